"""What pictures show: panels of lines over one another, before anything is drawn."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from holonom.result import Result
    from holonom.study.comparison import Comparison

Series = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers, on light and on dark paper.
COLORS = ("#3f7fbf", "#d9792b", "#3d9a6a", "#b0589f", "#8a7a3c", "#6f6f9f")
REJECTED = "#cc4444"
#: Signs at the points of a line.
MARKERS = ("circle", "square", "diamond", "down", "up", "plus", "cross")
#: Points drawn per line; more would not be seen.
POINTS = 1500


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Points in their order.

    Attributes
    ----------
    x, y : ndarray, shape (n_points,)
        Where `y` is not finite the line is interrupted.
    label : str
        Name in the legend; empty for none.
    color : str
        ``#rrggbb``; empty for the ink of axes and texts.
    marker : str
        One of `MARKERS` at every point; empty for none.
    drawn : bool
        Whether the points are joined.
    """

    x: Series
    y: Series
    label: str = ""
    color: str = COLORS[0]
    marker: str = ""
    drawn: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Lines in one pair of axes.

    Attributes
    ----------
    lines : list of Line
    label : str
        Of the vertical axis, with the unit.
    title, note : str
        Above it; the note is fainter.
    logarithmic : bool
        Whether the vertical axis is.
    level : tuple of float and str, or None
        A dotted horizontal line with its name.
    """

    lines: list[Line]
    label: str
    title: str = ""
    note: str = ""
    logarithmic: bool = False
    level: tuple[float, str] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Panels one below the other over a common horizontal axis; notebooks show it.

    Attributes
    ----------
    title : str
        What is read out where the picture is not seen.
    panels : list of Panel
    label : str
        Of the horizontal axis, with the unit.
    logarithmic : bool
        Whether the horizontal axis is.
    height : float
        Of a panel, against its width.
    """

    title: str
    panels: list[Panel] = field(default_factory=list)
    label: str = "time, s"
    logarithmic: bool = False
    height: float = 0.24

    def save(
        self,
        path: str | Path,
        *,
        inputs: Iterable[Path | None] = (),
        force: bool = False,
    ) -> Path:
        """Write the picture, SVG, PDF or PNG by its ending, and return the path.

        Parameters
        ----------
        path : path
        inputs : iterable of Path or None
            Files that it was made from, which are never replaced.
        force : bool
            Whether a file that is no picture by Holonom may be replaced.

        Raises
        ------
        UsageError
            If the format is not known, or needs matplotlib, which is not installed.
        FileError
            If the file cannot be written.
        """
        from holonom import plotting

        return plotting.save(self, Path(path), inputs=inputs, force=force)

    def figure(self) -> Figure:
        """Return the picture as a figure of matplotlib, to change and add to.

        Raises
        ------
        UsageError
            If matplotlib is not installed.
        """
        from holonom import plotting

        return plotting.figure(self)

    def draw(self, axes: Axes | Sequence[Axes]) -> None:
        """Draw the panels on axes of matplotlib of one's own, one for each.

        Raises
        ------
        UsageError
            If there are not as many axes as panels.
        """
        from holonom import plotting

        plotting.draw(self, axes)

    def _repr_svg_(self) -> str:
        from holonom import svg

        return svg.document(self)


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


def thinned(t: Series, y: Series) -> tuple[Series, Series]:
    """Return at most about `POINTS` points with the smallest and largest of every stretch.

    Where a stretch holds a value that is not finite, one of these stays, too: the line is
    interrupted there.
    """
    if t.size <= POINTS:
        return t, y
    edges = np.linspace(0, t.size, POINTS // 3 + 1).astype(int)
    finite = np.isfinite(y)
    kept: list[int] = [0, t.size - 1]
    for first, last in itertools.pairwise(edges):
        there = np.nonzero(finite[first:last])[0]
        stretch = y[first:last][there]
        if there.size:
            kept += [first + int(there[stretch.argmin()]), first + int(there[stretch.argmax()])]
        if there.size < last - first:
            kept.append(first + int(np.argmin(finite[first:last])))
    index = np.unique(kept)
    return t[index], y[index]


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
