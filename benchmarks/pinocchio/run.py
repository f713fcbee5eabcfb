"""Time of accelerations against Pinocchio's forward dynamics, from the C++ core of its wheel.

Run with cargo, g++ and the network at hand: ``python benchmarks/pinocchio/run.py``. It puts
Pinocchio into an environment of its own, ``target/pinocchio-env``, builds the C++ program beside
this file there, and runs the engine's example ``forward_dynamics`` and that program in turns.
"""

import csv
import os
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from statistics import median

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WORK = ROOT / "target/pinocchio-env"
PACKAGES = ["pin==4.1.0", "cmeel-eigen==3.4.1"]
#: Of Pinocchio's own build, and without its assertions.
FLAGS = (
    "-std=c++17 -O3 -w -DNDEBUG -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30 "
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12"
)
#: Algorithms from the library of the wheel, which is for any processor, or compiled here for this
#: one from its headers.
BUILDS = {
    "any processor": "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION",
    "native": "-march=native",
}
#: Of the engine.
TARGETS = {"any processor": "", "native": "-C target-cpu=native"}
#: In the names of methods that solve other equations.
OTHER = "for rods"
REPETITIONS = 5
ALLOWED_DIFFERENCE = 1e-8
BOUNDS = {"chain of 50": 1.2, "tree of 14": 1.2, "vehicle": 1.0}

LINKS = 50
CHAIN = """holonom = 1
dimension = "{dimension}"
gravity = {gravity}
[patterns.chain]
over.i = {{ from = 1, to = {links} }}
bodies."link_{{i}}" = {{ mass = 1.0, inertia = {inertia}, position = {position} }}
joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i - 1}}", "link_{{i}}"],
  point = {point}{axis} }}
[joints]
joint_1 = {{ between = ["ground", "link_1"] }}
"""
PLANAR_CHAIN = CHAIN.format(
    dimension="planar",
    gravity="[0.0, -9.81]",
    links=LINKS,
    inertia='"=1/12"',
    position='["=i - 0.5", 0.0]',
    point='["=i - 1.0", 0.0]',
    axis="",
)
SPATIAL_CHAIN = CHAIN.format(
    dimension="spatial",
    gravity="[0.0, -9.81, 0.0]",
    links=LINKS,
    inertia='[[0.01, 0.0, 0.0], [0.0, "=1/12", 0.0], [0.0, 0.0, "=1/12"]]',
    position='["=i - 0.5", 0.0, 0.0]',
    point='["=i - 1.0", 0.0, 0.0]',
    axis=", axis = [0.0, 0.0, 1.0]",
)


def body_line(parent: int, kind: str, place: list, center: list, mass: float, inertia: list) -> str:
    """A body for the C++ program: parent, joint, its place in the parent's joint, mass."""
    numbers = [*place, *center, mass, *(x for row in inertia for x in row)]
    return f"body {parent} {kind}\n" + " ".join(map(repr, numbers))


def chain_for_pinocchio() -> str:
    """The spatial chain: every link in the axes of the joint at its inner end."""
    inertia = [[0.01, 0.0, 0.0], [0.0, 1 / 12, 0.0], [0.0, 0.0, 1 / 12]]
    lines = ["0.0 -9.81 0.0"]
    for i in range(LINKS):
        place = [0.0 if i == 0 else 1.0, 0.0, 0.0]
        lines.append(body_line(i, "revolute z", place, [0.5, 0.0, 0.0], 1.0, inertia))
    return "\n".join(lines) + "\n"


def vehicle(cuts: list[str], *, is_forced: bool = False) -> tuple[str, str]:
    """The library's vehicle for both programs; without forces it has no steering driver, either.

    ``cuts``: the first words of the joints that close loops and stay.
    """
    source = (ROOT / "models/hmmwv14/model.toml").read_text()
    model = tomllib.loads(source)
    text = [line for line in source.splitlines() if not line.startswith("shapes.")]
    if not is_forced:
        del text[text.index("[drivers]") : text.index("[initial]")]
    del text[text.index("[outputs]") : text.index("[simulation]")]
    loops = ["lower_ball", "tie_rod"]
    gone = [loop for loop in loops if loop not in cuts]
    text = [line for line in text if not line.startswith(tuple(gone))]

    bodies, names = model["bodies"], list(model["bodies"])

    def minus(a: list, b: list) -> list:
        return [x - y for x, y in zip(a, b, strict=True)]

    edges = {names[0]: (None, "free", bodies[names[0]]["position"])}
    closures = []
    for name, joint in model["joints"].items():
        if not name.startswith(tuple(loops)):
            first, second = joint["between"]
            axis = "xyz"[joint["axis"].index(1.0)] if "axis" in joint else ""
            edges[second] = (first, f"{joint['type']} {axis}".strip(), joint["point"])
        elif name.startswith(tuple(cuts)):
            points = joint.get("points") or [joint["point"]] * 2
            kind = "ball" if joint["type"] == "spherical" else "rod"
            closures.append((kind, joint["between"], points))
    lines = [" ".join(map(repr, model["gravity"]))]
    for name in names:
        parent, kind, point = edges[name]
        body = bodies[name]
        place = minus(point, edges[parent][2]) if parent else [0.0, 0.0, 0.0]
        at = names.index(parent) + 1 if parent else 0
        center = minus(body["position"], point)
        lines.append(body_line(at, kind, place, center, body["mass"], body["inertia"]))
    for kind, between, points in closures:
        ends = [kind]
        for name, point in zip(between, points, strict=True):
            ends += [str(names.index(name) + 1), *map(repr, minus(point, edges[name][2]))]
        lines.append(" ".join(ends))
    return "\n".join(text) + "\n", "\n".join(lines) + "\n"


