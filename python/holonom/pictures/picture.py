"""A picture before it is drawn: panels of lines, one below the other."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holonom.base.plain import as_path
from holonom.base.text import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Series = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers, on light and on dark paper.
COLORS = ("#3f7fbf", "#d9792b", "#3d9a6a", "#b0589f", "#8a7a3c", "#6f6f9f")
REJECTED = "#cc4444"
#: Signs at the points of a line.
MARKERS = ("circle", "square", "diamond", "down", "up", "plus", "cross")
#: How the lines of runs are broken, so that they are told apart without colours.
DASHES = ("", "7 3", "2 3", "9 3 2 3", "12 4", "4 2 1 2")
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
    dash : str
        Lengths of strokes and gaps; empty for an unbroken line.
    band : tuple of ndarray, or None
        Places, lower and upper ends of a range that is filled; interrupted where not finite.
    wraps : bool
        Whether it is an angle that jumps by whole turns, for those who draw ranges of it.
    """

    x: Series
    y: Series
    label: str = ""
    color: str = COLORS[0]
    marker: str = ""
    drawn: bool = True
    dash: str = ""
    band: tuple[Series, Series, Series] | None = None
    wraps: bool = False


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
    least : float
        The vertical axis shows at least such a range, so that noise is not shown large.
    empty : str
        What stands in it where no line has a point.
    """

    lines: list[Line]
    label: str
    title: str = ""
    note: str = ""
    logarithmic: bool = False
    level: tuple[float, str] | None = None
    least: float = 0.0
    empty: str = "no rows"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
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
        from holonom.pictures import plotting

        return plotting.save(self, as_path(path), inputs=inputs, force=force)

    def figure(self) -> Figure:
        """Return the picture as a figure of matplotlib, to change and add to.

        Raises
        ------
        UsageError
            If matplotlib is not installed.
        """
        from holonom.pictures import plotting

        return plotting.figure(self)

    def draw(self, axes: Axes | Sequence[Axes]) -> None:
        """Draw the panels on axes of matplotlib of one's own, one for each.

        Raises
        ------
        UsageError
            If there are not as many axes as panels.
        """
        from holonom.pictures import plotting

        plotting.draw(self, axes)

    def __repr__(self) -> str:
        count = len(self.panels)
        return f"<picture {shown(self.title)!r}: {count} panel{'s' if count != 1 else ''}>"

    def _repr_svg_(self) -> str:
        from holonom.pictures import svg

        return svg.document(self)


def thinned(t: Series, y: Series, most: int = POINTS) -> tuple[Series, Series]:
    """Return at most about so many points with the smallest and largest of every stretch.

    Where a stretch holds a value that is not finite, one of these stays, too: the line is
    interrupted there.
    """
    if t.size <= most:
        return t, y
    edges = np.linspace(0, t.size, most // 3 + 1).astype(int)
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
