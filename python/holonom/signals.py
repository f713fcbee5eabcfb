"""What may be made of a channel after a run: its derivative, its spectrum, the slow part of it.

NumPy arrays in and out; rows are times. Nothing here knows a mechanism: a channel that the core
has, such as a velocity, is exact, and the derivative of a position is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holonom.base.errors import UsageError
from holonom.base.names import did_you_mean, nearest
from holonom.base.plain import real
from holonom.base.text import quoted

Series = NDArray[np.float64]

#: Intervals that differ by this part are equal: times are rounded when they are computed.
_UNEVEN = 1e-6

#: Windows of a spectrum as sums of cosines, Σ (-1)ᵏ aₖ cos(2πk n/N).
WINDOWS = {
    "hann": (0.5, 0.5),
    "rectangular": (1.0,),
    # Amplitudes between two frequencies are right to 0.2 %; five coefficients of ISO 18431-2.
    "flat_top": (1.0, 1.933, 1.286, 0.388, 0.0322),
}


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Amplitudes of the sines that a signal consists of.

    Attributes
    ----------
    frequency : ndarray, shape (n_frequencies,)
        Hz: multiples of `resolution` up to half the rate of the samples.
    amplitude : ndarray, shape (n_frequencies, ...)
        In the unit of the signal: a sine of amplitude A shows A, whatever the window. The first is
        the size of the mean, which is taken away before the window.
    window : str
    resolution : float
        Hz: one over the length of the signal.
    """

    frequency: Series
    amplitude: Series
    window: str
    resolution: float


def derivative(time: ArrayLike, values: ArrayLike) -> Series:
    """Return the derivative of a signal over time: differences of second order.

    The parabola through each row and its neighbours has it, also where rows are unevenly spaced; at
    both ends that through the three nearest rows. What jumps becomes a peak as high as the rows are
    near; what is noisy gets noisier: filter it first.

    Parameters
    ----------
    time : array_like, shape (n_times,)
        s, rising.
    values : array_like, shape (n_times, ...)

    Returns
    -------
    ndarray, shape (n_times, ...)
        In the unit of the values per second.

    Raises
    ------
    UsageError
        If times do not rise, there are less than three, or values are not one row per time.
    """
    t, y = _signal(time, values, 3)
    return np.asarray(np.gradient(y, t, axis=0, edge_order=2))


def low_pass(time: ArrayLike, values: ArrayLike, cutoff: float) -> Series:
    """Return the slow part of a signal, without delay.

    A sine of frequency f keeps its phase, and 1/(1 + (f/cutoff)⁴) of its amplitude: what a
    Butterworth filter of second order leaves that runs over the signal forward and then backward.
    At the cutoff that is a half, an octave above 6 %. The straight line through both ends passes
    unchanged, and the rest is continued beyond them by point reflection, so that the first and the
    last value stay what they are.

    Parameters
    ----------
    time : array_like, shape (n_times,)
        s, evenly spaced: ``result.at(numpy.linspace(…))`` has a run there.
    values : array_like, shape (n_times, ...)
    cutoff : float
        Hz, below half the rate of the samples.

    Returns
    -------
    ndarray, shape (n_times, ...)

    Raises
    ------
    UsageError
        If times are not evenly spaced, the cutoff is not positive or not below half the rate, or a
        value is not finite.
    """
    t, y = _even(time, values)
    step = (t[-1] - t[0]) / (t.size - 1)
    _require_cutoff(cutoff, step)
    shape = (-1, *(1 for _ in y.shape[1:]))
    part = np.linspace(0.0, 1.0, t.size).reshape(shape)
    line = y[0] + part * (y[-1] - y[0])
    rest = y - line
    # Odd about both ends, so of period 2(n - 1).
    odd = np.concatenate([rest[:-1], -rest[:0:-1]])
    frequency = np.fft.rfftfreq(odd.shape[0], step)
    gain = 1.0 / (1.0 + (frequency / cutoff) ** 4)
    slow = np.fft.irfft(np.fft.rfft(odd, axis=0) * gain.reshape(shape), odd.shape[0], axis=0)
    return np.asarray(line + np.concatenate([slow[: t.size - 1], np.zeros_like(rest[:1])]))


