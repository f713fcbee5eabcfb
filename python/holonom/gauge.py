"""What one tolerance is of a channel, and how far two runs are apart in it.

`docs/conventions.md` states the table: for positions, velocities and angles an absolute part and a
relative one, which multiplies the movement since the start or the velocity; for anything else the
relative part times the largest value in the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from holonom.channels import component_units
from holonom.store.layout import Quantity

Series = NDArray[np.float64]

#: A force or an acceleration below this part of the largest of its kind in the model is round-off.
NEGLIGIBLE = 1e-6
#: Channels that are errors themselves: there is no true value to compare them with.
RESIDUALS = "constraint."
#: Parts of a tolerance by unit; positions count from the start, velocities by their value.
ABSOLUTE: dict[Literal["position", "velocity"], dict[str, str]] = {
    "position": {"m": "translation", "rad": "rotation"},
    "velocity": {"m/s": "translation", "rad/s": "rotation"},
}
#: What else the store keeps of the kind of a unit.
KINDS = {"N": "lambda", "N m": "lambda", "m/s^2": "qdd", "rad/s^2": "qdd", "J": "energy"}


@dataclass(frozen=True, slots=True)
class Part:
    """Components of a channel that share a tolerance, and what kind of number they are."""

    columns: slice
    kind: Literal["position", "velocity", "orientation", "other"]
    absolute: str = ""
    principal: bool = False  # known up to whole turns

    def measure(self, first: Series, second: Series, start: Series) -> tuple[Series, Series]:
        """Return the difference of the runs by component, and what the relative part multiplies."""
        if self.kind == "orientation":
            opposite = np.sum(first * second, axis=1) < 0.0
            difference = first - np.where(opposite[:, None], -second, second)
            cosine = np.minimum(np.abs(second @ start), 1.0)
            return 2.0 * difference, 2.0 * np.arccos(cosine)
        difference = first - second
        if self.principal:
            difference = principal(difference)
        if self.kind == "velocity":
            return difference, length(second)
        moved = second - start
        # Whole turns do not count as movement.
        return difference, length(principal(moved) if self.absolute == "rotation" else moved)

    def compare(
        self,
        first: Series,
        second: Series,
        start: Series,
        tolerance: Mapping[str, float],
        index: int | None = None,
    ) -> tuple[Series, Series | None]:
        """Return how far two runs are apart in each row, and one tolerance there.

        Parameters
        ----------
        first, second : ndarray, shape (n, size)
            The whole channel.
        start : ndarray, shape (size,)
        tolerance : mapping of str to float
            Each part of it.
        index : int, optional
            Component of the channel; all of them when not given.

        Returns
        -------
        tuple of ndarray, shape (n,)
            No tolerance where it is known at the end of the run only, from `largest_tolerance`.
        """
        columns = self.columns
        difference, size = self.measure(first[:, columns], second[:, columns], start[columns])
        # Euler parameters count as half an angle each.
        half = 0.5 if self.kind == "orientation" and index is not None else 1.0
        if index is None:
            apart = length(difference)
        else:
            apart = half * np.abs(difference[:, index - columns.start])
        if self.kind == "other":
            return apart, None
        return apart, half * (tolerance[self.absolute] + tolerance["relative"] * size)

    def unit(self, whole: str, index: int | None) -> str:
        """Return the unit of `compare`, of a channel of this unit."""
        if self.kind == "orientation":
            return "rad" if index is None else whole
        return component_units(whole, 2)[int(self.absolute == "rotation")]


class Furthest(NamedTuple):
    """Where two runs are furthest apart in a channel, in tolerances, and since when beyond them."""

    name: str
    unit: str
    time: float
    apart: float
    tolerance: float
    tolerances: float
    since: float | None


class Gauge:
    """How far two runs are apart in one channel or component, from their rows as they come.

    A row that is not finite is lost: where one run has lost it they are infinitely far apart.

    Parameters
    ----------
    name : str
        The channel or component.
    quantity : Quantity
        The channel.
    index : int or None
        The component; None for all of them.
    tolerance : mapping of str to float
        Each part of it.
    within : float
        `Furthest.since` is the first time at which they are further apart than so many tolerances.
    lost : float
        How far apart rows are that both runs have lost.
    """

    def __init__(
        self,
        name: str,
        quantity: Quantity,
        index: int | None,
        tolerance: Mapping[str, float],
        *,
        within: float = math.inf,
        lost: float = math.inf,
    ) -> None:
        self.channel = quantity.name
        self._name, self._unit, self._index = name, quantity.unit, index
        columns = range(quantity.size)
        parts = parts_of(quantity)
        self._parts = [p for p in parts if index is None or index in columns[p.columns]]
        self._tolerance, self._within, self._lost = tolerance, within, lost
        self._start: Series | None = None
        self._largest = 0.0
        # Of each part, the rows further apart than all before: the first row beyond a bound is one
        # of them, also where one tolerance is known at the end only.
        self._rows: list[list[Series]] = [[] for _ in self._parts]

    def begin(self, first: Series) -> None:
        """Let movements count from the first of these rows, unless a start is known."""
        if self._start is None:
            self._start = _finite(first[0]).reshape(-1)

    def take(self, times: Series, first: Series, second: Series) -> None:
        """Compare rows of the whole channel."""
        self.begin(first)
        assert self._start is not None
        pair = [values.reshape(times.size, -1) for values in (first, second)]
        a, b = map(_finite, pair)
        for part, rows in zip(self._parts, self._rows, strict=True):
            apart, bound = part.compare(a, b, self._start, self._tolerance, self._index)
            # One component of an orientation is none without the others.
            alone = self._index is not None and part.kind != "orientation"
            columns = self._index if alone else part.columns
            lost = [~np.isfinite(v[:, columns]).reshape(times.size, -1).all(axis=1) for v in pair]
            apart[lost[0] | lost[1]] = math.inf
            apart[lost[0] & lost[1]] = self._lost
            if bound is None:  # known at the end
                bound = np.ones_like(apart)
                lengths = (length(values[:, part.columns]) for values in (a, b))
                self._largest = max(self._largest, *map(peak, lengths))
            ratio = _in_tolerances(apart, bound)
            before = np.append(rows[-1][-1, -1] if rows else -1.0, ratio[:-1])
            further = ratio > np.maximum.accumulate(before)
            if further.any():
                found = np.stack((times, apart, bound, ratio))[:, further]
                # The last is the furthest; the others only say since when.
                rows[:] = [found[:, -1:]] if math.isinf(self._within) else [*rows, found]

    def furthest(self, peaks: Mapping[str, float]) -> Furthest:
        """Return what was found; `peaks` as of `largest_tolerance`."""
        found: list[Furthest] = []
        since: list[float] = []
        for part, rows in zip(self._parts, self._rows, strict=True):
            times, apart, bound, ratio = np.concatenate(rows, axis=1)
            if part.kind == "other":
                relative = self._tolerance["relative"]
                bound[:] = largest_tolerance(self._unit, relative, self._largest, peaks)
                ratio = _in_tolerances(apart, bound)
            since += times[ratio > self._within][:1].tolist()
            at = np.argmax(ratio)
            numbers = (float(times[at]), float(apart[at]), float(bound[at]), float(ratio[at]))
            found.append(Furthest(self._name, part.unit(self._unit, self._index), *numbers, None))
        worst = max(found, key=lambda one: one.tolerances)
        return worst._replace(since=min(since, default=None))


def largest_tolerance(
    unit: str, relative: float, largest: float, peaks: Mapping[str, float]
) -> float:
    """Return one tolerance of what is no position or velocity.

    Parameters
    ----------
    unit : str
    relative : float
        Part of the tolerance.
    largest : float
        Length of the channel where it is longest in the run.
    peaks : mapping of str to float
        Largest magnitudes of ``lambda``, ``qdd`` and ``energy``: channels far below the largest of
        their kind are round-off, and one scale serves all energies, of which only differences mean
        anything.
    """
    kind = KINDS.get(unit, "")
    floor = peaks.get(kind, 0.0) * (1.0 if kind == "energy" else NEGLIGIBLE)
    return relative * max(largest, floor)


def own_tolerances(
    quantity: Quantity,
    values: Series,
    tolerance: Mapping[str, float],
    peaks: Mapping[str, float],
) -> Series:
    """Return one tolerance of each component of a channel, where it is largest in a run.

    The relative part of a position multiplies the component's own movement, not that of the vector:
    a height that changes by centimetres is no noise because the vehicle drives for kilometres.

    Parameters
    ----------
    quantity : Quantity
    values : ndarray, shape (n, size)
        At least one row.
    tolerance, peaks : mapping of str to float
        As of `Part.compare` and `largest_tolerance`.
    """
    found = np.zeros(quantity.size)
    for part in parts_of(quantity):
        there = values[:, part.columns]
        if part.kind == "other":
            largest = float(length(_finite(there)).max())
            found[part.columns] = largest_tolerance(
                quantity.unit, tolerance["relative"], largest, peaks
            )
            continue
        size = there if part.kind == "velocity" else there - there[0]
        if part.absolute == "rotation" and part.kind == "position":
            size = principal(size)
        half = 0.5 if part.kind == "orientation" else 1.0
        moved = np.abs(_finite(size)).max(axis=0)
        found[part.columns] = half * tolerance[part.absolute] + tolerance["relative"] * moved
    return found


def parts_of(quantity: Quantity) -> list[Part]:
    """Return the parts of a channel: one, or translations and rotations of a deformation."""
    whole = slice(0, quantity.size)
    if quantity.name.endswith(".euler_parameters"):
        return [Part(whole, "orientation", "rotation")]
    if quantity.unit == "m, rad":  # a deformation: three translations, three rotations
        middle = quantity.size // 2
        return [
            Part(slice(0, middle), "position", "translation"),
            Part(slice(middle, quantity.size), "position", "rotation"),
        ]
    for kind, absolute in ABSOLUTE.items():
        if quantity.unit in absolute:
            turns = quantity.name.endswith(".yaw_pitch_roll")
            return [Part(whole, kind, absolute[quantity.unit], turns)]
    return [Part(whole, "other")]


def _finite(values: Series) -> Series:
    return np.where(np.isfinite(values), values, 0.0)


def _in_tolerances(apart: Series, bound: Series) -> Series:
    """Return ratios without a NaN: nothing is within its bound because both are infinite."""
    ratio = np.where(apart == 0.0, 0.0, math.inf)
    return np.divide(apart, bound, out=ratio, where=np.isfinite(apart) & (apart > 0.0))


def length(rows: Series) -> Series:
    """Return the length of each row, shape (n,)."""
    return np.asarray(np.linalg.norm(rows, axis=1))


def peak(values: Series) -> float:
    """Return the largest magnitude; what is not finite does not count."""
    return float(np.abs(values).max(initial=0.0, where=np.isfinite(values)))


def principal(angle: Series) -> Series:
    """Return angles without whole turns, from −π to π."""
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))
