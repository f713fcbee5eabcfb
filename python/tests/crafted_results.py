"""A catalogue of results made to harm: what is changed in a file, with checksums that are right.

Whoever makes such a file can compute checksums, too; so these test the checks behind them.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from holonom.store.layout import FORMAT, SCHEMA, TABLES, insert, row_checksum

Change = Callable[[sqlite3.Connection], object]
HUGE = 2**62


def reseal(table: str, key: Any, **changes: Any) -> Change:
    """Change columns of a row and give it the checksum that belongs to them."""

    def change(db: sqlite3.Connection) -> None:
        columns = list(TABLES[table])
        listed = ", ".join(f'"{c}"' for c in columns)
        found = db.execute(f'SELECT {listed} FROM {table} WHERE "{columns[0]}" = ?', (key,))
        row = dict(zip(columns, found.fetchone(), strict=True))
        for name, value in changes.items():
            row[name] = value(row[name]) if callable(value) else value
        db.execute(f'DELETE FROM {table} WHERE "{columns[0]}" = ?', (key,))
        marks = ", ".join("?" * (len(columns) + 1))
        values = list(row.values())
        db.execute(f"INSERT INTO {table} VALUES ({marks})", (*values, row_checksum(table, values)))

    return change


def meta(key: str, value: Any) -> Change:
    """Give an entry of the description another value; a text is taken as it is."""
    text = value if isinstance(value, str) else json.dumps(value)

    def change(db: sqlite3.Connection) -> None:
        if key != "keys":  # an entry that is not listed there is never read
            (listed,) = db.execute("SELECT value FROM meta WHERE key = 'keys'").fetchone()
            keys = json.dumps(sorted({*json.loads(listed), key}))
            insert(db, "meta", ("keys", keys), "INSERT OR REPLACE")
        insert(db, "meta", (key, text), "INSERT OR REPLACE")

    return change


def sql(*statements: str) -> Change:
    """Run statements."""

    def change(db: sqlite3.Connection) -> None:
        for statement in statements:
            db.execute(statement)

    return change


def schema(name: str, text: str) -> Change:
    """Write another statement into the table of tables."""
    return sql(
        "PRAGMA writable_schema = ON",
        f"UPDATE sqlite_master SET sql = '{text}' WHERE name = '{name}'",
        "PRAGMA writable_schema = OFF",
    )


def root(name: str, page: str) -> Change:
    """Let a table begin on another page."""
    return sql(
        "PRAGMA writable_schema = ON",
        f"UPDATE sqlite_master SET rootpage = ({page}) WHERE name = '{name}'",
    )


def both(*changes: Change) -> Change:
    """Make several changes."""

    def change(db: sqlite3.Connection) -> None:
        for one in changes:
            one(db)

    return change


def _numbers(*values: float) -> bytes:
    return np.array(values, dtype="<f8").tobytes()


def _filled(value: float) -> Callable[[bytes], bytes]:
    return lambda blob: np.full(len(blob) // 8, value).tobytes()


def _chart(**changes: Any) -> Change:
    return reseal("chart", 0, text=lambda text: json.dumps(json.loads(text) | changes))


def _master(table: str) -> str:
    return f"SELECT rootpage FROM sqlite_master WHERE name = '{table}'"


_DEEP = "[" * 100_000 + "]" * 100_000
_ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"

#: Refused at once, by whatever opens the file.
AT_ONCE: dict[str, Change] = {
    "no table meta": sql("DROP TABLE meta"),
    "no table quantity": sql("DROP TABLE quantity"),
    "no table chunk": sql("DROP TABLE chunk"),
    "no table data": sql("DROP TABLE data"),
    "no table step": sql("DROP TABLE step"),
    "no table event": sql("DROP TABLE event"),
    "no table dense": sql("DROP TABLE dense"),
    "no table chart": sql("DROP TABLE chart"),
    "one table more": sql("CREATE TABLE more (x)"),
    "a view more": sql("CREATE VIEW more AS SELECT 1"),
    "an index more": sql("CREATE INDEX more ON chunk (first)"),
    "a trigger": sql("CREATE TRIGGER more AFTER INSERT ON meta BEGIN SELECT 1; END"),
    "a virtual table": sql("CREATE VIRTUAL TABLE more USING fts5 (x)"),
    "meta is a view": sql(
        "DROP TABLE meta", "CREATE VIEW meta AS SELECT 'a' AS key, '1' AS value, 0 AS checksum"
    ),
    "chunk is an endless view": sql(
        "DROP TABLE chunk",
        f"CREATE VIEW chunk AS {_ENDLESS} SELECT i AS id, 1 AS first, 1 AS count FROM n",
    ),
    "meta is an endless view": sql(
        "DROP TABLE meta",
        f"CREATE VIEW meta AS {_ENDLESS} SELECT i AS key, '1' AS value, 0 AS checksum FROM n",
    ),
    "data is a view of large blobs": sql(
        "DROP TABLE data",
        "CREATE VIEW data AS SELECT 1 AS id, 1 AS chunk, 1 AS quantity, "
        "zeroblob(900000000) AS blob, 0 AS checksum",
    ),
    "a generated column": sql(
        "DROP TABLE event",
        "CREATE TABLE event (id INTEGER PRIMARY KEY, time REAL, kind TEXT, "
        "data TEXT AS (zeroblob(900000000)), checksum INTEGER)",
    ),
    "a column more": sql("ALTER TABLE chunk ADD COLUMN more"),
    "a column with another name": sql('ALTER TABLE chunk RENAME COLUMN "count" TO counts'),
    "a table with other types": sql("DROP TABLE chart", SCHEMA["chart"].replace("REAL", "TEXT")),
    "a statement that cannot be read": schema("chunk", "CREATE TABLE chunk ("),
    "a statement of another kind": schema("chunk", "DROP TABLE chunk"),
    "a statement without end": schema("chunk", "CREATE TABLE chunk (" + "x, " * 5000 + "y)"),
    "two tables on one page": root("chunk", _master("data")),
    "a table on the first page": root("meta", "SELECT 1"),
    "a table on page zero": root("meta", "SELECT 0"),
    "a table beyond the file": root("quantity", "SELECT 100000"),
    "meta on the page of chunk": root("meta", _master("chunk")),
    "format 2, with the tables of format 3": sql("PRAGMA user_version = 2"),
    "format 1, with the tables of format 3": sql("PRAGMA user_version = 1"),
    "format 0": sql("PRAGMA user_version = 0"),
    "a format to come": sql(f"PRAGMA user_version = {FORMAT + 1}"),
    "a format of less than nothing": sql("PRAGMA user_version = -1"),
    "another application": sql("PRAGMA application_id = 7"),
    "no list of entries": sql("DELETE FROM meta WHERE key = 'keys'"),
    "an empty description": sql("DELETE FROM meta"),
    "the list of entries is a number": meta("keys", 5),
    "the list of entries holds numbers": meta("keys", [1, 2]),
    "an entry that is not there": meta("keys", ["status", "absent"]),
    "an entry that is no JSON": meta("title", "{"),
    "an entry 100,000 deep": meta("title", _DEEP),
    "statistics 100,000 deep": meta("statistics", '{"a":' * 50_000 + "1" + "}" * 50_000),
    "a model 900 deep": meta("model", '{"a":' * 900 + "1" + "}" * 900),
    "a number of 10,000 digits": meta("dof", "9" * 10_000),
    "a title that is a number": meta("title", 5),
    "a name that is a list": meta("name", []),
    "a model that is a list": meta("model", []),
    "a model that is nothing": meta("model", "null"),
    "options that are a text": meta("options", '"fast"'),
    "a tolerance that is a list": meta("options", {"tolerance": [1]}),
    "a tolerance with a part that is none": meta("options", {"tolerance": {"relative": None}}),
    "a part with options that are none": meta("parts", [{"until": 0.1, "options": [1]}]),
    "a part with a tolerance that is a text": meta(
        "parts", [{"until": 0.1, "options": {"tolerance": "loose"}}]
    ),
    "statistics that are a number": meta("statistics", 5),
    "statistics that hold texts": meta("statistics", {"steps": "many"}),
    "limits that are a list": meta("limited_by", [1]),
    "limits without numbers": meta("limited_by", {"coordinate": "pin.angle"}),
    "limits of rejected steps that are texts": meta(
        "limited_by", {"coordinate": None, "rejected": {"steps": "many", "of": 1}}
    ),
    "residuals that are a list": meta("residuals", [1.0]),
    "energy that is a text": meta("energy", '"all"'),
    "warnings that are a table": meta("warnings", {}),
    "warnings that are numbers": meta("warnings", [1]),
    "warnings without a code": meta("warnings", [{"message": "x"}]),
    "channels asked for that are numbers": meta("requested", [1]),
    "a status that nobody knows": meta("status", '"excellent"'),
    "a status that is a list": meta("status", []),
    "a reason that is a text": meta("stop_reason", '"why"'),
    "a reason with a list": meta("stop_reason", {"code": "a", "message": []}),
    "a certification without channels": meta("certification", {"tolerance": {}}),
    "a certification that is a number": meta("certification", 1),
    "a certification of texts": meta(
        "certification", {"tolerance": {"relative": "x"}, "channels": []}
    ),
    "processor time that is a text": meta("cpu_seconds", '"long"'),
    "fewer chunks than none": meta("chunks", -1),
    "one chunk more than there is": lambda db: meta(
        "chunks", db.execute("SELECT count(*) + 1 FROM chunk").fetchone()[0]
    )(db),
    "very many chunks": meta("chunks", HUGE // 1024),
    "no chunk where there are some": sql("DELETE FROM chunk"),
    "the first chunk is missing": sql("DELETE FROM chunk WHERE id = 1"),
    "a chunk with a text for a count": reseal("chunk", 1, count="many"),
    "a chunk with a negative count": reseal("chunk", 1, count=-5),
    "a chunk with a huge count": reseal("chunk", 1, count=HUGE),
    "a chunk with 10¹² rows": reseal("chunk", 1, count=10**12),
    "a chunk of one row more": reseal("chunk", 1, count=lambda n: n + 1),
    "a chunk that begins elsewhere": reseal("chunk", 1, first=7),
    "a chunk with a huge first row": reseal("chunk", 1, first=HUGE),
    "a chunk with data elsewhere": reseal("chunk", 1, data=3),
    "a chunk with data nowhere": reseal("chunk", 1, data=10**9),
    "a chunk with very many quantities": reseal("chunk", 1, quantities=10**15),
    "a chunk without quantities": reseal("chunk", 1, quantities=0),
    "steps from NaN": reseal("chunk", 1, start=float("inf")),
    "a quantity without a name": reseal("quantity", 1, name=""),
    "two quantities of one name": reseal("quantity", 2, name="time"),
    "a shape that is a text": reseal("quantity", 2, shape='"wide"'),
    "a shape of negative size": reseal("quantity", 2, shape="[-3]"),
    "a shape of huge size": reseal("quantity", 2, shape=f"[{HUGE}]"),
    "a shape of many dimensions": reseal("quantity", 2, shape=json.dumps([1] * 70)),
    "a shape with a fraction": reseal("quantity", 2, shape="[1.5]"),
    "a shape 100,000 deep": reseal("quantity", 2, shape=_DEEP),
    "times that are vectors": reseal("quantity", 1, shape="[1]"),
    "times that are missing": sql("DELETE FROM data WHERE id = 1"),
    "times that are cut": reseal("data", 1, blob=lambda blob: blob[:-8]),
    "times of no whole number of bytes": reseal("data", 1, blob=lambda blob: blob[:-3]),
    "times that are a text": reseal("data", 1, blob="0123456789"),
    "data of another chunk": reseal("data", 1, chunk=2),
    "data of another quantity": reseal("data", 1, quantity=2),
}

#: Refused where it is used; the rest of the file can be read.
WHERE_USED: dict[str, Change] = {
    "a shape of another size": reseal("quantity", 2, shape="[4]"),
    "coordinates that are cut": reseal("data", 2, blob=lambda blob: blob[:8]),
    "coordinates that are missing": sql("DELETE FROM data WHERE id = 2"),
    "coordinates that are a text": reseal("data", 2, blob="text"),
    "a model that is none": meta("model", {"holonom": 1}),
    "a model with a negative mass": lambda db: meta(
        "model",
        db.execute("SELECT value FROM meta WHERE key = 'model'")
        .fetchone()[0]
        .replace('"mass":2.0', '"mass":-2.0')
        .replace('"mass": 2.0', '"mass": -2.0'),
    )(db),
    "a step log that is missing": sql("DELETE FROM step"),
    "a step log of another length": reseal("step", 1, count=lambda n: n + 1),
    "a step log with a huge count": reseal("step", 1, count=HUGE),
    "a step log with negative count": reseal("step", 1, count=-1),
    "a step log without columns": reseal("step", 1, columns="[]"),
    "a step log of other columns": reseal("step", 1, columns='["a","b","c","d","e","f","g","h"]'),
    "a step log with columns of numbers": reseal("step", 1, columns="[1,2,3]"),
    "a step log with causes that are none": reseal("step", 1, causes="[]"),
    "a step log with causes 100,000 deep": reseal("step", 1, causes=_DEEP),
    "a step log of NaN": reseal("step", 1, blob=_filled(np.nan)),
    "steps that are missing": sql("DELETE FROM dense"),
    "steps of huge count": reseal("dense", 1, count=HUGE),
    "steps of no count": reseal("dense", 1, count=0),
    "steps with a chart that is none": reseal("dense", 1, chart=_filled(1e6)),
    "steps with a chart below none": reseal("dense", 1, chart=_filled(-1.0)),
    "steps with a chart that is NaN": reseal("dense", 1, chart=_filled(np.nan)),
    "charts that are missing": sql("DELETE FROM chart"),
    "a chart that is no JSON": reseal("chart", 0, text="{"),
    "a chart that is 100,000 deep": reseal("chart", 0, text=_DEEP),
    "a chart without numbers": reseal("chart", 0, numbers=b""),
    "a chart of too few numbers": reseal("chart", 0, numbers=lambda blob: blob[:16]),
    "a chart with a forest of no edges": _chart(
        forest={"edge": [], "parent": [], "order": [], "edges": 0}
    ),
    "a chart with a forest in a ring": _chart(
        forest={"edge": [0, 1], "parent": [1, 0], "order": [0, 1], "edges": 2}
    ),
    "a chart with a forest of bodies that are none": _chart(
        forest={"edge": [9, 9], "parent": [9, 9], "order": [9, 9], "edges": 9}
    ),
    "a chart of another kind": _chart(parametrization="unknown"),
    "a chart that partitions what is not there": _chart(
        parametrization="partitioning", independent=[99]
    ),
    "a chart of a plane without rows": _chart(parametrization="tangent_plane"),
    "a chart that keeps rows that are none": _chart(kept=[0, 77]),
    "a chart with a huge freedom": _chart(ndof=2**40),
    "a chart without a tree": _chart(tree=None),
    "an empty polynomial": reseal("dense", 1, w=b""),
    "a polynomial of NaN": reseal("dense", 1, w=_filled(np.nan)),
    "a polynomial of huge degree": reseal("dense", 1, degree=_filled(1e18)),
    "a polynomial of negative degree": reseal("dense", 1, degree=_filled(-1.0)),
    "steps of huge dimension": reseal("dense", 1, dimension=HUGE),
    "steps of negative dimension": reseal("dense", 1, dimension=-1),
    "steps without coordinates": reseal("dense", 1, q=b""),
    "steps without ledger": reseal("dense", 1, ledger=b""),
    "steps with powers of odd number": reseal("dense", 1, powers=_numbers(1.0)),
    "steps of no length": reseal("dense", 1, h=_filled(0.0)),
    "steps of NaN length": reseal("dense", 1, h=_filled(np.nan)),
    "steps that begin at NaN": reseal("dense", 1, t=_filled(np.nan)),
}

#: Strange, but what it says can be shown.
HARMLESS: dict[str, Change] = {
    "a title of control characters": meta("title", '"\\u001b[2J\\u0007\\u0000"'),
    "a title of 100 KB": meta("title", json.dumps("x" * 100_000)),
    "a unit of control characters": reseal("quantity", 2, unit="\x1b[31m"),
    "entries of names that nobody knows": both(meta("other", {"a": [1]})),
    "no certification": meta("certification", "null"),
    "warnings that are none": meta("warnings", []),
    "free pages": sql("CREATE TABLE t (x)", "DROP TABLE t"),
}


def craft(whole: Path, path: Path, change: Change) -> None:
    """Copy a result and change it."""
    path.write_bytes(whole.read_bytes())
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA ignore_check_constraints = ON")
        change(db)
        db.commit()
