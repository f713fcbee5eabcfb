"""What a result file says that it holds, verified when it is opened; what of it is damaged."""

from __future__ import annotations

import json
import math
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import FileError
from holonom.store.facts import require_facts
from holonom.store.integrity import BROKEN, DamagedRow, damaged, require, size_of, verified_row
from holonom.store.layout import TABLES, Quantity

#: Whole numbers that are told apart from all others as floats.
_LARGEST = 2**53
#: So many parts are told; a file with more of them is nearly nothing else.
MOST_DAMAGE = 10_000

#: Entries of ``meta`` that are looked for where the list of them is lost.
_KNOWN = (
    *("holonom", "name", "title", "model", "model_hash", "options", "requested", "warnings"),
    *("status", "started", "finished", "stop_reason", "statistics", "residuals", "energy", "dof"),
    *("method", "end_time", "cpu_seconds", "cpu_seconds_per_simulated_second", "limited_by"),
    *("certification", "parts", "chunks", "checkpoint"),
)


class Contents:
    """What there is in a store up to the last chunk that was there when it was opened.

    Parameters
    ----------
    db : sqlite3.Connection
    path : Path or None
    recover : bool
        Whether to go on where something is damaged: chunks whose times are lost are left out, and
        what else is lost is NaN or absent. `damage` says what.

    Attributes
    ----------
    path : Path or None
    meta : dict
        Entries of the table ``meta``, decoded.
    quantities : dict of str to Quantity
        What is stored, in the order of storing.
    count : int
        Number of output times.
    damage : list of str
        Parts that were found damaged so far, where reading went on all the same.

    Raises
    ------
    FileError
        ``result/damaged``, if a part that is read is not what was written and `recover` is not
        asked for.
    """

    def __init__(self, db: sqlite3.Connection, path: Path | None, *, recover: bool = False) -> None:
        self.path = path
        self.damage: list[str] = []
        self._noted: set[str] = set()
        #: None once it is closed.
        self._open: sqlite3.Connection | None = db
        self._recover = recover
        self._limit = size_of(path.resolve()) if path is not None else _LARGEST
        self.meta = self._read_meta()
        #: Where a run that did not end can be taken up: ``chunk`` and ``text``; see `Rewind`.
        self.checkpoint: dict[str, Any] | None = self.meta.pop("checkpoint", None)
        self._chunks = self._read_chunks()
        last = self._chunks[-1] if self._chunks else dict.fromkeys(TABLES["chunk"], 0)
        self._last = last
        self._ids: dict[str, int] = {}
        self.quantities: dict[str, Quantity] = {}
        self._read_quantities(max((c["quantities"] for c in self._chunks), default=0))
        self._rows = [chunk for chunk in self._chunks if chunk["count"]]
        self._require_times()
        self.count = sum(chunk["count"] for chunk in self._rows)
        self._starts = [0, *np.cumsum([chunk["count"] for chunk in self._rows]).tolist()]
        self._dense = self._spans()

    @property
    def _db(self) -> sqlite3.Connection:
        if self._open is None:
            raise FileError(
                f"{self.path or 'the result'} is closed",
                "read what is needed before `close`, within the `with` block, or open it again: "
                "`holonom.load(path)`",
                code="result/closed",
            )
        return self._open

    @property
    def quantity_ids(self) -> dict[str, int]:
        """Number of each quantity in the file."""
        return dict(self._ids)

    @property
    def last_chunk(self) -> dict[str, Any]:
        """The last row of the table ``chunk``."""
        return dict(self._last)

    def chunk(self, number: int) -> dict[str, Any]:
        """Return a row of the table ``chunk``."""
        found = [chunk for chunk in self._chunks if chunk["id"] == number]
        if not found:
            raise self._damaged(f"chunk {number}")
        return dict(found[0])

    def _damaged(self, part: str) -> FileError:
        return damaged(self.path, part, recover=self._recover)

    def _note(self, part: str) -> None:
        """Go on without a part, or refuse to."""
        if not self._recover:
            raise self._damaged(part) from None
        if part not in self._noted:
            self._noted.add(part)
            self.damage.append(part)

    def _entry(self, key: str) -> Any:
        try:
            return json.loads(verified_row(self._db, "meta", key)["value"])
        except (DamagedRow, *BROKEN):
            self._note(f"the entry `{key}` of its description")
            return None

    def _read_meta(self) -> dict[str, Any]:
        keys = self._entry("keys")
        if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
            self._note("the list of what describes the run")
            keys = list(_KNOWN)
        found = {}
        for key in keys:
            lost = len(self.damage)
            value = self._entry(key)
            if len(self.damage) == lost:
                found[key] = value
        for key in require_facts(found):
            self._note(f"the entry `{key}` of its description")
            found.pop(key)
        return found

    def _read_chunks(self) -> list[dict[str, Any]]:
        number = self.meta.pop("chunks", None)
        if number is None:  # it did not end, or that is lost: as far as there are rows
            try:
                (number,) = self._db.execute("SELECT max(id) FROM chunk").fetchone()
            except BROKEN:
                self._note("the list of chunks")
        chunks: list[dict[str, Any]] = []
        rows = 0
        for key in range(1, (number or 0) + 1):
            try:
                chunk = verified_row(self._db, "chunk", key)
                counts = [v for v in chunk.values() if isinstance(v, int)]
                require(all(0 <= value < _LARGEST for value in counts))
                require(self._recover or chunk["first"] == rows)
            except DamagedRow:
                self._note(f"chunk {key}")
                if len(self.damage) > MOST_DAMAGE:
                    break
                continue
            rows = chunk["first"] + chunk["count"]
            chunks.append(chunk)
        return chunks

    def _read_quantities(self, number: int) -> None:
        for key in range(1, number + 1):
            try:
                row = verified_row(self._db, "quantity", key)
                shape = json.loads(row["shape"])
                require(row["name"] not in self._ids and _is_shape(shape))
            except (DamagedRow, *BROKEN):
                self._note(f"quantity {key}")
                if len(self.damage) > MOST_DAMAGE:
                    break
                continue
            name = row["name"]
            self._ids[name] = key
            self.quantities[name] = Quantity(name, row["unit"], row["frame"], tuple(shape))

    def _require_times(self) -> None:
        """Leave out the chunks whose times are lost; without any, nothing has a row."""
        if not self._rows:
            return
        if "time" not in self.quantities or self.quantities["time"].shape != ():
            self._note("the output times")
            self.quantities["time"] = Quantity("time", "s", "", ())
            self._rows = []
        for chunk in list(self._rows):
            try:
                require(len(self._data(chunk, "time")) == 8 * chunk["count"])
            except DamagedRow:
                self._note(f"the times of rows {rows_of(chunk)}")
                self._rows.remove(chunk)

    def _data(self, chunk: dict[str, Any], name: str) -> bytes:
        number = self._ids[name]
        row = verified_row(self._db, "data", chunk["data"] + number - 1)
        require((row["chunk"], row["quantity"]) == (chunk["id"], number))
        blob: bytes = row["blob"]
        return blob

    def _spans(self) -> NDArray[np.float64]:
        """Return chunk, start and end (s) of the steps that states are computed from, in order."""
        spans: list[tuple[int, float, float]] = []
        for chunk in self._chunks:
            if chunk["start"] is None or chunk["end"] is None:
                continue
            start, end = chunk["start"], chunk["end"]
            if not (math.isfinite(start) and math.isfinite(end)):
                self._note(f"the steps of chunk {chunk['id']}")
                continue
            # A run that went on from its last row says anew what was beyond it.
            while spans and spans[-1][1] >= start:
                spans.pop()
            spans.append((chunk["id"], start, end))
        return np.array(spans, dtype=np.float64).reshape(-1, 3)


def rows_of(chunk: dict[str, Any]) -> str:
    """Return which rows a chunk holds, as messages say it."""
    return f"{chunk['first']} to {chunk['first'] + chunk['count'] - 1}"


def _is_shape(shape: object) -> bool:
    return (
        isinstance(shape, list)
        and len(shape) <= 4
        and all(type(n) is int and 0 <= n < 2**31 for n in shape)
    )
