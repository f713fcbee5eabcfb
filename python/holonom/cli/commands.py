"""The command line: ``holonom run | check | models | …``."""

from __future__ import annotations

import contextlib
import copy
import datetime as dt
import functools
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from holonom import library
from holonom.base import files
from holonom.base.errors import (
    Exit,
    FileError,
    HolonomError,
    SimulationError,
    UsageError,
    describe,
)
from holonom.base.names import COMMANDS, OPTIONS, did_you_mean, nearest
from holonom.base.text import one_line, shown
from holonom.cli.flags import (
    Words,
    read_changes,
    read_methods,
    read_size,
    read_times,
    read_tolerance,
    read_tolerances,
    takes_options,
)
from holonom.cli.progress import ComparisonProgress, FrameProgress, RunProgress, Stages
from holonom.cli.terminal import (
    complain,
    done,
    facts,
    fail,
    print_comparison,
    print_json,
    print_summary,
    print_version,
    say,
)
from holonom.model import Model

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.view.live import Live

app = typer.Typer(
    name="holonom",
    help="Implicit integration of constrained multibody systems.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit status: 0 ok, 1 usage, 2 invalid model, 3 solver failure, 4 some runs "
    "failed, 5 files, 6 results differ, 70 a defect, 130 interrupted, 141 the output was closed.",
)

#: Begins a model argument that names one of the library.
LIBRARY = "library:"

ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="Model file, TOML or JSON, or library:NAME.")
]
ResultFile = Annotated[Path, typer.Argument(metavar="RESULT", help="Result file.")]
Values = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change a value of the model; repeatable."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Force = Annotated[
    bool,
    typer.Option("--force", help="Replace a file that this command did not write, too."),
]
Recover = Annotated[bool, typer.Option("--recover", help="Read what is left of a damaged result.")]
Names = Annotated[
    list[str] | None,
    typer.Argument(metavar="[CHANNEL]...", help="Channels, or patterns such as 'rack_slide.*'."),
]


def _seconds(name: str, text: str) -> Any:
    return typer.Option(name, metavar="SECONDS", help=text)


@app.callback(invoke_without_command=True)
def command(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and how it was built.")
    ] = False,
    json_: Json = False,
) -> None:
    """Implicit integration of constrained multibody systems."""
    if version:
        print_version(json_)
        raise typer.Exit(Exit.OK)
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
@takes_options
def run(
    model: ModelFile,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Result file, results/<model>.holonom by default; missing folders are made. "
            "An older one stands until the run is beyond its start.",
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
    at: Annotated[float | None, _seconds("--at", "Which state; the last one by default.")] = None,
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
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")] = False,
    json_: Json = False,
    *,
    choices: dict[str, Any],
) -> int:
    """Run a model and store the result."""
    loaded = _load(model, values)
    target = output or Path("results") / f"{loaded.name}.holonom"
    if at is not None and start is None:
        raise UsageError("`--at` is given without a result", help="add `--start RESULT`")
    if at is not None and not math.isfinite(at):
        raise UsageError(f"`--at` is {at}", help="give a finite time, s")
    state = None
    if start is not None:
        with _opened(start, recover=recover) as older:
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
            print_json(facts(result) | ({"error": failure.to_json()} if failure else {}))
        elif not quiet:
            print_summary(result)
            before.tell(result)
    if failure is not None:
        if not json_:
            complain(str(failure))
        return failure.exit_code
    return Exit.OK


