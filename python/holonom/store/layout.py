"""The result store: one SQLite file that NumPy and `sqlite3` read without Holonom.

======== ===============================================================================
table    rows
======== ===============================================================================
meta     key, value: JSON; ``model``, ``model_hash``, ``options``, ``status``, …
quantity id, name, unit, frame, shape (JSON): ``time``, ``q``, ``qd``, … and the channels
chunk    one row per commit, and what belongs to it; see below
data     chunk, quantity, blob: little-endian f64, ``count`` × ``shape``, row by row
step     the steps attempted in a chunk: ``count``, ``columns`` and ``causes`` (JSON), blob
event    time, kind, data (JSON)
dense    the accepted steps of a chunk, with what the states inside them are made of; see below
chart    id, t, text (JSON), numbers: the independent variables of those steps
======== ===============================================================================

A row of ``chunk`` says what a commit added: output times ``first`` … ``first + count - 1``, which
stand in the rows of ``data`` from the id ``data`` on, one per quantity; the number of ``steps``
attempted; and how many ``quantities``, ``events`` and ``charts`` there are since the beginning of
the file. ``start`` and ``end`` (s) are those of its steps in ``dense``; null where it has none.

The blob of ``step`` holds one column after the other, little-endian f64 each: start ``t`` and size
``h`` of the attempt (s), its ``error`` (1 is on tolerance), ``accepted``, ``iterations``, …; the
``cause`` of a rejection is an index of ``causes``.

A row of ``dense`` holds ``count`` steps from ``start`` to ``end`` (s). Its blobs are little-endian
f64: ``t`` and ``h``, start and length of each step (s); the number of its ``chart``; the ``degree``
of its polynomials; ``q`` and ``winding`` at its start; the energy ``ledger`` there, and ``powers``
at start, quarters and end (W; empty where w has their integrals); ``normals`` that directions in
space are measured from; and in ``w`` the coefficients c₀, c₁, … of w(θ) = Σ cⱼ θʲ, each of
``dimension`` numbers, θ = (time - t)/h: independent variables, their rates, extra states, for
explicit codes also the energy dissipated and supplied. All coordinates follow from w, the joints
and the chart, as `Result.state` computes them. The ``numbers`` of a chart are the coordinates at
its time t, then the rows of a tangent plane, or references and anchors of relative coordinates.

**Checksums.** Every row ends in XXH3 (64 bits) of the table's name and of its other columns, each
after its length. Rows are asked for by their key, never found by a scan, and which keys there must
be is written, too: ``chunk`` counts what belongs to it, the entry ``keys`` of ``meta`` names all
entries, and that of a finished run says how many ``chunks`` there are. So a row that changed, moved
to another key, or vanished with its page is noticed, wherever the bit stood that flipped: in a
number, or in the pages of SQLite, which has no checksums of its own. What no row depends on, such
as free pages, is never read. Of a run that was killed the last commits may be lost with the
``-wal`` companion, whose frames SQLite checks itself; the file then says how far it goes.

While a run writes, the file is in WAL mode and every chunk is one commit, so that a killed run is
readable up to its last chunk. A finished file stands alone, without companions, and never changes
again: who goes on from it, or replaces it, writes beside it and renames.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from holonom import _core
from holonom.base import files
from holonom.base.errors import FileError

APPLICATION_ID = files.APPLICATION_ID
FORMAT = 3

#: The state at an output time: coordinates with rates, multipliers, extra states, windings and
#: the energy ledger.
STATE = ("time", "q", "qd", "qdd", "lambda", "z", "winding", "ledger")

#: Blobs of a row of the table `dense`.
DENSE = ("t", "h", "chart", "degree", "q", "winding", "normals", "ledger", "powers", "w")

#: Columns of a step log without entries.
STEP_COLUMNS = ("t", "h", "error", "accepted", "cause", "iterations")

#: Columns of each table with their types, the key first; a ``?`` allows null.
TABLES: dict[str, dict[str, str]] = {
    "meta": {"key": "TEXT", "value": "TEXT"},
    "quantity": {
        "id": "INTEGER",
        "name": "TEXT",
        "unit": "TEXT",
        "frame": "TEXT",
        "shape": "TEXT",
    },
    "chunk": {
        **dict.fromkeys(("id", "first", "count", "data", "quantities"), "INTEGER"),
        **dict.fromkeys(("steps", "events", "charts"), "INTEGER"),
        **dict.fromkeys(("start", "end"), "REAL?"),
    },
    "data": {"id": "INTEGER", "chunk": "INTEGER", "quantity": "INTEGER", "blob": "BLOB"},
    "step": {
        "chunk": "INTEGER",
        "count": "INTEGER",
        "columns": "TEXT",
        "causes": "TEXT",
        "blob": "BLOB",
    },
    "event": {"id": "INTEGER", "time": "REAL?", "kind": "TEXT?", "data": "TEXT"},
    "dense": {
        "chunk": "INTEGER",
        "count": "INTEGER",
        "start": "REAL",
        "end": "REAL",
        "dimension": "INTEGER",
        **dict.fromkeys(DENSE, "BLOB"),
    },
    "chart": {"id": "INTEGER", "t": "REAL", "text": "TEXT", "numbers": "BLOB"},
}


def _statement(table: str, columns: Mapping[str, str]) -> str:
    parts: list[str] = []
    for name, kind in columns.items():
        rule = "" if kind.endswith("?") else " NOT NULL"
        parts.append(f'"{name}" {kind.rstrip("?")}{" PRIMARY KEY" if not parts else rule}')
    ending = " WITHOUT ROWID" if columns[next(iter(columns))] == "TEXT" else ""
    return f'CREATE TABLE {table} ({", ".join(parts)}, "checksum" INTEGER NOT NULL){ending}'


#: What makes each table, to the letter: a file whose schema differs was not written here.
SCHEMA = {table: _statement(table, columns) for table, columns in TABLES.items()}

_INSERT = {
    table: f"INSERT INTO {table} VALUES ({', '.join('?' * (len(columns) + 1))})"  # noqa: S608
    for table, columns in TABLES.items()
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a stored array is.

    Parameters
    ----------
    name : str
        ``time``, ``q``, … or a channel such as ``chassis.position``.
    unit : str
        SI unit; ``mixed`` for coordinates, which hold lengths and angles.
    frame : str
        Axes of the components, such as ``ground``; empty where there are none.
    shape : tuple of int
        Shape at one time; ``()`` for a scalar.
    """

    name: str
    unit: str
    frame: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of components."""
        return math.prod(self.shape)


def undescribed(name: str, shape: tuple[int, ...]) -> Quantity:
    """Return what an array is that is no channel: a part of the state."""
    return Quantity(name, "s" if name == "time" else "mixed", "", shape)


def row_checksum(table: str, row: Sequence[Any]) -> int:
    """Return the checksum of a row's columns: integers, floats, texts, bytes or None."""
    kinds, parts = [table], []
    for value in row:
        if isinstance(value, bytes):
            kind, part = "b", value
        elif isinstance(value, str):
            kind, part = "t", value.encode("utf-8", "surrogatepass")
        elif isinstance(value, float):
            kind, part = "r", struct.pack("<d", value)
        elif value is None:
            kind, part = "n", b""
        else:
            kind, part = "i", str(int(value)).encode()
        kinds.append(kind)
        parts.append(part)
    return _core.checksum([" ".join(kinds).encode(), *parts])


