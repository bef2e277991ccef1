"""A constant of a force law that bends: gap, bias, iron, saturation, area.

The force is computed before the lines are taken, so that such a constant is no factor of a line:
the record's samples go through the law again, with the constant as it is thought to be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from rotorid.actuators.laws import KNEE
from rotorid.actuators.source import KNEE_CONSTANT
from rotorid.errors import InputError
from rotorid.estimators.likelihood.nuisances.base import (
    Nuisance,
    Nuisances,
    Unknown,
    all_inputs,
)
from rotorid.frozen import frozen
from rotorid.observation import Observation
from rotorid.record import Channel, ForceLaw


@frozen
class LawConstant(Nuisance):
    """Changes a constant of the force laws of some inputs, all by as much.

    Parameters
    ----------
    constant : str
        Its name in the law.
    inputs : set of str
    origin : float
        The value of the unknown at which the forces are as they were read.
    """

    constant: str
    inputs: frozenset[str]
    origin: float

    def changes(self, value: complex) -> Mapping[str, complex]:
        """Return by how much the constants of each law change at a value of the unknown."""
        return {self.constant: value - self.origin}

    @classmethod
    def of(cls, constant: str, label: str, channels: Sequence[Channel], std: float | None) -> Self:
        """Return a constant that some inputs have in common, about the mean of what is stated."""
        stated = [_law(channel).constants[constant] for channel in channels]
        mean = float(np.mean([found.value for found in stated]))
        unknown = Unknown(
            constant + (f"[{label}]" if label else ""),
            stated[0].unit,
            mean,
            std,
            mean,
            nuisance=True,
            positive=stated[0].positive,
            additive=not stated[0].positive,
            anchored=True,
        )
        return cls((unknown,), constant, frozenset(c.name for c in channels), mean)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return the constants that are not known exactly."""
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
        """Return those that are asked for, free, and each common to all inputs."""
        bent = _bent(records)
        found = [
            cls.of(n.constant, n.unknowns[0].name.partition("[")[2][:-1], channels, None)
            for n in cls.asked(records, Nuisances())
            for channels in [[c for c in bent if c.name in n.inputs]]
        ]
        alike = {name: _law(c).constants for c in bent for name in _law(c).constants}
        for name in alike:
            channels = [c for c in bent if name in _law(c).constants]
            if np.isfinite([_law(c).constants[name].value for c in channels]).all():
                found.append(cls.of(name, "", channels, None))
        return found


class Knee(LawConstant):
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
        unknown = Unknown("saturation", "1", 0.0, nuisance=True, additive=True)
        return [cls((unknown,), KNEE_CONSTANT, frozenset(names), 0.0)] if names else []


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
