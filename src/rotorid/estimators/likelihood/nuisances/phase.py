"""The phase of the rotor angle: not known, or known as well as an encoder or pulses tell it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from rotorid.estimators.likelihood.nuisances.base import Nuisances, Turn, Unknown
from rotorid.models.expression import symbol
from rotorid.observation import Observation


class Phase(Turn):
    """phi = recorded angle + phase."""

    @classmethod
    def of(cls, number: int, std: float | None = None) -> Self:
        """Return the phase of one record, known to `std`."""
        unknown = Unknown(f"phase[{number}]", "rad", 0.0, std, nuisance=True, additive=True)
        return cls((unknown,), number)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return that of every record whose phase is not known, or known with a deviation."""
        found = []
        for number, record in enumerate(records):
            if not record.lines.phase_known:
                found.append(cls.of(number))
            elif record.lines.phase_std > 0 and (wanted.runout or _turns(record)):
                found.append(cls.of(number, record.lines.phase_std))
        return found

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return that of every record."""
        return [cls.of(k) for k in range(len(records))]


def _turns(record: Observation) -> bool:
    """Tell whether the loads of the model turn with the rotor."""
    linear = record.model.require_linear()
    return any(symbol("phi") in term.signal.free_symbols for term in linear.load_terms)
