"""One run: from the core's chunks to a result."""

from __future__ import annotations

import contextlib
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom import _core
from holonom.base import files
from holonom.base.errors import (
    FileError,
    HolonomError,
    Interrupted,
    SimulationError,
    UsageError,
    translated,
)
from holonom.certificate import Certification
from holonom.certification import (
    NO_SECOND_RUN,
    Measurement,
    certified_channels,
    tightened,
    unfinished,
)
from holonom.channels import split_component
from holonom.result import Result
from holonom.states import start_state
from holonom.store.continuation import (
    GOING_ON,
    before_part,
    begun,
    continued,
    destination,
    first_state,
    merged,
    rewind,
    start_time,
)
from holonom.store.locks import require_unwritten
from holonom.store.memory import Memory, Stored
from holonom.store.reader import Reader
from holonom.store.writer import NotRepeatedError, Rewind, Writer

if TYPE_CHECKING:
    from holonom.model import Model, Progress, Rows, Watch
    from holonom.options import Options


#: The one limit that may end a run before its first step.
_TIME_IS_UP = "simulation/max-seconds"
#: Longest steps of a repetition that certifies a run, as a part of those of the run.
_SHORTER = 0.6


@dataclass(frozen=True)
class Observers:
    """Who is told of a run while it goes on; see `Model.simulate`."""

    progress: Progress | None = None
    watch: Watch | None = None
    rows: Rows | None = None


@dataclass(frozen=True)
class _Job:
    """What the core is asked for: `text` is `chosen` as JSON."""

    model: Model
    chosen: dict[str, Any]
    text: str
    state: dict[str, NDArray[np.float64]] | None
    checkpoint: str | None = None


def run(
    model: Model,
    options: Options,
    start: Mapping[str, NDArray[np.float64]] | None,
    output: Path | None,
    raise_failure: bool,
    certify: bool,
    observers: Observers,
    *,
    keep: bool = False,
    force: bool = False,
    source: Path | None = None,
) -> Result:
    """Run a model; see `Model.simulate`. `source` is the result that `start` was read from."""
    state = None if start is None else start_state(start)
    chosen, requested, text = _resolved(model, options, state)

    if certify:
        _require_certifiable(chosen)
    continues = None
    noted: list[dict[str, str]] = []
    if output is not None:
        asked, alone = output, keep or certify
        output, continues = destination(model, chosen, state, output, source, alone=alone)
        if output != asked:
            noted.append(_renamed(asked, output))
        output = files.numbered(output) if keep else output
        real = files.require_target(output, "result", inputs=model.sources, force=force)
        require_unwritten(real, output)

    if continues is not None:
        before = {"time": np.array([begun(continues)])}
        again, _, as_then = _resolved(model, options, before)
        if (place := rewind(continues, again)) is not None:
            recorder = _Recorder(model, again, requested, output, False, continues, force, place)
            try:
                first = None if place.text else first_state(continues, place)
                job = _Job(model, again, as_then, first, place.text)
                return _recorded(job, recorder, observers, raise_failure, False)
            except (NotRepeatedError, SimulationError) as error:
                if isinstance(error, SimulationError) and error.code != "simulation/checkpoint":
                    raise
                noted.append(_not_repeated(error))
            finally:
                recorder.release()
    recorder = _Recorder(model, chosen, requested, output, certify, continues, force)
    recorder.warnings += noted
    try:
        job = _Job(model, chosen, text, state)
        return _recorded(job, recorder, observers, raise_failure, certify)
    finally:
        recorder.release()


def _recorded(
    job: _Job, recorder: _Recorder, observers: Observers, raise_failure: bool, certify: bool
) -> Result:
    def append(chunk: dict[str, Any]) -> None:
        recorder.append(chunk)
        if observers.rows is not None:
            observers.rows(chunk)

    ended = False
    try:
        with _DeferredInterrupts() as interrupts:
            summary = _simulate(job, append, observers, interrupts)
            recorder.finish(summary)
            ended = True
    except KeyboardInterrupt as error:
        if not ended:  # before the first row: there is nothing to store
            recorder.abandon(error)
            raise
        reason = {
            "code": "simulation/interrupted",
            "message": "interrupted after the run",
            "help": "the result is whole",
        }
        raise Interrupted(reason, recorder.result()) from None
    except BaseException as error:
        returned = not raise_failure and recorder.is_unused
        if returned and isinstance(error, SimulationError) and error.code == _TIME_IS_UP:
            return recorder.without_rows(error.reason)
        if not (isinstance(error, FileError) and recorder.rescued(error)):
            recorder.abandon(error)
        raise
    result = recorder.result()
    if summary["status"] != "completed":
        reason = summary.get("stop_reason") or {"message": "the run ended early"}
        if summary["status"] == "interrupted":
            raise Interrupted({"code": "simulation/interrupted", **reason}, result)
        if raise_failure:
            raise SimulationError(reason, result)
    elif certify and _certified(job, recorder.reader, result, observers):
        message = "interrupted in the second run, which certifies; the result of the first is whole"
        raise Interrupted(
            {
                "code": "simulation/interrupted",
                "message": message,
                "help": "take it as it is, or certify it by another run",
            },
            result,
        )
    return result


