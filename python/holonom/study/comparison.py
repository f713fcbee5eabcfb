"""What a comparison of methods found: rows, tables, CSV, JSON and the diagram."""

from __future__ import annotations

import io
import math
import statistics
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from holonom.base import files
from holonom.base.errors import Interrupted, UsageError
from holonom.base.names import did_you_mean, listed, nearest
from holonom.base.plain import as_path
from holonom.base.text import preformatted, quoted
from holonom.options import Tolerance
from holonom.study.accuracy import ComponentError, Kind

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.table import Table

    from holonom.pictures.picture import Picture

#: Counts of work in the order of reading, with their headings.
COUNTS = {
    "steps": "steps",
    "rejected": "rejected",
    "evaluations": "evalu-\nations",
    "jacobians": "Jaco-\nbians",
    "factorizations": "factor-\nizations",
    "iterations": "itera-\ntions",
}
#: Width of tables where there is no terminal.
WIDTH = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One method at one tolerance.

    Attributes
    ----------
    method : str
        Code, with the choices that it was given: ``ForSDIRK jacobian=differences``.
    choices : dict
        The same as options of a run.
    tolerance : Tolerance
    status : str
        ``completed``, ``failed``, ``limit``, or ``refused``: the options do not fit the method.
    code, message : str
        Why it did not complete; empty otherwise.
    counts : dict of str to int
        Work of the run: ``steps`` are accepted ones, ``rejected`` the others, by cause in
        ``rejected_error``, ….
    cpu_samples : tuple of float
        Processor time of the core in each timed run, s; these ran one after the other. None of
        a run that did not complete.
    errors : tuple of ComponentError
        Error of every scalar; empty when the run did not complete.
    """

    method: str
    choices: dict[str, Any]
    tolerance: Tolerance
    status: str
    code: str = ""
    message: str = ""
    counts: dict[str, int] = field(default_factory=dict)
    cpu_samples: tuple[float, ...] = ()
    errors: tuple[ComponentError, ...] = ()

    @property
    def cpu_seconds(self) -> float | None:
        """Processor time of the core, s: the median of the timed runs; None without any."""
        return statistics.median(self.cpu_samples) if self.cpu_samples else None

    @property
    def measure(self) -> float | None:
        """Largest error over tolerance, over output times and scalars: 1 is on tolerance."""
        return max((error.scaled for error in self.errors), default=None)

    @property
    def worst(self) -> ComponentError | None:
        """The scalar that is farthest from the reference by `measure`."""
        return max(self.errors, key=lambda error: error.scaled, default=None)

    def __repr__(self) -> str:
        facts = [self.status]
        facts += [f"{self.counts['steps']} steps"] if "steps" in self.counts else []
        facts += [] if self.measure is None else [f"{self.measure:.3g} tolerances off"]
        return f"<{self.method} at {_limit(self.tolerance)}: {', '.join(facts)}>"

    def measure_of(self, kind: Kind) -> float | None:
        """Return `measure` over positions, velocities or other scalars; None without any."""
        return max((e.scaled for e in self.errors if e.kind == kind), default=None)

    def error_of(self, kind: Kind) -> float | None:
        """Return the largest error of positions (m, rad) or velocities (m/s, rad/s)."""
        return max((e.delta for e in self.errors if e.kind == kind), default=None)

    def rejections(self) -> dict[str, int]:
        """Return the number of rejected steps by cause, causes that occurred only."""
        start = "rejected_"
        return {
            name.removeprefix(start): count
            for name, count in self.counts.items()
            if name.startswith(start) and count
        }

    def to_json(self) -> dict[str, Any]:
        """Return the row as plain data."""
        worst = self.worst
        return {
            "method": self.method,
            "choices": self.choices,
            "tolerance": asdict(self.tolerance),
            "status": self.status,
            "code": self.code,
            "message": self.message,
            "position_error": self.error_of("position"),
            "velocity_error": self.error_of("velocity"),
            "measure": self.measure,
            "position_measure": self.measure_of("position"),
            "velocity_measure": self.measure_of("velocity"),
            "worst": None if worst is None else worst.name,
            "cpu_seconds": self.cpu_seconds,
            "cpu_samples": list(self.cpu_samples),
            **{name: self.counts.get(name) for name in COUNTS},
            "rejected_by_cause": self.rejections(),
            "errors": [asdict(error) for error in self.errors],
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """What the runs were compared with.

    Attributes
    ----------
    method : str
    tolerance : dict
        ``relative``, ``translation`` (m; m/s), ``rotation`` (rad; rad/s).
    path : str
        Its result file; empty for a run made on the spot.
    steps : int or None
    check_method : str
        The code that repeated the run to check it; empty when none did.
    check_errors : tuple of ComponentError
        How far the check is from the reference, scaled by the tightest tolerance compared.
    """

    method: str
    tolerance: dict[str, float]
    path: str = ""
    steps: int | None = None
    check_method: str = ""
    check_errors: tuple[ComponentError, ...] = field(default=(), repr=False)

    @property
    def difference(self) -> float | None:
        """Largest difference of the check over the tightest tolerance; None without a check."""
        return max((error.scaled for error in self.check_errors), default=None)

    def difference_of(self, kind: Kind) -> float | None:
        """Return the largest difference of positions (m, rad) or velocities (m/s, rad/s)."""
        return max((e.delta for e in self.check_errors if e.kind == kind), default=None)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "method": self.method,
            "tolerance": self.tolerance,
            "path": self.path,
            "steps": self.steps,
            "check_method": self.check_method,
            "check_difference": self.difference,
            "check_position_difference": self.difference_of("position"),
            "check_velocity_difference": self.difference_of("velocity"),
        }

    def __str__(self) -> str:
        if len(set(self.tolerance.values())) == 1:
            limits = f"{self.tolerance['relative']:g}"
        else:
            limits = ", ".join(f"{name} {value:g}" for name, value in self.tolerance.items())
        text = self.method + (f" at {limits}" if limits else "")
        text += f", {self.steps} steps" if self.steps is not None else ""
        text += f", from {self.path}" if self.path else ""
        if self.difference is not None:
            parts = [
                f"{value:.1e} {units}"
                for kind, units in _KINDS.items()
                if units and (value := self.difference_of(kind)) is not None
            ]
            text += f"; {self.check_method} differs from it by "
            text += "; ".join([*parts, f"{self.difference:.1e} of the tightest tolerance"])
        return text


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Methods and tolerances against a reference; ``print`` shows the table.

    Attributes
    ----------
    model, model_hash : str
    rows : tuple of Row
        One for each method and tolerance, methods in the order asked for.
    reference : Reference or None
        None when the comparison was interrupted before there was one.
    channels : tuple of str
        The scalars that are compared.
    start_time, end_time : float
        s.
    n_times : int
        Number of output times at which errors are taken.
    warnings : tuple of str
    interrupted : bool
        Whether Ctrl-C ended it; rows are those that were finished.
    """

    model: str
    model_hash: str
    rows: tuple[Row, ...]
    reference: Reference | None
    channels: tuple[str, ...]
    start_time: float
    end_time: float
    n_times: int
    warnings: tuple[str, ...] = ()
    interrupted: bool = False

    @property
    def methods(self) -> list[str]:
        """Methods in the order of the rows, each once."""
        return list(dict.fromkeys(row.method for row in self.rows))

    def of(self, method: str) -> list[Row]:
        """Return the rows of a method.

        Raises
        ------
        UsageError
            If it was not compared.
        """
        if method not in self.methods:
            near = did_you_mean(nearest(method, self.methods), f"there are {listed(self.methods)}")
            raise UsageError(f"there are no rows of {quoted(method)}", help=near)
        return [row for row in self.rows if row.method == method]

    @property
    def error_label(self) -> str:
        """What `error` is, for tables and axes."""
        return {
            "position": "largest error, m and rad",
            "velocity": "largest error, m/s and rad/s",
            "other": "largest error, relative",
        }[self._kind]

    def error(self, row: Row) -> float | None:
        """Return one number for how far a row is from the reference, free of its tolerance.

        The largest error of positions (m and rad); without positions that of velocities; without
        either `Row.measure` times the relative tolerance.
        """
        if not isinstance(row, Row):
            raise UsageError(f"{quoted(repr(row))} is no row", help="take one of `Comparison.rows`")
        if self._kind != "other":
            return row.error_of(self._kind)
        return None if row.measure is None else row.measure * row.tolerance.relative

    @property
    def doubt(self) -> float | None:
        """How far the reference's check is from it, in the unit of `error`; None without one."""
        if self.reference is None or self._kind == "other":
            return None
        return self.reference.difference_of(self._kind)

    def slopes(self) -> dict[str, float]:
        """Return the log-log slope of `error` against the relative tolerance by method.

        By least squares over the rows that completed; methods with fewer than two tolerances are
        left out. 1 means that the error follows the tolerance.
        """
        slopes = {}
        for method in self.methods:
            points = [
                (math.log10(row.tolerance.relative), math.log10(error))
                for row in self.of(method)
                if (error := self.error(row))
            ]
            if len({x for x, _ in points}) > 1:
                slopes[method] = statistics.linear_regression(*zip(*points, strict=True)).slope
        return slopes

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "model": self.model,
            "model_hash": self.model_hash,
            "reference": None if self.reference is None else self.reference.to_json(),
            "channels": list(self.channels),
            "start_time": self.start_time,
            "end_time": self.end_time,
            "n_times": self.n_times,
            "rows": [row.to_json() for row in self.rows],
            "slopes": self.slopes(),
            "warnings": list(self.warnings),
            "interrupted": self.interrupted,
        }

    def to_csv(self, path: str | Path, *, force: bool = False) -> Path:
        """Write one line per row and return the path; times in s, errors in SI.

        Parameters
        ----------
        path : path
        force : bool
            Whether a file that is no such table may be replaced.

        Raises
        ------
        FileError
            If the file cannot be written, or would replace another one.
        """
        lines = []
        for row in self.rows:
            data = row.to_json()
            data["tolerance"] = row.tolerance.relative
            data |= {f"{part}_tolerance": getattr(row.tolerance, part) for part in _ABSOLUTE}
            data["rejected_by_cause"] = _causes(row)
            lines.append(data)
        head = ["method", "tolerance", *(f"{part}_tolerance" for part in _ABSOLUTE)]
        skipped = {*head, "choices", "cpu_samples", "errors"}
        rest = Row(method="", choices={}, tolerance=Tolerance(1.0), status="").to_json()
        head += [name for name in rest if name not in skipped]
        table = [head, *([line[name] for name in head] for line in lines)]
        return files.write_table(as_path(path), "comparison", table, force=force)

    def errors_to_csv(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the error analysis, one line per row and scalar, and return the path.

        Parameters and errors are those of `to_csv`.
        """
        head = list(ComponentError.__dataclass_fields__)
        lines = (
            [row.method, row.tolerance.relative, *(getattr(error, name) for name in head)]
            for row in self.rows
            for error in row.errors
        )
        table = [["method", "tolerance", *head], *lines]
        return files.write_table(as_path(path), "comparison", table, force=force)

    def plot(self, path: str | Path | None = None, *, force: bool = False) -> Picture:
        """Draw the work-precision diagram: `error` against processor time, a line per method.

        Parameters
        ----------
        path : path, optional
            Picture file to write: SVG, or with matplotlib PDF or PNG, by its ending.
        force : bool
            Whether a file that is no picture by Holonom may be replaced.

        Raises
        ------
        UsageError
            If nothing completed, or the format is not known or needs matplotlib, which is not
            installed.
        """
        from holonom.pictures import runs as pictures

        picture = pictures.work_precision(self)
        if path is not None:
            picture.save(as_path(path), force=force)
        return picture

    def table(self) -> Table:
        """Return the rows as a table of `rich`."""
        table = _table()
        table.add_column("method")
        kinds = [
            kind for kind in _KINDS if any(row.measure_of(kind) is not None for row in self.rows)
        ]
        causes = list(dict.fromkeys(cause for row in self.rows for cause in row.rejections()))
        headings = ["tol."]
        for kind in kinds:
            headings += [f"error\n{_KINDS[kind]}"] if kind != "other" else []
            headings.append("error\n/ tol.")
        headings += [*COUNTS.values(), "cpu\nms"]
        place = headings.index(COUNTS["rejected"]) + 1
        headings[place:place] = [f"by\n{cause}" for cause in causes] if len(causes) > 1 else []
        for heading in headings:
            table.add_column(heading, justify="right")
        for row in self.rows:
            cells = []
            for kind in kinds:
                cells += [_error(row.error_of(kind))] if kind != "other" else []
                cells.append(_ratio(row.measure_of(kind)))
            if cells and row.status != "completed":
                cells[0] = row.status
            for name in COUNTS:
                cells.append(str(row.counts.get(name, "")))
                if name == "rejected" and len(causes) > 1:
                    cells += [str(row.rejections().get(cause, "")) for cause in causes]
            seconds = row.cpu_seconds
            cells.append("" if seconds is None else f"{1e3 * seconds:.3g}")
            last = row is self.of(row.method)[-1]
            table.add_row(row.method, _limit(row.tolerance), *cells, end_section=last)
        return table

    def error_table(self) -> Table:
        """Return the thesis's error analysis as a table of `rich`, scalar by scalar."""
        table = _table()
        for heading in ("scalar", "method"):
            table.add_column(heading)
        for heading in ("tolerance", "t*, s", "Δ", "RelErr, %", "average error", "Δ/tol."):
            table.add_column(heading, justify="right")
        for number, name in enumerate(self.channels):
            for row in self.rows:
                if not row.errors:
                    continue
                error = row.errors[number]
                table.add_row(
                    f"{name}, {error.unit}" if error.unit else name,
                    row.method,
                    _limit(row.tolerance),
                    f"{error.time:.4g}",
                    _error(error.delta),
                    _ratio(error.relative) or "–",
                    _error(error.mean),
                    _ratio(error.scaled),
                )
        return table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield self._heading()
        if self.rows:
            yield self.table()
        if slopes := self.slopes():
            text = ", ".join(f"{method} {slope:.2f}" for method, slope in slopes.items())
            yield f"slope of error against tolerance: {text}"
        for row in self.rows:
            if row.status != "completed":
                code = f" [{row.code}]" if row.code and row.code not in row.message else ""
                text = row.message.partition("\n")[0]
                yield f"{row.method} at {_limit(row.tolerance)} {row.status}: {text}{code}"
        for warning in self.warnings:
            yield f"warning: {warning}"

    def __repr__(self) -> str:
        return (
            f"<holonom.Comparison of {self.model!r}: {len(self.methods)} methods, "
            f"{len(self.rows)} rows, {len(self.channels)} scalars>"
        )

    def __str__(self) -> str:
        return as_text(self)

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def _heading(self) -> str:
        count = f"{len(self.channels)} scalar{'' if len(self.channels) == 1 else 's'}"
        return (
            f"{self.model}, {self.start_time:g} to {self.end_time:g} s: {count} at "
            f"{self.n_times} times\nreference: {self.reference or 'none'}"
        )

    @property
    def _kind(self) -> Kind:
        for row in self.rows:
            for kind in _KINDS:
                if row.error_of(kind) is not None:
                    return kind
        return "position"


class ComparisonInterrupted(Interrupted):
    """A comparison that Ctrl-C ended; `comparison` holds the rows that were finished."""

    def __init__(self, comparison: Comparison) -> None:
        super().__init__(
            {
                "code": "simulation/interrupted",
                "message": "the comparison was interrupted",
                "help": "`comparison` of this error holds the rows that were finished",
            }
        )
        self.comparison = comparison


#: Kinds of scalars with the headings of their errors.
_KINDS: dict[Kind, str] = {"position": "m, rad", "velocity": "m/s, rad/s", "other": ""}
_ABSOLUTE = ("translation", "rotation")


def as_text(renderable: Any) -> str:
    """Return something of `rich` as plain text."""
    from rich.console import Console

    file = io.StringIO()
    Console(file=file, width=WIDTH, color_system=None, highlight=False, markup=False).print(
        renderable
    )
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


def _table() -> Table:
    from rich import box
    from rich.table import Table

    return Table(box=box.SIMPLE_HEAD, pad_edge=False)


def _error(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _limit(tolerance: Tolerance) -> str:
    short = f"{tolerance.relative:.0e}"
    return short if float(short) == tolerance.relative else f"{tolerance.relative:g}"


def _causes(row: Row) -> str:
    return ", ".join(f"{cause} {count}" for cause, count in row.rejections().items())
