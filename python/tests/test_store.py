"""The result store, with made-up chunks whose every number is known."""

from __future__ import annotations

import random
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from conftest import CHANNELS, META, SUMMARY, synthetic_chunk, write_result

from holonom.base.errors import FileError, UsageError
from holonom.result import Result
from holonom.store.layout import APPLICATION_ID, FORMAT
from holonom.store.reader import Reader
from holonom.store.writer import Writer

WHOLE = synthetic_chunk(0, 200)


def test_every_array_comes_back_bit_for_bit(stored: Path) -> None:
    with Result.load(stored) as result:
        for name in ("time", "q", "qd", "qdd", "lambda", "z", "winding"):
            np.testing.assert_array_equal(result[name], WHOLE[name])
        for name, values in WHOLE["channels"].items():
            np.testing.assert_array_equal(result[name], values)
            assert result.unit(name) == CHANNELS[name].unit
            assert result.frame(name) == CHANNELS[name].frame
        assert result.status == "completed"
        assert result.statistics.steps == SUMMARY["statistics"]["steps"]
        assert result.statistics.seconds.newton == 0.1
        assert result.meta["model"] == META["model"]


def test_plain_sqlite_and_numpy_read_it(stored: Path) -> None:
    with closing(sqlite3.connect(stored)) as db:
        assert db.execute("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
        assert db.execute("PRAGMA user_version").fetchone() == (FORMAT,)
        blobs = db.execute(
            "SELECT blob FROM data JOIN quantity ON quantity.id = data.quantity "
            "WHERE name = 'rod.position' ORDER BY chunk"
        )
        values = np.concatenate([np.frombuffer(blob, "<f8") for (blob,) in blobs]).reshape(-1, 2)
        np.testing.assert_array_equal(values, WHOLE["channels"]["rod.position"])
        counts = db.execute("SELECT first, count FROM chunk ORDER BY id").fetchall()
        assert counts == [(0, 50), (50, 50), (100, 50), (150, 50)]


def test_the_step_log_and_events_come_back(stored: Path) -> None:
    with Result.load(stored) as result:
        log = result.steps
        np.testing.assert_array_equal(log["t"], WHOLE["time"])
        np.testing.assert_array_equal(log["order"], np.full(200, 7.0))
        assert list(log["cause"]) == WHOLE["steps"]["cause"]
        assert [event["time"] for event in result.events] == [0.0, 0.5, 1.0, 1.5]
        assert result.events[0]["item"] == "motor"


def test_a_finished_file_stands_alone(stored: Path) -> None:
    assert [entry.name for entry in stored.parent.iterdir()] == [stored.name]
    with closing(sqlite3.connect(stored)) as db:
        assert db.execute("PRAGMA journal_mode").fetchone() == ("delete",)


def test_a_state_is_one_row_of_the_arrays(stored: Path) -> None:
    with Result.load(stored) as result:
        state = result.state(0.73)
        for name, part in state.items():
            np.testing.assert_array_equal(part, np.atleast_1d(WHOLE[name][73]))
        assert result.state()["time"] == WHOLE["time"][-1]
        with pytest.raises(UsageError, match=r"nearest one is at 0\.73"):
            result.state(0.7312)


def test_a_result_can_be_saved_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "copy.holonom"
    with Result(Reader.of(write_result(tmp_path / "rod.holonom"))) as result:
        np.testing.assert_array_equal(result["q"], WHOLE["q"])
        assert result.save(path) == path
    with Result.load(path) as copy:
        np.testing.assert_array_equal(copy["q"], WHOLE["q"])
        assert copy.meta == result.meta
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_arrays_are_protected(stored: Path) -> None:
    with Result.load(stored) as result, pytest.raises(ValueError, match="read-only"):
        result["q"][0, 0] = 1.0


def test_a_chunk_is_stored_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    writer = Writer(path, META, CHANNELS)
    writer.append(synthetic_chunk(0, 50))
    broken = synthetic_chunk(50, 50)
    broken["channels"]["energy.imbalance"] = np.zeros(49)  # the last array that is written
    with pytest.raises(FileError, match=r"energy\.imbalance"):
        writer.append(broken)
    writer.append(synthetic_chunk(50, 50))
    writer.finish(SUMMARY)
    writer.close()
    with Result.load(path) as result:
        np.testing.assert_array_equal(result["q"], WHOLE["q"][:100])
        assert result.steps["t"].size == 100


def test_a_running_file_is_readable_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    writer = Writer(path, META, CHANNELS)
    writer.append(synthetic_chunk(0, 50))
    with Result.load(path) as early:
        assert early.status == "running"
        writer.append(synthetic_chunk(50, 50))
        assert early["q"].shape == (50, 3)  # as it was when it was opened
    with Result.load(path) as later:
        np.testing.assert_array_equal(later["q"], WHOLE["q"][:100])
    writer.append(synthetic_chunk(100, 100))
    writer.finish(SUMMARY)
    writer.close()
    with Result.load(path) as result:
        np.testing.assert_array_equal(result["q"], WHOLE["q"])


def test_where_wal_cannot_work_the_rollback_journal_serves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class NoSharedMemory(sqlite3.Connection):
        def execute(self, sql: str, *rest: object) -> sqlite3.Cursor:  # type: ignore[override]
            if "WAL" in sql:
                raise sqlite3.OperationalError("locking protocol")
            return super().execute(sql, *rest)  # type: ignore[arg-type]

    connect = sqlite3.connect
    monkeypatch.setattr(
        sqlite3, "connect", lambda *args, **named: connect(*args, factory=NoSharedMemory, **named)
    )
    path = tmp_path / "rod.holonom"
    writer = Writer(path, META, CHANNELS)
    writer.append(synthetic_chunk(0, 200))
    assert not path.with_name("rod.holonom-wal").exists()
    writer.finish(SUMMARY)
    writer.close()
    with Result.load(path) as result:
        np.testing.assert_array_equal(result["q"], WHOLE["q"])


def test_an_older_result_is_replaced_with_its_companions(tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    process = subprocess.Popen(
        [sys.executable, "-c", _ENDLESS, str(path), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.kill()
    process.communicate()
    assert path.with_name("rod.holonom-wal").exists()
    write_result(path, chunks=1).close()
    with Result.load(path) as result:
        assert result.time.size == 50
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("content", ["notes of a user\n" * 100, "x"])
def test_other_files_are_neither_read_nor_replaced(tmp_path: Path, content: str) -> None:
    path = tmp_path / "notes.txt"
    path.write_text(content)
    with pytest.raises(FileError, match="not a Holonom result"):
        Reader.open(path)
    with pytest.raises(FileError, match="not overwritten"):
        Writer(path, META, CHANNELS)
    assert path.read_text() == content


def test_another_database_is_not_a_result(tmp_path: Path) -> None:
    path = tmp_path / "songs.sqlite"
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE song (title)")
        db.commit()
    with pytest.raises(FileError, match="not a Holonom result"):
        Reader.open(path)


def test_a_newer_format_is_refused(stored: Path) -> None:
    with closing(sqlite3.connect(stored)) as db:
        db.execute(f"PRAGMA user_version = {FORMAT + 1}")
    with pytest.raises(FileError, match=f"format {FORMAT + 1}"):
        Reader.open(stored)


def test_damage_is_reported_not_returned(stored: Path) -> None:
    with closing(sqlite3.connect(stored)) as db:
        db.execute("UPDATE data SET blob = substr(blob, 1, 8) WHERE quantity = 2 AND chunk = 3")
        db.commit()
    with Result.load(stored) as result, pytest.raises(FileError, match="damaged"):
        result["q"]


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        Reader.open(tmp_path / "none.holonom")
    with pytest.raises(FileError, match="folder"):
        Reader.open(tmp_path)
    with pytest.raises(FileError, match="folder"):
        Writer(tmp_path, META, CHANNELS)


def test_a_read_only_result_can_be_read(stored: Path) -> None:
    stored.chmod(0o444)
    stored.parent.chmod(0o555)
    try:
        with Result.load(stored) as result:
            np.testing.assert_array_equal(result["q"], WHOLE["q"])
    finally:
        stored.parent.chmod(0o755)


# Writes chunk after chunk and says after each commit how many rows are safe.
_ENDLESS = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from conftest import CHANNELS, META, synthetic_chunk
from holonom.store.writer import Writer
writer = Writer(Path(sys.argv[1]), META, CHANNELS)
first = 0
while True:
    writer.append(synthetic_chunk(first, 40))
    first += 40
    print(first, flush=True)
"""


def _kill_and_read(path: Path, acknowledged: int, companion_moves: bool) -> None:
    """Kill a writer some time after `acknowledged` rows; nothing that was safe may be lost."""
    process = subprocess.Popen(
        [sys.executable, "-c", _ENDLESS, str(path), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    safe = 0
    while safe < acknowledged:
        safe = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    rest = process.stdout.read().split("\n")
    process.stdout.close()
    assert process.wait() == -signal.SIGKILL
    safe = max([safe, *(int(line) for line in rest[:-1])])
    if companion_moves:  # the two files are enough, wherever they are
        moved = path.with_name("moved.holonom")
        shutil.copy(path, moved)
        shutil.copy(path.with_name(path.name + "-wal"), moved.with_name(moved.name + "-wal"))
        path = moved
    with Result.load(path) as result:
        assert result.status == "killed"
        rows = result.time.size
        assert rows in (safe, safe + 40)  # the last commit may have come before its message
        expected = synthetic_chunk(0, rows)
        np.testing.assert_array_equal(result["qd"], expected["qd"])
        np.testing.assert_array_equal(result["rod.position"], expected["channels"]["rod.position"])
        np.testing.assert_array_equal(result.steps["t"], expected["steps"]["t"])
    with Result.load(path) as again:  # and the recovered file stands alone
        assert again.time.size == rows
    assert not path.with_name(path.name + "-wal").exists()


@pytest.mark.parametrize("trial", range(3))
def test_a_killed_run_is_readable_up_to_its_last_commit(tmp_path: Path, trial: int) -> None:
    moment = random.Random(trial).randint(1, 8000)
    _kill_and_read(tmp_path / "rod.holonom", moment, companion_moves=trial == 1)


@pytest.mark.long
@pytest.mark.parametrize("trial", range(20))
def test_a_killed_run_is_readable_at_20_random_moments(tmp_path: Path, trial: int) -> None:
    moment = random.Random(100 + trial).randint(1, 60000)
    _kill_and_read(tmp_path / "rod.holonom", moment, companion_moves=trial % 2 == 1)