def _resolved(
    model: Model, options: Options, state: dict[str, NDArray[np.float64]] | None
) -> tuple[dict[str, Any], list[str], str]:
    """Return what a run uses, stated, of the model or by default.

    Returns
    -------
    chosen : dict
    requested : list of str
        Channels and components that were asked for.
    text : str
        `chosen` as JSON.
    """
    start = None if state is None else float(state["time"][0])
    asked = (_encode(options.to_dict()), start)
    kept = model._choices  # once: threads may share the model
    if kept is None or kept[0] != asked:
        with translated():
            resolved = model._core.options(asked[0], start)
        chosen = {name: value for name, value in resolved.items() if value is not None}
        requested = model.expand(chosen["channels"])
        whole = [split_component(name)[0] for name in requested]
        chosen["channels"] = list(dict.fromkeys([*whole, *model.diagnostics]))
        kept = model._choices = (asked, chosen, requested, _encode(chosen))
    _, chosen, requested, text = kept
    # A result's own, to be changed without harm to the next one.
    own = {k: v.copy() if isinstance(v, dict | list) else v for k, v in chosen.items()}
    return own, list(requested), text


#: Plain data as JSON; `json.dumps` also looks for circles.
_encode = json.JSONEncoder(check_circular=False, separators=(",", ":")).encode


def _require_certifiable(chosen: Mapping[str, Any]) -> None:
    """Refuse to certify steps that no tolerance controls, and runs without steps."""
    if chosen["end_time"] <= chosen["start_time"]:
        raise UsageError(
            "`certify` compares a run with a second one, and this one ends where it starts: at "
            f"t = {chosen['end_time']:g} s\n  help: leave `certify` out, or set a later `end_time`"
        )
    if "fixed_step" in chosen:
        raise UsageError(
            "`certify` repeats the run at a tenth of the tolerance, and a fixed step follows none"
            "\n  help: leave `fixed_step` out, or run twice with different steps and compare"
        )


def _certify(job: _Job, reader: Stored, observers: Observers) -> bool:
    """Run a second time at a tenth of the tolerance and add what it says to the first run's store.

    Returns
    -------
    bool
        Whether Ctrl-C was pressed.
    """
    chosen = job.chosen
    start = float(chosen["start_time"])
    second = chosen | {"tolerance": tightened(chosen["tolerance"]), "dense_output": False}
    # Where something else than errors limits steps, a repetition would take the same ones.
    longest = _SHORTER * reader.meta["statistics"]["largest_step"]
    if longest > 0.0:
        for name in {"max_step"} | ({"initial_step"} & chosen.keys()):
            second[name] = min(longest, chosen.get(name, longest))
    times: list[float] = chosen.get("output_times") or [start]
    # Positions are measured by their movement since the start, which is then an output, too.
    ahead = int(times[0] > start)
    if ahead:
        second["output_times"] = [start, *times]
    names = certified_channels(job.model, reader.meta["requested"])
    measurement = Measurement(job.model, names, reader, chosen["tolerance"], ahead)
    summary: dict[str, Any] = {}
    failure: dict[str, Any] | None = None
    interrupted = False
    try:
        if observers.progress is not None:
            observers.progress(start, 0.0, 0)
        again = replace(job, chosen=second, text=_encode(second))
        with _DeferredInterrupts() as interrupts:
            summary = _simulate(again, measurement.append, observers, interrupts, repeats=True)
    except KeyboardInterrupt:
        interrupted = True
    except HolonomError as error:
        failure = error.to_json()
    if summary and summary["status"] != "completed":
        failure = summary["stop_reason"]
        interrupted = interrupted or summary["status"] == "interrupted"
    elif interrupted and not measurement.complete:
        failure = {"code": "simulation/interrupted", "message": "interrupted"}
    certification = Certification(
        tolerance=second["tolerance"],
        channels=measurement.errors(),
        until=measurement.until,
        reason=unfinished(failure) if failure else {},
        statistics=summary.get("statistics") or {},
    )
    warnings = [*reader.meta["warnings"]]
    if warning := certification.warning():
        warnings.append(warning)
    reader.amend({"certification": certification.to_json(), "warnings": warnings})
    return interrupted


