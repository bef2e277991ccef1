"""Columns of files to records in SI, whole or in blocks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid.core.errors import InputError, ReadError, naming, printable
from rotorid.core.units import MAGNITUDE, check_unit, converts, quantity, si_factor
from rotorid.core.values import Floats, frozen
from rotorid.core.watch import watch
from rotorid.data.record import Channel, Record
from rotorid.force.channel_dynamics import Dynamics
from rotorid.io.clock import RecordClock, is_time, on_grid, weigh_clock
from rotorid.io.table import Column, ColumnFile, Stored, open_tables
from rotorid.signals.average import RecordBlocks

_TIME, _MASK = "time", "mask"


@frozen
class Source:
    """Where a channel comes from in a file, and how it was recorded."""

    column: str  # name of the column in the file
    # unit of the column times `scale`; without it, the one that the file states
    unit: str | None = None
    scale: float | str | None = None  # A factor, or the scalar variable of the file that holds it
    # the unit that the channel must convert to; without it, the SI unit of its own
    expected: str | None = None
    reads: Mapping[str, float] | None = None  # see `Channel`
    hold: bool = False
    # in s
    delay: float = 0.0
    delay_std: float = 0.0
    gain_std: float = 0.0  # relative
    overrule: bool = False  # the unit given here holds where the file states another
    dynamics: Dynamics | None = None  # see `Channel`
    alone: bool = False  # its column is that of no other source that is alone
    place: str = ""  # where its column is named, if not in [channels]
    offset: float | str = 0.0  # taken off the reading, in SI or with a unit

    def channel(self, name: str, unit: str | None = None) -> Channel:
        unit = self.expected or "" if unit is None else unit
        said = self.reads, self.hold, self.delay, self.delay_std, self.gain_std
        return Channel(name, unit, *said, dynamics=self.dynamics)


def read_record(
    path: str | Path | Sequence[str | Path],
    *,
    columns: Mapping[str, str | Source] | Sequence[str] | None = None,
    sample_rate: float | str | None = None,
    time: str | Source | None = None,
    speed: float | str = 0.0,
    phase: float | str | None = 0.0,
    skip: float | str = 0.0,
    until: float | str | None = None,
    mask: str | None = None,
    fundamental: float | str | None = None,
    highest: float | str | None = None,
    header_row: int | None = None,
    overrule: bool = False,
) -> Record:
    """Read a record of samples.

    Parameters
    ----------
    path : str or Path, or a sequence of them
        Text (.csv, .txt, .dat, .lvm), HDF5 (.h5, .hdf5), MATLAB (.mat), Parquet, TDMS, universal
        files (.uff, .unv) or MDF (.mf4, .mdf); or several files of one clock.
    columns : mapping or sequence of str, optional
        Channel names to columns; or the columns, each under its own name. Without it, all
        columns of the length of the longest that hold a number, of matrices too: ``name[0]``.
    sample_rate : float or str
        In Hz, or with a unit: ``"5 kHz"``.
    time : str or Source, optional
        The column of sample times; in s where the file says nothing else. With `sample_rate`, the
        two are held against each other; with neither, the file must state its rate.
    speed : float or str
        Speed of rotation in rad/s, or with a unit; in Hz it counts revolutions.
    phase : float or str, optional
        Rotor angle at the file's first sample in rad, or with a unit; ``None`` where it is not
        known, so that the record tells no direction of the unbalance.
    skip : float or str
        Time in s from the file's first sample, before which gaps and samples that are no numbers
        do no harm: where there are some, the record starts there.
    until : float or str, optional
        Time in s from the file's first sample; what follows is dropped.
    mask : str, optional
        A column that is 0 where a sample is to be left out.
    fundamental : float or str, optional
        Hz. A rate that the file tells with a few digits only is taken to be a whole multiple of
        it, where the digits allow it.
    highest : float or str, optional
        Highest frequency in Hz that will be used: it decides whether samples at jittered times
        can be put on a uniform grid.
    header_row : int, optional
        Line of the column names in a text file, counted from 1; 0 where there are none.
    overrule : bool
        Take `sample_rate` and units as given here, even where the file states others.

    Returns
    -------
    Record
        In SI; a column without any unit is taken to be in SI already. What was done to the
        samples is in its `warnings`.

    Raises
    ------
    ReadError
        For a file, column or time axis that cannot be used.
    InputError
        For units that do not convert, or samples that are not finite.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> path = Path(tempfile.mkdtemp()) / "run.csv"
    >>> np.savetxt(path, [[0.0, 1.0], [0.5, 2.0]], delimiter=",", header="x,F", comments="")
    >>> read_record(path, sample_rate="5 kHz").column("F")
    array([1., 2.])
    """
    table = open_tables(path, header_row=header_row)
    with naming(table.file):
        sources, read, stamps = _columns(table, columns, time, mask, overrule)
        read, warnings = (read, ()) if columns is not None else _of_one_length(read)
        kept = read.pop(_MASK, None)
        given, whole = _si(sample_rate, "Hz", "sample_rate"), _si(fundamental, "Hz", "fundamental")
        begin, end = _si(skip, "s", "skip") or 0.0, _si(until, "s", "until")
        rows = max((len(column.values) for column in read.values()), default=0)
        times = _unused_times(table, {} if columns is None else sources, rows)
        clock = weigh_clock(given, stamps, read.values(), overrule, whole, (begin, end), times)
        into_si = _IntoSI(table, {name: sources[name] for name in read}, read)
        samples = into_si.samples(read)
        if not len(samples):
            raise ReadError("no samples", "columns of samples", "check the file")
        into_si.check()
        omega, angle = _si(speed, "rad/s", "speed") or 0.0, _si(phase, "rad", "phase") or 0.0
        mask_values = np.ones(len(samples)) if kept is None else kept.values
        valid = (mask_values != 0) & np.isfinite(mask_values)
        if len(valid) != len(samples):
            found = f"{len(valid)} samples where the channels have {len(samples)}"
            raise ReadError(found, "a mask of their length", "cut it alike", place=_MASK)
        clock, samples, valid = clock.cut(samples, valid, begin)
        clock, samples, valid = on_grid(clock, samples, valid, _si(highest, "Hz", "highest"))
    turned = angle + omega * (clock.start + np.arange(len(samples), dtype=float) / clock.rate)
    return Record(
        channels=into_si.channels,
        samples=samples,
        sample_rate=clock.rate,
        speed=omega,
        angle=None if angle == 0.0 else turned,
        phase_known=phase is not None,
        source=table.file,
        valid=None if mask is None else valid,
        warnings=(*clock.warnings, *warnings),
        start=clock.start,
    )


def _columns(
    table: ColumnFile,
    columns: Mapping[str, str | Source] | Sequence[str] | None,
    time: str | Source | None,
    mask: str | None,
    overrule: bool,
) -> tuple[dict[str, Source], dict[str, Column], Floats | None]:
    """Return what the channels come from, their columns and the mask's, and the sample times."""
    said = {_TIME: time, _MASK: mask}
    beside = {k: Source(s) if isinstance(s, str) else s for k, s in said.items() if s is not None}
    sources = _sources(columns, table, beside.get(_TIME), overrule)
    read = _read(table, {**sources, **beside})
    stamps = _stamps(read.pop(_TIME), beside[_TIME], table) if _TIME in beside else None
    return sources, read, stamps


