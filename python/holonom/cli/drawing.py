"""Pictures, pages and films: ``holonom plot``, ``report``, ``view`` and ``render``."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from holonom.base import files
from holonom.base.errors import Exit, UsageError
from holonom.cli.arguments import (
    Force,
    Json,
    Quiet,
    Recover,
    ResultFile,
    ResultFiles,
    made_of,
    opened,
    opened_together,
    output_to,
    require_times,
    seconds,
)
from holonom.cli.progress import CountedProgress
from holonom.cli.terminal import complain, done
from holonom.cli.words import read_size


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
        Path | None, output_to("Picture: .svg, .pdf or .png; by default RESULT.svg.")
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(help="What a run is called, once for each; their files by default."),
    ] = None,
    start: Annotated[float | None, seconds("--from", "Draw from here on.")] = None,
    end: Annotated[float | None, seconds("--to", "Draw up to here.")] = None,
    interval: Annotated[
        float | None, seconds("--interval", "Time between values; the stored rows by default.")
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
    require_times(start, end)
    if low_pass is not None and not (low_pass > 0.0 and math.isfinite(low_pass)):
        raise UsageError(f"`--filter` is {low_pass}", help="it must be positive and finite, Hz")
    results, channels = _results_first(names)
    target = output or made_of(results[0], ".svg")
    with opened_together(results, recover=recover) as (first, *others):
        first.plot(
            *channels,
            others=others,
            labels=label or None,
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


def _results_first(names: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Part result files from the channels that follow them; the first name is always a file."""
    count = 1
    while count < len(names) and _is_file(names[count]):
        count += 1
    return [Path(name) for name in names[:count]], list(names[count:])


def _is_file(name: str) -> bool:
    return name.endswith(".holonom") or os.path.isfile(name)  # noqa: PTH113 - of any text


def report(
    result: ResultFile,
    output: Annotated[Path | None, output_to("Page; by default RESULT.html.")] = None,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Write a self-contained HTML page about a run."""
    target = output or made_of(result, ".html")
    with opened(result, recover=recover) as loaded:
        loaded.report(target, force=force)
    return done("report", target, json_)


def view(
    result: ResultFiles,
    output: Annotated[Path | None, output_to("Page; by default RESULT.view.html.")] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Write a page in which the bodies move: one HTML file that needs nothing else."""
    from holonom.view import open_page

    target = output or made_of(result[0], ".view.html")
    files.require_targets([(target, "page")], inputs=result, force=force)
    with opened_together(result, recover=recover) as (first, *others):
        first.view(*others).save(target, force=force)
    if open_ and not open_page(target):
        complain(f"there is no browser to open; the page is {target}", "warning")
    return done("page", target, json_)


def render(
    result: ResultFiles,
    output: Annotated[
        Path | None, output_to("A picture (.png) or a film (.gif, .mp4); by default RESULT.png.")
    ] = None,
    at: Annotated[float | None, seconds("--at", "Time of a picture; the start by default.")] = None,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Pixels.")] = "1280x720",
    camera: Annotated[
        str, typer.Option(help="Where it is seen from: iso, front, side or top.")
    ] = "iso",
    fps: Annotated[
        float, typer.Option(help="Frames of a film per second; of a GIF 50 at most.")
    ] = 25.0,
    start: Annotated[float | None, seconds("--from", "Where a film begins.")] = None,
    end: Annotated[float | None, seconds("--to", "Where a film ends.")] = None,
    speed: Annotated[float, typer.Option(help="Seconds of the run per second of the film.")] = 1.0,
    dark: Annotated[bool, typer.Option("--dark", help="On dark ground.")] = False,
    browser: Annotated[
        Path | None,
        typer.Option(metavar="PROGRAM", help="Chromium, Chrome or Edge; looked for by default."),
    ] = None,
    quiet: Quiet = False,
    force: Force = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Draw a picture or a film of the bodies, without a display, by a browser of the machine."""
    target = output or made_of(result[0], ".png")
    with (
        opened_together(result, recover=recover) as (first, *others),
        CountedProgress(target.name, "frames", "drawing", shown=not (quiet or json_)) as progress,
    ):
        first.render(
            target, *others, at=at, size=read_size(size), camera=camera, fps=fps, start=start,
            end=end, speed=speed, dark=dark, browser=browser, progress=progress, force=force,
        )  # fmt: skip
    return (
        Exit.OK if quiet else done("film" if target.suffix != ".png" else "picture", target, json_)
    )
