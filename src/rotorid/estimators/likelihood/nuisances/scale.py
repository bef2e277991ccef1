"""The scale that all forces have in common: force = scale * (force as read)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from rotorid.estimators.likelihood.nuisances.base import Nuisance, Nuisances, Unknown
from rotorid.observation import Observation


class Scale(Nuisance):
    """One factor of all forces, currents' and displacements' share alike."""

    @classmethod
    def of(cls, std: float | None) -> Self:
        """Return the scale, known to `std`."""
        unknown = Unknown(
            "scale[force]", "1", 1.0, std, 1.0, nuisance=True, positive=True, anchored=True
        )
        return cls((unknown,))

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return it where its deviation is given."""
        return [cls.of(wanted.force_scale_std)] if wanted.force_scale_std else []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return it."""
        return [cls.of(None)]
