"""What `docs/python.md` and the README say of the Python package, run and compared with it."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

import holonom

PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
#: Names in backticks.
NAMED = set(re.findall(r"`(\w+)", PAGE))


def blocks(text: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def table(mark: str) -> list[list[str]]:
    """The cells of the table behind a mark, without its heading."""
    text = PAGE.partition(f"<!-- {mark} -->\n")[2].partition("\n\n")[0]
    assert text
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in text.split("\n")[2:]]


def keys(mark: str) -> dict[str, str]:
    """The names of a table, each with its second cell: the unit."""
    return {name: row[1] for row in table(mark) for name in re.findall(r"`(\w+)`", row[0])}


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the blocks of the page leave, run one after the other."""
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        for number, block in enumerate(blocks(PAGE)):
            exec(compile(block, f"python.md, block {number}", "exec"), names)
    return names


def test_the_blocks_of_the_page_do_what_they_say(ran: dict[str, Any]) -> None:
    result = ran["result"]
    assert result["shoulder.force"].shape == (result.time.size, 2)
    assert ran["second"].time[0] == 0.0  # both parts
    assert ran["second"].time[-1] == 0.4
    assert ran["branch"].time[0] == 0.137
    assert len(ran["peaks"]) == 3


def test_the_spring_to_a_driven_body_is_a_controller(ran: dict[str, Any]) -> None:
    # Independent truth: J θ'' = -k (θ - w) - d (θ' - w') with w = sin(3t)/2, by Runge and Kutta.
    inertia, k, d = 0.2 + 2.0 * 0.5**2, 40.0, 6.0

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        away, rate = y[0] - 0.5 * np.sin(3.0 * t), y[1] - 1.5 * np.cos(3.0 * t)
        return np.array([y[1], -(k * away + d * rate) / inertia])

    tracked = ran["tracked"]
    y, h = np.array([0.0, tracked["arm.angular_velocity"][0]]), 1e-3
    for i in range(2000):
        t = i * h
        a = slope(t, y)
        b = slope(t + h / 2.0, y + h / 2.0 * a)
        c = slope(t + h / 2.0, y + h / 2.0 * b)
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(t + h, y + h * c))
    assert tracked["arm.angle"][-1] == pytest.approx(y[0], abs=1e-5)
    assert np.abs(tracked["arm.angle"] - tracked["wish.angle"]).max() < 0.2


def test_a_controller_in_steps_holds_its_torque(ran: dict[str, Any]) -> None:
    # By hand: of a constant torque θ'' is constant.
    angle = rate = 0.0
    for _ in range(200):
        gain = (40.0 * (0.3 - angle) - 6.0 * rate) / (0.2 + 2.0 * 0.5**2)
        angle, rate = angle + rate * 0.01 + 0.5 * gain * 0.01**2, rate + gain * 0.01
    assert ran["angle"] == pytest.approx(angle, abs=1e-9)


def test_the_page_names_everything_that_is_public() -> None:
    missing = set(holonom.__all__) - NAMED
    for owner in (holonom.Model, holonom.Result):
        missing |= {f"{name}" for name, _ in inspect.getmembers(owner) if name[0] != "_"} - NAMED
    assert missing == set()


def test_the_tables_of_the_page_are_those_of_a_run(ran: dict[str, Any]) -> None:
    units = {about.name: about.metadata["unit"] for about in fields(holonom.Options)}
    assert keys("options") == units
    beside = set(inspect.signature(holonom.Model.simulate).parameters) - {"self", *units}
    assert beside <= NAMED
    result = ran["result"]
    assert keys("statistics").keys() == set(result.statistics)
    assert keys("energy").keys() == set(result.energy)
    assert keys("steps").keys() == set(result.steps)
    assert set(result.state()) <= NAMED
    assert set(result.residuals) <= NAMED


def test_the_blocks_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks((ROOT / "README.md").read_text(encoding="utf-8")):
        exec(block, names)
    assert names["again"].status == "completed"
    assert (tmp_path / "heavier.svg").stat().st_size > 1000


def test_pages_lead_to_pages() -> None:
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = path.read_text(encoding="utf-8")
        for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)", text):
            there = path if not target else path.parent / target
            assert there.exists(), (path.name, target)
            if anchor and there.suffix == ".md":
                known = [
                    slug(line) for line in re.findall(r"^#+ (.*)", there.read_text(), re.MULTILINE)
                ]
                known += re.findall(r'<a id="([^"]+)"', there.read_text())
                assert anchor in known, (path.name, target, anchor)


def slug(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
