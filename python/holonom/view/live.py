"""A run watched while it goes on: its page, to which rows come as they are computed."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holonom.channels import component_units, components
from holonom.store.layout import STATE
from holonom.view.encoding import floats, limits
from holonom.view.motion import BYTES_PER_KNOT, KNOT_BYTES, Poses, Way, pose_names, poses_of
from holonom.view.scene import mechanism, moved, roads
from holonom.view.server import HTML, JSON, Answer, Server

if TYPE_CHECKING:
    from holonom.model import Model

Array = NDArray[np.float64]

#: Bytes of a number of a channel.
_NUMBER = 4
#: Shown until the first rows are there.
_WAITING = b"""<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0.5">
<link rel="icon" href="data:,">
<title>Holonom</title><p style="font: 14px system-ui; margin: 2em">The run begins ...</p>"""
#: Seconds that the end of the run waits for a page to take the last rows.
LAST_ROWS = 2.0


class Live:
    """Serves the page of a run that goes on, on this machine alone.

    Parameters
    ----------
    model : Model
    end_time : float, optional
        When the run will end, s: how far bodies will get decides what the camera follows.
    """

    def __init__(self, model: Model, end_time: float | None = None) -> None:
        self._model = model
        self._end = end_time
        self._lock = threading.Lock()
        self._times = np.empty(0)
        self._poses: Poses | None = None
        self._channels: dict[str, Array] = {}
        #: Counts how often rows were taken away: a page then takes all again.
        self._generation = 0
        self._status = "running"
        self._taken = threading.Event()
        self._watched = False
        self._server = Server(self._get)
        self.address = self._server.address

    def append(self, rows: Mapping[str, Any]) -> None:
        """Take rows of the run: states and channels."""
        if not len(rows["time"]):
            return
        states = {name: rows[name] for name in STATE if name in rows}
        model = self._model
        poses = poses_of(model, model.evaluate(pose_names(model), states))
        with self._lock:
            if self._times.size and rows["time"][0] <= self._times[-1]:
                self._keep(slice(0, int(np.searchsorted(self._times, rows["time"][0]))))
            self._times = np.concatenate([self._times, rows["time"]])
            if self._poses is not None:
                poses = Poses(*map(np.concatenate, zip(self._poses, poses, strict=True)))
            self._poses = poses
            for name, values in rows["channels"].items():
                flat = np.asarray(values, dtype=float).reshape(len(rows["time"]), -1)
                self._channels[name] = np.concatenate([self._channels.get(name, flat[:0]), flat])
            width = BYTES_PER_KNOT * poses.place.shape[1]
            width += _NUMBER * sum(values.shape[1] for values in self._channels.values())
            while self._times.size * width > 2 * KNOT_BYTES:
                self._keep(slice(None, None, 2))

    def finish(self, status: str) -> None:
        """Say how the run ended, and wait until a page that watches has its last rows."""
        with self._lock:
            self._status = status
            self._taken.clear()
        if self._watched:
            self._taken.wait(LAST_ROWS)

    def close(self) -> None:
        """End the server."""
        self._server.close()

    def _keep(self, kept: slice) -> None:
        """Keep some rows; pages then take all again."""
        self._times = self._times[kept]
        if self._poses is not None:
            self._poses = Poses(*(part[kept] for part in self._poses))
        self._channels = {name: values[kept] for name, values in self._channels.items()}
        self._generation += 1

    def _ways(self) -> list[Way]:
        """Return every row as a knot of every body."""
        poses = self._poses
        if poses is None:
            return []
        bodies = range(poses.place.shape[1])
        return [Way(self._times, *(part[:, k] for part in poses)) for k in bodies]

    def _get(self, path: str, query: dict[str, str]) -> Answer:
        if path == "":
            return HTML, self._page()
        if path != "rows":
            return None
        try:
            since, generation = int(query["since"]), int(query["generation"])
        except (KeyError, ValueError):
            return None
        with self._lock:
            answer = self._rows(max(0, since), generation)
            ended = self._status != "running"
        self._watched = True
        content = json.dumps(answer, allow_nan=False).encode()
        if ended:
            self._taken.set()
        return JSON, content

    def _page(self) -> bytes:
        from holonom.view import page

        with self._lock:
            if not self._times.size:
                return _WAITING
            model = self._model
            items = json.loads(model.to_json(plain=True))
            run = {
                "title": model.title or model.name,
                "name": model.name,
                "file": "",
                "status": self._status,
                "completed": False,
                "method": "",
                **mechanism(model, items, self._times, self._ways()),
                "channels": [
                    {
                        "name": name,
                        "item": name.partition(".")[0],
                        "quantity": name.partition(".")[2],
                        "unit": model.channels[name].unit,
                        "frame": model.channels[name].frame,
                        "asked": True,
                        "components": components(name, values.shape[1]),
                        "units": component_units(model.channels[name].unit, values.shape[1]),
                        **self._curves(values, 0),
                    }
                    for name, values in self._channels.items()
                ],
            }
            run["follow"] = self._follow(run["size"])
            run["generation"] = self._generation
        return page([run], live=True).encode()

    def _rows(self, since: int, generation: int) -> dict[str, Any]:
        whole = generation != self._generation
        since = 0 if whole else since
        return {
            "generation": self._generation,
            "whole": whole,
            "status": self._status,
            "times": floats(self._times[since:] - self._times[:1]),
            "bodies": [
                moved(way.after(since), way.place[0], self._times[0]) for way in self._ways()
            ],
            "channels": [self._curves(values, since) for values in self._channels.values()],
            "roads": roads(self._model, self._ways()) if self._times.size > since else [],
        }

    def _curves(self, values: Array, since: int) -> dict[str, Any]:
        low, high = limits(values)
        return {**floats(values[since:]), "low": low.tolist(), "high": high.tolist()}

    def _follow(self, size: float) -> int | None:
        """Return the body to follow: the heaviest one, if it will get far at its present pace."""
        geometry = self._model.geometry["bodies"]
        if not geometry or self._end is None or self._times.size < 2:
            return None
        heaviest = max(range(len(geometry)), key=lambda k: float(geometry[k]["mass"]))
        place = self._ways()[heaviest].place
        pace = np.linalg.norm(place[-1] - place[0]) / (self._times[-1] - self._times[0])
        return heaviest if pace * (self._end - self._times[0]) > 1.2 * size else None
