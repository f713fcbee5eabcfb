"""Fifty stiff pendulums in a row fall: a larger model, drawn at five times."""

import sys
from pathlib import Path

import numpy as np

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

result = holonom.Model.library("chain50").simulate()
print(result.statistics.steps, "steps")
result.sketch(np.linspace(0.0, 1.0, 5), path=pictures / "07_chain.svg")
