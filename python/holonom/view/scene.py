"""A result as the page draws it: bodies with shapes and poses, elements, roads, channels.

Everything that moves comes from rows of the result or from `Result.sample`; attachments come from
the core's geometry.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from holonom.base.errors import UsageError
from holonom.channels import component_units, components
from holonom.states import computed_from
from holonom.summary import STATUS
from holonom.view.encoding import curves, floats, halves, limits, turns
from holonom.view.motion import Knots, Way, pose_names, poses_of
from holonom.view.shapes import Attachments, outline, rotation, stated, wheel_axis

if TYPE_CHECKING:
    from holonom.model import Model
    from holonom.result import Result

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: Frames of a page: at least, per simulated second, and per turn of the fastest body.
FRAMES, FRAMES_PER_SECOND, FRAMES_PER_TURN = 480, 100.0, 16.0
#: Frames times bodies, at most: more of both, and channels do not fit into a page.
MOST_FRAMES = 100_000
#: Moments that are looked at for each frame, so that nothing between frames is lost.
MOMENTS_PER_FRAME = 4
#: Moments times bodies, at most: where states are computed from steps, and where rows are read.
MOST_COMPUTED, MOST_READ = 1_000_000, 20_000_000
#: Poses that are taken in one piece.
_PIECE = 200_000
#: Bytes of channels, before they are written as text; of a value with its range to the next frame.
CHANNEL_BYTES, _VALUE_BYTES = 4_000_000, 6
#: Part of its range by which a curve may leave the line between two frames unseen.
_UNSEEN = 0.005

#: Joints whose point on the line of motion says nothing of the body's shape.
_SLIDING = ("translational", "cylindrical")
#: Quantities that the page has in another form.
_LEFT_OUT = ("euler_parameters",)


def scene(result: Result, channel_bytes: int = CHANNEL_BYTES) -> dict[str, Any]:
    """Return one run as plain data for the page, with so many bytes of channels at most.

    ``missed`` says how far bodies are drawn from the moments looked at: m, rad.

    Raises
    ------
    UsageError
        If the result has no rows.
    """
    model, meta = result.model, result.meta
    times, frames, stride = moments(result, channel_bytes)
    chosen = _chosen(result, frames.size, channel_bytes)
    width = sum(model.channels[name].size for name in chosen)
    knots = Knots(size_of(model), _reaches(model), times.size)
    traces = _Traces(frames, width)
    names = list(dict.fromkeys([*chosen, *pose_names(model)]))
    piece = max(2, _PIECE // max(1, len(model.geometry["bodies"])))
    for first in range(0, max(times.size - 1, 1), piece):
        now = times[first : first + piece + 1]
        rows = _rows(result, stride, first, now, names)
        knots.add(now, poses_of(model, rows))
        flat = [rows[name].reshape(now.size, -1) for name in chosen]
        traces.add(first, np.hstack([np.empty((now.size, 0)), *flat]))
    traces.finish()
    return {
        "title": str(meta.get("title") or meta.get("name") or "run"),
        "name": str(meta.get("name", "")),
        "file": result.path.name if result.path else "",
        "status": STATUS[result.status],
        "completed": result.status == "completed",
        "method": str(result.options.get("method", "")),
        "missed": list(knots.error),
        **mechanism(model, result.written_out, times[frames], knots.ways()),
        "channels": _channels(result, chosen, traces, channel_bytes),
    }


def mechanism(
    model: Model, items: Mapping[str, Any], times: Array, ways: Sequence[Way]
) -> dict[str, Any]:
    """Return what moves, as plain data: bodies with shapes and ways, elements, roads.

    Parameters
    ----------
    model : Model
    items : mapping
        The model as plain data, with titles.
    times : ndarray, shape (n_frames,)
        Of the frames, which channels have and keys step through, s.
    ways : sequence of Way
        How the bodies move.
    """
    geometry = model.geometry
    bodies, elements = geometry["bodies"], geometry["elements"]
    planar = geometry["dimension"] == "planar"
    size = size_of(model)
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
        "follow": _follow(bodies, ways, size),
        "bodies": [
            {
                "name": body["name"],
                "title": titles.get(body["name"], ""),
                "center": body["center_of_mass"],
                "kind": kinds[_weight(body)],
                "shapes": drawn.shapes,
                "origin": way.place[0].tolist(),
                **moved(way, way.place[0], times[0]),
            }
            for body, drawn, way in zip(bodies, outlines, ways, strict=True)
        ],
        "elements": [
            element
            | {"title": titles.get(element["name"], ""), "size": _symbol(element, thickness, size)}
            | ({"axis": wheel_axis(element, bodies).tolist()} if element["type"] == "tyre" else {})
            for element in elements
        ],
        "roads": roads(model, ways),
    }


def moved(way: Way, origin: Array, start: float) -> dict[str, Any]:
    """Return the way of a body from a place and a time on: so single precision is enough."""
    return {
        "times": floats(way.times - start),
        "position": floats(way.place - origin),
        "velocity": halves(way.velocity),
        "rotation": turns(way.turn),
        "spin": halves(way.spin),
    }


def _rows(
    result: Result, stride: int, first: int, times: Array, names: list[str]
) -> dict[str, Array]:
    """Return channels at some of the moments."""
    if stride:
        try:
            rows = result.rows(stride * first, stride * (times.size - 1) + 1, names)
        except UsageError:  # states that are lost from a damaged file; its steps may be there
            if result.span is None:
                raise
        else:
            return {name: values[::stride] for name, values in rows.items()}
    return result.sample(times, names)


class Moments(NamedTuple):
    """The times of a run that are looked at, ndarray, s, and the places of the frames among them.

    They are every `stride` th row, or computed from the steps where that is 0.
    """

    times: Array
    frames: Indices
    stride: int


def moments(result: Result, channel_bytes: int = CHANNEL_BYTES) -> Moments:
    """Return what is looked at: the rows where they are near to each other, else even times.

    Frames are fewer, down to `FRAMES`, where all channels that the run was asked for fit into so
    many bytes then.

    Raises
    ------
    UsageError
        If the result has no rows.
    """
    bodies = max(1, len(result.model.geometry["bodies"]))
    most = max(2, MOST_FRAMES // bodies)
    known = result.model.channels
    asked = sum(known[name].size for name in _asked(result) if name in known)
    room = channel_bytes // (_VALUE_BYTES * max(1, asked))
    fitting = room + 1 if room >= FRAMES else most  # fewer frames alone would not make room
    stride = -(-result.time.size // max(2, MOST_READ // bodies))
    rows, span = result.time[:: max(1, stride)], result.span
    if span is None or span[1] <= span[0]:
        if not rows.size:
            raise UsageError(
                "the result has no rows: there is nothing to show", help="run it again, for longer"
            )
        return Moments(rows, _spread(rows.size, min(most, fitting)), stride)
    wanted = min(_wanted(result, *span), most)
    count = min(MOMENTS_PER_FRAME * wanted, max(wanted, MOST_COMPUTED // bodies))
    shown = min(wanted + 1, fitting)
    gaps = np.diff(rows, prepend=span[0], append=span[1])
    if rows.size and rows[0] == span[0] and gaps.max() <= 2.0 * (span[1] - span[0]) / count:
        return Moments(rows, _spread(rows.size, shown), stride)
    return Moments(np.linspace(*span, count + 1), _spread(count + 1, shown), 0)


def _spread(count: int, most: int) -> Indices:
    """Return the places of so many at most, evenly from the first to the last."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)


