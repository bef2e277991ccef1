"""Text tables: dialect, preamble, numbers. What may be read in two ways is not read.

The rate then has to be given; one misread by a thousand makes masses a million times too large.
"""

from __future__ import annotations

import csv
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cached_property, partial
from itertools import islice, takewhile
from pathlib import Path
from typing import IO

import numpy as np

from rotorid.core.errors import InputError, ReadError, naming
from rotorid.core.files import open_regular
from rotorid.core.units import BRACKETS, is_unit, name_and_unit, si_factor
from rotorid.core.values import Floats, frozen
from rotorid.io.sandbox import too_large
from rotorid.io.table import COLUMNS, Column, Rate, content, no_column, not_what_it_says, seconds

LINE_CHARACTERS = 1 << 20
"""Of a line: ten thousand columns of a hundred characters."""
DIGITS = 400
"""Characters of a number: a double ends at 309 digits."""
PREAMBLE_CHARACTERS = 500
"""Of a line above the numbers that is searched for the sample rate."""
SLOWEST = 10.0
"""Hz: no rotor is sampled more slowly, while a rate that lost three digits to a thousands mark is
below it, and so is one made of how long was recorded, or of the hour of the day."""
# Every part takes all that it can and gives nothing back: the time grows with the line alone.
_VALUE = (
    r"[^\d+\-.\[(]*+(?:[\[(](?P<unit>[^\])]*+)[\])])?[^\d+\-.]*+"
    r"(?P<value>[\d.,]++(?:[eE][+-]?\d++)?)(?P<gap>[\s;,\"]*+)(?P<after>[^\s;,\"]*+)"
)
_RATE = re.compile(
    r"(?:sampl(?:e|ing)[ _-]?(?:rate|freq(?:uency)?)|scan[ _-]?rate)\b" + _VALUE, re.I
)
_STEP = re.compile(
    r"(?:delta_x|sampl(?:e|ing)[ _-]?(?:interval|time|period)|time[ _-]?step)\b" + _VALUE, re.I
)
_GROUPS = r"[1-9]\d{0,2}(?:%s\d{3})+"
_PER_SECOND = re.compile(
    r"(k|m|g)?(?:hz|sa?/s(?:ec)?|sps|samples/s(?:ec(?:ond)?)?)|1/s|s\^-1", re.I
)
_PREFIXES = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9}
_SECONDS = {"s": "s", "sec": "s", "ms": "ms", "msec": "ms", "us": "us", "µs": "us", "ns": "ns"}


def stated_rate(lines: Sequence[str], delimiter: str, mark: str) -> Rate | None:
    """Return the sample rate that the lines before the numbers state, if beyond doubt."""
    for line in lines:
        for pattern, unit in ((_RATE, "Hz"), (_STEP, "s")):
            match = pattern.search(line[:PREAMBLE_CHARACTERS])
            found = match and number(match["value"], delimiter, mark)
            if match and found:
                size = found[0] * (_factor(match, unit) or 0.0)
                hertz = 1 / size if size and unit == "s" else size
                if hertz >= SLOWEST:
                    return Rate(hertz, max(found[1], Rate.rounding))
    return None


def number(text: str, delimiter: str, mark: str) -> tuple[float, float] | None:
    """Return a number, and how far it may be off, relative, for its digits where it is not whole.

    A comma or point before groups of three digits is a decimal mark, or stands between thousands:
    the numbers of the table tell which. None where they do not.
    """
    mantissa, _, exponent = text.lower().strip(".,").partition("e")
    if delimiter == "," and not re.fullmatch(_GROUPS % "," + r"(?:\.\d*)?", mantissa):
        mantissa, comma, _ = mantissa.partition(",")  # what follows is another field
        exponent = "" if comma else exponent
    decimal = max((m for m in ",." if m in mantissa), key=mantissa.rfind, default="")
    if decimal and re.fullmatch(_GROUPS % re.escape(decimal), mantissa):
        several = mantissa.count(decimal) > 1
        known = "." if delimiter == "," else mark
        if not known and decimal == "," and not several:
            return None
        if several or (known and decimal != known):
            decimal = ""  # it stands between thousands
    whole, _, part = mantissa.partition(decimal) if decimal else (mantissa, "", "")
    other = re.sub(r"\d", "", whole)
    if other and not re.fullmatch(_GROUPS % re.escape(other[0]), whole):
        return None
    digits = re.sub(r"\D", "", whole)
    if not re.fullmatch(r"\d*", part) or not digits + part:
        return None
    try:
        value = float(f"{digits}.{part}e{exponent or 0}")
    except ValueError:
        return None
    return value, 0.5 * 10.0 ** (1 - len((digits + part).lstrip("0"))) if decimal else 0.0


