"""Plain data as TOML text: what `tomllib` reads, written."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any


def written(data: Mapping[str, Any]) -> str:
    """Return a table as TOML: two levels as headings, what lies deeper within a line.

    Parameters
    ----------
    data : mapping of str
        Numbers, texts, truth values, lists and tables; no nulls, which TOML does not have.
    """
    return "\n".join(_lines(data, (), 2)).strip("\n") + "\n"


def _lines(table: Mapping[str, Any], path: tuple[str, ...], levels: int) -> Iterator[str]:
    deeper = {
        key: value
        for key, value in table.items()
        if levels and isinstance(value, Mapping) and value
    }
    plain = {key: value for key, value in table.items() if key not in deeper}
    if path and (plain or not deeper):
        yield f"\n[{'.'.join(map(_key, path))}]"
    for key, value in plain.items():
        yield f"{_key(key)} = {_value(value)}"
    for key, value in deeper.items():
        yield from _lines(value, (*path, key), levels - 1)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _value(name)


def _value(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(key)} = {_value(entry)}" for key, entry in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value)  # numbers and truth values
