"""Choices for one run."""

from __future__ import annotations

import functools
import inspect
import itertools
import json
import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypedDict, TypeVar

from holonom import _core
from holonom.base.errors import UsageError
from holonom.base.names import METHODS, TOLERANCES, did_you_mean, listed, nearest
from holonom.base.names import OPTIONS as WORDS_OF_OTHERS
from holonom.base.text import is_unicode, quoted

#: Rows that times at an interval make at most, as of a run.
MOST_ROWS = 10_000_000
#: Largest count: whole numbers up to here are exact as numbers of any file.
MOST = 2.0**53


#: Choices that contradict each other.
_EITHER = (
    ("interval", "output_times"),
    ("fixed_step", "max_step"),
    ("fixed_step", "initial_step"),
)
#: Parts of a tolerance.
PARTS = ("relative", "translation", "rotation")


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Tolerances of a run.

    Parameters
    ----------
    relative : float
        Part of a position's movement since the start, or of a velocity's value.
    translation : float, optional
        Absolute part of translations, m and m/s; `relative` when not given.
    rotation : float, optional
        Absolute part of rotations, rad and rad/s; `relative` when not given.

    Raises
    ------
    UsageError
        If a part is not a positive finite number.
    """

    relative: float = None  # type: ignore[assignment] # refused below, in words
    translation: float | None = None
    rotation: float | None = None

    def __post_init__(self) -> None:
        if self.relative is None:
            raise UsageError(
                "a `Tolerance` has no part `relative`",
                help="state it, or pass a mapping, {'translation': 1e-6}: what it leaves out is "
                "that of the model",
            )
        for name in PARTS:
            value = getattr(self, name)
            value = self.relative if value is None else value
            object.__setattr__(self, name, require_positive(f"tolerance.{name}", value))

    @classmethod
    def of(
        cls, value: float | Mapping[str, float] | Tolerance, default: Mapping[str, float]
    ) -> Tolerance:
        """Return the tolerance meant by a number or a mapping of parts.

        Parts that a mapping leaves out are those of `default`.
        """
        if isinstance(value, Tolerance):
            return value
        if isinstance(value, Mapping):
            return cls(**{**default, **_parts(value)})
        return cls(value)


def _choice(kind: str, text: str, unit: str = "", words: Sequence[str] = ()) -> Any:
    """Return a field of `Options` with all there is to say about it.

    Validation, the docstring, the options of the command line and their help follow from it.
    """
    about = {"kind": kind, "text": text, "unit": unit, "words": tuple(words)}
    return field(default=None, metadata=about)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Choices for one run; what is None is taken from the model, or is the default of the core."""

    end_time: float | None = _choice("number", "Time at which the run ends.", "s")
    start_time: float | None = _choice(
        "number", "Time at which it starts; that of the state when it continues from one.", "s"
    )
    tolerance: float | Mapping[str, float] | Tolerance | None = _choice(  # noqa: RUF009
        "tolerance",
        "One number for all parts, or some of relative, translation (m; m/s) and rotation "
        "(rad; rad/s); the others are then the model's.",
    )
    method: str | None = _choice(
        "method", "Integration code such as ForSDIRK, or a family; `holonom.methods` lists them."
    )
    formula: str | None = _choice("text", "Formula, when the method is a family.")
    interval: float | None = _choice("positive", "Time between outputs.", "s")
    output_times: Sequence[float] | None = _choice(
        "times", "Output times, rising; instead of the interval.", "s"
    )
    channels: Sequence[str] | None = _choice(
        "names", "Channels to store, such as chassis.position, or patterns such as rack_slide.*."
    )
    fixed_step: float | None = _choice(
        "positive", "Steps of this size, without control of the error.", "s"
    )
    max_step: float | None = _choice("positive", "Largest step size.", "s")
    initial_step: float | None = _choice("positive", "First step size.", "s")
    max_steps: int | None = _choice("count", "Largest number of attempted steps.")
    max_seconds: float | None = _choice(
        "positive",
        "Largest wall time from the call on: assembly and every part of a step count, reading the "
        "model does not.",
        "s",
    )
    parametrization: str | None = _choice(
        "word",
        "What the independent variables are: relative coordinates of a spanning forest of the "
        "bodies (tree, the default), some of the bodies' coordinates (partitioning), or a basis of "
        "the constraints' tangent plane by QR or SVD.",
        words=("tree", "partitioning", "tangent_plane", "tangent_plane_svd"),
    )
    jacobian: str | None = _choice(
        "word",
        "Where the integration Jacobian comes from; analytic by default, which ForRosen needs.",
        words=("analytic", "differences"),
    )
    newton: str | None = _choice(
        "word",
        "How the integration Jacobian is represented: dense, of the independent variables alone; "
        "sparse, with the graph of the mechanism, so that its cost grows like the number of "
        "bodies; or simplified, the sparse one of closed loops without how joints turn, until "
        "iterations are slow. Dense and sparse take the same steps but for round-off. auto "
        "(default) takes what is predicted to cost least; ForRosen and the descriptor forms do "
        "not go with simplified.",
        words=("auto", "dense", "sparse", "simplified"),
    )
    accelerations: str | None = _choice(
        "word",
        "Where accelerations and multipliers come from: from body to body along a tree "
        "(recursive), a dense matrix of the independent variables (null_space), one of the "
        "multipliers, for which every body needs mass and inertia (reduced), a sparse matrix of "
        "both (augmented), or auto (default), whichever is predicted to cost least. States that "
        "the others cannot solve accurately are left to the augmented one.",
        words=("auto", "recursive", "null_space", "reduced", "augmented"),
    )
    coordinates: str | None = _choice(
        "word",
        "Which coordinates recoveries go through: poses of bodies with equations for every joint "
        "(cartesian), relative coordinates along the spanning tree with equations for what closes "
        "loops only (joint), or auto (default): joint for trees, and for models with loops of up "
        "to 200 degrees of freedom where few loops hang together, as measured to cost less. "
        "The motion is the same, and so are states, channels and reactions.",
        words=("auto", "cartesian", "joint"),
    )
    threads: int | None = _choice(
        "count",
        "Threads that share the work on the integration Jacobian of models with more than some "
        "1,000 bodies in a plane or 200 in space; 1 by default. Results are the same for any "
        "number, to the last bit.",
    )
    repartition_factor: float | None = _choice(
        "factor",
        "Growth of the condition at which independent variables are chosen anew; more than 1. By "
        "default 2.5 on the tree, 1.25 for a partition, 2 for a tangent plane.",
    )
    dense_output: bool | None = _choice(
        "flag",
        "Whether all that states between output times are made of is stored, so that any time can "
        "be asked for; by default where the code is implicit: explicit ones may take millions of "
        "steps.",
    )
    profile: str | None = _choice(
        "word",
        "Choices that go together; thesis partitions coordinates unless told otherwise.",
        words=("improved", "thesis"),
    )
    newmark_gamma: float | None = _choice(
        "positive",
        "γ of Newmark's formula, another than the trapezoidal rule of SspTrap and InflTrap: from "
        "0.5 (order 2) to 1; more damps high frequencies, at order 1 and with a fixed step only.",
    )
    newmark_beta: float | None = _choice("positive", "β of the same; (γ + ½)²/4 by default.")

    def __post_init__(self) -> None:
        # Each by itself was checked before: see `_checked`.
        if self.method is not None:
            require_method(self.method, self.formula)
        for one, other in _EITHER:
            if getattr(self, one) is not None and getattr(self, other) is not None:
                raise UsageError(
                    f"both `{one}` and `{other}` are given", help="leave one of them out"
                )
        if (
            self.start_time is not None
            and self.end_time is not None
            and self.end_time < self.start_time
        ):
            raise UsageError(
                f"`end_time` {self.end_time} s lies before `start_time` {self.start_time} s",
                help="exchange them, or leave `start_time` out",
            )

    @classmethod
    def of(cls, choices: Mapping[str, Any], beside: Iterable[str] = ()) -> Options:
        """Return options by name; a name that is none is refused with the nearest.

        Parameters
        ----------
        choices : mapping
        beside : iterable of str
            What the caller takes beside options, which may have been meant, too.

        Raises
        ------
        UsageError
            If there is no such option, or its value cannot be used.
        """
        for name in choices:
            if name not in _KINDS:
                raise _unknown_option(name, beside)
        return cls(**choices)

    def stated(self) -> dict[str, Any]:
        """Return the choices that are not None, by name."""
        return {name: value for name in _KINDS if (value := getattr(self, name)) is not None}

    def to_dict(self) -> dict[str, Any]:
        """Return the stated choices as plain data."""
        data: dict[str, Any] = {}
        for name, value in self.stated().items():
            if isinstance(value, Tolerance):
                value = {part: getattr(value, part) for part in PARTS}
            data[name] = list(value) if isinstance(value, tuple) else value
        return data


