"""How far a run is off: the same run at a tenth of its tolerance, compared row by row.

The tolerance of a channel is that of the run, as `docs/conventions.md` defines it: for positions,
velocities and angles an absolute part and a relative one, which multiplies the movement since the
start or the velocity; for anything else the relative part times the largest value in the run.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.certificate import ChannelError
from holonom.channels import split_component
from holonom.gauge import KINDS, RESIDUALS, Gauge, peak
from holonom.options import Tolerance
from holonom.store.layout import STATE

if TYPE_CHECKING:
    from holonom.model import Model
    from holonom.store.memory import Stored

Series = NDArray[np.float64]

#: The tolerance of the second run is this part of the first one's.
PART = 0.1
#: The smallest relative tolerance of a run; stated along with others it means none.
SMALLEST_RELATIVE = 1e-13
#: Of a result that was to be certified, until the second run says something.
NO_SECOND_RUN = {
    "code": "simulation/not-certified",
    "message": "there was no second run, or it was cut off",
    "advice": "certify it by another run",
}
#: Words that stand for channels of every body.
SETS = {
    "positions": ("position", "angle", "euler_parameters"),
    "velocities": ("velocity", "angular_velocity"),
}


def tightened(tolerance: Mapping[str, float]) -> dict[str, float]:
    """Return the tolerance of the second run; each part in full."""
    parts = Tolerance(**tolerance)
    # Two decimal numbers: 1e-4 becomes 1e-5 and not 1.0000000000000001e-05.
    tighter = {name: float(f"{PART * getattr(parts, name):.15g}") for name in Tolerance.__slots__}
    return tighter | {"relative": max(tighter["relative"], SMALLEST_RELATIVE)}


def unfinished(failure: Mapping[str, Any]) -> dict[str, Any]:
    """Return why there is no second run that reached its end, from what is said of that run."""
    code = str(failure.get("code", "simulation/failed"))
    said = str(failure.get("message") or "ended early").splitlines()[0].removesuffix(f" [{code}]")
    message = f"the second run, at a tenth of the tolerance, did not reach its end: {said}"
    return {**failure, "code": code, "message": message}


def certified_channels(model: Model, requested: Sequence[str]) -> list[str]:
    """Return what is compared: the channels asked for, or else the motion of all bodies."""
    names = [name for name in requested if not name.startswith(RESIDUALS)]
    if names:
        return names
    bodies = json.loads(model.to_json(plain=True)).get("bodies") or {}
    motion = [quantity for kind in SETS.values() for quantity in kind]
    wanted = (f"{body}.{quantity}" for body in bodies for quantity in motion)
    return [name for name in wanted if name in model.channels]


class Measurement:
    """Compares the rows of a second run, as they come, with a stored first one.

    Neither run is held in memory: each chunk meets the rows of the same times in the store.

    Parameters
    ----------
    model : Model
    names : sequence of str
        Channels and components.
    first : Reader or Memory
        The first run.
    tolerance : mapping of str to float
        Of the first run, each part.
    ahead : int
        Rows of the second run before the first one's: 1 when only the second stores the start.
    """

    def __init__(
        self,
        model: Model,
        names: Sequence[str],
        first: Stored,
        tolerance: Mapping[str, float],
        ahead: int = 0,
    ) -> None:
        self._model = model
        self._first = first
        self._gauges = [
            Gauge(name, model.channels[channel], index, tolerance)
            for name, (channel, index) in zip(names, map(split_component, names), strict=True)
        ]
        whole = dict.fromkeys(gauge.channel for gauge in self._gauges)
        self._stored = [name for name in whole if name in first.quantities]
        self._computed = [name for name in whole if name not in first.quantities]
        self._energies = [n for n in first.quantities if n.startswith("energy.")]
        self._peaks = dict.fromkeys(KINDS.values(), 0.0)
        self._ahead = ahead
        self._row = -ahead
        self.until: float | None = None

    @property
    def complete(self) -> bool:
        """Whether every row of the first run has been compared."""
        return bool(self._row == self._first.count)

    def append(self, chunk: Mapping[str, Any]) -> None:
        """Compare a chunk of the core with the rows of the first run."""
        ours = self._values(chunk, chunk["channels"]) if len(chunk["time"]) else {}
        if not ours:
            return
        for gauge in self._gauges:
            gauge.begin(ours[gauge.channel])
        skipped = min(max(-self._row, 0), len(chunk["time"]))
        self._row += skipped
        at, count = self._row, len(chunk["time"]) - skipped
        times = self._first.rows("time", at, count)
        # A run that ends early has a last row of its own.
        count = int(np.sum(np.cumprod(times == chunk["time"][skipped:][: times.size])))
        if not count:
            return
        states = {part: self._first.rows(part, at, count) for part in STATE if part in chunk}
        stored = {name: self._first.rows(name, at, count) for name in self._stored}
        theirs = self._values(states, stored)
        for gauge in self._gauges:
            mine = ours[gauge.channel][skipped : skipped + count]
            gauge.take(times[:count], theirs[gauge.channel], mine)
        for part in ("lambda", "qdd"):
            self._peaks[part] = max(self._peaks[part], peak(states[part]))
        for name in self._energies:
            energy = peak(self._first.rows(name, at, count))
            self._peaks["energy"] = max(self._peaks["energy"], energy)
        self._row += count
        self.until = float(times[count - 1])

    def errors(self) -> tuple[ChannelError, ...]:
        """Return the error of every channel over the rows compared so far."""
        if self.until is None:
            return ()
        return tuple(ChannelError(*gauge.furthest(self._peaks)[:-1]) for gauge in self._gauges)

    def _values(
        self, states: Mapping[str, Series], stored: Mapping[str, Series]
    ) -> dict[str, Series]:
        """Return whole channels: the stored ones, the others from the states."""
        parts = {part: states[part] for part in STATE if part in states}
        computed = self._model.evaluate(self._computed, parts) if self._computed else {}
        return computed | {name: stored[name] for name in self._stored}
