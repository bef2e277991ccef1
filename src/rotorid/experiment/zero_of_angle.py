"""Records that turn by their speed alone: whether they count the rotor angle from one zero.

The angle of such a record starts at its `phase`, 0 where nothing is said. Two records that were not
started by the rotor itself then have two zeros, and one unbalance has two directions. At one speed
the rotation's line of all sensors is the same but for that: turned as a whole. A line that is the
same but a hundred times as large is one in another unit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import InputError
from rotorid.experiment.schema import RecordEntry
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.record import Complexes, Record

SAME_SPEED = 1e-3
"""Share by which speeds may differ: the unbalance hardly answers otherwise then."""
ALIKE = 0.1
"""Share of the rotation's line that a turn as a whole may leave: noise, and a sweep that passes."""
TURNED = np.deg2rad(10.0)
"""Angle from which on a line is turned: no settling and no noise of a line so clear does that."""
LARGE = 100.0
"""Factor from which on a line as a whole is in another unit, mm for um: no balancing does that."""


@frozen
class Wave:
    """The rotation's line of the sensors of a record; `told`: where its angle begins is said."""

    number: int
    speed: float
    sensors: tuple[str, ...]
    phasors: Complexes
    told: bool = False

    def over(self, other: Wave) -> complex | None:
        """Return by which factor a line is that of another one as a whole; None where it is not."""
        near = abs(self.speed - other.speed) <= SAME_SPEED * abs(other.speed)
        size = np.abs(other.phasors)
        if not near or self.sensors != other.sensors or not size.all():
            return None
        ratios = self.phasors / other.phasors
        factor = complex(ratios.mean())
        return factor if np.abs(ratios - factor).max() <= ALIKE * abs(factor) else None


def check_told(records: Sequence[RecordEntry]) -> None:
    """Refuse runout beside several records of which nothing says where their angle begins.

    A wrong zero of one of them turns its unbalance; the unknown runout takes that up, and nothing
    shows it: another unbalance fits as well.

    Raises
    ------
    InputError
        With the record that comes second.
    """
    untold = [k for k, record in enumerate(records) if turns_untold(record)]
    if len(untold) > 1:
        raise InputError(
            f"nothing, nor in records.{untold[0]}, which turns too",
            "the rotor angle at the first sample of each record, where runout is to be told from "
            "unbalance",
            'write phase = "0 deg" in all of them if the mark of the rotor started them, or name '
            "the column of the mark: keyphasor, angle",
            place=f"records.{untold[1]}.phase",
        )


def turns_untold(record: RecordEntry) -> bool:
    """Tell whether a record turns and says nothing of where its angle begins."""
    if record.kind != "samples" or record.angle is not None or record.keyphasor is not None:
        return False
    return bool(record.speed.value) and "phase" not in record.model_fields_set


def wave_of(number: int, entry: RecordEntry, record: Record, model: Model) -> Wave | None:
    """Return the rotation's line of a record; None at standstill, or where it has its own."""
    sensors = [c for c in record.names if c in model.coordinates]
    if record.speed == 0 or entry.parameters or not sensors:
        return None
    samples = np.column_stack([record.column(name) for name in sensors])
    window = np.hanning(len(samples))[:, None]
    window /= window.sum()
    centred = samples - (window * samples).sum(axis=0)
    wave = np.exp(-1j * record.rotor_angle())[:, None]
    phasors = (window * wave * centred).sum(axis=0)
    return Wave(number, record.speed, tuple(sensors), phasors, not turns_untold(entry))


def check_rotation(waves: list[Wave], file: str) -> None:
    """Refuse the last record where another unit, or another zero of the angle, tells it apart."""
    last = waves[-1]
    for other in waves[:-1]:
        factor = last.over(other)
        if factor is None or factor == 0:
            continue
        size, turn = abs(factor), float(np.angle(factor))
        if max(size, 1 / size) > LARGE:
            raise InputError(
                f"a rotation {size:.3g} times as large as in records.{other.number} in all of "
                f"{', '.join(last.sensors)}",
                "one size of it, since both turn at the same speed",
                "correct unit or scale of the sensors in this record: [records.channels]",
                file=file,
                place=f"records.{last.number}.channels",
            )
        if not (last.told or other.told) and abs(size - 1) <= ALIKE and abs(turn) > TURNED:
            raise InputError(
                f"the rotation at {np.rad2deg(turn):.3g} deg from where it is in "
                f"records.{other.number}, which turns at the same speed",
                "one zero of the rotor angle in all records, where nothing is said of it",
                'name the column of the mark (keyphasor, angle), or write phase = "unknown" in all '
                f"records but records.{other.number}",
                file=file,
                place=f"records.{last.number}.phase",
            )
