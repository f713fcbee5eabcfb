"""Results: arrays by name, the state to restart from, the step log and the diagnosis of a run.

`Result` is here, with its files and the doors to pictures, pages and tables.

========== ======================================================================
``facts``  what is known about the run: how it was made, how it went, how it ended
``arrays`` channels by name, at the output times and at any other
========== ======================================================================
"""

from __future__ import annotations

import html
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holonom.base import files
from holonom.base.errors import FileError, UsageError
from holonom.base.plain import as_path
from holonom.base.text import quoted, shown
from holonom.pictures import runs as pictures
from holonom.result.arrays import Arrays
from holonom.store.reader import Reader

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]
    import xarray
    from matplotlib.axes import Axes

    from holonom.pictures.picture import Picture
    from holonom.view import View
    from holonom.view.sketch import Sketch


def require_results(*given: object) -> list[Result]:
    """Return results, as a list.

    Raises
    ------
    UsageError
        If one is something else.
    """
    for one in given:
        if not isinstance(one, Result):
            tip = "pass results; `Result.load(path)` reads one"
            raise UsageError(f"{quoted(repr(one))} is no result", help=tip)
    return list(given)  # type: ignore[arg-type]


class Result(Arrays):
    """A trajectory and what is known about the run that made it.

    ``result["chassis.position"]`` is an array over the output times. Channels that were asked for
    are stored; any other is computed from the stored states when it is first used.

    A result comes from `Model.simulate` or from `Result.load`. Arrays are read when they are used;
    they are kept and must not be written to.
    """

    @classmethod
    def load(cls, path: str | Path, *, recover: bool = False) -> Result:
        """Open a result file; also one whose run is going on or was killed.

        Parameters
        ----------
        path : path
        recover : bool
            Whether to read what is left of a damaged file: rows whose times are lost are left out,
            other numbers that are lost are NaN, and `damage` names them.

        Raises
        ------
        FileError
            If the file cannot be read or is not a result; ``result/damaged`` if a part of it is
            not what was written, also later, when that part is first used.
        """
        return cls(Reader.open(as_path(path), recover=recover))

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the result as one file and return its path.

        Parameters
        ----------
        path : path
        force : bool
            Whether a file that is no result may be replaced.

        Raises
        ------
        FileError
            If it cannot be written, something else than a result is there, or it is this result.
        """
        path = as_path(path)
        self._reader.save(path, force=force)
        return path

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the file where there is one, else by its bytes."""
        if self.path is not None:
            known = [str(self.meta.get(key)) for key in _RUN]
            return _from_file, (self.path.absolute(), known, self.time)
        with tempfile.TemporaryDirectory() as folder:
            return _from_bytes, (self.save(Path(folder) / "result.holonom").read_bytes(),)

    def plot(
        self,
        *channels: str,
        others: Sequence[Result] = (),
        labels: Sequence[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        interval: float | None = None,
        versus: str | None = None,
        fft: bool | str = False,
        derivative: bool = False,
        low_pass: float | None = None,
        path: str | Path | None = None,
        axes: Axes | Sequence[Axes] | None = None,
        force: bool = False,
    ) -> Picture:
        """Draw channels over time, one panel below the other.

        A notebook shows what is returned. What moves less than ten tolerances over the whole run
        says so and is not shown larger; where a curve turns back more often than it can be drawn,
        its range and its mean are shown.

        Parameters
        ----------
        *channels : str
            Names or patterns; what the run was asked for when none is given.
        others : sequence of Result, optional
            Further runs, laid over this one.
        labels : sequence of str, optional
            What the runs are called, this one first; their files or models when not given.
        start, end : float, optional
            Part of the run, s.
        interval : float, optional
            Time between the values, s, computed from the stored steps; the stored rows when not
            given.
        versus : str, optional
            A scalar channel or a component to draw over, instead of the time.
        fft : bool or str
            Draw amplitudes over frequencies, of evenly spaced values: `holonom.signals.spectrum`;
            a text names the window.
        derivative : bool
            Draw derivatives over time: `holonom.signals.derivative`.
        low_pass : float, optional
            Draw the slow part, below this frequency, Hz, without delay: `holonom.signals.low_pass`;
            derivatives and amplitudes are those of that part.
        path : path, optional
            Picture file to write: SVG, or with matplotlib PDF or PNG, by its ending.
        axes : matplotlib axes, or a sequence of them, optional
            Draw on these, one for each panel.
        force : bool
            Whether a file that is no picture by Holonom may be replaced.

        Returns
        -------
        Picture
            ``figure()`` makes a figure of matplotlib of it, ``save(path)`` a file.

        Raises
        ------
        UsageError
            If a channel is unknown, a choice is none, nothing of the run is left, there are not as
            many axes as panels, or the format is not known or needs matplotlib, which is not
            installed.
        FileError
            If the file cannot be written.
        """
        given: object = others
        several = isinstance(given, Iterable) and not isinstance(given, Result)
        runs = require_results(self, *(others if several else [given]))
        sources = [run.path for run in runs]
        target = None if path is None else as_path(path)
        if target is not None:  # before the work, not after it
            from holonom.pictures import plotting

            kind = plotting.require_format(target)
            files.require_target(target, kind, inputs=sources, force=force)
        picture = pictures.plot(
            runs,
            list(channels),
            labels=labels,
            start=start,
            end=end,
            interval=interval,
            versus=versus,
            fft=fft,
            derivative=derivative,
            low_pass=low_pass,
        )
        if axes is not None:
            picture.draw(axes)
        if target is not None:
            picture.save(target, inputs=sources, force=force)
        return picture

    def sketch(
        self,
        times: ArrayLike | None = None,
        *,
        moving: bool = False,
        path: str | Path | None = None,
        force: bool = False,
    ) -> Sketch:
        """Draw the mechanism in some of its poses, or in motion, as SVG; a notebook shows it.

        Parameters
        ----------
        times : array_like, optional
            Of the poses, s, of which the last is drawn strongly; chosen from the run when not
            given.
        moving : bool
            Whether the picture moves: the poses follow each other, in the time that they take where
            that is 1.5 to 12 s, else slower or faster.
        path : path, optional
            File to write, ``.svg``.
        force : bool
            Whether a file that is no picture by Holonom may be replaced.

        Raises
        ------
        UsageError
            If the result has no rows, or not at these times.
        FileError
            If the file cannot be written.
        """
        from holonom.view.sketch import sketch

        made = sketch(self, times, moving=moving)
        if path is not None:
            made.save(path, force=force)
        return made

    def report(self, path: str | Path, *, force: bool = False) -> Path:
        """Write a self-contained HTML page about the run and return its path.

        Parameters
        ----------
        path : path
        force : bool
            Whether a file that is no such page may be replaced.

        Raises
        ------
        FileError
            If it cannot be written, or would replace another file.
        """
        from holonom import report

        return report.write(self, as_path(path), force=force)

    def view(self, *others: Result) -> View:
        """Return a page in which the bodies of the run move; a notebook shows it in place.

        ``result.view().save("page.html")`` writes it: one file that needs nothing else.

        Parameters
        ----------
        *others : Result
            Further runs, laid over this one.

        Raises
        ------
        UsageError
            If a result has no rows, or there are too many.
        """
        from holonom import view  # here: most runs are not looked at

        return view.show(require_results(self, *others))

    def render(
        self,
        path: str | Path,
        *others: Result,
        at: float | None = None,
        size: tuple[int, int] = (1280, 720),
        camera: str = "iso",
        fps: float = 25.0,
        start: float | None = None,
        end: float | None = None,
        speed: float = 1.0,
        dark: bool = False,
        browser: str | Path | None = None,
        progress: Callable[[int, int], None] | None = None,
        force: bool = False,
    ) -> Path:
        """Draw a picture or a film of the bodies and return its path.

        A browser of the machine draws it (Chromium, Chrome or Edge), without a window. A GIF needs
        the extra ``render``, an MP4 the program ffmpeg.

        Parameters
        ----------
        path : path
            Its ending tells the kind: ``.png`` for a picture, ``.gif`` or ``.mp4`` for a film.
        *others : Result
            Further runs, laid over this one.
        at : float, optional
            Time of a picture, s; the start by default.
        size : (int, int)
            Width and height, pixels.
        camera : {"iso", "front", "side", "top"}
            Where it is seen from.
        fps : float
            Frames of a film per second, 0.01 to 1000; of a GIF 50 at most.
        start, end : float, optional
            Span of a film, s of the run; the whole run by default.
        speed : float
            Seconds of the run per second of the film.
        dark : bool
            Whether the ground is dark.
        browser : path, optional
            Program of the browser.
        progress : callable, optional
            Called with the number of frames that are done and how many there are.
        force : bool
            Whether a file that is no picture by Holonom may be replaced.

        Raises
        ------
        UsageError
            If a choice cannot be used, or a result has no rows.
        FileError
            If something to draw with is missing, or the file cannot be written.
        """
        from holonom.view.render import render  # here: most runs are not looked at

        return render(
            require_results(self, *others), as_path(path), at=at, size=size, camera=camera,
            fps=fps, start=start, end=end, speed=speed, dark=dark, browser=browser,
            progress=progress, force=force,
        )  # fmt: skip

    def to_csv(
        self, path: str | Path, channels: list[str] | None = None, *, force: bool = False
    ) -> Path:
        """Write channels as CSV and return the path; the stored ones when none are given.

        Parameters
        ----------
        path : path
        channels : list of str, optional
            Names or patterns.
        force : bool
            Whether a file that is no such table may be replaced.

        Raises
        ------
        UsageError
            If a channel is unknown.
        FileError
            If the file cannot be written, or would replace another one.
        """
        from holonom import export

        return export.write_csv_file(self, as_path(path), channels, force=force)

    def to_matlab(
        self, path: str | Path, channels: list[str] | None = None, *, force: bool = False
    ) -> Path:
        """Write channels as a MATLAB 5 file and return the path; the stored ones without names.

        Every channel is a variable, (n_times, 1) or (n_times, n), beside ``time`` (s). Variables
        are named after channels, with underscores for what MATLAB does not allow:
        ``chassis_position`` for ``chassis.position``. The structure ``holonom`` lists ``channel``,
        ``variable``, ``unit`` and ``frame``, and says which run it was.

        Parameters
        ----------
        path : path
        channels : list of str, optional
            Names or patterns.
        force : bool
            Whether a file that is no MATLAB file by Holonom may be replaced.

        Raises
        ------
        UsageError
            If a channel is unknown or takes 2 GB or more, or scipy is not installed.
        FileError
            If the file cannot be written, or would replace another one.
        """
        from holonom import export

        return export.write_matlab(self, as_path(path), channels, force=force)

    def to_xarray(self, channels: list[str] | None = None) -> xarray.Dataset:
        """Return channels as a dataset of xarray; the stored ones when none are given.

        Every channel is a variable over ``time`` (s), a vector also over its components, which are
        named: ``xyz``, ``euler_parameter``, …. ``attrs`` hold ``units`` (SI; "1" where there is
        none) and ``frame``; those of the dataset say which run it was.

        Raises
        ------
        UsageError
            If a channel is unknown, or xarray is not installed.
        """
        from holonom import export

        return export.dataset(self, channels)

    def to_pandas(self, channels: list[str] | None = None) -> pd.DataFrame:
        """Return channels as a data frame of pandas; the stored ones when none are given.

        The index is the time (s); a vector takes one column per component,
        ``chassis.position[2]``. ``attrs["units"]`` holds the SI unit of every column.

        Raises
        ------
        UsageError
            If a channel is unknown, or pandas is not installed.
        """
        from holonom import export

        return export.frame(self, channels)

    def to_netcdf(
        self, path: str | Path, channels: list[str] | None = None, *, force: bool = False
    ) -> Path:
        """Write `to_xarray` as NetCDF 4 and return the path; `force` as of `to_csv`.

        Raises
        ------
        UsageError
            If a channel is unknown, or xarray or h5netcdf is not installed.
        FileError
            If the file cannot be written.
        """
        from holonom import export

        return export.write_netcdf(self, as_path(path), channels, force=force)

    def to_parquet(
        self, path: str | Path, channels: list[str] | None = None, *, force: bool = False
    ) -> Path:
        """Write channels as Parquet and return the path; the stored ones when none are given.

        `force` is that of `to_csv`.

        One column for the time (s) and one per component, ``chassis.position[2]``; unit and frame
        are metadata of the column, what the run was is metadata of the file, ``holonom``: JSON.

        Raises
        ------
        UsageError
            If a channel is unknown, or pyarrow is not installed.
        FileError
            If the file cannot be written.
        """
        from holonom import export

        return export.write_parquet(self, as_path(path), channels, force=force)

    def close(self) -> None:
        """Let go of the file; arrays that were read stay."""
        self._reader.close()

    def __enter__(self) -> Result:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        from holonom.summary import summarize

        try:
            facts = summarize(self)
        except FileError as error:
            if error.code != "result/closed":
                raise
            return html.escape(repr(self))
        rows = "".join(
            f"<tr><th>{html.escape(shown(label))}</th><td>{html.escape(shown(text))}</td></tr>"
            for label, text in facts
        )
        return f"<table>{rows}</table>"

    def __repr__(self) -> str:
        try:
            time = self.until if self.time.size else None
            until = "no states" if time is None else f"{time:.6g} s"
        except FileError as error:
            if error.code != "result/closed":
                raise
            until = "closed"
        return f"<holonom.Result {self.meta.get('name')!r}: {self.status}, {until}>"


#: What a run that goes on keeps in the head of its file.
_RUN = ("model_hash", "started")


def _from_file(path: Path, known: list[str], times: NDArray[np.float64]) -> Result:
    """Open the file of a result that was pickled, if that run is still in it."""
    result = Result.load(path)
    same = [str(result.meta.get(key)) for key in _RUN] == known
    if same and np.array_equal(result.time[: times.size], times, equal_nan=True):
        return result
    result.close()
    raise FileError(
        f"{path} holds another run than the result that was pickled",
        "keep results by `--keep` (`keep=True`), or pickle those in memory, which hold their rows",
        code="result/replaced",
    )


def _from_bytes(data: bytes) -> Result:
    """Return the result in memory that a file of these bytes holds."""
    db = sqlite3.connect(":memory:", check_same_thread=False)
    db.deserialize(data)
    return Result(Reader(db, None))
