"""``holonom export``: channels as tables for other programs."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from holonom.base import files
from holonom.base.errors import Exit, UsageError
from holonom.cli.arguments import (
    Force,
    Json,
    Names,
    Recover,
    ResultFile,
    made_of,
    opened,
    output_to,
    require_times,
    seconds,
)
from holonom.cli.terminal import complain, done
from holonom.cli.words import read_times
from holonom.options import MOST, require_positive, times_at

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from holonom.result import Result


def export(
    result: ResultFile,
    channels: Names = None,
    output: Annotated[
        Path | None, output_to("The file; RESULT.csv by default, '-' prints CSV.")
    ] = None,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format", help="csv, parquet, netcdf or matlab; by default that of the file's name."
        ),
    ] = None,
    interval: Annotated[
        float | None,
        seconds(
            "--interval", "Time between rows, one of them at the end; those stored by default."
        ),
    ] = None,
    times: Annotated[
        str | None, typer.Option(help="Times of the rows, s, with commas: 0.1,0.25.")
    ] = None,
    start: Annotated[float | None, seconds("--from", "Write rows from here on.")] = None,
    end: Annotated[float | None, seconds("--to", "Write rows up to here.")] = None,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Write channels as CSV, Parquet, NetCDF or for MATLAB; without names those stored."""
    from holonom.export import FORMATS, format_of, write_csv

    if json_ and str(output) == "-":
        tip = "leave one of them out, or name a file with `-o FILE`"
        raise UsageError("`-o -` prints CSV and `--json` prints JSON", help=tip)
    require_times(start, end)
    format_ = format_of(output, format_)
    ending, write = FORMATS[format_]
    target = output or made_of(result, ending)
    if str(target) != "-":  # now, and of the file itself: rows at other times are in memory
        files.require_target(target, format_, inputs=[result], force=force)
    with opened(result, recover=recover) as stored:
        wanted = _row_times(stored, interval, times, start, end)
        loaded = stored if wanted is None else stored.at(wanted, channels)
        rows = _part(loaded.time, start, end)
        if str(target) == "-":
            if format_ != "csv":
                tip = f"name a file: `-o {made_of(Path(result.name), ending)}`"
                raise UsageError(f"`-o -` prints CSV, not {format_}", help=tip)
            write_csv(loaded, sys.stdout, channels, rows=rows)
            return Exit.OK
        write(loaded, target, channels, rows=rows, force=force)
        if not loaded.time.size:
            complain("the result has no rows; the table has a heading only", "warning")
    return done("table", target, json_)


def _row_times(
    result: Result,
    interval: float | None,
    times: str | None,
    start: float | None,
    end: float | None,
) -> list[float] | None:
    """Return the times that rows are wanted at; None for those that are stored.

    Of those at an interval it is those near the part that is written.
    """
    if interval is not None and times is not None:
        raise UsageError("both `--interval` and `--times` are given", help="leave one of them out")
    if times is not None:
        return read_times(times, "--times")
    if interval is None:
        return None
    if result.span is None and not result.time.size:
        raise UsageError(
            "the result has no rows and no stored steps: nothing to export",
            help="run the model again; `holonom info` says why this run ended",
        )
    first, last = result.span or (float(result.time[0]), float(result.time[-1]))
    require_positive("--interval", interval)
    if (last - first) / interval < MOST:  # what is more is refused
        if start is not None and start > first:
            first += math.floor((min(start, last) - first) / interval) * interval
        if end is not None and end < last:
            intervals = math.ceil((max(end, first) - first) / interval + 1.0)
            last = min(last, first + intervals * interval)
    return times_at(interval, first, last, name="--interval")


def _part(times: NDArray[np.float64], start: float | None, end: float | None) -> slice:
    """Return which rows lie between two times, s."""
    # A row at 0.1 + 0.2 s is one at 0.3 s.
    slack = 1e-9 * max(abs(times[0]), abs(times[-1])) if times.size else 0.0
    first = 0 if start is None else int(times.searchsorted(start - slack))
    beyond = times.size if end is None else int(times.searchsorted(end + slack, side="right"))
    if times.size and first >= beyond:
        raise UsageError(
            f"no row lies between `--from` and `--to`; they go from {times[0]:g} s to "
            f"{times[-1]:g} s",
            help="take a part of them, or rows in between by `--interval`",
        )
    return slice(first, beyond)
