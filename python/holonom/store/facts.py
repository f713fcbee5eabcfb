"""What a result says about its run, checked before anything relies on it.

A file may say anything. What has a known name has a known kind, and nothing is nested so deeply
that whoever prints it runs out of stack.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from holonom.certificate import Certification

#: How a run can have ended, or not yet.
STATUSES = ("completed", "interrupted", "failed", "limit", "killed", "running")

#: Levels of lists and tables within an entry.
_DEEPEST = 100


def require_facts(meta: Mapping[str, Any]) -> list[str]:
    """Return the names of the entries that are not of their kind."""
    return [key for key, value in meta.items() if not _fits(key, value)]


def _fits(key: str, value: Any) -> bool:
    if not _is_shallow(value):
        return False
    check = _KINDS.get(key)
    return check is None or check(value)


def _is_shallow(value: Any) -> bool:
    level = [value]
    for _ in range(_DEEPEST):
        inner: list[Any] = []
        for entry in level:
            if isinstance(entry, dict):
                inner.extend(entry.values())
            elif isinstance(entry, list):
                inner.extend(entry)
        if not inner:
            return True
        level = inner
    return False


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return isinstance(value, float) or abs(value) < 2**63


def _is_number_or_none(value: Any) -> bool:
    return value is None or _is_number(value)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict)


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(entry, str) for entry in value)


def _is_numbers(value: Any) -> bool:
    """Return whether a table holds numbers, or tables of numbers, or nothing."""
    if value is None:
        return True
    return isinstance(value, dict) and all(
        _is_number_or_none(entry) or (isinstance(entry, dict) and _is_numbers(entry))
        for entry in value.values()
    )


def _is_reason(value: Any) -> bool:
    if value is None:
        return True
    plain = isinstance(value, dict) and all(
        _is_number_or_none(entry) or isinstance(entry, str | bool) for entry in value.values()
    )
    return plain and all(_is_text(value.get(key, "")) for key in ("code", "message", "help"))


def _is_warnings(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(entry, dict)
        and _is_text(entry.get("code"))
        and _is_text(entry.get("message"))
        and _is_text(entry.get("path") or "")
        for entry in value
    )


def _is_options(value: Any) -> bool:
    if not isinstance(value, dict):
        return False
    tolerance = value.get("tolerance", 1.0)
    numbers = ("start_time", "end_time", "interval", "fixed_step", "max_step")
    texts = ("method", "formula", "profile", "parametrization", "newton", "jacobian")
    limits = tolerance.values() if isinstance(tolerance, dict) else [tolerance]
    return (
        all(map(_is_number, limits))
        and all(_is_number_or_none(value.get(key)) for key in numbers)
        and all(_is_text(value.get(key) or "") for key in texts)
    )


def _is_certification(value: Any) -> bool:
    if value is None:
        return True
    try:
        certification = Certification.from_json(value)
        certification.warning()
    except (TypeError, ValueError, KeyError, IndexError, AttributeError):
        return False
    return (
        _is_numbers(certification.tolerance)
        and _is_number_or_none(certification.until)
        and _is_numbers(certification.statistics)
        and _is_reason(certification.reason)
        and all(
            _is_text(c.name)
            and _is_text(c.unit)
            and all(map(_is_number, (c.time, c.error, c.tolerance, c.tolerances)))
            for c in certification.channels
        )
    )


def _is_limited_by(value: Any) -> bool:
    if value is None:
        return True
    if not isinstance(value, dict):
        return False
    absent = None if value.get("coordinate") else 0  # whoever is named is counted
    return (
        all(_is_text(value.get(key) or "") for key in ("coordinate", "force"))
        and all(_is_number(value.get(key, absent)) for key in ("steps", "of"))
        and _is_limited_by(value.get("rejected"))
    )


def _is_parts(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(part, dict)
        and _is_number(part.get("until"))
        and not require_facts(part)  # a part says what a whole result says
        for part in value
    )


def _is_checkpoint(value: Any) -> bool:
    return isinstance(value, dict) and (
        type(value.get("chunk")) is int
        and 0 <= value["chunk"] < 2**53
        and (value.get("text") is None or _is_text(value["text"]))
    )


_KINDS: dict[str, Callable[[Any], bool]] = {
    **dict.fromkeys(("holonom", "name", "title", "model_hash", "started", "finished"), _is_text),
    **dict.fromkeys(("dof", "end_time", "cpu_seconds"), _is_number_or_none),
    **dict.fromkeys(("statistics", "residuals", "energy"), _is_numbers),
    "cpu_seconds_per_simulated_second": _is_number_or_none,
    "limited_by": _is_limited_by,
    "method": lambda value: value is None or _is_text(value),
    "model": _is_table,
    "options": _is_options,
    "requested": _is_texts,
    "warnings": _is_warnings,
    "status": lambda value: value in STATUSES,
    "stop_reason": _is_reason,
    "certification": _is_certification,
    "checkpoint": _is_checkpoint,
    "parts": _is_parts,
    "chunks": lambda value: type(value) is int and 0 <= value < 2**53,
}
