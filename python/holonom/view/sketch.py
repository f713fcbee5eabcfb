"""The mechanism as a drawing: an SVG picture of one pose or several, or one that moves.

It shows bodies as their shapes, joints that turn and bushings as dots, or as triangles where they
stand on the ground, springs, dampers, distances, tyres and roads, seen from one side without
perspective. Rails, springs that twist, drivers and forces at points are on the 3-D page alone. It
needs no browser and no graphics card, and a moving one is a small file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holonom.base import files
from holonom.base.errors import UsageError
from holonom.base.plain import as_path
from holonom.base.text import escape
from holonom.states import vector
from holonom.view.encoding import unpacked
from holonom.view.motion import pose_names, poses_of
from holonom.view.scene import scene

if TYPE_CHECKING:
    from holonom.result import Result

Array = NDArray[np.float64]
#: Points of a part in the picture over the frames, ndarray of shape (n_frames, n_points, 2).
Moving = NDArray[np.float64]

WIDTH = 600.0
_LOWEST, _HIGHEST = 150.0, 420.0
_MARGIN = 12.0
#: Pictures per second of a moving sketch, and how many at most.
_RATE, _FRAMES = 20.0, 100
#: A moving sketch takes so long, s: others are slowed down or sped up.
_SHORTEST, _LONGEST = 1.5, 12.0
#: Poses of a still one; those before the last are faint.
_EXPOSURES = 4
_FAINT = 0.28
#: Of bodies, the heaviest first; equal bodies have one colour, as on the page.
_COLORS = (
    "#8797a5", "#3f678f", "#b8744a", "#6a9276", "#c2a04a",
    "#85709c", "#4b8b8d", "#a96464", "#7c8a55", "#9a7f6c",
)  # fmt: skip
_SPRING, _TYRE, _ROAD, _LIGHT = "#d98324", "#30363b", "#9aa3aa", "#e4e8ea"
_INK, _PAPER = "#1f2326", "#ffffff"
_STYLE = (
    f"svg{{color:{_INK};background:{_PAPER}}}"
    "@media(prefers-color-scheme:dark){svg{color:#dfe3e4;background:#1d2124}}"
)


@dataclass(frozen=True, slots=True)
class Sketch:
    """A drawing of a mechanism; notebooks show it, `save` writes it.

    Attributes
    ----------
    title : str
        What is read out where it is not seen.
    body : str
        What stands inside the SVG element.
    height : float
        At a width of 600.
    """

    title: str
    body: str
    height: float
    source: Path | None = None

    def element(self) -> str:
        """Return it as an element that takes text colour and width from its page."""
        return f"{self._head()}>{self.body}</svg>"

    def document(self) -> str:
        """Return it as a file that stands alone, light or dark as its reader wants."""
        size = f'width="{WIDTH:.0f}" height="{self.height:.0f}" color="{_INK}"'
        style = f"<metadata>Holonom</metadata><style>{_STYLE}</style>"
        return f"{self._head()} {size}>{style}{self.body}</svg>\n"

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the drawing as SVG and return its path.

        Parameters
        ----------
        path : path
        force : bool
            Whether a file that is no picture by Holonom may be replaced.

        Raises
        ------
        UsageError
            If the name does not end in ``.svg``.
        FileError
            If the file cannot be written, or would replace another one.
        """
        target = as_path(path)
        if target.suffix.lower() != ".svg":
            raise UsageError(f"{target}: sketches end in .svg", help="name it so")
        return files.write_text(target, "svg", self.document(), inputs=[self.source], force=force)

    def _head(self) -> str:
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {self.height:.0f}" '
            f'role="img" aria-label="{escape(self.title)}" font-size="12" '
            "font-family=\"system-ui,'Segoe UI',Roboto,'DejaVu Sans',sans-serif\""
        )

    def __repr__(self) -> str:
        return f"<holonom.Sketch {self.title!r}: {len(self.body) / 1e3:.0f} kB of SVG>"

    def _repr_svg_(self) -> str:
        return self.document()


