"""The report in a browser: cursor, zoom, the 3-D view in it, a telephone's width, paper."""

from __future__ import annotations

from pathlib import Path

import pytest
from browsers import Browser
from conftest import MODELS, oscillator_text

import holonom
from holonom.result import Result

pytestmark = pytest.mark.browser

POINT = """
const [figure, part, kind, more] = arguments;
const axes = document.querySelectorAll('.plot')[figure].querySelector('.axes');
axes.scrollIntoView({block: 'center'});
const box = axes.getBoundingClientRect();
const cut = [...axes.querySelectorAll('clipPath rect')][0];
const x = box.left + Number(cut.getAttribute('x')) + part * Number(cut.getAttribute('width'));
return [x, box.top + 40];
"""
RANGE = "return document.getElementById('range').textContent"
READ = (
    "return [...document.querySelectorAll('.plot')[arguments[0]].querySelectorAll('.key output')]"
    ".map((one) => one.textContent)"
)


@pytest.fixture(scope="module")
def vehicle() -> Result:
    return holonom.Model.load(MODELS / "hmmwv14" / "model.toml").simulate()


def show(
    browser: Browser, result: Result, path: Path, width: int = 1100, height: int = 900
) -> None:
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.driver.get(result.report(path).as_uri())
    browser.wait("return document.documentElement.dataset.ready === 'true'")


def mouse(browser: Browser, kind: str, x: float, y: float, button: str = "none") -> None:
    event = {"type": kind, "x": x, "y": y, "button": button, "clickCount": 1}
    browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)


def number(text: str) -> float:
    return float(text.replace("−", "-"))


