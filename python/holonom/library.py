"""The models that come with Holonom: mechanisms with a source, and values to compare with."""

from __future__ import annotations

import contextlib
import difflib
import os
import re
import shutil
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from holonom.base import files
from holonom.base.errors import FileError, UsageError
from holonom.base.text import quoted

#: A folder for each model; in the repository a link to `models/`.
FOLDER = Path(__file__).parent / "models"


@dataclass(frozen=True, slots=True)
class Entry:
    """A model of the library.

    Attributes
    ----------
    name : str
        Name of its folder.
    title : str
        What it is, in one line.
    path : Path
        The model file; ``README.md`` beside it tells source and reference values.
    """

    name: str
    title: str
    path: Path


def entries() -> list[Entry]:
    """Return the models of the library by name."""
    return [_read(name) for name in names()]


def names() -> list[str]:
    """Return the names of the models of the library.

    Raises
    ------
    FileError
        If there are none: the installation lacks them.
    """
    found = sorted(path.parent.name for path in FOLDER.glob("*/model.toml"))
    if not found:
        raise FileError(
            f"the library has no models: there are none in {FOLDER}",
            "install Holonom again; in a copy of the repository that is a link to `models/`",
        )
    return found


def _read(name: str) -> Entry:
    path = FOLDER / name / "model.toml"
    return Entry(name, tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""), path)


def entry(name: str) -> Entry:
    """Return a model of the library.

    Raises
    ------
    UsageError
        If there is none of this name; it tells the nearest ones.
    """
    known = names()
    if isinstance(name, str) and name in known:
        return _read(name)
    near = difflib.get_close_matches(str(name), known, n=3, cutoff=0.4)
    raise UsageError(
        f"the library has no model {quoted(name)}"
        + (f"; did you mean {' or '.join(f'`{n}`' for n in near)}?" if near else "")
        + "\n  help: `holonom models` lists all of them"
    )


def copy(name: str, folder: Path) -> list[Path]:
    """Copy a model with all that belongs to it, and those it extends, into a folder.

    Returns
    -------
    list of Path
        The new folders, each with ``model.toml`` and README; that of the model is the first.

    Raises
    ------
    UsageError
        If there is no such model.
    FileError
        If one of the folders is there already, or cannot be written; then none is made.
    """
    sources = list(_extended(entry(name)))
    targets = [folder / source.name for source in sources]
    for target in targets:
        if target.exists():
            raise FileError(
                f"{target} is there already; it is not overwritten"
                "\n  help: give another folder, or move this one away"
            )
    with _beside(folder) as fresh:
        for source in sources:
            _copy_files(source.path.parent, fresh / source.name, folder / source.name)
        for target in targets:
            (fresh / target.name).rename(target)
    return targets


@contextlib.contextmanager
def _beside(folder: Path) -> Iterator[Path]:
    """Yield a new folder in one that is made; if the block raises, both are gone."""
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    fresh = folder / f".holonom-{os.getpid()}.new"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        fresh.mkdir()
        yield fresh
    except BaseException as error:
        shutil.rmtree(fresh, ignore_errors=True)
        for path in made:  # the innermost first
            with contextlib.suppress(OSError):
                path.rmdir()
        if isinstance(error, OSError) and not isinstance(error, FileError):
            raise files.unusable(Path(error.filename2 or error.filename or folder), error) from None
        raise
    fresh.rmdir()


def _copy_files(source: Path, fresh: Path, target: Path) -> None:
    """Copy the files of a folder into a new one, which is to be called `target`."""
    fresh.mkdir()
    for file in sorted(source.iterdir()):
        if file.is_file():
            try:
                # Contents only: what is installed may be read-only.
                shutil.copyfile(file, fresh / file.name)
            except OSError as error:
                # It names both files where no room is left, else the one that cannot be opened.
                refused = error.filename2 or error.filename
                at = file if refused == str(file) else target / file.name
                raise files.unusable(at, error) from None


def _extended(found: Entry) -> Iterable[Entry]:
    """Yield a model and those that it extends."""
    yield found
    base = tomllib.loads(found.path.read_text(encoding="utf-8")).get("extends", "")
    if match := re.fullmatch(r"\.\./(\w+)/model\.toml", base):
        yield from _extended(entry(match[1]))
