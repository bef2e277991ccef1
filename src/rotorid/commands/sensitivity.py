"""``rotorid sensitivity``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rotorid.commands import OK
from rotorid.commands.console import Outputs, done
from rotorid.core.errors import InputError, naming
from rotorid.core.files import check_apart
from rotorid.core.watch import watch
from rotorid.data.record import PeriodicRecord, Record
from rotorid.experiment import Experiment, load_experiment
from rotorid.experiment.read import Recording, measured, periods_of, reference_name
from rotorid.force.laws import Linear
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
    pairs = _pairs(plan, pair)
    records, options = _read(plan, pairs)
    with naming(str(experiment)):
        watch("computing")
        named = {e: reference_name(r) for e, r in pairs.items()}
        found = sensitivity(records, named, **options)

    def html() -> str:
        return sensitivity_report(found, experiment.name, done(answer.given, plan.files))

    axes = [{key: getattr(each, key) for key in _FIGURES} for each in found]
    data = {"axes": axes, "verdict": worst_of(found)}
    answer.give(sensitivity_page(found), data, html)
    return OK


def _pairs(plan: Experiment, given: Sequence[str]) -> dict[str, str]:
    """Return the channel of e of each axis, or its column, and the column of r."""
    if given:
        pairs = [[part.strip() for part in text.partition("=")[::2]] for text in given]
        for pair, text in zip(pairs, given, strict=True):
            if not all(pair):
                raise InputError(
                    f"{text[:60]!r}",
                    "a channel and the column of its reference",
                    "write --pair F_x1=r_x1",
                    place="pair",
                )
        return {e: r for e, r in pairs}
    references = plan.entry.records[0].references or []
    if not references:
        raise InputError(
            "no columns of what was added to the commands",
            "them beside the commands behind the sum: S is the ratio of the two",
            'name them, --pair F_x1=r_x1, or of a whole record references = ["r_x1", ..]; where '
            "they were not recorded, rid.loop_sensitivity takes an identified plant and the "
            "controller's response",
            file=plan.file,
            place="records.0.references",
        )
    if len(references) != len(plan.model.inputs):
        raise InputError(
            f"{len(references)} references for {len(plan.model.inputs)} inputs",
            "one for each, in the order of the inputs",
            "name all, a column of zeros where none was added; or pairs: --pair F_x1=r_x1",
            file=plan.file,
            place="records.0.references",
        )
    return dict(zip(plan.model.inputs, references, strict=True))


def _read(
    plan: Experiment, pairs: Mapping[str, str]
) -> tuple[Sequence[PeriodicRecord] | Sequence[Record], dict[str, Any]]:
    entries = plan.entry.records
    if len({entry.made == "periods" for entry in entries}) > 1:
        raise InputError(
            "records of periods beside whole ones",
            "one or the other",
            "an experiment file for each",
            file=plan.file,
            place="records",
        )
    records = []
    for number, channels in enumerate(plan.channels):
        entry = channels.entry
        if entry.made not in ("periods", "whole"):
            raise InputError(
                "a record that is no samples of an excitation",
                "periods, or a whole record with its band",
                "leave it out",
                file=plan.file,
                place=f"records.{number}",
            )
        records.append(measured(channels, _beside(channels, pairs)))
    if entries[0].made == "periods":
        cut = [periods_of(record, entry) for record, entry in zip(records, entries, strict=True)]
        return cut, {}
    return records, {"band": entries[0].band, "skip": float(entries[0].skip or 0.0)}


def _beside(channels: Recording, pairs: Mapping[str, str]) -> dict[str, Source]:
    """Return where the references come from, in the unit and with the scale of their commands."""
    found, place = {}, "--pair"
    for e, r in pairs.items():
        command = channels.sources.get(e)
        if e in channels.laws and not isinstance(channels.laws[e].law, Linear):
            raise InputError(
                f"{e}, a force that is made of currents or fluxes",
                "the command behind the sum",
                "name its column: --pair COMMAND=REFERENCE",
                place="pair",
            )
        if command is None:
            found[e] = command = Source(e, place=place)
        said = (command.unit, command.scale, command.expected)
        found[reference_name(r)] = Source(r, *said, overrule=command.overrule, place=place)
    return found