def _factor(match: re.Match[str], base: str) -> float | None:
    """Return what turns a number into Hz or s; None for a unit, or a word, that says nothing."""
    # Behind a delimiter stands a field of its own, which may be anything.
    before = match["value"] + match["gap"]
    beside = before[-1:].isdigit() or before.endswith(" ")
    for text, sure in ((match["after"], beside), (match["unit"] or "", True)):
        known = _known(text.strip(), base) if text else None
        if known is not None:
            return known
        if text and (sure or "/s" in text or "hz" in text.lower()):
            return None
    return 1.0


def _known(text: str, base: str) -> float | None:
    if base == "Hz":
        match = _PER_SECOND.fullmatch(text)
        return None if match is None else _PREFIXES[(match[1] or "").lower()]
    try:
        return si_factor(_SECONDS.get(text.lower(), text), base)
    except InputError:
        return None


COMMENTS = ("#", "%")
_PAIRS = tuple(BRACKETS.items())
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
    # names of the columns without their units; their numbers from 0 where there are none
    names: tuple[str, ...]
    words: tuple[str, ...]  # the columns without any number, as far as the table is looked at
    # from the names (``x1 [um]``), or from a row of units beside them
    units: tuple[str | None, ...]
    delimiter: str  # A blank stands for any white space
    fields: int  # fields of a row of numbers
    header_lines: int  # lines before the numbers
    decimal_comma: bool
    clocks: tuple[bool, ...]  # the columns that hold times of day
    rate: Rate | None  # what the lines before the numbers say
    named: bool  # the names stand in the file


def find_dialect(lines: Sequence[str], header_row: int | None = None) -> Dialect | None:
    """Find how a table is written; None without rows of values. `header_row` counts from 1."""
    told = [i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in COMMENTS]
    if header_row:
        told = [i for i in told if i >= header_row]
    body = [lines[i] for i in told[-_BODY:]]
    delimiter = max(_DELIMITERS, key=lambda mark: _score(body, mark))
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
        header, unit_row = _header(lines, rows, start, delimiter)
    pairs = _names(lines, header, unit_row, fields, delimiter)
    values = [rows[i] for i in told if i >= start]
    mark = _decimal_mark([field for row in values for field in row], delimiter)
    return Dialect(
        names=tuple(name for name, _ in pairs),
        words=tuple(
            name
            for place, (name, _) in enumerate(pairs)
            if not any(is_value(field) for row in values for field in row[place : place + 1])
        ),
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
    line = line.strip("\r\n\ufeff") if delimiter == "\t" else line.strip()
    if delimiter == " ":
        return line.split()
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=delimiter))]
    except (csv.Error, StopIteration):
        return [line.strip()]


def is_value(field: str) -> bool:
    return len(field) <= DIGITS and bool(_NUMBER.fullmatch(field) or CLOCK.fullmatch(field))


def _decimal_mark(fields: Sequence[str], delimiter: str) -> str:
    """Return the decimal mark, empty where all numbers are whole; refuse commas beside points."""
    if delimiter == ",":
        return "."
    first = {
        mark: next((f for f in fields if mark in f and _NUMBER.fullmatch(f)), "") for mark in ",."
    }
    if all(first.values()):
        shown = " and ".join(repr(field[:40]) for field in first.values())
        cure = "export the table without marks between thousands"
        raise ReadError(f"numbers with commas and with points, {shown}", "one decimal mark", cure)
    return next((mark for mark, field in first.items() if field), "")


def _score(body: Sequence[str], delimiter: str) -> int:
    """Return how many values a delimiter makes of the rows, each in a column of its own."""
    rows = [split(line, delimiter) for line in body]
    counts = Counter(len(row) for row in rows)
    usual = max(counts, key=lambda n: (counts[n], n), default=0)
    return sum(is_value(field) for row in rows if len(row) == usual > 1 for field in row)


