"""What a study runs: its methods, its times, the codes and the tolerance of its reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import UsageError
from holonom.base.names import listed
from holonom.base.text import quoted
from holonom.model import Model
from holonom.options import Options, Tolerance, require_method, times_at, unknown_method
from holonom.options import methods as known_methods
from holonom.result import Result

Series = NDArray[np.float64]

#: Number of intervals between the output times, unless others are asked for.
INTERVALS = 200
#: The tightest tolerance compared is so many times the reference's; the least that doubles allow.
REFERENCE_PART = 1000.0
LEAST_TOLERANCE = 1e-12
#: Formulas by how cheaply they reach a tight tolerance on a stiff model; others come after them.
_RANKED = ("radau5", "sdirk4_15", "sdirk4_16", "rosenbrock4")

#: Choices that all runs share: what they are compared at, and how long they last.
_COMMON = ("tolerance", "channels", "start_time", "end_time", "interval", "output_times")

#: What to try where a reference does not cover the run.
_LONGER = "compare within its span, or let the reference be made on the spot"


def codes(asked: Sequence[str | Mapping[str, Any]] | None) -> dict[str, dict[str, Any]]:
    """Return the options of every method by its label."""
    if asked is None:
        asked = [entry["name"] for entry in known_methods() if entry["family"] != "explicit"]
    if isinstance(asked, str | Mapping):
        raise UsageError("`methods` is one method", help="pass a list of them")
    found = {}
    for entry in asked:
        if not isinstance(entry, str | Mapping):
            raise UsageError(
                f"`methods` holds {quoted(repr(entry))}", help="pass names, or options of a run"
            )
        options = {"method": entry} if isinstance(entry, str) else dict(entry)
        name, formula = options.pop("method", None), options.pop("formula", None)
        if not (isinstance(name, str) and isinstance(formula, str | None)):
            raise unknown_method(name, formula)
        code = require_method(name, formula)
        if shared := [name for name in _COMMON if name in options]:
            raise UsageError(
                f"a method carries no {listed(shared)}",
                help="this is common to all methods: give it beside them",
            )
        label = " ".join([code, *(f"{key}={value}" for key, value in options.items())])
        found[label] = {"method": code, **options}
    return found


def references() -> list[str]:
    """Return the code that makes references and the one, of another formula, that checks them."""
    implicit = [code for code in known_methods() if code["family"] != "explicit"]

    def rank(code: dict[str, str]) -> int:
        return _RANKED.index(code["formula"]) if code["formula"] in _RANKED else len(_RANKED)

    best, *others = sorted(implicit, key=rank)
    check = next((code for code in others if code["formula"] != best["formula"]), None)
    return [best["name"]] + ([] if check is None else [check["name"]])


def times(model: Model, options: Options, given: Result | None) -> tuple[Series, float]:
    """Return the output times of all runs and the end time, s."""
    begin, end = options.start_time, options.end_time
    if begin is None:
        begin = float(model.defaults.get("start_time") or 0.0)
    if end is None:
        end = model.defaults.get("end_time")
        if (
            given is not None
            and given.time.size
            and not (end is not None and end <= given.time[-1])
        ):
            end = float(given.time[-1])
    if end is None:
        raise UsageError(
            "there is no end time", help="give `end_time`, or state it in the model's [simulation]"
        )
    if end <= begin:
        raise UsageError(
            f"`end_time` is {end} s, the start {begin} s", help="the end must lie after the start"
        )
    slack = 1e-9 * (end - begin)
    if options.output_times is not None:
        taken = np.array(options.output_times)
        if taken[0] < begin - slack or taken[-1] > end + slack:
            raise UsageError(
                "`output_times` reach beyond the run",
                help=f"they must lie between {begin} s and {end} s",
            )
    elif options.interval is not None:
        taken = np.array(times_at(options.interval, begin, end))
    elif given is not None:
        taken = given.time[(given.time >= begin - slack) & (given.time <= end + slack)]
        kept = np.linspace(0, max(taken.size - 1, 0), min(taken.size, INTERVALS + 1))
        taken = taken[np.unique(np.round(kept).astype(int))]
    else:
        taken = np.linspace(begin, end, INTERVALS + 1)
    if given is not None:
        span = given.time
        if not span.size or not taken.size or taken[-1] > span[-1] + slack:
            until = f"ends at {span[-1]} s" if span.size else "holds nothing"
            raise UsageError(
                f"the reference {until}, but errors are taken until {end} s", help=_LONGER
            )
        if taken[0] < span[0] - slack:
            raise UsageError(
                f"the reference starts at {span[0]} s, but errors are taken from {taken[0]} s",
                help=_LONGER,
            )
        if end > span[-1] + slack:
            raise UsageError(
                f"the reference ends at {span[-1]} s, before the end time {end} s", help=_LONGER
            )
    return taken, float(end)


def reference_tolerance(
    limits: list[Tolerance], asked: float | Mapping[str, float] | Tolerance | None
) -> Tolerance:
    """Return the tolerance of a reference that is made on the spot."""
    made = {k: max(v / REFERENCE_PART, LEAST_TOLERANCE) for k, v in parts(tightest(limits)).items()}
    return Tolerance(**made) if asked is None else Tolerance.of(asked, made)


def tightest(limits: list[Tolerance]) -> Tolerance:
    """Return the smallest of every part."""
    each = [parts(limit) for limit in limits]
    return Tolerance(**{name: min(part[name] for part in each) for name in each[0]})


def parts(tolerance: Tolerance) -> dict[str, float]:
    """Return the parts of a tolerance by name."""
    return {name: getattr(tolerance, name) for name in Tolerance.__dataclass_fields__}
