"""What users pass, as plain data that the engine can take; what it cannot is refused by name."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from holonom.base.errors import FileError, ModelError, Problem, UsageError
from holonom.base.text import is_unicode, quoted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

#: Deepest nesting of a value; the core states the same limit for files.
MAX_DEPTH = 64


def frozen(value: Any) -> Any:
    """Return plain data that cannot be changed: mappings that refuse, tuples for lists."""
    if isinstance(value, dict):
        return MappingProxyType({key: frozen(entry) for key, entry in value.items()})
    return tuple(map(frozen, value)) if isinstance(value, list) else value


def as_path(path: str | Path) -> Path:
    """Return what a user names a file by as a path.

    Raises
    ------
    FileError
        If no file can have this name.
    UsageError
        If it is no name at all.
    """
    if isinstance(path, str) and not path:
        raise UsageError("a file is to have an empty name", help="give it one")
    try:
        found = Path(path)
    except TypeError:
        raise UsageError(
            f"{quoted(repr(path))} is no path", help="pass a text or a pathlib.Path"
        ) from None
    if "\0" in str(found):
        raise FileError(f"{quoted(found)} holds a NUL, which no file name can", help="leave it out")
    try:
        os.fsencode(found)
    except UnicodeEncodeError:
        raise FileError(
            f"{quoted(found)} holds what no file name can: half of a character",
            help="leave it out",
        ) from None
    return found


def plain(value: Any, path: str, depth: int = 0, within: str = "") -> Any:
    """Return a value as what JSON knows, NumPy's included; refuse what no model can hold.

    It is the new one of `path`, or all of a model if that is empty; `within` leads on from there.
    """

    def refused(code: str, message: str, tip: str) -> ModelError:
        where = f"the new value of {quoted(path)}" if path else "the data of the model"
        place = (path + within).lstrip(".")
        if within:
            where = f"{quoted(place)} in {where}"
        return ModelError(
            Problem(code=code, message=f"{where} {message}", path=quoted(place)[1:-1], help=tip)
        )

    if depth > MAX_DEPTH:
        tip = f"take fewer levels; no model needs more than {MAX_DEPTH}"
        raise refused("model/too-deep", "is nested too deeply", tip)
    if hasattr(value, "dtype") and hasattr(value, "tolist"):  # NumPy's; it is not imported for this
        value = value.tolist()
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        if (isinstance(value, int) and abs(value) > 10**100) or not math.isfinite(value):
            tip = "take a number between -1e100 and 1e100"
            raise refused("model/not-finite", "holds a number that is not finite", tip)
        return value
    if isinstance(value, str):
        if not is_unicode(value):
            tip = "take valid Unicode text"
            raise refused("model/unusable-value", "holds half a character", tip)
        return value
    if isinstance(value, Mapping):
        return {
            plain(str(key), path, within=within): plain(entry, path, depth + 1, f"{within}.{key}")
            for key, entry in value.items()
        }
    if isinstance(value, list | tuple):
        return [plain(entry, path, depth + 1, f"{within}[{i}]") for i, entry in enumerate(value)]
    tip = "take numbers, texts, lists and tables"
    raise refused("model/unusable-value", f"holds {quoted(repr(value))}", tip)


def real(values: ArrayLike) -> NDArray[np.float64]:
    """Return values as an array of numbers; complex ones, of which NumPy takes a part, are none.

    Raises
    ------
    TypeError, ValueError, OverflowError
        If they are no numbers.
    """
    import numpy as np  # here: it takes as long as all else to import

    array = np.asarray(values)
    if array.dtype.kind == "c":
        raise TypeError("complex numbers")
    return np.asarray(array, dtype=np.float64)


def require_text(text: str, what: str) -> None:
    """Refuse text that cannot be written in any file."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ModelError(
            Problem(
                code="model/syntax",
                message=f"{what} holds half a character at position {error.start}",
                help="take valid Unicode text",
            )
        ) from None


def require_callable(name: str, value: object) -> None:
    """Refuse what is neither a function nor left out."""
    if value is not None and not callable(value):
        raise UsageError(
            f"`{name}` is {quoted(repr(value))}", help="pass a function, or leave it out"
        )
