"""Names of channels: components of vectors, patterns, and names that no channel has."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from holonom.base.errors import UsageError
from holonom.base.names import did_you_mean, nearest_channels
from holonom.base.text import quoted

if TYPE_CHECKING:
    from holonom.store.layout import Quantity

#: What to try where a component is counted from the end.
FROM_ZERO = "components count from 0: `chassis.position[2]` is the last of three"
_NEGATIVE = re.compile(r"\[-\d+\]$")


def split_component(name: str) -> tuple[str, int | None]:
    """Return a channel's name and, of ``chassis.position[2]``, the index 2."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", name)
    return (match[1], int(match[2])) if match else (name, None)


def require_name(name: object) -> str:
    """Refuse what is no text where a channel is named.

    Raises
    ------
    UsageError
        ``simulation/unknown-channel``.
    """
    if not isinstance(name, str):
        raise UsageError(
            f"{quoted(repr(name))} is no channel",
            "simulation/unknown-channel",
            "pass names as texts, such as 'chassis.position'",
        )
    return name


def expand(patterns: Iterable[str], known: Mapping[str, Quantity]) -> list[str]:
    """Return the names that names and patterns mean, each once, in their order.

    A name may end in the index of a component, ``chassis.position[2]``.
    """
    found: dict[str, None] = {}
    if isinstance(patterns, str):
        raise UsageError(
            f"the channels are one text, {quoted(patterns)}", help="pass a list of names"
        )
    if not isinstance(patterns, Iterable):
        raise UsageError(
            f"the channels are {quoted(repr(patterns))}", help="pass a list of names or patterns"
        )
    for pattern in patterns:
        require_name(pattern)
        name, index = split_component(pattern)
        if pattern in known:  # thousands of names are looked up, not compared
            hits = [pattern]
        elif index is None:
            fits = re.compile(fnmatch.translate(name)).match
            hits = [n for n in known if fits(n)]
        else:
            hits = [pattern] if name in known else []
            if hits and not (len(known[name].shape) == 1 and index < known[name].size):
                shape = known[name].shape
                raise UsageError(
                    f"{quoted(name)} has no component {index}; its shape is {list(shape)}",
                    "simulation/unknown-channel",
                    f"take one from 0 to {shape[0] - 1}" if shape else "leave the index out",
                )
        if not hits:
            tip = did_you_mean(
                nearest_channels(pattern, known), "`Model.channels` and `holonom info` list them"
            )
            tip = FROM_ZERO if _NEGATIVE.search(pattern) else tip
            raise UsageError(
                f"there is no channel {quoted(pattern)}", "simulation/unknown-channel", tip
            )
        found |= dict.fromkeys(hits)
    return list(found)