def test_the_report_asks_nobody_and_has_nothing_to_complain_of(
    browser: Browser, vehicle: Result, tmp_path: Path
) -> None:
    browser.requests()
    show(browser, vehicle, tmp_path / "vehicle.html")
    assert (tmp_path / "vehicle.html").stat().st_size < 3_000_000
    browser.run("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    browser.wait("return document.querySelectorAll('.plot .axes svg').length > 20")
    assert {url.partition(":")[0] for url in browser.requests()} <= {"file", "data", "chrome"}
    assert browser.complaints() == []


def test_the_cursor_tells_the_values_of_all_figures(
    browser: Browser, vehicle: Result, tmp_path: Path
) -> None:
    show(browser, vehicle, tmp_path / "vehicle.html")
    mouse(browser, "mouseMoved", *browser.run(POINT, 0, 0.4))
    moment = number(browser.run(RANGE)[:-2])
    assert moment == pytest.approx(2.0, abs=0.01)
    truth = vehicle.sample([moment], ["chassis.position", "chassis.velocity"])
    for figure, name in ((0, "chassis.position"), (1, "chassis.velocity")):
        told = [number(text) for text in browser.run(READ, figure)]
        assert told == pytest.approx(list(truth[name][0]), abs=2e-3)
    shown = browser.run(
        "return [...document.querySelectorAll('.cursor')].map((c) => c.style.display)"
    )
    assert set(shown[:4]) == {"block"}
    browser.run("document.querySelector('.drawing').focus()")
    for _ in range(3):
        browser.run(
            "document.activeElement.dispatchEvent(new KeyboardEvent('keydown',"
            "{key: 'ArrowRight', bubbles: true}))"
        )
    later = number(browser.run(RANGE)[:-2])
    assert 0.0 < later - moment < 0.2


def test_a_part_is_drawn_larger_and_the_whole_again(
    browser: Browser, vehicle: Result, tmp_path: Path
) -> None:
    show(browser, vehicle, tmp_path / "vehicle.html")
    heights = (
        "return [...document.querySelectorAll('.plot')[0].querySelectorAll('.axes')[1]"
        ".querySelectorAll('text')].map((one) => one.textContent)"
    )
    before = browser.run(heights)
    (a, y), (b, _) = (browser.run(POINT, 0, part) for part in (0.5, 0.7))
    mouse(browser, "mouseMoved", a, y)
    mouse(browser, "mousePressed", a, y, "left")
    for x in (0.5 * (a + b), b):
        mouse(browser, "mouseMoved", x, y, "left")
    mouse(browser, "mouseReleased", b, y, "left")
    mouse(browser, "mouseMoved", 1.0, 1.0)
    first, last = browser.run(RANGE)[:-2].split(" to ")
    assert (number(first), number(last)) == pytest.approx((2.5, 3.5), abs=0.03)
    assert browser.run(heights) != before  # the height of the chassis has axes of its own again
    browser.run("document.querySelector('[data-zoom=\"0\"]').click()")
    assert browser.run(RANGE) == "0 to 5 s"
    assert browser.run(heights) == before
    browser.run("document.querySelector('[data-zoom=\"0.5\"]').click()")
    assert browser.run(RANGE) == "1.25 to 3.75 s"
    for _ in range(18):
        browser.run("document.querySelector('[data-zoom=\"0.5\"]').click()")
    first, last = browser.run(RANGE)[:-2].split(" to ")
    assert number(last) - number(first) == pytest.approx(5.0 / 2**19, rel=1e-3)
    assert browser.complaints() == []


def test_the_mechanism_moves_in_the_report_and_the_cursor_with_it(
    browser: Browser, vehicle: Result, tmp_path: Path
) -> None:
    show(browser, vehicle, tmp_path / "vehicle.html")
    browser.requests()
    browser.run("document.getElementById('play').click()")
    inside = "document.querySelector('iframe')?.contentWindow.holonom"
    browser.wait(f"return {inside}?.playing && {inside}.time > 0.2")
    browser.wait("return document.querySelector('.cursor').style.display === 'block'")
    browser.run(f"{inside}.play(false)")
    mouse(browser, "mouseMoved", *browser.run(POINT, 0, 0.8))
    browser.wait(f"return Math.abs({inside}.time - 4.0) < 0.02")
    assert {url.partition(":")[0] for url in browser.requests()} <= {"file", "data", "about"}
    assert browser.complaints() == []


@pytest.mark.parametrize("name", ["hmmwv14", "chain50", "slider_crank"])
def test_a_telephone_shows_the_report_without_moving_it_sideways(
    browser: Browser, tmp_path: Path, name: str
) -> None:
    result = holonom.Model.load(MODELS / name / "model.toml").simulate(certify=True)
    show(browser, result, tmp_path / f"{name}.html", 400, 800)
    browser.run("document.querySelectorAll('details').forEach((one) => (one.open = true))")
    assert browser.run("return document.documentElement.scrollWidth") <= 400
    sizes = browser.run(
        "return [...document.querySelectorAll('.axes text')]"
        ".map((one) => one.getBoundingClientRect().height).filter((h) => h > 0)"
    )
    assert min(sizes) > 10.0  # pixels of text that is read
    assert browser.complaints() == []


def test_a_long_signal_is_a_range_and_becomes_a_line_when_looked_into(
    browser: Browser, tmp_path: Path
) -> None:
    text = oscillator_text(mass=1.0, x=0.2, stiffness=1e5, free_length=1.0)
    result = holonom.Model.from_text(text).simulate(
        end_time=60.0, interval=2e-3, channels=["block.position[0]"]
    )
    show(browser, result, tmp_path / "long.html")
    bands = "return document.querySelectorAll('.plot')[0].querySelectorAll('path.band').length"
    ink = "return document.querySelectorAll('.plot')[0].querySelector('path.line').getTotalLength()"
    assert browser.run(bands) == 1
    assert browser.run(ink) < 3000  # pixels: it does not go up and down
    for _ in range(7):  # to half a second, with 25 periods
        browser.run("document.querySelector('[data-zoom=\"0.5\"]').click()")
    assert browser.run(bands) == 0
    assert browser.run(ink) > 3000


def test_on_paper_nothing_is_folded_and_the_picture_stands(
    browser: Browser, vehicle: Result, tmp_path: Path
) -> None:
    show(browser, vehicle, tmp_path / "vehicle.html")
    browser.run("document.getElementById('play').click()")
    browser.wait("return document.querySelector('iframe')?.contentWindow.holonom")
    browser.run(
        "window.told = null; window.addEventListener('beforeprint', () => { window.told = "
        "[...document.querySelectorAll('details:not(.text)')].every((one) => one.open); })"
    )
    browser.driver.execute_cdp_cmd("Page.printToPDF", {})
    assert browser.run("return window.told") is True
    assert browser.run("return document.querySelectorAll('details[open]').length") == 0
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert browser.run("return getComputedStyle(document.querySelector('iframe')).display") == (
            "none"
        )
        assert browser.run("return document.getElementById('poster').clientHeight") > 100
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_the_page_draws_a_range_where_a_curve_would_be_ink(
    browser: Browser, tmp_path: Path
) -> None:
    text = oscillator_text(mass=1.0, x=0.2, stiffness=1e5, free_length=1.0)
    model = holonom.Model.from_text(text.replace("stiffness = 100000.0", "stiffness = 1e5"))
    result = model.simulate(end_time=60.0, interval=2e-3, channels=["block.position[0]"])
    browser.open(result.view(), tmp_path / "long.html")
    alphas = """
const c = document.querySelector('.plot canvas');
const data = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
let faint = 0, full = 0;
for (let k = 3; k < data.length; k += 4) {
  if (data[k] > 230) full++;
  else if (data[k] > 50 && data[k] < 90) faint++;
}
return [faint, full, c.width * c.height];
"""
    faint, full, whole = browser.run(alphas)
    assert faint > 0.3 * whole  # the range from -0.2 to 0.2 m, 28 % strong
    assert full < 0.1 * whole  # the mean, and numbers along the axes
