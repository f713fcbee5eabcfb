"""The 14-body vehicle over its bump: in motion, with a report and a page to look around in."""

import sys
from pathlib import Path

import numpy as np

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

result = holonom.Model.library("hmmwv14").simulate()
result.sketch(np.arange(0.35, 2.35, 1.0 / 16.0), moving=True, path=pictures / "10_vehicle.svg")

print("report:", result.report("results/vehicle.html"))  # open these in a browser
print("3-D page:", result.view().save("results/vehicle.view.html"))
