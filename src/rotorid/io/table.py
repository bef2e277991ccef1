"""What the readers have in common: named columns with units, and how a column is found by name."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rotorid.errors import ReadError
from rotorid.record import Floats

_INDEXED = re.compile(r"(?P<name>.+)\[(?P<index>\d{1,6})\]")
_SIGNATURES = {
    b"\x89HDF\r\n\x1a\n": "HDF5 data",
    b"MATLAB 7.3 MAT-file": "a MAT v7.3 file",
    b"MATLAB 5.0 MAT-file": "a MAT v5 file",
    b"PK\x03\x04": "a zip archive or a spreadsheet",
    b"PAR1": "Parquet data",
    b"TDSm": "TDMS data",
    b"\x1f\x8b": "gzip data",
}


@dataclass(frozen=True)
class Column:
    """Samples of one column as they stand in the file, and the unit that the file states."""

    values: Floats
    unit: str | None = None


class Table(Protocol):
    """An open file of columns."""

    @property
    def file(self) -> str:
        """The path, for messages."""
        ...

    @property
    def names(self) -> Sequence[str]:
        """Names of the one-dimensional columns, in the file's order."""
        ...

    def find(self, name: str) -> str:
        """Return the file's own name of a column."""
        ...

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        ...

    def scalar(self, name: str) -> float:
        """Return a scalar variable."""
        ...


def head(path: Path, size: int = 65536) -> bytes:
    """Return the first bytes of a file."""
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise ReadError(found, "a file of samples", "check the path", file=str(path))
    try:
        with path.open("rb") as stream:
            start = stream.read(size)
    except OSError as error:
        raise ReadError(
            str(error.strerror or error), "a readable file", "check the path", file=str(path)
        ) from error
    if not start:
        raise ReadError("an empty file", "samples", "write it again", file=str(path))
    return start


def content(start: bytes) -> str:
    """Say what a file holds by its first bytes."""
    for signature, name in _SIGNATURES.items():
        if start.startswith(signature):
            return name
    return "binary data" if b"\0" in start else "text"


def not_what_it_says(path: Path, start: bytes, expected: str) -> ReadError:
    """Return the error for a file whose content does not fit its ending."""
    return ReadError(
        content(start),
        f"{expected}, as the ending {path.suffix} says",
        "give the file the ending of its format, or write it again",
        file=str(path),
    )


def too_large(file: str) -> ReadError:
    """Return the error for a record that does not fit into memory."""
    return ReadError(
        "more samples than memory holds", "a record that fits", "cut the record", file=file
    )


def no_column(name: str, names: Iterable[str], file: str, kind: str = "column") -> ReadError:
    """Return the error for a name that is not in the file, with the nearest that is."""
    there = list(names)
    near = difflib.get_close_matches(name, there, n=1)
    shown = ", ".join(there[:8]) + (f", ... ({len(there)} in all)" if len(there) > 8 else "")
    return ReadError(
        f"no {kind} {name!r}",
        f"one of {shown}" if there else f"a {kind}; the file has none",
        f"did you mean {near[0]!r}?" if near else "correct the name",
        file=file,
    )


@dataclass(frozen=True)
class NamedArrays:
    """A file of arrays found by path, or by leaf name where that is unique.

    Parameters
    ----------
    file : str
        The path of the file, for messages.
    shapes : mapping of path to shape
        Its numeric arrays.
    """

    file: str
    shapes: Mapping[str, tuple[int, ...]]

    @property
    def names(self) -> list[str]:
        """Names of the one-dimensional arrays: leaf names where these are unique."""
        paths = [p for p, shape in self.shapes.items() if _is_column(shape) and max(shape) > 1]
        leaves = [path.rsplit("/", 1)[-1] for path in paths]
        return [
            leaf if leaves.count(leaf) == 1 else path
            for path, leaf in zip(paths, leaves, strict=True)
        ]

    def find(self, name: str) -> str:
        """Return the path of a column, with its index where it is one of a 2-D array."""
        path, index = resolve(name, self.shapes, self.file)
        return path if index is None else f"{path}[{index}]"

    def find_scalar(self, name: str) -> str:
        """Return the path of an array of one number."""
        scalars = [path for path, shape in self.shapes.items() if np.prod(shape) == 1]
        fitting = [p for p in scalars if name.strip("/") in (p, p.rsplit("/", 1)[-1])]
        if len(fitting) != 1:
            raise no_column(name, scalars, self.file, kind="scalar variable")
        return fitting[0]


def resolve(name: str, shapes: Mapping[str, tuple[int, ...]], file: str) -> tuple[str, int | None]:
    """Find a variable by path or by unique leaf name, or a column of one by ``name[3]``."""
    indexed = _INDEXED.fullmatch(name)
    path = _path(name, shapes, file)
    if path is not None:
        if _is_column(shapes[path]):
            return path, None
        raise _not_a_column(name, shapes[path], file)
    base = None if indexed is None else _path(indexed["name"], shapes, file)
    if indexed is None or base is None:
        raise no_column(name, shapes, file)
    shape, index = shapes[base], int(indexed["index"])
    if len(shape) != 2 or index >= shape[1]:
        raise _not_a_column(name, shape, file)
    return base, index


def _path(name: str, paths: Iterable[str], file: str) -> str | None:
    paths = list(paths)
    wanted = name.strip("/")
    if wanted in paths:
        return wanted
    fitting = [path for path in paths if path.rsplit("/", 1)[-1] == wanted]
    if len(fitting) > 1:
        raise ReadError(
            f"{name!r} {len(fitting)} times ({', '.join(fitting[:4])})",
            "a name that is unique in the file",
            "write the whole path",
            file=file,
        )
    return fitting[0] if fitting else None


def _is_column(shape: tuple[int, ...]) -> bool:
    return len(shape) == 1 or (len(shape) == 2 and 1 in shape)


def _not_a_column(name: str, shape: tuple[int, ...], file: str) -> ReadError:
    size = " x ".join(map(str, shape)) or "a scalar"
    cure = "write name[0] for the first of its columns" if len(shape) == 2 else "name a column"
    return ReadError(f"{name!r} of size {size}", "a column, samples along axis 0", cure, file=file)


def as_column(values: Any, index: int | None) -> Floats:
    """Return a column of numbers of a variable as floats, shape (sample,)."""
    array = np.asarray(values)
    picked = array if index is None else array[:, index]
    return np.asarray(picked, dtype=np.float64).reshape(-1)


def is_numeric(dtype: Any) -> bool:
    """Tell whether samples of this type are real numbers."""
    return np.dtype(dtype).kind in "biuf"
