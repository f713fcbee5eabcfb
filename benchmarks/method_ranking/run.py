"""Every implicit code on the vehicle and on the whole library: work, time, and who is first.

Run from anywhere with the package installed: ``python benchmarks/method_ranking/run.py``.
"""

import csv
import math
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import holonom

HERE = Path(__file__).parent
MODELS = HERE / "../../models"
CODES = [method["name"] for method in holonom.methods() if method["family"] != "explicit"]
#: Compared with analytic and with numerical Jacobians.
DIFFERENCES = ("ForSDIRK", "SspSDIRK15", "InflSDIRK15")
COUNTS = ("steps", "rejected", "evaluations", "jacobians", "factorizations", "iterations")
#: Of the vehicle's tables, and of the ranking: so many that errors can be read between them.
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
WIDE = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
#: Errors of positions and angles at which times are compared, m and rad; the reference is finer.
ERRORS = (1e-3, 1e-4, 1e-5)
REFERENCE = 3e-8
#: Simulated time, s, where the model's own is longer than the question needs.
ENDS = {"simple_pendulum": 5.0, "hmmwv14": 2.5, "hmmwv14_bushing": 1.0}
#: Whose times are 1.
DEFAULT = "ForSDIRK"


def compare(
    name: str, methods: Sequence[Any], tolerances: Sequence[float], **choices: Any
) -> holonom.Comparison:
    """Compare codes on a model of the library."""
    path, end = MODELS / name / "model.toml", ENDS.get(name)
    return holonom.compare(
        path, methods=methods, tolerances=tolerances, end_time=end, max_seconds=20.0, **choices
    )


def vehicle() -> list[dict[str, Any]]:
    """Return a row for every profile, code, Jacobian and tolerance on the vehicle."""
    lines = []
    differences = [{"method": code, "jacobian": "differences"} for code in DIFFERENCES]
    for profile in ("improved", "thesis"):
        methods = [*CODES, *differences]
        for row in compare("hmmwv14", methods, TOLERANCES, repeat=3, profile=profile).rows:
            line = {"profile": profile, "method": row.method, "tolerance": row.tolerance.relative}
            line |= {"status": row.status} | {count: row.counts.get(count) for count in COUNTS}
            line |= {"cpu_seconds": row.cpu_seconds, "error": row.error_of("position")}
            lines.append(line)
    return lines


def time_at(rows: Sequence[Any], error: float) -> float | None:
    """Return the processor time for an error, s, between two tolerances on log-log lines.

    The time of the loosest run if that is better already; None if no run is good enough.
    """
    done = [(row.error_of("position"), row.cpu_seconds) for row in rows if row.cpu_seconds]
    for i, (found, time) in enumerate(done):
        if found <= error:
            if i == 0:
                return time
            before, faster = done[i - 1]
            share = math.log(before / error) / math.log(before / found)
            return faster * (time / faster) ** share
    return None


def ranking() -> list[dict[str, Any]]:
    """Return a row for every model, error and code: its time."""
    lines = []
    for path in sorted(MODELS.glob("*/model.toml")):
        name = path.parent.name
        comparison = compare(name, CODES, WIDE, repeat=1, reference_tolerance=REFERENCE)
        for error in ERRORS:
            for code in CODES:
                time = time_at(comparison.of(code), error)
                lines.append({"model": name, "error": error, "method": code, "cpu_seconds": time})
        print(f"{name} done", file=sys.stderr, flush=True)
    return lines


def relative(lines: list[dict[str, Any]], code: str, error: float) -> list[float]:
    """Return the times of a code over those of the default, of the models both reach."""
    times = {(x["model"], x["method"]): x["cpu_seconds"] for x in lines if x["error"] == error}
    names = dict.fromkeys(x["model"] for x in lines)
    pairs = [(times[name, code], times[name, DEFAULT]) for name in names]
    return [a / b for a, b in pairs if a is not None and b is not None]


def ranking_table(lines: list[dict[str, Any]]) -> str:
    """Return the geometric means over the models, best code first."""
    means: dict[str, list[tuple[float, int]]] = {}
    for code in CODES:
        ratios = [relative(lines, code, error) for error in ERRORS]
        means[code] = [(statistics.geometric_mean(r), len(r)) for r in ratios]
    order = sorted(CODES, key=lambda code: math.prod(mean for mean, _ in means[code]))
    head = " | ".join(f"{error:.0e}" for error in ERRORS)
    text = [f"| code | {head} |", "| --- " * (1 + len(ERRORS)) + "|"]
    full = len({line["model"] for line in lines})
    for code in order:
        cells = [f"{m:.2f}" + (f" ({n} of {full})" if n < full else "") for m, n in means[code]]
        text.append(f"| {code} | {' | '.join(cells)} |")
    return "\n".join(text)


def models_table(lines: list[dict[str, Any]], error: float) -> str:
    """Return the times of every model and code at one error, ms."""
    text = ["| model | " + " | ".join(CODES) + " |", "| --- " * (1 + len(CODES)) + "|"]
    part = [line for line in lines if line["error"] == error]
    for name in dict.fromkeys(line["model"] for line in part):
        times = [line["cpu_seconds"] for line in part if line["model"] == name]
        best = min(time for time in times if time is not None)
        cells = ["–" if t is None else f"{1e3 * t:.3g}" for t in times]
        cells = [f"**{c}**" if t == best else c for c, t in zip(cells, times, strict=True)]
        text.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(text)


def vehicle_table(lines: list[dict[str, Any]], profile: str) -> str:
    """Return steps / Jacobians / iterations / time in ms by code and tolerance."""
    text = ["| code | " + " | ".join(f"{tolerance:.0e}" for tolerance in TOLERANCES) + " |"]
    text.append("| --- " * (1 + len(TOLERANCES)) + "|")
    part = [line for line in lines if line["profile"] == profile]
    for code in dict.fromkeys(line["method"] for line in part):
        cells = [
            f"{x['steps']} / {x['jacobians']} / {x['iterations']} / {1e3 * x['cpu_seconds']:.0f}"
            if x["status"] == "completed"
            else x["status"]
            for x in part
            if x["method"] == code
        ]
        text.append(f"| {code} | {' | '.join(cells)} |")
    return "\n".join(text)


def write(name: str, lines: list[dict[str, Any]]) -> None:
    """Write rows to a CSV file beside this one."""
    with (HERE / name).open("w", newline="") as file:
        writer = csv.DictWriter(file, lines[0].keys(), lineterminator="\n")
        writer.writeheader()
        for x in lines:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in x.items()})


def main() -> None:
    """Measure, write the CSV files, print the tables of the pages."""
    on_vehicle = vehicle()
    write("vehicle.csv", on_vehicle)
    for profile in ("improved", "thesis"):
        print(f"\n{profile}\n\n{vehicle_table(on_vehicle, profile)}")
    library = ranking()
    write("results.csv", library)
    print(f"\n{ranking_table(library)}\n\n{models_table(library, ERRORS[1])}", flush=True)


if __name__ == "__main__":
    main()
