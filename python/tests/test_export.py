"""Results read back by the libraries that other programs use."""

from __future__ import annotations

import csv
import json
import re
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import scipy.io
import xarray as xr
from conftest import MODELS, PENDULUM
from hypothesis import example, given
from hypothesis import strategies as st

import holonom
from holonom.base import files
from holonom.cli.commands import invoke
from holonom.export import matlab_names
from holonom.result import Result


@pytest.fixture
def spatial() -> Result:
    """A short run of the vehicle: vectors of three and of four components, and scalars."""
    model = holonom.Model.load(MODELS / "hmmwv14" / "model.toml")
    names = ["chassis.position", "chassis.euler_parameters", "spring_front_right.force"]
    return model.simulate(end_time=0.05, channels=names)


NAMES = ["chassis.position", "chassis.euler_parameters", "spring_front_right.force"]


def test_a_dataset_holds_values_units_and_names_of_components(spatial: Result) -> None:
    data = spatial.to_xarray()
    assert set(data.data_vars) == set(spatial.channels)
    position = data["chassis.position"]
    assert position.dims == ("time", "xyz")
    assert position.attrs == {"units": "m", "frame": "ground"}
    # By label, against the column of the result.
    np.testing.assert_array_equal(position.sel(xyz="z"), spatial["chassis.position"][:, 2])
    parameters = data["chassis.euler_parameters"]
    assert parameters.dims == ("time", "euler_parameter")
    assert parameters.attrs["units"] == "1"
    np.testing.assert_allclose((parameters**2).sum("euler_parameter"), 1.0, atol=1e-12)
    assert data["spring_front_right.force"].dims == ("time",)
    assert data["energy.total"].attrs == {"units": "J"}
    assert data["time"].attrs["units"] == "s"
    np.testing.assert_array_equal(data["time"], spatial.time)
    assert data.attrs["method"] == "ForRadau"
    assert data.attrs["model_hash"] == spatial.model.hash
    assert set(data.attrs) >= {"source", "title", "tolerance", "status"}


def test_only_the_channels_named_are_exported(spatial: Result) -> None:
    data = spatial.to_xarray(["chassis.velocity", "chassis.position[1]"])
    assert list(data.data_vars) == ["chassis.velocity", "chassis.position[1]"]
    with pytest.raises(holonom.UsageError, match=r"chassis\.position"):
        spatial.to_xarray(["chassis.positon"])


def test_lengths_and_angles_of_a_deformation_have_units_of_their_own(tmp_path: Path) -> None:
    model = holonom.Model.load(MODELS / "hmmwv14_bushing" / "model.toml")
    name = "bushing_front_right.deformation"
    result = model.simulate(end_time=0.01, interval=0.01, channels=[name])
    units = {f"{name}[{i}]": "m" if i < 3 else "rad" for i in range(6)}
    assert {key: result.unit(key) for key in units} == units
    assert result.to_pandas([name]).attrs["units"] == units
    heading = result.to_csv(tmp_path / "d.csv", [name]).read_text().splitlines()[0]
    assert heading == ",".join(["time (s)", *(f"{key} ({unit})" for key, unit in units.items())])
    fields = list(pq.read_schema(result.to_parquet(tmp_path / "d.parquet", [name])))[1:]
    assert {field.name: field.metadata[b"unit"].decode() for field in fields} == units
    data = result.to_xarray([name, f"{name}[4]"])
    assert data[name].dims == ("time", "deformation")
    assert list(data[name]["deformation"].values) == ["x", "y", "z", "rx", "ry", "rz"]
    assert data[f"{name}[4]"].attrs["units"] == "rad"


def test_a_scalar_that_is_named_twice_is_one_column(spatial: Result, tmp_path: Path) -> None:
    names = ["chassis.position[1]", "chassis.position", "chassis.position[1]"]
    expected = [f"chassis.position[{i}]" for i in (1, 0, 2)]
    assert list(spatial.to_pandas(names)) == expected
    table = pd.read_parquet(spatial.to_parquet(tmp_path / "p.parquet", names))
    assert list(table) == ["time", *expected]
    heading = spatial.to_csv(tmp_path / "p.csv", names).read_text().splitlines()[0]
    assert heading == ",".join(["time (s)", *(f"{name} (m)" for name in expected)])


def test_without_names_every_table_holds_what_is_stored(spatial: Result, tmp_path: Path) -> None:
    scalars = list(spatial.to_pandas())
    assert len(scalars) > len(spatial.channels)
    assert list(spatial.to_pandas([])) == scalars
    assert len(pd.read_csv(spatial.to_csv(tmp_path / "a.csv", [])).columns) == 1 + len(scalars)
    assert set(spatial.to_xarray([])) == set(spatial.channels)