def _first_row(rows: dict[int, list[str]], lines: list[int], *, named: bool) -> int | None:
    valued = [rows[i] for i in lines[-_BODY:] if any(map(is_value, rows[i]))]
    if not valued:
        return None
    fields = Counter(len(row) for row in valued).most_common(1)[0][0]
    full = [[is_value(field) for field in row] for row in valued if len(row) == fields]
    columns = [c for c, told in enumerate(zip(*full, strict=True)) if 2 * sum(told) > len(told)]
    columns = columns or [0]
    counts = [
        sum(is_value(rows[i][c]) for c in columns) if len(rows[i]) == fields else 0 for i in lines
    ]
    whole = len(columns) if len(columns) in counts else 1
    found = next((n for n, count in enumerate(counts) if count >= whole), None)
    if found is None:
        return None
    # A row that is damaged is no name: only text is.
    while named and found and counts[found - 1] and is_value(rows[lines[found - 1]][0]):
        found -= 1
    return lines[found]


def _header(
    lines: Sequence[str], rows: dict[int, list[str]], start: int, delimiter: str
) -> tuple[int | None, int | None]:
    """Return the lines of the names and of the units above the first row of values."""
    fields = len(rows[start])
    while fields > 1 and not rows[start][fields - 1]:
        fields -= 1  # a row that ends in a delimiter
    above = [i for i in rows if i < start]
    texts = list(takewhile(lambda i: _is_text(rows[i], fields), reversed(above[-3:])))
    if not texts:  # the names may stand in a comment, as numpy writes them
        last = next((i for i in reversed(range(start)) if lines[i].strip()), start)
        row = split(lines[last].lstrip().lstrip("#%"), delimiter)
        is_names = last < start and len(row) == fields > 1 and _is_text(row, fields)
        return (last if is_names else None), None
    if len(texts) > 1 and _is_unit_row(rows[texts[0]]):
        return texts[1], texts[0]
    units = texts[1] if len(texts) > 1 and _is_unit_row(rows[texts[1]]) else None
    return texts[0], units


def _is_text(row: list[str], fields: int) -> bool:
    return len(row) >= fields and not any(map(_is_numbers, row))


def _is_numbers(field: str) -> bool:
    """Tell whether values are all that a field holds: one, or a row of what has other marks."""
    return bool(parts := re.split(r"[;,\s]+", field.strip())) and all(map(is_value, parts))


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
    pairs = [name_and_unit(name) for name in names[:fields]]
    pairs = [(name or str(number), unit) for number, (name, unit) in enumerate(pairs)]
    if unit_row is not None:
        texts = [field.strip("[]() ") for field in split(lines[unit_row], delimiter)]
        units = ["" if unit in _OTHER_UNITS else unit.strip("-") for unit in texts]
        units += [""] * (len(pairs) - len(units))
        pairs = [(n, unit or other or None) for (n, unit), other in zip(pairs, units, strict=False)]
    return pairs


def _whole_names(names: list[str], fields: int, delimiter: str, line: int) -> list[str]:
    """Join names that hold the delimiter in brackets, as ``Time (s)``; refuse more than columns."""
    whole: list[str] = []
    for name in names:
        unit = delimiter == " " and name[:1] in BRACKETS.values()
        if whole and (unit or any(whole[-1].count(o) > whole[-1].count(c) for c, o in _PAIRS)):
            whole[-1] += delimiter + name
        else:
            whole.append(name)
    if len(whole) == fields + 1 and whole[-1].lower() == "comment":  # LabVIEW's, mostly empty
        whole.pop()
    if len(whole) != fields:
        found = f"{len(names)} names for {fields} columns"
        cure = "name each column once there, or set header_row = 0 and call the columns 0, 1, 2"
        raise ReadError(found, "a name for each column", cure, place=f"line {line}")
    return whole


def _is_unit_row(fields: list[str]) -> bool:
    """Tell whether a row holds units, of some that no record needs too: nothing else is in it."""
    texts = [field.strip("[]() ") for field in fields]
    stated = [t for t in texts if t and t != "-" and t not in _OTHER_UNITS]
    return bool(stated) and all(map(is_unit, stated))


