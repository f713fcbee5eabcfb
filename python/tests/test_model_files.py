"""Layers of a model file and their schema, limits of its numbers, and what is said about them."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import holonom
from holonom import _core
from holonom.cli.commands import invoke
from holonom.cli.words import read_value

#: Two blocks on springs that the ground carries; sections may be added and parts be replaced.
BLOCKS = """
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies.a]
mass = 1.0
inertia = 0.1
position = [1.0, 0.0]
[bodies.b]
mass = 1.0
inertia = 0.1
position = [2.0, 0.0]
[joints]
pin = { type = "revolute", between = ["ground", "a"], point = [0.0, 0.0] }
[joints.rail]
type = "translational"
between = ["ground", "b"]
axis = [1.0, 0.0]
point = [0.0, 0.0]
[forces.spring]
type = "tsda"
between = ["a", "b"]
points = [[1.0, 0.0], [2.0, 0.0]]
stiffness = 10.0
free_length = 1.0
[simulation]
end_time = 0.1
"""
#: Three springs that one line makes.
REPEATED = """
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[patterns.row]
over.i = { from = 1, to = 3 }
bodies."b_{i}" = { mass = 1.0, inertia = 0.1, position = ["=i", 0.0] }
[patterns.row.forces."f_{i}"]
type = "tsda"
between = ["ground", "b_{i}"]
points = [[0.0, 1.0], ["=i", 0.0]]
stiffness = 5.0
free_length = 1.0
[patterns.row.initial.bodies]
"b_{i}" = { velocity = [1.0, 0.0] }
"""


def read(text: str) -> holonom.Model:
    return holonom.Model.from_text(text)


def problems(text: str, values: dict[str, Any] | None = None) -> list[str]:
    """Return the messages of the errors of a text, in which values may be set."""

    def build() -> None:
        read(text).with_values(values or {})

    with pytest.raises(holonom.ModelError) as caught:
        build()
    return [f"{problem.path}: {problem.message}" for problem in caught.value.problems]


def doubted(text: str) -> list[str]:
    """Return the paths of what is said to look like another unit."""
    warnings = [w for w in read(text).warnings if w["code"] == "model/implausible"]
    return [str(w["path"]) for w in warnings]


def layered(tmp_path: Path, base: str, variant: str) -> holonom.Model:
    """Return the model of a file that extends another one."""
    for name, text in {"base": base, "variant": variant}.items():
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / "model.toml").write_text(text)
    return holonom.Model.load(tmp_path / "variant" / "model.toml")


VARIANT = 'holonom = 1\nextends = "../base/model.toml"\n'


@pytest.mark.parametrize(
    ("text", "path"),
    [
        (BLOCKS + "[bodies.a.markers]\nm = { point = [1e99, 0.0] }", "bodies.a.markers.m"),
        (BLOCKS + "[initial.bodies]\na = { position = [1e20, 0.0] }", "initial.bodies.a.position"),
        (BLOCKS + "[initial.joints]\nrail = { displacement = -1e20 }",
         "initial.joints.rail.displacement"),
        (BLOCKS + "[roads]\nr = { type = 'flat', height = 1e99 }", "roads.r.height"),
        (BLOCKS + "[roads]\nr = { type = 'half_cylinder', radius = 1.0, center = -1e99 }",
         "roads.r.center"),
        (BLOCKS.replace("free_length = 1.0", "free_length = 1e99"), "forces.spring.free_length"),
        (BLOCKS + "[joints.rod]\ntype = 'distance'\nbetween = ['a', 'b']\nlength = 1e99\n"
         "points = [[1.0, 0.0], [2.0, 0.0]]",
         "joints.rod.length"),
    ],
)  # fmt: skip
def test_points_and_lengths_are_limited_wherever_they_stand(text: str, path: str) -> None:
    (problem,) = problems(text)
    assert problem.startswith(f"{path}: ")
    assert "at most 1e9 m" in problem


def test_what_is_switched_off_needs_no_start(tmp_path: Path) -> None:
    # Independent truth: the model without the body and what is on it.
    base = BLOCKS + "[initial.bodies]\nb = { velocity = [1.0, 0.0] }\n"
    base += "[initial.joints]\nrail = { velocity = 1.0 }\n"
    off = VARIANT + "[bodies]\nb = { enabled = false }\n[joints]\nrail = { enabled = false }\n"
    off += "[forces]\nspring = { enabled = false }\n"
    variant = layered(tmp_path, base, off)
    assert list(variant.bodies) == ["a"]
    assert "rail" not in variant.to_json()
    items = ("bodies.b", "joints.rail", "forces.spring")
    assert variant == read(base).with_values({f"{item}.enabled": False for item in items})
    exception = "[bodies]\nb_2 = { enabled = false }\n[forces]\nf_2 = { enabled = false }\n"
    assert list(read(REPEATED + exception).bodies) == ["b_1", "b_3"]
    # What is set of it is not dropped without a word; what was never there is still an error.
    (problem,) = problems(
        base, {f"{item}.enabled": False for item in items} | {"initial.joints.rail.velocity": 2.0}
    )
    assert problem.startswith("initial.joints.rail")
    (problem,) = problems(BLOCKS + "[initial.bodies]\nc = { velocity = [1.0, 0.0] }")
    assert "which is not there" in problem
    for line in ("b = { enabled = false }", "b = { enabled = false, velocity = [1.0, 0.0] }"):
        (problem,) = problems(BLOCKS + "[initial.bodies]\n" + line)
        assert "has no field `enabled`" in problem


@pytest.mark.parametrize(
    ("table", "before", "after"),
    [
        ("simulation", "fixed_step = 0.01", "max_step = 0.01"),
        ("simulation", "max_step = 0.01\ninitial_step = 1e-3", "fixed_step = 0.01"),
        ("forces.spring", "", "force = { x = [-1.0, 1.0], y = [-10.0, 10.0] }"),
        ("forces.spring", "", "points_in_body = [[0.0, 0.0], [0.0, 0.0]]"),
        ("joints.rail", "", "points_in_body = [[0.0, 0.0], [-2.0, 0.0]]"),
        ("bodies.a.markers.point", "point = [1.0, 0.0]", "point_in_body = [0.0, 0.0]"),
        ("drivers.d", 'joint = "pin"\ncoordinate = "rotation"\nmotion = 0.0', 'on = "a"'),
    ],
)
def test_a_variant_may_state_the_same_in_another_way(
    tmp_path: Path, table: str, before: str, after: str
) -> None:
    header = f"[{table}]\n"
    base = BLOCKS.replace(header, header + before + "\n")
    base = base if header in base or not before else base + header + before
    layered(tmp_path, base, VARIANT + header + after).check()
    values = tomllib.loads(after)
    read(base).with_values({f"{table}.{field}": value for field, value in values.items()}).check()
    # In one layer the two still contradict each other.
    (problem, *_) = problems(base.replace(header, header + after + "\n"))
    assert "has both" in problem or "has more than one of" in problem


def test_names_of_items_are_no_ways_to_state_anything(tmp_path: Path) -> None:
    base = BLOCKS + "[bodies.a.markers]\npoint = { point = [1.0, 0.0] }\n"
    added = "[bodies.a.markers]\npoint_in_body = { point = [1.0, 0.0] }\n"
    markers = layered(tmp_path, base, VARIANT + added).bodies["a"]["markers"]
    assert list(markers) == ["point", "point_in_body"]


def test_what_is_set_of_a_repeated_item_is_laid_over_it() -> None:
    # Independent truth: what a file says in the same place, and the text that is written of it.
    turn = {"type": "harmonic", "amplitude": 1.0, "angular_frequency": 2.0, "phase": 0.5}
    twist = '"t_{i}" = { type = "torque", on = "b_{i}", torque = ' + json.dumps(turn) + " }\n"
    text = REPEATED + "[patterns.row.forces]\n" + twist.replace('":', '" =')
    new = {"damping": 1.0, "stiffness": 2.0}
    slower = {"type": "harmonic", "angular_frequency": 1.0}
    changed = read(text).with_values({"forces.f_2": new, "forces.t_2.torque": slower})
    over = "[forces]\nf_2 = { damping = 1.0, stiffness = 2.0 }\n"
    stated = read(text + over + "t_2 = { torque = { angular_frequency = 1.0 } }\n")
    for model in (changed, stated, read(changed.to_json())):
        written = json.loads(model.to_json(plain=True))["forces"]
        assert written["t_2"]["torque"] == turn | slower
        assert written["f_2"] == written["f_3"] | {
            "between": ["ground", "b_2"], "points": [[0.0, 1.0], [2.0, 0.0]],
        } | new  # fmt: skip
        assert "patterns" in json.loads(model.to_json())
    off = read(text).with_values({"forces.f_2": {"enabled": False}})
    assert "f_2" not in off.forces


def test_a_part_of_what_a_field_says_does_not_take_its_place() -> None:
    whole = """
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
bodies.m = { mass = 1.0, inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
  position = [0.0, 0.0, 0.0] }
