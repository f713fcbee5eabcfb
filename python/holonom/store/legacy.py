"""Results of formats 1 and 2, which have no checksums: read whole into one of the present format.

Their step log had a row per attempt, their ``dense`` rows a number of their own; format 1 had
neither ``dense`` nor ``chart``.
"""

from __future__ import annotations

import json
import math
import re
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from holonom.base.errors import FileError
from holonom.store.integrity import BROKEN, unreadable
from holonom.store.layout import DENSE, STATE, Quantity
from holonom.store.writer import Writer

_BLOBS = ", ".join(f"{name} BLOB NOT NULL" for name in DENSE)
_STEP = (
    "CREATE TABLE step (\n    id INTEGER PRIMARY KEY, t REAL NOT NULL, h REAL NOT NULL, error REAL,"
    "\n    accepted INTEGER NOT NULL, cause TEXT, iterations INTEGER"
)
_TABLES = {
    "meta": "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
    "quantity": "CREATE TABLE quantity (\n    id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE,"
    "\n    unit TEXT NOT NULL, frame TEXT NOT NULL, shape TEXT NOT NULL)",
    "chunk": "CREATE TABLE chunk (id INTEGER PRIMARY KEY, first INTEGER NOT NULL, "
    "count INTEGER NOT NULL)",
    "data": "CREATE TABLE data (\n    chunk INTEGER NOT NULL REFERENCES chunk, quantity INTEGER "
    "NOT NULL REFERENCES quantity,\n    blob BLOB NOT NULL, UNIQUE (quantity, chunk))",
    "event": "CREATE TABLE event (id INTEGER PRIMARY KEY, time REAL, kind TEXT, "
    "data TEXT NOT NULL)",
}
_DENSE_TABLES = {
    "dense": 'CREATE TABLE dense (\n    id INTEGER PRIMARY KEY, count INTEGER NOT NULL, "start" '
    f'REAL NOT NULL, "end" REAL NOT NULL,\n    dimension INTEGER NOT NULL, {_BLOBS})',
    "chart": "CREATE TABLE chart (\n    id INTEGER PRIMARY KEY, t REAL NOT NULL, text TEXT NOT "
    "NULL, numbers BLOB NOT NULL)",
}


def converted(
    db: sqlite3.Connection,
    version: int,
    schema: list[tuple[str, str, str, str | None]],
    path: Path,
    size: int,
) -> sqlite3.Connection:
    """Read an older result into a database in memory, and close it.

    Parameters
    ----------
    db : sqlite3.Connection
    version : int
        Its format.
    schema : list of tuple
        Type, name, table and statement of everything in it.
    path : Path
    size : int
        Bytes of the file: what it says that it holds cannot be more.

    Raises
    ------
    FileError
        ``result/damaged``.
    """
    _require_schema(version, schema, path)
    writer = Writer(None, {}, {})
    try:
        _convert(db, writer, version, size)
    except (*BROKEN, ArithmeticError, LookupError, TypeError, AttributeError, FileError) as error:
        raise unreadable(path, f"what it holds does not fit together ({error})") from None
    db.close()
    converted_db = writer.hand_over()
    assert converted_db is not None  # it has no file
    return converted_db


def _require_schema(
    version: int, schema: list[tuple[str, str, str, str | None]], path: Path
) -> None:
    tables = _TABLES | (_DENSE_TABLES if version > 1 else {})
    expected: set[tuple[str, str, str, str | None]] = {
        ("table", name, name, sql) for name, sql in tables.items()
    }
    expected |= {("index", f"sqlite_autoindex_{t}_1", t, None) for t in ("quantity", "data")}
    found = set(schema)
    steps = [sql for kind, name, *_, sql in schema if (kind, name) == ("table", "step")]
    columns = (
        re.fullmatch(re.escape(_STEP) + r'((, "[a-z_]+")*)\)', steps[0] or "") if steps else None
    )
    expected |= {("table", "step", "step", sql) for sql in steps[:1]}
    if columns is None or found != expected or len(schema) != len(expected):
        raise unreadable(path, "its tables are not those of a result")


def _convert(db: sqlite3.Connection, writer: Writer, version: int, size: int) -> None:
    meta = {key: json.loads(value) for key, value in db.execute("SELECT key, value FROM meta")}
    quantities: dict[int, Quantity] = {}
    for number, name, unit, frame, shape in db.execute("SELECT * FROM quantity ORDER BY id"):
        dimensions = tuple(int(n) for n in json.loads(shape))
        if (
            not all(isinstance(text, str) for text in (name, unit, frame))
            or min(dimensions, default=0) < 0
        ):
            raise ValueError("a quantity")
        quantities[number] = Quantity(name, unit, frame, dimensions)
    writer.describe(quantities.values())
    read = 0
    for chunk, rows in db.execute("SELECT id, count FROM chunk ORDER BY id"):
        if not isinstance(rows, int) or not 0 < rows <= size:
            raise ValueError("a count of rows")
        arrays = {}
        for number, quantity in quantities.items():
            (blob,) = db.execute(
                "SELECT blob FROM data WHERE quantity = ? AND chunk = ?", (number, chunk)
            ).fetchone()
            read += len(blob)
            if read > size or len(blob) != 8 * rows * math.prod(quantity.shape):
                raise ValueError(f"`{quantity.name}` is incomplete")
            arrays[quantity.name] = np.frombuffer(blob, "<f8").reshape(rows, *quantity.shape)
        state = {name: arrays.pop(name) for name in STATE if name in arrays}
        writer.append({**state, "channels": arrays})
    if version > 1:
        for dense in _dense(db, size):
            writer.append({"time": np.zeros(0), "dense": dense})
    events = [json.loads(data) for (data,) in db.execute("SELECT data FROM event ORDER BY id")]
    writer.append({"time": np.zeros(0), "steps": _steps(db), "events": json.dumps(events)})
    writer.finish(meta)


def _dense(db: sqlite3.Connection, size: int) -> Iterator[dict[str, Any]]:
    """Yield the charts, then the steps, as the core delivers them."""
    charts = [
        (float(t), str(text), np.frombuffer(numbers, "<f8"))
        for t, text, numbers in db.execute("SELECT t, text, numbers FROM chart ORDER BY id")
    ]
    empty: dict[str, Any] = {"charts": charts, "charts_before": 0, "t": ()}
    if sum(numbers.nbytes for *_, numbers in charts) > size:
        raise ValueError("the charts")
    yield empty
    read = 0
    blobs = ", ".join(f'"{name}"' for name in DENSE)
    rows = db.execute(f'SELECT "end", dimension, {blobs} FROM dense ORDER BY id')  # noqa: S608
    for end, dimension, *values in rows:
        steps = dict(zip(DENSE, (np.frombuffer(v, "<f8") for v in values), strict=True))
        read += sum(len(value) for value in values)
        if read > size:
            raise ValueError("the steps")
        yield {
            **steps,
            "charts": [],
            "charts_before": len(charts),
            "end": float(end),
            "dimension": int(dimension),
        }


def _steps(db: sqlite3.Connection) -> dict[str, Any]:
    cursor = db.execute("SELECT * FROM step ORDER BY id")
    names = [column[0] for column in cursor.description]
    columns = list(zip(*cursor, strict=True))
    if not columns:
        return {}
    log: dict[str, Any] = {}
    for name, values in zip(names, columns, strict=True):
        if name == "cause":
            log[name] = [str(value or "") for value in values]
        elif name != "id":
            log[name] = np.array(values, dtype=np.float64)  # null becomes NaN
    return log