def _unused_times(
    table: ColumnFile, used: Mapping[str, Source], rows: int
) -> Iterator[tuple[str, Column]]:
    """Yield the columns of so many rows that are times by their names, and nothing else."""
    taken = _find(table, used).values()
    for name in table.names:
        with suppress(InputError):  # a name of several columns, a column of dates
            if is_time(name, None) and (key := table.find(name)) not in taken:
                column = table.read([key])[key]
                if len(column.values) == rows:
                    yield name, column


def _of_one_length(read: dict[str, Column]) -> tuple[dict[str, Column], tuple[str, ...]]:
    """Return the columns of the length of the longest that hold a number, and what is left out."""
    empty = [n for n, c in read.items() if n != _MASK and np.isnan(c.values).all()]
    told = {n: c for n, c in read.items() if n != _MASK and n not in empty}
    if not told:
        return read, ()
    longest = max(len(column.values) for column in told.values())
    kept = {n: c for n, c in read.items() if n == _MASK or (n in told and len(c.values) == longest)}
    text = f"no number in {', '.join(map(repr, empty))}: left out"
    return kept, (text,) if empty else ()


def _si(value: float | str | None, unit: str, place: str) -> float | None:
    return None if value is None else float(quantity(value, unit, place=place))


def _sources(
    columns: Mapping[str, str | Source] | Sequence[str] | None,
    table: ColumnFile,
    timing: Source | None,
    overrule: bool,
) -> dict[str, Source]:
    if isinstance(columns, Mapping):
        found = {n: Source(c) if isinstance(c, str) else c for n, c in columns.items()}
        return {n: replace(s, overrule=s.overrule or overrule) for n, s in found.items()}
    if columns is not None:
        return {name: Source(name) for name in columns}
    axis = None if timing is None else _find(table, {_TIME: timing})[_TIME]
    return {name: Source(name) for name in table.names if table.find(name) != axis}


