"""Results of formats 1 and 2, made of ones of the present format."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np

from holonom.store import legacy
from holonom.store.layout import APPLICATION_ID, DENSE


def write_older(stored: Path, path: Path, version: int) -> None:
    """Write what a file of format 3 holds as an older version of Holonom wrote it."""
    with closing(sqlite3.connect(stored)) as new, closing(sqlite3.connect(path)) as old:
        old.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        old.execute(f"PRAGMA user_version = {version}")
        tables = legacy._TABLES | (legacy._DENSE_TABLES if version > 1 else {})
        for statement in (*tables.values(), legacy._STEP + ")"):
            old.execute(statement)
        skipped = ("keys", "chunks")
        meta = [r for r in new.execute("SELECT key, value FROM meta") if r[0] not in skipped]
        old.executemany("INSERT INTO meta VALUES (?, ?)", meta)
        columns = "id, name, unit, frame, shape"
        rows = new.execute(f"SELECT {columns} FROM quantity")
        old.executemany("INSERT INTO quantity VALUES (?, ?, ?, ?, ?)", rows)
        rows = new.execute("SELECT id, first, count FROM chunk WHERE count > 0")
        old.executemany("INSERT INTO chunk VALUES (?, ?, ?)", rows)
        rows = new.execute("SELECT chunk, quantity, blob FROM data")
        old.executemany("INSERT INTO data VALUES (?, ?, ?)", rows)
        rows = new.execute("SELECT id, time, kind, data FROM event")
        old.executemany("INSERT INTO event VALUES (?, ?, ?, ?)", rows)
        known = {"t", "h", "error", "accepted", "cause", "iterations"}
        for names_json, causes_json, count, blob in new.execute(
            "SELECT columns, causes, count, blob FROM step ORDER BY chunk"
        ):
            names, causes = json.loads(names_json), json.loads(causes_json)
            table = dict(zip(names, np.frombuffer(blob).reshape(-1, count).tolist(), strict=True))
            table["cause"] = [causes[int(index)] for index in table["cause"]]
            for name in names:
                if name not in known:
                    old.execute(f'ALTER TABLE step ADD COLUMN "{name}"')
                    known.add(name)
            listed = ", ".join(f'"{name}"' for name in names)
            marks = ", ".join("?" * len(names))
            lines = zip(*(table[name] for name in names), strict=True)
            old.executemany(f"INSERT INTO step ({listed}) VALUES ({marks})", lines)
        if version > 1:
            blobs = ", ".join(f'"{name}"' for name in DENSE)
            rows = new.execute(
                f'SELECT chunk, count, "start", "end", dimension, {blobs} FROM dense ORDER BY chunk'
            )
            old.executemany(f"INSERT INTO dense VALUES ({', '.join('?' * 15)})", rows)
            rows = new.execute("SELECT id, t, text, numbers FROM chart")
            old.executemany("INSERT INTO chart VALUES (?, ?, ?, ?)", rows)
        old.commit()
