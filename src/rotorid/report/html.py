"""Pages as single HTML files: pictures inside, no script, nothing fetched from anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from rotorid.plots.style import data_uri


@dataclass(frozen=True)
class Picture:
    """An image with what it shows in words."""

    uri: str
    title: str
    caption: str


def picture(figure: Figure, title: str, caption: str) -> Picture:
    """Return a figure as a picture of a page."""
    return Picture(data_uri(figure), title, caption)


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("rotorid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def render(template: str, **content: Any) -> str:
    """Return a page from its template."""
    from rotorid import __version__

    return _environment().get_template(template).render(version=__version__, **content)
