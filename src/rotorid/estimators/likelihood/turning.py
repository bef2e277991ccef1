"""Whether the unbalance keeps to the angle that was given, from period to period.

Where the rotation stands on a line that is excited, no spectrum shows a speed that is off by less
than a line of the whole record. But the load of the unbalance then turns slowly against the angle
that was given, and so does the residual of each period along the derivative d by the phase:
``a_p = d' (r_p - r) / |d|^2``. A speed that is off gives a_p a slope; samples lost between the mark
and the columns, a step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.problem import Point
from rotorid.frozen import frozen
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats, PeriodicRecord
from rotorid.steady import Steady, unread

CREEPS = 3.5
"""Deviations of the slope from which on the angle is no better known than by its creep: chance
takes one good record in two thousand there, whose deviations are then a little too wide."""
STRAYS = 6.0
"""Deviations from which on a creep is sure."""
JUMPS = 8.0
"""Deviations from which on a step is: of a thousand places chance makes 4.5, and noise that carries
over from period to period a little more."""
LOST = 0.155
"""Angle in rad over the record by which a creep costs a thousandth of the unbalance's line, which
no deviation of the angle makes good: sin(a / 2) / (a / 2) = 1 - a^2 / 24."""
SCATTERS = 5.0
"""Scatter about slope and step, over that of noise, from which on neither is what moves it."""
LEAST_PERIODS = 8
"""Periods below which slope and scatter are not told apart."""


@frozen
class Creep:
    """How the rotation moves against its angle.

    Parameters
    ----------
    rate : float
        rad by which it gains in each period.
    std : float
    step : float
        rad of the clearest step beside the slope, and its deviation.
    step_std : float
    place : int
        First period behind the step.
    periods : int
    ahead : float
        Periods from t = 0 to the middle of those used.
    scatter : float
        What slope and step leave, over noise.
    """

    rate: float
    std: float
    step: float
    step_std: float
    place: int
    periods: int
    ahead: float
    scatter: float = 1.0

    @property
    def creeps(self) -> bool:
        """Whether the angle is worse known than it was said to be."""
        return abs(self.rate) > CREEPS * self.std

    @property
    def angle(self) -> float:
        """Angle, rad, by which the rotation may be off in the middle of the record."""
        return abs(self.rate) * max(self.ahead, self.periods / 2)

    @property
    def strays(self) -> bool:
        """Whether the creep is sure, and so large that the unbalance's line suffers."""
        return abs(self.rate) > STRAYS * self.std and abs(self.rate) * self.periods > LOST

    @property
    def jumps(self) -> bool:
        """Whether a step is sure."""
        return abs(self.step) > JUMPS * self.step_std


def creeps(point: Point, records: Sequence[Observation]) -> tuple[Creep | None, ...]:
    """Return how the rotation of each record moves against its angle, where that can be seen."""
    return tuple(_creep(at, r) for at, r in zip(point.records, records, strict=True))


def _creep(at: Evaluation, record: Observation) -> Creep | None:
    scatter, periodic = record.lines.scatter, record.periodic
    if scatter is None or periodic is None or not periodic.speed:
        return None
    if record.lines.periods < LEAST_PERIODS or at.ends is not None:
        return None
    turned = at.whiten(_turned(at, record))[:, 0]
    size = float(turned @ turned)
    if not size > 0:
        return None
    every = at.period_residual(scatter[:, :, list(record.order)])
    each = at.stacked(np.moveaxis(every - every.mean(axis=0), 0, 2))
    given = _given(periodic)
    if given is None:
        return None
    angles = -(turned @ each) / size - given
    middle = periodic.middle * periodic.fundamental
    return _fitted(angles, float(np.sqrt(len(angles) / size)), middle)


def _given(periodic: PeriodicRecord) -> Floats | None:
    """Return by how much the given angle is ahead of its line in each period; None off the lines.

    rad, less the mean.
    """
    turns = periodic.speed / (2 * np.pi * periodic.fundamental)
    if abs(turns - round(turns)) * periodic.periods > 1:
        return None
    wave = np.exp(-2j * np.pi * round(turns) * np.arange(periodic.samples) / periodic.samples)
    given = unread(periodic, "angle")
    if isinstance(given, Steady):
        turned = np.exp(1j * given.in_period * np.arange(periodic.periods))
    else:
        turned = np.exp(1j * given) @ wave
    phase = np.unwrap(np.angle(turned))
    return np.asarray(phase - phase.mean())


def _turned(at: Evaluation, record: Observation) -> Complexes:
    """Return the derivative of the rows by the phase, (line, row, 1): the loads a quarter on."""
    rows = np.zeros((at.problem.lines, at.problem.all_rows, 1), dtype=np.complex128)
    moving = record.lines.frequency > 0
    rows[moving, : at.problem.rows, 0] = 1j * at.loads[moving]
    return rows


def _fitted(angles: Floats, std: float, middle: float) -> Creep:
    """Fit a slope, and the step beside it that explains most; `std`: of one period."""
    count = len(angles)
    place = np.arange(count) - (count - 1) / 2
    size = float(place @ place)
    slope = float(place @ angles) / size
    rest = angles - slope * place
    # A step behind p periods, less its mean and slope; its size is what is left of it.
    steps = (np.arange(count) >= np.arange(1, count)[:, None]).astype(float)
    steps -= steps.mean(axis=1, keepdims=True)
    steps -= np.outer(steps @ place / size, place)
    length = np.sqrt((steps**2).sum(axis=1))
    found = steps @ rest / length
    best = int(np.argmax(np.abs(found)))
    left = rest - found[best] * steps[best] / length[best]
    return Creep(
        slope,
        std / float(np.sqrt(size)),
        float(found[best] / length[best]),
        std / float(length[best]),
        best + 1,
        count,
        middle,
        float(np.linalg.norm(left) / (std * np.sqrt(count - 3))),
    )


def told(record: Observation, creep: Creep) -> str:
    """Say how the rotation moves against its angle, and what to do."""
    periodic = record.periodic
    assert periodic is not None
    if creep.scatter > SCATTERS:
        return (
            f"the line of the rotation moves by {creep.scatter:.3g} times its noise from period to "
            "period, neither as with a speed that is off nor as with lost samples: a tone between "
            "the lines (another machine, a whirl at part of the speed) leaks into it, or the speed "
            "wanders; look at the spectrum (rotorid inspect --report), take periods that hold "
            "whole cycles of the tone, or record a mark (encoder or keyphasor)"
        )
    if creep.jumps and not creep.strays:
        when = float(periodic.time[creep.place, 0])
        return (
            f"the unbalance jumps by {np.degrees(creep.step):.3g} +- "
            f"{np.degrees(creep.step_std):.2g} degrees against its angle at about {when:.4g} s: "
            "samples were lost between the mark and the columns, or the speed changed; use the "
            "part before or behind"
        )
    true = periodic.speed + creep.rate * periodic.fundamental
    off = creep.std * periodic.fundamental
    return (
        f"speed: the unbalance turns with {true * 30 / np.pi:.8g} +- {off * 30 / np.pi:.2g} rpm, "
        f"not {periodic.speed * 30 / np.pi:.8g}, by {np.degrees(creep.rate * creep.periods):.3g} "
        "degrees over the record: give that speed, or record a mark (encoder or keyphasor)"
    )
