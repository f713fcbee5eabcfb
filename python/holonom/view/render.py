"""Pictures and films of runs: PNG, GIF and MP4, drawn by a browser without a window.

The page that `show` makes draws every frame at its own time and sends it back, so that films do not
depend on how fast the machine is.
"""

from __future__ import annotations

import io
import operator
import queue
import shutil
import struct
import subprocess
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from holonom.base import files
from holonom.base.errors import FileError, UsageError
from holonom.base.plain import require_callable
from holonom.base.text import quoted
from holonom.options import require_finite, require_positive
from holonom.view.browser import find, showing
from holonom.view.server import HTML, Answer, Server

if TYPE_CHECKING:
    from PIL import Image

    from holonom.result import Result

CAMERAS = ("iso", "front", "side", "top")
#: Endings of films, and of pictures.
FORMATS = (".png", ".gif", ".mp4")
#: Seconds until a frame must have come.
PATIENCE = 120.0
#: Frames of a film at most, and pixels along an edge.
MOST_FRAMES, SMALLEST, LARGEST = 20_000, 16, 8192
#: Frames per second; a GIF tells of a frame how many hundredths of a second it lasts, in 16 bits,
#: and where it lasts less than two, it is shown for longer.
SLOWEST, FASTEST, FASTEST_GIF = 0.01, 1000.0, 50.0

#: Called with the number of frames that are done and how many there are.
Progress = Callable[[int, int], None]