def sketch(
    result: Result,
    times: ArrayLike | None = None,
    *,
    moving: bool = False,
    drawn: dict[str, Any] | None = None,
) -> Sketch:
    """Draw the mechanism of a result; see `Result.sketch`.

    `drawn` is its `scene`, where that is there already.
    """
    drawn = scene(result) if drawn is None else drawn
    camera = _Camera(drawn)
    moments = _moments(result, drawn, times, moving)
    model = _Model(result, drawn, moments, camera, moving=moving)
    title = f"{drawn['title']}, {'in motion' if moving else 'drawn from its run'}"
    if not moving:
        exposures = []
        for k in range(moments.size):
            last = k == moments.size - 1
            group = "".join(part.still(k) for part in model.parts)
            exposures.append(group if last else f'<g opacity="{_FAINT}">{group}</g>')
        return Sketch(title, model.road() + "".join(exposures), model.height, result.path)
    length = float(moments[-1] - moments[0])
    seconds = float(np.clip(length, _SHORTEST, _LONGEST)) if length > 0.0 else _SHORTEST
    body = model.road(seconds) + "".join(part.moving(seconds) for part in model.parts)
    speed = length / seconds
    if not 0.99 < speed < 1.01 and speed > 0.0:
        said = f"{1.0 / speed:.3g} times slower" if speed < 1.0 else f"{speed:.3g} times faster"
        place = f'x="{WIDTH - 8:.0f}" y="{model.height - 8:.0f}"'
        body += f'<text {place} text-anchor="end" fill="currentColor" opacity=".6">{said}</text>'
    return Sketch(title, body, model.height, result.path)


def _moments(result: Result, drawn: dict[str, Any], times: ArrayLike | None, moving: bool) -> Array:
    """Return the times of the poses."""
    if times is not None:
        moments = vector(times)
        if not moments.size:
            raise UsageError("`times` are empty", help="pass at least one, s")
        if moments.size > _FRAMES:
            raise UsageError(
                f"{moments.size} poses are too many", help=f"a sketch shows {_FRAMES} at most"
            )
        return moments
    if result.span is None:  # rows only
        rows = result.time
        count = min(rows.size, _FRAMES if moving else _EXPOSURES)
        return np.asarray(rows[np.linspace(0, rows.size - 1, count).round().astype(int)])
    first, last = result.span
    if moving:
        seconds = float(np.clip(last - first, _SHORTEST, _LONGEST))
        return np.linspace(first, last, int(min(_RATE * seconds, _FRAMES)) + 1)
    if drawn["follow"] is None or _is_tied(drawn):
        return np.linspace(first, last, _EXPOSURES)
    # What travels is drawn as often as it passes its own length, as on one photograph.
    probe = np.linspace(first, last, 400)
    name = drawn["bodies"][drawn["follow"]]["name"]
    place = result.sample(probe, [f"{name}.position"])[f"{name}.position"]
    gone = np.linalg.norm(place - place[0], axis=1) / (1.15 * drawn["size"])
    wanted = [int(np.argmax(gone >= k)) for k in range(3) if gone.max() >= k]
    return np.asarray(probe[wanted])


class _Camera:
    """From space to the picture: right, up and towards the eye, without perspective."""

    def __init__(self, drawn: dict[str, Any]) -> None:
        self.planar = drawn["dimension"] == "planar"
        if self.planar:
            self.axes = np.eye(3)
            return
        gravity = np.array(drawn["gravity"], dtype=float)
        size = float(np.linalg.norm(gravity))
        up = -gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
        # Along the first axis that is level: mechanisms stand and vehicles drive along x.
        level = np.eye(3) - np.outer(up, up)
        ahead = level[int(np.argmax(np.linalg.norm(level, axis=1) > 0.7))]
        ahead /= np.linalg.norm(ahead)
        aside = np.cross(up, ahead)
        eye = 0.42 * ahead - 0.80 * aside + 0.36 * up
        eye /= np.linalg.norm(eye)
        right = np.cross(up, eye)
        right /= np.linalg.norm(right)
        self.axes = np.array([right, np.cross(eye, right), eye])

    def __call__(self, points: Array) -> Array:
        return np.asarray(points @ self.axes.T)


@dataclass
class _Part:
    """Something drawn: its points over the frames, and how they become a path."""

    points: Moving
    outline: Callable[[Array], str]
    style: str
    depth: float
    radius: float = 0.0  # of its pen, m

    def still(self, frame: int) -> str:
        return f'<path d="{self.outline(self.points[frame])}" {self.style}/>'

    def moving(self, seconds: float) -> str:
        shapes = [self.outline(points) for points in self.points]
        if len(set(shapes)) == 1:
            return self.still(0)
        return (
            f'<path d="{shapes[0]}" {self.style}><animate attributeName="d" '
            f'values="{";".join(shapes)}" dur="{seconds:g}s" calcMode="discrete" '
            'repeatCount="indefinite"/></path>'
        )