def _wanted(result: Result, first: float, last: float) -> int:
    """Return how many frames show a run: what turns fast must not seem to turn another way."""
    bodies = result.model.geometry["bodies"]
    probe = np.linspace(first, last, 200)
    rates = result.sample(probe, [f"{body['name']}.angular_velocity" for body in bodies])
    rates.pop("time")
    fastest = np.zeros(probe.size)
    for rate in rates.values():
        fastest = np.maximum(fastest, np.linalg.norm(rate.reshape(probe.size, -1), axis=1))
    turned = float(np.trapezoid(fastest, probe)) / (2.0 * np.pi)
    return int(max(FRAMES, FRAMES_PER_SECOND * (last - first), FRAMES_PER_TURN * turned))


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


def size_of(model: Model) -> float:
    """Return the size of the mechanism in its design configuration, m."""
    bodies, elements = model.geometry["bodies"], model.geometry["elements"]
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


def _reaches(model: Model) -> Array:
    """Return how far points of the bodies are from their origins, about, m."""
    bodies, elements = model.geometry["bodies"], model.geometry["elements"]
    attachments = _attachments(bodies, elements)
    reaches = []
    for number, body in enumerate(bodies):
        gyration = np.sqrt(np.max(body["inertia"]) / (body["mass"] or np.inf))
        far = [np.linalg.norm(p) for p in attachments[number].points]
        reaches.append(max([2.0 * gyration, *far]))
    return np.array(reaches)


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


