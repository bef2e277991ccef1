"""Whether the unbalance keeps to the stated rotor angle (docs/maximum-likelihood.md, section 11).

Of a whole record the errors of the angle are ``sum_n a_n P_n(s)``, s = -1 .. 1 over it, P_n of
Legendre; ``a_0 = - sum_n a_n P_n(-1)``, which no data tell: the angle is as given where it begins.

Where the rotation stands on a line that is excited, the residual of each period moves along its
derivative d by the phase: ``a_p = d' (r_p - r) / |d|^2``. A speed that is off gives a_p a slope,
samples lost between the mark and the columns a step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from rotorid.answer.machine_checks import MOVED, REJECTED
from rotorid.core.linalg import steps_within, straightened
from rotorid.core.notes import Note
from rotorid.core.values import Floats, frozen
from rotorid.data.lines import SampledClock
from rotorid.data.observation import Observation, Records
from rotorid.data.record import Steady, changed, unread
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.problem import Point

ANGLE = "rotor angle"  # what the notes are about
ORDERS = 3  # of n: a speed that is off, one that changes, one that changes and comes back
TOLD = 1e-4  # chance below which straying is told; below that of a rejected model it is sure
LARGEST = 1.0
"""rad within a record up to which straying is small: beyond, the line of the rotation falls apart,
and the misfit tells."""
STEP = 1e-3  # rad of the difference that a derivative is taken from: half as much of it is lost
PLACES = np.linspace(-1.0, 1.0, 201)


def against_angle(point: Point, records: Records) -> Iterator[Note]:
    layout, std = point.problem.layout, point.linear.std
    held = np.isin(layout.free, layout.held) & (std > 0)
    for at, rows, record in zip(point.records, point.rows, records, strict=True):
        lines, clock = record.lines, record.lines.clock
        if lines.transient is None or not lines.speed.any() or not at.loads.any():
            continue
        assert isinstance(clock, SampledClock)  # of a whole record
        place, columns = np.linspace(-1.0, 1.0, len(clock.period)), list[Floats]()
        for shape in np.polynomial.legendre.legvander(place, ORDERS).T:
            turned = changed(clock, angle=clock.angle + STEP * shape)
            ahead = at.problem.loads_on(replace(lines, clock=turned))
            if ahead.shape != at.problem.load.shape:
                break
            change = np.tensordot(at.state.phase, (ahead - at.problem.load) / STEP, 1)
            columns.append(at.whitened_loads(change @ at.load_factors))
        if len(columns) <= ORDERS:
            continue
        every = np.zeros((len(point.residual), len(columns)))
        every[rows] = np.transpose(columns)  # by a_0 and each a_n
        explained, angles = point.linear.score(every[:, 1:])
        chance = float(scipy.special.chdtrc(ORDERS, explained))
        whole = np.append(-np.polynomial.legendre.legval(-1.0, [0.0, *angles]), angles)
        moved = np.abs(point.linear.taken(every @ whole)[held] / std[held])
        yield from _strays(record, angles, chance, float(moved.max(initial=0.0)))


def _strays(record: Observation, angles: Floats, chance: float, moved: float) -> Iterator[Note]:
    """Tell the a_n, (order,), in rad, that noise gives by a chance and that move a value."""
    angle, clock = np.polynomial.legendre.legval(PLACES, [0.0, *angles]), record.lines.clock
    size = float(np.ptp(angle))
    if chance >= TOLD or moved <= MOVED or size > LARGEST:
        return
    assert isinstance(clock, SampledClock)
    text = (
        f"the unbalance strays from its angle by {np.degrees(size):.3g} degrees within "
        f"the record, which moves a value by {moved:.2g} deviations"
    )
    if clock.speed.ndim:
        text += ": check the mark of the angle, its lines and its column"
    else:
        seconds = float(np.ptp(clock.period))
        rate = np.gradient(angle, seconds / (len(PLACES) - 1)) * 30 / np.pi
        stated = float(clock.speed) * 30 / np.pi
        text += (
            f": the speed runs from {stated + rate[1]:.7g} to {stated + rate[-2]:.7g} rpm, not "
            f"at {stated:.7g}; record a mark (encoder or keyphasor), or use a part in which it is "
            "steady, and state the speed of that part to the last digit"
        )
    yield Note(ANGLE, "rejects" if chance < REJECTED else "doubts", text)


CREEPS = 3.5
"""Deviations of the slope from which on the angle is no better known than by its creep: chance
takes one good record in two thousand there, whose deviations are then a little too wide."""
STRAYS = 6.0  # deviations from which on a creep is sure
JUMPS = 8.0
"""Deviations from which on a step is: of a thousand places chance makes 4.5, and noise that carries
over from period to period a little more."""
LOST = 0.155
"""Angle in rad over the record by which a creep costs a thousandth of the unbalance's line, which
no deviation of the angle makes good: sin(a / 2) / (a / 2) = 1 - a^2 / 24."""
SCATTERS = 5.0  # scatter about slope and step, over noise, from which on neither is what moves it
LEAST_PERIODS = 8  # periods below which slope and scatter are not told apart


@frozen
class Creep:
    rate: float  # rad by which it gains in each period
    std: float
    step: float  # rad of the clearest step beside the slope, and its deviation
    step_std: float
    place: int  # first period behind the step
    periods: int
    ahead: float  # periods from t = 0 to the middle of those used
    scatter: float = 1.0  # what slope and step leave, over noise

    @property
    def creeps(self) -> bool:
        return abs(self.rate) > CREEPS * self.std

    @property
    def angle(self) -> float:
        """Angle, rad, by which the rotation may be off in the middle of the record."""
        return abs(self.rate) * max(self.ahead, self.periods / 2)

    @property
    def strays(self) -> bool:
        return abs(self.rate) > STRAYS * self.std and abs(self.rate) * self.periods > LOST

    @property
    def jumps(self) -> bool:
        return abs(self.step) > JUMPS * self.step_std


def creeps(point: Point, records: Records) -> tuple[Creep | None, ...]:
    return tuple(_creep(at, r) for at, r in zip(point.records, records, strict=True))


def _creep(at: Evaluation, record: Observation) -> Creep | None:
    scatter, periodic = record.lines.scatter, record.periodic
    few = record.lines.periods < LEAST_PERIODS
    if scatter is None or periodic is None or not periodic.speed or few or at.ends is not None:
        return None
    moving = record.lines.frequency[:, None] > 0
    turned = at.whitened_loads(np.where(moving, 1j * at.loads, 0))  # by the phase: a quarter on
    size = float(turned @ turned)
    if not size > 0:
        return None
    turns = periodic.speed / (2 * np.pi * periodic.fundamental)
    given = unread(periodic, "angle")
    if periodic.rotation is not None:  # its line turns with the angle itself
        phase = np.zeros(periodic.periods)
    elif abs(turns - round(turns)) * periodic.periods > 1:  # it stands on no line
        return None
    elif isinstance(given, Steady):
        phase = np.unwrap(given.in_period * np.arange(periodic.periods))
    else:
        line = 2 * np.pi * round(turns) * np.arange(periodic.samples) / periodic.samples
        ahead = given - line
        within = ahead - ahead[:, :1]
        within -= 2 * np.pi * np.rint(within / (2 * np.pi))  # the angle may begin anew each turn
        phase = np.unwrap(ahead[:, 0] + within.mean(axis=1))
    every = at.period_residual(scatter[:, :, at.problem.order])
    each = at.stacked(np.moveaxis(every - every.mean(axis=0), 0, 2))
    angles = -(turned @ each) / size - (phase - phase.mean())
    middle = periodic.middle * periodic.fundamental
    return _fitted(angles, float(np.sqrt(len(angles) / size)), middle)


def _fitted(angles: Floats, std: float, middle: float) -> Creep:
    """Fit a slope, and the step beside it that explains most; `std`: of one period."""
    count = len(angles)
    place = np.arange(count) - (count - 1) / 2
    size = float(place @ place)
    rest = straightened(angles)
    along, lengths = steps_within(rest)
    length = np.sqrt(lengths)
    found = along / length
    best = int(np.argmax(np.abs(found)))
    step = straightened((np.arange(count) > best).astype(float))
    left = rest - found[best] * step / length[best]
    return Creep(
        float(place @ angles) / size,
        std / float(np.sqrt(size)),
        float(found[best] / length[best]),
        std / float(length[best]),
        best + 1,
        count,
        middle,
        float(np.linalg.norm(left) / (std * np.sqrt(count - 3))),
    )


def told(record: Observation, creep: Creep) -> str:
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
