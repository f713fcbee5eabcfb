"""Resident memory of ``holonom run`` on the 14-body vehicle.

Run with the package installed: ``python benchmarks/memory/run.py``.
"""

import csv
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
MODEL = HERE / "../../models/hmmwv14/model.toml"
ALLOWED_MB = 150.0


def peak(arguments: list[str]) -> float:
    """Largest resident set of a child process, MB (of the largest child so far)."""
    subprocess.run(
        [sys.executable, "-m", "holonom", *arguments], check=True, stdout=subprocess.DEVNULL
    )
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 / 1e6


def main() -> None:
    """Measure, smaller before larger because the figure is that of the largest child so far."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            ("holonom --help", peak(["--help"])),
            ("holonom run", peak(["run", str(MODEL), "-o", f"{folder}/hmmwv14.holonom"])),
        ]
    with (HERE / "results.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["command", "peak_resident_mb"])
        for command, size in rows:
            writer.writerow([command, f"{size:.1f}"])
            print(f"{command}: {size:.1f} MB")
    assert rows[-1][1] < ALLOWED_MB, f"more than {ALLOWED_MB} MB"


if __name__ == "__main__":
    main()
