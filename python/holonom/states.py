"""States of a result at any time of its run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holonom.base.errors import FileError, UsageError
from holonom.base.text import quoted
from holonom.store.layout import STATE

if TYPE_CHECKING:
    from holonom.model import Model
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
        if not rows.size:
            # A run that ended before its first output row.
            raise UsageError(
                f"there is no state at {times[k]} s; the run covers {span} s",
                help="take a time of the run",
            )
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


def vector(times: ArrayLike) -> NDArray[np.float64]:
    """Return times as a vector of numbers."""
    try:
        wanted = np.atleast_1d(np.asarray(times, dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        raise UsageError(
            f"`times` is {quoted(repr(times))}", help="pass a vector of times, s"
        ) from None
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
        return UsageError(
            f"there is no state at {time} s; the run covers {first} s to {last} s",
            help="take a time of the run",
        )
    text = f"no state is stored at {time} s; the nearest one is at {rows[nearest]} s"
    if span is None:
        return UsageError(text, help="run with `dense_output = true` to have states at any time")
    return UsageError(
        f"{text}, and steps are stored from {span[0]} s to {span[1]} s", help="take one of these"
    )


def no_rows() -> UsageError:
    """Return the error of a result without rows."""
    return UsageError(
        "the result has no rows: nothing was stored before the run ended",
        help="`Result.stop_reason` says why it ended; run the model again",
    )