def _read(table: ColumnFile, sources: Mapping[str, Source]) -> dict[str, Column]:
    found = _find(table, sources)
    columns = table.read(list(dict.fromkeys(found.values())))
    return {name: columns[key] for name, key in found.items()}


def _find(table: ColumnFile, sources: Mapping[str, Source]) -> dict[str, str]:
    """Return the file's own name of the column of each channel."""
    found, taken = dict[str, str](), dict[str, str]()
    for name, source in sources.items():
        with naming(place=source.place or _place(name, "column")):
            found[name] = table.find(source.column)
    for name in found:
        if sources[name].alone and (other := taken.setdefault(found[name], name)) != name:
            raise InputError(
                f"{found[name]!r} for {other} and for {name}",
                "a column of its own for each channel",
                "write the name of the right column",
                place=_place(name, "column"),
            )
    return found


def largest_of(values: Floats) -> float:
    """Return the largest size of numbers, of those that are numbers."""
    if not len(values):
        return 0.0
    low, high = float(values.min()), float(values.max())
    if np.isnan(low):
        low, high = float(np.fmin.reduce(values)), float(np.fmax.reduce(values))
    return max(-low, high)


def unit_of(given: str | None, stated: str | None, overrule: bool, place: str) -> str | None:
    """Return the unit that is given, or else the file's; refuse two that differ."""
    if not given or not stated or overrule:
        return given or stated
    try:
        si_factor(stated)
    except InputError:
        return given  # a text that says nothing to us contradicts nothing
    if not converts(stated, given) or abs(si_factor(stated, given) - 1.0) >= 1e-9:
        found = f"unit {given!r}, where the file says {stated!r}"
        cure = "leave unit out, or give overrule = true if the file is wrong"
        raise InputError(found, "one unit", cure, place=place)
    return given


def check_magnitude(largest: float, factor: float, place: str) -> None:
    """Refuse samples whose squares leave what doubles hold: no machine has such, units do."""
    size = abs(largest * factor)
    if largest and math.isfinite(largest) and not 1 / MAGNITUDE <= size <= MAGNITUDE:
        expected = f"samples of {1 / MAGNITUDE:g} to {MAGNITUDE:g}"
        cure = "check the unit and the scale of the column, and its numbers"
        raise InputError(f"samples up to {size:.3g} in SI", expected, cure, place=place)


def _factor(column: Column, source: Source, table: ColumnFile, name: str) -> tuple[float, str]:
    """Return the number that turns a column into SI, and the unit that it then has."""
    place, scale = _place(name, "unit"), source.scale
    unit = unit_of(source.unit, column.unit if scale is None else None, source.overrule, place)
    if isinstance(scale, str):
        with naming(place=_place(name, "scale")):
            scale = table.scalar(scale)
            if scale == 0:
                cure = "write what turns the column into its unit, or leave it out for 1"
                raise InputError(f"{source.scale} = 0", "a scale other than 0", cure)
    if unit is None and source.expected:
        told, cure = f"a unit that converts to {source.expected}", "write it, here or into the file"
        raise InputError("no unit", told, cure, place=place)
    factor = 1.0 if unit is None else si_factor(unit, source.expected, place=place)
    factor *= 1.0 if scale is None else float(scale)
    return factor, source.expected or (check_unit(unit) if unit else "")


