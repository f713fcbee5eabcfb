"""What commands write never destroys what is the user's."""

from __future__ import annotations

import os
import resource
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import write_result

import holonom
from holonom.base import files
from holonom.base.errors import FileError
from holonom.cli.commands import invoke
from holonom.result import Result

#: Commands that write a file of a result, by the ending of what they write.
WRITERS: dict[str, Callable[[Path, Path], list[str]]] = {
    "html": lambda result, target: ["report", str(result), "-o", str(target)],
    "svg": lambda result, target: ["plot", str(result), "-o", str(target)],
    "png": lambda result, target: ["plot", str(result), "-o", str(target)],
    "pdf": lambda result, target: ["plot", str(result), "-o", str(target)],
    "csv": lambda result, target: ["export", str(result), "-o", str(target)],
    "parquet": lambda result, target: ["export", str(result), "-o", str(target)],
    "nc": lambda result, target: ["export", str(result), "-o", str(target)],
    "mat": lambda result, target: ["export", str(result), "-o", str(target)],
}
#: How one file comes to have two names.
LINKS: dict[str, Callable[[Path, Path], None]] = {
    "symlink": lambda file, name: name.symlink_to(file),
    "hard link": lambda file, name: name.hardlink_to(file),
    "the name itself": lambda file, name: shutil.move(file, name) and None,
}


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("ending", WRITERS)
@pytest.mark.parametrize("force", [False, True])
def test_what_a_command_reads_is_never_its_target(
    stored: Path, ending: str, link: str, force: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    name = stored.with_name(f"linked.{ending}")
    LINKS[link](stored, name)
    source = stored if stored.exists() else name
    before = source.read_bytes()
    status = invoke([*WRITERS[ending](source, name), *(["--force"] if force else [])])
    assert status == 5
    assert source.read_bytes() == before
    assert "reads" in capsys.readouterr().err
    assert not list(stored.parent.glob(".*"))


@pytest.mark.parametrize("command", ["report", "plot", "export"])
def test_a_default_target_may_be_the_result_itself(
    stored: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    ending = {"report": ".html", "plot": ".svg", "export": ".csv"}[command]
    renamed = stored.rename(stored.with_suffix(ending))
    before = renamed.read_bytes()
    assert invoke([command, str(renamed)]) == 5
    assert renamed.read_bytes() == before


@pytest.mark.parametrize("ending", WRITERS)
def test_a_file_of_somebody_else_needs_force(
    stored: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    target = stored.with_name(f"mine.{ending}")
    target.write_text("the notes of years\n")
    assert invoke(WRITERS[ending](stored, target)) == 5
    error = capsys.readouterr().err
    assert "--force" in error
    assert str(target) in error
    assert target.read_text() == "the notes of years\n"
    assert invoke([*WRITERS[ending](stored, target), "--force"]) == 0
    first = target.read_bytes()
    assert first != b"the notes of years\n"
    # What the command wrote it writes again without being forced, and says the same.
    assert invoke(WRITERS[ending](stored, target)) == 0
    assert invoke(WRITERS[ending](stored, target)) == 0


@pytest.mark.parametrize("ending", WRITERS)
def test_a_file_of_the_same_kind_by_another_program_needs_force(
    stored: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    kind = {"nc": "netcdf", "mat": "matlab"}.get(ending, ending)
    target = stored.with_name(f"mine.{ending}")
    start = {"csv": b"time,x\n", "html": b"<!DOCTYPE html><p>Mine"}
    foreign = start.get(ending, (*files.KINDS[kind].starts, b"")[0] + b" by hand " * 100)
    target.write_bytes(foreign)
    assert invoke(WRITERS[ending](stored, target)) == 5
    assert target.read_bytes() == foreign


def test_one_result_is_not_replaced_by_a_table_of_another(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.holonom"
    write_result(other).close()
    before = other.read_bytes()
    assert invoke(["export", str(stored), "--format", "csv", "-o", str(other)]) == 5
    assert invoke(["report", str(stored), "-o", str(other)]) == 5
    assert other.read_bytes() == before


def test_only_regular_files_are_replaced(stored: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.html"
    os.mkfifo(pipe)
    folder = tmp_path / "folder.html"
    folder.mkdir()
    loop = tmp_path / "loop.html"
    loop.symlink_to(loop)
    targets = [pipe, folder, loop, Path("/dev/null"), Path("/dev/full"), Path("/dev/tty")]
    with Result.load(stored) as result:
        for target in targets:
            with pytest.raises(FileError):
                result.report(target, force=True)
            with pytest.raises(FileError):
                result.save(target, force=True)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert Path("/dev/full").is_char_device()


def test_a_run_does_not_replace_a_device(pendulum: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.holonom"
    os.mkfifo(pipe)
    assert invoke(["run", str(pendulum), "-q", "-o", "/dev/null"]) == 5
    assert invoke(["run", str(pendulum), "-q", "-o", str(pipe), "--force"]) == 5
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_mode_and_link_of_what_is_replaced_stay(stored: Path, tmp_path: Path) -> None:
    real = tmp_path / "elsewhere" / "page.html"
    real.parent.mkdir()
    link = tmp_path / "page.html"
    link.symlink_to(real)
    with Result.load(stored) as result:
        result.report(link)  # a link to nothing yet: the file that it names is made
        assert link.is_symlink()
        real.chmod(0o640)
        old = real.stat().st_ino
        result.report(link)
    assert link.is_symlink()
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    assert real.stat().st_ino != old
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [
        "elsewhere",
        "page.html",
        "rod.holonom",
    ]


def test_a_run_keeps_mode_and_link_too(pendulum: Path, tmp_path: Path) -> None:
    real, link = tmp_path / "real.holonom", tmp_path / "link.holonom"
    model = holonom.Model.load(pendulum)
    model.simulate(output=real).close()
    real.chmod(0o600)
    link.symlink_to(real)
    model.simulate(output=link, end_time=0.5).close()
    assert link.is_symlink()
    assert stat.S_IMODE(real.stat().st_mode) == 0o600
    with Result.load(real) as result:
        assert result.time[-1] == 0.5


def test_an_empty_file_is_nothing_to_lose(stored: Path, tmp_path: Path) -> None:
    target = tmp_path / "page.html"
    target.touch()
    with Result.load(stored) as result:
        result.report(target)
    assert target.stat().st_size > 0


def test_two_outputs_of_a_command_are_two_files(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "table.csv"
    other = tmp_path / "other.csv"
    other.symlink_to(table)
    command = ["compare", str(pendulum), "--csv", str(table), "--errors", str(other)]
    assert invoke(command) == 5
    assert "same file" in capsys.readouterr().err
    assert not table.exists()


def test_a_comparison_replaces_neither_model_nor_reference(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reference = tmp_path / "reference.holonom"
    holonom.Model.load(pendulum).simulate(output=reference).close()
    before = reference.read_bytes(), pendulum.read_bytes()
    base = ["compare", str(pendulum), "--force"]
    assert invoke([*base, "--csv", str(pendulum)]) == 5
    assert invoke([*base, "--errors", str(pendulum)]) == 5
    assert invoke([*base, "--save-reference", str(pendulum)]) == 5
    assert invoke([*base, "--reference", str(reference), "--csv", str(reference)]) == 5
    assert invoke(["run", str(pendulum), "-o", str(pendulum), "--force"]) == 5
    assert (reference.read_bytes(), pendulum.read_bytes()) == before


@pytest.mark.parametrize("ending", WRITERS)
def test_a_full_disk_leaves_the_old_file_whole(stored: Path, ending: str) -> None:
    """The largest size of a file stands for a disk: the system refuses to write beyond it."""
    target = stored.with_name(f"old.{ending}")
    assert invoke(WRITERS[ending](stored, target)) == 0
    before = target.read_bytes()
    script = (
        "import resource, sys; from holonom.cli.commands import invoke;"
        "from holonom.pictures import plotting;"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({len(before) // 2}, resource.RLIM_INFINITY));"
        "sys.exit(invoke(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *WRITERS[ending](stored, target)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 5, done.stderr
    assert str(target) in done.stderr
    assert "Traceback" not in done.stderr
    assert target.read_bytes() == before
    assert not list(stored.parent.glob(".*"))


@pytest.mark.parametrize("limit", [0, 4096, 30_000])
def test_a_run_onto_a_full_disk_keeps_the_older_result(
    pendulum: Path, tmp_path: Path, limit: int
) -> None:
    target = tmp_path / "rod.holonom"
    with holonom.Model.load(pendulum).simulate(output=target) as result:
        expected = result["rod.position"]
    script = (
        "import resource, sys; from holonom.cli.commands import invoke;"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY));"
        "sys.exit(invoke(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "run", str(pendulum), "-o", str(target)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 5, done.stderr
    assert "Traceback" not in done.stderr
    assert "help:" in done.stderr
    with Result.load(target) as result:
        assert result["rod.position"].tobytes() == expected.tobytes()


def test_a_write_protected_file_needs_force(stored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = stored.with_name("page.html")
    with Result.load(stored) as result:
        result.report(target)
        target.chmod(0o444)
        monkeypatch.setattr(os, "access", lambda path, mode: path != target)  # root may all
        with pytest.raises(FileError, match="write-protected"):
            result.report(target)
        result.report(target, force=True)
    assert stat.S_IMODE(target.stat().st_mode) == 0o444


def test_limits_of_this_process_are_as_before() -> None:
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
