"""Round numbers along an axis, and how they are written."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

#: Numbers from 10⁻³ to 10⁴ are written out.
_SMALLEST, _LARGEST = -3, 4
#: Significant digits of a label; more are split into a common offset and the rest.
_DIGITS = 6


@dataclass(frozen=True, slots=True)
class Ticks:
    """Places on an axis with their labels.

    Attributes
    ----------
    values : tuple of float
        Rising.
    labels : tuple of str
        One for each value; empty where there is a mark only.
    scale : str
        What the numbers of the labels are multiplied by and added to, ``×10⁻⁶ + 0.45``; empty where
        they are the values.
    """

    values: tuple[float, ...]
    labels: tuple[str, ...]
    scale: str = ""


def limits(low: float, high: float, logarithmic: bool) -> tuple[float, float]:
    """Return the ends of an axis that shows values from `low` to `high` with some air."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return (0.1, 1.0) if logarithmic else (0.0, 1.0)
    if logarithmic:
        air = (high / low) ** 0.05 if high > 2.0 * low else 1.6
        return low / air, high * air
    least = max(1e-9 * max(abs(low), abs(high)), 1e-300)
    constant = high - low <= least
    air = 0.05 * (max(abs(low), abs(high)) or 20.0 if constant else high - low)
    return low - air, high + air


def linear(low: float, high: float, most: int) -> Ticks:
    """Return at most so many multiples of 1, 2, 2.5 or 5 times a power of ten in a range."""
    span = high - low
    power = math.floor(math.log10(span / most))
    steps = [f * 10.0**p for p in (power, power + 1) for f in (1.0, 2.0, 2.5, 5.0)]
    step = next((s for s in steps if _count(low, high, s) <= most), 10.0 * steps[-1])
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    values = [step * k + 0.0 for k in range(first, last + 1)]
    largest = max(map(abs, values), default=0.0)
    shown, scale = values, ""
    offset = 0.0
    if largest and math.log10(largest / step) > _DIGITS - 1:
        offset, largest = values[0], values[-1] - values[0]
        shown = [step * (k - first) for k in range(first, last + 1)]
    exponent = math.floor(math.log10(largest)) if largest else 0
    if not _SMALLEST < exponent <= _LARGEST:
        # A multiple of three, as units have their prefixes.
        exponent -= exponent % 3
        shown = [value / 10.0**exponent for value in shown]
        step /= 10.0**exponent
        scale = f"×{power_of_ten(exponent)}"
    if offset:
        scale = f"{scale} {'−' if offset < 0.0 else '+'} {abs(offset):.12g}".strip()
    # Zero alone needs none.
    decimals = max(0, -math.floor(math.log10(step) + 1e-9)) if largest else 0
    if largest and round(step, decimals) != round(step, decimals + 2):  # 2.5
        decimals += 1
    labels = tuple(f"{value:.{decimals}f}".replace("-", "−") for value in shown)
    return Ticks(tuple(values), labels, scale)


def logarithmic(low: float, high: float, most: int) -> Ticks:
    """Return powers of ten in a range; where these are few, also their doubles and fives."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    count = last - first + 1
    if count < 3:
        marks = [
            (digit, power)
            for power in range(first - 1, last + 1)
            for digit in between(low, high)
            if low <= digit * 10.0**power <= high
        ]
    else:
        every = math.ceil(count / most)
        # Counted from 10⁰, so that several axes agree.
        marks = [(1, power) for power in range(first, last + 1) if power % every == 0]
    plain = all(_SMALLEST <= power < _LARGEST for _, power in marks)
    labels = [
        f"{digit * 10.0**power:g}" if plain else f"{digit}×{power_of_ten(power)}".removeprefix("1×")
        for digit, power in marks
    ]
    return Ticks(tuple(digit * 10.0**power for digit, power in marks), tuple(labels))


def between(low: float, high: float) -> tuple[int, ...]:
    """Return the multiples of powers of ten that are labelled in a range."""
    decades = math.log10(high / low)
    if math.floor(math.log10(high) + 1e-9) - math.ceil(math.log10(low) - 1e-9) >= 2:
        return (1,)
    return (1, 2, 5) if decades > 0.5 else tuple(range(1, 10))


def power_of_ten(exponent: int) -> str:
    """Return a power of ten as it is written, ``10⁻⁶``."""
    return "10" + str(exponent).translate(_SUPERSCRIPT)


def _count(low: float, high: float, step: float) -> int:
    return int(np.floor(high / step + 1e-9) - np.ceil(low / step - 1e-9)) + 1
