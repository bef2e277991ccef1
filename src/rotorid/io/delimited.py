"""Reader of text tables, as loggers, spreadsheets and measurement programs write them."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from rotorid.errors import InputError, ReadError
from rotorid.frozen import frozen
from rotorid.io.dialect import CLOCK, COMMENTS, Dialect, find_dialect, split
from rotorid.io.table import Column, content, head, no_column, not_what_it_says, too_large
from rotorid.limits import DIGITS, LINE_CHARACTERS, SMALL_TEXT
from rotorid.record import Floats

_NUMPY_PLACE = re.compile(r"at row (\d+), column (\d+)")
_NUMPY_ROW = re.compile(r"at row (\d+)")
_HEAD_LINES = 400
_FAST = 32_000_000  # bytes from which on pyarrow, where it is installed, saves more than its import
_DAY = 86400.0


@frozen
class DelimitedTable:
    """An open text table; its numbers are read when they are asked for."""

    file: str
    dialect: Dialect
    encoding: str

    @property
    def _size(self) -> int:
        return Path(self.file).stat().st_size

    @cached_property
    def _counts(self) -> Counter[str]:
        return Counter(self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, without their units."""
        return self.dialect.names

    @property
    def units(self) -> tuple[str | None, ...]:
        """Units of the columns, where the file states them."""
        return self.dialect.units

    def find(self, name: str) -> str:
        """Return the name of a column, once it is sure to be there once."""
        count = self._counts.get(name, 0)
        if not count:
            error = no_column(name, self.names, self.file)
            if not self.dialect.named:
                cure = (
                    "name columns by their number, from 0, or say where the names are: header_row"
                )
                raise ReadError(error.found, error.expected, cure, file=self.file)
            raise error
        if count > 1:
            raise ReadError(
                f"column {name!r} {count} times",
                "a name that is unique in the file",
                "rename one",
                file=self.file,
            )
        return name

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by name."""
        wanted = list(dict.fromkeys(names))
        places = {name: place for place, name in enumerate(self.names)}
        position = {name: places[name] for name in wanted}
        numbers = [p for p in position.values() if not self.dialect.clocks[p]]
        read = dict(zip(numbers, self._numbers(numbers) if numbers else (), strict=True))
        columns = {}
        for name, place in position.items():
            if self.dialect.clocks[place]:
                columns[name] = Column(self._clock(place), "s", None)
            else:
                columns[name] = Column(read[place], self.units[place], self.dialect.rate)
        return columns

    def scalar(self, name: str) -> float:
        """Refuse: a text table has columns only."""
        raise ReadError(
            f"scale {name!r} in a text table",
            "a number, or a scalar variable of an HDF5 or MAT file",
            "write the number",
            file=self.file,
        )

    def _lines(self, stream: IO[str]) -> Iterator[str]:
        """Return the lines of values; those of a decimal comma with a point."""
        lines = self._bounded(stream)
        next(islice(lines, self.dialect.header_lines, self.dialect.header_lines), None)
        if self.dialect.decimal_comma:  # a point would stand between thousands
            return (line.replace(".", "'").replace(",", ".") for line in lines)
        return lines

    def _bounded(self, stream: IO[str]) -> Iterator[str]:
        """Return the lines of a text; refuse one that never seems to end.

        In a small file none can; looking at each takes a seventh of the time of reading numbers.
        """
        return iter(stream) if self._size <= SMALL_TEXT else self._checked(stream)

    def _checked(self, stream: IO[str]) -> Iterator[str]:
        """Return the lines of a large text."""
        for line in iter(partial(stream.readline, LINE_CHARACTERS), ""):
            if len(line) >= LINE_CHARACTERS:
                raise ReadError(
                    f"a line of more than {LINE_CHARACTERS} characters",
                    "lines of a table",
                    "export the record anew; this is no table, or it was damaged",
                    file=self.file,
                )
            yield line

    def _numbers(self, positions: list[int]) -> list[Floats]:
        """Return columns of numbers; nothing of the text is kept, and each number at most twice."""
        fast = self._fast_numbers(positions)
        if fast is not None:
            return fast
        delimiter = None if self.dialect.delimiter == " " else self.dialect.delimiter
        with (
            Path(self.file).open(encoding=self.encoding, errors="replace") as stream,
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore", UserWarning)  # numpy warns of a table without rows
            try:
                table = np.loadtxt(
                    self._lines(stream),
                    delimiter=delimiter,
                    usecols=positions,
                    ndmin=2,
                    quotechar='"',
                )
                return [np.ascontiguousarray(column) for column in table.T]
            except InputError:
                raise
            except ValueError as error:
                problem = str(error)
            except MemoryError:
                raise too_large(self.file) from None
        raise self._explain(problem)

    def _fast_numbers(self, positions: list[int]) -> list[Floats] | None:
        """Read with pyarrow; None where it is not installed, or does not take the file."""
        if (
            self._size <= _FAST
            or self.dialect.delimiter == " "
            or not self.encoding.startswith("utf-8")
        ):
            return None
        try:
            import pyarrow as pa
            import pyarrow.csv as reader
        except ImportError:
            return None
        keys = [str(number) for number in range(self.dialect.fields)]
        chosen = [keys[p] for p in positions]
        try:
            with Path(self.file).open("rb") as stream:
                for _ in range(self.dialect.header_lines):
                    stream.readline()
                table = reader.read_csv(
                    pa.PythonFile(stream, "r"),
                    read_options=reader.ReadOptions(column_names=keys, block_size=1 << 22),
                    parse_options=reader.ParseOptions(delimiter=self.dialect.delimiter),
                    convert_options=reader.ConvertOptions(
                        include_columns=chosen,
                        column_types=dict.fromkeys(chosen, pa.float64()),
                        decimal_point="," if self.dialect.decimal_comma else ".",
                        null_values=[],
                    ),
                )
        except (pa.ArrowException, OSError):
            return None  # numpy says what is wrong, or takes it
        columns = []
        for key in chosen:  # each leaves the table as it is copied
            columns.append(_numbers_of(table.column(key)))
            table = table.drop_columns([key])
        return columns

    def _clock(self, position: int) -> Floats:
        """Return a column of times of day in s from its first."""
        texts = []
        with Path(self.file).open(encoding=self.encoding, errors="replace") as stream:
            for number, line in enumerate(self._bounded(stream), start=1):
                if number <= self.dialect.header_lines or _says_nothing(line):
                    continue
                fields = split(line, self.dialect.delimiter)
                if len(fields) <= position or not CLOCK.fullmatch(fields[position][:DIGITS]):
                    found = fields[position] if len(fields) > position else "too few columns"
                    raise ReadError(
                        repr(found[:40]),
                        "a time such as 12:30:01.250",
                        "correct or remove the row",
                        file=self.file,
                        place=f"line {number}, column {self.names[position]}",
                    )
                texts.append(fields[position])
        try:
            return seconds_of_day(texts)
        except (ValueError, OverflowError) as error:
            raise ReadError(
                str(error)[:120],
                "times of days that there are",
                "correct or remove the row",
                file=self.file,
                place=f"column {self.names[position]}",
            ) from None

    def _explain(self, problem: str) -> ReadError:
        """Turn numpy's message into the line and the column of this file."""
        place = _NUMPY_PLACE.search(problem)
        row = _NUMPY_ROW.search(problem)
        few = "could not convert" not in problem  # then numpy counts rows from 1, else from 0
        line = self._line(int(row.group(1)) - few) if row else 0
        if place is None or few:
            return ReadError(
                "too few columns" if row else problem[:160],
                f"{len(self.names)} columns in each row",
                "complete or remove the row",
                file=self.file,
                place=f"line {line}" if row else "",
            )
        column = int(place.group(2)) - 1
        name = self.names[min(column, len(self.names) - 1)]
        value = repr(self._field(line, column))
        return ReadError(
            "an empty field" if value == "''" else value[:80],
            "a number",
            "cut the record there, or leave the column out",
            file=self.file,
            place=f"line {line}, column {name}",
        )

    def _field(self, line: int, column: int) -> str:
        """Return a field as it stands in the file."""
        with Path(self.file).open(encoding=self.encoding, errors="replace") as stream:
            row = next(islice(self._bounded(stream), max(line - 1, 0), None), "")
        fields = split(row.partition("#")[0], self.dialect.delimiter)
        return fields[column] if column < len(fields) else ""

    def _line(self, row: int) -> int:
        """Return the line of numpy's data row: it skips blank lines and comments."""
        with Path(self.file).open(encoding=self.encoding, errors="replace") as stream:
            for number, line in enumerate(self._bounded(stream), start=1):
                if number > self.dialect.header_lines and not _says_nothing(line):
                    row -= 1
                if row < 0:
                    return number
        return 0


