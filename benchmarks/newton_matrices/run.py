"""Work and contraction of Newton's matrix, inflated and simplified, on chains and loops.

Run with cargo installed: ``python benchmarks/newton_matrices/run.py``. It builds and runs the
example ``newton_matrices`` of the engine.
"""

import csv
import subprocess
import tempfile
from math import cos, pi, sin, tan
from pathlib import Path

HERE = Path(__file__).parent
COMMAND = "cargo run --release --quiet -p holonom --example newton_matrices --"
COLUMNS = [
    *("model", "tolerance", "bodies", "dof", "steps"),
    *("inflated_operations_by_one_order", "inflated_operations"),
    *("inflated_fill", "simplified_operations", "simplified_fill"),
    *("mean_contraction", "largest_contraction"),
    *("simplified_mean_contraction", "simplified_largest_contraction"),
]
HEAD = 'holonom = 1\ntitle = "{title}"\ndimension = "{dimension}"\ngravity = {gravity}\n'


class Text:
    """A planar or spatial model that is written item by item."""

    def __init__(self, title: str, dimension: str = "planar") -> None:
        gravity = [0.0, -9.81] if dimension == "planar" else [0.0, 0.0, -9.81]
        self.lines = [HEAD.format(title=title, dimension=dimension, gravity=gravity)]

    def rod(self, name: str, position: tuple[float, float], angle: float = 0.0) -> None:
        """Add a planar rod of 1 m and 1 kg."""
        self.lines.append(
            f'bodies."{name}" = {{ mass = 1.0, inertia = "=1/12", position = {list(position)}, '
            f"angle = {angle} }}"
        )

    def pin(
        self, first: str, point: tuple[float, float], second: str, end: float, spring: float = 0.0
    ) -> None:
        """Add a revolute joint at an end of the second rod, with a spring that is at rest."""
        between = f'between = ["{first}", "{second}"]'
        name = f"{first}_to_{second}"
        self.lines.append(
            f'joints."{name}" = {{ type = "revolute", {between}, '
            f"points_in_body = [{list(point)}, [{end}, 0.0]] }}"
        )
        if spring:
            self.lines.append(
                f'forces."{name}_spring" = {{ type = "rsda", {between}, stiffness = {spring}, '
                f"damping = {spring / 100} }}"
            )

    def text(self) -> str:
        """Return the model file."""
        return "\n".join(self.lines) + "\n"


def chain(n: int, spring: float) -> str:
    """Return links in a row that begin horizontally."""
    model = Text("chain")
    for i in range(1, n + 1):
        model.rod(f"link_{i}", (i - 0.5, 0.0))
        first, x = ("ground", 0.0) if i == 1 else (f"link_{i - 1}", 0.5)
        model.pin(first, (x, 0.0), f"link_{i}", -0.5, spring)
    return model.text()


def spatial_chain(n: int) -> str:
    """Return links in a row with axes that alternate, springs in all joints."""
    model = Text("spatial chain", "spatial")
    for i in range(1, n + 1):
        first, x = ("ground", 0.0) if i == 1 else (f"link_{i - 1}", 0.5)
        between, axis = f'between = ["{first}", "link_{i}"]', [0.0, float(i % 2), float(1 - i % 2)]
        body = (
            f"bodies.link_{i} = {{ mass = 1.0, position = [{i - 0.5}, 0.0, 0.0], "
            "inertia = [[0.01, 0.0, 0.0], [0.0, 0.083, 0.0], [0.0, 0.0, 0.083]] }"
        )
        joint = (
            f'joints.joint_{i} = {{ type = "revolute", {between}, axis = {axis}, '
            f"points_in_body = [[{x}, 0.0, 0.0], [-0.5, 0.0, 0.0]] }}"
        )
        spring = (
            f'forces.spring_{i} = {{ type = "rsda", {between}, axis = {axis}, '
            "stiffness = 1e3, damping = 10.0 }"
        )
        model.lines += [body, joint, spring]
    return model.text()


