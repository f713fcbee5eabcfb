"""What must hold before anything of a result file is believed: its header, its schema, its rows."""

from __future__ import annotations

import os
import sqlite3
import stat
from pathlib import Path
from typing import Any

from holonom.base import files
from holonom.base.errors import FileError
from holonom.store.layout import FORMAT, SCHEMA, TABLES, row_checksum

_SELECT = {
    table: 'SELECT {}, "checksum" FROM {} WHERE "{}" = ?'.format(  # noqa: S608
        ", ".join(f'"{name}"' for name in columns), table, next(iter(columns))
    )
    for table, columns in TABLES.items()
}
_TYPES = {"INTEGER": int, "REAL": float, "TEXT": str, "BLOB": bytes}

#: What may go wrong in SQLite and in the decoding of a row that is damaged.
BROKEN = (sqlite3.Error, ValueError, OverflowError, RecursionError, MemoryError)


class DamagedRow(Exception):  # noqa: N818 - `Reader` makes an error of it
    """A row that is missing, or is not what was written."""


def require(holds: bool) -> None:
    """Raise `DamagedRow` unless something holds."""
    if not holds:
        raise DamagedRow


def verified_row(db: sqlite3.Connection, table: str, key: int | str) -> dict[str, Any]:
    """Return a row by its key, with its types and checksum verified.

    Raises
    ------
    DamagedRow
    """
    try:
        found = db.execute(_SELECT[table], (key,)).fetchone()
    except BROKEN:
        raise DamagedRow from None
    require(found is not None and found[0] == key)
    *values, checksum = found
    for value, kind in zip(values, TABLES[table].values(), strict=True):
        allowed = value is None and kind.endswith("?")
        require(allowed or type(value) is _TYPES[kind.rstrip("?")])
    require(checksum == row_checksum(table, values))
    return dict(zip(TABLES[table], values, strict=True))


def unreadable(path: Path, why: str) -> FileError:
    """Return the error about a result of which nothing can be read, not even with `recover`."""
    return FileError(
        f"{path} is damaged: {why}; nothing of it can be read",
        "take a copy of it, or run the model again",
        code="result/damaged",
    )


def damaged(path: Path | None, part: str, *, recover: bool = False) -> FileError:
    """Return the error about a part of a result that is not what was written.

    What `recover` would read is advised unless it was asked for.
    """
    rest = "" if recover else "`--recover`, or `Result.load(path, recover=True)`, reads the rest; "
    return FileError(
        f"{path or 'the result'} is damaged: {part}",
        f"{rest}a copy or a new run has all",
        code="result/damaged",
    )


def require_result(path: Path) -> tuple[Path, int]:
    """Return the file of a result, with links resolved, and its format; nothing else is opened.

    Raises
    ------
    FileError
        If it is no regular file, not a result, or one of a newer format.
    """
    try:
        real = path.resolve()
        mode = real.stat().st_mode
        _require_regular(path, mode)
        with real.open("rb") as file:
            head = file.read(100)
    except FileNotFoundError:
        raise files.absent(path, "`holonom run` writes one") from None
    except FileError:
        raise
    except (OSError, ValueError, RuntimeError) as error:
        raise files.unusable(path, error) from None
    if not files.is_result(head):
        named_so = path.suffix.lower() in (".toml", ".json")
        tip = (
            f"`holonom run {path}` makes one of a model" if named_so else "`holonom run` writes one"
        )
        raise FileError(f"{path} is not a Holonom result", tip)
    version = int.from_bytes(head[60:64], "big")
    if not 1 <= version <= FORMAT:
        raise FileError(
            f"{path} has result format {version}; this version of Holonom reads formats 1 to "
            f"{FORMAT}\n  help: read it with a newer version"
        )
    return real, version


def checked_schema(
    db: sqlite3.Connection, path: Path, size: int
) -> list[tuple[str, str, str, str | None]]:
    """Return all there is in a database of at most `size` bytes, and make it harmless to read.

    Raises
    ------
    FileError
        ``result/damaged``.
    """
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, int(min(size + 1000, 1_000_000_000)))
    # A table that is nobody's work may be endless; reading ours takes a known number of steps.
    patience = iter(range(100 + size // 100))
    db.set_progress_handler(lambda: next(patience, None) is None, 1000)
    try:
        for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "mmap_size = 0"):
            db.execute(f"PRAGMA {pragma}")
        found = db.execute("SELECT type, name, tbl_name, sql FROM sqlite_master LIMIT 100")
        return found.fetchall()
    except BROKEN:
        raise unreadable(path, "its tables cannot be read") from None


def require_schema(schema: list[tuple[str, str, str, str | None]], path: Path) -> None:
    """Compare the schema with the one that is written, to the letter.

    Raises
    ------
    FileError
        ``result/damaged``.
    """
    expected = [("table", name, name, sql) for name, sql in SCHEMA.items()]
    if sorted(schema, key=str) != sorted(expected, key=str):
        raise unreadable(path, "its tables are not those of a result")


def may_write(real: Path) -> bool:
    """Return whether a file and its folder may be written."""
    return os.access(real, os.W_OK) and os.access(real.parent, os.W_OK)


def size_of(real: Path) -> int:
    """Return the bytes of a file with its ``-wal`` companion: no more can be stored in it."""
    total = 0
    for name in (real, real.with_name(real.name + "-wal")):
        try:
            total += name.stat().st_size
        except OSError:
            continue
    return total


def _require_regular(path: Path, mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise FileError(f"{path} is a folder; a result is one file\n  help: name the file")
    if not stat.S_ISREG(mode):
        raise FileError(f"{path} is not a regular file\n  help: a result is one")
