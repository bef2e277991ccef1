"""From the entries of an experiment file to a record: columns, force laws, rotor angle."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, naming
from rotorid.core.values import Floats
from rotorid.data.filtered import FilteredRecord, filtered
from rotorid.data.lazy_time import changed
from rotorid.data.lines import Lines
from rotorid.data.record import Channel, Drive, PeriodicRecord, Record
from rotorid.data.whole_record import spectra
from rotorid.experiment.channels import (
    Entries,
    Recording,
    check_columns,
    law_sources,
    source,
)
from rotorid.experiment.schema import RecordEntry, RecordKeys
from rotorid.force.laws import Linear
from rotorid.force.reading import ForceReading, as_channels, forces
from rotorid.io import Source, read_record
from rotorid.io.columns import open_blocks
from rotorid.models import Model
from rotorid.signals.angle import encoder_angle, keyphasor_angle, pulse_edges
from rotorid.signals.average import RecordBlocks, average, average_blocks
from rotorid.signals.checks.periods import detect_settling
from rotorid.signals.checks.rotation import rotation_warnings

_MARK = "the mark of the rotor angle"
_REFERENCE = "reference "


def check_shared(records: Sequence[RecordEntry], common: Entries) -> None:
    """Refuse channels in `[channels]` of a kind that no record is of."""
    kinds = {record.channel_kind for record in records}
    for name, entry in common.items():
        if entry.kind not in kinds:
            raise InputError(
                f"a channel of {entry.kind} that no record takes",
                f"a channel of {' or '.join(sorted(kinds))}",
                "leave the channel out, or give a record its kind",
                place=f"channels.{name}",
            )


def plan_record(
    record: RecordEntry, common: Entries, model: Model, folder: Path, place: str
) -> Recording:
    """Return where the channels of a record come from, everything checked but the files.

    Of the channels that all records share, those of another kind are not this record's.
    """
    kind, own = record.channel_kind, record.channels
    for name, entry in own.items():
        if entry.kind != kind:
            raise InputError(
                f"a channel of {entry.kind} in a record of {kind}",
                f"a channel of {kind}",
                "move the channel to a record of its kind, or give this record that kind",
                place=f"{place}.channels.{name}",
            )
    entries = {name: entry for name, entry in common.items() if entry.kind == kind} | own
    check_columns(entries)
    if not entries and kind != "samples":
        raise InputError(f"no channel of {kind}", "one or more", "add them", place="channels")
    sources: dict[str, Source] = {}
    laws: dict[str, ForceReading] = {}
    for name, entry in entries.items():
        with naming(place=place if name in own else ""):
            if entry.law is None:
                sources[name] = source(name, entry, model, folder)
            else:
                columns, laws[name] = law_sources(name, entry, entries, model, folder)
                sources |= columns
    return Recording(record, folder, entries, sources, laws)


def measured(
    plan: Recording, *, currents: bool, beside: Mapping[str, Source] | None = None
) -> Record:
    """Read the samples of a record, with other channels beside those that its file names."""
    entry = plan.entry
    columns = dict(plan.sources)
    if entry.angle is not None:
        columns[_MARK] = Source(
            entry.angle.column, entry.angle.unit, expected="rad" if entry.angle.unit else None
        )
    elif entry.keyphasor is not None:
        columns[_MARK] = Source(entry.keyphasor)
    columns |= {reference_name(name): Source(name) for name in entry.references or ()}
    columns |= beside or {}
    record = read_record(
        plan.paths,
        columns=columns,
        skip=entry.skip or 0.0,
        mask=entry.mask,
        highest=_highest(entry),
        **said_of(entry),
    )
    record = _with_angle(record, entry)
    if plan.laws:
        record = replace(record, channels=_driven(record.channels, plan))
    return forces(
        record, _readings(record, plan), drives=not currents, period=period_of(record, entry)
    )


def reference_name(column: str) -> str:
    """Return the name of the channel of a reference: no name of a model, whatever the column."""
    return f"{_REFERENCE}{column}"


def is_reference(name: str) -> bool:
    return name.startswith(_REFERENCE)


def lines_of(plan: Recording, record: Record, model: Model, *, currents: bool) -> Lines:
    """Return the lines of a whole record, its noise from what the file names."""
    entry, quiet = plan.entry, None
    assert entry.band is not None  # the schema sees to it
    if entry.quiet is not None:
        still = entry.model_copy(update={"file": entry.quiet, "files": None, "quiet": None})
        quiet = measured(replace(plan, entry=still), currents=currents)
    lines = spectra(
        record,
        entry.band,
        references=[reference_name(name) for name in entry.references or ()],
        quiet=quiet,
        inputs=model.inputs,
        skip=entry.skip or 0.0,
    )
    return replace(lines, warnings=(*record.warnings, *lines.warnings))


def filtered_of(record: Record, entry: RecordEntry) -> FilteredRecord:
    """Return the samples of a record, low-passed and differentiated."""
    assert entry.cutoff is not None  # the schema sees to it
    return filtered(
        record,
        entry.cutoff,
        decimate=entry.decimate or 1,
        leave_out=entry.leave_out or (),
        skip=entry.skip or 0.0,
    )


def said_of(entry: RecordKeys) -> dict[str, Any]:
    """Return what an entry says of its files, for a reader of samples or of blocks."""
    return {
        "sample_rate": entry.sample_rate,
        "time": None if entry.time is None else Source(entry.time.column, entry.time.unit),
        "speed": entry.speed.value,
        "phase": entry.phase,
        "until": entry.until,
        "fundamental": entry.fundamental,
        "header_row": entry.header_row,
        "overrule": entry.overrule,
    }


Watch = Callable[[Record | RecordBlocks], Callable[[Floats], None]]
"""Called with a record before its samples are read; returns what looks at these."""


def averaged(plan: Recording, watch: Watch, *, currents: bool) -> PeriodicRecord:
    """Read a record and cut it into periods; a large one in blocks."""
    entry, blocks = plan.entry, _blocks(plan, currents=currents)
    if blocks is None:
        record = measured(plan, currents=currents)
        watch(record)(record.samples)
        return periods_of(record, entry)
    watched = replace(blocks, read=lambda: _watched(blocks, watch))
    return _settled(
        lambda skip: average_blocks(
            watched, skip=skip, phase_known=entry.phase is not None, **_chosen(entry)
        ),
        entry,
    )


def _watched(blocks: RecordBlocks, watch: Watch) -> Iterator[Floats]:
    """Yield blocks, each shown before it is used, from the first each time that they are read."""
    look = watch(blocks)
    for block in blocks.read():
        look(block)
        yield block


def _blocks(plan: Recording, *, currents: bool) -> RecordBlocks | None:
    """Return a record in blocks, where nothing needs its samples side by side."""
    entry = plan.entry
    marked = entry.angle is not None or entry.keyphasor is not None
    made = any(not (currents and isinstance(law.law, Linear)) for law in plan.laws.values())
    if marked or made or entry.mask is not None:
        return None
    blocks = open_blocks(plan.paths, columns=plan.sources, **said_of(entry))
    return None if blocks is None else replace(blocks, channels=_driven(blocks.channels, plan))


def _highest(entry: RecordEntry) -> float | None:
    """Return the frequency of the highest line in Hz, where the file tells it."""
    if entry.band is not None:
        return entry.band[1]
    if entry.cutoff is not None:
        return entry.cutoff
    if entry.fundamental is not None and entry.harmonics:
        return max(entry.harmonics) * entry.fundamental
    return None


def period_of(record: Record, entry: RecordKeys) -> int | None:
    if entry.period_samples is not None or entry.fundamental is None:
        return entry.period_samples
    return round(record.sample_rate / entry.fundamental)


def _with_angle(record: Record, entry: RecordEntry) -> Record:
    """Return the record without the column of its mark, with the angle from it."""
    if _MARK not in record.names:
        return record
    index = record.names.index(_MARK)
    column, rate, source_file = record.samples[:, index], record.sample_rate, record.source
    if entry.angle is not None:
        counts = entry.angle.unit is None and entry.angle.lines is not None
        turned = encoder_angle(
            column,
            rate,
            per_revolution=float(entry.angle.lines or 1) if counts else 2 * np.pi,
            lines=entry.angle.lines,
            source=source_file,
        )
    else:
        times, half = pulse_edges(column, rate, source=source_file)
        turned = keyphasor_angle(times, len(column), rate, half=half, source=source_file)
    # Nobody measures the time between mark and columns: filters before the logger delay the columns
    # and not the mark. Unless the file says better, it is taken to lie anywhere within a sample.
    lag_std = entry.angle_lag_std
    if lag_std is None:
        lag_std = 1 / (rate * np.sqrt(12))
    return replace(
        record,
        channels=tuple(c for c in record.channels if c.name != _MARK),
        samples=np.delete(record.samples, index, axis=1),
        speed=turned.speed,
        angle=turned.angle,
        phase_std=float(np.hypot(turned.angle_std, abs(turned.speed) * lag_std)),
    )


def _driven(channels: Sequence[Channel], plan: Recording) -> tuple[Channel, ...]:
    """Return the channels, those of linear laws with their drives."""
    found_channels = []
    for channel in channels:
        found = plan.laws.get(channel.name)
        if found is not None and isinstance(found.law, Linear):
            law = found.law
            channel = replace(
                channel,
                drive=Drive(law.ki, law.ks, found.position),
                gain_std=float(np.hypot(channel.gain_std, law.std.get("ki", 0.0) / abs(law.ki))),
            )
        found_channels.append(channel)
    return tuple(found_channels)


def _readings(record: Record, plan: Recording) -> dict[str, ForceReading]:
    """Return the laws that bend, the displacements in them by the channels that read them."""
    spent = {name for law in plan.laws.values() for name in law.channels}
    sensors = [c for c in record.channels if c.name in plan.sources and c.name not in spent]
    found = {}
    for name, reading in plan.laws.items():
        if not isinstance(reading.law, Linear):
            with naming(record.source, place=f"channels.{name}.position"):
                position = as_channels(sensors, reading.position) if reading.position else {}
            found[name] = replace(reading, position=position)
    return found


def read_table(plan: Recording, model: Model) -> Sequence[Lines]:
    """Read a record that is a table; responses to several inputs are several."""
    from rotorid.experiment import table_records  # which few records need

    read = (
        table_records.read_phasors if plan.entry.kind == "phasors" else table_records.read_responses
    )
    return read(plan, model)


def periods_of(record: Record, entry: RecordEntry) -> PeriodicRecord:
    """Cut a record into periods; drop its transient where the file does not say what to skip."""
    periods = _settled(lambda skip: average(record, skip=skip, **_chosen(entry)), entry)
    return changed(periods, warnings=(*record.warnings, *periods.warnings))


def _chosen(entry: RecordEntry) -> dict[str, Any]:
    return {
        "fundamental": entry.fundamental,
        "period_samples": entry.period_samples,
        "harmonics": entry.harmonics,
        "band": entry.band,
    }


def _settled(cut: Callable[[float], PeriodicRecord], entry: RecordEntry) -> PeriodicRecord:
    """Drop the transient of a record where the file does not say what to skip."""
    periods = cut(entry.skip or 0.0)
    found = detect_settling(periods)
    warnings = []
    if found.periods:
        if entry.skip is None:
            periods = cut(found.drop)
            warnings.append(f"{found.told}: the first {found.drop:g} s are dropped")
        else:
            after = f"after skip = {entry.skip:g} s: skip {found.drop:g} s more"
            warnings.append(f"{found.told}, {after}")
    return changed(periods, warnings=(*periods.warnings, *warnings, *rotation_warnings(periods)))
