"""What there is: ``holonom check``, ``info``, ``models`` and ``schema``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from holonom import library
from holonom.base.errors import Exit, FileError, UsageError, describe
from holonom.cli.arguments import (
    Json,
    ModelFile,
    Recover,
    ResultFile,
    Values,
    load_model,
    lost,
    output_to,
)
from holonom.cli.terminal import (
    as_data,
    complain,
    done,
    facts,
    print_json,
    print_summary,
    say,
    say_channels,
)

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.store.layout import Quantity


def check(
    model: ModelFile,
    values: Values = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="A line per edge of the spanning tree.")
    ] = False,
    channels: Annotated[
        bool, typer.Option("--channels", help="A line per channel: name, shape, unit and frame.")
    ] = False,
    json_: Json = False,
) -> int:
    """Validate and assemble a model; print counts, redundancy and stiffness."""
    loaded = load_model(model, values)
    report = loaded.check()
    if json_:
        print_json(report.to_json() | {"channels": as_data(loaded.channels.values())})
        return Exit.OK
    say("\n".join([str(report), *(report.tree_lines() if verbose else [])]))
    if channels:
        say("\nchannels: stored where a run asks for them, else computed from its states")
        say_channels(loaded.channels.values())
    return Exit.OK


def info(
    result: ResultFile,
    channels: Annotated[
        bool,
        typer.Option("--channels", help="List also the channels that can be computed."),
    ] = False,
    recover: Recover = False,
    json_: Json = False,
) -> int:
    """Say what a result file holds, up to which time, and whether all of it is whole."""
    from holonom.result import Result

    refused = "" if recover else _refused(result)
    with Result.load(result, recover=True) as loaded:
        damage = loaded.verify() or ([refused] if refused else [])
        failure = None if recover or not damage else _left(result, damage)
        if json_:
            failed = {}
            if failure is not None:
                error = failure.to_json() | {"damage": damage}
                failed = {"error": error, "exit_status": int(failure.exit_code)}
            known = {"computable": as_data(_computable(loaded))} if channels else {}
            print_json(facts(loaded) | known | failed)
            return Exit.OK if failure is None else failure.exit_code
        print_summary(loaded)
        if loaded.status != "completed" and loaded.stop_reason:
            say(describe(loaded.stop_reason))
        say_channels(loaded.quantities[name] for name in loaded.channels)
        if channels:
            say("not stored, and computed from the states when asked for:")
            say_channels(_computable(loaded))
        elif "q" in loaded.quantities and "model" in loaded.meta:
            say("others are computed from the states; `--channels` lists them")
    if failure is not None:
        raise failure
    if damage:
        complain(f"{lost(result, damage)} [result/damaged]", "warning")
    return Exit.OK


def _computable(result: Result) -> list[Quantity]:
    """Return the channels that are not stored and follow from the stored states."""
    if "q" not in result.quantities:
        return []
    return [q for name, q in result.model.channels.items() if name not in result.quantities]


def _refused(path: Path) -> str:
    """Return why a result is refused where nothing of it may be lost; empty if it is not."""
    from holonom.result import Result

    try:
        Result.load(path).close()
    except FileError as error:
        if error.code != "result/damaged":
            raise
        return str(error).partition("\n")[0]
    return ""


def _left(path: Path, damage: list[str]) -> FileError:
    """Return the error about a damaged result of which the rest was shown."""
    return FileError(
        f"{lost(path, damage)}; what is told here of it is whole",
        "`--recover`, with each command that reads results, reads the rest; a copy or a new run "
        "has all",
        code="result/damaged",
    )


def models(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="What one of them is, and its source.")
    ] = None,
    output: Annotated[
        Path | None, output_to("Copy it there, to change it.", metavar="FOLDER")
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
            known = {"name": entry.name, "title": entry.title, "model": str(entry.path)}
            print_json(known | {"text": text})
        else:
            typer.echo(f"{text}\n\nmodel file: {entry.path}")
    else:
        return done("model", library.copy(name, output)[0] / "model.toml", json_)
    return Exit.OK


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
