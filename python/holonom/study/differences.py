"""Two results side by side: which channels differ, by how many tolerances, from when on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import UsageError
from holonom.base.text import preformatted, quoted
from holonom.certification import certified_channels
from holonom.channels import expand, split_component
from holonom.gauge import KINDS, RESIDUALS, Gauge, peak
from holonom.options import Tolerance, require_finite, require_positive

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.store.layout import Quantity

Series = NDArray[np.float64]

#: Times that differ by this part of a second, or of themselves, are the same.
_SLACK = 1e-9
#: Rows that are compared at once.
_ROWS = 2000
#: What the largest magnitudes of a kind are taken from.
_STATES = ("lambda", "qdd")
#: Channels named in the text; the data holds all of them.
SHOWN = 40


@dataclass(frozen=True, slots=True)
class ChannelDifference:
    """How far two runs are apart in one channel.

    Attributes
    ----------
    name, unit : str
        The channel or component; ``rad`` for an orientation by Euler parameters.
    time : float
        Where they are furthest apart in tolerances, s.
    difference : float
        Their distance there, in `unit`; of a vector its length.
    tolerance : float
        The tolerance there, in `unit`.
    tolerances : float
        The difference in tolerances; infinite where a row is lost in one of the files.
    since : float or None
        First time at which they differ by more than the bound, s; None where they never do.
    """

    name: str
    unit: str
    time: float
    difference: float
    tolerance: float
    tolerances: float
    since: float | None


@dataclass(frozen=True, slots=True)
class Differences:
    """What `diff` finds; ``print`` shows it.

    Attributes
    ----------
    first, second : str
        The results: their files, or the names of their models.
    tolerance : dict of str to float
        What differences are measured in: ``relative``, ``translation`` (m; m/s), ``rotation`` (rad;
        rad/s).
    within : float
        So many tolerances count as equal.
    span : tuple of float
        First and last time that were compared, s.
    times : int
        How many.
    channels : tuple of ChannelDifference
        In the order of the model.
    only_first, only_second : tuple of str
        Channels that were asked for and that the other model does not have.
    uncovered : str
        Why the runs cannot be equal although their channels may be: they cover different times;
        empty where they do not, or a part of the run was asked for.
    """

    first: str
    second: str
    tolerance: dict[str, float]
    within: float
    span: tuple[float, float]
    times: int
    channels: tuple[ChannelDifference, ...]
    only_first: tuple[str, ...] = ()
    only_second: tuple[str, ...] = ()
    uncovered: str = ""

    @property
    def equal(self) -> bool:
        """Whether all channels are in both runs, over the same time, and within the bound."""
        return not (self.differing or self.only_first or self.only_second or self.uncovered)

    @property
    def differing(self) -> tuple[ChannelDifference, ...]:
        """The channels beyond the bound, the one that left it first before the others."""
        beyond = [c for c in self.channels if c.since is not None]
        return tuple(sorted(beyond, key=lambda c: (c.since, -c.tolerances)))

    @property
    def worst(self) -> ChannelDifference | None:
        """The channel that is furthest apart, in tolerances."""
        return max(self.channels, key=lambda c: c.tolerances, default=None)

    def to_json(self) -> dict[str, Any]:
        """Return plain data; what is infinite is None."""
        channels = []
        for one in self.channels:
            data = {key: getattr(one, key) for key in ChannelDifference.__slots__}
            finite = {
                key: None if isinstance(value, float) and not math.isfinite(value) else value
                for key, value in data.items()
            }
            channels.append(finite | {"differs": one.since is not None})
        data = {key: getattr(self, key) for key in Differences.__slots__}
        return {"equal": self.equal, **data, "channels": channels}

    def __repr__(self) -> str:
        said = "equal" if self.equal else "not equal"
        counts = f"{len(self.differing)} of {len(self.channels)} channels differ"
        return f"<holonom.Differences: {said}, {counts}>"

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def __str__(self) -> str:
        parts = ", ".join(
            f"{name} {value:g}{unit}"
            for (name, value), unit in zip(self.tolerance.items(), ("", " m", " rad"), strict=True)
        )
        between = f"{self.span[0]:.6g} to {self.span[1]:.6g} s"
        lines = [
            f"{'first':<22}{self.first}",
            f"{'second':<22}{self.second}",
            f"{'compared':<22}{len(self.channels)} channels at {self.times} times, {between}",
            f"{'tolerance':<22}{parts}",
        ]
        if self.only_first or self.only_second:
            counts = f"{len(self.only_first)} in the first, {len(self.only_second)} in the second"
            lines.append(f"{'different models':<22}channels in one alone: {counts}")
        lines += [f"{'only in the first':<22}{name}" for name in self.only_first[:SHOWN]]
        lines += [f"{'only in the second':<22}{name}" for name in self.only_second[:SHOWN]]
        lines += [f"{'not the same time':<22}{self.uncovered}"] if self.uncovered else []
        bound = f"{self.within:g} tolerance{'' if self.within == 1.0 else 's'}"
        worst, differing = self.worst, self.differing
        if worst is not None and not differing:
            label = "equal" if self.equal else "equal in common"
            lines.append(
                f"{label:<22}within {bound}; furthest apart is {worst.name}: "
                f"{worst.tolerances:.3g} tolerances at {worst.time:.6g} s"
            )
        elif differing:
            lines.append(
                f"{'different':<22}{len(differing)} of {len(self.channels)} channels, by more "
                f"than {bound}"
            )
            lines += ["", *_table(differing[:SHOWN])]
            if more := len(differing) - SHOWN:
                lines += [f"… {more} more, with --json"] if more > 0 else []
        return "\n".join(lines)


def diff(
    first: Result,
    second: Result,
    channels: Sequence[str] | None = None,
    *,
    tolerance: float | Mapping[str, float] | Tolerance | None = None,
    within: float = 1.0,
    start: float | None = None,
    end: float | None = None,
) -> Differences:
    """Compare two results channel by channel, in tolerances.

    They are compared at the output times of both; where one has no row, its state is computed from
    its stored steps. Their models need not be the same: what both have is compared, and a channel
    that only one of them has is a difference, told with the result that has it.

    Parameters
    ----------
    first, second : Result
    channels : sequence of str, optional
        Names or patterns; what both runs store, and the motion of the bodies where that is nothing
        but energies.
    tolerance : float, mapping or Tolerance, optional
        The looser one of the two runs, part by part, when not given. What one tolerance is of a
        channel, `docs/conventions.md` says under “Certified runs”; movements count from the first
        time compared, so that what has come far since then may be farther off.
    within : float
        So many tolerances count as equal.
    start, end : float, optional
        Compare this part of the runs only, s.

    Raises
    ------
    UsageError
        If a channel is in neither run, or they have no time in common.
    """
    from holonom.result import require_results  # here: options and names need no results

    require_results(first, second)
    within = require_positive("within", within)
    chosen = _tolerance(first, second, tolerance)
    limits = _parts(chosen)
    times, uncovered = _times(first, second, start, end)
    names, only_first, only_second = _names(first, second, channels)
    gauges = [_gauge(name, first, second, limits, within) for name in names]
    peaks = dict.fromkeys(KINDS.values(), 0.0)
    whole = list(dict.fromkeys(gauge.channel for gauge in gauges))
    energies = [[n for n in run.channels if n.startswith("energy.")] for run in (first, second)]
    states = [[n for n in _STATES if n in run.quantities] for run in (first, second)]
    for at in range(0, times.size, _ROWS):
        part = times[at : at + _ROWS]
        values = [
            _rows(run, part, [*dict.fromkeys([*whole, *energy]), *state])
            for run, energy, state in zip((first, second), energies, states, strict=True)
        ]
        for gauge in gauges:
            gauge.take(part, values[0][gauge.channel], values[1][gauge.channel])
        for found, energy in zip(values, energies, strict=True):
            for kind in _STATES:
                peaks[kind] = max(peaks[kind], peak(found.get(kind, np.zeros(0))))
            for name in energy:
                peaks["energy"] = max(peaks["energy"], peak(found[name]))
    return Differences(
        first=_title(first),
        second=_title(second),
        tolerance=limits,
        within=within,
        span=(float(times[0]), float(times[-1])),
        times=int(times.size),
        channels=tuple(ChannelDifference(*gauge.furthest(peaks)) for gauge in gauges),
        only_first=only_first,
        only_second=only_second,
        uncovered=uncovered if start is None and end is None else "",
    )


def _gauge(
    name: str, first: Result, second: Result, tolerance: Mapping[str, float], within: float
) -> Gauge:
    channel, index = split_component(name)
    quantity = _quantity(first, channel)
    if _quantity(second, channel).shape != quantity.shape:
        raise UsageError(
            f"{quoted(channel)} has not as many components in both runs",
            help="compare planar models with planar ones; name other channels",
        )
    # Lost in both files: nothing is known, so nothing is said.
    return Gauge(name, quantity, index, tolerance, within=within, lost=0.0)


def _rows(run: Result, times: Series, names: Sequence[str]) -> dict[str, Series]:
    """Return channels and states at times: the stored rows where these are their times."""
    first = int(np.searchsorted(run.time, times[0]))
    if np.array_equal(run.time[first : first + times.size], times):
        return {name: run[name][first : first + times.size] for name in names}
    return run.sample(times, names)


def _times(
    first: Result, second: Result, start: float | None, end: float | None
) -> tuple[Series, str]:
    """Return the times that both runs know, and why these are not all of them."""
    spans = [_span(run) for run in (first, second)]
    low, high = max(span[0] for span in spans), min(span[1] for span in spans)
    uncovered = ""
    slack = _SLACK * max(1.0, abs(high))
    if any(abs(span[0] - low) > slack or abs(span[1] - high) > slack for span in spans):
        (a, b), (c, d) = spans
        uncovered = f"the first covers {a:.6g} to {b:.6g} s, the second {c:.6g} to {d:.6g} s"
    if start is not None:
        low = max(low, require_finite("start", start))
    if end is not None:
        high = min(high, require_finite("end", end))
    if first.time.size == second.time.size and np.array_equal(first.time, second.time):
        times = first.time
    else:
        times = np.union1d(first.time, second.time)
        if times.size > 1:  # what differs by round-off is one time
            times = times[np.append(True, np.diff(times) > _SLACK * np.maximum(1.0, times[1:]))]
    times = times[(times >= low - slack) & (times <= high + slack)]
    for run in (first, second):
        times = times[_known(run, times)]
    if not times.size:
        raise UsageError(
            "the results have no time in common" + (f": {uncovered}" if uncovered else ""),
            help="runs with `dense_output = true` have states at any time; see `--from`, `--to`",
        )
    return times, uncovered


def _span(run: Result) -> tuple[float, float]:
    rows = run.time
    ends = [run.span] if run.span is not None else []
    if rows.size:
        ends.append((float(rows[0]), float(rows[-1])))
    if not ends:
        raise UsageError(
            f"{_title(run)}: the result has no rows",
            help="`holonom info` says why the run ended; run it again",
        )
    return min(one[0] for one in ends), max(one[1] for one in ends)


def _known(run: Result, times: Series) -> NDArray[np.bool_]:
    """Return at which times a run has a state."""
    slack = _SLACK * np.maximum(1.0, np.abs(times))
    known = np.zeros(times.size, dtype=bool)
    if run.span is not None:
        known = (times >= run.span[0] - slack) & (times <= run.span[1] + slack)
    if run.time.size:
        near = np.clip(np.searchsorted(run.time, times), 0, run.time.size - 1)
        for candidate in (near, np.maximum(near - 1, 0)):
            known |= np.abs(run.time[candidate] - times) <= slack
    return known


def _names(
    first: Result, second: Result, wanted: Sequence[str] | None
) -> tuple[list[str], tuple[str, ...], tuple[str, ...]]:
    """Return what is compared, and what only one of the runs has."""
    known = [_known_channels(run) for run in (first, second)]
    found = [] if wanted is None else expand(wanted, {**known[1], **known[0]})
    if found:
        lists = [found, found]
    else:
        lists = [
            [n for n in run.channels if not n.startswith(RESIDUALS)] for run in (first, second)
        ]
        if all(name.startswith("energy.") for names in lists for name in names):
            motion = [certified_channels(run.model, []) for run in (first, second)]
            lists = [names + more for names, more in zip(lists, motion, strict=True)]
    ours = dict.fromkeys([*lists[0], *lists[1]])
    in_one = [
        tuple(
            n for n in ours if split_component(n)[0] in one and split_component(n)[0] not in other
        )
        for one, other in (known, known[::-1])
    ]
    names = [n for n in ours if all(split_component(n)[0] in channels for channels in known)]
    return names, in_one[0], in_one[1]


def _known_channels(run: Result) -> dict[str, Quantity]:
    stored = {name: run.quantities[name] for name in run.channels}
    return {**run.model.channels, **stored}


def _quantity(run: Result, name: str) -> Quantity:
    return run.quantities.get(name) or run.model.channels[name]


def _tolerance(
    first: Result, second: Result, stated: float | Mapping[str, float] | Tolerance | None
) -> Tolerance:
    runs = [
        Tolerance.of(run.options.get("tolerance") or _DEFAULT, {"relative": _DEFAULT})
        for run in (first, second)
    ]
    looser = {name: max(getattr(run, name) for run in runs) for name in Tolerance.__slots__}
    return Tolerance(**looser) if stated is None else Tolerance.of(stated, looser)


#: The tolerance of a run that states none.
_DEFAULT = 1e-4


def _parts(tolerance: Tolerance) -> dict[str, float]:
    return {name: float(getattr(tolerance, name)) for name in Tolerance.__slots__}


def _title(run: Result) -> str:
    return str(run.path) if run.path is not None else str(run.meta.get("name", "run"))


def _table(rows: Sequence[ChannelDifference]) -> list[str]:
    width = max(len("channel"), *(len(row.name) for row in rows))
    head = f"{'channel':<{width}}  {'from, s':>10}  {'tolerances':>10}  {'at, s':>10}  difference"
    return [head] + [
        f"{row.name:<{width}}  {row.since:10.6g}  {row.tolerances:10.3g}  {row.time:10.6g}  "
        f"{row.difference:.2e} {row.unit}".rstrip()
        for row in rows
    ]
