"""Pictures as files, and on axes of matplotlib, which is an extra."""

from __future__ import annotations

import importlib
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from holonom.base import files
from holonom.base.errors import UsageError
from holonom.base.names import listed
from holonom.base.text import quoted
from holonom.pictures import svg, ticks
from holonom.pictures.picture import COLORS, Line, Panel, Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Endings of files with pictures; all but the first need matplotlib.
FORMATS = ("svg", "pdf", "png")

_INK = "#1f2326"
_FONT, _SMALL = 9.0, 8.0  # pt
_SAMPLE = 52.0  # pt, of a line in the legend with the gaps beside it
_ROW = 12.0  # pt, of the legend
_MOST_LABELS = 7  # of a logarithmic axis
_NARROW = 3.0  # end of such an axis over its beginning, up to which it is labelled evenly
_STYLE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": _INK,
    "axes.grid": True,
    "axes.labelcolor": _INK,
    "axes.linewidth": 0.7,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": _FONT,
    "grid.alpha": 0.25,
    "grid.color": _INK,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.labelcolor": _INK,
    "lines.linewidth": 1.3,
    "text.color": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
}
_MARKERS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "down": "v",
    "up": "^",
    "plus": "P",
    "cross": "x",
}


def require_format(path: Path) -> str:
    """Return the format that a picture's ending tells.

    Raises
    ------
    UsageError
        If it is not known, or needs matplotlib, which is not installed.
    """
    kind = files.ending_of(path).removeprefix(".")
    if kind not in FORMATS:
        ending = f"there are no pictures as {quoted(path.suffix)}" if kind else "it has no ending"
        endings = listed(f".{known}" for known in FORMATS)
        raise UsageError(f"{path}: {ending}", help=f"pictures end in {endings}")
    if kind != "svg":
        _require_matplotlib(f"pictures that end in .{kind}")
    return kind


def save(
    picture: Picture,
    path: Path,
    *,
    inputs: Iterable[Path | None] = (),
    force: bool = False,
) -> Path:
    """Write a picture; see `Picture.save`. `inputs` and `force` are as of `files.replacing`."""
    kind = require_format(path)
    with files.replacing(path, kind, inputs=inputs, force=force) as fresh:
        if kind == "svg":
            fresh.write_text(svg.document(picture), encoding="utf-8")
        else:
            # The mark by which the file is known again, and nothing that changes from day to day.
            metadata = {"Software" if kind == "png" else "Creator": "Holonom"}
            dated = {"CreationDate": None} if kind == "pdf" else {}
            # In memory first: on a full disk the library's own clean-up would fail once more.
            drawn = io.BytesIO()
            made = figure(picture)
            made.savefig(drawn, dpi=160, metadata=metadata | dated, format=kind, facecolor="white")
            fresh.write_bytes(drawn.getbuffer())
    return path


def figure(picture: Picture) -> Figure:
    """Return a picture as a figure of matplotlib; see `Picture.figure`."""
    _require_matplotlib("figures")
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        width, count = 7.0, max(len(picture.panels), 1)
        height = 0.6 + (picture.height * width + 0.3) * count
        made = Figure(figsize=(width, height), layout="constrained")
        axes = made.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        draw(picture, list(axes)[: len(picture.panels)])
    return made


