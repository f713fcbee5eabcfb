"""Figures of channels, steps, residuals and energy."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom import files
from holonom.errors import UsageError

try:
    import matplotlib as mpl
    from cycler import cycler
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
except ModuleNotFoundError as error:
    if (error.name or "").partition(".")[0] != "matplotlib":
        raise
    raise UsageError(
        "plots and reports need matplotlib, which is not installed; "
        "it comes with the extra `plot`, as in `pip install '.[plot]'`"
    ) from None

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.study.comparison import Comparison

Series = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers, on light and on dark paper.
COLORS = ("#3f7fbf", "#d9792b", "#3d9a6a", "#b0589f", "#8a7a3c", "#6f6f9f")
REJECTED = "#cc4444"
MARKERS = "osD^vPX"
#: Points drawn per line; more would not be seen.
POINTS = 3000

# Axes, ticks and texts in this colour follow the page's text colour in an inlined picture.
_INK = "#1f2326"
_STYLE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": _INK,
    "axes.grid": True,
    "axes.labelcolor": _INK,
    "axes.linewidth": 0.7,
    "axes.prop_cycle": cycler(color=COLORS),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "font.size": 9.0,
    "grid.alpha": 0.25,
    "grid.color": _INK,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.labelcolor": _INK,
    "lines.linewidth": 1.3,
    "svg.fonttype": "none",
    "svg.hashsalt": "holonom",  # the same picture gives the same file
    "text.color": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
}


def plot(
    result: Result, patterns: Sequence[str], path: Path | None = None, *, force: bool = False
) -> Figure:
    """Draw channels one below the other; see `Result.plot`."""
    names = result.expand(list(patterns)) if patterns else result.requested
    if not names:
        raise UsageError("name at least one channel; the run was asked for none")
    figure = channels(result, names)
    if path is not None:
        save(figure, path, inputs=[result.path], force=force)
    return figure


def channels(result: Result, names: Sequence[str]) -> Figure:
    """Return a figure with one plot per channel over time."""
    plots = [
        (name, together, number == 0)
        for name in names
        for number, together in enumerate(_grouped(result.matrix(name)))
    ]
    rows = result.time.size
    with mpl.rc_context(_STYLE):
        figure, axes = _stack(len(plots), 1.9)
        for one, (name, together, first) in zip(axes, plots, strict=True):
            values = result.matrix(name)
            labels = components(name, values.shape[1])
            for i in together:
                line = thinned(result.time, values[:, i])
                # A single row has no line to draw.
                marker = "o" if rows == 1 else None
                one.plot(*line, label=labels[i], color=COLORS[i % len(COLORS)], marker=marker)
            if not rows:
                one.text(0.5, 0.5, "no rows", ha="center", transform=one.transAxes)
            if first:
                title = ", ".join(filter(None, (name, frame_text(result.frame(name)))))
                one.set_title(title, loc="left", fontsize=9)
            one.set_ylabel(unit_text(result.unit(name)) or "–")
            if len(labels) > 1:
                one.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
        axes[-1].set_xlabel("time, s")
    return figure


def step_sizes(steps: dict[str, NDArray[Any]]) -> Figure:
    """Return a figure of the step size over time, with rejected attempts marked."""
    with mpl.rc_context(_STYLE):
        figure, (axes,) = _stack(1, 2.4)
        accepted = steps["accepted"] > 0
        t, h = steps["t"], steps["h"]
        axes.plot(*thinned(t[accepted], h[accepted]), label="accepted")
        if not accepted.all():
            axes.plot(
                t[~accepted], h[~accepted], "x", color=REJECTED, markersize=4, label="rejected"
            )
            axes.legend(loc="best", fontsize=8)
        axes.set_yscale("log")
        axes.set_ylabel("step size, s")
        axes.set_xlabel("time, s")
    return figure


def residuals(result: Result, names: Sequence[str]) -> Figure:
    """Return a figure of constraint residuals over time, on a logarithmic scale."""
    with mpl.rc_context(_STYLE):
        figure, (axes,) = _stack(1, 2.4)
        for name in names:
            values = np.abs(result[name])
            shown = np.where(values > 0.0, values, np.nan)  # exactly satisfied: no point
            label = f"{name.partition('.')[2]}, {unit_text(result.unit(name))}"
            axes.plot(*thinned(result.time, shown), label=label)
        axes.set_yscale("log")
        axes.set_ylabel("largest residual")
        axes.set_xlabel("time, s")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    return figure


def energy(result: Result, names: Sequence[str]) -> Figure:
    """Return a figure of the energy ledger, with the imbalance in a plot of its own."""
    terms = [name for name in names if name != "energy.imbalance"]
    with mpl.rc_context(_STYLE):
        figure, axes = _stack(1 + ("energy.imbalance" in names), 2.2)
        for name in terms:
            label = name.partition(".")[2].replace("_", " ")
            axes[0].plot(*thinned(result.time, result[name]), label=label)
        axes[0].set_ylabel("energy, J")
        axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
        if "energy.imbalance" in names:
            axes[1].plot(*thinned(result.time, result["energy.imbalance"]), color=REJECTED)
            axes[1].set_ylabel("imbalance, J")
        axes[-1].set_xlabel("time, s")
    return figure


def work_precision(
    comparison: Comparison, path: Path | None = None, *, force: bool = False
) -> Figure:
    """Draw errors against processor time; see `Comparison.plot`."""
    lines = {
        method: [
            (seconds, error)
            for row in sorted(comparison.of(method), key=lambda row: -row.tolerance.relative)
            if (seconds := row.cpu_seconds) and (error := comparison.error(row))
        ]
        for method in comparison.methods
    }
    if not any(lines.values()):
        raise UsageError("there is nothing to draw: no run completed and was timed")
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 4.6), layout="constrained")
        axes = figure.subplots()
        for number, (method, points) in enumerate(lines.items()):
            if points:
                color, marker = COLORS[number % len(COLORS)], MARKERS[number % len(MARKERS)]
                x, y = zip(*points, strict=True)
                axes.plot(x, y, marker=marker, markersize=5, color=color, label=method)
        if comparison.doubt:
            text = "reference, by its check"
            axes.axhline(comparison.doubt, color=_INK, linewidth=0.8, linestyle=":", label=text)
        axes.set_xscale("log")
        axes.set_yscale("log")
        low, high = axes.get_xlim()
        axes.xaxis.set_major_locator(
            LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,))
        )
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("processor time, s")
        axes.set_ylabel(comparison.error_label)
        axes.set_title(comparison.model, loc="left", fontsize=9)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    if path is not None:
        save(figure, path, force=force)
    return figure


def save(
    figure: Figure, path: Path, *, inputs: Iterable[Path | None] = (), force: bool = False
) -> None:
    """Write a figure; the ending tells the format.

    Raises
    ------
    UsageError
        If the format is not known.
    FileError
        If the file cannot be written.
    """
    kind = require_format(path)
    dated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    metadata = {("Software" if kind == "png" else "Creator"): "Holonom", **dated}
    drawn = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(drawn, dpi=160, facecolor="white", metadata=metadata, format=kind)
    with files.replacing(path, kind, inputs=inputs, force=force) as fresh:
        fresh.write_bytes(drawn.getbuffer())


#: Formats of pictures, by the ending of the file.
PICTURES = ("svg", "pdf", "png")


def require_format(path: Path) -> str:
    """Return the format that a picture's ending tells.

    Raises
    ------
    UsageError
        If it is not known.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in PICTURES:
        raise UsageError(f"{path}: pictures end in {', '.join(f'.{k}' for k in PICTURES)}")
    return kind


