"""Every public name says what it is, and is typed: for people, editors and checkers alike."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import holonom
from holonom import _core

STUB = ast.parse(Path(holonom.__file__).with_name("_core.pyi").read_text(encoding="utf-8"))
#: Modules that users import from, beside the package itself.
MODULES = ["holonom.signals", "holonom.pictures.picture", "holonom.view", "holonom.view.sketch"]


def public() -> Iterator[tuple[str, Any]]:
    """Every public class and function, with the methods and properties of classes and bases."""
    found = {f"holonom.{name}": getattr(holonom, name) for name in holonom.__all__}
    for module in map(importlib.import_module, MODULES):
        for name, value in vars(module).items():
            own = getattr(value, "__module__", "") == module.__name__
            if own and not name.startswith("_"):
                found[f"{module.__name__}.{name}"] = value
    for name, value in found.items():
        yield name, value
        if not inspect.isclass(value):
            continue
        bases = [base for base in value.__mro__ if base.__module__.split(".")[0] == "holonom"]
        for key, member in (item for base in bases for item in vars(base).items()):
            kinds = (property, classmethod, staticmethod)
            if not key.startswith("_") and (
                inspect.isfunction(member) or isinstance(member, kinds)
            ):
                yield f"{name}.{key}", member


PUBLIC = dict(public())


def test_there_are_names() -> None:
    assert {"holonom.Model.simulate", "holonom.diff", "holonom.signals.low_pass"} <= PUBLIC.keys()
    assert len(PUBLIC) > 100


def test_every_public_name_has_a_docstring() -> None:
    silent = [name for name, value in PUBLIC.items() if not (inspect.getdoc(value) or "").strip()]
    assert silent == []


def test_every_public_function_is_typed() -> None:
    untyped = []
    for name, value in PUBLIC.items():
        function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
        if not inspect.isfunction(function):
            continue
        signature = inspect.signature(function)
        stated = [
            p.annotation for p in signature.parameters.values() if p.name not in ("self", "cls")
        ]
        if inspect.Signature.empty in (*stated, signature.return_annotation):
            untyped.append(name)
    assert untyped == []
    assert Path(holonom.__file__).with_name("py.typed").is_file()


def test_parameters_are_described_by_their_names() -> None:
    unknown = []
    for name, value in PUBLIC.items():
        function = getattr(value, "__func__", value)
        if not inspect.isfunction(function):
            continue
        text = inspect.getdoc(function) or ""
        _, _, section = text.partition("Parameters\n----------\n")
        section = section.partition("\n\nReturns\n")[0].partition("\n\nRaises\n")[0]
        lines = [line for line in section.split("\n") if line and not line.startswith(" ")]
        told = [one.strip(" *") for line in lines if " : " in line or "," in line
                for one in line.partition(" : ")[0].split(",")]  # fmt: skip
        known = inspect.signature(function).parameters
        unknown += [f"{name}: {one}" for one in told if one not in known]
    assert unknown == []


def names_of(body: list[ast.stmt]) -> set[str]:
    found = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
    return {name for name in found if not name.startswith("_")}


def members(owner: ModuleType | type) -> set[str]:
    inherited = set() if isinstance(owner, ModuleType) else set(dir(owner.__mro__[1]))
    return {name for name in dir(owner) if not name.startswith("_")} - inherited


def test_the_stub_names_what_the_engine_has() -> None:
    assert names_of(STUB.body) == members(_core)
    classes = [node for node in STUB.body if isinstance(node, ast.ClassDef)]
    assert len(classes) > 2
    for node in classes:
        assert names_of(node.body) == members(getattr(_core, node.name)), node.name


def test_the_stub_says_what_the_names_of_the_engine_are() -> None:
    owners = [STUB, *(node for node in STUB.body if isinstance(node, ast.ClassDef))]
    silent = [
        node.name
        for owner in owners
        for node in owner.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and not ast.get_docstring(node)
    ]
    assert silent == []