class _Plane(NamedTuple):
    """How near a part is, over the picture: the plane through its points, as far as they have one.

    Attributes
    ----------
    middle : ndarray, shape (3,)
        Right, up and towards the eye, m.
    slope : ndarray, shape (2,)
    """

    middle: Array
    slope: Array

    def is_behind(self, place: Array) -> bool:
        """Return whether a place is nearer than the plane is there."""
        right_up = (place - self.middle)[:2]
        return bool(place[2] >= self.middle[2] + self.slope @ right_up)


def _plane(points: Array, size: float) -> _Plane:
    """Return the plane through points (n, 3); what is seen end on is level, m."""
    middle = points.mean(axis=0)
    across, depth = np.split(points - middle, [2], axis=1)
    least = len(points) * (1e-3 * size) ** 2 * np.eye(2)
    return _Plane(middle, np.linalg.solve(across.T @ across + least, across.T @ depth)[:, 0])


class _Model:
    """All parts in the picture, with its scale."""

    def __init__(
        self,
        result: Result,
        drawn: dict[str, Any],
        moments: Array,
        camera: _Camera,
        *,
        moving: bool,
    ) -> None:
        self._camera, self._drawn = camera, drawn
        model = result.model
        poses = poses_of(model, result.sample(moments, pose_names(model)))
        self._places = [(poses.place[:, k], poses.turn[:, k]) for k in range(len(drawn["bodies"]))]
        follow = drawn["follow"] if moving and not _is_tied(drawn) else None
        self._shift = np.zeros((moments.size, 3))
        if follow is not None:
            self._shift = self._places[follow][0] - self._places[follow][0][0]
            up = camera.axes[1] if camera.planar else _up(drawn)
            self._shift = self._shift - np.outer(self._shift @ up, up)
        self.parts: list[_Part] = []
        self._planes: dict[int, list[_Plane]] = {}
        self._add_bodies()
        self._add_elements()
        self._fit()
        self.parts.sort(key=lambda part: part.depth)

    def _world(self, body: int | None, points: Array) -> Array:
        """Return points of a body in the picture before scaling, (n_frames, n_points, 3)."""
        if body is None:
            moved = np.broadcast_to(points, (self._shift.shape[0], *points.shape))
        else:
            place, turn = self._places[body]
            e0, e = turn[:, None, :1], turn[:, None, 1:]
            moved = points + 2.0 * np.cross(e, np.cross(e, points) + e0 * points) + place[:, None]
        return self._camera(moved - self._shift[:, None])

    def _add(
        self,
        seen: Array,
        outline: Callable[[Array], str],
        style: str,
        nearer: float = 0.0,
        radius: float = 0.0,
        behind: float = -np.inf,
    ) -> None:
        """Add a part by its points (n_frames, n_points, 3), nearer than what is `behind` it, m."""
        depth = max(float(seen[0, :, 2].mean()), behind) + nearer
        self.parts.append(_Part(seen[:, :, :2], outline, style, depth, radius))

    def _add_bodies(self) -> None:
        for number, body in enumerate(self._drawn["bodies"]):
            own = _COLORS[body["kind"] % len(_COLORS)]
            for shape in body["shapes"]:
                solid = _solid(shape)
                if solid is None:
                    continue
                seen = self._world(number, solid.points)
                color = shape.get("color")
                fill = own if color is None else "#{:02x}{:02x}{:02x}".format(*map(int, color))
                opacity = 0.42 if shape["type"] == "hull" else float(shape.get("opacity", 1.0))
                if shape["type"] == "wheel":
                    self._add_wheel(number, shape)
                    continue
                through = f' opacity="{opacity:.2g}"' if opacity < 1.0 else ""
                if solid.outline is _line:
                    style = f'fill="none" stroke="{fill}" {_ROUND}{through}'
                elif solid.radius:
                    style = f'fill="{fill}" stroke="{fill}" {_ROUND}{through}'
                else:
                    edge = _EDGE if shape["type"] != "mesh" else _EDGE.replace(".55", ".2")
                    style = f'fill="{fill}" {edge}{through}'
                self._add(seen, solid.outline, style, radius=solid.radius)
                plane = _plane(seen[0], self._drawn["size"])
                self._planes.setdefault(number, []).append(plane)

    def _add_wheel(self, body: int, wheel: dict[str, Any]) -> None:
        drum = _solid(wheel | {"type": "wheel"})
        assert drum is not None
        seen = self._world(body, drum.points)
        self._add(seen, drum.outline, f'fill="{_TYRE}" {_EDGE}', -1e-3 * self._drawn["size"])
        style = f'fill="none" stroke="{_ROAD}" stroke-width="1.1"'
        rim = self._world(body, _rim(wheel))
        self._add(rim, _spokes, style, 1e-3 * self._drawn["size"])

    def _add_elements(self) -> None:
        size = self._drawn["size"]
        for element in self._drawn["elements"]:
            frames = element["frames"]
            ends = [self._world(f["body"], np.array([f["point"]])) for f in frames]
            kind = element["type"]
            body = frames[0]["body"] if frames else None
            if kind == "tyre" and body is not None and not self._has_wheel(body):
                radius = float(element["radius"])
                axis = element["axis"] or [0.0, 1.0, 0.0]
                place = {"at": frames[0]["point"], "axis": axis, "radius": radius}
                self._add_wheel(body, place | {"width": 0.52 * radius})
            elif kind in ("tsda", "maxwell", "distance") and len(ends) == 2:
                seen = np.concatenate(ends, axis=1)
                color = "currentColor" if kind == "distance" else _SPRING
                style = f'fill="none" stroke="{color}" stroke-width="1.3" stroke-linejoin="round"'
                self._add(seen, _line if kind == "distance" else _coil, style, 0.02 * size)
            elif kind in ("revolute", "spherical", "universal", "cylindrical", "bushing", "fixed"):
                joined = [f["body"] for f in frames if f["body"] is not None]
                ground = len(joined) < len(frames)
                fill = "currentColor" if ground else _LIGHT
                style = f'fill="{fill}" stroke="{_INK}" stroke-width=".9"'
                # It is drawn after what it lies on, whose middle may be nearer than it is.
                on = ends[-1][0, 0] + [0.0, 0.0, nearer := 0.012 * size]
                planes = [plane for k in joined for plane in self._planes.get(k, [])]
                behind = max((p.middle[2] for p in planes if p.is_behind(on)), default=-np.inf)
                symbol = _support if ground else _dot
                self._add(ends[-1], symbol, style, nearer, behind=behind)

    def _has_wheel(self, body: int) -> bool:
        return any(s["type"] == "wheel" for s in self._drawn["bodies"][body]["shapes"])

    def _fit(self) -> None:
        """Scale all parts into the picture."""
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for part in self.parts:
            ends = part.points.reshape(-1, 2)
            low = np.minimum(low, ends.min(axis=0) - part.radius)
            high = np.maximum(high, ends.max(axis=0) + part.radius)
        if not self.parts:
            low, high = np.full(2, -0.5), np.full(2, 0.5)
        room = 0.03 * self._drawn["size"]
        low, high = low - room, high + room
        span = np.maximum(high - low, 1e-12)
        wide = (WIDTH - 2.0 * _MARGIN) / span[0]
        scale = min(wide, (_HIGHEST - 2.0 * _MARGIN) / span[1])
        self.height = float(max(_LOWEST, scale * span[1] + 2.0 * _MARGIN))
        middle = 0.5 * (low + high)
        center = np.array([0.5 * WIDTH, 0.5 * self.height])
        self._scale, self._origin = scale, center - scale * middle * [1.0, -1.0]
        for part in self.parts:
            part.points = self._origin + scale * part.points * [1.0, -1.0]
            if part.radius:
                part.style += f' stroke-width="{max(1.6, 2.0 * scale * part.radius):.1f}"'

    def road(self, seconds: float = 0.0) -> str:
        """Return the roads, which pass below what is followed."""
        drawn = ""
        for road in self._drawn["roads"]:
            x, height = np.array(road["x"]), np.array(road["height"])
            sides = [np.column_stack([x, np.full_like(x, y), height]) for y in road["y"]]
            outline = np.concatenate([sides[0], sides[1][::-1]])
            seen = self._camera(outline)[:, :2]
            places = self._origin + self._scale * seen * [1.0, -1.0]
            style = f'fill="{_ROAD}" fill-opacity=".28" stroke="{_ROAD}" stroke-width=".8"'
            shifts = -self._camera(self._shift)[:, :2] * self._scale * [1.0, -1.0]
            moves = ""
            if np.ptp(shifts, axis=0).max() > 0.0:
                values = ";".join(f"{a:.1f} {b:.1f}" for a, b in shifts)
                moves = (
                    f'<animateTransform attributeName="transform" type="translate" '
                    f'values="{values}" dur="{seconds:g}s" calcMode="discrete" '
                    'repeatCount="indefinite"/>'
                )
            stripes = "".join(
                f'<path d="{_line(self._origin + self._scale * s * [1.0, -1.0])}" fill="none" '
                f'stroke="{_ROAD}" stroke-width=".8"/>'
                for s in self._stripes(road)
            )
            drawn += f'<g><path d="{_line(places)}Z" {style}/>{stripes}{moves}</g>'
        return drawn

    def _stripes(self, road: dict[str, Any]) -> list[Array]:
        """Return lines across a road, by which one sees it move, and where it is not level."""
        x, height = np.array(road["x"]), np.array(road["height"])
        step = 0.25 * self._drawn["size"]
        return [
            self._camera(np.array([[at, y, np.interp(at, x, height)] for y in road["y"]]))[:, :2]
            for at in np.arange(np.ceil(x[0] / step) * step, x[-1], step)
        ]