class Further(TypedDict, total=False):
    """Choices of a run but for its code, tolerance, end and outputs; see `Options`."""

    start_time: float | None
    fixed_step: float | None
    max_step: float | None
    initial_step: float | None
    max_steps: int | None
    max_seconds: float | None
    parametrization: str | None
    jacobian: str | None
    newton: str | None
    accelerations: str | None
    coordinates: str | None
    threads: int | None
    repartition_factor: float | None
    dense_output: bool | None
    profile: str | None
    newmark_gamma: float | None
    newmark_beta: float | None


class Choices(Further, total=False):
    """Choices of a run as keywords, for checkers and editors; see `Options`."""

    end_time: float | None
    tolerance: float | Mapping[str, float] | Tolerance | None
    method: str | None
    formula: str | None
    interval: float | None
    output_times: Sequence[float] | None
    channels: Sequence[str] | None


def _checked(made: Callable[..., None]) -> Callable[..., None]:
    """Check what is stated, and refuse a name that is none with the nearest."""

    @functools.wraps(made)
    def init(self: Options, **choices: Any) -> None:
        checked = {}
        for name, value in choices.items():
            if name not in _KINDS:
                raise _unknown_option(name)
            checked[name] = None if value is None else _CHECKS[_KINDS[name]](name, value)
        made(self, **checked)

    return init