_OTHER_UNITS = {"°C", "ºC", "degC", "°F", "degF", "dB", "VDC", "VAC", "Vpp", "Ohm", "inc", "digits"}
"""Units of what a logger writes beside: temperatures have another zero, levels another scale."""


_HEAD_LINES = 400
_DAY = 86400.0


@frozen
class DelimitedTable:
    file: str
    dialect: Dialect
    encoding: str

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: place for place, name in enumerate(self.dialect.names)}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name in self.dialect.names if name not in self.dialect.words)

    def find(self, name: str) -> str:
        if name not in self._places:
            error = no_column(name, self.dialect.names, self.file)
            if not self.dialect.named:
                error.cure = (
                    "name columns by their number, from 0, or say where the names are: header_row"
                )
            raise error
        count = self.dialect.names.count(name) if len(self._places) < len(self.dialect.names) else 1
        if count > 1:
            expected = "a name that is unique in the file"
            cure = "rename one"
            raise ReadError(f"column {name!r} {count} times", expected, cure, file=self.file)
        return name

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        told, wanted = self.dialect, {name: self._places[name] for name in names}
        numbers = [place for place in wanted.values() if not told.clocks[place]]
        read = dict(zip(numbers, self._numbers(numbers) if numbers else (), strict=True))
        return {
            name: Column(read[place], told.units[place], told.rate)
            if place in read
            else Column(self._clock(place), "s", None)
            for name, place in wanted.items()
        }

    def read_each(self, names: Sequence[str]) -> dict[str, Column | InputError]:
        """Return columns, or why one cannot be read: by two passes through the file at most."""
        with suppress(InputError):
            return {**self.read(names)}
        found = dict(self._wrong(names))
        return {**found, **self.read(name for name in names if name not in found)}

    def _wrong(self, names: Iterable[str]) -> Iterator[tuple[str, ReadError]]:
        """Yield the columns with a field that is no number or time, with the first such field."""
        left = {name: self._places[name] for name in names}
        for line, fields in self._rows():
            for name, place in list(left.items()):
                text = fields[place] if place < len(fields) else None
                if text is None or not self._is_value(text, place):
                    del left[name]
                    yield name, self._no_value(text, line, place)
            if not left:
                return

    def _is_value(self, text: str, place: int) -> bool:
        """Tell whether numpy takes a field for a number, or a clock's for a time."""
        if self.dialect.clocks[place]:
            return CLOCK.fullmatch(text) is not None
        text = _pointed(text) if self.dialect.decimal_comma else text
        try:
            float(text)
        except ValueError:
            return False
        return text.isascii() and "_" not in text

    def _no_value(self, text: str | None, line: int, place: int) -> ReadError:
        at = f"line {line}" if text is None else f"line {line}, column {self.dialect.names[place]}"
        found = repr(text)[:80] if text else "an empty field"
        if text is None:
            found, expected = "too few columns", f"{len(self.dialect.names)} columns in each row"
            cure = "complete or remove the row"
        elif self.dialect.clocks[place]:
            expected, cure = "a time such as 12:30:01.250", "correct or remove the row"
        else:
            expected, cure = "a number", "cut the record there, or leave the column out"
        return ReadError(found, expected, cure, file=self.file, place=at)

    def texts(self, name: str) -> list[str]:
        return [fields[self._places[name]] for _, fields in self._rows()]

    def scalar(self, name: str) -> float:
        expected = "a number, or a scalar variable of an HDF5 or MAT file"
        cure = "write the number"
        raise ReadError(f"scale {name!r} in a text table", expected, cure, file=self.file)

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        for number, line in enumerate(self._lines(), start=self.dialect.header_lines + 1):
            text = line.partition("#")[0]
            if text.strip():
                yield number, split(text, self.dialect.delimiter)

    def _lines(self) -> Iterator[str]:
        """Yield the lines of values; of one without end only the beginning is read."""
        with Path(self.file).open(encoding=self.encoding, errors="replace") as stream:
            lines = iter(partial(stream.readline, LINE_CHARACTERS), "")
            for line in islice(lines, self.dialect.header_lines, None):
                if len(line) == LINE_CHARACTERS and not line.endswith("\n"):
                    found = f"a line of more than {LINE_CHARACTERS} characters"
                    cure = "export the record anew; this is no table, or it was damaged"
                    raise ReadError(found, "lines of a table", cure, file=self.file)
                yield line

    def _numbers(self, positions: list[int]) -> list[Floats]:
        """Return columns of numbers; nothing of the text is kept, and each number at most twice."""
        delimiter = None if self.dialect.delimiter == " " else self.dialect.delimiter
        lines = map(_pointed, self._lines()) if self.dialect.decimal_comma else self._lines()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # numpy warns of a table without rows
            try:
                table = np.loadtxt(
                    lines, delimiter=delimiter, usecols=positions, ndmin=2, quotechar='"'
                )
                return [np.ascontiguousarray(column) for column in table.T]
            except InputError:
                raise
            except ValueError as error:
                found, expected = str(error)[:160], f"{len(self.dialect.names)} columns in each row"
            except MemoryError:
                raise too_large(self.file) from None
        for _, wrong in self._wrong(self.dialect.names[place] for place in positions):
            raise wrong
        raise ReadError(found, expected, "complete or remove the row", file=self.file)

    def _clock(self, position: int) -> Floats:
        name = self.dialect.names[position]
        for _, wrong in self._wrong([name]):
            raise wrong
        try:
            return seconds_of_day([fields[position] for _, fields in self._rows()])
        except (ValueError, OverflowError) as error:
            raise ReadError(
                str(error)[:120],
                "times of days that there are",
                "correct or remove the row",
                file=self.file,
                place=f"column {name}",
            ) from None


