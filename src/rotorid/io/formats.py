"""Readers of MATLAB, Parquet, TDMS, universal and MDF files, each by a package run in a child."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import count, islice, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError, naming
from rotorid.core.files import open_regular
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.io.clock import even_rate
from rotorid.io.table import (
    COLUMNS,
    RESPONSES,
    ArrayFile,
    Column,
    ColumnPlace,
    Rate,
    Stored,
    check_held,
    is_numeric,
    seconds,
)

_TOGETHER = 100  # columns of Parquet that are read at once: each by itself takes ten times as long


def _loaded(
    file: str, arrays: Mapping[str, Column], others: Mapping[str, str] | None = None
) -> ArrayFile:
    def column(place: ColumnPlace, samples: slice) -> Column:
        found, index = arrays[place.path], place.index
        values = found.values if index is None else found.values.take(index, axis=place.axis)
        return replace(found, values=values.reshape(-1)[samples])

    shapes = {name: np.shape(array.values) for name, array in arrays.items()}
    return ArrayFile(file, shapes, column, others)


@contextmanager
def open_mat(file: str) -> Iterator[ArrayFile]:
    """Open a MAT file of version 4 to 7; fields of structures are named ``structure/field``."""
    from scipy.io import loadmat, whosmat

    with open_regular(file) as opened:
        stream: Any = opened  # scipy's stubs know no streams
        declared = whosmat(stream)
        held = os.path.getsize(file)
        check_held(8 * sum(math.prod(shape) for _, shape, _ in declared), held, file)
        counts = Counter(name for name, _, _ in declared)
        once = [name for name, count in counts.items() if count == 1]
        stream.seek(0)
        found = loadmat(stream, variable_names=once, simplify_cells=True)
    arrays = dict[str, Column]()
    others = {name: "two variables of that name" for name in counts if name not in once}
    for path, value in _flat("", {name: found[name] for name in once if name in found}):
        if kind := _mat_kind(value):
            others[path] = kind
        else:
            arrays[path] = Column(np.asarray(value, dtype=np.float64))
    check_held(sum(column.values.nbytes for column in arrays.values()), held, file)
    yield _loaded(file, arrays, others)


def _flat(prefix: str, fields: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in fields.items():
        if isinstance(value, dict):
            yield from _flat(f"{prefix}{name}/", value)
        else:
            yield prefix + name, value


def _mat_kind(value: Any) -> str:
    """Return what holds no real numbers; empty for what does."""
    from scipy.sparse import issparse

    if issparse(value):
        return "a sparse matrix"
    array = np.asarray(value, dtype=object if isinstance(value, list) else None)
    if array.dtype.kind in "SU":
        return "text"
    if array.dtype.kind == "c":
        return "complex numbers"
    if is_numeric(array.dtype):
        return ""
    inside = [type(each) for each in array.ravel()[:1]]
    return "an array of structures" if dict in inside else "cells"


class _ParquetFile(ArrayFile):
    def __init__(self, file: str, data: Any) -> None:
        import pyarrow.types as kinds

        self._data, self._schema = data, data.schema_arrow
        if len(self._schema.names) > COLUMNS:
            found = f"{len(self._schema.names)} columns"
            raise ReadError(found, f"{COLUMNS} at most", "export a part of them")
        are = "integer", "floating", "boolean", "decimal", "timestamp"
        numeric = [getattr(kinds, f"is_{kind}") for kind in are]
        counts = Counter(self._schema.names)
        numbers = [f for f in self._schema if any(is_kind(f.type) for is_kind in numeric)]
        rows = data.metadata.num_rows
        shapes = {field.name: (rows,) for field in numbers if counts[field.name] == 1}
        super().__init__(file, shapes, in_blocks=True)

    def columns(
        self, places: Mapping[str, ColumnPlace], rows: int | None
    ) -> Iterator[dict[str, Column]]:
        units = {name: _unit_of_field(self._schema.field(p.path)) for name, p in places.items()}
        asked = list(dict.fromkeys(place.path for place in places.values()))
        if rows is None:
            parts = (asked[i : i + _TOGETHER] for i in range(0, len(asked), _TOGETHER))
            found = (self._data.read(columns=some, use_threads=False) for some in parts)
        else:
            found = self._data.iter_batches(max(rows, 1024), columns=asked, use_threads=False)
        for part in found:
            values = {path: _arrow_numbers(part.column(path)) for path in part.schema.names}
            yield {
                n: Column(values[p.path], units[n]) for n, p in places.items() if p.path in values
            }


@contextmanager
def open_parquet(file: str) -> Iterator[ArrayFile]:
    from pyarrow.parquet import ParquetFile

    with ParquetFile(file, memory_map=False) as data:
        yield _ParquetFile(file, data)


def _arrow_numbers(column: Any) -> Floats:
    """Return the numbers of a column, those that are missing as NaN; times in s."""
    import pyarrow as pa

    if pa.types.is_timestamp(column.type):
        return seconds(column.to_numpy(zero_copy_only=False))
    numbers = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return np.asarray(numbers, dtype=np.float64)


def _unit_of_field(field: Any) -> str | None:
    said = [(field.metadata or {}).get(key) for key in (b"units", b"unit")]
    for text in filter(None, said):
        return text.decode("utf-8", "replace").strip() or None
    return "s" if str(field.type).startswith("timestamp") else None


@contextmanager
def open_tdms(file: str) -> Iterator[ArrayFile]:
    """Open a TDMS file; a column is a channel of a group, as LabVIEW has them."""
    from nptdms import TdmsFile

    with open_regular(file) as stream, TdmsFile.open(stream) as data:
        channels = {
            f"{group.name}/{channel.name}": channel
            for group in data.groups()
            for channel in group.channels()
            if channel.dtype is not None and np.dtype(channel.dtype).kind in "biufM"
        }

        def column(place: ColumnPlace, samples: slice) -> Column:
            channel = channels[place.path]
            values = np.asarray(channel[samples])
            numbers = seconds(values) if values.dtype.kind == "M" else values.astype(np.float64)
            return Column(numbers, *_stated(channel))

        shapes = {name: (len(channel),) for name, channel in channels.items()}
        yield ArrayFile(file, shapes, column, in_blocks=True)


def _stated(channel: Any) -> tuple[str | None, Rate | None, float | None]:
    """Return unit, sample rate and time of the first sample in the properties of a channel."""
    said = channel.properties
    unit = str(said.get("unit_string", "")).strip() or None
    if np.dtype(channel.dtype).kind == "M":
        unit = "s"
    step = _finite(said.get("wf_increment"))
    rate = Rate(1 / step) if step is not None and step > 0 and step != 1.0 else None
    begun, offset = said.get("wf_start_time"), said.get("wf_start_offset")
    if begun is None and offset is None:
        return unit, rate, None
    later = _finite(offset) or 0.0
    if isinstance(begun, np.datetime64) and not np.isnat(begun):
        since = begun.astype("datetime64[us]") - np.datetime64("2000-01-01", "us")
        later += float(since.astype(np.int64)) * 1e-6
    return unit, rate, later


def _finite(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


_FUNCTION = 58  # the data set of a function at nodal degrees of freedom
_TIME_RESPONSE, _RESPONSE, _COHERENCE = 1, 4, 6
_TIME_AXIS, _EVEN = 17, 1
_DIGITS = 5e-6  # the abscissa's step is written with six digits
_QUANTITIES = {8: "", 11: "'", 12: "''"}  # displacement, velocity, acceleration
_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")


@contextmanager
def open_universal(file: str) -> Iterator[ArrayFile]:
    """Open a universal file; a column has the name of its set, or node and direction, ``12+X``."""
    found, types = _read_sets(file)
    over_time = ("abscissa_spec_data_type", _TIME_AXIS), ("func_type", _TIME_RESPONSE)
    sets = [one for one in found if any(one.get(key) == kind for key, kind in over_time)]
    sets = [one for one in sets if not np.iscomplexobj(one["data"])]
    if not sets:
        raise ReadError(
            f"data sets {sorted(set(types))}, none of a signal over time" if types else "no sets",
            "data sets 58 of time responses",
            "export the time histories",
        )
    yield _loaded(file, {name: _universal(s) for name, s in zip(_names(sets), sets, strict=True)})


def _read_sets(file: str) -> tuple[list[Any], list[int]]:
    from pyuff import UFF

    with np.errstate(all="ignore"):
        data = UFF(file)
        types = [int(kind) for kind in np.atleast_1d(data.get_set_types())]
        return [data.read_sets(i) for i, kind in enumerate(types) if kind == _FUNCTION], types


def _names(sets: list[Mapping[str, Any]]) -> list[str]:
    first = [_text(s.get("id1")) for s in sets]
    if all(first) and len(set(first)) == len(first):
        return first
    nodes = [_end(s, "rsp", _AXES[:3]) for s in sets]
    counts = Counter(nodes)
    return [name if counts[name] == 1 else f"{name}#{number}" for number, name in enumerate(nodes)]


def _end(found: Mapping[str, Any], end: str, axes: Sequence[str] = _AXES) -> str:
    """Return node and direction of the response or the reference, such as ``12+X``."""
    axis = int(found.get(f"{end}_dir") or 0)
    along = "+-"[axis < 0] + axes[abs(axis) - 1] if 0 < abs(axis) <= len(axes) else ""
    return f"{int(found.get(f'{end}_node') or 0)}{along}"


def _text(value: Any) -> str:
    text = str(value or "").strip()
    return "" if text == "NONE" else text


def _universal(found: Mapping[str, Any]) -> Column:
    values = np.asarray(found["data"], dtype=np.float64)
    if len(values) != int(found.get("num_pts", len(values))):
        raise ValueError(f"{len(values)} values where {found['num_pts']} are announced")
    step = float(found.get("abscissa_inc") or 0.0)
    even = found.get("abscissa_spacing") == _EVEN and np.isfinite(step) and step > 0
    unit = _text(found.get("ordinate_axis_units_lab")) or None
    start = float(found.get("abscissa_min") or 0.0)
    return Column(values, unit, *((Rate(1 / step, _DIGITS), start) if even else ()))


@frozen
class StoredResponse:
    name: str  # ``12+X/3+Z``: node and direction of the response, then of the reference
    frequency: Floats  # (line,): hz
    values: Complexes  # (line,): as stored
    unit: str | None  # of the response over that of the reference, where the file states both
    # ``''`` of an acceleration, ``'`` of a velocity; None where the file does not say
    derivative: str | None
    coherence: Floats | None  # (line,), or None


def read_responses(path: Path) -> dict[str, StoredResponse]:
    return dict(Stored(path, RESPONSES).ask("copy"))  # of what is opened


@contextmanager
def open_responses(file: str) -> Iterator[dict[str, StoredResponse]]:
    sets, types = _read_sets(file)
    named = [(f"{_end(s, 'rsp')}/{_end(s, 'ref')}", s) for s in sets]
    coherence = {name: s for name, s in named if s.get("func_type") == _COHERENCE}
    responses = [(name, s) for name, s in named if s.get("func_type") == _RESPONSE]
    found = {name: _response(name, one, coherence.get(name)) for name, one in responses}
    if not found:
        kinds = sorted({int(s.get("func_type", 0)) for s in sets})
        raise ReadError(
            f"functions of type {kinds}, none a frequency response" if kinds else f"sets {types}",
            "data sets 58 of frequency responses (function type 4)",
            "export the frequency responses",
        )
    if len(found) < len(responses):
        twice, _ = Counter(name for name, _ in responses).most_common(1)[0]
        cure = "export them into files of their own"
        raise ReadError(f"two responses {twice}", "one of each pair of nodes and directions", cure)
    yield found


def _response(
    name: str, one: Mapping[str, Any], beside: Mapping[str, Any] | None
) -> StoredResponse:
    frequency = np.asarray(one["x"], dtype=np.float64)
    values = np.asarray(one["data"], dtype=np.complex128)
    if values.shape != frequency.shape or frequency.ndim != 1 or not len(values):
        raise ValueError(f"{values.shape} values at {frequency.shape} frequencies")
    coherence = None
    if beside is not None and np.array_equal(beside["x"], one["x"]):
        coherence = np.asarray(np.real(beside["data"]), dtype=np.float64)
    over, under = (_text(one.get(f"{axis}_axis_units_lab")) for axis in ("ordinate", "orddenom"))
    unit = f"({over})/({under})" if over and under else None
    derivative = _QUANTITIES.get(int(one.get("ordinate_spec_data_type") or 0))
    return StoredResponse(name, frequency, values, unit, derivative, coherence)


# Of an MDF file only numbers are taken. A conversion may also be a formula, which asammdf hands to
# `eval`: reading a channel could run any program. Formulas are refused, wherever they stand.
_REMOTE_MASTER = 1 << 3  # flag of a group of MDF 4: its times are those of another group


@contextmanager
def open_mdf(file: str) -> Iterator[ArrayFile]:
    """Open an MDF file; a channel is named by its name, or by its group and name: ``1/x``."""
    asammdf: Any = import_module("asammdf")  # its own types do not know all of its options
    # messages of a bus would be converted as the file is opened
    with asammdf.MDF(file, process_bus_logging=False) as data:
        channels = _Channels(data)
        yield ArrayFile(file, channels.shapes, channels.column)


class _Channels:
    """The channels of an open file, converted here: asammdf evaluates what the file says.

    It is left no conversion that it could evaluate, by whatever way it reads a channel.
    """

    def __init__(self, data: Any) -> None:
        self._data, self._version = data, 4 if data.version >= "4" else 3
        self._conversions: dict[tuple[int, int], Any] = {}
        self._clocks: dict[int, tuple[Rate | None, float | None]] = {}
        self._pieces: dict[int, Any] = {}
        self._places: dict[str, tuple[int, int]] = {}
        self.shapes: dict[str, tuple[int, ...]] = {}
        for number, group in enumerate(data.groups):
            samples = int(group.channel_group.cycles_nr)
            for index, channel in enumerate(group.channels):
                name = f"{number}/{channel.name}"
                self._places[name], self.shapes[name] = (number, index), (samples,)
                self._conversions[number, index] = channel.conversion
                channel.conversion = None

    def column(self, place: ColumnPlace, samples: slice) -> Column:
        group, index = self._places[place.path]
        conversion = self._conversions[group, index]
        channel = self._data.groups[group].channels[index]
        unit = getattr(conversion, "unit", "") or getattr(channel, "unit", "") or ""
        values = self._values(group, index)[samples]
        return Column(values, unit.strip() or None, *self._clock(group))

    def _clock(self, group: int) -> tuple[Rate | None, float | None]:
        """Return the rate and the start of a group, from its master channel or that of another."""
        if group not in self._clocks:
            heading = self._data.groups[group].channel_group
            if getattr(heading, "flags", 0) & _REMOTE_MASTER and self._version == 4:
                return self._clock(heading.cg_master_index)
            index, times = self._data.masters_db.get(group), np.zeros(0)
            master = None if index is None else self._data.groups[group].channels[index]
            if self._version == 3 and master is not None and not master.bit_count:
                times = np.arange(heading.cycles_nr) * float(master.sampling_rate or 1)  # by a step
            elif index is not None:
                times = self._values(group, index)
            start = next(filter(np.isfinite, times[:1].tolist()), None)
            self._clocks[group] = even_rate(times), start
        return self._clocks[group]

    def _unpacked(self, group: int) -> Any:
        """Return the bytes of a group for all of its channels, maybe thousands; None if many."""
        if self._version == 4 and group not in self._pieces:
            pieces = list(islice(self._data._mdf._load_data(self._data.groups[group]), 2))
            self._pieces = {group: pieces[0] if len(pieces) == 1 else None}
        return self._pieces.get(group)

    def _values(self, group: int, index: int) -> Floats:
        """Return the samples of a channel in its unit, invalid ones as NaN."""
        with naming(place=f"{group}/{self._data.groups[group].channels[index].name}"):
            samples, invalid = self._data.get(
                group=group,
                index=index,
                data=self._unpacked(group),
                raw=True,
                samples_only=True,  # with raw alone the times are still converted
                ignore_invalidation_bits=True,  # else invalid samples are left out unsaid
            )
            if not is_numeric(samples.dtype) or samples.ndim != 1:
                raise no_numbers("text, or several values a sample")
            values = convert(samples, self._conversions[group, index], self._version)
        if invalid is not None:
            values[np.asarray(invalid, dtype=bool)] = np.nan
        return values


def convert(samples: np.ndarray, block: Any, version: int) -> Floats:
    """Return samples in the unit of their channel; types of MDF 3 (and 2) mean others than of 4."""
    if samples.dtype.kind == "f":  # float32 would stay so, and lose digits
        samples = samples.astype(np.float64)
    if block is None:
        return samples.astype(np.float64)
    _check_no_formula(block, _FORMULA[version])
    rule = _RULES[version].get(block.conversion_type)
    if rule is None:
        raise no_numbers("a conversion to text, or of an unknown kind")
    with np.errstate(all="ignore"):  # what cannot be computed is NaN, as a missing sample is
        converted: Floats = rule(samples, block).astype(np.float64)
    converted[np.isnan(samples)] = np.nan  # a table gives every sample a value
    return converted


def no_numbers(found: str) -> ReadError:
    return ReadError(found, "real numbers", "name a channel of numbers, or export it so")


def _check_no_formula(block: Any, kind: int) -> None:
    """Refuse a conversion that is a formula or refers to one, used by a sample or not."""
    formulas = [block.formula] if block.conversion_type == kind else []
    for part in (block.referenced_blocks or {}).values():
        if _is_block(part):
            _check_no_formula(part, kind)
        elif part and b"{X}" in part:  # MDF 3 writes the default of a table as "2*{X}+1"
            formulas.append(part.decode("latin-1").strip("\0"))
    if formulas:
        raise ReadError(
            f"a conversion by the formula {formulas[0][:80]!r}",
            "none, or a linear, rational or table conversion: a formula could run any program",
            "export the channel in physical values",
        )


def _is_block(part: Any) -> bool:
    return hasattr(part, "conversion_type")


def _linear(x: np.ndarray, block: Any) -> Any:
    return block.a * x + block.b


def _rational(x: np.ndarray, block: Any) -> Any:
    """(P1 x^2 + P2 x + P3) / (P4 x^2 + P5 x + P6)."""
    above = [block.P1, block.P2, block.P3]
    below = [block.P4, block.P5, block.P6]
    if above[2] == below[2] == 0:  # x in both, which at x = 0 would leave 0/0
        above, below = above[:2], below[:2]
    return np.polyval(above, x) / np.polyval(below, x)


def _hyperbolic(x: np.ndarray, block: Any) -> Any:
    """(P2 - P4 y) / (P3 y - P1) with y = x - P5 - P6: "polynomial" in MDF 3."""
    y = x - block.P5 - block.P6
    return (block.P2 - block.P4 * y) / (block.P3 * y - block.P1)


def _of_seven(function: np.ufunc, x: np.ndarray, block: Any) -> Any:
    """f(((x - P7) P6 - P3) / P1) / P2 where P4 = 0, and f((P3 / (x - P7) - P6) / P4) / P5."""
    if block.P4 == 0:
        return function(((x - block.P7) * block.P6 - block.P3) / block.P1) / block.P2
    if block.P1 == 0:
        return function((block.P3 / (x - block.P7) - block.P6) / block.P4) / block.P5
    raise ValueError("a conversion of both P1 and P4")


def _interpolated(x: np.ndarray, block: Any) -> Any:
    return np.interp(x, _values(block, "raw"), _values(block, "phys"))


def _nearest(x: np.ndarray, block: Any) -> Any:
    """Value to value without interpolation: the nearest entry, the lower one half way."""
    raw, physical = _values(block, "raw"), _values(block, "phys")
    above = np.searchsorted(raw, x).clip(max=len(raw) - 1)
    below = (above - 1).clip(min=0)
    return np.where(x - raw[below] <= raw[above] - x, physical[below], physical[above])


def _ranges(x: np.ndarray, block: Any) -> Any:
    entry = _entry(x, block, "lower", "upper")
    return np.where(entry < 0, block.default, _values(block, "phys")[entry])


def _referenced(first: str, last: str, x: np.ndarray, block: Any) -> Floats:
    """Convert samples by the conversion that their entry refers to; text ("no signal") is NaN."""
    entry, parts = _entry(x, block, first, last), block.referenced_blocks or {}
    if not any(map(_is_block, parts.values())):
        raise no_numbers("a conversion to text")
    found = np.full(len(x), np.nan)
    for number in np.unique(entry):
        part = parts["default_addr" if number < 0 else f"text_{number}"]
        if _is_block(part):
            found[entry == number] = convert(x[entry == number], part, 4)
    return found


def _entry(x: np.ndarray, block: Any, first: str, last: str) -> np.ndarray:
    """Return the range of each sample, or -1; its end is in it for integers only (ASAM MDF 4)."""
    lower, upper = _values(block, first), _values(block, last)
    order = np.argsort(lower)
    place = order[np.searchsorted(lower[order], x, side="right") - 1]
    ends = x <= upper[place] if x.dtype.kind != "f" or first == last else x < upper[place]
    return np.where((x >= lower[place]) & ends, place, -1)


def _values(block: Any, name: str) -> Floats:
    """Return name_0, name_1 and so on."""
    keys = takewhile(lambda key: hasattr(block, key), (f"{name}_{i}" for i in count()))
    return np.array([getattr(block, key) for key in keys], dtype=np.float64)


# Type numbers as ASAM gives them. MDF 4 knows text to value, text to text and bit fields besides,
# MDF 3 values and ranges to text, dates and times: none of them gives numbers from numbers.
_RULES: Mapping[int, Mapping[int, Callable[[np.ndarray, Any], Any]]] = {
    3: {
        0: _linear,
        1: _interpolated,
        2: _nearest,
        6: _hyperbolic,
        7: partial(_of_seven, np.exp),
        8: partial(_of_seven, np.log),
        9: _rational,
        65535: lambda x, _: x,
    },
    4: {
        0: lambda x, _: x,
        1: _linear,
        2: _rational,
        4: _interpolated,
        5: _nearest,
        6: _ranges,
        7: partial(_referenced, "val", "val"),
        8: partial(_referenced, "lower", "upper"),
    },
}
_FORMULA = {3: 10, 4: 3}
