"""What methods are compared with: references made on the spot, stored, of other models, damaged."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import OSCILLATOR, displacement

import holonom
from holonom import Comparison
from holonom.cli.commands import invoke


def test_the_reference_is_made_by_two_codes_that_agree(oscillator: holonom.Model) -> None:
    comparison = holonom.compare(
        oscillator, methods=["ForSDIRK"], tolerances=[{"relative": 1e-4, "rotation": 1e-6}],
        repeat=0,
    )  # fmt: skip
    reference = comparison.reference
    assert reference is not None
    expected = {"relative": 1e-7, "translation": 1e-7, "rotation": 1e-9}
    assert reference.tolerance == pytest.approx(expected, rel=1e-12)
    known = {method["name"]: method["formula"] for method in holonom.methods()}
    assert known[reference.method] != known[reference.check_method]
    assert reference.difference is not None
    assert 0.0 < reference.difference < 0.1
    assert comparison.rows[0].cpu_seconds is None


def test_a_reference_that_its_check_contradicts_is_warned_of(oscillator: holonom.Model) -> None:
    comparison = holonom.compare(
        oscillator, methods=["DEABM"], tolerances=[1e-9], reference_tolerance=1e-5, repeat=0
    )
    assert any("in doubt" in warning for warning in comparison.warnings)


def test_a_stored_reference_is_compared_at_its_own_times(
    oscillator: holonom.Model, tmp_path: Path
) -> None:
    path = tmp_path / "reference.holonom"
    made = holonom.compare(
        oscillator, methods=["ForSDIRK"], tolerances=[1e-4], save_reference=path, repeat=0
    )
    with holonom.load(path) as reference:
        assert made.reference is not None
        assert reference.meta["method"] == made.reference.method
        for given in (path, str(path), reference):
            again = holonom.compare(
                oscillator, methods=["ForSDIRK"], tolerances=[1e-4], reference=given, repeat=0
            )
            assert again.rows[0].errors == made.rows[0].errors
            assert again.reference is not None
            assert again.reference.path == str(path)
            assert again.warnings == ()


def test_grids_that_differ_are_interpolated_and_coarse_ones_warned_of(
    oscillator: holonom.Model,
) -> None:
    fine = oscillator.simulate(tolerance=1e-10, interval=1e-3)
    coarse = oscillator.simulate(tolerance=1e-10, interval=0.05)
    times = np.linspace(0.0, 1.0, 38)

    def compared(reference: holonom.Result) -> Comparison:
        return holonom.compare(
            oscillator, methods=["ForSDIRK"], tolerances=[1e-5], reference=reference,
            output_times=times, channels=["block.position[0]"], repeat=0,
        )  # fmt: skip

    run = oscillator.simulate(method="ForSDIRK", tolerance=1e-5, output_times=times)
    delta = np.abs(run["block.position"][:, 0] - displacement(times)).max()
    good = compared(fine)
    assert good.rows[0].errors[0].delta == pytest.approx(delta, rel=0.01)
    assert good.warnings == ()
    assert any("too far apart" in warning for warning in compared(coarse).warnings)


def test_a_reference_of_other_values_or_of_too_short_a_time_is_told(
    oscillator: holonom.Model,
) -> None:
    short = oscillator.simulate(end_time=0.5, interval=0.01)
    with pytest.raises(holonom.UsageError, match=r"ends at 0\.5 s"):
        holonom.compare(oscillator, reference=short, end_time=1.0)
    other = oscillator.with_values({"bodies.block.mass": 1.1})
    comparison = holonom.compare(
        other, methods=["ForSDIRK"], tolerances=[1e-3], reference=short, repeat=0
    )
    assert comparison.end_time == 0.5
    assert any("another model" in warning for warning in comparison.warnings)
    assert comparison.rows[0].measure is not None
    assert comparison.rows[0].measure > 10.0  # the other mass is seen


def test_a_reference_of_another_model_is_compared_in_what_both_have() -> None:
    text = """
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
arm = { mass = 1.0, inertia = 0.1, position = [1.0, 0.0] }
tip = { mass = 1.0, inertia = 0.1, position = [3.0, 0.0] }
[simulation]
end_time = 0.2
"""
    model = holonom.Model.from_text(text)
    renamed = text.replace("tip", "end")
    other = holonom.Model.from_text(renamed).simulate(interval=0.1, tolerance=1e-9)
    asked: dict[str, Any] = {"methods": ["ForSDIRK"], "tolerances": [1e-3], "repeat": 0}
    comparison = holonom.compare(model, reference=other, **asked)
    # The arm falls alike in both: only names differ.
    assert comparison.channels == ("arm.position[0]", "arm.position[1]", "arm.angle")
    assert comparison.rows[0].measure is not None
    assert comparison.rows[0].measure < 1.0
    (said,) = [warning for warning in comparison.warnings if "which has no" in warning]
    assert "no `tip.position`, `tip.angle`, while this one has no `end.position`" in said
    with pytest.raises(holonom.UsageError, match=r"which has no `tip\.position`") as caught:
        holonom.compare(model, reference=other, channels=["tip.position"], **asked)
    assert "`arm.position`" in str(caught.value)
    nothing = holonom.Model.from_text(renamed.replace("arm", "leg")).simulate(interval=0.1)
    with pytest.raises(holonom.UsageError, match="is of another model"):
        holonom.compare(model, reference=nothing, **asked)


@pytest.mark.parametrize("lost", ["spring.length", "q"])
def test_a_reference_that_has_lost_what_is_compared_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lost: str
) -> None:
    """What is left of it serves for other channels, and is told to be damaged."""
    model, path = tmp_path / "block.toml", tmp_path / "reference.holonom"
    model.write_text(OSCILLATOR)
    line = ["run", str(model), "-q", "--tolerance", "1e-8", "-c", "spring.length,block.velocity"]
    assert invoke([*line, "-o", str(path)]) == 0
    with closing(sqlite3.connect(path)) as db:
        select = "SELECT id FROM quantity WHERE name = ?"
        change = f"UPDATE data SET blob = zeroblob(length(blob)) WHERE quantity = ({select})"
        assert db.execute(change, (lost,)).rowcount
        db.execute("UPDATE meta SET value = '7' WHERE key = 'dof'")
        db.commit()
    line = ["compare", str(model), "--method", "ForRadau", "--tolerance", "1e-3", "--repeat", "0"]
    line += ["--reference", str(path), "--recover", "--json"]
    asked = "spring.length" if lost == "spring.length" else "block.position"
    assert invoke([*line, "-c", asked]) == 1
    told = json.loads(capsys.readouterr().out)["error"]["message"]
    assert f"`{lost}`" in told
    assert invoke([*line, "-c", "block.velocity"]) == 0
    output = capsys.readouterr()
    (row,) = json.loads(output.out)["rows"]
    assert row["measure"] < 10.0
    assert "lost are: the entry `dof` of its description [result/damaged]" in output.err


def test_what_a_reference_has_lost_beyond_the_comparison_does_not_matter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = holonom.Model.from_text(OSCILLATOR)
    names = ["spring.length"]
    reference = model.simulate(end_time=1.0, interval=0.01, tolerance=1e-8, channels=names)
    asked: dict[str, Any] = {
        "methods": ["ForRadau"], "tolerances": [1e-3], "repeat": 0, "interval": 0.05,
        "channels": names, "end_time": 0.5,
    }  # fmt: skip
    whole = holonom.compare(model, reference=reference, **asked).rows[0].measure
    length = reference["spring.length"].copy()
    length[60:] = np.nan
    monkeypatch.setitem(reference._kept, "spring.length", length)
    assert holonom.compare(model, reference=reference, **asked).rows[0].measure == whole
    length[40] = np.nan
    with pytest.raises(holonom.UsageError, match="has lost 42 of 101 rows"):
        holonom.compare(model, reference=reference, **asked)
