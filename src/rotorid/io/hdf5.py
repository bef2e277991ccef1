"""Reader of HDF5 files: a column is a one-dimensional dataset, or a column of a 2-D one.

Links are followed inside the file only. What nobody wrote reads as its fill value, 0: a data set
may be announced and never written, in whole or in part; its samples may lie in other files, or be
put together from other data sets, of which one may be gone.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rotorid.core.errors import InputError, ReadError
from rotorid.core.files import check_beside, check_regular
from rotorid.core.frozen import frozen
from rotorid.core.limits import CHUNK_BYTES, COLUMNS, DEPTH, NODES, PARTS, REFERENCES
from rotorid.core.units import si_factor
from rotorid.io.child import in_child
from rotorid.io.table import (
    Column,
    ColumnPlace,
    Rate,
    StoredArrays,
    check_held,
    content,
    head,
    is_numeric,
    not_what_it_says,
    reading,
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
        values = np.asarray(self.packing.unpacked(stored), dtype=np.float64)
        return Column(np.ascontiguousarray(values.ravel()), self.unit, self.rate)


@frozen
class Hdf5Table(StoredArrays):
    """A damaged file ends the process that reads it, so that a child does all asked of HDF5."""

    def check_held(self, names: Sequence[str]) -> None:
        """Leave it to the child, which knows the files that hold the samples."""

    def rows(self, names: Sequence[str], rows: int | None) -> Iterator[dict[str, Column]]:
        places = {name: self.place(name) for name in names}
        arrays: dict[tuple[str, int], dict[str, ColumnPlace]] = {}
        for name, place in places.items():
            arrays.setdefault((place.path, place.axis), {})[name] = place
        with opened(self.file) as data:
            nodes, held, refused = _checked(data, self.file, list(places.values()))
            for error in refused.values():
                raise error
            told = {name: _told(nodes[p.path], p, self.file) for name, p in places.items()}
            together = _together(nodes.values())
            if rows is None:
                check_held(self.bytes_of(names), held, self.file)
                whole = _records(together, slice(None))
                for (path, _), asked in arrays.items():
                    found = _rows(nodes[path], asked, slice(None), whole)
                    yield {name: told[name].column(stored) for name, stored in found.items()}
                return
            count = max(max(self.shapes[path]) for path, _ in arrays)
            step = _whole_chunks(nodes.values(), rows)
            for begin in range(0, count, step):
                samples = slice(begin, begin + step)
                records, block = _records(together, samples), dict[str, Column]()
                for (path, _), asked in arrays.items():
                    found = _rows(nodes[path], asked, samples, records)
                    block |= {name: told[name].column(stored) for name, stored in found.items()}
                yield block

    def refused(self, names: Sequence[str]) -> dict[str, InputError]:
        places = {name: self.place(name) for name in names}
        by_path: dict[str, InputError] = in_child(_refused, self.file, self.file, places)
        return {name: by_path[p.path] for name, p in places.items() if p.path in by_path}

    def scalar(self, name: str) -> float:
        found: float = in_child(_scalar, self.file, self.file, self.find_scalar(name))
        return found


def open_hdf5(path: Path) -> Hdf5Table:
    """Open an HDF5 file, or a MATLAB file of version 7.3."""
    kind = content(head(path))
    if kind not in ("HDF5 data", "a MAT v7.3 file") and not h5py.is_hdf5(path):
        raise not_what_it_says(path, kind, "HDF5 data")
    state = path.stat()
    return _table(str(path), (state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns))


@lru_cache(maxsize=1)
def _table(file: str, state: tuple[int, ...]) -> Hdf5Table:
    """Return what is in a file; a record is opened by blocks, and again where it is too small."""
    shapes = Contents(file)
    return Hdf5Table(file, shapes, others=shapes.others)


def _scalar(file: str, path: str) -> float:
    with opened(file) as data:
        nodes, _, refused = _checked(data, file, [ColumnPlace(path)])
        for error in refused.values():
            raise error
        node = nodes[path]
        packing = packing_of(node.dataset, file)
        return float(np.ravel(packing.unpacked(np.asarray(_numbers(node)[()])))[0])


def _refused(file: str, places: Mapping[str, ColumnPlace]) -> dict[str, InputError]:
    with opened(file) as data:
        return _checked(data, file, list(places.values()))[2]


def _checked(
    data: h5py.File, file: str, places: Sequence[ColumnPlace]
) -> tuple[dict[str, Hdf5Node], int, dict[str, InputError]]:
    """Return data sets, the bytes of the files that hold the largest, and those not there whole."""
    nodes: dict[str, Hdf5Node] = {}
    refused: dict[str, InputError] = {}
    tables: dict[str, tuple[Hdf5Node, frozenset[str], InputError | None]] = {}
    held = 0
    for path in dict.fromkeys(place.path for place in places):
        above, _, name = path.rpartition("/")
        table, fields, wrong = tables.get(above, (None, (), None))
        if table is not None and name in fields:  # what a thousand fields are takes its time
            nodes[path] = replace(table, field=name)
        else:
            node = find(data, path)
            if node is None:
                raise ValueError(f"{path!r} is gone")
            nodes[path], wrong = node, None
            try:
                held = max(held, check_stored(node.dataset, file))
            except InputError as error:
                wrong = error
            if node.field is not None:
                tables[above] = node, frozenset(node.dataset.dtype.names), wrong
        if wrong is not None:
            refused[path] = wrong
    return nodes, held, refused


def _numbers(node: Hdf5Node) -> Any:
    """Return a data set, or the field of a table of records."""
    return node.dataset if node.field is None else node.dataset.fields(node.field)


def _together(nodes: Iterable[Hdf5Node]) -> dict[h5py.Dataset, list[str]]:
    """Return the tables of records of which several fields are asked for, and these.

    They are read at once: for one field the library goes through all of every record.
    """
    found: dict[h5py.Dataset, list[str]] = {}
    for node in nodes:
        if node.field is not None and len(node.dataset.shape) == 1:
            found.setdefault(node.dataset, []).append(node.field)
    return {table: names for table, names in found.items() if len(names) > 1}


def _whole_chunks(nodes: Iterable[Hdf5Node], rows: int) -> int:
    """Return a number of rows near the one asked for that is made of whole chunks of the file."""
    longest = max((max(n.dataset.chunks) for n in nodes if n.dataset.chunks), default=1)
    return rows if rows < longest // 64 else longest * max(1, round(rows / longest))


def _records(together: Mapping[h5py.Dataset, list[str]], samples: slice) -> dict[Any, Any]:
    return {table: table.fields(names)[samples] for table, names in together.items()}


def _rows(
    node: Hdf5Node, asked: Mapping[str, ColumnPlace], samples: slice, records: Mapping[Any, Any]
) -> dict[str, Any]:
    """Return some rows of an array: of a 2-D one the columns that are asked for, read at once."""
    first = next(iter(asked.values()))
    if node.dataset in records:
        return dict.fromkeys(asked, records[node.dataset][node.field])
    numbers = _numbers(node)
    if first.index is None:
        along = len(node.dataset.shape) == 1 or node.dataset.shape[0] > 1
        return dict.fromkeys(asked, numbers[samples] if along else numbers[:, samples])
    if len(asked) == 1:
        one = (samples, first.index) if first.axis == 1 else (first.index, samples)
        return dict.fromkeys(asked, numbers[one])
    several = numbers[samples] if first.axis == 1 else numbers[:, samples].T
    return {name: several[:, place.index] for name, place in asked.items()}


def _told(node: Hdf5Node, place: ColumnPlace, file: str) -> Told:
    """Return what the attributes of a dataset say of a column, or those of its groups of a rate."""
    packing = packing_of(node.dataset, file)
    found = [node.dataset.attrs, *(group.attrs for group in reversed(node.above))]
    rates = (rate for attributes in found if (rate := _rate(attributes)))
    return Told(packing, _unit(found[0], place.index), next(rates, None))


def _unit(attributes: Any, index: int | None) -> str | None:
    """Return the attribute ``units`` (or ``unit``): one text, or one per column."""
    for key in ("units", "unit"):
        texts = attribute(attributes, key)
        if texts is not None:
            which = 0 if len(texts) == 1 or index is None else min(index, len(texts) - 1)
            return _text(texts[which]) or None
    return None


def _text(value: Any) -> str:
    return (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)).strip()


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
            try:
                return si_factor(_text(texts[0]), "Hz" if key in _RATE else "s")
            except InputError:
                return 0.0
    return 1.0


FIRST = 50
"""Groups and data sets that are looked at when a file is opened: 10 ms."""

_HOPS = 16  # links that lead to links: what HDF5 itself allows
_ELSEWHERE = "a link into another file"
_TEXTS = (b"char", b"cell")  # what MATLAB calls text as codes, and cells


@frozen
class Hdf5Node:
    """A data set, the field of it where it is a table of records, and the groups above it."""

    dataset: h5py.Dataset
    field: str | None
    above: tuple[h5py.Group, ...]

    @property
    def kind(self) -> str | None:
        """Say what it holds in place of real numbers; None where it holds these."""
        dtype = self.dataset.dtype if self.field is None else self.dataset.dtype[self.field]
        return _kind(dtype) or (_matlab_kind(self.dataset) if self.field is None else None)


@dataclass
class Hdf5Content:
    """Shapes of numeric arrays by path, and what else there is.

    `whole` says that these are all of a file; from `aliases` on, paths were not walked: links, and
    groups that were seen already.
    """

    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    others: dict[str, str] = field(default_factory=dict)
    whole: bool = False
    aliases: set[str] = field(default_factory=set)

    def knows(self, path: str) -> bool:
        """Tell whether all that a path may lead to was looked at."""
        ends = [end for end, letter in enumerate(path) if letter == "/"]
        return self.whole and self.aliases.isdisjoint([path, *(path[:end] for end in ends)])

    def note(self, path: str, node: Hdf5Node | None) -> None:
        """Take up a data set, or the fields of one that is a table of records."""
        if node is None or node.dataset.shape is None:
            return
        names = node.dataset.dtype.names
        if node.field is None and names:
            for name in names:
                self.note(f"{path}/{name}", Hdf5Node(node.dataset, name, ()))
        elif (kind := node.kind) is None:
            self.shapes[path] = tuple(node.dataset.shape)
        else:
            self.others[path] = kind


class Contents(Mapping[str, tuple[int, ...]]):
    """Shapes of the numeric arrays of a file by path.

    Some are looked at when the file is opened. Of those of a larger file one that is asked for by
    its path is looked at by itself; all are only where names are searched.
    """

    def __init__(self, file: str) -> None:
        self._file, self._asked = file, set[str]()
        self._found: Hdf5Content = in_child(_look, file, file, FIRST)

    @property
    def others(self) -> dict[str, str]:
        """What else there is, as far as it was looked at."""
        return self._found.others

    def __getitem__(self, path: str) -> tuple[int, ...]:
        """Return the shape of the array of a path, which links may lead to."""
        found = self._found
        new = path not in found.shapes and path not in self._asked
        if new and path == "/".join(_steps(path)) and not found.knows(path):
            self._asked.add(path)
            there: Hdf5Content = in_child(_look_at, self._file, self._file, path)
            found.shapes |= there.shapes
            found.others |= there.others
        return found.shapes[path]

    def __iter__(self) -> Iterator[str]:
        if not self._found.whole:
            every: Hdf5Content = in_child(_look, self._file, self._file, NODES)
            every.shapes |= self._found.shapes  # those found behind links
            self._found.others.update(every.others)
            self._found = replace(every, others=self._found.others)
        return iter(self._found.shapes)

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _look(file: str, most: int) -> Hdf5Content:
    """Return what is in a file; where only some of it is asked for, up to what cannot be read."""
    found = Hdf5Content()
    with opened(file) as data:
        try:
            for path, node in _walk(data, file, most, found):
                found.note(path, node)
        except Exception:
            if most >= NODES:
                raise
            return found
    return replace(found, whole=True)


def _look_at(file: str, path: str) -> Hdf5Content:
    found = Hdf5Content()
    with opened(file) as data:
        found.note(path, find(data, path, found.others))
    return found


@contextmanager
def opened(file: str) -> Iterator[h5py.File]:
    with reading(file, "HDF5 data"), h5py.File(file, "r") as data:
        yield data


def find(data: h5py.File, path: str, others: dict[str, str] | None = None) -> Hdf5Node | None:
    """Return the data set of a path, or None; links into other files are noted in `others`."""
    steps, above, hops = _steps(path), [data["/"]], 0
    while steps:
        name, *steps = steps
        key = _key(above[-1], name)
        links = above[-1].id.links
        kind = None if key is None else links.get_info(key).type
        if kind == h5py.h5l.TYPE_SOFT and hops < _HOPS:
            hops, target = hops + 1, _shown(links.get_val(key))
            above = above[:1] if target.startswith("/") else above
            steps = [*_steps(target), *steps]
            continue
        if kind == h5py.h5l.TYPE_EXTERNAL and others is not None:
            file = _shown(links.get_val(key)[0])
            others[path.strip("/")] = f"{_ELSEWHERE} ({file[:80]}: name it in files)"
        if key is None or kind != h5py.h5l.TYPE_HARD:
            return None
        node = _open(above[-1], key)
        if isinstance(node, h5py.Dataset):
            field = steps[0] if len(steps) == 1 else None
            fitting = not steps if field is None else field in (node.dtype.names or ())
            return Hdf5Node(node, field, tuple(above)) if fitting else None
        if not isinstance(node, h5py.Group) or len(above) > DEPTH:
            return None
        above.append(node)
    return None


def _walk(
    data: h5py.File, file: str, most: int, found: Hdf5Content
) -> Iterator[tuple[str, Hdf5Node]]:
    """Yield the data sets of a file with their paths, each object once."""
    seen, count = {h5py.h5o.get_info(data.id).addr}, 0
    waiting: list[tuple[str, tuple[h5py.Group, ...]]] = [("", (data["/"],))]
    while waiting:
        prefix, above = waiting.pop()
        inner: list[tuple[str, tuple[h5py.Group, ...]]] = []
        for key in (group := above[-1]):
            key, shown = _raw(key), _shown(key)
            path = prefix + shown
            if shown[:1] == "#" or group.id.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                found.aliases.add(path)
                continue  # "#refs#" holds the cells of MATLAB
            count += 1
            _check_bounds(count, path, file, most)
            node = _open(group, key)
            if node is None:  # a type that has a name
                continue
            address = h5py.h5o.get_info(node.id).addr
            if address in seen:
                found.aliases.add(path)
                continue
            seen.add(address)
            if isinstance(node, h5py.Group):
                inner.append((f"{path}/", (*above, node)))
            elif isinstance(node, h5py.Dataset):
                yield path, Hdf5Node(node, None, above)
        waiting += reversed(inner)


def _check_bounds(count: int, path: str, file: str, most: int) -> None:
    if count > most or path.count("/") > DEPTH:
        many = f"more than {most} groups and data sets"
        raise ReadError(
            many if count > most else f"more than {DEPTH} groups in one another",
            "fewer to look through for a name",
            "write the whole path of each column, such as run1/x",
            file=file,
        )


def _steps(path: str) -> list[str]:
    return [step for step in path.split("/") if step not in ("", ".")]


def _key(group: h5py.Group, name: str) -> bytes | None:
    """Return a name as the file has it: in UTF-8, or as older programs of Windows wrote it."""
    for encoding in ("utf-8", "latin-1") if "\0" not in name else ():
        try:
            key = name.encode(encoding)
        except UnicodeEncodeError:
            continue
        if group.id.links.exists(key):
            return key
    return None


def _shown(key: str | bytes) -> str:
    """Return a name with the letters that it was written in."""
    raw = _raw(key)
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _raw(key: str | bytes) -> bytes:
    """Return a name as h5py takes and gives it: text, where it can be decoded."""
    return key if isinstance(key, bytes) else key.encode("utf-8", "surrogateescape")


def _open(group: h5py.Group, name: bytes) -> Any:
    """Open a node; what a data set keeps in files beside it counts from the folder of its file."""
    access = h5py.h5p.create(h5py.h5p.DATASET_ACCESS)
    access.set_efile_prefix(b"${ORIGIN}")
    match h5py.h5o.get_info(group.id, name).type:
        case h5py.h5o.TYPE_DATASET:
            return h5py.Dataset(h5py.h5d.open(group.id, name, access))
        case h5py.h5o.TYPE_GROUP:
            return h5py.Group(h5py.h5g.open(group.id, name))
    return None


def _kind(dtype: Any) -> str | None:
    """Say what a type holds in place of real numbers."""
    if dtype.kind == "b":
        return None  # a bit is an enumeration, too
    found = {
        "text": h5py.check_string_dtype(dtype) is not None or dtype.kind in "SU",
        "lists": h5py.check_vlen_dtype(dtype) is not None,
        "references": h5py.check_ref_dtype(dtype) is not None,
        "names of an enumeration": h5py.check_enum_dtype(dtype) is not None,
        "complex numbers": dtype.kind == "c",
        "a table of records": bool(dtype.names),
        "another type": not is_numeric(dtype),
    }
    return next((kind for kind, is_it in found.items() if is_it), None)


def _matlab_kind(dataset: h5py.Dataset) -> str | None:
    """Say where MATLAB wrote no numbers: text as codes, or an empty array as its size."""
    if "MATLAB_empty" in dataset.attrs:
        return "nothing"
    kind = dataset.attrs.get("MATLAB_class", b"")
    return "text or cells" if isinstance(kind, bytes) and kind in _TEXTS else None


@frozen
class Packing:
    """How stored numbers become samples, by the attributes beside them, as netCDF has it.

    ``value = scale_factor * stored + add_offset``, and a stored ``_FillValue`` is no sample at all.
    """

    scale: float = 1.0
    offset: float = 0.0
    missing: tuple[float, ...] = ()  # stored numbers that stand for a gap
    wrap: float = 0.0  # added to negative numbers: unsigned ones that were stored as signed

    def unpacked(self, stored: Any) -> Any:
        """Return samples, gaps as NaN; what is not packed as it is."""
        if self == Packing():
            return stored
        found = np.array(stored, dtype=np.float64)
        gaps = np.isin(found, self.missing) if self.missing else None
        if self.wrap:
            found[found < 0] += self.wrap
        found *= self.scale
        found += self.offset
        if gaps is not None:
            found[gaps] = np.nan
        return found


def packing_of(dataset: Any, file: str) -> Packing:
    """Return how the numbers of a data set are packed."""
    attributes = dataset.attrs
    one = {"scale_factor": 1.0, "add_offset": 0.0}
    for key in one:
        if key in attributes:
            one[key] = _number(attributes, key, dataset.name, file)
    missing = []
    for key in ("_FillValue", "missing_value"):
        found = attribute(attributes, key)
        if found is not None and is_numeric(found.dtype):
            missing += [float(x) for x in found if np.isfinite(x)]
    text = attribute(attributes, "_Unsigned")
    unsigned = text is not None and str(text[0]).strip("b'").lower() == "true"
    wrap = 2.0 ** (8 * dataset.dtype.itemsize) if unsigned and dataset.dtype.kind == "i" else 0.0
    return Packing(one["scale_factor"], one["add_offset"], tuple(missing), wrap)


def _number(attributes: Any, key: str, name: str, file: str) -> float:
    found = attribute(attributes, key)
    is_one = found is not None and len(found) == 1 and is_numeric(found.dtype)
    number = float(found[0]) if is_one else float("nan")
    if not np.isfinite(number) or (number == 0 and key == "scale_factor"):
        raise ReadError(
            f"an attribute {key} of {name[:80]!r} that is no number to scale by",
            "one number that is not 0" if key == "scale_factor" else "one number",
            "write the samples as they are, or that attribute anew",
            file=file,
        )
    return number


def attribute(attributes: Any, key: str) -> Any:
    """Return an attribute as a row of values; None where there is none, or none that we ask for."""
    if key not in attributes or (shape := (told := attributes.get_id(key)).shape) is None:
        return None
    if told.dtype.kind == "O" and h5py.check_string_dtype(told.dtype) is None:
        return None  # a list of any length: of a damaged one HDF5 ends the process
    return np.ravel(attributes[key]) if 0 < np.prod(shape) <= COLUMNS else None


_REWRITE = "write the data set whole, or cut it to what was recorded (dataset.resize in h5py)"


def check_stored(dataset: h5py.Dataset, file: str, depth: int = 0) -> int:
    """Refuse a data set that is not there whole; return the bytes of the files that hold it."""
    plan = dataset.id.get_create_plist()
    layout = plan.get_layout()
    held = check_regular(file).st_size
    if not dataset.size:
        return held
    if layout == h5py.h5d.VIRTUAL:
        held += _check_virtual(dataset, plan, file, depth)
    elif plan.get_external_count():
        held += _check_external(dataset, plan, file, depth)
    elif layout == h5py.h5d.CHUNKED:
        _check_chunks(dataset, file)
    elif not dataset.id.get_storage_size() and not _tells_gaps(dataset):
        raise _gap(dataset, "no sample written", file)
    check_held(dataset.size * dataset.dtype.itemsize, held, file)
    return held


def _check_chunks(dataset: h5py.Dataset, file: str) -> None:
    """Refuse chunks that fill the memory, and those that nobody wrote."""
    size = math.prod(dataset.chunks) * dataset.dtype.itemsize
    if size > CHUNK_BYTES:
        raise ReadError(
            f"chunks of {size // 10**6} MB in {_name(dataset)}",
            f"chunks of {CHUNK_BYTES // 10**6} MB at most, since each is unpacked whole",
            "write smaller chunks: h5repack -l CHUNK=10000",
            file=file,
        )
    pairs = zip(dataset.shape, dataset.chunks, strict=True)
    expected = math.prod(-(-length // chunk) for length, chunk in pairs)
    written = dataset.id.get_num_chunks()
    if written < expected and not _tells_gaps(dataset):
        raise _gap(dataset, f"{expected - written} of {expected} chunks never written", file)


def _check_external(dataset: h5py.Dataset, plan: Any, file: str, depth: int) -> int:
    """Look at the files that hold the samples; return their bytes."""
    needed, held = dataset.size * dataset.dtype.itemsize, 0
    if depth:
        raise ReadError(
            f"samples of {_name(dataset)} in files of their own",
            "parts that hold their samples",
            "write the parts whole: h5repack -l CONTI",
            file=file,
        )
    for number in range(plan.get_external_count()):
        name, offset, size = plan.get_external(number)
        path = check_beside(os.fsdecode(name), file)
        there = max(path.stat().st_size - offset, 0)
        size = min(size, needed)  # the last may be without end
        if there < size:
            raise _gap(dataset, f"{there} of {size} bytes in {path.name}", file)
        needed, held = needed - size, held + there
    if needed:
        raise _gap(dataset, f"{needed} bytes too few in the files that hold it", file)
    return held


def _check_virtual(dataset: h5py.Dataset, plan: Any, file: str, depth: int) -> int:
    """Look at the parts of a virtual data set, and that they fill it; return their files' bytes."""
    count, files = plan.get_virtual_count(), {}
    if count > PARTS or depth >= REFERENCES:
        found = f"{count} parts" if count > PARTS else f"parts of parts, {depth} deep,"
        raise ReadError(
            f"{found} of {_name(dataset)}",
            f"{PARTS} at most",
            "write it whole: h5repack",
            file=file,
        )
    covered = h5py.h5s.create_simple(dataset.shape)
    covered.select_none()
    for number in range(count):
        name = plan.get_virtual_filename(number)
        inner = plan.get_virtual_dsetname(number)
        target, origin = plan.get_virtual_vspace(number), plan.get_virtual_srcspace(number)
        if any("%b" in text.replace("%%", "") for text in (name, inner)) or _endless(target):
            raise ReadError(
                f"parts without end in {_name(dataset)}",
                "a virtual data set of parts that are named",
                "write it whole, or name each part",
                file=file,
            )
        name, inner = name.replace("%%", "%"), inner.replace("%%", "%")
        path = file if name == "." else str(check_beside(name, file))
        files[path] = _check_part(path, inner, origin, target, dataset, depth)
        _add(covered, target)
    if covered.get_select_npoints() < dataset.size:
        missing = dataset.size - covered.get_select_npoints()
        raise _gap(dataset, f"{missing} samples in none of its parts", file)
    return sum(files.values())


