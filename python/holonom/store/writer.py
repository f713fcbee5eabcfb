"""Writes the result store, chunk by chunk; see `holonom.store.layout` for what stands where."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.base import files
from holonom.base.errors import FileError
from holonom.store.layout import (
    APPLICATION_ID,
    DENSE,
    FORMAT,
    SCHEMA,
    STATE,
    TABLES,
    Quantity,
    as_file_errors,
    insert,
    leave_wal,
    put_meta,
    undescribed,
)
from holonom.store.locks import WriteLock

if TYPE_CHECKING:
    from holonom.store.reader import Reader

#: What SQLite may leave beside a file.
_COMPANIONS = ("-wal", "-shm", "-journal")


@dataclass(frozen=True, slots=True)
class Rewind:
    """Where a run that did not end is taken up.

    Parameters
    ----------
    chunk : int
        The last chunk that stays.
    text : str or None
        The core's checkpoint at its end. None: the run, or its last part, begins anew there.
    is_whole : bool
        Whether the result is of one run, not of several that went on from each other.
    """

    chunk: int
    text: str | None
    is_whole: bool


class NotRepeatedError(Exception):
    """A run that was taken up computes other numbers than before."""


class Writer:
    """Writes one run, chunk by chunk.

    The file is made beside the one it replaces, and takes its place with the first commit that
    goes beyond the start: until then the older result stands. No other writer of the same file is
    let in until `close` or `release`.

    Parameters
    ----------
    path : Path or None
        The file; an older result there is replaced. None keeps the store in memory.
    meta : mapping
        First entries of the table ``meta``: plain data.
    channels : mapping of str to Quantity
        Units and frames by name.
    continues : Reader, optional
        The result at `path`, which this run goes on from: its rows stay, those of the run are
        appended; where both have the same time, the older row.
    rewind : Rewind, optional
        Where `continues` is taken up: what it has beyond is written anew, and compared. It stands
        until this run is beyond its end.
    force : bool
        Whether any regular file may be replaced, not only a result.

    Attributes
    ----------
    kept : bool
        After `finish`: whether the older result still stands, because this run got nowhere.

    Raises
    ------
    FileError
        If the file cannot be written, is there and is not a result, or is being written.
    NotRepeatedError
        By `append`, where rows come out otherwise than in the result that is taken up.
    """

    def __init__(
        self,
        path: Path | None,
        meta: Mapping[str, Any],
        channels: Mapping[str, Quantity],
        *,
        continues: Reader | None = None,
        rewind: Rewind | None = None,
        force: bool = False,
    ) -> None:
        self.path = path
        self.kept = False
        self._channels = channels
        self._ids: dict[str, int] = {}
        self._sizes: dict[str, int] = {}
        #: The last row of the table ``chunk``, which the next one counts on from.
        self._last: dict[str, Any] = dict.fromkeys(TABLES["chunk"], 0)
        self._until: float | None = None
        self._charts_before = 0
        self._compared: Reader | None = None
        #: Time (s) beyond which a run that is taken up takes the place of the older file.
        self._goal: float | None = None
        self._advanced = False
        self._lock: WriteLock | None = None
        self._fresh: Path | None = None
        if path is None:
            self._db = sqlite3.connect(":memory:", check_same_thread=False)
            self._fill(meta, None, None)
            return
        self._force = force
        self._real = files.require_target(path, "result", force=force)
        with as_file_errors(path):
            self._real.parent.mkdir(parents=True, exist_ok=True)
            self._lock = WriteLock(self._real, path)
            self._replaces = self._real.exists() and self._real.stat().st_size > 0
            # Of a name of its own, which the lock protects, so that none is left behind for good.
            self._fresh = self._real.with_name(f".{self._real.name}.new")
            try:
                self._discard()
                # Not yet worth a journal on disk: whatever ends this process leaves the old file.
                self._db = sqlite3.connect(self._fresh, check_same_thread=False)
                self._db.execute("PRAGMA synchronous = OFF")
                self._db.execute("PRAGMA journal_mode = MEMORY").fetchone()
                self._fill(meta, continues, rewind)
            except BaseException:
                self.close()
                raise

    @property
    def count(self) -> int:
        """Number of output times written, those of older parts included."""
        return int(self._last["first"] + self._last["count"])

    def append(self, chunk: Mapping[str, Any]) -> None:
        """Store and commit one chunk as the core delivers it: all of it or nothing."""
        if self._until is not None:
            chunk = self._renumbered(chunk)
        count = len(chunk["time"])
        before = self._ids, self._sizes, self._last
        with as_file_errors(self.path):
            self._db.execute("BEGIN")
            try:
                last = {**self._last, "id": self._last["id"] + 1}
                last["first"] = self._last["first"] + self._last["count"]
                last["data"] = self._last["data"]
                if self._last["count"]:
                    last["data"] += self._last["quantities"]
                last["count"] = count
                if count:
                    self._append_outputs(chunk, last)
                last["steps"] = self._append_steps(chunk.get("steps") or {}, last["id"])
                last["events"] += self._append_events(chunk.get("events") or "[]", last["events"])
                last |= {"start": None, "end": None}
                if "dense" in chunk:
                    last |= self._append_dense(chunk["dense"], last)
                insert(self._db, "chunk", tuple(last.values()))
                if self.path is not None and "checkpoint" in chunk:
                    put_meta(self._db, _checkpoint(last["id"], chunk["checkpoint"]))
                self._db.commit()
            except BaseException:  # Ctrl-C too: the caller may append the same chunk again
                self._ids, self._sizes, self._last = before
                self._db.rollback()
                raise
            self._last = last
            self._advanced |= self._is_beyond(chunk, last)
            if self._fresh is not None and (self._advanced or not self._replaces):
                self._place()

    def finish(self, meta: Mapping[str, Any]) -> None:
        """Store the last entries of ``meta`` and leave one file without companions."""
        with as_file_errors(self.path):
            put_meta(self._db, {**meta, "chunks": self._last["id"]})
            if meta.get("status") != "interrupted":  # nobody takes it up
                self._db.execute("DELETE FROM meta WHERE key = 'checkpoint'")
                put_meta(self._db, {})
            self._db.commit()
            if self._fresh is not None:
                self.kept = self._replaces and meta.get("status") != "completed"
                if not self.kept:
                    self._place()
            if self.path is not None and not self.kept:
                leave_wal(self._db)

    def fail(self, meta: Mapping[str, Any]) -> bool:
        """Keep what is committed, and store why no more could be, where there is room for that.

        Without room the file says that the run did not end. In either case the checkpoint stays.

        Returns
        -------
        bool
            Whether anything is committed.
        """
        self.kept = self._fresh is not None
        with suppress(sqlite3.Error):  # a closed database, too
            self._db.rollback()
            try:
                put_meta(self._db, {**meta, "chunks": self._last["id"]})
                self._db.commit()
            except sqlite3.Error:
                self._db.rollback()
            if self.path is not None and not self.kept:
                leave_wal(self._db)
        return bool(self._last["id"])

    def close(self) -> None:
        """Let go of the file. Without `finish` it says that the run did not end."""
        with suppress(AttributeError):  # it could not even be made
            self._db.close()
        if self._fresh is not None:
            self._discard()
        self.release()

    def release(self) -> None:
        """Let other writers of the same file in."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def hand_over(self) -> sqlite3.Connection | None:
        """Write no more and return the database, or None where it is the file; keep the lock."""
        if self.path is not None and not self.kept:
            self._db.close()
            return None
        if self._fresh is not None:  # the older result stands: this one stays in memory
            memory = sqlite3.connect(":memory:", check_same_thread=False)
            with as_file_errors(self.path):
                self._db.backup(memory)
            self._db.close()
            self._db = memory
            self._discard()
        return self._db

    @property
    def locked(self) -> bool:
        """Whether no other process can write the file."""
        return self._lock is not None

    def describe(self, quantities: Iterable[Quantity]) -> None:
        """State the quantities before their first rows, where none may come."""
        self._channels = {quantity.name: quantity for quantity in quantities}
        arrays = {q.name: np.zeros((0, *q.shape)) for q in self._channels.values()}
        self._add_quantities(arrays)
        self._db.commit()
        self._last |= {"quantities": len(self._ids), "data": 1}

    def _fill(
        self, meta: Mapping[str, Any], continues: Reader | None, rewind: Rewind | None
    ) -> None:
        if continues is not None and rewind is not None:
            continues.require_unchanged()
            self._compared, self._goal = continues, continues.end
        if continues is None or (rewind is not None and rewind.chunk == 0):
            self._db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            self._db.execute(f"PRAGMA user_version = {FORMAT}")
            for statement in SCHEMA.values():
                self._db.execute(statement)
        else:
            continues.require_unchanged()
            continues.copy_into(self._db)
            self._ids, self._last = continues.quantity_ids, continues.last_chunk
            self._sizes = {name: q.size for name, q in continues.quantities.items()}
            if rewind is not None:
                self._last = continues.chunk(rewind.chunk)
                self._forget_beyond(self._last)
                if rewind.is_whole:
                    self._db.execute("DELETE FROM meta")
            # More chunks follow than the older run had when it ended.
            self._db.execute("DELETE FROM meta WHERE key = 'chunks'")
            rows = self._last["first"] + self._last["count"]
            self._until = float(continues.row(rows - 1)["time"][0]) if rows else -math.inf
            self._charts_before = self._last["charts"]
        if self.path is not None:
            text = None if rewind is None else rewind.text
            meta = {**meta, **_checkpoint(self._last["id"], text)}
        put_meta(self._db, meta)
        self._db.commit()

    def _forget_beyond(self, last: Mapping[str, Any]) -> None:
        """Leave out all that was written after a chunk."""
        for table in ("data", "step", "dense"):
            self._db.execute(f"DELETE FROM {table} WHERE chunk > ?", (last["id"],))  # noqa: S608
        self._db.execute("DELETE FROM chunk WHERE id > ?", (last["id"],))
        self._db.execute("DELETE FROM event WHERE id > ?", (last["events"],))
        self._db.execute("DELETE FROM chart WHERE id >= ?", (last["charts"],))
        if not last["quantities"]:
            self._db.execute("DELETE FROM quantity")
            self._ids, self._sizes = {}, {}

    def _is_beyond(self, chunk: Mapping[str, Any], last: Mapping[str, Any]) -> bool:
        """Return whether a chunk goes beyond what the older result has, or the start of the run."""
        rows = last["count"]
        if self._goal is None:
            return last["start"] is not None or (rows > 0 and last["first"] + rows > 1)
        ends = [float(chunk["time"][-1])] if rows else []
        ends += [last["end"]] if last["end"] is not None else []
        return max(ends, default=-math.inf) > self._goal

    def _require_repeated(self, arrays: Mapping[str, Any], last: Mapping[str, Any]) -> None:
        """Compare rows with those that the result which is taken up has in their places."""
        older = self._compared
        if older is None:
            return
        first, count = last["first"], min(last["count"], older.count - last["first"])
        if count <= 0:
            self._compared = None
            return
        times = np.ascontiguousarray(arrays["time"], dtype="<f8")
        is_last = older.meta["status"] == "interrupted" and first + count == older.count
        if is_last and older.rows("time", older.count - 1, 1)[0] != times[count - 1]:
            count -= 1  # where it was interrupted there is a row of its own
        for name, array in arrays.items():
            found = np.ascontiguousarray(array[:count], dtype="<f8").tobytes()
            if found != older.rows(name, first, count).astype("<f8").tobytes():
                raise NotRepeatedError(name)

    def _renumbered(self, chunk: Mapping[str, Any]) -> dict[str, Any]:
        """Return a chunk of a run that goes on, without the row that is there."""
        taken = dict(chunk)
        time = np.asarray(chunk["time"])
        new = time > self._until
        if not new.all():
            arrays = {name: chunk[name] for name in STATE if name in chunk}
            taken |= {name: np.asarray(array)[new] for name, array in arrays.items()}
            channels = chunk.get("channels", {})
            taken["channels"] = {name: np.asarray(a)[new] for name, a in channels.items()}
        if "dense" in chunk:
            dense = dict(chunk["dense"])
            dense["charts_before"] += self._charts_before
            dense["chart"] = np.asarray(dense["chart"]) + self._charts_before
            taken["dense"] = dense
        return taken

    def _append_outputs(self, chunk: Mapping[str, Any], last: dict[str, Any]) -> None:
        arrays = {name: chunk[name] for name in STATE if name in chunk}
        arrays |= chunk.get("channels", {})
        if not self._ids:
            self._add_quantities(arrays)
            last["quantities"], last["data"] = len(self._ids), 1
        if arrays.keys() != self._ids.keys():
            raise FileError(
                f"a chunk holds other quantities than the first: {sorted(arrays)}", _ONE_RUN
            )
        self._require_repeated(arrays, last)
        for name, array in arrays.items():
            values = np.ascontiguousarray(array, dtype="<f8")
            if values.size != last["count"] * self._sizes[name]:
                raise FileError(
                    f"`{name}` has {values.size} numbers for {last['count']} times", _ONE_RUN
                )
            number = self._ids[name]
            key = last["data"] + number - 1
            insert(self._db, "data", (key, last["id"], number, values.tobytes()))

    def _add_quantities(self, arrays: Mapping[str, NDArray[np.float64]]) -> None:
        ids, sizes = {}, {}
        for number, (name, array) in enumerate(arrays.items(), start=1):
            shape = tuple(int(n) for n in np.shape(array)[1:])
            known = self._channels.get(name, undescribed(name, shape))
            row = (number, name, known.unit, known.frame, json.dumps(shape))
            insert(self._db, "quantity", row)
            ids[name] = number
            sizes[name] = math.prod(shape)
        self._ids, self._sizes = ids, sizes

    def _append_steps(self, steps: Mapping[str, Any], chunk: int) -> int:
        if not steps or not len(steps["t"]):
            return 0
        causes = list(dict.fromkeys(steps["cause"])) if "cause" in steps else []
        index = {cause: number for number, cause in enumerate(causes)}
        columns = [
            [index[cause] for cause in values] if name == "cause" else values
            for name, values in steps.items()
        ]
        blob = np.array(columns, dtype="<f8").tobytes()
        count = len(steps["t"])
        row = (chunk, count, json.dumps(list(steps)), json.dumps(causes), blob)
        insert(self._db, "step", row)
        return count

    def _append_events(self, text: str, before: int) -> int:
        events = json.loads(text)
        for number, event in enumerate(events, start=before + 1):
            time = event.get("time")
            row = (number, None if time is None else float(time), event.get("kind"))
            insert(self._db, "event", (*row, json.dumps(event)))
        return len(events)

    def _append_dense(self, dense: Mapping[str, Any], last: Mapping[str, Any]) -> dict[str, Any]:
        first = dense["charts_before"]
        for number, (t, text, numbers) in enumerate(dense["charts"], start=first):
            insert(self._db, "chart", (number, float(t), text, _bytes(numbers)))
        facts: dict[str, Any] = {"charts": max(last["charts"], first + len(dense["charts"]))}
        count = len(dense["t"])
        if count:
            facts |= {"start": float(dense["t"][0]), "end": float(dense["end"])}
            blobs = [_bytes(dense[name]) for name in DENSE]
            span = (facts["start"], facts["end"], int(dense["dimension"]))
            insert(self._db, "dense", (last["id"], count, *span, *blobs))
        return facts

    def _place(self) -> None:
        """Move the new file to its place, then write it in WAL mode."""
        if self._fresh is None:
            return
        files.require_target(self._real, "result", force=self._force)
        self._db.commit()
        self._db.close()
        for companion in _COMPANIONS:  # of an older, killed run
            self._real.with_name(self._real.name + companion).unlink(missing_ok=True)
        files.put_in_place(self._fresh, self._real)
        self._fresh = None
        self._db = sqlite3.connect(self._real, check_same_thread=False)
        try:
            # NORMAL: a commit survives the end of the process; a power cut may lose the last.
            self._db.execute("PRAGMA synchronous = NORMAL")
            self._db.execute("PRAGMA journal_mode = WAL").fetchone()
            self._db.execute(f"PRAGMA user_version = {FORMAT}")  # shows whether WAL works here
        except sqlite3.OperationalError:  # it needs shared memory, which network folders lack
            self._db.execute("PRAGMA journal_mode = DELETE").fetchone()

    def _discard(self) -> None:
        assert self._fresh is not None
        for companion in ("", *_COMPANIONS):
            self._fresh.with_name(self._fresh.name + companion).unlink(missing_ok=True)


def _checkpoint(chunk: int, text: str | None) -> dict[str, Any]:
    return {"checkpoint": {"chunk": chunk, "text": text}}


def _bytes(values: NDArray[np.float64]) -> bytes:
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


_ONE_RUN = "append chunks of one run, as the core gives them"
