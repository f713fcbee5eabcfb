"""A four-bar in space, with the measured error of every channel."""

import sys
from pathlib import Path

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

result = holonom.Model.library("spatial_four_bar").simulate(certify=True)
for channel in result.certification.ranked[:3]:
    print(f"{channel.name}: {channel.tolerances:.2g} tolerances at {channel.time:.3g} s")
result.plot("coupler.position", "ball.force", path=pictures / "08_certified.svg")
