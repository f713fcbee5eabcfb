"""What is asked of a run: accepted values come back, everything else is refused by name."""

from __future__ import annotations

import inspect
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from conftest import PENDULUM

import holonom
from holonom import Options, Tolerance, UsageError
from holonom.model import Arguments
from holonom.options import Choices, times_at


def test_stated_choices_are_plain_data() -> None:
    options = Options(
        end_time=np.float64(2.5), tolerance=1e-4, output_times=np.array([0.0, 1.0]), max_steps=10
    )
    tolerance = {"relative": 1e-4, "translation": 1e-4, "rotation": 1e-4}
    assert options.to_dict() == {
        "end_time": 2.5,
        "tolerance": tolerance,
        "output_times": [0.0, 1.0],
        "max_steps": 10,
    }


def test_parts_of_a_tolerance_that_are_not_stated_are_those_of_the_default() -> None:
    default = {"relative": 1e-3, "translation": 1e-4, "rotation": 1e-5}
    assert Tolerance.of({"relative": 1e-6}, default) == Tolerance(1e-6, 1e-4, 1e-5)
    assert Tolerance.of({"rotation": 1e-6}, default) == Tolerance(1e-3, 1e-4, 1e-6)
    assert Tolerance.of(1e-6, default) == Tolerance(1e-6, 1e-6, 1e-6)
    assert Options(tolerance={"rotation": 1e-6}).to_dict() == {"tolerance": {"rotation": 1e-6}}


@pytest.mark.parametrize(
    ("choices", "named"),
    [
        ({"tolerance": 0.0}, "tolerance.relative"),
        ({"tolerance": math.nan}, "tolerance.relative"),
        ({"tolerance": "small"}, "tolerance.relative"),
        ({"tolerance": {"relative": 1e-3, "rotation": -1.0}}, "tolerance.rotation"),
        ({"tolerance": {"relativ": 1e-3}}, "relativ"),
        ({"tolerance": {}}, "relative"),
        ({"end_time": math.inf}, "end_time"),
        ({"end_time": True}, "end_time"),
        ({"end_time": 1.0, "start_time": 2.0}, "end_time"),
        ({"interval": 0.0}, "interval"),
        ({"interval": 0.1, "output_times": [0.0, 1.0]}, "output_times"),
        ({"output_times": []}, "output_times"),
        ({"output_times": [0.0, 1.0, 1.0]}, r"output_times\[2\]"),
        ({"output_times": [0.0, math.nan]}, r"output_times\[1\]"),
        ({"fixed_step": -1e-3}, "fixed_step"),
        ({"max_steps": 0}, "max_steps"),
        ({"threads": 0}, "`threads` is 0\n.* from 1 to 1024$"),
        ({"end_time": np.complex128(1 + 2j)}, "end_time"),
        ({"max_steps": 1.5}, "max_steps"),
        ({"repartition_factor": 1.0}, "repartition_factor"),
        ({"channels": "rod.position"}, "channels"),
        ({"parametrization": "tangent"}, "did you mean `tangent_plane`"),
        ({"parametrization": "lagrange"}, "tangent_plane_svd"),
        ({"jacobian": "numeric"}, "differences"),
    ],
)
def test_what_cannot_be_used_is_named(choices: dict[str, Any], named: str) -> None:
    with pytest.raises(UsageError, match=named):
        Options(**choices)


def test_truth_values_of_numpy_are_taken() -> None:
    assert Options(dense_output=np.bool_(False)).dense_output is False


@pytest.mark.parametrize("stated", ["newmark_gamma", "newmark_beta"])
@pytest.mark.parametrize("value", [0.25, 0.5])
def test_the_number_of_another_formula_is_named_as_it_was_stated(stated: str, value: float) -> None:
    choices: dict[str, Any] = {"method": "ForSDIRK", stated: value}
    with pytest.raises(UsageError, match=f"`{stated}` is {value}"):
        holonom.Model.from_text(PENDULUM).simulate(**choices)


