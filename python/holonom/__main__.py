"""The process behind the command: signals, pipes and closed streams, set up before all else.

Reading NumPy and the engine takes a tenth of a second, in which a signal may come as well as later;
so nothing heavy is imported at the top of this file.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from types import FrameType

#: Signals that end the command in good order; its exit status is then 128 + their number.
ENDING = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)

_FILES = 5
_PIPE = 141


def main() -> None:
    """Run the command line and exit with its status."""
    process = _Process()
    try:
        # What is drawn goes to files, whatever window system the environment asks for.
        os.environ["MPLBACKEND"] = "Agg"
        from holonom.cli.commands import invoke

        process.ready = True
        status = invoke(sys.argv[1:], process.received)
    except KeyboardInterrupt:  # between two lines of `invoke`
        status = 128 + process.received[0] if process.received else 130
    process.leave(status)


class _Process:
    """Signals and standard streams of this process."""

    def __init__(self) -> None:
        #: Whether a signal becomes `KeyboardInterrupt`; before, it ends the process at once.
        self.ready = False
        #: Numbers of the signals that came.
        self.received: list[int] = []
        #: Whether Ctrl-C is ignored, as of a job in the background; other signals then end it all
        #: the same, so that a run is to hear of them in its way.
        self._ignores_interrupts = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        signal.signal(signal.SIGINT, self._interrupt)
        for number in ENDING:
            if number != signal.SIGINT and signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._end)
        self._unraisable = sys.unraisablehook
        sys.unraisablehook = self._raise_again
        _open_streams()

    def leave(self, status: int) -> None:
        """Write what is left to write and exit."""
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)  # the status stands
        try:
            sys.stdout.flush()
        except BrokenPipeError:
            status = _PIPE
        except OSError as error:
            if status != _FILES:  # else the command has said so
                _say(f"error: standard output: {error.strerror}\n")
                _say("  help: see where the output goes, or whether its disk is full\n")
            status = status or _FILES
        # An interrupt within `exec` of a library leaves a mark, by which the interpreter would kill
        # itself at its end although the interrupt was caught; another `exec` takes it away.
        exec("pass")  # noqa: S102
        for stream in (sys.stdout, sys.stderr):
            # What cannot be written now must not be tried again at the end of the interpreter.
            with contextlib.suppress(OSError):
                stream.flush()
                continue
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        sys.exit(status)

    def _interrupt(self, number: int, _: FrameType | None) -> None:
        if number == signal.SIGINT and self._ignores_interrupts:
            return
        self._receive(number)
        raise KeyboardInterrupt

    def _end(self, number: int, frame: FrameType | None) -> None:
        """End the command as Ctrl-C does, also where that is deferred, as in a run."""
        handler = signal.getsignal(signal.SIGINT)
        if not callable(handler):
            handler = self._interrupt
        self._receive(number)
        handler(number, frame)

    def _receive(self, number: int) -> None:
        self.received.append(number)
        if not self.ready:  # nothing is open yet, and imports do not like exceptions
            _say("error: interrupted\n")
            os._exit(128 + number)

    def _raise_again(self, unraisable: sys.UnraisableHookArgs) -> None:
        """Do not lose a Ctrl-C that met a destructor."""
        if unraisable.exc_type is KeyboardInterrupt:
            signal.signal(signal.SIGALRM, signal.default_int_handler)
            signal.setitimer(signal.ITIMER_REAL, 0.01)  # now it would be lost again
        else:
            self._unraisable(unraisable)


def _open_streams() -> None:
    """Let closed streams refuse what is written, and no file take their numbers."""
    for number, mode in ((0, os.O_RDONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.dup2(os.open(os.devnull, mode), number)
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", encoding="utf-8")
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):  # a terminal may know fewer characters than we write
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        os.write(2, text.encode())


if __name__ == "__main__":
    main()
