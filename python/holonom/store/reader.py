"""Reads the arrays of the result store, and trusts nothing of what it finds there.

A file may be damaged, or made to harm. So its schema is compared with the one that is written, to
the letter, before any row is asked for; every row is looked up by its key and checked against its
checksum; and no array is larger than the file. See `holonom.store.layout` for the checksums.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.base import files
from holonom.base.errors import FileError
from holonom.store import legacy
from holonom.store.attempts import Total, totals
from holonom.store.contents import MOST_DAMAGE, Contents, rows_of
from holonom.store.integrity import (
    BROKEN,
    DamagedRow,
    checked_schema,
    may_write,
    require,
    require_result,
    require_schema,
    size_of,
    verified_row,
)
from holonom.store.layout import (
    DENSE,
    FORMAT,
    STATE,
    STEP_COLUMNS,
    as_file_errors,
    connect,
    leave_wal,
    put_meta,
)
from holonom.store.locks import only_writer, sweep, writer_of

if TYPE_CHECKING:
    from holonom.store.writer import Writer


class Reader(Contents):
    """Reads the arrays of a store; parameters, attributes and errors are those of `Contents`."""

    @classmethod
    def open(cls, path: Path, *, recover: bool = False, written_here: bool = False) -> Reader:
        """Open a file; what a killed run left in its ``-wal`` companion is recovered.

        Parameters
        ----------
        path : Path
        recover : bool
            See the class.
        written_here : bool
            Whether the caller holds the lock on the file and has finished writing it.

        Raises
        ------
        FileError
            If the file cannot be read, is not a result, or is damaged.
        """
        real, version = require_result(path)
        companions = any(os.path.lexists(f"{real}{ending}") for ending in ("-wal", "-journal"))
        writing = not written_here and writer_of(real) is not None
        if companions and not writing and may_write(real):
            with as_file_errors(path), closing(connect(real, "rw")) as db:
                companions = not leave_wal(db)  # nobody else has it open: it now stands alone
        # What nobody writes is read without locks and companions: those beside the name may come
        # from a run that replaces the file, while this process goes on reading the older one.
        live = companions or writing
        mode = ("rw" if may_write(real) else "ro") if live else "ro&immutable=1"
        with as_file_errors(path):
            db = connect(real, mode)
        try:
            schema = checked_schema(db, path, size := size_of(real))
            if version < FORMAT:
                db = legacy.converted(db, version, schema, path, size)
            else:
                require_schema(schema, path)
                db.set_progress_handler(None, 0)
            reader = cls(db, path, recover=recover)
            if reader.meta.get("status") == "running" and not writing:
                reader.meta["status"] = "killed"
                sweep(real)
        except BaseException:
            db.close()
            raise
        return reader

    @classmethod
    def of(cls, writer: Writer) -> Reader:
        """Return a reader of what was written; the writer writes no more, but keeps its lock."""
        db = writer.hand_over()
        if db is None:
            assert writer.path is not None
            return cls.open(writer.path, written_here=writer.locked)
        return cls(db, None)

    def close(self) -> None:
        """Let go of the file."""
        if self._open is not None:
            self._open.close()
            self._open = None

    def __del__(self) -> None:
        if hasattr(self, "_open"):
            self.close()

    @property
    def end(self) -> float:
        """Last time (s) of which there is anything; minus infinity without rows and steps."""
        last = [float(self.rows("time", self.count - 1, 1)[0])] if self.count else []
        span = self.dense_span
        return max([*last, *([span[1]] if span else [])], default=-math.inf)

    def read(self, name: str) -> NDArray[np.float64]:
        r"""Return a stored quantity.

        Returns
        -------
        ndarray, shape (n_times, \*shape)
        """
        blobs, total = [], 0
        for chunk in self._rows:
            blob = self._blob(chunk, name)
            total += len(blob)
            if total > self._limit:
                raise self._damaged(f"`{name}` is larger than the file")
            blobs.append(blob)
        values = np.frombuffer(b"".join(blobs), dtype="<f8").astype(np.float64, copy=False)
        return values.reshape(self.count, *self.quantities[name].shape)

    def rows(self, name: str, first: int, count: int) -> NDArray[np.float64]:
        r"""Return a part of a stored quantity, without reading the rest.

        Parameters
        ----------
        name : str
        first, count : int
            The first output time and how many; what lies beyond the last is left out.

        Returns
        -------
        ndarray, shape (at most count, \*shape)
        """
        quantity = self.quantities[name]
        begin = max(0, bisect_right(self._starts, first) - 1)
        end = bisect_right(self._starts, first + count - 1)
        blobs = [self._blob(chunk, name) for chunk in self._rows[begin:end]]
        there = sum(chunk["count"] for chunk in self._rows[begin:end])
        values = np.frombuffer(b"".join(blobs), dtype="<f8").astype(np.float64, copy=False)
        skipped = first - self._starts[begin]
        return values.reshape(there, *quantity.shape)[skipped : skipped + count]

    def row(self, index: int) -> dict[str, NDArray[np.float64]]:
        """Return the state at one output time, each part as a vector."""
        return {
            name: np.array(self.rows(name, index, 1), dtype=np.float64).reshape(-1)
            for name in STATE
            if name in self._ids
        }

    @property
    def dense_span(self) -> tuple[float, float] | None:
        """First and last time (s) that states can be computed at; None without dense output."""
        if not len(self._dense):
            return None
        return float(self._dense[0, 1]), float(self._dense[-1, 2])

    def dense_chunks(
        self, times: NDArray[np.float64]
    ) -> Iterator[tuple[NDArray[np.intp], dict[str, Any]]]:
        """Yield indices of times (s) within `dense_span` with the steps that hold them."""
        places = np.searchsorted(self._dense[:, 1], times, side="right") - 1
        gaps = times > self._dense[places, 2] + 1e-9 * np.maximum(1.0, np.abs(times))
        if gaps.any():
            raise self._damaged(f"the steps at {times[gaps][0]} s")
        for place in np.unique(places):
            yield np.nonzero(places == place)[0], self._dense_steps(int(self._dense[place, 0]))

    def steps(self) -> dict[str, NDArray[Any]]:
        """Return the step log by column; texts are an object array."""
        logs = [log for chunk in self._chunks if chunk["steps"] and (log := self._step_log(chunk))]
        names = dict.fromkeys(name for log in logs for name in log)
        found: dict[str, NDArray[Any]] = {}
        for name in names or dict.fromkeys(STEP_COLUMNS):
            kind: Any = object if name == "cause" else np.float64
            empty = "" if name == "cause" else np.nan
            parts = [log.get(name, np.full(log["t"].size, empty, dtype=kind)) for log in logs]
            found[name] = np.concatenate(parts) if parts else np.zeros(0, dtype=kind)
        return found

    def step_totals(self) -> list[Total]:
        """Return the attempts by outcome; see `attempts.totals`."""
        return totals(self.steps())

    def events(self) -> list[dict[str, Any]]:
        """Return the events in the order in which they happened."""
        found = []
        for number in range(1, self._last["events"] + 1):
            try:
                event = json.loads(verified_row(self._db, "event", number)["data"])
                require(isinstance(event, dict))
            except (DamagedRow, *BROKEN):
                self._note(f"event {number}")
                if len(self.damage) > MOST_DAMAGE:
                    break
            else:
                found.append(event)
        return found

    def verify(self) -> None:
        """Read all there is, so that `damage` names every part that is lost.

        Raises
        ------
        FileError
            ``result/damaged``, at the first one, if `recover` was not asked for.
        """
        _ = self._db  # what is closed is refused, not damaged
        for name in self.quantities:
            for chunk in self._rows:
                if len(self.damage) > MOST_DAMAGE:
                    return
                self._verify(partial(self._blob, chunk, name))
        self._verify(self.steps)
        self._verify(self.events)
        for number in self._dense[:, 0].astype(int).tolist():
            part = f"the steps of chunk {number}"
            self._verify(partial(self._dense_steps, number), part)

    def _verify(self, read: Callable[[], object], part: str = "") -> None:
        """Read something; note as lost what is refused even where reading goes on."""
        try:
            read()
        except FileError as error:
            if not self._recover:
                raise
            self._note(part or str(error).partition("\n")[0])

    def amend(self, meta: Mapping[str, Any]) -> None:
        """Store more entries of ``meta``, what is learnt about a run after its end."""
        if self.path is None:
            put_meta(self._db, meta)
            self._db.commit()
        else:
            real = self.path.resolve()
            with as_file_errors(self.path), closing(connect(real, "rw")) as db:
                put_meta(db, meta)
                db.commit()
            self._db.close()  # it reads without locks, and must not keep older pages
            self._open = connect(real, "ro&immutable=1")
        self.meta |= json.loads(json.dumps(meta))

    def require_unchanged(self) -> None:
        """Refuse to go on from what another run has replaced before this process got the lock."""
        assert self.path is not None
        now = Reader.open(self.path, written_here=True)
        same = now.last_chunk == self.last_chunk and now.meta == self.meta
        now.close()
        if not same:
            raise FileError(
                f"{self.path} was replaced while this run began\n  help: start it again",
                code="result/busy",
            )

    def copy_into(self, db: sqlite3.Connection) -> None:
        """Copy the store into an empty database."""
        with as_file_errors(self.path):
            self._db.backup(db)

    def save(self, path: Path, *, force: bool = False) -> None:
        """Write a copy as one file, in one move.

        Raises
        ------
        FileError
            If it cannot be written, is there and is not a result, or is this result itself.
        """
        real = files.require_target(path, "result", inputs=[self.path], force=force)
        with (
            as_file_errors(path),
            only_writer(real, path),
            files.replacing(path, "result", inputs=[self.path], force=force) as fresh,
            closing(sqlite3.connect(fresh)) as copy,
        ):
            self._db.backup(copy)
            leave_wal(copy)

    def _blob(self, chunk: dict[str, Any], name: str) -> bytes:
        """Return the numbers of a quantity in a chunk; NaN for those that are lost."""
        expected = 8 * chunk["count"] * self.quantities[name].size
        try:
            blob = self._data(chunk, name)
            require(len(blob) == expected)
        except DamagedRow:
            self._note(f"`{name}` in rows {rows_of(chunk)}")
            if expected > self._limit:
                raise self._damaged(f"`{name}` is larger than the file") from None
            return np.full(expected // 8, np.nan, dtype="<f8").tobytes()
        return blob

    def _dense_steps(self, number: int) -> dict[str, Any]:
        part = f"the steps of chunk {number}"
        try:
            row = verified_row(self._db, "dense", number)
            steps: dict[str, Any] = {name: _numbers(row[name]) for name in DENSE}
            require({steps[n].size for n in ("t", "h", "chart", "degree")} == {row["count"]})
            charts = steps["chart"]
            require(0 <= row["dimension"] < 2**31)
            require(row["count"] > 0 and _are_indices(charts, self._last["charts"]))
            first, last = int(charts.min()), int(charts.max())
            rows = [verified_row(self._db, "chart", key) for key in range(first, last + 1)]
            steps["charts"] = [(r["t"], r["text"], _numbers(r["numbers"])) for r in rows]
        except (DamagedRow, *BROKEN):
            raise self._damaged(part) from None
        return steps | {
            "charts_before": first,
            "end": row["end"],
            "dimension": row["dimension"],
        }

    def _step_log(self, chunk: dict[str, Any]) -> dict[str, NDArray[Any]] | None:
        try:
            row = verified_row(self._db, "step", chunk["id"])
            columns, causes = json.loads(row["columns"]), json.loads(row["causes"])
            require(_are_texts(columns) and _are_texts(causes))
            table = _numbers(row["blob"]).reshape(len(columns), row["count"])
            log: dict[str, NDArray[Any]] = dict(zip(columns, table, strict=True))
            require(log.keys() >= {"t", "h", "accepted"} and row["count"] == chunk["steps"])
            if "cause" in log:
                require(_are_indices(log["cause"], len(causes)))
                log["cause"] = np.array(causes, dtype=object)[log["cause"].astype(np.intp)]
        except (DamagedRow, *BROKEN):
            self._note(f"the step log of chunk {chunk['id']}")
            return None
        return log


def _are_texts(values: object) -> bool:
    return isinstance(values, list) and all(isinstance(value, str) for value in values)


def _are_indices(values: NDArray[np.float64], limit: int) -> bool:
    return bool(np.all((values >= 0) & (values < limit) & (values == np.floor(values))))


def _numbers(blob: bytes) -> NDArray[np.float64]:
    return np.frombuffer(blob, dtype="<f8").astype(np.float64)
