"""Plain data with attributes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from holonom.base.names import did_you_mean, nearest
from holonom.base.text import quoted


class Record(Mapping[str, Any]):
    """Plain data with its entries as attributes: ``statistics.steps``."""

    __slots__ = ("_data",)

    def __init__(self, data: Mapping[str, Any]) -> None:
        self._data = dict(data)

    def __getitem__(self, key: str) -> Any:
        if key not in self._data:
            raise KeyError(self._absent(key))
        value = self._data[key]
        return Record(value) if isinstance(value, dict) else value

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._data:
            raise AttributeError(self._absent(name), name=name, obj=self)
        return self[name]

    def _absent(self, name: object) -> str:
        there = f"there are {', '.join(self._data)}" if self._data else "there are none"
        near = did_you_mean(nearest(name, self._data), there)
        return f"there is no entry {quoted(name)}; {near}"

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def __len__(self) -> int:
        return len(self._data)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._data]

    def __repr__(self) -> str:
        return repr(self._data)
