"""From the entries of an experiment file to a record, checked before any file is read."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.units import check_unit, converts, multiply_units, si_factor
from rotorid.core.values import Complexes, Floats, frozen, grouped
from rotorid.data.lines import Lines
from rotorid.data.record import Channel, PeriodicRecord, Record, changed
from rotorid.data.whole_record import spectra
from rotorid.experiment.schema import ChannelEntry, DynamicsEntry, Recorded, RecordEntry, RecordKeys
from rotorid.force.channel_dynamics import Dynamics, EddyCurrents, FirstOrder, Measured, SecondOrder
from rotorid.force.laws import Flux, Law, Linear
from rotorid.force.reading import ForceReading, driven, through_laws
from rotorid.io import Source, open_table, read_record
from rotorid.io.columns import open_blocks
from rotorid.io.table import ColumnFile
from rotorid.models import Model
from rotorid.models.equations import DERIVATIVES, linear_combination
from rotorid.signals.angle import encoder_angle, mark_angle
from rotorid.signals.average import RecordBlocks, average, average_blocks
from rotorid.signals.checks.periods import detect_settling
from rotorid.signals.checks.rotation import rotation_warnings

Entries = Mapping[str, ChannelEntry]
_ANGLES = ("deg", "rad")
_POLAR = re.compile(r"(?:phase|phi|angle|arg)(?![a-z])", re.I)


@frozen
class Recording:
    """A record as the file has it: where its columns come from, and what is made of them."""

    number: int  # in the file, from 0
    entry: RecordEntry
    model: Model
    folder: Path  # of its files
    channels: Entries
    sources: Mapping[str, Source]
    # of inputs: the columns that they are made of by name, the displacement by coordinates
    laws: Mapping[str, ForceReading]
    # parameters that it has to itself: value and deviation, SI
    own: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    currents: bool = True  # those of linear laws stay; else they become forces

    @property
    def paths(self) -> list[Path]:
        return [self.folder / name for name in self.entry.paths]

    @property
    def place(self) -> str:
        return f"records.{self.number}"

    @property
    def undriven(self) -> list[str]:
        """Inputs on which nothing acts: they have no column."""
        return [name for name, source in self.sources.items() if source.scale == 0]


_UNIT_OF = {
    "samples": "the unit of the sensor",
    "phasors": "the unit of the amplitude",
    "responses": "the unit of the response, such as um/N",
}


def source(name: str, entry: ChannelEntry, model: Model, folder: Path) -> Source:
    """Return where a channel without force law comes from; a table is looked for in `folder`."""
    place, kind = f"channels.{name}", entry.kind
    quantities = (*model.inputs, *model.coordinates, *model.readings)
    if entry.input is not None:
        told = "{}, which is no input of the model"
        require_names([entry.input], model.inputs, told, place=f"{place}.input")
    if entry.reads is None:
        told = "{}, which is no input or coordinate of the model"
        require_names([name], quantities, told, place=place)
    elif name in quantities:
        raise InputError(
            f"reads in the channel of {name}",
            "a name of its own for a sensor of a combination",
            "rename the channel",
            place=place,
        )
    if entry.scale == 0 and (name not in model.inputs or kind != "samples"):
        raise InputError(
            "0",
            "a scale other than 0; only of an input of samples it says that nothing acts there",
            "write what turns the column into its unit, or leave the channel out",
            place=f"{place}.scale",
        )
    reads = _combination(entry, model, place)
    stated = entry.column is not None and (kind == "responses" or reads is None)
    if entry.unit is None and not stated and entry.scale != 0:
        raise InputError("no unit", _UNIT_OF[kind], "write it", place=f"{place}.unit")
    expected = model.units.get(name)
    if entry.polar:
        si_factor(entry.phase_unit, "rad", place=f"{place}.phase_unit")
    if kind == "responses":
        expected = reading_unit(name, entry, model)
    if entry.unit is not None and kind == "responses":
        reading_factor(name, entry, entry.unit, model)
    elif entry.unit is not None and kind == "phasors":
        si_factor(entry.unit, expected, place=f"{place}.unit")
        expected = expected or check_unit(entry.unit)
    dynamics = dynamics_of(entry.dynamics, actuator=name in model.inputs, folder=folder)
    return replace(_as_recorded(entry, expected, dynamics), reads=reads, alone=True)


def reading_unit(name: str, entry: ChannelEntry, model: Model) -> str:
    """Return the SI unit of what a channel reads, that of its first term."""
    reads = _combination(entry, model, f"channels.{name}") or {name: 1.0}
    *levers, moving = next(iter(reads)).split("*")
    units = [(model.units[moving.rstrip("'")], 1), ("s", -moving.count("'"))]
    return multiply_units(units + [(model.parameter_units[lever], 1) for lever in levers])


def reading_factor(name: str, entry: ChannelEntry, stated: str, model: Model) -> float:
    """Return the number that turns a response into SI; a derivative of another order is told."""
    place, over = f"channels.{name}.unit", model.units[entry.input or ""]
    reading = reading_unit(name, entry, model)
    expected = f"({reading})/({over})"
    try:
        return si_factor(stated, expected)
    except InputError as error:
        read = entry.reads or name
        plain = read.rstrip("'")
        for order, dots in enumerate(DERIVATIVES):
            other = multiply_units([(model.units.get(plain, reading), 1), ("s", -order)])
            if plain in model.coordinates and converts(stated, f"({other})/({over})"):
                raise InputError(
                    f"unit {stated!r} of a response that reads {read}",
                    f"a unit that converts to {expected}",
                    f'a channel of a name of its own with reads = "{plain}{dots}"',
                    place=place,
                ) from None
        raise error.at(place=place) from None


def _as_recorded(entry: Recorded, expected: str | None, dynamics: Dynamics | None) -> Source:
    return Source(
        column=entry.column or "",
        unit=entry.unit,
        scale=entry.scale,
        offset=str(entry.offset) if entry.offset else 0.0,
        expected=expected,
        hold=entry.hold == "zero-order",
        delay=entry.delay.value,
        delay_std=entry.delay.std or 0.0,
        gain_std=entry.gain_std,
        dynamics=dynamics,
    )


def _combination(entry: ChannelEntry, model: Model, place: str) -> dict[str, float] | None:
    """Return what a sensor reads, by dotted coordinates, or products of them with parameters."""
    names, text = ((*model.coordinates, *model.readings), model.parameter_names), entry.reads
    if text is None:
        return None
    return linear_combination(text, *names, derivatives=True, place=f"{place}.reads")


def dynamics_of(
    entry: DynamicsEntry | None, *, actuator: bool, folder: Path = Path()
) -> Dynamics | None:
    if entry is None:
        return None
    own = actuator if entry.of is None else entry.of == "actuator"
    common: dict[str, Any] = {"actuator": own, "shared": entry.shared}
    if entry.table is not None:
        hertz, measured = _response(open_table(folder / entry.table))
        return Measured(frequency=hertz, measured=measured, **common)
    if entry.eddy is not None:
        return EddyCurrents(eddy=entry.eddy, **common)
    assert entry.bandwidth is not None  # the schema sees to it
    if entry.damping is None:
        return FirstOrder(bandwidth=entry.bandwidth, **common)
    return SecondOrder(bandwidth=entry.bandwidth, damping=entry.damping, **common)


def _response(table: ColumnFile) -> tuple[Floats, Complexes]:
    """Return Hz and the response, of parts or amplitude and phase, by the units in the head."""
    with naming(table.file):
        names = list(table.names)
        if len(names) != 3:
            expected = "frequency in Hz, real part, imaginary part"
            raise InputError(f"{len(names)} columns", expected, "write these three columns")
        read = table.read(names)
        units, columns = [read[n].unit for n in names], [read[n].values for n in names]
        hertz = columns[0] * si_factor(units[0] or "Hz", "Hz")
        polar = units[2] in _ANGLES or _POLAR.match(names[2]) is not None
        if any("dB" in (text or "") for text in (*names, *units)) or (polar and units[2] is None):
            pairs = zip(names, units, strict=True)
            shown = (name if unit is None else f"{name} [{unit}]" for name, unit in pairs)
            expected = "frequency, then real and imaginary part, or amplitude and phase [deg]"
            cure = "write such columns, a phase with its unit"
            raise InputError(f"columns {', '.join(shown)}"[:200], expected, cure)
        if polar:
            angle = columns[2] * si_factor(units[2] or "rad", "rad")
            return hertz, np.asarray(columns[1] * np.exp(1j * angle))
        return hertz, np.asarray(columns[1] + 1j * columns[2])


def law_sources(
    name: str, entry: ChannelEntry, entries: Entries, model: Model, folder: Path
) -> tuple[dict[str, Source], ForceReading]:
    place = f"channels.{name}"
    if name not in model.inputs:
        expected = f"an input of the model ({', '.join(model.inputs)})"
        cure = "give laws to inputs only"
        raise InputError(f"a force law for {name}", expected, cure, place=place)
    with naming(place=place):
        law, position = entry.build(), _position(entry, entries, model)
    columns, linear = entry.recorded, isinstance(law, Linear)
    if linear and law.std.get("ks"):
        expected = "ks as it is, or as an unknown"
        cure = 'leave std out, or estimate it: gains = ["ks"]'
        raise InputError("a deviation of ks", expected, cure, place=f"{place}.ks")
    labels = [name] if linear else [f"{name}[{i}]" for i in range(len(columns))]
    unit = "T" if isinstance(law, Flux) else "A"
    sources = {
        label: _as_recorded(column, unit, _law_dynamics(law, column.dynamics, folder, place))
        for label, column in zip(labels, columns, strict=True)
    }
    return sources, ForceReading(law, tuple(labels), position)


def _law_dynamics(
    law: Law, entry: DynamicsEntry | None, folder: Path, place: str
) -> Dynamics | None:
    """Return the dynamics of a law's column: of a current; known, where the law bends."""
    bends = not isinstance(law, Linear)
    if entry is not None and (isinstance(law, Flux) or (bends and entry.uncertain)):
        raise InputError(
            "dynamics of a flux" if isinstance(law, Flux) else "unknown dynamics in a bent law",
            "known dynamics of a current",
            "take the linear law, measure the current behind the amplifier, or its response",
            place=f"{place}.dynamics",
        )
    return dynamics_of(entry, actuator=True, folder=folder)


