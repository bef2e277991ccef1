"""``rotorid sensitivity``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.commands import OK
from rotorid.commands.console import Outputs, done
from rotorid.core.errors import InputError, naming
from rotorid.core.files import check_apart
from rotorid.core.watch import watch
from rotorid.data.record import Channel, PeriodicRecord, Record, changed
from rotorid.experiment import Experiment, load_experiment
from rotorid.experiment.read import Recording, measured, periods_of, reference_name
from rotorid.force.laws import Linear
from rotorid.io import open_tables
from rotorid.io.columns import Source
from rotorid.report.machines import sensitivity_page, sensitivity_report
from rotorid.results.sensitivity import sensitivity, worst_of

_FIGURES = (
    *("axis", "peak", "peak_db", "peak_hz", "interval", "zone"),
    *("frequency_hz", "sensitivity", "std"),
)


def run(experiment: Path, pair: Sequence[str], answer: Outputs) -> int:
    targets = answer.check()
    watch("reading")
    plan = load_experiment(experiment)
    plan.require_records()
    check_apart(targets, plan.files)
    place = "--pair" if pair else "records.{}.references"
    records, named, options = _read(plan, _pairs(plan, pair), place)
    with naming(str(experiment)):
        watch("computing")
        found = sensitivity(records, named, **options)

    def html() -> str:
        return sensitivity_report(found, experiment.name, done(answer.given, plan.files))

    axes = [{key: getattr(each, key) for key in _FIGURES} for each in found]
    data = {"axes": axes, "verdict": worst_of(found)}
    answer.give(sensitivity_page(found), data, html)
    return OK


def _pairs(plan: Experiment, given: Sequence[str]) -> list[dict[str, str]]:
    """Return the channel of e of each axis, or its column, and the column of r, of each record.

    A record has the pairs of those axes whose r it holds. The samples tell the axis of a single
    reference, "" here.
    """
    if given:
        pairs = [[part.strip() for part in text.partition("=")[::2]] for text in given]
        for pair, text in zip(pairs, given, strict=True):
            if not all(pair):
                raise InputError(
                    f"{text[:60]!r}",
                    "a channel and the column of its reference",
                    "write --pair F_x1=r_x1",
                    place="--pair",
                )
        tables = (open_tables(p.paths, header_row=p.entry.header_row) for p in plan.channels)
        held = [table.names for table in tables]
        lost = {r for _, r in pairs if not any(r in names for names in held)}  # refused when read
        named = [[(e, r) for e, r in pairs if r in names or r in lost] for names in held]
        if twice := {e for own in named for e, r in own if dict(own)[e] != r}:
            expected, cure = "one of an input in each record", "give one of them"
            raise InputError(f"two references of {min(twice)}", expected, cure, place="--pair")
        return [dict(own) for own in named]
    inputs, listed = plan.model.inputs, [one.references or [] for one in plan.entry.records]
    if not all(listed):
        raise InputError(
            "no columns of what was added to the commands",
            "them beside the commands behind the sum: S is the ratio of the two",
            'name them, --pair F_x1=r_x1, or of a whole record references = ["r_x1", ..]; where '
            "they were not recorded, rid.loop_sensitivity takes an identified plant and the "
            "controller's response",
            file=plan.file,
            place="records.0.references",
        )
    if wrong := {len(references) for references in listed} - {1, len(inputs)}:
        raise InputError(
            f"{min(wrong)} references for {len(inputs)} inputs",
            "one for each, in the order of the inputs, or that of the one axis that was excited",
            "name these, or pairs: --pair F_x1=r_x1",
            file=plan.file,
            place="records.0.references",
        )
    return [dict(zip(inputs if len(r) == len(inputs) else ("",), r, strict=True)) for r in listed]


def _read(
    plan: Experiment, pairs: Sequence[Mapping[str, str]], place: str
) -> tuple[Sequence[PeriodicRecord] | Sequence[Record], dict[str, str], dict[str, Any]]:
    """Return the records, the channel of r of each command in all of them, and band and skip."""
    entries = plan.entry.records
    if len({entry.made == "periods" for entry in entries}) > 1:
        found = "records of periods beside whole ones"
        cure = "an experiment file for each"
        raise InputError(found, "one or the other", cure, file=plan.file, place="records")
    commands = dict.fromkeys(e for own in pairs for e in (plan.model.inputs if "" in own else own))
    read = list[tuple[Record, Mapping[str, str]]]()
    for number, (channels, own) in enumerate(zip(plan.channels, pairs, strict=True)):
        entry = channels.entry
        if entry.made not in ("periods", "whole"):
            raise InputError(
                "a record that is no samples of an excitation",
                "periods, or a whole record with its band",
                "leave it out",
                file=plan.file,
                place=f"records.{number}",
            )
        record = measured(channels, _beside(channels, own, commands, place.format(number)))
        if "" in own:
            own = {_axis_of(record, own[""], [*commands], entry.band): own[""]}
        read.append((record, own))
    named = {e: reference_name(f" of {e}") for e in commands if any(e in own for _, own in read)}
    records = [_complete(record, own, named) for record, own in read]
    if entries[0].made == "periods":
        cut = [periods_of(record, entry) for record, entry in zip(records, entries, strict=True)]
        return cut, named, {}
    return records, named, {"band": entries[0].band, "skip": float(entries[0].skip or 0.0)}


def _complete(record: Record, own: Mapping[str, str], named: Mapping[str, str]) -> Record:
    """Return a record with what was added to each command, zeros where it has nothing of it."""
    none = np.zeros(len(record.samples))
    added = [record.column(reference_name(own[e])) if e in own else none for e in named]
    channels = (*record.channels, *map(Channel, named.values()))
    return changed(record, channels=channels, samples=np.column_stack([record.samples, *added]))


def _axis_of(
    record: Record, reference: str, inputs: Sequence[str], band: tuple[float, float] | None
) -> str:
    """Return the command that holds a reference itself at the top of the band, where S is 1."""
    hertz = np.fft.rfftfreq(len(record.samples), 1 / record.sample_rate)
    low, high = band or (0.0, float(hertz[-1]))
    top = np.fft.rfft(record.samples, axis=0)[(hertz > (low + high) / 2) & (hertz <= high)]
    r = top[:, record.names.index(reference_name(reference))]
    return min(inputs, key=lambda e: float(abs(np.vdot(r, top[:, record.names.index(e)] - r))))


def _beside(
    channels: Recording, pairs: Mapping[str, str], commands: Iterable[str], place: str
) -> dict[str, Source]:
    """Return where the references come from, in the unit and with the scale of their commands."""
    found = {}
    for e in commands:
        command = channels.sources.get(e)
        if e in channels.laws and not isinstance(channels.laws[e].law, Linear):
            raise InputError(
                f"{e}, a force that is made of currents or fluxes",
                "the command behind the sum",
                "name its column: --pair COMMAND=REFERENCE",
                place=place,
            )
        if command is None:
            found[e] = command = Source(e, place=place)
        said = (command.unit, command.scale, command.expected)
        if (r := pairs.get(e, pairs.get(""))) is not None:
            found[reference_name(r)] = Source(r, *said, overrule=command.overrule, place=place)
    return found
