"""Damaged result files: refused, or all numbers and texts are those that were written.

Truth is the file before the damage: whatever is read is compared with it bit for bit.
"""

from __future__ import annotations

import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import MODELS, PENDULUM, oscillator_text, write_result

import holonom
from holonom.base.errors import FileError
from holonom.result import Result
from holonom.store.reader import Reader

#: Trials on all the small results together in `make test`; on each one, between two looks at the
#: clock, in `make verify`, which takes two minutes or `FUZZ_SECONDS`.
QUICK, ROUND = 2_000, 500


def _everything(result: Result) -> dict[str, Any]:
    """Return all numbers and texts of a result, in a form that is compared bit for bit."""
    found: dict[str, Any] = {"meta": repr(result.meta), "quantities": repr(result.quantities)}
    found |= {name: result[name].tobytes() for name in result.quantities}
    for name, column in result.steps.items():
        texts = column.dtype == object
        found[f"steps.{name}"] = repr(column.tolist()) if texts else column.tobytes()
    found["totals"] = repr(result.step_totals)
    found["events"] = repr(result.events)
    found["span"] = result.span
    if result.span is not None:
        first, last = result.span
        for part in (0.13, 0.5, 0.77, 0.999):
            state = result.state(first + part * (last - first))
            found[f"state {part}"] = {name: values.tobytes() for name, values in state.items()}
    return found


def _made_up(path: Path) -> None:
    write_result(path).close()


def _rod(path: Path) -> None:
    holonom.Model.from_text(PENDULUM, name="rod").simulate(output=path, end_time=0.2).close()


def _oscillator(path: Path) -> None:
    text = oscillator_text(mass=2.0, x=0.3, stiffness=50.0, free_length=1.0)
    model = holonom.Model.from_text(text, name="oscillator")
    model.simulate(output=path, end_time=1.0, interval=0.1, method="DEABM").close()


def _vehicle(path: Path) -> None:
    model = holonom.Model.load(MODELS / "hmmwv14" / "model.toml")
    model.simulate(output=path, end_time=0.02, certify=True).close()


def _continued(path: Path) -> None:
    model = holonom.Model.from_text(PENDULUM, name="rod")
    with model.simulate(output=path, end_time=0.1) as first:
        state = first.state()
    model.simulate(output=path, start=state, end_time=0.2).close()


MADE: dict[str, Callable[[Path], None]] = {
    "made up": _made_up,
    "rod": _rod,
    "oscillator": _oscillator,
    "vehicle": _vehicle,
    "continued": _continued,
}


