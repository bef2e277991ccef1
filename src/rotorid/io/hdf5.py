"""Reader of HDF5 files: a column is a one-dimensional dataset, or a column of a 2-D one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rotorid.errors import InputError
from rotorid.io.hdf5_nodes import Contents, Node, find, opened
from rotorid.io.hdf5_packing import attribute, packing_of
from rotorid.io.hdf5_storage import check_stored
from rotorid.io.table import (
    Column,
    NamedArrays,
    Place,
    Rate,
    as_column,
    check_held,
    content,
    head,
    is_numeric,
    not_what_it_says,
)
from rotorid.units import si_factor

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
        with opened(self.file) as data:
            nodes = self._checked(data, paths)
            held = max((held for _, held in nodes.values()), default=0)
            check_held(self.bytes_of(list(wanted)), held, self.file)
            for name, place in wanted.items():
                path = place.path
                node = nodes[path][0]
                if path not in whole and (place.index is None or paths.count(path) > 1):
                    whole[path] = _numbers(node)[()]
                values = (
                    as_column(whole[path], place) if path in whole else _part(_numbers(node), place)
                )
                packing = packing_of(node.dataset, self.file)
                columns[name] = Column(packing.unpacked(values), *_stated(node, place))
        return columns

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, Column]]:
        """Yield successive rows of columns, by the names that `find` returned."""
        places = {name: self.place(name) for name in names}
        with opened(self.file) as data:
            nodes = self._checked(data, [place.path for place in places.values()])
            found = {p: nodes[p.path][0] for p in places.values()}
            datasets = {p: _numbers(node) for p, node in found.items()}
            stated = {name: _stated(found[p], p) for name, p in places.items()}
            packed = {p: packing_of(node.dataset, self.file) for p, node in found.items()}
            count = max(max(self.shapes[p.path]) for p in places.values())
            step = _whole_chunks(found.values(), rows)
            for begin in range(0, count, step):
                parts: dict[tuple[str, int], Any] = {}
                for place, dataset in datasets.items():
                    if (place.path, place.axis) not in parts:
                        parts[place.path, place.axis] = _rows(dataset, place, begin, step)
                yield {
                    name: Column(
                        packed[p].unpacked(_picked(parts[p.path, p.axis], p)), *stated[name]
                    )
                    for name, p in places.items()
                }

    def scalar(self, name: str) -> float:
        """Return a dataset of one number."""
        path = self.find_scalar(name)
        with opened(self.file) as data:
            node = self._checked(data, [path])[path][0]
            packing = packing_of(node.dataset, self.file)
            return float(np.ravel(packing.unpacked(np.asarray(_numbers(node)[()])))[0])

    def _checked(self, data: h5py.File, paths: Sequence[str]) -> Mapping[str, tuple[Node, int]]:
        """Return data sets that are there whole, and the bytes of the files that hold them."""
        nodes = {}
        for path in dict.fromkeys(paths):
            node = find(data, path)
            if node is None:
                raise ValueError(f"{path!r} is gone")
            nodes[path] = node, check_stored(node.dataset, self.file)
        return nodes


def open_hdf5(path: Path) -> Hdf5Table:
    """Open an HDF5 file, or a MATLAB file of version 7.3."""
    start = head(path)
    if content(start) not in ("HDF5 data", "a MAT v7.3 file") and not h5py.is_hdf5(path):
        raise not_what_it_says(path, start, "HDF5 data")
    with opened(str(path)):
        shapes = Contents(str(path))
    return Hdf5Table(str(path), shapes, others=shapes.others)


def _numbers(node: Node) -> Any:
    """Return a data set, or the field of a table of records."""
    return node.dataset if node.field is None else node.dataset.fields(node.field)


def _whole_chunks(nodes: Iterable[Node], rows: int) -> int:
    """Return a number of rows near the one asked for that is made of whole chunks of the file."""
    longest = max((max(n.dataset.chunks) for n in nodes if n.dataset.chunks), default=1)
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


def _stated(node: Node, place: Place) -> tuple[str | None, Rate | None]:
    """Return the unit and the sample rate in the attributes of a dataset or its groups."""
    found = [node.dataset.attrs, *(group.attrs for group in reversed(node.above))]
    rates = (rate for attributes in found if (rate := _rate(attributes)))
    return _unit(found[0], place.index), next(rates, None)


def _unit(attributes: Any, index: int | None) -> str | None:
    """Return the attribute ``units`` (or ``unit``): one text, or one per column."""
    for key in ("units", "unit"):
        texts = attribute(attributes, key)
        if texts is not None:
            text = texts[0 if len(texts) == 1 or index is None else min(index, len(texts) - 1)]
            text = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
            return text.strip() or None
    return None


def _rate(attributes: Any) -> Rate | None:
    """Return the sample rate in Hz of an attribute of that name, or of the interval in s."""
    for key in (*_RATE, *_INTERVAL):
        found = attribute(attributes, key)
        if found is not None and len(found) == 1:
            number = found[0]
            if is_numeric(np.asarray(number).dtype) and np.isfinite(number) and number > 0:
                size = float(number) * _unit_of(attributes, key)
                if not size > 0:  # in a unit that says nothing
                    continue
                return Rate(size if key in _RATE else 1 / size)
    return None


def _unit_of(attributes: Any, key: str) -> float:
    """Return what turns a rate into Hz, or an interval into s, as an attribute beside it says."""
    for name in (f"{key}_units", f"{key}_unit", "time_units" if key in _INTERVAL else ""):
        texts = attribute(attributes, name) if name else None
        if texts is not None:
            text = texts[0].decode("utf-8", "replace") if isinstance(texts[0], bytes) else texts[0]
            try:
                return si_factor(str(text).strip(), "Hz" if key in _RATE else "s")
            except InputError:
                return 0.0
    return 1.0
