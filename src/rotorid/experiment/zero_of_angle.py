"""Records that turn by their speed alone: whether they count the rotor angle from one zero.

The angle of such a record starts at its `phase`, 0 where nothing is said. Two records that were not
started by the rotor itself then have two zeros, and one unbalance has two directions. At one speed
the rotation's line of all sensors is the same but for that: turned as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.errors import InputError
from rotorid.experiment.schema import RecordEntry
from rotorid.models import Model
from rotorid.record import Complexes, Record

SAME_SPEED = 1e-3
"""Share by which speeds may differ: the unbalance hardly answers otherwise then."""
ALIKE = 0.1
"""Share of the rotation's line that a turn as a whole may leave: noise, and a sweep that passes."""
TURNED = np.deg2rad(10.0)
"""Angle from which on a line is turned: no settling and no noise of a line so clear does that."""


@dataclass(frozen=True)
class Wave:
    """The rotation's line of the sensors of a record, by the angle that its speed gives."""

    number: int
    speed: float
    sensors: tuple[str, ...]
    phasors: Complexes

    def turned_from(self, other: Wave) -> float:
        """Return by which angle a line is that of another one turned as a whole; 0 if it is not."""
        near = abs(self.speed - other.speed) <= SAME_SPEED * abs(other.speed)
        if not near or self.sensors != other.sensors:
            return 0.0
        size = np.hypot(np.abs(self.phasors), np.abs(other.phasors))
        here, there = (w.phasors / np.where(size > 0, size, 1.0) for w in (self, other))
        power = float(np.vdot(there, there).real)
        turn = complex(np.vdot(there, here)) / power if power > 0 else 0j
        left = np.linalg.norm(here - turn * there)
        if left > ALIKE * np.linalg.norm(here) or abs(np.abs(turn) - 1) > ALIKE:
            return 0.0
        return float(np.angle(turn))


def wave_of(number: int, entry: RecordEntry, record: Record, model: Model) -> Wave | None:
    """Return the rotation's line of a record that says nothing of its zero; None of another."""
    told = "phase" in entry.model_fields_set or entry.angle is not None or entry.keyphasor
    sensors = [c for c in record.names if c in model.coordinates]
    if told or record.speed == 0 or entry.parameters or not sensors:
        return None
    samples = np.column_stack([record.column(name) for name in sensors])
    window = np.hanning(len(samples))[:, None]
    window /= window.sum()
    centred = samples - (window * samples).sum(axis=0)
    wave = np.exp(-1j * record.rotor_angle())[:, None]
    return Wave(number, record.speed, tuple(sensors), (window * wave * centred).sum(axis=0))


def check_zeros(waves: list[Wave], file: str) -> None:
    """Refuse records of one rotor whose angles start from different zeros."""
    for wave in waves[1:]:
        if abs(turn := wave.turned_from(waves[0])) > TURNED:
            first = waves[0].number
            raise InputError(
                f"the rotation at {np.rad2deg(turn):.3g} deg from where it is in records.{first}, "
                "which turns at the same speed",
                "one zero of the rotor angle in all records, where nothing is said of it",
                'name the column of the mark (keyphasor, angle), or write phase = "unknown" in all '
                f"records but records.{first}",
                file=file,
                place=f"records.{wave.number}.phase",
            )
