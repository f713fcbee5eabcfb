"""Signals: the slow part of an acceleration, and the derivative of a velocity."""

import sys
from pathlib import Path

import numpy as np

import holonom
from holonom import signals

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

result = holonom.Model.library("hmmwv14").simulate(end_time=2.5)
z = result["chassis.velocity[2]"]
slow = signals.low_pass(result.time, signals.derivative(result.time, z), 4.0)
print("largest slow acceleration:", np.abs(slow).max(), "m/s²")  # the same as a picture:
picture = result.plot("chassis.velocity[2]", derivative=True, low_pass=4.0)
picture.save(pictures / "09_what_is_slow.svg")
