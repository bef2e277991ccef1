"""Tables: described once, shown as text, as HTML and in a notebook."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import partial
from html import escape
from textwrap import TextWrapper

from rotorid.core.errors import CELL, SENTENCE, one_line, printable, shortened
from rotorid.core.frozen import frozen

GAP = "  "
NARROW = 20  # characters, below which sentences are not broken any further
LONG = 30  # characters, from which a cell of words may be broken
_WRAP = partial(TextWrapper, subsequent_indent=GAP, break_long_words=False, break_on_hyphens=False)
_NUMBER = re.compile(
    r"[-+\N{MINUS SIGN}]?(\d|\.\d)[\d.]*(e[-+]?\d+)?( ?[^\s\d]{1,3})?|-|[-+]?(nan|inf)"
)


@frozen
class Table:
    """Headings and rows of text; the first column names rows, numbers stand to the right."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def columns(self) -> list[tuple[str, ...]]:
        return list(zip(*self.rows, strict=True)) or [()] * len(self.headings)

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers, shape (column,)."""
        said = [[c for c in cells if c not in ("", "fixed")] for cells in self.columns[1:]]
        return (False, *(bool(cells) and all(map(_NUMBER.fullmatch, cells)) for cells in said))

    def text(self, width: int | None = None) -> str:
        """Return aligned columns; those that do not fit a width follow below, with the names."""
        columns: list[list[str]] = []
        told = zip(self.headings, *self.rows, strict=True)
        for texts, right in zip(told, self.numeric, strict=True):
            cells = [one_line(cell, CELL) for cell in texts]
            most = max(map(len, cells))
            columns.append([cell.rjust(most) if right else cell.ljust(most) for cell in cells])
        names, rest = columns[0], columns[1:]
        blocks = [[names]]
        for column in rest:
            used = sum(len(c[0]) + len(GAP) for c in blocks[-1])
            if width is not None and len(blocks[-1]) > 1 and used + len(column[0]) > width:
                blocks.append([names])
            blocks[-1].append(column)
        return "\n\n".join(
            "\n".join(GAP.join(row).rstrip() for row in zip(*block, strict=True))
            for block in blocks
        )

    def html(self) -> str:
        flows = (max(map(len, column), default=0) >= LONG for column in self.columns)
        marks = [
            'class="number"' if numeric else 'class="flow"' * flow
            for numeric, flow in zip(self.numeric, flows, strict=True)
        ]
        cells = zip(self.headings, marks, strict=True)
        lines = ["<table>", "<thead><tr>", *(_cell("th", text, mark) for text, mark in cells)]
        lines += ["</tr></thead>", "<tbody>"]
        for name, *values in self.rows:
            lines += ["<tr>", _cell("th", name, 'scope="row"')]
            lines += [_cell("td", text, m) for text, m in zip(values, marks[1:], strict=True)]
            lines += ["</tr>"]
        return "".join([*lines, "</tbody></table>"])


Page = Sequence[str | Table]


def page_text(page: Page, width: int | None = None) -> str:
    """Return sentences and tables as text, blank lines about tables; sentences break at a width."""
    parts: list[str] = []
    for index, part in enumerate(page):
        if isinstance(part, Table):
            if index and parts[-1]:
                parts.append("")
            parts += [part.text(width), ""]
        else:
            text = shortened(printable(part), SENTENCE)
            parts.append(text if width is None else _WRAP(max(width, NARROW)).fill(text))
    return "\n".join(parts).rstrip("\n")


def page_html(page: Page) -> str:
    return "".join(
        part.html() if isinstance(part, Table) else f"<p>{_escaped(part)}</p>" for part in page
    )


def by_hand(unit: str, size: float) -> tuple[str, float]:
    """Return the unit in which motion of such a size is told, and the factor from SI."""
    small = {"m": ("um", 1e6), "rad": ("urad", 1e6)} if size < 1 else {}
    return small.get(unit, (unit, 1.0))


def table(headings: Iterable[str], rows: Iterable[Iterable[str]]) -> Table:
    return Table(tuple(headings), tuple(tuple(row) for row in rows))


def _cell(tag: str, text: str, mark: str) -> str:
    said = _escaped(text)
    return f"<{tag} {mark}>{said}</{tag}>" if mark else f"<{tag}>{said}</{tag}>"


def _escaped(text: str) -> str:
    """Return a text for a page, where a newline is a blank like any other."""
    return escape(printable(text, keep="\n"))
