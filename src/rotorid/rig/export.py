"""Files of a rig: the logger's HDF5 file, and the experiment file that identifies it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rotorid.actuators.flux import Flux
from rotorid.actuators.laws import Differential, Linear
from rotorid.errors import InputError
from rotorid.models import Model
from rotorid.rig.logger import Column, RigRecord, actuator_position, label
from rotorid.rig.parts import Encoder, Keyphasor, PositionSensor, sensor_unit
from rotorid.rig.rig import Rig
from rotorid.rig.rig_file import RigPlan

_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def write_record(record: RigRecord, path: Path, *, rig_text: str = "") -> None:
    """Write what the logger of a rig recorded, as HDF5.

    One dataset per column, with its unit in the attribute ``units``; the sample times in ``t``;
    and a group ``truth``, which no logger would write.
    """
    with h5py.File(path, "w") as data:
        time = np.arange(len(record.samples)) / record.sample_rate
        _dataset(data, Column("t", "s", time))
        for column in record.columns:
            _dataset(data, column)
        _write_truth(data.create_group("truth"), record, rig_text)


def write_columns(path: Path, columns: Sequence[Column]) -> None:
    """Write columns as datasets of an HDF5 file, their units in the attribute ``units``."""
    with h5py.File(path, "w") as data:
        for column in columns:
            _dataset(data, column)


def _dataset(group: h5py.Group, column: Column) -> None:
    group.create_dataset(column.name, data=column.samples, **_PACKED)
    group[column.name].attrs["units"] = column.unit


def _write_truth(group: h5py.Group, record: RigRecord, rig_text: str) -> None:
    """Write the truth as tables: one-dimensional datasets would look like columns."""
    truth = record.truth
    if truth is None:
        return
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
    group.attrs["rig"] = rig_text


def experiment_path(out: Path, rig: str) -> Path:
    """Return where the experiment file of a record goes: beside it, with the ending .toml."""
    if out.suffix.lower() not in (".h5", ".hdf5"):
        raise InputError(
            f"the ending {out.suffix!r}",
            ".h5 or .hdf5",
            "name the record so; it is an HDF5 file",
            file=str(out),
            place="--out",
        )
    beside = out.with_suffix(".toml")
    if beside.exists() and Path(rig).exists() and beside.samefile(rig):
        raise InputError(
            f"the rig file {rig}, where the experiment file goes",
            "another name for the record",
            "choose one",
            file=str(out),
            place="--out",
        )
    return beside


def experiment_text(plan: RigPlan, record: RigRecord, file: str) -> str:
    """Return the experiment file that identifies the record of a rig."""
    rig = plan.rig
    if rig.excitation is None:
        raise InputError(
            "a rig without excitation", "a multisine", "add [excitation]", place="excitation"
        )
    lines = [
        f"# Written by `rotorid simulate`, from the rig {plan.name}: {plan.title}",
        f'model = "{plan.model}"',
        "",
        "[[records]]",
        f'file = "{file}"',
        f'sample_rate = "{_number(rig.logger.sample_rate)} Hz"',
        *_rotation(rig),
        f'fundamental = "{_number(rig.excitation.fundamental)} Hz"',
        f"harmonics = {_harmonics(rig)}",
        "",
        "[channels]",
        *_inputs(rig, record),
        *(_position(sensor, rig.model) for sensor in rig.sensors),
    ]
    known = _known_parameters(rig)
    if known:
        lines += ["", "[parameters]          # they multiply forces: a ruler gives them", *known]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Write a number so that it is read as the same one."""
    return repr(float(value)).removesuffix(".0")


def _rotation(rig: Rig) -> list[str]:
    mark = rig.logger.angle
    if isinstance(mark, Encoder):
        return [f'angle = {{ column = "encoder", lines = {mark.lines} }}']
    if isinstance(mark, Keyphasor):
        return ['keyphasor = "keyphasor"']
    if rig.rotation.speed == 0 and rig.rotation.constant:
        return []
    low, high = rig.rotation.range_until(0.0)
    found = [f'speed = "{_number((low + high) / 2)} rad/s"']
    if rig.rotation.phase:
        found.append(f'phase = "{_number(rig.rotation.phase)} rad"')
    return found


