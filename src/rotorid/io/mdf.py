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

from rotorid.files import open_regular
from rotorid.frozen import frozen
from rotorid.io.child import in_child
from rotorid.io.clock import even_rate
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
            return {name: self._column(data, name) for name in names}

    def scalar(self, name: str) -> float:
        """Return a channel of one number."""
        path = self.find_scalar(name)
        return float(self.read([path])[path].values[0])

    def _column(self, data: Any, name: str) -> Column:
        group, index = self.channels[self.place(name).path]
        signal = data.get(group=group, index=index)
        values = np.asarray(signal.samples)
        if not is_numeric(values.dtype) or values.ndim != 1:
            raise ValueError(f"{name!r} holds no numbers")
        unit = str(signal.unit or "").strip() or None
        times = np.asarray(signal.timestamps, dtype=float)
        start = float(times[0]) if len(times) else None
        return Column(values.astype(np.float64), unit, even_rate(times), start)


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
    """Return what is in an MDF file."""
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
def _opened(file: str, folder: str) -> Iterator[Any]:
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
                opened = MDF(file, temporary_folder=folder)
            except Exception as error:
                traceback.clear_frames(error.__traceback__)
                raise ValueError(str(error)) from None
        with opened as data:
            yield data


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
