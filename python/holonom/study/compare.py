"""Methods and tolerances run against each other, with a reference that is made on the spot."""

from __future__ import annotations

import contextlib
import reprlib
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import SimulationError, UsageError
from holonom.base.names import listed
from holonom.base.plain import as_path, require_callable
from holonom.base.text import quoted
from holonom.channels import split_component
from holonom.model import Model
from holonom.options import Further, Options, Tolerance, shows_choices
from holonom.result import Result
from holonom.states import start_state
from holonom.store.layout import STATE
from holonom.study import plan
from holonom.study.accuracy import ComponentError, Kind, Target, Truth, targets
from holonom.study.comparison import COUNTS, Comparison, ComparisonInterrupted, Reference, Row
from holonom.study.runs import Outcome, Task, run_task, side_by_side

Series = NDArray[np.float64]

#: Tolerances of the thesis's tables.
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
#: Channels that a message names.
_SHOWN = 6
#: Errors less than so many times the difference between the reference and its check are in doubt.
DOUBTFUL = 10.0

Progress = Callable[[float, int, str], None]


@shows_choices
def compare(
    model: Model | str | Path,
    *,
    methods: Sequence[str | Mapping[str, Any]] | None = None,
    tolerances: Sequence[float | Mapping[str, float] | Tolerance] = TOLERANCES,
    end_time: float | None = None,
    interval: float | None = None,
    output_times: Sequence[float] | None = None,
    channels: Sequence[str] | None = None,
    reference: Result | str | Path | None = None,
    reference_tolerance: float | Mapping[str, float] | Tolerance | None = None,
    save_reference: str | Path | None = None,
    force: bool = False,
    start: Mapping[str, NDArray[np.float64]] | None = None,
    repeat: int = 3,
    processes: int | None = None,
    progress: Progress | None = None,
    **choices: Unpack[Further],
) -> Comparison:
    """Run a model by several methods at several tolerances and compare them with a reference.

    Parameters
    ----------
    model : Model or path
    methods : sequence of str or mapping, optional
        Codes such as ``ForSDIRK``, or options of a run with ``method`` among them:
        ``{"method": "ForSDIRK", "jacobian": "differences"}``. All implicit codes by default.
    tolerances : sequence of float, mapping or Tolerance, optional
        As for a run; 1e-2 … 1e-5 by default.
    end_time : float, optional
        s; that of the model by default.
    interval, output_times : float, sequence of float, optional
        Times at which errors are taken, s. By default 200 equal intervals; with a given reference
        up to 201 of its own times, so that nothing has to be interpolated.
    channels : sequence of str, optional
        Channels, components, patterns, ``positions`` (of all bodies, with their orientations; the
        default) and ``velocities``. Euler parameters are compared as a rotation angle, 2·|δp|.
    reference : Result or path, optional
        A run to compare with. Without one it is made by the implicit code of highest order and
        repeated by a code with another formula; their difference is part of the comparison.
    reference_tolerance : float, mapping or Tolerance, optional
        Of the reference made on the spot; by default 1/1000 of the tightest tolerance.
    save_reference : path, optional
        Result file for the reference made on the spot.
    force : bool
        Whether `save_reference` may replace a file that is no result.
    start : mapping, optional
        State to start from, as `Result.state` returns it.
    repeat : int, optional
        Number of timed runs of every pair, one after the other and nothing beside them; the
        median counts. 0 takes no times.
    processes : int, optional
        Number of processes for the runs that errors are taken from; the timed runs come after
        them, alone. A script that asks for more than one needs ``if __name__ == "__main__":``.
    progress : callable, optional
        Called with the number of runs done, their total and what is being done.
    CHOICES

    Returns
    -------
    Comparison
        A row for each method and tolerance; runs that failed are rows with their code.

    Raises
    ------
    UsageError
        If a choice cannot be used, or a given reference does not cover the run.
    ModelError
        If the initial state cannot be assembled.
    SimulationError
        If no reference could be made.
    ComparisonInterrupted
        If Ctrl-C ended it; its ``comparison`` holds the rows that were finished.
    """
    loaded = model if isinstance(model, Model) else Model.load(model)
    if not (channels is None or isinstance(channels, Iterable)):
        raise UsageError(f"`channels` is {quoted(repr(channels))}", help="pass a list of names")
    if channels is not None and not isinstance(channels, str):
        channels = list(channels)  # one that ends is read once
    wanted = targets(loaded, channels)
    for name, given_list in (("methods", methods or ()), ("tolerances", tolerances)):
        if isinstance(given_list, str | Mapping) or not isinstance(given_list, Sequence):
            raise UsageError(f"`{name}` is {quoted(repr(given_list))}", help="pass a list of them")
    require_callable("progress", progress)
    if not (reference is None or isinstance(reference, Result | str | Path)):
        raise UsageError(
            f"`reference` is {quoted(repr(reference))}", help="pass a result, or its file"
        )
    limits = list(
        dict.fromkeys(Tolerance.of(limit, loaded.defaults["tolerance"]) for limit in tolerances)
    )
    codes = plan.codes(methods)
    repeat = _count("repeat", repeat, 0)
    processes = _count("processes", 1 if processes is None else processes, 1)
    if not limits or not codes:
        raise UsageError(
            "there is nothing to compare", help="give at least one method and one tolerance"
        )
    if reference is not None and (reference_tolerance is not None or save_reference is not None):
        raise UsageError(
            "`reference_tolerance` and `save_reference` belong to a reference made on the spot",
            help="give them or `reference`",
        )
    for name, instead in (("method", "methods"), ("tolerance", "tolerances")):
        if name in choices:
            raise UsageError(f"a comparison has no `{name}`", help=f"give `{instead}`, a list")
    if start is not None:
        start = start_state(start)
        choices = {**choices, "start_time": float(start["time"][0])}
    given = Result.load(reference) if isinstance(reference, str | Path) else reference
    options = Options.of(
        {**choices, "end_time": end_time, "interval": interval, "output_times": output_times}
    )
    times, end = plan.times(loaded, options, given)
    common = {"dense_output": False, **choices, "end_time": end, "output_times": times}
    common["channels"] = []
    pairs = [
        Task(label, {**common, **code, "tolerance": limit})
        for label, code in codes.items()
        for limit in limits
    ]
    for task in pairs:
        Options.of(task.choices)  # refuses what no run can use before anything runs
    if start is None:
        loaded.check(spectrum=False)  # a model that cannot be assembled is an error of the whole

    work = _Work(
        model=loaded,
        wanted=wanted,
        times=times,
        end=end,
        limits=limits,
        codes=codes,
        pairs=pairs,
        start=start,
        repeat=repeat,
        progress=progress,
        named={split_component(name)[0] for name in channels or ()},
    )
    if given is None:
        begin = {"start_time": choices["start_time"]} if "start_time" in choices else {}
        tolerance = plan.reference_tolerance(limits, reference_tolerance)
        ahead: dict[str, Any] = {**begin, "end_time": end, "output_times": times, "channels": []}
        output = None if save_reference is None else as_path(save_reference)
        work.candidates = [
            Task(name, {**ahead, "method": name, "tolerance": tolerance}, path, force)
            for name, path in zip(plan.references(), (output, None), strict=False)
        ]
    else:
        work.use(given)
        if given is not reference:
            given.close()
    try:
        work.run(processes)
    except KeyboardInterrupt:
        raise ComparisonInterrupted(work.comparison(interrupted=True)) from None
    return work.comparison()


