"""Every message says what to try, and no option is described twice."""

from __future__ import annotations

import ast
import copy
import json
import pickle
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from conftest import MODELS, PENDULUM

import holonom
from holonom import _core
from holonom.base.names import COMMANDS, METHODS, OPTIONS, nearest, nearest_channels
from holonom.base.text import as_json, as_name, as_text, one_line, quoted, shown
from holonom.cli import commands as cli

SOURCES = Path(holonom.__file__).parent
#: Errors by what they are made of, with the number of arguments of which the last is the help.
STATED = {"UsageError": 3, "FileError": 2, "Problem": 9}
#: Texts that are put together before, with their line of help.
WHOLE = {"text", "describe(data)", "said"}


def raised() -> list[tuple[str, ast.Call]]:
    """Return every error that Python makes, with its place."""
    return [
        (f"{path.relative_to(SOURCES)}:{node.lineno}", node)
        for path in sorted(SOURCES.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in STATED
    ]


def test_every_refusal_in_the_sources_states_what_to_try() -> None:
    """No message falls back on what its class says in general."""
    calls = raised()
    assert len(calls) > 150
    silent = [
        place
        for place, call in calls
        if "help" not in {keyword.arg for keyword in call.keywords}
        and len(call.args) < STATED[ast.unparse(call.func)]
        and "help: " not in ast.unparse(call)
        and not {ast.unparse(argument) for argument in call.args} & WHOLE
    ]
    # As SQLite puts it; the line of help is added just before.
    assert [place for place in silent if "layout" not in place] == []


@pytest.mark.parametrize(
    "error",
    [
        holonom.UsageError("x"),
        holonom.FileError("x"),
        holonom.ModelError(holonom.Problem(code="model/syntax", message="x")),
        holonom.SimulationError({"code": "simulation/failed", "message": "x"}),
        holonom.Interrupted({"message": "x"}),
    ],
)
def test_every_error_has_a_line_of_help_and_can_be_pickled(error: holonom.HolonomError) -> None:
    assert "\n  help: " in str(error)
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error), copy.deepcopy(error)):
        assert type(again) is type(error)
        assert str(again) == str(error)
        assert again.to_json() == error.to_json()


def test_an_error_that_carries_a_result_can_be_pickled(tmp_path: Path) -> None:
    model = holonom.Model.from_text(PENDULUM)
    for output in (None, tmp_path / "rod.holonom"):
        with pytest.raises(holonom.SimulationError) as caught:
            model.simulate(max_steps=3, output=output)
        again = pickle.loads(pickle.dumps(caught.value))
        assert again.code == "simulation/max-steps"
        np.testing.assert_array_equal(again.result["q"], caught.value.result["q"])


def test_models_and_results_can_be_pickled_and_copied(tmp_path: Path) -> None:
    model = holonom.Model.load(MODELS / "slider_crank" / "model.toml")
    again = pickle.loads(pickle.dumps(model))
    assert (again.hash, again.name) == (model.hash, model.name)
    assert copy.deepcopy(model) is model
    for output in (None, tmp_path / "x.holonom"):
        result = model.simulate(end_time=0.1, output=output)
        for other in (pickle.loads(pickle.dumps(result)), copy.copy(result), copy.deepcopy(result)):
            np.testing.assert_array_equal(other["q"], result["q"])
            # Steps and charts, too: any time can be asked for.
            np.testing.assert_array_equal(other.state(0.0123)["q"], result.state(0.0123)["q"])
            assert other.statistics.steps == result.statistics.steps


