"""Two results side by side: differences that are known because they were put there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import CHANNELS, META, PENDULUM, SUMMARY, oscillator_text, synthetic_chunk

import holonom
from holonom.base.errors import UsageError
from holonom.cli.commands import invoke
from holonom.result import Result
from holonom.store.reader import Reader
from holonom.store.writer import Writer
from holonom.study.differences import diff

TOLERANCE = {"relative": 1e-3, "translation": 1e-2, "rotation": 1e-2}


def made(**changes: Any) -> Result:
    """Return a result in memory whose channels were changed from the 120th row on."""
    writer = Writer(None, META | {"options": {"tolerance": TOLERANCE}}, CHANNELS)
    chunk = synthetic_chunk(0, 200)
    for name, offset in changes.items():
        channel = name.replace("__", ".")
        chunk["channels"][channel] = chunk["channels"][channel].copy()
        chunk["channels"][channel][120:] += offset
    writer.append(chunk)
    writer.finish(SUMMARY)
    return Result(Reader.of(writer))


def test_a_result_is_equal_to_itself() -> None:
    found = diff(made(), made())
    assert found.equal
    assert {c.tolerances for c in found.channels} == {0.0}
    assert found.times == 200
    assert [c.name for c in found.channels] == [
        "rod.position",
        "energy.kinetic",
        "energy.imbalance",
    ]
    assert "equal" in str(found)


def test_a_difference_is_told_with_channel_tolerances_and_since_when() -> None:
    found = diff(made(), made(rod__position=np.array([0.3, 0.4]), energy__kinetic=1e-3))
    (one,) = found.differing
    assert (one.name, one.since, one.unit) == ("rod.position", 1.2, "m")
    assert one.difference == pytest.approx(0.5)
    # By hand: 0.5 m over 1e-2 m and a thousandth of the way from (0, 1) that the second has gone.
    t = 0.01 * np.arange(120, 200)
    moved = np.hypot(np.sin(t) + 0.3, np.cos(t) + 0.4 - 1.0)
    assert one.tolerances == pytest.approx((0.5 / (1e-2 + 1e-3 * moved)).max(), rel=1e-12)
    assert not found.equal
    # 1e-3 J of 1.99² J, in thousandths of it.
    (kinetic,) = [c for c in found.channels if c.name == "energy.kinetic"]
    assert kinetic.tolerances == pytest.approx(1.0 / (1.99**2 + 1e-3), rel=1e-9)
    assert kinetic.since is None


def test_the_bound_and_the_tolerance_are_those_asked_for() -> None:
    pair = made(), made(rod__position=np.array([0.3, 0.4]))
    assert diff(*pair, within=100.0).equal
    assert diff(*pair, tolerance=1.0).equal
    assert diff(*pair, end=1.19).equal
    assert not diff(*pair, end=1.2).equal
    assert diff(*pair, ["energy.*"]).equal
    assert diff(*pair, ["rod.position[0]"]).channels[0].difference == pytest.approx(0.3)


def test_a_row_that_is_lost_in_one_file_is_no_equality() -> None:
    found = diff(made(), made(energy__kinetic=np.nan), ["energy.kinetic"])
    assert found.differing[0].since == 1.2
    assert found.to_json()["channels"][0]["tolerances"] is None  # JSON knows no infinity
    both = made(energy__kinetic=np.nan), made(energy__kinetic=np.nan)
    assert diff(*both, ["energy.kinetic"]).equal


def test_what_is_infinite_in_one_file_makes_no_tolerance_infinite() -> None:
    (one,) = diff(made(), made(energy__kinetic=np.inf), ["energy.kinetic"]).channels
    assert (one.since, one.difference, one.tolerances) == (1.2, np.inf, np.inf)
    assert one.tolerance == pytest.approx(1e-3 * 1.99**2)  # of the largest energy that is known


@pytest.mark.parametrize("rows", [1, 16, 2000])
def test_the_first_row_beyond_a_tolerance_that_the_last_row_decides_is_found(
    rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("holonom.study.differences._ROWS", rows)
    offset = np.zeros(80)
    offset[[10, 20, 30, 50, 60]] = 3e-3, 8e-3, 5e-3, 9e-3, 9e-3
    (one,) = diff(made(), made(energy__kinetic=offset), ["energy.kinetic"]).channels
    # By hand: a thousandth of the largest energy, 1.99² J at the end.
    assert one.tolerances == pytest.approx(9e-3 / (1e-3 * 1.99**2))
    assert (one.time, one.since) == pytest.approx((1.7, 1.4))


def run(text: str = PENDULUM, **choices: Any) -> Result:
    return holonom.Model.from_text(text).simulate(**choices)


def test_other_output_times_of_the_same_steps_are_no_difference() -> None:
    # Independent truth: output times change no bit of the steps, so only round-off is left.
    found = diff(run(interval=0.01), run(interval=0.007))
    assert found.times > 200
    assert found.worst is not None
    assert found.worst.tolerances < 1e-4


def test_looser_tolerances_are_those_that_count_and_tighter_ones_find_more() -> None:
    loose, tight = run(tolerance=1e-3), run(tolerance=1e-9)
    found = diff(loose, tight)
    assert found.tolerance == dict.fromkeys(TOLERANCE, 1e-3)
    # The tight run is the truth: the difference is the error of the loose one, which keeps its
    # tolerance within the factor of a run of 1 s.
    assert diff(loose, tight, within=30.0).equal
    assert not diff(loose, tight, tolerance=1e-9).equal


def test_without_common_channels_the_motion_is_compared() -> None:
    text = oscillator_text(mass=1.0, x=0.2, stiffness=50.0, free_length=1.0)
    found = diff(run(text, end_time=1.0), run(text.replace("50.0", "55.0"), end_time=1.0))
    assert "block.position" in {c.name for c in found.differing}
    # x(t) differ from the start on, so the first time that differs is early in the first period.
    assert found.differing[0].since is not None
    assert found.differing[0].since < 2.0 * np.pi / np.sqrt(50.0)


def test_a_shorter_run_is_not_equal_unless_a_part_is_asked_for() -> None:
    whole, part = run(), run(end_time=0.5)
    found = diff(whole, part)
    assert not found.differing
    assert not found.equal
    assert "0 to 1 s, the second 0 to 0.5 s" in found.uncovered
    assert "not the same time" in str(found)
    assert diff(whole, part, end=0.5).equal


def test_a_channel_of_one_model_only_is_a_difference() -> None:
    renamed = PENDULUM.replace("rod", "bar")
    found = diff(run(), run(renamed))
    assert found.only_first == ("rod.position",)
    assert found.only_second == ("bar.position",)
    assert not found.equal
    assert not found.differing
    # What both have is the same, and still the results are not equal.
    text = str(found)
    assert "different models" in text
    assert "equal in common" in text
    assert "\nequal  " not in text


def test_rows_without_steps_are_compared_where_both_have_them() -> None:
    bare = run(dense_output=False, interval=0.02)
    assert diff(run(), bare).times == bare.time.size
    with pytest.raises(UsageError, match="no time in common"):
        diff(run(dense_output=False, output_times=[0.25, 0.75], interval=None), bare, end=0.0)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"channels": ["rod.positon"]}, "did you mean `rod.position`"),
        ({"channels": ["rod.position[3]"]}, "no component 3"),
        ({"within": 0.0}, "within"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"start": 0.5, "end": 0.2}, "no time in common"),
        ({"end": float("nan")}, "end"),
    ],
)
def test_what_cannot_be_compared_is_refused(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        diff(made(), made(), **arguments)


def test_planar_and_spatial_runs_have_no_vectors_in_common() -> None:
    spatial = """
