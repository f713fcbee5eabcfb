"""States at any time of a run, from memory and from files."""

from __future__ import annotations

import csv
import json
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from conftest import PENDULUM
from older_results import write_older

import holonom
from holonom.base.errors import UsageError
from holonom.cli.commands import invoke
from holonom.result import Result

#: A wheel turning freely at 40 rad/s, with a rod that swings on its axle.
WHEEL = """
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies.wheel]
mass = 2.0
inertia = [[0.1, 0.0, 0.0], [0.0, 0.06, 0.0], [0.0, 0.0, 0.06]]
position = [0.0, 0.0, 0.0]
[bodies.rod]
mass = 1.0
inertia = [[0.01, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.05]]
position = [0.2, 0.3, 0.0]
[joints]
bearing = { type = "revolute", between = ["ground", "wheel"], point = [0.0, 0.0, 0.0], axis = [1, 0, 0] }
hinge = { type = "revolute", between = ["ground", "rod"], point = [0.2, 0.0, 0.0], axis = [1, 0, 0] }
[initial.bodies]
wheel = { angular_velocity = [40.0, 0.0, 0.0] }
[outputs]
channels = ["rod.position"]
interval = 0.5
[simulation]
end_time = 2.0
tolerance = 1.0e-5
"""  # noqa: E501

TIMES = [1.9017, 0.0, 0.3331, 2.0, 0.7123]


@pytest.fixture
def wheel() -> holonom.Model:
    return holonom.Model.from_text(WHEEL)


def test_states_between_rows_are_those_of_a_run_with_rows_there(wheel: holonom.Model) -> None:
    result = wheel.simulate()
    assert result.span == (0.0, 2.0)
    there = wheel.simulate(output_times=sorted(TIMES))
    np.testing.assert_array_equal(there.steps["t"], result.steps["t"])
    for row, time in enumerate(sorted(TIMES)):
        state = result.state(time)
        assert state["time"] == [time]
        for name, part in state.items():
            np.testing.assert_allclose(part, there[name][row].reshape(-1), rtol=0, atol=1e-11)


def test_an_output_time_is_its_row(wheel: holonom.Model) -> None:
    result = wheel.simulate()
    np.testing.assert_array_equal(result.state(0.5)["qdd"], result["qdd"][1])
    np.testing.assert_array_equal(result.state()["q"], result["q"][-1])


def test_channels_at_any_time_in_any_order(wheel: holonom.Model) -> None:
    result = wheel.simulate()
    found = result.sample(
        TIMES, ["bearing.angle", "rod.position", "rod.position[2]", "hinge.*", "q"]
    )
    assert list(found)[:5] == ["time", "q", "bearing.angle", "rod.position", "rod.position[2]"]
    np.testing.assert_array_equal(found["time"], TIMES)
    # Independent truth: a free wheel turns evenly, over 12 turns.
    np.testing.assert_allclose(found["bearing.angle"], 40.0 * np.array(TIMES), atol=1e-10)
    np.testing.assert_array_equal(found["rod.position"][:, 2], found["rod.position[2]"])
    # The rod is 0.3 m long.
    np.testing.assert_allclose(np.hypot(*found["rod.position"][:, 1:].T), 0.3, atol=1e-13)
    np.testing.assert_array_equal(result.sample(TIMES, ["time"])["time"], TIMES)
    at_rows = result.sample(result.time)
    assert list(at_rows) == ["time", *result.channels]
    for name in result.channels:
        np.testing.assert_allclose(at_rows[name], result[name], rtol=0, atol=1e-11)


def test_no_times_and_one_time(wheel: holonom.Model) -> None:
    result = wheel.simulate()
    assert result.sample([], ["rod.position", "rod.position[1]"])["rod.position"].shape == (0, 3)
    assert result.sample(0.7, ["rod.position"])["rod.position"].shape == (1, 3)


