"""What a user types: output, exit status, and one message instead of a traceback."""

from __future__ import annotations

import json
import os
import pty
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import PENDULUM, write_result

from holonom.base.errors import UsageError
from holonom.cli.commands import invoke
from holonom.model import Model
from holonom.result import Result
from holonom.store.layout import Quantity

HOLONOM = [sys.executable, "-m", "holonom"]


@pytest.fixture
def result_file(pendulum: Path, tmp_path: Path) -> Path:
    path = tmp_path / "out" / "rod.holonom"
    assert invoke(["run", str(pendulum), "-o", str(path), "--quiet"]) == 0
    return path


def output_json(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


def test_run_says_how_it_went_in_about_15_lines(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new" / "rod.holonom"
    assert invoke(["run", str(pendulum), "-o", str(path)]) == 0
    said = capsys.readouterr()
    assert said.err == ""  # no progress where nobody watches
    lines = said.out.splitlines()
    assert 12 <= len(lines) <= 20
    for wanted in (
        "Rod on a pin",
        "completed at 1 s",
        "ForRadau",
        "1 body, 1 joint",
        "1 degree of freedom",
        "accepted",
        "jacobians",
        "s per simulated second",
        "largest residuals",
        "energy imbalance",
        str(path),
    ):
        assert wanted in said.out, wanted
    assert "\x1b" not in said.out


def test_without_a_name_the_result_lands_in_results(
    pendulum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke(["run", str(pendulum), "-q"]) == 0
    assert (tmp_path / "results" / "rod.holonom").exists()


def test_folders_of_a_result_are_made(pendulum: Path, tmp_path: Path) -> None:
    path = tmp_path / "new" / "deep" / "rod.holonom"
    assert invoke(["run", str(pendulum), "-q", "-o", str(path)]) == 0
    assert path.is_file()


def test_flags_override_the_model(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rod.holonom"
    arguments = ["run", str(pendulum), "-o", str(path), "--json", "--end-time", "0.5"]
    arguments += ["--tolerance", "relative=1e-4,rotation=1e-5", "--interval", "0.1"]
    arguments += ["-c", "rod.angle,rod.position", "--set", "bodies.rod.mass=3", "--method", "DEABM"]
    assert invoke(arguments) == 0
    facts = output_json(capsys)
    assert facts["status"] == "completed"
    assert facts["stop_reason"]["code"] == "simulation/end-time"
    assert facts["stored_until"] == 0.5
    assert facts["n_times"] == 6
    assert facts["requested"] == ["rod.angle", "rod.position"]
    assert facts["options"]["method"] == "DEABM"
    assert facts["options"]["tolerance"] == {
        "relative": 1e-4,
        "translation": 1e-6,  # of the model
        "rotation": 1e-5,
    }
    with Result.load(path) as result:
        assert result.meta["model"]["bodies"]["rod"]["mass"] == 3


def test_a_run_starts_from_a_stored_state(
    pendulum: Path, result_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rest = str(tmp_path / "rest.holonom")
    arguments = ["run", str(pendulum), "-o", rest, "--start", str(result_file), "--at", "0.4"]
    assert invoke([*arguments, "--json"]) == 0
    facts = output_json(capsys)
    assert facts["n_times"] == 61
    assert invoke([*arguments[:-1], "0.4001", "--json"]) == 0  # no output time
    assert output_json(capsys)["n_times"] == 61
    assert invoke([*arguments[:-1], "1.4"]) == 1
    assert "covers 0.0 s to 1.0 s" in capsys.readouterr().err


@pytest.mark.parametrize("rows", [0, 1])
def test_the_faces_of_a_result_with_hardly_a_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: int
) -> None:
    path = tmp_path / "rod.holonom"
    write_result(path, chunks=rows, rows=1).close()
    picture, page, table = (tmp_path / name for name in ("a.png", "a.html", "a.csv"))
    assert invoke(["plot", str(path), "-o", str(picture)]) == 0
    assert picture.stat().st_size > 1000
    assert invoke(["report", str(path), "-o", str(page)]) == 0
    assert ("There are no rows" in page.read_text(encoding="utf-8")) == (rows == 0)
    assert invoke(["export", str(path), "-o", str(table)]) == 0
    assert len(table.read_text(encoding="utf-8").splitlines()) == 1 + rows
    assert ("no rows" in capsys.readouterr().err) == (rows == 0)
    for arguments in (["info"], ["info", "--json"], ["export", "-o", "-"]):
        assert invoke([*arguments[:1], str(path), *arguments[1:]]) == 0
    if rows == 0:
        with Result.load(path) as result, pytest.raises(UsageError, match="no rows"):
            result.state()


def test_check_prints_counts_or_json(pendulum: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["check", str(pendulum)]) == 0
    text = capsys.readouterr().out
    assert "degrees of freedom    1" in text
    assert invoke(["check", str(pendulum), "--json"]) == 0
    behind = output_json(capsys)
    assert behind["dof"] == 1
    assert invoke(["--json", "check", str(pendulum)]) == 0
    assert output_json(capsys) == behind
    # A table as a model file has it, and as JSON has it.
    tables = (
        "{mass = 2.0, inertia = 0.1, position = [0.8, 0.0]}",
        '{"mass": 2.0, "inertia": 0.1, "position": [0.8, 0.0]}',
    )
    for table in tables:
        assert invoke(["check", str(pendulum), "--set", f"bodies.rod={table}", "--json"]) == 0
        assert output_json(capsys)["dof"] == 1


def test_check_and_info_list_the_channels(
    pendulum: Path, result_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = Model.load(pendulum).channels
    capsys.readouterr()
    assert invoke(["check", str(pendulum), "--channels"]) == 0
    listed = capsys.readouterr().out.partition("\nchannels: ")[2].splitlines()[1:]
    assert [line.split()[0] for line in listed] == list(known)
    assert "  rod.position [2] m ground" in listed
    assert invoke(["check", str(pendulum), "--json"]) == 0
    found = output_json(capsys)["channels"]
    assert [Quantity(**{**q, "shape": tuple(q["shape"])}) for q in found] == list(known.values())

    assert invoke(["info", str(result_file)]) == 0
    said = capsys.readouterr().out
    assert "rod.acceleration" not in said
    assert "--channels" in said
    assert invoke(["info", str(result_file), "--channels"]) == 0
    assert "  rod.acceleration [2] m/s^2 ground" in capsys.readouterr().out
    assert invoke(["info", str(result_file), "--channels", "--json"]) == 0
    data = output_json(capsys)
    stored, others = ({q["name"] for q in data[key]} for key in ("channels", "computable"))
    assert stored | others == set(known)
    assert not stored & others
    assert invoke(["plot", str(result_file), "xyz"]) == 1
    assert "`holonom info RESULT --channels`" in capsys.readouterr().err


def test_a_pattern_takes_a_component(result_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert invoke(["export", str(result_file), "*.*c*[1]", "-o", "-"]) == 0
    heading = capsys.readouterr().out.splitlines()[0]
    vectors = ("rod.velocity[1] (m/s)", "rod.acceleration[1] (m/s^2)", "pin.force[1] (N)")
    assert heading == ",".join(["time (s)", *vectors])  # by hand: scalars have no component
    assert invoke(["export", str(result_file), "*.angle[1]", "-o", "-"]) == 1
    assert "there is no channel" in capsys.readouterr().err


def test_json_is_never_something_else(
    result_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    for line in (["--json"], ["export", str(result_file), "-o", "-", "--json"]):
        assert invoke(line) == 1
        assert "--json" in output_json(capsys)["error"]["message"]


def test_a_result_given_for_a_model_is_known(
    result_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in ("check", "run"):
        assert invoke([command, str(result_file)]) == 2
        assert f"`holonom info {result_file}`" in capsys.readouterr().err


def test_recover_is_not_advised_where_nothing_is_left(
    result_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result_file.write_bytes(result_file.read_bytes()[:4096])
    for flags in ([], ["--recover"]):
        assert invoke(["info", str(result_file), *flags]) == 5
        said = capsys.readouterr().err
        assert "nothing of it can be read" in said
        assert "--recover" not in said


def test_a_start_that_does_not_fit_is_told_in_words_of_the_command_line(
    pendulum: Path, result_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rest = ["--start", str(result_file), "-o", str(tmp_path / "rest.holonom"), "-q"]
    assert invoke(["run", "library:slider_crank", "--end-time", "2", *rest]) == 1
    assert f"{result_file} is a run of another model (rod)" in capsys.readouterr().err
    for flags in (["--start-time", "5"], ["--end-time", "0.5"]):
        assert invoke(["run", str(pendulum), *flags, *rest]) == 1
        assert "`--at SECONDS`" in capsys.readouterr().err


def test_check_explains_the_spanning_tree(capsys: pytest.CaptureFixture[str]) -> None:
    # By hand: crank and slider are tied to the ground by one coordinate each, the rod to either;
    # one joint closes the loop, and one coordinate is free.
    model = str(Path(__file__).parents[2] / "models" / "slider_crank" / "model.toml")
    assert invoke(["check", model, "--json"]) == 0
    tree = output_json(capsys)["tree"]
    assert {edge["body"] for edge in tree} == {"crank", "rod", "slider"}
    roles = [entry["role"] for edge in tree for entry in edge["coordinates"]]
    assert sorted(roles) == ["dependent", "dependent", "independent"]
    assert invoke(["check", model, "--verbose"]) == 0
    assert "ground → crank: joint" in capsys.readouterr().out
    assert invoke(["check", model]) == 0
    assert "spanning tree" not in capsys.readouterr().out


def test_the_faces_of_a_result(
    result_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(["report", str(result_file)]) == 0
    assert result_file.with_suffix(".html").read_text(encoding="utf-8").startswith("<!doctype")
    assert invoke(["plot", str(result_file), "rod.*", "-o", str(tmp_path / "rod.png")]) == 0
    assert (tmp_path / "rod.png").stat().st_size > 1000
    capsys.readouterr()
    assert invoke(["export", str(result_file), "rod.position", "-o", "-"]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header == "time (s),rod.position[0] (m),rod.position[1] (m)"
    assert len(rows) == 101
    assert invoke(["info", str(result_file)]) == 0
    assert "rod.position [2] m ground" in capsys.readouterr().out
    for command in (["info"], ["plot"], ["report"], ["export"]):
        assert invoke([*command, str(result_file), "--json"]) == 0
        assert isinstance(output_json(capsys), dict)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("UPDATE data SET blob = zeroblob(length(blob)) WHERE quantity = 2", "in rows 0 to"),
        ("UPDATE step SET causes = '[7]'", "the step log of chunk 1"),
        ("UPDATE dense SET dimension = 1 + dimension", "the steps of chunk 1"),
        ("UPDATE meta SET value = '7' WHERE key = 'dof'", "the entry `dof`"),
    ],
)
def test_info_of_a_damaged_result_tells_what_is_lost_and_what_is_left(
    result_file: Path, capsys: pytest.CaptureFixture[str], change: str, part: str
) -> None:
    stored = result_file
    with closing(sqlite3.connect(stored)) as db:
        assert db.execute(change).rowcount == 1
        db.commit()
    capsys.readouterr()
    assert invoke(["info", str(stored)]) == 5
    told = capsys.readouterr()
    assert part in told.err
    assert "--recover" in told.err
    assert "rod.position" in told.out
    assert invoke(["info", str(stored), "--json"]) == 5
    found = output_json(capsys)
    assert (found["error"]["code"], found["exit_status"]) == ("result/damaged", 5)
    assert [entry for entry in found["error"]["damage"] if part in entry]
    assert found["n_times"] == 101
    assert invoke(["info", str(stored), "--recover"]) == 0  # which was asked for
    assert part in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "ending"),
    [("plot", ".svg"), ("report", ".html"), ("view", ".view.html"), ("export", ".csv")],
)
def test_what_is_made_of_a_result_is_named_after_all_of_it(
    result_file: Path, command: str, ending: str
) -> None:
    """Two results of a study do not share a page because their names hold a point."""
    for name in ("speed0.5", "speed0.6", "speed0.7.holonom"):
        shutil.copy(result_file, result_file.with_name(name))
        assert invoke([command, str(result_file.with_name(name))]) == 0
    made = {path.name for path in result_file.parent.glob(f"speed*{ending}")}
    assert made == {f"speed0.{number}{ending}" for number in (5, 6, 7)}


def test_schema_is_json_and_has_a_reference(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["schema"]) == 0
    assert isinstance(output_json(capsys), dict)
    assert invoke(["schema", "--json"]) == 0
    assert isinstance(output_json(capsys), dict)
    assert invoke(["schema", "--reference"]) == 0
    assert capsys.readouterr().out.startswith("#")


USAGE, MODEL, SOLVER, FILES, INTERRUPTED = 1, 2, 3, 5, 130


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["fly"], USAGE, "fly"),
        (["run"], USAGE, "MODEL"),
        (["run", "MODEL", "--end-time", "soon"], USAGE, "--end-time"),
        (["run", "MODEL", "--tolerance", "small"], USAGE, "--tolerance small"),
        (["run", "MODEL", "--tolerance", "-1"], USAGE, "positive"),
        (["run", "MODEL", "--tolerance", "nan"], USAGE, "finite"),
        (["run", "MODEL", "--method", "Euler"], USAGE, "ForSDIRK"),
        (["run", "MODEL", "--set", "mass"], USAGE, "PATH=VALUE"),
        (["run", "MODEL", "-c", "rod.speed"], USAGE, "rod.speed"),
        (["run", "MODEL", "--at", "1"], USAGE, "--start"),
        (["run", "MODEL", "--fixed-step", "0"], USAGE, "fixed_step"),
        (["run", "MODEL", "--set", "bodies.rad.mass=1"], MODEL, "bodies.rad"),
        (["run", "MODEL", "--set", "gravity[1]=0", "--set", "gravity[1]=1"], USAGE, "twice"),
        (["run", "MODEL", "--fixed-step", "0.1", "--max-step", "0.01"], USAGE, "`max_step`"),
        (["run", "MODEL", "-o", "-"], USAGE, "standard output"),
        (["check", "BROKEN"], MODEL, "bodies"),
        (["run", "MODEL", "--max-steps", "2"], SOLVER, "simulation/max-steps"),
        (["run", "absent.toml"], FILES, "absent.toml"),
        (["check", "FOLDER"], FILES, "folder"),
        (["run", "MODEL", "-o", "FOLDER"], FILES, "folder"),
        (["run", "MODEL", "-o", "MODEL"], FILES, "not overwritten"),
        (["report", "MODEL"], FILES, "not a Holonom result"),
        (["info", "absent.holonom"], FILES, "absent.holonom"),
    ],
)
@pytest.mark.parametrize("as_json", [False, True])
def test_every_refusal_has_its_status_and_one_message(
    pendulum: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    status: int,
    said: str,
    as_json: bool,
) -> None:
    monkeypatch.chdir(tmp_path)
    broken = tmp_path / "broken.toml"
    broken.write_text('holonom = 1\ndimension = "planar"\n[bodees]\n')
    places = {"MODEL": str(pendulum), "FOLDER": str(tmp_path), "BROKEN": str(broken)}
    line = [places.get(word, word) for word in arguments]
    assert invoke([*line, "--json"] if as_json else line) == status
    output = capsys.readouterr()
    if as_json:
        assert said in json.dumps(json.loads(output.out)["error"])
    else:
        assert said in output.err
    assert "Traceback" not in output.err
    assert pendulum.read_text() == PENDULUM


def test_the_exit_status_of_a_run_is_in_its_data(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["run", str(pendulum), "-o", str(tmp_path / "rod.holonom"), "--json"]
    assert invoke([*line, "--end-time", "0.1"]) == 0
    facts = output_json(capsys)
    assert facts["exit_status"] == 0
    assert "error" not in facts
    assert invoke([*line, "--end-time", "0.2", "--max-steps", "1"]) == 3
    facts = output_json(capsys)
    assert facts["exit_status"] == 3
    assert facts["error"]["code"] == "simulation/max-steps"
    assert invoke([*line, "--end-time", "-1"]) == 1
    assert output_json(capsys)["exit_status"] == 1


def test_a_channel_of_the_file_that_is_not_there_is_refused_with_the_file(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = pendulum.with_name("wrong.toml")
    channels = [line for line in PENDULUM.splitlines() if line.startswith("channels")]
    assert len(channels) == 1
    wrong.write_text(PENDULUM.replace(channels[0], 'channels = ["rod.velocityy"]'))
    number = PENDULUM.splitlines().index(channels[0]) + 1
    for command in (["check"], ["run", "-o", str(tmp_path / "rod.holonom")]):
        assert invoke([command[0], str(wrong), *command[1:], "--json"]) == 2
        error = output_json(capsys)["error"]
        assert error["code"] == "model/unknown-name"
        (problem,) = error["errors"]
        assert (problem["file"], problem["line"]) == (str(wrong), number)
        assert problem["help"] == "did you mean `rod.velocity`?"
    assert not (tmp_path / "rod.holonom").exists()


@pytest.mark.parametrize(
    ("command", "usage"),
    [
        ("run", "MODEL"),
        ("plot", "RESULT... [CHANNEL]..."),
        ("export", "RESULT [CHANNEL]..."),
        ("view", "RESULT..."),
        ("models", "[NAME]"),
    ],
)
def test_help_says_what_takes_a_word(
    capsys: pytest.CaptureFixture[str], command: str, usage: str
) -> None:
    assert invoke([command, "--help"]) == 0
    told = capsys.readouterr().out
    assert f"holonom {command} [OPTIONS] {usage} " in told
    assert "--json" in told
    assert "<bool>" not in told  # a switch takes none


def test_channels_are_listed_alike_by_every_command(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["-c", "rod.position, pin.force", "--channels", "rod.angle", "--end-time", "0.1"]
    assert invoke(["run", str(pendulum), *names, "-o", str(tmp_path / "rod.holonom"), "-q"]) == 0
    few = ["--method", "ForRadau", "--tolerance", "1e-3", "--repeat", "0", "--json"]
    assert invoke(["compare", str(pendulum), *names, *few]) == 0
    compared = {name.partition("[")[0] for name in output_json(capsys)["channels"]}
    with Result.load(tmp_path / "rod.holonom") as result:
        assert compared == set(result.requested)


def test_without_a_command_the_help_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["--help"]) == 0
    assert "130 interrupted" in " ".join(capsys.readouterr().out.split())
    assert invoke([]) == 0
    assert "Usage" in capsys.readouterr().out


def test_a_real_process_ends_with_the_same_status(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = [*HOLONOM, "run", str(pendulum), "-o", str(tmp_path / "rod.holonom")]
    done = subprocess.run([*run, "--max-steps", "2"], capture_output=True, text=True)
    assert done.returncode == SOLVER
    assert "stopped at a limit" in done.stdout
    assert "Traceback" not in done.stderr
    with Result.load(tmp_path / "rod.holonom") as result:
        assert result.status == "limit"
    assert invoke(["info", str(tmp_path / "rod.holonom")]) == 0
    assert "simulation/max-steps" in capsys.readouterr().out


def _endless(pendulum: Path, path: Path) -> list[str]:
    arguments = ["--end-time", "9e4", "--tolerance", "1e-9", "--interval", "0.01"]
    return [*HOLONOM, "run", str(pendulum), "-o", str(path), *arguments]


def _wait_for_rows(path: Path) -> None:
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        if path.exists():
            with Result.load(path) as result:
                if result.time.size:
                    return
        time.sleep(0.05)
    raise AssertionError("nothing was stored within 30 s")


def _heed_ctrl_c() -> None:
    """Undo what a shell does to background jobs: a test may run in one."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_keeps_and_marks_what_was_computed(pendulum: Path, tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    process = subprocess.Popen(
        _endless(pendulum, path),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_heed_ctrl_c,
    )
    _wait_for_rows(path)
    process.send_signal(signal.SIGINT)
    asked = time.monotonic()
    out, err = process.communicate(timeout=30)
    assert time.monotonic() - asked < 3.0  # 0.2 s for the core; the rest is the summary
    assert process.returncode == INTERRUPTED
    assert "simulation/interrupted" in err
    assert f"`holonom run {pendulum} --start {path} -o {path}`" in err
    assert "Traceback" not in err
    assert "interrupted at" in out
    with Result.load(path) as result:
        assert result.status == "interrupted"
        assert result.time.size > 0
        assert result.stop_reason["time"] == result.time[-1]
        assert result["rod.position"].shape == (result.time.size, 2)
    assert [entry.name for entry in tmp_path.iterdir() if entry.is_file()] == [path.name]


def test_a_killed_run_says_up_to_which_time(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rod.holonom"
    process = subprocess.Popen(_endless(pendulum, path), stdout=subprocess.DEVNULL)
    _wait_for_rows(path)
    process.kill()
    process.wait()
    assert invoke(["info", str(path)]) == 0
    assert "killed while writing at" in capsys.readouterr().out
    assert invoke(["info", str(path), "--json"]) == 0
    facts = output_json(capsys)
    assert facts["status"] == "killed"
    assert facts["stored_until"] > 0.0


@pytest.mark.long
@pytest.mark.parametrize("trial", range(20))
def test_a_run_killed_at_20_random_moments_is_readable(
    pendulum: Path, tmp_path: Path, trial: int
) -> None:
    path = tmp_path / "rod.holonom"
    process = subprocess.Popen(_endless(pendulum, path), stdout=subprocess.DEVNULL)
    _wait_for_rows(path)
    time.sleep(random.Random(trial).uniform(0.0, 2.0))
    process.kill()
    process.wait()
    with Result.load(path) as result:
        assert result.status == "killed"
        rows = result.time.size
        np.testing.assert_allclose(result.time, 0.01 * np.arange(rows), rtol=1e-9, atol=1e-12)
        # The rod keeps its length, whatever else happened to the file.
        length = np.linalg.norm(result["rod.position"], axis=1)
        np.testing.assert_allclose(length, 0.8, atol=1e-10)


def test_progress_is_shown_on_a_terminal(pendulum: Path, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        _endless(pendulum, tmp_path / "rod.holonom"),
        stderr=theirs,
        stdout=subprocess.DEVNULL,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "120"},
    )
    os.close(theirs)
    shown = b""
    deadline = time.monotonic() + 30.0
    while b"steps" not in shown and time.monotonic() < deadline:
        shown += os.read(ours, 4096)
    process.send_signal(signal.SIGINT)
    while True:  # a terminal that nobody reads would stop the process
        try:
            if not os.read(ours, 4096):
                break
        except OSError:
            break
    assert process.wait(timeout=30) == INTERRUPTED
    os.close(ours)
    text = shown.decode(errors="replace")
    for wanted in ("t ", "h ", "steps", "left"):
        assert wanted in text
