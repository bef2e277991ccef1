"""Reader of MDF files (.mf4, .mdf, .dat of ASAM): a column is a channel."""

from __future__ import annotations

import gc
import mmap
import struct
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.files import open_regular
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.io.child import in_child
from rotorid.io.clock import even_rate
from rotorid.io.mdf_conversion import convert, no_numbers
from rotorid.io.table import (
    Column,
    NamedArrays,
    check_size,
    content,
    head,
    is_numeric,
    missing_package,
    not_what_it_says,
    reading,
    silent,
)

# A packed block: its name, its size, no links, what it was, two bytes and a number of how it was
# packed, its size before and after.
_PACKED, _PACKED_HEAD = b"##DZ", struct.Struct("<4s4xQQ2s6xQQ")
_PACKED_KINDS = (b"DT", b"SD", b"RD", b"DV", b"DI", b"RV", b"RI", b"dt", b"sd", b"rd")
_REMOTE_MASTER = 1 << 3  # flag of a group of MDF 4: its times are those of another group


@frozen
class MdfTable(NamedArrays):
    """An MDF file; its numbers are read when they are asked for."""

    channels: Mapping[str, tuple[int, int]]

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        names = list(names)
        self.check_held(names)
        with TemporaryDirectory() as folder:  # asammdf leaves copies there
            found: dict[str, Column] = in_child(self._columns, self.file, names, folder)
        return found

    def _columns(self, names: Sequence[str], folder: str) -> dict[str, Column]:
        """Return columns; asammdf's own decoder ends the process with some damaged files."""
        with _opened(self.file, folder) as data:
            return {name: data.column(*self.channels[self.place(name).path]) for name in names}

    def scalar(self, name: str) -> float:
        """Return a channel of one number."""
        path = self.find_scalar(name)
        return float(self.read([path])[path].values[0])


class _Channels:
    """The channels of an open file, converted here: asammdf evaluates what the file says.

    It is left no conversion that it could evaluate, by whatever way it reads a channel.
    """

    def __init__(self, data: Any, file: str) -> None:
        self.groups, self._data, self._file = data.groups, data, file
        self._version = 4 if data.version >= "4" else 3
        self._conversions: dict[tuple[int, int], Any] = {}
        self._times: dict[int, Floats | None] = {}
        for number, group in enumerate(data.groups):
            for index, channel in enumerate(group.channels):
                self._conversions[number, index] = channel.conversion
                channel.conversion = None

    def column(self, group: int, index: int) -> Column:
        """Return a channel, with the rate and the start that the times of its group tell."""
        conversion = self._conversions[group, index]
        channel = self.groups[group].channels[index]
        unit = getattr(conversion, "unit", "") or getattr(channel, "unit", "") or ""
        values, times = self._values(group, index), self._times_of(group)
        if times is None:
            return Column(values, unit.strip() or None)
        start = float(times[0]) if len(times) and np.isfinite(times[0]) else None
        return Column(values, unit.strip() or None, even_rate(times), start)

    def _times_of(self, group: int) -> Floats | None:
        """Return the sample times of a group, from its master channel, or that of another."""
        if group not in self._times:
            heading = self.groups[group].channel_group
            if getattr(heading, "flags", 0) & _REMOTE_MASTER and self._version == 4:
                return self._times_of(heading.cg_master_index)
            index = self._data.masters_db.get(group)
            self._times[group] = None if index is None else self._master(group, index)
        return self._times[group]

    def _master(self, group: int, index: int) -> Floats:
        """Return the samples of a master channel, which MDF 3 may leave to a step of time."""
        found = self.groups[group]
        channel = found.channels[index]
        if self._version == 3 and not channel.bit_count:
            return np.arange(found.channel_group.cycles_nr) * float(channel.sampling_rate or 1)
        return self._values(group, index)

    def _values(self, group: int, index: int) -> Floats:
        """Return the samples of a channel in its unit, invalid ones as NaN."""
        channel = self.groups[group].channels[index]
        try:
            samples, invalid = self._data.get(
                group=group,
                index=index,
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


def open_mdf(path: Path) -> MdfTable:
    """Open an MDF file; a channel is named by its name, or by its group and name: ``1/x``."""
    start = head(path)
    if content(start) != "MDF data":
        raise not_what_it_says(path, start, "MDF data")
    _check_packed(path)
    with TemporaryDirectory() as folder:
        found: MdfTable = in_child(_table, str(path), path, folder)
    return found


def _table(path: Path, folder: str) -> MdfTable:
    channels, shapes = {}, {}
    with _opened(str(path), folder) as data:
        for number, group in enumerate(data.groups):
            samples = int(group.channel_group.cycles_nr)
            check_size(samples, str(path))
            # asammdf makes room for a record before it reads one
            check_size(int(group.channel_group.samples_byte_nr), str(path), itemsize=1)
            for index, channel in enumerate(group.channels):
                name = f"{number}/{channel.name}"
                channels[name], shapes[name] = (number, index), (samples,)
    return MdfTable(str(path), shapes, channels)


def _check_packed(path: Path) -> None:
    """Refuse packed blocks that say that they are far more than the file can hold."""
    total = 0
    with open_regular(path) as stream, reading(str(path), "MDF data"):
        data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        with data:
            place = data.find(_PACKED)
            while place >= 0:
                block = data[place : place + _PACKED_HEAD.size]
                if len(block) == _PACKED_HEAD.size:
                    _id, size, links, kind, unpacked, packed = _PACKED_HEAD.unpack(block)
                    is_block = not links and kind in _PACKED_KINDS and size >= packed
                    total += unpacked if is_block else 0
                place = data.find(_PACKED, place + 4)
    check_size(total, str(path), itemsize=1)


@contextmanager
def _opened(file: str, folder: str) -> Iterator[_Channels]:
    """Yield the channels of a file; nothing that the file says is evaluated."""
    try:
        from asammdf import MDF
    except ImportError:
        raise missing_package("asammdf", file) from None
    with (
        silent(),
        redirect_stdout(StringIO()),  # asammdf prints the traceback of what it passes over
        reading(file, "MDF data"),
    ):
        with _no_last_words():
            try:
                # messages of a bus would be converted as the file is opened
                opened = MDF(file, temporary_folder=folder, process_bus_logging=False)  # type: ignore[call-arg]
            except Exception as error:
                traceback.clear_frames(error.__traceback__)
                raise ValueError(str(error)) from None
        with opened as data:
            yield _Channels(data, file)


@contextmanager
def _no_last_words() -> Iterator[None]:
    """Keep files that asammdf failed to open from writing to the terminal when they are deleted."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook
