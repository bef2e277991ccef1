"""Files of columns: how each is opened, and how a column is found in it by name.

A binary format is an `ArrayFile`, opened in a child, where it reads what `Stored` asks for.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from itertools import chain
from pathlib import Path
from posixpath import basename, dirname
from typing import Any, Protocol

import numpy as np

from rotorid.core.errors import NAME_CHARACTERS, InputError, ReadError, nearest, require_type
from rotorid.core.files import open_regular
from rotorid.core.units import name_and_unit
from rotorid.core.values import Floats, frozen
from rotorid.io.sandbox import Sandbox

RATES = (1e-9, 1e12)
"""Hz, of a sample rate that a file states: once in thirty years, and beyond any oscilloscope."""
COLUMNS = 10_000
"""Of a file: loggers have hundreds of channels."""
ACROSS, SLENDER = 100, 4
"""Columns of a matrix of samples at most, and what it is longer than wide at least: others are
pictures, gains, coefficients."""

DEPTH = 64
"""Groups in groups, and structures in structures: loggers nest up to five."""
COMPRESSION = 250
"""Bytes that one byte of a file may stand for: measured samples pack to a half, simulated ones
without noise to a hundredth; more is damage, or meant to fill the memory."""
UNPACKED_BYTES = 64_000_000
"""That any file may ask for, however small it is: a channel at rest packs without bound."""

_INDEXED = re.compile(r"(?P<name>.+)\[(?P<rows>:,)?(?P<index>\d{1,6})(?P<columns>,:)?\]")
_HDF5 = b"\x89HDF\r\n\x1a\n"
_SIGNATURES = {
    _HDF5: "HDF5 data",
    b"MATLAB 7.3 MAT-file": "a MAT v7.3 file",
    b"MATLAB 5.0 MAT-file": "a MAT v5 file",
    b"PK\x03\x04": "a zip archive or a spreadsheet",
    b"PAR1": "Parquet data",
    b"TDSm": "TDMS data",
    b"MDF ": "MDF data",
    b"UnFinMF ": "an MDF file that was not finished",
    b"\x1f\x8b": "gzip data",
    b"    -1": "universal file data",
}


@frozen
class Rate:
    hertz: float
    # how far, relative, it may be off for the digits in which it is written
    rounding: float = 1e-12


@frozen
class Column:
    """Samples of one column as they stand in the file, and what the file states of them."""

    values: Floats
    unit: str | None = None
    rate: Rate | None = None
    start: float | None = None  # when its first sample was taken, in s by the clock of all columns

    def __post_init__(self) -> None:
        if self.rate is not None and not RATES[0] <= self.rate.hertz <= RATES[1]:
            object.__setattr__(self, "rate", None)


class TooMuchError(ReadError):
    """Numbers that are more than the bytes of a file can stand for."""


class ColumnFile(Protocol):
    @property
    def file(self) -> str: ...

    @property
    def names(self) -> Sequence[str]:
        """Names of the columns, in the file's order; ``name[3]`` of a matrix."""

    def find(self, name: str) -> str:
        """Return the file's own name of a column."""

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""

    def texts(self, name: str) -> list[str]:
        """Return a column as it is written, a text a row; of a binary file its numbers."""

    def scalar(self, name: str) -> float: ...


class OneFile(ColumnFile, Protocol):
    def read_each(self, names: Sequence[str]) -> dict[str, Column | InputError]: ...


def content(path: Path) -> str:
    """Say what a file holds by its first bytes; HDF5 may stand behind a block of the user's."""
    with open_regular(path, "a file of samples") as stream:
        start = stream.read(65536)
        if not start:
            raise ReadError("an empty file", "samples", "write it again", file=str(path))
        for signature, name in _SIGNATURES.items():
            if start.lstrip(b"\r\n").startswith(signature):
                return name
        size, place = os.fstat(stream.fileno()).st_size, 512
        while place < size:
            stream.seek(place)
            if stream.read(len(_HDF5)) == _HDF5:
                return "HDF5 data"
            place *= 2
    return "binary data" if b"\0" in start else "text"