def test_netcdf_is_read_back_by_xarray_and_hdf5(spatial: Result, tmp_path: Path) -> None:
    path = spatial.to_netcdf(tmp_path / "new" / "run.nc", NAMES)
    with xr.open_dataset(path, engine="h5netcdf") as data:
        xr.testing.assert_identical(data.load(), spatial.to_xarray(NAMES))
    with h5py.File(path) as file:  # nothing but HDF5
        stored = file["chassis.position"]
        np.testing.assert_array_equal(stored[:], spatial["chassis.position"])
        assert stored.attrs["units"] == "m"


def test_parquet_is_read_back_by_pyarrow_and_pandas(spatial: Result, tmp_path: Path) -> None:
    path = spatial.to_parquet(tmp_path / "new" / "run.parquet", NAMES)
    columns = ["time", *(f"chassis.position[{i}]" for i in range(3))]
    columns += [*(f"chassis.euler_parameters[{i}]" for i in range(4)), "spring_front_right.force"]
    table = pq.read_table(path)
    assert table.column_names == columns
    field = table.schema.field("chassis.position[2]")
    assert field.metadata == {b"unit": b"m", b"frame": b"ground"}
    facts = json.loads(table.schema.metadata[b"holonom"])
    assert facts["model_hash"] == spatial.model.hash
    frame = pd.read_parquet(path)
    assert list(frame.columns) == columns
    np.testing.assert_array_equal(frame["time"], spatial.time)
    np.testing.assert_array_equal(frame[columns[1:4]].to_numpy(), spatial["chassis.position"])
    assert (frame.dtypes == np.float64).all()


@pytest.mark.parametrize(
    ("format_", "ending", "read"),
    [
        ("csv", ".csv", lambda path: pd.read_csv(path)["time (s)"]),
        ("parquet", ".parquet", lambda path: pd.read_parquet(path)["time"]),
        ("netcdf", ".nc", lambda path: xr.load_dataset(path, engine="h5netcdf")["time"]),
    ],
)
def test_the_command_writes_every_format_by_name_and_by_ending(
    stored: Path,
    capsys: pytest.CaptureFixture[str],
    format_: str,
    ending: str,
    read: Callable[[Path], Any],
) -> None:
    assert invoke(["export", str(stored), "rod.position", "--format", format_, "--json"]) == 0
    path = stored.with_suffix(ending)
    assert json.loads(capsys.readouterr().out) == {"table": str(path)}
    other = stored.with_name(f"other{ending}")
    assert invoke(["export", str(stored), "rod.position", "-o", str(other)]) == 0
    with Result.load(stored) as result:
        for written in (path, other):
            np.testing.assert_array_equal(read(written), result.time)


def test_rows_at_an_interval_end_with_the_run(pendulum: Path, tmp_path: Path) -> None:
    result, table = tmp_path / "rod.holonom", tmp_path / "rod.csv"
    assert invoke(["run", str(pendulum), "-q", "-o", str(result)]) == 0
    line = ["export", str(result), "rod.position", "--interval", "0.3", "-o", str(table)]
    assert invoke(line) == 0
    np.testing.assert_allclose(pd.read_csv(table)["time (s)"], [0.0, 0.3, 0.6, 0.9, 1.0])


@pytest.mark.parametrize(
    ("format_", "read"),
    [
        ("csv", lambda path: pd.read_csv(path).set_index("time (s)")["rod.position[0] (m)"]),
        ("parquet", lambda path: pd.read_parquet(path).set_index("time")["rod.position[0]"]),
        ("netcdf", lambda path: xr.load_dataset(path)["rod.position"][:, 0].to_series()),
        ("matlab", lambda path: _matlab_series(path)),
    ],
)
def test_the_command_writes_a_part_of_the_rows_as_they_are(
    stored: Path, tmp_path: Path, format_: str, read: Callable[[Path], Any]
) -> None:
    table = tmp_path / "part"
    line = ["export", str(stored), "rod.position", "--format", format_, "-o", str(table)]
    assert invoke([*line, "--from", "0.5", "--to", "0.75"]) == 0
    with Result.load(stored) as result:
        kept = (result.time >= 0.5) & (result.time <= 0.75)
        series = read(table)
        np.testing.assert_array_equal(series.index, result.time[kept])
        np.testing.assert_array_equal(series, result["rod.position"][kept, 0])


def _matlab_series(path: Path) -> pd.Series:
    content = scipy.io.loadmat(path)
    return pd.Series(content["rod_position"][:, 0], content["time"][:, 0])


