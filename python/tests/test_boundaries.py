"""What crosses from Python: names read once, complex numbers, parts left out, closed results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import CHANNELS, META, PENDULUM, SUMMARY, synthetic_chunk

import holonom
from holonom.base.errors import FileError, UsageError
from holonom.cli.commands import invoke
from holonom.result import Result
from holonom.store.memory import Memory
from holonom.view.scene import scene


@pytest.fixture
def model() -> holonom.Model:
    return holonom.Model.from_text(PENDULUM)


@pytest.fixture
def result(model: holonom.Model) -> Result:
    return model.simulate(end_time=0.2)


def test_names_are_read_once(model: holonom.Model, result: Result, tmp_path: Path) -> None:
    names = ["rod.angle", "rod.velocity"]

    def once() -> map[str]:
        return map(str, names)

    run = model.simulate(end_time=0.1, channels=once())  # type: ignore[arg-type]
    assert run.requested == names
    assert set(names) < set(run.keys())
    compared = holonom.compare(
        model, methods=["ForRadau"], tolerances=[1e-2], end_time=0.1, repeat=0,
        channels=once(),  # type: ignore[arg-type]
    )  # fmt: skip
    found = {error.name.partition("[")[0] for row in compared.rows for error in row.errors}
    assert found == set(names)
    difference = holonom.diff(result, result, once())  # type: ignore[arg-type]
    assert {channel.name for channel in difference.channels} == set(names)
    rows = result.rows(0, 2, once())  # type: ignore[arg-type]
    assert set(rows) == set(names)
    table = result.to_csv(tmp_path / "x.csv", once())  # type: ignore[arg-type]
    assert table.read_text().startswith("time (s),rod.angle (rad),rod.velocity[0] (m/s)")
    labels = iter(["one", "two"])
    result.plot("rod.angle", others=[run], labels=labels)  # type: ignore[arg-type]


def test_rows_are_of_the_stored_channels_by_default(result: Result) -> None:
    for rows in (result.rows(0, 2), result.rows(0, 2, None)):
        assert list(rows) == result.channels


@pytest.mark.parametrize(
    ("channel", "part"),
    [
        ("pin.force", "lambda"),
        ("pin.torque", "lambda"),
        ("rod.acceleration", "qdd"),
        ("rod.angular_acceleration", "qdd"),
        ("constraint.acceleration", "qdd"),
        ("energy.dissipated", "ledger"),
        ("energy.driver_work", "ledger"),
        ("energy.imbalance", "ledger"),
    ],
)
def test_a_state_without_what_a_channel_needs_is_refused(
    model: holonom.Model, result: Result, channel: str, part: str
) -> None:
    """Every other channel is what it is with the whole state."""
    state = result.state()
    lacking = {name: values for name, values in state.items() if name != part}
    with pytest.raises(UsageError, match=f"no entry `{part}`, which `{channel}`") as refused:
        model.evaluate([channel], lacking)
    assert refused.value.code == "simulation/start-state"
    for name in model.channels:
        whole = model.evaluate([name], state)[name]
        try:
            found = model.evaluate([name], lacking)[name]
        except UsageError:
            continue
        assert found.tobytes() == whole.tobytes(), name


def test_forces_need_no_multipliers() -> None:
    """The force of a spring follows from where the bodies are."""
    spring = PENDULUM.replace(
        "[outputs]",
        '[forces]\nspring = { type = "tsda", between = ["ground", "rod"], '
        "points = [[0.0, 1.0], [0.8, 0.0]], stiffness = 10.0, free_length = 1.0 }\n[outputs]",
    )
    model = holonom.Model.from_text(spring)
    state = model.simulate(end_time=0.1).state()
    bare = {name: state[name] for name in ("time", "q", "qd")}
    force = model.evaluate(["spring.force"], state)["spring.force"]
    assert force != 0.0
    assert model.evaluate(["spring.force"], bare)["spring.force"] == force


def test_a_result_without_a_part_of_its_states_is_shown_without_what_needs_it() -> None:
    memory = Memory(META, CHANNELS)
    memory.append({k: v for k, v in synthetic_chunk(0, 50).items() if k != "ledger"})
    memory.finish(SUMMARY)
    shown = {channel["name"] for channel in scene(Result(memory))["channels"]}
    assert {"rod.position", "energy.imbalance"} < shown  # this one is stored
    assert "energy.dissipated" not in shown


def test_a_complex_state_is_refused(model: holonom.Model, result: Result) -> None:
    state = result.state()
    with pytest.raises(UsageError, match="must hold numbers"):
        model.simulate(start=state | {"q": state["q"] + 1j}, end_time=0.3)  # type: ignore[dict-item]
    with pytest.raises(UsageError, match="`times`"):
        result.sample(np.array([0.1 + 0j]))


@pytest.mark.parametrize(
    "use",
    [
        lambda r, _: r.time,
        lambda r, _: r.state(),
        lambda r, _: r.sample([0.1]),
        lambda r, _: r.steps,
        lambda r, _: r.verify(),
        lambda r, folder: r.save(folder / "copy.holonom"),
        lambda r, folder: r.report(folder / "page.html"),
    ],
)
@pytest.mark.parametrize("recover", [False, True])
def test_what_is_closed_is_not_damaged(
    model: holonom.Model, tmp_path: Path, use: Callable[[Result, Path], object], recover: bool
) -> None:
    path = tmp_path / "rod.holonom"
    model.simulate(end_time=0.2, output=path).close()
    with holonom.load(path, recover=recover) as result:
        angle = result["rod.position"]
    with pytest.raises(FileError, match=r"is closed\n  help: .*holonom\.load") as refused:
        use(result, tmp_path)
    assert refused.value.code == "result/closed"
    assert repr(result) == "<holonom.Result 'model': completed, closed>"
    assert result._repr_html_() == "&lt;holonom.Result &#x27;model&#x27;: completed, closed&gt;"
    assert result["rod.position"] is angle
    assert not result.damage
    result.close()


def test_a_picture_over_no_times_is_refused_before_the_runs(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["compare", str(pendulum), "--repeat", "0", "--plot", str(tmp_path / "x.svg")]
    assert invoke(line) == 1
    said = capsys.readouterr()
    assert "`--repeat 0` takes no times" in said.err
    assert not said.out