def _certified(job: _Job, reader: Stored, result: Result, observers: Observers) -> bool:
    """Do what `_certify` does; where its finding cannot be stored, the first run is not lost."""
    try:
        return _certify(job, reader, observers)
    except FileError as error:
        error.result = result
        raise


def _renamed(asked: Path, output: Path) -> dict[str, str]:
    return {
        "code": "result/renamed",
        "message": f"`{asked}` holds the result that this run starts from and does not continue: "
        f"it stays, and this run is in `{output}`",
        "path": "",
    }


def _not_repeated(error: Exception) -> dict[str, str]:
    what = f"`{error}` comes" if isinstance(error, NotRepeatedError) else "its steps come"
    return {
        "code": "result/not-repeated",
        "message": f"{what} out otherwise here than when the run was stopped, on another "
        "machine or by another build; it goes on from its last row, and from there on its rows "
        "are not, to the last bit, those of a run that was never stopped",
        "path": "",
    }


def _simulate(
    job: _Job,
    on_chunk: Callable[[dict[str, Any]], None],
    observers: Observers,
    interrupts: _DeferredInterrupts,
    *,
    repeats: bool = False,
) -> dict[str, Any]:
    def on_progress(time: float, step_size: float, steps: int) -> None:
        with interrupts.heeded():
            if observers.progress is not None:
                observers.progress(time, step_size, steps)

    def on_stage(stage: str) -> None:
        with interrupts.heeded():
            if observers.watch is not None:
                observers.watch(stage)

    with translated():
        summary = job.model._core.simulate(
            job.text, job.state, on_chunk, on_progress, on_stage, job.checkpoint, repeats
        )
    if summary["status"] == "interrupted":
        interrupts.settle()
    return summary


