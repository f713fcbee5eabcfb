"""The commands there are, how a command line is read, and the exit status of every error."""

from __future__ import annotations

import copy
import functools
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from holonom.base import files
from holonom.base.errors import Exit, FileError, HolonomError, UsageError
from holonom.base.names import COMMANDS, OPTIONS, did_you_mean, nearest
from holonom.base.text import shown
from holonom.cli.arguments import Json
from holonom.cli.comparing import compare, diff
from holonom.cli.describing import check, info, models, schema
from holonom.cli.drawing import plot, render, report, view
from holonom.cli.exporting import export
from holonom.cli.running import run
from holonom.cli.terminal import fail, print_version
from holonom.cli.words import Words

app = typer.Typer(
    name="holonom",
    help="Implicit integration of constrained multibody systems.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit status: 0 ok, 1 usage, 2 invalid model, 3 solver failure, 4 some runs "
    "failed, 5 files, 6 results differ, 70 a defect, 130 interrupted, 141 the output was closed.",
)


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
    if context.invoked_subcommand is not None:
        if json_:  # in front of a command it means what it does behind it
            context.default_map = {context.invoked_subcommand: {"json_": True}}
        return
    if json_:
        raise UsageError(
            "`--json` is given without a command",
            help="write it behind the command, `holonom check MODEL --json`; alone it goes with "
            "`--version`",
        )
    typer.echo(context.get_help())


for _one in (
    run, compare, check, plot, diff, report, view, render, export, info, models, schema,
):  # fmt: skip
    app.command()(_one)


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
    except SystemExit as error:  # what the library of the command line makes of it in help
        if isinstance(error.__context__, BrokenPipeError):
            return Exit.PIPE
        raise
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
        with group.make_context("holonom", [*line]) as context:
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
    In help, a switch takes no word, and the usage has arguments as they are called.
    """
    found = parameters(context)
    for parameter in found:
        parameter.get_runtime_param = Words(parameter).itself
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        if parameter.param_type_name == "argument":
            parameter.get_usage_pieces = functools.partial(_usage, parameter)
    return found


def _usage(argument: Any, _: Any) -> list[str]:
    return [argument.metavar]


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
