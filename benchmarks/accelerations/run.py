"""Time of accelerations in Cartesian coordinates by solver and numbering of the joints.

Run with cargo installed: ``python benchmarks/accelerations/run.py``. It builds and runs the example
``accelerations`` of the engine.
"""

import csv
import os
import subprocess
from pathlib import Path

HERE = Path(__file__).parent
COMMAND = "cargo run --release --quiet -p holonom --example accelerations --features general-sparse"
PIVOTING = "augmented sparse LU (pivoting)"
TOPOLOGY = "reduced envelope Cholesky"
PLANAR = ["seven-body", "chain of 50"]
SPATIAL = ["seven-body in space", "chain of 50 in space", "spatial four-bar", "14-body vehicle"]
ALLOWED_DIFFERENCE = 1e-9
VEHICLE = "14-body vehicle"
AGAINST_DENSE = [
    ("accelerations", "dense LU", 0.5),
    ("integration Jacobian", "dense LU with right-hand sides", 1.0),
]


def main() -> None:
    """Measure, write ``results.csv`` and hold the ratios against their bounds."""
    found = subprocess.run(
        COMMAND.split(), check=True, stdout=subprocess.PIPE, text=True, cwd=HERE, env=os.environ
    )
    (HERE / "results.csv").write_text(found.stdout)
    rows = list(csv.DictReader(found.stdout.splitlines()))
    time = {
        (row["table"], row["model"], row["solver"], row["numbering"]): float(row["ms_per_1000"])
        for row in rows
    }
    for row in rows:
        print(
            f"table {row['table']}  {row['model']:21} {row['solver']:35} {row['numbering']:6}"
            f"{row['ms_per_1000']:>12} ms"
        )
        assert float(row["difference"]) < ALLOWED_DIFFERENCE, row
    for models, bound in [(PLANAR, 6.0), (SPATIAL, 3.0)]:
        for model in models:
            ratio = time["2", model, PIVOTING, ""] / time["2", model, TOPOLOGY, "good"]
            print(f"{model}: {ratio:.1f} times as fast as the pivoting sparse LU, bound {bound}")
            assert ratio >= bound, model
    numbering = (
        time["3", "chain of 50", "envelope Cholesky", "bad"]
        / time["4", "chain of 50", "envelope Cholesky", "good"]
    )
    print(f"chain of 50: good numbering {numbering:.1f} times as fast as bad, bound 3")
    assert numbering >= 3.0
    for what, measure, bound in AGAINST_DENSE:
        ratio = time["dense", VEHICLE, what, ""] / time["dense", VEHICLE, measure, ""]
        verdict = "held" if ratio <= bound else "missed"
        print(f"{VEHICLE}: {what} {ratio:.2f} times the {measure}, bound {bound}: {verdict}")


if __name__ == "__main__":
    main()
