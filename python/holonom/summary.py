"""The few lines that say how a run went."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from holonom.certificate import Certification
    from holonom.result import Result

#: Channels whose measured error is listed; the others are in the report and in the result.
CHANNELS_SHOWN = 12

#: Entries of the statistics in the order of reading, those that a summary names.
COUNTS = (
    "evaluations",
    "jacobians",
    "factorizations",
    "iterations",
    "reparametrizations",
)

#: What each status means to a reader.
STATUS = {
    "completed": "completed",
    "interrupted": "interrupted",
    "failed": "failed",
    "limit": "stopped at a limit",
    "killed": "killed while writing",
    "running": "not ended: still running, or killed",
}


def summarize(result: Result) -> list[tuple[str, str]]:
    """Return labels and texts: what was run, how, and how well it went."""
    facts = [("model", _model(result)), ("status", _status(result)), ("method", _method(result))]
    facts += [("items", items(result.written_out))]
    facts += _sizes(result)
    facts += [("outputs", _outputs(result))]
    facts += _steps(result)
    facts += _limits(result)
    facts += _work(result)
    facts += _residuals(result)
    facts += _energy(result)
    facts += _certification(result)
    if result.warnings:
        facts.append(("warnings", str(len(result.warnings))))
    return facts


def items(model: dict[str, Any]) -> str:
    """Return the counts of a model's items."""
    singular = {"bodies": "body", "joints": "joint", "forces": "force", "drivers": "driver"}
    counts = {kind: len(model.get(kind) or {}) for kind in singular}
    return ", ".join(
        f"{count} {singular[kind] if count == 1 else kind}" for kind, count in counts.items()
    )


def simulated(result: Result) -> tuple[float, float] | None:
    """Return when a run began and how far it came, s: output times may lie within."""
    start = result.options.get("start_time")
    if start is None and result.time.size:
        start = float(result.time[0])
    return None if start is None or result.until is None else (start, result.until)


def _model(result: Result) -> str:
    name, title = result.meta.get("name", ""), result.meta.get("title", "")
    return f"{name}: {title}" if title and title != name else str(name)


def _status(result: Result) -> str:
    text = STATUS.get(result.status, result.status)
    if result.until is not None:
        text += f" at {result.until:.6g} s"
    return text if result.time.size else f"{text}, nothing stored"


def _method(result: Result) -> str:
    options = result.options
    parts = [str(result.meta.get("method") or options.get("method") or "default method")]
    if options.get("fixed_step"):
        return ", ".join([*parts, f"fixed step {options['fixed_step']:g} s"])
    tolerance = options.get("tolerance")
    if isinstance(tolerance, dict):
        values = {float(v) for v in tolerance.values() if _is_number(v)}
        if len(values) == 1:
            tolerance = values.pop()
        else:
            units = {"relative": "", "translation": " m", "rotation": " rad"}
            tolerance = ", ".join(f"{k} {v:g}{units.get(k, '')}" for k, v in tolerance.items())
    if tolerance is not None:
        parts.append(f"tolerance {tolerance if isinstance(tolerance, str) else f'{tolerance:g}'}")
    return ", ".join(parts)


def _sizes(result: Result) -> list[tuple[str, str]]:
    quantities = result.quantities
    if "q" not in quantities:
        return []
    text = f"{quantities['q'].size}"
    if "lambda" in quantities:
        text += f", {quantities['lambda'].size} constraints"
    if result.meta.get("dof") is not None:
        dof = result.meta["dof"]
        text += f", {dof} degree{'' if dof == 1 else 's'} of freedom"
    if "z" in quantities and quantities["z"].size:
        text += f", {quantities['z'].size} extra states"
    return [("coordinates", text)]


def _outputs(result: Result) -> str:
    times = result.time
    span = f", {times[0]:.6g} to {times[-1]:.6g} s" if times.size else ""
    return f"{times.size} times{span}, {len(result.channels)} channels stored"


def _steps(result: Result) -> list[tuple[str, str]]:
    totals = result.step_totals
    if not totals:
        return []
    accepted = [row for row in totals if row[0]]
    rejected = [row for row in totals if not row[0]]
    text = f"{sum(row[2] for row in accepted)} accepted, {sum(row[2] for row in rejected)} rejected"
    if causes := [f"{cause} {count}" for _, cause, count, *_ in rejected if cause]:
        text += f" ({', '.join(causes)})"
    facts = [("steps", text)]
    for _, _, _, least, largest, mean in accepted:
        facts.append(("step size", f"{least:.2e} to {largest:.2e} s, mean {mean:.2e} s"))
    return facts


def _limits(result: Result) -> list[tuple[str, str]]:
    parts = _choices_that_limit(result)
    stiff = result.statistics.get("stiff_steps") or 0
    if stiff and any(w.get("code") == "simulation/stiff" for w in result.warnings):
        parts.append(f"stability, not accuracy, held the explicit code in {stiff} steps")
    elif text := limits(result.meta.get("limited_by") or {}):
        parts.append(text)
    return [("limited by", "; ".join(parts))] if parts else []


#: Part of `max_step` that steps have on average where that is what limits them.
_MOST = 0.9


def _choices_that_limit(result: Result) -> list[str]:
    """Return what was chosen of the steps' sizes, where that decided them."""
    options = result.meta.get("options") or {}
    parts = [part.get("options") or {} for part in result.meta.get("parts") or []]
    if any(part.get("fixed_step") != options.get("fixed_step") for part in parts):
        return ["`fixed_step`, which not all parts have alike"]
    if options.get("fixed_step"):
        return [f"`fixed_step`: every step has {options['fixed_step']:g} s"]
    largest = options.get("max_step")
    means = [row[-1] for row in result.step_totals if row[0]]
    if largest and means and means[0] >= _MOST * largest:
        return [f"`max_step`: steps have {means[0] / largest:.0%} of it on average"]
    return []


