"""What `Model.check` and ``holonom check`` say about a model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from holonom.base.text import preformatted

#: Modes shown in the text; the data holds all of them.
MODES_SHOWN = 12


@dataclass(frozen=True, slots=True)
class CheckReport:
    """Counts, redundancy, assembly and stiffness of a model; ``print`` shows it.

    Attributes
    ----------
    name : str
    data : dict
        ``bodies``, ``joints``, ``forces``, ``drivers``, ``coordinates``, ``constraint_rows``,
        ``redundant``, ``dof``, ``extra_states``, ``characteristic_length`` (m), ``adjustments``,
        ``chosen_velocities`` (initial velocities that nothing determines and that are not zero:
        ``coordinate``, ``rate``, ``unit``), ``initial_residuals``, ``spectrum`` (1/s, real and
        imaginary parts; only the fastest of large models, ``spectrum_is_complete`` tells), ``tree``
        (edges of the spanning forest with their relative coordinates and the role of each),
        ``end_time`` (s, of the file), ``accelerations`` (``solver``, whether it is ``stated`` by
        the model, predicted ``operations`` of each solver, ``refusal`` where one cannot be).
    warnings : list of dict
        ``code``, ``message``, ``path``.
    """

    name: str
    data: dict[str, Any]
    warnings: list[dict[str, str]]

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return int(self.data["dof"])

    @property
    def redundant(self) -> list[dict[str, str]]:
        """Redundant constraints, each with ``joint``, ``row`` and, in words, ``direction``."""
        return list(self.data.get("redundant", []))

    @property
    def spectrum(self) -> list[complex]:
        """Eigenvalues of the motion linearized at the initial state, 1/s.

        Of rotors that are the same about their axes they are whirl and precession as seen from
        what carries them, the innermost one of a row. Where another body spins, or one that spins
        and tilts carries what a universal joint or the line of a spring places, or a driver turns
        a rotor about none of the axes from which it is measured, the equations change as it
        turns, and they are those of the moment.
        """
        return [complex(re, im) for re, im in self.data.get("spectrum") or []]

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {"name": self.name, **self.data, "warnings": self.warnings}

    def __repr__(self) -> str:
        counts = f"{self.dof} degree{'' if self.dof == 1 else 's'} of freedom"
        found = f"{len(self.redundant)} redundant, {len(self.warnings)} warnings"
        return f"<holonom.CheckReport {self.name!r}: {counts}, {found}>"

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def __str__(self) -> str:
        lines = [f"{label:<22}{value}" for label, value in self._facts()]
        lines += _spectrum_lines(self.spectrum, self.data.get("spectrum_is_complete") is not False)
        lines += [warning_line(warning) for warning in self.warnings]
        return "\n".join(lines)

    def tree_lines(self) -> list[str]:
        """Return a line per edge of the spanning forest: what places a body against its parent."""
        lines = ["", "spanning tree: what places each body, and its relative coordinates"]
        for edge in self.data.get("tree", []):
            by = "free" if edge["kind"] == "free" else f"{edge['kind']} {edge['item']}"
            coordinates = ", ".join(
                entry["name"] + ("" if entry["role"] == "independent" else f" ({entry['role']})")
                for entry in edge["coordinates"]
            )
            lines.append(f"  {edge['parent']} → {edge['body']}: {by}; {coordinates or 'rigid'}")
        return lines

    def _facts(self) -> list[tuple[str, str]]:
        data = self.data
        facts = [("model", self.name)]
        counted = [
            f"{data[kind]} {kind if data[kind] != 1 else kind.removesuffix('s').replace('ie', 'y')}"
            for kind in ("bodies", "joints", "forces", "drivers")
            if kind in data
        ]
        facts.append(("items", ", ".join(counted)))
        for key, label in (
            ("coordinates", "coordinates"),
            ("constraint_rows", "constraint rows"),
            ("loops", "closed loops"),
            ("dof", "degrees of freedom"),
            ("extra_states", "extra states"),
        ):
            if key in data:
                facts.append((label, str(data[key])))
        if "characteristic_length" in data:
            facts.append(("characteristic length", f"{data['characteristic_length']:.4g} m"))
        if accelerations := data.get("accelerations"):
            facts += _acceleration_facts(accelerations)
        if joint := data.get("joint_coordinates"):
            rows = f"{joint['rows']} rows of cut joints and drivers"
            facts.append(("joint coordinates", f"{joint['coordinates']} along the tree, {rows}"))
        redundant = [f"{entry['joint']}: {entry['direction']}" for entry in self.redundant]
        facts.append(("redundant constraints", str(len(redundant)) if redundant else "none"))
        facts += [("", entry) for entry in redundant]
        if "end_time" in data and data["end_time"] is None:
            facts.append(("end time", "not stated: a run has to be given one"))
        facts += [("moved by assembly", plain(entry)) for entry in data.get("adjustments") or []]
        if residuals := data.get("initial_residuals"):
            facts.append(("initial residuals", plain(residuals)))
        return facts


def plain(entry: object) -> str:
    """Return a record of the core as one line."""
    if isinstance(entry, Mapping):
        return ", ".join(f"{key} {plain(value)}" for key, value in entry.items())
    if isinstance(entry, list | tuple):
        return "(" + ", ".join(map(plain, entry)) + ")"
    return f"{entry:.3g}" if isinstance(entry, float) else str(entry)


#: What each way to accelerations solves.
_SOLVERS = {
    "recursive": "recursion along the tree",
    "null_space": "null space",
    "reduced": "reduced matrix",
    "augmented": "augmented matrix",
}


def _acceleration_facts(data: Mapping[str, Any]) -> list[tuple[str, str]]:
    costs = sorted(
        (cost, solver) for solver, cost in data["operations"].items() if cost is not None
    )
    predicted = ", ".join(f"{_SOLVERS[solver]} {cost:,.0f}" for cost, solver in costs)
    why = "stated by the model" if data["stated"] else "fewest operations predicted"
    facts = [
        ("accelerations", f"{_SOLVERS[data['solver']]}, {why}"),
        ("", f"operations: {predicted}"),
    ]
    if data.get("refusal"):
        facts.append(("", f"not all solvers serve: {data['refusal']}"))
    return facts


def warning_line(warning: Mapping[str, str]) -> str:
    """Return a warning as one line."""
    place = f"{warning['path']}: " if warning.get("path") else ""
    return f"warning: {place}{warning.get('message', '')} [{warning.get('code', '')}]"


def _spectrum_lines(spectrum: list[complex], complete: bool) -> list[str]:
    if not spectrum:
        return (
            [] if complete else ["", "stiffness spectrum: the fastest eigenvalues did not settle"]
        )
    # One line per mode: of a conjugate pair the member with positive frequency.
    modes = sorted((z for z in spectrum if z.imag >= 0.0), key=abs, reverse=True)
    lines = [
        "",
        "stiffness spectrum at the initial state: "
        + ("eigenvalues, fastest first" if complete else "the fastest eigenvalues"),
        f"{'real part 1/s':>14} {'frequency Hz':>14} {'damping ratio':>14}",
    ]
    for z in modes[:MODES_SHOWN]:
        # What is round-off beside the magnitude is zero.
        real = z.real if abs(z.real) > 1e-9 * abs(z) else 0.0
        ratio = f"{-real / abs(z) + 0.0:.3f}" if z else "–"
        lines.append(f"{real + 0.0:14.4g} {z.imag / (2.0 * math.pi):14.4g} {ratio:>14}")
    if len(modes) > MODES_SHOWN:
        lines.append(f"{'…':>14} {len(modes) - MODES_SHOWN} slower modes, with --json")
    moving = [abs(z) for z in modes if abs(z) > 1e-6 * abs(modes[0])]
    if any(z.real > 1e-6 * abs(modes[0]) for z in modes):
        lines.append(
            "real parts above 0: deviations grow at this instant; only of an equilibrium does\n"
            "that make the motion unstable, not where bodies turn or accelerate"
        )
    if complete and len(moving) > 1:
        lines.append(f"fastest to slowest: {moving[0] / moving[-1]:.3g}")
    return lines
