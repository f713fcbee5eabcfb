"""The error analysis of comparisons, on known functions."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from holonom import Tolerance
from holonom.study.accuracy import Target, Truth, interpolate


def truth(
    target: Target, f: Callable[[np.ndarray], np.ndarray], nodes: np.ndarray, times: np.ndarray
) -> Truth:
    return Truth([target], nodes, {target.channel: f(nodes).reshape(nodes.size, -1)}, times)


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4),
    st.lists(st.floats(0.01, 1.0), min_size=4, max_size=12),
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=9),
)
def test_interpolation_reproduces_cubics_on_any_grid(
    coefficients: list[float], spacings: list[float], places: list[float]
) -> None:
    nodes = np.cumsum(spacings)
    times = nodes[0] + (nodes[-1] - nodes[0]) * np.array(places)
    values = interpolate(nodes, np.polyval(coefficients, nodes), times)
    scale = np.abs(np.polyval(np.abs(coefficients), nodes[-1])) + 1e-12
    # Round-off grows with the spread of the spacings: a factor of 100 between neighbours.
    np.testing.assert_allclose(values, np.polyval(coefficients, times), atol=1e-9 * scale, rtol=0.0)


def test_interpolation_is_exact_at_nodes_and_has_order_four() -> None:
    nodes = np.linspace(0.0, 2.0, 21)
    np.testing.assert_array_equal(interpolate(nodes, np.sin(nodes), nodes), np.sin(nodes))
    times = np.linspace(0.0, 2.0, 777)
    errors = []
    for count in (41, 81, 161):
        nodes = np.linspace(0.0, 2.0, count)
        errors.append(np.abs(interpolate(nodes, np.sin(5.0 * nodes), times) - np.sin(5.0 * times)))
    orders = [np.log2(a.max() / b.max()) for a, b in itertools.pairwise(errors)]
    np.testing.assert_allclose(orders, 4.0, atol=0.2)


def test_a_known_offset_is_found_within_one_percent() -> None:
    # Reference: sin on 2001 points; run: the exact sin with an offset that grows to 1e-6 at t*.
    def offset(t: np.ndarray) -> np.ndarray:
        return 1e-6 * np.exp(-((t - 1.234) ** 2) / 0.02)

    nodes, times = np.linspace(0.0, 2.0, 2001), np.linspace(0.0, 2.0, 97)
    at = times[np.argmin(np.abs(times - 1.234))]
    target = Target("a.angle", "a", 0, "rad")
    (error,) = truth(target, lambda t: np.sin(3.0 * t), nodes, times).errors(
        {"a": (np.sin(3.0 * times) + offset(times))[:, None]}, Tolerance(1e-5, 2e-5, 3e-5)
    )
    expected = offset(times)
    assert error.delta == pytest.approx(expected.max(), rel=0.01)  # (5.2)
    assert error.time == at
    # (5.3): the root of the sum, divided by n.
    assert error.mean == pytest.approx(np.sqrt((expected**2).sum()) / 97, rel=0.01)
    there = abs(np.sin(3.0 * at))
    assert error.relative == pytest.approx(100.0 * expected.max() / there, rel=0.01)  # (5.4)
    scaled = (expected / (3e-5 + 1e-5 * np.abs(np.sin(3.0 * times)))).max()
    assert error.scaled == pytest.approx(scaled, rel=0.01)
    assert error.interpolation < 0.01 * error.delta


@pytest.mark.parametrize("count", [21, 41, 201])
def test_the_interpolation_error_is_estimated_to_its_order_of_magnitude(count: int) -> None:
    nodes, times = np.linspace(0.0, 2.0, count), np.linspace(0.0, 2.0, 97)
    exact = np.sin(5.0 * times)
    target = Target("a", "a", 0, "m")
    (error,) = truth(target, lambda t: np.sin(5.0 * t), nodes, times).errors(
        {"a": exact[:, None]}, Tolerance(1e-5)
    )
    # A run without error: what is found is the interpolation error itself.
    assert 0.5 * error.delta < error.interpolation < 5.0 * error.delta


def test_rel_err_is_left_out_where_the_reference_is_near_zero() -> None:
    times = np.linspace(0.0, 1.0, 11)
    run = times.copy()
    run[0] += 0.25
    (error,) = truth(Target("a", "a", 0, "m"), lambda t: t, times, times).errors(
        {"a": run[:, None]}, Tolerance(1e-3)
    )
    assert (error.time, error.delta, error.relative) == (0.0, 0.25, None)


@pytest.mark.parametrize(
    ("unit", "absolute"),
    [("m", 2e-3), ("m/s", 2e-3), ("rad", 4e-3), ("rad/s", 4e-3), ("N", 1e-3 * 3.0)],
)
def test_the_absolute_tolerance_goes_by_the_unit(unit: str, absolute: float) -> None:
    # The reference runs from 0 to 3; the error stands where it is zero. A force has no absolute
    # tolerance of its own: the relative one of its largest value.
    times = np.linspace(0.0, 3.0, 4)
    run = times.copy()
    run[0] += 0.1
    (error,) = truth(Target("a", "a", 0, unit), lambda t: t, times, times).errors(
        {"a": run[:, None]}, Tolerance(1e-3, 2e-3, 4e-3)
    )
    assert error.scaled == pytest.approx(0.1 / absolute)


def test_orientations_are_compared_by_their_angle_and_either_sign() -> None:
    def turned(angle: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(angle)
        return np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=1)

    nodes, times = np.linspace(0.0, 9.0, 901), np.linspace(0.0, 9.0, 64)
    reference = turned(nodes)
    reference[::2] *= -1.0  # the same orientations
    run = turned(times + 1e-3)
    run[::3] *= -1.0
    target = Target("b.euler_parameters", "b", None, "rad", "turn")
    (error,) = Truth([target], nodes, {"b": reference}, times).errors({"b": run}, Tolerance(1e-3))
    assert error.delta == pytest.approx(1e-3, rel=1e-3)  # 2|δp| is 4 sin(δ/4)
    assert error.unit == "rad"
    # The reference's own angle is at most π.
    assert error.scaled >= 1e-3 / (1e-3 * (1.0 + np.pi))
