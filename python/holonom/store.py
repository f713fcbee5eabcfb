"""The result store: one SQLite file that NumPy and `sqlite3` read without Holonom.

======== ===============================================================================
table    rows
======== ===============================================================================
meta     key, value: JSON; ``model``, ``model_hash``, ``options``, ``status``, …
quantity id, name, unit, frame, shape (JSON): ``time``, ``q``, ``qd``, … and the channels
chunk    id, first, count: which output times stand in a chunk
data     chunk, quantity, blob: little-endian f64, ``count`` × ``shape``, row by row
step     one row per attempted step: ``t``, ``h``, ``error``, ``accepted``, ``cause``, …
event    time, kind, data (JSON)
dense    accepted steps in chunks, with what the states inside them are made of; see below
chart    id, t, text (JSON), numbers: the independent variables of those steps
======== ===============================================================================

A row of ``dense`` holds ``count`` steps from ``start`` to ``end`` (s). Its blobs are little-endian
f64: ``t`` and ``h``, start and length of each step (s); the number of its ``chart``; the ``degree``
of its polynomials; ``q`` and ``winding`` at its start; the energy ``ledger`` there, and ``powers``
at start, middle and end (W; empty where w has their integrals); ``normals`` that directions in
space are measured from; and in ``w`` the coefficients c₀, c₁, … of w(θ) = Σ cⱼ θʲ, each of
``dimension`` numbers, θ = (time - t)/h: independent variables, their rates, extra states, for
explicit codes also the energy dissipated and supplied. All coordinates follow from w, the joints
and the chart, as `Result.state` computes them. The ``numbers`` of a chart are the coordinates at
its time t, then the rows of a tangent plane, or references and anchors of relative coordinates. A
file of format 1 has neither table.

While a run writes, the file is in WAL mode and every chunk is one commit, so that a killed run is
readable up to its last chunk. A finished file stands alone, without companions.
"""

from __future__ import annotations

import json
import math
import os
import re
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from holonom.errors import FileError

APPLICATION_ID = 0x486F6C6F  # "Holo"
FORMAT = 2
#: Formats that can be read.
READABLE = (1, 2)

#: The state at an output time: coordinates with rates, multipliers, extra states, windings and
#: the energy ledger.
STATE = ("time", "q", "qd", "qdd", "lambda", "z", "winding", "ledger")

#: Blobs of a row of the table `dense`.
DENSE = ("t", "h", "chart", "degree", "q", "winding", "normals", "ledger", "powers", "w")

#: Columns of the step log that every run has: start time and size of the attempted step (s), its
#: error (1 is on tolerance), whether it was accepted, why not, and its Newton iterations.
STEP_COLUMNS = ("t", "h", "error", "accepted", "cause", "iterations")

_SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {FORMAT};
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE quantity (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE,
    unit TEXT NOT NULL, frame TEXT NOT NULL, shape TEXT NOT NULL);
CREATE TABLE chunk (id INTEGER PRIMARY KEY, first INTEGER NOT NULL, count INTEGER NOT NULL);
CREATE TABLE data (
    chunk INTEGER NOT NULL REFERENCES chunk, quantity INTEGER NOT NULL REFERENCES quantity,
    blob BLOB NOT NULL, UNIQUE (quantity, chunk));
CREATE TABLE step (
    id INTEGER PRIMARY KEY, t REAL NOT NULL, h REAL NOT NULL, error REAL,
    accepted INTEGER NOT NULL, cause TEXT, iterations INTEGER);
CREATE TABLE event (id INTEGER PRIMARY KEY, time REAL, kind TEXT, data TEXT NOT NULL);
CREATE TABLE dense (
    id INTEGER PRIMARY KEY, count INTEGER NOT NULL, "start" REAL NOT NULL, "end" REAL NOT NULL,
    dimension INTEGER NOT NULL, {", ".join(f"{name} BLOB NOT NULL" for name in DENSE)});
CREATE TABLE chart (
    id INTEGER PRIMARY KEY, t REAL NOT NULL, text TEXT NOT NULL, numbers BLOB NOT NULL);
