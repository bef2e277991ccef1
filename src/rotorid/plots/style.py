"""How every picture looks, and how a picture becomes part of a page or a file."""

from __future__ import annotations

import base64
import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from io import BytesIO
from typing import Any, ParamSpec

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

P = ParamSpec("P")

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

GREY, INK = "#9aa0a6", "#202124"
BLUE, SKY, GREEN, RED, PINK = "#0072b2", "#56b4e9", "#009e73", "#d55e00", "#cc79a7"
# Okabe and Ito: told apart by every eye
_STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e6e8",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.hashsalt": "rotorid",
    "text.parse_math": False,  # names are the user's, not TeX
    "savefig.facecolor": "white",
}


@contextmanager
def style() -> Iterator[None]:
    """Draw in the style of the house, and leave matplotlib's settings as they were."""
    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes, no reason to fail.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from")
        # Too long a name for its panel: drawn without the layout, no reason to fail either.
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        yield


def label(name: str, most: int = 24) -> str:
    """Return a name as a picture can hold it: printable, on one line, not too long."""
    text = "".join(c if c.isprintable() else " " for c in name)
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Let a function that draws a figure do so in the style of the house."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with style():
            return draw(*args, **kwargs)

    return drawn


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches that belongs to no window."""
    return Figure(figsize=(width, height), layout="constrained")


def panels(
    count: int, columns: int, height: float, width: float = 9.0
) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` panels in rows of at most `columns`, each of this height."""
    columns = max(1, min(columns, count))
    rows = -(-count // columns)
    figure = new_figure(width, height * rows + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False)
    axes = list(grid.flat)
    for unused in axes[count:]:
        unused.set_axis_off()
    return figure, axes


def decades(axes: Axes, *, x: bool = False, y: bool = False) -> None:
    """Make axes logarithmic, with powers of ten in plain text at the ticks."""
    for wanted, scale, axis in (
        (x, axes.set_xscale, axes.xaxis),
        (y, axes.set_yscale, axes.yaxis),
    ):
        if wanted:
            scale("log")
            axis.set_major_formatter(FuncFormatter(_power_of_ten))
            axis.set_minor_formatter(NullFormatter())


def ratios(axes: Axes, *, x: bool = False, y: bool = False) -> None:
    """Make axes logarithmic for numbers that lie within few decades: ticks at 1, 2 and 5."""
    for wanted, scale, axis in (
        (x, axes.set_xscale, axes.xaxis),
        (y, axes.set_yscale, axes.yaxis),
    ):
        if wanted:
            scale("log")
            low, high = axis.get_view_interval()
            steps = (1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)
            axis.set_major_locator(LogLocator(subs=steps))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())


def shown_unit(unit: str) -> tuple[str, float]:
    """Return a handy unit for small motion, and the factor from SI."""
    return {"m": ("µm", 1e6), "rad": ("µrad", 1e6)}.get(unit, (label(unit, 12) or "1", 1.0))


def _power_of_ten(value: float, _: object = None) -> str:
    exponent = math.log10(value)
    if abs(exponent - round(exponent)) > 1e-6:
        return f"{value:g}"
    return "10" + str(round(exponent)).translate(_RAISED)


def svg(figure: Figure) -> bytes:
    """Return a figure as SVG, the same bytes for the same figure."""
    stream = BytesIO()
    with style():
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return stream.getvalue()


def data_uri(figure: Figure) -> str:
    """Return a figure as the address of an image that the page holds itself."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg(figure)).decode("ascii")
