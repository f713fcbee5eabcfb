"""Reports, plots and CSV of made-up results, whose every number is known."""

from __future__ import annotations

import base64
import csv
import gzip
import json
import re
import sqlite3
import subprocess
import sys
import xml.etree.ElementTree as ET
from contextlib import closing
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import (
    CHANNELS,
    META,
    MODELS,
    PENDULUM,
    SUMMARY,
    oscillator_text,
    synthetic_chunk,
    write_result,
)
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import holonom
from holonom.base.errors import FileError, UsageError
from holonom.pictures import runs as pictures
from holonom.pictures import svg
from holonom.pictures.picture import POINTS, Line, Panel, Picture, thinned
from holonom.report import page as report_page
from holonom.report import render
from holonom.report.extrema import extrema
from holonom.report.figures import MOST_POINTS, Figures
from holonom.report.graph import graph
from holonom.report.page import CHANNELS_DRAWN
from holonom.result import Result
from holonom.store.reader import Reader
from holonom.store.writer import Writer
from holonom.summary import summarize

VOID = {"meta", "br", "hr", "img", "link", "input"}
SVG = "{http://www.w3.org/2000/svg}"


class Balance(HTMLParser):
    """Fails when an element is closed that is not the innermost open one."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[str] = []
        self.loaded: list[str] = []
        self.headings: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.loaded += [v or "" for k, v in attrs if k in ("src", "href", "xlink:href", "srcdoc")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h2", "h3"):
            self.headings.append(data)


def balanced(text: str) -> Balance:
    page = Balance()
    page.feed(text)
    assert page.open == []
    return page


def carried(text: str, name: str) -> bytes:
    """Return what an element carries, compressed."""
    found = re.search(f'<script id="{name}" type="application/octet-stream">(.*?)</script>', text)
    assert found
    return gzip.decompress(base64.b64decode(found[1]))


def numbers(text: str) -> list[dict[str, Any]]:
    """Return the figures of a page with the numbers of their lines."""
    data = carried(text, "figures")
    length = int.from_bytes(data[:4], "little")
    figures: list[dict[str, Any]] = json.loads(data[4 : 4 + length])
    blob = data[4 + length :]
    for figure in figures:
        for line in (line for panel in figure["panels"] for line in panel["lines"]):
            x, y = line["x"], line["y"]
            line["x"] = np.frombuffer(blob[x : x + 8 * line["count"]], "<f8")
            line["y"] = line["base"] + np.frombuffer(blob[y : y + 4 * line["count"]], "<f4")
    return figures


def test_the_report_is_one_well_formed_page_that_loads_nothing(stored: Path) -> None:
    with Result.load(stored) as result:
        text = render(result)
    page = balanced(text)
    assert not {"img", "iframe", "object"} & set(page.seen)
    assert all(target.startswith(("#", "data:")) for target in page.loaded)
    assert "@import" not in text
    assert "url(http" not in text
    figures = re.findall(r'<div class="drawing"><svg.*?</svg>', text, flags=re.DOTALL)
    assert len(figures) == 4  # one channel, steps, residuals, energy
    for figure in re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL):
        if "${" not in figure:  # those of the program are made there
            ET.fromstring(figure)


def test_what_is_read_first_stands_first(tmp_path: Path) -> None:
    model = holonom.Model.from_text(PENDULUM + "[parameters]\nlength = { value = 0.8 }\n")
    text = render(model.simulate(certify=True))
    page = balanced(text)
    order = ["Motion", "Channels", "Extrema", "Model", "Warnings", "Measured error"]
    order += ["How it was computed", "Step size", "Constraint residuals", "Energy", "Statistics"]
    order += ["Provenance"]
    assert [heading for heading in page.headings if heading in order] == order
    folded = text[text.index("<details>") :]
    assert "Step size" in folded
    assert "Measured error" not in folded
    assert "length" in text[: text.index("<details>")]


def test_extrema_are_those_of_the_rows_with_their_times(stored: Path) -> None:
    with Result.load(stored) as result:
        text = render(result)
    section = text[text.index("Extrema") : text.index("<h2>Model")]
    cells = re.findall(r"<td[^>]*>(.*?)</td>", section)
    rows = [cells[k : k + 6] for k in range(0, len(cells), 6)]
    # By hand: sin t over 0 … 1.99 s is largest at 1.57 s, cos t falls.
    assert rows[0] == ["rod.position, x", "m", "0", "0", "1", "1.57"]
    assert (rows[1][0], rows[1][3]) == ("rod.position, y", "1.99")
    assert float(rows[1][2].replace("−", "-")) == pytest.approx(np.cos(1.99), rel=1e-5)
    assert rows[1][4:] == ["1", "0"]


def test_extrema_lie_between_rows_too() -> None:
    # x = 0.1 cos t and its rate; rows are 0.9 s apart, from 0 to 5.4 s.
    text = oscillator_text(mass=1.0, x=0.1, stiffness=1.0, free_length=1.0)
    names = ["block.position[0]", "block.velocity[0]"]
    model = holonom.Model.from_text(text)
    result = model.simulate(end_time=5.4, interval=0.9, tolerance=1e-10, channels=names)
    (place, rate), why = extrema(result, names)
    assert not why
    assert place.smallest[0] == pytest.approx([-0.1, np.pi], abs=1e-3)
    assert place.smallest[0, 0] == pytest.approx(-0.1, abs=1e-8)
    assert place.largest[0] == pytest.approx([0.1, 0.0], abs=1e-8)  # the first row
    assert rate.smallest[0, 0] == pytest.approx(-0.1, abs=1e-8)
    assert rate.smallest[0, 1] == pytest.approx(0.5 * np.pi, abs=1e-3)
    assert rate.largest[0] == pytest.approx([0.1, 1.5 * np.pi], abs=1e-3)
    assert "between the stored rows states are computed" in render(result)
    # Without steps the rows are all there is, and the page says so.
    rows = model.simulate(end_time=6.3, interval=0.9, channels=names, dense_output=False)
    (place, _), why = extrema(rows, names)
    assert "no steps" in why
    assert tuple(place.smallest[0]) == (rows[names[0]].min(), rows.time[rows[names[0]].argmin()])
    assert "Of the stored rows" in render(rows)


def test_the_highest_of_many_peaks_is_found() -> None:
    # A block bounces on a stop without loss: its peaks are all but equal, each a fraction of a row.
    text = oscillator_text(mass=1.0, x=0.5, stiffness=1.0, free_length=1.0)
    text = text.replace("gravity = [0.0, 0.0]", "gravity = [-9.81, 0.0]")
    law = "force = { x = [-0.5, -0.25, 0.0, 1.0], y = [-2000.0, -1000.0, 0.0, 0.0] }"
    model = holonom.Model.from_text(text.replace("stiffness = 1.0", law))
    names = ["spring.force", "block.acceleration[0]"]
    result = model.simulate(
        end_time=12.0, interval=0.5, tolerance=1e-6, max_step=0.1, channels=names
    )
    (force, acceleration), why = extrema(result, names)
    fine = result.sample(np.linspace(0.0, 12.0, 400_001), names)
    assert not why
    least = fine["spring.force"].min()
    assert force.smallest[0, 0] <= least + 1e-8 * abs(least)
    # Newton: where the force is largest, so is the acceleration.
    assert acceleration.largest[0, 0] == pytest.approx(-force.smallest[0, 0] - 9.81, rel=1e-8)


def test_no_extremum_of_the_vehicle_is_passed_over() -> None:
    names = ["tyre_front_right.vertical_force", "lower_ball_front_right.force"]
    model = holonom.Model.load(MODELS / "hmmwv14" / "model.toml")
    result = model.simulate(channels=names, interval=0.05)
    found, _ = extrema(result, names)
    fine = result.sample(np.linspace(0.0, 5.0, 20_001), names)
    for one in found:
        values = fine[one.curve.name].reshape(20_001, -1)
        room = 1e-4 * np.ptp(values, axis=0)
        assert np.all(one.largest[:, 0] >= values.max(axis=0) - room)
        assert np.all(one.smallest[:, 0] <= values.min(axis=0) + room)
        # They are values of the run at their times.
        for k, (value, time) in enumerate(one.largest):
            there = result.sample([time], [one.curve.name])[one.curve.name].reshape(-1)
            assert there[k] == pytest.approx(value, rel=1e-9)
        # The rows alone would miss them.
        assert np.any(result.matrix(one.curve.name).max(axis=0) < one.largest[:, 0] - 10.0 * room)


def test_the_page_has_the_numbers_of_its_figures(stored: Path) -> None:
    with Result.load(stored) as result:
        (figure, *_) = numbers(render(result))
    whole = synthetic_chunk(0, 200)
    lines = [line for panel in figure["panels"] for line in panel["lines"]]
    assert [line["label"] for line in lines] == ["x", "y"]
    for i, line in enumerate(lines):
        np.testing.assert_array_equal(line["x"], whole["time"])
        np.testing.assert_allclose(line["y"], whole["q"][:, i], atol=1e-7)


def test_small_numbers_keep_their_digits_along_a_logarithm() -> None:
    falls = 10.0 ** -np.linspace(0.0, 14.0, 50)
    panels = [
        Panel([Line(np.arange(50.0), falls)], "m", logarithmic=logs) for logs in (True, False)
    ]
    figures = Figures(2)
    figures.add(Picture("", panels), "")
    logarithmic, linear = (panel["lines"][0]["y"] for panel in numbers(figures.data())[0]["panels"])
    np.testing.assert_allclose(logarithmic, falls, rtol=1e-7)
    np.testing.assert_allclose(linear, falls, atol=1e-7)


def test_what_is_long_is_told_in_few_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "skin.stl").write_bytes((MODELS / "hmmwv14" / "body.stl").read_bytes())
    skin = 'shapes.skin = { type = "mesh", file = "skin.stl" }'
    text = PENDULUM.replace("position = [0.8, 0.0]", f"position = [0.8, 0.0], {skin}")
    (tmp_path / "model.toml").write_text(text)
    result = holonom.Model.load(tmp_path / "model.toml").simulate(
        output_times=np.linspace(0.0, 1.0, 101)
    )
    page = render(result)
    assert "56 faces, [" in page
    assert "101 output times, 0.0 to 1.0" in page
    model = page[page.index("<pre>") : page.index("</pre>")]
    assert model.count("\n") < 100
    monkeypatch.setattr(report_page, "EVENTS_TOLD", 3)
    write_result(tmp_path / "rod.holonom").close()
    with Result.load(tmp_path / "rod.holonom") as stored:
        page = render(stored)
    assert "The first 3 of 4 events" in page
    assert page.count("breakpoint") == 3


def test_the_size_of_a_page_is_bounded() -> None:
    model = holonom.Model.from_text(PENDULUM)
    names = ["rod.position", "rod.velocity", "rod.acceleration", "pin.force", "energy.*"]
    result = model.simulate(end_time=10.0, interval=5e-5, channels=names)
    assert result.time.size > 200_000
    text = render(result)
    assert len(text) < 8_000_000
    counts = [line["count"] for f in numbers(text) for p in f["panels"] for line in p["lines"]]
    assert sum(counts) < 1.2 * MOST_POINTS
    drawn = numbers(text)[0]["panels"][0]["lines"][0]["y"]
    truth = result["rod.position[0]"]
    np.testing.assert_allclose([drawn.min(), drawn.max()], [truth.min(), truth.max()], rtol=1e-6)


def test_the_graph_tells_freedoms_loops_and_redundancy() -> None:
    four_bar = holonom.Model.load(MODELS / "slider_crank" / "model.toml")
    picture, facts = graph(four_bar.simulate(end_time=0.1))
    root = ET.fromstring(picture)
    texts = ["".join(e.itertext()) for e in root.iter(f"{SVG}text")]
    assert {"ground", "crank", "rod", "slider"} <= set(texts)
    assert texts.count("revolute · 1") == 2  # the third closes the loop
    assert "wrist: revolute · 1" in texts
    assert dict(facts)["degrees of freedom"] == "1"
    assert dict(facts)["closed loops"] == "1"
    assert dict(facts)["redundant constraints"] == "none"
    # A door on two hinges: five of their rows are one too many.
    door = """