def _numbers_of(column: Any) -> Floats:
    """Return the numbers of a column of pyarrow, whose own way there loads pandas."""
    parts = [
        np.frombuffer(chunk.buffers()[1], dtype=np.float64)[chunk.offset :][: len(chunk)]
        for chunk in column.chunks
    ]
    return np.concatenate([np.empty(0), *parts])


def _says_nothing(line: str) -> bool:
    return not line.partition("#")[0].strip() or line.lstrip().startswith(COMMENTS)


def seconds_of_day(texts: list[str]) -> Floats:
    """Return times of day, with their date or without, in s from the first."""
    if re.match(r"\d{4}-", texts[0]):
        stamps: Any = np.array(
            [t.rstrip("Z").replace(",", ".").replace(" ", "T") for t in texts],
            dtype="datetime64[ns]",
        )
        return np.asarray((stamps - stamps[0]).astype(np.int64) * 1e-9, dtype=float)
    parts = [t.rstrip("Z").replace(",", ".").split(" ")[-1].split("T")[-1] for t in texts]
    seconds = np.zeros(len(parts))
    for i, part in enumerate(parts):
        total = 0.0
        for piece in part.split(":"):
            total = 60 * total + float(piece)
        seconds[i] = total
    # A clock without date starts again at midnight.
    days = np.concatenate([[0], np.cumsum(np.diff(seconds) < -_DAY / 2)])
    return np.asarray(seconds - seconds[0] + _DAY * days, dtype=float)


