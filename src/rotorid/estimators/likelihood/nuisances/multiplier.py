"""A factor of channels that may be anything: a sign, a unit, a gain."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

import numpy as np

from rotorid.estimators.likelihood.nuisances.base import Factor, Unknown
from rotorid.record import Complexes, Floats


class Multiplier(Factor):
    """Quantity = s * reading: linear in s, so that a search may pass through zero."""

    @classmethod
    def of(cls, name: str, channels: Iterable[str], start: float = 1.0) -> Self:
        """Return the common factor of some channels, under the name of their gain."""
        unknown = Unknown(f"gain[{name}]", "1", start, nuisance=True, additive=True)
        return cls((unknown,), frozenset(channels))

    def factor(self, values: Floats, omega: Floats) -> Complexes:
        """S."""
        return np.full(len(omega), values[0], dtype=np.complex128)

    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        """1 / s."""
        return np.full((len(omega), 1), 1 / (values[0] or 1e-300), dtype=np.complex128)