@app.command()
def compare(
    model: ModelFile,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            help="Codes, and options of one: ForSDIRK,ForRosen or ForSDIRK,jacobian=differences; "
            "repeatable. All implicit codes by default.",
        ),
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(help="Numbers, or relative=1e-3,rotation=1e-4; repeatable. 1e-2 to 1e-5."),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(metavar="RESULT", help="Compare with this result; else one is made."),
    ] = None,
    reference_tolerance: Annotated[
        str | None,
        typer.Option(help="Of the reference made; 1/1000 of the tightest tolerance by default."),
    ] = None,
    save_reference: Annotated[
        Path | None, typer.Option(metavar="RESULT", help="Store the reference made.")
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(
            "-c",
            "--channel",
            "--channels",
            help="What is compared: channels, patterns, 'positions' (default), 'velocities'; "
            "repeatable, or with commas. Prints the error analysis of each.",
        ),
    ] = None,
    end_time: Annotated[float | None, _seconds("--end-time", "Time at which the runs end.")] = None,
    interval: Annotated[
        float | None, _seconds("--interval", "Time between the errors taken; 1/200 of the run.")
    ] = None,
    max_steps: Annotated[int | None, typer.Option(help="Largest number of steps of a run.")] = None,
    max_seconds: Annotated[
        float | None, _seconds("--max-seconds", "Largest wall time of a run.")
    ] = None,
    repeat: Annotated[int, typer.Option(help="Timed runs of each; their median counts.")] = 3,
    jobs: Annotated[
        int, typer.Option("-j", "--jobs", help="Processes; the timed runs stay alone.")
    ] = 1,
    csv: Annotated[Path | None, typer.Option(help="Write the table.")] = None,
    errors: Annotated[Path | None, typer.Option(help="Write the error analysis as CSV.")] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw error against processor time: .svg, .pdf or .png.")
    ] = None,
    values: Values = None,
    force: Force = False,
    recover: Recover = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")] = False,
    json_: Json = False,
) -> int:
    """Compare methods and tolerances with a reference: errors, work, processor time."""
    import holonom

    loaded = _load(model, values)
    channels = [name for text in channel or [] for name in text.split(",")]
    choices: dict[str, Any] = {
        "methods": read_methods(method or []),
        "tolerances": [limit for text in tolerance or [] for limit in read_tolerances(text)],
        "reference_tolerance": None
        if reference_tolerance is None
        else read_tolerance(reference_tolerance, "--reference-tolerance"),
        "reference": None if reference is None else holonom.Result.load(reference, recover=recover),
        "save_reference": save_reference,
        "channels": channels,
        "end_time": end_time,
        "interval": interval,
        "max_steps": max_steps,
        "max_seconds": max_seconds,
    }
    picture = ""
    if plot is not None:
        from holonom.pictures import plotting

        picture = plotting.require_format(plot)  # now, not after the runs
    files.require_targets(
        [
            (save_reference, "result"),
            (csv, "comparison"),
            (errors, "comparison"),
            (plot, picture),
        ],
        inputs=[*loaded.sources, reference],
        force=force,
    )
    interrupted = False
    with ComparisonProgress(loaded.name, shown=not (quiet or json_)) as progress:
        try:
            comparison = holonom.compare(
                loaded,
                repeat=repeat,
                processes=jobs,
                progress=progress,
                force=force,
                **{key: value for key, value in choices.items() if value not in (None, [])},
            )
        except holonom.ComparisonInterrupted as error:
            comparison, interrupted = error.comparison, True
    timed = any(row.errors and row.cpu_samples for row in comparison.rows)
    try:
        if csv is not None:
            comparison.to_csv(csv, force=force)
        if errors is not None:
            comparison.errors_to_csv(errors, force=force)
        if plot is not None and (timed or not interrupted):
            comparison.plot(plot, force=force)
    except HolonomError:
        if not (json_ or quiet):  # the work of minutes is shown all the same
            print_comparison(comparison, analysis=bool(channels))
        raise
    if json_:
        print_json(comparison.to_json())
    elif not quiet:
        print_comparison(comparison, analysis=bool(channels))
    if interrupted:
        if not json_:
            complain("the comparison was interrupted; the rows that were finished are kept")
        return Exit.INTERRUPTED
    failed = sum(row.status != "completed" for row in comparison.rows)
    if failed:
        return Exit.SOLVER if failed == len(comparison.rows) else Exit.PARTIAL
    return Exit.OK


@app.command()
def check(
    model: ModelFile,
    values: Values = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="A line per edge of the spanning tree.")
    ] = False,
    json_: Json = False,
) -> int:
    """Validate and assemble a model; print counts, redundancy and stiffness."""
    report = _load(model, values).check()
    if json_:
        print_json(report.to_json())
    else:
        say("\n".join([str(report), *(report.tree_lines() if verbose else [])]))
    return Exit.OK


