"""Runs whose file takes no more: what was stored stays, whole, and says why it ends there."""

from __future__ import annotations

import errno
import json
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import holonom
from holonom import library
from holonom.base.errors import FileError
from holonom.cli.commands import invoke
from holonom.result import Result
from holonom.store import reader, writer
from holonom.store.writer import Writer

CHOICES: dict[str, Any] = {"end_time": 4.0, "interval": 1e-3}

#: The largest size of a file stands for a disk: the system refuses to write beyond it.
_LIMITED = (
    "import resource, sys; from holonom.cli.commands import invoke;"
    "resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, resource.RLIM_INFINITY));"
    "sys.exit(invoke(sys.argv[1:]))"
)


@pytest.fixture
def model(pendulum: Path) -> holonom.Model:
    return holonom.Model.load(pendulum)


@pytest.fixture
def whole(model: holonom.Model) -> Result:
    return model.simulate(**CHOICES)


def _full() -> sqlite3.OperationalError:
    error = sqlite3.OperationalError("database or disk is full")
    error.sqlite_errorname = "SQLITE_FULL"
    return error


@pytest.fixture
def fills(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Let the disk be full for one chunk, after so many; what is smaller finds room again."""

    def fill(after: int) -> None:
        insert, chunks = writer.insert, 0

        def refusing(db: sqlite3.Connection, table: str, *rest: Any) -> None:
            nonlocal chunks
            chunks += table == "chunk"
            if table == "chunk" and chunks == after + 1:
                raise _full()
            insert(db, table, *rest)

        monkeypatch.setattr(writer, "insert", refusing)

    return fill


def _require_beginning(result: Result, whole: Result) -> None:
    """Compare rows and steps with those of a run that had room."""
    count = result.time.size
    assert 0 < count < whole.time.size
    for name in ("time", "q", "rod.position"):
        assert result[name].tobytes() == whole[name][:count].tobytes()
    assert result.span is not None
    assert result.span[1] < result.time[-1] + 0.1


def test_a_full_disk_leaves_no_hole_and_the_run_can_go_on(
    pendulum: Path, whole: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rod.holonom"
    line = ["run", str(pendulum), "-o", str(path), "--end-time", "4", "--interval", "1e-3"]
    done = subprocess.run(
        [sys.executable, "-c", _LIMITED, *line], capture_output=True, text=True, check=False
    )
    assert done.returncode == 5, done.stderr
    assert "no space is left" in done.stderr
    assert "status                failed at" in done.stdout
    with Result.load(path) as result:
        _require_beginning(result, whole)
        assert result.status == "failed"
        assert "no space is left" in result.stop_reason["message"]
    assert invoke(["info", str(path)]) == 0
    assert "no space is left" in capsys.readouterr().out
    assert invoke([*line, "--start", str(path)]) == 0
    with Result.load(path) as result:
        assert result.status == "completed"
        for name in ("time", "q", "rod.position"):
            assert result[name].tobytes() == whole[name].tobytes()


def test_the_error_carries_what_was_stored(
    model: holonom.Model, whole: Result, tmp_path: Path, fills: Callable[[int], None]
) -> None:
    path = tmp_path / "rod.holonom"
    fills(2)
    given: list[float] = []

    def rows(arrays: Mapping[str, Any]) -> None:
        given.extend(arrays["time"])

    with pytest.raises(FileError, match="no space is left") as full:
        model.simulate(output=path, rows=rows, **CHOICES)
    assert full.value.result is not None
    with full.value.result as result:
        assert result.path == path
        assert result.status == "failed"
        _require_beginning(result, whole)
        assert given == result.time.tolist()
    assert sorted(entry.name for entry in tmp_path.glob("rod*")) == ["rod.holonom"]
    model.simulate(output=path, **CHOICES).close()  # nothing holds the file


def test_a_file_without_room_for_the_reason_says_that_the_run_did_not_end(
    model: holonom.Model,
    whole: Result,
    tmp_path: Path,
    fills: Callable[[int], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "rod.holonom"
    fills(2)
    put_meta = writer.put_meta

    def refusing(db: sqlite3.Connection, meta: Mapping[str, Any]) -> None:
        if meta.get("status") == "failed":
            raise _full()
        put_meta(db, meta)

    monkeypatch.setattr(writer, "put_meta", refusing)
    with pytest.raises(FileError, match="no space is left"):
        model.simulate(output=path, **CHOICES)
    with Result.load(path) as result:
        assert result.status in ("killed", "running")
        _require_beginning(result, whole)


def test_where_an_older_result_stands_what_was_computed_is_in_memory(
    model: holonom.Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "rod.holonom"
    model.simulate(output=path).close()
    before = path.read_bytes()

    def refusing(self: Writer) -> None:
        raise FileError(f"{path}: no space", "make room")

    monkeypatch.setattr(Writer, "_place", refusing)
    with pytest.raises(FileError, match="no space") as full:
        model.simulate(output=path, **CHOICES)
    assert full.value.result is not None
    assert full.value.result.path is None
    assert full.value.result.time.size
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.glob("rod*")] == ["rod.holonom"]


def test_a_reason_does_not_outlive_the_run_that_goes_on(
    model: holonom.Model, tmp_path: Path, fills: Callable[[int], None]
) -> None:
    path = tmp_path / "rod.holonom"
    fills(2)
    with pytest.raises(FileError):
        model.simulate(output=path, **CHOICES)
    with Result.load(path) as result:
        state = result.state()
    # With another interval it goes on from the last row, as another part.
    seen: list[dict[str, Any]] = []

    def progress(*_: float) -> None:
        with Result.load(path) as running:
            if running.status == "running":
                seen.append(running.stop_reason)

    choices = CHOICES | {"interval": 5e-4}
    with model.simulate(start=state, output=path, progress=progress, **choices) as result:
        assert result.status == "completed"
        assert result.meta["parts"][0]["stop_reason"]["code"] == "file/unusable"
    assert all(reason == {} for reason in seen)


def test_a_finding_that_cannot_be_stored_does_not_lose_the_run(
    model: holonom.Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refusing(*_: object) -> None:
        raise _full()

    monkeypatch.setattr(reader, "put_meta", refusing)
    with pytest.raises(FileError, match="no space is left") as full:
        model.simulate(output=tmp_path / "rod.holonom", certify=True)
    assert full.value.result is not None
    assert full.value.result.status == "completed"


def test_a_model_is_copied_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "mine"
    copyfile = shutil.copyfile
    source = library.FOLDER / "chain50" / "model.toml"

    def refusing(source: Path, target: Path) -> None:
        if target.parent.name == "chain50" and target.name == "model.toml":
            target.write_bytes(b"holo")
            error = OSError(errno.ENOSPC, "No space left on device", str(source))
            error.filename2 = str(target)  # as `shutil` names both
            raise error
        copyfile(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfile", refusing)
        assert invoke(["models", "chain50_free", "-o", str(folder)]) == 5
    said = capsys.readouterr().err
    assert str(folder / "chain50" / "model.toml") in said
    assert str(source) not in said
    assert not list(tmp_path.iterdir())
    assert invoke(["models", "chain50_free", "-o", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)
    assert sorted(entry.name for entry in folder.iterdir()) == ["chain50", "chain50_free"]
