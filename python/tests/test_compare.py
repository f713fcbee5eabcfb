"""Comparisons of methods on known motions."""

from __future__ import annotations

import csv
import errno
import json
import multiprocessing
import os
import pty
import signal
import statistics
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import MODELS, OSCILLATOR, displacement

import holonom
from holonom import Comparison
from holonom.base import files
from holonom.cli.commands import invoke
from holonom.study.accuracy import targets
from holonom.study.plan import codes

#: A body that turns freely about its vertical axis, at 5 rad/s: past π after 0.63 s.
TOP = """
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.top]
mass = 1.0
inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]]
position = [0.0, 0.0, 0.0]
[initial.bodies]
top = { angular_velocity = [0.0, 0.0, 5.0] }
[simulation]
end_time = 2.0
"""


@pytest.fixture
def model_file(tmp_path: Path) -> Path:
    path = tmp_path / "block.toml"
    path.write_text(OSCILLATOR)
    return path


def read_csv(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_errors_are_those_against_the_exact_motion(oscillator: holonom.Model) -> None:
    comparison = holonom.compare(
        oscillator,
        methods=["ForSDIRK", "DEABM"],
        tolerances=[1e-3, 1e-5],
        channels=["block.position[0]"],
        repeat=1,
    )
    assert [(row.method, row.tolerance.relative) for row in comparison.rows] == [
        ("ForSDIRK", 1e-3), ("ForSDIRK", 1e-5), ("DEABM", 1e-3), ("DEABM", 1e-5),
    ]  # fmt: skip
    times = np.linspace(0.0, 1.0, 201)
    for row in comparison.rows:
        run = oscillator.simulate(
            method=row.method, tolerance=row.tolerance, output_times=times, channels=[]
        )
        exact = displacement(times)
        delta = np.abs(run["block.position"][:, 0] - exact)
        (error,) = row.errors
        assert error.delta == pytest.approx(delta.max(), rel=0.01)
        assert row.error_of("position") == error.delta
        scale = row.tolerance.relative * (1.0 + np.abs(exact))
        assert row.measure == pytest.approx((delta / scale).max(), rel=0.01)
        for name in ("steps", "rejected", "evaluations", "jacobians", "factorizations"):
            assert row.counts[name] == run.statistics[name], name
        assert sum(row.rejections().values()) == row.counts["rejected"]
        assert row.status == "completed"


def test_the_default_compares_all_implicit_codes_on_all_bodies() -> None:
    comparison = holonom.compare(MODELS / "double_pendulum" / "model.toml", repeat=1)
    implicit = [m["name"] for m in holonom.methods() if m["family"] != "explicit"]
    assert comparison.methods == implicit
    assert {row.tolerance.relative for row in comparison.rows} == {1e-2, 1e-3, 1e-4, 1e-5}
    bodies = ("upper", "lower")
    names = [
        f"{body}.{what}" for body in bodies for what in ("position[0]", "position[1]", "angle")
    ]
    assert list(comparison.channels) == names
    assert (comparison.n_times, comparison.end_time) == (201, 2.0)
    for slope in comparison.slopes().values():
        assert 0.5 < slope < 1.5
    for row in comparison.rows:
        assert row.cpu_seconds is not None
        assert row.measure is not None


def test_slopes_are_those_of_the_log_log_fit(oscillator: holonom.Model) -> None:
    comparison = holonom.compare(oscillator, methods=["ForSDIRK"], repeat=0)
    points = [(row.tolerance.relative, comparison.error(row)) for row in comparison.rows]
    fit = np.polyfit(*np.log10(np.array(points, dtype=float).T), 1)
    assert comparison.slopes()["ForSDIRK"] == pytest.approx(fit[0])


def test_angles_of_spatial_models_are_compared_without_whole_turns() -> None:
    model = holonom.Model.from_text(TOP, name="top")
    # Exact: the yaw is 5 t, told as a principal value; codes may jump at different output times.
    comparison = holonom.compare(
        model, methods=["ForSDIRK", "DOPRI5"], tolerances=[1e-4], repeat=0,
        channels=["top.yaw_pitch_roll", "positions"],
    )  # fmt: skip
    names = ["top.yaw_pitch_roll[0]", "top.yaw_pitch_roll[1]", "top.yaw_pitch_roll[2]"]
    names += ["top.position[0]", "top.position[1]", "top.position[2]", "top.euler_parameters"]
    assert list(comparison.channels) == names
    for row in comparison.rows:
        assert row.error_of("position") < 0.1
        run = model.simulate(
            method=row.method, tolerance=1e-4, output_times=np.linspace(0.0, 2.0, 201)
        )
        p, half = run["top.euler_parameters"], 2.5 * run.time
        off = 2.0 * np.hypot(p[:, 0] - np.cos(half), p[:, 3] - np.sin(half))
        assert row.errors[-1].delta == pytest.approx(off.max(), rel=0.01, abs=1e-9)
        assert row.errors[0].delta == pytest.approx(off.max(), rel=0.01, abs=1e-9)


def test_sets_of_channels_hold_every_body() -> None:
    model = holonom.Model.load(MODELS / "hmmwv14" / "model.toml")
    found = targets(model, ["positions", "velocities"])
    assert len(found) == 14 * (3 + 1 + 3 + 3)
    assert {target.unit for target in found} == {"m", "rad", "m/s", "rad/s"}
    assert {target.kind for target in found} == {"position", "velocity"}


def test_a_deformation_is_compared_as_lengths_and_angles() -> None:
    model = holonom.Model.load(MODELS / "hmmwv14_bushing" / "model.toml")
    name = "bushing_front_right.deformation"
    found = targets(model, [name])
    assert [(target.name, target.unit, target.kind) for target in found] == [
        (f"{name}[{i}]", "m" if i < 3 else "rad", "position") for i in range(6)
    ]
    assert targets(model, [f"{name}[4]"]) == found[4:5]


def test_runs_that_fail_are_rows_with_their_code(model_file: Path, tmp_path: Path) -> None:
    comparison = holonom.compare(
        model_file,
        methods=["ForSDIRK", {"method": "DEABM", "max_steps": 20},
                 {"method": "ForRosen", "jacobian": "differences"}],
        tolerances=[1e-2],
        repeat=2,
    )  # fmt: skip
    good, limited, refused = comparison.rows
    assert (good.status, good.code) == ("completed", "")
    assert (limited.status, limited.code) == ("limit", "simulation/max-steps")
    assert limited.method == "DEABM max_steps=20"
    assert limited.counts["steps"] + limited.counts["rejected"] >= 20
    assert (refused.status, refused.code) == ("refused", "simulation/option")
    for row in (limited, refused):
        assert (row.measure, row.errors, row.cpu_samples) == (None, (), ())
    text = str(comparison)
    assert "simulation/max-steps" in text
    assert "ForRosen jacobian=differences at 1e-02 refused" in text
    assert list(comparison.slopes()) == []
    # The command says so by its status: 4 when some failed, 3 when all did.
    line = ["compare", str(model_file), "--repeat", "0", "-q", "--tolerance", "1e-2"]
    assert invoke([*line, "--method", "ForSDIRK,DEABM,max_steps=20"]) == 4
    assert invoke([*line, "--method", "DEABM", "--max-steps", "20"]) == 3


def test_times_are_medians_of_runs_taken_singly(
    oscillator: holonom.Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The timed runs happen in this process, when no worker is left."""
    from holonom.study import runs

    alive: list[int] = []
    original = holonom.Model.simulate

    def simulate(self: holonom.Model, **choices: Any) -> holonom.Result:
        alive.append(len(multiprocessing.active_children()))
        return original(self, **choices)

    monkeypatch.setattr(holonom.Model, "simulate", simulate)
    assert runs.Model is holonom.Model
    comparison = holonom.compare(
        oscillator, methods=["ForSDIRK", "DEABM"], tolerances=[1e-3, 1e-4], repeat=3, processes=2
    )
    assert alive == [0] * 12  # 4 pairs, 3 times; the runs for the errors were elsewhere
    for row in comparison.rows:
        assert len(row.cpu_samples) == 3
        assert row.cpu_seconds == statistics.median(row.cpu_samples)


def test_several_processes_find_the_same(oscillator: holonom.Model) -> None:
    start = oscillator.simulate(tolerance=1e-6, interval=0.1).state(0.3)
    choices: dict[str, Any] = {
        "methods": ["ForSDIRK", "ForRosen"], "tolerances": [1e-2, 1e-5], "repeat": 0,
        "start": start, "channels": ["positions", "spring.force"],
    }  # fmt: skip
    alone = holonom.compare(oscillator, **choices)
    together = holonom.compare(oscillator, **choices, processes=3)
    assert alone.start_time == pytest.approx(0.3)
    assert together == alone  # rows, errors, counts, reference


def test_progress_counts_runs_up_to_their_total(oscillator: holonom.Model) -> None:
    for processes, total in ((1, 2 + 2 * 3), (2, 2 + 2 * 4)):
        seen: list[tuple[float, int, str]] = []
        holonom.compare(
            oscillator, methods=["ForSDIRK", "DEABM"], tolerances=[1e-3], repeat=3,
            processes=processes, progress=lambda *said: seen.append(said),  # noqa: B023
        )  # fmt: skip
        assert {said[1] for said in seen} == {total}
        done = [said[0] for said in seen]
        assert done == sorted(done)
        assert total - 1 <= done[-1] <= total


@pytest.mark.parametrize("processes", [1, 2])
def test_ctrl_c_keeps_the_rows_that_were_finished(
    oscillator: holonom.Model, processes: int
) -> None:
    reference = oscillator.simulate(tolerance=1e-4, end_time=500.0, interval=5.0)
    asked = 0.0

    def progress(done: float, total: int, text: str) -> None:
        nonlocal asked
        # Once the quick row is there, and the endless one is under way.
        if done >= 1.0 and not asked and (text.startswith("ForRosen") or text.endswith("done")):
            asked = time.monotonic()
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(holonom.ComparisonInterrupted) as caught:
        holonom.compare(
            oscillator,
            methods=["DEABM", {"method": "ForRosen", "fixed_step": 1e-6}],  # 500 million steps
            tolerances=[1e-2],
            reference=reference,
            end_time=500.0,
            repeat=1,
            processes=processes,
            progress=progress,
        )
    assert time.monotonic() - asked < 5.0
    assert isinstance(caught.value, KeyboardInterrupt)
    comparison = caught.value.comparison
    assert comparison.interrupted
    assert [row.method for row in comparison.rows] == ["DEABM"]
    assert comparison.rows[0].measure is not None
    assert not multiprocessing.active_children()


def test_the_command_shows_progress_and_ends_with_130(model_file: Path, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    arguments = ["--method", "DEABM,ForRosen,fixed_step=1e-6", "--tolerance", "1e-2"]
    table = tmp_path / "rows.csv"
    process = subprocess.Popen(
        [sys.executable, "-m", "holonom", "compare", str(model_file), *arguments,
         "--end-time", "500", "--repeat", "1", "--reference-tolerance", "1e-3",
         "--csv", str(table)],
        stderr=theirs,
        stdout=subprocess.PIPE,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "160"},
    )  # fmt: skip
    os.close(theirs)
    shown = b""
    deadline = time.monotonic() + 60.0
    while b"ForRosen" not in shown and time.monotonic() < deadline:
        shown += os.read(ours, 4096)
    assert b"/ 4 runs" in shown
    process.send_signal(signal.SIGINT)
    while True:  # a terminal that nobody reads would stop the process
        try:
            if not os.read(ours, 4096):
                break
        except OSError:
            break
    out, _ = process.communicate(timeout=30)
    os.close(ours)
    assert process.returncode == 130
    assert b"DEABM" in out
    assert [row["method"] for row in read_csv(table)] == ["DEABM"]


# What is written


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return holonom.compare(
        holonom.Model.from_text(OSCILLATOR, name="block"),
        methods=["ForSDIRK", "ForRosen"],
        tolerances=[1e-2, 1e-4, {"relative": 1e-5, "rotation": 1e-7}],
        channels=["positions", "velocities", "spring.force"],
        repeat=1,
    )


def test_the_table_has_a_line_per_row_and_no_colour(compared: Comparison) -> None:
    lines = str(compared).splitlines()
    assert "6 scalars" not in lines[0]
    assert "7 scalars at 201 times" in lines[0]
    assert "differs from it by" in lines[1]
    assert sum(line.strip().startswith(("ForSDIRK ", "ForRosen ")) for line in lines) == 6
    assert "\x1b" not in str(compared)
    for row in compared.rows:
        assert any(str(row.counts["evaluations"]) in line.split() for line in lines)


def test_csv_and_json_hold_the_same_rows(compared: Comparison, tmp_path: Path) -> None:
    data = json.loads(json.dumps(compared.to_json()))
    table = read_csv(compared.to_csv(tmp_path / "new" / "t.csv"))
    assert len(data["rows"]) == len(table) == 6
    for row, line, entry in zip(compared.rows, table, data["rows"], strict=True):
        assert line["method"] == entry["method"] == row.method
        assert float(line["measure"]) == entry["measure"] == row.measure
        assert float(line["velocity_measure"]) == row.measure_of("velocity")
        assert int(line["jacobians"]) == entry["jacobians"] == row.counts["jacobians"]
        assert float(line["cpu_seconds"]) == entry["cpu_seconds"] == row.cpu_seconds
        assert float(line["rotation_tolerance"]) == row.tolerance.rotation
        assert len(entry["errors"]) == 7
    errors = read_csv(compared.errors_to_csv(tmp_path / "e.csv"))
    assert len(errors) == 6 * 7
    assert float(errors[8]["delta"]) == compared.rows[1].errors[1].delta
    forces = [line for line in errors if line["name"] == "spring.force"]
    assert {line["kind"] for line in forces} == {"other"}


def test_the_diagram_has_a_line_of_points_per_method(compared: Comparison, tmp_path: Path) -> None:
    picture = compared.plot(tmp_path / "work.svg")
    (panel,) = picture.panels
    assert picture.logarithmic
    assert panel.logarithmic
    for method, line in zip(("ForSDIRK", "ForRosen"), panel.lines, strict=False):
        rows = compared.of(method)
        assert line.label == method
        np.testing.assert_array_equal(line.x, [row.cpu_seconds for row in rows])
        np.testing.assert_array_equal(line.y, [compared.error(row) for row in rows])
    assert ET.parse(tmp_path / "work.svg").getroot().tag.endswith("svg")


def test_without_times_there_is_nothing_to_draw(oscillator: holonom.Model) -> None:
    comparison = holonom.compare(oscillator, methods=["DEABM"], tolerances=[1e-3], repeat=0)
    with pytest.raises(holonom.UsageError, match="timed"):
        comparison.plot()


@pytest.mark.parametrize("ending", ["svg", "png"])
def test_an_error_of_exactly_zero_is_an_error(tmp_path: Path, ending: str) -> None:
    text = OSCILLATOR.replace("free_length = 0.9", "free_length = 1.0")  # at rest
    rest = holonom.compare(
        holonom.Model.from_text(text), methods=["ForRadau"], tolerances=[1e-3], repeat=1
    )
    assert rest.rows[0].measure == 0.0
    assert "error" in str(rest)
    assert "0.0e+00" in str(rest)
    picture = rest.plot(tmp_path / f"rest.{ending}")
    (panel,) = picture.panels
    assert not panel.lines
    assert "exactly zero" in panel.empty
    if ending == "svg":
        assert "exactly zero" in (tmp_path / "rest.svg").read_text(encoding="utf-8")


def test_the_command_writes_table_picture_and_json(
    model_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["compare", str(model_file), "--method", "ForSDIRK,ForRosen", "--tolerance", "1e-2,1e-3"]
    line += ["--tolerance", "relative=1e-4,rotation=1e-5", "--repeat", "1", "-j", "2"]
    files = {"--csv": tmp_path / "t.csv", "--errors": tmp_path / "e.csv"}
    files["--plot"] = tmp_path / "p.svg"
    line += [word for flag, path in files.items() for word in (flag, str(path))]
    assert invoke([*line, "--channels", "block.position[0],velocities"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "average error" in said.out  # the analysis of the channels asked for
    assert all(path.stat().st_size > 100 for path in files.values())
    assert invoke([*line, "--json", "--set", "bodies.block.mass=2"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert len(data["rows"]) == 6
    assert data["rows"][2]["tolerance"] == {
        "relative": 1e-4, "translation": 1e-4, "rotation": 1e-5,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"methods": ["ForSDIRC"]}, "did you mean `ForSDIRK`"),
        ({"methods": [{"method": "first_order", "formula": "adams"}]}, "first_order with"),
        ({"methods": ["second_order"]}, "known are ForSDIRK"),
        ({"methods": [{"method": "first_order", "formula": "ForRadau"}]}, "first_order with"),
        ({"methods": "ForSDIRK"}, "pass a list"),
        ({"methods": []}, "at least one method"),
        ({"methods": [{"method": "ForSDIRK", "jacobi": "x"}]}, "did you mean `jacobian`"),
        *(
            ({"methods": [{"method": "ForSDIRK", name: value}]}, f"no `{name}`")
            for name, value in {
                "tolerance": 1e-3,
                "channels": ["*"],
                "start_time": 0.5,
                "end_time": 3.0,
                "interval": 0.1,
                "output_times": [1.0],
            }.items()
        ),
        ({"tolerances": []}, "at least one method"),
        ({"tolerances": [-1.0]}, "positive"),
        ({"tolerance": 1e-3}, "give `tolerances`"),
        ({"channels": ["block.positon"]}, r"block\.position"),
        ({"channels": "positions"}, "pass a list"),
        ({"channels": []}, "at least one channel"),
        ({"repeat": -1}, "`repeat` is -1"),
        ({"processes": 0}, "`processes` is 0"),
        ({"end_time": 0.0}, "after the start"),
        ({"output_times": [0.0, 2.0], "end_time": 1.0}, "between 0.0 s and 1.0 s"),
        ({"interval": 0.1, "output_times": [0.0, 1.0]}, "both `"),
        ({"max_step": -1.0}, "max_step"),
        ({"reference": "REFERENCE", "reference_tolerance": 1e-3}, "made on the spot"),
    ],
)
def test_what_cannot_be_compared_is_refused_before_anything_runs(
    oscillator: holonom.Model, choices: dict[str, Any], said: str
) -> None:
    with pytest.raises(holonom.UsageError, match=said):
        holonom.compare(oscillator, progress=lambda *_: pytest.fail("it ran"), **choices)


def test_a_table_that_cannot_be_written_is_shown(
    model_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line = ["compare", str(model_file), "--method", "DEABM", "--tolerance", "1e-2"]
    # What can be known is refused before the runs.
    assert invoke([*line, "--csv", str(model_file / "t.csv")]) == 5
    assert not capsys.readouterr().out

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files, "put_in_place", full)
    assert invoke([*line, "--csv", str(tmp_path / "t.csv")]) == 5
    said = capsys.readouterr()
    assert "DEABM" in said.out
    assert "t.csv" in said.err


def test_a_method_means_what_it_means_in_a_run(oscillator: holonom.Model) -> None:
    asked = ["first_order", "forradau", {"method": "state_space", "formula": "Newmark"}]
    assert list(codes(asked)) == ["ForSDIRK", "ForRadau", "SspTrap"]
    run = oscillator.simulate(method="first_order", end_time=0.1)
    assert run.options["method"] == "ForSDIRK"


def test_a_family_with_its_formula_is_the_code(oscillator: holonom.Model) -> None:
    known = next(m for m in holonom.methods() if m["name"] == "ForSDIRK")
    pair = {"method": known["family"], "formula": known["formula"]}
    comparison = holonom.compare(oscillator, methods=[pair], tolerances=[1e-2], repeat=0)
    assert comparison.methods == ["ForSDIRK"]


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--method", "jacobian=differences"], 1, "no code before"),
        (["--tolerance", "1e-3,small"], 1, "--tolerance small"),
        (["--reference-tolerance", "small"], 1, "--reference-tolerance small"),
        (["--reference", "absent.holonom"], 5, "absent.holonom"),
        (["--plot", "picture.txt", "--method", "DEABM", "--tolerance", "1e-2"], 1, ".svg"),
    ],
)
def test_command_lines_that_cannot_be_used_say_why(
    model_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], status: int, said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(model_file.parent)
    assert invoke(["compare", str(model_file), *arguments]) == status
    output = capsys.readouterr()
    assert said in output.err
    assert "Traceback" not in output.err


def test_runs_end_when_a_run_does_whatever_the_output_times(oscillator: holonom.Model) -> None:
    few: dict[str, Any] = {"output_times": [0.0, 0.25, 0.5]}
    comparison = holonom.compare(
        oscillator, methods=["ForRadau"], tolerances=[1e-3], repeat=0, **few
    )
    run = oscillator.simulate(method="ForRadau", tolerance=1e-3, **few)
    assert (comparison.end_time, comparison.n_times) == (run.options["end_time"], 3)
    assert comparison.rows[0].counts["steps"] == run.statistics["steps"]
    endless = holonom.Model.from_text(OSCILLATOR.replace("end_time = 1.0", ""), name="block")
    for call in (endless.simulate, lambda **times: holonom.compare(endless, **times)):
        with pytest.raises(holonom.UsageError, match="no end time"):
            call(**few)


def test_a_start_that_is_no_state_is_refused_before_the_runs(pendulum: Path) -> None:
    with pytest.raises(holonom.UsageError, match="`start` is 3"):
        holonom.compare(pendulum, start=3)  # type: ignore[arg-type]
