"""What a body looks like: as its model states, or drawn from its joints, points and inertia.

Lengths are metres, points are in body axes. These are pictures: nothing here enters a computation.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holonom.view.encoding import floats, indices

Array = NDArray[np.float64]
Shape = dict[str, Any]

#: A body with more attachments than this is a hull, not a frame of rods.
_MOST_RODS = 6


@dataclass
class Attachments:
    """Where joints and forces sit on a body."""

    points: list[Array] = field(default_factory=list)
    #: Centre, radius and axis of each wheel.
    wheels: list[tuple[Array, float, Array]] = field(default_factory=list)

    def distinct(self, nearest: float) -> list[Array]:
        """Return the points without those nearer to another one than this."""
        kept: list[Array] = []
        for point in self.points:
            if all(np.linalg.norm(point - other) > nearest for other in kept):
                kept.append(point)
        return kept


@dataclass(frozen=True)
class Outline:
    """Shapes of a body, and how thick its rods are (m)."""

    shapes: list[Shape]
    thickness: float


def stated(body: dict[str, Any], size: float) -> Outline | None:
    """Return the shapes that the model states for a body, without those that are not seen at all.

    None where it states none.
    """
    if not body["shapes"]:
        return None
    shapes, thinnest = [], size
    for shape in body["shapes"]:
        if shape["opacity"] == 0.0:
            continue
        drawn = {key: value for key, value in shape.items() if key not in ("name", "position")}
        drawn["at"] = shape["position"]
        if shape["type"] == "mesh":
            vertices = np.array(shape["vertices"])
            drawn |= {"vertices": floats(vertices), "faces": indices(shape["faces"])}
            extent = float(np.ptp(vertices, axis=0).max())
        elif shape["type"] == "box":
            extent = float(min(shape["size"]))
        else:
            extent = 2.0 * float(shape["radius"])
        thinnest = min(thinnest, extent)
        shapes.append(drawn)
    # Joints are drawn as large as the thinnest part, within what is seen and does not cover it.
    return Outline(shapes, float(np.clip(0.5 * thinnest, 0.004 * size, 0.02 * size)))


def wheel_axis(tyre: dict[str, Any], bodies: list[dict[str, Any]]) -> Array:
    """Return the axis of a wheel in axes of its body.

    Roads are heights over x: wheels turn about y of the ground where none is stated.
    """
    if tyre["axis"] is not None:
        return np.array(tyre["axis"])
    body = bodies[tyre["frames"][0]["body"]]
    return np.asarray(rotation(body["euler_parameters"]).T @ np.array([0.0, 1.0, 0.0]))


def rotation(p: list[float]) -> Array:
    """Return the matrix that turns body axes into ground axes, from Euler parameters."""
    e0, e = p[0], np.array(p[1:])
    cross = np.array([[0.0, -e[2], e[1]], [e[2], 0.0, -e[0]], [-e[1], e[0], 0.0]])
    return np.asarray((e0**2 - e @ e) * np.eye(3) + 2.0 * np.outer(e, e) + 2.0 * e0 * cross)


def outline(body: dict[str, Any], attachments: Attachments, size: float, planar: bool) -> Outline:
    """Draw a body.

    Parameters
    ----------
    body : dict
        As the core's geometry gives it: ``mass``, ``inertia``, ``center_of_mass``.
    attachments : Attachments
    size : float
        Size of the whole mechanism, m.
    planar : bool
    """
    points = attachments.distinct(2e-3 * size)
    center = np.array(body["center_of_mass"])
    wheels = [_wheel(*wheel) for wheel in attachments.wheels]
    gyration = _gyration(body, planar)
    lengths = _tree_lengths(points)
    thickness = _thickness(lengths, size)
    if len(points) > _MOST_RODS and not planar:
        hull = {"type": "hull", "points": [p.tolist() for p in points], "radius": 1.2 * thickness}
        return Outline([hull, *wheels], thickness)
    if len(points) <= 1:
        return _lone(body, points, center, gyration, size, planar, wheels)
    rods = [_rod(points[i], points[j], thickness) for i, j in _edges(points)]
    if len(points) == 3 and _area(points) > 0.05 * max(lengths) ** 2:
        rods = [_rod(points[i], points[j], thickness) for i, j in ((0, 1), (1, 2), (2, 0))]
        corners = [p.tolist() for p in points]
        rods.append({"type": "plate", "points": corners, "thickness": 0.7 * thickness})
    nearest = min(points, key=lambda p: float(np.linalg.norm(p - center)))
    if not wheels and _distance_to_rods(center, points) > 0.4 * max(lengths):
        rods.append(_rod(nearest, center, thickness))
        rods.append({"type": "sphere", "at": center.tolist(), "radius": 2.2 * thickness})
    return Outline([*rods, *wheels], thickness)


def _lone(
    body: dict[str, Any],
    points: list[Array],
    center: Array,
    gyration: float,
    size: float,
    planar: bool,
    wheels: list[Shape],
) -> Outline:
    """Draw a body that hangs on one point, or on none."""
    arm = float(np.linalg.norm(points[0] - center)) if points else 0.0
    if arm > 1e-3 * size and gyration < 4.0 * arm:
        whole_rod = gyration > 0.4 * arm  # a uniform rod has its radius of gyration at 0.58
        length = 2.0 * arm if whole_rod else arm
        thickness = _thickness([length], size)
        shapes = [_rod(points[0], points[0] + length / arm * (center - points[0]), thickness)]
        if not whole_rod:
            bob = float(np.clip(1.58 * gyration, 0.09 * arm, 0.4 * arm))
            shapes.append({"type": "sphere", "at": center.tolist(), "radius": bob})
        return Outline([*shapes, *wheels], thickness)
    block = _block(body, center, size, planar)
    return Outline([*([] if wheels else [block]), *wheels], 0.2 * min(block["size"]))


def _block(body: dict[str, Any], center: Array, size: float, planar: bool) -> Shape:
    """Return the box of uniform density that has the mass and inertia of the body."""
    mass = body["mass"] or 1.0
    if planar:
        edge = float(np.sqrt(6.0 * max(body["inertia"][2][2], 0.0) / mass))
        sizes, axes = np.array([edge, 0.7 * edge, 0.5 * edge]), np.eye(3)
    else:
        moments, axes = np.linalg.eigh(np.array(body["inertia"]))
        if np.linalg.det(axes) < 0.0:
            axes = -axes
        sizes = np.sqrt(np.maximum(6.0 / mass * (moments.sum() - 2.0 * moments), 0.0))
    sizes = np.clip(sizes, 0.02 * size, 0.8 * size)
    return {
        "type": "box",
        "size": sizes.tolist(),
        "at": center.tolist(),
        "axes": axes.tolist(),
    }


def _wheel(center: Array, radius: float, axis: Array) -> Shape:
    return {
        "type": "wheel",
        "at": center.tolist(),
        "axis": axis.tolist(),
        "radius": radius,
        "width": 0.52 * radius,
    }


def _rod(first: Array, second: Array, radius: float) -> Shape:
    return {"type": "rod", "from": first.tolist(), "to": second.tolist(), "radius": radius}


def _gyration(body: dict[str, Any], planar: bool) -> float:
    inertia = np.array(body["inertia"])
    moment = inertia[2, 2] if planar else float(np.linalg.eigvalsh(inertia)[-1])
    return float(np.sqrt(max(moment, 0.0) / body["mass"])) if body["mass"] > 0.0 else 0.0


def _thickness(lengths: list[float], size: float) -> float:
    """Return the radius of rods: a part of their length, but seen in the whole picture."""
    if not lengths:
        return 0.01 * size
    length = float(np.median(lengths))
    return min(float(np.clip(0.06 * length, 0.006 * size, 0.02 * size)), 0.14 * length)


def _edges(points: list[Array]) -> list[tuple[int, int]]:
    """Return the shortest tree that joins the points, as pairs of indices."""
    edges, reached = [], [0]
    while len(reached) < len(points):
        pairs = [(i, j) for i in reached for j in range(len(points)) if j not in reached]
        best = min(pairs, key=lambda e: float(np.linalg.norm(points[e[0]] - points[e[1]])))
        edges.append(best)
        reached.append(best[1])
    return edges


def _tree_lengths(points: list[Array]) -> list[float]:
    if len(points) > 60:  # a hull: the tree would take long and is not drawn
        points = points[:60]
    return (
        [float(np.linalg.norm(points[i] - points[j])) for i, j in _edges(points)] if points else []
    )


def _area(points: list[Array]) -> float:
    a, b, c = points
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a)))


def _distance_to_rods(place: Array, points: list[Array]) -> float:
    distances = []
    for i, j in _edges(points):
        along = points[j] - points[i]
        part = np.clip((place - points[i]) @ along / (along @ along), 0.0, 1.0)
        distances.append(float(np.linalg.norm(points[i] + part * along - place)))
    return min(distances)
