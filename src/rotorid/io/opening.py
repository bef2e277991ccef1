"""Files of columns, each opened by the reader of its ending; several as one."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from rotorid.core.errors import InputError, ReadError
from rotorid.core.frozen import frozen
from rotorid.io.table import Column, Table, content, head, no_column
from rotorid.io.text import open_delimited


def _reader(module: str, name: str) -> Callable[[Path], Table]:
    """Return a reader that is imported, with the package of its format, when it is used."""

    def open_file(path: Path) -> Table:
        reader: Callable[[Path], Table] = getattr(import_module(f"rotorid.io.{module}"), name)
        return reader(path)

    return open_file


_HDF5, _MDF = _reader("hdf5", "open_hdf5"), _reader("mdf", "open_mdf")
_UNIVERSAL = _reader("universal", "open_universal")
READERS: Mapping[str, Callable[[Path], Table]] = {
    ".csv": open_delimited,
    ".txt": open_delimited,
    ".dat": open_delimited,
    ".lvm": open_delimited,
    ".asc": open_delimited,
    ".tsv": open_delimited,
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mat": _reader("mat", "open_mat"),
    ".parquet": _reader("parquet", "open_parquet"),
    ".tdms": _reader("tdms", "open_tdms"),
    ".uff": _UNIVERSAL,
    ".unv": _UNIVERSAL,
    ".mf4": _MDF,
    ".mdf": _MDF,
}


@frozen
class JoinedTables:
    """Several files of one clock: their columns beside one another.

    A column is named by its name where that is unique, else by ``file.csv:name``.
    """

    tables: Mapping[str, Table]

    @property
    def file(self) -> str:
        """The paths, for messages."""
        return ", ".join(table.file for table in self.tables.values())

    @property
    def names(self) -> list[str]:
        """Names of the columns, with their file where they are not unique."""
        every = {file: table.names for file, table in self.tables.items()}
        counts = Counter(name for names in every.values() for name in names)
        return [
            name if counts[name] == 1 else f"{file}:{name}"
            for file, names in every.items()
            for name in names
        ]

    def find(self, name: str) -> str:
        """Return the column's name with its file."""
        for file, table in self.tables.items():
            if name.startswith(f"{file}:"):
                return f"{file}:{table.find(name.removeprefix(f'{file}:'))}"
        found = {}
        for file, table in self.tables.items():
            try:
                found[file] = table.find(name)
            except InputError:
                continue
        if len(found) > 1:
            raise ReadError(
                f"column {name!r} in {' and '.join(found)}",
                "a name that is unique in the files",
                f"write the file before it, such as {next(iter(found))}:{name}",
                file=self.file,
            )
        for file, column in found.items():
            return f"{file}:{column}"
        raise no_column(name, self.names, self.file)

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        wanted = list(names)
        columns: dict[str, Column] = {}
        for file, table in self.tables.items():
            mine = [n.removeprefix(f"{file}:") for n in wanted if n.startswith(f"{file}:")]
            columns |= {f"{file}:{name}": c for name, c in table.read(mine).items()} if mine else {}
        return columns

    def scalar(self, name: str) -> float:
        """Return a scalar variable of the first file that has it."""
        for table in self.tables.values():
            try:
                return table.scalar(name)
            except InputError as error:
                last = error
        raise last


def open_table(path: str | Path, *, header_row: int | None = None) -> Table:
    """Open a file of columns with the reader of its ending."""
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        found = content(head(path)) + (f", ending {path.suffix}" if path.suffix else ", no ending")
        raise ReadError(
            found,
            f"a file that ends in {', '.join(READERS)}",
            "export the record to one of these",
            file=str(path),
        )
    if reader is open_delimited:
        return open_delimited(path, header_row=header_row)
    if header_row is not None:
        raise ReadError(
            "header_row of a file that is no text", "a text table", "remove it", file=str(path)
        )
    return reader(path)


def open_tables(path: str | Path | Sequence[str | Path], *, header_row: int | None = None) -> Table:
    """Open a file, or several as one."""
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
