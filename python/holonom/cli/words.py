"""The words that users write on the command line, as numbers, paths, tolerances and values."""

from __future__ import annotations

import contextlib
import json
import math
import os
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

from holonom.base.errors import UsageError
from holonom.base.text import quoted


class Words:
    """Reads what users write for one flag or argument: numbers, paths and texts.

    Files are opened by the commands, and not looked at before.

    Parameters
    ----------
    parameter : parameter of a command
        As the library of the command line describes it.
    """

    def __init__(self, parameter: Any) -> None:
        self._flag = max(parameter.opts, key=len) if parameter.opts[0][:1] == "-" else ""
        kind = parameter.type_descriptor.annotation
        kinds = [one for one in (get_args(kind) or (kind,)) if one is not type(None)]
        self._read = _READERS[kinds[0]]

    def itself(self) -> Words:
        """Return this: what reads a parameter is asked for by a call."""
        return self

    def coerce(self, value: Any, **_: Any) -> Any:
        """Return what a word means, or several.

        Raises
        ------
        UsageError
            If it is no number where one is needed.
        """
        if isinstance(value, list | tuple):
            return [self._read(word, self._flag) for word in value]
        return None if value is None else self._read(value, self._flag)


def _number(word: Any, flag: str) -> float:
    try:
        return float(word)
    except ValueError:
        text = f"`{flag} {quoted(word)[1:]} is no number"
        raise UsageError(text, help="write it like 0.25 or 1e-3") from None


def _whole(word: Any, flag: str) -> int:
    with contextlib.suppress(ValueError):
        return int(word)
    number = _number(word, flag)
    if not number.is_integer():
        text = f"`{flag} {quoted(word)[1:]} is no whole number"
        raise UsageError(text, help="write it like 200 or 1e5")
    return int(number)


def _path(word: Any, flag: str) -> Path:
    # Paths forget a slash at the end, by which a file would be made in place of a folder.
    if str(word).endswith(os.sep) and not os.path.isdir(word):  # noqa: PTH112 - before it is a path
        text = f"`{flag} {quoted(word)[1:]}" if flag else quoted(word)
        raise UsageError(f"{text} names a folder that is not there", help="name a file")
    return Path(word)


_READERS: dict[Any, Callable[[Any, str], Any]] = {
    bool: lambda word, _: word,
    float: _number,
    int: _whole,
    str: lambda word, _: word,
    Path: _path,
}


def read_names(texts: list[str]) -> list[str]:
    """Return names with commas between them, of a flag that is repeatable."""
    return [name.strip() for text in texts for name in text.split(",")]


def _once(found: dict[str, Any], name: str, value: Any, flag: str) -> None:
    """Put a value by its name; refuse one that is there."""
    if name in found:
        text = f"`{flag} {quoted(name)[1:]} is given twice"
        raise UsageError(text, help="leave one of the two out")
    found[name] = value


def read_tolerance(text: str, flag: str = "--tolerance") -> float | dict[str, float]:
    """Return the tolerance of a flag: a number, or parts by name."""
    parts = [part.partition("=") for part in text.split(",")] if "=" in text else []
    try:
        if not parts:
            return float(text)
        values = [(name.strip(), float(value)) for name, _, value in parts]
    except ValueError:
        tip = "give a number, or relative=1e-3,translation=1e-4,rotation=1e-4"
        raise UsageError(f"`{flag} {quoted(text)[1:]} is no tolerance", help=tip) from None
    found: dict[str, float] = {}
    for name, value in values:
        _once(found, name, value, flag)
    return found


def read_tolerances(text: str) -> list[float | dict[str, float]]:
    """Return one tolerance in parts, or several numbers."""
    return [read_tolerance(part) for part in ([text] if "=" in text else text.split(","))]


def read_times(text: str, flag: str) -> list[float]:
    """Return numbers with commas between them."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        tip = "give numbers with commas, s: 0.1,0.25"
        raise UsageError(f"`{flag} {quoted(text)[1:]} are no times", help=tip) from None


def read_size(text: str) -> tuple[int, int]:
    """Read width and height of a picture: ``1280x720``.

    Raises
    ------
    UsageError
        If it is not of that form.
    """
    width, cross, height = text.lower().replace("×", "x").partition("x")
    if not (cross and width.strip().isdecimal() and height.strip().isdecimal()):
        raise UsageError(f"`--size` is {quoted(text)}", help="write it like 1280x720")
    return int(width), int(height)


def read_methods(texts: list[str]) -> list[dict[str, Any]]:
    """Return codes with their options: ``ForRosen,ForSDIRK,jacobian=differences`` are two."""
    methods: list[dict[str, Any]] = []
    for text in texts:
        first = len(methods)
        for part in text.split(","):
            name, equals, value = part.partition("=")
            if not equals:
                methods.append({"method": part.strip()})
            elif len(methods) == first:
                raise UsageError(
                    f"`--method {quoted(text)[1:]} has no code before {quoted(part)}",
                    help="write the code first: ForSDIRK,jacobian=differences",
                )
            else:
                _once(methods[-1], name.strip(), read_value(value), "--method")
    return methods


def read_changes(texts: list[str]) -> dict[str, Any]:
    """Return new values of a model by path, of ``PATH=VALUE``."""
    changes: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise UsageError(
                f"`--set {quoted(text)[1:]} is not PATH=VALUE", help="as in gravity[1]=-1.62"
            )
        _once(changes, name.strip(), read_value(value), "--set")
    return changes


def read_value(text: str) -> Any:
    """Return a number, a list, a table, true or false; anything else is a text."""
    try:
        return json.loads(text)
    except ValueError:
        return _toml_value(text.strip())
    except RecursionError:
        tip = "take fewer levels"
        raise UsageError(f"{quoted(text)} is nested too deeply", help=tip) from None


def _toml_value(text: str) -> Any:
    """Return a table, list or number as model files have it, ``{mass = 1}``, ``1_000`` or ``+2``.

    Numbers that Python reads, as ``.5``, are numbers, too; anything else is a text.
    """
    if text.startswith(("{", "[")) and "\n" not in text:
        with contextlib.suppress(tomllib.TOMLDecodeError, RecursionError):
            return tomllib.loads(f"value = {text}")["value"]
    with contextlib.suppress(ValueError):
        return int(text, base=0)
    with contextlib.suppress(ValueError):
        if math.isfinite(number := float(text)):
            return number
    return text
