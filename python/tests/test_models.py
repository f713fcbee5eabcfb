"""The library: what a model's README says about it is what a run shows."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import MODELS

import holonom
from holonom.summary import summarize

FOLDERS = sorted(path.parent for path in MODELS.glob("*/model.toml"))


def said(folder: Path) -> str:
    text = (folder / "README.md").read_text(encoding="utf-8")
    block = text.split("<!-- measured -->")[1].split("<!-- end of measured -->")[0]
    return " ".join(block.split())


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_readme_has_a_source_and_figures_as_measured(folder: Path) -> None:
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert "**Source" in text or "The model of [" in text or "The chain of [" in text
    measured = re.search(r"tolerance (\S+): (\d+) steps", said(folder))
    assert measured is not None
    model = holonom.Model.load(folder / "model.toml")
    assert float(measured[1]) == model.defaults["tolerance"]["relative"]
    result = model.simulate(channels=[])
    # Changes of the step control that are worth a new figure.
    assert result.statistics.steps == pytest.approx(int(measured[2]), rel=0.3)


# Independent truth: the references, computed by other implementations.
@pytest.mark.parametrize(
    "folder",
    [folder for folder in FOLDERS if (folder / "reference.csv").is_file()],
    ids=lambda folder: folder.name,
)
def test_errors_are_not_larger_than_stated(folder: Path) -> None:
    stated = {
        unit: float(error)
        for error, unit in re.findall(r"(\d\.\de[-+]\d+) (m/s|rad/s|m|rad)\b(?!/)", said(folder))
    }
    path = folder / "reference.csv"
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    columns = lines[0].split(",")
    table = np.array([[float(x) for x in line.split(",")] for line in lines[1:]])
    model = holonom.Model.load(folder / "model.toml")
    result = model.simulate(end_time=table[-1, 0], output_times=table[:, 0], channels=columns[1:])
    for name, exact in zip(columns[1:], table.T[1:], strict=True):
        error = np.abs(result[name] - exact).max()
        assert error <= 2.0 * stated[result.unit(name)], (name, error)


def test_a_summary_counts_what_patterns_repeat() -> None:
    result = holonom.Model.load(MODELS / "chain50" / "model.toml").simulate(end_time=0.01)
    assert dict(summarize(result))["items"] == "50 bodies, 50 joints, 50 forces, 0 drivers"


def test_text_tells_whether_it_is_json() -> None:
    # Truth: the model that both texts are of.
    model = holonom.Model.library("double_pendulum")
    assert holonom.Model.from_text(model.to_json()) == model
    assert holonom.Model.from_text("\n  " + model.to_json(), "json") == model
    with pytest.raises(holonom.ModelError):
        holonom.Model.from_text(model.to_json(), "toml")
