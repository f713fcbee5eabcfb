"""What can go wrong, with stable codes and the exit status of each kind."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from holonom import _core
from holonom.base.text import shown

if TYPE_CHECKING:
    from holonom.result import Result


class Exit(IntEnum):
    """Exit status of the command line."""

    OK = 0
    USAGE = 1
    MODEL = 2
    SOLVER = 3
    PARTIAL = 4
    FILES = 5
    #: Two results are not equal within tolerance.
    DIFFERENT = 6
    DEFECT = 70
    INTERRUPTED = 130
    #: What read the output has closed it: as a program that SIGPIPE ends.
    PIPE = 141


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One finding about a model.

    Parameters
    ----------
    code : str
        Stable code, such as ``model/unknown-name``; ``docs/errors.md`` lists them.
    message : str
        What is wrong, naming the item.
    path : str
        Path in the model, such as ``forces.front_bushing.stiffness[2]``.
    file, line, column : str, int or None, int or None
        Where it stands in the text, counted from 1.
    expected, help : str
        What was expected, and what to try.
    """

    code: str
    message: str
    path: str = ""
    file: str = ""
    line: int | None = None
    column: int | None = None
    expected: str = ""
    help: str = ""

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Problem:
        """Read a finding of the core; absent and null fields keep their defaults."""
        known = cls.__dataclass_fields__
        return cls(**{k: v for k, v in data.items() if k in known and v is not None})

    def __str__(self) -> str:
        place = self.file
        if self.line is not None:
            place += f":{self.line}" + (f":{self.column}" if self.column is not None else "")
        lines = [f"{self.message} [{self.code}]"]
        lines += [f"  at: {place}"] if place else []
        lines += [f"  path: {self.path}"] if self.path else []
        lines += [f"  expected: {self.expected}"] if self.expected else []
        lines += [f"  help: {self.help}"] if self.help else []
        return "\n".join(lines)


class HolonomError(Exception):
    """Base of the errors that a user can cause and handle.

    Attributes
    ----------
    exit_code : Exit
        Status with which the command line ends.

    The text ends in a line ``help:`` that says what to try. Control characters of names and paths
    are written as escapes in it, and long names are cut.
    """

    exit_code = Exit.USAGE
    #: What to try where nothing better is known.
    usual_help = "docs/errors.md lists every code with its meaning and what to try"

    def __init__(self, message: str, help: str = "") -> None:  # noqa: A002 - as in `Problem`
        if help or "help: " not in message:
            message = f"{message.rstrip()}\n  help: {help or self.usual_help}"
        super().__init__(shown(message))

    def __reduce__(self) -> tuple[Any, ...]:
        # By its parts: the arguments of most classes are not those that the text came from.
        return _restored, (type(self), self.args, self.__dict__)

    def to_json(self) -> dict[str, Any]:
        """Return the error as plain data, for ``--json``."""
        return {"message": str(self)}


class UsageError(HolonomError, ValueError):
    """An option or argument that cannot be used: unknown channel, negative tolerance, ….

    Attributes
    ----------
    code : str
        Stable code, such as ``simulation/unknown-method``.
    """

    usual_help = "`holonom COMMAND --help` and help(holonom.Options) say what there is"

    def __init__(
        self,
        message: str,
        code: str = "simulation/option",
        help: str = "",  # noqa: A002
    ) -> None:
        super().__init__(message, help)
        self.code = code

    def to_json(self) -> dict[str, Any]:
        """Return the error as plain data."""
        return {"code": self.code, "message": str(self)}