def _check_part(
    path: str, name: str, origin: Any, target: Any, whole: h5py.Dataset, depth: int
) -> int:
    """Look at one part of a virtual data set; return the bytes of the files that hold it."""
    with opened(path) as data:
        node = find(data, name)
        if node is None or node.field is not None or node.kind is not None:
            raise ReadError(
                f"no numbers {name[:80]!r}, a part of {_name(whole)}",
                "a data set there",
                "write that part again",
                file=path,
            )
        if origin.get_select_type() == h5py.h5s.SEL_ALL:  # as many as there are
            there: tuple[int, ...] = (node.dataset.size,)
            needed: tuple[int, ...] = (target.get_select_npoints(),)
            fits = there == needed
        else:
            there = node.dataset.shape
            needed = tuple(int(last) + 1 for last in origin.get_select_bounds()[1])
            fits = len(there) == len(needed) and all(np.greater_equal(there, needed))
        if not fits:
            raise _gap(node.dataset, f"{there} where {whole.name} takes {needed}", path)
        return check_stored(node.dataset, path, depth + 1)


def _endless(space: Any) -> bool:
    """Tell whether a selection goes on without end: then HDF5 does not say how much it is."""
    try:
        return not 0 <= space.get_select_npoints() < 2**62
    except RuntimeError:
        return True


def _add(covered: Any, space: Any) -> None:
    kind, either = space.get_select_type(), h5py.h5s.SELECT_OR
    if kind == h5py.h5s.SEL_ALL:
        covered.select_all()
    elif kind == h5py.h5s.SEL_HYPERSLABS and covered.get_select_type() != h5py.h5s.SEL_ALL:
        if space.is_regular_hyperslab():
            start, stride, count, block = space.get_regular_hyperslab()
            covered.select_hyperslab(start, count, stride, block, op=either)
        else:
            for first, last in space.get_select_hyper_blocklist():
                covered.select_hyperslab(
                    tuple(first), (1,) * len(first), None, tuple(last - first + 1), op=either
                )


def _tells_gaps(dataset: h5py.Dataset) -> bool:
    """Tell whether what was not written reads as no number, of which the record's checks tell."""
    return dataset.dtype.kind == "f" and bool(np.isnan(dataset.fillvalue))


def _name(dataset: h5py.Dataset) -> str:
    return repr(str(dataset.name)[:80])


def _gap(dataset: h5py.Dataset, found: str, file: str) -> ReadError:
    return ReadError(
        f"{found}: a gap in {_name(dataset)}", "every sample in the file", _REWRITE, file=file
    )
