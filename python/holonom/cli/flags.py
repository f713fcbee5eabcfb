"""The flags of a run, made of the description in `holonom.options`."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import fields
from typing import Annotated, Any, get_type_hints

import typer

from holonom.cli.words import read_names, read_times, read_tolerance
from holonom.options import Options

#: Types of the flags by what an option is; a list may be repeated.
_TYPES: dict[str, Any] = {
    "number": float | None,
    "positive": float | None,
    "factor": float | None,
    "count": int | None,
    "flag": bool | None,
    "names": list[str] | None,
}
#: Flags that are not called as their options are.
_FLAGS = {"channels": ("-c", "--channel", "--channels")}


def takes_options(command: Callable[..., int]) -> Callable[..., int]:
    """Give a command a flag for every choice of a run; those stated reach it as `choices`."""

    @functools.wraps(command)
    def wrapper(**given: Any) -> int:
        choices = {}
        for about in fields(Options):
            value = given.pop(about.name)
            if value is not None:
                choices[about.name] = _read(about.name, about.metadata["kind"], value)
        return command(**given, choices=choices)

    hints = get_type_hints(command, include_extras=True)
    own = [
        parameter.replace(annotation=hints[name])
        for name, parameter in inspect.signature(command).parameters.items()
        if name != "choices"
    ]
    flags = [
        inspect.Parameter(
            about.name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=_flag(about)
        )
        for about in fields(Options)
    ]
    own = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own]
    every = [own[0], *flags, *own[1:]]
    wrapper.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    wrapper.__annotations__ = {entry.name: entry.annotation for entry in every}
    return wrapper


def _flag(about: Any) -> Any:
    kind, words = about.metadata["kind"], about.metadata["words"]
    name = about.name.replace("_", "-")
    flags = _FLAGS.get(about.name, (f"--{name}/--no-{name}" if kind == "flag" else f"--{name}",))
    text = about.metadata["text"] + (f" One of {', '.join(words)}." if words else "")
    metavar = "SECONDS" if about.metadata["unit"] == "s" else None
    option = typer.Option(*flags, help=text, metavar=metavar)
    return Annotated[_TYPES.get(kind, str | None), option]


def _read(name: str, kind: str, value: Any) -> Any:
    flag = f"--{name.replace('_', '-')}"
    if kind == "tolerance":
        return read_tolerance(value, flag)
    if kind == "names":
        return read_names(value)
    return read_times(value, flag) if kind == "times" else value
