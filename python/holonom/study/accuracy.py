"""How far a run is from a reference: the thesis's error analysis and the measure of tolerances.

For one scalar e(t) of a run at times t₁ … tₙ and a reference E at times T₁ … T_N the analysis is
that of Negrut's thesis on implicit integration of multibody systems (1998), section 5.1: the
reference is read at tᵢ by a cubic through the four nearest of its points, then

* Δᵢ = |E*ᵢ − eᵢ| (5.1), Δ = maxᵢ Δᵢ at t* (5.2);
* average error: √(Σ Δᵢ²) / n (5.3): the sum under the root, divided by n; not a root mean square;
* RelErr = 100 Δ / |E*(t*)| percent (5.4).

The measure of tolerances is maxᵢ Δᵢ / (atol + rtol |E*ᵢ|): 1 is on tolerance.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import UsageError
from holonom.certification import SETS
from holonom.channels import component_units, split_component
from holonom.gauge import ABSOLUTE, principal

if TYPE_CHECKING:
    from holonom.model import Model
    from holonom.options import Tolerance

Series = NDArray[np.float64]

#: RelErr is left out where the reference is smaller than this part of its largest value.
NEAR_ZERO = 1e-3

Kind = Literal["position", "velocity", "other"]


@dataclass(frozen=True, slots=True)
class Target:
    """One scalar that is compared.

    Parameters
    ----------
    name : str
        Such as ``chassis.position[2]``; ``chassis.euler_parameters`` for the orientation, which
        is compared by the angle between the two.
    channel : str
    index : int or None
        Component of the channel; None for all of it.
    unit : str
        SI; ``rad`` for an orientation.
    measured : {"number", "turn", "angle"}
        A plain number, an orientation, or an angle known up to whole turns.
    """

    name: str
    channel: str
    index: int | None
    unit: str
    measured: Literal["number", "turn", "angle"] = "number"

    @property
    def kind(self) -> Kind:
        """What it belongs to by its unit."""
        return next((kind for kind, units in ABSOLUTE.items() if self.unit in units), "other")

    def of(self, values: Mapping[str, Series]) -> Series:
        """Pick the scalar, shape (n,), or Euler parameters, (n, 4), from channels (n, size)."""
        whole = values[self.channel]
        return whole if self.index is None else whole[:, self.index]


@dataclass(frozen=True, slots=True)
class ComponentError:
    """Error of one scalar over a run.

    Attributes
    ----------
    name, unit : str
    time : float
        t*, where the error is largest, s.
    delta : float
        Largest error Δ (5.2), in `unit`.
    mean : float
        Average error (5.3), in `unit`.
    relative : float or None
        RelErr (5.4), percent; None where the reference is near zero.
    scaled : float
        Largest error over tolerance.
    interpolation : float
        Estimated error of reading the reference between its points, in `unit`.
    kind : {"position", "velocity", "other"}
    """

    name: str
    unit: str
    time: float
    delta: float
    mean: float
    relative: float | None
    scaled: float
    interpolation: float
    kind: Kind


def targets(model: Model, patterns: Sequence[str] | None) -> list[Target]:
    """Return the scalars meant by channels, components, patterns, ``positions``, ``velocities``.

    Parameters
    ----------
    model : Model
    patterns : sequence of str or None
        None means ``positions``: of every body, with its orientation.

    Raises
    ------
    UsageError
        If a name fits nothing.
    """
    if isinstance(patterns, str):
        raise UsageError("`channels` is one text", help="pass a list of channel names")
    tree = json.loads(model.to_json(plain=True))
    named: list[str] = []
    for pattern in ("positions",) if patterns is None else patterns:
        if pattern in SETS:
            bodies = tree.get("bodies") or {}
            wanted = (f"{body}.{what}" for body in bodies for what in SETS[pattern])
            named += [name for name in wanted if name in model.channels]
        else:
            named += model.expand([pattern])
    found = [target for name in dict.fromkeys(named) for target in _components(model, tree, name)]
    if not found:
        raise UsageError("there is nothing to compare", help="name at least one channel")
    return list(dict.fromkeys(found))


def _components(model: Model, tree: Mapping[str, Any], name: str) -> list[Target]:
    channel, index = split_component(name)
    quantity = model.channels[channel]
    if index is None and channel.endswith(".euler_parameters"):
        return [Target(channel, channel, None, "rad", "turn")]
    # Angles of spatial joints and of orientations are principal values; springs count turns.
    counts_turns = channel.partition(".")[0] in (tree.get("forces") or {})
    wraps = quantity.unit == "rad" and tree["dimension"] == "spatial" and not counts_turns
    measured: Literal["number", "angle"] = "angle" if wraps else "number"
    scalar = not quantity.shape
    return [
        Target(channel if scalar else f"{channel}[{i}]", channel, i, unit, measured)
        for i, unit in enumerate(component_units(quantity.unit, quantity.size))
        if index in (None, i)
    ]


def interpolate(nodes: Series, values: Series, times: Series) -> Series:
    r"""Return values between nodes by the cubic through the four nearest ones.

    Parameters
    ----------
    nodes : ndarray, shape (N,)
        Rising times, s.
    values : ndarray, shape (N,) or (N, k)
    times : ndarray, shape (n,)
        Between the first and the last node, s.

    Returns
    -------
    ndarray, shape (n,) or (n, k)
        With T_r ≤ t ≤ T_{r+1} the cubic is that of the points r−1 … r+2, at the ends that of the
        first or last four; exact at nodes. Fewer than four nodes give a lower degree.
    """
    count = min(4, nodes.size)
    left = np.searchsorted(nodes, times, side="right") - 1
    stencil = np.clip(left - 1, 0, nodes.size - count)[:, None] + np.arange(count)
    x = nodes[stencil]
    weights = np.ones_like(x)  # Lagrange's
    for j in range(count):
        for k in range(count):
            if k != j:
                weights[:, j] *= (times - x[:, k]) / (x[:, j] - x[:, k])
    return np.asarray(np.einsum("ij,ij...->i...", weights, values[stencil]))


def _interpolation_error(nodes: Series, values: Series, times: Series, fine: Series) -> float:
    """Estimate the largest error of `fine` by the same cubic on every second node."""
    right = np.clip(np.searchsorted(nodes, times), 1, nodes.size - 1)
    nearest = np.minimum(np.abs(nodes[right] - times), np.abs(nodes[right - 1] - times))
    between = nearest > 1e-9 * np.diff(nodes).max()
    if not between.any():
        return 0.0
    kept = np.unique(np.append(np.arange(0, nodes.size, 2), nodes.size - 1))
    coarse = interpolate(nodes[kept], values[kept], times[between])
    difference = np.abs(coarse - fine[between])
    # The error of a cubic goes with the fourth power of the spacing: 16, less where the wider
    # stencil is better centred (11.7 in the middle of an interval).
    return float(difference.max()) / 10.0


class Truth:
    """A reference at the times of the runs.

    Parameters
    ----------
    wanted : sequence of Target
    nodes : ndarray, shape (N,)
        Times of the reference, s.
    values : mapping of str to ndarray, shape (N, size)
        Its channels.
    times : ndarray, shape (n,)
        Times of the runs, s.
    """

    def __init__(
        self,
        wanted: Sequence[Target],
        nodes: Series,
        values: Mapping[str, Series],
        times: Series,
    ) -> None:
        self.times = times
        self._read = [_Reading.of(target, nodes, values, times) for target in wanted]

    def errors(self, values: Mapping[str, Series], tolerance: Tolerance) -> list[ComponentError]:
        """Return the error of every scalar of a run.

        Parameters
        ----------
        values : mapping of str to ndarray, shape (n, size)
            Channels of the run, by name.
        tolerance : Tolerance
            What the errors are measured against.
        """
        return [reading.error(self.times, values, tolerance) for reading in self._read]


@dataclass(frozen=True, slots=True)
class _Reading:
    target: Target
    values: Series  # (n,), of an orientation (n, 4)
    magnitude: Series  # (n,)
    peak: float  # largest magnitude of the whole channel
    interpolation: float

    @classmethod
    def of(
        cls, target: Target, nodes: Series, values: Mapping[str, Series], times: Series
    ) -> _Reading:
        sampled = target.of(values)
        if target.measured == "turn":
            # Both signs mean one orientation: follow one of them, so that a cubic makes sense.
            flips = np.sign(np.sum(sampled[1:] * sampled[:-1], axis=1))
            signs = np.cumprod(np.concatenate([[1.0], np.where(flips == 0.0, 1.0, flips)]))
            sampled = sampled * signs[:, None]
        elif target.measured == "angle":
            sampled = np.unwrap(sampled)
        fine = interpolate(nodes, sampled, times)
        doubt = _interpolation_error(nodes, sampled, times, fine) if nodes.size > 1 else 0.0
        if target.measured == "turn":
            magnitude = 2.0 * np.arctan2(np.linalg.norm(fine[:, 1:], axis=1), np.abs(fine[:, 0]))
            doubt *= 2.0
            peak = float(magnitude.max())
        else:
            magnitude = np.abs(principal(fine) if target.measured == "angle" else fine)
            peak = float(np.abs(values[target.channel]).max())
        return cls(target, fine, magnitude, peak, doubt)

    def error(
        self, times: Series, values: Mapping[str, Series], tolerance: Tolerance
    ) -> ComponentError:
        delta = self._delta(self.target.of(values))
        at = int(np.argmax(delta))
        there = float(self.magnitude[at])
        near_zero = there <= NEAR_ZERO * float(self.magnitude.max())
        bound = self._absolute(tolerance) + tolerance.relative * self.magnitude
        return ComponentError(
            name=self.target.name,
            unit=self.target.unit,
            time=float(times[at]),
            delta=float(delta[at]),
            mean=float(np.sqrt(np.sum(delta**2)) / delta.size),
            relative=None if near_zero else float(100.0 * delta[at] / there),
            scaled=float(np.max(delta / bound)),
            interpolation=self.interpolation,
            kind=self.target.kind,
        )

    def _delta(self, run: Series) -> Series:
        if self.target.measured == "turn":
            opposite = np.sum(run * self.values, axis=1) < 0.0
            difference = run - np.where(opposite[:, None], -self.values, self.values)
            return np.asarray(2.0 * np.linalg.norm(difference, axis=1))
        difference = run - self.values
        if self.target.measured == "angle":
            difference = principal(difference)
        return np.abs(difference)

    def _absolute(self, tolerance: Tolerance) -> float:
        """Return the absolute part of the tolerance that goes with the unit."""
        target = self.target
        if target.kind != "other":
            return float(getattr(tolerance, ABSOLUTE[target.kind][target.unit]))
        if target.channel.endswith(".euler_parameters"):  # half an angle
            assert tolerance.rotation is not None
            return 0.5 * tolerance.rotation
        # A tolerance says nothing about forces or energies: relative to their largest value.
        return tolerance.relative * (self.peak or 1.0)
