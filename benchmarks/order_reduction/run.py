"""Observed orders of the formulas with fixed steps as a model becomes stiff.

Run from anywhere with the package installed: ``python benchmarks/order_reduction/run.py``.
"""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

import holonom

HERE = Path(__file__).parent
DOCS = HERE / "../../docs"
#: A code for each formula, with the order that its source states.
CODES = {
    "SspTrap": ("trapezoidal", 2),
    "InflSDIRK": ("sdirk4_16", 4),
    "ForSDIRK": ("sdirk4_15", 4),
    "ForRosen": ("rosenbrock4", 4),
    "ForRadau": ("radau5", 5),
}
KINDS = ("coordinates", "velocities", "multipliers")
MODELS = ("double pendulum", "radial slider")
#: From a state on the slow motion, which a run at tight tolerance has reached, in these steps.
START, END, STEPS = 0.2, 0.7, 40

#: A body of 1 kg on an arm that swings; a spring and a damper hold it at 1 m from the pivot.
SLIDER = """
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[parameters]
k = { value = 1.0e4, unit = "N/m" }
c = { value = 1.0e3, unit = "N s/m" }
[bodies]
arm = { mass = 0.1, inertia = 0.01, position = [0.0, 0.0] }
body = { mass = 1.0, inertia = 0.01, position = [1.0, 0.0] }
[joints]
pivot = { type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }
slide = { type = "translational", between = ["arm", "body"], point = [1.0, 0.0], axis = [1.0, 0.0] }
[forces.spring]
type = "tsda"
between = ["arm", "body"]
points = [[0.0, 0.0], [1.0, 0.0]]
stiffness = "=k"
damping = "=c"
free_length = 1.0
[initial.bodies]
arm = { angular_velocity = 2.0 }
"""

PENDULUM_CHANNELS = {
    "coordinates": ["upper.angle", "lower.angle"],
    "velocities": ["upper.angular_velocity", "lower.angular_velocity"],
    "multipliers": ["shoulder.force", "elbow.force"],
}
SLIDER_CHANNELS = {
    "coordinates": ["arm.angle", "body.position"],
    "velocities": ["arm.angular_velocity", "body.velocity"],
    "multipliers": ["pivot.force", "slide.force", "slide.torque"],
}


def sweeps() -> Iterator[tuple[str, float, holonom.Model, dict[str, list[str]]]]:
    """Return title, damping, model and channels of every model of the sweeps."""
    pendulum = holonom.Model.load(HERE / "../../models/double_pendulum_w10/model.toml")
    for damping in 5.0 * 10.0 ** np.arange(0.0, 7.0, 0.5):
        values = {"parameters.k2.value": 6.0 * damping, "parameters.c2.value": float(damping)}
        yield MODELS[0], float(damping), pendulum.with_values(values), PENDULUM_CHANNELS
    slider = holonom.Model.from_text(SLIDER, name="slider")
    for damping in 10.0 ** np.arange(0.0, 7.0, 0.5):
        values = {"parameters.k.value": 10.0 * damping, "parameters.c.value": float(damping)}
        yield MODELS[1], float(damping), slider.with_values(values), SLIDER_CHANNELS


def errors(result: Any, truth: Any, channels: dict[str, list[str]]) -> list[float]:
    """Return the largest difference by kind."""
    return [
        max(float(np.abs(result[name] - truth[name]).max()) for name in channels[kind])
        for kind in KINDS
    ]


def measure() -> list[dict[str, Any]]:
    """Return a row for every model and code."""
    rows = []
    times = np.linspace(START, END, 6)
    for title, damping, model, channels in sweeps():
        fastest = max(abs(z) for z in model.check().spectrum)
        names = [name for kind in KINDS for name in channels[kind]]
        common = {"end_time": END, "output_times": times, "channels": names}
        tight = {"tolerance": 1e-12, "method": "ForRadau"}
        before = model.simulate(end_time=START, interval=START, channels=[], **tight)
        start = before.state(START)
        truth = model.simulate(start=start, **common, **tight)
        for code, (formula, order) in CODES.items():
            found = []
            for steps in (STEPS, 2 * STEPS):
                step = (END - START) / steps
                run = model.simulate(start=start, fixed_step=step, method=code, **common)
                found.append(errors(run, truth, channels))
            row = {"model": title, "damping": damping, "fastest": fastest}
            row |= {"step_times_fastest": fastest * (END - START) / STEPS}
            row |= {"code": code, "formula": formula, "order": order}
            for kind, coarse, fine in zip(KINDS, *found, strict=True):
                row[f"{kind}_error"] = coarse
                row[f"{kind}_order"] = float(np.log2(coarse / fine))
            rows.append(row)
    return rows


def draw(rows: list[dict[str, Any]]) -> None:
    """Draw observed orders over step size times fastest eigenvalue."""
    mpl.rcParams["svg.hashsalt"] = "order_reduction"  # the same file from the same numbers
    figure, axes = plt.subplots(
        len(MODELS), len(KINDS), figsize=(10.5, 6.0), sharex="row", sharey=True
    )
    for line, title in zip(axes, MODELS, strict=True):
        for axis, kind in zip(line, KINDS, strict=True):
            for code, (formula, _) in CODES.items():
                part = [row for row in rows if (row["model"], row["code"]) == (title, code)]
                x = [row["step_times_fastest"] for row in part]
                axis.semilogx(x, [row[f"{kind}_order"] for row in part], ".-", label=formula)
            axis.set_title(f"{title}: {kind}", fontsize="medium")
            axis.grid(alpha=0.3)
        line[0].set_ylabel("observed order")
    for axis in axes[-1]:
        axis.set_xlabel("step size × fastest eigenvalue")
    axes[0][0].set_ylim(0.0, 6.0)
    axes[0][0].legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(DOCS / "images/order-reduction.svg", metadata={"Date": None})
    plt.close(figure)


def table(rows: list[dict[str, Any]], model: str, quantity: str, digits: str) -> str:
    """Return a table of docs/order-reduction.md, with every third stiffness."""
    lines = ["| step × fastest | " + " | ".join(formula for formula, _ in CODES.values()) + " |"]
    lines.append("| --- " * (1 + len(CODES)) + "|")
    part = [row for row in rows if row["model"] == model]
    for first in range(0, len(part), 3 * len(CODES)):
        row = part[first : first + len(CODES)]
        cells = [" / ".join(f"{x[f'{k}_{quantity}']:{digits}}" for k in KINDS) for x in row]
        lines.append(f"| {row[0]['step_times_fastest']:.2g} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, write results.csv and the picture, print the table of the page."""
    rows = measure()
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
    draw(rows)
    for model in MODELS:
        print(f"\n{model}\n\n{table(rows, model, 'order', '.1f')}")
        print(f"\n{table(rows, model, 'error', '.0e')}")


if __name__ == "__main__":
    main()
