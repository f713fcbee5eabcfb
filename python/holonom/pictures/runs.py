"""Pictures of runs: channels, steps, residuals, energy, comparisons."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom import signals
from holonom.base.errors import UsageError
from holonom.base.names import listed
from holonom.base.text import quoted
from holonom.channels import require_name, split_component
from holonom.pictures.curves import STILL, Curves, curves
from holonom.pictures.picture import (
    COLORS,
    DASHES,
    MARKERS,
    REJECTED,
    Line,
    Panel,
    Picture,
    Series,
    thinned,
)
from holonom.pictures.traces import broken, dash_of, envelope, trace, walked

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.study.comparison import Comparison

#: Runs laid over each other, at most.
MOST_RUNS = 6
#: A spectrum shows so much less than its largest amplitude.
_DEPTH = 1e-6
#: Its axis ends so far beyond the last amplitude that tells something; resolutions that it shows.
_AIR, _LEAST_SHOWN = 1.15, 20.0
#: Points of a spectrum's line, about one to a pixel.
_PIXELS = 560


def plot(
    results: Sequence[Result],
    patterns: Sequence[str],
    *,
    labels: Sequence[str] | None,
    start: float | None,
    end: float | None,
    interval: float | None,
    versus: str | None,
    fft: bool | str,
    derivative: bool,
    low_pass: float | None,
) -> Picture:
    """Return the picture of channels one below the other; see `Result.plot`."""
    if len(results) > MOST_RUNS:
        raise UsageError(
            f"{len(results)} results are given", help=f"a picture shows {MOST_RUNS} of them at most"
        )
    first = results[0]
    names = _named(results, patterns) if patterns else first.requested
    if not names:
        raise UsageError("the run was asked for no channel", help="name at least one")
    if versus is not None and fft:
        raise UsageError("a spectrum is over frequencies", help="leave `fft` or `versus` out")
    across = [] if versus is None else [_scalar(results, versus)]
    called = _labels(results)
    absent = _absent(results, [*names, *across], called)
    common = [name for name in names if not any(name in lacking for lacking in absent.values())]
    if absent and (patterns or across or not common):
        raise _different_models(absent, common)
    names = common
    part: dict[str, Any] = {"start": start, "end": end, "interval": interval, "low_pass": low_pass}
    found = [
        curves(result, names, derivative=derivative, even=bool(fft), **part) for result in results
    ]
    stated = _stated_labels(labels, len(results))
    labels = stated or called if len(results) > 1 else [""]
    note = "" if low_pass is None else f"low-pass {low_pass:g} Hz"
    if fft:
        return _spectra(found, labels, "hann" if fft is True else str(fft), note)
    if versus is not None:
        over = [curves(result, across, **part)[0] for result in results]
        return _phases(found, over, labels, note)
    panels = [p for rows in zip(*found, strict=True) for p in _panels(rows, labels, note)]
    if absent:
        lacking = ", ".join(f"{run} has no {', '.join(names)}" for run, names in absent.items())
        panels[0] = replace(panels[0], note=", ".join(filter(None, (panels[0].note, lacking))))
    return Picture(", ".join(names), panels)


def _stated_labels(labels: object, runs: int) -> list[str]:
    """Return what some runs are to be called; nothing where it is not stated."""
    if labels is None:
        return []
    if isinstance(labels, str) or not isinstance(labels, Iterable):
        raise UsageError(f"`labels` is {quoted(repr(labels))}", help="pass a list of texts")
    stated = list(map(str, labels))
    if len(stated) != runs:
        raise UsageError(
            f"{len(stated)} labels are given for {runs} runs", help="give one for each"
        )
    return stated


def _named(results: Sequence[Result], patterns: Sequence[str]) -> list[str]:
    """Return the channels meant by names and patterns, each of the first run that has some."""
    found = [name for pattern in patterns for name in _meant(results, pattern)[1]]
    return list(dict.fromkeys(found))


def _meant(results: Sequence[Result], pattern: str) -> tuple[Result, list[str]]:
    """Return the first run that has what a pattern means, and the names of that."""
    for result in results:
        with contextlib.suppress(UsageError):
            return result, result.expand([pattern])
    return results[0], results[0].expand([pattern])  # refuses it, with the nearest names


def _absent(
    results: Sequence[Result], names: Sequence[str], called: Sequence[str]
) -> dict[str, list[str]]:
    """Return the channels that a run has not, or with as many components as the others, by run."""
    found = {}
    for result, label in zip(results, called, strict=True):
        sizes = [_size(result, name) for name in names]
        lacking = [
            name
            for name, size in zip(names, sizes, strict=True)
            if size is None or size != next(filter(None, (_size(one, name) for one in results)))
        ]
        if lacking:
            found[label] = lacking
    return found


def _size(result: Result, name: str) -> int | None:
    """Return how many components a channel has; None where there is no such channel."""
    if name not in result:
        return None
    whole, index = split_component(name)
    quantity = result.quantities.get(whole) or result.model.channels[whole]
    return quantity.size if index is None else 1


def _different_models(absent: dict[str, list[str]], common: Sequence[str]) -> UsageError:
    lacking = "; ".join(f"{run} has no {listed(names)}" for run, names in absent.items())
    return UsageError(
        f"the results are of different models: {lacking}",
        "simulation/unknown-channel",
        f"name channels that all of them have, such as {listed(common[:3])}"
        if common
        else "name channels that all of them have, such as `energy.total`",
    )


def channels(result: Result, names: Sequence[str], *, whole: bool = False) -> Picture:
    """Return a picture with a panel per channel, or more where components differ much in size.

    Parameters
    ----------
    result : Result
    names : sequence of str
    whole : bool
        Whether the lines have every row, for those who draw parts of them.
    """
    panels = [p for one in curves(result, names) for p in _panels([one], [""], "", whole=whole)]
    return Picture(", ".join(names), panels)


def _panels(
    rows: Sequence[Curves], labels: Sequence[str], note: str, *, whole: bool = False
) -> Iterator[Panel]:
    """Yield the panels of one channel of some runs: of several, one for each component."""
    first = rows[0]
    notes = ", ".join(filter(None, (frame_text(first.frame), note)))
    if len(rows) > 1:
        for i, word in enumerate(first.labels):
            lines = [
                trace(
                    one.time,
                    one.values[:, i],
                    label=label,
                    color=COLORS[k % len(COLORS)],
                    dash=DASHES[k % len(DASHES)],
                    wraps=one.wraps,
                )
                for k, (one, label) in enumerate(zip(rows, labels, strict=True))
            ]
            heading = f"{first.title}, {word}" if word else first.title
            still = all(one.still[i] for one in rows)
            least = STILL * max(float(one.tolerances[i]) for one in rows)
            unit = unit_of(first, i)
            said = _stillness(least, unit) if still else ""
            said = _ZERO if all(_is_zero(one, i) for one in rows) else said
            text = ", ".join(filter(None, (said, notes)))
            yield Panel(lines, unit, heading, text, least=least if still else 0.0)
        return
    draw = partial(_whole if whole else trace, wraps=first.wraps)
    marker = "circle" if first.time.size == 1 else ""  # a single row has no line to draw
    bounds = STILL * first.tolerances
    for number, together in enumerate(_together(first, bounds)):
        resting = [i for i in together if first.still[i]]
        lines = [
            draw(
                first.time,
                first.values[:, i],
                label=first.labels[i],
                color=COLORS[i % len(COLORS)],
                marker=marker,
            )
            for i in together
        ]
        heading = "" if number else first.title
        least = max((float(bounds[i]) for i in resting), default=0.0)
        unit = unit_of(first, together[0])
        zero = [i for i in together if _is_zero(first, i)]
        moving = [i for i in resting if i not in zero]
        parts = [
            text if len(these) == len(together) else f"{_words(first, these)} {text}"
            for these, text in ((zero, _ZERO), (moving, _stillness(least, unit)))
            if these
        ]
        text = ", ".join(filter(None, (*parts, "" if number else notes)))
        yield Panel(lines, unit, heading, text, least=least)


def _whole(t: Series, y: Series, *, label: str, color: str, marker: str, wraps: bool) -> Line:
    """Return a line with every row, interrupted as `trace` does it."""
    if wraps and envelope(t, y) is None:
        t, y = broken(t, y)
    return Line(t, y, label, color, marker, wraps=wraps)


def _together(one: Curves, bounds: Series) -> list[list[int]]:
    """Return which components share a panel: those of one unit that are seen on one scale."""
    groups: list[list[int]] = []
    for columns in _of_one_unit(one):
        found = grouped(one.values[:, columns], bounds[columns])
        groups += [[columns[k] for k in group] for group in found]
    return groups


def _of_one_unit(one: Curves) -> list[list[int]]:
    """Return the components of each unit."""
    units = dict.fromkeys(one.units)
    return [[i for i, other in enumerate(one.units) if other == unit] for unit in units]


#: Said of what is exactly that in every row.
_ZERO = "zero"


def _is_zero(one: Curves, component: int) -> bool:
    return one.time.size > 0 and not one.values[:, component].any()


def _words(one: Curves, these: Sequence[int]) -> str:
    return ", ".join(one.labels[i] for i in these)


def _stillness(bound: float, unit: str) -> str:
    return f"moves < {STILL:g} tolerances ({f'{bound:.1g} {unit}'.removesuffix(' –')})"


def _scalar(results: Sequence[Result], name: str) -> str:
    """Refuse a channel of several components: one must be named."""
    whole, index = split_component(require_name(name))
    result, found = _meant(results, name)
    quantity = result.quantities.get(whole) or result.model.channels.get(whole)
    if len(found) != 1 or (index is None and quantity is not None and quantity.size > 1):
        raise UsageError(
            f"{quoted(name)} is more than one number", help=f"take a component: {name}[0]"
        )
    return found[0]


def _phases(
    found: Sequence[Sequence[Curves]], over: Sequence[Curves], labels: Sequence[str], note: str
) -> Picture:
    """Return channels of some runs over another one, in which their rows are the same."""
    across = over[0]
    panels = []
    for rows in zip(*found, strict=True):
        first: Curves = rows[0]
        several = len(rows) > 1
        for i, word in enumerate(first.labels):
            lines = []
            for k, (run, one) in enumerate(zip(over, rows, strict=True)):
                x, y = run.values[:, 0], one.values[:, i]
                if one.wraps:
                    x, y = broken(x, y)
                if run.wraps:
                    x, y = broken(x, y, x)
                x, y = walked(x, y)
                color, dash = COLORS[k % len(COLORS)], dash_of(y, DASHES[k % len(DASHES)])
                lines.append(Line(x, y, labels[k] if several else "", color, dash=dash))
            whole = f"{first.title}, {word}" if word else first.title
            unit = unit_of(first, i)
            panels.append(Panel(lines, unit, whole, note))
    label = ", ".join(filter(None, (across.title, unit_text(across.units[0]))))
    return Picture(f"{', '.join(p.title for p in panels)} over {label}", panels, label, height=0.5)


def _spectra(
    found: Sequence[Sequence[Curves]], labels: Sequence[str], window: str, note: str
) -> Picture:
    every = [
        [signals.spectrum(one.time, one.values, window) for one in rows]
        for rows in zip(*found, strict=True)
    ]
    ends = [_last_told(spectra, rows[0]) for spectra, *rows in zip(every, *found, strict=True)]
    last, whole_range = max(ends), max(float(one.frequency[-1]) for row in every for one in row)
    drawn = "" if last >= whole_range else f"drawn to {last:.3g} of {whole_range:.4g} Hz"
    panels = []
    for spectra, *rows in zip(every, *found, strict=True):
        first: Curves = rows[0]
        told = (
            f"{window.replace('_', ' ')} window, resolution {spectra[0].resolution:.3g} Hz, "
            f"{first.time[0]:.4g} to {first.time[-1]:.4g} s"
        )
        several = len(rows) > 1
        parts = [[i] for i in range(len(first.labels))] if several else _of_one_unit(first)
        for together in parts:
            lines = []
            top = max(float(np.nanmax(one.amplitude[1:, together])) for one in spectra)
            for i in together:
                for k, (one, label) in enumerate(zip(spectra, labels, strict=True)):
                    at = k if several else i
                    seen = slice(1, np.searchsorted(one.frequency, last, side="right"))
                    x, y = _highest(one.frequency[seen], one.amplitude[seen, i], _DEPTH * top)
                    called, dash = label if several else first.labels[i], DASHES[k % len(DASHES)]
                    lines.append(Line(x, y, called, COLORS[at % len(COLORS)], dash=dash))
            lowest = min(float(first.tolerances[i]) for i in together)
            level = (lowest, "one tolerance") if _DEPTH * top < lowest else None
            word = first.labels[together[0]] if several else ""
            whole = f"{first.title}, {word}" if word else first.title
            unit = unit_of(first, together[0])
            notes = ", ".join(filter(None, (told, drawn, note)))
            panels.append(
                Panel(lines, f"amplitude, {unit}", whole, notes, logarithmic=True, level=level)
            )
    title_ = ", ".join(one.title for one in found[0])
    return Picture(f"amplitudes of {title_} by frequency", panels, "frequency, Hz", height=0.36)


def _last_told(spectra: Sequence[signals.Spectrum], first: Curves) -> float:
    """Return the frequency (Hz) that an axis ends at: beyond are amplitudes that tell nothing.

    They are below one tolerance, or so far below the highest that they are not shown.
    """
    ends = []
    for one in spectra:
        amplitude = one.amplitude[1:]
        least = np.maximum(first.tolerances, _DEPTH * np.nanmax(amplitude, axis=0, initial=0.0))
        told = np.nonzero((amplitude > least).any(axis=1))[0]
        last = one.frequency[told[-1] + 1] if told.size else 0.0
        last = max(_AIR * last, _LEAST_SHOWN * one.resolution)
        whole = float(one.frequency[-1])
        # What would gain little is drawn to its end.
        ends.append(last if last < 0.8 * whole else whole)
    return max(ends)


def _highest(x: Series, y: Series, least: float) -> tuple[Series, Series]:
    """Return the highest points of a spectrum, one to a pixel, at `least` where they are below."""
    if x.size > _PIXELS:
        edges = np.linspace(0, x.size, _PIXELS + 1).astype(int)[:-1]
        high = np.maximum.reduceat(y, edges)
        # The place of each: the first that is as high.
        index = [
            e + int(np.argmax(y[e:n] >= h))
            for e, n, h in zip(edges, [*edges[1:], None], high, strict=True)
        ]
        x, y = x[index], y[index]
    return x, np.maximum(y, least)


def _labels(results: Sequence[Result]) -> list[str]:
    """Return what runs are called beside each other: their files, or their models."""
    names = [one.path.stem if one.path else str(one.meta.get("name", "run")) for one in results]
    if len(set(names)) < len(names):
        names = [
            f"{one.path.parent.name}/{name}" if one.path else name
            for one, name in zip(results, names, strict=True)
        ]
    return [name if names.count(name) == 1 else f"{name} ({k + 1})" for k, name in enumerate(names)]


def step_sizes(steps: dict[str, NDArray[Any]]) -> Picture:
    """Return a picture of the step size over time, with rejected attempts marked."""
    accepted = steps["accepted"] > 0
    t, h = steps["t"], steps["h"]
    several = not accepted.all()
    label = "accepted" if several else ""
    lines = [trace(t[accepted], h[accepted], label=label)]
    if several:
        t, h = t[~accepted], h[~accepted]
        lines.append(Line(t, h, "rejected", color=REJECTED, marker="cross", drawn=False))
    return Picture("step size", [Panel(lines, "step size, s", logarithmic=True)], height=0.3)


def residuals(result: Result, names: Sequence[str]) -> Picture:
    """Return a picture of constraint residuals over time, on a logarithmic scale."""
    lines = []
    for number, name in enumerate(names):
        values = np.abs(result[name])
        shown = np.where(values > 0.0, values, np.nan)  # exactly satisfied: no point
        label = f"{name.partition('.')[2]}, {unit_text(result.unit(name))}"
        color = COLORS[number % len(COLORS)]
        lines.append(Line(*thinned(result.time, shown), label=label, color=color))
    empty = "all are exactly zero in every row" if result.time.size else "no rows"
    panel = Panel(lines, "largest residual", logarithmic=True, empty=empty)
    return Picture("constraint residuals", [panel], height=0.3)


def energy(result: Result, names: Sequence[str]) -> Picture:
    """Return a picture of the energy ledger, with the imbalance in a panel of its own."""
    terms = [name for name in names if name != "energy.imbalance"]
    lines = [
        trace(
            result.time,
            result[name],
            label=name.partition(".")[2].replace("_", " "),
            color=COLORS[number % len(COLORS)],
        )
        for number, name in enumerate(terms)
    ]
    panels = [Panel(lines, "energy, J")]
    if "energy.imbalance" in names:
        imbalance = trace(result.time, result["energy.imbalance"], color=REJECTED)
        panels.append(Panel([imbalance], "imbalance, J"))
    return Picture("energy", panels, height=0.27)


def work_precision(comparison: Comparison) -> Picture:
    """Return a picture of errors against processor time; see `Comparison.plot`."""
    lines, timed, zero = [], False, False
    for number, method in enumerate(comparison.methods):
        points = [
            (seconds, error)
            for row in sorted(comparison.of(method), key=lambda row: -row.tolerance.relative)
            if (seconds := row.cpu_seconds) and (error := comparison.error(row)) is not None
        ]
        shown = [point for point in points if point[1] > 0.0]
        timed, zero = timed or bool(points), zero or len(shown) < len(points)
        if shown:
            x, y = np.array(shown).T
            color, marker = COLORS[number % len(COLORS)], MARKERS[number % len(MARKERS)]
            lines.append(Line(x, y, method, color, marker))
    if not timed:
        raise UsageError(
            "there is nothing to draw: no run completed and was timed",
            help="the table says how each run ended",
        )
    level = (comparison.doubt, "reference, by its check") if comparison.doubt else None
    note = "errors that are exactly zero have no place on this axis" if zero else ""
    panel = Panel(
        lines, comparison.error_label, comparison.model, note, logarithmic=True, level=level,
        empty="all errors are exactly zero",
    )  # fmt: skip
    label = "processor time, s"
    return Picture("error against processor time", [panel], label, logarithmic=True, height=0.6)


def frame_text(frame: str) -> str:
    """Return what a channel's frame is called in a caption."""
    known = {"ground": "ground axes", "first": "axes of the first body", "along": ""}
    return known.get(frame, frame)


def unit_text(unit: str) -> str:
    """Return a unit as it is written."""
    return unit.replace("^2", "²").replace("^3", "³")


def unit_of(one: Curves, component: int) -> str:
    """Return the unit of a component as it is written."""
    return unit_text(one.units[component]) or "–"


def grouped(values: Series, bounds: Series | None = None) -> list[list[int]]:
    """Return which components share a panel: those whose movement is seen on a common scale.

    Parameters
    ----------
    values : ndarray, shape (n_times, n)
    bounds : ndarray, shape (n,), optional
        What moves less stands still; a millionth of the largest value when not given.
    """
    low, high = values.min(axis=0, initial=np.inf), values.max(axis=0, initial=-np.inf)
    least = 1e-6 * np.abs(values).max(initial=0.0)
    moves = high - low > (least if bounds is None else np.maximum(bounds, least))
    groups: list[list[int]] = []
    for i in range(values.shape[1]):
        for group in groups:
            joined = [*group, i]
            scale = high[joined].max() - low[joined].min()
            spans = [high[k] - low[k] for k in joined if moves[k]]
            if min(spans, default=np.inf) >= 0.1 * scale:
                group.append(i)
                break
        else:
            groups.append([i])
    return groups
