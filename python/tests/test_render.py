"""Pictures and films: what is refused before anything is drawn, and what a browser draws."""

from __future__ import annotations

import io
import json
import os
import signal
import stat
import subprocess
import sys
import time
import weakref
from pathlib import Path

import numpy as np
import pytest
from browsers import require_browser
from conftest import MODELS, PENDULUM, write_result

import holonom
from holonom.base.errors import FileError, UsageError
from holonom.cli.commands import invoke
from holonom.result import Result
from holonom.view import browser as browsers
from holonom.view import render as rendering


@pytest.fixture(scope="module")
def crank() -> Result:
    return holonom.Model.load(MODELS / "slider_crank" / "model.toml").simulate(end_time=0.5)


def pixels(path: Path, frame: int = 0) -> np.ndarray:
    from PIL import Image

    with Image.open(path) as image:
        image.seek(frame)
        return np.asarray(image.convert("RGB")).astype(int)


def test_what_cannot_be_drawn_is_refused(crank: Result, tmp_path: Path) -> None:
    for name, choices, told in (
        ("a.jpg", {}, "'.jpg'"),
        ("a", {}, "'nothing'"),
        ("a.png", {"at": 2.0}, "from 0 to 0.5 s"),
        ("a.png", {"end": 0.2}, "one time"),
        ("a.gif", {"at": 0.2}, "many times"),
        ("a.gif", {"start": 0.3, "end": 0.2}, "before it begins"),
        ("a.gif", {"fps": 1e9}, "frames"),
        ("a.gif", {"fps": 1000, "speed": 0.01}, "more than 20000 frames"),
        ("a.gif", {"speed": 0.0}, "`speed`"),
        ("a.gif", {"speed": 1e-320}, "more than 20000 frames"),
        ("a.gif", {"fps": "3"}, "`fps`"),
        ("a.gif", {"fps": 1e-300}, "0.01 to 1000"),
        ("a.gif", {"fps": 51.0}, "a fiftieth of a second"),
        ("a.png", {"at": "x"}, "`at`"),
        ("a.png", {"at": float("nan")}, "`at` is nan"),
        ("a.gif", {"start": [0.1]}, "`from`"),
        ("a.png", {"size": (4, 4)}, "4x4"),
        ("a.png", {"progress": 3}, "`progress`"),
        ("a.png", {"size": 5}, "width and height"),
        ("a.png", {"size": (640.5, 480)}, "width and height"),
        ("a.png", {"camera": "below"}, "'below'"),
        ("a.png", {"browser": "no-such-program"}, "no-such-program"),
    ):
        with pytest.raises((UsageError, FileError), match=told):
            crank.render(tmp_path / name, **choices)  # type: ignore[arg-type]
    foreign = tmp_path / "mine.png"
    foreign.write_bytes(b"\x89PNG\r\n\x1a\n and so on")
    with pytest.raises(FileError, match="not overwritten"):
        crank.render(foreign)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.png"]


def test_a_run_that_stored_nothing_has_no_picture(tmp_path: Path) -> None:
    write_result(tmp_path / "rod.holonom", chunks=0).close()
    with (
        Result.load(tmp_path / "rod.holonom") as empty,
        pytest.raises(UsageError, match="no rows"),
    ):
        empty.render(tmp_path / "x.png")