def not_what_it_says(path: Path, found: str, expected: str) -> ReadError:
    cure = "give the file the ending of its format, or write it again"
    return ReadError(found, f"{expected}, as the ending {path.suffix} says", cure, file=str(path))


def check_held(size: int, held: int, file: str) -> None:
    """Refuse to make more bytes of numbers than those can stand for that hold them."""
    if size > max(COMPRESSION * held, UNPACKED_BYTES):
        raise TooMuchError(
            f"{size} bytes of numbers declared in {held} bytes",
            "numbers that the file holds",
            "write it again",
            file=file,
        )


def no_column(name: str, names: Iterable[str], file: str = "", kind: str = "column") -> ReadError:
    there = list(names)
    shown = ", ".join(other[:NAME_CHARACTERS] for other in there[:8])
    shown += f", ... ({len(there)} in all)" if len(there) > 8 else ""
    return ReadError(
        f"no {kind} {name!r}",
        f"one of {shown}" if there else f"a {kind}; the file has none",
        nearest(name, there),
        file=file,
    )


@frozen
class ColumnPlace:
    """Where a column lies: the path of an array, and of a 2-D one the index and its axis."""

    path: str
    index: int | None = None
    axis: int = 1


class ArrayFile:
    """An open file of arrays; formats that read several at once have `columns` of their own."""

    def __init__(
        self,
        file: str,
        shapes: Mapping[str, tuple[int, ...]],
        column: Callable[[ColumnPlace, slice], Column] | None = None,
        others: Mapping[str, str] | None = None,
        in_blocks: bool = False,  # whether some rows can be read without the others
    ) -> None:
        self.file, self.shapes, self.column, self.in_blocks = file, shapes, column, in_blocks
        # what else is in it, and what that is, as far as it is known
        self.others = {} if others is None else others

    def columns(
        self, places: Mapping[str, ColumnPlace], rows: int | None
    ) -> Iterator[dict[str, Column]]:
        """Yield so many rows of all columns after others, or whole columns."""
        assert self.column is not None
        if rows is None:
            yield from ({n: self.column(place, slice(None))} for n, place in places.items())
            return
        for begin in range(0, max(self._lengths(places)), rows):
            samples = slice(begin, begin + rows)
            yield {name: self.column(place, samples) for name, place in places.items()}

    def bytes_held(self, places: Mapping[str, ColumnPlace]) -> int:
        return os.path.getsize(self.file)

    def names(self) -> list[str]:
        """Return the names of columns: leaf names where these are unique.

        Those of matrices too, but of groups that hold other columns, if any group does.
        """
        across = {path: columns_across(shape) for path, shape in self.shapes.items()}
        groups = {dirname(path) for path, count in across.items() if count == 1}
        apart = {p for p, count in across.items() if count > 1 and dirname(p) not in groups}
        paths = [p for p, count in across.items() if count and not (groups and p in apart)]
        leaves = [basename(name_and_unit(path)[0]) for path in paths]
        counts = Counter(basename(name_and_unit(path)[0]) for path in self.shapes)  # as `place`
        found = list[str]()
        for path, leaf in zip(paths, leaves, strict=True):
            name, count = leaf if counts[leaf] == 1 else path, across[path]
            found += [name] if count == 1 else [f"{name}[{k}]" for k in range(count)]
        return found

    def sizes(self) -> dict[str, tuple[int, ...]]:
        return dict(self.shapes)

    def find(self, name: str) -> str:
        """Return the path of a column, with its index where it is one of a 2-D array."""
        place = self.place(name)
        return place.path if place.index is None else place.path + name[name.rindex("[") :]

    def read(self, names: Sequence[str], rows: int | None = None) -> Iterator[dict[str, Column]]:
        places = {name: self.place(name) for name in names}
        held = self.bytes_held(places)
        if rows is None:
            check_held(self._size(places), held, self.file)
        units = {name: name_and_unit(place.path)[1] for name, place in places.items()}
        for part in self.columns(places, rows):
            yield {name: replace(c, unit=c.unit or units[name]) for name, c in part.items()}

    def size_in_blocks(self, names: Sequence[str]) -> int:
        """Return the size of columns in memory; 0 where they are not read in blocks."""
        return self._size({name: self.place(name) for name in names}) if self.in_blocks else 0

    def _size(self, places: Mapping[str, ColumnPlace]) -> int:
        return 8 * sum(self._lengths(places))

    def _lengths(self, places: Mapping[str, ColumnPlace]) -> list[int]:
        return [max(self.shapes[place.path], default=0) for place in places.values()]

    def place(self, name: str) -> ColumnPlace:
        """Find an array by its path or end, or a column of one: ``name[3]``, ``name[3,:]``.

        Without a colon, the samples of a two-dimensional array lie along its longer axis.
        """
        indexed = _INDEXED.fullmatch(name)
        for look in self._whole, self._ending:  # where it is a whole path no other is looked at
            if (path := look(name)) is not None:
                shape = self.shapes[path]
                if is_column(shape):
                    return ColumnPlace(path, axis=int(shape[0] > 1))
                raise _not_a_column(name, shape)
            if indexed is not None and (path := look(indexed["name"])) is not None:
                shape, index = self.shapes[path], int(indexed["index"])
                axis = int(len(shape) == 2 and shape[0] >= shape[1])
                if indexed["rows"] or indexed["columns"]:
                    axis = int(bool(indexed["rows"]))
                if len(shape) != 2 or index >= shape[axis]:
                    raise _not_a_column(name, shape)
                return ColumnPlace(path, index, axis)
        if (kind := self.others.get(name.strip("/"))) is not None:
            cure = "name a column of numbers, or export it so"
            raise ReadError(f"{name!r} of {kind}", "real numbers", cure)
        flat = [p for p, shape in self.shapes.items() if len(shape) == 2 and 1 not in shape]
        raise no_column(name, [*self.names(), *flat])

    def _whole(self, name: str) -> str | None:
        return next((path for path in (name, name.strip("/")) if path in self.shapes), None)

    def _ending(self, name: str) -> str | None:
        fitting = self._by_end.get(name.strip("/"), [])
        if len(fitting) > 1:
            found = f"{name!r} {len(fitting)} times ({', '.join(fitting[:4])})"
            raise ReadError(found, "a name that is unique in the file", "write the whole path")
        return fitting[0] if fitting else None

    @cached_property
    def _by_end(self) -> dict[str, list[str]]:
        """The paths by each of their ends: thousands of names are looked up."""
        found: dict[str, list[str]] = {}
        for path in self.shapes:
            for name in {path, name_and_unit(path)[0]}:
                parts = name.split("/")
                for begin in range(max(0, len(parts) - DEPTH), len(parts)):
                    found.setdefault("/".join(parts[begin:]), []).append(path)
        return found

    def scalar(self, name: str) -> float:
        scalars = [path for path, shape in self.shapes.items() if np.prod(shape) == 1]
        fitting = [p for p in scalars if name.strip("/") in (p, p.rsplit("/", 1)[-1])]
        if len(fitting) != 1:
            raise no_column(name, scalars, kind="scalar variable")
        places = {name: ColumnPlace(fitting[0])}
        self.bytes_held(places)
        return float(next(self.columns(places, None))[name].values[0])


