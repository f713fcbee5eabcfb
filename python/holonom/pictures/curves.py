"""Channels of runs as curves: a part of a run, slow parts, derivatives, at times of one's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holonom import signals
from holonom.base.errors import UsageError
from holonom.base.text import quoted
from holonom.channels import component_units, components, split_component
from holonom.gauge import KINDS, own_tolerances, peak
from holonom.options import Tolerance, require_finite, require_positive, times_at

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.store.layout import Quantity

Series = NDArray[np.float64]

#: Rows that a curve is computed at, at most.
_MOST = 2_000_000

_DERIVATIVES = {
    "m": "m/s", "m/s": "m/s^2", "rad": "rad/s", "rad/s": "rad/s^2", "J": "W", "": "1/s",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """One channel of one run, or one component.

    Attributes
    ----------
    name, title, frame : str
        The title names a component by its word: ``chassis.yaw_pitch_roll, pitch``.
    time : ndarray, shape (n_times,)
        s.
    values : ndarray, shape (n_times, n)
    labels, units : list of str
        Of the components; one empty label for a scalar.
    tolerances : ndarray, shape (n,)
        Of the components, in `units`; what moves less than ten of them over the whole run is still.
    still : ndarray, shape (n,)
        Which components are.
    wraps : bool
        Whether these are angles that jump by a whole turn where they come to its end.
    """

    name: str
    title: str
    frame: str
    time: Series
    values: Series
    labels: list[str]
    units: list[str]
    tolerances: Series
    still: NDArray[np.bool_]
    wraps: bool = False


#: What moves less than so many tolerances is told to be still.
STILL = 10.0


def title(name: str, size: int) -> str:
    """Return a channel as it is written, a component by its word; `size` is the whole channel's."""
    whole, index = split_component(name)
    if index is None:
        return name
    return f"{whole}, {components(whole, size)[index]}"


def tolerance_of(result: Result) -> dict[str, float]:
    """Return the tolerance of a run, each part."""
    stated = result.options.get("tolerance") or 1e-4
    tolerance = Tolerance.of(stated, {"relative": 1e-4})
    return {part: float(getattr(tolerance, part)) for part in Tolerance.__slots__}


def peaks_of(result: Result) -> dict[str, float]:
    """Return the largest magnitudes of a run by which forces and energies are measured."""
    peaks = dict.fromkeys(KINDS.values(), 0.0)
    for name in ("lambda", "qdd"):
        if name in result.quantities:
            peaks[name] = peak(result[name])
    for name in result.channels:
        if name.startswith("energy."):
            peaks["energy"] = max(peaks["energy"], peak(result[name]))
    return peaks


def curves(
    result: Result,
    names: Sequence[str],
    *,
    start: float | None = None,
    end: float | None = None,
    interval: float | None = None,
    low_pass: float | None = None,
    derivative: bool = False,
    even: bool = False,
) -> list[Curves]:
    """Return channels of a run over time.

    The whole run is filtered and differentiated; then a part of it is cut out.

    Parameters
    ----------
    result : Result
    names : sequence of str
    start, end : float, optional
        Part of the run, s.
    interval : float, optional
        Time between the values, s; the stored rows when not given.
    low_pass : float, optional
        Cutoff of `holonom.signals.low_pass`, Hz.
    derivative : bool
        Whether to take `holonom.signals.derivative`, of what was filtered.
    even : bool
        Whether times must be evenly spaced.

    Raises
    ------
    UsageError
        If a choice is not one, or the run has no rows there.
    """
    if low_pass is not None:
        require_positive("low_pass", low_pass)
    treated = low_pass is not None or derivative or even
    limits = _limits(result, start, end)
    times = _times(result, interval, even=even or low_pass is not None)
    sampled = {} if times is None else result.sample(times, list(names))
    if times is None:
        times = result.time
    tolerance, peaks = tolerance_of(result), peaks_of(result)
    inside = (times >= limits[0]) & (times <= limits[1])
    found = []
    for name in names:
        whole, index = split_component(name)
        quantity = result.quantities.get(whole) or result.model.channels[whole]
        size = quantity.size if index is None else 1
        values = np.asarray(sampled[name] if sampled else result[name]).reshape(times.size, size)
        one = _measured(result, name, quantity, times, values, tolerance, peaks)
        if whole.endswith(".yaw_pitch_roll"):
            if treated:
                one = replace(one, values=np.unwrap(one.values, axis=0))
            else:
                one = replace(one, wraps=True)
        if low_pass is not None:
            one = replace(one, values=signals.low_pass(times, one.values, low_pass))
        if derivative:
            one = _differentiated(one)
        found.append(replace(one, time=times[inside], values=one.values[inside]))
    return found


