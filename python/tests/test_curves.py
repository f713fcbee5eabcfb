"""Plots of parts, spectra, derivatives and several runs: what is drawn is what was computed."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import CHANNELS, META, MODELS, PENDULUM, SUMMARY, oscillator_text, synthetic_chunk
from hypothesis import given
from hypothesis import strategies as st

import holonom
from holonom.base.errors import UsageError
from holonom.channels import components
from holonom.cli.commands import invoke
from holonom.pictures import svg
from holonom.pictures.curves import curves, title
from holonom.pictures.picture import Panel, Picture
from holonom.pictures.runs import channels
from holonom.pictures.traces import COLUMNS, envelope, trace, walked
from holonom.result import Result
from holonom.signals import spectrum
from holonom.store.reader import Reader
from holonom.store.writer import Writer

SVG = "{http://www.w3.org/2000/svg}"
#: 1 kg on a spring of (2π·5)² N/m: 5 Hz, 0.2 m.
SPRING = oscillator_text(mass=1.0, x=0.2, stiffness=(10.0 * np.pi) ** 2, free_length=1.0)


@pytest.fixture(scope="module")
def spring() -> Result:
    return holonom.Model.from_text(SPRING).simulate(
        end_time=2.0, interval=0.01, tolerance=1e-8, channels=["block.position", "spring.force"]
    )


def drawn(picture: Picture) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(line.x, line.y) for panel in picture.panels for line in panel.lines]


def test_a_part_of_a_run_is_drawn_as_it_is(spring: Result) -> None:
    picture = spring.plot("block.position[0]", start=0.5, end=1.0)
    ((x, y),) = drawn(picture)
    kept = (spring.time >= 0.5) & (spring.time <= 1.0)
    np.testing.assert_array_equal(x, spring.time[kept])
    np.testing.assert_array_equal(y, spring["block.position[0]"][kept])


def test_values_between_rows_come_from_the_steps(spring: Result) -> None:
    ((x, y),) = drawn(spring.plot("block.position[0]", interval=0.003, end=1.0))
    np.testing.assert_allclose(np.diff(x), 0.003, rtol=1e-9)
    np.testing.assert_allclose(y, 0.2 * np.cos(10.0 * np.pi * x), atol=1e-5)  # the closed form


def test_values_at_an_interval_end_with_the_run(spring: Result) -> None:
    """Unless they must be evenly spaced, as for a spectrum or a filter."""
    ((x, _),) = drawn(spring.plot("block.position[0]", interval=0.03))
    np.testing.assert_allclose(x, [*(0.03 * np.arange(67)), 2.0])
    (even,) = curves(spring, ["block.position[0]"], interval=0.03, even=True)
    np.testing.assert_allclose(even.time, 0.03 * np.arange(67))


def test_derivatives_are_those_of_the_motion(spring: Result) -> None:
    picture = spring.plot("block.position[0]", derivative=True, interval=1e-3)
    ((x, y),) = drawn(picture)
    np.testing.assert_allclose(y, -2.0 * np.pi * np.sin(10.0 * np.pi * x), atol=3e-3)
    assert picture.panels[0].label == "m/s"
    assert picture.panels[0].title == "d/dt block.position, x"


def test_a_spectrum_has_the_amplitude_and_frequency_of_the_motion(spring: Result) -> None:
    picture = spring.plot("block.position[0]", fft=True, end=2.0)
    ((hertz, amplitude),) = drawn(picture)
    top = int(np.nanargmax(amplitude))
    assert hertz[top] == pytest.approx(5.0, abs=0.25)
    assert amplitude[top] == pytest.approx(0.2, rel=0.02)
    assert picture.label == "frequency, Hz"
    assert picture.panels[0].label == "amplitude, m"
    assert "hann window, resolution 0.4" in picture.panels[0].note
    assert "flat top window" in spring.plot("block.position[0]", fft="flat_top").panels[0].note


def test_a_spectrum_of_many_points_keeps_its_peaks(spring: Result) -> None:
    time = np.linspace(0.0, spring.time[-1], round(1e4 * spring.time[-1]) + 1)
    found = spectrum(time, spring.at(time)["block.position"][:, 0], "hann")
    ((hertz, amplitude),) = drawn(spring.plot("block.position[0]", fft=True, interval=1e-4))
    top = int(np.nanargmax(amplitude))
    assert hertz.size < 600 < found.frequency.size
    assert amplitude[top] == pytest.approx(found.amplitude[1:].max(), rel=0.02)
    assert hertz[top] == pytest.approx(5.0, abs=0.5)
    assert np.isfinite(amplitude).all()  # points between gaps would be no line


def test_the_axis_of_a_spectrum_ends_where_amplitudes_tell_nothing(spring: Result) -> None:
    picture = spring.plot("block.position[0]", fft=True, interval=1e-4)
    ((hertz, _),) = drawn(picture)
    found = spectrum(time := 1e-4 * np.arange(20001), spring.at(time)["block.position"][:, 0])
    assert 5.0 < hertz[-1] < 0.2 * found.frequency[-1]
    assert "of 5000 Hz" in picture.panels[0].note
    beyond = found.amplitude[found.frequency > hertz[-1]]
    level = picture.panels[0].level
    assert beyond.max() < max(1e-6 * found.amplitude[1:].max(), level[0] if level else 0.0)
    # What is seen to its end is drawn to its end.
    ((hertz, _),) = drawn(spring.plot("block.position[0]", fft="rectangular", interval=0.05))
    assert hertz[-1] == pytest.approx(10.0, rel=0.06)


#: A body that turns about z at 4 rad/s.
TURNING = """
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.wheel]
mass = 1.0
inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
position = [0.0, 0.0, 0.0]
[initial.bodies]
wheel = { angular_velocity = [0.0, 0.0, 4.0] }
"""


@pytest.mark.parametrize("rows", [301, 30001])
def test_an_angle_that_jumps_by_a_whole_turn_is_no_vertical_line(rows: int) -> None:
    name = "wheel.yaw_pitch_roll[0]"
    result = holonom.Model.from_text(TURNING).simulate(
        end_time=3.0, interval=3.0 / (rows - 1), channels=["wheel.yaw_pitch_roll"]
    )
    for picture in (
        result.plot(name),
        result.plot(name, others=[result]),
        channels(result, [name], whole=True),
    ):
        for x, y in drawn(picture):
            finite = np.isfinite(y)
            joined = finite[1:] & finite[:-1]
            assert np.abs(np.diff(y)[joined]).max() < 0.1
            assert (~finite).sum() == 2  # 12 rad are two turns, at π and 3π
            assert set(y[finite]) <= set(result[name])
            assert (np.diff(x) > 0.0).all()
    for across, along in (("wheel.angular_velocity[2]", name), (name, "wheel.position[0]")):
        ((_, y),) = drawn(result.plot(along, versus=across))
        assert np.isnan(y).sum() == 2


def test_a_filter_takes_what_is_fast(spring: Result) -> None:
    ((_, slow),) = drawn(spring.plot("block.position[0]", low_pass=2.0, start=0.9, end=1.1))
    # The gain at 5 Hz, and what is left of the ends, which are held.
    assert np.abs(slow).max() == pytest.approx(0.2 / (1.0 + 2.5**4), abs=2e-3)
    assert "low-pass 1 Hz" in spring.plot("block.position[0]", low_pass=1.0).panels[0].note


def test_one_channel_over_another_is_the_law_of_the_spring(spring: Result) -> None:
    picture = spring.plot("spring.force", versus="block.position[0]")
    ((x, y),) = drawn(picture)
    np.testing.assert_allclose(y, (10.0 * np.pi) ** 2 * x, atol=1e-6 * 200.0)
    assert picture.label == "block.position, x, m"


def test_runs_are_laid_over_each_other_with_their_names(tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.holonom" for name in ("soft", "stiff")]
    for path, k in zip(paths, ("50.0", "80.0"), strict=True):
        text = oscillator_text(mass=1.0, x=0.2, stiffness=float(k), free_length=1.0)
        with holonom.Model.from_text(text).simulate(end_time=1.0, output=path):
            pass
    with Result.load(paths[0]) as soft, Result.load(paths[1]) as stiff:
        picture = soft.plot("block.position", others=[stiff])
        assert [panel.title for panel in picture.panels] == [
            "block.position, x",
            "block.position, y",
        ]
        lines = picture.panels[0].lines
        assert [line.label for line in lines] == ["soft", "stiff"]
        assert len({(line.color, line.dash) for line in lines}) == 2
        np.testing.assert_array_equal(lines[1].y, stiff["block.position[0]"])
        with pytest.raises(UsageError, match="at most"):
            soft.plot("block.position", others=[stiff] * 6)
    twice = holonom.Model.from_text(SPRING).simulate(end_time=0.1)
    labels = [line.label for line in twice.plot("spring.force", others=[twice]).panels[0].lines]
    assert labels == ["model (1)", "model (2)"]


def test_runs_of_different_models_are_drawn_in_what_they_share() -> None:
    two = """
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
arm = { mass = 1.0, inertia = 0.1, position = [1.0, 0.0] }
tip = { mass = 1.0, inertia = 0.1, position = [3.0, 0.0] }
[outputs]
channels = ["arm.position", "tip.position"]
[simulation]
end_time = 0.1
"""
    texts = [two, two.replace("tip", "end"), two.replace("tip", "end").replace("arm", "leg")]
    first, second, third = [
        holonom.Model.from_text(text, name=name).simulate()
        for text, name in zip(texts, "abc", strict=True)
    ]
    picture = first.plot(others=[second])
    assert [panel.title for panel in picture.panels] == ["arm.position, x", "arm.position, y"]
    assert "b has no tip.position" in picture.panels[0].note
    assert "tip" not in picture.panels[1].note
    for work, said in (
        (lambda: first.plot(others=[third]), "c has no `arm.position`, `tip.position`"),
        (lambda: first.plot("tip.position", others=[second]), "b has no `tip.position`"),
        (lambda: first.plot("end.position", others=[second]), "a has no `end.position`"),
        (
            lambda: first.plot("arm.position", versus="tip.angle", others=[second]),
            "b has no `tip.angle`",
        ),
    ):
        with pytest.raises(UsageError, match=said) as caught:
            work()
        assert "different models" in str(caught.value)
        assert caught.value.code == "simulation/unknown-channel"
    with pytest.raises(UsageError, match=r"no channel `arm\.positon`"):
        first.plot("arm.positon", others=[second])


def test_components_have_names() -> None:
    assert components("b.yaw_pitch_roll", 3) == ["yaw", "pitch", "roll"]
    assert components("b.deformation", 6) == ["x", "y", "z", "rx", "ry", "rz"]
    assert components("b.position", 2) == ["x", "y"]
    assert title("b.yaw_pitch_roll[1]", 3) == "b.yaw_pitch_roll, pitch"
    for name in ("hmmwv14", "hmmwv14_bushing", "slider_crank"):
        channels = holonom.Model.load(MODELS / name / "model.toml").channels
        for quantity in channels.values():
            assert not any("[" in c for c in components(quantity.name, quantity.size)), quantity


def test_lengths_and_angles_of_a_deformation_have_axes_of_their_own() -> None:
    result = holonom.Model.load(MODELS / "hmmwv14_bushing" / "model.toml").simulate(end_time=0.7)
    picture = result.plot("bushing_front_right.deformation")
    labels = {panel.label: [line.label for line in panel.lines] for panel in picture.panels}
    assert labels["m"] == ["x", "y", "z"]
    assert set("xyz").isdisjoint(labels["rad"])
    name = "bushing_front_right.deformation"
    for component, unit in ((2, "m"), (3, "rad")):
        assert result.plot(f"{name}[{component}]").panels[0].label == unit
        picture = result.plot("chassis.position[2]", versus=f"{name}[{component}]")
        word = ("x", "y", "z", "rx")[component]
        assert picture.label == f"{name}, {word}, {unit}"
    rates = result.plot(name, derivative=True)
    assert {panel.label for panel in rates.panels} == {"m/s", "rad/s"}
    spectra = result.plot(name, fft=True).panels
    assert [panel.label for panel in spectra] == ["amplitude, m", "amplitude, rad"]


def test_what_moves_less_than_ten_tolerances_is_not_shown_large() -> None:
    writer = Writer(None, META | {"options": {"tolerance": 1e-3}}, CHANNELS)
    chunk = synthetic_chunk(0, 200)
    noise = 1e-5 * np.random.default_rng(5).normal(size=(200, 2))
    chunk["channels"]["rod.position"] = np.array([0.3, 0.3]) + noise
    writer.append(chunk)
    writer.finish(SUMMARY)
    with Result(Reader.of(writer)) as result:
        (panel,) = result.plot("rod.position").panels
        # Ten times 1e-3 m and a thousandth of the movement.
        assert panel.least == pytest.approx(1e-2, rel=1e-2)
        assert "moves < 10 tolerances (0.01 m)" in panel.note
        root = ET.fromstring(svg.element(Picture("", [panel])))
        lines = [p.get("d", "") for p in root.iter(f"{SVG}path") if p.get("class") == "line"]
        heights = [float(p.split(" ")[1].split("L")[0]) for p in lines[0][1:].split("L")]
        assert np.ptp(heights) < 0.02 * 0.24 * svg.WIDTH  # 6e-5 m of 1e-2 m
        (kinetic,) = result.plot("energy.kinetic").panels
        assert kinetic.least == 0.0
        # Where it is cut out of a run, what moved before still moves.
        assert result.plot("energy.kinetic", start=0.0, end=0.02).panels[0].least == 0.0


def oscillation(periods: float, rows: int) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0.0, 1.0, rows)
    return t, np.exp(-3.0 * t) * np.sin(2.0 * np.pi * periods * t)


def test_what_would_be_a_bar_of_ink_is_its_range_and_mean() -> None:
    t, y = oscillation(3000.0, 60_001)
    found = envelope(t, y)
    assert found is not None
    x, low, high, mean = found
    # Independent truth: the envelope of the signal, e^{-3t}, within the width of a column.
    there = np.isfinite(high) & (x > 0.02) & (x < 0.98)
    np.testing.assert_allclose(high[there], np.exp(-3.0 * x[there]), rtol=0.02)
    np.testing.assert_allclose(low[there], -np.exp(-3.0 * x[there]), rtol=0.02)
    assert np.abs(mean[there]).max() < 0.05
    assert x.size <= COLUMNS
    picture = Picture("", [Panel([trace(t, y)], "m")])
    text = svg.element(picture)
    assert text.count('class="band"') == 1
    ink = sum(np.abs(np.diff(line_places(text), axis=0)).sum(axis=0))
    assert ink < 3.0 * svg.WIDTH  # not up and down in every column


def line_places(text: str) -> np.ndarray:
    root = ET.fromstring(text)
    (path,) = [p.get("d", "") for p in root.iter(f"{SVG}path") if p.get("class") == "line"]
    return np.array([p.split(" ") for p in path[1:].split("L")], dtype=float)


def test_what_can_be_drawn_stays_a_line() -> None:
    assert envelope(*oscillation(40.0, 60_001)) is None
    assert envelope(*oscillation(3000.0, 3)) is None
    t, y = oscillation(0.5, 100_000)
    y[777] += 3.0
    assert envelope(t, y) is None  # one spike is a line
    assert trace(t, y).y.max() == y.max()


def test_only_the_dense_part_is_a_range() -> None:
    t = np.linspace(0.0, 1.0, 40_001)
    y = np.where(t < 0.5, np.sin(2.0 * np.pi * 2000.0 * t), np.sin(2.0 * np.pi * 3.0 * t))
    found = envelope(t, y)
    assert found is not None
    x, low, _, line = found
    assert np.isfinite(low[x < 0.49]).all()
    assert np.isnan(low[x > 0.51]).all()
    calm = x > 0.51
    np.testing.assert_allclose(line[calm], np.sin(2.0 * np.pi * 3.0 * x[calm]), atol=1e-9)


@given(st.integers(0, 1000), st.floats(10.0, 1e4))
def test_ranges_hold_the_extremes(seed: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, 20_000)
    y = np.sin(2.0 * np.pi * rate * t) + rng.normal(scale=0.3, size=t.size)
    line = trace(t, y)
    ends = [line.y] if line.band is None else [line.y, line.band[1], line.band[2]]
    whole = np.concatenate(ends)
    assert np.nanmin(whole) == y.min()
    assert np.nanmax(whole) == y.max()


def test_a_way_loses_only_points_that_are_not_seen() -> None:
    t = np.linspace(0.0, 50.0, 200_000)
    x, y = np.cos(t), np.sin(2.0 * t)
    a, b = walked(x, y)
    assert a.size < 120_000
    nearest = np.abs(np.hypot(a[1:] - a[:-1], b[1:] - b[:-1]))
    assert nearest.max() < 5e-3


def test_angles_have_no_jump_before_they_are_differentiated() -> None:
    text = PENDULUM.replace('dimension = "planar"', 'dimension = "spatial"')
    text = text.replace("gravity = [0.0, -9.81]", "gravity = [0.0, 0.0, 0.0]")
    text = text.replace(
        "inertia = 0.1, position = [0.8, 0.0]",
        "inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.8, 0.0, 0.0]",
    )
    text = text.replace("point = [0.0, 0.0]", "point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0]")
    text += "[initial.bodies]\nrod = { angular_velocity = [0.0, 0.0, 9.0] }\n"
    result = holonom.Model.from_text(text).simulate(end_time=2.0)
    assert np.ptp(result["rod.yaw_pitch_roll[0]"]) < 2.0 * np.pi + 0.1
    (rate,) = curves(result, ["rod.yaw_pitch_roll[0]"], derivative=True)
    np.testing.assert_allclose(rate.values, 9.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"start": 5.0}, "covers 0 s to 2 s"),
        ({"start": 1.0, "end": 0.5}, "nothing of it lies"),
        ({"end": float("nan")}, "end"),
        ({"interval": -1.0}, "interval"),
        ({"interval": 1e-9}, "longer interval"),
        ({"low_pass": 0.0}, "low_pass"),
        ({"low_pass": 51.0}, "nothing from 50 Hz on"),
        ({"fft": "hanning"}, "hann"),
        ({"fft": True, "versus": "spring.force"}, "over frequencies"),
        ({"versus": "block.position"}, "more than one number"),
        ({"versus": "spring.forces"}, "did you mean"),
        ({"versus": 3}, "`3` is no channel"),
        ({"others": 3}, "`3` is no result"),
        ({"others": ["x"]}, "`'x'` is no result"),
        ({"labels": 3}, "`labels` is `3`"),
        ({"labels": "x"}, "`labels` is `'x'`"),
        ({"labels": ["a", "b"]}, "2 labels are given for 1 runs"),
    ],
)
def test_choices_that_are_none_are_refused(
    spring: Result, choices: dict[str, Any], said: str
) -> None:
    with pytest.raises(UsageError, match=said):
        spring.plot("block.position[0]", **choices)


def test_a_run_without_steps_has_nothing_between_its_rows() -> None:
    bare = holonom.Model.from_text(SPRING).simulate(
        end_time=1.0, dense_output=False, output_times=[0.0, 0.1, 0.3, 0.31, 0.7, 1.0]
    )
    with pytest.raises(UsageError, match="not evenly spaced"):
        bare.plot("block.position", fft=True)
    with pytest.raises(UsageError, match="no stored steps"):
        bare.plot("block.position", interval=0.01)


def test_matplotlib_draws_ranges_and_dashes(tmp_path: Path, spring: Result) -> None:
    pytest.importorskip("matplotlib")
    t, y = oscillation(3000.0, 60_001)
    picture = Picture("", [Panel([trace(t, y, dash="7 3")], "m", least=9.0)])
    (axes,) = picture.figure().axes
    assert len(axes.collections) == 1
    assert axes.lines[0].is_dashed()
    assert np.ptp(axes.get_ylim()) == pytest.approx(9.0)
    picture.save(tmp_path / "band.png")


def test_the_command_draws_runs_and_parts(stored: Path, tmp_path: Path) -> None:
    other, target = tmp_path / "other.holonom", tmp_path / "both.svg"
    with Result.load(stored) as result:
        result.save(other)
    line = ["plot", str(stored), str(other), "rod.position", "energy.kinetic", "--to", "1.0"]
    assert invoke([*line, "-o", str(target), "--label", "soft, 50 N/m", "--label", "stiff"]) == 0
    texts = {element.text for element in ET.parse(target).iter(f"{SVG}text")}
    assert {"soft, 50 N/m", "stiff"} < texts
    assert invoke([*line, "-o", str(target), "--label", "soft"]) == 1
    assert invoke([*line, "-o", str(target)]) == 0
    texts = ["".join(e.itertext()) for e in ET.parse(target).iter(f"{SVG}text")]
    assert texts.count("rod") == 3  # a panel for each component
    assert texts.count("other") == 3
    for extra in (["--fft", "--window", "flat_top"], ["--derivative", "--filter", "3"]):
        assert invoke(["plot", str(stored), "energy.kinetic", *extra]) == 0
    assert invoke(["plot", str(stored), "energy.kinetic", "--versus", "rod.position[0]"]) == 0
    assert invoke(["plot", str(stored), "energy.kinetic", "--window", "hann"]) == 1
    assert invoke(["plot", str(stored), str(other), "-o", str(other), "--force"]) == 1
    assert invoke(["plot", str(stored), str(tmp_path / "none.holonom")]) == 5


def test_the_range_of_an_angle_that_jumps_has_no_mean() -> None:
    # 12,000 rad are 1,910 turns, more than a picture has pixels: what it draws is the range.
    t = np.linspace(0.0, 10.0, 60_001)
    angle = (1200.0 * t + np.pi) % (2.0 * np.pi) - np.pi
    line = trace(t, angle, wraps=True)
    assert line.band is not None
    assert not np.isfinite(line.y).any()
    np.testing.assert_allclose(line.band[2], np.pi, rtol=0.05)
    # What stands still afterwards is a line there, and no jump is joined.
    angle[t > 5.0] = 1.0
    line = trace(t, angle, wraps=True)
    assert line.band is not None
    there = np.isfinite(line.y) & (line.x > 5.02)  # behind the pixels that hold both
    assert (line.y[there] == 1.0).all()
    assert line.x[there].min() < 5.1
    assert all(part.size == line.x.size for part in line.band)


def test_what_turns_often_is_not_dashed() -> None:
    for periods, dash in ((5.0, "7 3"), (40.0, "")):
        t, y = oscillation(periods, 10_001)
        assert trace(t, y, dash="7 3").dash == dash


def test_zero_is_told_as_zero() -> None:
    # By hand: a wheel that turns about z alone has neither pitch nor roll nor a reaction sideways.
    result = holonom.Model.from_text(TURNING).simulate(
        end_time=1.0, interval=0.01, channels=["wheel.yaw_pitch_roll", "wheel.position"]
    )
    angles, place = result.plot().panels
    assert angles.note.startswith("pitch, roll zero")
    assert place.note.startswith("zero")
    (one,) = result.plot("wheel.position[2]", others=[result]).panels
    assert one.note.startswith("zero")
