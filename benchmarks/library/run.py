"""How far is every model of the library from its reference, at its own tolerance?

`run.py` prints a table and writes `results.csv`; `run.py --write` puts the line of each model into
its README. Counts and errors only: they are the same on every machine up to round-off.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

import holonom

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"
BEGIN, END = "<!-- measured -->", "<!-- end of measured -->"
UNITS = ("m", "rad", "m/s", "rad/s")


def reference(model: Path) -> tuple[list[str], np.ndarray] | None:
    """Return the columns and rows of a model's reference, the time first."""
    path = model / "reference.csv"
    if not path.is_file():
        return None
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    rows = [[float(x) for x in line.split(",")] for line in lines[1:]]
    return lines[0].split(","), np.array(rows)


def measure(folder: Path) -> dict[str, object]:
    """Run a model at its default tolerance; return counts and the largest errors by unit."""
    model = holonom.Model.load(folder / "model.toml")
    whole = model.simulate(channels=[])
    row: dict[str, object] = {
        "model": folder.name,
        "code": whole.meta["method"],
        "end": float(whole.time[-1]),
        "tolerance": model.defaults["tolerance"]["relative"],
        "steps": whole.statistics.steps,
        "rejected": whole.statistics.rejected,
        "jacobians": whole.statistics.jacobians,
    }
    known = reference(folder)
    if known is None:
        return row
    columns, table = known
    times = table[:, 0]
    result = model.simulate(end_time=times[-1], output_times=times, channels=columns[1:])
    for name, exact in zip(columns[1:], table.T[1:], strict=True):
        unit = result.unit(name)
        error = float(np.abs(result[name] - exact).max())
        row[unit] = max(error, float(str(row.get(unit, 0.0))))
    row["until"] = float(times[-1])
    return row


def sentences(row: dict[str, object]) -> str:
    """Return what a README says about a row."""
    text = (
        f"**Measured**, `{row['code']}` at the model's tolerance {row['tolerance']:g}: "
        f"{row['steps']} steps and {row['rejected']} rejected attempts, "
        f"{row['jacobians']} Jacobians to {row['end']:g} s."
    )
    errors = [f"{row[unit]:.1e} {unit}" for unit in UNITS if unit in row]
    if errors:
        until = f"up to {row['until']:g} s"
        text += f" Largest differences from the reference, {until}: {', '.join(errors)}."
    return text


def write(folder: Path, row: dict[str, object]) -> None:
    """Put the sentences into the README of a model."""
    path = folder / "README.md"
    text = path.read_text(encoding="utf-8")
    block = f"{BEGIN}\n{wrapped(sentences(row))}\n{END}\n"
    if BEGIN in text:
        before, rest = text.split(BEGIN)
        text = before + block + rest.split(END)[1].lstrip("\n")
        text = text.replace(f"{END}\n", f"{END}\n\n")
    else:
        text = text.replace("```sh\n", f"{block}\n```sh\n", 1)
    path.write_text(text, encoding="utf-8")


def wrapped(text: str) -> str:
    """Break lines as the other paragraphs do."""
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) > 100:
            lines.append("")
        lines[-1] += (" " if lines[-1] else "") + word
    return "\n".join(lines)


def main() -> None:
    """Measure every model of the library."""
    rows = []
    for folder in sorted(path.parent for path in MODELS.glob("*/model.toml")):
        rows.append(measure(folder))
        print(f"{folder.name}: {sentences(rows[-1])}", flush=True)
        if "--write" in sys.argv:
            write(folder, rows[-1])
    head = ["model", "code", "end", "tolerance", "steps", "rejected", "jacobians", "until", *UNITS]
    with (Path(__file__).parent / "results.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, head, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    main()
