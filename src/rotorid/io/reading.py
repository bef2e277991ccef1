"""From a file of columns to a `Record` in SI units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rotorid.errors import InputError, ReadError
from rotorid.io.delimited import open_delimited
from rotorid.io.hdf5 import open_hdf5
from rotorid.io.mat import open_mat
from rotorid.io.table import Column, Table, content, head
from rotorid.record import Channel, Floats, Record
from rotorid.units import check_unit, si_factor, to_si

READERS: Mapping[str, Callable[[Path], Table]] = {
    ".csv": open_delimited,
    ".h5": open_hdf5,
    ".hdf5": open_hdf5,
    ".mat": open_mat,
}
_TIME = "time"


@dataclass(frozen=True)
class Source:
    """Where a channel comes from in a file, and how it was recorded.

    Parameters
    ----------
    column : str
        Name of the column in the file.
    unit : str, optional
        Unit of the column times `scale`; without it, the one that the file states.
    scale : float or str
        A factor, or the scalar variable of the file that holds it.
    expected : str, optional
        The unit that the channel must convert to; without it, the SI unit of its own.
    reads : mapping of str to float, optional
        See `Channel`.
    hold : bool
    delay, delay_std : float
        In s.
    gain_std : float
        Relative.
    """

    column: str
    unit: str | None = None
    scale: float | str | None = None
    expected: str | None = None
    reads: Mapping[str, float] | None = None
    hold: bool = False
    delay: float = 0.0
    delay_std: float = 0.0
    gain_std: float = 0.0

    def channel(self, name: str, unit: str) -> Channel:
        """Return the channel of that name, its samples in `unit`."""
        return Channel(name, unit, self.reads, self.hold, self.delay, self.delay_std, self.gain_std)


def open_table(path: str | Path) -> Table:
    """Open a file of columns with the reader of its ending."""
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        found = content(head(path)) + (f", ending {path.suffix}" if path.suffix else ", no ending")
        raise ReadError(
            found,
            f"a file that ends in {', '.join(READERS)}",
            "export the record to one of these",
            file=str(path),
        )
    return reader(path)


def read_record(
    path: str | Path,
    *,
    columns: Mapping[str, str | Source] | Sequence[str] | None = None,
    sample_rate: float | str | None = None,
    time: str | Source | None = None,
    speed: float | str = 0.0,
    phase: float | str = 0.0,
) -> Record:
    """Read a record of samples.

    Parameters
    ----------
    path : str or Path
        Text (.csv), HDF5 (.h5, .hdf5) or MATLAB up to version 7 (.mat).
    columns : mapping or sequence of str, optional
        Channel names to columns; or the columns, each under its own name. Without it, all
        one-dimensional columns of the length of the longest.
    sample_rate : float or str
        In Hz, or with a unit: ``"5 kHz"``.
    time : str or Source, optional
        In its place, the column of sample times; in s where the file says nothing else.
    speed : float or str
        Speed of rotation in rad/s, or with a unit; in Hz it counts revolutions.
    phase : float or str
        Rotor angle at the file's first sample in rad, or with a unit.

    Returns
    -------
    Record
        In SI; a column without any unit is taken to be in SI already.

    Raises
    ------
    ReadError
        For a file, column or time axis that cannot be used.
    InputError
        For units that do not convert, or samples that are not finite.
    """
    table = open_table(path)
    if (sample_rate is None) == (time is None):
        raise InputError(
            "no sample rate and no time column" if time is None else "both",
            "one of sample_rate and time",
            "give one",
            file=table.file,
        )
    try:
        timing = _as_source(time) if time is not None else None
        sources = _sources(columns, table, timing)
        read = _read(table, sources if timing is None else {**sources, _TIME: timing})
        if timing is None:
            rate = _quantity(sample_rate, "Hz", "sample_rate")
        else:
            rate = _rate(read.pop(_TIME), timing, table)
        omega, angle = _quantity(speed, "rad/s", "speed"), _quantity(phase, "rad", "phase")
        if columns is None:
            longest = max((len(column.values) for column in read.values()), default=0)
            read = {name: c for name, c in read.items() if len(c.values) == longest}
        channels, samples = _channels({name: sources[name] for name in read}, read, table)
    except InputError as error:
        raise error.at(file=table.file) from None
    turned = angle + omega / rate * np.arange(len(samples), dtype=float)
    return Record(
        channels=channels,
        samples=samples,
        sample_rate=rate,
        speed=omega,
        angle=None if angle == 0.0 else turned,
        source=table.file,
    )


def rate_of(time: Floats) -> float:
    """Return the sample rate of equidistant times."""
    if len(time) < 2 or not np.all(np.isfinite(time)):
        raise ReadError(
            "sample times that are not finite" if len(time) > 1 else "a single sample",
            "equidistant sample times",
            "give sample_rate in place of the time column",
            place="time",
        )
    steps = np.diff(time)
    step = float(np.median(steps))
    wrong = np.flatnonzero(~(np.abs(steps - step) < 0.5 * abs(step)))
    if wrong.size or step <= 0:
        first = int(wrong[0]) if wrong.size else 0
        raise ReadError(
            f"a step of {steps[first]:.6g} s after sample {first} (t = {time[first]:.9g} s)"
            + (f", {wrong.size} such in all" if wrong.size > 1 else ""),
            f"steps of {step:.6g} s: no dropped samples",
            "cut the record there, or give sample_rate if only the time stamps are wrong",
            place="time",
        )
    return float((len(time) - 1) / (time[-1] - time[0]))


def _quantity(value: float | str | None, unit: str, place: str) -> float:
    return to_si(value, unit, place=place) if isinstance(value, str) else float(value or 0.0)


def _as_source(column: str | Source) -> Source:
    return column if isinstance(column, Source) else Source(column)


def _rate(column: Column, source: Source, table: Table) -> float:
    seconds = replace(source, unit=source.unit or column.unit or "s", expected="s")
    return rate_of(_si(column, seconds, table, _TIME)[0])


def _sources(
    columns: Mapping[str, str | Source] | Sequence[str] | None,
    table: Table,
    timing: Source | None,
) -> dict[str, Source]:
    if isinstance(columns, Mapping):
        return {name: _as_source(column) for name, column in columns.items()}
    if columns is not None:
        return {name: Source(name) for name in columns}
    axis = None if timing is None else _find(table, timing, _TIME)
    return {name: Source(name) for name in table.names if table.find(name) != axis}


def _find(table: Table, source: Source, name: str) -> str:
    try:
        return table.find(source.column)
    except InputError as error:
        raise error.at(place=_place(name, "column")) from None


def _read(table: Table, sources: Mapping[str, Source]) -> dict[str, Column]:
    found = {name: _find(table, source, name) for name, source in sources.items()}
    columns = table.read(list(dict.fromkeys(found.values())))
    return {name: columns[key] for name, key in found.items()}


def _si(column: Column, source: Source, table: Table, name: str) -> tuple[Floats, str]:
    """Return the samples of a channel in SI, and their unit."""
    unit = source.unit or (column.unit if source.scale is None else None)
    place = _place(name, "unit")
    scale = source.scale
    if isinstance(scale, str):
        try:
            scale = table.scalar(scale)
        except InputError as error:
            raise error.at(place=_place(name, "scale")) from None
    if scale == 0:
        raise InputError("0", "a scale other than 0", "correct it", place=_place(name, "scale"))
    if source.unit and column.unit and source.scale is None:
        _check_stated(source.unit, column.unit, place)
    if unit is None and source.expected:
        raise InputError(
            "no unit",
            f"a unit that converts to {source.expected}",
            "write it, here or into the file",
            place=place,
        )
    factor = 1.0 if unit is None else si_factor(unit, source.expected, place=place)
    samples = column.values * (factor * (1.0 if scale is None else scale))
    return samples, source.expected or (check_unit(unit) if unit else "")


def _place(name: str, key: str) -> str:
    return name if name == _TIME else f"channels.{name}.{key}"


def _check_stated(declared: str, stated: str, place: str) -> None:
    """Refuse a declared unit that is not the one that the file states."""
    try:
        si_factor(stated)
    except InputError:
        return  # a text that says nothing to us contradicts nothing
    try:
        same = abs(si_factor(stated, declared) - 1.0) < 1e-9
    except InputError:
        same = False
    if not same:
        raise InputError(
            f"unit {declared!r}, where the file says {stated!r}",
            "one unit",
            "leave unit out, or give scale = 1 if the file is wrong",
            place=place,
        )


def _channels(
    sources: Mapping[str, Source], read: Mapping[str, Column], table: Table
) -> tuple[tuple[Channel, ...], Floats]:
    lengths = {name: len(column.values) for name, column in read.items()}
    longest = max(lengths.values(), default=0)
    if longest == 0:
        raise ReadError("no samples", "columns of samples", "check the file")
    for name, length in lengths.items():
        if length != longest:
            raise ReadError(
                f"{length} samples where others have {longest}",
                "columns of one length",
                "cut them alike",
                place=_place(name, "column"),
            )
    samples = np.empty((longest, len(sources)))
    channels = []
    for i, (name, source) in enumerate(sources.items()):
        samples[:, i], unit = _si(read[name], source, table, name)
        channels.append(source.channel(name, unit))
    return tuple(channels), samples
