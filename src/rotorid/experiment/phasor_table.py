"""A table of 1x phasors, as an experiment file names its columns, to lines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.notes import Note
from rotorid.core.units import check_unit, si_factor
from rotorid.core.values import Complexes, Floats
from rotorid.data.lines import Lines
from rotorid.data.record import Channel
from rotorid.data.tables import phasor_lines
from rotorid.experiment.names import source
from rotorid.experiment.schema import ChannelEntry, RecordEntry
from rotorid.experiment.table_columns import Columns, complex_column, std_column
from rotorid.io import open_tables
from rotorid.io.table import Table
from rotorid.models import Model
from rotorid.signals.checks.channels import check_phases, check_probes


def check_channels(
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


def read_records(
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
        channels = check_channels(entries, model, folder)
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


def _speeds(rows: Columns, entry: RecordEntry, entries: Mapping[str, ChannelEntry]) -> Floats:
    if entry.speed.column is not None:
        return rows.si(entry.speed.column, entry.speed.unit, "rad/s", "speed")
    name, first = next(iter(entries.items()))
    column = first.amplitude or first.real or ""
    count = len(rows.si(column, first.unit, first.unit or "1", f"channels.{name}"))
    return np.full(count, entry.speed.value)


def _phases(rows: Columns, name: str, entry: ChannelEntry) -> list[Note]:
    if not entry.polar:
        return []
    turned = rows.si(entry.phase or "", entry.phase_unit, "rad", f"channels.{name}.phase")
    factor = si_factor(entry.phase_unit, "rad")
    return list(check_phases(name, turned / factor, degrees=factor < 1))


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