def is_column(shape: tuple[int, ...]) -> bool:
    return len(shape) == 1 or (len(shape) == 2 and 1 in shape)


def columns_across(shape: tuple[int, ...]) -> int:
    """Return how many columns of samples an array holds: of a matrix, as many as it is narrow."""
    if is_column(shape):
        return int(max(shape) > 1)
    narrow = len(shape) == 2 and 1 < min(shape) <= ACROSS and max(shape) > SLENDER * min(shape)
    return min(shape) if narrow else 0


def _not_a_column(name: str, shape: tuple[int, ...]) -> ReadError:
    size = " x ".join(map(str, shape)) or "a scalar"
    cure = "write name[0] for the first of its columns" if len(shape) == 2 else "name a column"
    return ReadError(f"{name!r} of size {size}", "a column of samples", cure)


def seconds(stamps: np.ndarray) -> Floats:
    """Return times of a clock in s since the first; those that are missing are NaN."""
    return np.asarray((stamps - stamps[:1]) / np.timedelta64(1, "s"), dtype=np.float64)


def is_numeric(dtype: Any) -> bool:
    return np.dtype(dtype).kind in "biuf"


@frozen
class Format:
    opener: str  # module and function under `rotorid.io`
    package: str  # which reads it
    kind: str
    contents: tuple[str, ...] = ()  # `kind` where nothing else is said


