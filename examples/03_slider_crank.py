"""A closed loop: the force in the pin over the angle of the crank."""

import sys
from pathlib import Path

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

result = holonom.Model.library("slider_crank").simulate(interval=1e-3)
result.plot("pin.force", versus="crank.angle", path=pictures / "03_slider_crank.svg")
result.sketch(moving=True, path=pictures / "03_slider_crank_moving.svg")