def grid(rows: int, n: int) -> str:
    """Return rows of links with posts between them: a ladder where there are two."""
    model = Text("grid")
    for j in range(rows):
        for i in range(1, n + 1):
            model.rod(f"beam_{i}_{j}", (i - 0.5, float(j)))
            first, point = (
                (f"beam_{i - 1}_{j}", (0.5, 0.0)) if i > 1 else ("ground", (0.0, float(j)))
            )
            model.pin(first, point, f"beam_{i}_{j}", -0.5, 1e5 if j == 0 else 0.0)
    for j in range(1, rows):
        for i in range(1, n + 1):
            model.rod(f"post_{i}_{j}", (float(i), j - 0.5), pi / 2)
            model.pin(f"beam_{i}_{j - 1}", (0.5, 0.0), f"post_{i}_{j}", -0.5)
            model.pin(f"beam_{i}_{j}", (0.5, 0.0), f"post_{i}_{j}", 0.5)
    return model.text()


def ring(n: int) -> str:
    """Return a chain that is closed to a loop over one link of the ground, springs at rest."""
    model, turn = Text("ring"), 2 * pi / (n + 1)
    for i in range(1, n + 1):
        angle = turn * (i - 0.5)
        radius = 0.5 / tan(turn / 2)
        model.rod(f"link_{i}", (radius * cos(angle), radius * sin(angle)), angle + pi / 2)
        first, point = (
            (f"link_{i - 1}", (0.5, 0.0)) if i > 1 else ("ground", (0.5 / sin(turn / 2), 0.0))
        )
        model.pin(first, point, f"link_{i}", -0.5)
        if i > 1:
            model.lines.append(
                f'forces.spring_{i} = {{ type = "rsda", between = ["{first}", "link_{i}"], '
                f"stiffness = 1e5, damping = 1e3, free_angle = {turn} }}"
            )
    outer, last = 0.5 / sin(turn / 2), turn * n
    model.pin("ground", (outer * cos(last), outer * sin(last)), f"link_{n}", 0.5)
    return model.text()


def four_bars(n: int) -> str:
    """Return upright cranks with couplers between them, at 1 rad/s."""
    model = Text("four-bars")
    for i in range(n + 1):
        model.rod(f"crank_{i}", (float(i), 0.5), pi / 2)
        model.pin("ground", (float(i), 0.0), f"crank_{i}", -0.5)
        if i:
            model.rod(f"coupler_{i}", (i - 0.5, 1.0))
            model.pin(f"crank_{i - 1}", (0.5, 0.0), f"coupler_{i}", -0.5)
            model.pin(f"crank_{i}", (0.5, 0.0), f"coupler_{i}", 0.5)
    model.lines.append("initial.bodies.crank_0 = { angular_velocity = 1.0 }")
    return model.text()


#: Model and end time, s.
MODELS = {
    "free chain of 20": (chain(20, 0.0), 2.0),
    "stiff chain of 20": (chain(20, 1e5), 1.0),
    "spatial chain of 20": (spatial_chain(20), 1.0),
    "ring of 30": (ring(30), 1.0),
    "four-bars, 40 loops": (four_bars(40), 2.0),
    "ladder of 100 loops": (grid(2, 100), 1.0),
    "grid of 4 by 10 loops": (grid(5, 10), 1.0),
}
LIBRARY = {"andrews": 0.03, "spatial_four_bar": 2.0, "hmmwv14": 1.0, "hmmwv14_bushing": 1.0}


def main() -> None:
    """Measure and write ``results.csv``."""
    with tempfile.TemporaryDirectory() as folder, (HERE / "results.csv").open("w") as file:
        cases = {}
        for name, (text, end) in MODELS.items():
            cases[name] = (Path(folder) / f"{len(cases)}.toml", end)
            cases[name][0].write_text(text)
        for name, end in LIBRARY.items():
            cases[name] = (HERE / f"../../models/{name}/model.toml", end)
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for name, (path, end) in cases.items():
            found = subprocess.run(
                [*COMMAND.split(), str(path), str(end)],
                check=True,
                stdout=subprocess.PIPE,
                text=True,
                cwd=HERE,
            )
            for line in found.stdout.splitlines():
                print(f"{name}: {line}")
                writer.writerow([name, *line.split(",")])


if __name__ == "__main__":
    main()
