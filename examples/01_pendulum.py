"""A pendulum from the library: run it, look at numbers, draw it in five poses."""

import sys
from pathlib import Path

import numpy as np

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

model = holonom.Model.library("simple_pendulum")
print(model.check())
result = model.simulate(end_time=2.0, tolerance=1e-6)
print(result.channels)
print("lowest point:", result["bob.position"][:, 1].min(), result.unit("bob.position"))

result.sketch(np.linspace(0.0, 0.8, 5), path=pictures / "01_pendulum.svg")
