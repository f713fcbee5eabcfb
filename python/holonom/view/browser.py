"""A browser without a window, which shows one page and ends."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from holonom.base.errors import FileError

#: Names of browsers that can do it, and where they stand outside of the search path.
_NAMES = (
    "chromium", "chromium-browser", "google-chrome-stable", "google-chrome", "chrome",
    "microsoft-edge",
)  # fmt: skip
_PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
)
#: No window, no network, nothing kept; WebGL by the processor where there is no graphics card.
_FLAGS = (
    "--headless=new", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-extensions", "--disable-background-timer-throttling",
    "--disable-renderer-backgrounding", "--hide-scrollbars", "--mute-audio",
)  # fmt: skip


def find(browser: str | Path | None = None) -> str:
    """Return the program of a browser based on Chromium.

    Raises
    ------
    FileError
        If there is none; it says what to install.
    """
    if browser is not None:
        found = shutil.which(str(browser))
        if found is None:
            raise FileError(
                f"{browser} is no program", help="name the program of Chromium, Chrome or Edge"
            )
        return found
    for name in (*_NAMES, *_PLACES):
        if found := shutil.which(name):
            return found
    raise FileError(
        "there is no browser to draw pictures with",
        help="install Chromium (`apt install chromium`, `brew install chromium`) or name one with "
        "`--browser`; `holonom view` writes a page that any browser shows",
    )


@contextmanager
def showing(program: str, address: str, size: tuple[int, int]) -> Iterator[subprocess.Popen[bytes]]:
    """Show a page while the block runs; the browser and what it wrote are gone at its end."""
    with tempfile.TemporaryDirectory(prefix="holonom-", ignore_cleanup_errors=True) as profile:
        command = [
            program, *_FLAGS, f"--user-data-dir={profile}", f"--window-size={size[0]},{size[1]}",
        ]  # fmt: skip
        if os.geteuid() == 0:
            command.append("--no-sandbox")  # Chromium's sandbox refuses root
        with (Path(profile) / "said").open("wb") as said:
            # Ctrl-C is for the command, which then ends the browser.
            process = subprocess.Popen(  # noqa: S603 -- a program of the user's choice
                [*command, address],
                stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True,
                env=os.environ | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), profile),
            )  # fmt: skip
            try:
                yield process
            finally:
                _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the browser with all its processes."""
    with suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