holonom = 1
dimension = "spatial"
[bodies.rod]
position = [0.0, 0.0, 0.0]
mass = 1.0
inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
"""
    with pytest.raises(UsageError, match="as many components"):
        diff(run(), run(spatial, end_time=1.0), ["rod.position"])


def test_the_difference_of_large_results_is_that_of_their_rows(tmp_path: Path) -> None:
    # More rows than are compared at once.
    found = diff(run(interval=1e-4), run(interval=1e-4))
    assert found.times == 10001
    assert found.equal


def test_the_exit_status_tells_whether_results_are_equal(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.holonom"
    with Result.load(stored) as result:
        result.save(other)
    assert invoke(["diff", str(stored), str(other)]) == 0
    assert "equal" in capsys.readouterr().out
    pair = [str(tmp_path / f"{name}.holonom") for name in ("loose", "tight")]
    for path, tolerance in zip(pair, (1e-3, 1e-9), strict=True):
        run(tolerance=tolerance, output=path).close()
    assert invoke(["diff", *pair, "--tolerance", "1e-9", "--json"]) == 6
    found = json.loads(capsys.readouterr().out)
    assert found["equal"] is False
    assert {c["name"] for c in found["channels"]} >= {"rod.position", "pin.force", "energy.total"}
    assert all(c["differs"] == (c["tolerances"] > 1.0) for c in found["channels"])
    assert invoke(["diff", *pair, "--tolerance", "1e-9", "--within", "1e9", "-q"]) == 0
    assert capsys.readouterr().out == ""
    assert invoke(["diff", *pair, "rod.nothing"]) == 1
    assert invoke(["diff", pair[0], str(tmp_path / "none.holonom")]) == 5


def test_what_is_no_result_is_named(tmp_path: Path) -> None:
    model = holonom.Model.from_text(PENDULUM)
    result = model.simulate(end_time=0.05)
    for work in (
        lambda: holonom.diff(result, "run.holonom"),  # type: ignore[arg-type]
        lambda: holonom.diff(model, result),  # type: ignore[arg-type]
        lambda: result.plot("rod.position", others=["run.holonom"]),  # type: ignore[list-item]
        lambda: result.render(tmp_path / "rod.png", "run.holonom"),  # type: ignore[arg-type]
    ):
        with pytest.raises(UsageError, match="is no result"):
            work()
    # One result in place of a list of them is taken as it is meant.
    assert result.plot("rod.position", others=result) is not None  # type: ignore[arg-type]
