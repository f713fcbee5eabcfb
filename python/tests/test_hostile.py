"""The catalogue of hostile use in `hostile/`: what each case must be answered with."""

from __future__ import annotations

import os
import re
import sqlite3
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import PENDULUM

import holonom
from holonom.base.errors import FileError, HolonomError, UsageError
from holonom.cli.commands import invoke
from holonom.store.layout import STATE

#: What a class of errors says where nobody has thought of better.
GENERAL = {kind.usual_help for kind in (HolonomError, UsageError, FileError)}
CASES = Path(__file__).parent / "hostile"
ALLOWED = {0, 1, 2, 3, 5}
#: What a terminal must not get: control characters but line ends, directions of writing.
OBEYED = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def cases(name: str) -> list[Any]:
    with (CASES / name).open("rb") as file:
        return tomllib.load(file)["case"]


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Files that the cases name in capitals."""
    folder = tmp_path_factory.mktemp("hostile")
    names = {"FOLDER": folder / "folder", "FIFO": folder / "fifo", "HUGE": folder / "huge.toml"}
    for name in ("EMPTY", "BINARY", "RESULT", "LOOP", "DANGLING", "NOTUTF8", "OTHERDB", "NEWER"):
        names[name] = folder / f"{name.lower()}.holonom"
    names["MODEL"], names["OTHER"] = folder / "rod" / "model.toml", folder / "other.toml"
    names["FOLDER"].mkdir()
    names["MODEL"].parent.mkdir()
    names["MODEL"].write_text(PENDULUM)
    names["OTHER"].write_text(PENDULUM.replace("rod", "bar").replace("[0.8, 0.0]", "[0.9, 0.0]"))
    names["EMPTY"].touch()
    names["BINARY"].write_bytes(bytes(range(256)))
    names["NOTUTF8"].write_bytes(b"holonom = 1 # \xff\n")
    names["LOOP"].symlink_to(names["LOOP"])
    names["DANGLING"].symlink_to(folder / "nowhere")
    os.mkfifo(names["FIFO"])
    with names["HUGE"].open("wb") as file:
        file.truncate(65 * 1024**2)
    assert invoke(["run", str(names["MODEL"]), "-q", "-o", str(names["RESULT"])]) == 0
    sqlite3.connect(names["OTHERDB"]).execute("CREATE TABLE meta (key TEXT)").connection.close()
    names["NEWER"].write_bytes(names["RESULT"].read_bytes())
    with sqlite3.connect(names["NEWER"]) as db:
        db.execute("PRAGMA user_version = 999")
    db.close()
    return {name: str(path) for name, path in names.items()}


def filled(word: str, places: dict[str, str]) -> str:
    """Return a word of a case: names of files, and ``{100000 L}`` for that many letters."""
    word = re.sub(r"\{(\d+) (.)\}", lambda match: int(match[1]) * match[2], word)
    word = re.sub(r"\{byte (..)\}", lambda match: chr(0xDC00 + int(match[1], 16)), word)
    for name, path in places.items():
        word = word.replace(name, path) if re.match(rf"{name}\b", word) else word
    return word


def assert_message(text: str, said: str, status: int) -> None:
    assert said in text
    assert not OBEYED.search(text), repr(text[:2000])
    assert max(map(len, text.splitlines()), default=0) <= 1100
    assert "Traceback" not in text
    if status:
        helps = [line for line in text.splitlines() if line.lstrip().startswith("help: ")]
        assert helps
        assert not any(general in line for line in helps for general in GENERAL)


@pytest.mark.parametrize(
    "case", cases("commands.toml"), ids=lambda case: " ".join(case["line"])[:60]
)
def test_a_hostile_command_line_has_its_status_and_message(
    case: dict[str, Any],
    places: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/nonexistent")
    line = [filled(word, places) for word in case["line"]]
    status = invoke(line)
    output = capsys.readouterr()
    assert (status, status in ALLOWED) == (case["status"], True), output.err
    assert_message(output.err, case["said"], status)
    assert not OBEYED.search(output.out.replace("\r\n", "\n"))
    assert Path(places["MODEL"]).read_text() == PENDULUM


@pytest.mark.parametrize("case", cases("models.toml"), ids=lambda case: case["name"])
def test_a_hostile_model_is_refused_or_runs(
    case: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"model.{case.get('syntax', 'toml')}"
    text = case["text"] if "text" in case else PENDULUM.replace(*case["replace"])
    path.write_text(filled(text, {}), encoding="utf-8")
    for command in (["check"], ["run", "-o", str(tmp_path / "x.holonom")]):
        status = invoke([command[0], str(path), *command[1:]])
        output = capsys.readouterr()
        assert status == case["status"], output.err
        assert_message(output.err, case["said"], status)
        assert not OBEYED.search(output.out)


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    model = holonom.Model.from_text(PENDULUM)
    result = model.simulate(end_time=0.1, interval=0.01)
    return {
        "holonom": holonom,
        "np": np,
        "model": model,
        "result": result,
        "states": {name: result[name] for name in STATE if name in result.quantities},
        "comparison": holonom.compare(
            model, methods=["ForRadau"], tolerances=[1e-3], end_time=0.1, repeat=1
        ),
        "deep": lambda levels: [] if levels == 0 else [names_deep(levels - 1)],
    }


def names_deep(levels: int) -> list[Any]:
    value: list[Any] = []
    for _ in range(levels):
        value = [value]
    return value


@pytest.mark.parametrize("case", cases("calls.toml"), ids=lambda case: case["call"][:60])
def test_a_hostile_call_raises_an_error_of_holonom(
    case: dict[str, Any], names: dict[str, Any]
) -> None:
    with pytest.raises(holonom.HolonomError) as refused:
        eval(case["call"], dict(names))
    assert type(refused.value).__name__ == case["error"]
    assert_message(str(refused.value), case["said"], 1)


def test_the_catalogue_has_300_cases_each_once() -> None:
    lines = [tuple(case["line"]) for case in cases("commands.toml")]
    models = [case["name"] for case in cases("models.toml")]
    calls = [case["call"] for case in cases("calls.toml")]
    for every in (lines, models, calls):
        assert len(set(every)) == len(every)
    assert len(lines) + len(models) + len(calls) >= 300


@pytest.mark.parametrize(
    "name", [b"caf\xe9.toml", b"\x1b[31m.toml", b"a\nb.toml", "ж.toml".encode()]
)
def test_a_model_file_may_have_any_name(tmp_path: Path, name: bytes) -> None:
    """A real process: names of bytes come as arguments."""
    path = os.path.join(os.fsencode(tmp_path), name)  # noqa: PTH118
    Path(os.fsdecode(path)).write_text(PENDULUM)
    beside = os.path.join(os.fsencode(tmp_path), b"\xff", b"model.toml")  # noqa: PTH118
    Path(os.fsdecode(beside)).parent.mkdir()
    Path(os.fsdecode(beside)).write_text('holonom = 1\nextends = "../base/model.toml"\n')
    (tmp_path / "base").mkdir()
    (tmp_path / "base" / "model.toml").write_text(PENDULUM)
    for command, model in (("run", path), ("check", beside)):
        done = subprocess.run(
            [sys.executable.encode(), b"-m", b"holonom", command.encode(), model],
            capture_output=True,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        assert not OBEYED.search(done.stdout.decode())
    Path(os.fsdecode(path)).write_text("holonom = ")
    done = subprocess.run(
        [sys.executable.encode(), b"-m", b"holonom", b"check", path], capture_output=True
    )
    assert done.returncode == 2
    assert_message(done.stderr.decode(), "model/syntax", 2)