def insert(db: sqlite3.Connection, table: str, row: Sequence[Any], verb: str = "INSERT") -> None:
    """Store a row with its checksum."""
    statement = verb + _INSERT[table].removeprefix("INSERT")
    db.execute(statement, (*row, row_checksum(table, row)))


def put_meta(db: sqlite3.Connection, meta: Mapping[str, Any]) -> None:
    """Store entries of ``meta`` and name them in its entry ``keys``."""
    keys = {key for (key,) in db.execute("SELECT key FROM meta")} | meta.keys() - {"keys"}
    for key, value in {**meta, "keys": sorted(keys - {"keys"})}.items():
        text = json.dumps(value, ensure_ascii=False)
        insert(db, "meta", (key, text), "INSERT OR REPLACE")


def connect(path: Path, mode: str) -> sqlite3.Connection:
    """Open a database that is there: ``rw``, ``ro``, or ``ro&immutable=1`` if nobody writes it."""
    uri = f"file:{quote(os.fsencode(path.resolve()))}?mode={mode}"
    return sqlite3.connect(uri, uri=True, check_same_thread=False)


def leave_wal(db: sqlite3.Connection) -> bool:
    """Fold the ``-wal`` companion into the file; False while others have the file open."""
    try:
        db.execute("PRAGMA busy_timeout = 0")
        (mode,) = db.execute("PRAGMA journal_mode = DELETE").fetchone()
    except sqlite3.OperationalError:
        return False
    return bool(mode == "delete")


@contextmanager
def as_file_errors(path: Path | None) -> Iterator[None]:
    """Name the file in what SQLite and the system say."""
    try:
        yield
    except FileError:
        raise
    except sqlite3.Error as error:
        said = str(error)
        kind = getattr(error, "sqlite_errorname", "")  # none of what Python itself refuses
        if kind.startswith(("SQLITE_FULL", "SQLITE_IOERR_WRITE")):
            said = f"no space is left there, or no more may be written ({said})\n  help: {_ROOM}"
        if "help: " not in said:
            said += f"\n  help: {_TRY.get(kind, _SEE)}"
        raise FileError(f"{path or 'the result'}: {said}") from error
    except OSError as error:
        raise files.unusable(path or Path("the result"), error) from error


_SEE = "look whether the disk works and whether another program has the file"
_TRY = {
    "SQLITE_BUSY": "another program has it open; wait until that is done",
    "SQLITE_LOCKED": "another program has it open; wait until that is done",
    "SQLITE_READONLY": "ask for write access to the file and its folder",
    "SQLITE_CANTOPEN": "ask for access to the file and its folder",
    "SQLITE_TOOBIG": "store fewer channels at fewer times: a commit is at most 1 GB",
    "SQLITE_NOMEM": "close other programs, or store fewer channels",
}
_ROOM = "make room, or choose another folder with `-o`; what was committed before is readable"
