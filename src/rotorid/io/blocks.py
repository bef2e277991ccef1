"""Records read in blocks, so that memory does not grow with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from rotorid.errors import InputError, ReadError
from rotorid.frozen import frozen
from rotorid.io.opening import open_tables
from rotorid.io.reading import (
    Source,
    channel_factors,
    check_magnitude,
    find_columns,
    largest_of,
    stamps_of,
)
from rotorid.io.table import Column, Table
from rotorid.io.timing import RecordClock, weigh_clock
from rotorid.record import Channel, Floats

WORTH = 64_000_000
"""Bytes of samples from which on a record is read in blocks; less is nothing to a machine."""

ROWS = 1 << 16
"""Samples of a block, of each channel."""


@runtime_checkable
class BlockedTable(Protocol):
    """A table that can be read in blocks of rows."""

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, Column]]:
        """Yield successive rows of columns, by the names that `find` returned."""
        ...

    def bytes_of(self, names: Sequence[str]) -> int:
        """Return the size of columns in memory."""
        ...


@frozen
class RecordBlocks:
    """What a `Record` says of itself, and its samples in blocks.

    Parameters
    ----------
    channels : sequence of Channel
    sample_rate : float
        Hz.
    speed, phase : float
        rad/s, and the rotor angle in rad at the file's first sample.
    source : str
    read : callable
        Returns an iterator over blocks of samples in SI, shape (sample, channel).
    """

    channels: tuple[Channel, ...]
    sample_rate: float
    speed: float
    phase: float
    source: str
    read: Callable[[], Iterator[Floats]]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return tuple(channel.name for channel in self.channels)


def open_blocks(
    paths: Sequence[Path],
    *,
    columns: Mapping[str, Source],
    sample_rate: float | None = None,
    time: Source | None = None,
    speed: float = 0.0,
    phase: float | None = 0.0,
    until: float | None = None,
    fundamental: float | None = None,
    header_row: int | None = None,
    overrule: bool = False,
) -> RecordBlocks | None:
    """Open a record to be read in blocks; None where it is small or cannot be read so.

    Parameters are those of `rotorid.read_record`, in SI.

    Raises
    ------
    InputError
        For files, columns, units and times that cannot be used.
    """
    table = open_tables(paths, header_row=header_row)
    if not isinstance(table, BlockedTable):
        return None
    try:
        found = find_columns(table, columns)
        keys = list(dict.fromkeys(found.values()))
        if table.bytes_of(keys) < WORTH:
            return None
        first = next(table.blocks(keys, 1), None)
        if first is None:
            return None
        stamps = None if time is None else stamps_of(table, time)
        limits = (0.0, until)
        clock = weigh_clock(sample_rate, stamps, first.values(), overrule, fundamental, limits)
        if clock.stamps is not None:
            return None
        units = {name: first[key] for name, key in found.items()}
        channels, factors = channel_factors(columns, units, table, overrule=overrule)
    except InputError as error:
        raise error.at(file=table.file) from None
    order = [found[name] for name in columns]

    def read() -> Iterator[Floats]:
        return _blocks(table, order, dict(zip(columns, factors, strict=True)), clock)

    return RecordBlocks(channels, clock.rate, speed, phase or 0.0, table.file, read)


def _blocks(
    table: Table, keys: Sequence[str], factors: Mapping[str, float], clock: RecordClock
) -> Iterator[Floats]:
    """Yield blocks of samples in SI, up to the end that the clock knows."""
    assert isinstance(table, BlockedTable)
    left = clock.end
    largest = dict.fromkeys(factors, 0.0)
    for block in table.blocks(list(dict.fromkeys(keys)), ROWS):
        lengths = {len(column.values) for column in block.values()}
        if len(lengths) > 1:
            raise ReadError(
                f"columns of {min(lengths)} and {max(lengths)} more samples",
                "columns of one length",
                "cut them alike",
                file=table.file,
            )
        count = lengths.pop() if left is None else min(left, lengths.pop())
        samples = np.empty((count, len(keys)))
        for place, (key, (name, factor)) in enumerate(zip(keys, factors.items(), strict=True)):
            values = block[key].values[:count]
            largest[name] = max(largest[name], largest_of(values))
            if largest[name] * abs(factor) > 1:  # small ones may grow yet
                _check_magnitude(largest[name], factor, name, table)
            np.multiply(values, factor, out=samples[:, place])
        yield samples
        if left is not None and (left := left - count) <= 0:
            break
    for name, factor in factors.items():
        _check_magnitude(largest[name], factor, name, table)


def _check_magnitude(largest: float, factor: float, name: str, table: Table) -> None:
    try:
        check_magnitude(largest, factor, f"channels.{name}.unit")
    except InputError as error:
        raise error.at(file=table.file) from None
