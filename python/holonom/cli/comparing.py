"""``holonom compare``, methods against a reference, and ``holonom diff``, two results."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated, Any

import typer

from holonom.base import files
from holonom.base.errors import Exit, HolonomError, UsageError
from holonom.cli.arguments import (
    Force,
    Json,
    ModelFile,
    Names,
    Quiet,
    Recover,
    ResultFile,
    Values,
    load_model,
    opened,
    require_times,
    seconds,
)
from holonom.cli.progress import CountedProgress
from holonom.cli.terminal import complain, print_comparison, print_json, say
from holonom.cli.words import read_methods, read_names, read_tolerance, read_tolerances


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
    end_time: Annotated[float | None, seconds("--end-time", "Time at which the runs end.")] = None,
    interval: Annotated[
        float | None, seconds("--interval", "Time between the errors taken; 1/200 of the run.")
    ] = None,
    max_steps: Annotated[int | None, typer.Option(help="Largest number of steps of a run.")] = None,
    max_seconds: Annotated[
        float | None, seconds("--max-seconds", "Largest wall time of a run.")
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
    quiet: Quiet = False,
    json_: Json = False,
) -> int:
    """Compare methods and tolerances with a reference: errors, work, processor time."""
    import holonom

    loaded = load_model(model, values)
    channels = read_names(channel or [])
    choices: dict[str, Any] = {
        "methods": read_methods(method or []),
        "tolerances": [limit for text in tolerance or [] for limit in read_tolerances(text)],
        "reference_tolerance": None
        if reference_tolerance is None
        else read_tolerance(reference_tolerance, "--reference-tolerance"),
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

        if repeat == 0:
            text = "`--repeat 0` takes no times, and `--plot` draws errors against them"
            raise UsageError(text, help="take `--repeat 1` or more, or leave `--plot` out")
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
    shown = not (quiet or json_)
    with (
        contextlib.nullcontext()
        if reference is None
        else opened(reference, recover=recover) as given,
        CountedProgress(loaded.name, "runs", "assembling", shown=shown) as progress,
    ):
        try:
            comparison = holonom.compare(
                loaded,
                reference=given,
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


def diff(
    first: ResultFile,
    second: Annotated[Path, typer.Argument(metavar="RESULT", help="Another result file.")],
    channels: Names = None,
    tolerance: Annotated[
        str | None,
        typer.Option(help="A number, or relative=1e-3,rotation=1e-4; the looser run's by default."),
    ] = None,
    within: Annotated[float, typer.Option(help="So many tolerances count as equal.")] = 1.0,
    start: Annotated[float | None, seconds("--from", "Compare from here on.")] = None,
    end: Annotated[float | None, seconds("--to", "Compare up to here.")] = None,
    recover: Recover = False,
    quiet: Quiet = False,
    json_: Json = False,
) -> int:
    """Say which channels of two results differ, by how many tolerances, from when on.

    The exit status is 0 where they are equal within tolerance and 6 where they are not.
    """
    import holonom

    require_times(start, end)
    with opened(first, recover=recover) as one, opened(second, recover=recover) as other:
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
