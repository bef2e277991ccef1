"""Unknown constants of forces: k_i, k_s, their common scale, constants of a law.

The force is computed before the lines are taken, so that such a constant is no factor of a line:
the record's samples go through the law again, with the constant as it is thought to be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.data.record import Channel, Drive, ForceLaw
from rotorid.force.laws import KNEE
from rotorid.force.reading import KNEE_CONSTANT
from rotorid.likelihood.effects import Drives, Effect, Rereads
from rotorid.likelihood.unknowns.kinds import (
    Nuisances,
    Scalar,
    Unknown,
    all_inputs,
    amount,
)


class Scale(Unknown):
    """One factor of all forces, currents' and displacements' share alike."""

    setting = "force_scale_std"

    @classmethod
    def of(cls, records: Sequence[Observation], std: float | None) -> Self:
        unknown = Scalar("scale[force]", "1", 1.0, std, positive=True, anchored=True)
        return cls((unknown,), frozenset(all_inputs(records)))

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        return [cls.of(records, wanted.force_scale_std)] if wanted.force_scale_std else []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        return [cls.of(records, None)]

    def effects(self) -> Sequence[Effect]:
        return (Drives(self.on, "force"),)


class CurrentGain(Unknown):
    """ki: the force per current of an input (per unit of its channel, where that is a force)."""

    setting = "gains"

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        return cls.every(records) if "ki" in wanted.gains else []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        found = []
        for name, channel in all_inputs(records).items():
            unit, ki = ("1", 1.0) if channel.drive is None else ("N/A", channel.drive.ki)
            unknown = Scalar(f"ki[{name}]", unit, ki, anchored=True)
            found.append(cls((unknown,), frozenset([name])))
        return found

    def effects(self) -> Sequence[Effect]:
        return (Drives(self.on, "ki"),)


def _driven(records: Sequence[Observation]) -> dict[str, Drive]:
    """Return the force laws of the inputs that are known by their current."""
    return {n: c.drive for n, c in all_inputs(records).items() if c.drive is not None}


class DisplacementGain(Unknown):
    """ks: the force per displacement, one for all inputs or one per input."""

    setting = "gains"
    rival = "term"

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        if not {"ks", "ks*"} & set(wanted.gains):
            return []
        if not _driven(records):
            raise InputError(
                "an unknown ks, but forces instead of currents",
                "channels with a linear force law",
                "give law, current, position and ki of each",
                place="gains",
            )
        return cls._common(records) if "ks" in wanted.gains else cls._single(records)

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        return [*cls._common(records), *cls._single(records)] if _driven(records) else []

    @classmethod
    def _common(cls, records: Sequence[Observation]) -> list[Self]:
        driven = _driven(records)
        mean = float(np.mean([drive.ks for drive in driven.values()]))
        unknown = Scalar("ks", "N/m", mean, anchored=True)
        return [cls((unknown,), frozenset(driven))]

    @classmethod
    def _single(cls, records: Sequence[Observation]) -> list[Self]:
        driven = _driven(records)
        common = "ks" if len(driven) > 1 else ""
        found = []
        for name, drive in driven.items():
            unknown = Scalar(f"ks[{name}]", "N/m", drive.ks, anchored=True)
            found.append(cls((unknown,), frozenset([name]), alternative_to=common))
        return found

    def effects(self) -> Sequence[Effect]:
        return (Drives(self.on, "ks"),)


@frozen
class MagnetConstant(Unknown):
    """Changes a constant of the force laws of some inputs, all by as much."""

    setting = "law"
    rival = "term"

    constant: str  # its name in the law
    origin: float  # the value of the unknown at which the forces are as they were read

    def effects(self) -> Sequence[Effect]:
        return (Rereads(self.on, self.changes),)

    def changes(self, value: complex) -> Mapping[str, complex]:
        """Return by how much the constants of each law change at a value of the unknown."""
        return {self.constant: value - self.origin}

    @classmethod
    def of(cls, constant: str, label: str, channels: Sequence[Channel], std: float | None) -> Self:
        stated = [_law(channel).constants[constant] for channel in channels]
        mean = float(np.mean([found.value for found in stated]))
        unknown = Scalar(
            constant + (f"[{label}]" if label else ""),
            stated[0].unit,
            mean,
            std,
            positive=stated[0].positive,
            additive=not stated[0].positive,
            anchored=True,
        )
        return cls((unknown,), frozenset(c.name for c in channels), constant, mean)

    def told(self, value: float | None) -> tuple[str, str]:
        said = f"{self.term} of the force laws{amount(value, self.unit)}"
        return said, f"give its value, or have it estimated: {self.term} = {{ start = ... }}"

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        groups: dict[tuple[str, str], list[Channel]] = {}
        for channel in _bent(records):
            for name, found in _law(channel).constants.items():
                if found.std:
                    groups.setdefault((name, found.shared or channel.name), []).append(channel)
        found_constants = []
        for (name, label), channels in groups.items():
            _refuse_unlike(name, label, channels)
            std = _law(channels[0]).constants[name].std
            found_constants.append(cls.of(name, label, channels, None if np.isinf(std) else std))
        return found_constants

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        bent = _bent(records)
        found = [
            cls.of(n.constant, n.scalars[0].name.partition("[")[2][:-1], channels, None)
            for n in cls.asked(records, Nuisances())
            for channels in [[c for c in bent if c.name in n.on]]
        ]
        alike = {name: _law(c).constants for c in bent for name in _law(c).constants}
        for name in alike:
            channels = [c for c in bent if name in _law(c).constants]
            if np.isfinite([_law(c).constants[name].value for c in channels]).all():
                found.append(cls.of(name, "", channels, None))
        return found


class Knee(MagnetConstant):
    """How near the iron of all inputs is to its saturation, from not at all: (b_0 / b_s)^4."""

    @staticmethod
    def saturation(knee: float) -> float:
        """Return b_s / b_0, the flux of the iron's knee over that of the bias."""
        return float(knee ** (-1 / KNEE)) if knee > 0 else np.inf

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return none: files say the saturation itself."""
        return []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return that of all inputs whose law knows a bias, and no saturation."""
        biased = [c for c in _bent(records) if "bias" in _law(c).constants]
        names = [c.name for c in biased if np.isinf(_saturation(c))]
        unknown = Scalar("saturation", "1", 0.0, additive=True)
        return [cls((unknown,), frozenset(names), KNEE_CONSTANT, 0.0)] if names else []

    def size(self, values: Floats) -> float:
        return self.saturation(float(values[0]))


def _law(channel: Channel) -> ForceLaw:
    assert channel.law is not None
    return channel.law


def _saturation(channel: Channel) -> float:
    """Return where the iron of an input saturates; 0 where its law knows no iron."""
    found = _law(channel).constants.get("saturation")
    return 0.0 if found is None else found.value


def _bent(records: Sequence[Observation]) -> list[Channel]:
    """Return the inputs whose force was made by a law that bends, of records with samples."""
    there = [record for record in records if record.lines.samples is not None]
    return [channel for channel in all_inputs(there).values() if channel.law is not None]


def _refuse_unlike(name: str, label: str, channels: Sequence[Channel]) -> None:
    """Refuse constants that are shared, and stated differently."""
    stated = {_law(channel).constants[name] for channel in channels}
    if len(stated) > 1:
        listed = ", ".join(f"{found.value:g} +- {found.std:g}" for found in sorted(stated))
        raise InputError(
            f"{name} of {label} as {listed}",
            "one value and deviation of a constant that is shared",
            "write the same in every channel, or drop shared",
            place=f"channels.{channels[0].name}.{name}",
        )