HDF5 = Format("hdf5.open_hdf5", "h5py", "HDF5 data", ("HDF5 data", "a MAT v7.3 file"))
MAT = Format("formats.open_mat", "scipy.io", "MAT data", ("a MAT v5 file", "binary data"))
UNIVERSAL = Format("formats.open_universal", "pyuff", "universal file data")
RESPONSES = replace(UNIVERSAL, opener="formats.open_responses")
TEXTS = (".csv", ".txt", ".dat", ".lvm", ".asc", ".tsv")
FORMATS = {
    **dict.fromkeys((".h5", ".hdf5"), HDF5),
    ".mat": MAT,
    ".parquet": Format("formats.open_parquet", "pyarrow.parquet", "Parquet data"),
    ".tdms": Format("formats.open_tdms", "nptdms", "TDMS data"),
    **dict.fromkeys((".uff", ".unv"), UNIVERSAL),
    **dict.fromkeys((".mf4", ".mdf"), Format("formats.open_mdf", "asammdf", "MDF data")),
}
READERS = (*TEXTS, *FORMATS)  # endings of files of columns


class Stored(Sandbox):
    """Columns that stay in their file, which a child reads."""

    def __init__(self, path: Path, format: Format) -> None:
        found = content(path)
        if found not in (format.contents or (format.kind,)):
            raise not_what_it_says(path, found, format.kind)
        try:
            import_module(format.package)  # here once: each child would take its time to import it
        except ImportError:
            raise ReadError(
                f"no package {format.package.partition('.')[0]}, which reads {path.suffix} files",
                "it to be installed",
                "pip install 'rotorid[files]'",
                file=str(path),
            ) from None
        self._path, self._format = path, format
        module, _, name = format.opener.partition(".")
        opener = getattr(import_module(f"rotorid.io.{module}"), name)
        super().__init__(opener, str(path), format.kind)

    @cached_property
    def names(self) -> list[str]:
        return list(self.ask("names"))

    @cached_property
    def sizes(self) -> dict[str, tuple[int, ...]]:
        """The shapes of the file's arrays, of scalars too."""
        return {path: tuple(shape) for path, shape in self.ask("sizes").items()}

    def find(self, name: str) -> str:
        return str(self.ask("find", name))

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        parts = self.stream("read", list(names))
        return dict(chain.from_iterable(part.items() for part in parts))

    def read_each(self, names: Sequence[str]) -> dict[str, Column | InputError]:
        try:
            return {**self.read(names)}
        except TooMuchError:
            raise
        except InputError:
            found: dict[str, Column | InputError] = {}
        for name in names:
            try:
                found |= self.read([name])
            except InputError as error:
                found[name] = error
        return found

    def texts(self, name: str) -> list[str]:
        return list(map(str, self.read([name])[name].values.tolist()))

    def scalar(self, name: str) -> float:
        return float(self.ask("scalar", name))

    def size_in_blocks(self, names: Sequence[str]) -> int:
        return int(self.ask("size_in_blocks", list(names)))

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, Column]]:
        """Yield so many rows of all columns after others, from a child of their own."""
        child = Stored(self._path, self._format)
        try:
            yield from child.stream("read", list(names), rows)
        finally:
            child.close()


