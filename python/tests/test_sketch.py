"""Drawings of mechanisms: what is drawn stands where the run has it, and moves as it does."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from conftest import MODELS, PENDULUM

import holonom
from holonom.base.errors import FileError, UsageError
from holonom.result import Result
from holonom.view.encoding import floats, turns, unpacked
from holonom.view.scene import scene
from holonom.view.sketch import _BOX, WIDTH, _facets, _hull, _line, _solid, sketch

SVG = "{http://www.w3.org/2000/svg}"


#: A small body on a massless rod.
BOB = PENDULUM.replace("rod", "bob").replace("inertia = 0.1", "inertia = 0.001")


def places(path: str) -> np.ndarray:
    """Return the points of one piece of a path, which is written in steps."""
    head, _, tail = path.strip("Mz").partition("l")
    steps = [float(n) for n in [*head.split(" "), *tail.split(" ")] if n]
    return np.cumsum(np.array(steps).reshape(-1, 2), axis=0)


@pytest.fixture(scope="module")
def pendulum() -> Result:
    return holonom.Model.from_text(BOB).simulate(end_time=2.0)


@pytest.fixture(scope="module")
def vehicle() -> Result:
    return holonom.Model.load(MODELS / "hmmwv14" / "model.toml").simulate(end_time=2.0)


def test_a_rod_is_drawn_at_the_angle_that_it_has(pendulum: Result) -> None:
    times = np.array([0.0, 0.3, 0.55])
    text = pendulum.sketch(times).document()
    angles = pendulum.sample(times, ["bob.angle"])["bob.angle"]
    root = ET.fromstring(text)
    lines = [p.get("d", "") for p in root.iter(f"{SVG}path") if p.get("stroke-linecap")]
    rods = [places(d) for d in lines if np.ptp(places(d), axis=0).max() > 20.0]
    assert len(rods) == 3
    # The last pose is drawn last; rows count downwards.
    for rod, angle in zip(rods, angles, strict=True):
        along = (rod[1] - rod[0]) * [1.0, -1.0]
        turned = np.arctan2(along[1], along[0]) - angle
        assert np.sin(turned) == pytest.approx(0.0, abs=3e-3)
    first, last = rods[0], rods[-1]
    assert np.abs(first[0] - last[0]).max() < 0.2  # both hang on the pivot


def test_what_moves_is_drawn_at_every_moment(pendulum: Result) -> None:
    times = np.linspace(0.0, 1.0, 21)
    root = ET.fromstring(pendulum.sketch(times, moving=True).document())
    moving = list(root.iter(f"{SVG}animate"))
    assert moving
    for one in moving:
        assert len(one.get("values", "").split(";")) == times.size
        assert one.get("dur") == "1.5s"  # shorter ones are slowed down
    assert "1.5 times slower" in "".join(root.itertext())
    bob = next(
        a for a in moving if np.ptp(places(a.get("values", "").split(";")[0]), axis=0).max() > 20
    )
    ends = np.array([places(d)[1] for d in bob.get("values", "").split(";")])
    angle = pendulum.sample(times, ["bob.angle"])["bob.angle"]
    assert np.corrcoef(ends[:, 0], np.cos(angle))[0, 1] > 0.9999
    assert np.corrcoef(-ends[:, 1], np.sin(angle))[0, 1] > 0.9999


def test_nothing_leaves_the_picture(pendulum: Result) -> None:
    for moving in (False, True):
        drawn = pendulum.sketch(moving=moving)
        root = ET.fromstring(drawn.document())
        for path in root.iter(f"{SVG}path"):
            for piece in re.findall(r"M[^M]*", path.get("d", "")):
                if re.search("[ah]", piece):  # signs of joints
                    continue
                points = places(piece)
                assert points[:, 0].min() > 0.0
                assert points[:, 0].max() < WIDTH
                assert points[:, 1].max() < drawn.height


def test_what_travels_is_followed_and_its_road_passes(vehicle: Result) -> None:
    drawn = vehicle.sketch(np.linspace(0.0, 1.0, 11), moving=True)
    (move,) = ET.fromstring(drawn.document()).iter(f"{SVG}animateTransform")
    shifts = np.array([p.split(" ") for p in move.get("values", "").split(";")], dtype=float)
    way = vehicle.sample(np.linspace(0.0, 1.0, 11), ["chassis.position"])["chassis.position"][:, 0]
    # The road goes back as far as the vehicle goes on.
    assert np.corrcoef(shifts[:, 0], -way)[0, 1] > 0.99999
    assert len(drawn.document()) < 500_000
    assert vehicle.sketch().document().count("<g opacity") >= 1  # it stands there more than once


def test_rods_do_not_cover_what_joins_them() -> None:
    made = holonom.Model.library("spatial_four_bar").simulate(end_time=0.1).sketch([0.0])
    parts = list(ET.fromstring(made.document()).iter(f"{SVG}path"))
    symbols = [k for k, p in enumerate(parts) if not p.get("stroke-linecap")]
    assert len(symbols) == 4
    for k in symbols:
        place = np.array(re.findall(r"[-.\d]+", parts[k].get("d", ""))[:2], dtype=float)
        for later in parts[k + 1 :]:
            if later.get("stroke-linecap"):
                first, last = places(later.get("d", ""))
                along = last - first
                part = np.clip((place - first) @ along / (along @ along), 0.0, 1.0)
                away = np.linalg.norm(first + part * along - place)
                assert away > 0.5 * float(later.get("stroke-width", 0.0))


def test_a_box_shows_the_faces_that_look_at_the_eye() -> None:
    solid = _solid({"type": "box", "size": [2.0, 2.0, 2.0], "at": [0.0, 0.0, 0.0]})
    assert solid is not None
    flipped = solid.points[:, :2] * [1.0, -1.0] * 50.0
    assert _facets(_BOX, flipped).count("M") == 1  # from straight above, its top
    # From a corner three faces are seen.
    eye = np.array([1.0, -1.2, 0.8]) / np.linalg.norm([1.0, -1.2, 0.8])
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    seen = np.stack([solid.points @ right, -solid.points @ np.cross(eye, right)], axis=1) * 50.0
    faces = _facets(_BOX, seen)
    assert faces.count("M") == 3
    areas = [abs(area(places(piece))) for piece in re.findall(r"M[^M]*", faces)]
    assert sum(areas) == pytest.approx(abs(area(places(_hull(seen)))), rel=1e-2)


def area(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize(
    ("shape", "reach"),
    [
        ({"type": "sphere", "at": [1.0, 0.0, 0.0], "radius": 0.2}, 1.2),
        ({"type": "rod", "from": [0.0, 0.0, 0.0], "to": [1.0, 0.0, 0.0], "radius": 0.1}, 1.1),
        ({"type": "cylinder", "at": [0.0, 0.0, 0.0], "axes": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
          "radius": 0.1, "length": 2.0}, 1.0),
        ({"type": "capsule", "at": [0.0, 0.0, 0.0], "axes": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
          "radius": 0.1, "length": 2.0}, 1.1),
        ({"type": "wheel", "at": [0.0, 0.0, 0.0], "axis": [0.0, 2.0, 0.0], "radius": 0.5,
          "width": 0.2}, 0.5),
        ({"type": "plate", "points": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "thickness": 0.1}, 1.0),
    ],
)  # fmt: skip
def test_shapes_reach_as_far_as_they_say(shape: dict[str, object], reach: float) -> None:
    solid = _solid(shape)
    assert solid is not None
    assert solid.points[:, 0].max() + solid.radius == pytest.approx(reach, abs=1e-2)


def test_what_is_not_seen_at_all_is_not_drawn() -> None:
    seen = 'seen = { type = "box", size = [0.5, 0.5, 0.5], opacity = 0.5 }'
    unseen = 'unseen = { type = "sphere", radius = 3.0, opacity = 0.0 }'
    text = BOB.replace("bob = {", f"bob = {{ shapes = {{ {seen}, {unseen} }},", 1)
    model = holonom.Model.from_text(text)
    drawn = scene(model.simulate(end_time=0.1))
    assert [s["type"] for body in drawn["bodies"] for s in body["shapes"]] == ["box"]


def test_a_mesh_is_drawn_by_its_faces() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    data = base64.b64encode(np.array(faces, dtype="<u4").tobytes()).decode("ascii")
    numbers = {"kind": "u4", "data": data}
    solid = _solid({"type": "mesh", "vertices": floats(corners), "faces": numbers})
    assert solid is not None
    # From above, z towards the eye: the slanted face hides the others.
    assert solid.outline(solid.points[:, :2] * [50.0, -50.0]).count("M") == 1


def test_numbers_come_back_from_their_text() -> None:
    values = np.array([[1.0, -2.5], [3.0, 4.0]])
    np.testing.assert_array_equal(unpacked(floats(values)).reshape(2, 2), values)
    assert unpacked(turns(np.array([[1.0, 0.0, 0.0, 0.0]]))).tolist() == [32767, 0, 0, 0]


def test_lines_are_written_without_losing_their_way() -> None:
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.normal(scale=3.0, size=(2000, 2)), axis=0)
    # To a tenth of a pixel, however many steps.
    np.testing.assert_allclose(places(_line(points)), points, atol=0.06)


def test_a_sketch_is_a_picture_by_holonom(pendulum: Result, tmp_path: Path) -> None:
    target = tmp_path / "new" / "rod.svg"
    made = pendulum.sketch(path=target)
    assert target.read_text(encoding="utf-8") == made.document() == made._repr_svg_()
    pendulum.sketch(path=target)  # replaces its own
    target.write_text("<svg/>")
    with pytest.raises(FileError, match="not a picture by Holonom"):
        pendulum.sketch(path=target)
    with pytest.raises(UsageError, match=r"\.svg"):
        made.save(tmp_path / "rod.png")
    with pytest.raises(UsageError, match="no state"):
        pendulum.sketch(5.0)
    with pytest.raises(UsageError, match="100 at most"):
        pendulum.sketch(np.linspace(0.0, 1.0, 101))
    with pytest.raises(UsageError, match="`times` is `'now'`"):
        pendulum.sketch("now")


def test_texts_of_a_model_cannot_leave_a_sketch() -> None:
    text = PENDULUM.replace("Rod on a pin", "</svg><script>&")
    made = holonom.Model.from_text(text).simulate().sketch()
    tags = {e.tag for e in ET.fromstring(made.document()).iter()}
    assert f"{SVG}script" not in tags
    assert "</svg><script>" in made.title
    bell = holonom.Model.from_text(PENDULUM.replace("Rod on a pin", r"Bell \u0007")).simulate()
    assert "Bell \\x07" in ET.fromstring(bell.sketch().document()).get("aria-label", "")


def test_rows_are_poses_where_there_are_no_steps() -> None:
    bare = holonom.Model.from_text(PENDULUM).simulate(dense_output=False)
    assert bare.sketch().document().count("<g opacity") == 3
    assert sketch(bare, drawn=scene(bare)).title == bare.sketch().title