def _follow(bodies: list[dict[str, Any]], ways: Sequence[Way], size: float) -> int | None:
    """Return the body that the camera follows: the heaviest one, where it travels far."""
    if not bodies:
        return None
    heaviest = max(range(len(bodies)), key=lambda k: bodies[k]["mass"])
    travel = float(np.ptp(ways[heaviest].place, axis=0).max())
    return heaviest if travel > 1.2 * size else None


def roads(model: Model, ways: Sequence[Way]) -> list[dict[str, Any]]:
    """Return the roads under tyres, as heights over the way that their wheels go."""
    elements = model.geometry["elements"]
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for element in elements:
        if element["type"] == "tyre":
            groups[repr(element["road"])].append(element)
    found = []
    for tyres in groups.values():
        places = np.concatenate([ways[tyre["frames"][0]["body"]].place for tyre in tyres])
        radius = max(float(tyre["radius"]) for tyre in tyres)
        low, high = places.min(axis=0), places.max(axis=0)
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


class _Traces:
    """Channels at the frames, and their ranges between these.

    Attributes
    ----------
    values : ndarray, shape (n_frames, width)
        At the frames.
    lowest, highest : ndarray, shape (n_frames - 1, width)
        From each frame to the next, both included.
    """

    def __init__(self, frames: Indices, width: int) -> None:
        self._frames = frames
        self.values = np.full((frames.size, width), np.nan)
        self.lowest = np.full((frames.size - 1, width), np.nan)
        self.highest = self.lowest.copy()

    def add(self, first: int, rows: Array) -> None:
        """Take channels, (n_times, width), at moments from `first` on; pieces share one moment."""
        frames, last = self._frames, first + len(rows) - 1
        here = np.nonzero((frames >= first) & (frames <= last))[0]
        self.values[here] = rows[frames[here] - first]
        # The stretches that have a part in this piece.
        begin = max(0, int(np.searchsorted(frames, first, "right")) - 1)
        end = min(frames.size - 1, int(np.searchsorted(frames, last)))
        if begin < end:
            starts = np.maximum(frames[begin:end] - first, 0)
            for kept, least in ((self.lowest, np.fmin), (self.highest, np.fmax)):
                found = least.reduceat(rows[: frames[end] - first + 1], starts, axis=0)
                kept[begin:end] = least(kept[begin:end], found)

    def finish(self) -> None:
        """Add to each stretch the frame at its end, which stands in the next one."""
        self.lowest = np.fmin(self.lowest, self.values[1:])
        self.highest = np.fmax(self.highest, self.values[1:])


def _chosen(result: Result, frames: int, room: int) -> list[str]:
    """Return the channels that may fit into the page, those that the run was asked for first."""
    known = result.model.channels
    names = [n for n in known if n.rpartition(".")[2] not in _LEFT_OUT or n in result.requested]
    there = {"", *result.quantities}  # of a damaged file a part of the states may be lost
    names = [n for n in names if n in there or computed_from(n, result.model) in there]
    first = _asked(result)

    def rank(name: str) -> int:
        return 0 if name in first else 1 if name.endswith(("force", "torque")) else 2

    chosen = []
    for name in sorted(names, key=rank):
        room -= 2 * known[name].size * frames
        if room >= 0:
            chosen.append(name)
    return chosen


def _asked(result: Result) -> set[str]:
    return {name.partition("[")[0] for name in result.requested}


def _channels(
    result: Result, chosen: list[str], traces: _Traces, room: int
) -> list[dict[str, Any]]:
    """Return the chosen channels, with ranges where the lines between frames say too little."""
    known, first = result.model.channels, _asked(result)
    found = {}
    end = 0
    for name in chosen:
        quantity = known[name]
        place = slice(end, end := end + quantity.size)
        values, lowest, highest = (
            part[:, place] for part in (traces.values, traces.lowest, traces.highest)
        )
        low, high = limits(np.concatenate([values, lowest, highest]))
        above = highest - np.fmax(values[1:], values[:-1])
        below = np.fmin(values[1:], values[:-1]) - lowest
        unseen = np.fmax(above, below) > _UNSEEN * (high - low)
        written = curves(values, low, high) | {"low": low.tolist(), "high": high.tolist()}
        room -= 2 * values.size
        if unseen.any():
            room -= 4 * lowest.size
            written["lowest"] = curves(lowest, low, high)
            written["highest"] = curves(highest, low, high)
        if room < 0:
            break
        found[name] = {
            "name": name,
            "item": name.partition(".")[0],
            "quantity": name.partition(".")[2],
            "unit": quantity.unit,
            "frame": quantity.frame,
            "asked": name in first,
            "components": components(name, quantity.size),
            "units": component_units(quantity.unit, quantity.size),
        } | written
    return [found[name] for name in known if name in found]
