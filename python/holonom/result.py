"""Results: arrays by name, the state to restart from, the step log and the diagnosis of a run."""

from __future__ import annotations

import html
import json
import re
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holonom.base import files
from holonom.base.errors import FileError, UsageError
from holonom.base.names import did_you_mean, nearest_channels
from holonom.base.plain import as_path
from holonom.base.record import Record
from holonom.base.text import quoted, shown
from holonom.certificate import Certification
from holonom.channels import FROM_ZERO, expand, require_name, split_component
from holonom.model import Model
from holonom.options import require_finite
from holonom.pictures import runs as pictures
from holonom.states import no_rows, states_at, vector
from holonom.store.layout import STATE, Quantity
from holonom.store.memory import Memory, Stored
from holonom.store.reader import Reader

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]
    import xarray
    from matplotlib.axes import Axes

    from holonom.pictures.picture import Picture
    from holonom.view import View
    from holonom.view.sketch import Sketch


class Result:
    """A trajectory and what is known about the run that made it.

    ``result["chassis.position"]`` is an array over the output times. Channels that were asked for
    are stored; any other is computed from the stored states when it is first used.

    A result comes from `Model.simulate` or from `Result.load`. Arrays are read when they are used;
    they are kept and must not be written to.
    """

    def __init__(self, reader: Stored, model: Model | None = None) -> None:
        self._reader = reader
        self._kept: dict[str, NDArray[np.float64]] = {}
        self._model = model

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

    @property
    def damage(self) -> list[str]:
        """Parts of the file that were found damaged so far; always empty without ``recover``."""
        return list(getattr(self._reader, "damage", []))

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return a channel, one of its components, or ``time``, ``q``, ``qd``, ….

        Returns
        -------
        ndarray, shape (n_times,) for scalars, (n_times, n) for vectors
            In the SI unit `unit` tells, along the axes `frame` tells.

        Raises
        ------
        UsageError
            If there is no such channel.
        """
        if not isinstance(name, str):
            raise UsageError(
                f"{quoted(repr(name))} is no channel",
                "simulation/unknown-channel",
                "`result[name]` takes one name; rows are those of the array it returns",
            )
        whole, index = split_component(name)
        if index is not None:
            self._quantity(name)  # refuses components that are not there
            return self[whole][:, index]
        if name not in self._kept:
            if name in self._reader.quantities:
                values = self._reader.read(name)
            elif not self.time.size:  # the run ended before anything was stored
                values = np.zeros((0, *(() if name in STATE else self._quantity(name).shape)))
            else:
                self._quantity(name)  # refuses unknown names, with the nearest ones
                states = {part: self[part] for part in STATE if part in self._reader.quantities}
                values = self.model.evaluate([name], states)[name]
            values.flags.writeable = False
            self._kept[name] = values
        return self._kept[name]

    def matrix(self, name: str) -> NDArray[np.float64]:
        """Return a channel with one column per component, ndarray, shape (n_times, n)."""
        quantity = self._quantity(name)
        size = 1 if split_component(name)[1] is not None else quantity.size
        return self[name].reshape(self.time.size, size)

    def __contains__(self, name: object) -> bool:
        """Whether `self[name]` is an array: stored, computable, or a component of such."""
        if not isinstance(name, str):
            return False
        whole, index = split_component(name)
        stored = self._reader.quantities
        quantity = stored.get(whole) or self.model.channels.get(whole)
        if quantity is None or index is None:
            return quantity is not None
        return len(quantity.shape) == 1 and index < quantity.size

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def keys(self) -> list[str]:
        """Return ``time`` and the names of the stored channels: ``dict(result)`` has them all.

        More names can be asked for: those of ``model.channels``, components, ``q``, ``qd``, ….
        """
        return ["time", *self.channels]

    def _ipython_key_completions_(self) -> list[str]:
        return list(dict.fromkeys([*self.keys(), *self.quantities, *self.model.channels]))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the file where there is one, else by its bytes."""
        if self.path is not None:
            return Result.load, (self.path.absolute(),)
        with tempfile.TemporaryDirectory() as folder:
            return _from_bytes, (self.save(Path(folder) / "result.holonom").read_bytes(),)

    @property
    def time(self) -> NDArray[np.float64]:
        """Output times, ndarray, shape (n_times,), s."""
        return self["time"] if "time" in self._reader.quantities else np.zeros(0)

    @property
    def channels(self) -> list[str]:
        """Names of the stored channels."""
        return [name for name in self._reader.quantities if name not in STATE]

    @property
    def quantities(self) -> dict[str, Quantity]:
        """What is stored, states and channels, by name."""
        return self._reader.quantities

    @property
    def requested(self) -> list[str]:
        """Names of the channels that the run was asked for."""
        return [name for name in self.meta.get("requested", []) if name in self]

    def unit(self, name: str) -> str:
        """Return the SI unit of a channel."""
        return self._quantity(name).unit

    def frame(self, name: str) -> str:
        """Return the axes in which a channel's components are given; empty for scalars."""
        return self._quantity(name).frame

    def state(self, time: float | None = None) -> dict[str, NDArray[np.float64]]:
        """Return the state at any time of the run, to start another run from.

        At an output time it is the stored row. At others it is computed from the stored steps: the
        joints hold to round-off, and it is as accurate as the step.

        Parameters
        ----------
        time : float, optional
            s; the last output time when not given.

        Returns
        -------
        dict of str to ndarray
            ``time`` (1,), ``q``, ``qd``, ``qdd``, ``lambda``, ``z``, ``winding`` and the energy
            ``ledger``: vectors.

        Raises
        ------
        UsageError
            If the run has no such time, or stored no steps and none of its output times is there.
        """
        times = self.time
        if time is None:
            if not times.size:
                raise no_rows()
            return self._reader.row(times.size - 1)
        wanted = np.array([require_finite("time", time)])
        for index in np.nonzero(times == wanted)[0][:1]:
            return self._reader.row(int(index))
        return {name: part[0] for name, part in states_at(self._reader, self.model, wanted).items()}

    def sample(
        self, times: ArrayLike, channels: Sequence[str] | None = None
    ) -> dict[str, NDArray[np.float64]]:
        r"""Return channels at any times of the run, also such that were not asked for.

        Parameters
        ----------
        times : array_like, shape (n_times,)
            s, in any order.
        channels : sequence of str, optional
            Names, with a component or not, or patterns; also ``q``, ``qd``, …. The stored ones when
            none are given.

        Returns
        -------
        dict of str to ndarray, shape (n_times, \*shape)
            ``time`` and the channels.

        Raises
        ------
        UsageError
            As `state`; if a channel is unknown.
        """
        wanted = vector(times)
        names = self.channels if channels is None else self._listed(channels)
        states = [name for name in names if name in STATE]
        names = self.model.expand([name for name in names if name not in STATE])
        parts = states_at(self._reader, self.model, wanted)
        whole = list(dict.fromkeys(split_component(name)[0] for name in names))
        values = self.model.evaluate(whole, parts) if wanted.size else {}
        found = {"time": wanted} | {name: parts[name] for name in states}
        for name in names:
            channel, index = split_component(name)
            if not wanted.size:
                values[channel] = np.zeros((0, *self._quantity(channel).shape))
            found[name] = values[channel] if index is None else values[channel][:, index]
        return found

    def at(self, times: ArrayLike, channels: Sequence[str] | None = None) -> Result:
        """Return this result with rows at other times, in memory: to plot or export it there.

        It has no steps, so states at further times are those of this result, not of the new one.

        Parameters
        ----------
        times : array_like, shape (n_times,)
            s, rising.
        channels : sequence of str, optional
            What is stored; the channels stored here when none are given.

        Raises
        ------
        UsageError
            As `sample`.
        """
        wanted = vector(times)
        if not np.all(np.diff(wanted) > 0.0):
            raise UsageError("`times` do not rise", help="sort them, and leave out equal ones")
        names = self.channels if channels is None else self.model.expand(self._listed(channels))
        names = list(dict.fromkeys(split_component(name)[0] for name in names))
        states = [name for name in STATE if name in self._reader.quantities and name != "time"]
        parts = self.sample(wanted, [*states, *names])
        memory = Memory(self.meta, self.model.channels)
        if wanted.size:
            rows = {name: parts[name] for name in ("time", *states)}
            memory.append(rows | {"channels": {name: parts[name] for name in names}})
        return Result(memory, self._model)

    @property
    def span(self) -> tuple[float, float] | None:
        """First and last time (s) between which any state can be computed.

        None where the run has no steps, or was made without ``dense_output``.
        """
        return self._reader.dense_span

    @property
    def meta(self) -> dict[str, Any]:
        """Everything the file says about the run, as plain data."""
        return self._reader.meta

    @property
    def path(self) -> Path | None:
        """The result file; None for a result in memory."""
        return self._reader.path

    @property
    def model(self) -> Model:
        """The model that was run; of a file read back from it."""
        if self._model is None:
            if "model" not in self.meta:
                raise FileError(
                    f"{self.path}: its model is lost",
                    "stored channels can be read all the same; run the model again for others",
                    code="result/damaged",
                )
            text = json.dumps(self.meta["model"], ensure_ascii=False)
            name = str(self.meta.get("name", "model"))
            self._model = Model.from_text(text, "json", name)
        return self._model

    @property
    def items(self) -> dict[str, Any]:
        """The model as plain data, with what its patterns repeat written out."""
        model: dict[str, Any] = self.meta.get("model", {})
        if "patterns" in model:
            model = json.loads(self.model.to_json(plain=True))
        return model

    @property
    def status(self) -> str:
        """How the run ended.

        ``completed``; ``interrupted`` by Ctrl-C; ``failed``; ``limit``: of steps or seconds;
        ``killed`` while writing; ``running``: not yet ended, or killed where that cannot be told.
        """
        return str(self.meta.get("status", "running"))

    @property
    def stop_reason(self) -> dict[str, Any]:
        """Why the run ended: ``code``, ``message`` and, where known, ``time``, ``item``, …."""
        return dict(self.meta.get("stop_reason") or {})

    @property
    def statistics(self) -> Record:
        """Counts and times of the run: ``steps``, ``rejected``, ``jacobians``, …."""
        return Record(self.meta.get("statistics") or {})

    @property
    def residuals(self) -> Record:
        """Largest constraint residuals over the accepted steps."""
        return Record(self.meta.get("residuals") or {})

    @property
    def energy(self) -> Record:
        """Energy ledger at the end, J."""
        return Record(self.meta.get("energy") or {})

    @property
    def warnings(self) -> list[dict[str, str]]:
        """Warnings of the model and of the run."""
        return list(self.meta.get("warnings") or [])

    @property
    def certification(self) -> Certification | None:
        """Measured error of every channel, if the run was made with ``certify=True``."""
        data = self.meta.get("certification")
        return None if data is None else Certification.from_json(data)

    @property
    def options(self) -> dict[str, Any]:
        """What the run used: the choices stated, the rest from the model or by default."""
        return dict(self.meta.get("options") or {})

    @property
    def steps(self) -> dict[str, NDArray[Any]]:
        """The log of attempted steps, by column, each ndarray of shape (n_steps,).

        ``t``, ``h`` (s): start and size; ``error``: 1 is on tolerance; ``accepted``: 1 or 0;
        ``cause``: of a rejection; ``iterations``: of Newton's method.
        """
        return self._reader.steps()

    @property
    def step_totals(self) -> list[tuple[bool, str, int, float, float, float]]:
        """Attempts by outcome: accepted or not, cause, count, smallest, largest, mean size (s)."""
        return self._reader.step_totals()

    @property
    def events(self) -> list[dict[str, Any]]:
        """Events in the order in which they happened."""
        return self._reader.events()

    def expand(self, patterns: Iterable[str]) -> list[str]:
        """Return the channels meant by names and patterns, stored ones or computable."""
        stored = self._reader.quantities
        if isinstance(patterns, str) or not isinstance(patterns, Iterable):
            return expand(patterns, stored)  # which refuses it
        patterns = list(patterns)
        whole = {split_component(require_name(pattern))[0] for pattern in patterns}
        return expand(patterns, stored if whole <= stored.keys() else self.model.channels)

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
        runs = [self, *others]
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

        given: tuple[object, ...] = others
        for other in given:
            if not isinstance(other, Result):
                tip = "pass results; `Result.load(path)` reads one"
                raise UsageError(f"{quoted(repr(other))} is no result", help=tip)
        return view.show([self, *others])

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
            Frames of a film per second.
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
            [self, *others], as_path(path), at=at, size=size, camera=camera, fps=fps, start=start,
            end=end, speed=speed, dark=dark, browser=browser, progress=progress, force=force,
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

        rows = "".join(
            f"<tr><th>{html.escape(shown(label))}</th><td>{html.escape(shown(text))}</td></tr>"
            for label, text in summarize(self)
        )
        return f"<table>{rows}</table>"

    def __repr__(self) -> str:
        until = f"{self.time[-1]:.6g} s" if self.time.size else "no states"
        return f"<holonom.Result {self.meta.get('name')!r}: {self.status}, {until}>"

    @staticmethod
    def _listed(channels: Iterable[str]) -> list[str]:
        if isinstance(channels, str) or not isinstance(channels, Iterable):
            expand(channels, {})  # which refuses it
        return [require_name(name) for name in channels]

    def _quantity(self, name: str) -> Quantity:
        stored = self._reader.quantities
        whole, index = split_component(require_name(name))
        quantity = stored.get(whole) or self.model.channels.get(whole)
        if quantity is None:
            known = [*stored, *self.model.channels]
            tip = did_you_mean(nearest_channels(whole, known), "`Result.model.channels` lists them")
            if re.search(r"\[-\d+\]$", whole):
                tip = FROM_ZERO
            elif any(sign in whole for sign in "*?["):
                tip = "a pattern means several: `Result.expand([pattern])` lists them"
            raise UsageError(
                f"there is no channel {quoted(name)}", "simulation/unknown-channel", tip
            )
        if index is not None:
            expand([name], {whole: quantity})  # refuses components that are not there
        return quantity


def _from_bytes(data: bytes) -> Result:
    """Return the result in memory that a file of these bytes holds."""
    db = sqlite3.connect(":memory:", check_same_thread=False)
    db.deserialize(data)
    return Result(Reader(db, None))