Options.__init__ = _checked(Options.__init__)  # type: ignore[method-assign]


def _unknown_option(name: str, beside: Iterable[str] = ()) -> UsageError:
    known = [*_KINDS, *beside]
    near = did_you_mean(nearest(name, known, WORDS_OF_OTHERS), f"there are {listed(known)}")
    return UsageError(f"there is no option {quoted(name)}", help=near)


_FIELDS: dict[str, Field[Any]] = {about.name: about for about in fields(Options)}
#: Options with the kind of each: `fields` is slow, and every call of a run asks.
_KINDS: dict[str, str] = {name: about.metadata["kind"] for name, about in _FIELDS.items()}
#: Options that are one word out of few, with their words.
WORDS: dict[str, tuple[str, ...]] = {
    about.name: about.metadata["words"]
    for about in fields(Options)
    if about.metadata["kind"] == "word"
}


def _described() -> str:
    """Return the docstring of `Options`, with a paragraph for each of its fields."""
    lines = [str(Options.__doc__), "", "    Parameters", "    ----------"]
    lines += _paragraphs([about.name for about in fields(Options)], " " * 4)
    lines += ["", "    Raises", "    ------", "    UsageError"]
    return "\n".join([*lines, "        If a value is of the wrong kind, or out of range.", "    "])


def _paragraphs(names: Sequence[str], indent: str) -> list[str]:
    lines = []
    for about in (_FIELDS[name] for name in names):
        unit = f" In {about.metadata['unit']}." if about.metadata["unit"] else ""
        words = f" One of {', '.join(about.metadata['words'])}." if about.metadata["words"] else ""
        text = about.metadata["text"] + unit + words
        lines += [f"{indent}{about.name} : {str(about.type).removesuffix(' | None')}, optional"]
        deeper = indent + " " * 4
        lines += textwrap.wrap(text, 96, initial_indent=deeper, subsequent_indent=deeper)
    return lines


_Function = TypeVar("_Function", bound=Callable[..., Any])


