"""Runs that are killed at any moment, while others read, and go on to their end.

Truth is a run that nobody killed: the rows of a killed one are its rows, and once that has gone on
to its end, so are all others, with the log of its steps and what it counted; bit for bit.
"""

from __future__ import annotations

import contextlib
import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import PENDULUM

import holonom
from holonom.result import Result
from holonom.store import layout

END, INTERVAL = 2000.0, 0.05
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
    assert result.statistics.steps > 3000  # there are checkpoints
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
    if status == "completed":
        return rows
    assert sorted(path.parent.glob(f"*{path.name}*")) == [path]  # no companions are left
    with model.simulate(
        start=state, output=path, end_time=END, interval=INTERVAL, threads=1
    ) as result:
        assert result.path == path
    with Result.load(path) as result:
        _require_equal(result, whole)
    return rows


def _require_equal(result: Result, whole: Result) -> None:
    """Compare all that is no time that passed."""
    assert result.status == whole.status == "completed"
    for name in STATE:
        assert result[name].tobytes() == whole[name].tobytes(), name
    log, expected = result.steps, whole.steps
    assert log.keys() == expected.keys()
    for name in expected:
        assert np.array_equal(log[name], expected[name]), name
    assert result.events == whole.events
    for entry in ("statistics", "energy", "residuals", "limited_by", "warnings", "options"):
        told = [_without_times(r.meta[entry]) for r in (result, whole)]
        assert told[0] == told[1], entry
    assert "parts" not in result.meta
    for moment in np.linspace(1.0, END - 1.0, 5) + 0.0123:
        states = [r.state(moment) for r in (result, whole)]
        assert all(np.array_equal(states[0][name], part) for name, part in states[1].items())


def _without_times(entry: Any) -> Any:
    if not isinstance(entry, dict):
        return entry
    return {name: value for name, value in entry.items() if "seconds" not in name}


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


def test_a_run_is_killed_again_and_again(
    model_file: Path, whole: tuple[Result, float], tmp_path: Path
) -> None:
    path = tmp_path / "rod.holonom"
    chance = random.Random(11)
    moment = 0.6 * whole[1]
    while not path.exists():  # killed before there was anything to lose
        _kill(model_file, path, moment, reading=False)
        moment *= 1.5
    rows = 0
    for _ in range(6):
        with Result.load(path) as result:
            assert result.time.size >= rows  # what was there stays there
            rows = result.time.size
            assert result["q"].tobytes() == whole[0]["q"][:rows].tobytes()
            if result.status == "completed":
                break
        _kill_later(model_file, path, chance.uniform(0.2, 0.7) * whole[1])
    with Result.load(path) as result:
        ended = result.status == "completed"
    if not ended:
        subprocess.run(_going_on(model_file, path), check=True, stdout=subprocess.DEVNULL)
    with Result.load(path) as result:
        _require_equal(result, whole[0])


#: Goes on, maybe until it kills itself.
_GO_ON = """
import os
import signal
import sys
import holonom
end, interval = float(sys.argv[3]), float(sys.argv[4])
until = float(sys.argv[5]) if len(sys.argv) > 5 else end
def progress(time, step, steps):
    if time > until:
        os.kill(os.getpid(), signal.SIGKILL)
model = holonom.Model.load(sys.argv[1])
with holonom.Result.load(sys.argv[2]) as result:
    state = result.state()
print("ready", flush=True)
options = {"end_time": end, "interval": interval, "threads": 1}
model.simulate(start=state, output=sys.argv[2], progress=progress, **options)
"""


def _going_on(model_file: Path, path: Path, end: float = END) -> list[str]:
    return [sys.executable, "-c", _GO_ON, str(model_file), str(path), str(end), str(INTERVAL)]


def _kill_later(model_file: Path, path: Path, moment: float) -> None:
    """Go on from a result and kill that after a time (s)."""
    line = _going_on(model_file, path)
    process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(moment)
    process.send_signal(signal.SIGKILL)
    process.communicate()


def _interrupted(model: holonom.Model, path: Path, moment: float, **options: Any) -> None:
    """Run until a time (s), and press Ctrl-C."""

    def progress(now: float, _step: float, _steps: int) -> None:
        if now >= moment:
            raise KeyboardInterrupt

    with pytest.raises(holonom.Interrupted):
        model.simulate(output=path, progress=progress, threads=1, **options)


