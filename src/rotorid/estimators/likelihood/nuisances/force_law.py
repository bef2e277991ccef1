"""Constants of the force laws: ``F = ki i + ks x``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from rotorid.errors import InputError
from rotorid.estimators.likelihood.nuisances.base import (
    Constant,
    Nuisances,
    Unknown,
    all_inputs,
)
from rotorid.observation import Observation
from rotorid.record import Drive


class CurrentGain(Constant):
    """ki: the force per current of an input (per unit of its channel, where that is a force)."""

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return that of every input, where it is asked for."""
        return cls.every(records) if "ki" in wanted.gains else []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return that of every input."""
        return [
            cls(
                (
                    Unknown(
                        f"ki[{name}]",
                        "1" if channel.drive is None else "N/A",
                        1.0 if channel.drive is None else channel.drive.ki,
                        nuisance=True,
                        anchored=True,
                    ),
                ),
                frozenset([name]),
                "ki",
            )
            for name, channel in all_inputs(records).items()
        ]


def _driven(records: Sequence[Observation]) -> dict[str, Drive]:
    """Return the force laws of the inputs that are known by their current."""
    return {n: c.drive for n, c in all_inputs(records).items() if c.drive is not None}


class DisplacementGain(Constant):
    """ks: the force per displacement, one for all inputs or one per input."""

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return what the settings ask for."""
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
        """Return the common one and the single ones."""
        return [*cls._common(records), *cls._single(records)] if _driven(records) else []

    @classmethod
    def _common(cls, records: Sequence[Observation]) -> list[Self]:
        driven = _driven(records)
        mean = float(np.mean([drive.ks for drive in driven.values()]))
        unknown = Unknown("ks", "N/m", mean, nuisance=True, anchored=True)
        return [cls((unknown,), frozenset(driven), "ks")]

    @classmethod
    def _single(cls, records: Sequence[Observation]) -> list[Self]:
        return [
            cls(
                (Unknown(f"ks[{name}]", "N/m", drive.ks, nuisance=True, anchored=True),),
                frozenset([name]),
                "ks",
            )
            for name, drive in _driven(records).items()
        ]
