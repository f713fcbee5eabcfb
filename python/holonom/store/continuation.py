"""Runs that go on from a result: whether their rows belong behind its own, and what they say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom import _core
from holonom.base import files
from holonom.base.errors import FileError
from holonom.certificate import Certification
from holonom.store.layout import STATE
from holonom.store.reader import Reader
from holonom.store.writer import Rewind

if TYPE_CHECKING:
    from holonom.model import Model

State = Mapping[str, NDArray[np.float64]]

#: What a result in parts says while the last one is written; the parts before have their own.
GOING_ON: dict[str, Any] = {"status": "running", "stop_reason": None, "end_time": None}

#: Options that change no number of a run.
_FREE = ("start_time", "max_steps", "max_seconds", "threads")

#: What describes the whole up to the last part beside statistics, for one that is taken up.
_OF_PARTS = ("residuals", "energy", "limited_by", "cpu_seconds", "warnings")

#: Statistics that are not summed over the parts of a result.
_EXTREMES = {"smallest_step": min, "largest_step": max, "largest_contraction": max}
#: Those that are means, with the number of what they are means of.
_MEANS = {"mean_contraction": "contractions"}
#: The processor time per time that was simulated, in the statistics and beside them.
_RATE = "cpu_seconds_per_simulated_second"


def destination(
    model: Model,
    chosen: Mapping[str, Any],
    state: State | None,
    output: Path,
    source: Path | None,
    *,
    alone: bool,
) -> tuple[Path, Reader | None]:
    """Return the file of a run, and the result there that it goes on from.

    A run from the last state of the result at `output` is appended to it. One from another of its
    states, or with another model or other channels, takes a new name, so that no row is lost.

    Parameters
    ----------
    model : Model
    chosen : mapping
        Options of the run.
    state : mapping or None
        What it starts from.
    output : Path
        The file asked for.
    source : Path or None
        The result that the state is from, where known.
    alone : bool
        Whether the run needs a file of its own.
    """
    if state is None or not files.same_file(output, output):
        return output, None
    try:
        older = Reader.open(output)
    except FileError:
        if files.same_file(source, output):
            raise
        return output, None  # whatever it is, the writer says whether it may be replaced
    if not (files.same_file(source, output) or _holds(older, state)):
        older.close()
        return output, None
    channels = {name for name in older.quantities if name not in STATE}
    fits = older.meta.get("model_hash") == model.hash and channels == set(chosen["channels"])
    if fits and not alone and older.count and _is_row(older, older.count - 1, state):
        return output, older
    older.close()
    return files.numbered(output), None


def begun(older: Reader) -> float:
    """Return the first time (s) of a result, or of the last of the runs that it is made of."""
    parts = older.meta.get("parts") or []
    return float(parts[-1]["until"]) if parts else start_time(older.meta)


def start_time(meta: Mapping[str, Any]) -> float:
    """Return the first time (s) of a result."""
    return float((meta.get("options") or {}).get("start_time") or 0.0)


def rewind(older: Reader, chosen: Mapping[str, Any]) -> Rewind | None:
    """Return where a result is taken up by a run that is to go on from its last row.

    A run that was killed or interrupted, or whose disk was full, goes on as if nothing had
    happened, if its options are `chosen`, resolved for a run from where it has `begun`. None if it
    ended otherwise, or is of other options or of another version: then the last row is a start
    like any other.
    """
    meta, place = older.meta, older.checkpoint
    is_whole = not meta.get("parts")
    # Of those that failed, only ones whose rows could not be stored have a checkpoint.
    stopped = meta.get("status") in ("killed", "failed")
    # Of a part the description of those before it is needed, which earlier versions did not keep.
    known = is_whole or "energy" in meta["parts"][-1]
    stopped |= meta.get("status") == "interrupted" and known
    if place is None or not stopped or meta.get("holonom") != _core.version():
        return None
    found, asked = (
        {k: v for k, v in options.items() if k not in _FREE}
        for options in (meta.get("options") or {}, chosen)
    )
    if found != asked or not 0 <= place["chunk"] <= older.last_chunk["id"]:
        return None
    return Rewind(place["chunk"], place["text"], is_whole)


def before_part(older: Mapping[str, Any]) -> dict[str, Any]:
    """Return the description of a result without its last part."""
    last = older["parts"][-1]
    return {**older, **{key: last[key] for key in ("statistics", *_OF_PARTS) if key in last}}


def first_state(older: Reader, place: Rewind) -> dict[str, NDArray[np.float64]] | None:
    """Return the state that the last part of a result began with; None if that was the model's."""
    if place.is_whole:
        return None
    chunk = older.chunk(place.chunk)
    return older.row(chunk["first"] + chunk["count"] - 1)


