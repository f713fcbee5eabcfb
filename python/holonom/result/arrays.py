"""Arrays by the names of channels, at the output times of a run and at any other."""

from __future__ import annotations

from collections.abc import ItemsView, Iterable, Iterator, Sequence, ValuesView
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holonom.base.errors import UsageError
from holonom.base.names import did_you_mean, nearest_channels
from holonom.base.text import quoted
from holonom.channels import (
    FROM_ZERO,
    LISTED,
    component_units,
    expand,
    is_from_end,
    is_pattern,
    require_name,
    require_names,
    split_component,
    unknown,
)
from holonom.model import Model
from holonom.options import require_finite
from holonom.result.facts import Facts
from holonom.states import no_rows, states_at, vector
from holonom.store.layout import STATE, Quantity, undescribed
from holonom.store.memory import Memory, Stored


class Arrays(Facts):
    """A mapping of names to arrays: stored ones, and those computed from stored states."""

    def __init__(self, reader: Stored, model: Model | None = None) -> None:
        super().__init__(reader, model)
        self._kept: dict[str, NDArray[np.float64]] = {}

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
                values = np.zeros((0, *self._quantity(name).shape))
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
        quantity = self._known(whole)
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

    def values(self) -> ValuesView[NDArray[np.float64]]:
        """Return the arrays of `keys`; each is read when its turn comes."""
        return ValuesView(self)

    def items(self) -> ItemsView[str, NDArray[np.float64]]:
        """Return `keys` with their arrays; each is read when its turn comes."""
        return ItemsView(self)

    def get(self, name: str, default: Any = None) -> Any:
        """Return the array of a name, or `default` where there is none."""
        if name not in self:
            return default
        return self[name]

    def _ipython_key_completions_(self) -> list[str]:
        return list(dict.fromkeys([*self.keys(), *self.quantities, *self.model.channels]))

    @property
    def time(self) -> NDArray[np.float64]:
        """Output times, ndarray, shape (n_times,), s."""
        return self["time"] if "time" in self._reader.quantities else np.zeros(0)

    @property
    def until(self) -> float | None:
        """How far the run came, s: output times may end before.

        Of a run that is not ended, or that was killed, the last output time; None where nothing is
        stored either.
        """
        told: float | None = self.meta.get("end_time")
        return told if told is not None or not self.time.size else float(self.time[-1])

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
        """Return the SI unit of a channel, or of a component of one."""
        quantity, (_, index) = self._quantity(name), split_component(name)
        if index is None:
            return quantity.unit
        return component_units(quantity.unit, quantity.size)[index]

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
        names = self.channels if channels is None else require_names(channels)
        states = [name for name in names if name in STATE and name != "time"]
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

    def rows(
        self, first: int, count: int, channels: Sequence[str] | None = None
    ) -> dict[str, NDArray[np.float64]]:
        r"""Return channels at some of the output times, without reading the others.

        Parameters
        ----------
        first, count : int
            The first output time, counted from 0, and how many; what lies beyond the last is left
            out.
        channels : sequence of str, optional
            Names, without components. The stored ones when none are given.

        Returns
        -------
        dict of str to ndarray, shape (at most count, \*shape)

        Raises
        ------
        UsageError
            If a channel is unknown, or a number is negative.
        """
        for name, number in (("first", first), ("count", count)):
            if not isinstance(number, int | np.integer) or number < 0:
                text = f"`{name}` is {quoted(repr(number))}"
                raise UsageError(text, help="rows are counted from 0: pass a whole number")
        stored = self._reader.quantities
        names = self.channels if channels is None else require_names(channels)
        if not stored:  # the run ended before its first row
            return {name: self[name] for name in names}
        found = {name: self._reader.rows(name, first, count) for name in names if name in stored}
        others = [name for name in names if name not in stored]
        if others:
            states = {n: self._reader.rows(n, first, count) for n in STATE if n in stored}
            found |= self.model.evaluate(others, states)
        return found

    def at(self, times: ArrayLike, channels: Sequence[str] | None = None) -> Self:
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
        names = self.channels if channels is None else self.model.expand(channels)
        names = list(dict.fromkeys(split_component(name)[0] for name in names))
        states = [name for name in STATE if name in self._reader.quantities and name != "time"]
        parts = self.sample(wanted, [*states, *names])
        memory = Memory(self.meta, self.model.channels)
        if wanted.size:
            rows = {name: parts[name] for name in ("time", *states)}
            memory.append(rows | {"channels": {name: parts[name] for name in names}})
        return type(self)(memory, self._model)

    @property
    def span(self) -> tuple[float, float] | None:
        """First and last time (s) between which any state can be computed.

        None where the run has no steps, or was made without ``dense_output``.
        """
        return self._reader.dense_span

    def expand(self, patterns: Iterable[str]) -> list[str]:
        """Return the channels meant by names and patterns, stored ones or computable."""
        stored = self._reader.quantities
        patterns = require_names(patterns)
        whole = {split_component(pattern)[0] for pattern in patterns}
        return expand(patterns, stored if whole <= stored.keys() else self.model.channels)

    def _known(self, whole: str) -> Quantity | None:
        """Return what a name without component means: what is stored, or computable."""
        stored = self._reader.quantities
        if whole in STATE and not stored:  # without rows nothing says how long vectors are
            return undescribed(whole, () if whole == "time" else (0,))
        return stored.get(whole) or self.model.channels.get(whole)

    def _quantity(self, name: str) -> Quantity:
        whole, index = split_component(require_name(name))
        quantity = self._known(whole)
        if quantity is None:
            known = [*self._reader.quantities, *self.model.channels]
            tip = did_you_mean(nearest_channels(whole, known), LISTED)
            if is_from_end(whole):
                tip = FROM_ZERO
            elif is_pattern(whole):
                expand([name], self.model.channels)  # refuses a pattern that means nothing
                tip = "a pattern means several: `Result.expand([pattern])` lists them"
            raise unknown(name, tip)
        if index is not None:
            expand([name], {whole: quantity})  # refuses components that are not there
        return quantity
