"""Pages as single HTML files: pictures and all that draws them inside, nothing fetched."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rotorid.core.errors import printable
from rotorid.core.files import MARK
from rotorid.core.frozen import frozen
from rotorid.core.tables import Table
from rotorid.models import Model
from rotorid.report.interactive import spec
from rotorid.report.panels import Curve, Panel, key_of, thinned


@frozen
class Passage:
    """A part of a page: a title, what it shows in words, and a table, a list, or panels."""

    title: str
    caption: str = ""
    table: Table | None = None
    items: tuple[str, ...] = ()
    panels: tuple[Panel, ...] = ()
    after: str = ""  # said behind the rest

    @property
    def key(self) -> list[Curve]:
        return key_of(self.panels)


@dataclass
class PagePanels:
    panels: list[Panel]

    def add(self, panel: Panel) -> str:
        """Take a panel in, and return the id of its place."""
        self.panels.append(panel)
        return f"plot-{len(self.panels)}"

    def text(self) -> str:
        """Return the panels as JSON that ends no script, thinned until a page can hold it."""
        most = MOST_POINTS
        while True:
            found = _shared([spec(thinned(panel, most)) for panel in self.panels])
            if len(found) <= MOST_DATA or most <= FEWEST_POINTS:
                return found
            most //= 2


MOST_POINTS, FEWEST_POINTS = 2048, 64
"""Points of a curve: at first, and where a page has so many curves that it would be too long."""
MOST_DATA = 1_000_000
"""Characters of all curves of a page: with plotly's 4.9 million it stays under 6 million."""
WORTH = 16
"""Numbers of a list from which on it is held once for all curves that have it."""


def _shared(specs: list[dict[str, Any]]) -> str:
    """Return specs as JSON; a list of numbers that several curves have stands once."""
    lists: dict[str, int] = {}
    for drawn in specs:
        for trace in drawn["data"]:
            for key in ("x", "y"):
                if len(trace.get(key, ())) >= WORTH:
                    text = json.dumps(trace[key], allow_nan=False, separators=(",", ":"))
                    trace[key] = {"list": lists.setdefault(text, len(lists))}
    plots = {f"plot-{k}": drawn for k, drawn in enumerate(specs, start=1)}
    content = json.dumps(plots, allow_nan=False, separators=(",", ":"))
    found = f'{{"lists":[{",".join(lists)}],"plots":{content}}}'
    return found.replace("<", "\\u003c").replace("&", "\\u0026")


def _printable(value: Any) -> Any:
    """Return what a page shows of a value; what is already HTML stays as it is."""
    plain = isinstance(value, str) and not isinstance(value, Markup)
    return printable(value, keep="\n\t") if plain else value


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("rotorid.report"),
        autoescape=True,
        finalize=_printable,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def render(template: str, **content: Any) -> str:
    """Return a page from its template; only its own scripts run, whatever a name may hold."""
    from plotly.offline import get_plotlyjs

    from rotorid import __version__

    environment = _environment()
    drawn = PagePanels([])
    page = environment.get_template(template).render(
        version=__version__, mark=MARK, drawn=drawn, scripts=(), **content
    )
    if not drawn.panels:
        return page.replace(_PLACE, "")
    own = environment.get_template("page.js").render()
    library = get_plotlyjs().replace("</script", "<\\/script")
    allowed = " ".join(f"'sha256-{_digest(script)}'" for script in (library, own))
    body = (
        f'<script type="application/json" id="plots">{drawn.text()}</script>\n'
        f"<script>{library}</script>\n<script>{own}</script>"
    )
    head, _, tail = page.rpartition(_PLACE)
    return head.replace(_ALLOWED, f"; script-src {allowed}", 1) + body + tail


_PLACE = "<!-- scripts -->"
_ALLOWED = "; script-src 'none'"


def _digest(script: str) -> str:
    return b64encode(sha256(script.encode("utf-8")).digest()).decode("ascii")


def answer(
    title: str,
    verdict: str,
    mood: str,
    sections: Iterable[Passage],
    *,
    heading: str = "",
    lead: str = "",
    urge: str = "",
    steps: Sequence[str] = (),
    model: Model | None = None,
    done: Sequence[str] = (),
) -> str:
    """Return the page of a verdict, coloured by its mood, and the sections that hold anything."""
    return render(
        "answer.html",
        title=title,
        heading=heading or title,
        lead=lead,
        verdict=verdict,
        mood=mood,
        urge=urge,
        steps=steps,
        sections=filled(sections),
        model=model,
        done=done,
    )


def filled(sections: Iterable[Passage]) -> list[Passage]:
    return [one for one in sections if one.table or one.items or one.panels]
