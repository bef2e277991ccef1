"""Unknown rotor angle of a record, and runout of a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Self

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats
from rotorid.data.observation import Observation
from rotorid.data.record import Channel
from rotorid.likelihood.effects import Adds, Effect, Turns
from rotorid.likelihood.unknowns.kinds import Nuisances, Plausible, Scalar, Unknown
from rotorid.models.expressions import symbol

NEAR = 0.02
"""Share by which the speed of another record may differ that tells where a phase may start."""
HELD = 0.1
"""Share of the largest power of the rotation from which on a line holds it, and no excitation."""

LEAKS = 0.1
"""Amplitude that cos(n phi) leaves on the lines that are used, from which on these hold the n-th
order: one half on a line of it, a third between two lines. What leaks elsewhere is 1e-3 at most,
and a runout of metres would explain any misfit there."""


@frozen
class Phase(Unknown):
    """phi = recorded angle + phase, of one record."""

    # A mark is glued on, and a filter of 9 kHz turns 9000 rpm by as much.
    plausible = Plausible(
        "rotor angle",
        "rad",
        np.pi / 180,
        "taken as exact: 1 deg of it",
        "directions count from the angle as given",
    )

    record: int = field(kw_only=True)

    def effects(self) -> Sequence[Effect]:
        return (Turns(),)

    def size(self, values: Floats) -> float:
        return float(np.angle(np.exp(1j * values[0])))

    @classmethod
    def of(cls, number: int, std: float | None = None, start: float = 0.0) -> Self:
        unknown = Scalar(f"phase[{number}]", "rad", start, std, additive=True)
        return cls((unknown,), frozenset(), record=number)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        found = []
        for number, record in enumerate(records):
            if not record.lines.phase_known:
                found.append(cls.of(number, start=_start(record, records)))
            elif record.lines.phase_std > 0 and (wanted.runout or _turns(record)):
                found.append(cls.of(number, record.lines.phase_std))
        return found

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
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


@frozen
class Runout(Unknown):
    """``y = C q + cos * cos(n phi) + sin * sin(n phi)``, common to all records."""

    setting = "runout"
    rival = "term"
    # Of a ground journal; balancing standards allow the probes of a good machine several times it.
    plausible = Plausible(
        "runout", "m", 1e-6, "taken as 0: 1 um of it", "runout = true estimates it"
    )

    order: int = 1  # n

    def effects(self) -> Sequence[Effect]:
        return tuple(Adds(name, self.order) for name in self.on)

    @classmethod
    def of(cls, channel: Channel, order: int = 1) -> Self:
        times = "" if order == 1 else f", order {order}"
        name = f"runout[{channel.name}{times}]"
        cos, sin = (
            Scalar(f"{name}.{part}", channel.unit, 0.0, additive=True) for part in ("cos", "sin")
        )
        return cls((cos, sin), frozenset([channel.name]), order)

    @property
    def term(self) -> str:
        """Its name without the part."""
        return self.scalars[0].name.removesuffix(".cos")

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        return cls.every(records) if wanted.runout else []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        return [cls.of(channel) for channel in _position_sensors(records)]

    @classmethod
    def harmonics(cls, records: Sequence[Observation]) -> list[Self]:
        """Return that of each sensor twice and three times per revolution, where lines hold it."""
        orders = [n for n in (2, 3) if any(_holds(record, n) for record in records)]
        return [cls.of(channel, n) for channel in _position_sensors(records) for n in orders]


def _position_sensors(records: Sequence[Observation]) -> list[Channel]:
    found = {s.channel.name: s.channel for r in records for s in r.sensors if s.order == 0}
    return list(found.values())


def _holds(record: Observation, order: int) -> bool:
    """Tell whether a line of a record is a multiple of its rotation, and not what leaks there."""
    wave = record.lines.clock.lines(lambda t, phi, speed: np.cos(order * phi)[..., None])
    return bool(np.abs(wave).max(initial=0.0) > LEAKS)
