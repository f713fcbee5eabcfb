"""Results as tables of numbers for other programs."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING, TextIO

import numpy as np

if TYPE_CHECKING:
    from holonom.result import Result


def write_csv(result: Result, file: TextIO, channels: list[str] | None = None) -> list[str]:
    """Write channels as CSV, one row per output time, and return their names.

    The first column is the time; a vector takes one column per component. Headings hold name,
    index and unit, ``chassis.position[2] (m)``; numbers are the shortest that read back the same.

    Parameters
    ----------
    result : Result
    file : text file
        Opened with ``newline=""``.
    channels : list of str, optional
        Names or patterns; the stored channels when none are given.

    Raises
    ------
    UsageError
        If a channel is unknown.
    """
    names = result.expand(channels) if channels else result.channels
    header, columns = ["time (s)"], [result.time]
    for name in names:
        values = result.matrix(name)
        unit = f" ({unit})" if (unit := result.unit(name)) else ""
        scalar = values.shape[1] == 1
        header += [name + ("" if scalar else f"[{i}]") + unit for i in range(values.shape[1])]
        columns += list(values.T)
    writer = csv.writer(file)
    writer.writerow(header)
    writer.writerows(np.column_stack(columns).tolist())
    return names
