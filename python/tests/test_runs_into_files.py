"""Runs into files: what was there stays until there is something better, whoever else is at it."""

from __future__ import annotations

import json
import re
import shlex
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from conftest import MODELS

import holonom
from holonom.base.errors import Exit, FileError, UsageError
from holonom.certificate import Certification
from holonom.cli.commands import invoke
from holonom.report.page import render
from holonom.result import Result
from holonom.store.continuation import merged
from holonom.store.reader import Reader
from holonom.store.writer import Writer

#: Runs until it is stopped, and says when its first rows are in the file asked for.
_ENDLESS = """
import os, sys
import holonom

before = os.stat(sys.argv[2]).st_ino if os.path.exists(sys.argv[2]) else None
told = False

def progress(time, step_size, steps):
    global told
    if not told and os.path.exists(sys.argv[2]) and os.stat(sys.argv[2]).st_ino != before:
        told = True
        print("placed", flush=True)

model = holonom.Model.load(sys.argv[1])
model.simulate(end_time=1e5, interval=0.02, output=sys.argv[2], progress=progress)
"""


def _endless(model: Path, path: Path) -> subprocess.Popen[str]:
    """Start a run without end and wait for its rows."""
    process = subprocess.Popen(
        [sys.executable, "-c", _ENDLESS, str(model), str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "placed\n"
    return process


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.communicate()


def _names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


@pytest.fixture
def model(pendulum: Path) -> holonom.Model:
    return holonom.Model.load(pendulum)


@pytest.fixture
def older(model: holonom.Model, tmp_path: Path) -> Path:
    path = tmp_path / "results" / "rod.holonom"
    model.simulate(output=path).close()
    return path


def test_a_run_says_what_it_replaces(
    pendulum: Path, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(["run", str(pendulum), "-o", str(older), "--end-time", "0.5"]) == 0
    said = capsys.readouterr().out
    assert re.search(rf"^replaces +{re.escape(str(older))} of \d\d:\d\d$", said, re.MULTILINE)
    with Result.load(older) as result:
        assert result.time[-1] == 0.5


def test_keep_counts_names_up(
    pendulum: Path, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = older.read_bytes()
    for number in (2, 3):
        assert invoke(["run", str(pendulum), "-o", str(older), "--keep"]) == 0
        assert f"rod-{number}.holonom" in capsys.readouterr().out
    assert older.read_bytes() == before
    assert _names(older.parent) == ["rod-2.holonom", "rod-3.holonom", "rod.holonom"]


def test_a_run_that_gets_nowhere_replaces_nothing(
    pendulum: Path, model: holonom.Model, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = older.read_bytes()
    line = ["run", str(pendulum), "-o", str(older), "--max-seconds", "1e-9"]
    assert invoke(line) == 3
    assert older.read_bytes() == before
    # One that fails after its start has one row, and no step that was accepted.
    result = model.simulate(
        output=older, on_failure="return", method="ForRadau", fixed_step=0.5, interval=0.5
    )
    if result.status != "completed":
        assert result.path is None
        assert older.read_bytes() == before
    result.close()
    assert _names(older.parent) == ["rod.holonom"]


def test_a_limit_within_the_first_step_keeps_the_older_result(
    model: holonom.Model, older: Path, tmp_path: Path
) -> None:
    """The engine delivers the row at the start, then the run ends: one row is no replacement."""
    before = older.read_bytes()
    with Result.load(older) as result:
        row = {name: part[None] for name, part in result.state(0.0).items()}
        row["time"] = row["time"][0]
        row["channels"] = {name: result[name][:1] for name in result.channels}
        meta = {**result.meta, "status": "running"}
    for ending in ("limit", "failed", "interrupted"):
        writer = Writer(older, meta, model.channels)
        writer.append(row)
        writer.finish({"status": ending, "stop_reason": {"code": "x", "message": "y"}})
        with Result(Reader.of(writer)) as kept:
            assert kept.path is None
            assert kept.status == ending
            assert kept.time.size == 1
        writer.release()
        assert older.read_bytes() == before
        assert _names(older.parent) == ["rod.holonom"]
    # Where nothing stood before, the one row is all there is, and is kept.
    first = tmp_path / "first.holonom"
    writer = Writer(first, meta, model.channels)
    writer.append(row)
    writer.finish({"status": "limit"})
    writer.close()
    with Result.load(first) as result:
        assert result.time.size == 1


def test_the_second_of_two_runs_into_a_file_is_refused(
    pendulum: Path, model: holonom.Model, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    process = _endless(pendulum, older)
    try:
        assert invoke(["run", str(pendulum), "-o", str(older), "--json"]) == 5
        error = json.loads(capsys.readouterr().out)["error"]
        assert error["code"] == "result/busy"
        assert f"is being written by process {process.pid}" in error["message"]
        with Result.load(older) as running:
            assert running.status == "running"
            assert running.time.size > 1
        with model.simulate() as other, pytest.raises(FileError, match="is being written"):
            other.save(older)
    finally:
        _end(process)
    # The lock ended with the process.
    assert invoke(["info", str(older)]) == 0
    assert "killed" in capsys.readouterr().out
    assert _names(older.parent) == ["rod.holonom"]
    assert invoke(["run", str(pendulum), "-o", str(older), "-q"]) == 0
    with Result.load(older) as result:
        assert result.status == "completed"
    assert _names(older.parent) == ["rod.holonom"]


def test_of_two_runs_of_one_process_the_second_is_refused(
    model: holonom.Model, older: Path
) -> None:
    refused: list[FileError] = []

    def progress(*_: float) -> None:
        if refused:
            return
        try:
            model.simulate(output=older).close()
        except FileError as error:
            refused.append(error)

    model.simulate(output=older, end_time=100.0, progress=progress).close()
    if refused:  # the run may end before the first report of its progress
        assert refused[0].code == "result/busy"


def test_runs_of_threads_into_one_file_leave_one_whole_result(
    model: holonom.Model, older: Path
) -> None:
    codes: list[str] = []

    def run(end: float) -> None:
        try:
            model.simulate(output=older, end_time=end).close()
            codes.append("whole")
        except FileError as error:
            codes.append(error.code)

    threads = [threading.Thread(target=run, args=(5.0 + k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(codes) <= {"whole", "result/busy"}
    assert "whole" in codes
    with Result.load(older) as result:
        assert result.status == "completed"
        assert result.time[-1] >= 5.0
    assert _names(older.parent) == ["rod.holonom"]


def test_a_reader_keeps_reading_while_the_file_is_replaced(
    pendulum: Path, model: holonom.Model, older: Path
) -> None:
    expected = model.simulate()
    with Result.load(older) as reading:
        assert reading.time.size == 101
        process = _endless(pendulum, older)
        try:
            # Not read before, so that it comes from the file that is no longer there.
            for name in ("q", "qd", "lambda", "rod.position"):
                assert reading[name].tobytes() == expected[name].tobytes()
            assert reading.state(0.555)["q"].tobytes() == expected.state(0.555)["q"].tobytes()
        finally:
            _end(process)
        assert reading["pin.force"].tobytes() == expected["pin.force"].tobytes()


def test_a_result_in_use_can_be_replaced_by_the_same_process(
    model: holonom.Model, older: Path
) -> None:
    first = model.simulate(output=older)
    second = model.simulate(output=older, end_time=0.5)
    assert first["q"].shape[0] == 101
    assert second["q"].shape[0] == 51
    first.close()
    second.close()


def test_what_is_continued_is_appended(
    pendulum: Path, model: holonom.Model, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Result.load(older) as first:
        rows = {name: first[name].copy() for name in ("time", "q", "qd", "rod.position")}
        after = model.simulate(start=first.state(), end_time=2.0)
        before = first.statistics
        steps = before.steps
        inside = first.state(0.7531)
    line = ["run", str(pendulum), "-o", str(older), "--start", str(older), "--end-time", "2"]
    assert invoke(line) == 0
    assert "continues" in capsys.readouterr().out
    with Result.load(older) as result:
        assert result.status == "completed"
        for name, values in rows.items():
            whole = np.concatenate([values, after[name][1:]])
            assert result[name].tobytes() == whole.tobytes()
        assert result.span == (0.0, 2.0)
        assert result.options["start_time"] == 0.0
        assert result.statistics.steps == steps + after.statistics.steps
        parts = [part for part in (before, after.statistics) if part.contractions]
        count = sum(part.contractions for part in parts)
        assert result.statistics.contractions == count > 0
        mean = sum(part.mean_contraction * part.contractions for part in parts) / count
        assert result.statistics.mean_contraction == pytest.approx(mean, rel=1e-14)
        largest = max(part.largest_contraction for part in parts)
        assert result.statistics.largest_contraction == largest
        assert result.steps["t"].size == result.statistics.steps + result.statistics.rejected
        assert [part["until"] for part in result.meta["parts"]] == [1.0]
        for time in (0.7531, 1.2345):
            expected = inside if time < 1.0 else after.state(time)
            for name, part in result.state(time).items():
                assert part.tobytes() == expected[name].tobytes()
    assert _names(older.parent) == ["rod.holonom"]
    assert invoke([*line[:-1], "3"]) == 0
    with Result.load(older) as result:
        assert result.time[-1] == 3.0
        assert np.all(np.diff(result.time) > 0.0)
        assert len(result.meta["parts"]) == 2
        assert result.statistics.outputs == result.time.size
        smallest = result.statistics.smallest_step
    assert invoke([*line[:-1], "3"]) == 0  # of no length
    with Result.load(older) as result:
        assert result.statistics.outputs == result.time.size
        assert result.statistics.smallest_step == smallest > 0.0


def test_limits_and_times_of_a_result_in_parts_are_those_of_the_whole(
    model: holonom.Model, older: Path
) -> None:
    with Result.load(older) as first:
        state, before = first.state(), first.limited_by
        seconds = first.meta["cpu_seconds"]
    with model.simulate(start=state, end_time=2.0) as alone:
        after = alone.limited_by
    assert before.coordinate == after.coordinate == "pin.angle"
    with model.simulate(start=state, output=older, end_time=2.0) as result:
        found = result.limited_by
        assert (found.steps, found.of) == (before.steps + after.steps, before.of + after.of)
        assert found.rejected.of == before.rejected.of + after.rejected.of
        spent = result.meta["cpu_seconds"]
        assert spent > seconds
        rate = "cpu_seconds_per_simulated_second"
        assert result.meta[rate] == result.statistics[rate] == spent / 2.0
    # Whose steps were the most in one part alone has at least those.
    few, many = {"coordinate": "a", "steps": 2, "of": 3}, {"coordinate": "b", "steps": 5, "of": 9}
    for one, other in ((few, many), (many, few)):
        limits = merged({"limited_by": one}, {"limited_by": other})["limited_by"]
        assert {key: limits[key] for key in many} == {"coordinate": "b", "steps": 5, "of": 12}


def test_fixed_steps_of_one_part_are_not_told_of_all(
    pendulum: Path, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["run", str(pendulum), "-o", str(older)]
    assert invoke(line) == 0
    capsys.readouterr()
    line += ["--start", str(older), "--fixed-step", "0.01", "--end-time"]
    for end in ("1.5", "2"):  # the first part remains one of other steps
        assert invoke([*line, end]) == 0
        out = capsys.readouterr().out
        assert "`fixed_step`, which not all parts have alike" in out
        assert "every step has" not in out
    assert invoke(["run", str(pendulum), "-o", str(older), "--force", *line[-3:-1]]) == 0
    assert "`fixed_step`: every step has 0.01 s" in capsys.readouterr().out


def test_a_certified_result_that_was_continued_is_certified_in_part(
    pendulum: Path, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["run", str(pendulum), "-o", str(older)]
    assert invoke([*line, "--certify"]) == 0
    with Result.load(older) as result:
        before = result.certification
    assert before is not None
    assert before.certified
    capsys.readouterr()
    line += ["--start", str(older)]
    assert invoke([*line, "--end-time", "2", "--tolerance", "1e-3"]) == 0
    out = capsys.readouterr().out
    assert re.search("^certified +no: there was no second run beyond 1 s, where", out, re.MULTILINE)
    worst = before.worst
    assert worst is not None
    assert f"{worst.tolerances:.3g} tolerances  {worst.name}" in out
    with Result.load(older) as result:
        found = result.certification
        assert found is not None
        assert (found.certified, found.channels, found.until) == (False, before.channels, 1.0)
        assert f"up to 1 s `{worst.name}` is furthest off" in str(found)
        assert str(found).endswith(": certify a run of the whole time")
        (part,) = result.meta["parts"]
        assert Certification.from_json(part["certification"]) == before
        page = render(result)
        assert "Certified: no" in page
        assert "compared up to 1 s" in page
    # Nothing closer than the loosest of the tolerances can be asked of the whole.
    assert invoke([*line, "--end-time", "3", "--tolerance", "rotation=1e-2"]) == 0
    assert "relative 0.001, translation 0.001 m, rotation 0.01 rad" in capsys.readouterr().out
    with Result.load(older) as result:
        assert result.certification == found
        assert result.meta["options"]["tolerance"]["relative"] == 1e-6  # of the last part
        loosest = {"relative": 1e-3, "translation": 1e-3, "rotation": 1e-2}
        assert result.options["tolerance"] == loosest
        assert holonom.diff(result, result).tolerance == loosest


def test_a_continuation_that_is_cut_off_leaves_nothing_certified(
    model: holonom.Model, older: Path
) -> None:
    with model.simulate(output=older, certify=True) as result:
        state = result.state()

    def fail(rows: dict[str, np.ndarray]) -> None:
        if rows["time"].size and rows["time"][-1] > 1.0:
            raise RuntimeError

    with pytest.raises(RuntimeError):
        model.simulate(start=state, output=older, end_time=2.0, rows=fail)
    with Result.load(older) as result:
        assert (result.status, result.time[-1] > 1.0) == ("killed", True)
        assert result.certification is not None
        assert not result.certification.certified


def test_rows_at_listed_times_are_counted(model: holonom.Model, older: Path) -> None:
    with Result.load(older) as first:
        rows, state = first.time.size, first.state()
    with model.simulate(start=state, output=older, output_times=[1.5, 2.0], end_time=2.0) as result:
        assert result.statistics.outputs == result.time.size == rows + 2


def test_by_default_a_run_goes_on_into_the_file_it_starts_from(
    pendulum: Path,
    model: holonom.Model,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke(["run", str(pendulum)]) == 0
    path = Path("results") / f"{model.name}.holonom"
    assert path.exists()
    assert invoke(["run", str(pendulum), "--start", str(path), "--end-time", "2"]) == 0
    with Result.load(path) as result:
        assert (result.time[0], result.time[-1]) == (0.0, 2.0)


@pytest.mark.parametrize(
    "more", [["--at", "0.5"], ["--at", "0.5037"], ["--set", "gravity[1]=-1.62"], ["-c", "rod.*"]]
)
def test_what_cannot_be_appended_takes_a_new_name(
    pendulum: Path, older: Path, more: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = older.read_bytes()
    line = ["run", str(pendulum), "-o", str(older), "--start", str(older), "--end-time", "2"]
    assert invoke([*line, *more]) == 0
    assert "rod-2.holonom" in capsys.readouterr().out
    assert older.read_bytes() == before
    with Result.load(older.with_name("rod-2.holonom")) as result:
        assert result.time[-1] == 2.0


def test_python_continues_too(model: holonom.Model, older: Path) -> None:
    with Result.load(older) as result:
        last, inner = result.state(), result.state(0.5)
    with model.simulate(start=last, end_time=1.5, output=older) as result:
        assert (result.path, result.time[0], result.time[-1]) == (older, 0.0, 1.5)
        assert not [w for w in result.warnings if w["code"] == "result/renamed"]
    with model.simulate(start=last, end_time=1.5, output=older, certify=True) as result:
        assert [w["code"] for w in result.warnings] == ["result/renamed"]
        assert result.path is not None
        result.path.unlink()
    with model.simulate(start=inner, end_time=1.5, output=older) as result:
        assert result.path == older.with_name("rod-2.holonom")
        assert [w["code"] for w in result.warnings] == ["result/renamed"]
        assert "rod-2.holonom" in result.warnings[0]["message"]


def test_a_result_without_rows_is_saved_and_read_back(tmp_path: Path) -> None:
    vehicle = holonom.Model.load(MODELS / "hmmwv14" / "model.toml")
    result = vehicle.simulate(end_time=1.0, max_seconds=1e-9, on_failure="return")
    assert result.time.size == 0
    result.save(tmp_path / "none.holonom")
    with Result.load(tmp_path / "none.holonom") as found:
        assert (found.status, found.stop_reason) == (result.status, result.stop_reason)
        with pytest.raises(AttributeError, match="there are none"):
            _ = found.statistics.steps
        for empty in (result, found):
            shapes = {"time": (0,), "q": (0, 0), "chassis.position": (0, 3)}
            assert {name: empty[name].shape for name in shapes} == shapes
            assert {
                name: rows.shape for name, rows in empty.rows(0, 3, [*shapes]).items()
            } == shapes
            assert [empty.unit(name) for name in shapes] == ["s", "mixed", "m"]
            assert [empty.matrix(name).shape[1] for name in shapes] == [1, 0, 3]
            assert all(name in empty for name in shapes)


def test_a_run_that_something_else_ended_says_what(model: holonom.Model, tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    count = 0

    def fail(_: object) -> None:
        nonlocal count
        count += 1
        if count > 1:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        model.simulate(end_time=1e4, interval=0.01, max_steps=10**6, output=path, rows=fail)
    with Result.load(path) as result:
        assert result.status == "killed"  # it is taken up as one that was
        assert "RuntimeError: enough" in result.stop_reason["message"]
        assert result.time.size > 1


class _Speechless(Exception):
    def __str__(self) -> str:
        raise ValueError


@pytest.mark.parametrize("error", [RuntimeError("x\udcff"), _Speechless(), FileNotFoundError("y")])
def test_the_error_that_ended_a_run_is_raised_as_it_is(
    model: holonom.Model, tmp_path: Path, error: Exception
) -> None:
    path = tmp_path / "rod.holonom"

    def fail(_: object) -> None:
        raise error

    with pytest.raises(type(error)) as caught:
        model.simulate(end_time=1e3, interval=0.01, output=path, rows=fail)
    assert caught.value is error
    assert not list(tmp_path.glob("rod.holonom-*"))


def test_what_another_run_replaced_meanwhile_is_not_continued(
    model: holonom.Model, older: Path
) -> None:
    seen = Reader.open(older)
    model.simulate(output=older, end_time=1.2).close()
    before = older.read_bytes()
    with pytest.raises(FileError, match="was replaced") as refused:
        Writer(older, {"status": "running"}, model.channels, continues=seen)
    assert refused.value.code == "result/busy"
    assert older.read_bytes() == before
    assert _names(older.parent) == ["rod.holonom"]


def test_a_continuation_that_gets_nowhere_changes_nothing(
    pendulum: Path, older: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = older.read_bytes()
    line = ["run", str(pendulum), "-o", str(older), "--start", str(older), "--end-time", "2"]
    assert invoke([*line, "--max-seconds", "1e-9"]) == 3
    assert older.read_bytes() == before
    assert _names(older.parent) == ["rod.holonom"]


@pytest.mark.parametrize("more", [[], ["--keep"], ["--keep", "--certify"], ["-o", "a.holonom"]])
def test_the_advice_after_ctrl_c_goes_on_from_the_result(
    pendulum: Path,
    tmp_path: Path,
    more: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke(["run", str(pendulum), "--end-time", "0.1"]) == 0
    before = Path("results/rod.holonom").read_bytes()
    plain, long = Writer.append, ["--end-time", "1000", "--interval", "0.05"]

    def append(self: Writer, chunk: dict[str, np.ndarray]) -> None:
        signal.raise_signal(signal.SIGINT)
        plain(self, chunk)

    with monkeypatch.context() as pressed:
        pressed.setattr(Writer, "append", append)
        assert invoke(["run", str(pendulum), *long, *more]) == Exit.INTERRUPTED
    told = re.search(r"`holonom (run .*?)`, with the other .* goes on", capsys.readouterr().err)
    assert told is not None
    assert re.findall("`(--.*?)`", told[0]) == sorted({"--certify", "--keep"} & {*more})
    line = [*shlex.split(told[1]), *long]
    path = Path(line[line.index("--start") + 1])
    with Result.load(path) as stopped:
        assert (stopped.status, stopped.time[-1] < 1000.0) == ("interrupted", True)
    assert invoke(line) == 0
    # It is taken up bit for bit, as one run, and that is what is said.
    assert re.search(rf"^continues +{path} of", capsys.readouterr().out, re.MULTILINE)
    with Result.load(path) as result:
        assert (result.status, result.time[-1]) == ("completed", 1000.0)
        assert "parts" not in result.meta
    assert (Path("results/rod.holonom").read_bytes() == before) is bool(more)
    assert not Path("results/rod-3.holonom").exists()


@pytest.mark.parametrize("time", ["nan", "inf", "-inf"])
def test_a_state_at_no_time_is_refused(
    pendulum: Path, older: Path, time: str, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["run", str(pendulum), "--start", str(older), "--at", time]
    assert invoke(line) == 1
    assert "finite" in capsys.readouterr().err
    with Result.load(older) as result:
        with pytest.raises(UsageError, match="finite"):
            result.state(float(time))
        with pytest.raises(UsageError, match="finite"):
            result.sample([0.1, float(time)])


def test_an_interrupted_run_is_continued_to_the_rows_of_a_run_from_its_last_state(
    pendulum: Path, model: holonom.Model, tmp_path: Path
) -> None:
    path = tmp_path / "rod.holonom"
    process = _endless(pendulum, path)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    with Result.load(path) as killed:
        assert killed.status == "killed"
        rows, state = killed["q"].copy(), killed.state()
    end = float(state["time"][0]) + 0.5
    expected = model.simulate(start=state, end_time=end, interval=0.02)
    with model.simulate(start=state, end_time=end, interval=0.02, output=path) as whole:
        assert whole["q"].tobytes() == np.concatenate([rows, expected["q"][1:]]).tobytes()