@pytest.mark.parametrize("method", ["ForRadau", "DEABM", "DOPRI5"])
@pytest.mark.parametrize("parametrization", ["tree", "partitioning", "tangent_plane"])
def test_a_file_says_the_same_in_another_process(
    wheel: holonom.Model, tmp_path: Path, method: str, parametrization: str
) -> None:
    path = tmp_path / "wheel.holonom"
    with wheel.simulate(
        output=path, method=method, parametrization=parametrization, dense_output=True
    ) as result:
        here = result.sample(TIMES, ["q", "qdd", "bearing.force", "bearing.angle"])
    program = (
        "import sys, json; from holonom import Result; result = Result.load(sys.argv[1]); "
        "found = result.sample(json.loads(sys.argv[2]), json.loads(sys.argv[3])); "
        "print(json.dumps({k: v.tolist() for k, v in found.items()}))"
    )
    arguments = [json.dumps(TIMES), json.dumps([name for name in here if name != "time"])]
    text = subprocess.run(
        [sys.executable, "-c", program, str(path), *arguments],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    for name, values in json.loads(text).items():
        np.testing.assert_array_equal(values, here[name])


def test_a_run_goes_on_from_inside_a_step(wheel: holonom.Model) -> None:
    whole = wheel.simulate()
    steps = whole.steps
    longest = int(np.argmax(steps["h"]))
    time = float(steps["t"][longest] + 0.4 * steps["h"][longest])
    rest = wheel.simulate(start=whole.state(time))
    error = np.abs(rest["rod.position"][-1] - whole["rod.position"][-1]).max()
    assert error < 10 * 1e-5
    assert abs(rest["bearing.angle"][-1] - 80.0) < 1e-9


def test_what_the_run_does_not_cover_is_refused(wheel: holonom.Model) -> None:
    result = wheel.simulate()
    for time in (-0.1, 2.1):
        with pytest.raises(UsageError, match=r"the run covers 0\.0 s to 2\.0 s"):
            result.state(time)
    for time in (float("nan"), float("inf"), float("-inf")):
        with pytest.raises(UsageError, match="finite"):
            result.state(time)
    with pytest.raises(UsageError, match="did you mean `rod"):
        result.sample([0.1], ["rod.positon"])
    with pytest.raises(UsageError, match="a vector"):
        result.sample([[0.1]])


@pytest.mark.parametrize(
    ("method", "asked", "stored"),
    [
        ("ForRadau", None, True),
        ("ForRadau", False, False),
        ("DEABM", None, False),
        ("DEABM", True, True),
    ],
)
def test_implicit_codes_store_their_steps_unless_told_otherwise(
    wheel: holonom.Model, method: str, asked: bool | None, stored: bool
) -> None:
    result = wheel.simulate(method=method, dense_output=asked)
    assert (result.span is not None) == stored
    if stored:
        assert result.state(0.7)["time"] == 0.7
    else:
        assert result.state(0.5)["time"] == 0.5
        np.testing.assert_array_equal(
            result.sample([0.5])["rod.position"][0], result["rod.position"][1]
        )
        with pytest.raises(UsageError, match=r"(?s)nearest one is at 0\.5 s.*dense_output = true"):
            result.state(0.7)


def test_the_model_file_can_say_it_and_the_call_wins() -> None:
    model = holonom.Model.from_text(PENDULUM + "dense_output = false\n")
    assert model.simulate().span is None
    assert model.simulate(dense_output=True).span == (0.0, 1.0)
    with pytest.raises(UsageError, match="True or False"):
        model.simulate(dense_output=1)


def test_a_file_of_the_format_before_has_states_at_output_times(
    wheel: holonom.Model, tmp_path: Path
) -> None:
    path = tmp_path / "wheel.holonom"
    write_older(wheel.simulate().save(tmp_path / "new.holonom"), path, 1)
    with Result.load(path) as result:
        assert result.span is None
        np.testing.assert_array_equal(result.state(0.5)["q"], result["q"][1])
        with pytest.raises(UsageError, match="nearest one is at 0"):
            result.state(0.6)
        result.save(tmp_path / "copy.holonom")
    with Result.load(tmp_path / "copy.holonom") as copy:
        assert copy.time.size == 5


def test_a_damaged_file_is_no_wrong_state(wheel: holonom.Model, tmp_path: Path) -> None:
    path = tmp_path / "wheel.holonom"
    wheel.simulate(output=path).close()
    with closing(sqlite3.connect(path)) as db:
        db.execute("UPDATE dense SET w = substr(w, 9)")
        db.commit()
    with Result.load(path) as result, pytest.raises(holonom.FileError) as refused:
        result.state(0.7)
    assert refused.value.code == "result/damaged"


_KILLED = """
import os, signal, sys
import holonom

def progress(time, step_size, steps):
    if time > 30.0:
        os.kill(os.getpid(), signal.SIGKILL)

model = holonom.Model.load(sys.argv[1])
model.simulate(end_time=1e5, interval=0.02, output=sys.argv[2], progress=progress)
"""


def test_a_killed_run_knows_every_state_that_it_stored(pendulum: Path, tmp_path: Path) -> None:
    path = tmp_path / "killed.holonom"
    process = subprocess.run([sys.executable, "-c", _KILLED, str(pendulum), str(path)], check=False)
    assert process.returncode == -signal.SIGKILL
    with Result.load(path) as result:
        assert result.status == "killed"
        assert result.span is not None
        first, last = result.span
        assert first == 0.0
        assert last > 20.0
        # A step is stored no later than the rows in it.
        assert last - 1.0 < result.time[-1] <= last
        times = np.linspace(first, last, 50)
        # As far as the same run comes in a few steps more: its end takes part in its steps.
        taken = len(result.steps["t"])
        again = {"end_time": 1e5, "max_steps": 2 * taken, "output_times": times}
        with pytest.raises(holonom.SimulationError) as stopped:
            result.model.simulate(**again)
        there = stopped.value.result
        assert there is not None
        found = result.sample(times, ["rod.position"])["rod.position"]
        np.testing.assert_allclose(found, there["rod.position"][:50], rtol=0, atol=1e-12)


def test_a_model_with_other_values_is_read_back_along_its_forest(tmp_path: Path) -> None:
    def spring(side: float, stiffness: float) -> str:
        return (
            f'{{ type = "bushing", between = ["ground", "a"], point = [{side}, 0.0, 0.0], '
            f"stiffness = [{stiffness}, {stiffness}, {stiffness}], "
            "rotational_stiffness = [10.0, 10.0, 10.0] }"
        )

    model = holonom.Model.from_text(
        f"""
holonom = 1
dimension = "spatial"
[bodies.a]
mass = 1.0
inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
position = [1.0, 0.0, 0.0]
[forces]
left = {spring(0.5, 400.0)}
right = {spring(1.5, 50.0)}
[initial.bodies]
a = {{ velocity = [0.1, 0.2, 0.3], angular_velocity = [0.5, 0.2, 0.1] }}
[simulation]
end_time = 1.0
"""
    )
    softer = model.with_values({"forces.left.stiffness": [5.0, 5.0, 5.0]})
    times = [0.1234, 0.777]
    path = tmp_path / "softer.holonom"
    softer.simulate(output=path).close()
    there = softer.simulate(output_times=times)
    with Result.load(path) as result:
        found = result.sample(times, ["a.position"])["a.position"]
    np.testing.assert_allclose(found, there["a.position"], rtol=0, atol=1e-12)


def _table(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_the_command_exports_rows_at_other_times(wheel: holonom.Model, tmp_path: Path) -> None:
    path = tmp_path / "wheel.holonom"
    with wheel.simulate(output=path) as result:
        expected = result.sample([0.25, 0.75], ["bearing.angle", "rod.position[2]"])
    table = tmp_path / "table.csv"
    names = ["bearing.angle", "rod.position[2]"]
    assert invoke(["export", str(path), *names, "--times", "0.25,0.75", "-o", str(table)]) == 0
    head, *rows = _table(table)
    assert head == ["time (s)", "bearing.angle (rad)", "rod.position[2] (m)"]
    np.testing.assert_array_equal(
        np.array(rows, dtype=float), np.column_stack([expected[name] for name in expected])
    )
    assert invoke(["export", str(path), "--interval", "0.3", "-o", str(table)]) == 0
    times = [float(row[0]) for row in _table(table)[1:]]
    np.testing.assert_allclose(times, [*(0.3 * np.arange(7)), 2.0], atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--interval", "0.1", "--times", "0.1"], "both `"),
        (["--times", "0.1,b"], "numbers with commas"),
        (["--times", "0.2,0.1"], "do not rise"),
        (["--times", "3.0"], "covers"),
        (["--interval", "0"], "positive"),
    ],
)
def test_rows_that_make_no_sense_are_refused(
    wheel: holonom.Model,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    said: str,
) -> None:
    path = tmp_path / "wheel.holonom"
    wheel.simulate(output=path).close()
    assert invoke(["export", str(path), *arguments]) == 1
    assert said in capsys.readouterr().err
    assert not path.with_suffix(".csv").exists()


def test_a_run_that_was_killed_before_its_first_row_has_states(
    wheel: holonom.Model, tmp_path: Path
) -> None:
    path = tmp_path / "older.holonom"  # of format 2, where nothing counts what there is
    write_older(wheel.simulate().save(tmp_path / "whole.holonom"), path, 2)
    with closing(sqlite3.connect(path)) as file, file:
        for table in ("data", "chunk", "quantity"):
            file.execute(f"DELETE FROM {table}")
    result = holonom.Result.load(path)
    assert result.time.size == 0
    assert result.span == (0.0, 2.0)
    with pytest.raises(UsageError, match="nothing was stored"):
        result.state()
    whole = wheel.simulate()
    for name, values in result.state(1.234).items():
        np.testing.assert_array_equal(values, whole.state(1.234)[name])
    with pytest.raises(UsageError, match=r"the run covers 0\.0 s to 2\.0 s\n"):
        result.state(2.1)