def _measured(
    result: Result,
    name: str,
    quantity: Quantity,
    times: Series,
    values: Series,
    tolerance: Mapping[str, float],
    peaks: Mapping[str, float],
) -> Curves:
    """Return a channel with what one tolerance of it is."""
    whole, index = split_component(name)
    tolerances, span = np.zeros(quantity.size), np.zeros(values.shape[1])
    if times.size:
        every = values if index is None else np.asarray(result[whole]).reshape(-1, quantity.size)
        tolerances = own_tolerances(quantity, every, tolerance, peaks)
        finite = np.where(np.isfinite(values), values, np.nan)
        span = np.nan_to_num(np.fmax.reduce(finite) - np.fmin.reduce(finite))
    meant = slice(None) if index is None else slice(index, index + 1)
    tolerances = tolerances[meant]
    return Curves(
        name,
        title(name, quantity.size),
        quantity.frame,
        times,
        values,
        components(whole, quantity.size) if index is None else [""],
        component_units(quantity.unit, quantity.size)[meant],
        tolerances,
        span < STILL * tolerances,
    )


def _differentiated(one: Curves) -> Curves:
    """Return the derivative, whose tolerance is the rate that makes one of the run's length."""
    length = float(np.ptp(one.time)) if one.time.size else 1.0
    values = signals.derivative(one.time, one.values)
    tolerances = one.tolerances / (length or 1.0)
    span = np.ptp(values, axis=0) if values.shape[0] else np.zeros(values.shape[1])
    return replace(
        one,
        title=f"d/dt {one.title}",
        units=[_DERIVATIVES.get(unit, f"{unit}/s") for unit in one.units],
        values=values,
        tolerances=tolerances,
        still=span < STILL * tolerances,
    )


def _limits(result: Result, start: float | None, end: float | None) -> tuple[float, float]:
    low = -np.inf if start is None else require_finite("start", start)
    high = np.inf if end is None else require_finite("end", end)
    ends = [result.time[[0, -1]]] if result.time.size else []
    ends += [np.array(result.span)] if result.span is not None else []
    if not ends:  # the picture says that there are no rows
        return low, high
    first, last = float(min(e[0] for e in ends)), float(max(e[1] for e in ends))
    if not low < high or low >= last or high <= first:
        asked = " ".join(
            f"{word} {limit:g} s"
            for word, limit in (("from", start), ("to", end))
            if limit is not None
        )
        raise UsageError(
            f"the run covers {first:g} s to {last:g} s, and nothing of it lies {asked}",
            help="take a part of the run",
        )
    return low, high


def _times(result: Result, interval: float | None, *, even: bool) -> Series | None:
    """Return evenly spaced times; None where the stored rows serve."""
    rows = result.time
    if interval is None and (not even or signals.is_even(rows)):
        return None
    span = result.span or ((float(rows[0]), float(rows[-1])) if rows.size else None)
    if span is None or result.span is None:
        raise UsageError(
            f"the rows of {quoted(result.meta.get('name', 'the run'))} are not evenly spaced, and "
            "it has no stored steps to compute others from"
            if interval is None
            else "the run has no stored steps, from which values between its rows are computed",
            help="run it with `dense_output = true`, or with an even output interval",
        )
    length = span[1] - span[0]
    step = length / max(rows.size - 1, 200) if interval is None else interval
    times = np.array(times_at(step, *span, most=_MOST))
    # The last interval may be shorter.
    return times if not even or signals.is_even(times) else times[:-1]
