"""Models: reading, changing, checking and running them."""

from __future__ import annotations

import fnmatch
import html
import json
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from holonom import _core, library
from holonom.base import files, toml
from holonom.base.errors import FileError, ModelError, Problem, UsageError, translated
from holonom.base.names import did_you_mean, nearest_channels
from holonom.base.plain import as_path, frozen, plain, require_text
from holonom.base.text import as_name, as_text, quoted, shown
from holonom.check import CheckReport
from holonom.options import Options
from holonom.store.layout import Quantity

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from holonom.result import Result

#: Largest model file, bytes; the core states the same limit for text.
MAX_FILE_SIZE = 64 * 1024**2

#: Beginnings of the names of channels that every run stores.
DIAGNOSTICS = ("energy.", "constraint.")

Progress = Callable[[float, float, int], None]
#: Told what long work is doing: ``reading``, ``compiling``, ``assembling``, ``analysing``,
#: ``running``; about twenty times a second, also within a step. What it raises ends the work.
Watch = Callable[[str], None]
#: Given output rows as they are computed: states and channels as arrays by name.
Rows = Callable[[Mapping[str, Any]], None]


class Model:
    """A validated model: bodies, joints, forces, drivers and their initial state.

    Make one with `Model.load`, `Model.from_text` or `Model.library`. A model never changes.

    Examples
    --------
    ::

        model = holonom.Model.load("models/double_pendulum/model.toml")
        print(model.check())
        result = model.simulate(end_time=2.0, tolerance=1e-6)
    """

    def __init__(self, core: _core.CoreModel, name: str, sources: Iterable[Path] = ()) -> None:
        self._core = core
        self._channels: dict[str, Quantity] | None = None
        self._defaults: dict[str, Any] | None = None
        self._diagnostics: tuple[str, ...] | None = None
        self._text: str | None = None
        self._hash: str | None = None
        self._warnings: str | None = None
        self._tree: Mapping[str, Any] | None = None
        self._geometry: dict[str, Any] | None = None
        self._sources = tuple(sources)
        #: Kept by a run for the next one, which often asks for the same: what it asked for, what
        #: that means, the channels, and the same as JSON.
        self._choices: tuple[object, dict[str, Any], list[str], str] | None = None
        self.name = name

    @classmethod
    def load(cls, path: str | Path, *, watch: Watch | None = None) -> Model:
        """Read a model file, TOML or (with the ending ``.json``) JSON.

        What the model ``extends`` and the files of its meshes are read as well, from the folders
        beside the model's own.

        Parameters
        ----------
        path : str or Path
        watch : callable, optional
            Called with what is being done, about twenty times a second where it takes long.

        Raises
        ------
        FileError
            If the file cannot be read.
        ModelError
            If it is not a valid model; the message names file, line and item.
        """
        path = as_path(path)
        _require_callable("watch", watch)
        text = _read(path)
        tree = path.resolve().parent.parent
        sources = [path]

        def within(name: str) -> Path:  # the core has joined it to the name of the model file
            target = Path(as_name(name)).resolve()
            if not target.is_relative_to(tree):
                raise FileError(
                    f"it lies outside the folder tree {tree}", help="copy it into this tree"
                )
            sources.append(target)
            return target

        def read(name: str) -> str:
            return _read(within(name))

        syntax = "json" if path.suffix.lower() == ".json" else "toml"
        with translated():
            core = _core.parse(
                text, syntax, as_text(str(path)), read, lambda name: _read_mesh(within(name)), watch
            )
        folder = path.resolve().parent.name
        name = shown(folder if path.stem == "model" and folder else path.stem)
        return cls(core, name, sources)

    @classmethod
    def from_text(
        cls, text: str, syntax: Literal["toml", "json"] = "toml", name: str = "model"
    ) -> Model:
        """Read a model from text; it cannot use ``extends`` or the ``file`` of a mesh.

        Raises
        ------
        ModelError
            If it is not a valid model.
        """
        if isinstance(text, Mapping):
            raise UsageError(
                "`text` is a mapping, not the text of a model",
                help="`Model.from_dict(data)` takes plain data",
            )
        if not isinstance(text, str):
            raise UsageError(
                f"`text` is {quoted(repr(text))}, not the text of a model",
                help="pass TOML or JSON, or read a file with `Model.load(path)`",
            )
        if not isinstance(name, str):
            raise UsageError(f"`name` is {quoted(repr(name))}", help="pass a text")
        if syntax not in ("toml", "json"):
            raise UsageError(
                f"`syntax` is {quoted(syntax)}", help='it is "toml" or "json", without a dot'
            )
        if "\n" not in text and text.strip().lower().endswith((".toml", ".json")):
            raise ModelError(
                Problem(
                    code="model/syntax",
                    message=f"{quoted(text.strip())} is the name of a file, not a model's text",
                    help="read files with `Model.load(path)`",
                )
            )
        require_text(text, "the text of the model")

        def read(_: str) -> str:
            raise FileError(
                "a model given as text cannot extend a file", help="use `Model.load(path)`"
            )

        def read_mesh(_: str) -> bytes:
            raise FileError("a model given as text has no folder", help="use `Model.load(path)`")

        with translated():
            core = _core.parse(text, syntax, as_text(name), read, read_mesh, None)
        return cls(core, shown(name))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], name: str = "model") -> Model:
        """Read a model from plain data: the tables of a model file as dictionaries.

        NumPy numbers and arrays are taken as well. It cannot use ``extends``.

        Raises
        ------
        UsageError
            If `data` is no mapping.
        ModelError
            If it is not a valid model.
        """
        if not isinstance(data, Mapping):
            raise UsageError(
                f"`data` is {quoted(repr(data))}, not a mapping",
                help="`Model.from_text` reads text, `Model.load` a file",
            )
        return cls.from_text(json.dumps(plain(data, "")), "json", name)

    def to_dict(self) -> dict[str, Any]:
        """Return the merged model as plain data, from which `from_dict` makes the same one."""
        data: dict[str, Any] = json.loads(self.to_json())
        return data

    def save(self, path: str | Path) -> Path:
        """Write the merged model, TOML or (with the ending ``.json``) JSON; return the path.

        A model that is there is replaced, in one move.

        Raises
        ------
        FileError
            If it cannot be written, something else than a model is there, or one that it extends.
        """
        path = as_path(path)
        is_json = path.suffix.lower() == ".json"
        text = json.dumps(self.to_dict(), indent=2) if is_json else toml.written(self.to_dict())
        if path.exists():
            for source in self._sources[1:]:
                if files.same_file(path, source):
                    raise FileError(
                        f"{path} is a file that this model extends; it is not overwritten",
                        "take another name",
                        code="file/protected",
                    )
            try:
                Model.load(path)
            except ModelError:
                raise FileError(
                    f"{path} is there and is no model; it is not overwritten",
                    "take another name",
                    code="file/protected",
                ) from None
        # What is there is a model, or nothing.
        return files.write_text(path, "model", text, force=path.exists())

    @property
    def sources(self) -> tuple[Path, ...]:
        """The files that the model was read from, its own first; empty where it was given as text.

        No run of it replaces one of them.
        """
        return self._sources

    @property
    def bodies(self) -> Mapping[str, Any]:
        """Bodies by name, as the file states them, patterns written out; read-only."""
        return self._items("bodies")

    @property
    def joints(self) -> Mapping[str, Any]:
        """Joints by name, as `bodies`."""
        return self._items("joints")

    @property
    def forces(self) -> Mapping[str, Any]:
        """Forces by name, as `bodies`."""
        return self._items("forces")

    @property
    def drivers(self) -> Mapping[str, Any]:
        """Drivers by name, as `bodies`."""
        return self._items("drivers")

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Parameters by name, as `bodies`: each a mapping with ``value``, ``unit``, ``title``."""
        return self._items("parameters")

    def _items(self, kind: str) -> Mapping[str, Any]:
        if self._tree is None:
            self._tree = frozen(json.loads(self.to_json(plain=True)))
        found: Mapping[str, Any] = self._tree.get(kind, MappingProxyType({}))
        return found

    @classmethod
    def library(cls, name: str) -> Model:
        """Read a model that comes with Holonom, such as ``hmmwv14``; ``holonom models`` lists them.

        Raises
        ------
        UsageError
            If there is none of this name; it tells the nearest ones.
        """
        return cls.load(library.entry(name).path)

    def with_values(self, values: Mapping[str, Any]) -> Model:
        """Return the model with other values.

        Parameters
        ----------
        values : mapping of str to value
            By path: ``forces.front_bushing.stiffness[2]``, ``parameters.speed.value``.
            Numbers are in the units of the file; a text ``"=2*name"`` is an expression of
            parameters. A repeated item goes by its own name, ``bodies.link_7.mass``, or by
            that in its pattern, ``patterns.chain.bodies."link_{i}".mass``.

        Raises
        ------
        ModelError
            If a path does not exist or a value does not fit.
        """
        if not isinstance(values, Mapping):
            raise UsageError(
                f"`values` is {quoted(repr(values))}, not a mapping",
                help='pass new values by path: {"bodies.rod.mass": 2.0}',
            )
        changed = {}
        for path, value in values.items():
            if not isinstance(path, str):
                raise UsageError(
                    f"{quoted(repr(path))} is no path of a value",
                    help="a path is a text, such as bodies.rod.mass",
                )
            require_text(path, "a path")
            changed[path] = plain(value, path)
        with translated():
            core = self._core.with_values(json.dumps(changed))
        return Model(core, self.name, self._sources)

    def check(self, *, spectrum: bool = True, watch: Watch | None = None) -> CheckReport:
        """Assemble the initial state and count what there is.

        Refuses whatever a run with the choices of the model file would refuse before its first
        step, and says which initial velocities were chosen where nothing determines them.

        Parameters
        ----------
        spectrum : bool
            Whether to compute the eigenvalues of the motion linearized at the initial state.
        watch : callable, optional
            As in `load`.

        Raises
        ------
        ModelError
            If the initial state cannot be assembled.
        SimulationError, UsageError
            If a choice or an output channel of the file cannot be used.
        """
        _require_callable("watch", watch)
        with translated():
            data = json.loads(self._core.check(bool(spectrum), watch))
        self.expand(data.pop("channels"))
        warnings = [*self.warnings, *data.pop("warnings")]
        return CheckReport(name=self.name, data=data, warnings=warnings)

    def simulate(
        self,
        *,
        start: Mapping[str, NDArray[np.float64]] | None = None,
        output: str | Path | None = None,
        on_failure: Literal["raise", "return"] = "raise",
        progress: Progress | None = None,
        watch: Watch | None = None,
        rows: Rows | None = None,
        certify: bool = False,
        keep: bool = False,
        force: bool = False,
        source: str | Path | None = None,
        **choices: Any,
    ) -> Result:
        """Run the model.

        Parameters
        ----------
        start : mapping, optional
            State to start from, as `Result.state` returns it; else the model's initial state.
        output : path, optional
            Result file, written while the run goes on; missing folders are made. Without it the
            result stays in memory. An older result there stands until this run has got beyond its
            start; one whose last state is `start` is continued, and one whose other states are
            is not replaced: the run then takes a new name, as with `keep`. A run that was killed or
            interrupted is continued with the same options as if it had not been, bit for bit.
        on_failure : {"raise", "return"}
            What to do when the run ends early: raise, or return what there is with its `status`.
        progress : callable, optional
            Called with time (s), step size (s) and number of steps, about ten times a second; with
            `certify` for both runs, at the beginning of the second one with zero steps.
        watch : callable, optional
            Called with what is being done, about twenty times a second, before the first step and
            within steps.
        rows : callable, optional
            Called with the output rows as they come: ``time``, the states that `evaluate` takes and
            ``channels``, arrays by name; with `certify` those of the first run. A run that takes up
            an older one may find that it cannot, and then begin again earlier.
        certify : bool
            Whether to repeat the run at a tenth of the tolerance and to measure the error of every
            channel: see `Result.certification`. The result is that of the first run, unchanged.
        keep : bool
            Whether to keep an older file at `output` and to write ``<name>-2``, … instead.
        force : bool
            Whether `output` may also replace a file that is no result.
        source : path, optional
            The result file that `start` was read from, where no row of it is `start`.
        **choices
            Those of `Options`: ``end_time``, ``tolerance``, ``method``, ``interval``,
            ``channels``, …; what is not stated comes from the model.

        Raises
        ------
        UsageError
            If a choice cannot be used.
        ModelError
            If the initial state cannot be assembled.
        SimulationError
            If the run ends before its end time; its ``result`` holds what was computed.
        FileError
            If the file cannot be written, is there and is not a result, or is being written.
        Interrupted
            If Ctrl-C ended the run; likewise. In the second run of `certify` the ``result`` is
            whole, and not certified.
        """
        from holonom.simulation import run  # here, because it needs `Model` itself

        if on_failure not in ("raise", "return"):
            raise UsageError(
                f"`on_failure` is {quoted(on_failure)}", help="it is 'raise' or 'return'"
            )
        _require_callable("progress", progress)
        _require_callable("watch", watch)
        _require_callable("rows", rows)
        for name, flag in (("certify", certify), ("keep", keep), ("force", force)):
            if not isinstance(flag, bool):
                raise UsageError(f"`{name}` is {quoted(repr(flag))}", help="it is True or False")
        options = Options.of(choices)
        target = None if output is None else as_path(output)
        return run(
            self,
            options,
            start,
            target,
            on_failure == "raise",
            progress,
            watch,
            certify,
            rows=rows,
            keep=keep,
            force=force,
            source=None if source is None else as_path(source),
        )

    @property
    def title(self) -> str:
        """Title stated in the file, else the name."""
        return str(self.defaults.get("title") or self.name)

    @property
    def hash(self) -> str:
        """Hash of the merged model text: equal for equal models."""
        if self._hash is None:
            self._hash = self._core.hash()
        return self._hash

    @property
    def defaults(self) -> dict[str, Any]:
        """Title and dimension; start and end (s) and tolerance of a run that states none."""
        if self._defaults is None:
            self._defaults = json.loads(self._core.defaults())
        return self._defaults

    @property
    def warnings(self) -> list[dict[str, str]]:
        """What is legal but implausible: ``code``, ``message`` and ``path`` of each."""
        if self._warnings is None:
            self._warnings = self._core.warnings()
        found: list[dict[str, str]] = json.loads(self._warnings) if self._warnings != "[]" else []
        return found

    @property
    def channels(self) -> dict[str, Quantity]:
        """Every channel that can be asked for, by name, with unit, frame and shape."""
        if self._channels is None:
            self._channels = {
                name: Quantity(name, unit, frame, tuple(shape))
                for name, unit, frame, shape in self._core.channels()
            }
        return self._channels

    @property
    def diagnostics(self) -> tuple[str, ...]:
        """Channels that every run stores: residuals and the energy ledger.

        The path integrals among them cannot be computed from states afterwards.
        """
        if self._diagnostics is None:
            names = (name for name in self.channels if name.startswith(DIAGNOSTICS))
            self._diagnostics = tuple(names)
        return self._diagnostics

    @property
    def geometry(self) -> dict[str, Any]:
        """What is needed to draw the model, as plain data; lengths in m.

        ``dimension``, ``gravity``; ``bodies`` in the design configuration, with their ``shapes``;
        ``elements``: joints, forces and drivers with ``collection``, ``name``, ``type`` and
        ``frames``. A frame is a ``body`` (its number, None for the ground) with a ``point`` and
        ``axes`` (columns) in body axes.
        """
        if self._geometry is None:
            self._geometry = json.loads(self._core.geometry())
        return self._geometry

    def road_heights(self, tyre: str, places: ArrayLike) -> NDArray[np.float64]:
        """Return the height of the road under a tyre at places x (m), ndarray, m.

        Raises
        ------
        UsageError
            If there is no such tyre.
        """
        tyres = [e["name"] for e in self.geometry["elements"] if e["type"] == "tyre"]
        if tyre not in tyres:
            raise UsageError(
                f"there is no tyre {quoted(tyre)}",
                help=did_you_mean(tyres, "") if tyres else "the model has no tyres",
            )
        import numpy as np

        try:
            x = np.atleast_1d(np.asarray(places, dtype=np.float64))
        except (TypeError, ValueError, OverflowError):
            x = np.empty((0, 0))
        if x.ndim != 1 or not np.isfinite(x).all():
            raise UsageError(
                f"`places` is {quoted(repr(places))}", help="pass a vector of finite places, m"
            )
        return np.array(self._core.road_heights(tyre, x.tolist()))

    def expand(self, patterns: Iterable[str]) -> list[str]:
        """Return the channels meant by names and patterns such as ``rack_slide.*``.

        Raises
        ------
        UsageError
            If a name or pattern fits no channel.
        """
        return expand(patterns, self.channels)

    def evaluate(
        self, names: Iterable[str], state: Mapping[str, ArrayLike]
    ) -> dict[str, NDArray[np.float64]]:
        r"""Compute channels from states.

        Parameters
        ----------
        names : iterable of str
            Channels.
        state : mapping of str to ndarray
            ``time`` (n_times,), ``q``, ``qd``, ``qdd``, ``lambda``, ``z``, ``winding`` and
            ``ledger`` (n_times, size), as a result stores them.

        Returns
        -------
        dict of str to ndarray, shape (n_times, \*shape)

        Raises
        ------
        UsageError
            If a channel is unknown, or an array has not the shape that the model's state has.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise UsageError(f"`names` is {quoted(repr(names))}", help="pass a list of channels")
        names = [require_name(name) for name in names]
        for name in names:
            if name not in self.channels:
                tip = did_you_mean(
                    nearest_channels(name, self.channels), "`Model.channels` lists them"
                )
                if split_component(name)[1] is not None:
                    tip = "name the whole channel; components are columns of what is returned"
                elif any(sign in name for sign in "*?["):
                    tip = "`Model.expand([pattern])` lists the channels that a pattern means"
                raise UsageError(
                    f"there is no channel {quoted(name)}", "simulation/unknown-channel", tip
                )
        from holonom.states import as_rows  # here: NumPy takes as long as all else to import

        rows = as_rows(state)
        with translated():
            return self._core.evaluate_channels(names, rows)

    def dense_states(
        self, steps: Mapping[str, Any], times: NDArray[np.float64]
    ) -> dict[str, NDArray[np.float64]]:
        """Compute the states at times (s) within stored steps; see `Reader.dense_chunks`.

        Returns
        -------
        dict of str to ndarray, shape (n_times, size)
            As `evaluate` takes them.
        """
        from holonom.states import vector

        if not hasattr(steps, "keys"):
            tip = "pass an entry of `Reader.dense_chunks`"
            raise UsageError(f"the steps are {quoted(repr(steps))}", help=tip)
        with translated():
            return self._core.dense_states(dict(steps), vector(times).tolist())

    def to_json(self, *, plain: bool = False) -> str:
        """Return the merged model as JSON text, without ``extends``.

        Numbers stand as the file states them, with its units and expressions; `plain` text holds
        none of these, only numbers in SI units.

        Parameters
        ----------
        plain : bool, default False
            Write out what patterns repeat, so that every item stands under its name, and what
            units and expressions mean: plain numbers in SI units.
        """
        if plain:
            return self._core.to_plain_json()
        if self._text is None:
            self._text = self._core.to_json()
        return self._text

    def __reduce__(self) -> tuple[Any, ...]:
        return Model.from_text, (self.to_json(), "json", self.name)

    def __copy__(self) -> Model:
        return self  # a model never changes

    def __deepcopy__(self, _: dict[int, Any]) -> Model:
        return self

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{kind}</th><td>{len(self._items(kind))}</td>"
            f"<td>{html.escape(shown(', '.join(list(self._items(kind))[:12])))}</td></tr>"
            for kind in ("bodies", "joints", "forces", "drivers", "parameters")
            if self._items(kind)
        )
        title = html.escape(shown(f"{self.title} ({self.defaults.get('dimension')})"))
        return f"<table><caption>{title}</caption>{rows}</table>"

    def __repr__(self) -> str:
        return f"<holonom.Model {self.name!r}, {self.defaults.get('dimension')}, {self.hash[:12]}>"


