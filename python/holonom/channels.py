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

#: Where the channels that there are can be looked up.
LISTED = (
    "`holonom check MODEL --channels`, `holonom info RESULT --channels` and `Model.channels` list "
    "them"
)
#: What to try where a component is counted from the end.
FROM_ZERO = "components count from 0: `chassis.position[2]` is the last of three"


def split_component(name: str) -> tuple[str, int | None]:
    """Return a channel's name and, of ``chassis.position[2]``, the index 2."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", name)
    return (match[1], int(match[2])) if match else (name, None)


#: Names of components by the ending of the channel.
_COMPONENTS = {
    "yaw_pitch_roll": ["yaw", "pitch", "roll"],
    "euler_parameters": ["e0", "e1", "e2", "e3"],
    "deformation": ["x", "y", "z", "rx", "ry", "rz"],
}


def components(name: str, size: int) -> list[str]:
    """Return what the components of a channel are called; one empty name for scalars."""
    if size == 1:
        return [""]
    named = _COMPONENTS.get(name.rpartition(".")[2], [])
    if len(named) == size:
        return list(named)
    return list("xyz"[:size]) if size <= 3 else [f"[{i}]" for i in range(size)]


def component_units(unit: str, size: int) -> list[str]:
    """Return the unit of each component of a channel; ``m, rad`` is that of either half."""
    parts = unit.split(", ")
    return [parts[i * len(parts) // size] for i in range(size)]


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


def require_names(names: Iterable[str]) -> list[str]:
    """Return a list of names or patterns; refuse what is none.

    Raises
    ------
    UsageError
    """
    if isinstance(names, str):
        raise UsageError(f"the channels are one text, {quoted(names)}", help="pass a list of names")
    if not isinstance(names, Iterable):
        raise UsageError(
            f"the channels are {quoted(repr(names))}", help="pass a list of names or patterns"
        )
    return [require_name(name) for name in names]


def unknown(name: str, tip: str) -> UsageError:
    """Return the error of a name that no channel has."""
    return UsageError(f"there is no channel {quoted(name)}", "simulation/unknown-channel", tip)


def is_pattern(name: str) -> bool:
    """Whether a name that no channel has was meant for several."""
    return any(sign in name for sign in "*?[")


def is_from_end(name: str) -> bool:
    """Whether a component is counted from the end, as in ``chassis.position[-1]``."""
    return re.search(r"\[-\d+\]$", name) is not None


def _has(quantity: Quantity, index: int) -> bool:
    return len(quantity.shape) == 1 and index < quantity.size


def expand(patterns: Iterable[str], known: Mapping[str, Quantity]) -> list[str]:
    """Return the names that names and patterns mean, each once, in their order.

    A name may end in the index of a component, ``chassis.position[2]``, and a pattern, too:
    ``*.force[2]`` means that component of all vectors that fit and have it.

    Raises
    ------
    UsageError
        ``simulation/unknown-channel``, if one of them fits nothing.
    """
    found: dict[str, None] = {}
    for pattern in require_names(patterns):
        name, index = split_component(pattern)
        if pattern in known:  # thousands of names are looked up, not compared
            hits = [pattern]
        elif index is None:
            fits = re.compile(fnmatch.translate(name)).match
            hits = [n for n in known if fits(n)]
        elif name not in known:
            fits = re.compile(fnmatch.translate(name)).match
            hits = [f"{n}[{index}]" for n in known if fits(n) and _has(known[n], index)]
        else:
            hits = [pattern]
            if not _has(known[name], index):
                shape = known[name].shape
                raise UsageError(
                    f"{quoted(name)} has no component {index}; its shape is {list(shape)}",
                    "simulation/unknown-channel",
                    f"take one from 0 to {shape[0] - 1}" if shape else "leave the index out",
                )
        if not hits:
            tip = did_you_mean(nearest_channels(pattern, known), LISTED)
            raise unknown(pattern, FROM_ZERO if is_from_end(pattern) else tip)
        found |= dict.fromkeys(hits)
    return list(found)
