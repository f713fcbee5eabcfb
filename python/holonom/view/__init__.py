"""The 3-D page: one HTML file in which the bodies of a run move, with everything inside.

`show` builds it, `Result.view` and ``holonom view`` are its doors. The page's own program is built
from ``viewer/`` and lies here as ``page.html``; what it shows is put in by `holonom.view.scene`.
"""

from __future__ import annotations

import json
import webbrowser
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from holonom.base import files
from holonom.base.errors import UsageError
from holonom.base.plain import as_path
from holonom.base.text import shown
from holonom.view.scene import scene

if TYPE_CHECKING:
    from holonom.result import Result

#: Where the built page takes its data.
_PLACE = '<script id="holonom-data" type="application/json">null</script>'
_TITLE = "<title>Holonom</title>"
#: Runs laid over each other at most: more cannot be told apart.
MOST_RUNS = 4


class View:
    """A page that shows results in motion; a notebook shows it where it is the value of a cell."""

    def __init__(self, html: str, title: str, sources: Sequence[Path | None] = ()) -> None:
        self.html = html
        self.title = title
        self._sources = sources

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the page and return its path.

        Parameters
        ----------
        path : path
        force : bool
            Whether a file that is no page by Holonom may be replaced.

        Raises
        ------
        FileError
            If it cannot be written, or would replace another file.
        """
        target = as_path(path)
        return files.write_text(target, "page", self.html, inputs=self._sources, force=force)

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.html)}" title="{escape(self.title)}" allowfullscreen '
            'style="width:100%;height:600px;border:0;border-radius:8px"></iframe>'
        )

    def __repr__(self) -> str:
        return f"<holonom.View {self.title!r}: {len(self.html) / 1e6:.2f} MB>"


def show(results: Sequence[Result]) -> View:
    """Return the page of one result, or of several laid over each other.

    Raises
    ------
    UsageError
        If a result has no rows, or there are more than `MOST_RUNS`.
    """
    runs = scenes(results)
    return View(page(runs), str(runs[0]["title"]), [result.path for result in results])


def scenes(results: Sequence[Result]) -> list[dict[str, Any]]:
    """Return the runs of a page as plain data; errors are those of `show`."""
    if not 1 <= len(results) <= MOST_RUNS:
        raise UsageError(
            f"{len(results)} results are given", help=f"a page shows 1 to {MOST_RUNS} of them"
        )
    runs = [scene(result) for result in results]
    if len({one["dimension"] for one in runs}) > 1:
        raise UsageError(
            "planar and spatial results cannot be laid over each other",
            help="make a page for each kind",
        )
    return runs


def page(runs: list[dict[str, Any]], **more: Any) -> str:
    """Return the HTML of runs; ``job`` is what to draw for a film, ``live`` how rows come."""
    title = shown(str(runs[0]["title"]))
    # `</script` in a text would end the element that carries the data.
    data = json.dumps({"format": 1, "runs": runs, **more}, ensure_ascii=False, allow_nan=False)
    data = data.replace("<", "\\u003c")
    html = resources.files(__package__).joinpath("page.html").read_text(encoding="utf-8")
    heading = f'<title>{escape(title)}</title>\n<meta name="generator" content="Holonom page">'
    html = html.replace(_TITLE, heading, 1)
    return html.replace(_PLACE, _PLACE.replace("null", data), 1)


def open_page(path: Path) -> bool:
    """Open a page in the user's browser and return whether there is one."""
    return open_address(path.resolve().as_uri())


def open_address(address: str) -> bool:
    """Open an address in the user's browser and return whether there is one."""
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False
