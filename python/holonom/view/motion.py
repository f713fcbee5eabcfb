"""The motion of bodies as few poses, between which the page moves along cubics.

A knot is a moment of the run: place, orientation and the rates of both. Between two knots of a body
the place is the cubic with their places and velocities, and the Euler parameters are the cubics
with their values and rates, brought back to length one: a turn by the shorter way that begins and
ends with the angular velocities of the run. Stretches are halved until every moment in them is met,
each body by itself: what rests has few knots, what turns fast has many.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from holonom.view.encoding import half

if TYPE_CHECKING:
    from holonom.model import Model

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Bytes of the knots of a page, and of one, before they are written as text.
KNOT_BYTES, BYTES_PER_KNOT = 6_000_000, 36
#: How far bodies may be drawn from their rows where there is room: part of the mechanism's size;
#: rad, of which no body needs less and none is allowed more.
PLACE, TURN, MOST_TURN = 2e-4, 1e-3, 1e-2
#: Where there is none the bounds grow by this factor, until there is.
_LOOSER = 4.0
_LOOSEST = _LOOSER**12
#: Rows that are looked at in one piece.
_PIECE = 200_000


class Poses(NamedTuple):
    """Poses and rates of bodies in ground axes, ndarrays of shape (n_times, n_bodies, …)."""

    #: (…, 3), m
    place: Array
    #: Euler parameters, (…, 4)
    turn: Array
    #: (…, 3), m/s
    velocity: Array
    #: Angular velocity, (…, 3), rad/s
    spin: Array


class Way(NamedTuple):
    """The knots of one body: times (n,), s, and what `Poses` has of it there, (n, …)."""

    times: Array
    place: Array
    turn: Array
    velocity: Array
    spin: Array

    def after(self, count: int) -> Way:
        """Return it without so many knots."""
        return Way(*(part[count:] for part in self))


def pose_names(model: Model) -> list[str]:
    """Return the channels that `poses_of` asks for."""
    planar = model.geometry["dimension"] == "planar"
    turn = "angle" if planar else "euler_parameters"
    parts = ("position", turn, "velocity", "angular_velocity")
    return [f"{body['name']}.{part}" for body in model.geometry["bodies"] for part in parts]


def poses_of(model: Model, sampled: Mapping[str, Array]) -> Poses:
    """Return the poses of all bodies, in space also those of a planar model."""
    names = pose_names(model)
    place, turn, velocity, spin = (
        np.stack([sampled[name] for name in names[k::4]], axis=1) for k in range(4)
    )
    if model.geometry["dimension"] == "planar":
        zero = np.zeros_like(turn)
        place, velocity = (np.dstack([*np.moveaxis(v, -1, 0), zero]) for v in (place, velocity))
        turn = np.dstack([np.cos(0.5 * turn), zero, zero, np.sin(0.5 * turn)])
        spin = np.dstack([zero, zero, spin])
    return Poses(place, turn, velocity, spin)


class Knots:
    """Chooses the knots of a run, piece by piece.

    Parameters
    ----------
    size : float
        Of the mechanism, m.
    reach : ndarray, shape (n_bodies,)
        How far points of the bodies are from their origins, m.
    rows : int
        How many there will be.

    Attributes
    ----------
    error : (float, float)
        How far bodies are drawn from the rows so far: m and rad, rounding included.
    """

    def __init__(self, size: float, reach: Array, rows: int) -> None:
        place = np.full(reach.size, PLACE * size)
        turn = np.clip(place / np.maximum(reach, 1e-300), TURN, MOST_TURN)
        self._bounds = np.stack([place, turn], axis=1)
        self._rest = rows
        self._room = KNOT_BYTES // BYTES_PER_KNOT
        self._looser = 1.0
        self._origin: tuple[float, Array] | None = None
        self._parts: list[list[Way]] = []
        self._last: list[Way] = []
        self.error = (0.0, 0.0)

    def add(self, times: Array, poses: Poses) -> None:
        """Take a piece; its first row is the last one of the piece before."""
        if self._origin is None:
            self._origin = float(times[0]), poses.place[0]
        path = _Path(times, poses, *self._origin)
        # Each piece gets its part of the room, and what those before it left.
        share = self._room * times.size / max(self._rest, times.size)
        chosen, error = path.chosen(self._looser * self._bounds)
        while np.count_nonzero(chosen) > share and self._looser < _LOOSEST:
            self._looser *= _LOOSER
            chosen, error = path.chosen(self._looser * self._bounds)
        self._looser = max(1.0, self._looser / _LOOSER)  # the next piece may be calmer
        self._room -= int(np.count_nonzero(chosen))
        self._rest -= times.size - 1
        self.error = (max(self.error[0], error[0]), max(self.error[1], error[1]))
        self._parts.append(
            [_way(times, poses, k, np.nonzero(one)[0]) for k, one in enumerate(chosen)]
        )
        last = np.array([times.size - 1])
        self._last = [_way(times, poses, k, last) for k in range(len(chosen))]

    def ways(self) -> list[Way]:
        """Return the knots of every body."""
        bodies = zip(*self._parts, self._last, strict=True)
        return [Way(*map(np.concatenate, zip(*parts, strict=True))) for parts in bodies]


def _way(times: Array, poses: Poses, body: int, rows: Indices) -> Way:
    return Way(times[rows], *(part[rows, body] for part in poses))


class _Path:
    """The rows of a piece as they are, and as the page would have them, were they knots.

    Arrays are of shape (n_bodies * n_times, …), body by body: the seven coordinates of place and
    orientation, and their rates.
    """

    def __init__(self, times: Array, poses: Poses, start: float, origin: Array) -> None:
        self._true_times = times - start
        self._times = self._true_times.astype("f4").astype(float)
        self._count, self._bodies = times.size, poses.place.shape[1]
        from_origin = poses.place - origin  # as `moved` writes it
        self._true = _flat(np.dstack([from_origin, poses.turn]))
        turn = np.rint(32767.0 * poses.turn) / 32767.0
        turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
        spin = half(poses.spin)
        e0, e = turn[..., :1], turn[..., 1:]
        rate = 0.5 * np.dstack([-np.sum(spin * e, axis=-1), e0 * spin + np.cross(spin, e)])
        self._spin = np.linalg.norm(_flat(spin), axis=1)
        self._pose = _flat(np.dstack([from_origin.astype("f4"), turn]))
        self._rate = _flat(np.dstack([half(poses.velocity), rate]))

    def chosen(self, bounds: Array) -> tuple[NDArray[np.bool_], tuple[float, float]]:
        """Return which rows are knots, (n_bodies, n_times) without the last, and the error."""
        chosen = np.zeros((self._bodies, self._count), dtype=bool)
        chosen[:, 0] = True
        error = np.zeros(2)
        first = self._count * np.arange(self._bodies)
        last = first + self._count - 1
        while np.any(longer := last - first > 1):
            first, last = first[longer], last[longer]
            middle = (first + last) // 2
            # Most stretches that are too long are so in the middle: the rest need not be seen.
            missed = self._errors(first, last, middle)
            good = np.all(missed <= bounds[first // self._count], axis=1)
            good[good], worst = self._kept(first[good], last[good], bounds)
            error = np.maximum(error, worst)
            first, middle, last = first[~good], middle[~good], last[~good]
            chosen.flat[middle] = True
            first, last = np.concatenate([first, middle]), np.concatenate([middle, last])
        return chosen, (float(error[0]), float(error[1]))

    def _kept(
        self, first: Indices, last: Indices, bounds: Array
    ) -> tuple[NDArray[np.bool_], Array]:
        """Return which stretches meet all of their rows, and the largest errors of these."""
        good = np.ones(first.size, dtype=bool)
        error = np.zeros(2)
        rows = last - first - 1
        pieces = np.cumsum(rows) // _PIECE
        for piece in np.unique(pieces):
            here = np.nonzero((pieces == piece) & (rows > 0))[0]
            if not here.size:
                continue
            count = rows[here]
            start = np.cumsum(count) - count
            owner = np.repeat(here, count)
            row = np.arange(count.sum()) + np.repeat(first[here] + 1 - start, count)
            worst = np.maximum.reduceat(self._errors(first[owner], last[owner], row), start)
            good[here] = np.all(worst <= bounds[first[here] // self._count], axis=1)
            error = np.maximum(error, worst[good[here]].max(axis=0, initial=0.0))
        return good, error

    def _errors(self, first: Indices, last: Indices, row: Indices) -> Array:
        """Return by how much rows are missed between two knots, (n, 2): m, rad; see `poseAt`."""
        t = self._times
        span = (t[last % self._count] - t[first % self._count])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):  # rows nearer than rounding tells
            s = (self._true_times[row % self._count] - t[first % self._count])[:, None] / span
        a, b = self._pose[first], self._pose[last]
        from_rate, to_rate = span * self._rate[first], span * self._rate[last]
        back = np.sum(a[:, 3:] * b[:, 3:], axis=1) < 0.0  # the same orientation, the other sign
        b[back, 3:] *= -1.0
        to_rate[back, 3:] *= -1.0
        # More than half a turn between two knots is not told by its rates.
        far = np.maximum(self._spin[first], self._spin[last]) * span[:, 0] >= np.pi
        from_rate[far, 3:] = to_rate[far, 3:] = (b - a)[far, 3:]
        r = 1.0 - s
        found = a + s**2 * (3.0 - 2.0 * s) * (b - a) + s * r**2 * from_rate - s**2 * r * to_rate
        true = self._true[row]
        missed = np.linalg.norm(found[:, :3] - true[:, :3], axis=1)
        cosine = np.abs(np.sum(found[:, 3:] * true[:, 3:], axis=1))
        cosine /= np.linalg.norm(found[:, 3:], axis=1)
        angle = 4.0 * np.arcsin(np.sqrt(0.5 * np.maximum(1.0 - cosine, 0.0)))
        return np.stack([missed, angle], axis=1)


def _flat(parts: Array) -> Array:
    """Return (n_times, n_bodies, …) as (n_bodies * n_times, …), body by body."""
    swapped = np.ascontiguousarray(np.swapaxes(parts, 0, 1))
    return swapped.reshape(-1, *swapped.shape[2:])
