"""Tables 20 to 23 of Negrut's thesis: errors of two codes on the stiff double pendulum.

Run from anywhere with the package installed: ``python benchmarks/thesis_tables/run.py``.
"""

import csv
import math
import statistics
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import holonom
from holonom.study.accuracy import ComponentError
from holonom.study.comparison import Row

HERE = Path(__file__).parent
ANGLE, RATE = "upper.angle", "upper.angular_velocity"
#: Tables by code and variable; without a number those that the thesis does not have.
TABLES = {
    ("ForSDIRK", ANGLE): "20",
    ("ForRosen", ANGLE): "21",
    ("ForSDIRK", RATE): "22",
    ("ForRosen", RATE): "23",
}
FURTHER = ("SspTrap", "InflTrap", "InflSDIRK", "ForRadau")
EXPONENTS = (-2, -3, -4, -5)


def errors(model: holonom.Model, code: str, exponent: int) -> tuple[Row, float]:
    """Return the errors of a run at the ends of its own steps, as the thesis takes them."""
    run = {"tolerance": 10.0**exponent, "profile": "thesis"}
    steps = model.simulate(method=code, channels=[], **run).steps
    accepted = steps["accepted"] > 0.5
    ends = (steps["t"] + steps["h"])[accepted]
    comparison = holonom.compare(
        model,
        methods=[code],
        tolerances=[run["tolerance"]],
        profile="thesis",
        channels=[ANGLE, RATE],
        output_times=np.unique(np.clip([0.0, *ends], 0.0, 2.0)),
        reference_tolerance=1e-11,
        repeat=0,
    )
    assert comparison.reference is not None
    return comparison.rows[0], comparison.reference.difference_of("position")


def show(title: str, rows: dict[int, Row], found: dict[int, ComponentError]) -> None:
    """Print one table."""
    deltas = [math.log10(found[k].delta) for k in EXPONENTS]
    slope = statistics.linear_regression(EXPONENTS, deltas).slope
    print(f"\n{title}: slope of Δ {slope:.2f}\n")
    print("| k | t*, s | Δ | RelErr, % | average error | steps (rejected) |\n" + "| --- " * 6 + "|")
    for k, error in found.items():
        relative = "–" if error.relative is None else f"{error.relative:.1e}"
        steps = f"{rows[k].counts['steps']} ({rows[k].counts['rejected']})"
        cells = [f"{error.time:.2f}", f"{error.delta:.1e}", relative, f"{error.mean:.1e}", steps]
        print(f"| {k} | {' | '.join(cells)} |")


def main() -> None:
    """Run, write results.csv, print the tables of the page."""
    model = holonom.Model.load(HERE / "../../models/double_pendulum/model.toml")
    lines: list[dict[str, Any]] = []
    doubt = 0.0
    for code in ("ForSDIRK", "ForRosen", *FURTHER):
        rows = {}
        for k in EXPONENTS:
            rows[k], difference = errors(model, code, k)
            doubt = max(doubt, difference)
        for channel in (ANGLE, RATE):
            found = {k: next(e for e in rows[k].errors if e.name == channel) for k in EXPONENTS}
            table = TABLES.get((code, channel), "")
            show(f"{f'Table {table}, ' if table else ''}{code}, {channel}", rows, found)
            for k, error in found.items():
                counts = {name: rows[k].counts[name] for name in ("steps", "rejected")}
                line = {"table": table, "method": code, "k": k} | asdict(error) | counts
                lines.append(line)
    print(f"\nthe reference and its check differ by {doubt:.1e} rad at most")
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, lines[0].keys(), lineterminator="\n")
        writer.writeheader()
        for x in lines:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in x.items()})


if __name__ == "__main__":
    main()
