"""How a text table is written: preamble, names, units, delimiter, decimal mark, sample rate."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence

from rotorid.errors import InputError, ReadError
from rotorid.frozen import frozen
from rotorid.io.preamble import stated_rate
from rotorid.io.table import Rate
from rotorid.limits import COLUMNS, DIGITS, UNIT_CHARACTERS
from rotorid.units import check_unit

COMMENTS = ("#", "%")
_BRACKETS = {"]": "[", ")": "("}
_PAIRS = tuple(_BRACKETS.items())
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][+-]?\d+)?|[+-]?(?:nan|inf)", re.I)
CLOCK = re.compile(
    r"(?:\d{4}[-/]\d\d?[-/]\d\d?[T ]|\d\d?[./]\d\d?[./]\d{2,4} )?"
    r"(?:\d{1,3}:)?\d{1,2}:\d{2}(?:[.,]\d*)?Z?"
)
"""A time of day, ``12:30:01.250``, perhaps with its date."""
_DELIMITERS = ("\t", ";", ",", " ")
_BODY = 12  # rows from which the delimiter is judged


@frozen
class Dialect:
    """How a text table is written.

    Parameters
    ----------
    names : tuple of str
        Names of the columns without their units; their numbers from 0 where there are none.
    units : tuple of str or None
        From the names (``x1 [um]``), or from a row of units beside them.
    delimiter : str
        A blank stands for any white space.
    fields : int
        Fields of a row of numbers.
    header_lines : int
        Lines before the numbers.
    decimal_comma : bool
    clocks : tuple of bool
        The columns that hold times of day.
    rate : Rate or None
        What the lines before the numbers say.
    named : bool
        The names stand in the file.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    delimiter: str
    fields: int
    header_lines: int
    decimal_comma: bool
    clocks: tuple[bool, ...]
    rate: Rate | None
    named: bool


def find_dialect(lines: Sequence[str], header_row: int | None = None) -> Dialect | None:
    """Find how a table is written from its first lines; None where there are no rows of values.

    Parameters
    ----------
    lines : sequence of str
    header_row : int, optional
        The line of the names, from 1; 0 where there are none.
    """
    told = [i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in COMMENTS]
    if header_row:
        told = [i for i in told if i >= header_row]
    body = [lines[i] for i in told[-_BODY:]]
    delimiter = max(_DELIMITERS, key=lambda mark: _score(body, mark))
    if header_row and len(told) < 1:
        return None
    rows = {i: split(lines[i], delimiter) for i in told}
    start = _first_row(rows, told, named=header_row is None)
    if start is None:
        return None
    row = rows[start]
    fields = len(row)
    if fields > COLUMNS:
        raise ReadError(
            f"{fields} columns", f"{COLUMNS} at most", "export a part of them, or to HDF5"
        )
    header, unit_row = None, None
    if header_row:
        header = header_row - 1
        unit_row = next((i for i in told if header < i < start), None)
    elif header_row is None:
        header, unit_row = _header(lines, rows, told, start, delimiter)
    pairs = _names(lines, header, unit_row, fields, delimiter)
    mark = _decimal_mark([field for i in told if i >= start for field in rows[i]], delimiter)
    return Dialect(
        names=tuple(name for name, _ in pairs),
        units=tuple(unit for _, unit in pairs),
        delimiter=delimiter,
        fields=fields,
        header_lines=start,
        decimal_comma=mark == ",",
        clocks=tuple(bool(CLOCK.fullmatch(field)) for field in row[: len(pairs)]),
        rate=stated_rate(lines[:start], delimiter, mark),
        named=header is not None,
    )


def split(line: str, delimiter: str) -> list[str]:
    """Split a row into its fields, without blanks around them."""
    line = line.strip("\r\n\ufeff") if delimiter == "\t" else line.strip()
    if delimiter == " ":
        return line.split()
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=delimiter))]
    except (csv.Error, StopIteration):
        return [line.strip()]


def is_value(field: str) -> bool:
    """Tell whether a field is a number or a time of day."""
    return len(field) <= DIGITS and bool(_NUMBER.fullmatch(field) or CLOCK.fullmatch(field))


def _decimal_mark(fields: Sequence[str], delimiter: str) -> str:
    """Return the decimal mark of a table; empty where all its numbers are whole.

    Raises
    ------
    ReadError
        Where numbers have commas and others points: one of the two stands between thousands.
    """
    if delimiter == ",":
        return "."
    first = {
        mark: next((f for f in fields if mark in f and _NUMBER.fullmatch(f)), "") for mark in ",."
    }
    if all(first.values()):
        shown = " and ".join(repr(field[:40]) for field in first.values())
        raise ReadError(
            f"numbers with commas and with points, {shown}",
            "one decimal mark",
            "export the table without marks between thousands",
        )
    return next((mark for mark, field in first.items() if field), "")


def _score(body: Sequence[str], delimiter: str) -> int:
    """Return how many values a delimiter makes of the rows, each in a column of its own."""
    rows = [split(line, delimiter) for line in body]
    counts = Counter(len(row) for row in rows)
    if not counts:
        return 0
    usual = max(counts, key=lambda n: (counts[n], n))
    return sum(is_value(field) for row in rows if len(row) == usual > 1 for field in row)


