"""Derivatives, filters and spectra against sines, parabolas and an independent filter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from holonom.base.errors import UsageError
from holonom.signals import WINDOWS, derivative, is_even, low_pass, spectrum


def test_the_derivative_of_a_parabola_is_exact_on_uneven_times() -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.01, 0.2, 40))
    y = np.stack([3.0 * t**2 - t, np.full(40, 2.0)], axis=1)
    np.testing.assert_allclose(derivative(t, y)[:, 0], 6.0 * t - 1.0, atol=1e-10)
    np.testing.assert_allclose(derivative(t, y)[:, 1], 0.0, atol=1e-12)


def test_the_derivative_is_of_second_order() -> None:
    def error(count: int) -> float:
        t = np.linspace(0.0, 1.0, count)
        return float(np.abs(derivative(t, np.sin(5.0 * t)) - 5.0 * np.cos(5.0 * t)).max())

    assert error(101) / error(201) == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("ratio", [0.2, 1.0, 3.0])
def test_a_sine_keeps_its_phase_and_the_stated_part_of_its_size(ratio: float) -> None:
    t = np.linspace(0.0, 10.0, 5001)
    cutoff = 4.0
    y = np.sin(2.0 * np.pi * ratio * cutoff * t + 0.7)
    kept = low_pass(t, y, cutoff) / (1.0 / (1.0 + ratio**4))
    middle = slice(1500, 3500)  # the ends are held
    np.testing.assert_allclose(kept[middle], y[middle], atol=2e-3 * (1.0 + ratio**4))


def test_ends_and_straight_lines_pass() -> None:
    t = np.linspace(2.0, 3.0, 777)
    y = np.stack([5.0 - 3.0 * t, np.random.default_rng(2).normal(size=777)], axis=1)
    slow = low_pass(t, y, 10.0)
    np.testing.assert_allclose(slow[:, 0], y[:, 0], atol=1e-12)
    np.testing.assert_allclose(slow[[0, -1]], y[[0, -1]], atol=1e-12)


def test_the_filter_is_a_butterworth_filter_run_forward_and_backward() -> None:
    signal = pytest.importorskip("scipy.signal")
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 4.0, 4001)
    y = np.cumsum(rng.normal(size=t.size)) / 30.0
    b, a = signal.butter(2, 5.0, fs=1000.0)
    other = signal.filtfilt(b, a, y, padtype="odd", padlen=2000)
    middle = slice(800, 3200)
    # Its bilinear transform warps frequencies, by less than 1e-4 this far below the rate.
    assert np.abs(low_pass(t, y, 5.0) - other)[middle].max() < 2e-3 * np.ptp(y)


@pytest.mark.parametrize("window", WINDOWS)
def test_a_sine_shows_its_amplitude_at_its_frequency(window: str) -> None:
    t = np.arange(1000) / 500.0
    y = 1.5 + 0.25 * np.sin(2.0 * np.pi * 40.0 * t) + 2.0 * np.cos(2.0 * np.pi * 110.0 * t)
    found = spectrum(t, y, window)
    at = {hertz: int(np.argmin(np.abs(found.frequency - hertz))) for hertz in (0.0, 40.0, 110.0)}
    amplitudes = [found.amplitude[k] for k in at.values()]
    np.testing.assert_allclose(amplitudes, [1.5, 0.25, 2.0], rtol=1e-9)
    assert found.resolution == pytest.approx(0.5)
    assert found.frequency[-1] == pytest.approx(250.0)
    far = np.abs(found.frequency[:, None] - [0.0, 40.0, 110.0]).min(axis=1) > 5.0
    assert found.amplitude[far].max() < 1e-9


@pytest.mark.parametrize(
    ("window", "least"), [("rectangular", 0.63), ("hann", 0.84), ("flat_top", 0.998)]
)
def test_between_two_frequencies_a_window_shows_what_it_is_known_for(
    window: str, least: float
) -> None:
    t = np.arange(1000) / 500.0
    found = spectrum(t, np.sin(2.0 * np.pi * 40.25 * t), window)
    assert least <= found.amplitude.max() <= 1.001


def test_the_rectangular_spectrum_has_the_power_of_the_signal() -> None:
    for count in (512, 513):
        y = np.random.default_rng(count).normal(size=(count, 2))
        found = spectrum(np.arange(count) / 7.0, y, "rectangular")
        power = found.amplitude[1:] ** 2 / 2.0
        if count % 2 == 0:
            power[-1] *= 2.0
        np.testing.assert_allclose(
            found.amplitude[0] ** 2 + power.sum(axis=0), (y**2).mean(axis=0), rtol=1e-12
        )


def test_evenness_forgives_round_off_only() -> None:
    t = 1e4 + 0.01 * np.arange(1000)
    assert is_even(t)
    t[500] += 1e-6
    assert not is_even(t)


T = np.linspace(0.0, 1.0, 11)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: derivative(T[:2], T[:2]), "2 rows are too few"),
        (lambda: derivative(T[::-1], T), "do not rise"),
        (lambda: derivative(T, T[:5]), r"shape \(11,\) and values \(5,\)"),
        (lambda: derivative(["a"], [1.0]), "no numbers"),
        (lambda: low_pass(T, 1j * T, 1.0), "complex"),
        (lambda: derivative(T + 0j, T), "complex"),
        (lambda: spectrum(T, 1j * T), "complex"),
        (lambda: low_pass(T, T, np.complex128(1.0)), "the cutoff is"),
        (lambda: low_pass(T**2, T, 1.0), "not evenly spaced"),
        (lambda: low_pass(T, T, 5.0), "0.1 s apart hold nothing from 5 Hz on"),
        (lambda: low_pass(T, T, float("nan")), "positive and finite"),
        (lambda: low_pass(T, T, "fast"), "the cutoff is `'fast'`"),  # type: ignore[arg-type]
        (lambda: low_pass(T, np.where(T > 0.5, np.inf, T), 1.0), "not finite"),
        (lambda: spectrum(T, T, "hanning"), "hann"),
        (lambda: spectrum(T**2, T), "not evenly spaced"),
    ],
)
def test_what_cannot_be_done_is_refused(call: Callable[[], object], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        call()
