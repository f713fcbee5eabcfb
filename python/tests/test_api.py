"""What a user does from Python."""

from __future__ import annotations

import gc
import json
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import MODELS, PENDULUM

import holonom
from holonom.model import reading
from holonom.store.memory import Memory
from holonom.store.writer import Writer
from holonom.summary import summarize


@pytest.fixture
def model(pendulum: Path) -> holonom.Model:
    return holonom.Model.load(pendulum)


def quarter_period(length: float, inertia: float, mass: float, amplitude: float) -> float:
    """Time from rest to the lowest point, s: the complete elliptic integral by its AGM."""
    a, b = 1.0, np.cos(amplitude / 2.0)
    for _ in range(30):
        a, b = (a + b) / 2.0, np.sqrt(a * b)
    rate = np.sqrt(9.81 * mass * length / (inertia + mass * length**2))
    return float(np.pi / (2.0 * a * rate))


def test_the_pendulum_reaches_its_lowest_point_on_time(model: holonom.Model) -> None:
    moment = quarter_period(0.8, 0.1, 2.0, np.pi / 2.0)
    result = model.simulate(end_time=moment, tolerance=1e-9)
    assert result.status == "completed"
    assert result.time[-1] == moment
    np.testing.assert_allclose(result["rod.position"][-1], [0.0, -0.8], atol=1e-7)


def test_arrays_have_units_frames_and_shapes(model: holonom.Model) -> None:
    result = model.simulate()
    assert result.time.shape == (101,)
    np.testing.assert_allclose(result.time, np.linspace(0.0, 1.0, 101), atol=1e-12)
    assert result["rod.position"].shape == (101, 2)
    assert (result.unit("rod.position"), result.frame("rod.position")) == ("m", "ground")
    assert result["energy.kinetic"].shape == (101,)
    assert result.unit("energy.kinetic") == "J"
    assert result.statistics.steps > 0


def test_contraction_of_iterations_is_told(model: holonom.Model) -> None:
    spent = model.simulate(method="SspSDIRK16", tolerance=1e-8).statistics
    assert 0 < spent.contractions <= spent.iterations
    assert 0.0 < spent.mean_contraction <= spent.largest_contraction < 1.0
    spent = model.simulate(method="DEABM").statistics
    assert (spent.contractions, spent.mean_contraction, spent.largest_contraction) == (0, 0.0, 0.0)


def test_processor_time_is_that_of_assembly_and_run(model: holonom.Model) -> None:
    result = model.simulate(tolerance=1e-10)
    spent = result.statistics
    assert spent.run_cpu_seconds > 0.0
    assert spent.cpu_seconds == spent.assembly_cpu_seconds + spent.run_cpu_seconds
    assert result.meta["cpu_seconds"] == spent.cpu_seconds


def test_channels_that_were_not_stored_are_computed_the_same(model: holonom.Model) -> None:
    stored = model.simulate(channels=["rod.velocity", "rod.position", "pin.force"])
    computed = model.simulate(channels=[])
    assert "rod.velocity" not in computed.channels
    for name in ("rod.velocity", "rod.position", "pin.force"):
        np.testing.assert_array_equal(computed[name], stored[name])


def test_a_run_continues_from_a_stored_state(model: holonom.Model) -> None:
    whole = model.simulate(tolerance=1e-9)
    rest = model.simulate(start=whole.state(0.4), end_time=1.0, tolerance=1e-9)
    assert rest.time[0] == pytest.approx(0.4, abs=1e-12)
    np.testing.assert_allclose(rest["rod.position"], whole["rod.position"][40:], atol=1e-7)


