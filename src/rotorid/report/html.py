"""Pages as single HTML files: pictures inside, no script, nothing fetched from anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from rotorid.plots.style import data_uri
from rotorid.screen import printable


@dataclass(frozen=True)
class Picture:
    """An image with what it shows in words."""

    uri: str
    title: str
    caption: str


def picture(figure: Figure, title: str, caption: str) -> Picture:
    """Return a figure as a picture of a page."""
    return Picture(data_uri(figure), title, caption)


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
    """Return a page from its template."""
    from rotorid import __version__

    return _environment().get_template(template).render(version=__version__, **content)