forces.m_bush = { type = "bushing", between = ["ground", "m"], point = [0.0, 0.0, 0.0],
  MATRIX }
simulation = { end_time = 1.0, STEP }
"""
    zeros = [[float(i == j) for j in range(6)] for i in range(6)]
    matrix = whole.replace("MATRIX", f"stiffness_matrix = {zeros}")
    halves = whole.replace("MATRIX", "stiffness = [1.0, 1.0, 1.0]")
    fixed, free = "fixed_step = 0.01", "max_step = 0.01"
    turned = {"forces.m_bush.rotational_stiffness": [1.0, 1.0, 1.0]}
    (problem,) = problems(matrix.replace("STEP", free), turned)
    assert "stiffness_matrix" in problem
    (problem,) = problems(matrix.replace("STEP", fixed), {"simulation.initial_step": 1e-3})
    assert "fixed_step" in problem
    found = read(halves.replace("STEP", free)).with_values(
        {"forces.m_bush.stiffness_matrix": zeros, "simulation.fixed_step": 0.01}
    )
    assert "stiffness" not in found.forces["m_bush"]
    # What a force does not know takes no place either: only that is wrong.
    pushed = BLOCKS + "[forces.push]\ntype = 'point_force'\non = 'a'\npoint = [1.0, 0.0]\n"
    pushed += "force = [1.0, 0.0]\n"
    (problem,) = problems(pushed, {"forces.push.stiffness": 3.0})
    assert "`stiffness`" in problem


def fits(schema: Any, value: Any, root: dict[str, Any]) -> bool:
    """Return whether a value keeps those keywords of JSON Schema that the schema of models has."""
    if "$ref" in schema and not fits(root["$defs"][schema["$ref"].rpartition("/")[2]], value, root):
        return False
    kinds: dict[str, Any] = {
        "object": dict, "array": list, "string": str, "boolean": bool, "number": (int, float),
        "integer": int,
    }  # fmt: skip
    types = schema.get("type", [])
    types = [types] if isinstance(types, str) else types
    of_type = [isinstance(value, kinds[kind]) for kind in types]
    if isinstance(value, bool):
        of_type = [kind == "boolean" for kind in types]
    if types and not any(of_type):
        return False
    if "const" in schema and value != schema["const"]:
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        return False
    if isinstance(value, list):
        length = schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value))
        if not length or not all(fits(schema.get("items", {}), one, root) for one in value):
            return False
    if isinstance(value, dict):
        known = schema.get("properties", {})
        rest = schema.get("additionalProperties", True)
        if not set(schema.get("required", [])) <= value.keys():
            return False
        for name, one in value.items():
            inner = known.get(name, {} if rest is True else rest)
            if inner is False or not fits(inner, one, root):
                return False
    found = [[fits(one, value, root) for one in schema.get(key, [])] for key in ("anyOf", "oneOf")]
    if ("anyOf" in schema and not any(found[0])) or ("oneOf" in schema and sum(found[1]) != 1):
        return False
    branch = "then" if "if" in schema and fits(schema["if"], value, root) else "else"
    return "if" not in schema or fits(schema.get(branch, {}), value, root)


def test_the_schema_takes_what_the_reader_takes() -> None:
    schema = json.loads(_core.schema())

    def accepted(text: str) -> bool:
        data = json.loads(json.dumps(tomllib.loads(text)))
        return fits(schema, data, schema)

    chain = REPEATED + "[forces]\nf_1 = { stiffness = 6.0 }\n"
    for whole in (BLOCKS, REPEATED, chain, chain + "f_2 = { enabled = false }"):
        read(whole)
        assert accepted(whole), whole
    off = BLOCKS + "[bodies.c]\nenabled = false\ntitle = 'off'\n"
    read(off)
    assert accepted(off)
    assert accepted(VARIANT + "[joints]\npin = { enabled = false }")
    assert accepted(VARIANT + "[joints]\npin = { point = [0.0, 1.0] }")
    # Misspelt fields, missing ones and values of another kind are still told.
    for wrong in (
        BLOCKS.replace("mass = 1.0", "", 1),
        BLOCKS.replace("stiffness", "stifness"),
        off.replace("title", "titel"),
        chain.replace("{ stiffness", "{ stifness"),
        VARIANT + "[joints]\npin = { pont = [0.0, 1.0] }",
        VARIANT + "simulation = 3",
        VARIANT.replace('"../base/model.toml"', "3"),
        REPEATED.replace('dimension = "planar"', ""),
    ):
        assert not accepted(wrong), wrong


def test_no_unit_is_doubted_that_the_file_states() -> None:
    heavy = BLOCKS.replace("mass = 1.0", "mass = 2e9", 1)
    far = BLOCKS.replace("point = [0.0, 0.0] }", "point = [2e6, 0.0] }")
    turning = BLOCKS + (
        "[drivers]\nd = { joint = 'pin', coordinate = 'rotation', motion = 3600000.0 }\n"
        "[initial.bodies]\na = { angle = 720.0 }\n"
    )
    for text, path, units in (
        (heavy, "bodies.a.mass", "mass = 'kg'"),
        (heavy, "bodies.a.mass", "mass = 't'"),
        (far, "joints.pin", "length = 'mm'"),
        (turning, "drivers.d.motion", "angle = 'deg'"),
        (turning, "initial.bodies.a.angle", "angle = 'deg'"),
    ):
        assert path in doubted(text)
        stated = text.replace("gravity", f"units = {{ {units} }}\ngravity")
        assert doubted(stated.replace("-9.81", "0.0")) == []
        # Gravity of 9.81 mm/s² is a slip in any file.
        assert doubted(stated) == (["gravity"] if "mm" in units else [])
    assert "bodies.a.mass" in doubted(heavy.replace("gravity", "units = { force = 'N' }\ngravity"))


def test_warnings_have_short_numbers_and_name_what_is_far() -> None:
    started = BLOCKS + "[initial.bodies]\nb = { position = [1e8, 0.0] }\n"
    assert "initial.bodies.b.position" in doubted(started)
    designed = BLOCKS.replace("position = [2.0", "position = [1e8")
    designed = designed.replace("\npoint = [0.0", "\npoint = [1e8")
    assert "bodies.b.position" in doubted(designed)
    turned = read(BLOCKS + "[initial.bodies]\na = { angle = 1e90 }").warnings
    assert all(len(w["message"]) + len(str(w.get("help", ""))) < 300 for w in turned)
    assert any("1e90 rad" in w["message"] for w in turned)


def test_a_long_free_length_does_not_make_ends_meet() -> None:
    # Truth: the ends are 1 m apart, and the spring pushes them with 1000 N.
    spring = BLOCKS.replace("stiffness = 10.0", "stiffness = 1e-6")
    report = read(spring.replace("free_length = 1.0", "free_length = 1e9")).check()
    assert report is not None
    with pytest.raises(holonom.HolonomError, match="coincide"):
        read(BLOCKS.replace("[[1.0, 0.0], [2.0, 0.0]]", "[[1.5, 0.0], [1.5, 0.0]]")).check()


SPATIAL = """
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.a]
mass = 1.0
inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
position = [0.0, 0.0, 0.0]
[forces.f]
"""


def test_what_is_wrong_with_a_force_is_said_once_and_rightly() -> None:
    step = "{ type = 'smooth_step', from = 0.0, to = 1.0, start = 1.0, end = 1.0 }"
    on = "on = 'a'\npoint = [0.0, 0.0, 0.0]\ndirection = [1.0, 1.0, 1.0]\n"
    assert len(problems(f"{SPATIAL}type = 'point_force'\n{on}force = {step}")) == 1
    bushing = SPATIAL + "type = 'bushing'\nbetween = ['ground', 'a']\npoint = [0.0, 0.0, 0.0]\n"
    (empty,) = problems(bushing)
    assert "`rotational_damping`" in empty
    assert "`branches`" in empty
    assert "law" not in empty
    for field, unit in {
        "stiffness": "N/m", "rotational_stiffness": "N m/rad", "damping": "N s/m",
        "rotational_damping": "N m s/rad",
    }.items():  # fmt: skip
        (negative,) = problems(f"{bushing}{field} = [1.0, -1.0, 1.0]")
        assert f"`forces.f.{field}[1]` is -1 {unit};" in negative
    torque = BLOCKS + "[forces.t]\ntype = 'torque'\non = 'a'\ntorque = "
    for wrong in ("[1.0, 2.0]", "[1.0, 2.0, 3.0]"):
        (problem,) = problems(torque + wrong)
        assert "a list of 2 entries" not in problem
        assert "expected a number" in problem
    read(torque + "1.0")
    read(f"{SPATIAL}type = 'torque'\non = 'a'\ntorque = [1.0, 0.0, 2.0]")


def test_numbers_are_set_as_people_write_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for text, value in {
        ".5": 0.5, "1.": 1.0, "+2": 2, "01": 1.0, "1_000": 1000, "0x10": 16, "1e3": 1000.0,
        "-.5e-1": -0.05, "[1, 2]": [1, 2], '{color = "#5b6660"}': {"color": "#5b6660"},
        "nan": "nan", "inf": "inf", "0.5 kg": "0.5 kg", "ForRosen": "ForRosen",
        '"5"': "5", "2020-01-01": "2020-01-01", "true": True,
    }.items():  # fmt: skip
        found = read_value(text)
        assert (found, type(found)) == (value, type(value)), text
    file = tmp_path / "model.toml"
    file.write_text(BLOCKS)
    assert invoke(["check", str(file), "--set", "bodies.a.mass=.5"]) == 0
    assert invoke(["check", str(file), "--set", "title=5"]) == 2
    assert """in a shell '"5"'""" in capsys.readouterr().err
    assert invoke(["check", str(file), "--set", 'title="5"']) == 0


def test_a_list_that_is_not_stated_is_set_as_a_whole() -> None:
    (problem,) = problems(BLOCKS, {"initial.velocity[0]": 1.0})
    assert "`initial.velocity` is not stated" in problem
    read(BLOCKS).with_values({"initial.velocity": [1.0, 0.0]})


def test_a_text_may_begin_as_files_do() -> None:
    model = read(BLOCKS)
    for text in (BLOCKS, model.to_json()):
        assert read("\ufeff" + text) == model
