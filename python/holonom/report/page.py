"""The page about a run, in the order in which an engineer reads it.

What moved, the channels asked for, their extrema; then the model with its parameters, warnings and
the measured error; then, folded, how it was computed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from holonom.base import files
from holonom.base.errors import HolonomError
from holonom.base.text import escape
from holonom.check import plain
from holonom.pictures import runs as pictures
from holonom.report.figures import Figures, packed
from holonom.report.graph import graph
from holonom.report.tables import card, extrema, flat, grid, measured, parameters, table
from holonom.summary import STATUS, largest_imbalance, simulated, summarize

if TYPE_CHECKING:
    from holonom.result import Result

#: Bodies drawn when the run was asked for no channels.
BODIES_DRAWN = 6
#: Channels drawn at most; the extrema are those of all.
CHANNELS_DRAWN = 60
#: Events told at most.
EVENTS_TOLD = 200
#: Bytes of channels within the 3-D view: the report draws those that were asked for itself.
_VIEW_CHANNELS = 400_000


def write(result: Result, path: Path, *, force: bool = False) -> Path:
    """Write the page; `force` replaces a file that is no report, too.

    Raises
    ------
    FileError
        If it cannot be written, or would replace what is no report or the result itself.
    """
    files.require_target(path, "report", inputs=[result.path], force=force)
    return files.write_text(path, "report", render(result), inputs=[result.path], force=force)


def render(result: Result) -> str:
    """Return the page as HTML text."""
    title = str(result.meta.get("title") or result.meta.get("name") or "run")
    names, note = _names(result)
    drawn = names[:CHANNELS_DRAWN]
    if len(names) > len(drawn):
        said = f"The first {len(drawn)} of {len(names)} channels; `holonom plot` draws the others."
        note += f'<p class="note">{said}</p>'
    figures = Figures(_line_count(result, drawn))
    if result.time.size:
        seen = [_motion(result), _channels(result, drawn, note, figures)]
        seen += [_section("Extrema", extrema(result, names) if names else "")]
    else:
        seen = ['<p class="note">There are no rows: nothing was stored.</p>']
    sections = [
        *_head(result, title),
        *seen,
        _model(result),
        _warnings(result),
        _section("Measured error", measured(result)),
        _computed(result, figures),
        _provenance(result),
        figures.data(),
    ]
    style, program = (_own(name) for name in ("page.css", "page.js"))
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="generator" content="Holonom report">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(section for section in sections if section)
        + f"\n</main>\n<script>\n{program}</script>\n</body>\n</html>\n"
    )


def _own(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _section(title: str, body: str) -> str:
    return f"<section><h2>{title}</h2>{body}</section>" if body else ""


def _folded(title: str, body: str) -> str:
    return f"<details><summary><h2>{title}</h2></summary>{body}</details>" if body else ""


def _head(result: Result, title: str) -> list[str]:
    meta, facts = result.meta, dict(summarize(result))
    badge = f'<span class="badge {escape(result.status)}">{escape(STATUS[result.status])}</span>'
    told = [str(meta.get("name", "")), facts.get("method", ""), str(meta.get("started", ""))]
    if (span := simulated(result)) is not None:
        told.insert(1, f"{span[0]:.6g} to {span[1]:.6g} s")
    if count := len(result.warnings):
        badge += f' <a class="badge limit" href="#warnings">{count} warning{"s"[: count > 1]}</a>'
    lead = ", ".join(escape(text) for text in told if text)
    return [
        f"<h1>{escape(title)}</h1>",
        f'<p class="lead">{badge} &ensp;{lead}</p>',
        _notice(result),
    ]


def _notice(result: Result) -> str:
    if result.status == "completed" or not result.stop_reason:
        return ""
    reason = result.stop_reason
    text = f"{reason.get('message', '')} [{reason.get('code', '')}]"
    for key in ("item", "coordinate", "time", "step_size", "help"):
        if reason.get(key) is not None:
            text += f"\n{key.replace('_', ' ')}: {plain(reason[key])}"
    return f'<div class="notice bad">{escape(text)}</div>'


def _motion(result: Result) -> str:
    """Return the mechanism as a picture, which a click turns into the page where it moves."""
    from holonom import view
    from holonom.view.scene import scene
    from holonom.view.sketch import sketch

    try:
        drawn = scene(result, _VIEW_CHANNELS)
        picture = sketch(result, drawn=drawn).element()
    except HolonomError as error:
        said = str(error).partition("\n")[0]
        return f'<p class="note">There is no picture of the mechanism: {escape(said)}</p>'
    return _section(
        "Motion",
        f'<figure id="motion"><div id="poster">{picture}</div>'
        '<button id="play" type="button" hidden>▶ see it move, in 3-D</button>'
        "<figcaption>Poses of the run, the last one strong.</figcaption>"
        f"</figure>{packed('scene', view.page([drawn]).encode())}",
    )


def _names(result: Result) -> tuple[list[str], str]:
    """Return the channels to be drawn, and a note where none were asked for."""
    names = result.requested
    if names or not result.time.size:
        return names, ""
    bodies = [f"{body}.position" for body in result.written_out.get("bodies", {})]
    names = [name for name in bodies if name in result][:BODIES_DRAWN]
    note = "The run was asked for no channels; these are bodies of the model."
    return names, f'<p class="note">{note}</p>' if names else ""


def _line_count(result: Result, names: list[str]) -> int:
    return sum(result.matrix(name).shape[1] for name in names) + 10 if names else 10


def _channels(result: Result, names: list[str], note: str, figures: Figures) -> str:
    if not names:
        return ""
    drawn = [
        figures.add(
            pictures.channels(result, [name]),
            _caption(result, name),
            pictures.channels(result, [name], whole=True),
        )
        for name in names
    ]
    tools = (
        '<div id="tools" hidden><span id="range"></span><button type="button" data-zoom="2" '
        'aria-label="zoom out">−</button><button type="button" data-zoom="0.5" '
        'aria-label="zoom in">+</button><button type="button" data-move="-0.5" '
        'aria-label="earlier">◀</button><button type="button" data-move="0.5" '
        'aria-label="later">▶</button><button type="button" data-zoom="0">whole run</button></div>'
    )
    return _section("Channels", note + tools + "".join(drawn))


def _caption(result: Result, name: str) -> str:
    return "" if name in result.channels else "computed from the stored states"


def _model(result: Result) -> str:
    listed = parameters(result.meta.get("model") or {})
    picture, facts = graph(result)
    body = card(listed) if listed else ""
    if facts:
        caption = (
            "What places each body, with the freedoms that it leaves; dashed are forces and "
            "free bodies. Beside it the joints that close loops; red ones are redundant."
        )
        drawn = f"<figcaption>{caption}</figcaption>" if picture else ""
        counts = ", ".join(
            f"{value} {_counted(label, value)}" if value.isdigit() else f"{label}: {value}"
            for label, value in facts
        )
        said = f'<p class="facts">{escape(counts)}</p>'
        body += f'<figure class="wide">{said}<div class="sideways">{picture}</div>{drawn}</figure>'
    return _section("Model", body)


def _counted(label: str, value: str) -> str:
    """Return the word for one or several."""
    if value != "1":
        return label
    return {"bodies": "body", "degrees of freedom": "degree of freedom"}.get(
        label, label.removesuffix("s")
    )


def _warnings(result: Result) -> str:
    notices = [
        f"{w['path']}: " * bool(w.get("path")) + f"{w.get('message', '')} [{w.get('code', '')}]"
        for w in result.warnings
    ]
    body = "".join(f'<div class="notice">{escape(text)}</div>' for text in notices)
    return f'<section id="warnings"><h2>Warnings</h2>{body}</section>' if notices else ""


def _computed(result: Result, figures: Figures) -> str:
    parts = [_tiles(result), card(table(summarize(result)))]
    if result.time.size:
        parts += [_steps(result, figures), _residuals(result, figures), _energy(result, figures)]
    parts += [_statistics(result), _events(result)]
    return _folded("How it was computed", "".join(parts))


def _tiles(result: Result) -> str:
    tiles = []
    if (span := simulated(result)) is not None:
        tiles.append((f"{span[1] - span[0]:.4g} s", "simulated"))
    accepted = result.steps["accepted"] > 0
    if accepted.size:
        tiles.append((f"{accepted.sum()}", f"steps, {(~accepted).sum()} rejected"))
    if result.meta.get("cpu_seconds") is not None:
        tiles.append((f"{result.meta['cpu_seconds']:.3g} s", "processor time"))
    if isinstance(value := result.residuals.get("position"), float):
        tiles.append((f"{value:.1e}", "largest position residual"))
    if (worst := largest_imbalance(result)) is not None:
        tiles.append((f"{worst:.1e} J", "largest energy imbalance"))
    if (found := result.certification) is not None and found.worst is not None:
        tiles.append((f"{found.worst.tolerances:.3g} tolerances", "largest measured error"))
    cells = "".join(f"<div><b>{escape(v)}</b><span>{escape(k)}</span></div>" for v, k in tiles)
    return f'<div class="tiles">{cells}</div>' if tiles else ""


def _steps(result: Result, figures: Figures) -> str:
    log = result.steps
    if not log["t"].size:
        return ""
    caption = "Size of every attempted step; crosses mark attempts that were rejected."
    return "<h3>Step size</h3>" + figures.add(pictures.step_sizes(log), caption)


def _residuals(result: Result, figures: Figures) -> str:
    names = [name for name in result.channels if name.startswith("constraint.")]
    if not names:
        return ""
    if not any(np.any(result[name]) for name in names):
        said = '<p class="note">All are exactly zero at every output time.</p>'
        return f"<h3>Constraint residuals</h3>{said}"
    caption = "Largest residual of all constraints at each output time; exact zeros are not drawn."
    return "<h3>Constraint residuals</h3>" + figures.add(pictures.residuals(result, names), caption)


def _energy(result: Result, figures: Figures) -> str:
    names = [name for name in result.channels if name.startswith("energy.")]
    if not names:
        return ""
    rows = [
        (
            name.partition(".")[2].replace("_", " "),
            f"{result[name][0]:.6g}",
            f"{result[name][-1]:.6g}",
            f"{np.fmax.reduce(np.abs(result[name])):.3g}",
        )
        for name in names
    ]
    caption = "The imbalance is what the ledger of the other terms does not account for."
    return (
        "<h3>Energy</h3>"
        + figures.add(pictures.energy(result, names), caption)
        + card(grid(("J", "first row", "last row", "largest of a row"), rows, numbers=(1, 2, 3)))
    )


def _statistics(result: Result) -> str:
    rows = list(flat(result.meta.get("statistics") or {}))
    rows += [(f"residual {k}", v) for k, v in flat(result.meta.get("residuals") or {})]
    rows += [(f"energy {k}, J", v) for k, v in flat(result.meta.get("energy") or {})]
    return "<h3>Statistics</h3>" + card(table(rows)) if rows else ""


def _events(result: Result) -> str:
    rows = [
        (
            f"{e['time']:.6g} s" if isinstance(e.get("time"), int | float) else "",
            str(e.get("kind", "")),
            plain({k: v for k, v in e.items() if k not in ("time", "kind")}),
        )
        for e in result.events[:EVENTS_TOLD]
    ]
    if not rows:
        return ""
    count = len(result.events)
    said = f"The first {len(rows)} of {count} events; `Result.events` has the others."
    note = f'<p class="note">{said}</p>' if count > len(rows) else ""
    return "<h3>Events</h3>" + note + card(grid(("time", "kind", ""), rows))


def _provenance(result: Result) -> str:
    meta = result.meta
    rows = [
        ("Holonom", str(meta.get("holonom", ""))),
        ("model hash", str(meta.get("model_hash", ""))),
        ("started", str(meta.get("started", ""))),
        ("finished", str(meta.get("finished", "–"))),
    ]
    rows += [(f"option {key}", value) for key, value in flat(_brief(result.options))]
    model = json.dumps(_brief(meta.get("model") or {}), indent=1, ensure_ascii=False)
    return _folded(
        "Provenance",
        card(table(rows))
        + '<details class="card text"><summary>The model as it was run</summary>'
        + f"<pre>{escape(model)}</pre></details>",
    )


#: Lists that are told by their length and ends where they are long.
_LISTS = ("output_times", "vertices", "faces")


def _brief(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables with long lists of times and of what meshes consist of in few words."""
    brief: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, Mapping):
            brief[key] = _brief(value)
        elif key in _LISTS and isinstance(value, list) and len(value) > 8:
            brief[key] = f"{len(value)} {key.replace('_', ' ')}, {value[0]} to {value[-1]}"
        else:
            brief[key] = value
    return brief
