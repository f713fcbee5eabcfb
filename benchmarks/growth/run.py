"""Processor time and memory of whole runs against the number of bodies.

Run from anywhere with the package installed: ``python benchmarks/growth/run.py``. Each run is a
process of its own, from reading the model to its result; what it would store of its steps is left
out, and of its memory the rows that it stores.
"""

import csv
import json
import resource
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

HERE = Path(__file__).parent
FIGURE = HERE / "../../docs/images/growth.svg"
SIZES = [100, 300, 1000, 3000, 10000]
LADDER = [30, 100, 300, 1000, 3000, 10000]  # loops
END, TOLERANCE = 1.0, 1e-3

PLANAR_CHAIN = """
holonom = 1
title = "planar chain"
dimension = "planar"
gravity = [0.0, -9.81]
[patterns.chain]
over.i = {{ from = 1, to = {n} }}
bodies."link_{{i}}" = {{ mass = 1.0, inertia = "=1/12", position = ["=i - 0.5", 0.0] }}
joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i - 1}}", "link_{{i}}"],
  points_in_body = [[0.5, 0.0], [-0.5, 0.0]] }}
forces."spring_{{i}}" = {{ type = "rsda", between = ["link_{{i - 1}}", "link_{{i}}"],
  stiffness = 1e5, damping = 1e3 }}
[joints]
joint_1 = {{ between = ["ground", "link_1"], points_in_body = [[0.0, 0.0], [-0.5, 0.0]] }}
[forces]
spring_1 = {{ between = ["ground", "link_1"] }}
"""

SPATIAL_CHAIN = """
holonom = 1
title = "spatial chain"
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[patterns.chain]
over.i = {{ from = 1, to = {n} }}
bodies."link_{{i}}" = {{ mass = 1.0, position = ["=i - 0.5", 0.0, 0.0],
  inertia = [[0.01, 0.0, 0.0], [0.0, "=1/12", 0.0], [0.0, 0.0, "=1/12"]] }}
joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i - 1}}", "link_{{i}}"],
  points_in_body = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]], axis = [0.0, "=i % 2", "=1 - i % 2"] }}
forces."spring_{{i}}" = {{ type = "rsda", between = ["link_{{i - 1}}", "link_{{i}}"],
  axis = [0.0, "=i % 2", "=1 - i % 2"], stiffness = 1e5, damping = 1e3 }}
[joints]
joint_1 = {{ between = ["ground", "link_1"], points_in_body = [[0.0, 0.0, 0.0], [-0.5, 0.0, 0.0]] }}
[forces]
spring_1 = {{ between = ["ground", "link_1"] }}
"""

# Link i hangs from link i // 2, all straight down; springs pull the two of a pair apart.
TREE = """
holonom = 1
title = "binary tree"
dimension = "planar"
gravity = [0.0, -9.81]
[patterns.tree]
over.i = {{ from = 1, to = {n} }}
bodies."link_{{i}}" = {{ mass = 1.0, inertia = "=1/12",
  position = [0.0, "=-floor(log(i)/log(2) + 1e-9) - 0.5"] }}
joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i // 2}}", "link_{{i}}"],
  points_in_body = [[0.0, -0.5], [0.0, 0.5]] }}
forces."spring_{{i}}" = {{ type = "rsda", between = ["link_{{i // 2}}", "link_{{i}}"],
  stiffness = 1e4, damping = 1e2, free_angle = "=0.2*(i % 2) - 0.1" }}
[joints]
joint_1 = {{ between = ["ground", "link_1"], points_in_body = [[0.0, 0.0], [0.0, 0.5]] }}
[forces]
spring_1 = {{ between = ["ground", "link_1"] }}
"""

