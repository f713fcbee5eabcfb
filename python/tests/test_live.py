"""A run watched while it goes on: what the server gives to whom, and what a browser shows."""

from __future__ import annotations

import base64
import json
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import Browser
from conftest import PENDULUM
from test_view import page_data

import holonom
from holonom.cli.commands import invoke
from holonom.cli.progress import RunProgress
from holonom.store.layout import STATE
from holonom.view import live
from holonom.view.live import Live


def got(address: str, **headers: str) -> tuple[int, bytes]:
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def numbers(blob: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(blob["data"]), {"f4": "<f4", "i2": "<i2"}[blob["kind"]])


def test_rows_come_as_they_are_computed() -> None:
    model = holonom.Model.from_text(PENDULUM)
    chunks: list[Any] = []
    result = model.simulate(rows=chunks.append)
    np.testing.assert_array_equal(np.concatenate([c["time"] for c in chunks]), result.time)
    np.testing.assert_array_equal(
        np.concatenate([c["channels"]["rod.position"] for c in chunks]), result["rod.position"]
    )
    with pytest.raises(holonom.UsageError, match="`rows`"):
        model.simulate(rows=1)  # type: ignore[arg-type]


def test_the_page_and_what_comes_after_it_are_the_run() -> None:
    model = holonom.Model.from_text(PENDULUM)
    watched = Live(model, 1.0)
    pages: list[dict[str, Any]] = []

    def take(rows: Any) -> None:
        watched.append(rows)
        if not pages:
            pages.append(page_data(got(watched.address)[1].decode()))

    try:
        assert b"begins" in got(watched.address)[1]
        result = model.simulate(rows=take)
        assert pages[0]["live"] is True
        (run,) = pages[0]["runs"]
        first = numbers(run["times"])
        since = f"rows?since={first.size}&generation={run['generation']}"
        rest = json.loads(got(watched.address + since)[1])
        times = run["start"] + np.concatenate([first, numbers(rest["times"])])
        np.testing.assert_allclose(times, result.time, atol=1e-6)
        (body,), (more,) = run["bodies"], rest["bodies"]
        place = np.concatenate([numbers(one["position"]).reshape(-1, 3) for one in (body, more)])
        np.testing.assert_allclose(
            (place + body["origin"])[:, :2], result["rod.position"], atol=1e-6
        )
        names = [channel["name"] for channel in run["channels"]]
        again = json.loads(got(watched.address + "rows?since=5&generation=-1")[1])
        assert again["whole"]
        force = numbers(again["channels"][names.index("pin.force")]).reshape(-1, 2)
        np.testing.assert_allclose(force, result["pin.force"], rtol=1e-6, atol=1e-5)
    finally:
        watched.close()


def test_long_runs_are_thinned_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "KNOT_BYTES", 1000)
    model = holonom.Model.from_text(PENDULUM)
    watched = Live(model)
    try:
        result = model.simulate(rows=watched.append)
        rows = json.loads(got(watched.address + "rows?since=0&generation=0")[1])
    finally:
        watched.close()
    assert rows["whole"]
    assert rows["generation"] > 0
    times = result.time[0] + numbers(rows["times"])
    assert 10 < times.size < result.time.size
    # What is left are rows of the run, the first among them.
    assert times[0] == result.time[0]
    assert np.abs(times[:, None] - result.time).min(axis=1).max() < 1e-6


def test_a_run_that_begins_again_earlier_replaces_what_it_repeats() -> None:
    model = holonom.Model.from_text(PENDULUM)
    watched = Live(model)
    try:
        result = model.simulate(rows=watched.append)
        before = json.loads(got(watched.address + "rows?since=0&generation=0")[1])
        other = model.simulate(rows=watched.append, start=result.state(0.5), end_time=0.7)
        rows = json.loads(got(watched.address + "rows?since=9&generation=0")[1])
    finally:
        watched.close()
    assert not before["whole"]
    assert rows["whole"]
    times = result.time[0] + numbers(rows["times"])
    expected = np.concatenate([result.time[result.time < 0.5], other.time])
    np.testing.assert_allclose(times, expected, atol=1e-6)


def test_only_who_was_told_the_address_is_answered() -> None:
    watched = Live(holonom.Model.from_text(PENDULUM))
    try:
        host = watched.address.split("/")[2]
        assert host.startswith("127.0.0.1:")
        assert got(f"http://{host}/")[0] == 404
        assert got(watched.address + "other")[0] == 404
        assert got(watched.address + "rows?since=x")[0] == 404
        assert got(watched.address, Host="example.org")[0] == 404
        assert got(watched.address)[0] == 200
    finally:
        watched.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(watched.address, timeout=5)


