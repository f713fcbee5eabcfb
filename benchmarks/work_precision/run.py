"""Processor time of the core against accuracy, all codes on three mechanisms.

Run from anywhere with the package installed: ``python benchmarks/work_precision/run.py``.
"""

import csv
import os
import platform
import statistics
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

import holonom

mpl.use("svg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
#: End time, s, and the time in which the best code is to reach ERROR, ms.
MODELS = {"double_pendulum_w10": (2.0, 1.1), "andrews": (0.03, 6.0), "chain50": (1.0, 15.0)}
CODES = ["ForSDIRK", "ForSDIRK16", "ForRosen", "ForRadau", "SspSDIRK15", "InflSDIRK15"]
TOLERANCES = [10.0 ** (-k / 2) for k in range(6, 15)]
REFERENCE = {"method": "ForRadau", "tolerance": 1e-11}
ERROR, OUTPUTS, REPETITIONS = 1e-5, 200, 9


def poses(result: holonom.Result, channels: list[str]) -> NDArray[np.float64]:
    """All body positions, m, and angles, rad, at the output times after the start."""
    return np.hstack([result[name].reshape(OUTPUTS + 1, -1)[1:] for name in channels])


def measure(name: str, end: float) -> list[dict[str, object]]:
    """One row per code and tolerance."""
    model = holonom.Model.load(HERE / f"../../models/{name}/model.toml")
    channels = [c for c in model.channels if c.endswith((".position", ".angle"))]
    bodies = [c for c in channels if c.count(".") == 1 and not c.startswith("constraint.")]
    common = {"end_time": end, "interval": end / OUTPUTS, "channels": bodies}
    exact = poses(model.simulate(**common, **REFERENCE), bodies)
    rows = []
    for code in CODES:
        for tolerance in TOLERANCES:
            runs = [
                model.simulate(**common, method=code, tolerance=tolerance)
                for _ in range(REPETITIONS)
            ]
            s = runs[0].statistics
            rows.append(
                {
                    "model": name,
                    "code": code,
                    "tolerance": tolerance,
                    "milliseconds": 1e3
                    * statistics.median(r.statistics.run_cpu_seconds for r in runs),
                    "error": float(np.abs(poses(runs[0], bodies) - exact).max()),
                    "steps": s.steps,
                    "rejected": s.rejected_error + s.rejected_newton + s.rejected_evaluation,
                    "evaluations": s.evaluations,
                    "jacobians": s.jacobians,
                }
            )
    return rows


def time_to(rows: list[dict[str, object]], code: str) -> float:
    """Milliseconds to ERROR, interpolated between tolerances on logarithmic axes."""
    points = sorted((r["error"], r["milliseconds"]) for r in rows if r["code"] == code)
    errors, times = np.log(np.array(points)).T
    return float(np.exp(np.interp(np.log(ERROR), errors, times)))


def draw(table: list[dict[str, object]]) -> None:
    """One diagram per model."""
    figure, axes = plt.subplots(1, len(MODELS), figsize=(12, 4), layout="constrained")
    for ax, name in zip(axes, MODELS, strict=True):
        for code in CODES:
            rows = [r for r in table if (r["model"], r["code"]) == (name, code)]
            ax.loglog(
                [r["error"] for r in rows],
                [r["milliseconds"] for r in rows],
                "o-",
                label=code,
                ms=3,
            )
        ax.axvline(ERROR, color="0.7", lw=0.8)
        ax.set(title=name, xlabel="largest error, m or rad")
    axes[0].set_ylabel("processor time, ms")
    axes[-1].legend(frameon=False, fontsize=8)
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "holonom"}):
        figure.savefig(HERE / "work_precision.svg", metadata={"Date": None})


def main() -> None:
    """Measure, write results.csv and the diagram, print the times to ERROR."""
    table: list[dict[str, object]] = []
    for name, (end, bound) in MODELS.items():
        rows = measure(name, end)
        table += rows
        times = {code: time_to(rows, code) for code in CODES}
        print(
            name, {code: round(t, 2) for code, t in times.items()}, f"bound {bound} ms", flush=True
        )
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, table[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in table:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
    draw(table)
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")


if __name__ == "__main__":
    main()
