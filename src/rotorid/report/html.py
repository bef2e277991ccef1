"""Pages as single HTML files: sections of sentences, tables and panels, with all that draws them.

Nothing is fetched. Panels are plotly's plain data, rounded to what an eye can tell.
"""

from __future__ import annotations

import json
import math
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import date
from functools import cache
from hashlib import sha256
from html import escape
from itertools import count
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from markupsafe import Markup

from rotorid.core.errors import printable
from rotorid.core.files import MARK
from rotorid.core.frozen import frozen
from rotorid.core.tables import Table
from rotorid.core.values import Floats
from rotorid.models import Model
from rotorid.report.drawn import Axis, Curve, Matrix, Panel, key_of, label, thinned

if TYPE_CHECKING:
    from jinja2 import Environment

Mood = Literal["", "good", "doubt", "bad"]
"""How a verdict is coloured."""
MOST_TEXTS = 24
"""Equations that a page lists: of more it says how many."""


@frozen
class Passage:
    """A part of a page, or the page itself; what is empty is left out, from top to bottom."""

    title: str
    caption: str = ""
    table: Table | None = None
    items: tuple[str, ...] = ()
    panels: tuple[Panel, ...] = ()
    after: str = ""  # said behind the rest
    lead: str = ""  # what it is about, with its badge
    badge: str = ""
    verdict: str = ""
    mood: Mood = ""  # of badge and verdict
    urge: str = ""  # said before the steps
    steps: tuple[str, ...] = ()  # what to do, or to mind
    numbers: tuple[tuple[str, str], ...] = ()  # of the first screen, each with what it is
    picture: Passage | None = None  # the part that stands beside the verdict, and not below
    said: tuple[str, ...] = ()  # more sentences like the caption
    body: Markup = Markup()
    parts: tuple[Passage, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether it shows anything but what it would say of it."""
        own = self.table or self.items or self.panels or self.said or self.body
        return bool(own or any(part.holds for part in self.parts))

    @property
    def sentences(self) -> tuple[str, ...]:
        return tuple(filter(None, (self.caption, *self.said)))

    @property
    def every(self) -> Iterator[Passage]:
        yield self
        for part in filter(None, (self.picture, *self.parts)):
            if part.holds:
                yield from part.every


def page_of(
    page: Passage, *, tab: str = "", model: Model | None = None, done: Sequence[str] = ()
) -> str:
    """Return a page, the equations of its model, and what was done; `tab` is its name in a browser.

    Only its own scripts run, whatever a name may hold.
    """
    from plotly.offline import get_plotlyjs

    from rotorid import __version__

    work = Passage("Provenance", items=tuple(done))
    parts = tuple(part for part in page.parts if part is not page.picture)
    lead = marked("{}, written {}" if page.lead else "{}Written {}", page.lead, f"{date.today()}")
    page = replace(page, lead=lead, parts=(*parts, *equations(model), work))
    panels = [panel for section in page.every for panel in section.panels]
    scripts = []
    if panels:
        library = get_plotlyjs().replace("</script", "<\\/script")
        scripts = [library, _environment().get_template("page.js").render()]
    sums = [sha256(script.encode("utf-8")).digest() for script in scripts]
    return (
        _environment()
        .get_template("page.html")
        .render(
            page=page,
            tab=tab or page.title,
            version=__version__,
            mark=MARK,
            key_of=key_of,
            place=count(1).__next__,
            allowed=" ".join(f"'sha256-{b64encode(one).decode('ascii')}'" for one in sums)
            or "'none'",
            plots=Markup(plots_text(panels)),
            scripts=list(map(Markup, scripts)),
        )
    )


def marked(html: str, *values: str) -> Markup:
    """Return HTML with values in it that are text, whatever they hold."""
    return Markup(html).format(*map(_printable, values))


def equations(model: Model | None) -> Iterator[Passage]:
    if model is not None:
        texts = model.texts
        many = f"{len(texts)} equations: those of a rotor from its drawing, or of a model file."
        listed = "".join(f"{text}\n" for text in texts)
        few = len(texts) <= MOST_TEXTS
        body = marked("<pre>{}</pre>", listed) if few else marked("<p>{}</p>", many)
        yield Passage("Equations of motion", body=body)


def rendered(template: str, **content: Any) -> Markup:
    return Markup(_environment().get_template(template).render(content))


def _printable(value: Any) -> Any:
    """Return what a page shows of a value; what is already HTML stays as it is."""
    plain = isinstance(value, str) and not isinstance(value, Markup)
    return printable(value, keep="\n\t") if plain else value


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # takes its time to load

    return Environment(
        loader=PackageLoader("rotorid.report"),
        autoescape=True,
        finalize=_printable,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


MOST_POINTS, FEWEST_POINTS = 2048, 64
"""Points of a curve: at first, and where a page has so many curves that it would be too long."""
MOST_DATA = 1_000_000
"""Characters of all curves of a page: with plotly's 4.9 million it stays under 6 million."""


def plots_text(panels: Sequence[Panel]) -> str:
    """Return panels as JSON that ends no script, thinned until a page can hold it."""
    most = MOST_POINTS
    while True:
        plots = {f"plot-{k}": spec(thinned(panel, most)) for k, panel in enumerate(panels, start=1)}
        found = json.dumps(plots, allow_nan=False, separators=(",", ":"))
        if len(found) <= MOST_DATA or most <= FEWEST_POINTS:
            return found.replace("<", "\\u003c").replace("&", "\\u0026")
        most //= 2


_WIDTH = {"thin": 0.9, "thick": 4.5}  # of lines; 1.6 otherwise
_SIZE = {"dots": 6, "points": 3, "diamonds": 8, "named": 8}
_CLEAR = "rgba(0,0,0,0)"
_RULE = "rgba(128,134,139,0.28)"
_RULER = {"type": "line", "line": {"color": "#80868b", "width": 1}}
_DIVERGING = [
    [0, "#2166ac"],
    [0.25, "#92c5de"],
    [0.5, "#f7f7f7"],
    [0.75, "#f4a582"],
    [1, "#b2182b"],
]
_GROWING = [[0, "#f7fbff"], [0.4, "#9ecae1"], [0.7, "#3182bd"], [1, "#08306b"]]
# ColorBrewer's RdBu and Blues
_INCH = 110
"""Pixels of an inch of a panel's height: on a screen a panel stands alone, and is larger."""
_FEW, _MANY = 0.6, 2.5
"""Powers of ten between which a logarithmic axis has ticks at 1, 2 and 5: above, at powers of ten;
below, where plotly thinks best."""
_SHARP = 5
"""Significant digits of what is drawn."""


def spec(panel: Panel) -> dict[str, Any]:
    x, y, matrix = panel.x, panel.y, panel.matrix
    drawn = [_trace(curve, x.ends) for curve in panel.curves]
    if matrix is not None:
        drawn.append(_heatmap(matrix))
        y = replace(y, names=matrix.rows)
        x = x if isinstance(matrix.columns, np.ndarray) else replace(x, names=matrix.columns)
    across = {"xref": "x domain", "x0": 0, "x1": 1, "y0": panel.level, "y1": panel.level}
    upright = {"yref": "y domain", "y0": 0, "y1": 1, "x0": panel.upright, "x1": panel.upright}
    rulers = ((panel.level, across), (panel.upright, upright))
    axes = {
        "xaxis": _axis(x, [curve.x for curve in panel.curves]),
        "yaxis": _axis(y, [v for c in panel.curves for v in (c.y, c.base) if v is not None]),
    }
    if y.names:
        axes["yaxis"]["autorange"] = "reversed"
    if panel.equal:
        axes["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
        axes["xaxis"]["constrain"] = "domain"
    layout = {
        **axes,
        "margin": {"l": 8, "r": 12, "t": 6, "b": 8},
        "showlegend": False,
        "modebar": {"bgcolor": _CLEAR, "color": "#80868b", "activecolor": "#0072b2"},
        "hovermode": "closest",
        "separators": ".\u2009",
        "paper_bgcolor": _CLEAR,
        "plot_bgcolor": _CLEAR,
        # as the page has it on white; it sets the ink of dark pages itself
        "font": {"size": 12, "color": "#202124", "family": "system-ui, sans-serif"},
        "shapes": [_RULER | ends for at, ends in rulers if at is not None],
        "height": round(_INCH * panel.height),
    }
    return {"data": drawn, "layout": layout}


def shown(name: str, most: int = 24) -> str:
    """Return a user's name as plotly writes it: its markup is none."""
    return escape(label(name, most), quote=False)


def _logarithmic(values: list[Floats], ends: tuple[float, float] | None) -> dict[str, Any]:
    made: dict[str, Any] = {"type": "log", "exponentformat": "power", "nticks": 6}
    every = np.concatenate([*values, np.zeros(0)]) if ends is None else np.array(ends)
    seen = every[np.isfinite(every) & (every > 0)]
    reach = float(np.log10(seen.max() / seen.min())) if len(seen) else 0.0
    if reach > _MANY:
        made["dtick"] = math.ceil(reach / 6)
    elif reach > _FEW:  # powers of ten alone would be one or two
        low, high = math.floor(np.log10(seen.min())) - 1, math.ceil(np.log10(seen.max())) + 1
        ticks = [n * 10.0**k for k in range(low, high + 1) for n in (1, 2, 5)]
        made |= {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    return made


def _axis(axis: Axis, values: list[Floats]) -> dict[str, Any]:
    made: dict[str, Any] = {
        "title": {"text": shown(axis.title, 60), "standoff": 6},
        "automargin": True,
        "gridcolor": _RULE,
        "zeroline": False,
        "linecolor": _RULE,
    }
    if axis.log:
        made |= _logarithmic(values, axis.ends)
    else:
        made |= {"exponentformat": "power", "minexponent": 6}
    if axis.ends is not None:
        low, high = np.log10(axis.ends) if axis.log else axis.ends
        made["range"] = [float(low), float(high)]
    if axis.names:
        ticks = list(range(len(axis.names)))
        made |= {"tickvals": ticks, "ticktext": [shown(name) for name in axis.names]}
    return made


def _beside(curve: Curve, ends: tuple[float, float] | None) -> str | list[str]:
    """Return where names stand: in the right half of a picture not to the right, to be in it."""
    if ends is None:
        return "middle right"
    outer = [("bottom left", "top left")[up] for up in (curve.y >= 0).tolist()]
    right = (curve.x > sum(ends) / 2).tolist()
    return [at if far else "middle right" for at, far in zip(outer, right, strict=True)]


def _trace(curve: Curve, ends: tuple[float, float] | None = None) -> dict[str, Any]:
    made: dict[str, Any] = {
        "type": "scatter",
        "name": shown(curve.label, 60),
        "x": _numbers(curve.x),
        "y": _numbers(curve.y),
    }
    if curve.look == "band":
        return _band(made, curve)
    if curve.look == "stems":
        made |= _stems(curve)
    if curve.look in _SIZE:
        named = curve.look == "named"
        symbol = "diamond-open" if named or curve.look == "diamonds" else "circle"
        marker = {"color": curve.colour, "size": _SIZE[curve.look], "symbol": symbol}
        made |= {"mode": "markers+text" if named else "markers", "marker": marker}
        if named:  # on paper nobody points at a mark
            made |= {"textposition": _beside(curve, ends), "cliponaxis": False}
    else:
        line: dict[str, Any] = {"color": curve.colour, "width": _WIDTH.get(curve.look, 1.6)}
        if curve.look == "dashed":
            line["dash"] = "dash"
        made |= {"mode": "lines", "line": line}
    if curve.error is not None:
        bars = {"type": "data", "array": _numbers(curve.error), "color": curve.colour}
        made["error_x"] = bars | {"thickness": 2, "width": 4}
    if curve.told:
        made["text"] = [shown(text, 80) for text in curve.told]
        made["hoverinfo"] = "text+name"
    return made


def _stems(curve: Curve) -> dict[str, Any]:
    base = curve.base if curve.base is not None else np.zeros_like(curve.y)
    gap = np.full_like(curve.y, np.nan)
    x = np.column_stack([curve.x, curve.x, gap]).ravel()
    y = np.column_stack([base, curve.y, gap]).ravel()
    return {"x": _numbers(x), "y": _numbers(y)}


def _band(made: dict[str, Any], curve: Curve) -> dict[str, Any]:
    """Return a band as one outline, filled: there along its upper edge, back along the lower."""
    base = np.zeros_like(curve.y) if curve.base is None else curve.base
    colour = curve.colour
    seen = np.isfinite(curve.y) & np.isfinite(base)
    x = np.concatenate([curve.x[seen], curve.x[seen][::-1]])
    y = np.concatenate([curve.y[seen], base[seen][::-1]])
    fill = "rgba({},{},{},0.35)".format(*(int(colour[i : i + 2], 16) for i in (1, 3, 5)))
    return made | {
        "x": _numbers(x),
        "y": _numbers(y),
        "mode": "lines",
        "line": {"width": 0.6, "color": colour},
        "fill": "toself",
        "fillcolor": fill,
        "hoverinfo": "skip",
    }


def _heatmap(matrix: Matrix) -> dict[str, Any]:
    numeric = isinstance(matrix.columns, np.ndarray)
    columns = matrix.columns if numeric else np.arange(len(matrix.columns), dtype=float)
    rows = [shown(name) for name in matrix.rows]
    made: dict[str, Any] = {
        "type": "heatmap",
        "x": _numbers(np.asarray(columns, dtype=float)),
        "y": list(range(len(matrix.rows))),
        "z": [_numbers(row) for row in matrix.values],
        "zmin": matrix.low,
        "zmax": matrix.high,
        "colorscale": _DIVERGING if matrix.low < 0 else _GROWING,
        "hoverongaps": False,
        "text": [[row] * len(columns) for row in rows],
        "hovertemplate": "%{text}, %{x}: %{z:.3g}<extra></extra>",
        "colorbar": {"title": {"text": shown(matrix.label, 40), "side": "right"}, "thickness": 12},
    }
    if not numeric:
        names = [shown(str(name)) for name in matrix.columns]
        made["customdata"] = [[f"{row}, {column}" for column in names] for row in rows]
        made["hovertemplate"] = "%{customdata}: %{z:.3g}<extra></extra>"
    if matrix.written:
        made["text"] = [
            [_brief(z) if i != j else "" for j, z in enumerate(row)]
            for i, row in enumerate(matrix.values)
        ]
        made["texttemplate"] = "%{text}"
        made["textfont"] = {"size": 10}
    return made


def _brief(value: float) -> str:
    if not abs(value) >= 0.3:
        return ""
    return f"{value:.2f}".replace("0.", ".").replace("-", "\N{MINUS SIGN}")


def _numbers(values: Floats) -> list[float | None]:
    """Return numbers as JSON has them, rounded; null where there is none."""
    return [float(f"{v:.{_SHARP}g}") if np.isfinite(v) else None for v in np.asarray(values)]
