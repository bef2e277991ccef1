"""Records that are tables: 1x phasors, and frequency responses of text or universal files."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from rotorid.core.errors import NAME_CHARACTERS, InputError, naming
from rotorid.core.units import si_factor, to_si
from rotorid.core.values import Complexes, Floats, Integers, grouped
from rotorid.data.lines import Lines
from rotorid.data.record import Channel
from rotorid.data.table_lines import line_spacing, phasor_lines, response_lines
from rotorid.experiment.read import Recording, reading_factor
from rotorid.experiment.schema import ChannelEntry, RecordEntry, RowsEntry
from rotorid.io import formats, open_tables
from rotorid.io.columns import check_magnitude, largest_of, unit_of
from rotorid.io.formats import StoredResponse
from rotorid.io.table import ColumnFile, no_column
from rotorid.signals.checks.channels import check_phases, check_probes


class Columns:
    """The columns of a table, in SI and of one length."""

    def __init__(self, table: ColumnFile, entry: RecordEntry) -> None:
        self.table, self.overrule = table, entry.overrule
        self.rows: int | None = None
        # rows of the file, from 0
        self.chosen = slice(None) if entry.rows is None else chosen_rows(table, entry.rows)

    def si(self, column: str, unit: str | None, expected: str, place: str) -> Floats:
        with naming(place=place):
            key = self.table.find(column)
        found = self.table.read([key])[key]
        declared = unit_of(unit, found.unit, self.overrule, f"{place}.unit")
        if declared is None:
            told = f"a unit that converts to {expected}"
            raise InputError("no unit", told, "write it", place=place)
        factor = si_factor(declared, expected, place=f"{place}.unit")
        values = found.values[self.chosen]
        wrong = ~np.isfinite(values)
        if wrong.any():
            row = np.arange(len(found.values))[self.chosen][wrong][0]
            raise InputError(
                f"{values[wrong][0]} in row {row + 1} of {column!r}",
                "a number in every row",
                "fill it in, or delete the row",
                place=place,
            )
        check_magnitude(largest_of(values), factor, place)
        rows = len(values)
        if self.rows not in (None, rows):
            told = f"{rows} and {self.rows} rows"
            raise InputError(told, "columns of one length", "cut them", place=place)
        self.rows = rows
        return np.asarray(values * factor)


def chosen_rows(table: ColumnFile, entry: RowsEntry) -> Integers:
    with naming(place="rows"):
        texts = table.texts(table.find(entry.column))
    wanted = str(entry.value).removesuffix(".0")
    found = [row for row, text in enumerate(texts) if text.removesuffix(".0") == wanted]
    if not found:
        there, kind = list(dict.fromkeys(texts)), f"row whose {entry.column[:NAME_CHARACTERS]} is"
        raise no_column(wanted, there, kind=kind).at(place="rows.is")
    return np.array(found)


def complex_column(rows: Columns, entry: ChannelEntry, expected: str, place: str) -> Complexes:
    """Return X of a channel in a unit: what the instrument states, as Re(X exp(i phi)) has it."""
    first, second = entry.parts
    unit = (entry.phase_unit, "rad") if entry.polar else (entry.unit, expected)
    one = rows.si(getattr(entry, first), entry.unit, expected, f"{place}.{first}")
    other = rows.si(getattr(entry, second), *unit, f"{place}.{second}")
    if entry.polar and (one < 0).any():
        raise InputError(
            f"the amplitude {one.min():g} in row {int(one.argmin()) + 1}",
            "0 or more",
            "turn its phase by 180 deg, or give a signed reading as real",
            place=f"{place}.amplitude",
        )
    found = one * np.exp(1j * other) if entry.polar else one + 1j * other
    return np.asarray(found.conj() if entry.lag else found)


def std_column(rows: Columns, entry: ChannelEntry, expected: str, place: str) -> Floats:
    """Return the deviations of a channel in a unit, of a column or one for all rows."""
    stated, own = entry.std or "", False
    with suppress(InputError):
        own = bool(rows.table.find(stated))
    if own:
        found = rows.si(stated, entry.unit, expected, place)
    else:
        found = np.full(rows.rows or 0, to_si(stated, expected, place=place))
    if not (found > 0).all():
        raise InputError(
            f"{found.min():g} in row {int(found.argmin()) + 1}" if own else stated,
            "a deviation of more than 0",
            "state how far the amplitude scatters: the last digit of the instrument at least",
            place=place,
        )
    return found


class _Read(NamedTuple):
    """A channel of a table in SI: a phasor or a response by speed or frequency, and its noise."""

    input: str | None
    channel: Channel
    axis: Floats
    values: Complexes
    std: Floats | None
    coherence: Floats | None


def _unit(plan: Recording, name: str) -> str:
    """Return the SI unit of a channel of a table, of a response over that of its input."""
    unit, driven = plan.sources[name].expected or "", plan.channels[name].input
    return unit if driven is None else f"({unit})/({plan.model.units[driven]})"


def _of_table(plan: Recording, rows: Columns, axis: Floats | None) -> list[_Read]:
    """Return the channels of a table: a row per frequency, or per speed, if that is no column."""
    found = list[_Read]()
    for name, one in plan.channels.items():
        place, unit, std, coherence = f"channels.{name}", _unit(plan, name), None, None
        values = complex_column(rows, one, unit, place)
        axis = np.full(len(values), plan.entry.speed.value) if axis is None else axis
        if one.coherence is not None:
            coherence = rows.si(one.coherence, "1", "1", f"{place}.coherence")
        with naming(place=f"{place}.scale"):
            scale = rows.table.scalar(one.scale) if isinstance(one.scale, str) else one.scale
        factor = (1.0 if scale is None else float(scale)) / (2 if one.peak_to_peak else 1)
        if one.std is not None:
            std = abs(factor) * std_column(rows, one, unit, f"{place}.std")
        channel = plan.sources[name].channel(name)
        found.append(_Read(one.input, channel, axis, factor * values, std, coherence))
    return found


def read_phasors(plan: Recording) -> list[Lines]:
    entry, entries = plan.entry, plan.channels
    table = open_tables(plan.paths, header_row=entry.header_row)
    rows, speed = Columns(table, entry), None
    with naming(table.file):
        if entry.speed.column is not None:
            speed = rows.si(entry.speed.column, entry.speed.unit, "rad/s", "speed")
        found = _of_table(plan, rows, speed)
        phasors = np.column_stack([one.values for one in found])
        stated = [one.std for one in found if one.std is not None]
        lacking = [one.channel.name for one in found if one.std is None]
        if stated and lacking:
            raise InputError(
                f"no std of {', '.join(lacking)}",
                "the deviation of every channel, or of none where speeds were read twice",
                "state it",
                place=f"channels.{lacking[0]}.std",
            )
        std = np.column_stack(stated) if stated else None
        probes = [k for k, name in enumerate(entries) if name not in plan.model.inputs]
        names, known = [list(entries)[k] for k in probes], None if std is None else std[:, probes]
        checks = list(check_probes(names, phasors[:, probes], known))
        for name, one in entries.items():
            if one.polar:
                place, factor = f"channels.{name}.phase", si_factor(one.phase_unit, "rad")
                turned = rows.si(one.phase or "", one.phase_unit, "rad", place)
                checks += check_phases(name, turned / factor, degrees=factor < 1)
        channels, source = [one.channel for one in found], table.file
        told: dict[str, Any] = {"source": source, "checks": checks, "same_speed": entry.same_speed}
        return [phasor_lines(channels, found[0].axis, phasors, std, **told)]


def read_responses(plan: Recording) -> list[Lines]:
    """Read frequency responses; those to one input, on one grid of frequencies, share lines."""
    entry, entries, paths = plan.entry, plan.channels, plan.paths
    stored = [name for name, one in entries.items() if one.column is not None]
    if stored and len(stored) < len(entries):
        raise InputError(
            f"a column in {stored[0]}, none in {next(n for n in entries if n not in stored)}",
            "responses of universal files, or columns of a table",
            "put them into records of their own",
            place=f"channels.{stored[0]}",
        )
    with naming(", ".join(map(str, paths))):
        if stored and entry.rows is not None:
            cure = "remove rows: its responses are chosen by the column of each channel"
            raise InputError("rows of a universal file", "rows of a table", cure, place="rows")
        if stored:
            found = _of_universal(plan)
        elif entry.frequency is None:
            expected = "the column of the frequencies of the rows"
            cure = 'write frequency = { column = "f", unit = "Hz" }'
            raise InputError("no frequency", expected, cure, place="frequency")
        else:
            rows = Columns(open_tables(paths, header_row=entry.header_row), entry)
            hertz = rows.si(entry.frequency.column, entry.frequency.unit, "Hz", "frequency")
            found = _of_table(plan, rows, hertz)
        return [_lines(group, plan) for group in _groups(found)]


def _of_universal(plan: Recording) -> list[_Read]:
    stored: dict[str, StoredResponse] = {}
    for path in plan.paths:
        stored |= formats.read_responses(path)
    found = list[_Read]()
    for name, one in plan.channels.items():
        place, channel, std = f"channels.{name}", plan.sources[name].channel(name), None
        data = stored.get(one.column or "")
        if data is None:
            raise InputError(
                f"no response {one.column!r:.62}",
                f"one of {', '.join(list(stored)[:12])}{' ..' if len(stored) > 12 else ''}",
                "name node and direction of the response, then of the force",
                place=f"{place}.column",
            )
        _check_derivative(data.derivative, name, one)
        unit = unit_of(one.unit, data.unit, plan.entry.overrule, f"{place}.unit")
        if unit is None:
            raise InputError(
                "no unit, here or in the file", "the unit of the response", "write it", place=place
            )
        scale = 1.0 if one.scale is None else to_si(one.scale, "1", place=f"{place}.scale")
        factor = scale * reading_factor(name, one, unit, plan.model)
        check_magnitude(largest_of(np.abs(data.values)), abs(factor), place)
        with np.errstate(invalid="ignore"):  # what is not finite is told with its line
            values = np.asarray(data.values * factor, dtype=np.complex128)
        if one.std is not None:
            std = np.full(len(values), to_si(one.std, _unit(plan, name), place=f"{place}.std"))
        values = values.conj() if one.lag else values
        found.append(_Read(one.input, channel, data.frequency, values, std, data.coherence))
    return found


def _check_derivative(found: str | None, name: str, entry: ChannelEntry) -> None:
    """Refuse a sensor of positions where the file says that accelerations were measured."""
    reads = entry.reads or name
    said = reads.count("'") and max(len(part) - len(part.rstrip("'")) for part in reads.split())
    if found is None or said == len(found):
        return
    kinds = ("a displacement", "a velocity", "an acceleration")
    raise InputError(
        f"{kinds[len(found)]} in the file, where the channel reads {reads}",
        f"a sensor of {kinds[len(found)]}",
        f'a channel of a name of its own with reads = "{reads.rstrip(chr(39))}{found}"',
        place=f"channels.{name}",
    )


def _groups(found: Sequence[_Read]) -> list[list[_Read]]:
    """Return the responses that share an input, a grid of frequencies and a kind of noise."""
    for one in found:
        if one.std is None and one.coherence is None:
            raise InputError(
                "neither std nor coherence",
                "what tells the noise of the response",
                "write coherence beside it, with averages in the record; or std",
                place=f"channels.{one.channel.name}",
            )
    grids = (np.round(one.axis, 9).tobytes() for one in found)
    kinds = ((one.input, grid, one.std is None) for one, grid in zip(found, grids, strict=True))
    return list(grouped(zip(kinds, found, strict=True)).values())


def _lines(group: Sequence[_Read], plan: Recording) -> Lines:
    entry, driven, hertz = plan.entry, group[0].input or "", group[0].axis
    low, high = (0.0, np.inf) if entry.band is None else entry.band
    kept = np.flatnonzero((hertz >= low) & (hertz <= high))[:: entry.every]
    if not len(kept):
        expected = f"a band within {hertz.min():g} to {hertz.max():g} Hz"
        cure = "correct band"
        raise InputError(f"no line from {low:g} to {high:g} Hz", expected, cure, place="band")
    std = [one.std[kept] for one in group if one.std is not None]
    coherence = [one.coherence[kept] for one in group if one.coherence is not None]
    return response_lines(
        Channel(driven, plan.model.units[driven]),
        [one.channel for one in group],
        hertz[kept],
        np.column_stack([one.values[kept] for one in group]),
        std=np.column_stack(std) if std else None,
        coherence=np.column_stack(coherence) if coherence else None,
        averages=entry.averages,
        speed=entry.speed.value,
        window=entry.window,
        spacing=line_spacing(hertz),
        source=entry.paths[0],
    )