def _pointed(text: str) -> str:
    """Write a decimal comma as a point; a point would stand between thousands."""
    return text.replace(".", "'").replace(",", ".")


def _says_nothing(line: str) -> bool:
    return not line.partition("#")[0].strip() or line.lstrip().startswith(COMMENTS)


def seconds_of_day(texts: list[str]) -> Floats:
    """Return times of day, with their date or without, in s from the first."""
    if re.match(r"\d{4}-", texts[0]):
        iso = [t.rstrip("Z").replace(",", ".").replace(" ", "T") for t in texts]
        return seconds(np.array(iso, dtype="datetime64[ns]"))
    parts = [t.rstrip("Z").replace(",", ".").split(" ")[-1].split("T")[-1] for t in texts]
    pieces = ((0.0, 0.0, *map(float, part.split(":")))[-3:] for part in parts)
    times = np.array([60 * (60 * hours + minutes) + rest for hours, minutes, rest in pieces])
    # A clock without date starts again at midnight.
    days = np.concatenate([[0], np.cumsum(np.diff(times) < -_DAY / 2)])
    return np.asarray(times - times[0] + _DAY * days, dtype=float)


def open_delimited(path: Path, *, header_row: int | None = None) -> DelimitedTable:
    """Open a text table; its names are in line `header_row`, from 1, or above the values."""
    with open_regular(path, "a file of samples") as opened:
        encoding = _encoding(opened.read(65536))
    if encoding != "utf-16" and (found := content(path)) != "text":
        raise not_what_it_says(path, found, "a text table")
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = _first_lines(stream, _HEAD_LINES + (header_row or 0))
    if header_row and (
        header_row > len(lines) or _says_nothing(lines[header_row - 1].lstrip("#%"))
    ):
        raise ReadError(
            f"nothing in line {header_row}",
            "a row of names there",
            "correct header_row",
            file=str(path),
            place="header_row",
        )
    with naming(str(path)):
        dialect = find_dialect(lines, header_row)
    if dialect is None:
        texts = [line for line in lines if not _says_nothing(line)]
        expected = "rows of numbers below a row of names"
        cure = "check the file; header_row says in which line the names are"
        raise ReadError("no samples" if texts else "comments only", expected, cure, file=str(path))
    return DelimitedTable(str(path), dialect, encoding)


def _first_lines(stream: IO[str], count: int) -> list[str]:
    """Return the first lines, fewer where they are very long."""
    lines, length = list[str](), 0
    while len(lines) < count and length < LINE_CHARACTERS:
        if not (line := stream.readline(LINE_CHARACTERS)):
            break
        lines.append(line)
        length += len(line)
    return lines


def _encoding(start: bytes) -> str:
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    with suppress(UnicodeDecodeError):
        start[: start.rfind(b"\n") + 1].decode("utf-8")
        return "utf-8-sig"
    return "latin-1"
