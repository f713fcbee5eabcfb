"""A result in memory is the one of a file, number by number: the file is the independent truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import CHANNELS, META, SUMMARY, synthetic_chunk

import holonom
from holonom.result import Result
from holonom.store.memory import Memory
from holonom.store.reader import Reader
from holonom.store.writer import Writer

MODEL = Path(__file__).parents[2] / "models" / "slider_crank" / "model.toml"


def assert_same(found: Result, known: Result) -> None:
    assert found.quantities == known.quantities
    for name in known.quantities:
        np.testing.assert_array_equal(found[name], known[name])
    assert found.steps.keys() == known.steps.keys()
    for column, values in known.steps.items():
        np.testing.assert_array_equal(found.steps[column], values)
        assert found.steps[column].dtype == values.dtype
    for mine, theirs in zip(found.step_totals, known.step_totals, strict=True):
        assert mine[:3] == theirs[:3]
        assert mine[3:] == pytest.approx(theirs[3:], rel=1e-12)
    assert found.events == known.events
    assert found.span == known.span


def test_made_up_chunks_come_back_as_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    memory, writer = Memory(META, CHANNELS), Writer(path, META, CHANNELS)
    for store in (memory, writer):
        for first in range(0, 200, 50):
            store.append(synthetic_chunk(first, 50))
        store.finish(SUMMARY)
    writer.close()
    with Result.load(path) as known:
        assert_same(Result(memory), known)
        assert memory.meta == known.meta
    reader = Reader.open(path)
    assert memory.count == reader.count
    for index in (0, 49, 50, 199):
        for name, part in reader.row(index).items():
            np.testing.assert_array_equal(memory.row(index)[name], part)
    for first, count in ((0, 10), (45, 20), (190, 30), (200, 5)):
        np.testing.assert_array_equal(
            memory.rows("q", first, count), reader.rows("q", first, count)
        )
    for store in (memory, reader):
        store.amend({"note": {"runs": (1, 2)}})
    assert memory.meta["note"] == reader.meta["note"] == {"runs": [1, 2]}
    reader.close()


@pytest.mark.parametrize("method", ["ForSDIRK", "DEABM"])
def test_a_run_is_the_same_in_memory_in_a_file_and_saved(method: str, tmp_path: Path) -> None:
    model = holonom.Model.load(MODEL)
    choices = {"end_time": 0.4, "interval": 1e-3, "method": method, "dense_output": True}
    memory = model.simulate(**choices)
    stored = model.simulate(output=tmp_path / "stored.holonom", **choices)
    saved = Result.load(memory.save(tmp_path / "new" / "saved.holonom"))
    assert len(memory._reader._chunks) > 1  # rows came in several chunks
    times, names = np.linspace(*memory.span, 37), ["q", "lambda", "crank.angle"]
    for other in (stored, saved):
        assert_same(memory, other)
        parts = other.sample(times, names)
        for name, part in memory.sample(times, names).items():
            np.testing.assert_array_equal(part, parts[name])
    assert saved.meta == memory.meta
    assert memory.path is None
    assert memory.model is model
    saved.close()
    stored.close()


def test_a_run_without_rows_is_a_result_without_rows() -> None:
    result = Result(Memory(META, CHANNELS))
    assert result.time.size == 0
    assert result.span is None
    assert result.events == []
    assert list(result.steps) == ["t", "h", "error", "accepted", "cause", "iterations"]


def test_saving_replaces_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    memory = Memory(META, CHANNELS)
    memory.append(synthetic_chunk(0, 5))
    with pytest.raises(holonom.FileError, match="not overwritten"):
        memory.save(path)
    assert path.read_text() == "mine"
    assert [entry.name for entry in tmp_path.iterdir()] == ["notes.txt"]
