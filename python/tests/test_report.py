"""Reports, plots and CSV of made-up results, whose every number is known."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from conftest import CHANNELS, META, PENDULUM, SUMMARY, synthetic_chunk
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import holonom
from holonom.base.errors import FileError, UsageError
from holonom.pictures import runs as pictures
from holonom.pictures import svg
from holonom.pictures.picture import POINTS, thinned
from holonom.report import render
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

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.loaded += [v or "" for k, v in attrs if k in ("src", "href", "xlink:href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_report_is_one_well_formed_page_that_loads_nothing(stored: Path) -> None:
    with Result.load(stored) as result:
        text = render(result)
    page = Balance()
    page.feed(text)
    assert page.open == []
    assert not {"script", "link", "img", "iframe", "object"} & set(page.seen)
    assert all(target.startswith("#") for target in page.loaded)
    assert "@import" not in text
    assert "url(http" not in text
    figures = re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    assert len(figures) == 4  # one channel, steps, residuals, energy
    for figure in figures:
        ET.fromstring(figure)


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


def test_pages_and_pictures_hold_no_control_characters(tmp_path: Path) -> None:
    """`cat page.html` in a terminal obeys none; a script in a title is text."""
    title = "</script><script>alert(1)</script>\\u001b[31m\\u202eHolonom"
    text = PENDULUM.replace('title = "Rod on a pin"', f'title = "{title}"')
    assert text != PENDULUM
    result = holonom.Model.from_text(text).simulate(end_time=0.1)
    result.report(tmp_path / "report.html")
    result.view().save(tmp_path / "page.html")
    result.plot(path=tmp_path / "picture.svg")
    result.to_csv(tmp_path / "table.csv")
    for path in tmp_path.iterdir():
        written = path.read_text(encoding="utf-8")
        assert "\x1b" not in written, path
        assert "<script>alert" not in written, path
