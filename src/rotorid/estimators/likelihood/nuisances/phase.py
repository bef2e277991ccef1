"""The phase of the rotor angle: not known, or known as well as an encoder or pulses tell it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from rotorid.estimators.likelihood.nuisances.base import Nuisances, Turn, Unknown
from rotorid.models.expression import symbol
from rotorid.observation import Observation
from rotorid.record import Complexes

NEAR = 0.02
"""Share by which the speed of another record may differ that tells where a phase may start."""
HELD = 0.1
"""Share of the largest power of the rotation from which on a line holds it, and no excitation."""


class Phase(Turn):
    """phi = recorded angle + phase."""

    @classmethod
    def of(cls, number: int, std: float | None = None, start: float = 0.0) -> Self:
        """Return the phase of one record, known to `std`."""
        unknown = Unknown(f"phase[{number}]", "rad", start, std, nuisance=True, additive=True)
        return cls((unknown,), number)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return that of every record whose phase is not known, or known with a deviation."""
        found = []
        for number, record in enumerate(records):
            if not record.lines.phase_known:
                found.append(cls.of(number, start=_start(record, records)))
            elif record.lines.phase_std > 0 and (wanted.runout or _turns(record)):
                found.append(cls.of(number, record.lines.phase_std))
        return found

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return that of every record."""
        return [cls.of(k) for k in range(len(records))]

    @classmethod
    def later(cls, records: Sequence[Observation], starts: Sequence[float] = (0.0,)) -> list[Self]:
        """Return that of each record that turns after the first one, at each of some starts.

        The first counts the angle of the unbalance; another may have begun anywhere else.
        """
        turning = [k for k, r in enumerate(records) if _speed(r) != 0 and _turns(r)]
        known = [k for k in turning[1:] if records[k].lines.phase_known]
        return [cls.of(k, start=start) for k in known for start in starts]


def _start(record: Observation, records: Sequence[Observation]) -> float:
    """Return by what the rotation stands turned in a record, against one that knows its phase.

    From the other side of the circle no minimum is found. At another speed the unbalance is
    answered otherwise, and nothing is taken from it.
    """
    speed = _speed(record)
    for other in records:
        near = abs(_speed(other) - speed) <= NEAR * abs(speed)
        names = [s.channel.name for s in record.sensors]
        if other.lines.phase_known and near and [s.channel.name for s in other.sensors] == names:
            here, there = _wave(record), _wave(other)
            size = np.hypot(np.abs(here), np.abs(there))
            return float(np.angle(np.vdot(there, here / np.where(size > 0, size, 1.0) ** 2)))
    return 0.0


def _speed(record: Observation) -> float:
    return float(np.mean(record.lines.speed))


def _wave(record: Observation) -> Complexes:
    """Return the phasors of the rotation in the sensors, (sensor,); 0 where no line holds it."""
    turn = record.lines.clock.lines(lambda t, phi, speed: np.cos(phi)[..., None])[:, 0]
    power = np.abs(turn) ** 2
    held = np.where(power > HELD * power.max(initial=0.0), turn, 0.0)
    total = float((np.abs(held) ** 2).sum())
    lines = record.lines.mean[:, [s.column for s in record.sensors]]
    return np.asarray(held.conj() @ lines / total if total > 0 else np.zeros(lines.shape[1]) + 0j)


def _turns(record: Observation) -> bool:
    """Tell whether the loads of the model turn with the rotor."""
    linear = record.model.require_linear()
    return any(symbol("phi") in term.signal.free_symbols for term in linear.load_terms)
