"""What commands print: results and comparisons for readers, the same as data, errors."""

from __future__ import annotations

import contextlib
import json
import platform
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from holonom.base.errors import Exit
from holonom.base.text import as_json, one_line, shown

if TYPE_CHECKING:
    from holonom.result import Result
    from holonom.store.layout import Quantity
    from holonom.study.comparison import Comparison

#: Lines of an error analysis that are printed; a longer one goes to a file.
ANALYSIS_SHOWN = 240


def print_version(json_: bool) -> None:
    """Print the facts of this build."""
    from importlib.metadata import version

    from holonom import _core

    built = {
        "holonom": _core.version(),
        **json.loads(_core.build()),
        "python": platform.python_version(),
        "numpy": version("numpy"),
    }
    if json_:
        print_json(built)
    else:
        say("holonom {holonom}, {profile} build for {target} with {simd}".format(**built))
        say("Python {python}, NumPy {numpy}".format(**built))


def facts(result: Result) -> dict[str, Any]:
    """Return what is known about a result, without the model's text."""
    known = {key: value for key, value in result.meta.items() if key != "model"}
    known |= {
        **({"options": result.options} if "options" in known else {}),
        "result": str(result.path),
        "n_times": result.time.size,
        "stored_until": float(result.time[-1]) if result.time.size else None,
        "channels": as_data(result.quantities[name] for name in result.channels),
    }
    return known


def as_data(quantities: Iterable[Quantity]) -> list[dict[str, Any]]:
    """Return channels as plain data: name, unit, frame and shape of each."""
    return [
        {"name": q.name, "unit": q.unit, "frame": q.frame, "shape": list(q.shape)}
        for q in quantities
    ]


def say_channels(quantities: Iterable[Quantity]) -> None:
    """Print a line for each channel: name, shape, unit and frame."""
    for q in quantities:
        shape = f" {list(q.shape)}" if q.shape else ""
        say(one_line(f"  {q.name}{shape} {q.unit} {q.frame}").rstrip())


def print_summary(result: Result) -> None:
    """Print warnings and the lines that say how a run went."""
    from holonom.check import warning_line
    from holonom.summary import summarize

    for warning in result.warnings:
        say(one_line(warning_line(warning)))
    stored = [] if result.path is None else [("result", str(result.path))]
    for label, text in [*summarize(result), *stored]:
        say(f"{label:<22}{one_line(text)}")


def print_comparison(comparison: Comparison, *, analysis: bool) -> None:
    """Print a comparison, perhaps with the errors of every channel."""
    from rich.console import Console

    from holonom.study.comparison import as_text

    parts: list[Any] = [comparison]
    if analysis and len(comparison.channels) * len(comparison.rows) <= ANALYSIS_SHOWN:
        parts.append(comparison.error_table())
    elif analysis:
        parts.append("the error analysis is long; `--errors FILE` writes it as CSV")
    for part in parts:
        if sys.stdout.isatty():
            Console(highlight=False, markup=False).print(part)
        else:
            typer.echo(as_text(part))


def print_json(data: Any) -> None:
    """Print plain data."""
    typer.echo(as_json(data))


def say(text: str) -> None:
    """Print text that may hold names and titles of files: every line of it is safe to show."""
    typer.echo(shown(text))


def done(what: str, path: Path, json_: bool) -> int:
    """Say what was written, and return the exit status."""
    if json_:
        print_json({what: str(path)})
    else:
        say(f"{what:<22}{one_line(path)}")
    return Exit.OK


def fail(status: int, error: dict[str, Any], arguments: Sequence[str], text: str = "") -> int:
    """Tell an error, as data or as `text`, and return the exit status."""
    text = text or error["message"]
    if "--json" in arguments:
        try:
            print_json({"error": error, "exit_status": int(status)})
        except BrokenPipeError:
            return Exit.PIPE
        except OSError:  # standard output is what is wrong
            complain(text)
    else:
        complain(text)
    return int(status)


def complain(message: str, kind: str = "error") -> None:
    """Print an error or a warning to standard error."""
    # The core renders findings with their own heading, `error[model/…]: …`.
    text = shown(message if message.startswith(kind) else f"{kind}: {message}")
    with contextlib.suppress(OSError):  # who closes this stream does not want to be told
        typer.echo(typer.style(text, fg="red") if sys.stderr.isatty() else text, err=True)
