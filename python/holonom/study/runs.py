"""Many runs of one model, in this process or in several, reduced to what is asked of them."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import SimulationError, UsageError
from holonom.model import Model
from holonom.result import Result
from holonom.store.layout import STATE

Series = NDArray[np.float64]
Start = Mapping[str, Series] | None


@dataclass(frozen=True, slots=True)
class Task:
    """One run: a label, the options, and where to store it.

    Parameters
    ----------
    label : str
    choices : dict
        Options of the run, as for `Model.simulate`.
    output : Path, optional
        Result file; none is written without it.
    force : bool
        Whether it may replace a file that is no result.
    """

    label: str
    choices: dict[str, Any]
    output: Path | None = None
    force: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What is kept of a run; plain enough to travel between processes.

    Attributes
    ----------
    status : str
        As of a result, or ``refused``: the options cannot be used.
    reason : dict
        ``code`` and ``message`` of the end.
    statistics : dict of str to int or float
        Counts and times of the run.
    cpu_seconds : float or None
        Processor time of the core, s.
    values : dict of str to ndarray, shape (n_times, size)
        The channels asked for; empty unless the run completed.
    """

    status: str
    reason: dict[str, Any]
    statistics: dict[str, Any] = field(default_factory=dict)
    cpu_seconds: float | None = None
    values: dict[str, Series] = field(default_factory=dict)

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return self.status == "completed"


def run_task(
    model: Model,
    task: Task,
    names: Sequence[str],
    start: Start,
    progress: Callable[[float, float, int], None] | None,
) -> Outcome:
    """Run once and keep the channels `names`.

    A failure is an outcome.

    Raises
    ------
    Interrupted
        If Ctrl-C ended the run.
    """
    try:
        result = model.simulate(
            start=start,
            output=task.output,
            force=task.force,
            on_failure="return",
            progress=progress,
            **task.choices,
        )
    except UsageError as error:
        return Outcome("refused", {"code": error.code, "message": str(error)})
    except KeyboardInterrupt:  # `Interrupted` is a `SimulationError` as well
        raise
    except SimulationError as error:
        return Outcome("failed", {"message": str(error), **error.reason})
    with result:
        values: dict[str, Series] = {}
        if result.status == "completed" and names:
            values = _channels(model, result, names)
        return Outcome(
            result.status,
            result.stop_reason,
            dict(result.statistics),
            result.meta.get("cpu_seconds"),
            values,
        )


def side_by_side(
    model: Model, tasks: Sequence[Task], names: Sequence[str], start: Start, processes: int
) -> Generator[tuple[int, Outcome], None, None]:
    """Run tasks in several processes; yield the index and outcome of each as it ends.

    Tasks begin in the order given. Closing the generator ends the runs that are going on.

    Raises
    ------
    UsageError
        If a process dies.
    """
    context = multiprocessing.get_context("spawn")  # the one that all systems have
    stop = context.Event()
    executor = ProcessPoolExecutor(
        max_workers=min(processes, len(tasks)),
        mp_context=context,
        initializer=_begin,
        initargs=(model.to_json(), model.name, stop),
    )
    try:
        with _ignoring_interrupts():
            futures = {
                executor.submit(_run_here, task, names, start): index
                for index, task in enumerate(tasks)
            }
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool:
        raise UsageError(
            "a process of the comparison died",
            help="a script that asks for several processes must do so under "
            '`if __name__ == "__main__":`; and each needs memory for the model',
        ) from None
    finally:
        stop.set()
        executor.shutdown(wait=True, cancel_futures=True)


#: Of a worker process: the model, and the event that asks it to stop.
_worker: dict[str, Any] = {}


def _begin(text: str, name: str, stop: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the main process says when to stop
    _worker["model"] = Model.from_text(text, "json", name)
    _worker["stop"] = stop


def _run_here(task: Task, names: Sequence[str], start: Start) -> Outcome:
    def progress(*_: float) -> None:
        if _worker["stop"].is_set():
            raise SimulationError(
                {
                    "code": "simulation/interrupted",
                    "message": "stopped",
                    "help": "start the comparison again",
                }
            )

    return run_task(_worker["model"], task, names, start, progress)


@contextlib.contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Let processes that start in the block ignore Ctrl-C from their first moment."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _channels(model: Model, result: Result, names: Sequence[str]) -> dict[str, Series]:
    """Return channels of a run, each (n_times, size); those not stored are computed at once."""
    absent = [name for name in names if name not in result.quantities]
    states = {part: result[part] for part in STATE if part in result.quantities}
    computed = model.evaluate(absent, states) if absent else {}
    rows = result.time.size
    return {
        name: np.array(computed[name] if name in computed else result[name]).reshape(rows, -1)
        for name in names
    }