def test_the_end_of_the_run_waits_for_the_last_rows_only_if_somebody_watches() -> None:
    model = holonom.Model.from_text(PENDULUM)
    watched = Live(model)
    try:
        model.simulate(rows=watched.append)
        begun = time.monotonic()
        watched.finish("completed")
        assert time.monotonic() - begun < live.LAST_ROWS / 2
        got(watched.address + "rows?since=0&generation=0")
        ended = threading.Thread(target=watched.finish, args=("completed",))
        ended.start()
        rows = json.loads(got(watched.address + "rows?since=0&generation=0")[1])
        ended.join(live.LAST_ROWS / 2)
        assert not ended.is_alive()
        assert rows["status"] == "completed"
    finally:
        watched.close()


def test_the_command_serves_the_page_while_it_runs(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "rod.toml"
    model.write_text(PENDULUM)
    output = str(tmp_path / "rod.holonom")
    assert invoke(["run", str(model), "-o", output, "--watch", "--json"]) == 0
    told = capfd.readouterr()
    assert json.loads(told.out)["status"] == "completed"
    address = told.err.split("watch it at ")[1].strip()
    with pytest.raises(urllib.error.URLError):  # the server ended with the run
        urllib.request.urlopen(address, timeout=5)
    assert invoke(["run", str(model), "-o", output, "--open"]) == 1


def test_a_run_that_ends_at_zero_is_shown_to_end_there(
    pendulum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends: list[float | None] = []

    class Watched(Live):
        def __init__(self, model: holonom.Model, end_time: float | None) -> None:
            super().__init__(model, end_time)
            ends.append(self._end)

    class Told(RunProgress):
        def __init__(self, model: holonom.Model, end_time: float | None, **more: bool) -> None:
            super().__init__(model, end_time, **more)
            ends.append(self._end)

    monkeypatch.setattr("holonom.view.live.Live", Watched)
    monkeypatch.setattr("holonom.cli.running.RunProgress", Told)
    line = ["run", str(pendulum), "-o", str(tmp_path / "rod.holonom"), "--watch", "-q"]
    assert invoke([*line, "--start-time", "-0.5", "--end-time", "0"]) == 0
    assert invoke(line) == 0
    assert ends == [0.0, 0.0, 1.0, 1.0]  # the model's, where none is stated


def test_ctrl_c_ends_run_and_server(tmp_path: Path) -> None:
    output = tmp_path / "rod.holonom"
    model = tmp_path / "rod.toml"
    model.write_text(PENDULUM)
    command = [sys.executable, "-m", "holonom", "run", str(model), "-o", str(output), "--watch"]
    with subprocess.Popen(
        [*command, "--end-time", "5000", "-q"], stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        address = process.stderr.readline().split("watch it at ")[1].strip()
        deadline = time.monotonic() + 60.0
        while b"begins" in got(address)[1]:
            assert time.monotonic() < deadline
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 130
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address, timeout=5)
    with holonom.Result.load(output) as result:
        assert result.status == "interrupted"
        assert result.time.size > 10


@pytest.mark.browser
def test_a_browser_shows_the_run_as_it_goes_on(browser: Browser) -> None:
    model = holonom.Model.from_text(PENDULUM)
    watched = Live(model, 1.0)
    chunks: list[Any] = []
    model.simulate(rows=chunks.append, interval=0.001)
    try:
        rows = chunks[0]
        keys = [key for key in rows if isinstance(rows[key], np.ndarray)]

        def part(first: int, last: int) -> dict[str, Any]:
            cut = {key: rows[key][first:last] for key in keys}
            cut["channels"] = {name: v[first:last] for name, v in rows["channels"].items()}
            return cut

        count = len(rows["time"])
        assert count > 20
        watched.append(part(0, count // 2))
        browser.get(watched.address)
        middle = float(rows["time"][count // 2 - 1])
        assert browser.run("return holonom.time") == pytest.approx(middle, abs=1e-5)
        still = browser.picture()
        watched.append(part(count // 2, count))
        last = float(rows["time"][-1])
        browser.wait(f"return holonom.end > {last - 1e-4}")
        assert browser.run("return holonom.time") == pytest.approx(last, abs=1e-5)
        assert browser.picture() != still
        drawn = browser.run("return holonom.where('rod')")
        state = {name: values for name, values in part(count - 1, count).items() if name in STATE}
        truth = model.evaluate(["rod.position"], state)["rod.position"][0]
        np.testing.assert_allclose(drawn[:2], truth, atol=1e-4)
        watched.finish("completed")
        browser.wait("return holonom.status === 'completed'")
        assert browser.complaints() == []
    finally:
        watched.close()
