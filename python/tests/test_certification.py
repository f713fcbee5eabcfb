"""Certified runs: the error of every channel, measured by a run at a tenth of the tolerance."""

from __future__ import annotations

import json
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import oscillator_text, write_result
from numpy.typing import NDArray

import holonom
from holonom.certificate import BOUND, Certification, ChannelError
from holonom.certification import Measurement
from holonom.cli.commands import invoke
from holonom.report import render
from holonom.result import Result
from holonom.store.reader import Reader
from holonom.store.writer import Writer

HOLONOM = [sys.executable, "-m", "holonom"]
INTERRUPTED = 130
TOLERANCE = 1e-4

#: x = 0.3 cos 5t: without any damping.
OSCILLATOR = (
    oscillator_text(mass=2.0, x=0.3, stiffness=50.0, free_length=1.0)
    + """
[outputs]
channels = ["block.position", "block.velocity", "spring.force"]
interval = 0.05
[simulation]
end_time = 10.0
tolerance = 1.0e-4
"""
)

#: A rod on a ball joint that is thrown round, with a bushing at its end.
TOP = """
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies.rod]
mass = 1.0
inertia = [[0.02, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.06]]
position = [0.5, 0.0, 0.0]
[bodies.tip]
mass = 0.5
inertia = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]]
position = [1.0, 0.0, 0.0]
[joints]
ball = { type = "spherical", between = ["ground", "rod"], point = [0.0, 0.0, 0.0] }
[forces.bushing]
type = "bushing"
between = ["rod", "tip"]
point = [1.0, 0.0, 0.0]
stiffness = [2.0e3, 2.0e3, 2.0e3]
damping = [5.0, 5.0, 5.0]
rotational_stiffness = [50.0, 50.0, 50.0]
[initial.bodies]
rod = { angular_velocity = [0.0, 1.0, 3.0] }
[simulation]
end_time = 1.0
tolerance = { relative = 1.0e-3, translation = 1.0e-4, rotation = 1.0e-5 }
"""
PARTS = {"relative": 1e-3, "translation": 1e-4, "rotation": 1e-5}


@pytest.fixture
def oscillator(tmp_path: Path) -> Path:
    """The model file of the oscillator, in a folder of its own."""
    path = tmp_path / "models" / "oscillator" / "model.toml"
    path.parent.mkdir(parents=True)
    path.write_text(OSCILLATOR, encoding="utf-8")
    return path


def certification(result: Result) -> Certification:
    found = result.certification
    assert found is not None
    return found


def in_tolerances(found: Certification) -> dict[str, float]:
    return {channel.name: channel.tolerances for channel in found.channels}


def stored_rows(path: Path) -> list[list[tuple[Any, ...]]]:
    """Everything that the run itself has written, to the last bit."""
    tables = ("quantity", "chunk", "data", "step", "event")
    db = sqlite3.connect(path)
    rows = [db.execute(f"SELECT * FROM {name} ORDER BY 1, 2").fetchall() for name in tables]
    db.close()
    return rows


@pytest.mark.parametrize(("method", "certified"), [("ForRadau", True), ("ForRosen", False)])
def test_the_measured_error_is_the_true_one(method: str, certified: bool) -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    result = model.simulate(method=method, certify=True)
    # Independent truth: the closed form.
    x, v = 0.3 * np.cos(5.0 * result.time), -1.5 * np.sin(5.0 * result.time)
    true = {
        "block.position": np.abs(result["block.position"][:, 0] - x)
        / (TOLERANCE + TOLERANCE * np.abs(x - 0.3)),
        "block.velocity": np.abs(result["block.velocity"][:, 0] - v)
        / (TOLERANCE + TOLERANCE * np.abs(v)),
        "spring.force": np.abs(result["spring.force"] - 50.0 * x) / (TOLERANCE * 15.0),
    }
    found = certification(result)
    for channel in found.channels:
        # The second run is off, too: by a tenth where the error goes with the tolerance.
        assert channel.tolerances == pytest.approx(true[channel.name].max(), rel=0.2)
        assert channel.tolerances == pytest.approx(channel.error / channel.tolerance)
        moment = int(np.argmin(np.abs(result.time - channel.time)))
        assert true[channel.name][moment] > 0.7 * true[channel.name].max()
    assert [c.name for c in found.channels] == result.requested
    assert found.tolerance == {"relative": 1e-5, "translation": 1e-5, "rotation": 1e-5}
    assert found.statistics["steps"] > result.statistics.steps
    assert found.certified is certified
    assert (max(in_tolerances(found).values()) <= BOUND) is certified
    codes = [warning["code"] for warning in result.warnings]
    assert ("simulation/not-certified" in codes) is not certified


