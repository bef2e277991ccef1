"""Reader of HDF5 files: a column is a one-dimensional dataset, or a column of a 2-D one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rotorid.errors import ReadError
from rotorid.io.table import (
    Column,
    NamedArrays,
    as_column,
    content,
    head,
    is_numeric,
    not_what_it_says,
    resolve,
    too_large,
)


@dataclass(frozen=True)
class Hdf5Table(NamedArrays):
    """An HDF5 file; its numbers are read when they are asked for."""

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        wanted = {name: resolve(name, self.shapes, self.file) for name in names}
        paths = [path for path, _ in wanted.values()]
        whole: dict[str, Any] = {}
        columns = {}
        with _opened(self.file) as data:
            for name, (path, index) in wanted.items():
                dataset = data[path]
                if index is None or paths.count(path) > 1:
                    if path not in whole:
                        whole[path] = dataset[()]
                    values = as_column(whole[path], index)
                else:
                    values = as_column(dataset[:, index], None)
                columns[name] = Column(values, _unit(dataset, index))
        return columns

    def scalar(self, name: str) -> float:
        """Return a dataset of one number."""
        path = self.find_scalar(name)
        with _opened(self.file) as data:
            return float(np.ravel(data[path][()])[0])


def open_hdf5(path: Path) -> Hdf5Table:
    """Open an HDF5 file."""
    start = head(path)
    if content(start) != "HDF5 data":
        raise not_what_it_says(path, start, "HDF5 data")
    shapes: dict[str, tuple[int, ...]] = {}

    def note(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and node.shape is not None and is_numeric(node.dtype):
            shapes[name] = tuple(node.shape)

    with _opened(str(path)) as data:
        data.visititems(note)
    return Hdf5Table(str(path), shapes)


@contextmanager
def _opened(file: str) -> Iterator[h5py.File]:
    try:
        with h5py.File(file, "r") as data:
            yield data
    except MemoryError:
        raise too_large(file) from None
    except (OSError, RuntimeError, LookupError, TypeError, ValueError) as error:  # for damage
        raise ReadError(
            f"damaged HDF5 data ({error})", "a whole HDF5 file", "write it again", file=file
        ) from error


def _unit(dataset: h5py.Dataset, index: int | None) -> str | None:
    """Return the attribute ``units`` (or ``unit``): one text, or one per column."""
    for key in ("units", "unit"):
        if key in dataset.attrs:
            texts = np.ravel(dataset.attrs[key])
            text = texts[0 if len(texts) == 1 or index is None else min(index, len(texts) - 1)]
            text = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
            return text.strip() or None
    return None
