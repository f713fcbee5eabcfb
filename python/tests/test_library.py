"""The library of models: listed, run, copied; it is what stands in `models/`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import holonom
from holonom import library
from holonom.cli.commands import invoke

MODELS = Path(__file__).parents[2] / "models"


def test_every_model_of_the_repository_is_in_the_library() -> None:
    folders = sorted(path.name for path in MODELS.iterdir() if path.is_dir())
    assert [entry.name for entry in library.entries()] == folders
    for entry in library.entries():
        assert entry.title
        assert (entry.path.parent / "README.md").read_bytes() == (
            MODELS / entry.name / "README.md"
        ).read_bytes()


def test_a_model_is_found_by_name() -> None:
    for name in ("hmmwv14_bushing", "chain50_free"):  # both extend another
        model = holonom.Model.library(name)
        assert model.name == name
        assert model.hash == holonom.Model.load(MODELS / name / "model.toml").hash


@pytest.mark.parametrize("name", ["hmmwv_14", "../hmmwv14", "", "hmmwv14/model.toml", 14, "\x00"])
def test_an_unknown_name_is_refused_with_the_nearest(name: str) -> None:
    with pytest.raises(holonom.UsageError, match="no model") as refused:
        holonom.Model.library(name)
    assert "holonom models" in str(refused.value)
    if "hmmwv" in str(name):
        assert "`hmmwv14`" in str(refused.value)


def test_models_are_listed_told_and_copied(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(["models"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "hmmwv14               14-body HMMWV over a smooth bump at 10 mph" in lines
    assert invoke(["models", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == len(lines)
    assert invoke(["models", "simple_pendulum"]) == 0
    assert capsys.readouterr().out.startswith("# Simple pendulum\n")
    assert invoke(["models", "chain50_free", "-o", str(tmp_path / "mine")]) == 0
    capsys.readouterr()
    copied = holonom.Model.load(tmp_path / "mine" / "chain50_free" / "model.toml")
    assert copied.hash == holonom.Model.library("chain50_free").hash
    assert invoke(["models", "chain50", "-o", str(tmp_path / "mine")]) == 5
    assert "not overwritten" in capsys.readouterr().err
    assert invoke(["models", "-o", str(tmp_path)]) == 1
    assert invoke(["check", "library:simple_pendulum"]) == 0
    assert invoke(["check", "library:simple_pendulums"]) == 1
    assert "`simple_pendulum`" in capsys.readouterr().err


def test_a_library_that_is_not_there_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(library, "FOLDER", tmp_path / "models")
    for line in (["models"], ["models", "--json"], ["check", "library:chain50"]):
        assert invoke(line) == 5
        assert f"there are none in {tmp_path / 'models'}" in "".join(capsys.readouterr())
