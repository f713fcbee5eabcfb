"""Long work of large models ends at once when it is asked to, whatever it is doing."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import oscillator_text

import holonom
from holonom.summary import summarize

CHAIN = """
holonom = 1
title = "chain"
dimension = "planar"
gravity = [0.0, -9.81]
[patterns.chain]
over.i = {{ from = 1, to = {links} }}
bodies."link_{{i}}" = {{ mass = 1.0, inertia = "=1/12", position = ["=i - 0.5", 0.0] }}
joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i - 1}}", "link_{{i}}"],
  points_in_body = [[0.5, 0.0], [-0.5, 0.0]] }}
forces."spring_{{i}}" = {{ type = "rsda", between = ["link_{{i - 1}}", "link_{{i}}"],
  stiffness = 1e5, damping = 1e3 }}
[joints]
joint_1 = {{ between = ["ground", "link_1"], points_in_body = [[0.0, 0.0], [-0.5, 0.0]] }}
[forces]
spring_1 = {{ between = ["ground", "link_1"] }}
[simulation]
end_time = 50.0
newton = "sparse"
"""

STAGES = {"", "reading", "compiling", "assembling", "analysing", "running"}

#: Says when it is ready, and when it was interrupted (s) with how many rows.
SCRIPT = """
import sys, time
import holonom
from holonom.summary import summarize
holonom.Model  # the engine is read when it is first used
print("ready", flush=True)
try:
    model = holonom.Model.load(sys.argv[1])
    model.check(spectrum=False)
    model.simulate(interval=0.002)
except KeyboardInterrupt as error:
    met = time.monotonic()
    result = getattr(error, "result", None)
    print(met, -1 if result is None else result.time.size, flush=True)
"""


def _patience() -> float:
    """Return how long an answer may take, s: 0.2 on a machine that does nothing else."""
    return 0.2 * (1.0 + os.getloadavg()[0] / (os.cpu_count() or 1))


def _answer(path: Path, moment: float) -> tuple[float, int]:
    """Return how long Ctrl-C at a moment (s) takes to be met, s, and the rows there were."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(path)],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL) and None,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(moment)
    asked = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    met, rows = out.split()
    return float(met) - asked, int(rows)


def _assert_heeded(path: Path, links: int, moments: list[float]) -> None:
    path.write_text(CHAIN.format(links=links))
    answers = [(moment, *_answer(path, moment)) for moment in moments]
    late = [answer for answer in answers if answer[1] > _patience()]
    assert not late, answers
    # Some were met before the first row, some after it.
    assert len({rows < 0 for *_, rows in answers}) == 2, answers


def test_ctrl_c_is_heeded_in_set_up_and_steps(tmp_path: Path) -> None:
    _assert_heeded(tmp_path / "chain.toml", 2_000, [0.02, 0.1, 3.0, 4.1])


@pytest.mark.long
def test_ctrl_c_is_heeded_at_any_moment_of_ten_thousand_bodies(tmp_path: Path) -> None:
    moments = random.Random(20260101)
    drawn = [moments.uniform(0.0, 12.0) for _ in range(20)]
    _assert_heeded(tmp_path / "chain.toml", 10_000, drawn)


@pytest.mark.parametrize("pressed", [True, False])
@pytest.mark.parametrize("part", [1, 2])
def test_ctrl_c_is_heeded_while_a_run_is_checked_by_a_second_one(
    tmp_path: Path, pressed: bool, part: int
) -> None:
    text = oscillator_text(mass=1.0, x=1.0, stiffness=100.0, free_length=1.0)
    model = holonom.Model.from_text(text)
    end = 2_000.0
    asked: list[int] = []

    def progress(time: float, _: float, steps: int) -> None:
        if time == end and not asked:  # the first run is at its end
            asked.append(steps)
            if not pressed:
                raise KeyboardInterrupt
            os.kill(os.getpid(), signal.SIGINT)

    options: Any = {"tolerance": 1e-4, "end_time": end, "interval": 1.0}
    path, other = tmp_path / "checked.holonom", tmp_path / "whole.holonom"
    start: Any = {}
    if part == 2:
        start = {"start": model.simulate(**options | {"end_time": 9.0}, output=path).state()}
        shutil.copy(path, other)
    with pytest.raises(holonom.Interrupted, match="all rows are there") as caught:
        model.simulate(**options, **start, progress=progress, output=path)
    result = caught.value.result
    assert result is not None
    assert result.status == "interrupted"
    assert result.time.size == 2_001
    assert "interrupted" in next(
        warning["message"] for warning in result.warnings if "amplified" in warning["code"]
    )
    # Taken up, it is checked: all is as if nobody had asked.
    again = model.simulate(**options, start=result.state(), output=path)
    whole = model.simulate(**options, **start, output=other)
    assert again.status == "completed"
    assert list(again.warnings) == list(whole.warnings)
    assert np.array_equal(again.time, whole.time)
    assert np.array_equal(again["block.position"], whole["block.position"])
    counts = [
        {key: value for key, value in found.statistics.items() if "seconds" not in key}
        for found in (again, whole)
    ]
    assert counts[0] == counts[1]
    assert again.energy == whole.energy
    assert again.statistics.outputs == again.time.size == 2_001


def test_what_is_being_done_is_told() -> None:
    told: list[str] = []
    model = holonom.Model.from_text(CHAIN.format(links=2_000))
    model.simulate(end_time=0.02, watch=told.append)
    assert {"running"} <= set(told) <= STAGES


def test_what_watches_raise_ends_the_work(tmp_path: Path) -> None:
    path = tmp_path / "chain.toml"
    path.write_text(CHAIN.format(links=2_000))

    def refuse(stage: str) -> None:
        raise LookupError(stage)

    model = holonom.Model.load(path)
    with pytest.raises(LookupError) as ended:
        model.simulate(watch=refuse)
    assert str(ended.value) in STAGES


def test_the_time_allowed_counts_from_the_call() -> None:
    model = holonom.Model.from_text(CHAIN.format(links=2_000))
    with pytest.raises(holonom.SimulationError) as ended:
        model.simulate(max_seconds=1e-3)
    assert ended.value.code == "simulation/max-seconds"
    assert ended.value.result is None
    begun = time.monotonic()
    with pytest.raises(holonom.SimulationError) as ended:
        model.simulate(max_seconds=2.0)
    assert time.monotonic() - begun < 2.0 + 2.0 * _patience()
    assert ended.value.code == "simulation/max-seconds"


def test_a_limit_before_the_first_step_returns_a_result_without_rows(tmp_path: Path) -> None:
    model = holonom.Model.from_text(CHAIN.format(links=2_000))
    path = tmp_path / "chain.holonom"
    result = model.simulate(max_seconds=1e-3, on_failure="return", output=path)
    assert (result.status, result.time.size) == ("limit", 0)
    assert result.stop_reason["code"] == "simulation/max-seconds"
    assert repr(result) == "<holonom.Result 'model': limit, no states>"
    assert summarize(result)
    assert not list(tmp_path.iterdir())  # an older result would stand as well


def test_many_channels_are_found_in_the_time_of_their_number() -> None:
    model = holonom.Model.from_text(CHAIN.format(links=2_000))
    names = [f"link_{k}.position" for k in range(1, 2_001)]
    begun = time.process_time()
    assert model.expand(["link_*.position"]) == names
    assert model.expand(names) == names
    # Comparing every name with every channel took 10 s.
    assert time.process_time() - begun < 2.0
    result = model.simulate(end_time=1e-3, channels=["link_*.position"])
    assert result.requested == names
    assert result["link_2000.position"].shape == (result.time.size, 2)
