"""The 3-D page of 200 bodies in 50,000 rows: how it is made, and how it runs in software.

Run with the package and its extra ``dev`` installed, Chromium and chromedriver on the search path:
``python benchmarks/large_page/run.py``.
"""

import csv
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent
END, ROWS = 50.0, 50_000

#: A chain that swings, and rotors that turn with 2 to 100 rad/s.
MODEL = """
holonom = 1
title = "a chain of 150 links and 50 rotors"
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[patterns.chain]
over.i = { from = 1, to = 150 }
bodies."link_{i}" = { position = ["=(i - 0.5)/10", 0.0, 0.0], shapes.rod = { type = "capsule",
  radius = 0.02, points_in_body = [[-0.05, 0.0, 0.0], [0.05, 0.0, 0.0]], density = 800.0 } }
joints."joint_{i}" = { type = "revolute", between = ["link_{i - 1}", "link_{i}"],
  points_in_body = [[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]], axis = [0.0, "=i % 2", "=1 - i % 2"] }
forces."spring_{i}" = { type = "rsda", between = ["link_{i - 1}", "link_{i}"],
  axis = [0.0, "=i % 2", "=1 - i % 2"], stiffness = 20.0, damping = 0.1 }
[joints]
joint_1 = { between = ["ground", "link_1"], points_in_body = [[0.0, 0.0, 0.0], [-0.05, 0.0, 0.0]] }
[forces]
spring_1 = { between = ["ground", "link_1"] }
[patterns.rotors]
over.k = { from = 1, to = 50 }
bodies."rotor_{k}" = { position = ["=0.3*k", 2.0, 0.0], shapes.bar = { type = "box",
  size = [0.2, 0.05, 0.05], density = 800.0 } }
joints."bearing_{k}" = { type = "revolute", between = ["ground", "rotor_{k}"],
  points_in_body = [["=0.3*k", 2.0, 0.0], [0.0, 0.0, 0.0]], axis = [0.0, 1.0, 0.0] }
initial.bodies."rotor_{k}" = { angular_velocity = [0.0, "=2*k", 0.0] }
"""


def simulate(path: str) -> dict[str, float]:
    """Write the result file."""
    import holonom

    model = holonom.Model.from_text(MODEL)
    model.simulate(end_time=END, interval=END / ROWS, tolerance=1e-3, output=path).close()
    return {"result, MB": Path(path).stat().st_size / 1e6}


def make_page(path: str) -> dict[str, float]:
    """Write the page of a result file."""
    import holonom

    begin = time.perf_counter()
    with holonom.Result.load(path) as result:
        page = result.view().save(Path(path).with_suffix(".html"))
    seconds = time.perf_counter() - begin
    text = page.read_text(encoding="utf-8").partition('type="application/json">')[2]
    (run,) = json.loads(text.partition("</script>")[0])["runs"]
    return {
        "making the page, s": seconds,
        "peak memory, MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6,
        "page, MB": page.stat().st_size / 1e6,
        "drawn within, m": run["missed"][0],
        "drawn within, rad": run["missed"][1],
        "size of the mechanism, m": run["size"],
    }


def show(path: str) -> dict[str, float]:
    """Open the page in Chromium without a window, at 1280x720, and play it."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for flag in ("headless=new", "no-sandbox", "enable-unsafe-swiftshader"):
        options.add_argument(f"--{flag}")
    service = webdriver.ChromeService(str(shutil.which("chromedriver")))
    browser = webdriver.Chrome(options=options, service=service)
    size = {"width": 1280, "height": 720, "deviceScaleFactor": 1, "mobile": False}
    try:
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        begin = time.perf_counter()
        browser.get(Path(path).with_suffix(".html").as_uri())
        while not browser.execute_script("return window.holonom?.drawn > 0"):
            time.sleep(0.02)
        seconds = time.perf_counter() - begin
        browser.execute_script("holonom.play(true)")
        time.sleep(4.0)  # the page finds the resolution that it can hold
        rates = []
        for _ in range(4):
            first = browser.execute_script("return [holonom.drawn, performance.now()]")
            time.sleep(3.0)
            last = browser.execute_script("return [holonom.drawn, performance.now()]")
            rates.append(1000.0 * (last[0] - first[0]) / (last[1] - first[1]))
    finally:
        browser.quit()
    return {"first picture, s": seconds, "frames per second": max(rates)}


PARTS = {"simulate": simulate, "page": make_page, "show": show}


def main() -> None:
    """Do each part in a process of its own; write the table."""
    if len(sys.argv) == 3:
        print(json.dumps(PARTS[sys.argv[1]](sys.argv[2])))
        return
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for part in PARTS:
            command = [sys.executable, __file__, part, f"{folder}/large.holonom"]
            found = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            figures |= json.loads(found.splitlines()[-1])
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["figure", "value"])
        for name, value in figures.items():
            writer.writerow([name, f"{value:.3g}"])
            print(f"{name}: {value:.3g}")


if __name__ == "__main__":
    main()
