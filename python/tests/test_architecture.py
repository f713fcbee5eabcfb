"""The rooms of the package: which may use which, and that no import goes in a circle."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import holonom

ROOT = Path(holonom.__file__).parent
ENGINE = "holonom._core"

#: What every room may use: it knows nothing of mechanisms.
GROUND = {"_core", "base"}
#: What else each room may use; `ARCHITECTURE.md` says what they yield.
MAY_USE: dict[str, set[str]] = {
    "certificate": set(),
    "options": set(),
    "library": set(),
    "check": set(),
    "store": {"certificate"},
    "channels": set(),
    "model": {"channels", "store", "options", "library", "check", "states"},
    "states": {"store"},
    "summary": set(),
    "signals": set(),
    "gauge": {"channels", "store"},
    "pictures": {"channels", "gauge", "options", "signals"},
    "certification": {"certificate", "channels", "gauge", "options", "store"},
    "result": {"certificate", "channels", "model", "options", "pictures", "states", "store"},
    "simulation": {"certificate", "certification", "channels", "result", "states", "store"},
    "study": {
        "certification",
        "channels",
        "gauge",
        "model",
        "options",
        "pictures",
        "result",
        "states",
        "store",
    },
    "report": {"check", "pictures", "summary", "view"},
    "export": {"channels"},
    "view": {"channels", "options", "states", "store", "summary"},
    "cli": {"check", "export", "library", "model", "options", "pictures", "result", "study"}
    | {"summary", "view"},
    "__init__": {"model", "result"},
    "__main__": {"cli"},
}
#: Methods of `Model` and `Result` that lead upwards, imported where they are called.
DOORS = {
    ("model", "simulation"),
    ("result", "export"),
    ("result", "report"),
    ("result", "summary"),
    ("result", "view"),
}


def modules() -> dict[str, Path]:
    """Every module of the package by its name."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        if path.is_relative_to(ROOT / "models"):
            continue
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(("holonom", *parts)).removesuffix(".__init__")
        found[name] = path
    return found


MODULES = modules()


def imports(path: Path, *, at_once: bool) -> Iterator[str]:
    """The modules of the package that a file imports: when it is loaded, or ever."""
    skipped: set[ast.AST] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        types_only = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        later = at_once and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if node in skipped or types_only or later:
            body = node.body if types_only else ast.iter_child_nodes(node)
            skipped.update(body)
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.startswith("holonom."))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "holonom":
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in MODULES or whole == ENGINE else str(node.module)


def room(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def test_every_room_has_a_row() -> None:
    assert {room(name) for name in MODULES} == (GROUND - {"_core"}) | MAY_USE.keys()


def test_arrows_between_rooms_point_one_way() -> None:
    used = {
        (room(name), room(target))
        for name, path in MODULES.items()
        for target in imports(path, at_once=False)
        if target != "holonom"
    }
    arrows = {(a, b) for a, b in used if a != b and b not in GROUND} - DOORS
    faults = {f"{a} uses {b}" for a, b in arrows if b not in MAY_USE.get(a, set())}
    assert not faults
    idle = {f"{a} need not use {b}" for a, row in MAY_USE.items() for b in row} - {
        f"{a} need not use {b}" for a, b in arrows
    }
    assert idle == set()


def test_the_page_about_the_architecture_holds_the_same_table() -> None:
    text = (ROOT / "../../ARCHITECTURE.md").read_text(encoding="utf-8")
    text = text[text.index("## The Python package") :]
    rows = re.findall(r"^\| `(\w+)` \| .* \| ([^|]*) \|$", text, flags=re.MULTILINE)
    told = {name: set(uses.split(", ")) - {"–"} for name, uses in rows if name != "base"}
    assert told == {name: uses for name, uses in MAY_USE.items() if name != "__init__"}


def test_rooms_stand_on_one_another() -> None:
    list(TopologicalSorter(MAY_USE).static_order())


def test_no_import_goes_in_a_circle() -> None:
    graph = {
        name: set(imports(path, at_once=True)) - {name, ENGINE} for name, path in MODULES.items()
    }
    list(TopologicalSorter(graph).static_order())  # a CycleError names the circle
    assert sum(map(len, graph.values())) > 100  # the imports were found


def test_the_store_has_no_circle_even_between_calls() -> None:
    graph = {
        name: {t for t in imports(path, at_once=False) if room(t) == "store"} - {name}
        for name, path in MODULES.items()
        if room(name) == "store"
    }
    list(TopologicalSorter(graph).static_order())
    assert len(graph) > 8
