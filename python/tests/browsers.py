"""Chromium without a window, for tests of pages."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from holonom.view import View


class Browser:
    """Chromium without a window, and what it said."""

    def __init__(self, profile: Path, *, listening: bool = True) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        options = webdriver.ChromeOptions()
        options.binary_location = str(shutil.which("chromium"))
        for flag in (
            "headless=new", "no-sandbox", "disable-dev-shm-usage", "enable-unsafe-swiftshader",
            "disable-background-networking", "no-first-run", f"user-data-dir={profile}",
        ):  # fmt: skip
            options.add_argument(f"--{flag}")
        if listening:  # to the network, too, which slows the page down
            logs = {"browser": "ALL", "performance": "ALL"}
            options.set_capability("goog:loggingPrefs", logs)
        service = Service(str(shutil.which("chromedriver")))
        self.driver = webdriver.Chrome(options=options, service=service)

    def open(self, view: View, path: Path, width: int = 1280, height: int = 720) -> None:
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        self.get(view.save(path).as_uri())

    def get(self, address: str) -> None:
        self.driver.get(address)
        self.wait("return document.documentElement.dataset.ready === 'true'")
        self.wait("return holonom.drawn > 0")

    def run(self, script: str, *values: Any) -> Any:
        return self.driver.execute_script(script, *values)

    def wait(self, script: str, seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not self.run(script):
            assert time.monotonic() < end, f"not within {seconds} s: {script}"
            time.sleep(0.05)

    def picture(self) -> bytes:
        from selenium.webdriver.common.by import By

        return self.driver.find_element(By.ID, "stage").screenshot_as_png

    def click(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            event = {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1}
            self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def complaints(self) -> list[str]:
        # Reading pixels for a screenshot is slow in software, and Chromium says so.
        said = [e["message"] for e in self.driver.get_log("browser")]
        return [text for text in said if "GPU stall due to ReadPixels" not in text]

    def requests(self) -> list[str]:
        events = [json.loads(e["message"])["message"] for e in self.driver.get_log("performance")]
        sent = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
        return [s["request"]["url"] for s in sent]


def require_browser() -> None:
    """Skip a test where there is no browser, or fail where one is required."""
    missing = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    if missing:
        text = f"{' and '.join(missing)} not found: the page is not shown in a browser"
        if os.environ.get("HOLONOM_BROWSER") == "required":
            pytest.fail(text)
        pytest.skip(text)


def one_browser(profile: Path) -> Iterator[Browser]:
    require_browser()
    one = Browser(profile)
    yield one
    one.driver.quit()
