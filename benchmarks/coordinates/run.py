"""Measure runs in joint and in Cartesian coordinates: processor time of the same steps."""

from __future__ import annotations

import csv
import itertools
import math
import statistics
from collections.abc import Iterator
from pathlib import Path

import holonom

ROUNDS = 15
TOLERANCE = 1e-3
MODELS = (
    "hmmwv14",
    "hmmwv14_bushing",
    "spatial_four_bar",
    "slider_crank",
    "andrews",
    "chain50",
    "double_pendulum_w10",
)


def closed_chain(links: int) -> str:
    """Return a chain of links in the plane, in a half circle between two hinges in the ground."""
    points = [
        (math.cos(math.pi * (1 - k / links)), -math.sin(math.pi * k / links))
        for k in range(links + 1)
    ]
    lines = ["[bodies]"]
    for k, (a, b) in enumerate(itertools.pairwise(points)):
        middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]
        lines.append(f"b{k} = {{ mass = 1.0, inertia = 0.01, position = {middle} }}")
    lines.append("[joints]")
    for k, point in enumerate(points):
        ends = ["ground" if k == 0 else f"b{k - 1}", "ground" if k == links else f"b{k}"]
        lines.append(hinge(f"j{k}", ends, point))
    return "\n".join(lines)


def four_bars(count: int) -> str:
    """Return a row of four-bars, each moved by the one before."""
    bodies, joints = ["[bodies]"], ["[joints]"]
    for k in range(count):
        x = 3.0 * k
        for name, place in (("c", [x, 0.5]), ("k", [x + 1.25, 1.25]), ("r", [x + 2.5, 0.75])):
            bodies.append(f"{name}{k} = {{ mass = 1.0, inertia = 0.2, position = {place} }}")
        joints += [
            hinge(f"a{k}", ["ground", f"c{k}"], (x, 0.0)),
            hinge(f"b{k}", [f"c{k}", f"k{k}"], (x, 1.0)),
            hinge(f"d{k}", [f"k{k}", f"r{k}"], (x + 2.5, 1.5)),
            hinge(f"e{k}", ["ground", f"r{k}"], (x + 2.5, 0.0)),
        ]
        if k:
            bodies.append(f"l{k} = {{ mass = 0.5, inertia = 0.05, position = [{x - 0.25}, 0.9] }}")
            joints += [
                hinge(f"f{k}", [f"r{k - 1}", f"l{k}"], (x - 0.5, 0.8)),
                hinge(f"g{k}", [f"l{k}", f"c{k}"], (x, 1.0)),
            ]
    return "\n".join([*bodies, *joints, "[initial.joints]", "a0 = { angular_velocity = 2.0 }"])


def scissors(stages: int) -> str:
    """Return a scissor lift on a spring."""
    slide = 'between = ["ground", "foot"], point = [1.0, 0.0], axis = [1.0, 0.0]'
    bodies = ["[bodies]", "foot = { mass = 0.2, inertia = 0.01, position = [1.0, 0.0] }"]
    joints = [
        "[joints]",
        hinge("base", ["ground", "p0"], (0.0, 0.0)),
        hinge("pin", ["foot", "q0"], (1.0, 0.0)),
        f'slide = {{ type = "translational", {slide} }}',
    ]
    for k in range(stages):
        arm = f"{{ mass = 1.0, inertia = 0.1, position = [0.5, {k + 0.5}] }}"
        bodies += [f"p{k} = {arm}", f"q{k} = {arm}"]
        joints.append(hinge(f"x{k}", [f"p{k}", f"q{k}"], (0.5, k + 0.5)))
        if k:
            joints.append(hinge(f"l{k}", [f"q{k - 1}", f"p{k}"], (0.0, float(k))))
            joints.append(hinge(f"r{k}", [f"p{k - 1}", f"q{k}"], (1.0, float(k))))
    spring = (
        'spring = { type = "tsda", between = ["ground", "foot"], '
        "points = [[0.0, 0.0], [1.0, 0.0]], stiffness = 2000.0, damping = 20.0, free_length = 1.0 }"
    )
    return "\n".join([*bodies, *joints, "[forces]", spring])


