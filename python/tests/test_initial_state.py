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


def test_the_summary_names_choices_and_stability_that_limited_the_steps() -> None:
    moving = model("[initial.joints]\nhinge = { angular_velocity = 3.0 }\n")
    told = dict(summarize(moving.simulate(end_time=0.5, max_step=0.001)))
    assert told["limited by"].startswith("`max_step`")
    told = dict(summarize(moving.simulate(end_time=0.5, fixed_step=0.01)))
    assert told["limited by"] == "`fixed_step`: every step has 0.01 s"
    # Its eigenvalue of -1e5 1/s lets DOPRI5 make steps of 3.3e-5 s.
    stiff = holonom.Model.library("stiff_slider").simulate(end_time=0.1, method="DOPRI5")
    assert stiff.statistics.steps > 2900
    assert [w["code"] for w in stiff.warnings] == ["simulation/stiff"]
    assert dict(summarize(stiff))["limited by"].startswith("stability")


def test_a_check_says_that_a_run_needs_an_end() -> None:
    text = ARM.replace("UNITS", "").replace("end_time = 0.1", "")
    assert "end time" in str(holonom.Model.from_text(text).check())
    assert "end time" not in str(model("").check())
