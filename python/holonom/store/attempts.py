"""The log of attempted steps, summed by outcome."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Accepted or not, cause, count, and smallest, largest and mean size (s).
Total = tuple[bool, str, int, float, float, float]


def totals(log: Mapping[str, NDArray[Any]]) -> list[Total]:
    """Return the attempts of a step log by outcome: the accepted first, then the most frequent."""
    accepted, sizes = log["accepted"] > 0, log["h"]
    causes = log.get("cause", np.full(sizes.size, "", dtype=object))
    found: list[Total] = []
    for good, cause in set(zip(accepted.tolist(), causes.tolist(), strict=True)):
        h = sizes[(accepted == good) & (causes == cause)]
        found.append((good, str(cause), h.size, float(h.min()), float(h.max()), float(h.mean())))
    return sorted(found, key=lambda total: (not total[0], -total[2], total[1]))
