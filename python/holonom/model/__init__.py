"""Models: reading, changing, checking and running them; `Model` is here.

============ ====================================================================
``reading``  model files, with what they extend and their meshes, and texts
``compiled`` what a compiled model says of itself and computes from given states
============ ====================================================================
"""

from __future__ import annotations

import html
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

from holonom import _core, library
from holonom.base import files, toml
from holonom.base.errors import FileError, ModelError, UsageError, translated
from holonom.base.plain import as_path, plain, require_callable, require_text
from holonom.base.text import quoted, shown
from holonom.check import CheckReport
from holonom.model import reading
from holonom.model.compiled import KINDS, Compiled
from holonom.options import Choices, Options, require_known_code, shows_choices

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from holonom.result import Result

Progress = Callable[[float, float, int], None]
#: Told what long work is doing: ``reading``, ``compiling``, ``assembling``, ``analysing``,
#: ``running``; about twenty times a second, also within a step. What it raises ends the work.
Watch = Callable[[str], None]
#: Given output rows as they are computed: states and channels as arrays by name.
Rows = Callable[[Mapping[str, Any]], None]


class Arguments(Choices, total=False):
    """Keywords of `Model.simulate`, for checkers and editors."""

    start: Mapping[str, NDArray[np.float64]] | None
    output: str | Path | None
    on_failure: Literal["raise", "return"]
    progress: Progress | None
    watch: Watch | None
    rows: Rows | None
    certify: bool
    keep: bool
    force: bool
    source: str | Path | None
    options: Options | None


