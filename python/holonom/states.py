"""States: at any time of a run, and those that users pass."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holonom.base.errors import FileError, UsageError
from holonom.base.names import did_you_mean, listed, nearest
from holonom.base.plain import real
from holonom.base.text import quoted
from holonom.store.layout import STATE

if TYPE_CHECKING:
    from holonom.model import Model
    from holonom.model.compiled import Compiled
    from holonom.store.memory import Stored

#: Times that differ by this part of a second, or of themselves, are the same.
_SLACK = 1e-9


def states_at(
    reader: Stored, model: Model, times: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return states at times (s): computed where steps are stored, else stored rows.

    Returns
    -------
    dict of str to ndarray, shape (n_times, size)
        By the names of `holonom.store.layout.STATE`.

    Raises
    ------
    UsageError
        If the run has no such time.
    FileError
        If the steps of a file do not fit its rows.
    """
    rows = reader.read("time") if "time" in reader.quantities else np.zeros(0)
    span = reader.dense_span
    if not rows.size and span is None:
        raise no_rows()
    if not np.isfinite(times).all():
        raise UsageError("times are not finite numbers", help="leave NaN and infinity out")
    slack = _SLACK * np.maximum(1.0, np.abs(times))
    inside = np.zeros(times.size, dtype=bool)
    if span is not None:
        inside = (times >= span[0] - slack) & (times <= span[1] + slack)
    stored = reader.quantities
    found = {name: np.empty((times.size, stored[name].size)) for name in STATE if name in stored}
    for k in np.nonzero(~inside)[0]:
        if not rows.size:  # a run that ended before its first output row
            assert span is not None
            raise _beyond(float(times[k]), *span)
        nearest = int(np.argmin(np.abs(rows - times[k])))
        if not abs(rows[nearest] - times[k]) <= slack[k]:
            raise _no_state(float(times[k]), rows, nearest, span)
        for name, part in reader.row(nearest).items():
            found[name][k] = part
    if span is not None:
        index = np.nonzero(inside)[0]
        clipped = np.clip(times[index], *span)
        for places, steps in reader.dense_chunks(clipped):
            states = model.dense_states(steps, clipped[places])
            for name, part in states.items():
                values = part.reshape(places.size, -1)
                found.setdefault(name, np.empty((times.size, values.shape[1])))
                if found[name].shape[1] != values.shape[1]:
                    text = f"{reader.path}: `{name}` in its steps does not fit its rows"
                    raise FileError(f"{text}\n  help: run it again", code="result/damaged")
                found[name][index[places]] = values
    return found


def as_rows(states: object) -> dict[str, NDArray[np.float64]]:
    """Return states as arrays of numbers, a row per time; the core checks their lengths.

    Raises
    ------
    UsageError
        If they are no arrays by name, or an array has no row for each time.
    """
    if not isinstance(states, Mapping):
        tip = "pass arrays by name, as `Result.state(time)` returns them"
        raise UsageError(f"the states are {quoted(repr(states))}", help=tip)
    found = {}
    for name, values in states.items():
        if name not in STATE:
            near = did_you_mean(nearest(name, STATE), f"there are {listed(STATE)}")
            raise UsageError(f"a state has no entry {quoted(name)}", help=near)
        try:
            array = np.asarray(values)
            real = array.astype(np.float64) if array.dtype.kind in "biuf" else None
        except (TypeError, ValueError, OverflowError):
            real = None
        if real is None or real.ndim > 2:
            raise UsageError(
                f"`{name}` is {quoted(repr(values))}", help="pass a row of numbers for each time"
            )
        found[name] = np.atleast_1d(real)
    if "time" not in found:
        raise UsageError("the states have no entry `time`", help="pass their times, s, as well")
    count = found["time"].size
    for name, array in found.items():
        alone = array.ndim == 1 and count in (1, array.size)
        if not alone and len(array) != count and not (array.ndim == 2 and array.size == 0):
            raise UsageError(
                f"`{name}` has the shape {array.shape}, and there are {count} times",
                help=f"it must have a row for each of them, ({count}, size)",
            )
    return found