def spatial_four_bars(count: int) -> str:
    """Return a row of four-bars in space, each moved by the one before."""
    inertia = "inertia = [[0.1, 0.0, 0.0], [0.0, 0.12, 0.0], [0.0, 0.0, 0.13]]"
    ball = 'type = "spherical"'
    cross = 'type = "universal", axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]'
    bodies, joints = ["[bodies]"], ["[joints]"]

    def body(name: str, mass: float, place: list[float]) -> None:
        bodies.append(f"{name} = {{ mass = {mass}, {inertia}, position = {place} }}")

    def joint(name: str, kind: str, ends: list[str], point: list[float]) -> None:
        between = ", ".join(f'"{end}"' for end in ends)
        joints.append(f"{name} = {{ {kind}, between = [{between}], point = {point} }}")

    for k in range(count):
        x = 3.0 * k
        body(f"c{k}", 1.0, [x, 0.5, 0.0])
        body(f"k{k}", 2.0, [x + 1.25, 1.25, 0.1])
        body(f"r{k}", 1.5, [x + 2.5, 0.75, 0.2])
        joint(f"a{k}", 'type = "revolute", axis = [0.0, 0.0, 1.0]', ["ground", f"c{k}"], [x, 0, 0])
        joint(f"b{k}", ball, [f"c{k}", f"k{k}"], [x, 1.0, 0.0])
        joint(f"d{k}", cross, [f"k{k}", f"r{k}"], [x + 2.5, 1.5, 0.2])
        tilted = 'type = "revolute", axis = [0.0, 0.1, 1.0]'
        joint(f"e{k}", tilted, ["ground", f"r{k}"], [x + 2.5, 0.0, 0.2])
        if k:
            body(f"l{k}", 0.5, [x - 0.25, 0.9, 0.1])
            joint(f"f{k}", cross, [f"r{k - 1}", f"l{k}"], [x - 0.5, 0.8, 0.2])
            joint(f"g{k}", ball, [f"l{k}", f"c{k}"], [x, 0.6, 0.0])
    spring = (
        'spring = { type = "rsda", between = ["ground", "c0"], axis = [0.0, 0.0, 1.0], '
        "stiffness = 100.0, damping = 1.0 }"
    )
    initial = ["[initial.joints]", "a0 = { angular_velocity = 2.0 }"]
    return "\n".join([*bodies, *joints, "[forces]", spring, *initial])


def hinge(name: str, ends: list[str], point: tuple[float, float]) -> str:
    """Return a revolute joint between two bodies."""
    return f'{name} = {{ type = "revolute", between = {ends}, point = {list(point)} }}'.replace(
        "'", '"'
    )


def models() -> Iterator[tuple[str, holonom.Model, str, float]]:
    """Return names, models, codes and end times: the library's, and families with loops."""
    for name in MODELS:
        model = holonom.Model.library(name)
        end = 0.03 if name == "andrews" else model.defaults.get("end_time", 1.0)
        yield name, model, "ForRadau", end
    plane = 'holonom = 1\ndimension = "planar"\ngravity = [0.0, -9.81]\n'
    space = 'holonom = 1\ndimension = "spatial"\ngravity = [0.0, -9.81, 0.0]\n'
    for family, head, code, end, sizes in (
        (closed_chain, plane, "ForRadau", 1.0, (5, 20, 100, 200)),
        (four_bars, plane, "ForRadau", 1.0, (1, 3, 6, 10, 20)),
        (scissors, plane, "ForRadau", 1.0, (1, 3, 5, 10, 15, 30)),
        (spatial_four_bars, space, "ForRadau", 1.0, (1, 4, 6, 10, 20)),
        (closed_chain, plane, "DEABM", 0.3, (20, 50, 100, 150, 200)),
    ):
        for size in sizes:
            name = f"{family.__name__}_{size}"
            yield name, holonom.Model.from_text(head + family(size), name=name), code, end


def main() -> None:
    """Measure every model, alternating between both forms, and write the table."""
    lines = []
    for name, model, code, end in models():
        seconds: dict[str, list[float]] = {"cartesian": [], "joint": []}
        steps = {}
        for _ in range(ROUNDS):
            for form, measured in seconds.items():
                result = model.simulate(
                    end_time=end,
                    interval=end,
                    method=code,
                    tolerance=TOLERANCE,
                    channels=[],
                    coordinates=form,
                )
                measured.append(result.statistics["run_cpu_seconds"])
                steps[form] = result.statistics["steps"]
        median = {form: statistics.median(measured) for form, measured in seconds.items()}
        ratio = median["cartesian"] / median["joint"]
        per_second = 1e3 * median["joint"] / end
        print(
            f"{name:20} {code:8} {1e3 * median['cartesian']:8.2f} ms "
            f"{1e3 * median['joint']:8.2f} ms "
            f"{ratio:5.2f} times, {steps['cartesian']} and {steps['joint']} steps, "
            f"{per_second:.2f} ms per simulated second"
        )
        lines.append(
            [
                name,
                code,
                steps["cartesian"],
                steps["joint"],
                f"{1e3 * median['cartesian']:.3g}",
                f"{1e3 * median['joint']:.3g}",
                f"{ratio:.3g}",
                f"{per_second:.3g}",
            ]
        )
    with (Path(__file__).parent / "results.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(
            [
                "model",
                "code",
                "steps_cartesian",
                "steps_joint",
                "cartesian_ms",
                "joint_ms",
                "ratio",
                "joint_ms_per_simulated_second",
            ]
        )
        table.writerows(lines)


if __name__ == "__main__":
    main()