class FileError(HolonomError, OSError):
    """A file that cannot be read or written, must not be replaced, or is damaged.

    Attributes
    ----------
    code : str
        ``file/unusable``, ``file/protected``, ``result/busy``, ``result/closed``,
        ``result/damaged`` or ``result/replaced``.
    result : Result or None
        Of a run whose rows could not be stored any more: those that are stored.
    """

    exit_code = Exit.FILES
    code = "file/unusable"
    usual_help = "look whether the file is there, and whether its folder lets you read and write"

    def __init__(
        self,
        message: str,
        help: str = "",  # noqa: A002
        *,
        code: str = "file/unusable",
    ) -> None:
        super().__init__(message, help)
        self.code = code
        self.result: Result | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the error as plain data."""
        return {"code": self.code, "message": str(self)}


class ModelError(HolonomError):
    """A model that cannot be used, or whose initial state cannot be found.

    Attributes
    ----------
    problems : tuple of Problem
        All findings, in the order of the text.
    """

    exit_code = Exit.MODEL

    def __init__(self, *problems: Problem, rendered: str = "") -> None:
        super().__init__(rendered.rstrip() or "\n".join(map(str, problems)))
        self.problems = problems

    @property
    def code(self) -> str:
        """Code of the first finding."""
        return self.problems[0].code if self.problems else "model/invalid"

    def to_json(self) -> dict[str, Any]:
        """Return the findings as plain data."""
        fields = Problem.__dataclass_fields__
        return {
            "code": self.code,
            "message": str(self),
            "errors": [{f: getattr(p, f) for f in fields} for p in self.problems],
        }


class SimulationError(HolonomError):
    """A run that did not reach its end time.

    Attributes
    ----------
    reason : dict
        ``code``, ``message`` and, where known, ``time`` (s), ``step_size`` (s), ``item``,
        ``coordinate``, ``help``.
    result : Result or None
        What was computed before; None when the run never started.
    """

    exit_code = Exit.SOLVER

    def __init__(self, reason: dict[str, Any], result: Result | None = None) -> None:
        self.reason = {k: v for k, v in reason.items() if v is not None}
        self.result = result
        super().__init__(describe(self.reason))

    @property
    def code(self) -> str:
        """Stable code, such as ``simulation/newton-divergence``."""
        return str(self.reason.get("code", "simulation/failed"))

    def to_json(self) -> dict[str, Any]:
        """Return the reason as plain data."""
        return {"message": str(self), **self.reason}


class Interrupted(SimulationError, KeyboardInterrupt):  # noqa: N818 - not an error
    """A run that Ctrl-C ended; ``result`` holds what was computed.

    It is a `KeyboardInterrupt` as well, so that a loop over runs ends too.
    """

    exit_code = Exit.INTERRUPTED


def describe(reason: dict[str, Any]) -> str:
    """Return a reason (`SimulationError.reason`) as text of a few lines."""
    lines = [
        f"{reason.get('message', 'the run failed')} [{reason.get('code', 'simulation/failed')}]"
    ]
    for key in ("item", "coordinate"):
        lines += [f"  {key}: {reason[key]}"] if reason.get(key) else []
    where = [
        f"{name} {reason[key]:.9g} s"
        for key, name in (("time", "at"), ("step_size", "step size"))
        if isinstance(reason.get(key), int | float)
    ]
    lines += [f"  time: {', '.join(where)}"] if where else []
    tip = reason.get("help") or _HELP.get(str(reason.get("code")))
    lines += [f"  help: {tip}"] if tip else []
    return "\n".join(lines)


#: What to try where the core says nothing better.
_HELP = {
    "simulation/dense-output": "the steps stored are not those of this model: run it again",
    "simulation/interrupted": "what was computed is kept; `start=` or `--start` goes on from it",
}

#: Codes of choices that the core refuses before a run starts.
_USAGE = (
    "simulation/option",
    "simulation/unknown-method",
    "simulation/unknown-channel",
    "simulation/start-state",
    "simulation/short-table",
)


def _restored(kind: type[HolonomError], args: tuple[Any, ...], state: dict[str, Any]) -> Any:
    """Make an error again that was pickled or copied."""
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(state)
    return error


class _Translation:
    """A context, made once: one of `contextlib` takes as long as a step of a small model."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: object, _: object) -> None:
        if isinstance(error, _core.ModelError):
            data = json.loads(error.args[0])
            problems = [Problem.from_json(entry) for entry in data.get("errors", [])]
            raise ModelError(*problems, rendered=data.get("rendered") or "") from None
        if isinstance(error, _core.SimulationError):
            data = json.loads(error.args[0])
            usage = data.get("code") in _USAGE
            text = describe(data)
            raise (UsageError(text, data["code"]) if usage else SimulationError(data)) from None


_TRANSLATION = _Translation()


def translated() -> _Translation:
    """Return a context that turns errors of the core into those of this module."""
    return _TRANSLATION


for _public in (
    Problem,
    HolonomError,
    UsageError,
    FileError,
    ModelError,
    SimulationError,
    Interrupted,
):
    _public.__module__ = "holonom"  # the name that a traceback shows is the one to catch
