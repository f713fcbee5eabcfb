"""Holonom: implicit integration of constrained multibody systems.

::

    import holonom

    model = holonom.Model.load("models/double_pendulum/model.toml")
    result = model.simulate(end_time=2.0, tolerance=1e-6)
    result.plot("upper.angle", "energy.imbalance")
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Unpack

    from holonom import signals as signals
    from holonom.base.errors import (
        FileError,
        HolonomError,
        Interrupted,
        ModelError,
        Problem,
        SimulationError,
        UsageError,
    )
    from holonom.certificate import Certification, ChannelError
    from holonom.check import CheckReport
    from holonom.model import Arguments, Model
    from holonom.options import Options, Tolerance, methods
    from holonom.result import Result
    from holonom.study.compare import compare
    from holonom.study.comparison import Comparison, ComparisonInterrupted
    from holonom.study.differences import ChannelDifference, Differences, diff

    __version__: str

__all__ = [
    "Certification",
    "ChannelDifference",
    "ChannelError",
    "CheckReport",
    "Comparison",
    "ComparisonInterrupted",
    "Differences",
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
    "diff",
    "load",
    "methods",
    "simulate",
]

#: Where public names live. They are read when they are first used, so that the command line can
#: heed signals before NumPy and the engine are there.
_HOMES = {
    "certificate": ("Certification", "ChannelError"),
    "check": ("CheckReport",),
    "base.errors": (
        "FileError",
        "HolonomError",
        "Interrupted",
        "ModelError",
        "Problem",
        "SimulationError",
        "UsageError",
    ),
    "model": ("Model",),
    "options": ("Options", "Tolerance", "methods"),
    "result": ("Result",),
    "study.compare": ("compare",),
    "study.comparison": ("Comparison", "ComparisonInterrupted"),
    "study.differences": ("ChannelDifference", "Differences", "diff"),
}

#: Modules that are public as a whole.
_MODULES = ("signals",)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        value: Any = import_module("holonom._core").version()
    elif name in _MODULES:
        value = import_module(f"holonom.{name}")
    else:
        home = next((home for home, names in _HOMES.items() if name in names), None)
        if home is None:
            text = f"module 'holonom' has no attribute {name!r}"
            raise AttributeError(text, name=name, obj=sys.modules[__name__])
        value = getattr(import_module(f"holonom.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, *_MODULES, "__version__"])


def load(path: "str | Path", *, recover: bool = False) -> "Result":
    """Open a result file; the same as `Result.load`."""
    from holonom.result import Result

    return Result.load(path, recover=recover)


def simulate(path: "str | Path", **choices: "Unpack[Arguments]") -> "Result":
    """Run a model file; the same as ``Model.load(path).simulate(...)``, which lists them."""
    from holonom.model import Model

    return Model.load(path).simulate(**choices)