def by_hand(
    first: Result, second: Result, relative: float, translation: float, rotation: float
) -> dict[str, float]:
    """The errors of channels of `TOP` in tolerances, as docs/conventions.md says it."""

    def rows(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return first[name], second[name]

    def length(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.sqrt(np.sum(x**2, axis=1)))

    a, b = rows("rod.position")
    moved = translation + relative * length(b - b[0])
    u, w = rows("rod.velocity")
    p, s = rows("rod.euler_parameters")
    s = np.where(np.sum(p * s, axis=1)[:, None] < 0.0, -s, s)
    turned = rotation + relative * 2.0 * np.arccos(np.minimum(np.abs(s @ s[0]), 1.0))
    f, g = rows("bushing.force")
    force = relative * max(length(f).max(), length(g).max())
    d, e = rows("bushing.deformation")
    stretch = translation + relative * length((e - e[0])[:, :3])
    twist = rotation + relative * length((e - e[0])[:, 3:])
    k, m = rows("energy.total")
    largest = max(np.abs(first[f"energy.{n}"]).max() for n in ("kinetic", "potential", "total"))
    return {
        "rod.position": (length(a - b) / moved).max(),
        "rod.position[2]": (np.abs(a - b)[:, 2] / moved).max(),
        "rod.velocity": (length(u - w) / (translation + relative * length(w))).max(),
        "rod.euler_parameters": (2.0 * length(p - s) / turned).max(),
        "rod.euler_parameters[3]": (np.abs(p - s)[:, 3] / (0.5 * turned)).max(),
        "bushing.force": (length(f - g) / force).max(),
        "bushing.force[0]": (np.abs(f - g)[:, 0] / force).max(),
        "bushing.deformation": max(
            (length((d - e)[:, :3]) / stretch).max(), (length((d - e)[:, 3:]) / twist).max()
        ),
        "bushing.deformation[4]": (np.abs(d - e)[:, 4] / twist).max(),
        "energy.total": (np.abs(k - m) / (relative * largest)).max(),
    }


def test_steps_that_only_turns_limit_are_repeated_by_shorter_ones() -> None:
    # DOP853 takes the same steps at all of these tolerances; truth: a run with steps of a tenth.
    model = holonom.Model.from_text(
        """
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.body]
mass = 1.0
inertia = [[1.343735, 0.0, 0.0], [0.0, 1.464425, 0.0], [0.0, 0.0, 1.700006]]
position = [0.0, 0.0, 0.0]
[initial.bodies.body]
angular_velocity = [4.195e-7, 8.958939, -4.67e-8]
"""
    )
    asked: dict[str, Any] = {"end_time": 40.0, "interval": 0.4, "method": "DOP853"}
    asked["channels"] = ["body.angular_velocity"]
    truth = model.simulate(**asked, tolerance=1e-12, max_step=0.01)["body.angular_velocity"]
    result = model.simulate(**asked, tolerance=1e-5, certify=True)
    off = np.abs(result["body.angular_velocity"] - truth).max()
    assert result.certification is not None
    (channel,) = result.certification.channels
    assert not result.certification.certified
    assert channel.error == pytest.approx(off, rel=0.1)


def test_every_kind_of_channel_has_its_tolerance() -> None:
    model = holonom.Model.from_text(TOP)
    tenth = {name: part / 10.0 for name, part in PARTS.items()}
    choices: dict[str, Any] = {"interval": 0.002, "channels": ["rod.*", "bushing.*", "energy.*"]}
    expected = by_hand(
        model.simulate(**choices), model.simulate(**choices, tolerance=tenth), **PARTS
    )
    found = certification(
        model.simulate(
            certify=True, interval=0.002, channels=[*expected, "constraint.position", "ball.torque"]
        )
    )
    errors = in_tolerances(found)
    assert list(errors) == [*expected, "ball.torque"]  # a residual is an error itself
    assert errors.pop("ball.torque") < 1e-3  # a ball joint has none, but for round-off
    assert errors == pytest.approx(expected, rel=1e-6)
    units = {channel.name: channel.unit for channel in found.channels}
    assert units["rod.euler_parameters"] == "rad"
    assert units["rod.euler_parameters[3]"] == ""
    assert units["bushing.deformation[4]"] == "rad"


def test_without_channels_the_motion_of_all_bodies_is_certified() -> None:
    model = holonom.Model.from_text(TOP)
    found = certification(model.simulate(certify=True, channels=[]))
    quantities = ("position", "euler_parameters", "velocity", "angular_velocity")
    expected = {f"{body}.{quantity}" for body in ("rod", "tip") for quantity in quantities}
    errors = in_tolerances(found)
    assert errors.keys() == expected
    stored = certification(model.simulate(certify=True, channels=sorted(expected)))
    assert errors == pytest.approx(in_tolerances(stored), rel=1e-9)


def test_the_run_does_not_change_by_a_bit(oscillator: Path, tmp_path: Path) -> None:
    model = holonom.Model.load(oscillator)
    plain, certified = tmp_path / "plain.holonom", tmp_path / "certified.holonom"
    model.simulate(output=plain, interval=0.01).close()
    model.simulate(output=certified, interval=0.01, certify=True).close()
    assert stored_rows(certified) == stored_rows(plain)
    with Result.load(plain) as first, Result.load(certified) as second:
        assert first.certification is None
        assert first.time.size > 3 * 256  # several chunks
        assert certification(second).until == second.time[-1]
        differ = {"certification", "started", "finished", "cpu_seconds", "statistics"}
        differ |= {"cpu_seconds_per_simulated_second"}
        for key in first.meta.keys() - differ:
            assert first.meta[key] == second.meta[key], key


def test_chunks_of_other_lengths_are_compared_row_by_row() -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    errors = [
        in_tolerances(certification(model.simulate(certify=True, output_times=times)))
        for times in (
            np.linspace(0.0, 10.0, 2001),  # the start is an output
            np.linspace(0.0, 10.0, 2001)[1:],  # and is not: the movement is the same
        )
    ]
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)


