"""Panels as a figure of matplotlib: for notebooks, papers and the documentation."""

from __future__ import annotations

import io
import math
import warnings
from base64 import b64encode
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from rotorid.core.errors import InputError
from rotorid.report.drawn import Curve, Matrix, Panel, key_of, label

MOST_IMAGE = 150_000  # characters of a picture in a notebook
MOST_IMAGE_PANELS = 12  # panels of a picture in a notebook: what a screen holds
DPI = (80, 55, 40)  # dots per inch of such a picture: the first with which it is small enough

_INK = "#202124"
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e6e8",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.hashsalt": "rotorid",
    "text.parse_math": False,  # names are the user's, not TeX
    "savefig.facecolor": "white",
}
_LOOKS: dict[str, dict[str, Any]] = {
    "line": {"lw": 1.2},
    "thin": {"lw": 0.6},
    "thick": {"lw": 3.0},
    "dashed": {"lw": 1.2, "ls": "--"},
    "dots": {"marker": "o", "ms": 4, "ls": "none"},
    "points": {"marker": "o", "ms": 2, "ls": "none"},
    "diamonds": {"marker": "D", "ms": 4.5, "mfc": "none", "ls": "none"},
    "named": {"marker": "D", "ms": 4.5, "mfc": "none", "ls": "none"},
    "stems": {"lw": 1.4},
    "band": {"lw": 6.0, "alpha": 0.4},
}


@contextmanager
def style() -> Iterator[None]:
    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes, no reason to fail.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from")
        # Too long a name for its panel: drawn without the layout, no reason to fail either.
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        # A single value: the axis is widened about it.
        warnings.filterwarnings("ignore", message="Attempting to set identical")
        yield


class Picture(Figure):
    """A figure that a notebook shows as it is, whatever its backend."""

    def _repr_png_(self) -> bytes:
        drawn = io.BytesIO()
        with style():
            self.savefig(drawn, format="png", dpi=DPI[0])
        return drawn.getvalue()

    def __repr__(self) -> str:
        return f"{super().__repr__()[:-1]}; savefig('picture.png') writes it>"


@style()
def figure_of(panels: Sequence[Panel], columns: int = 3, *, apart: bool = False) -> Figure:
    """Draw panels side by side, `columns` in a row, with one key for all or, `apart`, for each."""
    if not panels:  # modes of a machine with a single place have no shapes
        raise InputError("a result with nothing to draw", "curves or shapes", "print its table")
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    width = 9.0 if columns < 3 or rows > 1 else 12.0
    height = max(panel.height for panel in panels) * rows + 0.3
    figure = Picture(figsize=(width, height), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for unused in axes[len(panels) :]:
        unused.set_axis_off()
    for panel, one in zip(panels, axes, strict=False):
        draw(one, panel)
        if apart:
            one.legend(handles=_handles([panel]), loc="best", fontsize=7.5)
    handles = [] if apart else _handles(panels)
    if handles:
        figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 4))
    return figure


def image_of(panels: Sequence[Panel], told: str) -> str:
    """Return panels as an HTML image of at most `MOST_IMAGE` characters: a notebook keeps them."""
    for dpi in DPI:
        drawn = io.BytesIO()
        figure_of(panels[:MOST_IMAGE_PANELS]).savefig(drawn, format="png", dpi=dpi)
        text = b64encode(drawn.getvalue()).decode("ascii")
        if len(text) <= MOST_IMAGE:
            source = f"data:image/png;base64,{text}"
            return f'<img alt="{escape(told)}" style="max-width: 100%" src="{source}">'
    return ""


def _handles(panels: Sequence[Panel]) -> list[Line2D]:
    return [
        Line2D([], [], label=curve.label, color=curve.colour, **_LOOKS[curve.look])
        for curve in key_of(panels)
    ]


def draw(axes: Axes, panel: Panel) -> None:
    axes.set_title(label(panel.title, 48), loc="left")
    axes.set(xlabel=panel.x.title, ylabel=panel.y.title)
    for axis, which, drawn in ((panel.x, "x", axes.xaxis), (panel.y, "y", axes.yaxis)):
        if axis.log:
            axes.set(**{f"{which}scale": "log"})
            drawn.set_major_locator(LogLocator(numticks=6))
            drawn.set_major_formatter(FuncFormatter(_power_of_ten))
            drawn.set_minor_formatter(NullFormatter())
        if axis.names:
            _named(axes, which, axis.names)
    for curve in panel.curves:
        _draw_curve(axes, curve)
    if panel.matrix is not None:
        _draw_matrix(axes, panel.matrix)
    if panel.level is not None:
        axes.axhline(panel.level, color=_INK, lw=0.8)
    if panel.upright is not None:
        axes.axvline(panel.upright, color=_INK, lw=0.8)
    if panel.equal:
        axes.set_aspect("equal")
    if panel.x.ends is not None:
        axes.set_xlim(*panel.x.ends)
    if panel.y.ends is not None:
        axes.set_ylim(*panel.y.ends)


def _draw_curve(axes: Axes, curve: Curve) -> None:
    colour = curve.colour
    if curve.look == "band":
        base = 0.0 if curve.base is None else curve.base
        axes.fill_between(curve.x, base, curve.y, color=colour, lw=0, alpha=0.4)
    elif curve.look == "stems":
        axes.vlines(curve.x, 0.0 if curve.base is None else curve.base, curve.y, color=colour)
    else:
        axes.plot(curve.x, curve.y, color=colour, **_LOOKS[curve.look])
    if curve.look == "named":
        for x, y, told in zip(curve.x, curve.y, curve.told, strict=True):
            place: Any = {"xytext": (5, 0), "textcoords": "offset points", "va": "center"}
            axes.annotate(label(told), (x, y), fontsize=7, **place)
    if curve.error is not None:
        axes.hlines(curve.y, curve.x - curve.error, curve.x + curve.error, color=colour, lw=2)


def _draw_matrix(axes: Axes, matrix: Matrix) -> None:
    colours = "RdBu_r" if matrix.low < 0 else "Blues"
    columns = matrix.columns
    if isinstance(columns, np.ndarray):
        x, names = columns, None
    else:
        x, names = np.arange(len(columns), dtype=float), columns
    rows = np.arange(len(matrix.rows))
    image = axes.pcolormesh(
        x, rows, matrix.values, cmap=colours, vmin=matrix.low, vmax=matrix.high, shading="nearest"
    )
    if names is not None:
        axes.set_xticks(x, [label(name) for name in names], rotation=90)
    _named(axes, "y", matrix.rows)
    axes.grid(visible=False)
    if matrix.written and len(matrix.rows) <= 20:
        for (row, column), value in np.ndenumerate(matrix.values):
            if row != column and abs(value) >= 0.3:
                colour = "white" if abs(value) > 0.7 else _INK
                text = f"{value:.1f}".replace("0.", ".").replace("-", "\N{MINUS SIGN}")
                axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=6.5)
    if axes.figure is not None:
        axes.figure.colorbar(image, ax=axes, shrink=0.8, label=matrix.label)


def _named(axes: Axes, which: str, names: Sequence[str]) -> None:
    texts = [label(name) for name in names]
    if which == "x":
        axes.set_xticks(range(len(names)), texts)
    else:
        axes.set_yticks(range(len(names)), texts)
        axes.set_ylim(len(names) - 0.5, -0.5)


def _power_of_ten(value: float, _: object = None) -> str:
    exponent = math.log10(value)
    if abs(exponent - round(exponent)) > 1e-6 or abs(exponent) < 3:
        return f"{value:g}"
    return "10" + str(round(exponent)).translate(_RAISED)
