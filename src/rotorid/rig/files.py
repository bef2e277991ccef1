"""Files of a rig: the logger's HDF5 file, and the experiment file that identifies it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from io import BytesIO
from itertools import compress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomlkit
import tomlkit.items

from rotorid.core.errors import InputError, one_line, printable
from rotorid.core.files import MARK, Kind
from rotorid.core.toml import inline
from rotorid.force.laws import Differential, Flux, Linear
from rotorid.models.equations import combination_text
from rotorid.rig.file import RigPlan, load_rig
from rotorid.rig.logger import Logged, LoggedColumn, RigRecord, Truth, actuator_position, label
from rotorid.rig.parts import Encoder, Keyphasor, sensor_unit
from rotorid.rig.rig import Rig
from rotorid.signals.multisine import multisine

RECORD = Kind("rotorid simulate")
_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def record_bytes(
    record: Logged | RigRecord, *, rig_text: str = "", faults: Sequence[str] = ()
) -> bytes:
    """Return an HDF5 file: datasets with ``units``, times ``t`` and a group ``truth``."""
    time = np.arange(len(record.columns[0].samples)) / record.sample_rate
    # In memory: on a disk that fills while it writes, the library crashes.
    with h5py.File("in memory", "w", driver="core", backing_store=False) as data:
        data.attrs.update(written_by=RECORD.writer, written=MARK)
        for column in (LoggedColumn("t", "s", time), *record.columns):
            data.create_dataset(column.name, data=column.samples, **_PACKED)
            data[column.name].attrs["units"] = column.unit
        if record.truth is not None:
            _write_truth(data.create_group("truth"), record.truth)
            data["truth"].attrs.update(rig=rig_text, faults=list(faults))
        data.flush()
        return RECORD.signed(bytes(data.id.get_file_image()))


def _write_truth(group: h5py.Group, truth: Truth) -> None:
    """Write the truth as tables: one-dimensional datasets would look like columns."""
    tables = {
        "rotation": (np.stack([truth.angle, truth.speed], axis=1), ("angle", "speed")),
        "position": (truth.position, truth.coordinates),
        "velocity": (truth.velocity, truth.coordinates),
        "force": (truth.force, truth.inputs),
        "current": (truth.current, truth.inputs),
    }
    for name, (table, columns) in tables.items():
        dataset = group.create_dataset(name, data=table, **_PACKED)
        dataset.attrs["columns"] = list(columns)
    parameters = group.create_group("parameters")
    for name, value in truth.parameters.items():
        parameters.attrs[name] = value


def experiment_path(out: Path, rig: str) -> Path:
    if out.suffix.lower() not in (".h5", ".hdf5"):
        expected = ".h5 or .hdf5"
        cure = "name the record so; it is an HDF5 file"
        raise InputError(f"the ending {out.suffix!r}", expected, cure, file=str(out), place="--out")
    beside = out.with_suffix(".toml")
    if beside.exists() and Path(rig).exists() and beside.samefile(rig):
        found = f"the rig file {rig}, where the experiment file goes"
        expected = "another name for the record"
        raise InputError(found, expected, "choose one", file=str(out), place="--out")
    return beside


def experiment_text(plan: RigPlan, record: Logged | RigRecord, file: str) -> str:
    """Return the experiment file that identifies the record of a rig, faults left unsaid."""
    rig = plan.rig.as_described
    if rig.excitation is None:
        raise InputError(
            "a rig without excitation", "a multisine", "add [excitation]", place="excitation"
        )
    lines = set(rig.excitation.harmonics.tolist())
    turns = abs(rig.rotation.speed) / (2 * np.pi * rig.excitation.fundamental)
    if round(turns) >= 1 and abs(turns - round(turns)) < 0.01:  # that of the rotation
        lines.add(round(turns))
    entry = {
        "file": file,
        "sample_rate": _quantity(rig.logger.sample_rate, "Hz"),
        **_rotation(rig),
        "fundamental": _quantity(rig.excitation.fundamental, "Hz"),
        "harmonics": sorted(lines),
    }
    text = tomlkit.document()
    text["model"] = plan.model
    text["records"] = tomlkit.aot()
    text["records"].append(_table(entry))
    text["channels"] = _table(_inputs(rig, record) | _positions(rig))
    if known := _known_parameters(rig):
        text["parameters"] = _table(known)
        text["parameters"].comment("they multiply forces: a ruler gives them")
    said = printable(tomlkit.dumps(text), keep="\n")
    source = f"{one_line(plan.name)}: {one_line(plan.title)}"
    return f"# Written by `{RECORD.writer}`, from the rig {source}\n# as written: {MARK}\n{said}"


def _table(entries: Mapping[str, Any]) -> tomlkit.items.Table:
    table = tomlkit.table()
    for key, value in entries.items():
        table[key] = inline(value)
    return table


def _quantity(value: float, unit: str) -> str:
    """Write a number with its unit so that it is read as the same one."""
    return f"{repr(float(value)).removesuffix('.0')} {unit}"


def _rotation(rig: Rig) -> dict[str, Any]:
    mark = rig.logger.angle
    if isinstance(mark, Encoder):
        return {"angle": {"column": "encoder", "lines": mark.lines}}
    if isinstance(mark, Keyphasor):
        return {"keyphasor": "keyphasor"}
    if rig.rotation.speed == 0 and rig.rotation.constant:
        return {}
    speed, phase = rig.rotation.speed, rig.rotation.phase
    rpm = float(f"{speed * 30 / np.pi:.12g}")  # as people write it, if it is the same speed
    same = np.isclose(rpm * np.pi / 30, speed, rtol=1e-15, atol=0)
    said = _quantity(rpm, "rpm") if same else _quantity(speed, "rad/s")
    return {"speed": said, "phase": _quantity(phase, "rad")}


def _inputs(rig: Rig, record: Logged | RigRecord) -> dict[str, Any]:
    columns = {column.name: column for column in record.columns}
    plant = rig.plant(1.0)
    found = {}
    for j, (name, part) in enumerate(zip(rig.model.inputs, rig.parts, strict=True)):
        kinds = ("i",) if part.flux is None else ("b1", "b2")
        sources = [_recorded(columns[label(name, part, kind)]) for kind in kinds]
        if part.law is None:
            found[name] = sources[0]
        elif part.flux is not None:
            found[name] = _law(part.flux.law, flux=sources)
        else:
            place = actuator_position(rig, plant, j)
            there = (s.name for s in rig.sensors if dict(s.combination) == place)
            position = next(there, combination_text(place))
            found[name] = _law(part.law, current=sources[0], position=position)
    return found


def _recorded(column: LoggedColumn) -> dict[str, Any]:
    found: dict[str, Any] = {"column": column.name, "unit": column.unit}
    if column.hold:
        found["hold"] = "zero-order"
    if column.delay:
        found["delay"] = _quantity(round(column.delay * 1e6, 6), "us")
    if column.dynamics is not None:
        found["dynamics"] = {"bandwidth": _quantity(column.dynamics.bandwidth.value, "Hz")}
    return found


def _law(law: Linear | Differential | Flux, **sources: Any) -> dict[str, Any]:
    """Write a law by its constants; what they are by default is left out."""
    constants = {
        name: _quantity(getattr(law, name), of.unit)
        for name, of in law.stated.items()
        if getattr(law, name) != law.__dataclass_fields__[name].default
    }
    poles = {"poles": law.poles} if isinstance(law, Flux) else {}
    return {"law": type(law).__name__.lower(), **sources, **constants, **poles}


def _positions(rig: Rig) -> dict[str, Any]:
    found = {}
    for sensor in rig.sensors:
        reads = {} if sensor.reads is None else {"reads": combination_text(sensor.reads)}
        unit = sensor_unit(sensor.combination, rig.model.units)
        found[sensor.name] = {**reads, "column": sensor.name, "unit": unit}
    return found


def _known_parameters(rig: Rig) -> dict[str, Any]:
    """Return the parameters that multiply an input: no record of the rig alone gives them."""
    model = rig.model
    of_inputs = model.monomials[[term.monomial for term in model.input_terms]]
    driving = np.asarray(of_inputs.any(axis=0), dtype=bool)
    return {
        name: {"fixed": _quantity(rig.values[name], model.parameter_units[name])}
        for name in compress(model.parameter_names, driving)
    }


EXAMPLES = ("your-rig", "sweep", "sensitivity")
"""Pages of the documentation that begin with files of a logger."""
PLACES = ("AX", "AY", "BX", "BY")  # what the logger of these calls the axes


def example_files(page: str) -> dict[str, Callable[[], bytes]]:
    """Return the files that a page of the documentation begins with: by name, what makes each."""
    rig = load_rig("three-mass").rig
    rig = replace(rig, sensors=tuple(s for s in rig.sensors if s.name in ("x1", "y1", "x3", "y3")))
    if page == "your-rig":
        return {"run7.csv": partial(_logged, rig, 5.0, 7, ";")}
    axes = dict.fromkeys(rig.model.inputs, 5e-3)  # A
    if page == "sensitivity":
        apart = multisine(1.0, range(5, 600), axes, apart=True, unit="A")
        return {"loop.csv": partial(_logged, replace(rig, excitation=apart), 20.0, 0)}
    rig = replace(rig, rotation=replace(rig.rotation, speed=2 * np.pi * 137.31))
    made: dict[str, Callable[[], bytes]] = {}
    for seed, (place, axis) in enumerate(zip(PLACES, axes, strict=True)):
        one = multisine(0.2, range(25, 1150), {axis: 5e-3}, phases="schroeder", unit="A")
        rig = replace(rig, excitation=one)
        made[f"sweep-{place.lower()}.csv"] = partial(_logged, rig, 5.0, seed)
    return made


def _logged(rig: Rig, seconds: float, seed: int, gap: str = ",") -> bytes:
    """Return a table as loggers write it; one of commas has what was added, and a keyphasor too."""
    samples, rate = rig.run(seconds, np.random.default_rng(seed)).samples.T, rig.logger.sample_rate
    time = np.arange(samples.shape[1]) / rate
    columns = {"Time [s]": time, **dict(zip((f"I {p} [A]" for p in PLACES), samples, strict=False))}
    columns |= {f"Pos {p} [um]": 1e6 * one for p, one in zip(PLACES, samples[4:], strict=True)}
    if gap == "," and rig.excitation is not None:
        places = dict(zip(rig.model.inputs, PLACES, strict=True))
        names = [f"Ref {places[name]} [A]" for name in rig.excitation.names]
        added = np.resize(rig.excitation.samples(rate), (len(time), len(names)))
        columns |= dict(zip(names, added.T, strict=True))
        columns["Key [V]"] = 5.0 * ((rig.rotation.speed * time) % (2 * np.pi) < 0.6)
    text = BytesIO()
    head = f"Logger 4711\nDate: 2026-03-02 10:14\nAs written: {MARK}\n\n" + gap.join(columns)
    table = np.column_stack(list(columns.values()))
    np.savetxt(text, table, delimiter=gap, header=head, comments="", fmt="%.7g")
    return RECORD.signed(text.getvalue())
