"""What a run costs beside its steps: the call, output rows, and others at the same time.

Run with the package installed: ``python benchmarks/overhead/run.py``.
"""

import csv
import multiprocessing
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import holonom

HERE = Path(__file__).parent
MODELS = HERE / "../../models"
SMALL = {"end_time": 0.01, "interval": 0.01, "tolerance": 1e-3, "channels": []}
END = 2.5  # s of the vehicle
ROWS = 500
RUNS = 200
BATCH = 8
WORKERS = 2


def load(name: str) -> holonom.Model:
    return holonom.Model.load(MODELS / name / "model.toml")


def least(call: Callable[[], float], repeats: int) -> float:
    """Smallest of several measurements: others on the machine only add."""
    return min(call() for _ in range(repeats))


def call_seconds(model: holonom.Model, count: int = 10) -> tuple[float, float]:
    """Processor time of one call, and of the engine in it, s: mean over a block of calls."""
    begun = time.thread_time()
    results = [model.simulate(**SMALL) for _ in range(count)]
    took = time.thread_time() - begun
    return took / count, sum(r.meta["cpu_seconds"] for r in results) / count


def process_seconds(*line: str) -> float:
    """Processor time of one process of Python, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *line], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run_seconds(model: holonom.Model, interval: float, channels: list[str]) -> float:
    """Processor time of one call on the vehicle, s."""
    begun = time.thread_time()
    model.simulate(end_time=END, interval=interval, channels=channels)
    return time.thread_time() - begun


def vehicle(_: int) -> float:
    """Run the vehicle of this process once; return the processor time of its thread, s."""
    begun = time.thread_time()
    _models[0].simulate(end_time=1.0, interval=0.01)
    return time.thread_time() - begun


_models: list[holonom.Model] = []


def begin() -> None:
    _models[:] = [load("hmmwv14")]
    vehicle(0)


def throughput(pool: ThreadPoolExecutor | ProcessPoolExecutor) -> tuple[float, float]:
    """Wall time of the fastest batch of runs, and processor time of all runs, s."""
    with pool:
        list(pool.map(vehicle, range(4 * WORKERS)))  # all workers are there
        batches, worked = [], 0.0
        for _ in range(RUNS // BATCH):
            begun = time.perf_counter()
            worked += sum(pool.map(vehicle, range(BATCH)))
            batches.append(time.perf_counter() - begun)
        return min(batches), worked


def main() -> None:
    """Measure and write the table."""
    rows: list[tuple[str, float, str]] = []
    pendulum = load("simple_pendulum")
    blocks = [call_seconds(pendulum) for _ in range(1000)]
    call, engine = min(blocks)
    rows += [("one call", 1e3 * call, "ms"), ("engine in it", 1e3 * engine, "ms")]
    rows += [("around it", 1e3 * min(a - b for a, b in blocks), "ms")]

    for what, line in (
        ("Python alone", ("-c", "pass")),
        ("`import holonom`", ("-c", "import holonom")),
        ("`holonom --version`", ("-m", "holonom", "--version")),
        ("`holonom check` of a small model", ("-m", "holonom", "check", "library:simple_pendulum")),
    ):
        seconds = least(lambda words=line: process_seconds(*words), 20)
        rows.append((what, 1e3 * seconds, "ms"))

    model = load("hmmwv14")
    coordinates = [
        name for name in model.channels if name.endswith((".position", ".euler_parameters"))
    ]
    for what, interval, channels in (
        ("vehicle, 2 rows", END, []),
        (f"vehicle, {ROWS + 1} rows, states only", END / ROWS, []),
        (f"vehicle, {ROWS + 1} rows, all coordinates", END / ROWS, coordinates),
        (f"vehicle, {ROWS + 1} rows, all channels", END / ROWS, ["*"]),
    ):
        seconds = least(lambda i=interval, c=channels: run_seconds(model, i, c), 40)
        rows.append((what, 1e3 * seconds, "ms"))

    begin()
    one, alone = throughput(ThreadPoolExecutor(1))
    context = multiprocessing.get_context("spawn")
    several = {
        "threads": ThreadPoolExecutor(WORKERS),
        "processes": ProcessPoolExecutor(WORKERS, context, begin),
    }
    for kind, pool in several.items():
        wall, worked = throughput(pool)
        rows.append((f"{WORKERS} {kind} against 1, wall time", one / wall, "times"))
        rows.append((f"{WORKERS} {kind} against 1, processor time", worked / alone, "times"))

    with (HERE / "results.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["what", "value", "unit"])
        for what, value, unit in rows:
            writer.writerow([what, f"{value:.3g}", unit])
            print(f"{what}: {value:.3g} {unit}")


if __name__ == "__main__":
    main()
