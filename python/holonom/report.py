"""One page about a run: a single HTML file with its pictures inside."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from holonom.base import files
from holonom.base.text import shown
from holonom.check import plain
from holonom.pictures import runs as pictures
from holonom.pictures import svg
from holonom.pictures.picture import Picture
from holonom.summary import STATUS, certified, summarize, with_unit

if TYPE_CHECKING:
    from holonom.result import Result

#: Bodies drawn when the run was asked for no channels.
BODIES_DRAWN = 6

_CSS = """
:root { color-scheme: light dark; --paper: #fbfbf9; --card: #ffffff; --ink: #1f2326;
  --faint: #667078; --line: #dfe2e0; --good: #2f7d52; --bad: #b23a3a; --fair: #a86a12; }
@media (prefers-color-scheme: dark) { :root { --paper: #16191b; --card: #1d2124; --ink: #dfe3e4;
  --faint: #98a2a8; --line: #33393d; --good: #63b98b; --bad: #e07b7b; --fair: #d9a14b; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 64rem; margin: 0 auto; padding: 2.2rem 1.2rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .3rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 .7rem; }
.lead { color: var(--faint); margin: 0 0 1.4rem; }
.badge { color: var(--card); border-radius: 1rem; padding: .1rem .7rem; font-size: .85rem;
  background: var(--bad); white-space: nowrap; }
.badge.completed { background: var(--good); }
.badge.interrupted, .badge.limit, .badge.running { background: var(--fair); }
.card, figure, .notice { background: var(--card); border: 1px solid var(--line);
  border-radius: .5rem; margin: 0 0 1rem; padding: 1rem 1.2rem; }
.notice { border-left: .3rem solid var(--fair); white-space: pre-wrap; }
.notice.bad { border-left-color: var(--bad); }
.tiles { display: flex; flex-wrap: wrap; gap: .8rem; margin-bottom: 1rem; }
.tiles div { flex: 1 1 9.5rem; background: var(--card); border: 1px solid var(--line);
  border-radius: .5rem; padding: .7rem .9rem; }
.tiles b { display: block; font-size: 1.25rem; font-weight: 600; }
.tiles span { color: var(--faint); font-size: .82rem; }
figure { overflow-x: auto; }
figure svg { width: 100%; max-width: 46rem; height: auto; min-width: 24rem; margin: 0 auto;
  display: block;  color: var(--ink); }
figcaption, p.note { color: var(--faint); font-size: .88rem; margin: .4rem 0 0; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .28rem .8rem .28rem 0;
  border-bottom: 1px solid var(--line); }
th { font-weight: 500; color: var(--faint); white-space: nowrap; }
td.number, th.number { text-align: right; }
tr:last-child > * { border-bottom: 0; }
pre { overflow: auto; max-height: 30rem; font-size: .82rem; margin: .6rem 0 0; }
code { overflow-wrap: anywhere; }
summary { cursor: pointer; }
@media print { figure, .card, .tiles div { break-inside: avoid; } }
"""


def escape(text: str) -> str:
    """Return text for the page; control characters are written by their numbers."""
    return html.escape(shown(text))


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
    name, started = str(result.meta.get("name", "")), str(result.meta.get("started", ""))
    badge = f'<span class="badge {escape(result.status)}">{escape(STATUS[result.status])}</span>'
    sections = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="lead">{badge} &ensp;{escape(name)}, {escape(started)}</p>',
        _notice(result),
        _tiles(result),
        _card(_table(summarize(result))),
    ]
    sections += [_certification(result)]
    if result.time.size:
        sections += [_channels(result), _residuals(result), _energy(result)]
    else:
        sections += ['<p class="note">There are no rows: nothing was stored.</p>']
    sections += [_steps(result), _statistics(result), _warnings(result), _events(result)]
    sections += [_provenance(result)]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="generator" content="Holonom report">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(section for section in sections if section)
        + "\n</main>\n</body>\n</html>\n"
    )


def _notice(result: Result) -> str:
    if result.status == "completed" or not result.stop_reason:
        return ""
    reason = result.stop_reason
    text = f"{reason.get('message', '')} [{reason.get('code', '')}]"
    for key in ("item", "coordinate", "time", "step_size", "help"):
        if reason.get(key) is not None:
            text += f"\n{key.replace('_', ' ')}: {plain(reason[key])}"
    return f'<div class="notice bad">{escape(text)}</div>'


def _tiles(result: Result) -> str:
    tiles = []
    if result.time.size:
        tiles.append((f"{result.time[-1] - result.time[0]:.4g} s", "simulated"))
    accepted = result.steps["accepted"] > 0
    if accepted.size:
        tiles.append((f"{accepted.sum()}", f"steps, {(~accepted).sum()} rejected"))
    if result.meta.get("cpu_seconds") is not None:
        tiles.append((f"{result.meta['cpu_seconds']:.3g} s", "processor time"))
    for key, label in (("position", "largest position residual"),):
        value = result.residuals.get(key)
        if isinstance(value, float):
            tiles.append((f"{value:.1e}", label))
    if "energy.imbalance" in result.channels and result.time.size:
        worst = np.abs(result["energy.imbalance"]).max()
        tiles.append((f"{worst:.1e} J", "largest energy imbalance"))
    if (found := result.certification) is not None and found.worst is not None:
        tiles.append((f"{found.worst.tolerances:.3g} tolerances", "largest measured error"))
    cells = "".join(f"<div><b>{escape(v)}</b><span>{escape(k)}</span></div>" for v, k in tiles)
    return f'<div class="tiles">{cells}</div>' if tiles else ""


def _certification(result: Result) -> str:
    found = result.certification
    if found is None:
        return ""
    said = f'<p class="note">Certified: {escape(certified(found))}.</p>'
    if not found.channels:
        return f"<h2>Measured error</h2>{said}"
    rows = [
        (
            c.name,
            f"{c.tolerances:.3g}",
            with_unit(c.error, c.unit),
            with_unit(c.tolerance, c.unit),
            f"{c.time:.6g} s",
        )
        for c in found.ranked
    ]
    head = ("channel", "error in tolerances", "error", "tolerance there", "time")
    until = "" if found.until is None else f" up to {found.until:.6g} s"
    note = (
        f'<p class="note">The run was repeated at a tenth of its tolerance and compared{until}. '
        "Each line is where the channel is furthest off; 1 is on tolerance.</p>"
    )
    return f"<h2>Measured error</h2>{said}" + _card(_grid(head, rows) + note)


def _channels(result: Result) -> str:
    names = result.requested
    note = ""
    if not names:
        positions = [f"{body}.position" for body in result.items.get("bodies", {})]
        names = [name for name in positions if name in result][:BODIES_DRAWN]
        note = (
            '<p class="note">The run was asked for no channels; these are bodies of the model.</p>'
        )
    if not names:
        return ""
    figures = [
        _figure(pictures.channels(result, [name]), _frame_note(result, name)) for name in names
    ]
    return "<h2>Channels</h2>" + "".join(figures) + note


def _frame_note(result: Result, name: str) -> str:
    stored = "stored" if name in result.channels else "computed from the stored states"
    unit = pictures.unit_text(result.unit(name)) or "no unit"
    parts = filter(None, (unit, pictures.frame_text(result.frame(name)), stored))
    return f"{name}: {', '.join(parts)}"


def _steps(result: Result) -> str:
    log = result.steps
    if not log["t"].size:
        return ""
    caption = "Size of every attempted step; crosses mark attempts that were rejected."
    return "<h2>Step size</h2>" + _figure(pictures.step_sizes(log), caption)


def _residuals(result: Result) -> str:
    names = [name for name in result.channels if name.startswith("constraint.")]
    if not any(np.any(result[name]) for name in names):
        return ""
    caption = "Largest residual of all constraints at each output time; exact zeros are not drawn."
    figure = _figure(pictures.residuals(result, names), caption)
    return "<h2>Constraint residuals</h2>" + figure


def _energy(result: Result) -> str:
    names = [name for name in result.channels if name.startswith("energy.")]
    if not names:
        return ""
    rows = [
        (
            name.partition(".")[2].replace("_", " "),
            f"{result[name][0]:.6g}",
            f"{result[name][-1]:.6g}",
            f"{np.abs(result[name]).max():.3g}",
        )
        for name in names
    ]
    caption = "The imbalance is what the ledger of the other terms does not account for."
    return (
        "<h2>Energy</h2>"
        + _figure(pictures.energy(result, names), caption)
        + _card(_grid(("J", "at the start", "at the end", "largest size"), rows))
    )


def _statistics(result: Result) -> str:
    rows = list(_flat(result.meta.get("statistics") or {}))
    rows += [(f"residual {k}", v) for k, v in _flat(result.meta.get("residuals") or {})]
    rows += [(f"energy {k}, J", v) for k, v in _flat(result.meta.get("energy") or {})]
    return "<h2>Statistics</h2>" + _card(_table(rows)) if rows else ""


def _warnings(result: Result) -> str:
    notices = [
        f"{w['path']}: " * bool(w.get("path")) + f"{w.get('message', '')} [{w.get('code', '')}]"
        for w in result.warnings
    ]
    body = "".join(f'<div class="notice">{escape(text)}</div>' for text in notices)
    return "<h2>Warnings</h2>" + body if notices else ""


def _events(result: Result) -> str:
    rows = [
        (
            f"{e['time']:.6g} s" if isinstance(e.get("time"), int | float) else "",
            str(e.get("kind", "")),
            plain({k: v for k, v in e.items() if k not in ("time", "kind")}),
        )
        for e in result.events
    ]
    return "<h2>Events</h2>" + _card(_grid(("time", "kind", ""), rows)) if rows else ""


def _provenance(result: Result) -> str:
    meta = result.meta
    rows = [
        ("Holonom", str(meta.get("holonom", ""))),
        ("model hash", str(meta.get("model_hash", ""))),
        ("started", str(meta.get("started", ""))),
        ("finished", str(meta.get("finished", "–"))),
    ]
    rows += [(f"option {key}", value) for key, value in _flat(_brief(result.options))]
    model = json.dumps(meta.get("model", {}), indent=1, ensure_ascii=False)
    return (
        "<h2>Provenance</h2>"
        + _card(_table(rows))
        + f'<details class="card"><summary>The model as it was run</summary><pre>{escape(model)}'
        + "</pre></details>"
    )


def _brief(options: Mapping[str, Any]) -> dict[str, Any]:
    """Shorten long lists of numbers."""
    brief = dict(options)
    times = brief.get("output_times")
    if isinstance(times, list) and len(times) > 8:
        brief["output_times"] = f"{len(times)} times from {times[0]} to {times[-1]} s"
    return brief


def _flat(data: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    for key, value in data.items():
        label = f"{prefix}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            yield from _flat(value, f"{label}, ")
        elif isinstance(value, list):
            yield label, ", ".join(map(str, value))
        else:
            yield label, f"{value:.6g}" if isinstance(value, float) else str(value)


def _table(rows: Iterable[tuple[str, str]]) -> str:
    lines = (f"<tr><th>{escape(k)}</th><td><code>{escape(v)}</code></td></tr>" for k, v in rows)
    return f"<table>{''.join(lines)}</table>"


def _grid(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><tr>{top}</tr>{body}</table>"


def _card(body: str) -> str:
    return f'<div class="card">{body}</div>'


def _figure(picture: Picture, caption: str) -> str:
    return f"<figure>{svg.element(picture)}<figcaption>{escape(caption)}</figcaption></figure>"
