"""``holonom run``."""

from __future__ import annotations

import contextlib
import datetime as dt
import math
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from holonom.base import files
from holonom.base.errors import Exit, FileError, Interrupted, SimulationError, UsageError
from holonom.cli.arguments import (
    Force,
    Json,
    ModelFile,
    Quiet,
    Recover,
    Values,
    load_model,
    opened,
    output_to,
    seconds,
)
from holonom.cli.flags import takes_options
from holonom.cli.progress import RunProgress
from holonom.cli.terminal import complain, facts, print_json, print_summary, say

if TYPE_CHECKING:
    from holonom.model import Model
    from holonom.result import Result
    from holonom.view.live import Live


@takes_options
def run(
    model: ModelFile,
    output: Annotated[
        Path | None,
        output_to(
            "Result file, results/<model>.holonom by default; missing folders are made. "
            "An older one stands until the run is beyond its start."
        ),
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULT",
            help="Start from a state of this result; from its last one, a run into the same file "
            "is appended. One that was killed or interrupted goes on as if it had not been.",
        ),
    ] = None,
    at: Annotated[float | None, seconds("--at", "Which state; the last one by default.")] = None,
    certify: Annotated[
        bool,
        typer.Option(
            "--certify",
            help="Repeat at a tenth of the tolerance; report the error of every channel.",
        ),
    ] = False,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch", help="Serve a page, on this machine alone, that shows the run as it goes on."
        ),
    ] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open that page in the browser.")] = False,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep an older result: write <name>-2.holonom, ….")
    ] = False,
    force: Force = False,
    recover: Recover = False,
    values: Values = None,
    quiet: Quiet = False,
    json_: Json = False,
    *,
    choices: dict[str, Any],
) -> int:
    """Run a model and store the result."""
    loaded = load_model(model, values)
    by_default = Path("results") / f"{loaded.name}.holonom"
    target = output or by_default
    end = choices.get("end_time", loaded.defaults.get("end_time"))
    if at is not None and start is None:
        raise UsageError("`--at` is given without a result", help="add `--start RESULT`")
    if at is not None and not math.isfinite(at):
        raise UsageError(f"`--at` is {at}", help="give a finite time, s")
    state = None
    ran: Mapping[str, Any] = {}
    if start is not None:
        with opened(start, recover=recover) as older:
            state, ran = older.state(at), older.meta
        _require_later(choices.get("start_time"), end, float(state["time"][0]), start)
    sources = [*loaded.sources, None if files.same_file(start, target) else start]
    if not keep:
        files.require_targets([(target, "result")], inputs=sources, force=force)
    before = _Older(target)
    failure: SimulationError | FileError | None = None
    with (
        _watched(loaded, end, watch=watch, open_=open_) as live,
        RunProgress(loaded, end, certify=certify, shown=not (quiet or json_)) as progress,
    ):
        try:
            result = loaded.simulate(
                start=state,
                output=target,
                progress=progress.run if progress else None,
                watch=progress.stage if progress else None,
                rows=live.append if live else None,
                certify=certify,
                keep=keep,
                force=force,
                source=start,
                **choices,
            )
        except (SimulationError, FileError) as error:
            if error.result is None:
                raise
            begins = {
                "--at": at is not None,
                "--certify": certify,
                "--keep": keep,
                "--start-time": "start_time" in choices,
            }
            result = error.result
            failure = _advised(error, model, by_default, [flag for flag in begins if begins[flag]])
        except UsageError as error:
            if start is not None and error.code == "simulation/start-state":
                raise _of_another_model(start, ran, loaded, error) from None
            raise
        if live:
            live.finish(result.status)
    with result:
        if json_:
            failed = {} if failure is None else {"error": failure.to_json()}
            status = Exit.OK if failure is None else failure.exit_code
            print_json(facts(result) | failed | {"exit_status": int(status)})
        elif not quiet:
            print_summary(result)
            before.tell(result)
    if failure is not None:
        if not json_:
            complain(str(failure))
        return failure.exit_code
    return Exit.OK


