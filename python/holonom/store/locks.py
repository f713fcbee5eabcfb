"""Who writes a result: a lock that ends with the process that holds it, however that ends."""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator
from pathlib import Path

from holonom.base.errors import FileError

#: How long a reader that only asks may hold the lock, s; a writer waits so long before it gives up.
_PATIENCE = 0.3


class WriteLock:
    """Keeps other writers of a file out until `release` or the end of the process.

    It locks a small file beside, not the file itself, which another takes the place of while a run
    writes. What a killed process leaves of it is not locked any more and stops nobody.

    Parameters
    ----------
    real : Path
        The file, with links resolved.
    shown : Path
        Its name in messages.

    Raises
    ------
    FileError
        If another process, or another run of this one, writes the file.
    """

    def __init__(self, real: Path, shown: Path) -> None:
        self._path = _beside(real)
        self._handle: int | None = None
        deadline = time.monotonic() + _PATIENCE
        while True:
            handle = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                process = _process(handle)
                os.close(handle)
                if time.monotonic() < deadline:
                    time.sleep(0.02)
                    continue
                raise _busy(shown, process) from None
            except OSError:  # a file system without locks
                os.close(handle)
                return
            if _is_at(handle, self._path):  # else its owner has just removed it
                break
            os.close(handle)
        os.ftruncate(handle, 0)
        os.write(handle, str(os.getpid()).encode())
        self._handle = handle

    def release(self) -> None:
        """Let other writers in, and leave nothing behind."""
        if self._handle is not None:
            self._path.unlink(missing_ok=True)
            os.close(self._handle)
            self._handle = None


@contextlib.contextmanager
def only_writer(real: Path, shown: Path) -> Iterator[None]:
    """Keep other writers of a file out of a block, as `WriteLock`; its folder is made."""
    real.parent.mkdir(parents=True, exist_ok=True)
    lock = WriteLock(real, shown)
    try:
        yield
    finally:
        lock.release()


def writer_of(real: Path) -> int | None:
    """Return the process that writes a file, 0 if its number is unknown; None if nobody does."""
    try:
        handle = os.open(_beside(real), os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _process(handle) or 0
    except OSError:
        return None
    finally:
        os.close(handle)
    return None


def require_unwritten(real: Path, shown: Path) -> None:
    """Refuse a file that another run writes, before work begins that could not be stored.

    Raises
    ------
    FileError
        ``result/busy``.
    """
    process = writer_of(real)
    if process is not None:
        raise _busy(shown, process)


def sweep(real: Path) -> None:
    """Remove what a killed writer left of its lock."""
    with contextlib.suppress(FileError, OSError):
        if _beside(real).exists():
            WriteLock(real, real).release()


def _busy(shown: Path, process: int | None) -> FileError:
    return FileError(
        f"{shown} is being written by process {process or 'unknown'}\n  help: wait for its end, or "
        "give this run another name with `-o`",
        code="result/busy",
    )


def _beside(real: Path) -> Path:
    return real.with_name(f".{real.name}.lock")


def _process(handle: int) -> int | None:
    text = os.pread(handle, 20, 0)
    return int(text) if text.isdigit() else None


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))  # noqa: PTH116 - as of a handle
    except FileNotFoundError:
        return False
