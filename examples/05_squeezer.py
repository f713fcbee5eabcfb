"""Andrews' squeezing mechanism: seven bodies in three loops within 30 ms, slowed down."""

import sys
from pathlib import Path

import holonom

pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures"

result = holonom.Model.library("andrews").simulate()
result.sketch(moving=True, path=pictures / "05_squeezer.svg")
