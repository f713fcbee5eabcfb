"""The smallest and the largest values of a run, also where they lie between its stored rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import HolonomError
from holonom.pictures.curves import Curves, curves

if TYPE_CHECKING:
    from holonom.result import Result

Series = NDArray[np.float64]

#: States that are computed in each step beside the rows, and how many times bodies at a time.
_PER_STEP, _MOST = 8, 200_000
#: How often the surroundings of a peak are divided, and into how many parts.
_ROUNDS, _PARTS = 4, 8


class Extrema(NamedTuple):
    """The extrema of one channel: value and time (s) by component, ndarrays of shape (n, 2)."""

    curve: Curves
    smallest: Series
    largest: Series


def extrema(result: Result, names: Sequence[str]) -> tuple[list[Extrema], str]:
    """Return the extrema of channels, and why they are those of the rows alone, if they are.

    There they are those of states computed from the steps: first some in each step, then ever
    nearer to the highest peaks. Of a run without steps, and of what moves less than its solver
    tells, they are those of the rows. Where nothing is finite they are NaN.
    """
    found = curves(result, names)
    times, values = result.time, _side_by_side([one.values for one in found])
    columns = np.nonzero(~np.concatenate([one.still for one in found]))[0]
    best = _best_rows(times, values)
    why = ""
    if result.span is None:
        why = "there are no steps from which what lies between them follows"
    else:
        try:
            best = _look_between(result, names, times, values, columns, best)
        except HolonomError as error:
            why = f"what lies between them cannot be computed: {error}"
    ends = np.cumsum([len(one.labels) for one in found])
    parts = np.split(best, ends[:-1], axis=1)
    return [
        Extrema(one, part[0] * [-1.0, 1.0], part[1]) for one, part in zip(found, parts, strict=True)
    ], why


def _best_rows(times: Series, values: Series) -> Series:
    """Return value and time of the largest of -values and of values, (2, width, 2)."""
    best = np.full((2, values.shape[1], 2), np.nan)
    for side, signed in enumerate((-values, values)):
        known = np.isfinite(signed).any(axis=0)
        at = np.nanargmax(np.where(np.isfinite(signed), signed, -np.inf), axis=0)
        best[side, :, 0] = np.where(known, signed[at, np.arange(at.size)], np.nan)
        best[side, :, 1] = times[at]
    return best


def _look_between(
    result: Result,
    names: Sequence[str],
    times: Series,
    values: Series,
    columns: NDArray[np.intp],
    best: Series,
) -> Series:
    """Return the best of rows and of what lies between them."""

    def sampled(wanted: Series) -> Series:
        found = result.sample(wanted, list(names))
        return _side_by_side([found[name].reshape(wanted.size, -1) for name in names])

    more = _in_steps(result)
    if more.size > times.size:  # else rows are as near to each other
        every = np.concatenate([times, more])
        order = np.argsort(every, kind="stable")
        times, values = every[order], np.concatenate([values, sampled(more)])[order]
        best = _best_rows(times, values)
    # Any of the peaks that may be higher than the highest row can be the highest one.
    most = _most(result) // ((_PARTS + 1) * 2 * max(1, columns.size))
    peaks = [
        (side, column, *around)
        for side, sign in enumerate((-1.0, 1.0))
        for column in columns
        for around in _surroundings(times, sign * values[:, column], best[side, column, 0], most)
    ]
    if not peaks:
        return best
    side, column, low, high = map(np.array, zip(*peaks, strict=True))
    assert result.span is not None
    low, high = np.clip([low, high], *result.span)
    for _ in range(_ROUNDS):
        grid = np.linspace(low, high, _PARTS + 1, axis=1)
        moments, place = np.unique(grid, return_inverse=True)
        there = sampled(moments)[place.reshape(grid.shape), column[:, None]]
        there = np.where(side[:, None], there, -there)
        at = np.argmax(np.where(np.isfinite(there), there, -np.inf), axis=1)
        pick = np.arange(at.size)
        for s, c, value, time in zip(side, column, there[pick, at], grid[pick, at], strict=True):
            if value > best[s, c, 0]:
                best[s, c] = value, time
        low, high = grid[pick, np.maximum(at - 1, 0)], grid[pick, np.minimum(at + 1, _PARTS)]
    return best


def _surroundings(
    times: Series, values: Series, best: float, most: int
) -> list[tuple[float, float]]:
    """Return between which times peaks lie that may be higher than the best value, some at most."""
    before = np.nan_to_num(np.diff(values, prepend=values[0]), nan=0.0)
    after = np.nan_to_num(np.diff(values, append=values[-1]), nan=0.0)
    tops = np.nonzero((before >= 0.0) & (after <= 0.0) & np.isfinite(values))[0]
    # A parabola gets higher by an eighth of its fall to a neighbour at most; times may be uneven.
    reach = values[tops] + 0.25 * np.maximum(before[tops], -after[tops])
    order = np.argsort(-reach, kind="stable")[: max(1, most)]
    tops = tops[order][reach[order] >= best]
    low, high = times[np.maximum(tops - 1, 0)], times[np.minimum(tops + 1, times.size - 1)]
    return list(zip(low, high, strict=True))


def _in_steps(result: Result) -> Series:
    """Return times in every step that are not rows, s; fewer where there are too many."""
    log = result.steps
    good = log["accepted"] > 0
    start, size = log["t"][good], log["h"][good]
    inner = (start[:, None] + size[:, None] * np.arange(_PER_STEP) / _PER_STEP).ravel()
    assert result.span is not None
    inner = np.unique(inner[(inner >= result.span[0]) & (inner <= result.span[1])])
    return inner[:: max(1, -(-inner.size // _most(result)))]


def _most(result: Result) -> int:
    """Return how many states may be computed at a time."""
    return max(1, _MOST // max(1, len(result.model.geometry["bodies"])))


def _side_by_side(parts: Sequence[Series]) -> Series:
    return np.concatenate(parts, axis=1)