def test_what_is_missing_is_named_with_how_to_get_it(
    crank: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(browsers, "_PLACES", ())
    with pytest.raises(FileError, match=r"no browser(.|\n)*apt install chromium"):
        crank.render(tmp_path / "a.png")
    with pytest.raises(FileError, match=r"ffmpeg(.|\n)*apt install ffmpeg"):
        crank.render(tmp_path / "a.mp4")
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(FileError, match=r"pillow(.|\n)*pip install pillow"):
        crank.render(tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())


def test_a_browser_that_gives_up_is_told(
    crank: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "browser"
    program.write_text("#!/bin/sh\nexit 7\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    with pytest.raises(FileError, match="status 7"):
        crank.render(tmp_path / "a.png", browser=program)
    program.write_text("#!/bin/sh\nsleep 60\n")
    monkeypatch.setattr(rendering, "PATIENCE", 0.5)
    with pytest.raises(FileError, match="drew nothing"):
        crank.render(tmp_path / "a.png", browser=program)
    assert [p.name for p in tmp_path.iterdir()] == ["browser"]


def test_films_have_the_times_that_are_asked_for(crank: Result) -> None:
    times = rendering._times([crank], "gif", None, 20.0, 0.1, 0.4, 0.5)
    np.testing.assert_allclose(times, np.linspace(0.1, 0.4, 13))
    assert rendering._times([crank], "png", 0.3, 25.0, None, None, 1.0) == [0.3]
    assert len(rendering._times([crank], "mp4", None, 60.0, None, None, 1.0)) == 31


@pytest.mark.parametrize("fps", [7.0, 30.0, 45.0, 50.0])
def test_a_gif_lasts_as_long_as_its_frames(
    fps: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    convert, made = Image.Image.convert, []
    drawn = []
    for number in range(60):
        picture, content = Image.new("RGB", (32, 24), (4 * number, 0, 99)), io.BytesIO()
        picture.save(content, "PNG")
        drawn.append(content.getvalue())

    def watched(image: Image.Image, *choices: str) -> Image.Image:
        found = convert(image, *choices)
        made.append(weakref.ref(found))
        return found

    monkeypatch.setattr(Image.Image, "convert", watched)
    most = 0

    def kept(image: Image.Image, *choices: object, **more: object) -> Image.Image:
        nonlocal most
        most = max(most, sum(one() is not None for one in made))
        return quantize(image, *choices, **more)  # type: ignore[arg-type]

    quantize = Image.Image.quantize
    monkeypatch.setattr(Image.Image, "quantize", kept)
    rendering._write_gif(tmp_path / "a.gif", iter(drawn), fps)
    assert most < 20  # full pictures at a time
    monkeypatch.undo()
    with Image.open(tmp_path / "a.gif") as film:
        lasts = 0.0
        for number in range(getattr(film, "n_frames", 1)):
            film.seek(number)
            assert film.info["duration"] >= 20
            lasts += film.info["duration"]
    assert lasts == pytest.approx(1000.0 * 60 / fps, abs=10.0)
    np.testing.assert_allclose(pixels(tmp_path / "a.gif")[0, 0], [0, 0, 99], atol=8)


@pytest.mark.browser
def test_a_picture_shows_the_run_at_its_time(crank: Result, tmp_path: Path) -> None:
    require_browser()
    first = pixels(crank.render(tmp_path / "first.png", at=0.1, size=(320, 200)))
    later = pixels(crank.render(tmp_path / "later.png", at=0.2, size=(320, 200)))
    dark = pixels(crank.render(tmp_path / "dark.png", at=0.1, size=(320, 200), dark=True))
    assert first.shape == (200, 320, 3)
    assert np.abs(first - later).max() > 100  # the crank has turned
    assert dark.mean() < 0.5 * first.mean()
    # It is drawn at its time, not at that of the clock: the same again.
    again = pixels(crank.render(tmp_path / "first.png", at=0.1, size=(320, 200)))
    np.testing.assert_array_equal(first, again)


@pytest.mark.browser
def test_the_command_writes_a_film(tmp_path: Path) -> None:
    require_browser()
    result = tmp_path / "rod.holonom"
    model = tmp_path / "rod.toml"
    model.write_text(PENDULUM)
    film = tmp_path / "rod.gif"
    assert invoke(["run", str(model), "-q", "-o", str(result)]) == 0
    line = ["render", str(result), "-o", str(film), "--size", "240x160", "--fps", "10"]
    assert invoke([*line, "--from", "0.2", "--to", "0.7", "-q"]) == 0
    from PIL import Image

    with Image.open(film) as image:
        assert getattr(image, "n_frames", 1) == 6
        assert image.info["duration"] == 100
    assert np.abs(pixels(film) - pixels(film, 5)).max() > 100
    assert invoke([*line, "--from", "0.2", "--to", "0.3", "-q"]) == 0  # its own film is replaced
    assert invoke(["render", str(result), "--size", "wide"]) == 1
    assert invoke(["render", str(result), "-o", str(result)]) == 1


@pytest.mark.browser
def test_ctrl_c_ends_the_browser_and_leaves_the_old_film(tmp_path: Path) -> None:
    require_browser()
    result, film = tmp_path / "rod.holonom", tmp_path / "rod.gif"
    holonom.Model.from_text(PENDULUM).simulate(output=result)
    film.write_bytes(b"GIF89a Holonom")
    command = [sys.executable, "-m", "holonom", "render", str(result), "-o", str(film)]
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        [*command, "--speed", "0.01"], env=environment, stderr=subprocess.PIPE
    ) as process:
        deadline = time.monotonic() + 120.0
        while not list(tmp_path.glob("holonom-*/*/")):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 130
    assert film.read_bytes() == b"GIF89a Holonom"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["rod.gif", "rod.holonom"]


@pytest.mark.browser
def test_a_film_goes_through_ffmpeg(crank: Result, tmp_path: Path) -> None:
    """A program in its place keeps what it is given: whole pictures, in their order."""
    require_browser()
    program = tmp_path / "bin" / "ffmpeg"
    program.parent.mkdir()
    program.write_text(
        '#!/bin/sh\nfor last; do :; done\n(printf "\\000\\000\\000\\040ftyp"; cat) > "$last"\n'
    )
    program.chmod(0o755)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
        path = crank.render(tmp_path / "a.mp4", size=(161, 101), end=0.1, fps=20.0)
    frames = path.read_bytes().split(b"\x89PNG")[1:]
    assert len(frames) == 3
    assert all(
        frame[12:20] == (160).to_bytes(4, "big") + (100).to_bytes(4, "big") for frame in frames
    )
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
        with pytest.raises(FileError, match="no such codec"):
            crank.render(tmp_path / "b.mp4", end=0.1)


def test_json_names_the_picture(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert invoke(["render", str(tmp_path / "none.holonom"), "--json"]) == 5
    assert json.loads(capfd.readouterr().out)["exit_status"] == 5