def inline_svg(figure: Figure, title: str) -> str:
    """Return a figure as an SVG element that takes text colour and width from its page."""
    text = io.StringIO()
    with mpl.rc_context(_STYLE | {"svg.hashsalt": title}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :].replace(_INK, "currentColor")
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, count=1, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    label = title.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)


def components(name: str, size: int) -> list[str]:
    """Return the names of a channel's components."""
    if size == 1:
        return [""]
    if name.endswith(".euler_parameters"):
        return [f"e{i}" for i in range(size)]
    return list("xyz"[:size]) if size <= 3 else [f"[{i}]" for i in range(size)]


def thinned(t: Series, y: Series) -> tuple[Series, Series]:
    """Return at most about `POINTS` points with the smallest and largest of every stretch."""
    if t.size <= POINTS:
        return t, y
    edges = np.linspace(0, t.size, POINTS // 2 + 1).astype(int)
    kept: list[int] = [0, t.size - 1]
    for first, last in itertools.pairwise(edges):
        stretch = y[first:last]
        if np.isfinite(stretch).any():
            kept += [first + int(np.nanargmin(stretch)), first + int(np.nanargmax(stretch))]
    index = np.unique(kept)
    return t[index], y[index]


def frame_text(frame: str) -> str:
    """Return what a channel's frame is called in a caption."""
    known = {"ground": "ground axes", "first": "axes of the first body's frame", "along": ""}
    return known.get(frame, frame)


def unit_text(unit: str) -> str:
    """Return a unit as it is written."""
    return unit.replace("^2", "²").replace("^3", "³")


def _grouped(values: Series) -> list[list[int]]:
    """Return which components share a plot: those whose movement is seen on a common scale."""
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


def _stack(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(8.2, 0.5 + height * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)
    return figure, list(axes[:, 0])
