"""Two runs side by side: a softer shoulder, which channels differ, and from when on."""

import sys
from pathlib import Path

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

model = holonom.Model.library("double_pendulum")
stiff = model.simulate()
soft = model.with_values({"parameters.k1": 300.0}).simulate()

print(holonom.diff(stiff, soft))  # in tolerances
stiff.plot(
    "upper.angle",
    "lower.angle",
    others=[soft],
    labels=["400 N m/rad", "300 N m/rad"],
    path=pictures / "04_two_runs.svg",
)