def _harmonics(rig: Rig) -> list[int]:
    """Return the excited lines and, where it is one of the fundamental, that of the rotation."""
    if rig.excitation is None:
        return []
    lines = set(rig.excitation.harmonics.tolist())
    turns = abs(rig.rotation.speed) / (2 * np.pi * rig.excitation.fundamental)
    if round(turns) >= 1 and abs(turns - round(turns)) < 0.01:
        lines.add(round(turns))
    return sorted(lines)


def _inputs(rig: Rig, record: RigRecord) -> list[str]:
    columns = {column.name: column for column in record.columns}
    plant = rig.plant(1.0)
    found = []
    for j, (name, part) in enumerate(zip(rig.model.inputs, rig.parts, strict=True)):
        kinds = ("i",) if part.flux is None else ("b1", "b2")
        sources = [_recorded(columns[label(name, part, kind)]) for kind in kinds]
        if part.law is None:
            keys = sources[0]
        elif part.flux is not None:
            keys = _flux(part.flux.law, sources)
        else:
            keys = _law(part.law, sources[0], _place(rig, actuator_position(rig, plant, j)))
        found.append(f"{name} = {{ {keys} }}")
    return found


def _place(rig: Rig, position: Mapping[str, float]) -> str:
    """Name the sensor that reads a displacement; or say which coordinates it is made of."""
    for sensor in rig.sensors:
        if dict(sensor.combination) == dict(position):
            return sensor.name
    return _combination(position)


def _recorded(column: Column) -> str:
    keys = [f'column = "{column.name}"', f'unit = "{column.unit}"']
    if column.hold:
        keys.append('hold = "zero-order"')
    if column.delay:
        keys.append(f'delay = "{_number(round(column.delay * 1e6, 6))} us"')
    return ", ".join(keys)


def _flux(law: Flux, sources: list[str]) -> str:
    keys = [
        'law = "flux"',
        f"flux = [{', '.join(f'{{ {source} }}' for source in sources)}]",
        f'area = "{_number(law.area)} m^2"',
        f"poles = {law.poles}",
    ]
    return ", ".join([*keys, *_angle(law.angle)])


def _law(law: Linear | Differential, source: str, position: str) -> str:
    keys = [f"current = {{ {source} }}", f'position = "{position}"']
    if isinstance(law, Linear):
        keys += [f'ki = "{_number(law.ki)} N/A"', f'ks = "{_number(law.ks)} N/m"']
        return ", ".join(['law = "linear"', *keys])
    keys += [
        f'K = "{_number(law.constant)} N m^2/A^2"',
        f'bias = "{_number(law.bias)} A"',
        f'gap = "{_number(law.gap)} m"',
    ]
    return ", ".join(['law = "differential"', *keys, *_angle(law.angle)])


def _angle(angle: float) -> list[str]:
    return [f'angle = "{_number(angle)} rad"'] if angle else []


def _combination(parts: Mapping[str, float]) -> str:
    """Write a linear combination as text, ``x - 0.2*theta_y``."""
    text = ""
    for name, factor in parts.items():
        size = "" if abs(factor) == 1 else f"{_number(abs(factor))}*"
        sign = " - " if factor < 0 else " + " if text else ""
        text += (sign if text else sign.strip()) + size + name
    return text


def _position(sensor: PositionSensor, model: Model) -> str:
    unit = sensor_unit(sensor.combination, model.units)
    reads = "" if sensor.reads is None else f'reads = "{_combination(sensor.reads)}", '
    return f'{sensor.name} = {{ {reads}column = "{sensor.name}", unit = "{unit}" }}'


def _known_parameters(rig: Rig) -> list[str]:
    """Return the parameters that multiply an input: no record of the rig alone gives them."""
    exponents = rig.model.monomials
    held = {
        name
        for term in rig.model.input_terms
        for name, power in zip(
            rig.model.parameter_names, exponents[term.monomial].tolist(), strict=True
        )
        if power
    }
    units = {parameter.name: parameter.unit for parameter in rig.model.parameters}
    return [
        f'{name} = {{ fixed = "{_number(rig.values[name])} {units[name]}" }}'
        for name in rig.model.parameter_names
        if name in held
    ]