@app.command()
def plot(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULT... [CHANNEL]...",
            help="Result files, laid over each other; then channels, components such as "
            "'chassis.position[2]', or patterns.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Picture: .svg, .pdf or .png; by default RESULT.svg."),
    ] = None,
    start: Annotated[float | None, _seconds("--from", "Draw from here on.")] = None,
    end: Annotated[float | None, _seconds("--to", "Draw up to here.")] = None,
    interval: Annotated[
        float | None, _seconds("--interval", "Time between values; the stored rows by default.")
    ] = None,
    versus: Annotated[
        str | None,
        typer.Option(metavar="CHANNEL", help="Draw over a scalar or a component, not the time."),
    ] = None,
    fft: Annotated[bool, typer.Option("--fft", help="Draw amplitudes over frequencies.")] = False,
    window: Annotated[
        str | None, typer.Option(help="Of --fft: hann (default), rectangular or flat_top.")
    ] = None,
    derivative: Annotated[
        bool, typer.Option("--derivative", help="Draw derivatives over time.")
    ] = False,
    low_pass: Annotated[
        float | None,
        typer.Option("--filter", metavar="HZ", help="Draw what is slower than this; no delay."),
    ] = None,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Draw channels over time; without names those that the run was asked for."""
    if window is not None and not fft:
        raise UsageError("`--window` is given without `--fft`", help="add `--fft`")
    _require_times(start, end)
    if low_pass is not None and not (low_pass > 0.0 and math.isfinite(low_pass)):
        raise UsageError(f"`--filter` is {low_pass}", help="it must be positive and finite, Hz")
    results, channels = _results_first(names)
    target = output or results[0].with_suffix(".svg")
    with contextlib.ExitStack() as opened:
        first, *others = [opened.enter_context(_opened(p, recover=recover)) for p in results]
        first.plot(
            *channels,
            others=others,
            start=start,
            end=end,
            interval=interval,
            versus=versus,
            fft=(window or True) if fft else False,
            derivative=derivative,
            low_pass=low_pass,
            path=target,
            force=force,
        )
    return done("picture", target, json_)


def _require_times(start: float | None, end: float | None) -> None:
    """Refuse the ends of a part of a run that are no times."""
    for flag, value in (("--from", start), ("--to", end)):
        if value is not None and not math.isfinite(value):
            raise UsageError(f"`{flag}` is {value}", help="give a finite time, s")


def _results_first(names: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Part result files from the channels that follow them; the first name is always a file."""
    count = 1
    while count < len(names) and _is_file(names[count]):
        count += 1
    return [Path(name) for name in names[:count]], list(names[count:])


def _is_file(name: str) -> bool:
    return name.endswith(".holonom") or os.path.isfile(name)  # noqa: PTH113 - of any text


@app.command()
def diff(
    first: ResultFile,
    second: Annotated[Path, typer.Argument(metavar="RESULT", help="Another result file.")],
    channels: Names = None,
    tolerance: Annotated[
        str | None,
        typer.Option(help="A number, or relative=1e-3,rotation=1e-4; the looser run's by default."),
    ] = None,
    within: Annotated[float, typer.Option(help="So many tolerances count as equal.")] = 1.0,
    start: Annotated[float | None, _seconds("--from", "Compare from here on.")] = None,
    end: Annotated[float | None, _seconds("--to", "Compare up to here.")] = None,
    recover: Recover = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")] = False,
    json_: Json = False,
) -> int:
    """Say which channels of two results differ, by how many tolerances, from when on.

    The exit status is 0 where they are equal within tolerance and 6 where they are not.
    """
    import holonom

    _require_times(start, end)
    with _opened(first, recover=recover) as one, _opened(second, recover=recover) as other:
        found = holonom.diff(
            one,
            other,
            channels,
            tolerance=None if tolerance is None else read_tolerance(tolerance),
            within=within,
            start=start,
            end=end,
        )
    if json_:
        print_json(found.to_json())
    elif not quiet:
        say(str(found))
    return Exit.OK if found.equal else Exit.DIFFERENT


@app.command()
def report(
    result: ResultFile,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Page; by default RESULT.html.")
    ] = None,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Write a self-contained HTML page about a run."""
    target = output or result.with_suffix(".html")
    with _opened(result, recover=recover) as loaded:
        loaded.report(target, force=force)
    return done("report", target, json_)


@app.command()
def view(
    result: Annotated[
        list[Path], typer.Argument(metavar="RESULT...", help="Result files, laid over each other.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Page; by default RESULT.view.html."),
    ] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Write a page in which the bodies move: one HTML file that needs nothing else."""
    from holonom.view import open_page

    target = output or result[0].with_suffix(".view.html")
    files.require_targets([(target, "page")], inputs=result, force=force)
    with contextlib.ExitStack() as opened:
        first, *others = [opened.enter_context(_opened(path, recover=recover)) for path in result]
        first.view(*others).save(target, force=force)
    if open_ and not open_page(target):
        complain(f"there is no browser to open; the page is {target}", "warning")
    return done("page", target, json_)


