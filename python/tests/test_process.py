"""The command as a process: signals at any moment, pipes, closed streams, the environment."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import MODELS

HOLONOM = [sys.executable, "-m", "holonom"]
VEHICLE = MODELS / "hmmwv14" / "model.toml"


def start(
    *arguments: object, interrupts: signal.Handlers = signal.SIG_DFL, **options: object
) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*HOLONOM, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, interrupts) and None,
        **options,
    )  # type: ignore[call-overload]


def wait_until_guarded(process: subprocess.Popen[str]) -> None:
    """Wait until the process handles SIGTERM itself: before, its first 20 ms are Python's own."""
    status = Path(f"/proc/{process.pid}/status")
    if not status.exists():
        time.sleep(0.3)
        return
    bit = 1 << (signal.SIGTERM - 1)
    while process.poll() is None:
        caught = next(x for x in status.read_text().splitlines() if x.startswith("SigCgt"))
        if int(caught.split()[1], 16) & bit:
            return
        time.sleep(0.002)


def end(process: subprocess.Popen[str], number: int, moment: float) -> tuple[int, str]:
    """Send a signal so many seconds after the guard is up; return status and messages."""
    wait_until_guarded(process)
    time.sleep(moment)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    return process.returncode, err


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result whose report and export take a while."""
    path = tmp_path_factory.mktemp("run") / "vehicle.holonom"
    arguments = ["--end-time", "0.3", "--interval", "1e-3", "-q", "-o", str(path)]
    subprocess.run([*HOLONOM, "run", str(VEHICLE), *arguments], check=True)
    return path


def commands(vehicle: Path, folder: Path) -> list[list[object]]:
    return [
        ["run", VEHICLE, "-o", folder / "v.holonom", "--end-time", "900"],
        ["report", vehicle, "-o", folder / "v.html"],
        ["export", vehicle, "*", "-o", folder / "v.csv"],
        ["check", VEHICLE],
        ["plot", vehicle, "-o", folder / "v.svg"],
    ]


def assert_ends_in_good_order(vehicle: Path, folder: Path, trial: int) -> None:
    drawn = random.Random(trial)
    every = commands(vehicle, folder)
    arguments = every[trial % len(every)]
    number = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)[trial // len(every) % 3]
    moment = drawn.choice([0.0, drawn.uniform(0.0, 0.3), drawn.uniform(0.0, 1.5)])
    status, err = end(start(*arguments), number, moment)
    assert status in (128 + number, 0), (arguments[0], moment, err)  # it may have been through
    assert "Traceback" not in err, (arguments[0], moment, err)
    assert "Exception ignored" not in err, (arguments[0], moment, err)
    if status:
        assert err.startswith("error: ") or "interrupted" in err, err
    # Nothing half written stays beside what was asked for.
    left = {path.name for path in folder.iterdir()}
    assert left <= {"v.holonom", "v.html", "v.csv", "v.svg"}, left


@pytest.mark.parametrize("trial", range(15))
def test_a_signal_ends_any_command_with_its_status_and_one_message(
    vehicle: Path, tmp_path: Path, trial: int
) -> None:
    assert_ends_in_good_order(vehicle, tmp_path, trial)


@pytest.mark.long
@pytest.mark.parametrize("trial", range(15, 215))
def test_a_signal_at_200_random_moments(vehicle: Path, tmp_path: Path, trial: int) -> None:
    assert_ends_in_good_order(vehicle, tmp_path, trial)


def test_a_signal_while_libraries_are_read_ends_at_once(vehicle: Path) -> None:
    process = start("info", vehicle)
    assert end(process, signal.SIGINT, 0.0) in [(130, "error: interrupted\n"), (0, "")]


@pytest.mark.parametrize("interrupts", [signal.SIG_DFL, signal.SIG_IGN])
def test_a_run_ended_by_sigterm_keeps_and_marks_what_was_computed(
    pendulum: Path, tmp_path: Path, interrupts: signal.Handlers
) -> None:
    """Also where Ctrl-C is ignored, as in the background of a script."""
    path = tmp_path / "rod.holonom"
    line = ("run", pendulum, "-o", path, "--end-time", "9e4", "--tolerance", "1e-9")
    process = start(*line, interrupts=interrupts)
    while not path.exists():
        time.sleep(0.02)
    status, err = end(process, signal.SIGTERM, 0.5)
    assert status == 143
    assert "simulation/interrupted" in err
    import holonom

    with holonom.load(path) as result:
        assert result.status == "interrupted"


def test_a_signal_that_is_ignored_stays_ignored(vehicle: Path) -> None:
    """As under `nohup`."""
    script = "import os, signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN);"
    script += "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    process = subprocess.Popen(
        [sys.executable, "-c", script, "-m", "holonom", "info", str(vehicle)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    wait = Path(f"/proc/{process.pid}/cmdline")
    # Neither the test's own process before it becomes another, nor the script.
    while b"\0holonom\0" not in (line := wait.read_bytes()) or b"\0-c\0" in line:
        time.sleep(0.002)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=60)
    assert process.returncode == 0


def test_a_pipe_that_closes_ends_the_command_quietly(vehicle: Path) -> None:
    process = start("export", vehicle, "*", "-o", "-")
    assert process.stdout is not None
    assert process.stdout.readline().startswith("time")
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ""
    process.stderr.close()
    assert process.wait(timeout=60) == 141


@pytest.mark.parametrize("line", [["--help"], ["check", "--help"], []])
def test_help_whose_reader_has_gone_ends_quietly(line: list[str]) -> None:
    process = start(*line)
    for stream in (process.stdout, process.stderr):
        assert stream is not None
    process.stdout.close()  # type: ignore[union-attr]
    assert process.stderr.read() == ""  # type: ignore[union-attr]
    process.stderr.close()  # type: ignore[union-attr]
    assert process.wait(timeout=60) == 141


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        ("schema >&-", 5, "standard output"),
        ("export RESULT -o - >&-", 5, "standard output"),
        ("schema >/dev/full", 5, "No space left"),
        ("info RESULT >/dev/full", 5, "No space left"),
        ("info RESULT --json >/dev/full", 5, "No space left"),
        ("info RESULT 2>&- >/dev/null", 0, ""),
        ("info absent 2>&-", 5, ""),
        ("info absent 2>/dev/full", 5, ""),
        ("info RESULT <&- >/dev/null", 0, ""),
        ("info RESULT <&- >&- 2>&-", 5, ""),
    ],
)
def test_closed_and_full_streams(
    vehicle: Path, tmp_path: Path, arguments: str, status: int, said: str
) -> None:
    line = f"{sys.executable} -m holonom {arguments}".replace("RESULT", str(vehicle))
    done = subprocess.run(line, shell=True, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == status, done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


@pytest.mark.parametrize(
    "environment",
    [
        {"MPLBACKEND": "nonsense"},
        {"PYTHONIOENCODING": "ascii"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"TERM": "dumb", "COLUMNS": "1"},
        {"COLUMNS": "nonsense"},
        {"HOME": "/nonexistent"},
    ],
)
def test_the_environment_cannot_break_a_command(
    vehicle: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    for arguments in (
        ["info", vehicle],
        ["plot", vehicle, "-o", tmp_path / "v.svg"],
        ["schema", "--reference"],
    ):
        done = subprocess.run(
            [*HOLONOM, *map(str, arguments)],
            capture_output=True,
            text=True,
            env=os.environ | environment,
        )
        assert (done.returncode, done.stderr) == (0, "")


def test_the_version_says_what_was_built() -> None:
    done = subprocess.run([*HOLONOM, "--version"], capture_output=True, text=True, check=True)
    import holonom

    assert done.stdout.startswith(f"holonom {holonom.__version__}, release build for ")
    assert f"Python {sys.version.split()[0]}" in done.stdout


@pytest.mark.parametrize("line", [["--version"], ["models"], ["check", "library:slider_crank"]])
def test_commands_without_arrays_start_without_numpy_and_what_typer_reads_with(
    line: list[str],
) -> None:
    """Each of them takes longer to import than all else together."""
    script = (
        "import sys; from holonom.cli.commands import invoke; status = invoke(sys.argv[1:]);"
        "sys.exit(status or len({'numpy', 'pydantic', 'rich', 'matplotlib'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", script, *line], stdout=subprocess.PIPE)
    assert done.returncode == 0
    assert done.stdout