def test_choices_that_a_model_keeps_are_those_of_the_call() -> None:
    """Runs in threads share the model; independent truth: a model of its own for each choice."""
    shared = holonom.Model.from_text(PENDULUM)
    choices = [
        {"end_time": 0.01 * k, "tolerance": 10.0**-k, "channels": ["rod.angle"]} for k in (2, 3, 4)
    ]
    expected = [holonom.Model.from_text(PENDULUM).simulate(**own) for own in choices]
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(lambda k: (k, shared.simulate(**choices[k])), [0, 1, 2] * 40))
    for k, result in results:
        assert result.options == expected[k].options
        assert result.requested == ["rod.angle"]
        np.testing.assert_array_equal(result["q"], expected[k]["q"])
    first, second = (shared.simulate(**choices[0]) for _ in range(2))
    first.options["tolerance"]["relative"] = first.meta["model"]["bodies"]["rod"]["mass"] = 0.0
    first.meta["options"]["channels"].clear()
    assert second.options == expected[0].options
    assert second.meta["model"] == shared.to_dict() == expected[0].meta["model"]


def test_keywords_are_typed_and_told_as_the_options_are() -> None:
    types = {about.name: about.type for about in fields(holonom.Options)}
    assert {name: kind.__forward_arg__ for name, kind in Choices.__annotations__.items()} == types
    simulate = inspect.signature(holonom.Model.simulate)
    assert Arguments.__annotations__.keys() == simulate.parameters.keys() - {"self"}
    told = str(inspect.getdoc(holonom.Model.simulate))
    assert all(f"\n{name} : " in told for name in types)
    assert "CHOICES" not in told + str(holonom.compare.__doc__)
    assert "max_seconds" in inspect.signature(holonom.compare).parameters


def test_options_are_shared_by_runs() -> None:
    model = holonom.Model.from_text(PENDULUM)
    shared = holonom.Options(end_time=0.5, tolerance=1e-3, method="ForSDIRK")
    used = model.simulate(options=shared, end_time=0.25).options
    assert (used["end_time"], used["method"]) == (0.25, "ForSDIRK")
    assert used["tolerance"]["relative"] == 1e-3
    with pytest.raises(holonom.UsageError, match="`options` is"):
        model.simulate(options={"end_time": 0.5})  # type: ignore[arg-type]


@pytest.mark.parametrize("other", ["max_step", "initial_step"])
def test_a_fixed_step_has_no_other_sizes_beside_it(other: str) -> None:
    model = holonom.Model.from_text(PENDULUM)
    with pytest.raises(holonom.UsageError, match=f"both `fixed_step` and `{other}`"):
        model.simulate(**{"fixed_step": 0.01, other: 0.001})


def test_names_that_can_be_read_once_are_kept() -> None:
    names = ["rod.position", "pin.force"]
    assert Options(channels=(name for name in names)).to_dict() == {"channels": names}
    assert Options(channels=map(str, names)).channels == tuple(names)


@pytest.mark.parametrize("interval", [0.3, 0.25, 1.0 / 3.0, 0.1, 0.1 + 1e-9, 0.7, 1.0, 5.0])
def test_times_at_an_interval_are_the_rows_of_a_run(interval: float) -> None:
    """Against the core, which makes its rows itself: multiples, and the end."""
    model = holonom.Model.from_text(PENDULUM)
    rows = model.simulate(start_time=0.2, end_time=1.2, interval=interval, tolerance=1e-2).time
    assert times_at(interval, 0.2, 1.2) == rows.tolist()


@pytest.mark.parametrize("interval", [1e-12, 1e-320, 0.0, float("nan"), "1"])
def test_an_interval_that_makes_too_many_times_is_refused(interval: Any) -> None:
    with pytest.raises(UsageError, match="`--interval` is"):
        times_at(interval, 0.0, 1.0, name="--interval")
