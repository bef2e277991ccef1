"""The phase of the rotor angle, where a record knows it up to a constant only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from rotorid.estimators.likelihood.nuisances.base import Nuisances, Turn, Unknown
from rotorid.observation import Observation


class Phase(Turn):
    """phi = recorded angle + phase."""

    @classmethod
    def of(cls, number: int) -> Self:
        """Return the phase of one record."""
        unknown = Unknown(f"phase[{number}]", "rad", 0.0, nuisance=True, additive=True)
        return cls((unknown,), number)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return that of every record without a known phase."""
        return [cls.of(k) for k, record in enumerate(records) if not record.lines.phase_known]

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return that of every record."""
        return [cls.of(k) for k in range(len(records))]
