"""Initial states, units and what a check says about them."""

import math

import pytest

import holonom
from holonom.summary import summarize

ARM = """
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
UNITS
[bodies]
arm = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
rider = { mass = 1.0, inertia = 0.1, position = [2.0, 0.0] }
[joints]
hinge = { type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }
[joints.rail]
type = "translational"
between = ["arm", "rider"]
point = [2.0, 0.5]
axis = [0.0, 1.0]
[simulation]
end_time = 0.1
"""


def model(rest: str, units: str = "") -> holonom.Model:
    return holonom.Model.from_text(ARM.replace("UNITS", units) + rest)


def test_check_and_run_tell_chosen_velocities() -> None:
    turning = model("[initial.bodies]\narm = { angular_velocity = 2.0 }\n")
    report = turning.check()
    assert [c["coordinate"] for c in report.data["chosen_velocities"]] == ["rail.displacement"]
    assert any("rail.displacement" in w["message"] for w in report.warnings)
    result = turning.simulate()
    assert any(w["code"] == "model/not-stated" for w in result.warnings)


def test_joints_start_where_they_are_stated_in_units_of_the_file() -> None:
    stated = "[initial.joints]\nhinge = { angle = 30.0 }\nrail = { displacement = 100.0 }\n"
    result = model(stated, 'units = { angle = "deg", length = "cm" }').simulate(
        channels=["hinge.angle", "rail.displacement"]
    )
    # SI in results: 30 degrees and 1 m.
    assert result["hinge.angle"][0] == pytest.approx(math.pi / 6, abs=1e-14)
    assert result["rail.displacement"][0] == pytest.approx(1.0, abs=1e-14)


def test_a_summary_says_what_limited_the_steps() -> None:
    start = "hinge = { angular_velocity = 3.0 }\nrail = { displacement = 0.3 }\n"
    result = model(f"[initial.joints]\n{start}").simulate(end_time=1.0, tolerance=1e-8)
    limited = result.meta["limited_by"]
    assert limited["coordinate"] in {"hinge.angle", "rail.displacement"}
    assert 0 < limited["steps"] <= limited["of"] <= result.statistics.steps
    assert limited["coordinate"] in dict(summarize(result))["limited by"]
