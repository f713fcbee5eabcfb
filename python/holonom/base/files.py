"""Files that commands write: which may be replaced, and how that is done without losing one.

Everything is written beside its target and renamed, so that a full disk, a kill or an error leaves
the older file whole. An older file is replaced only if it is one that the same command writes, and
it is never one that the command reads.
"""

from __future__ import annotations

import csv
import errno
import itertools
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from holonom.base.errors import FileError, UsageError
from holonom.base.names import did_you_mean, nearest
from holonom.base.text import quoted

APPLICATION_ID = 0x486F6C6F  # "Holo"

#: Name in files that Holonom made, by which they are known again.
MARK = b"Holonom"

#: So much of the beginning and of the end of a file is searched for the mark.
_SEARCHED = 1 << 16

#: Files of a folder among which the one that was meant is looked for.
_LOOKED_AT = 10_000

#: So far a file name is counted up, `rod-2.holonom`, …, when older ones are kept.
_MOST_NUMBERS = 100_000


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of file and how one that Holonom made is known.

    Parameters
    ----------
    title : str
        What it is called in messages.
    starts : tuple of bytes
        How such a file may begin.
    mark : bytes
        What it also holds, near its beginning or end; empty for a kind without a place for it.
    endings : tuple of str
        Of its file names. Others may be taken, too, but none that promises another kind of file.
    """

    title: str
    starts: tuple[bytes, ...]
    mark: bytes = MARK
    endings: tuple[str, ...] = ()

    def made(self, file: Any) -> bool:
        """Return whether an open file is one that Holonom made."""
        head: bytes = file.read(_SEARCHED)
        if self.title == RESULT:
            return is_result(head)
        if not head.startswith(self.starts):
            return False
        if self.mark in head:
            return True
        file.seek(max(0, os.fstat(file.fileno()).st_size - _SEARCHED))
        return self.mark in file.read(_SEARCHED)


RESULT = "Holonom result"

#: Kinds of files by name. A table has no place for a mark; its heading tells it. A model may begin
#: with anything: who writes one reads what is there, and tells.
KINDS = {
    "result": Kind(RESULT, (), endings=(".holonom",)),
    "model": Kind("model", (b"",), b"", (".toml", ".json")),
    "svg": Kind(
        "picture by Holonom", (b"<svg", b"<?xml"), b"<metadata>Holonom</metadata>", (".svg",)
    ),
    "pdf": Kind("picture by Holonom", (b"%PDF-",), endings=(".pdf",)),
    "png": Kind("picture by Holonom", (b"\x89PNG\r\n\x1a\n",), endings=(".png",)),
    "gif": Kind("film by Holonom", (b"GIF8",), endings=(".gif",)),
    "mp4": Kind(
        "film by Holonom",
        tuple(bytes([0, 0, 0, n]) + b"ftyp" for n in range(16, 64, 4)),
        endings=(".mp4",),
    ),
    "report": Kind(
        "report by Holonom", (b"<!doctype html>",), b'content="Holonom report"', (".html", ".htm")
    ),
    "page": Kind(
        "3-D page by Holonom", (b"<!doctype html>",), b'content="Holonom page"', (".html", ".htm")
    ),
    "csv": Kind("table of channels", (b"time (s)",), b"", (".csv", ".txt")),
    "comparison": Kind("table of a comparison", (b"method,tolerance,",), b"", (".csv", ".txt")),
    "parquet": Kind("table of channels by Holonom", (b"PAR1",), endings=(".parquet",)),
    "netcdf": Kind(
        "data set by Holonom", (b"\x89HDF\r\n\x1a\n",), endings=(".nc", ".nc4", ".h5", ".hdf5")
    ),
    "matlab": Kind("MATLAB file by Holonom", (b"MATLAB 5.0 MAT-file",), endings=(".mat",)),
}

#: Endings by which other programs take a file for one of theirs.
_PROMISES = (
    ".csv .tsv .txt .md .log .xls .xlsx .ods .json .toml .yaml .yml .xml .html .htm .py .m "
    ".mat .npy .npz .h5 .hdf5 .nc .nc4 .parquet .feather .svg .pdf .png .gif .jpg .jpeg .webp "
    ".bmp .tif .tiff .eps .ps .mp4 .avi .webm .doc .docx .ppt .pptx .odt .tex .zip .gz .tar "
    ".holonom "
)


def is_result(head: bytes) -> bool:
    """Return whether a file that begins so is a result, of whatever format."""
    number = APPLICATION_ID.to_bytes(4, "big")
    return head.startswith(b"SQLite format 3\0") and head[68:72] == number


def require_target(
    path: Path, kind: str, *, inputs: Iterable[Path | None] = (), force: bool = False
) -> Path:
    """Refuse a target that must not be written, and return the file that it stands for.

    Parameters
    ----------
    path : Path
        A regular file, or nothing; a link stands for what it points to.
    kind : str
        One of `KINDS`: an older file must be one of these.
    inputs : iterable of Path or None
        Files that the same command reads; they are refused even with `force`.
    force : bool
        Whether any other regular file may be replaced.

    Raises
    ------
    FileError
        If writing there would destroy something.
    UsageError
        If a new name promises another kind of file.
    """
    if not isinstance(force, bool):
        raise UsageError(f"`force` is {quoted(repr(force))}", help="it is True or False")
    if str(path) == "-":
        raise UsageError(
            f"`-`, standard output, takes no {KINDS[kind].title}",
            help="name a file; `holonom export -o -` prints channels as CSV",
        )
    real = Path(os.path.realpath(path))
    try:
        there = real.lstat()
    except FileNotFoundError:
        if not force:
            _require_ending(path, KINDS[kind])
        return real
    except (OSError, ValueError) as error:
        raise unusable(path, error) from None
    if stat.S_ISDIR(there.st_mode):
        raise FileError(f"{path} is a folder\n  help: give the name of a file in it")
    if not stat.S_ISREG(there.st_mode):
        raise FileError(
            f"{path} is not a regular file; only files are replaced\n  help: give another name"
        )
    for source in inputs:
        if source is not None and _same(source, there):
            raise FileError(
                f"{path} is a file that this command reads ({source}); it is not overwritten"
                "\n  help: give another name",
                code="file/protected",
            )
    if force or not there.st_size:
        return real
    if not os.access(real, os.W_OK):
        raise FileError(
            f"{path} is write-protected; it is not overwritten\n  help: give another name, or "
            "`--force` (`force=True`)",
            code="file/protected",
        )
    known = KINDS[kind]
    try:
        with real.open("rb") as file:
            made = known.made(file)
    except OSError as error:
        raise unusable(path, error) from None
    if not made:
        raise FileError(
            f"{path} is there and is not a {known.title}; it is not overwritten\n  help: give "
            "another name, or `--force` (`force=True`) to replace it",
            code="file/protected",
        )
    return real


def found(path: Path) -> os.stat_result | None:
    """Return what the system tells of a file, or None where there is none, also by its name."""
    try:
        return path.stat()
    except (OSError, ValueError):
        return None


def ending_of(path: Path) -> str:
    """Return by what other programs know a file, ``.csv``; that of ``.csv`` and ``x.`` too."""
    _, dot, ending = path.name.rpartition(".")
    return (dot + ending).lower() if dot else ""


def _require_ending(path: Path, kind: Kind) -> None:
    ending = ending_of(path)
    if ending in kind.endings or ending not in _PROMISES.split():
        return
    raise UsageError(
        f"{path}: {quoted(ending)} is not the ending of a {kind.title}",
        help=f"name it {quoted(path.with_suffix(kind.endings[0]))}, or take `--force` "
        "(`force=True`) to have it under this name",
    )


def require_targets(
    targets: Sequence[tuple[Path | None, str]],
    *,
    inputs: Iterable[Path | None] = (),
    force: bool = False,
) -> None:
    """Refuse targets of one command before its work begins; they must be different files, too."""
    sources = tuple(inputs)
    seen: dict[Path, Path] = {}
    for path, kind in targets:
        if path is None:
            continue
        real = require_target(path, kind, inputs=sources, force=force)
        if real in seen:
            raise FileError(
                f"{path} and {seen[real]} are the same file, for two things to be written"
                "\n  help: give each a name of its own",
                code="file/protected",
            )
        seen[real] = path


@contextmanager
def replacing(
    path: Path, kind: str, *, inputs: Iterable[Path | None] = (), force: bool = False
) -> Iterator[Path]:
    """Yield a new name beside a target; what is written there takes its place at the end.

    Parameters are those of `require_target`. If the block raises, the target is as it was.

    Raises
    ------
    FileError
        As `require_target`, and if the system refuses to write.
    """
    real = require_target(path, kind, inputs=inputs, force=force)
    fresh = real.with_name(f".holonom-{os.getpid()}-{next(_numbers)}.new")
    try:
        real.parent.mkdir(parents=True, exist_ok=True)
        yield fresh
        put_in_place(fresh, real)
    except FileError:
        raise
    except (OSError, ValueError) as error:
        if isinstance(error, ValueError) and "null byte" not in str(error):
            raise
        raise unusable(path, error) from error
    finally:
        with suppress(OSError, ValueError):
            fresh.unlink(missing_ok=True)


def put_in_place(fresh: Path, real: Path) -> None:
    """Rename a file that is complete over an older one, with the older one's mode and owner."""
    with fresh.open("rb") as file:
        os.fsync(file.fileno())  # a disk that is full may say so only now
    with suppress(FileNotFoundError):
        older = real.stat()
        with suppress(OSError):  # only root may give files away
            os.chown(fresh, older.st_uid, older.st_gid)
        fresh.chmod(stat.S_IMODE(older.st_mode))
    fresh.replace(real)


