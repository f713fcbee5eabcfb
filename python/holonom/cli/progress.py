"""Bars and lines on a terminal that show how far long work is; nothing elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress

    from holonom.model import Model


class RunProgress:
    """A bar on a terminal; nothing elsewhere."""

    def __init__(
        self, model: Model, end_time: float | None, *, certify: bool = False, shown: bool
    ) -> None:
        self._certify = certify
        self._steps = 0
        self._runs = 0
        self._end = 0.0 if end_time is None else end_time
        self._start: float | None = None
        self._name = model.name
        self._shown = shown and sys.stderr.isatty()
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> RunProgress | None:
        if not self._shown:
            return None
        self._bar = _bar()
        self._bar.start()
        self._task = self._bar.add_task(self._name, total=None, text="assembling")
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def stage(self, name: str) -> None:
        """Show what is done before the first step."""
        if self._start is None:
            self._bar.update(self._task, text=name, refresh=True)

    def run(self, time: float, step_size: float, steps: int) -> None:
        """Show where the run is."""
        if self._start is None:
            self._start = time
        self._runs += self._runs == 0 or (steps == 0 and self._steps > 0)
        self._steps = steps
        name = f"{self._name}, run {self._runs} of 2" if self._certify else self._name
        self._bar.update(
            self._task,
            description=name,
            completed=time - self._start,
            total=max(self._end - self._start, 0.0) or None,
            text=f"t {time:.4f} / {self._end:g} s, h {step_size:.1e} s, {steps} steps",
            refresh=True,
        )


class Stages:
    """A line on a terminal that says what is done, from one second on."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._begun = time.monotonic()
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> Callable[[str], None] | None:
        return self._update if sys.stderr.isatty() else None

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _update(self, stage: str) -> None:
        if self._bar is None:
            if time.monotonic() - self._begun < 1.0:
                return
            self._bar = _bar()
            self._bar.start()
            self._task = self._bar.add_task(self._name, total=None, text=stage)
        self._bar.update(self._task, text=stage, refresh=True)


class CountedProgress:
    """A bar on a terminal over things that are counted; nothing elsewhere.

    Parameters
    ----------
    name : str
    things : str
        What is counted.
    begun : str
        What is done before the first of them.
    shown : bool
    """

    def __init__(self, name: str, things: str, begun: str, *, shown: bool) -> None:
        self._bar: Any = _bar() if shown and sys.stderr.isatty() else None
        self._name, self._things, self._begun = name, things, begun

    def __enter__(self) -> Callable[..., None] | None:
        if self._bar is None:
            return None
        self._bar.start()
        self._task = self._bar.add_task(self._name, total=None, text=self._begun)
        return self._update

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _update(self, done: float, total: int, *more: str) -> None:
        text = ", ".join([f"{int(done)} / {total} {self._things}", *more])
        self._bar.update(self._task, completed=done, total=total, text=text, refresh=True)


def _bar() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TextColumn("{task.fields[text]}"),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        auto_refresh=False,
    )
