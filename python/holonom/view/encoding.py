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


def turns(euler_parameters: Array) -> dict[str, str]:
    """Return orientations in 16 bits per parameter: 6e-5 rad.

    Of the two signs that mean the same orientation each takes that of its predecessor, so that the
    page can turn from one to the next the short way.

    Parameters
    ----------
    euler_parameters : ndarray, shape (n_times, 4)
    """
    if not len(euler_parameters):
        return _packed("i2", euler_parameters)
    p = euler_parameters / np.linalg.norm(euler_parameters, axis=1, keepdims=True)
    flips = np.sum(p[1:] * p[:-1], axis=1) < 0.0
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips, -1.0, 1.0))])
    return _packed("i2", np.rint(32767.0 * p * signs[:, None]))


def ranges(values: Array) -> tuple[Array, Array]:
    """Return the least and the largest finite value of each column, ndarrays, shape (n,).

    Both are zero where there is none.
    """
    finite = np.isfinite(values)
    low = np.where(finite, values, np.inf).min(axis=0, initial=np.inf)
    high = np.where(finite, values, -np.inf).max(axis=0, initial=-np.inf)
    return np.where(low > high, 0.0, low), np.where(low > high, 0.0, high)


def curves(values: Array) -> dict[str, Any]:
    """Return curves in 16 bits, each over its own range.

    Parameters
    ----------
    values : ndarray, shape (n_times, n)
    """
    low, high = ranges(values)
    span = np.where(high > low, high - low, 1.0)
    codes = np.rint((_MISSING - 1) * (values - low) / span)
    codes = np.where(np.isfinite(values), codes, _MISSING)
    return _packed("u2", codes) | {"low": low.tolist(), "high": high.tolist()}


def unpacked(blob: dict[str, str]) -> NDArray[Any]:
    """Return what one of these functions made, as one row of numbers."""
    return np.frombuffer(base64.b64decode(blob["data"]), f"<{blob['kind']}")


def _packed(kind: str, values: NDArray[Any]) -> dict[str, str]:
    data = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"kind": kind, "data": base64.b64encode(data).decode("ascii")}
