"""Reader of text tables: comma, semicolon or tab between the columns, names in the first row."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotorid.errors import InputError, ReadError
from rotorid.io.table import Column, content, head, no_column, not_what_it_says, too_large
from rotorid.record import Floats
from rotorid.units import check_unit

_HEADER_UNIT = re.compile(r"(?P<name>.*?\S)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))")
_COMMENT = ("#", "%")
_NUMPY_PLACE = re.compile(r"at row (\d+), column (\d+)")
_NUMPY_ROW = re.compile(r"at row (\d+)")


@dataclass(frozen=True)
class DelimitedTable:
    """An open text table; its numbers are read when they are asked for.

    Parameters
    ----------
    file : str
    names : tuple of str
        Names of the columns, without their units.
    units : tuple of str or None
        Units from the header (``x1 [um]``) or from a row of units below it.
    delimiter, encoding : str
    header_lines : int
        Lines before the numbers.
    decimal_comma : bool
    """

    file: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    delimiter: str
    encoding: str
    header_lines: int
    decimal_comma: bool

    def find(self, name: str) -> str:
        """Return the name of a column, once it is sure to be there once."""
        if name not in self.names:
            raise no_column(name, self.names, self.file)
        if self.names.count(name) > 1:
            raise ReadError(
                f"column {name!r} {self.names.count(name)} times",
                "a name that is unique in the file",
                "rename one",
                file=self.file,
            )
        return name

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by name."""
        wanted = list(dict.fromkeys(names))
        positions = [self.names.index(name) for name in wanted]
        numbers = self._numbers(positions)
        return {
            name: Column(np.ascontiguousarray(numbers[:, i]), self.units[position])
            for i, (name, position) in enumerate(zip(wanted, positions, strict=True))
        }

    def scalar(self, name: str) -> float:
        """Refuse: a text table has columns only."""
        raise ReadError(
            f"scale {name!r} in a text table",
            "a number, or a scalar variable of an HDF5 or MAT file",
            "write the number",
            file=self.file,
        )

    def _numbers(self, positions: list[int]) -> Floats:
        with (
            Path(self.file).open(encoding=self.encoding, errors="replace") as stream,
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore", UserWarning)  # numpy warns of a table without rows
            lines: Iterator[str] = iter(stream)
            for _ in range(self.header_lines):
                next(lines, None)
            if self.decimal_comma:
                lines = (line.replace(",", ".") for line in lines)
            try:
                return np.loadtxt(
                    lines, delimiter=self.delimiter, usecols=positions, ndmin=2, quotechar='"'
                )
            except ValueError as error:
                problem = str(error)
            except MemoryError:
                raise too_large(self.file) from None
        raise self._explain(problem)

    def _explain(self, problem: str) -> ReadError:
        """Turn numpy's message into the line and the column of this file."""
        place = _NUMPY_PLACE.search(problem)
        row = _NUMPY_ROW.search(problem)
        few = "could not convert" not in problem  # then numpy counts rows from 1, else from 0
        line = self._line(int(row.group(1)) - few) if row else 0
        if place is None or few:
            return ReadError(
                "too few columns" if row else problem,
                f"{len(self.names)} columns in each row",
                "complete or remove the row",
                file=self.file,
                place=f"line {line}" if row else "",
            )
        name = self.names[int(place.group(2)) - 1]
        value = problem.partition("string ")[2].partition(" to ")[0] or problem
        return ReadError(
            "an empty field" if value == "''" else value,
            "a number",
            "cut the record there, or leave the column out",
            file=self.file,
            place=f"line {line}, column {name}",
        )

    def _line(self, row: int) -> int:
        """Return the line of numpy's data row: it skips blank lines and comments."""
        with Path(self.file).open(encoding=self.encoding, errors="replace") as stream:
            for number, line in enumerate(stream, start=1):
                if number > self.header_lines and line.partition("#")[0].strip():
                    row -= 1
                if row < 0:
                    return number
        return 0


def open_delimited(path: Path) -> DelimitedTable:
    """Open a text table: find its delimiter, its names and its units."""
    start = head(path)
    encoding = _encoding(start)
    if encoding != "utf-16" and content(start) != "text":
        raise not_what_it_says(path, start, "a text table")
    numbered = _first_lines(path, encoding)
    if not numbered:
        raise ReadError("comments only", "a row of names", "write one", file=str(path))
    (last, header), *rest = numbered
    delimiter = next((mark for mark in "\t;," if mark in header), ",")
    fields = _split(header, delimiter)
    while len(fields) > 1 and not fields[-1]:  # rows that end in a delimiter
        fields.pop()
    if all(_is_number(field) for field in fields):
        raise ReadError(
            f"numbers ({header.strip()[:40]})",
            "a row of column names first",
            "write one, such as t,x1,y1",
            file=str(path),
            place=f"line {last}",
        )
    pairs = [_name_and_unit(field) for field in fields]
    if rest and _is_unit_row(_split(rest[0][1], delimiter)):
        last, row = rest.pop(0)
        row_units = [field.strip("[]() ") for field in _split(row, delimiter)]
        row_units += [""] * (len(pairs) - len(row_units))
        pairs = [
            (name, unit or other.strip("-") or None)
            for (name, unit), other in zip(pairs, row_units, strict=False)
        ]
    return DelimitedTable(
        file=str(path),
        names=tuple(name for name, _ in pairs),
        units=tuple(unit for _, unit in pairs),
        delimiter=delimiter,
        encoding=encoding,
        header_lines=last,
        decimal_comma=delimiter != "," and bool(rest) and "," in rest[0][1],
    )


def _encoding(start: bytes) -> str:
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        start[: start.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _first_lines(path: Path, encoding: str) -> list[tuple[int, str]]:
    """Return the first three lines that say something, and their numbers."""
    found: list[tuple[int, str]] = []
    with path.open(encoding=encoding, errors="replace") as stream:
        for number, line in enumerate(iter(lambda: stream.readline(1 << 20), ""), start=1):
            if line.strip() and not line.lstrip().startswith(_COMMENT):
                found.append((number, line))
            if len(found) == 3:
                break
    return found


def _split(line: str, delimiter: str) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line.strip()], delimiter=delimiter))]
    except csv.Error:
        return [line.strip()]


def _is_number(field: str) -> bool:
    try:
        float(field.replace(",", "."))
    except ValueError:
        return False
    return True


def _is_unit_row(fields: list[str]) -> bool:
    """Tell whether a row holds units: nothing else stands in it, and not numbers alone."""
    texts = [field.strip("[]() ") for field in fields]
    return all(not t or t == "-" or _is_unit(t) for t in texts) and not all(
        _is_number(t) or not t for t in texts
    )


def _is_unit(text: str) -> bool:
    try:
        check_unit(text)
    except InputError:
        return False
    return True


def _name_and_unit(field: str) -> tuple[str, str | None]:
    match = _HEADER_UNIT.fullmatch(field)
    unit = (match["square"] or match["round"] or "").strip() if match else ""
    if match and (unit in ("", "-") or _is_unit(unit)):
        return match["name"], unit.strip("-") or None
    return field, None
