"""Pictures of a report, and the numbers behind them, from which the page draws them anew."""

from __future__ import annotations

import base64
import gzip
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holonom.base.text import escape
from holonom.pictures import svg
from holonom.pictures.picture import Picture, thinned

Series = NDArray[np.float64]

#: Points of all figures together; longer signals keep the ends of the range of every stretch.
MOST_POINTS = 400_000


class Figures:
    """Collects figures with their numbers.

    Parameters
    ----------
    lines : int
        Lines that are expected, among which the numbers are shared.
    """

    def __init__(self, lines: int) -> None:
        self._most = MOST_POINTS // max(lines, 1)
        self._figures: list[dict[str, Any]] = []
        self._blob = bytearray()
        self._places: dict[bytes, int] = {}

    def add(self, picture: Picture, caption: str, whole: Picture | None = None) -> str:
        """Return a figure; `whole` has the same panels with lines that are not thinned."""
        # What is drawn and what is told are one thing: see `page.js`.
        number = len(self._figures)
        self._figures.append(
            {
                "label": picture.label,
                "log": picture.logarithmic,
                "height": picture.height,
                "panels": [
                    {
                        "title": panel.title,
                        "note": panel.note,
                        "label": panel.label,
                        "log": panel.logarithmic,
                        "least": panel.least,
                        "empty": panel.empty,
                        "lines": [
                            {
                                "label": line.label,
                                "color": line.color,
                                "marker": line.marker,
                                "drawn": line.drawn,
                                "dash": line.dash,
                                "wraps": line.wraps,
                                **self._numbers(line.x, line.y, panel.logarithmic),
                            }
                            for line in panel.lines
                        ],
                    }
                    for panel in (whole or picture).panels
                ],
            }
        )
        said = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
        return (
            f'<figure class="plot" data-figure="{number}"><div class="drawing">'
            f"{svg.element(picture)}</div>{said}</figure>"
        )

    def data(self) -> str:
        """Return the element that carries the numbers."""
        head = json.dumps(self._figures, allow_nan=False).encode()
        head += b" " * (-(len(head) + 4) % 8)  # numbers begin at a multiple of their size
        return packed("figures", len(head).to_bytes(4, "little") + head + self._blob)

    def _numbers(self, x: Series, y: Series, logarithmic: bool) -> dict[str, Any]:
        if x.size > self._most:
            x, y = thinned(x, y, self._most)
        # Single precision serves far from zero, too; but along a logarithm each value for itself.
        finite = y[np.isfinite(y)]
        base = 0.0 if logarithmic or not finite.size else float(finite[0])
        return {
            "x": self._put(np.ascontiguousarray(x, "<f8").tobytes()),
            "y": self._put(np.ascontiguousarray(y - base, "<f4").tobytes()),
            "base": base,
            "count": int(x.size),
        }

    def _put(self, data: bytes) -> int:
        """Return where numbers stand; equal ones, as times, stand there once."""
        if data not in self._places:
            self._blob += b"\0" * (-len(self._blob) % 8)
            self._places[data] = len(self._blob)
            self._blob += data
        return self._places[data]


def packed(name: str, data: bytes) -> str:
    """Return an element that carries bytes, compressed, as text that can end no element."""
    text = base64.b64encode(gzip.compress(data, 6, mtime=0)).decode("ascii")
    return f'<script id="{name}" type="application/octet-stream">{text}</script>'