class _Recorder:
    """Opens the store with the first chunk, so that a run that never starts replaces nothing."""

    def __init__(
        self,
        model: Model,
        chosen: dict[str, Any],
        requested: list[str],
        output: Path | None,
        certified: bool,
        continues: Reader | None,
        force: bool,
        place: Rewind | None = None,
    ) -> None:
        self._continues = continues
        self._place = place
        self._older = dict(continues.meta) if continues is not None else {}
        if place is not None and not place.is_whole:
            self._older = before_part(self._older)
        self._force = force
        self._model = model
        self._chosen = chosen
        self._requested = requested
        self._output = output
        self._certified = certified
        self._writer: Writer | Memory | None = None
        self._reader: Stored | None = None
        #: Added to those of the model and of the run.
        self.warnings: list[dict[str, str]] = []
        #: Why nothing is stored any more.
        self.failure: BaseException | None = None

    def append(self, chunk: dict[str, Any]) -> None:
        """Store a chunk of the core; after one that could not be stored, none: no row is skipped.

        At its end, whatever the reason, the core hands over the last state.
        """
        if self.failure is not None:
            raise self.failure
        with self._noted():
            self._open().append(chunk)

    def finish(self, summary: dict[str, Any]) -> None:
        """Store the summary and complete the file."""
        summary = dict(summary)
        warnings = self._model.warnings
        found = [*self.warnings, *(summary.pop("warnings", None) or [])]
        warnings += [w for w in found if w not in warnings]
        if self._certified:
            none = Certification(tightened(self._chosen["tolerance"]), reason=NO_SECOND_RUN)
            summary["certification"] = none.to_json()
        summary |= {"warnings": warnings, "finished": _now()}
        if self._older and not (self._place is not None and self._place.is_whole):
            summary = merged(self._older, summary)
        with self._noted():
            written = self._open()
            if "statistics" in summary:
                summary["statistics"]["outputs"] = written.count
            written.finish(summary)

    @contextlib.contextmanager
    def _noted(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            self.failure = error
            raise

    @property
    def is_unused(self) -> bool:
        """Whether nothing has come, not even the state at the start."""
        return self._writer is None

    def without_rows(self, reason: dict[str, Any]) -> Result:
        """Return the result of a run that a limit ended before its first step: in memory.

        So it replaces nothing.
        """
        self._output, self._continues, self._older = None, None, {}
        self.finish({"status": "limit", "stop_reason": reason})
        return self.result()

    def rescued(self, error: FileError) -> bool:
        """Give the error of a file that took no more what was stored before; the file says why.

        Where an older result still stands, it is in memory.

        Returns
        -------
        bool
            Whether anything was stored.
        """
        if error is not self.failure:  # one of a function that the run called
            return False
        message, _, tip = str(error).partition("\n  help: ")
        reason = {"code": error.code, "message": message, "help": tip}
        meta = {"status": "failed", "stop_reason": reason, "finished": _now()}
        try:
            if isinstance(self._writer, Writer) and self._writer.fail(meta):
                error.result = self.result()
        except FileError:  # nor does the disk read
            pass
        return error.result is not None

    def abandon(self, error: BaseException) -> None:
        """Close what was stored before something else ended the run; the file says what.

        It is taken up as that of a run that was killed.
        """
        try:
            # What the file itself refused it has said, or cannot say.
            if isinstance(self._writer, Writer) and error is not self.failure:
                what = ": ".join(filter(None, (type(error).__name__, str(error))))
                reason = {
                    "code": "simulation/interrupted",
                    "message": f"the run was ended by {what.encode(errors='replace').decode()}",
                    "help": "the rows before that are whole",
                }
                self._writer.fail({"stop_reason": reason})
        except Exception:  # noqa: BLE001, S110 - the error that ended the run is the one to tell
            pass
        finally:
            if self._writer is not None:
                self._writer.close()

    def release(self) -> None:
        """Let other runs write the file."""
        if self._writer is not None:
            self._writer.release()

    @property
    def reader(self) -> Stored:
        """What was written; nothing is appended after it was first asked for."""
        if self._reader is None:
            written = self._open()
            self._reader = written if isinstance(written, Memory) else Reader.of(written)
        return self._reader

    def result(self) -> Result:
        result = Result(self.reader, self._model)
        result.continued = self._continues is not None
        return result

    def _open(self) -> Writer | Memory:
        if self._writer is None:
            model = self._model
            meta: dict[str, Any] = {
                "holonom": _core.version(),
                "name": model.name,
                "title": model.title,
                "model_hash": model.hash,
                "options": self._chosen,
                "requested": self._requested,
                "warnings": model.warnings,
                "status": "running",
                "started": _now(),
            }
            if self._output is None:
                self._writer = Memory(meta, model.channels, lambda: {"model": model.to_dict()})
                return self._writer
            meta["model"] = model.to_dict()
            older = self._continues
            if self._place is not None:
                meta["options"] = self._chosen | {"start_time": start_time(self._older)}
                if self._place.is_whole:
                    meta["started"] = self._older.get("started", meta["started"])
                else:
                    meta = GOING_ON | {"options": meta["options"]}
            elif older is not None:
                until = float(older.row(older.count - 1)["time"][0])
                meta = continued(self._older, until, self._chosen)
            self._writer = Writer(
                self._output,
                meta,
                model.channels,
                continues=older,
                rewind=self._place,
                force=self._force,
            )
            if older is not None and self._place is None:
                older.close()
        return self._writer


class _DeferredInterrupts:
    """Let Ctrl-C take effect where it is heeded, and after the block.

    So the core ends in good order, and what is written is whole. What was raised where it was
    heeded but did not end the run, which was at its end and being checked, is raised after the
    block.
    """

    def __init__(self) -> None:
        self._asked: list[int] = []
        self._before: Any = None
        self._raised: KeyboardInterrupt | None = None

    def __enter__(self) -> _DeferredInterrupts:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._ask)
            if not callable(self._before):  # Ctrl-C does nothing, and is to go on doing so
                signal.signal(signal.SIGINT, self._before)
                self._before = None
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
        if kind is None:
            with self.heeded():  # what was pressed since then comes first
                if self._raised is not None:
                    raise self._raised

    def _ask(self, number: int, _: object) -> None:
        self._asked.append(number)

    @contextlib.contextmanager
    def heeded(self) -> Iterator[None]:
        """Do what Ctrl-C does, if it was pressed, then what is in the block."""
        try:
            if self._asked:
                self._before(self._asked.pop(), None)
            yield
        except KeyboardInterrupt as error:
            self._raised = error
            raise

    def settle(self) -> None:
        """Forget what was raised: the run was ended by it."""
        self._raised = None


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime())