def models() -> dict[str, tuple[float, str, str | None]]:
    """How far the states swing, and the model for both programs."""
    chain = chain_for_pinocchio()
    return {
        "chain of 50": (1.0, SPATIAL_CHAIN, chain),
        "chain of 50 in the plane": (1.0, PLANAR_CHAIN, chain),
        "tree of 14": (1.0, *vehicle([])),
        "vehicle without rods": (0.02, *vehicle(["lower_ball"])),
        "vehicle": (0.02, *vehicle(["lower_ball", "tie_rod"])),
        "vehicle with forces": (0.005, vehicle(["lower_ball", "tie_rod"], is_forced=True)[0], None),
    }


def call(command: list[object], **env: str) -> str:
    """Run a command; its output."""
    words = [str(word) for word in command]
    run = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True, env=os.environ | env)
    return run.stdout


def build_pinocchio() -> dict[str, Path]:
    """The C++ programs, by build."""
    python = WORK / "bin/python"
    if not python.exists():
        call([sys.executable, "-m", "venv", WORK])
    call([python, "-m", "pip", "install", "--quiet", *PACKAGES])
    sites = call([python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"])
    prefix = Path(sites.strip()) / "cmeel.prefix"
    source = HERE / "accelerations.cpp"
    programs = {}
    for name, own in BUILDS.items():
        program = WORK / ("accelerations_" + name.replace(" ", "_"))
        programs[name] = program
        if program.exists() and program.stat().st_mtime > source.stat().st_mtime:
            continue
        flags = shlex.split(f"{FLAGS} {own}")
        folders = [f"-I{prefix}/include", f"-I{prefix}/include/eigen3", f"-L{prefix}/lib"]
        library = [f"-Wl,-rpath,{prefix}/lib", "-lpinocchio_default"]
        call(["g++", *flags, *folders, source, "-o", program, *library])
    return programs


def build_holonom() -> dict[str, Path]:
    """The engine's example, by target."""
    programs = {}
    for name, flags in TARGETS.items():
        own = Path(os.environ.get("CARGO_TARGET_DIR", "target"))
        folder = WORK / "native" if flags else ROOT / own
        command = "cargo build --release --quiet -p holonom --example forward_dynamics"
        place = ["--manifest-path", ROOT / "Cargo.toml", "--target-dir", folder]
        call([*command.split(), *place], **({"RUSTFLAGS": flags} if flags else {}))
        programs[name] = folder / "release/examples/forward_dynamics"
    return programs


def microseconds(
    holonom: dict[str, Path], pinocchio: dict[str, Path]
) -> tuple[dict[tuple[str, ...], float], dict[str, dict[str, str]]]:
    """Medians by model, code, build and method, and what the engine says of each model."""
    times: dict[tuple[str, ...], list[float]] = {}
    facts = {}
    file, tree, states = (WORK / name for name in ["model.toml", "tree.txt", "states.txt"])
    for name, (swing, text, for_pinocchio) in models().items():
        file.write_text(text)
        tree.write_text(for_pinocchio or "")
        for _ in range(REPETITIONS):
            for target, program in holonom.items():
                found = call([program, file, swing, states])
                row = facts[name] = next(csv.DictReader(found.splitlines()))
                assert row["left_to_others"] == "0", (name, row)
                for method in ["evaluation", "at known positions"]:
                    key = name, "holonom", target, method
                    times.setdefault(key, []).append(float(row[method]))
            for build, program in pinocchio.items() if for_pinocchio else []:
                for line in call([program, tree, states]).splitlines():
                    method, took, difference = line.rsplit(",", 2)
                    is_same = OTHER not in method
                    assert not is_same or float(difference) < ALLOWED_DIFFERENCE, (name, line)
                    times.setdefault((name, "pinocchio", build, method), []).append(float(took))
    return {key: median(found) for key, found in times.items()}, facts


def main() -> None:
    """Measure, write ``results.csv`` and hold accelerations and ratios against their bounds."""
    pinocchio, holonom = build_pinocchio(), build_holonom()
    times, facts = microseconds(holonom, pinocchio)
    with (HERE / "results.csv").open("w", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        head = ["model", "coordinates", "rows", "corrections"]
        writer.writerow([*head, "code", "build", "method", "microseconds"])
        for (model, *what), took in times.items():
            sizes = [facts[model][key] for key in head[1:]]
            writer.writerow([model, *sizes, *what, f"{took:.2f}"])
            print(f"{model:25} {' | '.join(what):60} {took:8.2f} µs")
    for model, bound in BOUNDS.items():
        for target in TARGETS:
            own = times[model, "holonom", target, "evaluation"]
            other = min(
                took
                for (*at, method), took in times.items()
                if at == [model, "pinocchio", target] and OTHER not in method
            )
            verdict = "held" if own <= bound * other else "missed"
            print(f"{model}, {target}: {own / other:.2f} times, bound {bound}: {verdict}")


if __name__ == "__main__":
    main()
