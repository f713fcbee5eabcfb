"""The pictures of runs and comparisons: which lines stand in which panel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import UsageError
from holonom.pictures.picture import (
    COLORS,
    MARKERS,
    REJECTED,
    Line,
    Panel,
    Picture,
    Series,
    thinned,
)

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.study.comparison import Comparison


def plot(result: Result, patterns: Sequence[str]) -> Picture:
    """Return the picture of channels one below the other; see `Result.plot`."""
    names = result.expand(list(patterns)) if patterns else result.requested
    if not names:
        raise UsageError("the run was asked for no channel", help="name at least one")
    return channels(result, names)


def channels(result: Result, names: Sequence[str]) -> Picture:
    """Return a picture with a panel per channel, or more where components differ much in size."""
    panels = []
    for name in names:
        values = result.matrix(name)
        labels = components(name, values.shape[1])
        marker = "circle" if result.time.size == 1 else ""  # a single row has no line to draw
        for number, together in enumerate(grouped(values)):
            lines = [
                Line(
                    *thinned(result.time, values[:, i]),
                    label=labels[i],
                    color=COLORS[i % len(COLORS)],
                    marker=marker,
                )
                for i in together
            ]
            title, note = ("", "") if number else (name, frame_text(result.frame(name)))
            panels.append(Panel(lines, unit_text(result.unit(name)) or "–", title, note))
    return Picture(", ".join(names), panels)


def step_sizes(steps: dict[str, NDArray[Any]]) -> Picture:
    """Return a picture of the step size over time, with rejected attempts marked."""
    accepted = steps["accepted"] > 0
    t, h = steps["t"], steps["h"]
    several = not accepted.all()
    label = "accepted" if several else ""
    lines = [Line(*thinned(t[accepted], h[accepted]), label=label)]
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
    panel = Panel(lines, "largest residual", logarithmic=True)
    return Picture("constraint residuals", [panel], height=0.3)


def energy(result: Result, names: Sequence[str]) -> Picture:
    """Return a picture of the energy ledger, with the imbalance in a panel of its own."""
    terms = [name for name in names if name != "energy.imbalance"]
    lines = [
        Line(
            *thinned(result.time, result[name]),
            label=name.partition(".")[2].replace("_", " "),
            color=COLORS[number % len(COLORS)],
        )
        for number, name in enumerate(terms)
    ]
    panels = [Panel(lines, "energy, J")]
    if "energy.imbalance" in names:
        imbalance = Line(*thinned(result.time, result["energy.imbalance"]), color=REJECTED)
        panels.append(Panel([imbalance], "imbalance, J"))
    return Picture("energy", panels, height=0.27)


def work_precision(comparison: Comparison) -> Picture:
    """Return a picture of errors against processor time; see `Comparison.plot`."""
    lines = []
    for number, method in enumerate(comparison.methods):
        points = [
            (seconds, error)
            for row in sorted(comparison.of(method), key=lambda row: -row.tolerance.relative)
            if (seconds := row.cpu_seconds) and (error := comparison.error(row))
        ]
        if points:
            x, y = np.array(points).T
            color, marker = COLORS[number % len(COLORS)], MARKERS[number % len(MARKERS)]
            lines.append(Line(x, y, method, color, marker))
    if not lines:
        raise UsageError(
            "there is nothing to draw: no run completed and was timed",
            help="the table says how each run ended",
        )
    level = (comparison.doubt, "reference, by its check") if comparison.doubt else None
    panel = Panel(lines, comparison.error_label, comparison.model, logarithmic=True, level=level)
    label = "processor time, s"
    return Picture("error against processor time", [panel], label, logarithmic=True, height=0.6)


def components(name: str, size: int) -> list[str]:
    """Return the names of a channel's components."""
    if size == 1:
        return [""]
    if name.endswith(".euler_parameters"):
        return [f"e{i}" for i in range(size)]
    if name.endswith(".yaw_pitch_roll"):
        return ["yaw", "pitch", "roll"]
    return list("xyz"[:size]) if size <= 3 else [f"[{i}]" for i in range(size)]


def frame_text(frame: str) -> str:
    """Return what a channel's frame is called in a caption."""
    known = {"ground": "ground axes", "first": "axes of the first body's frame", "along": ""}
    return known.get(frame, frame)


def unit_text(unit: str) -> str:
    """Return a unit as it is written."""
    return unit.replace("^2", "²").replace("^3", "³")


def grouped(values: Series) -> list[list[int]]:
    """Return which components share a panel: those whose movement is seen on a common scale."""
    low, high = values.min(axis=0, initial=np.inf), values.max(axis=0, initial=-np.inf)
    moves = high - low > 1e-6 * np.abs(values).max(initial=0.0)
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
