"""Reader of HDF5 files: a column is a one-dimensional dataset, or a column of a 2-D one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rotorid.io.table import (
    Column,
    NamedArrays,
    Place,
    Rate,
    as_column,
    check_size,
    content,
    head,
    is_numeric,
    not_what_it_says,
    reading,
)

_RATE = ("sample_rate", "sampling_rate", "sampling_frequency", "samplerate", "fs")
_INTERVAL = ("sample_interval", "wf_increment", "dt")


@dataclass(frozen=True)
class Hdf5Table(NamedArrays):
    """An HDF5 file; its numbers are read when they are asked for."""

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        wanted = {name: self.place(name) for name in names}
        paths = [place.path for place in wanted.values()]
        whole: dict[str, Any] = {}
        columns = {}
        with _opened(self.file) as data:
            for name, place in wanted.items():
                path = place.path
                if path not in whole and (place.index is None or paths.count(path) > 1):
                    whole[path] = _dataset(data, path, self.file)[()]
                values = (
                    as_column(whole[path], place)
                    if path in whole
                    else _part(_dataset(data, path, self.file), place)
                )
                columns[name] = Column(values, *_stated(data, path, place))
        return columns

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, Column]]:
        """Yield successive rows of columns, by the names that `find` returned."""
        places = {name: self.place(name) for name in names}
        with _opened(self.file) as data:
            datasets = {p: _dataset(data, p.path, self.file) for p in places.values()}
            stated = {name: _stated(data, p.path, p) for name, p in places.items()}
            count = max(max(self.shapes[p.path]) for p in places.values())
            step = _whole_chunks(data, [p.path for p in datasets], rows)
            for begin in range(0, count, step):
                parts: dict[tuple[str, int], Any] = {}
                for place, dataset in datasets.items():
                    if (place.path, place.axis) not in parts:
                        parts[place.path, place.axis] = _rows(dataset, place, begin, step)
                yield {
                    name: Column(_picked(parts[p.path, p.axis], p), *stated[name])
                    for name, p in places.items()
                }

    def scalar(self, name: str) -> float:
        """Return a dataset of one number."""
        path = self.find_scalar(name)
        with _opened(self.file) as data:
            return float(np.ravel(data[path][()])[0])


def open_hdf5(path: Path) -> Hdf5Table:
    """Open an HDF5 file, or a MATLAB file of version 7.3."""
    start = head(path)
    if content(start) not in ("HDF5 data", "a MAT v7.3 file"):
        raise not_what_it_says(path, start, "HDF5 data")
    shapes: dict[str, tuple[int, ...]] = {}

    def note(name: str, node: Any) -> None:
        if name.startswith("#") or not isinstance(node, h5py.Dataset) or node.shape is None:
            return  # "#refs#" holds the cells of MATLAB
        if node.dtype.names:  # a table of records
            fields = [f for f in node.dtype.names if is_numeric(node.dtype[f])]
            shapes.update({f"{name}/{field}": tuple(node.shape) for field in fields})
        elif is_numeric(node.dtype) and not _is_matlab_text(node):
            shapes[name] = tuple(node.shape)

    with _opened(str(path)) as data:
        data.visititems(note)
    return Hdf5Table(str(path), shapes)


@contextmanager
def _opened(file: str) -> Iterator[h5py.File]:
    with reading(file, "HDF5 data"), h5py.File(file, "r") as data:
        yield data


def _is_matlab_text(dataset: h5py.Dataset) -> bool:
    """Tell whether MATLAB wrote no numbers here: text as codes, or an empty array as its size."""
    kind = dataset.attrs.get("MATLAB_class", b"")
    return bytes(kind) in (b"char", b"cell") or "MATLAB_empty" in dataset.attrs


def _dataset(data: h5py.File, path: str, file: str) -> Any:
    """Return a dataset, or the field of a table of records."""
    parent, _, leaf = path.rpartition("/")
    table = data.get(parent) if parent else None
    if isinstance(table, h5py.Dataset):
        check_size(table.size, file, table.dtype.itemsize)
        return table.fields(leaf)
    dataset = data[path]
    check_size(dataset.size, file, dataset.dtype.itemsize)
    return dataset


def _whole_chunks(data: h5py.File, paths: Sequence[str], rows: int) -> int:
    """Return a number of rows near the one asked for that is made of whole chunks of the file."""
    nodes = [data[path] for path in paths if path in data]
    longest = max((max(n.chunks) for n in nodes if getattr(n, "chunks", None)), default=1)
    return rows if rows < longest // 64 else longest * max(1, round(rows / longest))


def _rows(dataset: Any, place: Place, begin: int, step: int) -> Any:
    """Read some rows of a dataset, all its columns."""
    samples = slice(begin, begin + step)
    if place.index is not None:
        return dataset[samples] if place.axis == 1 else dataset[:, samples]
    if len(dataset.shape) == 1:
        return dataset[samples]
    return np.ravel(dataset[samples] if dataset.shape[0] > 1 else dataset[:, samples])


def _picked(rows: Any, place: Place) -> Any:
    return rows if place.index is None else rows.take(place.index, axis=place.axis)


def _part(dataset: Any, place: Place) -> Any:
    """Read one column of a two-dimensional dataset."""
    part = dataset[:, place.index] if place.axis == 1 else dataset[place.index, :]
    return as_column(part, Place(place.path))


def _stated(data: h5py.File, path: str, place: Place) -> tuple[str | None, Rate | None]:
    """Return the unit and the sample rate in the attributes of a dataset or its groups."""
    nodes = [path, *(path[:i] for i in range(len(path) - 1, 0, -1) if path[i] == "/"), "/"]
    found = [data[node].attrs for node in nodes if node in data]
    units = (_unit(a, place.index) for a in found[:1])
    rates = (rate for attributes in found if (rate := _rate(attributes)))
    return next(units, None), next(rates, None)


def _unit(attributes: Any, index: int | None) -> str | None:
    """Return the attribute ``units`` (or ``unit``): one text, or one per column."""
    for key in ("units", "unit"):
        if key in attributes:
            texts = np.ravel(attributes[key])
            text = texts[0 if len(texts) == 1 or index is None else min(index, len(texts) - 1)]
            text = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
            return text.strip() or None
    return None


def _rate(attributes: Any) -> Rate | None:
    """Return the sample rate in Hz of an attribute of that name, or of the interval in s."""
    for key in (*_RATE, *_INTERVAL):
        if key in attributes and np.size(attributes[key]) == 1:
            number = np.ravel(attributes[key])[0]
            if is_numeric(np.asarray(number).dtype) and np.isfinite(number) and number > 0:
                return Rate(float(number) if key in _RATE else 1 / float(number))
    return None
