"""Pictures: numbers along axes, lines where the values are, texts that cannot break out."""

from __future__ import annotations

import itertools
import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import holonom
from holonom.pictures import svg
from holonom.pictures.picture import MARKERS, Line, Panel, Picture, thinned
from holonom.pictures.runs import residuals
from holonom.pictures.ticks import limits, linear, logarithmic
from holonom.result import Result

SVG = "{http://www.w3.org/2000/svg}"
T = np.linspace(0.0, 2.0, 101)


def read(label: str) -> float:
    """Read a label as a person does."""
    plain = label.replace("−", "-").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    if "×" not in label and label[-1] in "⁰¹²³⁴⁵⁶⁷⁸⁹":
        return 10.0 ** float(plain.removeprefix("10"))
    digit, times, power = plain.partition("×10")
    return float(digit) * (10.0 ** float(power) if times else 1.0)


def factor(scale: str) -> tuple[float, float]:
    """Read what labels are multiplied by and added to."""
    found = re.fullmatch(r"(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))? ?(?:([+−]) ([\d.e+-]+))?", scale)
    assert found, scale
    power, sign, offset = found.groups()
    multiplier = read(f"1×10{power}") if power else 1.0
    return multiplier, (-1.0 if sign == "−" else 1.0) * float(offset or 0.0)


magnitudes = st.floats(-9, 9).map(lambda x: 10.0**x)


@given(st.floats(-1e6, 1e6), magnitudes, st.integers(2, 9))
def test_labels_say_where_their_ticks_are(middle: float, span: float, most: int) -> None:
    low, high = limits(middle - span / 2, middle + span / 2, logarithmic=False)
    ticks = linear(low, high, most)
    step = np.diff(ticks.values)
    assert 1 <= len(ticks.values) <= most
    assert all(low <= value <= high or math.isclose(value, low) for value in ticks.values)
    multiplier, offset = factor(ticks.scale)
    for value, label in zip(ticks.values, ticks.labels, strict=True):
        room = 1e-6 * (step[0] if step.size else span) + 1e-11 * abs(value)
        assert abs(read(label) * multiplier + offset - value) <= room, (label, ticks)
    assert len(set(ticks.labels)) == len(ticks.labels)
    assert not any("-" in label for label in ticks.labels)  # a minus is no hyphen
    # A sign, a point and six digits, or seven where steps are quarters.
    assert max(map(len, ticks.labels)) <= 9


@given(magnitudes, st.floats(0.0, 20.0), st.integers(2, 9))
def test_logarithmic_labels_say_where_their_ticks_are(
    low: float, decades: float, most: int
) -> None:
    ticks = logarithmic(*limits(low, low * 10.0**decades, logarithmic=True), most)
    assert len(ticks.values) >= 1
    for value, label in zip(ticks.values, ticks.labels, strict=True):
        assert read(label) == pytest.approx(value, rel=1e-9)


def test_ticks_by_hand() -> None:
    assert linear(-0.1, 2.1, 5).labels == ("0.0", "0.5", "1.0", "1.5", "2.0")
    assert linear(-3e-7, 3e-7, 5).labels == ("−200", "0", "200")
    assert linear(-3e-7, 3e-7, 5).scale == "×10⁻⁹"
    assert linear(1000.0, 1000.001, 3).scale == "×10⁻⁶ + 1000"
    assert logarithmic(0.5, 2e3, 6).labels == ("1", "10", "100", "1000")
    assert logarithmic(1e-9, 1e-1, 5).labels == ("10⁻⁸", "10⁻⁶", "10⁻⁴", "10⁻²")


def paths(text: str) -> list[np.ndarray]:
    """Return the points of the lines of a picture, piece by piece."""
    lines = [p.get("d", "") for p in ET.fromstring(text).iter(f"{SVG}path") if p.get("class")]
    pieces = [piece for line in lines for piece in line.split("M")[1:]]
    return [np.array([p.split(" ") for p in piece.split("L")], dtype=float) for piece in pieces]


def test_a_line_is_where_its_values_are() -> None:
    y = 3.0 * T - 1.0
    (points,) = paths(svg.element(Picture("", [Panel([Line(T, y)], "m")])))
    # Independent truth: a straight line stays one, and what rises goes up.
    fit = np.polyfit(points[:, 0], points[:, 1], 1)
    assert fit[0] < 0.0
    np.testing.assert_allclose(np.polyval(fit, points[:, 0]), points[:, 1], atol=0.02)
    assert points[0, 0] < 100.0
    assert points[-1, 0] > 0.9 * svg.WIDTH


def test_values_that_are_not_finite_interrupt_a_line() -> None:
    y = np.where((T > 0.5) & (T < 0.8), np.nan, T)
    y[-1] = np.inf
    pieces = paths(svg.element(Picture("", [Panel([Line(T, y)], "m")])))
    assert [len(piece) for piece in pieces] == [26, 60]


def test_a_spike_of_one_row_in_a_million_is_seen() -> None:
    t, y = np.linspace(0.0, 1.0, 1_000_000), np.zeros(1_000_000)
    y[123_456], y[700_000] = 5.0, np.nan
    x, thin = thinned(t, y)
    assert x.size < 3000
    assert np.nanmax(thin) == 5.0
    assert np.isnan(thin).sum() == 1
    text = svg.element(Picture("", [Panel([Line(x, thin)], "m")]))
    assert len(text) < 60_000
    assert len(paths(text)) == 2