"""


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


class Writer:
    """Writes one run, chunk by chunk.

    Parameters
    ----------
    path : Path or None
        The file; an older result there is replaced. None keeps the store in memory.
    meta : mapping
        First entries of the table ``meta``: plain data.
    channels : mapping of str to Quantity
        Units and frames by name.

    Raises
    ------
    FileError
        If the file cannot be written, or is there and is not a result.
    """

    def __init__(
        self, path: Path | None, meta: Mapping[str, Any], channels: Mapping[str, Quantity]
    ) -> None:
        self._path = path
        self._channels = channels
        self._ids: dict[str, int] = {}
        self._sizes: dict[str, int] = {}
        self._step_columns = set(STEP_COLUMNS)
        self._chunks = 0
        self._rows = 0
        with _as_file_errors(path):
            self._db = sqlite3.connect(":memory:", check_same_thread=False)
            if path is None:
                self._db.executescript(_SCHEMA)
                self._put_meta(meta)
                self._db.commit()
            else:
                self._db.close()
                self._db = _create(path, lambda db: _put_meta(db, meta))

    def append(self, chunk: Mapping[str, Any]) -> None:
        """Store and commit one chunk as the core delivers it: all of it or nothing."""
        count = len(chunk["time"])
        events = chunk.get("events") or "[]"
        with _as_file_errors(self._path):
            self._db.execute("BEGIN")
            try:
                ids, sizes = self._ids, self._sizes
                if count:
                    ids, sizes = self._append_outputs(chunk, count)
                columns = self._append_steps(chunk.get("steps") or {})
                if "dense" in chunk:
                    self._append_dense(chunk["dense"])
                self._db.executemany(
                    "INSERT INTO event (time, kind, data) VALUES (?, ?, ?)",
                    [(e.get("time"), e.get("kind"), json.dumps(e)) for e in json.loads(events)],
                )
                self._db.commit()
            except BaseException:  # Ctrl-C too: the caller may append the same chunk again
                self._db.rollback()
                raise
        self._ids, self._sizes, self._step_columns = ids, sizes, columns
        self._chunks += bool(count)
        self._rows += count

    def finish(self, meta: Mapping[str, Any]) -> None:
        """Store the last entries of ``meta`` and leave one file without companions."""
        with _as_file_errors(self._path):
            self._put_meta(meta)
            self._db.commit()
            if self._path is not None:
                _leave_wal(self._db)

    def close(self) -> None:
        """Let go of the file. Without `finish` it says that the run did not end."""
        self._db.close()

    def into_reader(self) -> Reader:
        """Return a reader of what was written; it takes over the connection."""
        return Reader(self._db, self._path)

    def _put_meta(self, meta: Mapping[str, Any]) -> None:
        _put_meta(self._db, meta)

    def _append_outputs(
        self, chunk: Mapping[str, Any], count: int
    ) -> tuple[dict[str, int], dict[str, int]]:
        arrays = {name: chunk[name] for name in STATE if name in chunk}
        arrays |= chunk.get("channels", {})
        ids, sizes = self._ids, self._sizes
        if not ids:
            ids, sizes = self._add_quantities(arrays)
        if arrays.keys() != ids.keys():
            raise FileError(f"a chunk holds other quantities than the first: {sorted(arrays)}")
        number = self._chunks + 1
        self._db.execute(
            "INSERT INTO chunk (id, first, count) VALUES (?, ?, ?)", (number, self._rows, count)
        )
        for name, array in arrays.items():
            values = np.ascontiguousarray(array, dtype="<f8")
            if values.size != count * sizes[name]:
                raise FileError(f"`{name}` has {values.size} numbers for {count} output times")
            self._db.execute(
                "INSERT INTO data (chunk, quantity, blob) VALUES (?, ?, ?)",
                (number, ids[name], values.tobytes()),
            )
        return ids, sizes

    def _add_quantities(
        self, arrays: Mapping[str, NDArray[np.float64]]
    ) -> tuple[dict[str, int], dict[str, int]]:
        ids, sizes = {}, {}
        for number, (name, array) in enumerate(arrays.items(), start=1):
            shape = tuple(int(n) for n in np.shape(array)[1:])
            unit = "s" if name == "time" else "mixed"
            known = self._channels.get(name, Quantity(name, unit, "", shape))
            self._db.execute(
                "INSERT INTO quantity (id, name, unit, frame, shape) VALUES (?, ?, ?, ?, ?)",
                (number, name, known.unit, known.frame, json.dumps(shape)),
            )
            ids[name] = number
            sizes[name] = math.prod(shape)
        return ids, sizes

    def _append_steps(self, steps: Mapping[str, Any]) -> set[str]:
        if not steps:
            return self._step_columns
        for column in steps.keys() - self._step_columns:
            if not re.fullmatch("[a-z_]+", column):
                raise FileError(f"`{column}` cannot be the name of a step column")
            self._db.execute(f'ALTER TABLE step ADD COLUMN "{column}"')
        columns = ", ".join(f'"{column}"' for column in steps)
        marks = ", ".join("?" * len(steps))
        rows = zip(*(np.asarray(values).tolist() for values in steps.values()), strict=True)
        self._db.executemany(f"INSERT INTO step ({columns}) VALUES ({marks})", rows)  # noqa: S608
        return self._step_columns | steps.keys()

    def _append_dense(self, dense: Mapping[str, Any]) -> None:
        first = dense["charts_before"]
        self._db.executemany(
            "INSERT INTO chart (id, t, text, numbers) VALUES (?, ?, ?, ?)",
            [
                (first + k, t, text, _bytes(numbers))
                for k, (t, text, numbers) in enumerate(dense["charts"])
            ],
        )
        count = len(dense["t"])
        if count:
            facts = {
                "count": count,
                "start": float(dense["t"][0]),
                "end": dense["end"],
                "dimension": dense["dimension"],
            }
            facts |= {name: _bytes(dense[name]) for name in DENSE}
            columns = ", ".join(f'"{name}"' for name in facts)
            marks = ", ".join("?" * len(facts))
            self._db.execute(
                f"INSERT INTO dense ({columns}) VALUES ({marks})",  # noqa: S608
                tuple(facts.values()),
            )


class Reader:
    """Reads a store up to the last chunk that was there when it was opened.

    Attributes
    ----------
    path : Path or None
    meta : dict
        Entries of the table ``meta``, decoded.
    quantities : dict of str to Quantity
        What is stored, in the order of storing.
    count : int
        Number of output times.
    """

    def __init__(self, db: sqlite3.Connection, path: Path | None) -> None:
        self.path = path
        self._db = db
        with _as_file_errors(path):
            self.meta = {k: json.loads(v) for k, v in db.execute("SELECT key, value FROM meta")}
            self._last, self.count = db.execute(
                "SELECT coalesce(max(id), 0), coalesce(sum(count), 0) FROM chunk"
            ).fetchone()
            (version,) = db.execute("PRAGMA user_version").fetchone()
            found = []
            if version > 1:
                found = db.execute('SELECT id, "start", "end" FROM dense ORDER BY id').fetchall()
            self._dense = np.array(found, dtype=np.float64).reshape(-1, 3)
            rows = db.execute("SELECT id, name, unit, frame, shape FROM quantity ORDER BY id")
            self._ids: dict[str, int] = {}
            self.quantities: dict[str, Quantity] = {}
            for number, name, unit, frame, shape in rows:
                self._ids[name] = number
                self.quantities[name] = Quantity(name, unit, frame, tuple(json.loads(shape)))

    @classmethod
    def open(cls, path: Path) -> Reader:
        """Open a file; what a killed run left in its ``-wal`` companion is recovered.

        Raises
        ------
        FileError
            If the file cannot be read or is not a result.
        """
        if not path.exists():
            raise FileError(f"{path}: there is no such file")
        if path.is_dir():
            raise FileError(f"{path} is a folder; a result is one file")
        writable = os.access(path, os.W_OK) and os.access(path.resolve().parent, os.W_OK)
        with _as_file_errors(path):
            db = _connect(path, "rw" if writable else "ro")
            try:
                _require_result(db, path)
                reader = cls(db, path)
                (journal,) = db.execute("PRAGMA journal_mode").fetchone()
                running = reader.meta.get("status") == "running" and journal == "wal"
                if running and writable and _leave_wal(db):
                    # Nobody else has the file open: the run is dead and the file now stands alone.
                    reader.meta["status"] = "killed"
                    _put_meta(db, {"status": "killed"})
                    db.commit()
            except BaseException:
                db.close()
                raise
        return reader

    def close(self) -> None:
        """Let go of the file."""
        self._db.close()

    def __del__(self) -> None:
        self._db.close()

    def read(self, name: str) -> NDArray[np.float64]:
        r"""Return a stored quantity.

        Returns
        -------
        ndarray, shape (n_times, \*shape)
        """
        quantity = self.quantities[name]
        with _as_file_errors(self.path):
            rows = self._db.execute(
                "SELECT blob FROM data WHERE quantity = ? AND chunk <= ? ORDER BY chunk",
                (self._ids[name], self._last),
            )
            joined = b"".join(blob for (blob,) in rows)
        if len(joined) != 8 * self.count * quantity.size:
            raise FileError(f"{self.path}: `{name}` is incomplete; the file is damaged")
        values = np.frombuffer(joined, dtype="<f8").astype(np.float64, copy=False)
        return values.reshape(self.count, *quantity.shape)

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
        with _as_file_errors(self.path):
            found = self._db.execute(
                "SELECT chunk.first, chunk.count, blob "
                "FROM data JOIN chunk ON chunk.id = data.chunk "
                "WHERE quantity = ? AND chunk.id <= ? AND chunk.first < ? "
                "AND chunk.first + chunk.count > ? ORDER BY chunk.id",
                (self._ids[name], self._last, first + count, first),
            ).fetchall()
        values = np.frombuffer(b"".join(blob for *_, blob in found), dtype="<f8")
        there = sum(rows for _, rows, _ in found)
        values = values.astype(np.float64, copy=False).reshape(there, *quantity.shape)
        skipped = first - found[0][0] if found else 0
        return values[skipped : skipped + count]

    def row(self, index: int) -> dict[str, NDArray[np.float64]]:
        """Return the state at one output time, each part as a vector."""
        with _as_file_errors(self.path):
            chunk, first = self._db.execute(
                "SELECT id, first FROM chunk WHERE first <= ? ORDER BY first DESC LIMIT 1", (index,)
            ).fetchone()
            state = {}
            for name in STATE:
                if name not in self._ids:
                    continue
                (blob,) = self._db.execute(
                    "SELECT blob FROM data WHERE chunk = ? AND quantity = ?",
                    (chunk, self._ids[name]),
                ).fetchone()
                size = self.quantities[name].size
                part = np.frombuffer(
                    blob, dtype="<f8", count=size, offset=8 * size * (index - first)
                )
                state[name] = part.astype(np.float64)
        return state

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
        for place in np.unique(places):
            yield np.nonzero(places == place)[0], self._dense_steps(int(self._dense[place, 0]))

    def _dense_steps(self, number: int) -> dict[str, Any]:
        columns = ", ".join(f'"{name}"' for name in ("end", "dimension", *DENSE))
        with _as_file_errors(self.path):
            end, dimension, *blobs = self._db.execute(
                f"SELECT {columns} FROM dense WHERE id = ?",  # noqa: S608
                (number,),
            ).fetchone()
            steps: dict[str, Any] = {
                name: _numbers(blob) for name, blob in zip(DENSE, blobs, strict=True)
            }
            first, last = int(steps["chart"].min()), int(steps["chart"].max())
            charts = self._db.execute(
                "SELECT t, text, numbers FROM chart WHERE id BETWEEN ? AND ? ORDER BY id",
                (first, last),
            ).fetchall()
        steps["charts"] = [(t, text, _numbers(numbers)) for t, text, numbers in charts]
        return steps | {"charts_before": first, "end": end, "dimension": dimension}

    def steps(self) -> dict[str, NDArray[Any]]:
        """Return the step log by column; texts are an object array."""
        with _as_file_errors(self.path):
            cursor = self._db.execute("SELECT * FROM step ORDER BY id")
            names = [column[0] for column in cursor.description]
            columns = list(zip(*cursor, strict=True)) or [()] * len(names)
        log: dict[str, NDArray[Any]] = {}
        for name, column in zip(names, columns, strict=True):
            if name == "id":
                continue
            if any(isinstance(value, str) for value in column) or name == "cause":
                log[name] = np.array(column, dtype=object)
            else:
                log[name] = np.array(column, dtype=np.float64)  # NULL becomes NaN
        return log

    def step_totals(self) -> list[tuple[bool, str, int, float, float, float]]:
        """Return accepted or not, cause, count and smallest, largest and mean size (s) of attempts.

        Much faster than reading the log of a long run.
        """
        with _as_file_errors(self.path):
            rows = self._db.execute(
                "SELECT accepted > 0, coalesce(cause, ''), count(*), min(h), max(h), avg(h) "
                "FROM step GROUP BY 1, 2 ORDER BY 1 DESC, 3 DESC, 2"
            ).fetchall()
        return [(bool(accepted), *rest) for accepted, *rest in rows]

    def events(self) -> list[dict[str, Any]]:
        """Return the events in the order in which they happened."""
        with _as_file_errors(self.path):
            return [json.loads(data) for (data,) in self._db.execute("SELECT data FROM event")]

    def amend(self, meta: Mapping[str, Any]) -> None:
        """Store more entries of ``meta``, what is learnt about a run after its end."""
        with _as_file_errors(self.path):
            _put_meta(self._db, meta)
            self._db.commit()
        self.meta |= json.loads(json.dumps(meta))

    def save(self, path: Path) -> None:
        """Write a copy as one file, in one move."""
        require_replaceable(path)
        with (
            _as_file_errors(path),
            _new_file(path) as fresh,
            closing(sqlite3.connect(fresh)) as copy,
        ):
            self._db.backup(copy)
            _leave_wal(copy)


def require_replaceable(path: Path) -> None:
    """Refuse a target that is a folder, or a file that is not a result.

    Raises
    ------
    FileError
        If writing a result there would destroy something else.
    """
    if path.is_dir():
        raise FileError(f"{path} is a folder; give the name of the result file")
    if path.exists() and path.stat().st_size > 0:
        with _as_file_errors(path), closing(_connect(path, "ro")) as db:
            try:
                _require_result(db, path)
            except FileError as error:
                raise FileError(f"{error}; it is not overwritten") from None


def _create(path: Path, fill: Any) -> sqlite3.Connection:
    """Put a new store in place in one move, then open it for writing in WAL mode."""
    require_replaceable(path)
    with _new_file(path) as fresh, closing(sqlite3.connect(fresh)) as db:
        db.executescript(_SCHEMA)
        fill(db)
        db.commit()
    db = sqlite3.connect(path, check_same_thread=False)
    try:
        # NORMAL: a commit survives the death of the process; only a power cut may lose the last.
        db.execute("PRAGMA synchronous = NORMAL")
        db.execute("PRAGMA journal_mode = WAL").fetchone()
        _put_meta(db, {"status": "running"})  # the first write shows whether WAL works here
        db.commit()
    except sqlite3.OperationalError:  # WAL needs shared memory, which network folders lack
        db.rollback()
        db.execute("PRAGMA journal_mode = DELETE").fetchone()
    return db


@contextmanager
def _new_file(path: Path) -> Iterator[Path]:
    """Yield a temporary neighbour of `path` that takes its place at the end."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name}.{os.getpid()}.new")
    fresh.unlink(missing_ok=True)
    try:
        yield fresh
        for companion in ("-wal", "-shm", "-journal"):  # of an older, killed run
            path.with_name(path.name + companion).unlink(missing_ok=True)
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    uri = f"file:{quote(str(path.resolve()))}?mode={mode}"
    return sqlite3.connect(uri, uri=True, check_same_thread=False)