def render(
    results: Sequence[Result],
    path: Path,
    *,
    at: float | None,
    size: tuple[int, int],
    camera: str,
    fps: float,
    start: float | None,
    end: float | None,
    speed: float,
    dark: bool,
    browser: str | Path | None,
    progress: Progress | None,
    force: bool,
) -> Path:
    """Draw a picture or a film; see `Result.render`."""
    from holonom.view import page, scenes

    kind = kind_of(path)
    width, height = _edges(size)
    _require(camera, fps, speed)
    require_callable("progress", progress)
    inputs = [result.path for result in results]
    files.require_target(path, kind, inputs=inputs, force=force)
    runs = scenes(results)
    times = _times(results, kind, at, fps, start, end, speed)
    # What is asked for is judged before what is installed.
    if kind == "gif":
        _pillow()
    ffmpeg = _ffmpeg() if kind == "mp4" else ""
    program = find(browser)
    if kind == "mp4":  # encoders halve the resolution of colours, for which edges have to be even
        width, height = 2 * (width // 2), 2 * (height // 2)
    job = {"times": times, "size": [width, height], "camera": camera, "dark": dark}
    html = page(runs, job=job).encode()
    frames = _drawn(program, html, len(times), (width, height), progress)
    with files.replacing(path, kind, inputs=inputs, force=force) as fresh:
        if kind == "png":
            fresh.write_bytes(_signed(next(frames)))
        elif kind == "gif":
            _write_gif(fresh, frames, fps)
        else:
            _write_film(ffmpeg, fresh, frames, fps)
    return path


def kind_of(path: Path) -> str:
    """Return the kind of file that a name asks for."""
    ending = files.ending_of(path)
    if ending not in FORMATS:
        raise UsageError(
            f"{path} ends in {ending or 'nothing'!r}", help=f"end it in {', '.join(FORMATS)}"
        )
    return ending[1:]


def _edges(size: object) -> tuple[int, int]:
    """Return width and height of a picture, pixels."""
    try:
        width, height = map(operator.index, size)  # type: ignore[call-overload]
    except (TypeError, ValueError):
        raise UsageError(
            f"`size` is {quoted(repr(size))}", help="pass width and height, pixels: (1280, 720)"
        ) from None
    if not all(SMALLEST <= edge <= LARGEST for edge in (width, height)):
        raise UsageError(
            f"the size is {width}x{height}", help=f"edges have {SMALLEST} to {LARGEST} pixels"
        )
    return width, height


def _require(camera: str, fps: float, speed: float) -> None:
    if camera not in CAMERAS:
        raise UsageError(f"the camera is {camera!r}", help=f"it is one of {', '.join(CAMERAS)}")
    require_positive("speed", speed)
    if not SLOWEST <= require_positive("fps", fps) <= FASTEST:
        raise UsageError(
            f"`fps` is {fps:g}", help=f"films have {SLOWEST:g} to {FASTEST:g} frames per second"
        )


def _times(
    results: Sequence[Result],
    kind: str,
    at: float | None,
    fps: float,
    start: float | None,
    end: float | None,
    speed: float,
) -> list[float]:
    """Return the times of the frames."""
    spans = [result.span or (float(result.time[0]), float(result.time[-1])) for result in results]
    first, last = min(span[0] for span in spans), max(span[1] for span in spans)
    slack = 1e-9 * max(abs(first), abs(last))
    asked = {"at": at, "from": start, "to": end}
    for name, value in asked.items():
        if value is not None and not first - slack <= require_finite(name, value) <= last + slack:
            raise UsageError(
                f"`{name}` is {value:g} s", help=f"the run goes from {first:g} to {last:g} s"
            )
    if kind == "png":
        if start is not None or end is not None:
            raise UsageError("a picture shows one time", help="give `at`, or write a film")
        return [first if at is None else at]
    if at is not None:
        raise UsageError("a film shows many times", help="give `from` and `to`, or write a picture")
    first, last = first if start is None else start, last if end is None else end
    if last <= first:
        raise UsageError(
            f"the film ends at {last:g} s, before it begins",
            help="let `to` be after `from`; of a run of one state write a picture",
        )
    count = (last - first) / speed * fps
    if not count <= MOST_FRAMES:
        raise UsageError(
            f"the film would have more than {MOST_FRAMES} frames",
            help="raise the speed, or show less of the run",
        )
    if kind == "gif" and fps > FASTEST_GIF:
        raise UsageError(
            f"`fps` is {fps:g}, and a frame of a GIF is shown for a fiftieth of a second at least",
            help=f"take {FASTEST_GIF:g} frames per second or fewer, or write an MP4",
        )
    return list(np.linspace(first, last, max(1, round(count)) + 1))


def _drawn(
    program: str, html: bytes, count: int, size: tuple[int, int], progress: Progress | None
) -> Iterator[bytes]:
    """Yield the frames as PNG, in their order."""
    arrived: queue.Queue[bytes | str] = queue.Queue()

    def get(path: str, _: dict[str, str]) -> Answer:
        return (HTML, html) if path == "" else None

    def post(path: str, _: dict[str, str], content: bytes) -> bool:
        arrived.put(content.decode("utf-8", "replace") if path == "failed" else content)
        return path in ("frame", "failed")

    server = Server(get, post)
    try:
        with showing(program, server.address, size) as process:
            for number in range(count):
                frame = _next(arrived, process)
                if progress is not None:
                    progress(number + 1, count)
                yield frame
    finally:
        server.close()


def _next(arrived: queue.Queue[bytes | str], process: subprocess.Popen[bytes]) -> bytes:
    waited = 0.0
    while waited < PATIENCE:
        try:
            frame = arrived.get(timeout=0.2)  # short: Ctrl-C is heard in between
        except queue.Empty:
            waited += 0.2
            if process.poll() is not None:
                raise FileError(
                    f"the browser ended with status {process.returncode}",
                    help="try another one with `--browser`",
                ) from None
            continue
        if isinstance(frame, str):
            raise FileError(
                f"the browser could not draw: {frame}", help="try another one with `--browser`"
            )
        return frame
    raise FileError(
        f"the browser drew nothing for {PATIENCE:g} s", help="try a smaller size, or another one"
    )


def _signed(png: bytes) -> bytes:
    """Return a picture that says who drew it."""
    head = 8 + 25  # the signature and the first chunk
    content = b"tEXtSoftware\0Holonom"
    chunk = struct.pack(">I", len(content) - 4) + content + struct.pack(">I", zlib.crc32(content))
    return png[:head] + chunk + png[head:]


def _pillow() -> Any:
    try:
        from PIL import Image
    except ImportError:
        raise FileError(
            "films as GIF need the package pillow",
            help="it comes with the extra `render`, or by `pip install pillow`",
        ) from None
    return Image


def _write_gif(path: Path, frames: Iterator[bytes], fps: float) -> None:
    image = _pillow()
    kept = list(frames)  # as they came: their pixels would be many times as large

    def picture(frame: bytes) -> Image.Image:
        whole: Image.Image = image.open(io.BytesIO(frame)).convert("RGB")
        return whole

    # One palette for the whole film, without dithering: what does not move does not change.
    some = [picture(frame) for frame in kept[:: max(1, len(kept) // 8)]]
    width, height = some[0].size
    sheet = image.new("RGB", (width, height * len(some)))
    for number, one in enumerate(some):
        sheet.paste(one, (0, height * number))
    palette = sheet.quantize(255, method=image.Quantize.MAXCOVERAGE)
    reduced = (picture(f).quantize(palette=palette, dither=image.Dither.NONE) for f in kept)
    # Durations are hundredths of a second; their sum stays right.
    ends = [round(100.0 * (number + 1) / fps) for number in range(len(kept))]
    durations = [10 * (end - begin) for begin, end in zip([0, *ends], ends, strict=False)]
    next(reduced).save(
        path,
        format="GIF",
        save_all=True,
        append_images=reduced,
        duration=durations,
        loop=0,
        comment=b"Holonom",
    )


def _ffmpeg() -> str:
    found = shutil.which("ffmpeg")
    if found is None:
        raise FileError(
            "films as MP4 need the program ffmpeg",
            help="install it (`apt install ffmpeg`, `brew install ffmpeg`), or write a GIF",
        )
    return found


def _write_film(ffmpeg: str, path: Path, frames: Iterator[bytes], fps: float) -> None:
    command = [
        ffmpeg, "-loglevel", "error", "-y", "-f", "image2pipe", "-framerate", f"{fps:g}",
        "-c:v", "png", "-i", "-", "-pix_fmt", "yuv420p", "-metadata", "comment=Holonom",
        "-movflags", "+faststart", "-f", "mp4", str(path),
    ]  # fmt: skip
    with subprocess.Popen(  # noqa: S603 -- found on the user's search path
        command, stdin=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for frame in frames:
                process.stdin.write(frame)
            process.stdin.close()
        except BrokenPipeError:  # ffmpeg has given up and says why
            pass
        except BaseException:
            process.kill()
            raise
        said = process.stderr.read().decode("utf-8", "replace").strip()
    if process.returncode:
        raise FileError(f"ffmpeg failed: {said}", help="try a smaller size, or write a GIF")
