"""Results made to harm neither hang, nor fill the memory, nor end in a traceback."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import PENDULUM
from crafted_results import AT_ONCE, HARMLESS, WHERE_USED, craft, sql
from older_results import write_older

import holonom
from holonom.cli.commands import invoke

#: All commands together may take so long on such a file, s, and so much more memory, bytes.
PATIENCE = 60
MEMORY = 1_500_000_000


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "rod.holonom"
    model = holonom.Model.from_text(PENDULUM, name="rod")
    model.simulate(output=path, end_time=0.2).close()
    return path


@pytest.fixture(autouse=True)
def bounded() -> Iterator[None]:
    """Give the test so much time and memory."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, before[1]))
    signal.alarm(PATIENCE)  # its default action ends the tests
    yield
    signal.alarm(0)
    resource.setrlimit(resource.RLIMIT_AS, before)


_DIFFERENT = ("info", "export", "export --times", "run --start", "info --recover")


def _statuses(path: Path, folder: Path, *, every: bool = False) -> dict[str, int]:
    """Return the exit status of commands that read a result: those that differ, or every one."""
    model = folder / "rod.toml"
    model.write_text(PENDULUM)
    end = ["--end-time", "0.3", "-q", "-o", str(folder / "next.holonom")]
    commands = {
        "info": ["info", str(path)],
        "info --json": ["info", str(path), "--json"],
        "export": ["export", str(path), "-o", str(folder / "t.csv")],
        "export --times": ["export", str(path), "--times", "0.0513", "-o", "-"],
        "export other": ["export", str(path), "rod.velocity", "-o", str(folder / "u.csv")],
        "run --start": ["run", str(model), "--start", str(path), *end],
        "info --recover": ["info", str(path), "--recover"],
        "export --recover": ["export", str(path), "--recover", "-o", str(folder / "v.csv")],
    }
    if not every:
        commands = {name: commands[name] for name in _DIFFERENT}
    return {name: invoke(line) for name, line in commands.items()}


@pytest.mark.parametrize("name", AT_ONCE)
def test_what_no_result_can_be_is_refused_at_once(
    whole: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "crafted.holonom"
    craft(whole, path, AT_ONCE[name])
    statuses = _statuses(path, tmp_path)
    refused = {key: value for key, value in statuses.items() if "--recover" not in key}
    assert set(refused.values()) == {5}, statuses
    assert set(statuses.values()) <= {0, 1, 2, 5}, statuses
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert str(path) in said


@pytest.mark.parametrize("name", WHERE_USED)
def test_what_does_not_fit_is_refused_where_it_is_used(
    whole: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "crafted.holonom"
    craft(whole, path, WHERE_USED[name])
    statuses = _statuses(path, tmp_path)
    assert set(statuses.values()) <= {0, 1, 2, 3, 5}, statuses
    assert any(statuses.values()), statuses
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("name", AT_ONCE | WHERE_USED | HARMLESS)
def test_every_command_survives_crafted_results(
    whole: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "crafted.holonom"
    craft(whole, path, (AT_ONCE | WHERE_USED | HARMLESS)[name])
    for more in ([], ["--recover"]):
        line = ["report", str(path), "-o", str(tmp_path / "r.html"), *more]
        assert invoke(line) in (0, 1, 2, 5)
        line = ["plot", str(path), "-o", str(tmp_path / "r.svg"), *more]
        assert invoke(line) in (0, 1, 2, 5)
    assert set(_statuses(path, tmp_path, every=True).values()) <= {0, 1, 2, 3, 5}
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("name", HARMLESS)
def test_what_is_only_strange_is_shown(
    whole: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "crafted.holonom"
    craft(whole, path, HARMLESS[name])
    statuses = _statuses(path, tmp_path)
    assert set(statuses.values()) == {0}, statuses
    assert "Traceback" not in capsys.readouterr().err


_OLDER = {
    "an endless view of chunks": sql(
        "DROP TABLE chunk",
        "CREATE VIEW chunk AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
        "SELECT i AS id, i AS first, 1 AS count FROM n",
    ),
    "a huge count": sql("UPDATE chunk SET count = 1000000000000"),
    "a negative count": sql("UPDATE chunk SET count = -1"),
    "a text for a count": sql("UPDATE chunk SET count = 'many'"),
    "a text for a blob": sql("UPDATE data SET blob = 'text'"),
    "a blob that is cut": sql("UPDATE data SET blob = x'0011'"),
    "no data": sql("DELETE FROM data"),
    "a shape that is a text": sql("UPDATE quantity SET shape = '\"wide\"'"),
    "a huge shape": sql("UPDATE quantity SET shape = '[4611686018427387904]'"),
    "a name that is a number": sql("UPDATE quantity SET name = x'00ff' WHERE id = 2"),
    "no model": sql("UPDATE meta SET value = '[]' WHERE key = 'model'"),
    "an entry that is no JSON": sql("UPDATE meta SET value = '{' WHERE key = 'title'"),
    "a deep entry": sql(
        "UPDATE meta SET value = replace(hex(zeroblob(50000)), '0', '[') WHERE key = 'title'"
    ),
    "an event that is no JSON": sql("INSERT INTO event VALUES (77, 0, 'x', '{')"),
    "a step of texts": sql("UPDATE step SET h = 'long'"),
    "a chart that is missing": sql("DELETE FROM chart"),
    "steps of texts": sql("UPDATE dense SET w = 'text'"),
    "a trigger": sql("CREATE TRIGGER more AFTER INSERT ON meta BEGIN SELECT 1; END"),
}


@pytest.mark.parametrize("name", _OLDER)
def test_older_formats_are_trusted_no_more(
    whole: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    older, path = tmp_path / "older.holonom", tmp_path / "crafted.holonom"
    write_older(whole, older, 2)
    craft(older, path, _OLDER[name])
    statuses = _statuses(path, tmp_path)
    assert set(statuses.values()) <= {0, 1, 2, 3, 5}, statuses
    assert any(statuses.values()), statuses
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    "content",
    [b"", b"SQLite format 3\0", b"SQLite format 3\0" + bytes(84), bytes(4096), b"x" * 100_000],
)
def test_what_is_no_database_is_no_result(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "crafted.holonom"
    path.write_bytes(content)
    assert set(_statuses(path, tmp_path).values()) == {5}
    assert "not a Holonom result" in capsys.readouterr().err


def test_the_header_of_a_result_alone_is_damaged(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "crafted.holonom"
    for size in (100, 101, 4095, 4096, 8192):
        path.write_bytes(whole.read_bytes()[:size])
        assert set(_statuses(path, tmp_path).values()) == {5}
        assert "is damaged" in capsys.readouterr().err
