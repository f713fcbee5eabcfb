"""Results as tables and data sets for other programs."""

from __future__ import annotations

import csv
import importlib
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import NDArray

from holonom.base import files
from holonom.base.errors import UsageError
from holonom.base.names import did_you_mean, nearest
from holonom.base.text import quoted
from holonom.channels import component_units, components, split_component

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]
    import xarray

    from holonom.result import Result

#: Names of the dimensions of data sets along which components lie, other than of plain vectors.
_DIMENSIONS = {
    ("euler_parameters", 4): "euler_parameter",
    ("yaw_pitch_roll", 3): "turn",
    ("deformation", 6): "deformation",
}
_PLAIN = {2: "xy", 3: "xyz"}


#: Every row.
_ALL = slice(None)


def write_csv(
    result: Result, file: TextIO, channels: list[str] | None = None, *, rows: slice = _ALL
) -> list[str]:
    """Write channels as CSV, one row per output time, and return their names.

    The first column is the time; a vector takes one column per component. Headings hold name,
    index and unit, ``chassis.position[2] (m)``; numbers are the shortest that read back the same.
    A heading that a spreadsheet program would take for a formula begins with an apostrophe.

    Parameters
    ----------
    result : Result
    file : text file
        Opened with ``newline=""``.
    channels : list of str, optional
        Names or patterns; the stored channels when none are given.
    rows : slice, optional
        Which output times; all by default.

    Raises
    ------
    UsageError
        If a channel is unknown.
    """
    columns = list(_columns(result, channels, rows))
    heading = [name + (f" ({unit})" if unit else "") for name, unit, _, _ in columns]
    files.write_cells(file, [heading])
    csv.writer(file).writerows(np.column_stack([values for *_, values in columns]).tolist())
    return _names(result, channels)


def dataset(
    result: Result, channels: list[str] | None = None, *, rows: slice = _ALL
) -> xarray.Dataset:
    """Return channels as a dataset; see `Result.to_xarray`."""
    xr = _library("xarray", "data sets of xarray", "xarray")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"time": ("time", result.time[rows], {"units": "s"})}
    for name in _names(result, channels):
        values = result[name][rows]
        attributes = {"units": result.unit(name) or "1", "frame": result.frame(name)}
        dims = ["time"]
        if values.ndim > 1:
            size, ending = values.shape[1], name.rpartition(".")[2]
            plain = _PLAIN.get(size, f"component_{size}")
            dim = _DIMENSIONS.get((ending, size), plain)
            coordinates[dim] = (dim, components(name, size))
            dims.append(dim)
        variables[name] = (dims, values, {key: text for key, text in attributes.items() if text})
    facts = {key: text for key, text in _facts(result).items() if text}
    made: xarray.Dataset = xr.Dataset(variables, coordinates, facts)
    return made


def frame(result: Result, channels: list[str] | None = None) -> pd.DataFrame:
    """Return channels as a data frame; see `Result.to_pandas`."""
    made = _library("pandas", "data frames of pandas", "pandas")
    (_, *found) = _columns(result, channels)
    columns = {name: values for name, _, _, values in found}
    table: pd.DataFrame = made.DataFrame(columns, index=made.Index(result.time, name="time"))
    table.attrs["units"] = {name: unit for name, unit, _, _ in found}
    return table


def write_netcdf(
    result: Result,
    path: Path,
    channels: list[str] | None = None,
    *,
    rows: slice = _ALL,
    force: bool = False,
) -> Path:
    """Write channels as NetCDF 4; see `Result.to_netcdf`."""
    for name in ("h5netcdf", "h5py"):
        _library(name, "NetCDF files", "netcdf")
    data = dataset(result, channels, rows=rows)
    with files.replacing(path, "netcdf", inputs=[result.path], force=force) as fresh:
        # By way of memory: where a disk is full, the HDF5 library ends the process.
        fresh.write_bytes(data.to_netcdf(engine="h5netcdf"))
    return path


def write_parquet(
    result: Result,
    path: Path,
    channels: list[str] | None = None,
    *,
    rows: slice = _ALL,
    force: bool = False,
) -> Path:
    """Write channels as Parquet; see `Result.to_parquet`."""
    pa = _library("pyarrow", "Parquet files", "parquet")
    parquet = importlib.import_module("pyarrow.parquet")
    fields, arrays = [], []
    for name, unit, frame, values in _columns(result, channels, rows):
        metadata = {"unit": unit, "frame": frame}
        fields.append(pa.field(name, pa.float64(), nullable=False, metadata=metadata))
        arrays.append(pa.array(np.ascontiguousarray(values)))
    schema = pa.schema(fields, metadata={"holonom": json.dumps(_facts(result))})
    with files.replacing(path, "parquet", inputs=[result.path], force=force) as fresh:
        parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), fresh)
    return path


def write_matlab(
    result: Result,
    path: Path,
    channels: list[str] | None = None,
    *,
    rows: slice = _ALL,
    force: bool = False,
) -> Path:
    """Write channels as a MATLAB file; see `Result.to_matlab`."""
    io = _library("scipy.io", "MATLAB files", "matlab")
    names = _names(result, channels)
    variables = dict(zip(names, matlab_names(names), strict=True))
    arrays = {"time": result.time, **{variables[name]: result[name] for name in names}}
    arrays = {name: array[rows] for name, array in arrays.items()}
    for name, array in arrays.items():
        if array.nbytes >= _MATLAB_LIMIT:
            raise UsageError(
                f"`{name}` takes {array.nbytes / 1e9:.1f} GB, and a variable of a MATLAB 5 file at "
                "most 2 GB\n  help: export fewer rows (`--interval`, `--from`), or write NetCDF"
            )
    texts = {
        "channel": names,
        "variable": list(variables.values()),
        "unit": [result.unit(name) for name in names],
        "frame": [result.frame(name) for name in names],
    }
    facts = {key: np.array(values, dtype=object) for key, values in texts.items()}
    arrays["holonom"] = {**_facts(result), **facts}  # type: ignore[assignment]
    with files.replacing(path, "matlab", inputs=[result.path], force=force) as fresh:
        io.savemat(fresh, arrays, appendmat=False, long_field_names=True, oned_as="column")
    return path


