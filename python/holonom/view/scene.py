"""A result as the page draws it: bodies with shapes and poses, elements, roads, channels.

Everything that moves comes from `Result.sample`; attachments come from the core's geometry.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import UsageError
from holonom.pictures.curves import components
from holonom.summary import STATUS
from holonom.view.encoding import curves, floats, turns
from holonom.view.shapes import Attachments, outline, rotation, stated, wheel_axis

if TYPE_CHECKING:
    from holonom.model import Model
    from holonom.result import Result

Array = NDArray[np.float64]
Poses = dict[str, tuple[Array, Array]]

#: Frames of a page: at least, per simulated second, and per turn of the fastest body.
FRAMES, FRAMES_PER_SECOND, FRAMES_PER_TURN = 480, 100.0, 16.0
#: Bytes of poses and of channels, before they are written as text.
POSE_BYTES, CHANNEL_BYTES = 4_000_000, 4_000_000
_BYTES_PER_POSE = 20

#: Joints whose point on the line of motion says nothing of the body's shape.
_SLIDING = ("translational", "cylindrical")
#: Quantities that the page has in another form.
_LEFT_OUT = ("euler_parameters",)


def scene(result: Result, channel_bytes: int = CHANNEL_BYTES) -> dict[str, Any]:
    """Return one run as plain data for the page, with so many bytes of channels at most.

    Raises
    ------
    UsageError
        If the result has no rows.
    """
    times = frame_times(result)
    meta = result.meta
    poses = poses_of(result.model, lambda names: result.sample(times, names))
    return {
        "title": str(meta.get("title") or meta.get("name") or "run"),
        "name": str(meta.get("name", "")),
        "file": result.path.name if result.path else "",
        "status": STATUS[result.status],
        "completed": result.status == "completed",
        "method": str(result.options.get("method", "")),
        **mechanism(result.model, result.items, times, poses),
        "channels": _channels(result, times, channel_bytes),
    }


def mechanism(model: Model, items: Mapping[str, Any], times: Array, poses: Poses) -> dict[str, Any]:
    """Return what moves, as plain data: bodies with shapes and poses, elements, roads."""
    geometry = model.geometry
    bodies, elements = geometry["bodies"], geometry["elements"]
    planar = geometry["dimension"] == "planar"
    size = _size(bodies, elements)
    titles = {
        name: str(item.get("title", ""))
        for group in ("bodies", "joints", "forces", "drivers")
        for name, item in items.get(group, {}).items()
    }
    attachments = _attachments(bodies, elements)
    outlines = [
        stated(body, size) or outline(body, attachments[number], size, planar)
        for number, body in enumerate(bodies)
    ]
    thickness = [drawn.thickness for drawn in outlines]
    kinds = {mass: k for k, mass in enumerate(_by_weight(bodies))}
    return {
        "dimension": geometry["dimension"],
        "gravity": geometry["gravity"],
        "size": size,
        "times": floats(times - times[0]),
        "start": float(times[0]),
        "follow": _follow(bodies, poses, size),
        "bodies": [
            {
                "name": body["name"],
                "title": titles.get(body["name"], ""),
                "center": body["center_of_mass"],
                "kind": kinds[_weight(body)],
                "thickness": drawn.thickness,
                "shapes": drawn.shapes,
                "origin": poses[body["name"]][0][0].tolist(),
                # From the first place on, so that single precision is enough far from the origin.
                "position": floats(poses[body["name"]][0] - poses[body["name"]][0][0]),
                "rotation": turns(poses[body["name"]][1]),
            }
            for body, drawn in zip(bodies, outlines, strict=True)
        ],
        "elements": [
            element
            | {"title": titles.get(element["name"], ""), "size": _symbol(element, thickness, size)}
            | ({"axis": wheel_axis(element, bodies).tolist()} if element["type"] == "tyre" else {})
            for element in elements
        ],
        "roads": roads(model, poses),
    }


def frame_times(result: Result) -> Array:
    """Return the times of the frames: even, or those of stored rows where no steps are stored."""
    bodies = result.model.geometry["bodies"]
    most = max(2, POSE_BYTES // (_BYTES_PER_POSE * max(1, len(bodies))))
    span = result.span
    if span is None or span[1] <= span[0]:
        rows = result.time
        if not rows.size:
            raise UsageError(
                "the result has no rows: there is nothing to show", help="run it again, for longer"
            )
        chosen = np.linspace(0, rows.size - 1, min(rows.size, most)).round().astype(int)
        return np.asarray(rows[chosen])
    first, last = span
    wanted = max(FRAMES, FRAMES_PER_SECOND * (last - first))
    # A body that turns far between two frames would seem to turn another way.
    probe = np.linspace(first, last, 200)
    rates = result.sample(probe, [f"{body['name']}.angular_velocity" for body in bodies])
    rates.pop("time")
    fastest = np.zeros(probe.size)
    for rate in rates.values():
        fastest = np.maximum(fastest, np.linalg.norm(rate.reshape(probe.size, -1), axis=1))
    wanted = max(wanted, FRAMES_PER_TURN * float(np.trapezoid(fastest, probe)) / (2.0 * np.pi))
    return np.linspace(first, last, int(min(wanted, most)) + 1)


def poses_of(model: Model, sample: Callable[[list[str]], Mapping[str, Array]]) -> Poses:
    """Return positions (n_times, 3) and Euler parameters (n_times, 4) of the bodies by name."""
    names = [body["name"] for body in model.geometry["bodies"]]
    planar = model.geometry["dimension"] == "planar"
    turn = "angle" if planar else "euler_parameters"
    sampled = sample([f"{n}.{q}" for n in names for q in ("position", turn)])
    poses = {}
    for name in names:
        place, turned = sampled[f"{name}.position"], sampled[f"{name}.{turn}"]
        if planar:
            zero = np.zeros(len(place))
            place = np.column_stack([place, zero])
            half = 0.5 * turned
            turned = np.column_stack([np.cos(half), zero, zero, np.sin(half)])
        poses[name] = (place, turned)
    return poses


def _attachments(
    bodies: list[dict[str, Any]], elements: list[dict[str, Any]]
) -> dict[int, Attachments]:
    found: dict[int, Attachments] = defaultdict(Attachments)
    for element in elements:
        if element["collection"] == "drivers" or element["type"] in (*_SLIDING, "torque", "rsda"):
            continue
        for frame in element["frames"]:
            if frame["body"] is None:
                continue
            point = np.array(frame["point"])
            if element["type"] == "tyre":
                wheel = (point, float(element["radius"]), wheel_axis(element, bodies))
                found[frame["body"]].wheels.append(wheel)
            found[frame["body"]].points.append(point)
    return found


def _size(bodies: list[dict[str, Any]], elements: list[dict[str, Any]]) -> float:
    """Return the size of the mechanism in its design configuration, m."""
    places = [np.array(body["position"]) for body in bodies]
    for element in elements:
        for frame in element["frames"]:
            point = np.array(frame["point"])
            if frame["body"] is not None:
                body = bodies[frame["body"]]
                point = np.array(body["position"]) + rotation(body["euler_parameters"]) @ point
            places.append(point)
    if not places:
        return 1.0
    extent = float(np.linalg.norm(np.ptp(np.array(places), axis=0)))
    if extent > 0.0:
        return extent
    gyrations = [np.sqrt(body["inertia"][2][2] / (body["mass"] or 1.0)) for body in bodies]
    return 4.0 * float(max(gyrations, default=0.0)) or 1.0


def _weight(body: dict[str, Any]) -> str:
    return f"{body['mass']:.6g}"


def _by_weight(bodies: list[dict[str, Any]]) -> list[str]:
    """Return the masses that occur, the largest first: equal bodies have one colour."""
    return sorted({_weight(body) for body in bodies}, key=lambda text: -float(text))


def _symbol(element: dict[str, Any], thickness: list[float], size: float) -> float:
    """Return the radius of the symbol of an element, m."""
    near = [thickness[f["body"]] for f in element["frames"] if f["body"] is not None]
    # Not too different from each other: a short link has small joints, but joints that are seen.
    usual = float(np.median(thickness)) if thickness else 0.01 * size
    return float(np.clip(1.6 * min(near, default=usual), 1.2 * usual, 2.4 * usual))


def _follow(bodies: list[dict[str, Any]], poses: Poses, size: float) -> int | None:
    """Return the body that the camera follows: the heaviest one, where it travels far."""
    if not bodies:
        return None
    heaviest = max(range(len(bodies)), key=lambda k: bodies[k]["mass"])
    travel = float(np.ptp(poses[bodies[heaviest]["name"]][0], axis=0).max())
    return heaviest if travel > 1.2 * size else None


def roads(model: Model, poses: Poses) -> list[dict[str, Any]]:
    """Return the roads under tyres, as heights over the way that their wheels go."""
    bodies, elements = model.geometry["bodies"], model.geometry["elements"]
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for element in elements:
        if element["type"] == "tyre":
            groups[repr(element["road"])].append(element)
    found = []
    for tyres in groups.values():
        ways = [poses[bodies[tyre["frames"][0]["body"]]["name"]][0] for tyre in tyres]
        radius = max(float(tyre["radius"]) for tyre in tyres)
        low = np.min([way.min(axis=0) for way in ways], axis=0)
        high = np.max([way.max(axis=0) for way in ways], axis=0)
        x = np.arange(low[0] - 12.0 * radius, high[0] + 24.0 * radius, 0.06 * radius)
        heights = np.array(model.road_heights(tyres[0]["name"], x))
        # Of even stretches the ends are enough.
        bends = np.diff(heights, 2) != 0.0
        kept = np.concatenate([[True], bends, [True]])
        kept[:-1] |= kept[1:]
        kept[1:] |= kept[:-1]
        found.append(
            {
                "x": x[kept].tolist(),
                "height": heights[kept].tolist(),
                "y": [float(low[1]) - 2.0 * radius, float(high[1]) + 2.0 * radius],
            }
        )
    return found


def _channels(result: Result, times: Array, room: int) -> list[dict[str, Any]]:
    """Return the channels that fit into the page, those that the run was asked for first."""
    known = result.model.channels
    names = [n for n in known if n.rpartition(".")[2] not in _LEFT_OUT or n in result.requested]
    first = {name.partition("[")[0] for name in result.requested}

    def rank(name: str) -> int:
        return 0 if name in first else 1 if name.endswith(("force", "torque")) else 2

    chosen = []
    for name in sorted(names, key=rank):
        room -= 2 * known[name].size * times.size
        if room >= 0:
            chosen.append(name)
    sampled = result.sample(times, chosen) if chosen else {}
    chosen.sort(key=names.index)
    return [
        {
            "name": name,
            "item": name.partition(".")[0],
            "quantity": name.partition(".")[2],
            "unit": known[name].unit,
            "frame": known[name].frame,
            "asked": name in first,
            "components": components(name, known[name].size),
        }
        | curves(sampled[name].reshape(times.size, -1))
        for name in chosen
    ]