def require_parts(rows: Mapping[str, object], names: Iterable[str], model: Compiled) -> None:
    """Refuse states without what a channel is computed from; the core would take zero for it.

    Raises
    ------
    UsageError
    """
    absent = {"qdd", "lambda", "ledger"} - rows.keys()
    for name in names if absent else ():
        if (part := computed_from(name, model)) in absent:
            raise UsageError(
                f"the state has no entry `{part}`, which {quoted(name)} is computed from",
                "simulation/start-state",
                "pass what `Result.state` returns for the same model",
            )


def computed_from(name: str, model: Compiled) -> str:
    """Return what of a state a channel needs beside positions and rates: one part, or none.

    Returns
    -------
    str
        ``qdd``, ``lambda``, ``ledger`` or empty.
    """
    item, _, quantity = name.rpartition(".")
    if name in ("energy.dissipated", "energy.driver_work", "energy.imbalance"):
        return "ledger"
    if quantity in ("acceleration", "angular_acceleration"):
        return "qdd"
    # Reactions of joints and drivers; those of forces follow from how the bodies move.
    is_reaction = quantity in ("force", "torque") and item not in model.forces
    return "lambda" if is_reaction else ""


def start_state(start: object) -> dict[str, NDArray[np.float64]]:
    """Return a start state as vectors of numbers; the core checks it against the model."""

    def refused(message: str) -> UsageError:
        text = f"{message}\n  help: pass what `Result.state` returns for the same model"
        return UsageError(text, "simulation/start-state")

    if not isinstance(start, Mapping):
        raise refused(f"`start` is {reprlib.repr(start)}; it must be a state: arrays by name")
    state = {}
    for name, values in start.items():
        if name not in STATE:
            raise refused(f"`start` has an entry {name!r}; known are {', '.join(STATE)}")
        try:
            state[name] = np.atleast_1d(real(values))
        except (TypeError, ValueError, OverflowError):
            raise refused(
                f"`start[{name!r}]` is {reprlib.repr(values)}; it must hold numbers"
            ) from None
        if state[name].ndim != 1:
            shape = state[name].shape
            raise refused(f"`start[{name!r}]` has the shape {shape}; it must be a vector")
        if not np.isfinite(state[name]).all():
            index = int(np.argmin(np.isfinite(state[name])))
            raise refused(
                f"`start[{name!r}][{index}]` is {state[name][index]}, not a finite number"
            )
    for name in ("time", "q", "qd"):
        if name not in state:
            raise refused(f"`start` has no entry `{name}`")
    if state["time"].size != 1:
        raise refused(f"`start['time']` holds {state['time'].size} times; it must hold one")
    return state


def vector(times: ArrayLike) -> NDArray[np.float64]:
    """Return times as a vector of numbers."""
    try:
        wanted = np.atleast_1d(real(times))
    except (TypeError, ValueError, OverflowError):
        wanted = None
    if wanted is None or times is None:
        raise UsageError(f"`times` is {quoted(repr(times))}", help="pass a vector of times, s")
    if wanted.ndim != 1:
        raise UsageError(f"`times` has the shape {wanted.shape}", help="pass a vector of times, s")
    return wanted


def _no_state(
    time: float, rows: NDArray[np.float64], nearest: int, span: tuple[float, float] | None
) -> UsageError:
    """Say why there is no state at a time, and at which there are."""
    first, last = float(rows[0]), float(rows[-1])
    if span is not None:
        first, last = min(first, span[0]), max(last, span[1])
    if not first <= time <= last:
        return _beyond(time, first, last)
    text = f"no state is stored at {time} s; the nearest one is at {rows[nearest]} s"
    if span is None:
        return UsageError(text, help="run with `dense_output = true` to have states at any time")
    return UsageError(
        f"{text}, and steps are stored from {span[0]} s to {span[1]} s", help="take one of these"
    )


def _beyond(time: float, first: float, last: float) -> UsageError:
    text = f"there is no state at {time} s; the run covers {first} s to {last} s"
    return UsageError(text, help="take a time of the run")


def no_rows() -> UsageError:
    """Return the error of a result without rows."""
    return UsageError(
        "the result has no rows: nothing was stored before the run ended",
        help="`Result.stop_reason` says why it ended; run the model again",
    )
