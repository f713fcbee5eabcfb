"""Error and steps of all implicit codes against the stiffness of a spring that turns with its body.

Run from anywhere with the package installed: ``python benchmarks/stiff_sweep/run.py``.
"""

import csv
import math
from pathlib import Path

import numpy as np

import holonom

HERE = Path(__file__).parent
FIGURE = HERE / "../../docs/images/stiff_sweep.svg"
CODES = [
    "ForSDIRK",
    "ForSDIRK16",
    "ForRosen",
    "ForRadau",
    "SspSDIRK15",
    "SspSDIRK16",
    "InflSDIRK15",
    "InflSDIRK",
    "SspTrap",
    "InflTrap",
]
STIFFNESS = [10.0**power for power in range(3, 13)]  # N/m
DAMPING_TIME = 0.1  # s; the damper has the stiffness times this
TOLERANCE, END, ROWS = 1e-4, 1.0, 50
ANGLE, RATE = 0.3, 4.0  # rad, rad/s at the start
GRAVITY, INERTIA = 9.81, 0.02  # arm and body about their centres, kg m^2
ALLOWED_ERROR, ALLOWED_RATIO = 30.0, 2.0


def rates(x: np.ndarray, k: float, c: float) -> tuple[np.ndarray, np.ndarray]:
    """Polar equations of motion in elongation, its rate, angle, its rate; with their Jacobian."""
    e, u, angle, w = x
    r, mass = 1.0 + e, INERTIA + (1.0 + e) ** 2
    sin, cos = math.sin(angle), math.cos(angle)
    turning = (-2.0 * r * u * w - GRAVITY * r * cos) / mass
    slope = np.array([u, r * w * w - GRAVITY * sin - k * e - c * u, w, turning])
    by_e = (-2.0 * u * w - GRAVITY * cos - 2.0 * r * turning) / mass
    jacobian = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [w * w - k, -c, -GRAVITY * cos, 2.0 * r * w],
            [0.0, 0.0, 0.0, 1.0],
            [by_e, -2.0 * r * w / mass, GRAVITY * r * sin / mass, -2.0 * r * u / mass],
        ]
    )
    return slope, jacobian


def slow_start(k: float, c: float) -> np.ndarray:
    """Start without a fast transient: spring and damper balance the radial force and its rate."""
    e = u = 0.0
    for _ in range(20):
        r = 1.0 + e
        turning = rates(np.array([e, u, ANGLE, RATE]), k, c)[0][3]
        force = r * RATE**2 - GRAVITY * math.sin(ANGLE)
        u = (u * RATE**2 + 2.0 * r * RATE * turning - GRAVITY * math.cos(ANGLE) * RATE) / k
        e = (force - c * u) / k
    return np.array([e, u, ANGLE, RATE])


def reference(k: float, c: float, steps: int = 40) -> np.ndarray:
    """The motion at the output times by Radau IIA of order 5 with fixed steps."""
    s = math.sqrt(6.0)
    a = np.array(
        [
            [(88 - 7 * s) / 360, (296 - 169 * s) / 1800, (-2 + 3 * s) / 225],
            [(296 + 169 * s) / 1800, (88 + 7 * s) / 360, (-2 - 3 * s) / 225],
            [(16 - s) / 36, (16 + s) / 36, 1 / 9],
        ]
    )
    h = END / (ROWS * steps)
    x = slow_start(k, c)
    rows = [x]
    for _ in range(ROWS):
        for _ in range(steps):
            stages = np.tile(x, (3, 1))
            for _ in range(5):
                parts = [rates(stage, k, c) for stage in stages]
                slopes = np.array([slope for slope, _ in parts])
                residual = x + h * a @ slopes - stages
                blocks = [[a[i, j] * parts[j][1] for j in range(3)] for i in range(3)]
                matrix = np.eye(12) - h * np.block(blocks)
                stages = stages + np.linalg.solve(matrix, residual.ravel()).reshape(3, 4)
            x = stages[2]
        rows.append(x)
    return np.array(rows)


def cartesian(x: np.ndarray) -> np.ndarray:
    """Position and velocity of the body from polar coordinates by rows."""
    e, u, angle, w = x.T
    r, sin, cos = 1.0 + e, np.sin(angle), np.cos(angle)
    return np.stack([r * cos, r * sin, u * cos - r * w * sin, u * sin + r * w * cos], axis=1)