def spectrum(time: ArrayLike, values: ArrayLike, window: str = "hann") -> Spectrum:
    """Return the amplitudes of a signal by frequency.

    Parameters
    ----------
    time : array_like, shape (n_times,)
        s, evenly spaced: ``result.at(numpy.linspace(…))`` has a run there.
    values : array_like, shape (n_times, ...)
    window : str
        ``hann``: the usual choice, lines 1.5 times the resolution apart are told apart;
        ``rectangular``: for a whole number of periods; ``flat_top``: amplitudes exact to 0.2 %
        between frequencies, lines five times the resolution wide.

    Returns
    -------
    Spectrum

    Raises
    ------
    UsageError
        If times are not evenly spaced, the window is not known, or a value is not finite.
    """
    coefficients = _coefficients(window)
    t, y = _even(time, values)
    count, step = t.size, (t[-1] - t[0]) / (t.size - 1)
    turn = 2.0 * np.pi * np.arange(count) / count
    weight = sum((-1.0) ** k * a * np.cos(k * turn) for k, a in enumerate(coefficients))
    shape = (-1, *(1 for _ in y.shape[1:]))
    mean = y.mean(axis=0)
    weighted = (y - mean) * np.reshape(weight, shape)
    amplitude = 2.0 * np.abs(np.fft.rfft(weighted, axis=0)) / (count * coefficients[0])
    if count % 2 == 0:
        amplitude[-1] *= 0.5  # the only one that has no mirror image
    amplitude[0] = np.abs(mean)
    return Spectrum(np.fft.rfftfreq(count, step), amplitude, window, 1.0 / (count * step))


def is_even(time: Series) -> bool:
    """Return whether times are evenly spaced, to round-off."""
    if time.size < 2:
        return True
    steps = np.diff(time)
    mean = (time[-1] - time[0]) / (time.size - 1)
    room = _UNEVEN * mean + 8.0 * np.spacing(np.abs(time).max())
    return bool(np.all(np.abs(steps - mean) <= room))


def _coefficients(window: str) -> tuple[float, ...]:
    if not isinstance(window, str) or window not in WINDOWS:
        tip = did_you_mean(nearest(window, WINDOWS), f"one of {', '.join(WINDOWS)}")
        raise UsageError(f"there is no window {quoted(str(window))}", help=tip)
    return WINDOWS[window]


def _require_cutoff(cutoff: float, step: float) -> None:
    try:
        hertz = float(real(cutoff))
    except (TypeError, ValueError, OverflowError):
        raise UsageError(
            f"the cutoff is {quoted(repr(cutoff))}", help="give a frequency, Hz"
        ) from None
    if not (hertz > 0.0 and np.isfinite(hertz)):
        raise UsageError(f"the cutoff is {hertz} Hz", help="it must be positive and finite")
    if hertz >= 0.5 / step:
        raise UsageError(
            f"the cutoff is {hertz:g} Hz, and rows {step:g} s apart hold nothing from "
            f"{0.5 / step:g} Hz on",
            help="take a lower cutoff, or rows nearer to each other (`interval`)",
        )


def _signal(time: ArrayLike, values: ArrayLike, least: int) -> tuple[Series, Series]:
    try:
        t, y = real(time), real(values)
    except (TypeError, ValueError, OverflowError):
        raise UsageError(
            "times or values are no numbers, or complex ones",
            help="pass arrays, such as `result.time`; of complex values one part after the other",
        ) from None
    if t.ndim != 1 or y.ndim < 1 or y.shape[0] != t.size:
        raise UsageError(
            f"times have the shape {t.shape} and values {y.shape}",
            help="pass a vector of times, and values with one row for each",
        )
    if t.size < least:
        raise UsageError(
            f"{t.size} rows are too few: this takes {least}",
            help="take more output times, or a longer part of the run",
        )
    if not np.all(np.diff(t) > 0.0):
        raise UsageError("times do not rise", help="sort them, and leave out equal ones")
    return t, y


def _even(time: ArrayLike, values: ArrayLike) -> tuple[Series, Series]:
    t, y = _signal(time, values, 4)
    if not is_even(t):
        raise UsageError(
            "times are not evenly spaced",
            help="take those of `result.at(numpy.linspace(first, last, count))`",
        )
    if not np.isfinite(y).all():
        raise UsageError(
            "a value is not finite", help="leave out the part of the run where that is so"
        )
    return t, y