def test_a_changed_model_that_goes_on_is_no_imbalance(model: holonom.Model) -> None:
    # Independent truth: no force but gravity, so that the energy of the heavier rod is constant.
    first = model.simulate(end_time=0.4)
    heavier = model.with_values({"bodies.rod.mass": 3.0})
    second = heavier.simulate(start=first.state(), end_time=1.0)
    assert not second.warnings
    energy, scale = second.energy, float(second["energy.kinetic"].max())
    assert energy["initial"] == pytest.approx(second["energy.total"][0], rel=1e-9)
    assert abs(energy["imbalance"]) <= energy["largest_imbalance"] < 1e-3 * scale
    # The channel goes on from the lighter rod; what is told of the run is not that.
    jump = second["energy.imbalance"][0]
    assert jump == pytest.approx(second["energy.total"][0] - first.energy["initial"], rel=1e-9)
    assert abs(jump) > 0.01 * scale
    assert float(dict(summarize(second))["energy imbalance"].split()[0]) < 1e-3 * scale


def test_the_energy_of_a_state_without_a_ledger_is_balanced_from_there(
    model: holonom.Model,
) -> None:
    state = model.simulate(end_time=0.4).state()
    del state["ledger"]
    # Independent truth: no force but gravity.
    result = model.simulate(start=state, end_time=1.0)
    scale = float(result["energy.kinetic"].max())
    assert np.abs(result["energy.imbalance"]).max() < 1e-3 * scale
    assert result.energy["initial"] == pytest.approx(result["energy.total"][0], rel=1e-12)


@pytest.mark.parametrize(
    ("start", "named"),
    [
        (3, "`start` is 3"),
        ({}, "no entry `time`"),
        ("state", "it must be a state"),
        ({"time": [0.0], "q": ["a"], "qd": [0.0]}, r"start\['q'\]` is \['a'\]"),
        ({"q": [0.0], "qd": [0.0]}, "no entry `time`"),
        ({"time": 0.0, "qd": [0.0]}, "no entry `q`"),
        ({"time": 0.0, "position": [0.0]}, "'position'"),
    ],
)
def test_a_start_that_is_no_state_is_refused(model: holonom.Model, start: Any, named: str) -> None:
    with pytest.raises(holonom.UsageError, match=named) as refused:
        model.simulate(start=start)
    assert refused.value.code == "simulation/start-state"


def test_a_joint_lets_go_between_two_parts_of_a_run() -> None:
    """Independent truth: the parabola of a body that nothing holds."""
    model = holonom.Model.from_dict(
        {
            "holonom": 1,
            "dimension": "planar",
            "gravity": [0.0, -9.81],
            "bodies": {"shot": {"mass": 1.0, "inertia": 0.1, "position": [1.0, 0.0]}},
            "joints": {
                "sling": {
                    "type": "distance",
                    "between": ["ground", "shot"],
                    "points": [[0.0, 0.0], [1.0, 0.0]],
                }
            },
            "initial": {"bodies": {"shot": {"velocity": [0.0, 5.0]}}},
        }
    )
    held = model.simulate(end_time=0.1)
    state = held.state()
    flight = model.with_values({"joints.sling.enabled": False}).simulate(start=state, end_time=0.5)
    flown = 0.4
    for k, pull in enumerate([0.0, -9.81]):
        place = state["q"][k] + flown * state["qd"][k] + 0.5 * pull * flown**2
        assert flight["shot.position"][-1, k] == pytest.approx(place, abs=1e-4)


@pytest.mark.parametrize(
    ("entry", "change", "named"),
    [
        ("q", lambda q: q[:-1], "`q` has 2 numbers; a state of this model has 3"),
        ("qd", lambda v: np.append(v, 0.0), "`qd` has 4 numbers"),
        ("q", lambda q: q * np.nan, r"start\['q'\]\[0\]` is nan"),
        ("qd", lambda v: np.full_like(v, np.inf), r"start\['qd'\]\[0\]` is inf"),
        ("time", lambda t: np.append(t, t), "holds 2 times"),
        ("q", lambda q: q[None, :], "shape"),
        ("q", lambda q: q + np.array([1e-3, 0.0, 0.0]), "joint `pin`, translation along x"),
        ("qd", lambda v: v + np.array([0.0, 10.0, 0.0]), "joint `pin`, translation along y"),
    ],
)
def test_a_state_that_does_not_fit_is_refused(
    model: holonom.Model, entry: str, change: Callable[[Any], Any], named: str
) -> None:
    state = model.simulate(end_time=0.1).state()
    state[entry] = change(state[entry])
    with pytest.raises(holonom.UsageError, match=named) as refused:
        model.simulate(start=state)
    assert refused.value.code == "simulation/start-state"