class Model(Compiled):
    """A validated model: bodies, joints, forces, drivers and their initial state.

    Make one with `Model.load`, `Model.from_text` or `Model.library`. A model never changes;
    two are equal if their merged texts are, whatever they are called.

    Examples
    --------
    ::

        model = holonom.Model.load("models/double_pendulum/model.toml")
        print(model.check())
        result = model.simulate(end_time=2.0, tolerance=1e-6)
    """

    def __init__(
        self, core: _core.CoreModel, name: str = "model", sources: Iterable[Path] = ()
    ) -> None:
        given: object = core
        if not isinstance(given, _core.CoreModel):
            raise UsageError(
                f"a model is not made of {quoted(repr(given))}",
                help="`Model.load(path)` reads a file, `Model.from_text` and `from_dict` what "
                "stands in one, `Model.library(name)` one that comes with Holonom",
            )
        super().__init__(core, name)
        self._sources = tuple(sources)
        #: Kept by a run for the next one, which often asks for the same: what it asked for, what
        #: that means, the channels, and the same as JSON.
        self._choices: tuple[object, dict[str, Any], list[str], str] | None = None

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
        require_callable("watch", watch)
        core, sources = reading.read_file(path, watch)
        folder = path.resolve().parent.name
        name = shown(folder if path.stem == "model" and folder else path.stem)
        return cls(core, name, sources)

    @classmethod
    def from_text(
        cls, text: str, syntax: Literal["toml", "json"] | None = None, name: str = "model"
    ) -> Model:
        """Read a model from text; it cannot use ``extends`` or the ``file`` of a mesh.

        Without `syntax`, text that begins with a brace is JSON, which no TOML does.

        Raises
        ------
        ModelError
            If it is not a valid model.
        """
        return cls(reading.read_text(text, syntax, name), shown(name))

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

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the merged model, TOML or (with the ending ``.json``) JSON; return the path.

        A model that is there is replaced, in one move.

        Parameters
        ----------
        path : path
        force : bool
            Whether a file that is no model, or is write-protected, may be replaced, and a name
            promise something else.

        Raises
        ------
        FileError
            If it cannot be written, something else than a model is there, one that it extends, or
            one that is write-protected.
        UsageError
            If a new name promises another kind of file.
        """
        path = as_path(path)
        is_json = files.ending_of(path) == ".json"
        text = json.dumps(self.to_dict(), indent=2) if is_json else toml.written(self.to_dict())
        if files.found(path) is not None:
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
                if not force:
                    raise FileError(
                        f"{path} is there and is no model; it is not overwritten",
                        "take another name, or `force=True`",
                        code="file/protected",
                    ) from None
        return files.write_text(path, "model", text, force=force)

    @property
    def sources(self) -> tuple[Path, ...]:
        """The files that the model was read from, its own first; empty where it was given as text.

        No run of it replaces one of them.
        """
        return self._sources

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
            Numbers are in the units of the file, not in SI as those of `bodies` are, where it
            states ``units``; a text ``"=2*name"`` is an expression of
            parameters. A repeated item goes by its own name, ``bodies.link_7.mass``, or by
            that in its pattern, ``patterns.chain.bodies."link_{i}".mass``. What is set of it
            is laid over it. A field takes the place of one that it stands for, as ``force`` of
            ``stiffness``.

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
            If a choice of the file cannot be used.
        """
        require_callable("watch", watch)
        require_known_code(self.defaults)
        with translated():
            data = json.loads(self._core.check(bool(spectrum), watch))
        warnings = [*self.warnings, *data.pop("warnings")]
        return CheckReport(name=self.name, data=data, warnings=warnings)

    @shows_choices
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
        options: Options | None = None,
        **choices: Unpack[Choices],
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
        options : Options, optional
            Choices that several runs share; those of the call come before them, and one that
            excludes another of these is refused. What neither states comes from the model.
        CHOICES

        Raises
        ------
        UsageError
            If a choice cannot be used.
        ModelError
            If the initial state cannot be assembled.
        SimulationError
            If the run ends before its end time; its ``result`` holds what was computed.
        FileError
            If the file cannot be written, is there and is not a result, or is being written. Where
            the disk became full its ``result`` holds what was stored before.
        Interrupted
            If Ctrl-C ended the run; likewise. In the second run of `certify` the ``result`` is
            whole, and not certified.
        """
        from holonom.simulation import Observers, run  # here, because it needs `Model` itself

        if on_failure not in ("raise", "return"):
            raise UsageError(
                f"`on_failure` is {quoted(on_failure)}", help="it is 'raise' or 'return'"
            )
        require_callable("progress", progress)
        require_callable("watch", watch)
        require_callable("rows", rows)
        for name, flag in (("certify", certify), ("keep", keep), ("force", force)):
            if not isinstance(flag, bool):
                raise UsageError(f"`{name}` is {quoted(repr(flag))}", help="it is True or False")
        shared: object = options
        if not isinstance(shared, Options | None):
            text = f"`options` is {quoted(repr(shared))}"
            raise UsageError(text, help="pass `holonom.Options(…)`, or choices as keywords")
        stated = {**(shared.stated() if shared else {}), **choices}
        if stated.get("method") is None:
            require_known_code(self.defaults)
        chosen = Options.of(stated, beside=Model.simulate.__kwdefaults__ or ())
        target = None if output is None else as_path(output)
        return run(
            self,
            chosen,
            start,
            target,
            on_failure == "raise",
            certify,
            Observers(progress, watch, rows),
            keep=keep,
            force=force,
            source=None if source is None else as_path(source),
        )

    def __reduce__(self) -> tuple[Any, ...]:
        sources = [source.absolute() for source in self._sources]
        return _restored, (self.to_json(), self.name, sources)

    def __eq__(self, other: object) -> bool:
        return self.hash == other.hash if isinstance(other, Model) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.hash)

    def __copy__(self) -> Model:
        return self  # a model never changes

    def __deepcopy__(self, _: dict[int, Any]) -> Model:
        return self

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{kind}</th><td>{len(self._items(kind))}</td>"
            f"<td>{html.escape(shown(', '.join(list(self._items(kind))[:12])))}</td></tr>"
            for kind in KINDS
            if self._items(kind)
        )
        title = html.escape(shown(f"{self.title} ({self.defaults.get('dimension')})"))
        return f"<table><caption>{title}</caption>{rows}</table>"

    def __repr__(self) -> str:
        return f"<holonom.Model {self.name!r}, {self.defaults.get('dimension')}, {self.hash[:12]}>"


def _restored(text: str, name: str, sources: Iterable[Path]) -> Model:
    """Make a model again that was pickled; no run of it replaces a file that it was read from."""
    core = reading.read_text(text, "json", name)
    return Model(core, name, sources)