def _position(entry: ChannelEntry, entries: Entries, model: Model) -> dict[str, float]:
    if entry.position is None:
        return {}
    read = {name: _combination(one, model, f"channels.{name}") for name, one in entries.items()}
    sensors = {name: reads for name, reads in read.items() if reads is not None}
    known = list(dict.fromkeys((*model.coordinates, *sensors)))
    total: dict[str, float] = {}
    parts = linear_combination(entry.position, known, model.parameter_names, place="position")
    for product, factor in parts.items():
        *levers, name = product.split("*")
        for coordinate, share in sensors.get(name, {name: 1.0}).items():
            text = "*".join([*levers, coordinate])
            total[text] = total.get(text, 0.0) + factor * share
    return {name: value for name, value in total.items() if value}


def columns_of(entry: ChannelEntry) -> tuple[tuple[str, ...], ...]:
    """Return what a channel is read from: a column, the two of a phasor, or each of its law's."""
    if entry.scale == 0:  # nothing acts there: it needs none
        return ()
    if entry.law is not None:
        return tuple((column.column.strip("/"),) for column in entry.columns)
    if entry.column is not None:
        return ((entry.column.strip("/"),),)
    return (tuple(str(getattr(entry, part)) for part in entry.parts),)


def check_columns(entries: Entries) -> None:
    """Refuse one column for two channels; force laws may share a current: coils in series."""
    taken: dict[tuple[str, ...], str] = {}
    for name, entry in entries.items():
        for column in columns_of(entry):
            other = taken.setdefault(column, name)
            series = entry.law is not None and entries[other].law is not None and other != name
            if (other != name or columns_of(entry).count(column) > 1) and not series:
                raise InputError(
                    f"{' and '.join(map(repr, column))} for {other} and for {name}",
                    "a column of its own for each channel",
                    "write the name of the right column; a sensor that sees several coordinates is "
                    "one channel with reads, a force that acts on several one input of the model",
                    place=f"channels.{name}",
                )


