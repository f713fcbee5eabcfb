"""A result in memory: arrays as the core made them, with the interface of a result file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holonom.base import files
from holonom.store.attempts import Total, totals
from holonom.store.layout import STATE, STEP_COLUMNS, Quantity, as_file_errors, undescribed
from holonom.store.locks import only_writer
from holonom.store.reader import Reader
from holonom.store.writer import Writer

#: Rows that a file takes in one commit.
_ROWS = 4096


class Memory:
    """Takes one run, chunk by chunk, and gives what was taken; both `Writer` and `Reader`.

    Parameters
    ----------
    meta : mapping
        First entries of `meta`: plain data.
    channels : mapping of str to Quantity
        Units and frames by name.
    later : callable, optional
        Returns further entries, when `meta` is first asked for: what takes long to make.

    Attributes
    ----------
    path : None
    count : int
        Number of output times.
    """

    path: Path | None = None

    def __init__(
        self,
        meta: Mapping[str, Any],
        channels: Mapping[str, Quantity],
        later: Callable[[], Mapping[str, Any]] = dict,
    ) -> None:
        self._entries = dict(meta)
        self._later = later
        self.count = 0
        self._channels = channels
        self._chunks: list[Mapping[str, Any]] = []
        self._joined: dict[str, NDArray[np.float64]] = {}

    def append(self, chunk: Mapping[str, Any]) -> None:
        """Keep one chunk as the core delivers it; nothing is done with it before it is read."""
        self._chunks.append(chunk)
        self.count += len(chunk["time"])

    def finish(self, meta: Mapping[str, Any]) -> None:
        """Keep the last entries of `meta`."""
        self._entries |= meta

    @cached_property
    def meta(self) -> dict[str, Any]:
        """What is known about the run."""
        return self._entries | dict(self._later())

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """What is stored, in the order of storing."""
        first = next((chunk for chunk in self._chunks if len(chunk["time"])), {})
        arrays = {name: first[name] for name in STATE if name in first}
        arrays |= first.get("channels", {})
        return {
            name: self._channels.get(name, undescribed(name, array.shape[1:]))
            for name, array in arrays.items()
        }

    @cached_property
    def _dense(self) -> list[dict[str, Any]]:
        """Accepted steps, chunk by chunk."""
        return [chunk["dense"] for chunk in self._chunks if chunk.get("dense")]

    def close(self) -> None:
        """Do nothing: there is no file."""

    def read(self, name: str) -> NDArray[np.float64]:
        r"""Return a stored quantity, ndarray, shape (n_times, \*shape)."""
        if name not in self._joined:
            place = name if name in STATE else "channels"
            parts = [chunk[place] for chunk in self._chunks if len(chunk["time"])]
            if place == "channels":
                parts = [channels[name] for channels in parts]
            self._joined[name] = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return self._joined[name]

    def rows(self, name: str, first: int, count: int) -> NDArray[np.float64]:
        r"""Return a part of a stored quantity, ndarray, shape (at most count, \*shape)."""
        return self.read(name)[first : first + count]

    def row(self, index: int) -> dict[str, NDArray[np.float64]]:
        """Return the state at one output time, each part as a vector."""
        return {
            name: np.array(self.read(name)[index], ndmin=1)
            for name in STATE
            if name in self.quantities
        }

    @property
    def dense_span(self) -> tuple[float, float] | None:
        """First and last time (s) that states can be computed at; None without dense output."""
        chunks = [chunk for chunk in self._dense if len(chunk["t"])]
        return (float(chunks[0]["t"][0]), float(chunks[-1]["end"])) if chunks else None

    def dense_chunks(
        self, times: NDArray[np.float64]
    ) -> Iterator[tuple[NDArray[np.intp], dict[str, Any]]]:
        """Yield indices of times (s) within `dense_span` with the steps that hold them."""
        chunks = [chunk for chunk in self._dense if len(chunk["t"])]
        starts = np.array([chunk["t"][0] for chunk in chunks])
        places = np.searchsorted(starts, times, side="right") - 1
        for place in np.unique(places):
            steps = chunks[place]
            first, last = int(steps["chart"].min()), int(steps["chart"].max())
            charts = [chart for chunk in self._dense for chart in chunk["charts"]][first : last + 1]
            found = steps | {"charts": charts, "charts_before": first}
            yield np.nonzero(places == place)[0], found

    def steps(self) -> dict[str, NDArray[Any]]:
        """Return the step log by column; texts are an object array."""
        log: dict[str, NDArray[Any]] = {}
        chunks = [chunk["steps"] for chunk in self._chunks if chunk.get("steps")]
        for column in chunks[0] if chunks else STEP_COLUMNS:
            dtype = object if column == "cause" else np.float64
            parts = [np.asarray(steps[column], dtype=dtype) for steps in chunks]
            log[column] = np.concatenate(parts) if parts else np.zeros(0, dtype)
        return log

    def step_totals(self) -> list[Total]:
        """Return the attempts by outcome; see `attempts.totals`."""
        return totals(self.steps())

    def events(self) -> list[dict[str, Any]]:
        """Return the events in the order in which they happened."""
        texts = [chunk.get("events") or "[]" for chunk in self._chunks]
        return [event for text in texts for event in json.loads(text)]

    def amend(self, meta: Mapping[str, Any]) -> None:
        """Keep more entries of `meta`, what is learnt about a run after its end."""
        self.meta |= json.loads(json.dumps(meta))

    def release(self) -> None:
        """Do nothing: no other writer waits."""

    def save(self, path: Path, *, force: bool = False) -> None:
        """Write the result as one file, in one move.

        Raises
        ------
        FileError
            If it cannot be written, or something else than a result is there.
        """
        real = files.require_target(path, "result", force=force)
        with (
            as_file_errors(path),
            only_writer(real, path),
            files.replacing(path, "result", force=force) as fresh,
        ):
            writer = Writer(fresh, self.meta, self.quantities)
            try:
                for chunk in self._pieces():
                    writer.append(chunk)
                writer.finish({"status": self.meta.get("status", "running")})
            finally:
                writer.close()

    def _pieces(self) -> Iterator[Mapping[str, Any]]:
        """Yield what was appended, rows in commits that a file can take."""
        for chunk in self._chunks:
            rest = {name: chunk[name] for name in ("steps", "events", "dense") if name in chunk}
            yield {"time": []} | rest
        for first in range(0, self.count, _ROWS):
            rows = {name: self.rows(name, first, _ROWS) for name in self.quantities}
            channels = {name: rows.pop(name) for name in list(rows) if name not in STATE}
            yield rows | {"channels": channels}


#: Where a result is read from.
Stored = Reader | Memory
