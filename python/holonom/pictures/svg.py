"""Pictures as SVG: axes with round numbers, lines, legends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from holonom.base.text import escape
from holonom.pictures.picture import Line, Panel, Picture, Series
from holonom.pictures.ticks import Ticks, limits, linear, logarithmic

#: Width of a picture; heights follow. It is readable where this is shown as 400 px.
WIDTH = 600.0
_FONT = 12.5
_SMALL = 11.5
_FAMILY = "system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', Helvetica, Arial, sans-serif"
_ROW = 16.0  # a row of text
_SAMPLE = 32.0  # length of a line in the legend
_GAP = 14.0  # between panels, and between entries of a legend
_RIGHT = 14.0
#: Widths of characters in parts of the font size, about; others take 0.6.
_NARROW = {**dict.fromkeys("iljI.,:;|'!·", 0.28), **dict.fromkeys("ftr()[]-/ ", 0.36)}
_WIDE = {**dict.fromkeys("mwMW@—", 0.95), **dict.fromkeys("ABCDEFGHKLNOPQRSTUVXYZ×+=−", 0.72)}

_INK = "#1f2326"
_PAPER = "#ffffff"
#: Where a picture stands alone it follows the reader's choice of light or dark.
_STYLE = (
    f"svg{{color:{_INK};background:{_PAPER}}}"
    "@media(prefers-color-scheme:dark){svg{color:#dfe3e4;background:#1d2124}"
    ".paper{fill:#1d2124}}"
)

_MARKERS = {
    "circle": "M-3.2 0a3.2 3.2 0 1 0 6.4 0a3.2 3.2 0 1 0 -6.4 0z",
    "square": "M-2.9 -2.9h5.8v5.8h-5.8z",
    "diamond": "M0 -4L4 0L0 4L-4 0z",
    "down": "M-3.7 -3H3.7L0 3.7z",
    "up": "M-3.7 3H3.7L0 -3.7z",
    "plus": "M-1.2 -3.7h2.4v2.5h2.5v2.4h-2.5v2.5h-2.4v-2.5h-2.5v-2.4h2.5z",
    "cross": "M-2.6 -2.6l5.2 5.2m-5.2 0l5.2 -5.2",
}


def document(picture: Picture) -> str:
    """Return a picture as a file that stands alone."""
    body, height = _draw(picture)
    head = _head(picture, height)
    return (
        f'{head} width="{WIDTH:.0f}" height="{height:.0f}" color="{_INK}">'
        f"<metadata>Holonom</metadata><style>{_STYLE}</style>"
        f'<rect class="paper" width="100%" height="100%" fill="{_PAPER}"/>{body}</svg>\n'
    )


def element(picture: Picture) -> str:
    """Return a picture as an element that takes text colour and width from its page."""
    body, height = _draw(picture)
    return f"{_head(picture, height)}>{body}</svg>"


def _head(picture: Picture, height: float) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {height:.0f}" '
        f'role="img" aria-label="{escape(picture.title)}" font-family="{_FAMILY}" '
        f'font-size="{_FONT}"'
    )


def _draw(picture: Picture) -> tuple[str, float]:
    """Return what stands inside the element, and its height."""
    bottom = 2.4 * _ROW + 6.0
    vertical = [_vertical(panel, picture.height) for panel in picture.panels]
    widest = max((text_width(t, _SMALL) for a in vertical for t in a.ticks.labels), default=0.0)
    left = widest + _ROW + 14.0
    across = _Axis.over(
        [line.x for panel in picture.panels for line in panel.lines],
        picture.logarithmic,
        int((WIDTH - left) / 75.0),
        (left, WIDTH - _RIGHT),
        air=any(line.marker and line.drawn for p in picture.panels for line in p.lines),
    )
    parts: list[str] = []
    top = 6.0
    for panel, axis in zip(picture.panels, vertical, strict=True):
        last = panel is picture.panels[-1]
        heading, below = _heading(panel, left, top)
        parts.append(heading)
        axis.place(below + picture.height * WIDTH, below)
        parts += _panel(panel, across, axis, left, numbers=last)
        top = below + picture.height * WIDTH + _GAP
    foot = top - _GAP + 2.0 * _ROW + 4.0
    label = picture.label + (f" ({across.ticks.scale})" if across.ticks.scale else "")
    label = shortened(label, WIDTH - left - _RIGHT)
    middle = 0.5 * (left + WIDTH - _RIGHT)
    parts.append(_text(label, middle, foot, anchor="middle"))
    return "".join(parts), top - _GAP + bottom


@dataclass
class _Axis:
    """From values to places in the picture."""

    low: float
    high: float
    logarithmic: bool
    ticks: Ticks
    first: float = 0.0
    last: float = 1.0

    @classmethod
    def over(
        cls,
        series: Sequence[Series],
        logs: bool,
        most: int,
        ends: tuple[float, float] = (0.0, 1.0),
        *,
        air: bool = True,
    ) -> _Axis:
        """Return an axis that shows all finite values, with at most so many numbers."""
        finite = [s[np.isfinite(s) & ((s > 0.0) | (not logs))] for s in series]
        low = min((float(s.min()) for s in finite if s.size), default=math.nan)
        high = max((float(s.max()) for s in finite if s.size), default=math.nan)
        if air or not low < high:
            low, high = limits(low, high, logs)
        ticks = (logarithmic if logs else linear)(low, high, max(most, 2))
        return cls(low, high, logs, ticks, *ends)

    def place(self, first: float, last: float) -> None:
        self.first, self.last = first, last

    def __call__(self, values: Series) -> Series:
        low, high = self.low, self.high
        if self.logarithmic:
            positive = np.where(values > 0.0, values, np.nan)
            part = np.log(positive / low) / math.log(high / low)
        else:
            part = (values - low) / (high - low)
        return np.asarray(self.first + part * (self.last - self.first))

    def marks(self) -> Iterator[tuple[float, str]]:
        """Yield places and labels of the ticks."""
        places = self(np.array(self.ticks.values, dtype=float))
        return zip(places.tolist(), self.ticks.labels, strict=True)


def _vertical(panel: Panel, height: float) -> _Axis:
    series = [line.y for line in panel.lines]
    series += [end for line in panel.lines if line.band for end in line.band[1:]]
    if panel.level is not None:
        series.append(np.array([panel.level[0]]))
    if panel.least:
        ends = [s[np.isfinite(s)] for s in series]
        low = min((float(s.min()) for s in ends if s.size), default=0.0)
        high = max((float(s.max()) for s in ends if s.size), default=0.0)
        more = max(0.0, 0.5 * (panel.least - (high - low)))
        series.append(np.array([low - more, high + more]))
    return _Axis.over(series, panel.logarithmic, int(height * WIDTH / 28.0))


def _heading(panel: Panel, left: float, top: float) -> tuple[str, float]:
    """Return title and legend, and where the axes begin below them."""
    parts = []
    room = WIDTH - left - _RIGHT
    if panel.title:
        title = shortened(panel.title, (0.6 if panel.note else 0.9) * room)
        note = shortened(panel.note, 0.9 * (room - text_width(title)))
        note = f'<tspan dx="8" font-weight="400" fill-opacity=".65">{escape(note)}</tspan>'
        parts.append(
            f'<text x="{left:.1f}" y="{top + 12.0:.1f}" fill="currentColor" font-weight="600">'
            f"{escape(title)}{note if panel.note else ''}</text>"
        )
        top += _ROW + 2.0
    x, rows = left, 0
    entries: list[tuple[str, Line | None]] = [
        (line.label, line) for line in panel.lines if line.label
    ]
    if panel.level is not None:
        entries.append((panel.level[1], None))
    for label, line in entries:
        label = shortened(label, room - _SAMPLE - 6.0, _SMALL)
        width = _SAMPLE + 6.0 + text_width(label, _SMALL)
        if x > left and x + width > WIDTH - _RIGHT:
            x, rows = left, rows + 1
        y = top + rows * _ROW + 8.0
        parts.append(_sample(line, x, y))
        parts.append(_text(label, x + _SAMPLE + 6.0, y + 4.0, size=_SMALL))
        x += width + _GAP
    if entries:
        top += (rows + 1) * _ROW + 2.0
    return "".join(parts), top + 4.0


def _sample(line: Line | None, x: float, y: float) -> str:
    """Return the sign of a line in the legend."""
    if line is None:
        return _dotted(x, x + _SAMPLE, y)
    parts = ""
    if line.drawn:
        parts += f'<path d="M{x:.1f} {y:.1f}h{_SAMPLE}" {_stroke(line)}/>'
    if line.marker:
        parts += _marked(line, [(x + 0.5 * _SAMPLE, y)])
    return parts


def _panel(
    panel: Panel, across: _Axis, axis: _Axis, left: float, *, numbers: bool
) -> Iterator[str]:
    right, bottom, top = across.last, axis.first, axis.last
    grid, labels = [], []
    for x, label in across.marks():
        grid.append(f"M{x:.1f} {top:.1f}V{bottom:.1f}")
        if numbers and label:
            labels.append(_text(label, x, bottom + 15.0, size=_SMALL, anchor="middle"))
    for y, label in axis.marks():
        grid.append(f"M{left:.1f} {y:.1f}H{right:.1f}")
        labels.append(_text(label, left - 6.0, y + 4.0, size=_SMALL, anchor="end"))
    yield f'<path d="{"".join(grid)}" stroke="currentColor" stroke-opacity=".14" fill="none"/>'
    frame = f"M{left:.1f} {top:.1f}V{bottom:.1f}H{right:.1f}"
    yield f'<path d="{frame}" stroke="currentColor" stroke-opacity=".7" fill="none"/>'
    yield from labels
    said = panel.label + (f" ({axis.ticks.scale})" if axis.ticks.scale else "")
    said = shortened(said, bottom - top + 2.0 * _ROW)
    yield (
        f'<g transform="translate(12 {0.5 * (top + bottom):.1f}) rotate(-90)">'
        f"{_text(said, 0.0, 0.0, anchor='middle')}</g>"
    )
    if panel.level is not None:
        (y,) = axis(np.array([panel.level[0]])).tolist()
        yield _dotted(left, right, y)
    if not any(np.isfinite(line.y).any() for line in panel.lines):
        middle = 0.5 * (left + right), 0.5 * (top + bottom) + 4.0
        yield _text(panel.empty, *middle, anchor="middle", opacity=0.65)
    for line in panel.lines:
        xs, ys = across(line.x), axis(line.y)
        if line.band is not None:
            yield _band(line, across(line.band[0]), *map(axis, line.band[1:]))
        if line.drawn and line.x.size > 1:
            yield f'<path class="line" d="{_path(xs, ys)}" {_stroke(line)}/>'
        if line.marker:
            there = np.isfinite(xs) & np.isfinite(ys)
            yield _marked(line, zip(xs[there].tolist(), ys[there].tolist(), strict=True))


def _path(x: Series, y: Series) -> str:
    """Return joined points; a new piece begins behind those that are not finite."""
    parts, joined = [], False
    there = np.isfinite(x) & np.isfinite(y)
    for a, b, ok in zip(x.tolist(), y.tolist(), there.tolist(), strict=True):
        if ok:
            parts.append(f"{'L' if joined else 'M'}{a:.2f} {b:.2f}")
        joined = ok
    return "".join(parts)


def _band(line: Line, x: Series, low: Series, high: Series) -> str:
    """Return a filled range in pieces."""
    there = np.isfinite(low) & np.isfinite(high)
    ends = np.nonzero(np.diff(there.astype(int), prepend=0, append=0))[0]
    pieces = []
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        whole = slice(first, last)
        outline = np.concatenate([high[whole], low[whole][::-1]])
        pieces.append(_path(np.concatenate([x[whole], x[whole][::-1]]), outline) + "Z")
    color = line.color or "currentColor"
    kind = f'fill="{color}" fill-opacity=".25" stroke="{color}" stroke-opacity=".55"'
    return f'<path class="band" d="{"".join(pieces)}" {kind} stroke-width=".7"/>'


def _stroke(line: Line) -> str:
    color = line.color or "currentColor"
    dash = f' stroke-dasharray="{line.dash}"' if line.dash else ""
    return f'stroke="{color}" stroke-width="1.5" stroke-linejoin="round" fill="none"{dash}'


def _marked(line: Line, places: Iterable[tuple[float, float]]) -> str:
    """Return a sign at each place; such that cover each other are drawn once."""
    sign = _MARKERS[line.marker]
    color = line.color or "currentColor"
    unique = dict.fromkeys((round(2.0 * x) / 2.0, round(2.0 * y) / 2.0) for x, y in places)
    if line.marker == "cross":
        kind = f'stroke="{color}" stroke-width="1.3" fill="none"'
    else:
        kind = f'fill="{color}"'
    body = "".join(f'<path transform="translate({x:g} {y:g})" d="{sign}"/>' for x, y in unique)
    return f'<g class="{line.marker}" {kind}>{body}</g>'


def _dotted(first: float, last: float, y: float) -> str:
    return (
        f'<path d="M{first:.1f} {y:.1f}H{last:.1f}" stroke="currentColor" stroke-width="1" '
        'stroke-dasharray="1.5 3" fill="none"/>'
    )


def _text(
    text: str,
    x: float,
    y: float,
    *,
    size: float = _FONT,
    anchor: str = "start",
    opacity: float = 1.0,
) -> str:
    kind = "" if size == _FONT else f' font-size="{size}"'
    kind += "" if anchor == "start" else f' text-anchor="{anchor}"'
    kind += "" if opacity == 1.0 else f' fill-opacity="{opacity}"'
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="currentColor"{kind}>{escape(text)}</text>'


def text_width(text: str, size: float = _FONT) -> float:
    """Return about how wide a text is."""
    return size * sum(_NARROW.get(c) or _WIDE.get(c) or 0.6 for c in text)


def shortened(text: str, room: float, size: float = _FONT) -> str:
    """Return a text that fits in so much room; its middle is left out where it must be."""
    if text_width(text, size) <= room:
        return text
    keep = len(text)
    while (
        keep > 2 and text_width(text[: (keep + 1) // 2] + "…" + text[-(keep // 2) :], size) > room
    ):
        keep -= max(1, keep // 16)
    return text[: (keep + 1) // 2] + "…" + text[-(keep // 2) :]