def run(model: holonom.Model, code: str, k: float, c: float, truth: np.ndarray) -> dict:
    """One run: steps, and the error in units of the tolerance."""
    x, y, vx, vy = (float(value) for value in cartesian(slow_start(k, c)[None])[0])
    changed = model.with_values(
        {
            "parameters.stiffness": k,
            "parameters.damping": c,
            "initial.bodies.arm.angle": ANGLE,
            "initial.bodies.arm.angular_velocity": RATE,
            "initial.bodies.body.angle": ANGLE,
            "initial.bodies.body.angular_velocity": RATE,
            "initial.bodies.body.position": [x, y],
            "initial.bodies.body.velocity": [vx, vy],
        }
    )
    result = changed.simulate(
        end_time=END,
        tolerance=TOLERANCE,
        method=code,
        interval=END / ROWS,
        channels=["body.position", "body.velocity"],
        on_failure="return",
    )
    found = np.hstack([result["body.position"], result["body.velocity"]])
    exact = cartesian(truth)[: len(found)]
    error = float((np.abs(found - exact) / (1.0 + np.abs(exact))).max()) / TOLERANCE
    s = result.statistics
    return {
        "code": code,
        "stiffness": k,
        "damping": c,
        "status": result.status,
        "steps": s.steps,
        "rejected": s.rejected_error + s.rejected_newton + s.rejected_evaluation,
        "error": error,
    }


def draw(rows: list[dict]) -> None:
    """Error and steps against stiffness, damped and undamped."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update(
        {
            "svg.hashsalt": "stiff_sweep",
            "svg.fonttype": "none",
            "font.size": 8.5,
            "axes.grid": True,
            "grid.linewidth": 0.4,
        }
    )
    figure, axes = plt.subplots(2, 2, figsize=(8.6, 5.0), sharex=True, sharey="row")
    families = {"For": "-", "Ssp": "--", "Infl": ":"}
    for column, damped in enumerate((True, False)):
        error, steps = axes[0][column], axes[1][column]
        for number, code in enumerate(CODES):
            line = [r for r in rows if r["code"] == code and (r["damping"] > 0.0) == damped]
            style = next(v for key, v in families.items() if code.startswith(key))
            for axis, quantity in ((error, "error"), (steps, "steps")):
                axis.plot(
                    [r["stiffness"] for r in line],
                    [r[quantity] for r in line],
                    style,
                    color=f"C{number}",
                    marker=".",
                    linewidth=1.2,
                    label=code,
                )
        error.set_title("damper c = 0.1 s · k" if damped else "no damper")
        error.set(xscale="log", yscale="log", ylim=(0.05, 200.0))
        if damped:
            error.axhline(ALLOWED_ERROR, color="0.4", linewidth=0.8)
            error.text(1.3e3, 1.15 * ALLOWED_ERROR, "30 tolerances", color="0.3")
        steps.set(xlabel="stiffness k, N/m", yscale="log", ylim=(5.0, 500.0))
    axes[0][0].set_ylabel("error / tolerance")
    axes[1][0].set_ylabel("accepted steps")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="center right", frameon=False)
    figure.tight_layout(rect=(0.0, 0.0, 0.86, 1.0))
    figure.savefig(FIGURE, metadata={"Date": None})


def main() -> None:
    """Run the sweep, write results.csv and the figure, hold the bounds."""
    model = holonom.Model.load(HERE / "../../models/stiff_slider/model.toml")
    rows = []
    for damped in (True, False):
        for k in STIFFNESS:
            c = DAMPING_TIME * k if damped else 0.0
            truth = reference(k, c)
            rows += [run(model, code, k, c, truth) for code in CODES]
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.3g}" if isinstance(v, float) else v for k, v in row.items()})
    draw(rows)
    for code in CODES:
        line = [r for r in rows if r["code"] == code and r["damping"] > 0.0]
        steps = [r["steps"] for r in line if r["stiffness"] >= 1e4]
        worst = max(r["error"] for r in line)
        free = [r for r in rows if r["code"] == code and r["damping"] == 0.0]
        ended = [r["error"] for r in free if r["status"] == "completed"]
        print(
            f"{code:12} {min(steps):4d} to {max(steps):4d} steps, error {worst:5.2f} tolerances; "
            f"undamped {len(ended)} of {len(free)} runs, error {max(ended):5.2f}"
        )
        assert all(r["status"] == "completed" for r in line), f"{code}: a run failed"
        assert worst <= ALLOWED_ERROR, f"{code}: {worst:.1f} tolerances"
        ratio = max(steps) / min(steps)
        assert ratio < ALLOWED_RATIO, f"{code}: steps vary by a factor of {ratio:.1f}"


if __name__ == "__main__":
    main()