def limits(found: Mapping[str, Any]) -> str:
    """Return in one sentence what made a run take many steps, from its ``limited_by``."""
    parts = []
    if found.get("coordinate"):
        parts.append(
            f"the error of {found['coordinate']} was the largest in {found['steps']} of "
            f"{found['of']} steps that errors limited"
        )
    rejected = found.get("rejected") or {}
    if rejected.get("coordinate"):
        behind = rejected.get("force") or rejected["coordinate"]
        parts.append(
            f"{behind} stands behind {rejected['steps']} of {rejected['of']} rejected ones"
        )
    return "; ".join(parts)


def _work(result: Result) -> list[tuple[str, str]]:
    counts = [f"{result.statistics[key]} {key}" for key in COUNTS if key in result.statistics]
    facts = [
        ("" if first else "work", ", ".join(counts[first : first + 3]))
        for first in range(0, len(counts), 3)
    ]
    if (spent := result.statistics).get("contractions"):
        mean, largest = spent["mean_contraction"], spent["largest_contraction"]
        text = f"of iterations {mean:.2g} in the mean, at most {largest:.2g}"
        facts.append(("contraction", text))
    seconds = result.meta.get("cpu_seconds")
    if isinstance(seconds, int | float):
        text = f"{seconds:.3g} s"
        if (span := simulated(result)) is not None and span[1] > span[0]:
            text += f", {seconds / (span[1] - span[0]):.3g} s per simulated second"
        facts.append(("processor time", text))
    return facts


def _residuals(result: Result) -> list[tuple[str, str]]:
    largest = _numbers(result.residuals)
    ratio = largest.pop("largest_over_bound", None)
    parts = [f"{key.replace('_', ' ')} {value:.1e}" for key, value in largest.items()]
    parts += [f"at most {ratio:.1e} of the bound"] if ratio is not None else []
    return [("largest residuals", ", ".join(parts))] if parts else []


def _energy(result: Result) -> list[tuple[str, str]]:
    facts = []
    if at_end := _energy_at_end(result):
        text = ", ".join(f"{name.replace('_', ' ')} {v:.4g}" for name, v in at_end.items())
        facts.append(("energy at the end, J", text))
    if (worst := largest_imbalance(result)) is not None:
        text = f"{worst:.2e} J at most"
        if (moved := _energy_moved(result)) > 0.0:
            text += f", {worst / moved:.1e} of the energy that moved"
        facts.append(("energy imbalance", text))
    return facts


#: Terms of the energy balance.
_TERMS = ("kinetic", "potential", "dissipated", "driver_work")


def _energy_at_end(result: Result) -> dict[str, float]:
    """Return the terms of the energy balance, J, where the run ended, which need be no row."""
    told = {} if result.meta.get("end_time") is None else _numbers(result.energy)
    stored = {name: f"energy.{name}" for name in _TERMS if f"energy.{name}" in result.channels}
    rows = {name: result[channel][-1] for name, channel in stored.items() if result.time.size}
    found = {name: told.get(name, rows.get(name)) for name in _TERMS}
    return {name: value for name, value in found.items() if value is not None and value == value}


def largest_imbalance(result: Result) -> float | None:
    """Return the largest energy imbalance at a step or in a row, J; None where none is known.

    It is what the run itself has added: one that goes on with a changed model begins elsewhere.
    """
    sizes = [np.array([_numbers(result.energy).get("largest_imbalance", np.nan)])]
    begun = simulated(result)
    if "energy.imbalance" in result.channels and begun and begun[0] in result.time[:1]:
        imbalance = result["energy.imbalance"]
        sizes.append(np.abs(imbalance - imbalance[0]))
    worst = float(np.fmax.reduce(np.concatenate(sizes)))  # rows that are lost are NaN
    return worst if np.isfinite(worst) else None


def _energy_moved(result: Result) -> float:
    """Return the energy that moved, J, as the run says it or as its rows do."""
    if moved := _numbers(result.energy).get("moved"):
        return moved
    rows = [result[f"energy.{name}"] for name in _TERMS if f"energy.{name}" in result.channels]
    spans = [np.fmax.reduce(values) - np.fmin.reduce(values) for values in rows if values.size]
    return float(np.fmax.reduce(spans, initial=0.0))


def _certification(result: Result) -> list[tuple[str, str]]:
    found = result.certification
    if found is None:
        return []
    facts = [("certified", certified(found))]
    for index, channel in enumerate(found.ranked[:CHANNELS_SHOWN]):
        text = f"{channel.tolerances:8.3g} tolerances  {channel.name}"
        text += f": {with_unit(channel.error, channel.unit)} at {channel.time:.6g} s"
        facts.append(("" if index else "measured errors", text))
    if more := found.ranked[CHANNELS_SHOWN:]:
        text = f"{more[0].tolerances:8.3g} tolerances  {len(more)} more channels, at most"
        facts.append(("", text))
    return facts


def certified(found: Certification) -> str:
    """Return in one line whether a result is certified."""
    if found.reason:
        return f"no: {found.reason['message']}"
    count, beyond = len(found.channels), len(found.exceeding)
    what = f"within {found.bound:g} tolerances of a run at a tenth of the tolerance"
    channels = "channel" if count == 1 else "channels"
    if beyond:
        return f"no: {beyond} of {count} {channels} not {what}"
    return f"yes: {count} {channels} {what}"


def with_unit(value: float, unit: str) -> str:
    """Return a small number with its unit."""
    return f"{value:.2e} {unit}".rstrip()


def _numbers(data: Mapping[str, Any]) -> dict[str, float]:
    return {key: float(value) for key, value in data.items() if _is_number(value)}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