#: A variable of MATLAB 5 files holds less, bytes.
_MATLAB_LIMIT = 2**31
#: The longest name of a variable in MATLAB.
_MATLAB_LENGTH = 63
_MATLAB_KEYWORDS = (
    *("break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for"),
    *("function", "global", "if", "otherwise", "parfor", "persistent", "return", "spmd"),
    *("switch", "try", "while", "time", "holonom"),
)


def matlab_names(names: Sequence[str]) -> list[str]:
    """Return names of channels as names of variables in MATLAB, all of them different.

    What is no letter, digit or underscore becomes an underscore, ``chassis_position_2_`` for
    ``chassis.position[2]``; a name that does not begin with a letter gets an ``x`` before it, a
    keyword an underscore behind it; it is cut at 63 characters, and the second of equal names ends
    in ``_2``.
    """
    taken: set[str] = set()
    found = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        plain = plain if re.match("[A-Za-z]", plain) else f"x{plain}"
        plain = f"{plain}_" if plain in _MATLAB_KEYWORDS else plain[:_MATLAB_LENGTH]
        unique, number = plain, 1
        while unique in taken:
            number += 1
            ending = f"_{number}"
            unique = plain[: _MATLAB_LENGTH - len(ending)] + ending
        taken.add(unique)
        found.append(unique)
    return found


def write_csv_file(
    result: Result,
    path: Path,
    channels: list[str] | None = None,
    *,
    rows: slice = _ALL,
    force: bool = False,
) -> Path:
    """Write channels as a CSV file; see `write_csv`."""
    with (
        files.replacing(path, "csv", inputs=[result.path], force=force) as fresh,
        fresh.open("w", encoding="utf-8", newline="") as file,
    ):
        write_csv(result, file, channels, rows=rows)
    return path


#: Formats of files: their ending and what writes them.
FORMATS = {
    "csv": (".csv", write_csv_file),
    "parquet": (".parquet", write_parquet),
    "netcdf": (".nc", write_netcdf),
    "matlab": (".mat", write_matlab),
}


def format_of(path: Path | None, stated: str | None) -> str:
    """Return the format that is stated, or that the ending of a file tells.

    Raises
    ------
    UsageError
        If there is no such format, or the ending is that of another one.
    """
    endings = {ending: kind for kind, (ending, _) in FORMATS.items()}
    known = ", ".join(f"{kind} ({ending})" for ending, kind in endings.items())
    if stated is not None and stated not in FORMATS:
        near = nearest(stated, FORMATS, {kind: ending[1:] for kind, (ending, _) in FORMATS.items()})
        raise UsageError(
            f"there is no format {quoted(stated)}",
            help=did_you_mean(near, f"known are {known}"),
        )
    ending = "" if path is None or str(path) == "-" else files.ending_of(path)
    told = endings.get(ending)
    if stated is None:
        if ending and told is None:
            raise UsageError(
                f"{path}: no format ends in `{ending}`\n  help: known are {known}; `--format` "
                "states one for any other ending"
            )
        return told or "csv"
    if told not in (None, stated):
        raise UsageError(
            f"{path} is to be {stated}, but `{ending}` is the ending of {told}\n  help: name it "
            f"`{path.with_suffix(FORMATS[stated][0]) if path else ''}`"
        )
    return stated


def _names(result: Result, channels: list[str] | None) -> list[str]:
    return (result.expand(channels) if channels else []) or result.channels


def _columns(
    result: Result, channels: list[str] | None, rows: slice = _ALL
) -> Iterator[tuple[str, str, str, NDArray[np.float64]]]:
    """Yield name, unit, frame and values of every scalar, each once, the time first."""
    yield "time", "s", "", result.time[rows]
    seen: set[str] = set()
    for name in _names(result, channels):
        whole, index = split_component(name)
        columns = result.matrix(whole)[rows].T
        units, frame = component_units(result.unit(whole), len(columns)), result.frame(whole)
        for i in range(len(columns)) if index is None else [index]:
            column = whole if len(columns) == 1 else f"{whole}[{i}]"
            if column not in seen:
                seen.add(column)
                yield column, units[i], frame, columns[i]


def _facts(result: Result) -> dict[str, str]:
    """Return what tells the run, as texts."""
    meta = result.meta
    tolerance = result.options.get("tolerance")
    return {
        "title": str(meta.get("title") or meta.get("name") or ""),
        "source": f"Holonom {meta.get('holonom', '')}".rstrip(),
        "model": str(meta.get("name") or ""),
        "model_hash": str(meta.get("model_hash") or ""),
        "method": str(meta.get("method") or result.options.get("method") or ""),
        "tolerance": "" if tolerance is None else json.dumps(tolerance),
        "status": result.status,
    }


def _library(name: str, what: str, extra: str) -> Any:
    """Import a library that comes with an extra, or say how to get it."""
    package = name.partition(".")[0]
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise UsageError(
            f"{what} need {package}, which is not installed",
            help=f"it comes with the extra `{extra}`, or by `pip install {package}`",
        ) from None
