"""``holonom run``."""

from __future__ import annotations

import contextlib
import datetime as dt
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from holonom.base import files
from holonom.base.errors import Exit, SimulationError, UsageError
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
    target = output or Path("results") / f"{loaded.name}.holonom"
    if at is not None and start is None:
        raise UsageError("`--at` is given without a result", help="add `--start RESULT`")
    if at is not None and not math.isfinite(at):
        raise UsageError(f"`--at` is {at}", help="give a finite time, s")
    state = None
    if start is not None:
        with opened(start, recover=recover) as older:
            state = older.state(at)
    sources = [*loaded.sources, None if files.same_file(start, target) else start]
    if not keep:
        files.require_targets([(target, "result")], inputs=sources, force=force)
    before = _Older(target)
    failure: SimulationError | None = None
    with (
        _watched(loaded, choices.get("end_time"), watch=watch, open_=open_) as live,
        RunProgress(
            loaded, choices.get("end_time"), certify=certify, shown=not (quiet or json_)
        ) as progress,
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
        except SimulationError as error:
            if error.result is None:
                raise
            result, failure = error.result, error
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

    live = Live(model, end_time or model.defaults.get("end_time"))
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
        elif result.meta.get("parts"):
            say(f"{'continues':<22}{name}")
        elif files.same_file(result.path, self._target):
            say(f"{'replaces':<22}{name}")
        else:
            say(f"{'keeps':<22}{name}")