def write_text(
    path: Path, kind: str, text: str, *, inputs: Iterable[Path | None] = (), force: bool = False
) -> Path:
    """Write a text as UTF-8; see `replacing`."""
    with replacing(path, kind, inputs=inputs, force=force) as fresh:
        fresh.write_text(text, encoding="utf-8", newline="")
    return path


def write_table(
    path: Path,
    kind: str,
    lines: Iterable[Sequence[Any]],
    *,
    inputs: Iterable[Path | None] = (),
    force: bool = False,
) -> Path:
    """Write lines of cells as CSV; see `replacing` and `write_cells`."""
    with (
        replacing(path, kind, inputs=inputs, force=force) as fresh,
        fresh.open("w", encoding="utf-8", newline="") as file,
    ):
        write_cells(file, lines)
    return path


def write_cells(file: TextIO, lines: Iterable[Sequence[Any]]) -> None:
    """Write lines of cells as CSV; no text of a cell is a formula to a spreadsheet program."""
    csv.writer(file).writerows([_defused(cell) for cell in line] for line in lines)


def numbered(path: Path) -> Path:
    """Return the first name that is free: ``rod-2.holonom`` where ``rod.holonom`` is there."""
    if not os.path.lexists(path):
        return path
    for number in range(2, _MOST_NUMBERS):
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
        if not os.path.lexists(candidate):
            return candidate
    raise FileError(f"{path}: there is no free name of that kind\n  help: give another one")


