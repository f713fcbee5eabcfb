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
from conftest import PENDULUM, write_result

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
    kind = {"nc": "netcdf", "mat": "matlab", "html": "report"}.get(ending, ending)
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


@pytest.mark.parametrize("kind", ["report", "result", "model"])
def test_a_write_protected_file_needs_force(
    stored: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = stored.with_name("target")
    with Result.load(stored) as result:
        model = holonom.Model.from_text(PENDULUM)
        write = {"report": result.report, "result": result.save, "model": model.save}[kind]
        write(target)
        target.chmod(0o444)
        monkeypatch.setattr(os, "access", lambda path, mode: path != target)  # root may all
        with pytest.raises(FileError, match="write-protected") as refused:
            write(target)
        assert refused.value.code == "file/protected"
        write(target, force=True)
    assert stat.S_IMODE(target.stat().st_mode) == 0o444


def test_limits_of_this_process_are_as_before() -> None:
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY


def variant(folder: Path) -> tuple[Path, Path]:
    """Return a model and the one that it extends."""
    base, model = folder / "base" / "model.toml", folder / "variant" / "model.toml"
    for path in (base, model):
        path.parent.mkdir()
    base.write_text(PENDULUM)
    model.write_text('holonom = 1\nextends = "../base/model.toml"\ntitle = "Variant"\n')
    return model, base


@pytest.mark.parametrize(
    "line",
    [
        ["run", "{model}", "--force", "-o", "{base}"],
        ["run", "{model}", "--force", "--set", "bodies.rod.mass=3", "-o", "{link}"],
        ["compare", "{model}", "--force", "--csv", "{base}"],
        ["compare", "{model}", "--force", "--errors", "{link}"],
        ["compare", "{model}", "--force", "--save-reference", "{base}"],
    ],
    ids=lambda line: f"{line[0]} {line[-2]} {line[-1]}",
)
def test_what_a_model_extends_is_not_overwritten_even_by_force(
    line: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, base = variant(tmp_path)
    link = tmp_path / "link"
    link.hardlink_to(base)
    status = invoke([word.format(model=model, base=base, link=link) for word in line])
    assert (status, base.read_text()) == (5, PENDULUM)
    assert "is a file that this command reads" in capsys.readouterr().err


def test_a_model_knows_its_files_and_saves_over_none_it_extends(tmp_path: Path) -> None:
    path, base = variant(tmp_path)
    model = holonom.Model.load(path).with_values({"bodies.rod.mass": 3.0})
    assert model.sources == (path, base)
    assert holonom.Model.from_text(PENDULUM).sources == ()
    with pytest.raises(holonom.FileError, match="extends"):
        model.save(base)
    with pytest.raises(holonom.FileError, match="that this command reads"):
        model.simulate(end_time=0.01, output=base, force=True)
    assert base.read_text() == PENDULUM
    model.save(path)  # its own: the user's word
    assert holonom.Model.load(path).bodies["rod"]["mass"] == 3.0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["run", "{model}", "-o", "rod.csv"], "`.csv` is not the ending of a Holonom result"),
        (["run", "{model}", "-o", "rod.mat"], "name it `rod.holonom`"),
        (["report", "{result}", "-o", "rod.pdf"], "name it `rod.html`"),
        (["view", "{result}", "-o", "rod.MP4"], "name it `rod.html`"),
        (["export", "{result}", "-o", "rod.xlsx"], "known are csv (.csv)"),
        (["export", "{result}", "-o", "rod.xlsx", "--format", "csv"], "name it `rod.csv`"),
        (["plot", "{result}", "-o", "rod.gif"], "pictures end in `.svg`, `.pdf`, `.png`"),
        (["compare", "{model}", "--csv", "table.xlsx"], "name it `table.csv`"),
        (["compare", "{model}", "--errors", "table.pdf"], "name it `table.csv`"),
        (["compare", "{model}", "--plot", "x.gif"], "pictures end in `.svg`, `.pdf`, `.png`"),
        (["compare", "{model}", "--plot", "x"], "pictures end in `.svg`, `.pdf`, `.png`"),
        (["compare", "{model}", "--save-reference", "x.csv"], "name it `x.holonom`"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_name_that_promises_another_kind_of_file_is_refused_before_the_work(
    line: list[str],
    said: str,
    stored: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Else a spreadsheet or a mail program would show nonsense."""
    model, _ = variant(tmp_path)
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(holonom.Model, "simulate", lambda *_, **__: pytest.fail("a run began"))
    assert invoke([word.format(model=model, result=stored) for word in line]) == 1
    assert said in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before


def test_a_name_of_ones_own_is_taken(stored: Path, tmp_path: Path) -> None:
    for name in ("table.dat", "table", "table.txt", "TABLE.CSV"):
        assert invoke(["export", str(stored), "--format", "csv", "-o", str(tmp_path / name)]) == 0
    assert invoke(["report", str(stored), "-o", str(tmp_path / "x.pdf"), "--force"]) == 0


@pytest.mark.parametrize(("command", "other"), [("report", "view"), ("view", "report")])
def test_a_report_does_not_replace_a_page_nor_a_page_a_report(
    command: str, other: str, stored: Path, tmp_path: Path
) -> None:
    target = tmp_path / "run.html"
    assert invoke([other, str(stored), "-o", str(target)]) == 0
    before = target.read_bytes()
    assert invoke([command, str(stored), "-o", str(target)]) == 5
    assert target.read_bytes() == before
    assert invoke([other, str(stored), "-o", str(target)]) == 0


def test_a_page_about_holonom_is_not_one_by_holonom(stored: Path, tmp_path: Path) -> None:
    page = b'<!doctype html>\n<html><head><meta name="author" content="Me"></head>My Holonom notes'
    picture = b'<svg xmlns="http://www.w3.org/2000/svg"><text>Holonom</text></svg>'
    for command, name, mine in (("report", "a.html", page), ("plot", "a.svg", picture)):
        target = tmp_path / name
        target.write_bytes(mine)
        assert invoke([command, str(stored), "-o", str(target)]) == 5
        assert target.read_bytes() == mine


def test_an_absent_file_is_told_with_the_one_that_was_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("slider.toml").write_text(PENDULUM)
    Path("dangling.toml").symlink_to("nowhere.toml")
    for line, said in (
        (["check", "slidr.toml"], "did you mean `slider.toml`?"),
        (["check", "nofolder/slider.toml"], "there is no folder nofolder either"),
        (["check", "dangling.toml"], "is a link to nowhere.toml, which is not there"),
        (["check", "slider_crank"], "`library:slider_crank`"),
        (["check", "models/slider_crank/model.toml"], "`library:slider_crank`"),
        (["check", "slider.toml/x"], "a part of the name is a file, not a folder"),
        (["info", "slider.tom"], "did you mean `slider.toml`?"),
        (["info", "xyz.holonom"], "`holonom run` writes one"),
        (["info", "slider.toml"], "`holonom run slider.toml` makes one of a model"),
    ):
        assert invoke(line) == 5
        assert said in capsys.readouterr().err, line
