"""Six decades of stiffness in as many steps: what an implicit code on free coordinates is for."""

import sys
from pathlib import Path

import numpy as np

import holonom
from holonom.pictures.picture import Line, Panel, Picture

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

model = holonom.Model.library("stiff_slider")
stiffness = 10.0 ** np.arange(5.0, 12.0)
steps = []
for k in stiffness:
    stiffer = model.with_values({"parameters.stiffness": k, "parameters.damping": 0.1 * k})
    steps.append(float(stiffer.simulate().statistics.steps))
    print(f"{k:8.0e} N/m {steps[-1]:4.0f} steps")

line = Line(stiffness, np.array(steps), marker="circle")
picture = Picture("steps", [Panel([line], "steps", least=50.0)], "N/m", logarithmic=True)
picture.save(pictures / "06_stiffness.svg")