def shared_currents(plan: Recording) -> tuple[str, ...]:
    read = ((plan.sources[i].column, name) for name, law in plan.laws.items() for i in law.channels)
    users = grouped((column.strip("/"), name) for column, name in read)
    return tuple(
        f"the current {column[:60]!r} drives {' and '.join(names)}: right for coils in series only"
        for column, names in users.items()
        if len(names) > 1
    )


_MARK = "the mark of the rotor angle"
_REFERENCE = "reference "


def check_shared(records: Sequence[RecordEntry], common: Entries) -> None:
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
    number: int, record: RecordEntry, common: Entries, model: Model, folder: Path
) -> Recording:
    """Return where the channels of a record come from, everything checked but the files."""
    kind, own, place = record.channel_kind, record.channels, f"records.{number}"
    if model.linear is None and record.made == "whole":
        raise InputError(
            "the lines of a whole record for a model that is not linear in its coordinates",
            "periods, or samples that are filtered",
            'write cutoff = "100 Hz" in place of band (five to ten times the frequencies '
            "of the motion), or the fundamental of a periodic excitation",
            place=f"{place}.band",
        )
    for name, entry in own.items():
        if entry.kind != kind:
            found = f"a channel of {entry.kind} in a record of {kind}"
            cure = "move the channel to a record of its kind, or give this record that kind"
            raise InputError(found, f"a channel of {kind}", cure, place=f"{place}.channels.{name}")
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
    return Recording(number, record, model, folder, entries, sources, laws)


