"""How far the answer may be off where the cost is no parabola: along the floor of its valley.

The deviations are those of the curvature at the minimum. Where a record informs some combination
of the unknowns only weakly, the valley along it bends: other unknowns leave their intervals long
before the cost rises. So the valley is followed both ways along the weakest directions, each step
led back to its floor, until the cost has risen as far as chance takes it. Over a parabola an
unknown moves by no more of its deviations than the root of the rise; one that moves further has a
deviation that much wider (profile likelihood).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rotorid.estimators.likelihood.inference import Inference, infer
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.solver import beside
from rotorid.frozen import frozen
from rotorid.record import Floats

WEAKEST = 2
"""Directions along which the valley is followed."""
STRIDE = 0.5
"""Length of a step, in deviations of its direction."""
STEEP = 4.0
"""Rise of the cost over one step from which on it has left the floor, or the valley its bend."""
SHORTEST = 1 / 64
"""Share of the stride below which a wall ends the valley."""
STRIDES = 40
"""Steps one way: three deviations take 6; those that a bend shortens took up to 37."""
HALF = 0.5
"""Share of its value by which an unknown may move in one step."""
RISEN = 9.0
"""Rise up to which the valley is followed: chance goes further in 3 of 1000 records. A rotor driven
on one axis at rest had k1 off by 8 deviations of the interval that a rise of 4 gives."""
LIKELY = 4.0
"""Rise up to which the size of loads is asked: that of the interval of 95 %."""
BEGUN = 1.0
"""Rise of one deviation. Below it its root says nothing of the width: rounding, and a floor not
quite reached."""
ENDLESS = 8.0
"""Deviations wider by this factor are none: the cost hardly tells where the unknown ends. Of
records that inform every parameter to a quarter the widest was 7."""


@frozen
class Valley:
    """What lies along a valley, in stated deviations of the free unknowns, (free,).

    Parameters
    ----------
    wider : array
        By how much deviations are wider than those of the curvature, 1 where they are not.
    lowest : Point
        The lowest point on the way, that of the minimum where none is lower.
    falls : bool
        Whether one is.
    """

    wider: Floats
    lowest: Point
    falls: bool = False


def explore(point: Point, inference: Inference, told: NDArray[np.bool_]) -> Valley:
    """Follow the valley of a minimum along its weakest directions, both ways."""
    free = point.problem.layout.free
    stated = np.sqrt(np.diag(inference.covariance).clip(0))
    unit = np.where(told, stated, 1.0)
    size, along = np.linalg.eigh(inference.covariance / np.outer(unit, unit) * np.outer(told, told))
    wider, lowest = np.ones(len(free)), point
    for k in range(max(0, len(size) - WEAKEST), len(size)):
        for sign in (-STRIDE, STRIDE):
            change = sign * np.sqrt(max(size[k], 0.0)) * along[:, k] * unit
            end = point
            for at in _floor(point, change, unit):
                rise = at.cost - point.cost
                if rise > RISEN:
                    break
                end = at if rise <= LIKELY else end
                lowest = at if at.cost < lowest.cost else lowest
                moved = np.abs(at.unknowns - point.unknowns)[free] / unit * told
                wider = np.maximum(wider, moved / np.sqrt(max(rise, BEGUN)))
                if (moved > 2 * ENDLESS).any():
                    break
            risen = np.sqrt(max(end.cost - point.cost, BEGUN))
            wider = np.maximum(wider, _of_loads(end, unit) * told / risen)
    return Valley(wider, lowest, lowest is not point)


def _of_loads(end: Point, unit: Floats) -> Floats:
    """Return the deviations of loads at another point, (free,), zero for what is no load.

    A load may come with a factor of its own, as (I_t - I_p) mu: where that nears zero, the same
    load has another size, and another deviation.
    """
    loads = np.isin(end.problem.layout.free, end.problem.affine)
    try:
        found = np.sqrt(np.diag(infer(end, end.problem.exact).covariance).clip(0))
    except np.linalg.LinAlgError:
        return np.zeros(len(unit))
    return np.where(loads & np.isfinite(found), found / unit, 0.0)


def _floor(point: Point, change: Floats, unit: Floats) -> Iterator[Point]:
    """Yield points of the floor that begins with a change of the free unknowns."""
    free, stride = point.problem.layout.free, float(np.linalg.norm(change / unit))
    at, step = point, change
    for _ in range(STRIDES):
        step = _shortened(step, at)
        found = beside(at, step)
        if found is None or found.cost > at.cost + STEEP:
            step = step / 4
            if np.linalg.norm(step / unit) < SHORTEST * stride:
                return
            continue
        yield found
        onward = (found.unknowns - at.unknowns)[free]
        length = float(np.linalg.norm(onward / unit))
        if length == 0:
            return
        step = onward / length * min(2 * float(np.linalg.norm(step / unit)), stride)
        at = found


def _shortened(step: Floats, at: Point) -> Floats:
    """Shorten a step that moves an unknown, other than a load or a shift, by too much of itself."""
    layout, affine = at.problem.layout, set(at.problem.affine.tolist())
    scaling = [i not in affine and not layout.unknowns[i].additive for i in layout.free]
    asked = np.array(scaling, dtype=bool) & (at.unknowns[layout.free] != 0)
    share = np.abs(step[asked] / at.unknowns[layout.free][asked])
    return step * min(1.0, HALF / max(float(share.max(initial=0.0)), 1e-300))