@app.command()
def render(
    result: Annotated[
        list[Path], typer.Argument(metavar="RESULT...", help="Result files, laid over each other.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="A picture (.png) or a film (.gif, .mp4); by default RESULT.png.",
        ),
    ] = None,
    at: Annotated[
        float | None, _seconds("--at", "Time of a picture; the start by default.")
    ] = None,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Pixels.")] = "1280x720",
    camera: Annotated[
        str, typer.Option(help="Where it is seen from: iso, front, side or top.")
    ] = "iso",
    fps: Annotated[float, typer.Option(help="Frames of a film per second.")] = 25.0,
    start: Annotated[float | None, _seconds("--from", "Where a film begins.")] = None,
    end: Annotated[float | None, _seconds("--to", "Where a film ends.")] = None,
    speed: Annotated[float, typer.Option(help="Seconds of the run per second of the film.")] = 1.0,
    dark: Annotated[bool, typer.Option("--dark", help="On dark ground.")] = False,
    browser: Annotated[
        Path | None,
        typer.Option(metavar="PROGRAM", help="Chromium, Chrome or Edge; looked for by default."),
    ] = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")] = False,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Draw a picture or a film of the bodies, without a display, by a browser of the machine."""
    target = output or result[0].with_suffix(".png")
    with contextlib.ExitStack() as opened:
        first, *others = [opened.enter_context(_opened(path, recover=recover)) for path in result]
        with FrameProgress(target.name, shown=not (quiet or json_)) as progress:
            first.render(
                target, *others, at=at, size=read_size(size), camera=camera, fps=fps, start=start,
                end=end, speed=speed, dark=dark, browser=browser, progress=progress, force=force,
            )  # fmt: skip
    return (
        Exit.OK if quiet else done("film" if target.suffix != ".png" else "picture", target, json_)
    )


@app.command()
def export(
    result: ResultFile,
    channels: Names = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The file; RESULT.csv by default, '-' prints CSV."),
    ] = None,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format", help="csv, parquet, netcdf or matlab; by default that of the file's name."
        ),
    ] = None,
    interval: Annotated[
        float | None, _seconds("--interval", "Time between rows; the stored rows by default.")
    ] = None,
    times: Annotated[
        str | None, typer.Option(help="Times of the rows, s, with commas: 0.1,0.25.")
    ] = None,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Write channels as CSV, Parquet, NetCDF or for MATLAB; without names those stored."""
    from holonom.export import FORMATS, format_of, write_csv

    format_ = format_of(output, format_)
    ending, write = FORMATS[format_]
    target = output or result.with_suffix(ending)
    if str(target) != "-":  # now, and of the file itself: rows at other times are in memory
        files.require_target(target, format_, inputs=[result], force=force)
    with _opened(result, recover=recover) as stored:
        rows = _row_times(stored, interval, times)
        loaded = stored if rows is None else stored.at(rows, channels)
        if str(target) == "-":
            if format_ != "csv":
                tip = f"name a file: `-o {result.stem}{ending}`"
                raise UsageError(f"`-o -` prints CSV, not {format_}", help=tip)
            write_csv(loaded, sys.stdout, channels)
            return Exit.OK
        write(loaded, target, channels, force=force)
        if not loaded.time.size:
            complain("the result has no rows; the table has a heading only", "warning")
    return done("table", target, json_)


#: Rows that an export makes at most, as a run.
_MOST_ROWS = 1e7


def _row_times(result: Result, interval: float | None, times: str | None) -> list[float] | None:
    """Return the times that rows are wanted at; None for those that are stored."""
    if interval is not None and times is not None:
        raise UsageError("both `--interval` and `--times` are given", help="leave one of them out")
    if times is not None:
        return read_times(times, "--times")
    if interval is None:
        return None
    if not (interval > 0.0 and math.isfinite(interval)):
        raise UsageError(f"`--interval` is {interval}", help="it must be positive and finite, s")
    if result.span is None and not result.time.size:
        raise UsageError(
            "the result has no rows and no stored steps: nothing to export",
            help="run the model again; `holonom info` says why this run ended",
        )
    first, last = result.span or (float(result.time[0]), float(result.time[-1]))
    if (last - first) / interval > _MOST_ROWS:
        raise UsageError(
            f"`--interval` is {interval}, which makes more than {_MOST_ROWS:.0e} rows",
            help="take a longer interval",
        )
    count = math.floor((last - first) / interval * (1.0 + 1e-12))
    return [min(first + k * interval, last) for k in range(count + 1)]


@app.command()
def info(result: ResultFile, recover: Recover = False, json_: Json = False) -> int:
    """Say what a result file holds, and up to which time."""
    with _opened(result, recover=recover) as loaded:
        if json_:
            print_json(facts(loaded))
        else:
            print_summary(loaded)
            if loaded.status != "completed" and loaded.stop_reason:
                say(describe(loaded.stop_reason))
            for name in loaded.channels:
                quantity = loaded.quantities[name]
                shape = f" {list(quantity.shape)}" if quantity.shape else ""
                say(one_line(f"  {name}{shape} {quantity.unit} {quantity.frame}").rstrip())
    return Exit.OK


@app.command()
def models(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="What one of them is, and its source.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FOLDER", help="Copy it there, to change it."),
    ] = None,
    json_: Json = False,
) -> int:
    """List the models that come with Holonom; MODEL is `library:NAME` in other commands."""
    if name is None:
        if output is not None:
            raise UsageError("`-o` needs the name of a model", help="`holonom models` lists them")
        found = library.entries()
        if json_:
            print_json([{"name": e.name, "title": e.title, "model": str(e.path)} for e in found])
        else:
            typer.echo("\n".join(f"{e.name:<22}{e.title}" for e in found))
    elif output is None:
        entry = library.entry(name)
        text = (entry.path.parent / "README.md").read_text(encoding="utf-8").rstrip("\n")
        if json_:
            facts = {"name": entry.name, "title": entry.title, "model": str(entry.path)}
            print_json(facts | {"text": text})
        else:
            typer.echo(f"{text}\n\nmodel file: {entry.path}")
    else:
        return done("model", library.copy(name, output)[0] / "model.toml", json_)
    return Exit.OK


@app.command()
def schema(
    reference: Annotated[
        bool, typer.Option("--reference", help="Print the reference page, in Markdown.")
    ] = False,
    json_: Json = False,  # noqa: ARG001 - the schema is JSON already
) -> int:
    """Print the JSON Schema of model files."""
    from holonom import _core

    typer.echo((_core.model_reference() if reference else _core.schema()).rstrip("\n"))
    return Exit.OK


def invoke(arguments: Sequence[str], received: Sequence[int] = ()) -> int:
    """Run a command line and return its exit status; errors of the user are one message.

    Parameters
    ----------
    arguments : sequence of str
        None of them shows the help.
    received : sequence of int, optional
        Numbers of the signals that came, filled while the command runs.
    """
    line = list(arguments) or ["--help"]
    try:
        status = _run(line)
        return 128 + received[0] if received and status == Exit.INTERRUPTED else status
    except KeyboardInterrupt as error:
        return _interrupted(error, line, received)
    except HolonomError as error:
        return fail(error.exit_code, error.to_json(), line, str(error))
    except typer.TyperException as error:  # an unknown flag, a missing argument
        text = f"{error.format_message()}\n  help: {_usage_help(error, line)}"
        return fail(Exit.USAGE, {"code": "usage/command-line", "message": shown(text)}, line)
    except BrokenPipeError:  # who reads has had enough, as `head`: nothing is wrong
        return Exit.PIPE
    except OSError as error:
        if error.filename:
            found = files.unusable(Path(os.fsdecode(error.filename)), error)
        else:
            tip = "see where the output goes, or whether its disk is full"
            found = FileError(f"standard output: {error.strerror or error}", tip)
        return fail(found.exit_code, found.to_json(), line, str(found))
    except Exception as error:  # noqa: BLE001 - whatever it is, it is not the user's fault
        if received:  # what an interrupt became on its way
            return _interrupted(error, line, received)
        import traceback

        typer.echo(shown(traceback.format_exc()), err=True)
        text = (
            f"this is a defect in Holonom, not in your model: {shown(repr(error))}\n"
            "  help: please report it with the model and the command line"
        )
        return fail(Exit.DEFECT, {"code": "holonom/defect", "message": text}, line)


def _run(line: list[str]) -> int:
    """Read a command line and do what it says.

    The library of the command line parses; its own way to run one would end broken pipes and Ctrl-C
    silently, with statuses of its own.
    """
    group: Any = typer.main.get_command(_part_for(line))
    for command in (group, *group.commands.values()):
        command.get_params = functools.partial(_with_words, command.get_params)
    if "_HOLONOM_COMPLETE" in os.environ:  # a shell asks what could come next
        group.main(line, prog_name="holonom")
    try:
        with group.make_context("holonom", line) as context:
            return int(group.invoke(context) or Exit.OK)
    except typer.Exit as done:  # `--help`
        return int(done.exit_code)


def _part_for(line: Sequence[str]) -> typer.Typer:
    """Return the program with the one command that is called: to build all takes a while."""
    asked = next((word for word in line if not word.startswith("-")), "")
    called = [c for c in app.registered_commands if c.callback and c.callback.__name__ == asked]
    if "--version" in line and not asked:
        called = app.registered_commands[:1]
    if not called or "_HOLONOM_COMPLETE" in os.environ:
        return app
    part = copy.copy(app)
    part.registered_commands = called
    return part


def _with_words(parameters: Callable[[Any], list[Any]], context: Any) -> list[Any]:
    """Return the parameters of a command, which read words as `Words` does.

    To import what the library reads them with takes longer than most commands, and it says less.
    """
    found = parameters(context)
    for parameter in found:
        parameter.get_runtime_param = Words(parameter).itself
    return found


def _interrupted(error: BaseException, line: Sequence[str], received: Sequence[int]) -> int:
    status = 128 + received[0] if received else int(Exit.INTERRUPTED)
    facts = {"code": "simulation/interrupted", "message": "interrupted"}
    if isinstance(error, HolonomError):
        facts = error.to_json()
    return fail(status, facts, line)


def _usage_help(error: typer.TyperException, line: Sequence[str]) -> str:
    """Say what was meant by a word of the command line, or where its words are listed."""
    group: Any = typer.main.get_command(app)
    command = next((word for word in line if word in group.commands), None)
    text = error.format_message()
    if command is None:
        asked = next((word for word in line if not word.startswith("-")), "")
        meant = [f"holonom {name}" for name in nearest(asked, group.commands, COMMANDS)]
        return did_you_mean(meant, "`holonom --help` lists the commands")
    if text.startswith("No such option"):
        known = {
            name.lstrip("-").replace("-", "_"): name
            for parameter in group.commands[command].params
            for name in parameter.opts
            if name.startswith("--")
        }
        asked = getattr(error, "option_name", "").lstrip("-").replace("-", "_")
        meant = [known[name] for name in nearest(asked, known, OPTIONS)]
        return did_you_mean(meant, f"`holonom {command} --help` lists the options")
    return f"`holonom {command} --help` lists arguments and options"


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


def _load(path: Path, values: list[str] | None) -> Model:
    if str(path).startswith(LIBRARY):
        path = library.entry(str(path).removeprefix(LIBRARY)).path
    with Stages(path.name) as watch:
        model = Model.load(path, watch=watch)
    changes = read_changes(values or [])
    return model.with_values(changes) if changes else model


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


@contextlib.contextmanager
def _opened(path: Path, *, recover: bool) -> Iterator[Result]:
    """Open a result; say in the end what of it is damaged."""
    from holonom.result import Result  # with NumPy, which takes as long as all else to import

    with Result.load(path, recover=recover) as result:
        yield result
        if result.damage:
            shown = "; ".join(result.damage[:_DAMAGE_SHOWN])
            more = len(result.damage) - _DAMAGE_SHOWN
            text = f"{shown}; {more} more" if more > 0 else shown
            complain(f"{path} is damaged, and lost are: {text} [result/damaged]", "warning")


#: Parts of a damaged result that are named.
_DAMAGE_SHOWN = 8
