"""A model written in the script itself; its spectrum shows the natural frequency."""

import sys
from pathlib import Path

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

model = holonom.Model.from_text("""
holonom = 1
title = "Mass on a spring"
dimension = "planar"
[bodies]
block = { mass = 1.0, inertia = 0.1, position = [0.2, 0.0] }
[joints.rail]
type = "translational"
between = ["ground", "block"]
point = [0.0, 0.0]
axis = [1.0, 0.0]
[forces.spring]
type = "tsda"
between = ["ground", "block"]
points = [[-1.0, 0.0], [0.2, 0.0]]
stiffness = 4.0e3
damping = 2.0
free_length = 1.0
[outputs]
channels = ["block.position"]
""")
result = model.simulate(end_time=4.0, interval=0.005)

# sqrt(4000/1)/2π = 10.07 Hz
result.plot("block.position[0]", fft=True, path=pictures / "02_vibration.svg")
