"""Numbers as the page reads them: little-endian, base64, as short as the eye allows."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Code of a number that is not finite; the largest finite one is a step below.
_MISSING = 65535


def floats(values: Array) -> dict[str, str]:
    """Return numbers in single precision."""
    return _packed("f4", values)


def indices(faces: list[list[int]]) -> dict[str, str]:
    """Return triangles by the numbers of their corners, in 32 bits each."""
    return _packed("u4", np.array(faces))


def halves(values: Array) -> dict[str, str]:
    """Return numbers in half precision, three digits; the largest is 65,504."""
    return _packed("f2", half(values))


def half(values: Array) -> Array:
    """Return numbers as the page has them in half precision."""
    return np.clip(values, -65504.0, 65504.0).astype("f2").astype(np.float64)


def turns(euler_parameters: Array) -> dict[str, str]:
    """Return orientations in 16 bits per parameter: 6e-5 rad.

    Parameters
    ----------
    euler_parameters : ndarray, shape (n_times, 4)
    """
    return _packed("i2", np.rint(32767.0 * euler_parameters))


def curves(values: Array, low: Array, high: Array) -> dict[str, str]:
    """Return curves in 16 bits.

    Parameters
    ----------
    values : ndarray, shape (n_times, n)
    low, high : ndarray, shape (n,)
        Smallest and largest value of each; see `limits`.
    """
    span = np.where(high > low, high - low, 1.0)
    codes = np.rint((_MISSING - 1) * (values - low) / span)
    return _packed("u2", np.where(np.isfinite(values), codes, _MISSING))


def limits(values: Array) -> tuple[Array, Array]:
    """Return the smallest and the largest finite value of every column; zero where there is none.

    Parameters
    ----------
    values : ndarray, shape (n_times, n)
    """
    finite = np.isfinite(values)
    low = np.where(finite, values, np.inf).min(axis=0, initial=np.inf)
    high = np.where(finite, values, -np.inf).max(axis=0, initial=-np.inf)
    return np.where(low > high, 0.0, low), np.where(low > high, 0.0, high)


def unpacked(blob: dict[str, str]) -> NDArray[Any]:
    """Return what one of these functions made, as one row of numbers."""
    return np.frombuffer(base64.b64decode(blob["data"]), f"<{blob['kind']}")


def _packed(kind: str, values: NDArray[Any]) -> dict[str, str]:
    data = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"kind": kind, "data": base64.b64encode(data).decode("ascii")}