def same_file(one: Path | None, other: Path | None) -> bool:
    """Return whether two names are those of one file that is there, through whatever links."""
    if one is None or other is None:
        return False
    try:
        return _same(one, other.stat())
    except (OSError, ValueError):
        return False


def unusable(path: Path, error: Exception) -> FileError:
    """Return what the system says about a file as an error with something to try."""
    said = getattr(error, "strerror", None) or str(error)
    number = getattr(error, "errno", None) or 0
    if number == errno.ENOENT:
        return FileError(f"{path}: no file can be made there", "write to another folder")
    return FileError(f"{path}: {said}", _HELP.get(number, "look at the name and at the folder"))


def absent(path: Path, otherwise: str = "") -> FileError:
    """Return the error of a file that is not there, with the name beside it that was meant.

    Parameters
    ----------
    path : Path
    otherwise : str
        What to try where no name beside it is like the one given.
    """
    meant: list[str] = []
    with suppress(OSError, ValueError):
        if path.is_symlink():
            text = f"{path} is a link to {path.readlink()}, which is not there"
            return FileError(text, "name the file itself, or make the link again")
        there = itertools.islice(path.parent.iterdir(), _LOOKED_AT)
        beside = [entry.name for entry in there if entry.is_file()]
        meant = [str(path.with_name(name)) for name in nearest(path.name, sorted(beside))]
        if not beside or meant == [str(path)]:
            meant = []
    if not meant and not path.parent.is_dir():
        otherwise = f"there is no folder {path.parent} either; see where you are"
    return FileError(
        f"{path}: there is no such file",
        did_you_mean(meant, otherwise or f"look what there is in the folder {path.parent}"),
    )


_HELP = {
    errno.ENOTDIR: "a part of the name is a file, not a folder",
    errno.EISDIR: "name a file in the folder",
    errno.EIO: "the disk or the connection to it fails; try a copy elsewhere",
    errno.ENODEV: "only files are read and written, no devices",
    errno.ENXIO: "only files are read and written, no devices",
    errno.EBUSY: "wait until whoever uses it is done, or give another name",
    errno.EMFILE: "close some files, or allow more open ones (`ulimit -n`)",
    errno.ENFILE: "close some programs: this machine can open no more files",
    errno.ENOSPC: "make room or write to another folder; a file that was there is as it was",
    errno.EDQUOT: "make room or write to another folder; a file that was there is as it was",
    errno.EFBIG: "allow larger files (`ulimit -f`); a file that was there is as it was",
    errno.EACCES: "ask for access to the file and its folder, or write to another folder",
    errno.EPERM: "ask for access to the file and its folder, or write to another folder",
    errno.EROFS: "write to another folder; this one is read-only",
    errno.ENAMETOOLONG: "give a shorter name",
    errno.ELOOP: "the link points to itself; give another name",
}

_numbers = itertools.count(1)


def _same(path: Path, other: os.stat_result) -> bool:
    try:
        return os.path.samestat(path.stat(), other)
    except (OSError, ValueError):
        return False


def _defused(cell: Any) -> Any:
    if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r", "\n")):
        return f"'{cell}"
    return cell
