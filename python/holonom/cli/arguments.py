"""Arguments and flags that several commands take, and the models and results they name."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from holonom import library
from holonom.base.errors import UsageError
from holonom.cli.progress import Stages
from holonom.cli.terminal import complain
from holonom.cli.words import read_changes
from holonom.model import Model

if TYPE_CHECKING:
    from holonom.result import Result


#: Parts of a damaged result that are named.
_DAMAGE_SHOWN = 8
#: Begins a model argument that names one of the library.
LIBRARY = "library:"

ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="Model file, TOML or JSON, or library:NAME.")
]
ResultFile = Annotated[Path, typer.Argument(metavar="RESULT", help="Result file.")]
ResultFiles = Annotated[
    list[Path], typer.Argument(metavar="RESULT...", help="Result files, laid over each other.")
]
Values = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change a value of the model; repeatable."),
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")]
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


def seconds(name: str, text: str) -> Any:
    """Return a flag for a time or a duration."""
    return typer.Option(name, metavar="SECONDS", help=text)


def output_to(text: str, metavar: str | None = None) -> Any:
    """Return the flag that names what a command writes."""
    return typer.Option("-o", "--output", metavar=metavar, help=text)


def made_of(result: Path, ending: str) -> Path:
    """Return the name of what is made of a result where none is given: its own, and an ending.

    What has that ending is the target itself, which is refused where it is the result.
    """
    return Path(str(result).removesuffix(".holonom").removesuffix(ending) + ending)


def load_model(path: Path, values: list[str] | None) -> Model:
    """Read a model file, or one of the library, and change its values."""
    if str(path).startswith(LIBRARY):
        path = library.entry(str(path).removeprefix(LIBRARY)).path
    with Stages(path.name) as watch:
        model = Model.load(path, watch=watch)
    changes = read_changes(values or [])
    return model.with_values(changes) if changes else model


@contextlib.contextmanager
def opened(path: Path, *, recover: bool) -> Iterator[Result]:
    """Open a result; say in the end what of it is damaged."""
    from holonom.result import Result  # with NumPy, which takes as long as all else to import

    with Result.load(path, recover=recover) as result:
        yield result
        if result.damage:
            complain(f"{lost(path, result.damage)} [result/damaged]", "warning")


def lost(path: Path, damage: Sequence[str]) -> str:
    """Return what of a damaged result is lost."""
    shown = "; ".join(damage[:_DAMAGE_SHOWN])
    more = len(damage) - _DAMAGE_SHOWN
    text = f"{shown}; {more} more" if more > 0 else shown
    return f"{path} is damaged, and lost are: {text}"


@contextlib.contextmanager
def opened_together(paths: Sequence[Path], *, recover: bool) -> Iterator[list[Result]]:
    """Open results to be laid over each other, as `opened`."""
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(opened(path, recover=recover)) for path in paths]


def require_times(start: float | None, end: float | None) -> None:
    """Refuse the ends of a part of a run that are no times."""
    for flag, value in (("--from", start), ("--to", end)):
        if value is not None and not math.isfinite(value):
            raise UsageError(f"`{flag}` is {value}", help="give a finite time, s")