def _require_callable(name: str, value: object) -> None:
    if value is not None and not callable(value):
        raise UsageError(
            f"`{name}` is {quoted(repr(value))}", help="pass a function, or leave it out"
        )


#: What to try where a component is counted from the end.
FROM_ZERO = "components count from 0: `chassis.position[2]` is the last of three"
_NEGATIVE = re.compile(r"\[-\d+\]$")


def split_component(name: str) -> tuple[str, int | None]:
    """Return a channel's name and, of ``chassis.position[2]``, the index 2."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", name)
    return (match[1], int(match[2])) if match else (name, None)


def require_name(name: object) -> str:
    """Refuse what is no text where a channel is named.

    Raises
    ------
    UsageError
        ``simulation/unknown-channel``.
    """
    if not isinstance(name, str):
        raise UsageError(
            f"{quoted(repr(name))} is no channel",
            "simulation/unknown-channel",
            "pass names as texts, such as 'chassis.position'",
        )
    return name


def expand(patterns: Iterable[str], known: Mapping[str, Quantity]) -> list[str]:
    """Return the names that names and patterns mean, each once, in their order.

    A name may end in the index of a component, ``chassis.position[2]``.
    """
    found: dict[str, None] = {}
    if isinstance(patterns, str):
        raise UsageError(
            f"the channels are one text, {quoted(patterns)}", help="pass a list of names"
        )
    if not isinstance(patterns, Iterable):
        raise UsageError(
            f"the channels are {quoted(repr(patterns))}", help="pass a list of names or patterns"
        )
    for pattern in patterns:
        require_name(pattern)
        name, index = split_component(pattern)
        if pattern in known:  # thousands of names are looked up, not compared
            hits = [pattern]
        elif index is None:
            fits = re.compile(fnmatch.translate(name)).match
            hits = [n for n in known if fits(n)]
        else:
            hits = [pattern] if name in known else []
            if hits and not (len(known[name].shape) == 1 and index < known[name].size):
                shape = known[name].shape
                raise UsageError(
                    f"{quoted(name)} has no component {index}; its shape is {list(shape)}",
                    "simulation/unknown-channel",
                    f"take one from 0 to {shape[0] - 1}" if shape else "leave the index out",
                )
        if not hits:
            tip = did_you_mean(
                nearest_channels(pattern, known), "`Model.channels` and `holonom info` list them"
            )
            tip = FROM_ZERO if _NEGATIVE.search(pattern) else tip
            raise UsageError(
                f"there is no channel {quoted(pattern)}", "simulation/unknown-channel", tip
            )
        found |= dict.fromkeys(hits)
    return list(found)


def _read(path: Path) -> str:
    if path.is_dir():
        meant = path / "model.toml"
        tip = f"did you mean {meant}?" if meant.is_file() else "name the model file in it"
        raise FileError(f"{path} is a folder, not a model file", tip)
    if path.exists() and not path.is_file():
        raise FileError(f"{path} is not a regular file", "save the model in a file first")
    try:
        if path.stat().st_size > MAX_FILE_SIZE:
            raise ModelError(
                Problem(
                    code="model/too-large",
                    message=f"the file has {path.stat().st_size} bytes",
                    file=str(path),
                    expected=f"at most {MAX_FILE_SIZE} bytes",
                    help="repeat items by [patterns], or look whether this is a model at all",
                )
            )
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ModelError(
            Problem(
                code="model/syntax",
                message=f"byte {error.start} of the file is not UTF-8",
                file=str(path),
                expected="a text file in UTF-8",
                help="save it as UTF-8; a result file is opened by `Result.load`",
            )
        ) from None
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> FileError:
    """Return why a model file cannot be read, and what was meant."""
    if not isinstance(error, FileNotFoundError):
        return files.unusable(path, error)
    name = path.stem if path.name != "model.toml" else path.parent.name
    if name in library.names():
        return FileError(
            f"{path}: there is no such file",
            f"that of the library is `library:{name}`, or `Model.library({name!r})`",
        )
    return files.absent(path, "`holonom models` lists those that come with Holonom")


def _read_mesh(path: Path) -> bytes:
    if not path.is_file():
        raise FileError("there is no such file", "write the path relative to the model file")
    if path.stat().st_size > MAX_FILE_SIZE:
        raise FileError(f"it has {path.stat().st_size} bytes", "make the mesh coarser")
    return path.read_bytes()