def _require_result(db: sqlite3.Connection, path: Path) -> None:
    try:
        (application,) = db.execute("PRAGMA application_id").fetchone()
        (version,) = db.execute("PRAGMA user_version").fetchone()
    except sqlite3.DatabaseError:
        raise FileError(f"{path} is not a Holonom result") from None
    if application != APPLICATION_ID:
        raise FileError(f"{path} is not a Holonom result")
    if version not in READABLE:
        known = " and ".join(map(str, READABLE))
        raise FileError(
            f"{path} has result format {version}; this version of Holonom reads formats {known}"
        )


def _bytes(values: NDArray[np.float64]) -> bytes:
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def _numbers(blob: bytes) -> NDArray[np.float64]:
    return np.frombuffer(blob, dtype="<f8").astype(np.float64)


def _put_meta(db: sqlite3.Connection, meta: Mapping[str, Any]) -> None:
    db.executemany(
        "INSERT OR REPLACE INTO meta (key, value) VALUES (?, ?)",
        [(key, json.dumps(value, ensure_ascii=False)) for key, value in meta.items()],
    )


def _leave_wal(db: sqlite3.Connection) -> bool:
    """Fold the ``-wal`` companion into the file; False while others have the file open."""
    try:
        db.execute("PRAGMA busy_timeout = 0")
        (mode,) = db.execute("PRAGMA journal_mode = DELETE").fetchone()
    except sqlite3.OperationalError:
        return False
    return bool(mode == "delete")


@contextmanager
def _as_file_errors(path: Path | None) -> Iterator[None]:
    """Name the file in what SQLite and the system say."""
    try:
        yield
    except FileError:
        raise
    except (sqlite3.Error, OSError) as error:
        said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise FileError(f"{path or 'the result'}: {said}") from error
