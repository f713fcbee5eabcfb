"""Types of the compiled core. All numbers are SI; text marked JSON holds a JSON document."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

class ModelError(Exception):
    """A model that cannot be used; ``args[0]`` is JSON: ``errors`` and ``rendered``."""

class SimulationError(Exception):
    """A run that cannot start; ``args[0]`` is JSON: ``code``, ``message``, ``time``, …."""

class CoreModel:
    """A validated model."""

    def with_values(self, values_json: str) -> CoreModel:
        """Return the model with other values; JSON maps paths to values."""

    def to_json(self) -> str:
        """Return the merged model text as JSON, with units and expressions as they are written."""

    def to_plain_json(self) -> str:
        """Return the same with patterns written out and plain numbers in SI units."""

    def hash(self) -> str:
        """Return the hash of the merged model text."""

    def defaults(self) -> str:
        """Return JSON: title, dimension, span and tolerance of a run that states none."""

    def geometry(self) -> str:
        """Return JSON: how a model is drawn.

        ``bodies`` in their design configuration, with ``shapes``: ``type``, sizes, ``position`` and
        ``axes`` (rows) in body axes, ``color`` (0 to 255 each, or None) and ``opacity``;
        ``elements``: joints, forces and drivers with their ``frames``: ``body`` (an index, None for
        the ground), ``point`` (m) and ``axes`` (columns) in body axes.
        """

    def road_heights(self, tyre: str, places: list[float]) -> list[float]:
        """Return the height (m) of the road under a tyre at places x (m)."""

    def channels(self) -> list[tuple[str, str, str, list[int]]]:
        """Return name, unit, frame and shape of each."""

    def channel(self, name: str) -> tuple[str, str, list[int]] | None:
        """Return unit, frame and shape of one, without a list of all."""

    def warnings(self) -> str:
        """Return a JSON list of ``code``, ``message``, ``path``."""

    def check(self, spectrum: bool, on_stage: Callable[[str], None] | None) -> str:
        """Return JSON: counts, degrees of freedom, redundancy, adjustments, spectrum."""

    def options(self, choices_json: str, start_time: float | None) -> dict[str, Any]:
        """Return all options of a run with these choices, from a state at ``start_time``."""

    def simulate(
        self,
        options_json: str,
        start: Mapping[str, NDArray[np.float64]] | None,
        on_chunk: Callable[[dict[str, Any]], None],
        on_progress: Callable[[float, float, int], None],
        on_stage: Callable[[str], None],
        checkpoint: str | None = None,
        repeats: bool = False,
    ) -> dict[str, Any]:
        """Run and return a summary; chunks of results go to ``on_chunk``.

        With the entry ``checkpoint`` of a chunk, the run that made it is taken up at the end of
        that chunk: the same chunks follow, to the last bit. A run that `repeats` another one, which
        it is compared with, does not look for what it may be wrong about.

        ``on_progress`` is called between steps, ``on_stage`` also within: what it raises ends the
        run at once.
        """

    def dense_states(
        self, steps: dict[str, Any], times: list[float]
    ) -> dict[str, NDArray[np.float64]]:
        """Compute states at times within the steps of a chunk's entry ``dense``."""

    def evaluate_channels(
        self, names: list[str], state: Mapping[str, NDArray[np.float64]]
    ) -> dict[str, NDArray[np.float64]]:
        """Compute channels from stored states."""

def parse(
    text: str,
    syntax: str,
    name: str,
    read: Callable[[str], str],
    read_bytes: Callable[[str], bytes],
    on_stage: Callable[[str], None] | None,
) -> CoreModel:
    """Read a model; ``syntax`` is ``"toml"`` or ``"json"``.

    ``read`` returns what a model extends, ``read_bytes`` what the file of a mesh holds.
    """

def checksum(parts: list[bytes]) -> int:
    """Return XXH3 (64 bits, signed) over parts, each after its length."""

def schema() -> str:
    """Return the JSON Schema of model files."""

def model_reference() -> str:
    """Return the reference page of model files, in Markdown."""

def methods() -> str:
    """Return a JSON list of ``name``, ``title``, ``family``, ``formula``."""

def find_method(method: str, formula: str | None = None) -> str | None:
    """Return the name of the code that a method and a formula mean, if there is one."""

def diagnostics() -> list[str]:
    """Return the names of the channels that every run stores."""

def version() -> str:
    """Return the version of the core."""

def build() -> str:
    """Return a JSON object: ``profile``, ``target`` and ``simd`` of this build and machine."""