def open_delimited(path: Path, *, header_row: int | None = None) -> DelimitedTable:
    """Open a text table: find its delimiter, its names and its units.

    Parameters
    ----------
    path : Path
    header_row : int, optional
        The line of the names, from 1; 0 where there are none. Without it, the line of text above
        the first row of values.
    """
    start = head(path)
    encoding = _encoding(start)
    if encoding != "utf-16" and content(start) != "text":
        raise not_what_it_says(path, start, "a text table")
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
    try:
        dialect = find_dialect(lines, header_row)
    except InputError as error:
        raise error.at(file=str(path)) from None
    if dialect is None:
        texts = [line for line in lines if not _says_nothing(line)]
        raise ReadError(
            "no samples" if texts else "comments only",
            "rows of numbers below a row of names",
            "check the file; header_row says in which line the names are",
            file=str(path),
        )
    return DelimitedTable(str(path), dialect, encoding)


def _first_lines(stream: IO[str], count: int) -> list[str]:
    """Return the first lines, fewer where they are very long."""
    lines: list[str] = []
    length = 0
    while (
        len(lines) < count
        and length < LINE_CHARACTERS
        and (line := stream.readline(LINE_CHARACTERS))
    ):
        lines.append(line)
        length += len(line)
    return lines


def _encoding(start: bytes) -> str:
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        start[: start.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"
