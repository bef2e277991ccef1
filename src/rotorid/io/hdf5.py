"""Reader of HDF5 files: a column is a one-dimensional dataset, or a column of a 2-D one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.units import si_factor
from rotorid.io.child import from_child, in_child
from rotorid.io.hdf5_nodes import Contents, Node, find, opened
from rotorid.io.hdf5_packing import Packing, attribute, packing_of
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

_RATE = ("sample_rate", "sampling_rate", "sampling_frequency", "samplerate", "fs")
_INTERVAL = ("sample_interval", "wf_increment", "dt")


@frozen
class Told:
    """What a file says of a column."""

    packing: Packing
    unit: str | None
    rate: Rate | None

    def column(self, stored: Any) -> Column:
        """Return the column of numbers as they are stored."""
        return Column(self.packing.unpacked(stored), self.unit, self.rate)


@frozen
class Hdf5Table(NamedArrays):
    """An HDF5 file; its numbers are read when they are asked for.

    A damaged one ends the process that reads it, now and then, so that a child does all that is
    asked of HDF5.
    """

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        wanted = {name: self.place(name) for name in names}
        places = list(wanted.values())
        answers = from_child(_arrays, self.file, self.file, places, self.bytes_of(list(wanted)))
        told: Mapping[Place, Told] = next(answers)
        stored: dict[Place, Any] = dict(answers)
        sources, columns = _sources(places), {}
        for name, place in wanted.items():
            source = sources[place]
            values = as_column(stored[source], Place("") if source == place else place)
            columns[name] = told[place].column(values)
        return columns

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, Column]]:
        """Yield successive rows of columns, by the names that `find` returned."""
        wanted = {name: self.place(name) for name in names}
        places = list(wanted.values())
        count = max(max(self.shapes[place.path]) for place in places)
        answers = from_child(_blocks, self.file, self.file, places, count, rows)
        told: Mapping[Place, Told] = next(answers)
        for stored in answers:
            yield {
                name: told[place].column(_picked(stored[_rows_of(place)], place))
                for name, place in wanted.items()
            }

    def scalar(self, name: str) -> float:
        """Return a dataset of one number."""
        found: float = in_child(_scalar, self.file, self.file, self.find_scalar(name))
        return found


def open_hdf5(path: Path) -> Hdf5Table:
    """Open an HDF5 file, or a MATLAB file of version 7.3."""
    start = head(path)
    if content(start) not in ("HDF5 data", "a MAT v7.3 file") and not h5py.is_hdf5(path):
        raise not_what_it_says(path, start, "HDF5 data")
    state = path.stat()
    return _table(str(path), (state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns))


@lru_cache(maxsize=1)
def _table(file: str, state: tuple[int, ...]) -> Hdf5Table:
    """Return what is in a file; a record is opened by blocks, and again where it is too small."""
    shapes = Contents(file)
    return Hdf5Table(file, shapes, others=shapes.others)


def _arrays(file: str, places: Sequence[Place], size: int) -> Iterator[Any]:
    """Yield what the file says of places, and then their numbers."""
    sources = _sources(places)
    with opened(file) as data:
        nodes, held = _checked(data, file, places)
        check_held(size, held, file)
        yield {place: _told(nodes[place.path], place, file) for place in sources}
        for source in dict.fromkeys(sources.values()):
            numbers = _numbers(nodes[source.path])
            yield source, numbers[()] if source.index is None else _part(numbers, source)


def _blocks(file: str, places: Sequence[Place], count: int, rows: int) -> Iterator[Any]:
    """Yield what the file says of places, and then their rows."""
    with opened(file) as data:
        nodes, _ = _checked(data, file, places)
        yield {place: _told(nodes[place.path], place, file) for place in places}
        sources = {_rows_of(place): _numbers(nodes[place.path]) for place in places}
        step = _whole_chunks(nodes.values(), rows)
        for begin in range(0, count, step):
            yield {s: _rows(numbers, s, begin, step) for s, numbers in sources.items()}


def _scalar(file: str, path: str) -> float:
    with opened(file) as data:
        node = _checked(data, file, [Place(path)])[0][path]
        packing = packing_of(node.dataset, file)
        return float(np.ravel(packing.unpacked(np.asarray(_numbers(node)[()])))[0])


def _checked(data: h5py.File, file: str, places: Sequence[Place]) -> tuple[dict[str, Node], int]:
    """Return data sets that are there whole, and the bytes of the files that hold the largest."""
    nodes, held = {}, 0
    for path in dict.fromkeys(place.path for place in places):
        node = find(data, path)
        if node is None:
            raise ValueError(f"{path!r} is gone")
        nodes[path], held = node, max(held, check_stored(node.dataset, file))
    return nodes, held


def _told(node: Node, place: Place, file: str) -> Told:
    """Return what a file says of a column."""
    return Told(packing_of(node.dataset, file), *_stated(node, place))


def _sources(places: Sequence[Place]) -> dict[Place, Place]:
    """Return what is read for each place: an array of which several columns are asked for whole."""
    count = Counter(place.path for place in dict.fromkeys(places))
    return {place: Place(place.path) if count[place.path] > 1 else place for place in places}


def _rows_of(place: Place) -> Place:
    """Return what stands for all columns of the rows of an array."""
    return place if place.index is None else Place(place.path, 0, place.axis)


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
    return dataset[:, place.index] if place.axis == 1 else dataset[place.index, :]


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