def merged(older: Mapping[str, Any], newer: Mapping[str, Any]) -> dict[str, Any]:
    """Return what describes the whole of a result, from that of its parts."""
    whole = dict(newer)
    before, after = older.get("statistics") or {}, newer.get("statistics") or {}
    whole["statistics"] = after | {
        key: value + after[key] for key, value in before.items() if key in after
    }
    for key, choose in _EXTREMES.items():
        # A part without steps has none that is smallest.
        known = [part[key] for part in (before, after) if key in part and part.get("steps")]
        if known:
            whole["statistics"][key] = choose(known)
    for key, number in _MEANS.items():
        if key in before and key in after:
            counts = before.get(number) or 0, after.get(number) or 0
            total = before[key] * counts[0] + after[key] * counts[1]
            whole["statistics"][key] = total / max(sum(counts), 1)
    whole["residuals"] = _largest(older.get("residuals"), newer.get("residuals"))
    energy, former = dict(newer.get("energy") or {}), older.get("energy") or {}
    for key in ("largest_imbalance", "range", "moved"):
        energy |= _largest({key: former.get(key, 0.0)}, energy, (key,))
    if energy and former:
        energy["initial"] = former["initial"]
        energy["imbalance"] += former["imbalance"]
    whole["energy"] = energy
    if older.get("limited_by") and newer.get("limited_by"):
        limits = [older["limited_by"], newer["limited_by"]]
        rejected = _limits(*(found.get("rejected") or {} for found in limits))
        whole["limited_by"] = _limits(*limits) | {"rejected": rejected}
    if older.get("cpu_seconds") is not None and newer.get("cpu_seconds") is not None:
        whole["cpu_seconds"] = older["cpu_seconds"] + newer["cpu_seconds"]
        span = newer["end_time"] - start_time(older)
        whole[_RATE] = whole["cpu_seconds"] / span if span > 0.0 else 0.0
        whole["statistics"][_RATE] = whole[_RATE]
    seen = list(older.get("warnings") or [])
    whole["warnings"] = seen + [w for w in newer.get("warnings") or [] if w not in seen]
    return whole


def _limits(older: Mapping[str, Any], newer: Mapping[str, Any]) -> dict[str, Any]:
    """Return what limited the steps of both: of the coordinate with the most, at least so many.

    How many of its steps another coordinate limited is not known, unless it was the first there.
    """
    first = (older.get("steps") or 0) > (newer.get("steps") or 0)
    most = dict(older if first else newer)
    same = older.get("coordinate") == newer.get("coordinate")
    for key in ("steps", "of") if same else ("of",):
        most[key] = (older.get(key) or 0) + (newer.get(key) or 0)
    return most


def part(meta: Mapping[str, Any], until: float) -> dict[str, Any]:
    """Return what is kept of the description up to a time (s): how the last part of it was run."""
    keys = ("options", "status", "stop_reason", "statistics", "started", "finished", "holonom")
    own = () if meta.get("parts") else ("certification",)
    kept = {key: meta[key] for key in (*keys, *_OF_PARTS, *own) if key in meta}
    return kept | {"until": until}


def continued(older: Mapping[str, Any], until: float, chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a result says of itself from when a run goes on from its last row on.

    Parameters
    ----------
    older : mapping
        What it has said.
    until : float
        The time of that row, s.
    chosen : mapping
        Options of the run.
    """
    meta = {**GOING_ON, "options": {**chosen, "start_time": start_time(older)}}
    meta["parts"] = [*(older.get("parts") or []), part(older, until)]
    if (found := older.get("certification")) is not None:
        meta["certification"] = Certification.from_json(found).continued(until).to_json()
    return meta


def _largest(
    older: Mapping[str, Any] | None, newer: Mapping[str, Any] | None, keys: Iterable[str] = ()
) -> dict[str, Any]:
    first, second = dict(older or {}), dict(newer or {})
    return {
        key: max(first.get(key, second.get(key, 0.0)), second.get(key, first.get(key, 0.0)))
        for key in keys or {**first, **second}
    }


def _holds(older: Reader, state: State) -> bool:
    """Return whether a state is one of a result, at an output time."""
    if not older.count:
        return False
    for index in np.nonzero(older.read("time") == state["time"][0])[0]:
        if _is_row(older, int(index), state):
            return True
    return False


def _is_row(older: Reader, index: int, state: State) -> bool:
    row = older.row(index)
    return all(np.array_equal(row[name], part) for name, part in state.items() if name in row)
