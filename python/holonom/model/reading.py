"""Reads model files, with what they extend and their meshes, and models given as text."""

from __future__ import annotations

import stat
from collections.abc import Callable, Mapping
from pathlib import Path

from holonom import _core, library
from holonom.base import files
from holonom.base.errors import FileError, ModelError, Problem, UsageError, translated
from holonom.base.plain import require_text
from holonom.base.text import as_name, as_text, quoted

#: Largest model file, bytes; the core states the same limit for text.
MAX_FILE_SIZE = 64 * 1024**2


def read_file(
    path: Path, watch: Callable[[str], None] | None
) -> tuple[_core.CoreModel, list[Path]]:
    """Return the model of a file, and the files that it was read from, its own first.

    Errors are those of `Model.load`.
    """
    text = _read(path)
    tree = path.resolve().parent.parent
    sources = [path]

    def within(name: str) -> Path:  # the core has joined it to the name of the model file
        target = Path(as_name(name)).resolve()
        if not target.is_relative_to(tree):
            raise FileError(
                f"it lies outside the folder tree {tree}", help="copy it into this tree"
            )
        sources.append(target)
        return target

    def read(name: str) -> str:
        return _read(within(name))

    syntax = "json" if path.suffix.lower() == ".json" else "toml"
    with translated():
        core = _core.parse(
            text, syntax, as_text(str(path)), read, lambda name: _read_mesh(within(name)), watch
        )
    return core, sources


def read_text(text: str, syntax: str | None, name: str) -> _core.CoreModel:
    """Return the model of a text; errors are those of `Model.from_text`."""
    if isinstance(text, Mapping):
        raise UsageError(
            "`text` is a mapping, not the text of a model",
            help="`Model.from_dict(data)` takes plain data",
        )
    if not isinstance(text, str):
        raise UsageError(
            f"`text` is {quoted(repr(text))}, not the text of a model",
            help="pass TOML or JSON, or read a file with `Model.load(path)`",
        )
    if not isinstance(name, str):
        raise UsageError(f"`name` is {quoted(repr(name))}", help="pass a text")
    require_text(name, "the name of the model")
    text = text.removeprefix("\ufeff")  # which files may begin with, too
    if syntax is None:
        syntax = "json" if text.lstrip().startswith("{") else "toml"
    if syntax not in ("toml", "json"):
        raise UsageError(
            f"`syntax` is {quoted(syntax)}", help='it is "toml" or "json", without a dot'
        )
    if "\n" not in text and text.strip().lower().endswith((".toml", ".json")):
        raise ModelError(
            Problem(
                code="model/syntax",
                message=f"{quoted(text.strip())} is the name of a file, not a model's text",
                help="read files with `Model.load(path)`",
            )
        )
    require_text(text, "the text of the model")

    def read(_: str) -> str:
        raise FileError("a model given as text cannot extend a file", help="use `Model.load(path)`")

    def read_mesh(_: str) -> bytes:
        raise FileError("a model given as text has no folder", help="use `Model.load(path)`")

    with translated():
        return _core.parse(text, syntax, as_text(name), read, read_mesh, None)


def _read(path: Path) -> str:
    there = files.found(path)
    if there is not None and stat.S_ISDIR(there.st_mode):
        meant = path / "model.toml"
        tip = f"did you mean {meant}?" if meant.is_file() else "name the model file in it"
        raise FileError(f"{path} is a folder, not a model file", tip)
    if there is not None and not stat.S_ISREG(there.st_mode):
        raise FileError(f"{path} is not a regular file", "save the model in a file first")
    try:
        if there is not None and there.st_size > MAX_FILE_SIZE:
            raise ModelError(
                Problem(
                    code="model/too-large",
                    message=f"the file has {there.st_size} bytes",
                    file=str(path),
                    expected=f"at most {MAX_FILE_SIZE} bytes",
                    help="repeat items by [patterns], or look whether this is a model at all",
                )
            )
        with path.open("rb") as file:
            if files.is_result(file.read(100)):
                raise ModelError(
                    Problem(
                        code="model/syntax",
                        message="the file is a result, not a model",
                        file=str(path),
                        expected="a model file, TOML or JSON",
                        help=f"`holonom info {path}` says what it holds; `Result.load(path).model` "
                        "is the model that was run",
                    )
                )
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ModelError(
            Problem(
                code="model/syntax",
                message=f"byte {error.start} of the file is not UTF-8",
                file=str(path),
                expected="a text file in UTF-8",
                help="save it as UTF-8",
            )
        ) from None
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> FileError:
    """Return why a model file cannot be read, and what was meant."""
    if not isinstance(error, FileNotFoundError):
        return files.unusable(path, error)
    name = path.stem if path.name != "model.toml" else path.parent.name
    try:
        is_of_library = name in library.names()
    except FileError:  # this installation has none
        is_of_library = False
    if is_of_library:
        return FileError(
            f"{path}: there is no such file",
            f"that of the library is `library:{name}`, or `Model.library({name!r})`",
        )
    return files.absent(path, "`holonom models` lists those that come with Holonom")


def _read_mesh(path: Path) -> bytes:
    if not path.is_file():
        raise FileError("there is no such file", "write the path relative to the model file")
    if path.stat().st_size > MAX_FILE_SIZE:
        raise FileError(f"it has {path.stat().st_size} bytes", "make the mesh coarser")
    return path.read_bytes()