def _place(name: str, key: str) -> str:
    return name if name in (_TIME, _MASK) else f"channels.{name}.{key}"


def _stamps(column: Column, source: Source, table: ColumnFile) -> Floats:
    seconds = replace(source, unit=source.unit or column.unit or "s", expected="s")
    factor, _ = _factor(column, seconds, table, _TIME)
    check_magnitude(largest_of(column.values), factor, _TIME)
    return np.asarray(column.values * factor)


class _IntoSI:
    """Puts columns into SI, all rows at once or some after others; `first` are some of them."""

    def __init__(
        self, table: ColumnFile, sources: Mapping[str, Source], first: Mapping[str, Column]
    ) -> None:
        told = {name: _factor(first[name], one, table, name) for name, one in sources.items()}
        self.factors = {name: factor for name, (factor, _) in told.items()}
        self.channels = tuple(one.channel(name, told[name][1]) for name, one in sources.items())
        self.offsets = [
            quantity(one.offset, told[name][1] or "1", place=_place(name, "offset"))
            for name, one in sources.items()
        ]
        self.largest = dict.fromkeys(sources, 0.0)

    def samples(self, read: Mapping[str, Column], rows: int | None = None) -> Floats:
        lengths = {name: len(read[name].values[:rows]) for name in self.factors}
        longest = max(lengths.values(), default=0)
        for name, length in lengths.items():
            if length != longest:
                raise ReadError(
                    f"{length} samples where others have {longest}",
                    "columns of one length",
                    "cut them alike",
                    place=_place(name, "column"),
                )
        found = np.empty((longest, len(lengths)))
        for place, (name, factor) in enumerate(self.factors.items()):
            values = read[name].values[:rows]
            self.largest[name] = max(self.largest[name], largest_of(values))
            if self.largest[name] * abs(factor) > 1:  # small ones may grow yet
                check_magnitude(self.largest[name], factor, _place(name, "unit"))
            with np.errstate(invalid="ignore"):  # gaps are told where they are looked for
                np.multiply(values, factor, out=found[:, place])
        found -= self.offsets
        return found

    def check(self) -> None:
        for name, factor in self.factors.items():
            check_magnitude(self.largest[name], factor, _place(name, "unit"))


WORTH = 64_000_000
"""Bytes of samples from which on a record is read in blocks; less is nothing to a machine."""
ROWS = 1 << 16
"""Samples of a block, of each channel."""


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
    """Open as `read_record` does, in SI and in blocks; None where small or not readable so."""
    table = open_tables(paths, header_row=header_row)
    if not isinstance(table, Stored):
        return None
    with naming(table.file):
        found = _find(table, columns)
        keys = list(dict.fromkeys(found.values()))
        if (size := table.size_in_blocks(keys)) < WORTH or not size:
            return None
        if (first := next(table.blocks(keys, 1), None)) is None:
            return None
        stamps = None if time is None else _stamps(_read(table, {_TIME: time})[_TIME], time, table)
        limits, times = (0.0, until), _unused_times(table, columns, size // (8 * len(keys)))
        told = sample_rate, stamps, first.values(), overrule, fundamental
        clock = weigh_clock(*told, limits, times)
        if clock.stamps is not None:
            return None
        sources = _sources(columns, table, time, overrule)
        into_si = _IntoSI(table, sources, {name: first[key] for name, key in found.items()})

    def read() -> Iterator[Floats]:
        with naming(table.file):
            yield from _blocks(table, found, into_si, clock)

    return RecordBlocks(into_si.channels, clock.rate, speed, phase or 0.0, table.file, read)


def _blocks(
    table: Stored, keys: Mapping[str, str], into_si: _IntoSI, clock: RecordClock
) -> Iterator[Floats]:
    left, done, asked = clock.end, 0, list(dict.fromkeys(keys.values()))
    whole = table.size_in_blocks(asked) if left is None else 8 * left * len(keys)
    say = f"reading megabytes of {printable(Path(table.file).name)}"
    for block in table.blocks(asked, ROWS):
        samples = into_si.samples({name: block[key] for name, key in keys.items()}, left)
        yield samples
        done += samples.nbytes
        watch(say, done // 10**6, whole // 10**6)
        if left is not None and (left := left - len(samples)) <= 0:
            break
    into_si.check()
