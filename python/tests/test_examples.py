"""The scripts of examples/: each runs, writes its pictures, and stands in the gallery."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from conftest import ROOT

EXAMPLES = ROOT / "examples"
SCRIPTS = sorted(EXAMPLES.glob("[0-9]*.py"))
GALLERY = (EXAMPLES / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_runs_and_writes_its_pictures(script: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script), str(tmp_path / "pictures")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONSAFEPATH": "1"},
    )
    assert (done.returncode, done.stderr) == (0, "")
    made = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert made == {path.name for path in (EXAMPLES / "pictures").glob(f"{script.stem}*")}
    for name in made:
        root = ET.parse(tmp_path / "pictures" / name).getroot()
        assert len(list(root.iter("{http://www.w3.org/2000/svg}path"))) > 2


def test_the_gallery_shows_every_example_and_every_picture() -> None:
    assert len(SCRIPTS) >= 8
    linked = re.findall(r"\]\(([^)]+)\)", GALLERY)
    kept = [f"pictures/{path.name}" for path in (EXAMPLES / "pictures").iterdir()]
    assert set(linked) == {script.name for script in SCRIPTS} | set(kept)


def test_pictures_are_small() -> None:
    sizes = {path.name: path.stat().st_size for path in (EXAMPLES / "pictures").iterdir()}
    assert max(sizes.values()) < 500_000, sizes


def test_the_first_picture_of_the_readme_is_the_vehicle_in_motion() -> None:
    first = re.search(r"!\[[^\]]*\]\(([^)]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert first
    assert "vehicle" in first[0]
    picture = (ROOT / first[1]).read_bytes()
    frames = picture.count(b"\x21\xf9\x04")  # a GIF has a graphic control extension for each
    assert b"<animate " in picture or (picture.startswith(b"GIF89a") and frames > 10)
    assert len(picture) < 1_500_000