def shows_choices(function: _Function) -> _Function:
    """List the choices that a function takes as keywords in its docstring and its signature.

    So `help` and completion at run time know them; checkers read the annotation of ``**choices``.
    """
    known = inspect.signature(function)
    *own, rest = known.parameters.values()
    kind = Further if "Further" in str(rest.annotation) else Choices
    names = [name for name in _FIELDS if name in kind.__annotations__]
    keyword = inspect.Parameter.KEYWORD_ONLY
    shown = [
        inspect.Parameter(name, keyword, default=None, annotation=str(_FIELDS[name].type))
        for name in names
    ]
    function.__signature__ = known.replace(parameters=[*own, *shown])  # type: ignore[attr-defined]
    before, mark, after = (function.__doc__ or "").partition(f"{_MARK}\n")
    if mark:  # no docstrings with `python -OO`
        indent = before.rpartition("\n")[2]
        told = "\n".join(_paragraphs(names, indent))
        function.__doc__ = before.removesuffix(indent) + told + "\n" + after
    return function


#: Stands in a docstring where the choices go.
_MARK = "CHOICES"


def methods() -> list[dict[str, str]]:
    """Return the integration codes: ``name``, ``title``, ``family`` and ``formula`` of each."""
    return [dict(code) for code in _methods()]


@functools.cache
def _methods() -> tuple[Mapping[str, str], ...]:
    return tuple(json.loads(_core.methods()))


def unknown_method(method: object, formula: object = None) -> UsageError:
    """Return the error for a code, or a pair of family and formula, that there is none of."""
    known = methods()
    asked = quoted(method) + ("" if formula is None else f" with the formula {quoted(formula)}")
    pairs = ", ".join(f"{code['name']} ({code['family']} with {code['formula']})" for code in known)
    names = [code["name"] for code in known]
    tip = f"known are {pairs}"
    if formula is None and (near := nearest(method, names, METHODS)):
        tip = f"{did_you_mean(near, '')} known are {', '.join(names)}"
    return UsageError(f"there is no method {asked}", "simulation/unknown-method", tip)


def require_method(method: str, formula: str | None) -> str:
    """Return the name of the code that a method and a formula mean.

    Raises
    ------
    UsageError
        There is none.
    """
    if (name := _core.find_method(method, formula)) is None:
        raise unknown_method(method, formula)
    return name


def require_known_code(defaults: Mapping[str, Any]) -> None:
    """Refuse the code that a model file asks for, if there is none of its name."""
    if method := defaults.get("method"):
        require_method(method, defaults.get("formula"))


def _parts(stated: Mapping[str, float]) -> dict[str, float]:
    """Check the parts of a tolerance that are stated."""
    known = PARTS
    for name in stated:
        if name not in known:
            near = did_you_mean(nearest(name, known, TOLERANCES), f"there are {listed(known)}")
            raise UsageError(f"`tolerance` has no part {quoted(name)}", help=near)
    if not stated:
        raise UsageError("`tolerance` is empty", help=f"give one of {listed(known)}")
    return {name: require_positive(f"tolerance.{name}", part) for name, part in stated.items()}