def test_a_run_at_a_limit_keeps_its_last_state_and_goes_on(model: holonom.Model) -> None:
    part = model.simulate(output_times=[0.0, 1.0], max_steps=20, on_failure="return")
    assert part.status == "limit"
    assert part.time.size == 2
    assert 0.0 < part.time[-1] == part.stop_reason["time"] < 1.0
    rest = model.simulate(start=part.state())
    assert rest.time[0] == part.time[-1]
    assert rest.status == "completed"
    # Independent truth: the run in one piece.
    whole = model.simulate()
    np.testing.assert_allclose(rest["rod.angle"][-1], whole["rod.angle"][-1], atol=1e-4)


@pytest.mark.parametrize("store", [Writer, Memory])
def test_ctrl_c_while_rows_are_stored_loses_none(
    store: Any, model: holonom.Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = store.append

    def append(self: Any, chunk: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        plain(self, chunk)

    monkeypatch.setattr(store, "append", append)
    output = tmp_path / "rod.holonom" if store is Writer else None
    with pytest.raises(holonom.Interrupted) as ended:
        model.simulate(end_time=1e4, tolerance=1e-9, interval=0.01, output=output)
    result = ended.value.result
    assert result is not None
    assert result.status == "interrupted"
    assert result.time[-1] == result.stop_reason["time"] < 1e4
    # Every row up to the last, which is the state in which the run was stopped.
    np.testing.assert_allclose(result.time[:-1], 0.01 * np.arange(result.time.size - 1), atol=1e-9)


def test_a_stored_file_holds_the_same_run(model: holonom.Model, tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    memory = model.simulate()
    model.simulate(output=path).close()
    with holonom.load(path) as loaded:
        np.testing.assert_array_equal(loaded["q"], memory["q"])
        assert loaded.model.hash == model.hash
        np.testing.assert_array_equal(loaded["rod.velocity"], memory["rod.velocity"])
        again = loaded.model.simulate(start=loaded.state(0.4))
        assert again.time[-1] == loaded.time[-1]


def test_ctrl_c_ends_the_reading_of_a_large_model() -> None:
    # Long enough to be met in the middle of it on any machine.
    links = "\n".join(
        f"link_{k} = {{ mass = 1.0, inertia = 0.1, position = [{k}.0, 0.0] }}"
        for k in range(60_000)
    )
    text = f'holonom = 1\ntitle = "links"\ndimension = "planar"\n[bodies]\n{links}\n'
    # Python drops what is raised in a finalizer: those of earlier results run now.
    gc.collect()
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    read = []

    def wait() -> None:
        read.append(holonom.Model.from_text(text))
        timer.join()

    with pytest.raises(KeyboardInterrupt):
        wait()
    assert not read


def test_ctrl_c_before_the_first_row_replaces_nothing(model: holonom.Model, tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    model.simulate(output=path).close()
    before = path.read_bytes()
    links = "\n".join(
        f"link_{k} = {{ mass = 1.0, inertia = 0.1, position = [{k}.0, 0.0] }}"
        for k in range(20_000)
    )
    head = 'holonom = 1\ntitle = "links"\ndimension = "planar"\n[simulation]\nend_time = 1.0\n'
    large = holonom.Model.from_text(f"{head}[bodies]\n{links}\n")
    # Python drops what is raised in a finalizer: those of earlier results run now.
    gc.collect()
    timer = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        large.simulate(output=path)
    assert path.read_bytes() == before


def test_a_result_says_what_the_run_used_stated_or_not(
    model: holonom.Model, tmp_path: Path
) -> None:
    path = tmp_path / "rod.holonom"
    model.simulate(method="SspTrap", end_time=0.5, interval=0.25, output=path)
    part = {"relative": 1e-6, "translation": 1e-6, "rotation": 1e-6}
    with holonom.Result.load(path) as stored:
        used = stored.options
        assert used.pop("channels")[:2] == ["rod.position", "pin.force"]
        assert used == {
            "start_time": 0.0,
            "end_time": 0.5,
            "tolerance": part,
            "method": "SspTrap",
            "formula": "trapezoidal",
            "interval": 0.25,
            "max_steps": 10_000_000,
            "parametrization": "tree",
            "jacobian": "analytic",
            "newton": "auto",
            "accelerations": "auto",
            "coordinates": "auto",
            "threads": 1,
            "repartition_factor": 2.5,
            "dense_output": True,
            "profile": "improved",
        }
        again = model.simulate(**stored.options)
        np.testing.assert_array_equal(again["rod.position"], stored["rod.position"])
    thesis = model.simulate(profile="thesis", method="DEABM").options
    assert (thesis["parametrization"], thesis["dense_output"]) == ("partitioning", False)
    assert "output_times" not in thesis


def test_values_are_changed_by_path_and_the_original_stays(model: holonom.Model) -> None:
    heavy = model.with_values({"bodies.rod.mass": np.float64(5.0)})
    assert json.loads(heavy.to_json())["bodies"]["rod"]["mass"] == 5.0
    assert json.loads(model.to_json())["bodies"]["rod"]["mass"] == 2.0
    assert heavy.hash != model.hash
    with pytest.raises(holonom.ModelError, match=r"bodies\.rud") as caught:
        model.with_values({"bodies.rud.mass": 5.0})
    assert caught.value.code.startswith("model/")


CHAIN = """
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
parameters.links = { value = 2 }
[patterns.chain]
over.i = { from = 1, to = "=links" }
bodies."link_{i}" = { mass = "=1/i", inertia = 0.01, position = ["=i - 0.5", 0.0] }
[patterns.chain.joints."joint_{i}"]
type = "revolute"
between = ["link_{i - 1}", "link_{i}"]
point = ["=i - 1", 0.0]
[joints]
joint_1 = { between = ["ground", "link_1"] }
[simulation]
end_time = 0.1
"""


def test_a_pattern_is_repeated_as_often_as_a_parameter_says(tmp_path: Path) -> None:
    two = holonom.Model.from_text(CHAIN)
    assert two.check(spectrum=False).dof == 2
    three = two.with_values({"bodies.link_3.inertia": 0.02, "parameters.links": 3})
    assert three.check(spectrum=False).dof == 3
    bodies = json.loads(three.to_json(plain=True))["bodies"]
    assert (list(bodies), bodies["link_3"]["inertia"]) == (["link_1", "link_2", "link_3"], 0.02)
    assert "patterns" in json.loads(three.to_json())
    # All links at once, and a stored result knows its model.
    still = three.with_values({'patterns.chain.bodies."link_{i}".mass': 5.0})
    path = tmp_path / "chain.holonom"
    still.simulate(output=path, certify=True).close()
    with holonom.load(path) as loaded:
        assert loaded.model.hash == still.hash
        assert loaded["link_3.position"].shape[1:] == (2,)
    with pytest.raises(holonom.ModelError, match="parameter `links`") as caught:
        two.with_values({"parameters.links": 2.5})
    assert caught.value.code == "model/out-of-range"


def test_check_counts_and_shows_the_linearized_motion(model: holonom.Model) -> None:
    # At rest in the horizontal the pendulum's linearization has eigenvalues 0; hanging it swings
    # with the small-angle frequency.
    hanging = model.with_values({"bodies.rod.position": [0.0, -0.8]})
    report = hanging.check()
    assert (report.dof, report.data["bodies"], report.data["joints"]) == (1, 1, 1)
    text = str(report)
    assert "1 body, 1 joint" in text
    assert "degrees of freedom    1" in text
    assert "real parts above 0" not in text
    # Upside down it falls; that is said not to be the case of whatever turns.
    falling = model.with_values({"bodies.rod.position": [0.0, 0.8]})
    assert "real parts above 0: deviations grow at this instant" in str(falling.check())


def test_threads_change_no_bit(model: holonom.Model) -> None:
    chain = holonom.Model.from_text(CHAIN).with_values({"parameters.links": 1200})
    alone = chain.simulate(newton="sparse")
    shared = chain.simulate(newton="sparse", threads=2)
    np.testing.assert_array_equal(alone["link_1200.position"], shared["link_1200.position"])
    assert (alone.options["threads"], shared.options["threads"]) == (1, 2)
    with pytest.raises(holonom.UsageError, match="`threads` is 5000; it must be from 1 to 1024"):
        model.simulate(threads=5000)


@pytest.mark.parametrize("solver", ["null_space", "reduced", "augmented"])
def test_accelerations_come_from_the_stated_solver(model: holonom.Model, solver: str) -> None:
    found = model.simulate(accelerations=solver, end_time=0.2)
    assert found.options["accelerations"] == solver
    usual = model.simulate(end_time=0.2)
    np.testing.assert_allclose(found["rod.position"], usual["rod.position"], atol=1e-6)
    checked = model.with_values({"simulation.accelerations": solver}).check()
    assert checked.data["accelerations"]["solver"] == solver
    assert checked.data["accelerations"]["stated"]
    assert "stated by the model" in str(checked)


def test_a_solver_that_cannot_be_is_refused_with_the_body() -> None:
    rod = holonom.Model.from_text(
        """
        holonom = 1
        dimension = "planar"
        [bodies]
        rod = { mass = 1.0, inertia = 0.0, position = [1.0, 0.0] }
        [joints]
        pin = { type = "revolute", between = ["ground", "rod"], point = [0.0, 0.0] }
        [simulation]
        end_time = 0.1
        """
    )
    assert "`rod` has no mass" in str(rod.check())
    with pytest.raises(holonom.UsageError, match="body `rod` has no mass, or no inertia"):
        rod.simulate(accelerations="reduced")


def test_an_unknown_channel_is_refused_with_the_nearest(model: holonom.Model) -> None:
    with pytest.raises(holonom.UsageError, match=r"rod\.position"):
        model.simulate(channels=["rod.positon"])
    result = model.simulate(end_time=0.1)
    with pytest.raises(holonom.UsageError, match=r"pin\.force"):
        result["pin.forces"]


def test_patterns_name_several_channels(model: holonom.Model) -> None:
    result = model.simulate(end_time=0.1, channels=["rod.*"])
    assert {"rod.position", "rod.velocity", "rod.angle"} <= set(result.requested)


@pytest.mark.parametrize(
    ("pattern", "count"),
    [
        ("*.position", 2),
        ("r?d.position", 1),
        ("rod.[pv]*", 2),
        ("[!r]*.force", 1),
        ("*.[!a-e]*", None),
        ("**.angle", 2),
        ("rod.positio[!n]", 0),
        ("?.position", 0),
    ],
)
def test_a_model_file_takes_the_patterns_that_a_call_takes(
    pendulum: Path, pattern: str, count: int | None
) -> None:
    model = holonom.Model.load(pendulum)
    text = PENDULUM.replace('"rod.position", "pin.force"', f'"{pattern}"')
    pendulum.write_text(text)
    if count == 0:
        with pytest.raises(holonom.ModelError, match=r"outputs\.channels\[0\]"):
            holonom.Model.load(pendulum)
        with pytest.raises(holonom.UsageError, match="there is no channel"):
            model.expand([pattern])
        return
    asked = holonom.Model.load(pendulum).simulate(end_time=0.01).requested
    assert asked == model.expand([pattern])
    assert count in (None, len(asked))


def test_an_unknown_option_or_method_is_refused_with_the_known_ones(model: holonom.Model) -> None:
    with pytest.raises(holonom.UsageError, match="did you mean `tolerance`"):
        model.simulate(tolerence=1e-3)
    with pytest.raises(holonom.UsageError, match="ForSDIRK"):
        model.simulate(method="ForSDIRC")


def test_a_limit_ends_the_run_with_what_there_is(model: holonom.Model) -> None:
    with pytest.raises(holonom.SimulationError) as caught:
        model.simulate(max_steps=3)
    error = caught.value
    assert error.code == "simulation/max-steps"
    assert error.result is not None
    assert error.result.status == "limit"
    kept = model.simulate(max_steps=3, on_failure="return")
    assert kept.status == "limit"
    assert kept.stop_reason["code"] == "simulation/max-steps"


def test_progress_is_told_and_an_error_in_it_ends_the_run(model: holonom.Model) -> None:
    def fail(*_: Any) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        model.simulate(end_time=1e4, tolerance=1e-9, progress=fail)


def test_a_failed_start_leaves_an_older_result_alone(model: holonom.Model, tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    model.simulate(output=path, end_time=0.1).close()
    before = path.read_bytes()
    with pytest.raises(holonom.UsageError):
        model.simulate(output=path, method="ForSDIRC")
    assert path.read_bytes() == before


@pytest.mark.parametrize("what", ["extends", "meshes"])
def test_an_interruption_while_files_are_read_is_let_through(
    pendulum: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    variant = pendulum.parent.parent / "variant" / "model.toml"
    variant.parent.mkdir()
    text = 'holonom = 1\nextends = "../rod/model.toml"\n'
    for name in ("first", "second"):
        text += f'[bodies.rod.shapes.{name}]\ntype = "mesh"\nfile = "{name}.stl"\n'
    variant.write_text(text)
    read: list[str] = []

    def interrupted(path: Path) -> bytes:
        read.append(path.name)
        raise KeyboardInterrupt

    if what == "meshes":
        monkeypatch.setattr(reading, "_read_mesh", interrupted)
    else:
        whole = reading._read
        monkeypatch.setattr(
            reading, "_read", lambda path: whole(path) if path == variant else interrupted(path)
        )
    with pytest.raises(KeyboardInterrupt):
        holonom.Model.load(variant)
    assert read == ["first.stl" if what == "meshes" else "model.toml"]  # and nothing after it


def test_a_tolerance_in_part_is_the_same_in_a_file_and_in_a_call(pendulum: Path) -> None:
    text = pendulum.read_text()
    part = {"relative": 1e-7}
    stated = text.replace("tolerance = 1.0e-6", "tolerance = { relative = 1e-7 }")
    free = text.replace("tolerance = 1.0e-6\n", "")
    of_file = holonom.Model.from_text(stated).simulate(end_time=0.01)
    of_call = holonom.Model.from_text(free).simulate(end_time=0.01, tolerance=part)
    assert of_file.options["tolerance"] == of_call.options["tolerance"]
    assert of_file.options["tolerance"] == {
        "relative": 1e-7,
        "translation": 1e-4,
        "rotation": 1e-4,
    }


def test_extends_stays_in_the_tree_of_model_folders(pendulum: Path) -> None:
    folder = pendulum.parents[1] / "variant"
    folder.mkdir()
    variant = folder / "model.toml"
    variant.write_text('holonom = 1\nextends = "../rod/model.toml"\ntitle = "Variant"\n')
    model = holonom.Model.load(variant)
    assert model.title == "Variant"
    assert model.name == "variant"

    outside = pendulum.parents[2] / "outside.toml"
    outside.write_text(PENDULUM)
    variant.write_text('holonom = 1\nextends = "../../outside.toml"\n')
    with pytest.raises(holonom.ModelError, match="outside"):
        holonom.Model.load(variant)


def test_a_link_out_of_the_tree_is_no_way_out(pendulum: Path) -> None:
    outside = pendulum.parents[2] / "outside.toml"
    outside.write_text(PENDULUM)
    link = pendulum.parent / "link.toml"
    link.symlink_to(outside)
    variant = pendulum.parent / "variant.toml"
    variant.write_text('holonom = 1\nextends = "link.toml"\n')
    with pytest.raises(holonom.ModelError, match="outside"):
        holonom.Model.load(variant)


def test_a_path_given_as_text_is_recognised() -> None:
    with pytest.raises(holonom.ModelError, match=r"Model\.load"):
        holonom.Model.from_text("models/rod/model.toml")


def test_text_and_json_give_the_same_model(model: holonom.Model) -> None:
    assert holonom.Model.from_text(PENDULUM).hash == model.hash
    assert holonom.Model.from_text(model.to_json(), "json").hash == model.hash


def test_a_file_that_is_not_utf8_or_is_a_folder_is_named(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_bytes(b"title = '\xff'")
    with pytest.raises(holonom.ModelError, match="UTF-8"):
        holonom.Model.load(path)
    with pytest.raises(holonom.FileError, match=r"did you mean .*model\.toml"):
        holonom.Model.load(tmp_path)


def test_methods_are_listed() -> None:
    names = [method["name"] for method in holonom.methods()]
    assert {"ForSDIRK", "DEABM"} <= set(names)


def test_the_models_of_the_library_load_and_assemble() -> None:
    paths = sorted(MODELS.glob("*/model.toml"))
    assert len(paths) >= 6
    for path in paths:
        model = holonom.Model.load(path)
        report = model.check(spectrum=False)
        assert report.dof >= 0, path
        assert model.defaults["end_time"] > 0.0, path


def test_what_the_pages_name_is_there() -> None:
    assert holonom.signals.spectrum.__module__ == "holonom.signals"
    assert "signals" in dir(holonom)
    result = holonom.Model.library("double_pendulum").simulate(end_time=0.5)
    assert result.limited_by == result.meta["limited_by"]
    assert result.limited_by.steps <= result.limited_by.of


def test_a_stated_growth_of_the_condition_holds_for_every_parametrization() -> None:
    # A block on a circle, by two slides: each is bad somewhere, and late choices cost steps.
    model = holonom.Model.from_text(
        """
        holonom = 1
        dimension = "planar"
        gravity = [0.0, 0.0]
        [bodies]
        carrier = { mass = 0.1, inertia = 0.1, position = [1.0, 0.0] }
        block = { mass = 1.0, inertia = 1.0, position = [1.0, 0.0] }
        [joints.x]
        type = "translational"
        between = ["ground", "carrier"]
        point = [1.0, 0.0]
        axis = [1.0, 0.0]
        [joints.y]
        type = "translational"
        between = ["carrier", "block"]
        point = [1.0, 0.0]
        axis = [0.0, 1.0]
        [joints.round]
        type = "distance"
        between = ["ground", "block"]
        points = [[0.0, 0.0], [1.0, 0.0]]
        [initial.bodies.block]
        velocity = [0.0, 3.0]
        """
    )
    for parametrization, usual in (("tree", 2.5), ("partitioning", 1.25), ("tangent_plane", 2.0)):
        usually = model.simulate(end_time=2.0, parametrization=parametrization)
        assert usually.options["repartition_factor"] == usual
        late = model.simulate(end_time=2.0, parametrization=parametrization, repartition_factor=1e9)
        assert late.options["repartition_factor"] == 1e9
        assert late.statistics["steps"] > 1.4 * usually.statistics["steps"]