@frozen
class JoinedTables:
    """Several files of one clock; a column whose name is not unique is ``file.csv:name``."""

    tables: Mapping[str, ColumnFile]

    @property
    def file(self) -> str:
        return ", ".join(table.file for table in self.tables.values())

    @property
    def names(self) -> list[str]:
        every = {file: table.names for file, table in self.tables.items()}
        counts = Counter(name for names in every.values() for name in names)
        return [
            name if counts[name] == 1 else f"{file}:{name}"
            for file, names in every.items()
            for name in names
        ]

    def find(self, name: str) -> str:
        found = {}
        for file, table in self.tables.items():
            if name.startswith(f"{file}:"):
                return f"{file}:{table.find(name.removeprefix(f'{file}:'))}"
            with suppress(InputError):
                found[file] = f"{file}:{table.find(name)}"
        if len(found) > 1:
            raise ReadError(
                f"column {name!r} in {' and '.join(found)}",
                "a name that is unique in the files",
                f"write the file before it, such as {next(iter(found))}:{name}",
                file=self.file,
            )
        if not found:
            raise no_column(name, self.names, self.file)
        return next(iter(found.values()))

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        wanted = list(names)
        columns: dict[str, Column] = {}
        for file, table in self.tables.items():
            mine = [n.removeprefix(f"{file}:") for n in wanted if n.startswith(f"{file}:")]
            columns |= {f"{file}:{name}": c for name, c in table.read(mine).items()} if mine else {}
        return columns

    def texts(self, name: str) -> list[str]:
        file = next(file for file in self.tables if name.startswith(f"{file}:"))
        return self.tables[file].texts(name.removeprefix(f"{file}:"))

    def scalar(self, name: str) -> float:
        for table in self.tables.values():
            try:
                return table.scalar(name)
            except InputError as error:
                last = error
        raise last


def open_table(path: str | Path, *, header_row: int | None = None) -> OneFile:
    """Open a file of columns with the reader of its ending."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending in TEXTS:
        opener = import_module("rotorid.io.text").open_delimited
        table: OneFile = opener(path, header_row=header_row)
        return table
    if ending not in FORMATS:
        found = content(path) + (f", ending {path.suffix}" if path.suffix else ", no ending")
        cure = "export the record to one of these"
        raise ReadError(found, f"a file that ends in {', '.join(READERS)}", cure, file=str(path))
    if header_row is not None:
        found = "header_row of a file that is no text"
        raise ReadError(found, "a text table", "remove it", file=str(path))
    form = FORMATS[ending]
    return Stored(path, HDF5 if form is MAT and content(path) in HDF5.contents else form)


def open_tables(
    path: str | Path | Sequence[str | Path], *, header_row: int | None = None
) -> ColumnFile:
    require_type(path, str, Path, list, tuple, place="path")
    if isinstance(path, str | Path):
        return open_table(path, header_row=header_row)
    paths = [Path(one) for one in path]
    if not paths:
        raise ReadError("no files", "one or more", "name them", place="files")
    if len(paths) == 1:
        return open_table(paths[0], header_row=header_row)
    short = [p.name for p in paths]
    keys = short if len(set(short)) == len(short) else [str(p) for p in paths]
    if len({os.path.realpath(p) for p in paths}) < len(paths):
        raise ReadError("a file twice", "each file once", "remove one", place="files")
    opened = [open_table(p, header_row=header_row) for p in paths]
    return JoinedTables(dict(zip(keys, opened, strict=True)))
