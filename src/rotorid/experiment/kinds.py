"""What kinds of records there are besides samples: tables, each with a reader of its own.

A kind is an entry of `_table`, a name in `schema.Kind`, and the keys by which its channels are
told (`ChannelEntry.kind`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rotorid.core.errors import InputError
from rotorid.data.lines import Lines
from rotorid.data.record import Channel
from rotorid.experiment.duplicates import check_columns
from rotorid.experiment.read import Recording, recording
from rotorid.experiment.schema import ChannelEntry, Kind, RecordEntry
from rotorid.models import Model

Entries = Mapping[str, ChannelEntry]
Reader = Callable[[Path, RecordEntry, Entries, Model], Sequence[Lines]]
Check = Callable[[Entries, Model, Path], Mapping[str, Channel]]


def _table(kind: str) -> tuple[Check, Reader]:
    """Return what checks the channels of a kind, and what reads its files; loaded when used."""
    from rotorid.experiment import tables

    return {
        "phasors": (tables.check_phasors, tables.read_phasors),
        "responses": (tables.check_responses, tables.read_responses),
    }[kind]


def check_own(record: RecordEntry, common: Entries, model: Model, folder: Path) -> None:
    wrong = [name for name, entry in record.channels.items() if entry.kind != record.channel_kind]
    if wrong:
        raise InputError(
            f"a channel of {record.channels[wrong[0]].kind} in a record of {record.channel_kind}",
            f"a channel of {record.channel_kind}",
            "move the channel to a record of its kind, or give this record that kind",
            place=f"channels.{wrong[0]}",
        )
    if record.channel_kind == "samples":
        recording(record.channels, model, _of_kind(common, record.channel_kind), folder)
    else:
        _table(record.channel_kind)[0](record.channels, model, folder)


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


def plan_record(record: RecordEntry, common: Entries, model: Model, folder: Path) -> Recording:
    """Return where the channels of a record come from, everything checked but the files.

    Of the channels that all records share, those of another kind are not this record's.
    """
    entries = own_entries(record, common)
    check_columns(entries)
    if record.channel_kind == "samples":
        return recording(entries, model, folder=folder)
    if not entries:
        raise InputError(
            f"no channel of {record.channel_kind}", "one or more", "add them", place="channels"
        )
    _table(record.channel_kind)[0](entries, model, folder)
    return Recording({}, {}, entries)


def own_entries(record: RecordEntry, common: Entries) -> dict[str, ChannelEntry]:
    """Return the channels of a record: those that all share, and its own."""
    return {**_of_kind(common, record.channel_kind), **record.channels}


def _of_kind(entries: Entries, kind: Kind) -> dict[str, ChannelEntry]:
    return {name: entry for name, entry in entries.items() if entry.kind == kind}


def read_table(folder: Path, entry: RecordEntry, plan: Recording, model: Model) -> Sequence[Lines]:
    """Read a record that is a table; responses to several inputs are several."""
    return _table(entry.kind)[1](folder, entry, plan.table, model)
