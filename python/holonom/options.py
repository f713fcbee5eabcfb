"""Choices for one run."""

from __future__ import annotations

import difflib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from holonom import _core
from holonom.errors import UsageError


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

    relative: float
    translation: float | None = None
    rotation: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            value = self.relative if value is None else value
            _require_positive(f"tolerance.{field.name}", value)
            object.__setattr__(self, field.name, float(value))

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


# Options that are one word out of few.
_WORDS = {
    "parametrization": ("tree", "partitioning", "tangent_plane", "tangent_plane_svd"),
    "jacobian": ("analytic", "differences"),
    "newton": ("auto", "dense", "sparse"),
    "accelerations": ("auto", "recursive", "null_space", "reduced", "augmented"),
    "profile": ("improved", "thesis"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Choices for one run; what is None is taken from the model, or is the default of the core.

    Parameters
    ----------
    end_time, start_time : float, optional
        s. The start time is that of `start` when a run continues from a state.
    tolerance : float, mapping or Tolerance, optional
        One number for all parts, or some of ``relative``, ``translation`` (m; m/s), ``rotation``
        (rad; rad/s); the others are then the model's.
    method, formula : str, optional
        A code such as ``ForSDIRK``, or a family with a formula; `holonom.methods` lists them.
    interval : float, optional
        Time between outputs, s.
    output_times : sequence of float, optional
        Output times, s, rising; instead of `interval`.
    channels : sequence of str, optional
        Channels to store, such as ``chassis.position`` or ``rack_slide.*``.
    fixed_step, max_step, initial_step : float, optional
        s.
    max_steps : int, optional
        Largest number of steps.
    max_seconds : float, optional
        Largest wall time from the call on, s: assembly and every part of a step count. Reading the
        model does not.
    parametrization : str, optional
        What the independent variables are: ``tree`` (default) takes relative coordinates of a
        spanning forest of the bodies, ``partitioning`` some of the bodies' coordinates,
        ``tangent_plane`` a basis of the constraints' tangent plane by QR, ``tangent_plane_svd``
        the same by SVD.
    jacobian : str, optional
        Where the integration Jacobian comes from: ``analytic`` (default) or ``differences`` of
        accelerations; ForRosen needs the analytic one.
    newton : str, optional
        How the integration Jacobian is represented: ``dense`` of the independent variables alone,
        ``sparse`` with the graph of the mechanism, so that its cost grows like the number of
        bodies, or ``auto`` (default), whichever is predicted to cost less.
    accelerations : str, optional
        Where accelerations and multipliers come from: ``recursive``, from body to body along a
        tree, ``null_space``, a dense matrix of the independent variables, ``reduced``, a matrix of
        the multipliers by blocks of joints, for which every body needs mass and inertia,
        ``augmented``, a sparse matrix of both, or ``auto`` (default), whichever is predicted to
        cost least. States that the others cannot solve accurately are left to the augmented one.
    threads : int, optional
        Threads that share the work on the integration Jacobian of models with more than some 1,000
        bodies in a plane or 200 in space; 1 by default. Results are the same for any number, to the
        last bit.
    repartition_factor : float, optional
        Growth of the condition at which a partition or a tangent plane is chosen anew; more
        than 1. The tree has a factor of its own, 2.5.
    dense_output : bool, optional
        Whether all that states between output times are made of is stored, so that `Result.state`
        and `Result.sample` know any time. By default where the code is implicit: explicit ones may
        take millions of steps.
    profile : str, optional
        ``improved`` or ``thesis``, which partitions coordinates unless `parametrization` is stated.
    newmark_gamma, newmark_beta : float, optional
        Another member of Newmark's family in place of the trapezoidal rule of ``SspTrap`` and
        ``InflTrap``: γ from 0.5 (order 2) to 1, more damps high frequencies, at order 1 and with
        a `fixed_step` only; β is (γ + ½)²/4 by default.

    Raises
    ------
    UsageError
        If a value is of the wrong kind or out of range.
    """

    end_time: float | None = None
    start_time: float | None = None
    tolerance: float | Mapping[str, float] | Tolerance | None = None
    method: str | None = None
    formula: str | None = None
    interval: float | None = None
    output_times: Sequence[float] | None = None
    channels: Sequence[str] | None = None
    fixed_step: float | None = None
    max_step: float | None = None
    initial_step: float | None = None
    max_steps: int | None = None
    max_seconds: float | None = None
    parametrization: str | None = None
    jacobian: str | None = None
    newton: str | None = None
    accelerations: str | None = None
    threads: int | None = None
    repartition_factor: float | None = None
    dense_output: bool | None = None
    profile: str | None = None
    newmark_gamma: float | None = None
    newmark_beta: float | None = None

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        for name in ("end_time", "start_time"):
            if (value := getattr(self, name)) is not None:
                put(name, _require_finite(name, value))
        for name in ("interval", "fixed_step", "max_step", "initial_step", "max_seconds"):
            if (value := getattr(self, name)) is not None:
                put(name, _require_positive(name, value))
        if self.tolerance is not None:
            stated = self.tolerance
            if isinstance(stated, Mapping):
                put("tolerance", _parts(stated))
            elif not isinstance(stated, Tolerance):
                put("tolerance", Tolerance(stated))
        for name in ("newmark_gamma", "newmark_beta"):
            if (value := getattr(self, name)) is not None:
                put(name, _require_positive(name, value))
        for name in ("max_steps", "threads"):
            if (value := getattr(self, name)) is not None:
                put(name, _require_count(name, value))
        for name, known in _WORDS.items():
            if (value := getattr(self, name)) is not None and value not in known:
                raise UsageError(f"`{name}` is {value!r}; it must be one of {_listed(known)}")
        if self.dense_output is not None and not isinstance(self.dense_output, bool):
            raise UsageError(f"`dense_output` is {self.dense_output!r}; it must be True or False")
        if self.repartition_factor is not None:
            factor = _require_finite("repartition_factor", self.repartition_factor)
            if factor <= 1.0:
                raise UsageError(f"`repartition_factor` is {factor}; it must be more than 1")
            put("repartition_factor", factor)
        if self.channels is not None:
            if isinstance(self.channels, str):
                raise UsageError("`channels` is one text; it must be a list of channel names")
            put("channels", tuple(map(str, self.channels)))
        if self.output_times is not None:
            put("output_times", _require_rising("output_times", self.output_times))
            if self.interval is not None:
                raise UsageError("give either `interval` or `output_times`, not both")
        if (
            self.start_time is not None
            and self.end_time is not None
            and self.end_time < self.start_time
        ):
            raise UsageError(
                f"`end_time` {self.end_time} s lies before `start_time` {self.start_time} s"
            )

    @classmethod
    def of(cls, choices: Mapping[str, Any]) -> Options:
        """Return options by name; a name that is none is refused with the nearest.

        Raises
        ------
        UsageError
            If there is no such option, or its value cannot be used.
        """
        known = list(cls.__dataclass_fields__)
        for name in choices:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1)
                hint = f"; did you mean `{near[0]}`?" if near else f"; known are {', '.join(known)}"
                raise UsageError(f"there is no option `{name}`{hint}")
        return cls(**choices)

    def to_dict(self) -> dict[str, Any]:
        """Return the stated choices as plain data."""
        data: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Tolerance):
                value = {part.name: getattr(value, part.name) for part in fields(value)}
            if value is not None:
                data[field.name] = list(value) if isinstance(value, tuple) else value
        return data


def _parts(stated: Mapping[str, float]) -> dict[str, float]:
    """Check the parts of a tolerance that are stated."""
    known = Tolerance.__dataclass_fields__
    for name in stated:
        if name not in known:
            raise UsageError(f"`tolerance` has no part `{name}`; known are {_listed(list(known))}")
    if not stated:
        raise UsageError(f"`tolerance` is empty; it needs one of {_listed(list(known))}")
    return {name: _require_positive(f"tolerance.{name}", part) for name, part in stated.items()}


def methods() -> list[dict[str, str]]:
    """Return the integration codes: ``name``, ``title``, ``family`` and ``formula`` of each."""
    known: list[dict[str, str]] = json.loads(_core.methods())
    return known


def _require_finite(name: str, value: object) -> float:
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        raise UsageError(f"`{name}` is {value!r}; it must be a number")
    number = float(value)
    if not math.isfinite(number):
        raise UsageError(f"`{name}` is {number}; it must be a finite number")
    return number


def _require_positive(name: str, value: object) -> float:
    number = _require_finite(name, value)
    if number <= 0.0:
        raise UsageError(f"`{name}` is {number}; it must be positive")
    return number


def _require_count(name: str, value: object) -> int:
    number = _require_finite(name, value)
    if number != int(number) or number < 1.0:
        raise UsageError(f"`{name}` is {number:g}; it must be a whole number, 1 or more")
    return int(number)


def _require_rising(name: str, values: Sequence[float]) -> tuple[float, ...]:
    times = tuple(_require_finite(f"{name}[{i}]", value) for i, value in enumerate(values))
    if not times:
        raise UsageError(f"`{name}` is empty; it must hold at least one time")
    for i, (earlier, later) in enumerate(itertools.pairwise(times)):
        if later <= earlier:
            raise UsageError(f"`{name}[{i + 1}]` is {later} s after {earlier} s; times must rise")
    return times


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
