"""A table of 1x phasors, as an experiment file names its columns, to lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotorid.errors import InputError
from rotorid.experiment.names import source
from rotorid.experiment.schema import ChannelEntry, RecordEntry
from rotorid.io import open_tables
from rotorid.io.reading import check_magnitude, largest_of
from rotorid.io.table import Table
from rotorid.lines import Lines
from rotorid.models import Model
from rotorid.phasor_lines import phasor_lines
from rotorid.record import Channel, Check, Complexes, Floats
from rotorid.signals.checks_phasors import check_phases, check_probes
from rotorid.units import check_unit, si_factor, to_si


def phasor_channels(
    entries: Mapping[str, ChannelEntry], model: Model, folder: Path
) -> dict[str, Channel]:
    """Return the channels of a table, names and what they read checked against the model."""
    found = {}
    for name, entry in entries.items():
        place = f"channels.{name}"
        unit = model.units.get(name)
        if entry.unit is None:
            raise InputError("no unit", "the unit of the amplitude", "write it", place=place)
        si_factor(entry.unit, unit, place=f"{place}.unit")
        si_factor(entry.phase_unit, "rad", place=f"{place}.phase_unit")
        found[name] = source(name, entry, model, folder).channel(
            name, unit or check_unit(entry.unit)
        )
    return found


def read_phasors(
    folder: Path, entry: RecordEntry, entries: Mapping[str, ChannelEntry], model: Model
) -> list[Lines]:
    """Read a table of phasors, its files relative to a folder.

    Raises
    ------
    InputError
        For files, columns, units and numbers that cannot be used.
    """
    table = open_tables([folder / name for name in entry.paths], header_row=entry.header_row)
    rows = Columns(table, entry.overrule)
    try:
        channels = phasor_channels(entries, model, folder)
        speed = _speeds(rows, entry, entries)
        units = {name: channels[name].unit for name in entries}
        read = [complex_column(rows, name, one, units[name]) for name, one in entries.items()]
        phasors = _stacked(speed, read, table)
        stated = [std_column(rows, name, one, units[name]) for name, one in entries.items()]
        std = _common(list(entries), stated, speed)
        probes = [k for k, name in enumerate(entries) if name not in model.inputs]
        checks = [
            *check_probes(
                [list(entries)[k] for k in probes],
                phasors[:, probes],
                None if std is None else std[:, probes],
            ),
            *(c for name, one in entries.items() for c in _phases(rows, name, one)),
        ]
        lines = phasor_lines(
            list(channels.values()), speed, phasors, std, source=table.file, checks=checks
        )
        return [lines]
    except InputError as error:
        raise error.at(file=table.file) from None


@dataclass(frozen=True)
class Columns:
    """The columns of a table, in SI."""

    table: Table
    overrule: bool

    def si(self, column: str, unit: str | None, expected: str, place: str) -> Floats:
        """Return a column in the unit that is expected."""
        found = self.table.read([self._key(column, place)]).popitem()[1]
        declared = unit or found.unit
        if declared is None:
            raise InputError(
                "no unit", f"a unit that converts to {expected}", "write it", place=place
            )
        factor = si_factor(declared, expected, place=f"{place}.unit")
        if unit and found.unit and not self.overrule:
            self.check_stated(unit, found.unit, place)
        wrong = ~np.isfinite(found.values)
        if wrong.any():
            raise InputError(
                f"{found.values[wrong][0]} in row {int(wrong.argmax()) + 1} of {column!r}",
                "a number in every row",
                "fill it in, or delete the row",
                place=place,
            )
        check_magnitude(largest_of(found.values), factor, place)
        return np.asarray(found.values * factor)

    def has(self, column: str) -> bool:
        """Tell whether there is a column of that name."""
        try:
            self.table.find(column)
        except InputError:
            return False
        return True

    def _key(self, column: str, place: str) -> str:
        try:
            return self.table.find(column)
        except InputError as error:
            raise error.at(place=place) from None

    @staticmethod
    def check_stated(declared: str, stated: str, place: str) -> None:
        """Refuse a unit other than the one that the file states."""
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
                "leave unit out, or give overrule = true if the file is wrong",
                place=f"{place}.unit",
            )


def _speeds(rows: Columns, entry: RecordEntry, entries: Mapping[str, ChannelEntry]) -> Floats:
    """Return the speed of each row."""
    if entry.speed.column is not None:
        return rows.si(entry.speed.column, entry.speed.unit, "rad/s", "speed")
    name, first = next(iter(entries.items()))
    column = first.amplitude or first.real or ""
    count = len(rows.si(column, first.unit, first.unit or "1", f"channels.{name}"))
    return np.full(count, entry.speed.value)


def complex_column(rows: Columns, name: str, entry: ChannelEntry, expected: str) -> Complexes:
    """Return X of a channel in a unit: what the instrument states, as Re(X exp(i phi)) has it."""
    place = f"channels.{name}"
    if entry.polar:
        size = rows.si(entry.amplitude or "", entry.unit, expected, f"{place}.amplitude")
        turned = rows.si(entry.phase or "", entry.phase_unit, "rad", f"{place}.phase")
        if (size < 0).any():
            raise InputError(
                f"the amplitude {size.min():g} in row {int(size.argmin()) + 1}",
                "0 or more",
                "turn its phase by 180 deg, or give a signed reading as real",
                place=f"{place}.amplitude",
            )
        check_lengths(size, turned, place)
        found = size * np.exp(1j * turned)
    else:
        real = rows.si(entry.real or "", entry.unit, expected, f"{place}.real")
        imag = rows.si(entry.imag or "", entry.unit, expected, f"{place}.imag")
        check_lengths(real, imag, place)
        found = real + 1j * imag
    found = found.conj() if entry.lag else found
    return np.asarray(_factor(rows, entry, place) * found)


def _factor(rows: Columns, entry: ChannelEntry, place: str) -> float:
    """Return what amplitudes as they stand are multiplied by."""
    scale = 1.0 if entry.scale is None else entry.scale
    if isinstance(scale, str):
        try:
            scale = rows.table.scalar(scale)
        except InputError as error:
            raise error.at(place=f"{place}.scale") from None
    return float(scale) / 2 if entry.peak_to_peak else float(scale)


def _phases(rows: Columns, name: str, entry: ChannelEntry) -> list[Check]:
    """Check the phases of a channel in the unit in which they are stated."""
    if not entry.polar:
        return []
    turned = rows.si(entry.phase or "", entry.phase_unit, "rad", f"channels.{name}.phase")
    factor = si_factor(entry.phase_unit, "rad")
    return list(check_phases(name, turned / factor, degrees=factor < 1))


def std_column(rows: Columns, name: str, entry: ChannelEntry, expected: str) -> Floats | None:
    """Return the deviation of the amplitude in a unit, a column or one for all rows."""
    if entry.std is None:
        return None
    place = f"channels.{name}.std"
    if rows.has(entry.std):
        found = rows.si(entry.std, entry.unit, expected, place)
    else:
        found = np.array([to_si(entry.std, expected, place=place)])
    if not (found > 0).all():
        raise InputError(
            f"{found.min():g} in row {int(found.argmin()) + 1}" if len(found) > 1 else entry.std,
            "a deviation of more than 0",
            "state how far the amplitude scatters: the last digit of the instrument at least",
            place=place,
        )
    return np.asarray(abs(_factor(rows, entry, f"channels.{name}")) * found)


def check_lengths(one: Floats, other: Floats | Complexes, place: str) -> None:
    """Refuse columns of different lengths."""
    if len(one) != len(other):
        raise InputError(
            f"{len(one)} and {len(other)} rows", "columns of one length", "cut them", place=place
        )


def _stacked(speed: Floats, phasors: list[Complexes], table: Table) -> Complexes:
    """Return the phasors of all channels, shape (row, channel)."""
    for one in phasors:
        if len(one) != len(speed):
            raise InputError(
                f"{len(one)} phasors for {len(speed)} speeds", "a row each", "cut the columns"
            )
    return np.column_stack(phasors)


def _common(names: list[str], std: list[Floats | None], speed: Floats) -> Floats | None:
    """Return the deviations of all channels, None where none is stated."""
    lacking = [name for name, one in zip(names, std, strict=True) if one is None]
    if len(lacking) == len(names):
        return None
    if lacking:
        raise InputError(
            f"no std of {', '.join(lacking)}",
            "the deviation of every channel, or of none where speeds were read twice",
            "state it",
            place=f"channels.{lacking[0]}.std",
        )
    return np.column_stack([np.broadcast_to(one, len(speed)) for one in std if one is not None])
