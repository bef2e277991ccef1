"""Records of an experiment file to look at: of one that is finished, and of a draft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rotorid.errors import InputError, ReadError
from rotorid.experiment.kinds import read_table
from rotorid.experiment.loader import Experiment, load_experiment
from rotorid.experiment.recording import measured
from rotorid.experiment.schema import RecordEntry
from rotorid.io import Source, read_record
from rotorid.line_inspection import LineInspection, inspect_lines
from rotorid.record import Record
from rotorid.signals.angle import keyphasor_angle, pulse_edges
from rotorid.signals.inspection import Inspection, inspect_record
from rotorid.toml import parse_table, read_bytes
from rotorid.units import to_si

OPEN = "?"
"""What a draft writes where something is left to say."""

_KEPT = ("sample_rate", "speed", "phase", "skip", "until", "header_row", "mask")


def inspect_experiment(path: Path) -> tuple[list[Inspection | LineInspection], str]:
    """Inspect every record of an experiment file.

    Returns
    -------
    inspections : list of Inspection or LineInspection
        The latter for tables of phasors and responses; those to several inputs are several.
    told : str
        Why the file was read as a draft; empty where it is finished.

    Raises
    ------
    InputError
        For files that cannot be read.
    """
    try:
        plan = load_experiment(path)
    except InputError as error:
        try:
            entries = _draft_entries(path)
        except InputError:
            raise error from None  # what the file is not says more than that it is no TOML
        if entries is None:
            raise
        told = f"read as a draft, every column as it is, because of this: {error}"
        return [_inspect_draft(path.parent, entry) for entry in entries], told
    plan.require_records()
    return [found for number in range(len(plan.entry.records)) for found in _each(plan, number)], ""


def named_files(path: Path) -> list[Path]:
    """Return an experiment file, a draft too, and every file that a text in it names."""
    found = [path]
    left: list[Any] = [parse_table(read_bytes(path), file=str(path))]
    while left:
        value = left.pop()
        if isinstance(value, dict | list):
            left += value.values() if isinstance(value, dict) else value
        elif isinstance(value, str):
            with suppress(OSError, ValueError):  # texts that are no names of files
                if (path.parent / value).is_file():
                    found.append(path.parent / value)
    return found


def _each(plan: Experiment, number: int) -> Iterator[Inspection | LineInspection]:
    """Inspect one record of a finished file."""
    entry, channels = plan.entry.records[number], plan.channels[number]
    if entry.channel_kind != "samples":
        for lines in read_table(plan.folder, entry, channels, plan.model):
            named = lines.source or ", ".join(entry.paths)
            yield inspect_lines(replace(lines, source=named))
        return
    currents = plan.method("ml") == "ml"
    yield _inspect(measured(plan.folder, entry, channels, currents=currents), entry)


def _inspect(record: Record, entry: RecordEntry) -> Inspection:
    size = entry.period_samples
    if size is None and entry.fundamental is not None:
        size = round(record.sample_rate / entry.fundamental)
    return inspect_record(
        record,
        period_samples=size,
        harmonics=entry.harmonics,
        band=entry.band,
        skip=entry.skip or 0.0,
        whole=size is None and entry.band is not None,
    )


def _draft_entries(path: Path) -> list[Mapping[str, Any]] | None:
    """Return the records of a file that leaves something open, None where it does not."""
    try:
        data = read_bytes(path)
        entries = parse_table(data).get("records", [])
    except ReadError:  # told where the file is read in earnest
        return None
    if not isinstance(entries, list) or not entries:
        return None
    periodic = [
        isinstance(e, dict) and ("fundamental" in e or "period_samples" in e) for e in entries
    ]
    named = all(isinstance(e, dict) and ("file" in e or "files" in e) for e in entries)
    return entries if named and (f'"{OPEN}"'.encode() in data or not all(periodic)) else None


def _inspect_draft(folder: Path, entry: Mapping[str, Any]) -> Inspection:
    """Inspect a record with all its columns, as far as its entry is filled in."""
    said = {key: entry[key] for key in _KEPT if entry.get(key, OPEN) not in (OPEN, "unknown")}
    names = entry["files"] if "files" in entry else [entry["file"]]
    if not all(isinstance(name, str) and name != OPEN for name in names):
        raise ReadError("no name of a file", "the file of a record", "name it")
    skip = said.pop("skip", 0.0)
    record = read_record([folder / name for name in names], time=_time(entry), **said)
    record = _without_mark(record, entry)
    size = entry.get("period_samples")
    fundamental = entry.get("fundamental", OPEN)
    if fundamental != OPEN:
        size = round(record.sample_rate / to_si(fundamental, "Hz", place="fundamental"))
    if isinstance(skip, str):
        skip = to_si(skip, "s", place="skip")
    harmonics = entry.get("harmonics")
    return inspect_record(
        record,
        period_samples=size if isinstance(size, int) else None,
        harmonics=harmonics if isinstance(harmonics, list) else None,
        skip=skip,
        whole=size is None and "band" in entry,
    )


def _without_mark(record: Record, entry: Mapping[str, Any]) -> Record:
    """Leave out the column of the rotor angle, which is no channel; a keyphasor tells the speed."""
    angle = entry.get("angle")
    mark = angle.get("column") if isinstance(angle, dict) else entry.get("keyphasor")
    kept = [c for c, name in enumerate(record.names) if name != mark]
    turned: dict[str, Any] = {}
    if entry.get("keyphasor") in record.names:
        with suppress(InputError):  # what is wrong with it is told once the file is finished
            column, rate = record.column(entry["keyphasor"]), record.sample_rate
            times, half = pulse_edges(column, rate, source=record.source)
            seen = keyphasor_angle(times, len(column), rate, half=half, source=record.source)
            turned = {"speed": seen.speed, "angle": seen.angle}
    return replace(
        record,
        channels=tuple(record.channels[c] for c in kept),
        samples=record.samples[:, kept],
        **turned,
    )


def _time(entry: Mapping[str, Any]) -> Source | None:
    time = entry.get("time", OPEN)
    if time == OPEN:
        return None
    return Source(time) if isinstance(time, str) else Source(time["column"], time.get("unit"))