@pytest.mark.parametrize(
    "name", ["</svg><script>", "a & b", '"quoted"', "\x1b[31mred\x00", "x" * 3000, "ʃ𝛼 −"]
)
def test_texts_cannot_break_out(name: str) -> None:
    lines = [Line(T, T, name), Line(T, -T, name, marker=MARKERS[1])]
    picture = Picture(name, [Panel(lines, name, name, name, level=(0.5, name))], name)
    for text in (svg.element(picture), svg.document(picture)):
        root = ET.fromstring(text)  # it is XML, whatever the name
        assert "script" not in {element.tag.removeprefix(SVG) for element in root.iter()}
        assert "\x1b" not in text
        longest = max(len("".join(e.itertext())) for e in root.iter(f"{SVG}text"))
        assert longest < 250


def test_no_numbers_overlap_and_nothing_leaves_the_picture() -> None:
    rng = np.random.default_rng(7)
    for scale in 10.0 ** rng.uniform(-12, 12, 40):
        offset = scale * 10.0 ** rng.uniform(-2, 8)
        panels = [Panel([Line(T, offset + scale * np.sin(k + T), f"y{k}")], "m") for k in (0, 1)]
        root = ET.fromstring(svg.element(Picture("", panels)))
        height = float(root.get("viewBox", "").split()[3])
        numbers = [e for e in root.iter(f"{SVG}text") if e.get("text-anchor") == "end"]
        for e in numbers:
            assert float(e.get("x", "")) - svg.text_width(e.text or "", 11.5) > 12.0
            assert 0.0 < float(e.get("y", "")) < height
        rows = sorted(float(e.get("y", "")) for e in numbers)
        assert min(np.diff(rows)) > 11.5


def test_a_picture_is_drawn_on_axes_of_ones_own(stored: Path) -> None:
    figure = pytest.importorskip("matplotlib.figure").Figure()
    one, two = figure.subplots(2)
    with Result.load(stored) as result:
        picture = result.plot("rod.position[0]", axes=one)
        assert len(picture.panels) == 1
        np.testing.assert_array_equal(one.lines[0].get_ydata(), result["rod.position[0]"])
        assert "m" in one.get_ylabel()
        with pytest.raises(holonom.UsageError, match="1 panels, and there are 2 axes"):
            result.plot("rod.position[0]", axes=[one, two])
        assert picture._repr_svg_().startswith("<svg")
        assert len(picture.figure().axes) == 1


def test_legends_of_matplotlib_cover_no_line() -> None:
    t = np.linspace(0.0, 1.0, 50)
    labels = ["x", "a run with a long name", "another run with a name that is longer still"]
    lines = [Line(t, np.sin(9.0 * t + k), label) for k, label in enumerate(labels)]
    panels = [Panel(lines, "m", "block.position", "ground axes"), Panel(lines[:1], "m", "y")]
    figure = Picture("test", panels).figure()
    figure.draw_without_rendering()
    for axes, count in zip(figure.axes, (3, 1), strict=True):
        legend = axes.get_legend()
        assert legend is not None
        assert len(legend.get_texts()) == count
        box = legend.get_window_extent()
        assert box.y0 >= axes.bbox.y1 - 0.5  # above the axes
        assert box.x1 <= figure.bbox.x1
        title = axes._left_title.get_window_extent()  # type: ignore[attr-defined]  # matplotlib has no other name
        assert title.y0 >= box.y1 - 3.0


def test_a_picture_is_one_line_where_no_notebook_shows_it() -> None:
    line = Line(np.arange(3.0), np.arange(3.0))
    assert repr(Picture("angle", [Panel([line], "rad")])) == "<picture 'angle': 1 panel>"
    assert repr(Picture("a\x1b[31m", [])) == r"<picture 'a\\x1b[31m': 0 panels>"


def test_residuals_that_are_zero_are_said_to_be(stored: Path) -> None:
    pytest.importorskip("matplotlib")
    with Result.load(stored) as result:
        result._kept["constraint.position"] = np.zeros(result.time.size)
        picture = residuals(result, ["constraint.position"])
    said = "all are exactly zero in every row"
    assert said in svg.element(picture)
    assert said in [text.get_text() for text in picture.figure().axes[0].texts]


@pytest.mark.parametrize(
    ("low", "high"), [(2e-4, 9e-3), (6e-4, 1.4e-3), (3e-4, 3.8e-4), (1e-9, 1e5)]
)
def test_logarithmic_labels_of_matplotlib_do_not_overlap(low: float, high: float) -> None:
    pytest.importorskip("matplotlib")
    x = np.geomspace(low, high, 9)
    picture = Picture("", [Panel([Line(x, x)], "s", logarithmic=True)], "s", logarithmic=True)
    figure = picture.figure()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    for axis, first, second in ((axes.xaxis, "x0", "x1"), (axes.yaxis, "y0", "y1")):
        ends = axis.get_view_interval()
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        shown = [
            t.label1 for t in ticks if ends[0] <= t.get_loc() <= ends[1] and t.label1.get_text()
        ]
        assert 2 <= len(shown) <= 10
        boxes = sorted(
            (label.get_window_extent() for label in shown), key=lambda b: getattr(b, first)
        )
        for one, other in itertools.pairwise(boxes):
            assert getattr(one, second) < getattr(other, first)
