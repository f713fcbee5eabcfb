"""Tolerances are kept: the error over tolerance of the codes, and how the error follows it.

The truth is Radau IIA of order 5 at a thousandth of the tightest tolerance, repeated by ForSDIRK.
"""

from __future__ import annotations

import math
import statistics

import pytest
from conftest import MODELS

import holonom
from holonom import Comparison

CODES = ["SspTrap", "InflTrap", "InflSDIRK", "ForSDIRK", "ForRosen", "ForRadau"]
TOLERANCES = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7]
#: Largest error over tolerance, least and greatest.
BOUNDS = {"position": (0.02, 30.0), "velocity": (0.02, 60.0)}
#: How far the log-log slope of the error against the tolerance may be from the expected one.
SLOPE = 0.25
#: Seconds; None is the end time of the model.
ENDS = {
    "double_pendulum": None,
    "andrews": None,
    "slider_crank": None,
    "spatial_four_bar": None,
    "hmmwv14": 2.0,
}
#: With accelerations of 1e6 rad/s² a position off by the tolerance is a velocity off by thousands.
UNBOUNDED = {("andrews", "velocity")}
#: Expected slopes other than 1: h follows the estimate, of order 3 in Radau IIA, and the error the
#: formula, whose order 5 shows on models that are not stiff.
SLOPES = {"ForRadau": (1.0, 1.25)}


def measured(name: str, codes: list[str], tolerances: list[float]) -> Comparison:
    """Compare codes on a model of the library; fails where the reference is in doubt."""
    comparison = holonom.compare(
        MODELS / name / "model.toml",
        methods=codes,
        tolerances=tolerances,
        end_time=ENDS[name],
        channels=["positions", "velocities"],
        repeat=0,
    )
    assert comparison.warnings == ()
    return comparison


def faults(name: str, comparison: Comparison) -> list[str]:
    """Return what is out of bounds, in words."""
    found = []
    for row in comparison.rows:
        where = f"{row.method} on {name} at {row.tolerance.relative:g}"
        if row.status != "completed":
            found.append(f"{where}: {row.status}, {row.message}")
            continue
        for kind, (least, greatest) in BOUNDS.items():
            if (name, kind) not in UNBOUNDED:
                value = row.measure_of(kind)
                if not least <= value <= greatest:
                    found.append(f"{where}: {kind} off by {value:.2g} tolerances")
    return found


def slopes(comparison: Comparison, kind: str) -> dict[str, float]:
    """Return the log-log slope of error over the tolerance by code, by least squares."""
    out = {}
    for code in comparison.methods:
        rows = comparison.of(code)
        x = [math.log10(row.tolerance.relative) for row in rows]
        y = [math.log10(row.measure_of(kind) * row.tolerance.relative) for row in rows]
        out[code] = statistics.linear_regression(x, y).slope
    return out


@pytest.mark.parametrize("name", ENDS)
def test_errors_stay_near_loose_tolerances(name: str) -> None:
    tolerances = TOLERANCES[:2] if name == "hmmwv14" else TOLERANCES[:3]
    found = faults(name, measured(name, CODES, tolerances))
    assert not found, "\n".join(found)


@pytest.mark.long
@pytest.mark.parametrize("name", ENDS)
def test_errors_follow_the_tolerance(name: str) -> None:
    comparison = measured(name, CODES, TOLERANCES)
    found = faults(name, comparison)
    assert not found, "\n".join(found)
    for kind in BOUNDS:
        if (name, kind) in UNBOUNDED:
            continue
        for code, slope in slopes(comparison, kind).items():
            least, greatest = SLOPES.get(code, (1.0, 1.0))
            if not least - SLOPE <= slope <= greatest + SLOPE:
                found.append(f"{code} on {name}: slope {slope:.2f} of {kind} errors")
    assert not found, "\n".join(found)