#: Of what has faces.
_EDGE = 'stroke="currentColor" stroke-opacity=".55" stroke-width=".8" stroke-linejoin="round"'
#: Pens with round ends and corners, as thick as what they draw.
_ROUND = 'stroke-linecap="round" stroke-linejoin="round"'


def _is_tied(drawn: dict[str, Any]) -> bool:
    """Return whether a joint holds the mechanism to the ground: then it goes nowhere."""
    return any(
        element["collection"] == "joints" and any(f["body"] is None for f in element["frames"])
        for element in drawn["elements"]
    )


def _up(drawn: dict[str, Any]) -> Array:
    gravity = np.array(drawn["gravity"], dtype=float)
    size = float(np.linalg.norm(gravity))
    return -gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class _Solid:
    """Points of a shape in body axes, how they become an outline, and how far it is around them."""

    points: Array
    outline: Callable[[Array], str]
    radius: float = 0.0


def _solid(shape: dict[str, Any]) -> _Solid | None:
    kind, radius = shape["type"], float(shape.get("radius") or 0.0)
    middle = np.array(shape["at"], dtype=float) if "at" in shape else np.zeros(3)
    turned = np.array(shape.get("axes") or np.eye(3), dtype=float)
    if kind in ("rod", "capsule"):
        if "from" in shape:
            return _Solid(np.array([shape["from"], shape["to"]], dtype=float), _line, radius)
        half = 0.5 * float(shape["length"]) * turned[:, 2]
        return _Solid(np.array([middle - half, middle + half]), _line, radius)
    if kind == "sphere":
        return _Solid(np.array([middle, middle]), _line, radius)
    if kind in ("plate", "hull"):
        return _Solid(np.array(shape["points"], dtype=float), _hull, radius)
    if kind == "box":
        signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
        corners = middle + (0.5 * np.array(shape["size"]) * signs) @ turned.T
        return _Solid(corners, partial(_facets, _BOX))
    if kind in ("wheel", "cylinder"):
        axis = np.array(shape["axis"], dtype=float) if "axis" in shape else turned[:, 2]
        axis /= np.linalg.norm(axis)
        half = 0.5 * float(shape["width"] if "width" in shape else shape["length"]) * axis
        ring = radius * _ring(axis, _CORNERS)
        return _Solid(np.concatenate([middle + half + ring, middle - half + ring[::-1]]), _drum)
    if kind == "mesh":
        corners = middle + unpacked(shape["vertices"]).reshape(-1, 3) @ turned.T
        faces = unpacked(shape["faces"]).astype(int).reshape(-1, 3)
        if len(faces) > _MOST_FACES:
            return _Solid(corners[:: max(1, len(corners) // 2000)], _hull)
        return _Solid(corners, partial(_facets, faces))
    return None


#: Corners of a round outline; faces of a mesh, beyond which its convex outline is drawn.
_CORNERS, _MOST_FACES = 18, 300
#: Faces of a box by its corners, counter-clockwise from outside.
_BOX = np.array(
    [[4, 6, 7, 5], [0, 1, 3, 2], [2, 3, 7, 6], [0, 4, 5, 1], [1, 5, 7, 3], [0, 2, 6, 4]]
)


def _facing(face: Array) -> bool:
    """Return whether a face is seen from outside; rows of pictures count downwards."""
    x, y = face.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < -0.05


def _facets(faces: NDArray[np.int_], points: Array) -> str:
    """Return the faces that are seen."""
    seen = [points[face] for face in faces]
    return "".join(f"{_line(face)}z" for face in seen if _facing(face)) or _hull(points)


def _drum(points: Array) -> str:
    """Return the outline of a cylinder and the end of it that is seen."""
    ends = points[:_CORNERS], points[_CORNERS:]
    return _hull(points) + "".join(_hull(end) for end in ends if _facing(end))


def _ring(axis: Array, count: int) -> Array:
    """Return points on the unit circle about an axis."""
    along = axis / np.linalg.norm(axis)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    turn = 2.0 * np.pi * np.arange(count) / count
    return np.outer(np.cos(turn), first) + np.outer(np.sin(turn), np.cross(along, first))


def _rim(shape: dict[str, Any]) -> Array:
    """Return points of the rim of a wheel and of its spokes, on the side that is seen."""
    axis = np.array(shape["axis"], dtype=float)
    out = -axis if axis[1] > 0.0 else axis  # the eye is on the side of -y
    center = np.array(shape["at"]) + 0.5 * float(shape["width"]) * out
    ring = center + 0.62 * float(shape["radius"]) * _ring(axis, 15)
    return np.concatenate([ring, center[None]])


def _number(value: float) -> str:
    return f"{value + 0.0:.1f}".removesuffix(".0")


def _line(points: Array) -> str:
    """Return joined points, to a tenth of a pixel, the first as it is and the others by steps."""
    places = np.rint(10.0 * np.asarray(points))
    steps = 0.1 * np.diff(places, axis=0, prepend=np.zeros((1, 2)))
    texts = [f"{_number(x)} {_number(y)}" for x, y in steps]
    return f"M{texts[0]}l{' '.join(texts[1:])}" if len(texts) > 1 else f"M{texts[0]}"


def _dot(points: Array) -> str:
    (x, y) = points[0]
    return f"M{_number(x - 2.5)} {_number(y)}a2.5 2.5 0 1 0 5 0a2.5 2.5 0 1 0-5 0Z"


def _support(points: Array) -> str:
    (x, y) = points[0]
    return f"M{_number(x)} {_number(y - 4.0)}l7 11h-14Z"


def _spokes(points: Array) -> str:
    ring, center = points[:-1], points[-1:]
    spokes = "".join(_line(np.concatenate([center, ring[k : k + 1]])) for k in (0, 5, 10))
    return f"{_line(ring)}z{spokes}"


def _coil(points: Array) -> str:
    """Return a zigzag between two points: as many turns always, so that it is seen to stretch."""
    first, last = points
    along = last - first
    length = float(np.hypot(*along))
    if length < 4.0:
        return _line(points)
    across = np.array([-along[1], along[0]]) / length * min(6.0, 0.16 * length)
    parts = np.array([0.0, 0.14, *(0.17 + 0.66 * (np.arange(8) + 0.5) / 8.0), 0.86, 1.0])
    aside = np.array([0.0, 0.0, *(1.0, -1.0) * 4, 0.0, 0.0])
    return _line(first + np.outer(parts, along) + np.outer(aside, across))


#: Corners that stand out by less than such an area, in square pixels, are not seen.
_FLAT = 0.8


def _hull(points: Array) -> str:
    """Return the convex outline of points."""
    rounded = sorted({(round(float(x), 1), round(float(y), 1)) for x, y in points})
    if len(rounded) < 3:
        return f"{_line(np.array(rounded))}z"
    turns: list[list[tuple[float, float]]] = []
    for order in (rounded, rounded[::-1]):
        chain: list[tuple[float, float]] = []
        for p in order:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= _FLAT:
                chain.pop()
            chain.append(p)
        turns.append(chain[:-1])
    outline = turns[0] + turns[1]
    return f"{_line(np.array(outline))}z"


def _turn(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
