"""Signals as lines of so many points as are seen, and as ranges where no line is."""

from __future__ import annotations

import numpy as np

from holonom.pictures.picture import COLORS, POINTS, Line, Series, thinned

#: Parts of a picture's width, two pixels each, in which a curve turns back so often or more that
#: it would be a bar of ink: there its range is shown.
COLUMNS, TURNS = 280, 2
#: A line that turns back more often is not dashed.
MOST_DASHED = 20
#: Neighbours of such a part over which the mean is taken.
_AROUND = 3


def trace(
    t: Series,
    y: Series,
    *,
    label: str = "",
    color: str = "",
    marker: str = "",
    dash: str = "",
    wraps: bool = False,
) -> Line:
    """Return a signal as a line, with its range and its mean where it turns back too often.

    Where `wraps`, the line is interrupted at jumps by a whole turn, and a range that has some
    stands without a mean, which would say nothing. What turns often is not dashed.
    """
    color = color or COLORS[0]
    found = envelope(t, y, wraps=wraps)
    if found is None:
        if wraps:
            t, y = broken(t, y)
        x, line = thinned(t, y)
        return Line(x, line, label, color, marker, dash=dash_of(line, dash))
    x, low, high, mean = found
    return Line(x, mean, label, color, marker, dash=dash, band=(x, low, high))


def dash_of(y: Series, dash: str) -> str:
    """Return how a line is broken: not at all where gaps would cut its swings to pieces."""
    steps = np.diff(y[np.isfinite(y)])
    moves = steps[np.abs(steps) > 1e-3 * (np.ptp(y[np.isfinite(y)]) if steps.size else 0.0)]
    turns = int((np.sign(moves[1:]) != np.sign(moves[:-1])).sum())
    return "" if turns > MOST_DASHED else dash


def broken(x: Series, y: Series, angle: Series | None = None) -> tuple[Series, Series]:
    """Return a line that is interrupted where an angle, or `y`, jumps by more than half a turn."""
    jumps = np.nonzero(np.abs(np.diff(y if angle is None else angle)) > np.pi)[0] + 1
    middle = 0.5 * (x[jumps - 1] + x[jumps])
    return np.insert(x, jumps, middle), np.insert(y, jumps, np.nan)


def envelope(
    t: Series, y: Series, *, wraps: bool = False
) -> tuple[Series, Series, Series, Series] | None:
    """Return a signal by its range where it would be a bar of ink, or None where it is nowhere.

    Returns
    -------
    tuple of ndarray, shape (n,)
        Places, low and high ends (NaN where the signal is a line), and the line: the signal's own
        points there, elsewhere its mean over some pixels; where it `wraps`, NaN at jumps and in
        place of means over some.
    """
    if t.size < 3 * TURNS or not np.isfinite(y).all() or not t[-1] > t[0]:
        return None
    place = (t - t[0]) / (t[-1] - t[0]) * COLUMNS
    column = np.minimum(place.astype(int), COLUMNS - 1)
    range_ = float(np.ptp(y))
    rising = np.sign(np.where(np.abs(np.diff(y)) > 1e-3 * range_, np.diff(y), 0.0))
    moves = np.nonzero(rising)[0]
    back = moves[1:][rising[moves[1:]] != rising[moves[:-1]]]
    turns = np.bincount(column[back], minlength=COLUMNS)
    edges = np.searchsorted(column, np.arange(COLUMNS + 1))
    filled = np.nonzero(np.diff(edges) > 0)[0]
    low, high = np.full(COLUMNS, np.nan), np.full(COLUMNS, np.nan)
    low[filled] = np.minimum.reduceat(y, edges[filled])
    high[filled] = np.maximum.reduceat(y, edges[filled])
    dense = (turns >= TURNS) & (high - low > 0.01 * range_)
    # Single calm columns between dense ones are part of them, single dense ones are lines.
    dense[1:-1] |= dense[:-2] & dense[2:] & np.isfinite(low[1:-1])
    dense[1:-1] &= dense[:-2] | dense[2:]
    if dense.sum() < 4:
        return None
    # Over some more pixels: two of them hold no whole number of periods.
    sums = np.concatenate([[0.0], np.cumsum(y)])
    first = edges[np.maximum(np.arange(COLUMNS) - _AROUND, 0)]
    last = edges[np.minimum(np.arange(COLUMNS) + _AROUND + 1, COLUMNS)]
    mean = (sums[last] - sums[first]) / np.maximum(last - first, 1)
    if wraps:
        leaps = np.concatenate([[0], np.cumsum(np.abs(np.diff(y)) > np.pi), [0]])
        mean[leaps[np.maximum(last - 1, first)] > leaps[first]] = np.nan
    middle = t[0] + (np.arange(COLUMNS) + 0.5) * (t[-1] - t[0]) / COLUMNS
    calm = ~dense[column]
    calm_t, calm_y = thinned(t[calm], y[calm]) if calm.any() else (t[:0], y[:0])
    number = np.nonzero(dense)[0]
    x = np.concatenate([calm_t, middle[number]])
    line = np.concatenate([calm_y, mean[number]])
    bottom = np.concatenate([np.full(calm_t.size, np.nan), low[number]])
    top = np.concatenate([np.full(calm_t.size, np.nan), high[number]])
    order = np.argsort(x, kind="stable")
    x, bottom, top, line = x[order], bottom[order], top[order], line[order]
    if wraps:
        bottom, top = (broken(x, part, line)[1] for part in (bottom, top))
        x, line = broken(x, line)
    return x, bottom, top, line


def walked(x: Series, y: Series) -> tuple[Series, Series]:
    """Return the points of a way in their order, without those that fall on the last one."""
    if x.size <= POINTS:
        return x, y
    cells = []
    for values, count in ((x, 1200), (y, 800)):
        finite = values[np.isfinite(values)]
        low, span = (finite.min(), np.ptp(finite)) if finite.size else (0.0, 0.0)
        scaled = np.where(np.isfinite(values), (values - low) / (span or 1.0) * count, -1.0)
        cells.append(scaled.astype(int))
    moved = (np.diff(cells[0], prepend=-2) != 0) | (np.diff(cells[1], prepend=-2) != 0)
    moved[-1] = True
    return x[moved], y[moved]
