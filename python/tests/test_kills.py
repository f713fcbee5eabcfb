"""Runs that are killed at any moment, while others read, and go on to their end.

Truth is a run that nobody killed: up to the last committed row the rows of a killed one are its
rows, and beyond it those of a run that was started from that row on purpose; bit for bit.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import PENDULUM

import holonom
from holonom.result import Result

END, INTERVAL = 400.0, 0.05
STATE = ("time", "q", "qd", "qdd", "lambda", "rod.position", "pin.force", "energy.total")

_RUN = """
import sys
import holonom
end, interval = float(sys.argv[3]), float(sys.argv[4])
print("ready", flush=True)
model = holonom.Model.load(sys.argv[1])
model.simulate(end_time=end, interval=interval, output=sys.argv[2], threads=1)
"""

#: Reads whatever is there, again and again: every row that it sees is one of the whole run.
_READ = """
import sys
import numpy as np
import holonom
whole = np.load(sys.argv[2])
print("ready", flush=True)
seen = 0
while True:
    try:
        with holonom.Result.load(sys.argv[1]) as result:
            q, rows = result["q"], result.time.size
    except holonom.FileError as error:
        assert "no such file" in str(error), error
        continue
    assert q.tobytes() == whole[:rows].tobytes(), rows
    if rows > seen:
        seen = rows
        print(rows, flush=True)
"""


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kills") / "rod.toml"
    path.write_text(PENDULUM)
    return path


@pytest.fixture(scope="module")
def whole(model_file: Path) -> tuple[Result, float]:
    """The run that nobody killed, and how long it takes as a process, s."""
    path = model_file.with_name("whole.holonom")
    line = [sys.executable, "-c", _RUN, str(model_file), str(path), str(END), str(INTERVAL)]
    begun = time.monotonic()
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL)
    taken = time.monotonic() - begun
    result = Result.load(path)
    np.save(model_file.with_name("q.npy"), result["q"])
    return result, taken


def _kill(model_file: Path, path: Path, moment: float, *, reading: bool) -> None:
    """Start a run and kill it after a time (s), maybe while another process reads."""
    reader = None
    if reading:
        line = [sys.executable, "-c", _READ, str(path), str(model_file.with_name("q.npy"))]
        reader = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert reader.stdout is not None
        assert reader.stdout.readline() == "ready\n"
    line = [sys.executable, "-c", _RUN, str(model_file), str(path), str(END), str(INTERVAL)]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(moment)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    if reader is not None:
        time.sleep(0.1)
        assert reader.poll() is None, reader.communicate()[1]
        reader.kill()
        _, complaint = reader.communicate()
        assert not complaint


def _require_same_rows(
    model_file: Path, path: Path, whole: Result, moment: float, *, reading: bool
) -> int:
    """Kill a run, go on from what it left, and compare all rows; return how many it left."""
    _kill(model_file, path, moment, reading=reading)
    if not path.exists():  # it had nothing to lose yet
        return 0
    model = holonom.Model.load(model_file)
    with Result.load(path) as killed:
        rows, status = killed.time.size, killed.status
        assert status in ("killed", "completed")
        for name in STATE:
            assert killed[name].tobytes() == whole[name][:rows].tobytes(), (moment, name)
        state = killed.state()
        until = float(state["time"][0])
    if status == "completed":
        return rows
    assert sorted(path.parent.glob(f"*{path.name}*")) == [path]  # no companions are left
    # Another run, in memory, from the same row of the run that nobody killed.
    begin = {name: part.copy() for name, part in whole.state(until).items()}
    expected = model.simulate(start=begin, end_time=END, interval=INTERVAL, threads=1)
    with model.simulate(
        start=state, output=path, end_time=END, interval=INTERVAL, threads=1
    ) as result:
        assert result.path == path
    with Result.load(path) as result:
        assert result.status == "completed"
        for name in STATE:
            after = np.concatenate([whole[name][:rows], expected[name][1:]])
            assert result[name].tobytes() == after.tobytes(), (moment, name)
    return rows


@pytest.mark.parametrize("trial", range(4))
def test_a_killed_run_goes_on_to_its_end(
    model_file: Path, whole: tuple[Result, float], tmp_path: Path, trial: int
) -> None:
    moment = random.Random(trial).uniform(0.3, 0.95) * whole[1]
    path = tmp_path / "rod.holonom"
    _require_same_rows(model_file, path, whole[0], moment, reading=trial % 2 == 1)


@pytest.mark.long
def test_two_hundred_killed_runs_go_on_to_their_ends(
    model_file: Path, whole: tuple[Result, float], tmp_path: Path
) -> None:
    chance = random.Random(20261122)
    left = []
    for trial in range(200):
        path = tmp_path / f"rod{trial}.holonom"
        moment = chance.uniform(0.0, 1.1) * whole[1]
        reading = trial % 4 == 3
        left.append(_require_same_rows(model_file, path, whole[0], moment, reading=reading))
        path.unlink(missing_ok=True)
    # The moments were those that matter: before the first row, between, and after the last one.
    assert len(set(left)) > 20


def test_a_run_killed_over_an_older_result_leaves_one_of_the_two(
    model_file: Path, whole: tuple[Result, float], tmp_path: Path
) -> None:
    path = tmp_path / "rod.holonom"
    model = holonom.Model.load(model_file)
    chance = random.Random(5)
    for _ in range(4):
        model.simulate(output=path, end_time=0.77, interval=0.07, threads=1).close()
        older = path.read_bytes()
        _kill(model_file, path, chance.uniform(0.0, 1.0) * whole[1], reading=False)
        if path.read_bytes() == older:
            continue
        with Result.load(path) as result:
            rows = result.time.size
            assert rows > 1
            assert result["q"].tobytes() == whole[0]["q"][:rows].tobytes()
