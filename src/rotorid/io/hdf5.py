"""Reader of HDF5 files: links are followed inside the file only.

What nobody wrote reads as its fill value, 0: all of a data set, a part, or a file that holds one.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from typing import Any

import h5py
import numpy as np

from rotorid.core.errors import InputError, ReadError, naming
from rotorid.core.files import check_beside, check_regular
from rotorid.core.frozen import frozen
from rotorid.core.units import si_factor, to_si
from rotorid.io.sandbox import damaged
from rotorid.io.table import (
    COLUMNS,
    DEPTH,
    ArrayFile,
    Column,
    ColumnPlace,
    Rate,
    check_held,
    is_numeric,
)

CHUNK_BYTES = 256_000_000
"""Of a chunk, which is unpacked whole: writers choose from 10 kB to 10 MB."""

NODES = 10_000
"""Groups and data sets looked through for a name, 0.1 ms each; a whole path is found at once."""

PARTS = 5_000
"""Files of a virtual data set, each of which is opened: one a second, for an hour."""

REFERENCES = 4
"""Files that refer to files: a virtual data set of virtual data sets is two."""

_RATE = ("sample_rate", "sampling_rate", "sampling_frequency", "samplerate", "fs")
_INTERVAL = ("sample_interval", "wf_increment", "dt")
_PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "_Unsigned")
_ASKED = ("units", "unit", *_RATE, *_INTERVAL, *_PACKING)
_HOPS = 16  # links that lead to links: what HDF5 itself allows
_TEXTS = (b"char", b"cell")  # what MATLAB calls text as codes, and cells


@contextmanager
def open_hdf5(file: str) -> Iterator[ArrayFile]:
    """Open an HDF5 file, or a MATLAB file of version 7.3."""
    with h5py.File(file, "r") as data:  # refused while another program writes it
        with suppress(ImportError, OSError, NotImplementedError):
            from fcntl import LOCK_UN, flock

            flock(data.id.get_vfd_handle(), LOCK_UN)  # none need wait until this one is closed
        yield _Hdf5File(file, data)


class _Hdf5File(ArrayFile):
    in_blocks = True
    shapes: _Contents

    def __init__(self, file: str, data: h5py.File) -> None:
        contents = _Contents(data)
        super().__init__(file, contents, others=contents.others)
        self._stored: dict[h5py.Dataset, int] = {}

    def bytes_held(self, places: Mapping[str, ColumnPlace]) -> int:
        """Return the bytes of the files that hold data sets; refuse one not there whole."""
        most = 0
        for place in places.values():
            dataset = self.shapes.node(place.path).dataset
            if (held := self._stored.get(dataset)) is None:
                held = self._stored[dataset] = check_stored(dataset, self.file)
            most = max(most, held)
        return most

    def columns(
        self, places: Mapping[str, ColumnPlace], rows: int | None
    ) -> Iterator[dict[str, Column]]:
        arrays: dict[tuple[str, int], dict[str, ColumnPlace]] = {}
        for name, place in places.items():
            arrays.setdefault((place.path, place.axis), {})[name] = place
        nodes = {path: self.shapes.node(path) for path, _ in arrays}
        rates = dict[int, Rate | None]()
        column = {name: _column_of(nodes[p.path], p.index, rates) for name, p in places.items()}
        fields: dict[h5py.Dataset, list[str]] = {}
        for node in nodes.values():
            if node.field is not None and len(node.dataset.shape) == 1:
                fields.setdefault(node.dataset, []).append(node.field)
        count = max(max(self.shapes[path], default=1) for path in nodes)
        step = rows or max(count, 1)
        chunk = max((max(n.dataset.chunks) for n in nodes.values() if n.dataset.chunks), default=1)
        if rows and rows >= chunk // 64:  # whole chunks of the file, near what is asked for
            step = chunk * max(1, round(rows / chunk))
        for begin in range(0, max(count, 1), step):
            samples = slice(begin, begin + step)
            # Read at once: for one field the library goes through all of every record.
            records = {table: table.fields(names)[samples] for table, names in fields.items()}
            parts = (
                {name: column[name](stored) for name, stored in found.items()}
                for (path, _), asked in arrays.items()
                for found in [_rows(nodes[path], asked, samples, records)]
            )
            if rows is None:  # one after the other: each takes its room here
                yield from parts
            else:
                yield {name: column for part in parts for name, column in part.items()}


def _rows(
    node: Hdf5Node, asked: Mapping[str, ColumnPlace], samples: slice, records: Mapping[Any, Any]
) -> dict[str, Any]:
    """Return some rows of an array: of a 2-D one the columns that are asked for, read at once."""
    first, shape = next(iter(asked.values())), node.dataset.shape
    if records and node.dataset in records:
        return dict.fromkeys(asked, records[node.dataset][node.field])
    numbers = node.dataset if node.field is None else node.dataset.fields(node.field)
    if first.index is None:
        along = (samples,) if len(shape) == 1 or shape[:1] > (1,) else (slice(None), samples)
        return dict.fromkeys(asked, numbers[along if shape else ()])
    if len(asked) == 1:
        one = (samples, first.index) if first.axis == 1 else (first.index, samples)
        return dict.fromkeys(asked, numbers[one])
    several = numbers[samples] if first.axis == 1 else numbers[:, samples].T
    return {name: several[:, place.index] for name, place in asked.items()}


def _column_of(
    node: Hdf5Node, index: int | None, rates: dict[int, Rate | None]
) -> Callable[[Any], Column]:
    """Return what makes a column of stored numbers; `rates` keeps those of the groups above."""
    said = attributes(node.dataset)
    if (rate := _rate(said)) is None:
        if id(node.above) not in rates:
            above = (_rate(attributes(group)) for group in reversed(node.above))
            rates[id(node.above)] = next(filter(None, above), None)
        rate = rates[id(node.above)]
    unit, unpacked = _unit(said, index), _unpacking(node.dataset, said)

    def column(stored: Any) -> Column:
        values = np.asarray(unpacked(stored), dtype=np.float64)
        return Column(np.ascontiguousarray(values.ravel()), unit, rate)

    return column


def _unit(said: Mapping[str, Any], index: int | None) -> str | None:
    """Return the attribute ``units``, or else ``unit``: one text, or one per column."""
    told = (said.get(key) for key in ("units", "unit"))
    for texts in (texts for texts in told if texts is not None):
        which = 0 if len(texts) == 1 or index is None else min(index, len(texts) - 1)
        if text := _text(texts[which]):
            return text
    return None


def _text(value: Any) -> str:
    return (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)).strip()


def _rate(said: Mapping[str, Any]) -> Rate | None:
    """Return the sample rate in Hz of an attribute of that name, or of the interval in s."""
    for key in (*_RATE, *_INTERVAL):
        with suppress(InputError):  # a unit that says nothing
            size = _size(said, key, "Hz" if key in _RATE else "s")
            if size > 0:
                return Rate(size if key in _RATE else 1 / size)
    return None


def _size(said: Mapping[str, Any], key: str, unit: str) -> float:
    """Return an attribute in a unit: a text, ``10 kHz``, or a number, by the unit beside it."""
    told = said.get(key)
    if told is not None and len(told) == 1 and isinstance(told[0], str | bytes):
        text = _text(told[0])
        return to_si(text if text[-1:].isalpha() else f"{text} {unit}", unit)
    for name in (f"{key}_units", f"{key}_unit", "time_units" if unit == "s" else ""):
        if (texts := said.get(name)) is not None:
            return _one_number(told) * si_factor(_text(texts[0]), unit)
    return _one_number(told)


def attributes(of: h5py.Dataset | h5py.Group) -> dict[str, Any]:
    """Return attributes as rows of values; None for one that holds none that we ask for."""
    there = [key for key in _ASKED if h5py.h5a.exists(of.id, key.encode())]
    beside = [f"{key}_{unit}" for key in there for unit in ("units", "unit")]
    there += [k for k in (*beside, "time_units") if there and h5py.h5a.exists(of.id, k.encode())]
    return {key: _row(of.attrs, key) for key in there}


def _row(attrs: Any, key: str) -> Any:
    told = attrs.get_id(key)
    if told.dtype.kind == "O" and h5py.check_string_dtype(told.dtype) is None:
        return None  # a list of any length: of a damaged one HDF5 ends the process
    shape = told.shape
    return np.ravel(attrs[key]) if shape is not None and 0 < np.prod(shape) <= COLUMNS else None


def _one_number(found: Any) -> float:
    is_one = found is not None and len(found) == 1 and is_numeric(found.dtype)
    return float(found[0]) if is_one and np.isfinite(found[0]) else math.nan


def _unpacking(dataset: Any, said: Mapping[str, Any]) -> Callable[[Any], Any]:
    """Return what unpacks, as netCDF: ``scale_factor * stored + add_offset``, or a gap."""
    scale, offset = (_packing(dataset, said, key) for key in ("scale_factor", "add_offset"))
    fills = [said.get(key) for key in ("_FillValue", "missing_value")]
    missing = [
        float(x)
        for fill in fills
        if fill is not None and is_numeric(fill.dtype)
        for x in fill
        if np.isfinite(x)
    ]
    text = said.get("_Unsigned")
    unsigned = text is not None and str(text[0]).strip("b'").lower() == "true"
    wrap = 2.0 ** (8 * dataset.dtype.itemsize) if unsigned and dataset.dtype.kind == "i" else 0.0
    if (scale, offset, missing, wrap) == (1.0, 0.0, [], 0.0):
        return lambda stored: stored

    def unpacked(stored: Any) -> Any:
        found = np.array(stored, dtype=np.float64)
        gaps = np.isin(found, missing)
        found = scale * np.where(found < 0, found + wrap, found) + offset
        return np.where(gaps, np.nan, found)

    return unpacked


def _packing(dataset: Any, said: Mapping[str, Any], key: str) -> float:
    if key not in said:
        return float(key == "scale_factor")
    number = _one_number(said[key])
    if math.isnan(number) or (number == 0 and key == "scale_factor"):
        raise ReadError(
            f"an attribute {key} of {dataset.name[:80]!r} that is no number to scale by",
            "one number that is not 0" if key == "scale_factor" else "one number",
            "write the samples as they are, or that attribute anew",
        )
    return number


@frozen
class Hdf5Node:
    """A data set, the field of it where it is a table of records, and the groups above it."""

    dataset: h5py.Dataset
    field: str | None
    above: tuple[h5py.Group, ...]

    @property
    def kind(self) -> str | None:
        """Say what it holds in place of real numbers; None where it holds these."""
        dataset, exists = self.dataset, h5py.h5a.exists
        if self.field is not None:
            return _kind(dataset.dtype[self.field])
        if (found := _kind(dataset.dtype)) or exists(dataset.id, b"MATLAB_empty"):
            return found or "nothing"  # an empty array is written as its size
        kind = dataset.attrs["MATLAB_class"] if exists(dataset.id, b"MATLAB_class") else b""
        return "text or cells" if isinstance(kind, bytes) and kind in _TEXTS else None


def _kind(dtype: Any) -> str | None:
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


class _Contents(Mapping[str, tuple[int, ...]]):
    """Shapes of the numeric arrays by path; all are looked at only where names are searched."""

    def __init__(self, data: h5py.File) -> None:
        self._data = data
        self._nodes: dict[str, Hdf5Node | None] = {}
        self._fields: dict[str, tuple[Hdf5Node, frozenset[str]]] = {}  # of tables of records
        self._all: dict[str, tuple[int, ...]] | None = None
        self.others: dict[str, str] = {}  # what else there is, as far as it was looked at

    def node(self, path: str) -> Hdf5Node:
        if path not in self._nodes:
            above, _, name = path.rpartition("/")
            table, fields = self._fields.get(above, (None, ()))
            if table is not None and name in fields:  # what a thousand fields are takes its time
                self._nodes[path] = replace(table, field=name)
            else:
                found = self._nodes[path] = find(self._data, path, self.others)
                if found is not None and found.field is not None:
                    self._fields[above] = found, frozenset(found.dataset.dtype.names)
        node = self._nodes[path]
        if node is None:
            raise KeyError(path)
        return node

    def __getitem__(self, path: str) -> tuple[int, ...]:
        if self._all is not None and path in self._all:
            return self._all[path]
        if path != "/".join(_steps(path)):
            raise KeyError(path)
        found = dict(self._arrays(path, self.node(path)))
        return found[path]

    def __iter__(self) -> Iterator[str]:
        if self._all is None:
            self._all = {
                p: shape for at, node in _walk(self._data) for p, shape in self._arrays(at, node)
            }
        return iter(self._all)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _arrays(self, path: str, node: Hdf5Node) -> Iterator[tuple[str, tuple[int, ...]]]:
        """Yield a data set of numbers, or the fields of one that is a table of records."""
        if (shape := node.dataset.shape) is None:
            return
        if node.field is None and (names := node.dataset.dtype.names):
            for name in names:
                yield from self._arrays(f"{path}/{name}", replace(node, field=name))
        elif (kind := node.kind) is None:
            self._nodes[path] = node
            yield path, tuple(shape)
        else:
            self.others[path] = kind


def find(data: h5py.File, path: str, others: dict[str, str]) -> Hdf5Node | None:
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
        if kind == h5py.h5l.TYPE_EXTERNAL:
            file = _shown(links.get_val(key)[0])
            others[path.strip("/")] = f"a link into another file ({file[:80]}: name it in files)"
        if key is None or kind != h5py.h5l.TYPE_HARD:
            return None
        node = _open(above[-1], key, h5py.h5o.get_info(above[-1].id, key).type)
        if isinstance(node, h5py.Dataset):
            field = steps[0] if len(steps) == 1 else None
            fitting = not steps if field is None else field in (node.dtype.names or ())
            return Hdf5Node(node, field, tuple(above)) if fitting else None
        if not isinstance(node, h5py.Group) or len(above) > DEPTH:
            return None
        above.append(node)
    return None


def _walk(data: h5py.File) -> Iterator[tuple[str, Hdf5Node]]:
    """Yield the data sets of a file with their paths, each object once."""
    seen, count = {h5py.h5o.get_info(data.id).addr}, 0
    waiting: list[tuple[str, tuple[h5py.Group, ...]]] = [("", (data["/"],))]
    while waiting:
        prefix, above = waiting.pop()
        inner: list[tuple[str, tuple[h5py.Group, ...]]] = []
        count += len(group := above[-1])
        if count > NODES or prefix.count("/") > DEPTH:
            many = f"more than {NODES} groups and data sets"
            raise ReadError(
                many if count > NODES else f"more than {DEPTH} groups in one another",
                "fewer to look through for a name",
                "write the whole path of each column, such as run1/x",
            )
        for key in group:
            key, shown = _raw(key), _shown(key)
            path = prefix + shown
            if shown[:1] == "#" or group.id.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                continue  # "#refs#" holds the cells of MATLAB
            info = h5py.h5o.get_info(group.id, key)
            if info.addr in seen or (node := _open(group, key, info.type)) is None:
                continue  # what was seen already, or a type that has a name
            seen.add(info.addr)
            if isinstance(node, h5py.Group):
                inner.append((f"{path}/", (*above, node)))
            else:
                yield path, Hdf5Node(node, None, above)
        waiting += reversed(inner)


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
    with suppress(UnicodeDecodeError):
        return _raw(key).decode("utf-8")
    return _raw(key).decode("latin-1")


def _raw(key: str | bytes) -> bytes:
    """Return a name as h5py takes and gives it: text, where it can be decoded."""
    return key if isinstance(key, bytes) else key.encode("utf-8", "surrogateescape")


def _open(group: h5py.Group, name: bytes, kind: int) -> Any:
    """Open a node; what a data set keeps in files beside it counts from the folder of its file."""
    if kind == h5py.h5o.TYPE_GROUP:
        return h5py.Group(h5py.h5g.open(group.id, name))
    if kind != h5py.h5o.TYPE_DATASET:
        return None
    return h5py.Dataset(h5py.h5d.open(group.id, name, _access()))


@cache
def _access() -> Any:
    access = h5py.h5p.create(h5py.h5p.DATASET_ACCESS)
    access.set_efile_prefix(b"${ORIGIN}")
    return access


_REWRITE = "write the data set whole, or cut it to what was recorded (dataset.resize in h5py)"


def check_stored(dataset: h5py.Dataset, file: str, depth: int = 0) -> int:
    """Refuse a data set that is not there whole; return the bytes of the files that hold it."""
    held, size, made = check_regular(file).st_size, dataset.size, dataset.id.get_create_plist()
    if not size:
        return held
    if (layout := made.get_layout()) == h5py.h5d.VIRTUAL:
        held += _check_virtual(dataset, file, depth)
    elif made.get_external_count():
        held += _check_external(dataset, file, depth)
    elif layout == h5py.h5d.CHUNKED:
        _check_chunks(dataset)
    elif not dataset.id.get_storage_size() and not _tells_gaps(dataset):
        raise _gap(dataset, "no sample written")
    check_held(size * dataset.dtype.itemsize, held, file)
    return held


def _check_chunks(dataset: h5py.Dataset) -> None:
    """Refuse chunks that fill the memory, and those that nobody wrote."""
    size = math.prod(dataset.chunks) * dataset.dtype.itemsize
    if size > CHUNK_BYTES:
        raise ReadError(
            f"chunks of {size // 10**6} MB in {_name(dataset)}",
            f"chunks of {CHUNK_BYTES // 10**6} MB at most, since each is unpacked whole",
            "write smaller chunks: h5repack -l CHUNK=10000",
        )
    pairs = zip(dataset.shape, dataset.chunks, strict=True)
    expected = math.prod(-(-length // chunk) for length, chunk in pairs)
    written = dataset.id.get_num_chunks()
    if written < expected and not _tells_gaps(dataset):
        raise _gap(dataset, f"{expected - written} of {expected} chunks never written")


def _check_external(dataset: h5py.Dataset, file: str, depth: int) -> int:
    """Look at the files that hold the samples; return their bytes."""
    needed, held = dataset.size * dataset.dtype.itemsize, 0
    if depth:
        raise ReadError(
            f"samples of {_name(dataset)} in files of their own",
            "parts that hold their samples",
            "write the parts whole: h5repack -l CONTI",
        )
    for name, offset, size in dataset.external:
        path = check_beside(os.fsdecode(name), file)
        there = max(path.stat().st_size - offset, 0)
        size = min(size, needed)  # the last may be without end
        if there < size:
            raise _gap(dataset, f"{there} of {size} bytes in {path.name}")
        needed, held = needed - size, held + there
    if needed:
        raise _gap(dataset, f"{needed} bytes too few in the files that hold it")
    return held


def _check_virtual(dataset: h5py.Dataset, file: str, depth: int) -> int:
    """Look at the parts of a virtual data set, and that they fill it; return their files' bytes."""
    parts, files = dataset.virtual_sources(), dict[str, int]()
    if len(parts) > PARTS or depth >= REFERENCES:
        found = f"{len(parts)} parts" if len(parts) > PARTS else f"parts of parts, {depth} deep,"
        found += f" of {_name(dataset)}"
        raise ReadError(found, f"{PARTS} at most", "write it whole: h5repack")
    covered = h5py.h5s.create_simple(dataset.shape)
    covered.select_none()
    for target, name, inner, origin in parts:
        if any("%b" in text.replace("%%", "") for text in (name, inner)) or _endless(target):
            raise ReadError(
                f"parts without end in {_name(dataset)}",
                "a virtual data set of parts that are named",
                "write it whole, or name each part",
            )
        name, inner = name.replace("%%", "%"), inner.replace("%%", "%")
        path = file if name == "." else str(check_beside(name, file))
        with naming(path):
            files[path] = _check_part(path, inner, origin, target, dataset, depth)
        _add(covered, target)
    if covered.get_select_npoints() < dataset.size:
        missing = dataset.size - covered.get_select_npoints()
        raise _gap(dataset, f"{missing} samples in none of its parts")
    return sum(files.values())


def _check_part(
    path: str, name: str, origin: Any, target: Any, whole: h5py.Dataset, depth: int
) -> int:
    """Look at one part of a virtual data set; return the bytes of the files that hold it."""
    try:
        opened = h5py.File(path, "r")
    except OSError as error:
        raise damaged(error, "HDF5 data", path) from None
    with opened as data:
        node = find(data, name, {})
        if node is None or node.field is not None or node.kind is not None:
            raise ReadError(
                f"no numbers {name[:80]!r}, a part of {_name(whole)}",
                "a data set there",
                "write that part again",
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
            raise _gap(node.dataset, f"{there} where {whole.name} takes {needed}")
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


def _gap(dataset: h5py.Dataset, found: str) -> ReadError:
    return ReadError(f"{found}: a gap in {_name(dataset)}", "every sample in the file", _REWRITE)
