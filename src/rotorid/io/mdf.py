"""Reader of MDF files (.mf4, .mdf, .dat of ASAM): a column is a channel.

Only numbers are taken from the file. A conversion may also be a formula, which asammdf hands to
`eval`: reading a channel could run any program. Formulas are refused, wherever they stand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from itertools import count, islice, takewhile
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.values import Floats
from rotorid.io.clock import even_rate
from rotorid.io.table import ArrayFile, Column, check_size, is_numeric

_REMOTE_MASTER = 1 << 3  # flag of a group of MDF 4: its times are those of another group


@contextmanager
def open_mdf(file: str) -> Iterator[ArrayFile]:
    """Open an MDF file; a channel is named by its name, or by its group and name: ``1/x``."""
    asammdf: Any = import_module("asammdf")  # its own types do not know all of its options
    # messages of a bus would be converted as the file is opened
    with asammdf.MDF(file, process_bus_logging=False) as data:
        channels = _Channels(data, file)
        yield ArrayFile(file, channels.shapes, channels.column)


class _Channels:
    """The channels of an open file, converted here: asammdf evaluates what the file says.

    It is left no conversion that it could evaluate, by whatever way it reads a channel.
    """

    def __init__(self, data: Any, file: str) -> None:
        self._data, self._file = data, file
        self._version = 4 if data.version >= "4" else 3
        self._conversions: dict[tuple[int, int], Any] = {}
        self._times: dict[int, Floats | None] = {}
        self._pieces: dict[int, Any] = {}
        self._places: dict[str, tuple[int, int]] = {}
        self.shapes: dict[str, tuple[int, ...]] = {}
        for number, group in enumerate(data.groups):
            samples = int(group.channel_group.cycles_nr)
            check_size(samples, file)
            # asammdf makes room for a record before it reads one
            check_size(int(group.channel_group.samples_byte_nr), file, itemsize=1)
            for index, channel in enumerate(group.channels):
                name = f"{number}/{channel.name}"
                self._places[name], self.shapes[name] = (number, index), (samples,)
                self._conversions[number, index] = channel.conversion
                channel.conversion = None

    def column(self, path: str) -> Column:
        """Return a channel, with the rate and the start that the times of its group tell."""
        group, index = self._places[path]
        conversion = self._conversions[group, index]
        channel = self._data.groups[group].channels[index]
        unit = getattr(conversion, "unit", "") or getattr(channel, "unit", "") or ""
        values, times = self._values(group, index), self._times_of(group)
        if times is None:
            return Column(values, unit.strip() or None)
        start = float(times[0]) if len(times) and np.isfinite(times[0]) else None
        return Column(values, unit.strip() or None, even_rate(times), start)

    def _times_of(self, group: int) -> Floats | None:
        """Return the sample times of a group, from its master channel, or that of another."""
        if group not in self._times:
            heading = self._data.groups[group].channel_group
            if getattr(heading, "flags", 0) & _REMOTE_MASTER and self._version == 4:
                return self._times_of(heading.cg_master_index)
            index = self._data.masters_db.get(group)
            self._times[group] = None if index is None else self._master(group, index)
        return self._times[group]

    def _master(self, group: int, index: int) -> Floats:
        """Return the samples of a master channel, which MDF 3 may leave to a step of time."""
        found = self._data.groups[group]
        channel = found.channels[index]
        if self._version == 3 and not channel.bit_count:
            return np.arange(found.channel_group.cycles_nr) * float(channel.sampling_rate or 1)
        return self._values(group, index)

    def _unpacked(self, group: int) -> Any:
        """Return the bytes of a group, once for all of its channels; None where they are many.

        asammdf would unpack a group again for each channel, of which it may have thousands.
        """
        if self._version == 4 and group not in self._pieces:
            pieces = list(islice(self._data._mdf._load_data(self._data.groups[group]), 2))
            self._pieces = {group: pieces[0] if len(pieces) == 1 else None}
        return self._pieces.get(group)

    def _values(self, group: int, index: int) -> Floats:
        """Return the samples of a channel in its unit, invalid ones as NaN."""
        channel = self._data.groups[group].channels[index]
        try:
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
        except ReadError as error:
            raise error.at(file=self._file, place=f"{group}/{channel.name}") from None
        if invalid is not None:
            values[np.asarray(invalid, dtype=bool)] = np.nan
        return values


def convert(samples: np.ndarray, block: Any, version: int) -> Floats:
    """Return samples in the unit of their channel, by asammdf's ChannelConversion.

    The same type number means another conversion in version 3 (and 2) of a file than in 4.
    """
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
    """Return the error for a channel that holds something else than numbers."""
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


def _none(x: np.ndarray, block: Any) -> Any:
    return x


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
    """Range to value, else the default."""
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
    """Return which range each sample is in, or -1.

    The end of a range belongs to it for integers, and to the next one for floats (ASAM MDF 4).
    """
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
        65535: _none,
    },
    4: {
        0: _none,
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