def test_a_run_is_interrupted_and_goes_on(
    model_file: Path, whole: tuple[Result, float], tmp_path: Path
) -> None:
    path, options = tmp_path / "rod.holonom", {"end_time": END, "interval": INTERVAL}
    model = holonom.Model.load(model_file)
    for moment in (5.0, 750.0):  # before and after the first checkpoint, on machines of today
        _interrupted(model, path, moment, **options)
        with Result.load(path) as stopped:
            state, last = stopped.state(), stopped.time[-1]
        assert not np.isin(last, whole[0].time)  # a row of its own, where it was stopped
        model.simulate(start=state, output=path, threads=1, **options).close()
        with Result.load(path) as result:
            _require_equal(result, whole[0])
        path.unlink()


def test_a_part_of_a_result_is_killed_and_goes_on(model_file: Path, tmp_path: Path) -> None:
    path, truth = tmp_path / "rod.holonom", tmp_path / "truth.holonom"
    model = holonom.Model.load(model_file)
    for file in (path, truth):
        model.simulate(output=file, end_time=5.0, interval=INTERVAL, threads=1).close()
    with Result.load(truth) as result:
        first = result.time.size
    end = 4 * END  # long enough for many calls of `progress`, which come by the clock
    going_on = _going_on(model_file, truth, end)
    subprocess.run(going_on, check=True, stdout=subprocess.DEVNULL)
    going_on = _going_on(model_file, path, end)
    killed = subprocess.run([*going_on, "250"], stdout=subprocess.DEVNULL)
    assert killed.returncode == -signal.SIGKILL
    with Result.load(path) as result:
        assert result.status == "killed"
        assert result.time.size > first
    subprocess.run(going_on, check=True, stdout=subprocess.DEVNULL)
    with Result.load(path) as result, Result.load(truth) as expected:
        for name in STATE:
            assert result[name].tobytes() == expected[name].tobytes(), name
        assert len(result.meta["parts"]) == 1
        told = [_without_times(r.meta["statistics"]) for r in (result, expected)]
        assert told[0] == told[1]


def test_a_run_with_other_options_goes_on_from_the_last_row(
    model_file: Path, tmp_path: Path
) -> None:
    path = tmp_path / "rod.holonom"
    model = holonom.Model.load(model_file)
    _interrupted(model, path, 5.0, end_time=END, interval=INTERVAL)
    with Result.load(path) as stopped:
        rows, state = stopped.time, stopped.state()
    end = float(rows[-1]) + 2.0
    model.simulate(start=state, output=path, end_time=end, interval=INTERVAL, threads=1).close()
    with Result.load(path) as result:
        assert result.time[: rows.size].tobytes() == rows.tobytes()
        assert [part["until"] for part in result.meta["parts"]] == [rows[-1]]


def test_rows_that_come_out_otherwise_are_kept_and_told(model_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    model = holonom.Model.load(model_file)
    # A checkpoint may have been written just before: then there is nothing to compare. On a slow
    # disk most of the moments at which a run can be interrupted follow one: others come in turn.
    for attempt in range(40):
        _interrupted(model, path, 5.0 + 40.0 * attempt, end_time=END, interval=INTERVAL)
        with Result.load(path) as stopped:
            reader = stopped._reader
            beyond = reader.checkpoint["chunk"] + 1 if reader.checkpoint else 1
            if beyond <= reader.last_chunk["id"] and reader.chunk(beyond)["count"] > 1:
                break
    else:
        pytest.fail("the run was always interrupted at a checkpoint")
    # As another machine would have written it: numbers are other in their last bit.
    with contextlib.closing(sqlite3.connect(path)) as db:
        found = db.execute("SELECT id, chunk, quantity, blob FROM data WHERE quantity = 2")
        for number, chunk, quantity, blob in found.fetchall():
            q = np.frombuffer(blob, "<f8").copy()
            q[0] = np.nextafter(q[0], 9.0)
            layout.insert(db, "data", (number, chunk, quantity, q.tobytes()), "INSERT OR REPLACE")
        db.commit()
    with Result.load(path) as stopped:
        rows, state = stopped["q"], stopped.state()
    with model.simulate(
        start=state, output=path, end_time=END, interval=INTERVAL, threads=1
    ) as result:
        assert result.path == path
        assert result["q"][: len(rows)].tobytes() == rows.tobytes()
        assert "result/not-repeated" in [warning["code"] for warning in result.meta["warnings"]]
        assert result.time[-1] == END
