"""Reader of MDF files (.mf4, .mdf, .dat of ASAM): a column is a channel."""

from __future__ import annotations

import gc
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

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

_MASTER = 2


@dataclass(frozen=True)
class MdfTable(NamedArrays):
    """An MDF file; its numbers are read when they are asked for."""

    channels: Mapping[str, tuple[int, int]]

    def read(self, names: Iterable[str]) -> dict[str, Column]:
        """Return columns by the names that `find` returned."""
        with _opened(self.file) as data:
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
        rate = even_rate(np.asarray(signal.timestamps, dtype=float))
        return Column(values.astype(np.float64), unit, rate)


def open_mdf(path: Path) -> MdfTable:
    """Open an MDF file; a channel is named by its name, or by its group and name: ``1/x``."""
    start = head(path)
    if content(start) != "MDF data":
        raise not_what_it_says(path, start, "MDF data")
    channels, shapes = {}, {}
    with _opened(str(path)) as data:
        for number, group in enumerate(data.groups):
            samples = int(group.channel_group.cycles_nr)
            check_size(samples, str(path), itemsize=1)
            # asammdf makes room for a record before it reads one
            check_size(int(group.channel_group.samples_byte_nr), str(path), itemsize=1)
            for index, channel in enumerate(group.channels):
                name = f"{number}/{channel.name}"
                channels[name], shapes[name] = (number, index), (samples,)
    return MdfTable(str(path), shapes, channels)


@contextmanager
def _opened(file: str) -> Iterator[Any]:
    try:
        from asammdf import MDF
    except ImportError:
        raise missing_package("asammdf", file) from None
    with (
        silent(),
        redirect_stdout(StringIO()),  # asammdf prints the traceback of what it passes over
        reading(file, "MDF data"),
        TemporaryDirectory() as folder,
    ):
        with _no_last_words():
            try:
                opened = MDF(file, temporary_folder=folder)  # it leaves copies there
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