LADDERS = """
holonom = 1
title = "ladder"
dimension = "planar"
gravity = [0.0, -9.81]
[patterns.ladder]
over.i = {{ from = 1, to = {n} }}
bodies."low_{{i}}" = {{ mass = 1.0, inertia = "=1/12", position = ["=i - 0.5", 0.0] }}
bodies."high_{{i}}" = {{ mass = 1.0, inertia = "=1/12", position = ["=i - 0.5", 1.0] }}
bodies."rung_{{i}}" = {{ mass = 1.0, inertia = "=1/12", position = ["=i", 0.5], angle = "=pi/2" }}
joints."low_joint_{{i}}" = {{ type = "revolute", between = ["low_{{i - 1}}", "low_{{i}}"],
  points_in_body = [[0.5, 0.0], [-0.5, 0.0]] }}
joints."high_joint_{{i}}" = {{ type = "revolute", between = ["high_{{i - 1}}", "high_{{i}}"],
  points_in_body = [[0.5, 0.0], [-0.5, 0.0]] }}
joints."foot_{{i}}" = {{ type = "revolute", between = ["low_{{i}}", "rung_{{i}}"],
  points_in_body = [[0.5, 0.0], [-0.5, 0.0]] }}
joints."head_{{i}}" = {{ type = "revolute", between = ["high_{{i}}", "rung_{{i}}"],
  points_in_body = [[0.5, 0.0], [0.5, 0.0]] }}
forces."spring_{{i}}" = {{ type = "rsda", between = ["low_{{i - 1}}", "low_{{i}}"],
  stiffness = 1e5, damping = 1e3 }}
[joints]
low_joint_1 = {{ between = ["ground", "low_1"], points_in_body = [[0.0, 0.0], [-0.5, 0.0]] }}
high_joint_1 = {{ between = ["ground", "high_1"], points_in_body = [[0.0, 1.0], [-0.5, 0.0]] }}
[forces]
spring_1 = {{ between = ["ground", "low_1"] }}
"""

SHAPES = {
    "planar chain": (PLANAR_CHAIN, SIZES),
    "spatial chain": (SPATIAL_CHAIN, SIZES),
    "binary tree": (TREE, SIZES),
    "ladder": (LADDERS, LADDER),
}


def measure(shape: str, n: int) -> dict[str, float]:
    """Run one model in this process; return counts, processor seconds and memory."""
    import holonom

    # A first run loads what any run needs.
    holonom.Model.from_text(SHAPES[shape][0].format(n=3)).simulate(end_time=1e-3, interval=1e-3)
    before = resource.getrusage(resource.RUSAGE_SELF)
    model = holonom.Model.from_text(SHAPES[shape][0].format(n=n))
    result = model.simulate(end_time=END, tolerance=TOLERANCE, interval=END, dense_output=False)
    after = resource.getrusage(resource.RUSAGE_SELF)
    stored = sum(result.matrix(name).nbytes for name in result.quantities)
    return {
        "steps": result.statistics["steps"],
        "bodies": n * (3 if shape == "ladder" else 1),
        "cpu_seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "megabytes": ((after.ru_maxrss - before.ru_maxrss) * 1024 - stored) / 1e6,
    }


def exponent(rows: list[dict[str, float]]) -> float:
    """Slope of processor time against bodies in logarithms, by least squares."""
    bodies, seconds = ([np.log(row[key]) for row in rows] for key in ("bodies", "cpu_seconds"))
    return float(np.polyfit(bodies, seconds, 1)[0])


def main() -> None:
    """Run all shapes at all sizes, each in a process of its own; write the table and the figure."""
    if len(sys.argv) == 3:
        print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
        return
    figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["shape", "n", "bodies", "steps", "cpu_seconds", "megabytes", "kilobytes_per_body"]
        )
        for shape, (_, sizes) in SHAPES.items():
            rows = []
            for n in sizes:
                command = [sys.executable, __file__, shape, str(n)]
                text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
                row = json.loads(text)
                rows.append(row)
                seconds, size = f"{row['cpu_seconds']:.3f}", f"{row['megabytes']:.1f}"
                each = f"{1e3 * row['megabytes'] / row['bodies']:.1f}"
                writer.writerow([shape, n, row["bodies"], row["steps"], seconds, size, each])
                print(
                    f"{shape}, n = {n}: {row['steps']} steps, {seconds} s, {size} MB,"
                    f" {each} kB per body",
                    flush=True,
                )
            slope = exponent(rows)
            print(f"{shape}: exponent {slope:.2f}")
            label = f"{shape}, {slope:.2f}"
            seconds = [row["cpu_seconds"] for row in rows]
            axes.loglog([row["bodies"] for row in rows], seconds, "o-", label=label)
    axes.set(xlabel="bodies", ylabel="processor time of a run, s")
    axes.legend(title="shape, exponent")
    figure.savefig(FIGURE)


if __name__ == "__main__":
    main()