@dataclass(slots=True, kw_only=True)
class _Work:
    """The runs of one comparison and what came of them."""

    model: Model
    wanted: list[Target]
    times: Series
    end: float
    limits: list[Tolerance]
    codes: dict[str, dict[str, Any]]
    pairs: list[Task]
    start: Mapping[str, Series] | None
    repeat: int
    progress: Progress | None
    #: Channels that were asked for by name, not by a pattern or as one of a set.
    named: set[str] = field(default_factory=set)
    candidates: list[Task] = field(default_factory=list)
    outcomes: dict[int, Outcome] = field(default_factory=dict)
    samples: dict[int, list[float]] = field(default_factory=dict)
    reference: Reference | None = None
    truth: Truth | None = None
    warnings: list[str] = field(default_factory=list)
    done: int = 0
    total: int = 0

    @property
    def channels(self) -> list[str]:
        return list(dict.fromkeys(target.channel for target in self.wanted))

    def use(self, given: Result) -> None:
        """Take a given result as the reference.

        Of what was not named, the channels that only one of the models has are left out.
        """
        if given.meta.get("model_hash") not in (None, self.model.hash):
            self._keep_common(given)
        tolerance = given.options.get("tolerance")
        self.reference = Reference(
            method=str(given.meta.get("method") or given.options.get("method") or "unknown"),
            tolerance=dict(tolerance) if isinstance(tolerance, dict) else {},
            path="" if given.path is None else str(given.path),
            steps=given.statistics.get("steps"),
        )
        there = np.ones(given.time.size, dtype=bool)
        for name in self.channels:
            there &= _there(given, name, self.times)
        values = {name: given.matrix(name)[there] for name in self.channels}
        self.truth = Truth(self.wanted, given.time[there], values, self.times)

    def _keep_common(self, given: Result) -> None:
        """Leave out what the reference has not, or refuse where it was asked for by name."""
        there = {**given.model.channels, **given.quantities}

        def shape(name: str) -> Any:
            return there[name].shape if name in there else None

        absent = [n for n in self.channels if shape(n) != self.model.channels[n].shape]
        if not absent:
            self.warnings.append("the reference is a run of another model, or of other values")
            return
        here = self.model.channels
        known = dict.fromkeys(target.channel for target in targets(given.model, None))
        others = [name for name in known if name not in here]
        text = f"the reference is of another model, which has no {_some(absent)}"
        if others and not self.named:
            text += f", while this one has no {_some(others)}"
        kept = [target for target in self.wanted if target.channel not in absent]
        if not kept or self.named & set(absent):
            common = [name for name in here if shape(name) == here[name].shape]
            tip = f"name channels that both have, such as {_some(common)}"
            raise UsageError(text, "simulation/unknown-channel", tip)
        self.wanted = kept
        self.warnings.append(f"{text}: only what both have is compared")

    def run(self, processes: int) -> None:
        """Make the reference and all rows; Ctrl-C leaves what is finished."""
        tasks = [*self.candidates, *self.pairs]
        first = len(self.candidates)
        alone = processes == 1
        extra = max(self.repeat - 1, 0) if alone else self.repeat
        self.total = len(tasks) + extra * len(self.pairs)
        found: dict[int, Outcome] = {}
        outcomes = self._one_by_one(tasks) if alone else self._together(tasks, processes)
        with contextlib.closing(outcomes):
            for index, outcome in outcomes:
                self.done += 1
                if index < first:
                    found[index] = outcome
                    if len(found) == first:
                        self._settle(found)
                    continue
                pair = index - first
                self.outcomes[pair] = outcome
                if alone:
                    if self.repeat and outcome.completed and outcome.cpu_seconds is not None:
                        self.samples[pair] = [outcome.cpu_seconds]
                    self._time(pair, extra)
        if not alone:
            for pair in range(len(self.pairs)):
                self._time(pair, extra)

    def _settle(self, found: dict[int, Outcome]) -> None:
        """Choose the reference from its candidates and check it by the other one."""
        usable = [index for index in sorted(found) if found[index].completed]
        if not usable:
            raise SimulationError(
                {**found[0].reason, "message": f"no reference could be made: {_said(found[0])}"}
            )
        chosen, *checks = usable
        task, outcome = self.candidates[chosen], found[chosen]
        self.truth = Truth(self.wanted, self.times, outcome.values, self.times)
        errors: list[ComponentError] = []
        if checks:
            errors = self.truth.errors(found[checks[0]].values, plan.tightest(self.limits))
        self.reference = Reference(
            method=task.label,
            tolerance=plan.parts(task.choices["tolerance"]),
            path="" if task.output is None or chosen else str(task.output),
            steps=outcome.statistics.get("steps"),
            check_method=self.candidates[checks[0]].label if checks else "",
            check_errors=tuple(errors),
        )
        for index, failed in found.items():
            if not failed.completed:
                label = self.candidates[index].label
                self.warnings.append(f"{label} could not repeat the reference: {_said(failed)}")

    def _time(self, pair: int, times: int) -> None:
        """Repeat a run for its processor time, with nothing beside it."""
        task, outcome = self.pairs[pair], self.outcomes[pair]
        for number in range(times):
            if outcome.completed:
                text = f"{_title(task)}, timing {number + 1} of {times}"
                again = run_task(self.model, task, [], self.start, self._inside(text))
                if again.cpu_seconds is not None:
                    self.samples.setdefault(pair, []).append(again.cpu_seconds)
            self.done += 1

    def _one_by_one(self, tasks: list[Task]) -> Generator[tuple[int, Outcome], None, None]:
        for index, task in enumerate(tasks):
            title = f"reference by {_title(task)}" if index < len(self.candidates) else _title(task)
            progress = self._inside(title)
            yield index, run_task(self.model, task, self.channels, self.start, progress)

    def _together(
        self, tasks: list[Task], processes: int
    ) -> Generator[tuple[int, Outcome], None, None]:
        # The longest runs first: references, then tight tolerances.
        order = sorted(range(len(tasks)), key=lambda i: tasks[i].choices["tolerance"].relative)
        self._tell(0.0, f"{len(tasks)} runs in {processes} processes")
        sorted_tasks = [tasks[i] for i in order]
        runs = side_by_side(self.model, sorted_tasks, self.channels, self.start, processes)
        with contextlib.closing(runs):
            for place, outcome in runs:
                yield order[place], outcome
                self._tell(0.0, f"{_title(sorted_tasks[place])} done")

    def _tell(self, fraction: float, text: str) -> None:
        if self.progress is not None:
            self.progress(self.done + fraction, self.total, text)

    def _inside(self, text: str) -> Callable[[float, float, int], None]:
        """Return the progress of one run, as part of that of the comparison."""
        begin, span = float(self.times[0]), self.end - float(self.times[0])
        self._tell(0.0, text)

        def progress(time: float, _: float, steps: int) -> None:
            fraction = min(max((time - begin) / span, 0.0), 1.0) if span > 0.0 else 0.0
            self._tell(fraction, f"{text}, t {time:.4g} s, {steps} steps")

        return progress

    def comparison(self, *, interrupted: bool = False) -> Comparison:
        """Return what there is."""
        rows = [self._row(pair) for pair in sorted(self.outcomes)] if self.truth else []
        warnings = self.warnings + _doubtful(rows, self.reference) + _coarse(rows)
        return Comparison(
            model=self.model.name,
            model_hash=self.model.hash,
            rows=tuple(rows),
            reference=self.reference,
            channels=tuple(target.name for target in self.wanted),
            start_time=float(self.times[0]),
            end_time=self.end,
            n_times=int(self.times.size),
            warnings=tuple(warnings),
            interrupted=interrupted,
        )

    def _row(self, pair: int) -> Row:
        task, outcome = self.pairs[pair], self.outcomes[pair]
        tolerance = task.choices["tolerance"]
        errors: list[ComponentError] = []
        if outcome.completed and self.truth is not None:
            errors = self.truth.errors(outcome.values, tolerance)
        reason = {} if outcome.completed else outcome.reason
        return Row(
            method=task.label,
            choices=self.codes[task.label],
            tolerance=tolerance,
            status=outcome.status,
            code=str(reason.get("code", "")),
            message=str(reason.get("message", "")),
            counts={
                name: count
                for name, count in outcome.statistics.items()
                if name in COUNTS or name.startswith("rejected_")
            },
            cpu_samples=tuple(self.samples.get(pair, ())),
            errors=tuple(errors),
        )