def _flipped(data: bytearray, chance: random.Random) -> str:
    place = chance.randrange(8 * len(data))
    data[place // 8] ^= 1 << place % 8
    return f"bit {place % 8} of byte {place // 8}"


def _burst(data: bytearray, chance: random.Random) -> str:
    size = min(len(data), chance.choice([2, 4, 8, 16, 64, 512, 4096]))
    place = chance.randrange(len(data) - size + 1)
    kind = chance.choice(["zeros", "ones", "noise", "moved"])
    if kind == "moved":  # a piece of the file in another place, as a disk that loses its way does
        other = chance.randrange(len(data) - size + 1)
        data[place : place + size] = data[other : other + size]
    else:
        fill = {"zeros": bytes(size), "ones": b"\xff" * size}.get(kind) or chance.randbytes(size)
        data[place : place + size] = fill
    return f"{kind}, {size} bytes from {place}"


def _cut(data: bytearray, chance: random.Random) -> str:
    size = chance.randrange(len(data))
    if chance.random() < 0.5:
        size -= size % 4096
    del data[size:]
    return f"cut at {size}"


def _header(data: bytearray, chance: random.Random) -> str:
    place = chance.randrange(8 * 100)
    data[place // 8] ^= 1 << place % 8
    return f"bit {place % 8} of byte {place // 8}"


DAMAGE = [_flipped] * 6 + [_burst] * 2 + [_cut, _header]


def _require_no_difference(whole: bytes, path: Path, truth: Any, trials: int, seed: int) -> None:
    chance = random.Random(seed)
    refused = 0
    for trial in range(trials):
        data = bytearray(whole)
        what = chance.choice(DAMAGE)(data, chance)
        path.write_bytes(data)
        try:
            with Result.load(path) as result:
                found = _everything(result)
        except FileError as error:
            said = error
        else:
            assert found == truth, (seed, trial, what)
            continue
        assert said.code in ("result/damaged", "file/unusable"), (trial, what, str(said))
        assert str(path) in str(said)
        refused += 1
        _require_rest(path, truth, (trial, what))
    assert refused > trials // 5  # the trials reach what matters


def _require_rest(path: Path, truth: dict[str, Any], label: object) -> None:
    """What is recovered is what was written, or NaN, or absent."""
    try:
        result = Result.load(path, recover=True)
    except FileError:
        return
    with result:
        kept = np.frombuffer(truth["time"])
        time = result.time
        rows = np.searchsorted(kept, time)
        assert np.isin(time, kept).all(), label
        for name in result.quantities:
            assert name in truth, label
            size = result.quantities[name].size
            values = result[name].reshape(time.size, size)
            original = np.frombuffer(truth[name]).reshape(kept.size, size)[rows]
            same = values.view("u8") == original.view("u8")
            assert (same | np.isnan(values)).all(), (label, name)
        if result.span is not None and "model" in result.meta:
            try:
                state = result.state(result.span[0] + 0.5 * (result.span[1] - result.span[0]))
            except FileError:
                return
            if result.span == truth["span"] and not result.damage:
                assert {k: v.tobytes() for k, v in state.items()} == truth["state 0.5"], label


@pytest.mark.parametrize("name", MADE)
def test_no_damage_changes_a_number(tmp_path: Path, name: str) -> None:
    _fuzz(tmp_path, name, QUICK // len(MADE), seed=1)


@pytest.mark.long
@pytest.mark.parametrize("name", MADE)
def test_no_damage_of_two_minutes_changes_a_number(tmp_path: Path, name: str) -> None:
    seconds = float(os.environ.get("FUZZ_SECONDS", "120")) / len(MADE)
    _fuzz(tmp_path, name, ROUND, seed=2, seconds=seconds)


def _fuzz(folder: Path, name: str, trials: int, seed: int, seconds: float = 0.0) -> None:
    """Damage a result so many times, and then again with the next seed until the time is up."""
    path = folder / "whole.holonom"
    MADE[name](path)
    with Result.load(path) as result:
        truth = _everything(result)
    whole, until = path.read_bytes(), time.monotonic() + seconds
    for again in itertools.count(seed):
        _require_no_difference(whole, folder / "damaged.holonom", truth, trials, again)
        if time.monotonic() >= until:
            return


_KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from conftest import CHANNELS, META, synthetic_chunk
from holonom.store.reader import Reader
from holonom.store.writer import Writer
writer = Writer(Path(sys.argv[1]), META, CHANNELS)
for number in range(4):
    writer.append(synthetic_chunk(50 * number, 50))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_damaged_companion_of_a_killed_run_costs_its_last_commits_only(tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    line = [sys.executable, "-c", _KILLED, str(path), str(Path(__file__).parent)]
    assert subprocess.run(line, check=False).returncode == -signal.SIGKILL
    companion = path.with_name(path.name + "-wal")
    main, wal = path.read_bytes(), companion.read_bytes()
    copy = tmp_path / "copy" / path.name
    copy.parent.mkdir()
    chance = random.Random(3)
    truth = Reader.of(write_result(None))
    counts: set[int] = set()
    codes: set[str] = set()
    for _ in range(60):
        shutil.rmtree(copy.parent)
        copy.parent.mkdir()
        data = bytearray(wal)
        what = chance.choice(DAMAGE)(data, chance)
        copy.write_bytes(main)
        copy.with_name(companion.name).write_bytes(data)
        try:
            with Result.load(copy) as result:
                rows = result.time.size
                assert result.status == "killed"
                assert rows % 50 == 0, what
                for name in result.quantities:
                    part = truth.read(name)[:rows]
                    assert result[name].tobytes() == part.tobytes(), (what, name)
                counts.add(rows)
        except FileError as error:
            codes.add(error.code)
    assert codes <= {"result/damaged"}
    assert max(counts) == 200
    assert len(counts) > 1


def test_recovery_gives_all_that_is_whole(tmp_path: Path) -> None:
    """One page of one channel's numbers is lost: everything else is there."""
    path = tmp_path / "rod.holonom"
    write_result(path).close()
    with Result.load(path) as result:
        truth = {name: result[name] for name in result.quantities}
        needle = truth["energy.kinetic"][60:70].tobytes()
    data = bytearray(path.read_bytes())
    data[data.index(needle)] ^= 1
    path.write_bytes(data)
    with Result.load(path) as result:
        np.testing.assert_array_equal(result["q"], truth["q"])  # what is whole needs no recovery
        with pytest.raises(FileError) as refused:
            result["energy.kinetic"]
        assert refused.value.code == "result/damaged"
        assert "energy.kinetic" in str(refused.value)
        assert "50 to 99" in str(refused.value)
    with Result.load(path, recover=True) as result:
        assert result.damage == []
        for name, values in truth.items():
            lost = slice(50, 100) if name == "energy.kinetic" else slice(0, 0)
            assert np.isnan(result[name][lost]).all()
            rest = np.delete(result[name], lost, axis=0)
            np.testing.assert_array_equal(rest, np.delete(values, lost, axis=0))
        assert len(result.damage) == 1


def test_recovery_leaves_out_rows_without_times(tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    write_result(path).close()
    with Result.load(path) as result:
        time, q = result.time, result["q"]
    data = bytearray(path.read_bytes())
    data[data.index(time[110:120].tobytes())] ^= 1
    path.write_bytes(data)
    with pytest.raises(FileError, match="times of rows 100 to 149"):
        Result.load(path)
    with Result.load(path, recover=True) as result:
        np.testing.assert_array_equal(result.time, np.delete(time, slice(100, 150)))
        np.testing.assert_array_equal(result["q"], np.delete(q, slice(100, 150), axis=0))
        assert "times" in result.damage[0]
