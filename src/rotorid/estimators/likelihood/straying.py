"""Whether the unbalance keeps to the angle that was given, over a whole record.

A speed that changes by a ten-thousandth while a record is taken turns its unbalance away from the
angle and back by some degrees: no line stands out, both halves turn by as much, and the unbalance
comes out turned by what is left. But the load along the angle errors of low order,

    phi(t) + sum_n a_n P_n(s),   s = -1 .. 1 over the record, P_n of Legendre,

explains the residual, with what the unknowns can take over taken out: a_n is by least squares.
Unknowns move by what they take over of it, and of a_0, which no data tell: the angle is as it was
given where the record begins, so that a_0 = - sum_n a_n P_n(-1).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from rotorid.estimators.gate import MOVED, REJECTED, Verdict
from rotorid.estimators.likelihood.assembly import other_loads
from rotorid.estimators.likelihood.inference import along_relations
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.tangent import RANK
from rotorid.frozen import frozen
from rotorid.lines import WholeClock
from rotorid.observation import Observation
from rotorid.record import Floats

ORDERS = (1, 2, 3)
"""n: a speed that is off, one that changes, one that changes and comes back."""
TOLD = 1e-4
"""Chance below which straying is told; below that of a rejected model it is sure."""
LARGEST = 1.0
"""rad within a record up to which straying is small: beyond, the line of the rotation falls apart,
and the misfit tells."""
STEP = 1e-3
"""rad of the difference that a derivative is taken from: half as much of it is lost."""
PLACES = np.linspace(-1.0, 1.0, 201)


@frozen
class Straying:
    """How the rotation of a record strays from its angle.

    Parameters
    ----------
    angles : array, shape (order,)
        a_n in rad.
    chance : float
        With which noise alone gives as much.
    moved : float
        Deviations by which a value moves at most where the straying is taken out.
    """

    angles: Floats
    chance: float
    moved: float


def straying(point: Point, records: Sequence[Observation]) -> Iterator[tuple[int, Straying]]:
    """Yield number and straying of the records that were taken whole, where an unbalance shows."""
    turned = {n: _turned(point, n, record) for n, record in enumerate(records)}
    if not any(len(columns.T) for columns in turned.values()):
        return
    jacobian, scale, basis = along_relations(point, point.problem.exact)
    left, values, right = np.linalg.svd(jacobian, full_matrices=False)
    kept = values > RANK * values.max(initial=0.0)
    left, root = left[:, kept], right[kept].T / values[kept]
    std = np.sqrt(((scale[:, None] * (basis @ root)) ** 2).sum(axis=1))
    layout = point.problem.layout
    held = np.isin(layout.free, layout.held) & (std > 0)
    std = std[held]
    sizes = [len(at.residual) for at in point.records]
    for number, columns in turned.items():
        if not len(columns.T):
            continue
        every = np.zeros((len(jacobian), columns.shape[1]))
        first = sum(sizes[:number])
        every[first : first + len(columns)] = columns
        taken = left.T @ every
        rest = (every - left @ taken)[:, 1:]
        solved, _, rank, _ = np.linalg.lstsq(rest, -point.residual, rcond=RANK)
        angles: Floats = np.asarray(solved, dtype=np.float64)
        explained = float(((rest @ angles) ** 2).sum())
        chance = float(scipy.special.chdtrc(max(int(rank), 1), explained))
        whole = np.concatenate([[-_angle(angles, np.array([-1.0]))[0]], angles])
        change = (scale * (basis @ (root @ (taken @ whole))))[held]
        yield number, Straying(angles, chance, float(np.abs(change / std).max(initial=0.0)))


def _angle(angles: Floats, place: Floats) -> Floats:
    """Return by how much the rotation is ahead of its angle at places of the record."""
    shapes = scipy.special.eval_legendre(np.array(ORDERS), place[:, None])
    return np.asarray(shapes @ angles)


def _turned(point: Point, number: int, record: Observation) -> Floats:
    """Return the derivative of a record's residual by a_0 and each a_n, (real equation, order)."""
    at, clock = point.records[number], record.lines.clock
    nothing = np.zeros((len(at.residual), 0))
    if not isinstance(clock, WholeClock) or not record.lines.speed.any() or not at.loads.any():
        return nothing
    loads = other_loads(point.problem.layout, record, number, at.problem)
    place = np.linspace(-1.0, 1.0, len(clock.time))
    columns = []
    for order in (0, *ORDERS):
        angle = clock.angle + STEP * scipy.special.eval_legendre(order, place)
        ahead = loads(replace(record.lines, clock=replace(clock, angle=angle)))
        if ahead.shape != at.problem.load.shape:
            return nothing
        rows = np.zeros((at.problem.lines, at.problem.all_rows, 1), dtype=np.complex128)
        change = np.tensordot(at.state.phase, (ahead - at.problem.load) / STEP, 1) @ at.load_factors
        rows[:, : at.problem.rows, 0] = change
        columns.append(at.whiten(rows)[:, 0])
    return np.stack(columns, axis=1)


def against_angle(point: Point, records: Sequence[Observation]) -> Verdict:
    """Judge whether the rotation of whole records keeps to its angle, where it matters."""
    total = Verdict()
    for number, found in straying(point, records):
        size = float(np.ptp(_angle(found.angles, PLACES)))
        if found.chance >= TOLD or found.moved <= MOVED or size > LARGEST:
            continue
        text = _told(records[number], found)
        sure = found.chance < REJECTED
        total += Verdict(faults=(text,)) if sure else Verdict(doubts=(text,))
    return total


def _told(record: Observation, found: Straying) -> str:
    """Say how far the rotation strays, what speed would do, and what to do."""
    clock = record.lines.clock
    assert isinstance(clock, WholeClock)
    seconds = float(clock.time[-1] - clock.time[0])
    angle = _angle(found.angles, PLACES)
    rate = np.gradient(angle, seconds / (len(PLACES) - 1)) * 30 / np.pi
    said = (
        f"the unbalance strays from its angle by {np.degrees(np.ptp(angle)):.3g} degrees within "
        f"the record, which moves a value by {found.moved:.2g} deviations"
    )
    if clock.speed.ndim:
        return f"{said}: check the mark of the angle, its lines and its column"
    stated = float(clock.speed) * 30 / np.pi
    return (
        f"{said}: the speed runs from {stated + rate[1]:.7g} to {stated + rate[-2]:.7g} rpm, not "
        f"at {stated:.7g}; record a mark (encoder or keyphasor), or use a part in which it is "
        "steady, and state the speed of that part to the last digit"
    )