def test_an_interval_has_a_part_of_its_rows(pendulum: Path, tmp_path: Path) -> None:
    result, table = tmp_path / "rod.holonom", tmp_path / "rod.csv"
    assert invoke(["run", str(pendulum), "-q", "-o", str(result)]) == 0
    line = ["export", str(result), "rod.angle", "--interval", "0.3", "-o", str(table)]
    assert invoke([*line, "--from", "0.5"]) == 0
    np.testing.assert_allclose(pd.read_csv(table)["time (s)"], [0.6, 0.9, 1.0])
    for interval, ends, times in [
        ("0.1", ["0.3", "0.7"], [0.3, 0.4, 0.5, 0.6, 0.7]),  # 0.1 + 0.2 is 0.30000000000000004
        ("0.3", ["0.3", "2"], [0.3, 0.6, 0.9, 1.0]),
        ("1e-9", ["0.5", "0.500000002"], [0.5, 0.500000001, 0.500000002]),  # of 1e9 in all
    ]:
        line = ["export", str(result), "rod.angle", "--interval", interval, "-o", str(table)]
        assert invoke([*line, "--from", ends[0], "--to", ends[1], "--force"]) == 0
        np.testing.assert_allclose(pd.read_csv(table)["time (s)"], times, rtol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--from", "5"], "they go from 0 s to 1.99 s"),
        (["--from", "0.5", "--to", "0.4"], "no row lies"),
        (["--to", "nan"], "`--to` is nan"),
        (["--format", "excel"], "known are csv (.csv), parquet (.parquet), netcdf (.nc)"),
        (["--format", "parquet", "-o", "-"], "prints CSV"),
        (["-o", "table.xlsx"], "no format ends in `.xlsx`"),
        (["-o", "table.csv", "--format", "parquet"], "the ending of csv"),
        (["rod.positon"], "rod.position"),
    ],
)
def test_exports_that_make_no_sense_are_refused(
    stored: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    before = stored.read_bytes()
    assert invoke(["export", str(stored), *arguments]) == 1
    assert said in capsys.readouterr().err
    assert stored.read_bytes() == before


@pytest.mark.parametrize(
    ("library", "extra", "write"),
    [
        ("xarray", "xarray", lambda result, _: result.to_xarray()),
        ("xarray", "xarray", lambda result, path: result.to_netcdf(path)),
        ("h5netcdf", "netcdf", lambda result, path: result.to_netcdf(path)),
        ("h5py", "netcdf", lambda result, path: result.to_netcdf(path)),
        ("pyarrow", "parquet", lambda result, path: result.to_parquet(path)),
        ("scipy.io", "matlab", lambda result, path: result.to_matlab(path)),
    ],
)
def test_a_missing_library_is_named_with_its_extra(
    stored: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    library: str,
    extra: str,
    write: Callable[[Result, Path], Any],
) -> None:
    monkeypatch.setitem(sys.modules, library, None)  # as if it were not there
    path = tmp_path / "table"
    with (
        Result.load(stored) as result,
        pytest.raises(holonom.UsageError, match=rf"(?s){library.partition('.')[0]}.*`{extra}`"),
    ):
        write(result, path)
    assert not path.exists()


@pytest.mark.parametrize("name", ["run.csv", "run.nc", "run.parquet"])
def test_a_place_that_cannot_be_written_is_named(stored: Path, name: str) -> None:
    blocked = stored / name  # a file where a folder is needed
    assert invoke(["export", str(stored), "-o", str(blocked)]) == 5


def test_matlab_reads_channels_with_units_under_valid_names(
    spatial: Result, tmp_path: Path
) -> None:
    path = spatial.to_matlab(tmp_path / "run.mat")
    read = scipy.io.loadmat(path, squeeze_me=True)
    np.testing.assert_array_equal(read["time"], spatial.time)
    np.testing.assert_array_equal(read["chassis_position"], spatial["chassis.position"])
    facts = read["holonom"]
    listed = dict(zip(facts["channel"].item(), facts["variable"].item(), strict=True))
    assert set(listed) == set(spatial.channels)
    for channel, variable in listed.items():
        np.testing.assert_array_equal(read[variable], spatial[channel])
    units = dict(zip(facts["channel"].item(), facts["unit"].item(), strict=True))
    assert units["chassis.position"] == "m"
    assert facts["model_hash"].item() == spatial.model.hash


@given(st.lists(st.text(max_size=90), unique=True, max_size=30))
@example(["a.b", "a_b", "a-b", "end", "_x", "1", "time", "holonom", "é", "x" * 80, "x" * 80 + "y"])
def test_names_of_variables_are_valid_and_different(names: list[str]) -> None:
    found = matlab_names(names)
    assert len(set(found)) == len(names)
    for name in found:
        assert re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,62}", name)
        assert name not in ("end", "for", "function", "time", "holonom")


@pytest.mark.parametrize("text", ["=1+1", "+1", "-cmd|' /C calc'!A0", "@SUM(1)", "\t=1", "\r=1"])
def test_no_text_of_a_table_is_a_formula(text: str) -> None:
    made = StringIO(newline="")
    files.write_cells(made, [[text, -1.5, "a,b", 'say "so"']])
    (cells,) = csv.reader(StringIO(made.getvalue(), newline=""))
    assert cells == [f"'{text}", "-1.5", "a,b", 'say "so"']


def test_a_channel_with_the_name_of_a_formula_is_a_heading(tmp_path: Path) -> None:
    text = PENDULUM.replace("rod = {", '"-rod" = {').replace('"rod', '"-rod')
    result = holonom.Model.from_text(text).simulate(end_time=0.05)
    heading = result.to_csv(tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "'-rod.position[0] (m)" in next(csv.reader([heading]))
