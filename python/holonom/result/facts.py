"""What is known about a run, apart from its arrays: how it was made, how it went, how it ended."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from holonom.base.errors import FileError
from holonom.base.names import listed
from holonom.base.record import Record
from holonom.base.text import quoted
from holonom.certificate import Certification
from holonom.model import Model
from holonom.options import PARTS
from holonom.store.memory import Stored
from holonom.store.reader import Reader


class _Columns(dict[str, NDArray[Any]]):
    """Columns of a log; a name that is none is refused with those that there are."""

    def __missing__(self, name: object) -> NDArray[Any]:
        raise KeyError(f"there is no column {quoted(str(name))}; there are {listed(self)}")


def _loosest(tolerances: Iterable[float | Mapping[str, float]]) -> dict[str, float]:
    """Return the largest of each part of tolerances; one number is that of all parts."""
    each = [t if isinstance(t, Mapping) else dict.fromkeys(PARTS, t) for t in tolerances]
    return {name: max(t[name] for t in each if name in t) for name in dict.fromkeys(chain(*each))}


class Facts:
    """What a result says of its run.

    Parameters
    ----------
    reader : Reader or Memory
    model : Model, optional
        The model that was run, where it is at hand.

    Attributes
    ----------
    continued : bool
        Whether the run that returned it went on from what its file held before; False of one that
        was loaded.
    """

    continued: bool = False

    def __init__(self, reader: Stored, model: Model | None = None) -> None:
        self._reader = reader
        self._model = model

    @property
    def damage(self) -> list[str]:
        """Parts of the file that were found damaged so far; always empty without ``recover``."""
        return list(getattr(self._reader, "damage", []))

    def verify(self) -> list[str]:
        """Read all of the file, and return `damage`, which then names every part that is lost.

        Raises
        ------
        FileError
            ``result/damaged``, at the first one, without ``recover``.
        """
        if isinstance(self._reader, Reader):
            self._reader.verify()
        return self.damage

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
            model = dict(self.meta["model"])
            steps = dict(model.get("simulation") or {})
            if "fixed_step" in steps:
                # Earlier versions took them beside it, and did nothing by them.
                unused = ("max_step", "initial_step")
                model["simulation"] = {k: v for k, v in steps.items() if k not in unused}
            text = json.dumps(model, ensure_ascii=False)
            name = str(self.meta.get("name", "model"))
            self._model = Model.from_text(text, "json", name)
        return self._model

    @property
    def written_out(self) -> dict[str, Any]:
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
    def limited_by(self) -> Record:
        """What limited the steps: ``coordinate``, ``steps``, ``of``, ``rejected``; perhaps empty.

        ``docs/conventions.md`` says what each of them counts.
        """
        return Record(self.meta.get("limited_by") or {})

    @property
    def warnings(self) -> list[dict[str, str]]:
        """Warnings of the model and of the run."""
        return list(self.meta.get("warnings") or [])

    @property
    def certification(self) -> Certification | None:
        """Measured error of every channel, if the run was made with ``certify=True``.

        Of a certified result that was continued it is what was measured before, and ``certified``
        is False: the whole is not. The first of ``meta["parts"]`` has it as it was.
        """
        data = self.meta.get("certification")
        if data is None:
            return None
        found, parts = Certification.from_json(data), self.meta.get("parts")
        return found.continued(parts[0]["until"]) if parts else found

    @property
    def options(self) -> dict[str, Any]:
        """What the run used: the choices stated, the rest from the model or by default.

        Of a result in parts those of the last one, but for ``start_time``, that of the first, and
        ``tolerance``, the loosest of all, part by part: nothing closer can be asked of the whole.
        """
        options = dict(self.meta.get("options") or {})
        parts = [part.get("options") or {} for part in self.meta.get("parts") or []]
        stated = [run["tolerance"] for run in (*parts, options) if "tolerance" in run]
        if parts and stated:
            options["tolerance"] = _loosest(stated)
        return options

    @property
    def steps(self) -> dict[str, NDArray[Any]]:
        """The log of attempted steps, by column, each ndarray of shape (n_steps,).

        ``t``, ``h`` (s): start and size; ``error``: 1 is on tolerance; ``accepted``: 1 or 0;
        ``cause``: of a rejection; ``iterations``: of Newton's method.
        """
        return _Columns(self._reader.steps())

    @property
    def step_totals(self) -> list[tuple[bool, str, int, float, float, float]]:
        """Attempts by outcome: accepted or not, cause, count, smallest, largest, mean size (s)."""
        return self._reader.step_totals()

    @property
    def events(self) -> list[dict[str, Any]]:
        """Events in the order in which they happened."""
        return self._reader.events()
