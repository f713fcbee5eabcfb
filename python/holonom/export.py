"""Results as tables and data sets for other programs."""

from __future__ import annotations

import csv
import importlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import NDArray

from holonom.errors import FileError, UsageError

if TYPE_CHECKING:
    import xarray

    from holonom.result import Result

#: Names of the components of vectors by the ending of the channel, or by their number.
_COMPONENTS = {
    "euler_parameters": ("euler_parameter", ["e0", "e1", "e2", "e3"]),
    "yaw_pitch_roll": ("turn", ["yaw", "pitch", "roll"]),
    2: ("xy", ["x", "y"]),
    3: ("xyz", ["x", "y", "z"]),
}


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
    columns = list(_columns(result, channels))
    writer = csv.writer(file)
    writer.writerow([name + (f" ({unit})" if unit else "") for name, unit, _, _ in columns])
    writer.writerows(np.column_stack([values for *_, values in columns]).tolist())
    return _names(result, channels)


def dataset(result: Result, channels: list[str] | None = None) -> xarray.Dataset:
    """Return channels as a dataset; see `Result.to_xarray`."""
    xr = _library("xarray", "data sets of xarray", "xarray")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"time": ("time", result.time, {"units": "s"})}
    for name in _names(result, channels):
        values = result[name]
        attributes = {"units": result.unit(name) or "1", "frame": result.frame(name)}
        dims = ["time"]
        if values.ndim > 1:
            size = values.shape[1]
            default = (f"component_{size}", list(range(size)))
            ending = name.rpartition(".")[2]
            dim, labels = _COMPONENTS.get(ending) or _COMPONENTS.get(size) or default
            coordinates[dim] = (dim, labels)
            dims.append(dim)
        variables[name] = (dims, values, {key: text for key, text in attributes.items() if text})
    facts = {key: text for key, text in _facts(result).items() if text}
    made: xarray.Dataset = xr.Dataset(variables, coordinates, facts)
    return made


def write_netcdf(result: Result, path: Path, channels: list[str] | None = None) -> Path:
    """Write channels as NetCDF 4; see `Result.to_netcdf`."""
    for name in ("h5netcdf", "h5py"):
        _library(name, "NetCDF files", "netcdf")
    data = dataset(result, channels)
    with _writing(path):
        data.to_netcdf(path, engine="h5netcdf")
    return path


def write_parquet(result: Result, path: Path, channels: list[str] | None = None) -> Path:
    """Write channels as Parquet; see `Result.to_parquet`."""
    pa = _library("pyarrow", "Parquet files", "parquet")
    parquet = importlib.import_module("pyarrow.parquet")
    fields, arrays = [], []
    for name, unit, frame, values in _columns(result, channels):
        metadata = {"unit": unit, "frame": frame}
        fields.append(pa.field(name, pa.float64(), nullable=False, metadata=metadata))
        arrays.append(pa.array(np.ascontiguousarray(values)))
    schema = pa.schema(fields, metadata={"holonom": json.dumps(_facts(result))})
    with _writing(path):
        parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), path)
    return path


def write_csv_file(result: Result, path: Path, channels: list[str] | None = None) -> Path:
    """Write channels as a CSV file; see `write_csv`."""
    with _writing(path), path.open("w", encoding="utf-8", newline="") as file:
        write_csv(result, file, channels)
    return path


#: Formats of files: their ending and what writes them.
FORMATS = {
    "csv": (".csv", write_csv_file),
    "parquet": (".parquet", write_parquet),
    "netcdf": (".nc", write_netcdf),
}


def _names(result: Result, channels: list[str] | None) -> list[str]:
    return result.expand(channels) if channels else result.channels


def _columns(
    result: Result, channels: list[str] | None
) -> Iterator[tuple[str, str, str, NDArray[np.float64]]]:
    """Yield name, unit, frame and values of every scalar, the time first."""
    yield "time", "s", "", result.time
    for name in _names(result, channels):
        values = result.matrix(name)
        unit, frame = result.unit(name), result.frame(name)
        for i, column in enumerate(values.T):
            yield name if values.shape[1] == 1 else f"{name}[{i}]", unit, frame, column


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
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != name:
            raise
        raise UsageError(
            f"{what} need {name}, which is not installed; it comes with the extra `{extra}`, as in "
            f"`pip install '.[{extra}]'`"
        ) from None


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Make the folder and name the file in what the system says."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from None