def _first_row(rows: dict[int, list[str]], told: list[int], *, named: bool) -> int | None:
    """Return the line of the first row of values."""
    last = [rows[i] for i in told[-_BODY:]]
    valued = [row for row in last if any(is_value(field) for field in row)]
    if not valued:
        return None
    fields = Counter(len(row) for row in valued).most_common(1)[0][0]
    full = [row for row in valued if len(row) == fields]
    columns = [
        c for c in range(fields) if 2 * sum(is_value(row[c]) for row in full) > len(full)
    ] or [0]

    def fits(row: list[str], least: int) -> bool:
        return len(row) == fields and sum(is_value(row[c]) for c in columns) >= least

    found = next((n for n, i in enumerate(told) if fits(rows[i], len(columns))), None)
    if found is None:
        found = next((n for n, i in enumerate(told) if fits(rows[i], 1)), None)
    if found is None:
        return None
    # A row that is damaged is no name: only text is.
    while (
        named
        and found > 0
        and fits(rows[told[found - 1]], 1)
        and is_value(rows[told[found - 1]][0])
    ):
        found -= 1
    return told[found]


def _header(
    lines: Sequence[str],
    rows: dict[int, list[str]],
    told: list[int],
    start: int,
    delimiter: str,
) -> tuple[int | None, int | None]:
    """Return the lines of the names and of the units above the first row of values."""
    fields = len(rows[start])
    while fields > 1 and not rows[start][fields - 1]:
        fields -= 1  # a row that ends in a delimiter
    above = [i for i in told if i < start]
    texts = []
    for i in reversed(above[-3:]):
        if len(rows[i]) < fields or any(is_value(field) for field in rows[i]):
            break
        texts.append(i)
    if not texts:  # the names may stand in a comment, as numpy writes them
        for i in reversed(range(start)):
            row = split(lines[i].lstrip().lstrip("#%"), delimiter)
            if lines[i].strip() and len(row) == fields > 1 and not any(map(is_value, row)):
                return i, None
            if lines[i].strip():
                break
        return None, None
    if len(texts) > 1 and _is_unit_row(rows[texts[0]]):
        return texts[1], texts[0]
    if len(texts) > 1 and _is_unit_row(rows[texts[1]]):
        return texts[0], texts[1]
    return texts[0], None


def _names(
    lines: Sequence[str], header: int | None, unit_row: int | None, fields: int, delimiter: str
) -> list[tuple[str, str | None]]:
    if header is None:
        return [(str(number), None) for number in range(fields)]
    names = split(lines[header].lstrip().lstrip("#%"), delimiter)
    while len(names) > 1 and not names[-1]:  # rows that end in a delimiter
        names.pop()
    if len(names) > fields:
        names = _whole_names(names, fields, delimiter, header + 1)
    pairs = [_name_and_unit(name) for name in names[:fields]]
    pairs = [(name or str(number), unit) for number, (name, unit) in enumerate(pairs)]
    if unit_row is not None:
        units = [field.strip("[]() ") for field in split(lines[unit_row], delimiter)]
        units = ["" if unit in _OTHER_UNITS else unit for unit in units]
        units += [""] * (len(pairs) - len(units))
        pairs = [
            (name, unit or other.strip("-") or None)
            for (name, unit), other in zip(pairs, units, strict=False)
        ]
    return pairs


def _whole_names(names: list[str], fields: int, delimiter: str, line: int) -> list[str]:
    """Put names together that hold the delimiter in brackets, as ``Time (s)`` may.

    Raises
    ------
    ReadError
        Where there are more names than columns even so: nothing tells whose they are.
    """
    whole: list[str] = []
    for name in names:
        unit = delimiter == " " and name[:1] in _BRACKETS.values()
        if whole and (unit or any(whole[-1].count(o) > whole[-1].count(c) for c, o in _PAIRS)):
            whole[-1] += delimiter + name
        else:
            whole.append(name)
    if len(whole) == fields + 1 and whole[-1].lower() == "comment":  # LabVIEW's, mostly empty
        whole.pop()
    if len(whole) != fields:
        raise ReadError(
            f"{len(names)} names for {fields} columns",
            "a name for each column",
            "name each column once there, or set header_row = 0 and call the columns 0, 1, 2",
            place=f"line {line}",
        )
    return whole


def _is_unit_row(fields: list[str]) -> bool:
    """Tell whether a row holds units, of some that no record needs too: nothing else is in it."""
    texts = [field.strip("[]() ") for field in fields]
    stated = [t for t in texts if t and t != "-" and t not in _OTHER_UNITS]
    return bool(stated) and all(map(_is_unit, stated))


_OTHER_UNITS = {"°C", "ºC", "degC", "°F", "degF", "dB", "VDC", "VAC", "Vpp", "Ohm", "inc", "digits"}
"""Units of what a logger writes beside: temperatures have another zero, levels another scale."""


def _is_unit(text: str) -> bool:
    if len(text) > UNIT_CHARACTERS:
        return False
    try:
        check_unit(text)
    except InputError:
        return False
    return True


def _name_and_unit(field: str) -> tuple[str, str | None]:
    """Split ``x1 [um]`` into name and unit: what stands in the brackets at the end."""
    opening = _BRACKETS.get(field[-1:])
    if opening is None:
        return field, None
    begin = field.find(opening, max(field.rfind(field[-1], 0, -1), 0))
    name, unit = field[: max(begin, 0)].rstrip(), field[begin + 1 : -1].strip()
    if name.strip() and (unit in ("", "-") or _is_unit(unit)):
        return name, unit.strip("-") or None
    return field, None