def test_a_run_that_goes_on_from_a_state_is_certified(oscillator: Path, tmp_path: Path) -> None:
    model = holonom.Model.load(oscillator)
    first = tmp_path / "first.holonom"
    model.simulate(output=first, end_time=4.0).close()
    second = tmp_path / "second.holonom"
    command = ["run", str(oscillator), "--certify", "-q", "-o", str(second)]
    assert invoke([*command, "--start", str(first), "--at", "2.0"]) == 0
    with Result.load(first) as start, Result.load(second) as result:
        # Independent truth: the closed form of the motion from the state that was stored.
        (x0, v0), t = (start.state(2.0)["q"][0], start.state(2.0)["qd"][0]), result.time - 2.0
        x = x0 * np.cos(5.0 * t) + v0 / 5.0 * np.sin(5.0 * t)
        bound = TOLERANCE + TOLERANCE * np.abs(x - x0)
        true = (np.abs(result["block.position"][:, 0] - x) / bound).max()
        assert result.time[0] == pytest.approx(2.0)
        errors = in_tolerances(certification(result))
        assert errors["block.position"] == pytest.approx(true, rel=0.2)


def test_summary_json_report_and_file_say_how_far_off_every_channel_is(
    oscillator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "oscillator.holonom"
    command = ["run", str(oscillator), "-o", str(path), "--certify", "--method", "ForRosen"]
    assert invoke(command) == 0
    out = capsys.readouterr().out
    with Result.load(path) as result:
        found = certification(result)
        page = render(result)
        message = result.warnings[-1]["message"]
    worst = found.worst
    assert worst is not None
    figure = f"{worst.tolerances:.3g}"
    assert worst.name == "block.velocity"
    assert f"certified             no: {len(found.exceeding)} of 3 channels not within 10" in out
    assert "[simulation/not-certified]" in out
    for text in (out, page):
        for channel in found.channels:
            assert channel.name in text
            assert f"{channel.tolerances:.3g}" in text
    for wanted in (figure, "`block.velocity`", "m/s at", "tighten the tolerance to 1e-05"):
        assert wanted in message
    assert f"{figure} tolerances" in page
    assert "Measured error" in page
    assert "simulation/not-certified" in page
    assert invoke(["info", str(path)]) == 0
    assert f"{figure} tolerances  block.velocity" in capsys.readouterr().out
    assert invoke([*command, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)["certification"]
    assert facts["certified"] is False
    assert {c["name"]: c["tolerances"] for c in facts["channels"]} == in_tolerances(found)
    assert facts["bound"] == BOUND
    db = sqlite3.connect(path)
    (text,) = db.execute("SELECT value FROM meta WHERE key = 'certification'").fetchone()
    db.close()
    again = Certification.from_json(json.loads(text))
    assert again.channels == found.channels


def test_a_certified_run_says_so(oscillator: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = oscillator.parent / "result.holonom"
    assert invoke(["run", str(oscillator), "-o", str(path), "--certify"]) == 0
    out = capsys.readouterr().out
    assert "certified             yes: 3 channels within 10 tolerances" in out
    assert "warning" not in out
    with Result.load(path) as result:
        assert "Certified: yes" in render(result)


def test_a_repetition_does_not_look_for_what_it_may_be_wrong_about() -> None:
    # A rod that stands nearly upright: whatever is wrong at the start grows a millionfold.
    model = holonom.Model.from_text(
        """
        holonom = 1
        dimension = "planar"
        gravity = [0.0, -9.81]
        [bodies.rod]
        mass = 1.0
        inertia = 0.1
        position = [0.0, 0.5]
        [joints.pin]
        type = "revolute"
        between = ["ground", "rod"]
        point = [0.0, 0.0]
        [initial.bodies.rod]
        angular_velocity = 1e-5
        velocity = [-5e-6, 0.0]
        [simulation]
        end_time = 6.0
        tolerance = 1e-4
        """
    )

    def codes(*, repeats: bool) -> list[str]:
        quiet = [lambda _: None, lambda *_: None, lambda _: None]
        summary = model._core.simulate("{}", None, *quiet, None, repeats)
        return [warning["code"] for warning in summary["warnings"]]

    assert codes(repeats=False) == ["simulation/amplified-error"]
    assert codes(repeats=True) == []


def test_a_second_run_that_fails_leaves_the_result_not_certified() -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    steps = model.simulate().statistics
    limit = steps.steps + steps.rejected + 5  # enough for the first run, not for the second
    result = model.simulate(certify=True, max_steps=limit)
    assert result.status == "completed"
    found = certification(result)
    assert not found.certified
    assert found.reason["code"] == "simulation/max-steps"
    assert "max_steps" in found.reason["help"]  # of that run, beside what the warning advises
    assert found.reason["time"] < 10.0
    assert found.until is not None
    assert 0.0 < found.until <= found.reason["time"]
    assert len(found.channels) == 3  # over what both runs have
    warning = result.warnings[-1]
    assert warning["code"] == "simulation/not-certified"
    for wanted in ("simulation/max-steps", "did not reach its end", f"up to {found.until:.6g} s"):
        assert wanted in warning["message"]
    page = render(result)
    assert "Certified: no" in page
    assert "did not reach its end" in page


def test_a_tolerance_that_has_no_tenth_leaves_the_result_not_certified() -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    result = model.simulate(certify=True, tolerance=5e-13, end_time=0.1)
    found = certification(result)
    assert (found.certified, found.channels, found.until) == (False, (), None)
    assert found.reason["code"] == "simulation/option"
    assert "5e-14" in found.reason["message"]
    assert "certify at a looser tolerance" in result.warnings[-1]["message"]


def test_a_run_of_no_length_is_not_certified() -> None:
    with pytest.raises(holonom.UsageError, match="ends where it starts"):
        holonom.Model.from_text(OSCILLATOR).simulate(end_time=0.0, certify=True)


def test_no_relative_tolerance_to_speak_of_is_certified() -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    parts = {"relative": 1e-13, "translation": 1e-5, "rotation": 1e-5}
    places = {"certify": True, "channels": ["block.position"], "end_time": 0.1}
    found = certification(model.simulate(tolerance=parts, **places))
    assert found.certified
    assert found.tolerance == {"relative": 1e-13, "translation": 1e-6, "rotation": 1e-6}


def test_a_first_run_that_fails_is_not_repeated() -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    result = model.simulate(certify=True, max_steps=10, on_failure="return")
    assert result.status == "limit"
    found = certification(result)
    assert (found.certified, found.channels) == (False, ())
    assert "there was no second run" in found.reason["message"]


@pytest.mark.parametrize("stated", ["call", "model"])
def test_steps_that_no_tolerance_controls_are_refused(stated: str, tmp_path: Path) -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    choices: dict[str, Any] = {"fixed_step": 0.01}
    if stated == "model":
        model, choices = model.with_values({"simulation.fixed_step": 0.01}), {}
    path = tmp_path / "never.holonom"
    with pytest.raises(holonom.UsageError, match="fixed step"):
        model.simulate(certify=True, output=path, **choices)
    assert not path.exists()


def test_progress_is_told_for_both_runs_and_ctrl_c_in_the_second_keeps_the_first(
    tmp_path: Path,
) -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    path = tmp_path / "oscillator.holonom"
    calls: list[tuple[float, int]] = []

    def progress(moment: float, step_size: float, steps: int) -> None:
        calls.append((moment, steps))
        if len(calls) > 1 and steps == 0:
            signal.raise_signal(signal.SIGINT)

    # Long enough for the first run to be told of.
    with pytest.raises(holonom.Interrupted, match="second run") as ended:
        model.simulate(certify=True, tolerance=1e-10, end_time=60.0, output=path, progress=progress)
    assert calls[-1] == (0.0, 0)
    assert calls[-2][0] > 0.0
    assert ended.value.exit_code == INTERRUPTED
    kept = ended.value.result
    assert kept is not None
    kept.close()
    with Result.load(path) as result:
        assert (result.status, result.time[-1]) == ("completed", 60.0)
        assert certification(result).reason["code"] == "simulation/interrupted"
        assert result.warnings[-1]["code"] == "simulation/not-certified"


def test_ctrl_c_on_the_command_line_in_the_second_run_keeps_the_first(
    oscillator: Path, tmp_path: Path
) -> None:
    path = tmp_path / "oscillator.holonom"
    arguments = ["--certify", "--method", "DOPRI5", "--tolerance", "2e-12", "--end-time", "200"]
    process = subprocess.Popen(
        [*HOLONOM, "run", str(oscillator), "-o", str(path), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    _wait_for(path, "completed")
    time.sleep(0.5)  # the second run is under way
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == INTERRUPTED
    assert "the result of the first is whole" in err
    assert "Traceback" not in err
    assert "completed at 200 s" in out
    assert "certified             no: the second run" in out
    with Result.load(path) as result:
        assert result.status == "completed"
        assert result.time[-1] == 200.0
        assert certification(result).reason["code"] == "simulation/interrupted"


def _wait_for(path: Path, status: str) -> None:
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if path.exists():
            db = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
            try:
                found = db.execute("SELECT value FROM meta WHERE key = 'status'").fetchone()
            finally:
                db.close()
            if found and json.loads(found[0]) == status:
                return
        time.sleep(0.01)
    raise AssertionError(f"the run was not {status} within 60 s")


def test_a_part_of_a_stored_quantity_is_that_part_of_the_whole(tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    write_result(path).close()
    reader = Reader.open(path)
    for name in ("time", "q", "z", "rod.position", "energy.kinetic"):
        whole = reader.read(name)
        for first, count in [(0, 1), (0, 200), (49, 2), (30, 100), (150, 50), (190, 50), (200, 5)]:
            part = reader.rows(name, first, count)
            np.testing.assert_array_equal(part, whole[first : first + count])
    reader.close()


def test_figures_of_a_certification_survive_the_file(oscillator: Path, tmp_path: Path) -> None:
    path = tmp_path / "oscillator.holonom"
    memory = holonom.Model.load(oscillator).simulate(certify=True)
    memory.save(path)
    with Result.load(path) as loaded:
        ours, theirs = certification(memory), certification(loaded)
        assert ours == theirs
        assert isinstance(theirs.channels[0], holonom.ChannelError)
        facts: Mapping[str, Any] = theirs.to_json()
        assert facts["certified"] is True
        assert theirs.ranked[0] == theirs.worst


@pytest.mark.parametrize("lost", ["first", "second", "both"])
@pytest.mark.parametrize(
    ("name", "value"),
    [("block.position", np.nan), ("spring.force", np.nan), ("spring.force", np.inf)],
)
def test_a_row_that_is_not_finite_is_never_within_the_bound(
    name: str,
    value: float,
    lost: str,
    monkeypatch: pytest.MonkeyPatch,
    oscillator: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def lose(run: type) -> None:
        append = run.append  # type: ignore[attr-defined]

        def damaged(self: Any, chunk: Mapping[str, Any]) -> None:
            values = chunk.get("channels", {}).get(name, np.zeros(0)).copy()
            values[np.isclose(chunk["time"][: len(values)], 1.5)] = value
            append(self, {**chunk, "channels": {**chunk.get("channels", {}), name: values}})

        monkeypatch.setattr(run, "append", damaged)

    for run in {"first": [Writer], "second": [Measurement], "both": [Writer, Measurement]}[lost]:
        lose(run)
    path = tmp_path / "lost.holonom"
    command = ["run", str(oscillator), "-o", str(path), "--certify", "--json"]
    assert invoke(command) == 0
    facts = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)["certification"]
    with Result.load(path) as result:
        found, page = certification(result), render(result)
        assert "simulation/not-certified" in [warning["code"] for warning in result.warnings]
    assert not found.certified
    assert [c.name for c in found.exceeding] == [name]
    worst = found.worst
    assert worst is not None
    assert (worst.name, worst.error, worst.tolerances) == (name, np.inf, np.inf)
    assert worst.time == pytest.approx(1.5)
    assert 0.0 < worst.tolerance < 1.0  # what is lost has no part in the largest value
    assert all(0.0 < c.tolerances < BOUND for c in found.channels if c != worst)
    (stored,) = [c for c in facts["channels"] if c["name"] == name]
    assert (facts["certified"], stored["error"], stored["tolerances"]) == (False, None, None)
    assert f"`{name}` is inf tolerances off" in page


@pytest.mark.parametrize("tolerances", [-1.0, np.nan])
def test_what_older_files_say_of_rows_with_a_nan_is_not_certified(tolerances: float) -> None:
    channel = holonom.ChannelError("block.position", "m", 0.0, 0.0, 0.0, tolerances)
    other = holonom.ChannelError("block.velocity", "m/s", 0.0, 0.0, 1e-4, 2.0)
    data = Certification({"relative": 1e-5}, channels=(channel, other)).to_json()
    found = Certification.from_json(data)
    assert not found.certified
    assert found.worst is found.exceeding[0]
    assert "`block.position` is inf tolerances off" in str(found)


def test_what_was_too_far_off_stays_so_when_the_result_goes_on() -> None:
    def at(tolerances: float) -> Certification:
        error = ChannelError("a.angle", "rad", 0.2, 1e-4 * tolerances, 1e-4, tolerances)
        return Certification({"relative": 1e-5}, BOUND, (error,), until=0.4, reason={})

    assert at(100.0).continued(0.5) == at(100.0)
    going_on = at(1.0).continued(0.5)
    # Rows beyond the one at 0.4 s were not compared, wherever the last part began.
    assert "no second run beyond 0.4 s" in going_on.reason["message"]
    assert going_on.continued(0.7) == going_on