def measured(plan: Recording, beside: Mapping[str, Source] | None = None) -> Record:
    """Read the samples of a record, and columns `beside` those of its channels."""
    entry, columns = plan.entry, {**plan.sources, **(beside or {})}
    if entry.angle is not None:
        unit, there = entry.angle.unit, f"{plan.place}.angle"
        expected = "rad" if unit else None
        columns[_MARK] = Source(entry.angle.column, unit, expected=expected, place=there)
    elif entry.keyphasor is not None:
        columns[_MARK] = Source(entry.keyphasor, place=f"{plan.place}.keyphasor")
    for name in entry.references or ():
        columns.setdefault(reference_name(name), Source(name, place=f"{plan.place}.references"))
    highest = entry.cutoff if entry.band is None else entry.band[1]
    if entry.band is None and entry.fundamental is not None and entry.harmonics:
        highest = max(entry.harmonics) * entry.fundamental
    columns = {name: column for name, column in columns.items() if name not in plan.undriven}
    record = read_record(
        plan.paths,
        columns=columns,
        skip=entry.skip or 0.0,
        mask=entry.mask,
        highest=highest,
        **said_of(entry),
    )
    zeros = np.zeros((len(record.samples), len(plan.undriven)))
    added = (*record.channels, *(Channel(n, plan.model.units[n]) for n in plan.undriven))
    record = replace(record, channels=added, samples=np.column_stack([record.samples, zeros]))
    record, period = _with_angle(record, entry), period_of(record, entry)
    return through_laws(record, plan.laws, currents=plan.currents, period=period)


def reference_name(column: str) -> str:
    """Return the name of the channel of a reference: no name of a model, whatever the column."""
    return f"{_REFERENCE}{column}"


def is_reference(name: str) -> bool:
    return name.startswith(_REFERENCE)


def lines_of(plan: Recording, record: Record) -> Lines:
    entry, quiet = plan.entry, None
    assert entry.band is not None  # the schema sees to it
    if entry.quiet is not None:
        still = entry.model_copy(update={"file": entry.quiet, "files": None, "quiet": None})
        quiet = measured(replace(plan, entry=still))
    lines = spectra(
        record,
        entry.band,
        references=[reference_name(name) for name in entry.references or ()],
        quiet=quiet,
        inputs=plan.model.inputs,
        skip=entry.skip or 0.0,
    )
    return replace(lines, warnings=(*record.warnings, *lines.warnings))


