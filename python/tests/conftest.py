"""Helpers of the tests: synthetic chunks as the core delivers them, a small model, the models."""

from __future__ import annotations

import json
import signal
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import Browser, one_browser
from hypothesis import settings

import holonom
from holonom.store.layout import Quantity
from holonom.store.writer import Writer

# The same cases at every run; `--hypothesis-profile=default` searches for other ones.
settings.register_profile("same", derandomize=True)
settings.load_profile("same")

# A shell starts what runs in the background with interrupts ignored, which children inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"

#: A rod turning about the origin, released at rest from the horizontal.
PENDULUM = """
holonom = 1
title = "Rod on a pin"
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
rod = { mass = 2.0, inertia = 0.1, position = [0.8, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "rod"], point = [0.0, 0.0] }
[outputs]
channels = ["rod.position", "pin.force"]
interval = 0.01
[simulation]
end_time = 1.0
tolerance = 1.0e-6
"""


def oscillator_text(*, mass: float, x: float, stiffness: float, free_length: float) -> str:
    """Return a model text: a block at rest at x (m) on a rail, on a spring from x = -1 m."""
    return f"""
holonom = 1
title = "Mass on a spring"
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = {{ mass = {mass}, inertia = 0.1, position = [{x}, 0.0] }}
[joints.guide]
type = "translational"
between = ["ground", "block"]
point = [0.0, 0.0]
axis = [1.0, 0.0]
[forces.spring]
type = "tsda"
between = ["ground", "block"]
points = [[-1.0, 0.0], [{x}, 0.0]]
stiffness = {stiffness}
free_length = {free_length}
"""


#: A mass of 1 kg on a spring, released 0.1 m from its rest: x = −0.1 + 0.1 cos(ω t), ω² = 400.
OSCILLATOR = (
    oscillator_text(mass=1.0, x=0.0, stiffness=400.0, free_length=0.9)
    + """
[simulation]
end_time = 1.0
"""
)


def displacement(t: np.ndarray) -> np.ndarray:
    """Return where the block of `OSCILLATOR` is (m) at times (s)."""
    return -0.1 + 0.1 * np.cos(20.0 * t)


CHANNELS = {
    "rod.position": Quantity("rod.position", "m", "ground", (2,)),
    "energy.kinetic": Quantity("energy.kinetic", "J", "", ()),
    "energy.imbalance": Quantity("energy.imbalance", "J", "", ()),
    "constraint.position": Quantity("constraint.position", "m", "", ()),
}


def synthetic_chunk(first: int, count: int) -> dict[str, Any]:
    """Return output rows `first` … of a made-up run; every number is known from its row."""
    t = 0.01 * np.arange(first, first + count)
    q = np.stack([np.sin(t), np.cos(t), t], axis=1)
    return {
        "time": t,
        "q": q,
        "qd": 2.0 * q,
        "qdd": 3.0 * q,
        "lambda": q[:, :2],
        "z": np.zeros((count, 0)),
        "winding": np.zeros((count, 0)),
        "ledger": np.zeros((count, 3)),
        "channels": {
            "rod.position": q[:, :2],
            "energy.kinetic": t**2,
            "energy.imbalance": 1e-9 * np.sin(t),
            "constraint.position": 1e-15 * (1.0 + np.cos(t)),
        },
        "steps": {
            "t": t,
            "h": np.full(count, 0.01),
            "error": np.full(count, 0.5),
            "accepted": (np.arange(first, first + count) % 10 != 3).astype(float),
            "cause": ["error" if i % 10 == 3 else "" for i in range(first, first + count)],
            "iterations": np.full(count, 2.0),
            "order": np.full(count, 7.0),  # a column that not every run has
        },
        "events": json.dumps([{"time": float(t[0]), "kind": "breakpoint", "item": "motor"}]),
    }


META: dict[str, Any] = {
    "name": "rod",
    "title": "Rod <on> a pin",
    "model": tomllib.loads(PENDULUM),
    "model_hash": "0123456789abcdef",
    "options": {"method": "ForSDIRK", "tolerance": {"relative": 1e-3, "translation": 1e-3}},
    "requested": ["rod.position"],
    "warnings": [
        {"code": "model/implausible", "message": "looks like grams", "path": "bodies.rod"}
    ],
    "status": "running",
    "started": "2026-01-01T00:00:00+00:00",
    "holonom": "0.0.0",
}
SUMMARY: dict[str, Any] = {
    "status": "completed",
    "stop_reason": {"code": "simulation/end-time", "message": "reached the end time"},
    "statistics": {"steps": 180, "rejected": 20, "jacobians": 33, "seconds": {"newton": 0.1}},
    "residuals": {"position": 2e-15, "velocity": 1e-14},
    "energy": {"kinetic": 4.0, "imbalance": 1e-9},
    "dof": 1,
    "cpu_seconds": 0.2,
}


def write_result(path: Path, chunks: int = 4, rows: int = 50) -> Writer:
    """Write a finished synthetic result."""
    writer = Writer(path, META, CHANNELS)
    for number in range(chunks):
        writer.append(synthetic_chunk(number * rows, rows))
    writer.finish(SUMMARY)
    return writer


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """A finished result file of 200 rows."""
    path = tmp_path / "rod.holonom"
    write_result(path).close()
    return path


@pytest.fixture
def pendulum(tmp_path: Path) -> Path:
    """The model file of a pendulum, in a folder of its own."""
    path = tmp_path / "models" / "rod" / "model.toml"
    path.parent.mkdir(parents=True)
    path.write_text(PENDULUM, encoding="utf-8")
    return path


@pytest.fixture
def oscillator() -> holonom.Model:
    """The model of `OSCILLATOR`."""
    return holonom.Model.from_text(OSCILLATOR, name="block")


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Chromium, if it is there; `HOLONOM_BROWSER=required` refuses to go on without."""
    yield from one_browser(tmp_path_factory.mktemp("profile"))