def _there(given: Result, name: str, times: Series) -> NDArray[np.bool_]:
    """Return which rows of a channel of a reference are not lost, shape (n_times,).

    Raises
    ------
    UsageError
        If lost ones are needed at these times, s, or the channel is computed from what is lost.
    """
    there = np.ones(given.time.size, dtype=bool)
    first = int(given.time.searchsorted(times[0], side="right")) - 1
    needed = slice(max(first, 0), int(given.time.searchsorted(times[-1])) + 1)
    stored = given.quantities
    for part in [name] if name in stored else [state for state in STATE if state in stored]:
        rows = given[part].reshape(given.time.size, -1)
        kept: NDArray[np.bool_] = np.asarray(np.isfinite(rows).all(axis=1))
        if not kept[needed].all() or not (kept.all() or name in stored):
            raise UsageError(
                f"the reference has lost {(~kept).sum()} of {kept.size} rows of {quoted(part)}, "
                f"which {quoted(name)} is taken from, the first at {given.time[~kept][0]:g} s",
                help="take a copy of it that is whole, or compare other channels",
            )
        there &= kept
    return there


def _doubtful(rows: list[Row], reference: Reference | None) -> list[str]:
    """Warn of errors that are hardly larger than the reference's own."""
    warnings = []
    kinds: tuple[tuple[Kind, str], ...] = (("position", "m, rad"), ("velocity", "m/s, rad/s"))
    for kind, units in kinds:
        doubt = None if reference is None else reference.difference_of(kind)
        found = [
            f"{row.method} at {row.tolerance.relative:g}"
            for row in rows
            if doubt and row.errors and (row.error_of(kind) or 0.0) < DOUBTFUL * doubt
        ]
        if found:
            warnings.append(
                f"the reference and its check differ by {doubt:.1e} ({units}); errors that small "
                f"are in doubt: {', '.join(found)}"
            )
    return warnings


def _coarse(rows: list[Row]) -> list[str]:
    """Warn of a reference whose points are too far apart for the errors found."""
    found = [
        (error.interpolation / error.delta, error.name, row)
        for row in rows
        for error in row.errors
        if error.interpolation > 0.01 * error.delta > 0.0
    ]
    if not found:
        return []
    ratio, name, row = max(found, key=lambda entry: entry[0])
    text = (
        f"the reference's points lie too far apart: reading it between them may err by {ratio:.1e} "
        f"of the error of `{name}` by {row.method} at {row.tolerance.relative:g}; leave out "
        "`interval` and `output_times` to take errors at its own times"
    )
    return [text]


def _title(task: Task) -> str:
    return f"{task.label} at {task.choices['tolerance'].relative:.0e}"


def _some(names: Sequence[str]) -> str:
    more = len(names) - _SHOWN
    return listed(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def _said(outcome: Outcome) -> str:
    return str(outcome.reason.get("message", outcome.status)).partition("\n")[0]


def _count(name: str, value: object, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise UsageError(
            f"`{name}` is {reprlib.repr(value)}", help=f"it must be a whole number, {least} or more"
        )
    return value