def said_of(entry: RecordKeys) -> dict[str, Any]:
    keys = ("sample_rate", "phase", "until", "fundamental", "header_row", "overrule")
    time = None if entry.time is None else Source(entry.time.column, entry.time.unit)
    return {key: getattr(entry, key) for key in keys} | {"time": time, "speed": entry.speed.value}


Watch = Callable[[Record | RecordBlocks], Callable[[Floats], None]]
"""Called with a record before its samples are read; returns what looks at these."""


def averaged(plan: Recording, watch: Watch) -> PeriodicRecord:
    """Read a record and cut it into periods; a large one in blocks."""
    entry, blocks = plan.entry, None
    marked = entry.angle is not None or entry.keyphasor is not None
    made = any(not (plan.currents and isinstance(law.law, Linear)) for law in plan.laws.values())
    made |= bool(plan.undriven)
    if not (marked or made or entry.mask is not None):  # else its samples are needed side by side
        blocks = open_blocks(plan.paths, columns=plan.sources, **said_of(entry))
    if blocks is None:
        record = measured(plan)
        watch(record)(record.samples)
        return periods_of(record, entry)

    def read() -> Iterator[Floats]:
        look = watch(blocks)
        for block in blocks.read():
            look(block)
            yield block

    watched = replace(blocks, channels=driven(blocks.channels, plan.laws), read=read)
    return _settled(partial(average_blocks, watched, phase_known=entry.phase is not None), entry)


def period_of(record: Record, entry: RecordKeys) -> int | None:
    if entry.period_samples is not None or entry.fundamental is None:
        return entry.period_samples
    return round(record.sample_rate / entry.fundamental)


def _with_angle(record: Record, entry: RecordEntry) -> Record:
    if _MARK not in record.names:
        return record
    (bare, column), rate = without_mark(record, _MARK), record.sample_rate
    if entry.angle is not None:
        lines = entry.angle.lines
        turn = float(lines or 1) if entry.angle.unit is None else 2 * np.pi
        turned = encoder_angle(column, rate, per_revolution=turn, lines=lines, source=record.source)
    else:
        turned = mark_angle(column, rate, source=record.source)
    # Nobody measures the time between mark and columns: filters before the logger delay the columns
    # and not the mark. Unless the file says better, it is taken to lie anywhere within a sample.
    lag_std = entry.angle_lag_std
    if lag_std is None:
        lag_std = 1 / (rate * np.sqrt(12))
    phase_std = float(np.hypot(turned.angle_std, abs(turned.speed) * lag_std))
    return replace(bare, speed=turned.speed, angle=turned.angle, phase_std=phase_std)


def without_mark(record: Record, name: str) -> tuple[Record, Floats]:
    channels = tuple(c for c in record.channels if c.name != name)
    samples = np.delete(record.samples, record.names.index(name), axis=1)
    return replace(record, channels=channels, samples=samples), record.column(name)


def periods_of(record: Record, entry: RecordEntry) -> PeriodicRecord:
    periods = _settled(partial(average, record), entry)
    return changed(periods, warnings=(*record.warnings, *periods.warnings))


def _settled(cut: Callable[..., PeriodicRecord], entry: RecordEntry) -> PeriodicRecord:
    """Drop the transient of a record where the file does not say what to skip."""
    keys = "fundamental", "period_samples", "harmonics", "band"
    cut = partial(cut, **{key: getattr(entry, key) for key in keys})
    periods = cut(skip=entry.skip or 0.0)
    found = detect_settling(periods)
    warnings = []
    if found.periods:
        if entry.skip is None:
            periods = cut(skip=found.drop)
            warnings.append(f"{found.told}: the first {found.drop:g} s are dropped")
        else:
            after = f"after skip = {entry.skip:g} s: skip {found.drop:g} s more"
            warnings.append(f"{found.told}, {after}")
    if periods.rotation is None:
        warnings += rotation_warnings(periods)
    return changed(periods, warnings=(*periods.warnings, *warnings))
