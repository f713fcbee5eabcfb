"""Holonom: implicit integration of constrained multibody systems.

::

    import holonom

    model = holonom.Model.load("models/double_pendulum/model.toml")
    result = model.simulate(end_time=2.0, tolerance=1e-6)
    result.plot("upper.angle", "energy.imbalance")
"""

from pathlib import Path
from typing import Any

from holonom._core import version as _version
from holonom.certification import Certification, ChannelError
from holonom.check import CheckReport
from holonom.errors import (
    FileError,
    HolonomError,
    Interrupted,
    ModelError,
    Problem,
    SimulationError,
    UsageError,
)
from holonom.model import Model
from holonom.options import Options, Tolerance, methods
from holonom.result import Result
from holonom.study.compare import compare
from holonom.study.comparison import Comparison, ComparisonInterrupted

__version__ = _version()

__all__ = [
    "Certification",
    "ChannelError",
    "CheckReport",
    "Comparison",
    "ComparisonInterrupted",
    "FileError",
    "HolonomError",
    "Interrupted",
    "Model",
    "ModelError",
    "Options",
    "Problem",
    "Result",
    "SimulationError",
    "Tolerance",
    "UsageError",
    "compare",
    "load",
    "methods",
    "simulate",
]


def load(path: str | Path) -> Result:
    """Open a result file; the same as `Result.load`."""
    return Result.load(path)


def simulate(path: str | Path, **choices: Any) -> Result:
    """Run a model file; the same as ``Model.load(path).simulate(...)``."""
    return Model.load(path).simulate(**choices)
