"""How bodies hang on each other: the spanning forest, the joints that close loops, what is free."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from holonom.base.errors import HolonomError
from holonom.base.text import escape
from holonom.pictures.svg import shortened, text_width

if TYPE_CHECKING:
    from holonom.result import Result

#: Bodies of a model whose graph is drawn; a larger one is told in numbers.
MOST_BODIES = 400
#: So many bodies in a row that are tied alike are drawn as one.
_ALIKE = 4

_ROW, _BOX, _GAP, _STEP = 30.0, 20.0, 106.0, 12.0
_SMALL, _FONT = 10.5, 12.0
_CUT, _BAD = "#b0589f", "#cc4444"


@dataclass
class _Node:
    name: str
    text: str
    edge: str = ""
    forces: bool = False
    children: list[_Node] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0


def graph(result: Result) -> tuple[str, list[tuple[str, str]]]:
    """Return the picture of the graph as an SVG element, and what it shows in numbers.

    The picture is empty where the model is too large, or cannot be assembled.
    """
    try:
        report = result.model.check()
    except HolonomError:
        return "", []
    data = report.data
    facts = [(label, str(data[key])) for key, label in _FACTS if key in data]
    redundant = [f"{one['joint']}: {one['direction']}" for one in report.redundant]
    facts.append(("redundant constraints", "; ".join(redundant) or "none"))
    tree = data.get("tree", [])
    if not 0 < len(tree) <= MOST_BODIES:
        return "", facts
    faulty = {one["joint"] for one in report.redundant}
    elements = {e["name"]: e for e in result.model.geometry["elements"]}
    planar = result.model.geometry["dimension"] == "planar"
    nodes = _forest(tree, elements, planar)
    in_tree = {edge["item"] for edge in tree}
    names = [body["name"] for body in result.model.geometry["bodies"]]
    cuts = []
    for element in elements.values():
        if element["collection"] != "joints" or element["name"] in in_tree:
            continue
        ends = ["ground" if f["body"] is None else names[f["body"]] for f in element["frames"]]
        if len(ends) == 2:
            cuts.append((ends[0], ends[1], _label(element["type"], planar), element["name"]))
    kept = {end for cut in cuts for end in cut[:2]}
    _gather(nodes["ground"], kept)
    return _drawn(nodes["ground"], cuts, faulty, data), facts


_FACTS = (
    ("dof", "degrees of freedom"),
    ("bodies", "bodies"),
    ("joints", "joints"),
    ("loops", "closed loops"),
    ("coordinates", "coordinates"),
    ("constraint_rows", "constraint rows"),
)

#: Freedoms that a joint leaves: planar, spatial.
_FREEDOMS = {
    "fixed": (0, 0),
    "revolute": (1, 1),
    "translational": (1, 1),
    "cylindrical": (2, 2),
    "universal": (2, 2),
    "spherical": (3, 3),
    "distance": (2, 5),
}


def _label(kind: str, planar: bool) -> str:
    freedoms = _FREEDOMS.get(kind)
    return kind if freedoms is None else f"{kind} · {freedoms[0 if planar else 1]}"


def _forest(tree: list[dict[str, Any]], elements: dict[str, Any], planar: bool) -> dict[str, _Node]:
    nodes = {"ground": _Node("ground", "ground")}
    for edge in tree:
        if edge["kind"] == "free":
            label = f"free · {3 if planar else 6}"
        else:
            kind = elements[edge["item"]]["type"] if edge["item"] in elements else edge["kind"]
            label = _label(kind, planar)
        node = _Node(edge["body"], edge["body"], label, forces=edge["kind"] != "joint")
        nodes[edge["body"]] = node
        nodes[edge["parent"]].children.append(node)
    return nodes


def _gather(root: _Node, kept: set[str]) -> None:
    """Draw rows of bodies that are tied alike as one box."""
    stack = [root]
    while stack:
        node = stack.pop()
        for index, child in enumerate(node.children):
            row = [child]
            while (
                len(row[-1].children) == 1
                and row[-1].name not in kept
                and row[-1].children[0].edge == child.edge
                and row[-1].children[0].name not in kept
            ):
                row.append(row[-1].children[0])
            if len(row) >= _ALIKE:
                whole = _Node(
                    child.name,
                    f"{child.name} … {row[-1].name} ({len(row)})",
                    child.edge,
                    child.forces,
                    row[-1].children,
                )
                node.children[index] = whole
                child = whole
            stack.append(child)


def _drawn(
    root: _Node, cuts: list[tuple[str, str, str, str]], faulty: set[str], data: dict[str, Any]
) -> str:
    places: dict[str, _Node] = {}
    widths: dict[int, float] = defaultdict(float)
    order: list[tuple[_Node, int]] = []
    stack = [(root, 0)]
    while stack:
        node, depth = stack.pop()
        node.text = shortened(node.text, 190.0, _FONT)
        node.width = text_width(node.text, _FONT) + 16.0
        widths[depth] = max(widths[depth], node.width)
        order.append((node, depth))
        stack += [(child, depth + 1) for child in reversed(node.children)]
    left, starts = 4.0, {}
    for depth in range(len(widths)):
        starts[depth] = left
        left += widths[depth] + _GAP
    # A parent stands beside its first child, so that chains are straight.
    row = 0
    for node, depth in order:
        node.x, node.y = starts[depth], 8.0 + _ROW * row
        places[node.name] = node
        if not node.children:
            row += 1
    for node, _ in reversed(order):
        if node.children:
            node.y = node.children[0].y
    right = max(node.x + node.width for node, _ in order)
    edges = [_edge(node, child) for node, _ in order for child in node.children]
    boxes = [_box(node) for node, _ in order]
    arcs, width = _arcs(places, cuts, faulty, right)
    height = 8.0 + _ROW * max(row, 1) + 4.0
    title = f"{data.get('bodies', 0)} bodies, {data.get('dof', 0)} degrees of freedom"
    return (
        f'<svg class="graph" xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" '
        f'height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(title)}" font-size="{_FONT}" '
        f'style="min-width:{min(width, 680.0):.0f}px">{"".join(edges + arcs + boxes)}</svg>'
    )


def _edge(node: _Node, child: _Node) -> str:
    x, y = node.x + node.width, node.y + 0.5 * _BOX
    a, b = child.x, child.y + 0.5 * _BOX
    bend = a - _GAP + 8.0
    dash = ' stroke-dasharray="4 3"' if child.forces else ""
    path = f"M{x:.1f} {y:.1f}H{bend:.1f}V{b:.1f}H{a:.1f}" if y != b else f"M{x:.1f} {y:.1f}H{a:.1f}"
    label = shortened(child.edge, _GAP - 18.0, _SMALL)
    return (
        f'<path d="{path}" fill="none" stroke="currentColor" stroke-opacity=".5"{dash}/>'
        f'<text x="{bend + 6.0:.1f}" y="{b - 4.0:.1f}" fill="currentColor" fill-opacity=".7" '
        f'font-size="{_SMALL}">{escape(label)}</text>'
    )


def _box(node: _Node) -> str:
    ground = node.name == "ground"
    fill = "currentColor" if ground else "var(--card, #fff)"
    ink = "var(--card, #fff)" if ground else "currentColor"
    return (
        f'<rect x="{node.x:.1f}" y="{node.y:.1f}" width="{node.width:.1f}" height="{_BOX}" rx="5" '
        f'fill="{fill}" stroke="currentColor" stroke-opacity=".6"/>'
        f'<text x="{node.x + 8.0:.1f}" y="{node.y + 14.0:.1f}" fill="{ink}">'
        f"{escape(node.text)}</text>"
    )


def _arcs(
    places: dict[str, _Node],
    cuts: list[tuple[str, str, str, str]],
    faulty: set[str],
    right: float,
) -> tuple[list[str], float]:
    """Return the joints that close loops as brackets beside the tree, and where these end."""
    drawn: list[str] = []
    taken: list[tuple[int, float, float]] = []
    tied = [c for c in cuts if c[0] in places and c[1] in places]
    spans = sorted(
        (abs(places[a].y - places[b].y), min(places[a].y, places[b].y), a, b, label, name)
        for a, b, label, name in tied
    )
    width = right + 8.0
    for length, top, a, b, label, name in spans:
        # The innermost bracket that is free at this height.
        level = 0
        while any(n == level and top < e and s < top + length for n, s, e in taken):
            level += 1
        taken.append((level, top - 1.0, top + length + 1.0))
        out = right + 14.0 + level * _STEP
        one, other = places[a], places[b]
        ends = [
            (n.x + n.width, n.y + _BOX * (0.7 if n.y <= m.y else 0.3))
            for n, m in ((one, other), (other, one))
        ]
        color = _BAD if name in faulty else _CUT
        (x, y), (u, v) = ends
        path = f"M{x:.1f} {y:.1f}H{out:.1f}V{v:.1f}H{u:.1f}"
        said = f"{name}: {label}" + (", redundant" if name in faulty else "")
        drawn.append(
            f'<path d="{path}" fill="none" stroke="{color}" stroke-opacity=".8" '
            f'stroke-dasharray="5 3"><title>{escape(said)}</title></path>'
        )
        width = max(width, out + 8.0)
    # Names beside the brackets, each in a row of its own from the middle of its bracket on.
    rows: set[int] = set()
    edge = width
    for length, top, _, _, label, name in spans:
        row = round((top + 0.5 * length) / 13.0)
        while row in rows:
            row += 1
        rows.add(row)
        color = _BAD if name in faulty else _CUT
        said = shortened(f"{name}: {label}", 230.0, _SMALL)
        drawn.append(
            f'<text x="{edge:.1f}" y="{row * 13.0 + 14.0:.1f}" fill="{color}" '
            f'font-size="{_SMALL}">{escape(said)}</text>'
        )
        width = max(width, edge + text_width(said, _SMALL) + 6.0)
    return drawn, width