def test_a_model_that_was_pickled_does_not_replace_what_it_extends(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(PENDULUM)
    (tmp_path / "model.toml").write_text('holonom = 1\nextends = "base.toml"\n')
    again = pickle.loads(pickle.dumps(holonom.Model.load(tmp_path / "model.toml")))
    with pytest.raises(holonom.FileError, match="extends"):
        again.save(tmp_path / "base.toml")
    assert (tmp_path / "base.toml").read_text() == PENDULUM


def test_another_run_in_the_file_of_a_pickled_result_is_told(tmp_path: Path) -> None:
    model, path = holonom.Model.from_text(PENDULUM), tmp_path / "x.holonom"
    with model.simulate(end_time=0.2, output=path) as result:
        data = pickle.dumps(result)
    # A run that went on is the same run.
    with model.simulate(start=pickle.loads(data).state(), end_time=0.3, output=path) as longer:
        assert longer.path == path
    assert pickle.loads(data).time[-1] == 0.3
    model.simulate(end_time=0.1, output=path).close()
    with pytest.raises(holonom.FileError) as caught:
        pickle.loads(data)
    assert caught.value.code == "result/replaced"


@pytest.mark.parametrize("path", sorted(MODELS.glob("*/model.toml")), ids=lambda p: p.parent.name)
def test_a_model_that_is_saved_or_plain_data_is_the_same(path: Path, tmp_path: Path) -> None:
    model = holonom.Model.load(path)
    assert holonom.Model.from_dict(model.to_dict()).hash == model.hash
    for name in ("model.toml", "model.json"):
        target = model.save(tmp_path / "new" / name)
        assert holonom.Model.load(target).hash == model.hash
        model.save(target)  # a model is replaced
    other = tmp_path / "notes.toml"
    other.write_text("a = 1\n")
    with pytest.raises(holonom.FileError, match="not overwritten"):
        model.save(other)
    assert other.read_text() == "a = 1\n"
    assert holonom.Model.load(model.save(other, force=True)).hash == model.hash


def test_items_of_a_model_are_read_only_views() -> None:
    model = holonom.Model.from_text(PENDULUM)
    assert model.bodies["rod"]["mass"] == 2.0
    assert list(model.joints) == ["pin"]
    assert dict(model.forces) == {}
    with pytest.raises(TypeError):
        model.bodies["rod"]["mass"] = 3.0  # type: ignore[index]
    with pytest.raises(KeyError, match="did you mean `rod`"):
        model.bodies["rdo"]
    assert "<caption>Rod on a pin (planar)</caption>" in model._repr_html_()


def test_a_result_is_iterated_by_name() -> None:
    result = holonom.Model.from_text(PENDULUM).simulate(end_time=0.1)
    assert list(result)[:3] == ["time", "rod.position", "pin.force"]
    assert len(result) == len(result.keys())
    assert set(dict(result)) == set(result)
    assert "rod.velocity" in result
    assert "rod.velocity" not in list(result)
    assert {"rod.velocity", "q", "time"} <= set(result._ipython_key_completions_())
    assert "rod.position[1]" in result
    assert "rod.position[2]" not in result
    assert 3 not in result
    frame = result.to_pandas(["rod.position", "energy.total"])
    assert list(frame.columns) == ["rod.position[0]", "rod.position[1]", "energy.total"]
    np.testing.assert_array_equal(frame["rod.position[1]"], result["rod.position"][:, 1])
    np.testing.assert_array_equal(frame.index, result.time)
    assert frame.attrs["units"]["energy.total"] == "J"
    assert "<th>status</th>" in result._repr_html_()


def test_options_are_those_of_the_core_the_command_and_the_file() -> None:
    """Independent truth: what the core takes, the flags that exist, the schema of model files."""
    ours = {about.name: about.metadata for about in fields(holonom.Options)}
    model = holonom.Model.from_text(PENDULUM)
    assert set(model._core.options("{}", None)) == set(ours)
    group: Any = typer.main.get_command(cli.app)
    flags = {parameter.name for parameter in group.commands["run"].params}
    assert set(ours) <= flags
    compare = {parameter.name for parameter in group.commands["compare"].params}
    assert {"end_time", "interval", "max_steps", "max_seconds"} <= compare & set(ours)
    assert all(f"    {name} : " in str(holonom.Options.__doc__) for name in ours)
    for name, about in ours.items():  # words that the core does not know would be refused by it
        for word in about["words"]:
            model._core.options(json.dumps({name: word}), None)
    schema = json.loads(_core.schema())
    stated = _properties(schema, "max_steps")
    assert len(stated) > 8
    assert stated - {"cut"} <= set(ours)  # joints are named in the file that has them


def _properties(schema: Any, known: str) -> set[str]:
    """Return the fields of the table of a schema that has a field `known`."""
    if isinstance(schema, dict):
        if isinstance(schema.get("properties"), dict) and known in schema["properties"]:
            return set(schema["properties"])
        schema = list(schema.values())
    parts = schema if isinstance(schema, list) else []
    return next((found for part in parts if (found := _properties(part, known))), set())


def test_words_of_other_codes_lead_to_ours() -> None:
    names = [about.name for about in fields(holonom.Options)]
    for word, meant in {"tol": "tolerance", "dt": "fixed_step", "hmax": "max_step"}.items():
        assert nearest(word, names, OPTIONS) == [meant]
    codes = [code["name"] for code in holonom.methods()]
    assert set(METHODS) <= set(codes)  # no word leads to a code that is none
    assert nearest("Radau", codes, METHODS) == ["ForRadau"]
    channels = list(holonom.Model.from_text(PENDULUM).channels)
    for word in ("omega", "rpm", "w"):
        assert nearest_channels(f"rod.{word}", channels)[0] == "rod.angular_velocity"
    commands = typer.main.get_command(cli.app).commands  # type: ignore[attr-defined]
    assert COMMANDS.keys() == commands.keys()
    for word, meant in {"list": "models", "library": "models", "show": "info"}.items():
        assert nearest(word, commands, COMMANDS) == [meant]


def test_text_is_safe_and_short_wherever_it_comes_from() -> None:
    assert shown("a\tb\nc é ж 中 𝛷") == "a\tb\nc é ж 中 𝛷"
    assert shown("\x1b[31m\x00\x9b\u202e\u2028\ud800\udcff") == (
        r"\x1b[31m\x00\x9b\u202e\u2028\ud800\xff"
    )
    assert one_line("a\nb\rc") == r"a b\x0dc"
    assert quoted("a\nb") == r"`a\nb`"
    assert len(quoted("x" * 10**6)) < 120
    assert max(map(len, shown("x" * 10**6 + "\n" + "y" * 999).split("\n"))) < 1010
    for name in ("caf\udce9", "\udc80\udcff", "plain"):
        assert as_name(as_text(name)) == name
        as_text(name).encode()


def test_json_has_no_number_that_is_not_finite() -> None:
    data = {"a": [float("nan"), (-float("inf"), 1.5)], "b": {"c": float("inf")}, "d": Path("e\x1b")}
    text = as_json(data)
    assert json.loads(text) == {"a": [None, [None, 1.5]], "b": {"c": None}, "d": "e\x1b"}
    assert "\x1b" not in text


def test_what_is_shown_of_an_object_is_short() -> None:
    model = holonom.Model.library("double_pendulum")
    certified = model.simulate(end_time=0.1, certify=True)
    other = model.simulate(end_time=0.1, tolerance=1e-2)
    compared = holonom.compare(model, methods=["ForRadau"], end_time=0.1, repeat=0)
    differences = holonom.diff(certified, other)
    objects = [model.check(), certified.certification, differences, compared, compared.rows[0]]
    objects += [certified.sketch(), model, certified, model.channels]
    for one in objects:
        assert len(repr(one)) < 200, repr(one)
    assert "2 degrees of freedom" in repr(objects[0])
    assert "ForRadau at 1e-02: completed" in repr(objects[4])
    assert str(objects[1]).splitlines()[1].split()[2] == certified.certification.ranked[0].name
    for one in (objects[0], differences, compared):
        assert one._repr_html_().startswith("<pre>")
        assert "<" not in one._repr_html_()[5:-6]


def test_calls_that_are_nearly_right_say_what_was_meant() -> None:
    with pytest.raises(holonom.UsageError, match=r"`Model\.load\(path\)`"):
        holonom.Model("x.toml")  # type: ignore[arg-type]
    with pytest.raises(holonom.UsageError, match="that of the model"):
        holonom.Tolerance(translation=1e-6)
    model = holonom.Model.from_text(PENDULUM)
    result = model.simulate(end_time=0.1)
    with pytest.raises(KeyError, match=r"rod\.angular_velocity"):
        model.channels["rod.omega"]
    with pytest.raises(KeyError, match="`error`, `accepted`"):
        result.steps["x"]
    assert model.channels.get("rod.omega") is None
    for first, count in ((-1, 5), (0, -1), (0.5, 1)):
        with pytest.raises(holonom.UsageError, match="counted from 0"):
            result.rows(first, count, ["rod.position"])  # type: ignore[arg-type]


def test_models_of_one_text_are_equal() -> None:
    model = holonom.Model.from_text(PENDULUM)
    again = pickle.loads(pickle.dumps(model))
    assert model == again
    assert len({model, again, model.with_values({"bodies.rod.mass": 3.0})}) == 2
    assert model != PENDULUM