def _require_later(stated: float | None, end: float | None, time: float, start: Path) -> None:
    """Refuse times of a run that do not go with the state (s) of a result that it starts from."""
    if stated is not None and stated != time:
        raise UsageError(
            f"`--start-time` is {stated:g} s, and the run starts from the state of {start} at "
            f"{time:g} s",
            help="leave it out; `--at SECONDS` names the state to start from",
        )
    if end is not None and end < time:
        raise UsageError(
            f"the run ends at {end:g} s, before the state of {start} at {time:g} s that it starts "
            "from",
            help="take a later `--end-time`, or an earlier state: `--at SECONDS`",
        )


def _of_another_model(
    start: Path, ran: Mapping[str, Any], model: Model, error: UsageError
) -> UsageError:
    """Say whose state it is that a model cannot start from, if it is another's."""
    if ran.get("model_hash") == model.hash:
        return error
    name, why = str(ran.get("name", "")), str(error).partition(" [simulation/")[0]
    whose = f"another model ({name})" if name != model.name else f"another version of {name}"
    return UsageError(
        f"{start} is a run of {whose}: {why} [{error.code}]",
        error.code,
        f"start from a run of {model.name} with the same items",
    )


def _advised(
    error: SimulationError | FileError, model: Path, by_default: Path, begins: Sequence[str]
) -> SimulationError | FileError:
    """Say by which command a run that Ctrl-C ended goes on.

    Parameters
    ----------
    error : SimulationError or FileError
    model : path
        As the command was given it.
    by_default : path
        Where results of the model go.
    begins : sequence of str
        The flags that were given and with which the command would begin another run.
    """
    result = error.result
    if isinstance(error, FileError) or result is None or result.path is None:
        return error
    if result.status != "interrupted":
        return error
    path = result.path
    target = "" if files.same_file(path, by_default) else f" -o {shlex.quote(str(path))}"
    line = f"holonom run {shlex.quote(str(model))} --start {shlex.quote(str(path))}{target}"
    without = f" but without {' and '.join(f'`{flag}`' for flag in begins)}" if begins else ""
    tip = f"`{line}`, with the other options as they were{without}, goes on from it"
    return Interrupted(error.reason | {"help": f"what was computed is kept; {tip}"}, result)


@contextlib.contextmanager
def _watched(
    model: Model, end_time: float | None, *, watch: bool, open_: bool
) -> Iterator[Live | None]:
    """Serve the page of a run while the block runs, if it is asked for."""
    if open_ and not watch:
        raise UsageError("`--open` is given without a page", help="add `--watch`")
    if not watch:
        yield None
        return
    from holonom.view import open_address
    from holonom.view.live import Live

    live = Live(model, end_time)
    try:
        typer.echo(f"watch it at {live.address}", err=True)
        if open_ and not open_address(live.address):
            complain("there is no browser to open", "warning")
        yield live
    finally:
        live.close()


class _Older:
    """What stood at the target of a run before it began."""

    def __init__(self, target: Path) -> None:
        self._target = target
        try:
            self._status: os.stat_result | None = target.stat()
        except OSError:
            self._status = None

    def tell(self, result: Result) -> None:
        """Say what became of it."""
        if self._status is None:
            return
        moment = dt.datetime.fromtimestamp(self._status.st_mtime).astimezone()
        today = moment.date() == dt.datetime.now().astimezone().date()
        name = f"{self._target} of {moment:{'%H:%M' if today else '%Y-%m-%d %H:%M'}}"
        if result.path is None:
            say(f"{'keeps':<22}{name}: this run did not get beyond its start")
        elif result.continued:
            say(f"{'continues':<22}{name}")
        elif files.same_file(result.path, self._target):
            say(f"{'replaces':<22}{name}")
        else:
            say(f"{'keeps':<22}{name}")