holonom = 1
dimension = "spatial"
[bodies.door]
mass = 20.0
inertia = [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 2.0]]
position = [0.5, 0.0, 0.0]
[joints.low]
type = "revolute"
between = ["ground", "door"]
point = [0.0, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
[joints.high]
type = "revolute"
between = ["ground", "door"]
point = [0.0, 0.0, 1.0]
axis = [0.0, 0.0, 1.0]
"""
    picture, facts = graph(holonom.Model.from_text(door).simulate(end_time=0.1))
    assert re.search("high|low", dict(facts)["redundant constraints"])
    assert ", redundant" in picture
    assert dict(facts)["degrees of freedom"] == "1"


def test_a_long_chain_is_drawn_as_few_boxes() -> None:
    chain = holonom.Model.load(MODELS / "chain50" / "model.toml")
    picture, _ = graph(chain.simulate(end_time=0.01))
    root = ET.fromstring(picture)
    assert len(list(root.iter(f"{SVG}rect"))) < 5
    assert "link_01 … link_50 (50)" in picture


def test_what_cannot_be_shown_in_motion_is_left_out_with_its_reason(stored: Path) -> None:
    with Result.load(stored) as result:
        result.meta["model"]["bodies"]["rod"]["mass"] = "heavy"
        text = render(result)
    balanced(text)
    assert "There is no picture of the mechanism" in text
    assert "rod.position" in text


def test_the_report_says_what_the_result_holds(stored: Path) -> None:
    with Result.load(stored) as result:
        text = render(result)
    for expected in (
        "Rod &lt;on&gt; a pin",
        "completed",
        "180 accepted, 20 rejected (error 20)",
        "0.101 s per simulated second",  # 0.2 s for the 1.99 s that are stored
        "2.0e-15",
        "looks like grams [model/implausible]",
        "0123456789abcdef",
        "breakpoint",
        "seconds, newton",
    ):
        assert expected in text, expected


def test_the_end_of_a_run_need_be_no_row(pendulum: Path, tmp_path: Path) -> None:
    model = holonom.Model.load(pendulum)
    path, truth = tmp_path / "rod.holonom", model.simulate()
    result = model.simulate(output_times=[0.3, 0.6], output=path)
    assert (result.until, result.time[-1]) == (1.0, 0.6)
    said, energy = dict(summarize(result)), result.energy
    assert said["status"] == "completed at 1 s"
    assert "1 s>" in repr(result)
    kinetic = truth["energy.kinetic"][-1]
    assert energy.kinetic == pytest.approx(kinetic, rel=1e-9)
    assert f"kinetic {kinetic:.4g}, " in said["energy at the end, J"]
    spent = result.meta["cpu_seconds"]
    assert f"{spent:.3g} s per simulated second" in said["processor time"]
    # The first row is not the start: what the imbalance is then is no offset of it.
    assert said["energy imbalance"].startswith(f"{energy.largest_imbalance:.2e} J at most, ")
    page = render(result)
    for wanted in (
        "<b>1 s</b><span>simulated",
        "0 to 1 s",
        f"<b>{energy.largest_imbalance:.1e} J</b><span>largest energy imbalance",
    ):
        assert wanted in page
    # One that goes on and is cut off has come to its last row.

    def fail(rows: dict[str, np.ndarray]) -> None:
        if rows["time"].size and rows["time"][-1] > 1.0:
            raise RuntimeError

    with model.simulate(output=path) as result, pytest.raises(RuntimeError):
        model.simulate(start=result.state(), output=path, end_time=2.0, rows=fail)
    with Result.load(path) as result:
        assert result.status == "killed"
        assert result.until == result.time[-1] > 1.0
        said = dict(summarize(result))
        last = result["energy.kinetic"][-1]
        assert said["energy at the end, J"].startswith(f"kinetic {last:.4g}, ")


def test_rows_that_are_lost_are_no_part_of_an_energy(pendulum: Path, tmp_path: Path) -> None:
    path = tmp_path / "rod.holonom"
    with holonom.Model.load(pendulum).simulate(output=path) as result:
        names = list(result.quantities)
        expected = dict(summarize(result))["energy at the end, J"]
        at_steps = result.energy.largest_imbalance
    with closing(sqlite3.connect(path)) as db:
        for name in ("energy.imbalance", "energy.kinetic"):
            change = "UPDATE data SET blob = zeroblob(length(blob)) WHERE quantity = ?"
            assert db.execute(change, (1 + names.index(name),)).rowcount
        db.commit()
    with Result.load(path, recover=True) as result:
        assert np.isnan(result["energy.imbalance"]).all()
        said = dict(summarize(result))
        assert said["energy at the end, J"] == expected
        assert said["energy imbalance"].startswith(f"{at_steps:.2e} J at most, ")
        assert f"<b>{at_steps:.1e} J</b><span>largest energy imbalance" in render(result)


def test_every_rejected_step_is_marked(stored: Path) -> None:
    with Result.load(stored) as result:
        picture = ET.fromstring(svg.element(pictures.step_sizes(result.steps)))
    crosses = [g for g in picture.iter(f"{SVG}g") if g.get("class") == "cross"]
    assert all(g.get("stroke") == pictures.REJECTED for g in crosses)
    legend = 1
    assert sum(len(g) for g in crosses) == 20 + legend


def test_pictures_take_the_ink_of_their_page(stored: Path) -> None:
    with Result.load(stored) as result:
        text = svg.element(pictures.channels(result, ["rod.position"]))
    assert "currentColor" in text
    assert svg._INK not in text
    assert "rod.position" in text  # text is text, not outlines


def test_the_same_result_gives_the_same_picture(stored: Path, tmp_path: Path) -> None:
    pictures = []
    for name in ("a.svg", "b.svg"):
        with Result.load(stored) as result:
            result.plot("rod.position", "energy.*", path=tmp_path / name)
        pictures.append((tmp_path / name).read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize("ending", [".svg", ".pdf", ".png"])
def test_pictures_are_written_by_their_ending(stored: Path, tmp_path: Path, ending: str) -> None:
    target = tmp_path / "new" / f"picture{ending}"
    with Result.load(stored) as result:
        result.plot(path=target)
    start = {".svg": b"<svg", ".pdf": b"%PDF", ".png": b"\x89PNG"}[ending]
    assert target.read_bytes().startswith(start)


def test_an_unknown_picture_format_is_refused_with_the_known_ones(stored: Path) -> None:
    with Result.load(stored) as result, pytest.raises(UsageError, match=r"\.svg"):
        result.plot("rod.position", path="picture.doc")


@pytest.mark.parametrize("status", ["failed", "interrupted", "limit", "running", "killed"])
def test_an_early_end_is_told_with_its_reason(tmp_path: Path, status: str) -> None:
    writer = Writer(tmp_path / "rod.holonom", META, CHANNELS)
    writer.append(synthetic_chunk(0, 50))
    reason = {"code": "simulation/newton-divergence", "message": "gave up", "item": "forces.b"}
    writer.finish(SUMMARY | {"status": status, "stop_reason": reason})
    with Result(Reader.of(writer)) as result:
        text = render(result)
        assert "gave up [simulation/newton-divergence]" in text
        assert "item: forces.b" in text
        assert dict(summarize(result))["status"].endswith("at 0.49 s")


def test_a_run_that_stored_nothing_still_has_a_report(tmp_path: Path) -> None:
    writer = Writer(tmp_path / "rod.holonom", META, CHANNELS)
    writer.finish({"status": "failed", "stop_reason": {"code": "simulation/x", "message": "no"}})
    with Result(Reader.of(writer)) as result:
        assert "nothing stored" in render(result)


def test_a_report_that_cannot_be_written_names_its_file(stored: Path) -> None:
    with Result.load(stored) as result, pytest.raises(FileError, match=re.escape(stored.name)):
        result.report(stored / "report.html")  # a file where a folder is needed


def test_small_movements_get_a_plot_of_their_own() -> None:
    t = np.linspace(0.0, 1.0, 50)
    travel = np.stack([10.0 * t, np.zeros(50), 0.1 * np.sin(t)], axis=1)
    assert pictures.grouped(travel) == [[0, 1], [2]]
    assert pictures.grouped(travel[:, :1]) == [[0]]
    assert pictures.grouped(np.stack([0.45 + 0.004 * t, 0.0 * t], axis=1)) == [[0], [1]]
    assert pictures.grouped(np.zeros((5, 3))) == [[0, 1, 2]]


def test_a_component_is_a_channel_of_its_own(stored: Path) -> None:
    with Result.load(stored) as result:
        np.testing.assert_array_equal(result["rod.position[1]"], result["rod.position"][:, 1])
        assert result.unit("rod.position[1]") == "m"
        assert result.expand(["rod.position[1]"]) == ["rod.position[1]"]
        result.plot("rod.position[1]")
        with pytest.raises(UsageError, match="no component 2"):
            result["rod.position[2]"]
        with pytest.raises(UsageError, match="no component 0"):
            result["energy.kinetic[0]"]


def test_csv_reads_back_the_same_numbers(stored: Path, tmp_path: Path) -> None:
    with Result.load(stored) as result:
        path = result.to_csv(tmp_path / "rod.csv", ["energy.kinetic", "rod.position"])
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == [
        "time (s)",
        "energy.kinetic (J)",
        "rod.position[0] (m)",
        "rod.position[1] (m)",
    ]
    whole = synthetic_chunk(0, 200)
    columns = [
        whole["time"],
        whole["channels"]["energy.kinetic"],
        whole["q"][:, 0],
        whole["q"][:, 1],
    ]
    np.testing.assert_array_equal(np.array(rows, dtype=float), np.column_stack(columns))


finite = st.floats(-1e6, 1e6)


@given(arrays(float, st.integers(2, 20000), elements=finite, fill=finite))
def test_thinning_keeps_ends_and_extremes(values: np.ndarray) -> None:
    t = np.arange(values.size, dtype=float)
    thin_t, thin = thinned(t, values)
    assert thin_t.size <= POINTS + 2
    assert (thin.min(), thin.max()) == (values.min(), values.max())
    assert (thin_t[0], thin_t[-1]) == (t[0], t[-1])
    np.testing.assert_array_equal(thin, values[thin_t.astype(int)])


#: Runs a command line in an interpreter without libraries that a plain install lacks.
PLAIN = """
import sys
for name in ("matplotlib", "pandas", "xarray", "scipy"):
    sys.modules[name] = None
from holonom.cli.commands import invoke
sys.exit(invoke(sys.argv[1:]))
"""


def plain(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PLAIN, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


def test_a_plain_install_plots_and_reports(stored: Path, tmp_path: Path) -> None:
    for command, target in (("plot", "rod.svg"), ("report", "rod.html")):
        done = plain(command, stored, "-o", tmp_path / target)
        assert (done.returncode, done.stderr) == (0, "")
        assert "<svg" in (tmp_path / target).read_text(encoding="utf-8")


def test_what_needs_matplotlib_names_the_extra_and_what_does_not(stored: Path) -> None:
    done = plain("plot", stored, "-o", stored.with_suffix(".png"))
    assert done.returncode == 1
    assert "extra `plot`" in done.stderr
    assert ".svg" in done.stderr
    assert "Traceback" not in done.stderr


def test_many_channels_are_told_in_numbers() -> None:
    model = holonom.Model.load(MODELS / "hmmwv14" / "model.toml")
    result = model.simulate(end_time=0.2, channels=["*"])
    text = render(result)
    assert len(text) < 4_000_000
    assert text.count('<figure class="plot"') == CHANNELS_DRAWN + 3
    assert f"The first {CHANNELS_DRAWN} of {len(result.requested)} channels" in text
    assert all(name.partition("[")[0] in text for name in result.requested)


def test_residuals_that_are_exactly_zero_are_told(tmp_path: Path) -> None:
    # A block at rest along an axis of the ground: every row of the guide is zero as it is computed.
    text = oscillator_text(mass=1.0, x=0.0, stiffness=100.0, free_length=1.0)
    result = holonom.Model.from_text(text).simulate(end_time=0.1)
    assert not any(result[name].any() for name in result.channels if "constraint" in name)
    page = result.report(tmp_path / "rest.html").read_text(encoding="utf-8")
    assert "All are exactly zero at every output time." in page
