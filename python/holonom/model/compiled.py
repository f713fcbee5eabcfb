"""What a compiled model says of itself, and what it computes from given states."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from holonom import _core
from holonom.base.errors import UsageError, translated
from holonom.base.names import did_you_mean, nearest_channels
from holonom.base.plain import frozen, real
from holonom.base.record import Record
from holonom.base.text import is_unicode, quoted
from holonom.channels import LISTED, expand, is_pattern, require_name, split_component, unknown
from holonom.store.layout import Quantity

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

#: Kinds of items of a model.
KINDS = ("bodies", "joints", "forces", "drivers", "parameters")


class Channels(Mapping[str, Quantity]):
    """Every channel of a model by name.

    A large model has hundreds of thousands, which are listed when something goes over all of them.

    Parameters
    ----------
    core : CoreModel
    """

    def __init__(self, core: _core.CoreModel) -> None:
        self._core = core
        self._all: dict[str, Quantity] | None = None

    def _listed(self) -> dict[str, Quantity]:
        if self._all is None:
            self._all = {
                name: Quantity(name, unit, frame, tuple(shape))
                for name, unit, frame, shape in self._core.channels()
            }
        return self._all

    def __getitem__(self, name: str) -> Quantity:
        if (found := self._found(name)) is None:
            near = nearest_channels(name, self) if isinstance(name, str) else []
            raise KeyError(f"there is no channel {quoted(str(name))}; {did_you_mean(near, LISTED)}")
        return found

    def __contains__(self, name: object) -> bool:
        return self._found(name) is not None

    def get(self, name: str, default: Any = None) -> Any:
        """Return a channel by name, or `default` where there is none."""
        found = self._found(name)
        return default if found is None else found

    def _found(self, name: object) -> Quantity | None:
        if not isinstance(name, str) or not is_unicode(name):
            return None
        if self._all is not None:
            return self._all.get(name)
        found = self._core.channel(name)
        return None if found is None else Quantity(name, *found[:2], tuple(found[2]))

    def __iter__(self) -> Iterator[str]:
        return iter(self._listed())

    def __len__(self) -> int:
        return len(self._listed())

    def __reversed__(self) -> Iterator[str]:
        return reversed(self._listed())

    def __repr__(self) -> str:
        return f"<{len(self)} channels: {reprlib.repr(list(self))[1:-1]}>"

    def __reduce__(self) -> tuple[type[dict[str, Quantity]], tuple[dict[str, Quantity]]]:
        return dict, (self._listed(),)


class Compiled:
    """A model as the engine holds it; what is asked for often is asked once.

    Parameters
    ----------
    core : CoreModel
    name : str
    """

    def __init__(self, core: _core.CoreModel, name: str) -> None:
        self._core = core
        self._channels = Channels(core)
        self._defaults: dict[str, Any] | None = None
        self._text: str | None = None
        self._hash: str | None = None
        self._warnings: str | None = None
        self._tree: dict[str, Record] | None = None
        self._geometry: dict[str, Any] | None = None
        self.name = name

    @property
    def bodies(self) -> Mapping[str, Any]:
        """Bodies by name as the file states them, in SI and patterns written out; read-only.

        A value read here is in SI, one given to `with_values` in the units of the file.
        """
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
            tree = json.loads(self.to_json(plain=True))
            self._tree = {key: Record(frozen(tree.get(key, {}))) for key in KINDS}
        return self._tree[kind]

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
    def channels(self) -> Mapping[str, Quantity]:
        """Every channel that can be asked for, by name, with unit, frame and shape."""
        return self._channels

    @property
    def diagnostics(self) -> tuple[str, ...]:
        """Channels that every run stores: residuals and the energy ledger.

        The path integrals among them cannot be computed from states afterwards.
        """
        return tuple(_core.diagnostics())

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
            x = np.atleast_1d(real(places))
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
            If a channel is unknown, an array has not the shape that the model's state has, or one
            is missing that a channel is computed from.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise UsageError(f"`names` is {quoted(repr(names))}", help="pass a list of channels")
        names = [require_name(name) for name in names]
        for name in names:
            if name not in self.channels:
                tip = did_you_mean(nearest_channels(name, self.channels), LISTED)
                if split_component(name)[1] is not None:
                    tip = "name the whole channel; components are columns of what is returned"
                elif is_pattern(name):
                    tip = "`Model.expand([pattern])` lists the channels that a pattern means"
                raise unknown(name, tip)
        from holonom.states import as_rows, require_parts  # here: NumPy takes long to import

        rows = as_rows(state)
        require_parts(rows, names, self)
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

    def to_dict(self) -> dict[str, Any]:
        """Return the merged model as plain data, from which `from_dict` makes the same one."""
        data: dict[str, Any] = json.loads(self.to_json())
        return data
