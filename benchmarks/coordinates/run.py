"""Measure runs in joint and in Cartesian coordinates: processor time of the same steps."""

from __future__ import annotations

import csv
import statistics
from pathlib import Path

import holonom

ROUNDS = 15
TOLERANCE = 1e-3
MODELS = (
    "hmmwv14",
    "hmmwv14_bushing",
    "spatial_four_bar",
    "slider_crank",
    "andrews",
    "chain50",
    "double_pendulum_w10",
)


def main() -> None:
    """Measure every model, alternating between both forms, and write the table."""
    lines = []
    for name in MODELS:
        model = holonom.Model.library(name)
        end = 0.03 if name == "andrews" else model.defaults.get("end_time", 1.0)
        seconds: dict[str, list[float]] = {"cartesian": [], "joint": []}
        steps = {}
        for _ in range(ROUNDS):
            for form, measured in seconds.items():
                result = model.simulate(
                    end_time=end, interval=end, tolerance=TOLERANCE, channels=[], coordinates=form
                )
                measured.append(result.statistics["run_cpu_seconds"])
                steps[form] = result.statistics["steps"]
        median = {form: statistics.median(measured) for form, measured in seconds.items()}
        ratio = median["cartesian"] / median["joint"]
        per_second = 1e3 * median["joint"] / end
        print(
            f"{name:20} {1e3 * median['cartesian']:8.2f} ms {1e3 * median['joint']:8.2f} ms "
            f"{ratio:5.2f} times, {steps['cartesian']} and {steps['joint']} steps, "
            f"{per_second:.2f} ms per simulated second"
        )
        lines.append(
            [
                name,
                steps["cartesian"],
                steps["joint"],
                f"{1e3 * median['cartesian']:.3g}",
                f"{1e3 * median['joint']:.3g}",
                f"{ratio:.3g}",
                f"{per_second:.3g}",
            ]
        )
    with (Path(__file__).parent / "results.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(
            [
                "model",
                "steps_cartesian",
                "steps_joint",
                "cartesian_ms",
                "joint_ms",
                "ratio",
                "joint_ms_per_simulated_second",
            ]
        )
        table.writerows(lines)


if __name__ == "__main__":
    main()
