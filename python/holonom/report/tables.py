"""What a report says in numbers: extrema, parameters, measured errors, facts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from holonom.base.text import escape
from holonom.pictures.runs import unit_of, unit_text
from holonom.report.extrema import extrema as extrema_of
from holonom.summary import certified, with_unit

if TYPE_CHECKING:
    from holonom.result import Result

#: Below this part of a tolerance a value is round-off.
_ROUND_OFF = 1e-6


def extrema(result: Result, names: Sequence[str]) -> str:
    """Return the smallest and the largest value of every component with their times."""
    found, why = extrema_of(result, names)
    rows = []
    for one, smallest, largest in found:
        for i, label in enumerate(one.labels):
            (low, at), (high, then) = smallest[i], largest[i]
            if np.isnan(low):
                continue
            name = f"{one.title}, {label}" if label else one.title
            unit = unit_of(one, i).removesuffix("–")
            tolerance = one.tolerances[i]
            values = (_told(low, tolerance), number(at), _told(high, tolerance), number(then))
            rows.append((name, unit, *values))
    if not rows:
        return ""
    head = ("channel", "unit", "smallest", "at, s", "largest", "at, s")
    said = (
        f"Of the stored rows: {escape(why).removesuffix('.')}."
        if why
        else "Of the whole motion: between the stored rows states are computed from the steps, but "
        "for what moves less than its solver tells."
    )
    return card(grid(head, rows, numbers=(2, 3, 4, 5))) + f'<p class="note">{said}</p>'


def parameters(model: Mapping[str, Any]) -> str:
    """Return the parameters of a model with units and titles."""
    rows = []
    for name, stated in (model.get("parameters") or {}).items():
        about = stated if isinstance(stated, Mapping) else {"value": stated}
        value = about.get("value", "")
        shown = number(value) if isinstance(value, int | float) else str(value)
        unit, title = (str(about.get(key) or "") for key in ("unit", "title"))
        rows.append((str(name), shown, unit, title))
    head = ("parameter", "value", "unit", "")
    return grid(head, rows, numbers=(1,)) if rows else ""


def measured(result: Result) -> str:
    """Return the errors that a second run measured, or nothing where there was none."""
    found = result.certification
    if found is None:
        return ""
    said = f'<p class="note">Certified: {escape(certified(found))}.</p>'
    if not found.channels:
        return said
    rows = [
        (
            c.name,
            f"{c.tolerances:.3g}",
            with_unit(c.error, unit_text(c.unit)),
            with_unit(c.tolerance, unit_text(c.unit)),
            f"{c.time:.6g} s",
        )
        for c in found.ranked
    ]
    head = ("channel", "error in tolerances", "error", "tolerance there", "time")
    until = "" if found.until is None else f" up to {found.until:.6g} s"
    note = (
        f'<p class="note">The run was repeated at a tenth of its tolerance and compared{until}. '
        "Each line is where the channel is furthest off; 1 is on tolerance.</p>"
    )
    return said + card(grid(head, rows, numbers=(1,)) + note)


def _told(value: float, tolerance: float) -> str:
    """Return a value; what is far below the tolerance has no digits."""
    return "≈ 0" if 0.0 < abs(value) < _ROUND_OFF * tolerance else number(value)


def number(value: float) -> str:
    """Return a number to six digits, with a minus that is no hyphen."""
    return f"{value:.6g}".replace("-", "−")


def flat(data: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    """Yield the entries of nested tables with their names in one."""
    for key, value in data.items():
        label = f"{prefix}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            yield from flat(value, f"{label}, ")
        elif isinstance(value, list):
            yield label, ", ".join(map(str, value))
        else:
            yield label, f"{value:.6g}" if isinstance(value, float) else str(value)


def table(rows: Iterable[tuple[str, str]]) -> str:
    """Return names and values."""
    lines = (f"<tr><th>{escape(k)}</th><td><code>{escape(v)}</code></td></tr>" for k, v in rows)
    return f"<table>{''.join(lines)}</table>"


def grid(head: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: Sequence[int] = ()) -> str:
    """Return a table with a heading; columns of numbers stand at the right."""
    kinds = [' class="number"' if k in numbers else "" for k in range(len(head))]
    top = "".join(f"<th{k}>{escape(cell)}</th>" for k, cell in zip(kinds, head, strict=True))
    body = "".join(
        f"<tr>{''.join(f'<td{k}>{escape(c)}</td>' for k, c in zip(kinds, row, strict=True))}</tr>"
        for row in rows
    )
    return f'<table class="grid"><tr>{top}</tr>{body}</table>'


def card(body: str) -> str:
    """Return something in a frame, in which what is too wide is moved sideways."""
    return f'<div class="card">{body}</div>'