def _tolerance(_: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        return _parts(value)
    return value if isinstance(value, Tolerance) else Tolerance(value)


def require_finite(name: str, value: object) -> float:
    """Return a number that is finite."""
    is_complex = getattr(getattr(value, "dtype", None), "kind", "") == "c"  # NumPy drops a part
    if isinstance(value, bool) or is_complex or not hasattr(value, "__float__"):
        raise UsageError(f"`{name}` is {quoted(repr(value))}", help="it must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    except (TypeError, ValueError):
        text = f"`{name}` is {quoted(repr(value))}"
        raise UsageError(text, help="it must be a single number") from None
    if not math.isfinite(number):
        raise UsageError(f"`{name}` is {number}", help="it must be a finite number")
    return number


def require_positive(name: str, value: object) -> float:
    """Return a number above zero."""
    number = require_finite(name, value)
    if number <= 0.0:
        raise UsageError(f"`{name}` is {number}", help="it must be positive")
    return number


def times_at(
    interval: object, first: float, last: float, *, name: str = "interval", most: int = MOST_ROWS
) -> list[float]:
    """Return times at an interval, and the end: those at which a run has its rows.

    Parameters
    ----------
    interval : float
        s.
    first, last : float
        s; the last interval is shorter where the span is no multiple of it.
    name : str, optional
        What the interval is called where it was stated.
    most : int, optional
        How many there may be.

    Raises
    ------
    UsageError
        If the interval is not a positive finite number, or makes more times than that.
    """
    step = require_positive(name, interval)
    if (last - first) / step + 1.0 > most:
        raise UsageError(
            f"`{name}` is {step:g}, which makes more than {most:.0e} rows",
            help="take a longer interval",
        )
    # The last multiple may be beside the end by round-off.
    reached = last - _ROUND_OFF * (last - first)
    count = int((last - first) / step * (1.0 + _ROUND_OFF))
    times = [time for k in range(count + 1) if (time := first + k * step) < reached]
    return [*times, last]


#: Times of a run that differ by this part of it are the same.
_ROUND_OFF = 1e-12


def _require_factor(name: str, value: object) -> float:
    number = require_finite(name, value)
    if number <= 1.0:
        raise UsageError(f"`{name}` is {number}", help="it must be more than 1")
    return number


def _require_count(name: str, value: object) -> int:
    number = require_finite(name, value)
    if number != int(number) or not 1.0 <= number <= MOST:
        most = "1024" if name == "threads" else f"{MOST:.0e}"  # as the core refuses more threads
        rule = f"it must be a whole number from 1 to {most}"
        raise UsageError(f"`{name}` is {number:g}", help=rule)
    return int(number)


def _require_times(name: str, values: Any) -> tuple[float, ...]:
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise UsageError(
            f"`{name}` is {quoted(repr(values))}", help="pass a list of times, s, that rise"
        )
    times = tuple(require_finite(f"{name}[{i}]", value) for i, value in enumerate(values))
    if not times:
        raise UsageError(f"`{name}` is empty", help="it must hold at least one time, s")
    for i, (earlier, later) in enumerate(itertools.pairwise(times)):
        if later <= earlier:
            raise UsageError(
                f"`{name}[{i + 1}]` is {later} s after {earlier} s", help="times must rise"
            )
    return times


def _require_names(name: str, values: Any) -> tuple[str, ...]:
    if isinstance(values, str):
        raise UsageError(f"`{name}` is one text", help="pass a list of channel names")
    entries = tuple(values) if isinstance(values, Iterable) else None  # one that ends is read once
    if entries is None or not all(isinstance(entry, str) for entry in entries):
        raise UsageError(f"`{name}` is {quoted(repr(values))}", help="pass a list of channel names")
    names = tuple(map(str, entries))
    for i, entry in enumerate(names):
        if not is_unicode(entry):
            raise UsageError(
                f"`{name}[{i}]`, {quoted(entry)}, holds half a character", help="take valid text"
            )
    return names


def _require_text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise UsageError(f"`{name}` is {quoted(repr(value))}", help="it must be a text")
    return value


def _require_word(name: str, value: object) -> str:
    text, words = _require_text(name, value), WORDS[name]
    if text not in words:
        near = did_you_mean(nearest(text, words), f"it is one of {listed(words)}")
        raise UsageError(f"`{name}` is {quoted(text)}, which it does not know", help=near)
    return text


def _require_flag(name: str, value: object) -> bool:
    # NumPy has a type of its own, and need not be imported for it.
    if not (isinstance(value, bool) or type(value).__name__ in ("bool", "bool_")):
        raise UsageError(f"`{name}` is {quoted(repr(value))}", help="it must be True or False")
    return bool(value)


_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "number": require_finite,
    "positive": require_positive,
    "factor": _require_factor,
    "count": _require_count,
    "tolerance": _tolerance,
    "times": _require_times,
    "names": _require_names,
    "method": _require_text,
    "text": _require_text,
    "word": _require_word,
    "flag": _require_flag,
}

Options.__doc__ = _described()