def draw(picture: Picture, axes: Axes | Sequence[Axes]) -> None:
    """Draw the panels of a picture on axes; see `Picture.draw`."""
    several: list[Any] = list(axes) if hasattr(axes, "__iter__") else [axes]
    if len(several) != len(picture.panels):
        raise UsageError(
            f"the picture has {len(picture.panels)} panels, and there are {len(several)} axes"
            "\n  help: `len(Picture.panels)` tells how many axes are needed"
        )
    for one in several:
        if not hasattr(one, "plot"):
            tip = "pass axes of matplotlib, as `plt.subplots()` makes them"
            raise UsageError(f"{quoted(repr(one))} is no axes", help=tip)
    for one, panel in zip(several, picture.panels, strict=True):
        for line in panel.lines:
            if line.band is not None:
                one.fill_between(*line.band, color=line.color or COLORS[0], alpha=0.25, linewidth=0)
            one.plot(line.x, line.y, **_style(line))
        _widen(one, panel)
        if not any(np.isfinite(line.y).any() for line in panel.lines):
            middle = {"ha": "center", "va": "center", "transform": one.transAxes}
            one.text(0.5, 0.5, panel.empty, alpha=0.65, **middle)
        if panel.level is not None:
            value, label = panel.level
            one.axhline(value, color=_INK, linewidth=0.8, linestyle=":", label=label)
        one.set_xscale("log" if picture.logarithmic else "linear")
        one.set_yscale("log" if panel.logarithmic else "linear")
        for axis, logarithmic in ((one.xaxis, picture.logarithmic), (one.yaxis, panel.logarithmic)):
            if logarithmic:
                _few_labels(axis)
        rows = _legend(one)
        title = ", ".join(filter(None, (panel.title, panel.note)))
        one.set_title(title, loc="left", fontsize=_FONT, pad=4.0 + _ROW * rows)
        one.set_ylabel(panel.label)
    if several:
        several[-1].set_xlabel(picture.label)


def _few_labels(axis: Any) -> None:
    """Label powers of ten, or in a narrow range round numbers, and so few that none overlap."""
    from matplotlib import ticker

    low, high = sorted(axis.get_view_interval())
    if high > _NARROW * low:
        between = ticks.between(low, high)
        axis.set_major_locator(ticker.LogLocator(subs=between, numticks=_MOST_LABELS))
        axis.set_major_formatter(ticker.LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf)))
    else:
        axis.set_major_locator(ticker.MaxNLocator(_MOST_LABELS - 2))
        axis.set_major_formatter(ticker.ScalarFormatter())
        axis.set_minor_locator(ticker.NullLocator())
    axis.set_minor_formatter(ticker.NullFormatter())


def _legend(axes: Axes) -> int:
    """Name the lines above the axes, where none of them is, and return in how many rows."""
    handles, labels = axes.get_legend_handles_labels()
    if not labels:
        return 0
    whole = axes.get_figure(root=True)
    assert whole is not None
    width = axes.get_position().width * whole.get_figwidth() * 72.0  # pt
    entries = [svg.shortened(label, width - _SAMPLE, _SMALL) for label in labels]
    widest = max(svg.text_width(text, _SMALL) for text in entries) + _SAMPLE
    columns = min(max(int(width / widest), 1), len(entries))
    axes.legend(
        handles,
        entries,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        fontsize=_SMALL,
        borderaxespad=0.1,
        borderpad=0.1,
        columnspacing=1.2,
        handlelength=4.0,
        labelspacing=0.25,
    )
    return -(-len(entries) // columns)


def _style(line: Line) -> dict[str, Any]:
    return {
        "color": line.color or COLORS[0],
        "label": line.label or None,
        "linestyle": _dashes(line) if line.drawn else "none",
        "marker": _MARKERS[line.marker] if line.marker else None,
        "markersize": 4.5,
    }


def _dashes(line: Line) -> Any:
    return (0, tuple(map(float, line.dash.split()))) if line.dash else "-"


def _widen(axes: Axes, panel: Panel) -> None:
    """Show at least the range of the panel, about what is drawn."""
    if not panel.least:
        return
    low, high = axes.get_ylim()
    more = 0.5 * (panel.least - (high - low))
    if more > 0.0:
        axes.set_ylim(low - more, high + more)


def _require_matplotlib(what: str) -> None:
    try:
        importlib.import_module("matplotlib")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        raise UsageError(
            f"{what} need matplotlib, which is not installed; it comes with the extra `plot`, or "
            "by `pip install matplotlib`\n  help: pictures that end in .svg need nothing else"
        ) from None
