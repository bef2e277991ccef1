"""Reader of HDF5 files: links are followed inside the file only.

What nobody wrote reads as its fill value, 0: all of a data set, a part, or a file that holds one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cached_property
from posixpath import dirname
from typing import Any, NamedTuple

import h5py
import numpy as np

from rotorid.core.errors import InputError, ReadError, naming
from rotorid.core.files import check_beside, check_regular
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
REFERENCES = 4
"""Files that refer to files: a virtual data set of virtual data sets is two."""

_RATES = {
    **dict.fromkeys(
        ("sample_rate", "sampling_rate", "sampling_frequency", "samplerate", "fs"), "Hz"
    ),
    **dict.fromkeys(("sample_interval", "wf_increment", "dt"), "s"),
}
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
    shapes: _Contents

    def __init__(self, file: str, data: h5py.File) -> None:
        contents = _Contents(data)
        super().__init__(file, contents, others=contents.others, in_blocks=True)
        self._data = data
        self._stored: dict[h5py.Dataset, int] = {}
        self._rates: dict[str | bytes, Rate | None] = {}  # by the name of a group

    def bytes_held(self, places: Mapping[str, ColumnPlace]) -> int:
        """Return the bytes of the files that hold data sets; refuse one not there whole."""
        datasets = {self.shapes.node(place.path).dataset for place in places.values()}
        for dataset in datasets - self._stored.keys():
            self._stored[dataset] = check_stored(dataset, self.file)
        return max((self._stored[dataset] for dataset in datasets), default=0)

    def columns(
        self, places: Mapping[str, ColumnPlace], rows: int | None
    ) -> Iterator[dict[str, Column]]:
        asked: dict[tuple[h5py.Dataset, int], dict[str, _Part]] = {}
        column: dict[str, Callable[[Any], Column]] = {}
        for name, place in places.items():
            node = self.shapes.node(place.path)
            parts = asked.setdefault((node.dataset, place.axis), {})
            parts[name] = node.field, place.index
            column[name] = self._column_of(node.dataset, place.index)
        count = max(max(dataset.shape, default=1) for dataset, _ in asked)
        step = rows or max(count, 1)
        chunk = max((max(dataset.chunks) for dataset, _ in asked if dataset.chunks), default=1)
        if rows and rows >= chunk // 64:  # whole chunks of the file, near what is asked for
            step = chunk * max(1, round(rows / chunk))
        for begin in range(0, max(count, 1), step):
            found = (
                (name, column[name](stored))
                for (dataset, axis), parts in asked.items()
                for name, stored in _rows(dataset, axis, parts, slice(begin, begin + step))
            )
            if rows is None:  # one after the other: each takes its room here
                yield from ({name: values} for name, values in found)
            else:
                yield dict(found)

    def _column_of(self, dataset: h5py.Dataset, index: int | None) -> Callable[[Any], Column]:
        """Return what makes a column of stored numbers."""
        rate = _rate(dataset) or self._rate_of_group(dirname(dataset.name))
        unit, unpacked = _unit(dataset, index), _unpacking(dataset)

        def column(stored: Any) -> Column:
            values = np.asarray(unpacked(stored), dtype=np.float64)
            return Column(np.ascontiguousarray(values.ravel()), unit, rate)

        return column

    def _rate_of_group(self, name: str | bytes) -> Rate | None:
        """Return the sample rate that a group states, or the nearest one above it."""
        if name not in self._rates:
            above = dirname(name)
            stated = _rate(self._data[name])
            self._rates[name] = stated or (self._rate_of_group(above) if above != name else None)
        return self._rates[name]


_Part = tuple[str | None, int | None]
"""Of each sample of a data set: the field where it is a record, the index where it is a row."""


def _rows(
    dataset: h5py.Dataset, axis: int, parts: Mapping[str, _Part], samples: slice
) -> Iterator[tuple[str, Any]]:
    """Yield some rows of columns of one data set, read at once.

    For one field the library goes through all of every record, for one column through all chunks.
    """
    fields = list(dict.fromkeys(field for field, _ in parts.values() if field is not None))
    indices = {index for _, index in parts.values()}
    several = len(indices) > 1
    across = slice(None) if several or None in indices else next(iter(indices))
    along = (samples, across) if axis else (across, samples)
    numbers = dataset.fields(fields) if fields else dataset
    stored = numbers[along if dataset.ndim == 2 else (samples,)[: dataset.ndim]]
    for name, (field, index) in parts.items():
        values = stored if field is None else stored[field]
        yield name, values if index is None or not several else values.take(index, axis=axis)


def _attribute(of: h5py.Dataset | h5py.Group, key: str) -> Any:
    """Return an attribute as a row of values; None where there is none that can be taken."""
    if key not in of.attrs:
        return None
    told = of.attrs.get_id(key)
    if told.dtype.kind == "O" and h5py.check_string_dtype(told.dtype) is None:
        return None  # a list of any length: of a damaged one HDF5 ends the process
    few = told.shape is not None and 0 < math.prod(told.shape) <= COLUMNS
    return np.ravel(of.attrs[key]) if few else None


def _unit(dataset: h5py.Dataset, index: int | None) -> str | None:
    """Return the attribute ``units``, or else ``unit``: one text, or one per column."""
    told = (_attribute(dataset, key) for key in ("units", "unit"))
    units = (_text(texts[min(index or 0, len(texts) - 1)]) for texts in told if texts is not None)
    return next(filter(None, units), None)


def _text(value: Any) -> str:
    return (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)).strip()


def _rate(of: h5py.Dataset | h5py.Group) -> Rate | None:
    """Return the sample rate in Hz of an attribute of that name, or of the interval in s."""
    for key, unit in _RATES.items():
        with suppress(InputError):  # a unit that says nothing
            size = _size(of, key, unit)
            if size > 0:
                return Rate(size if unit == "Hz" else 1 / size)
    return None


def _size(of: h5py.Dataset | h5py.Group, key: str, unit: str) -> float:
    """Return an attribute in a unit: a text, ``10 kHz``, or a number, by the unit beside it."""
    told = _attribute(of, key)
    if told is not None and len(told) == 1 and isinstance(told[0], str | bytes):
        text = _text(told[0])
        return to_si(text if text[-1:].isalpha() else f"{text} {unit}", unit)
    number = _one_number(told)
    for beside in (f"{key}_units", f"{key}_unit", "time_units"):
        texts = None if beside == "time_units" and unit != "s" else _attribute(of, beside)
        if texts is not None:
            return number * si_factor(_text(texts[0]), unit)
    return number


def _one_number(found: Any) -> float:
    is_one = found is not None and len(found) == 1 and is_numeric(found.dtype)
    return float(found[0]) if is_one and np.isfinite(found[0]) else math.nan


def _unpacking(dataset: h5py.Dataset) -> Callable[[Any], Any]:
    """Return what unpacks, as netCDF: ``scale_factor * stored + add_offset``, or a gap."""
    scale, offset = (_packing(dataset, key) for key in ("scale_factor", "add_offset"))
    fills = [_attribute(dataset, key) for key in ("_FillValue", "missing_value")]
    numbers = [fill for fill in fills if fill is not None and is_numeric(fill.dtype)]
    missing = [float(x) for fill in numbers for x in fill if np.isfinite(x)]
    text = _attribute(dataset, "_Unsigned")
    unsigned = text is not None and _text(text[0]).lower() == "true"
    wrap = 2.0 ** (8 * dataset.dtype.itemsize) if unsigned and dataset.dtype.kind == "i" else 0.0
    if (scale, offset, missing, wrap) == (1.0, 0.0, [], 0.0):
        return lambda stored: stored

    def unpacked(stored: Any) -> Any:
        found = np.array(stored, dtype=np.float64)
        gaps = np.isin(found, missing)
        found = scale * np.where(found < 0, found + wrap, found) + offset
        return np.where(gaps, np.nan, found)

    return unpacked


def _packing(dataset: h5py.Dataset, key: str) -> float:
    if key not in dataset.attrs:
        return float(key == "scale_factor")
    number = _one_number(_attribute(dataset, key))
    if math.isnan(number) or (number == 0 and key == "scale_factor"):
        raise ReadError(
            f"an attribute {key} of {dataset.name[:80]!r} that is no number to scale by",
            "one number that is not 0" if key == "scale_factor" else "one number",
            "write the samples as they are, or that attribute anew",
        )
    return number


class Node(NamedTuple):
    dataset: h5py.Dataset
    field: str | None  # of it where it is a table of records

    @property
    def kind(self) -> str | None:
        """Say what it holds in place of real numbers; None where it holds these."""
        dataset = self.dataset
        if self.field is not None:
            return _kind(dataset.dtype[self.field])
        if (found := _kind(dataset.dtype)) or "MATLAB_empty" in dataset.attrs:
            return found or "nothing"  # an empty array is written as its size
        kind = dataset.attrs.get("MATLAB_class", b"")
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
        self._nodes: dict[str, Node] = {}  # those that were looked at
        self.others: dict[str, str] = {}  # what else there is, as far as it was looked at

    def node(self, path: str) -> Node:
        steps = _steps(path)
        if path not in self._nodes and path == "/".join(steps):
            dataset, left = find(self._data, path, self.others)
            if dataset is not None:
                self._enter("/".join(steps[: len(steps) - len(left)]), dataset)
        return self._nodes[path]

    def __getitem__(self, path: str) -> tuple[int, ...]:
        return tuple(self.node(path).dataset.shape)

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    @cached_property
    def _paths(self) -> list[str]:
        return [path for at, found in _walk(self._data) for path in self._enter(at, found)]

    def _enter(self, path: str, dataset: h5py.Dataset) -> list[str]:
        """Enter a data set, or the fields of a table of records; return the paths of numbers."""
        if dataset.shape is None:
            return []
        names = dataset.dtype.names
        nodes = {f"{path}/{name}": Node(dataset, name) for name in names or ()}
        nodes = nodes if names else {path: Node(dataset, None)}
        kinds = {at: node.kind for at, node in nodes.items()}
        self.others |= {at: kind for at, kind in kinds.items() if kind is not None}
        self._nodes |= {at: node for at, node in nodes.items() if kinds[at] is None}
        return [at for at, kind in kinds.items() if kind is None]


def find(
    data: h5py.File, path: str, others: dict[str, str]
) -> tuple[h5py.Dataset | None, list[str]]:
    """Return the data set on a path, and what of the path is left: a field, where it is a table.

    Links are followed inside the file; those into other files are noted in `others`.
    """
    steps, node, hops = _steps(path), data, 0
    while steps and isinstance(node, h5py.Group):
        name, *steps = steps
        if (key := _key(node, name)) is None:
            break
        links = node.id.links
        kind = links.get_info(key).type
        if kind == h5py.h5l.TYPE_HARD:
            node = node[key]
        elif kind == h5py.h5l.TYPE_SOFT and hops < _HOPS:
            hops, target = hops + 1, links.get_val(key)
            node = data if target.startswith(b"/") else node
            steps = [*_steps(_shown(target)), *steps]
        else:
            if kind == h5py.h5l.TYPE_EXTERNAL:
                file = _shown(links.get_val(key)[0])
                link = f"a link into another file ({file[:80]}: name it in files)"
                others[path.strip("/")] = link
            break
    return (node, steps) if isinstance(node, h5py.Dataset) else (None, [])


def _walk(data: h5py.File) -> Iterator[tuple[str, h5py.Dataset]]:
    """Yield the data sets of a file with their paths, each object once."""
    seen, count = {h5py.h5o.get_info(data.id).addr}, 0
    waiting: list[tuple[str, h5py.Group]] = [("", data)]
    while waiting:
        prefix, group = waiting.pop()
        inner: list[tuple[str, h5py.Group]] = []
        count += len(group)
        if count > NODES or prefix.count("/") > DEPTH:
            many = f"more than {NODES} groups and data sets"
            raise ReadError(
                many if count > NODES else f"more than {DEPTH} groups in one another",
                "fewer to look through for a name",
                "write the whole path of each column, such as run1/x",
            )
        for key in group.id:
            if key[:1] == b"#" or group.id.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                continue  # "#refs#" holds the cells of MATLAB
            address = h5py.h5o.get_info(group.id, key).addr
            if address in seen:
                continue
            seen.add(address)
            path, node = prefix + _shown(key), group[key]
            if isinstance(node, h5py.Group):
                inner.append((f"{path}/", node))
            elif isinstance(node, h5py.Dataset):  # and not a type that has a name
                yield path, node
        waiting += reversed(inner)


def _steps(path: str) -> list[str]:
    return [step for step in path.split("/") if step not in ("", ".")]


def _key(group: h5py.Group, name: str) -> bytes | None:
    """Return a name as the file has it: in UTF-8, or as older programs of Windows wrote it."""
    for encoding in ("utf-8", "latin-1") if "\0" not in name else ():
        with suppress(UnicodeEncodeError):
            if group.id.links.exists(key := name.encode(encoding)):
                return key
    return None


def _shown(key: bytes) -> str:
    with suppress(UnicodeDecodeError):
        return key.decode("utf-8")
    return key.decode("latin-1")


_REWRITE = "write the data set whole, or cut it to what was recorded (dataset.resize in h5py)"


def check_stored(dataset: h5py.Dataset, file: str, depth: int = 0) -> int:
    """Refuse a data set that is not there whole; return the bytes of the files that hold it."""
    held, size, made = check_regular(file).st_size, dataset.size, dataset.id.get_create_plist()
    if not size:
        return held
    if (layout := made.get_layout()) == h5py.h5d.VIRTUAL:
        held += _check_virtual(dataset, file, depth)
    elif made.get_external_count():
        expected = "samples in the file itself"
        cure = "write the data set whole: h5repack -l CONTI"
        raise ReadError(f"samples of {_name(dataset)} in files of their own", expected, cure)
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


def _check_virtual(dataset: h5py.Dataset, file: str, depth: int) -> int:
    """Look at the parts of a virtual data set, and that they fill it; return their files' bytes."""
    parts, files = dataset.virtual_sources(), dict[str, int]()
    if depth >= REFERENCES:
        found = f"parts of parts, {depth} deep, of {_name(dataset)}"
        raise ReadError(found, "parts that hold their samples", "write it whole: h5repack")
    covered = h5py.h5s.create_simple(dataset.shape)
    covered.select_none()
    for target, name, inner, origin in parts:
        if _endless(target):  # as all are whose name has a number in it
            expected = "a virtual data set of parts that are named"
            cure = "write it whole, or name each part"
            raise ReadError(f"parts without end in {_name(dataset)}", expected, cure)
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
        dataset, left = find(data, name, {})
        if dataset is None or left or Node(dataset, None).kind is not None:
            found = f"no numbers {name[:80]!r}, a part of {_name(whole)}"
            raise ReadError(found, "a data set there", "write that part again")
        if origin.get_select_type() == h5py.h5s.SEL_ALL:  # as many as there are
            there: tuple[int, ...] = (dataset.size,)
            needed: tuple[int, ...] = (target.get_select_npoints(),)
            fits = there == needed
        else:
            there = dataset.shape
            needed = tuple(int(last) + 1 for last in origin.get_select_bounds()[1])
            fits = len(there) == len(needed) and all(np.greater_equal(there, needed))
        if not fits:
            raise _gap(dataset, f"{there} where {whole.name} takes {needed}")
        return check_stored(dataset, path, depth + 1)


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
