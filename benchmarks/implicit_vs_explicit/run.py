"""Processor time of implicit and explicit codes on a stiff vehicle, from one state.

Run from anywhere with the package installed: ``python benchmarks/implicit_vs_explicit/run.py``.
"""

import csv
import os
import platform
import time
from pathlib import Path

import numpy as np

import holonom

HERE = Path(__file__).parent
START, END, TOLERANCE = 0.45, 0.70, 1e-3
CODES = ["ForSDIRK", "ForRosen", "DEABM", "DOPRI5"]
COMPARED = {
    "chassis.position": slice(2, 3),  # height, m
    "chassis.yaw_pitch_roll": slice(1, 2),  # pitch, rad
    "spindle_front_right.wheel_center.position": slice(2, 3),  # height, m
}
REQUIRED_RATIO, ALLOWED_DIFFERENCE = 300.0, 1e-3
IMPLICIT = ("ForSDIRK", "ForRosen")


def main() -> None:
    """Run all codes, compare them, write results.csv."""
    model = holonom.Model.load(HERE / "../../models/hmmwv14/model.toml")
    # The state at 0.45 s comes from a run that is finer than the ones compared.
    before = model.simulate(end_time=START, tolerance=1e-6, interval=START, channels=[])
    state = before.state(START)
    rows, curves = [], {}
    for code in CODES:
        # Short runs are repeated: the least time says most about the code.
        repetitions = 5 if code in IMPLICIT else 1
        seconds = []
        for _ in range(repetitions):
            begun = time.process_time()
            result = model.simulate(
                start=state,
                end_time=END,
                tolerance=TOLERANCE,
                method=code,
                interval=0.01,
                channels=list(COMPARED),
            )
            seconds.append(time.process_time() - begun)
        curves[code] = np.hstack([result[name][:, part] for name, part in COMPARED.items()])
        s = result.statistics
        rows.append(
            {
                "code": code,
                "cpu_seconds": min(seconds),
                "steps": s.steps,
                "rejected": s.rejected_error + s.rejected_newton + s.rejected_evaluation,
                "evaluations": s.evaluations,
                "jacobians": s.jacobians,
                "difference": float(np.abs(curves[code] - curves["ForSDIRK"]).max()),
            }
        )
        print(rows[-1], flush=True)
    for row in rows:
        row["ratio"] = row["cpu_seconds"] / rows[0]["cpu_seconds"]
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    explicit = [row for row in rows if row["code"] not in IMPLICIT]
    for row in explicit:
        print(f"{row['code']}: {row['ratio']:.0f} times the processor time of ForSDIRK")
        assert row["ratio"] >= REQUIRED_RATIO, f"{row['code']}: less than {REQUIRED_RATIO} times"
    worst = max(row["difference"] for row in rows)
    print(f"largest difference of any code from ForSDIRK: {worst:.1e} m or rad")
    assert worst <= ALLOWED_DIFFERENCE, "the codes do not agree"


if __name__ == "__main__":
    main()
