"""Campbell diagram, critical speeds and the unbalance response.

A critical speed is where a free vibration rings with the rotation: ``Im lambda(Omega) = |Omega|``.
Roots are bracketed on a grid of speeds by the number of modes above the rotation, which is
continuous where curves cross each other, and no curve is followed for it. The grid holds the speeds
between the eigenvalues of ``Omega^2 (i G - M) + i Omega D + K``, so that no two roots fall into one
of its intervals where matrices do not depend on the speed otherwise. Notation as in `modes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg
import scipy.optimize

from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import ByContent, Complexes, Floats, Integers
from rotorid.core.watch import counting
from rotorid.models import Model
from rotorid.results.machine import Machine, machine_of
from rotorid.results.modes import (
    NORMAL,
    Eigen,
    Whirl,
    chosen,
    deviations,
    drawn_blocks,
    eigen_at,
    eigenvalues_at,
    finite_speed,
    gram,
    pattern_of,
    whirls_of,
)

POINTS = 61
"""Speeds of a diagram."""
SCAN = 120
"""Speeds at which modes above the rotation are counted, besides those from the eigenvalues."""
EXACT = 1e-10
"""Share of a speed to which a root is found."""
FALSE = 1e-6
"""Share of the speed by which a root may miss: more, and the count changed as a mode vanished."""
BESIDE = 1e-3
"""Share of a speed at which one looks beside it: a mode that still rings there turns along."""
ALIKE = 0.7
"""Overlap of shapes below which a step of the speed is halved to follow a curve."""
HALVINGS = 6
"""Halvings of a step at the most: curves that still part then touch one another."""
CURVES, SPARE = 24, 8
"""Curves of a diagram: the lowest; and those above that are followed with them, and may fall."""


@frozen
class CriticalSpeed:
    """A speed at which a natural frequency is that of the rotation."""

    speed_rad_s: float  # negative for a rotor that turns backward
    std: float | None  # rad/s; ``None`` where nothing is known of the deviations
    # {"forward", "backward", "planar", "mixed"}: unbalance of a machine that is the same in two
    # planes excites forward ones alone
    whirl: Whirl
    damping_ratio: float  # of the mode there
    interval: tuple[float, float] | None  # (float, float) or None: holds 95 percent, rad/s


@frozen
class Campbell(ByContent):
    """Natural frequencies over the speed, and critical speeds."""

    model: str
    speed: Floats  # (speed,): rad/s
    # (speed, curve): naN where a mode does not oscillate; deviations are NaN where nothing is known
    # of them
    frequency_hz: Floats
    std_hz: Floats
    damping_ratio: Floats
    whirl: tuple[Whirl, ...]  # of each curve, at the last speed at which it oscillates
    critical: tuple[CriticalSpeed, ...]
    status: str
    remarks: tuple[str, ...]


def campbell(
    source: Estimate | Model,
    to: float | str,
    *,
    record: int = 0,
    rng: np.random.Generator | None = None,
) -> Campbell:
    """Return natural frequencies from standstill to a speed, and the critical speeds on the way.

    Of the machine that the equations describe, without forces at its inputs, as `modes`. Critical
    speeds are where ``Im lambda(Omega) = |Omega|``.

    Parameters
    ----------
    source : Estimate or Model
        A model is taken at its nominal values, without deviations.
    to : float or str
        rad/s, or a text with unit; negative for a rotor that turns backward.
    record : int
        Whose values are taken of what every record has to itself.
    rng : numpy.random.Generator, optional
        Of the draws where modes come close.

    Returns
    -------
    Campbell

    Raises
    ------
    InputError
        As `modes`, and for a speed of zero.

    Examples
    --------
    >>> import rotorid as rid
    >>> found = rid.campbell(rid.load_model("jeffcott"), "6000 rpm")
    >>> [round(each.speed_rad_s, 2) for each in found.critical]
    [447.17]
    """
    machine = machine_of(source, record)
    last = finite_speed(to, "to")
    if last == 0:
        raise InputError("0", "a speed to go to", "give the highest speed", place="to")
    speeds = np.linspace(0.0, last, POINTS)
    eigen = [
        eigen_at(machine, speed, CURVES + SPARE)
        for speed in counting(speeds.tolist(), "modes at speeds")
    ]
    order = _curves(machine, speeds, eigen)
    shape = (len(speeds), order.shape[1])
    hertz, std, ratio = (np.full(shape, np.nan) for _ in range(3))
    for k, (speed, at) in enumerate(zip(speeds.tolist(), eigen, strict=True)):
        there = order[k] >= 0
        values = at.found.values[order[k, there]]
        hertz[k, there] = values.imag / (2 * np.pi)
        ratio[k, there] = -values.real / np.abs(values)
        spread, _ = deviations(machine, speed, at, rng)
        if spread is not None:
            std[k, there] = spread[order[k, there], 0]
    return Campbell(
        machine.model.name,
        speeds,
        hertz,
        std,
        ratio,
        _whirls(machine, speeds, eigen, order),
        tuple(critical_speeds(machine, last, rng)),
        machine.status,
        machine.remarks,
    )


def _whirls(
    machine: Machine, speeds: Floats, eigen: Sequence[Eigen], order: Floats
) -> tuple[Whirl, ...]:
    """Return the whirl of each curve, at the last speed at which it oscillates."""
    last = [int(np.flatnonzero(curve >= 0)[-1]) for curve in order.T]
    at = {k: whirls_of(machine, float(speeds[k]), eigen[k].found) for k in set(last)}
    return tuple(at[k][int(order[k, curve])] for curve, k in enumerate(last))


def _curves(machine: Machine, speeds: Floats, eigen: Sequence[Eigen]) -> Floats:
    """Return which mode each curve is at each speed, (speed, curve); -1 where it is none."""
    first = len(eigen[0].found.values)
    rows = [list(range(first))]
    for k in range(len(speeds) - 1):
        found = _followed(machine, speeds[k], speeds[k + 1], eigen[k], eigen[k + 1], HALVINGS)
        rows.append([found.get(i, -1) for i in rows[-1]])
        new = [j for j in range(len(eigen[k + 1].found.values)) if j not in found.values()]
        rows[-1] += new
    width = max(map(len, rows))
    table = np.array([[*row, *[-1] * (width - len(row))] for row in rows], dtype=np.int64)
    table = table[:, (table >= 0).any(axis=0)]
    height = [
        min(eigen[k].found.values[i].imag for k, i in enumerate(curve) if i >= 0)
        for curve in table.T
    ]
    return np.asarray(table[:, np.sort(np.argsort(height, kind="stable")[:CURVES])])


def _followed(
    machine: Machine, here: float, there: float, at: Eigen, to: Eigen, left: int
) -> dict[int, int]:
    """Return which mode at the next speed each mode is."""
    overlap = _overlap(machine, here, at, to)
    if not overlap.size:
        return {}
    away = np.abs(at.found.values.imag[:, None] - to.found.values.imag)
    scale = max(float(np.abs(at.found.values).max()), 1e-300)
    rows, columns = scipy.optimize.linear_sum_assignment(away / scale - overlap)
    sure = overlap[rows, columns] > ALIKE
    for placed, modes in ((rows, at.found), (columns, to.found)):
        for group in modes.distinct:
            if len(group) > 1:  # their vectors are any
                sure |= np.isin(placed, group)
    if sure.all() or left == 0:
        return dict(zip(rows.tolist(), columns.tolist(), strict=True))
    middle = (here + there) / 2
    half = eigen_at(replace(machine, covariance=None), middle, CURVES + SPARE)
    one = _followed(machine, here, middle, at, half, left - 1)
    two = _followed(machine, middle, there, half, to, left - 1)
    return {i: two[j] for i, j in one.items() if j in two}


def _overlap(machine: Machine, speed: float, at: Eigen, to: Eigen) -> Floats:
    """Return how alike the modes of two speeds are, (mode, mode): 1 for the same shape."""
    one, two = at.found, to.found
    crossed = gram(machine, speed, one, two)
    back = gram(machine, speed, two, one).T
    size = np.outer(*(np.abs(np.diag(gram(machine, speed, each, each))) for each in (one, two)))
    return np.sqrt(np.abs(crossed * back) / np.where(size > 0, size, np.inf)).clip(0, 1)


def critical_speeds(
    machine: Machine, to: float, rng: np.random.Generator | None = None
) -> list[CriticalSpeed]:
    """Return the critical speeds between standstill and a speed, in ascending order."""
    sign = -1.0 if to < 0 else 1.0
    grid = _grid(machine, to)
    above = [
        _above(machine, sign * speed) for speed in counting(grid, "looking for critical speeds")
    ]
    roots: list[float] = []
    for low, high, one, two in zip(grid[:-1], grid[1:], above[:-1], above[1:], strict=True):
        # A root of the mode that is number k from the top, for each k that one end counts alone.
        for k in range(min(len(one), len(two)), max(len(one), len(two))):
            root = _root(machine, sign, k, low, high)
            if root is not None:
                roots.append(root)
    found: list[CriticalSpeed] = []
    for root in sorted(roots):
        if found and root - abs(found[-1].speed_rad_s) < FALSE * root:
            continue  # the other plane of the same mode, or of one as close: found there already
        found += _critical(machine, sign * root, rng)
    return found


def _grid(machine: Machine, to: float) -> list[float]:
    """Return the speeds, above 0, at which modes above the rotation are counted."""
    last = abs(to)
    seeds = _seeds(machine, to)
    between = (seeds[:-1] + seeds[1:]) / 2
    beside = np.concatenate([seeds * (1 - BESIDE), seeds * (1 + BESIDE), between])
    regular = np.linspace(0, last, SCAN + 1)[1:]
    first = min([last * 1e-3, *(seeds[:1] / 2)])
    points = np.concatenate([[first], regular, beside[(beside > first) & (beside < last)]])
    found: list[float] = np.unique(points).tolist()
    return found


def _seeds(machine: Machine, to: float) -> Floats:
    """Return approximate critical speeds: those of the matrices as they are half way."""
    half = to / 2
    stiffness, damping, mass = machine.matrices(half)
    gyroscopic = machine.matrices_by_speed(half)[1]
    constant = damping - half * gyroscopic
    n = len(mass)
    pencil = np.zeros((2, 2 * n, 2 * n), dtype=np.complex128)
    heavy, stiff = np.abs(mass).max(initial=0.0), np.abs(stiffness).max(initial=0.0)
    scale = float(np.sqrt(stiff / heavy)) if heavy > 0 and stiff > 0 else max(abs(half), 1.0)
    pencil[0, :n, n:] = pencil[1, :n, :n] = np.eye(n)
    pencil[0, n:, :n], pencil[0, n:, n:] = -stiffness, -1j * scale * constant
    pencil[1, n:, n:] = scale**2 * (1j * gyroscopic - mass)
    values = scipy.linalg.eigvals(*pencil)
    values = scale * values[np.isfinite(values)]
    real = np.abs(values.real)[np.abs(values.imag) < np.abs(values.real)]
    return np.sort(real[(real > 0) & (real < 2 * abs(to))])


def _above(machine: Machine, speed: float) -> Floats:
    """Return by how much modes lie above the rotation, those that do, the highest first."""
    over = eigenvalues_at(machine, speed).imag - abs(speed)
    return np.sort(over[over > 0])[::-1]


def _root(machine: Machine, sign: float, k: int, low: float, high: float) -> float | None:
    """Return the speed at which the mode that is number k from the top rings with the rotation."""

    def over(speed: float) -> float:
        values = np.sort(eigenvalues_at(machine, sign * speed).imag)[::-1]
        return float(values[k] - speed) if k < len(values) else -speed

    if over(low) * over(high) > 0:
        return None
    root = float(scipy.optimize.brentq(over, low, high, xtol=EXACT * high, rtol=EXACT))
    if max(abs(over(root * (1 - BESIDE))), abs(over(root * (1 + BESIDE)))) < EXACT * root:
        return None  # it turns with the rotor at every speed: I_p = I_t
    return root if abs(over(root)) < FALSE * root else None


def _critical(
    machine: Machine, speed: float, rng: np.random.Generator | None
) -> list[CriticalSpeed]:
    """Return what is at a critical speed: one, or those of modes that coincide there by chance."""
    eigen = eigen_at(machine, speed)
    values = eigen.found.values
    found = []
    for group in eigen.found.grouped(pattern_of(machine, speed)):
        near = int(group[0])
        if abs(values[near].imag - abs(speed)) > FALSE * abs(speed):
            continue
        whirl = whirls_of(machine, speed, eigen.found)[near]
        ratio = float(-values[near].real / abs(values[near]))
        spread: tuple[float | None, tuple[float, float] | None] = (None, None)
        if machine.covariance is not None:
            spread = _spread(machine, speed, eigen, near, rng)
        found.append(CriticalSpeed(speed, spread[0], whirl, ratio, spread[1]))
    return found


def _spread(
    machine: Machine, speed: float, eigen: Eigen, near: int, rng: np.random.Generator | None
) -> tuple[float, tuple[float, float]]:
    """Return the deviation of a critical speed, and the interval that holds 95 percent."""
    sign = -1.0 if speed < 0 else 1.0
    group = next(g for g in (*eigen.clusters, *eigen.found.distinct) if near in g)
    by_speed = sign * _by_speed(machine, speed, eigen, group)
    if not any(near in c for c in eigen.clusters):
        slope = complex(np.trace(by_speed)) / len(group)
        along = -eigen.slopes[near].imag / (slope.imag - 1)
        std = float(np.linalg.norm(along @ machine.root))
        reach = NORMAL * std
        return std, (speed - reach, speed + reach)
    draws = np.random.default_rng(0) if rng is None else rng
    away = np.diag(eigen.found.values[group]) - 1j * abs(speed) * np.eye(len(group))
    matrices = away + drawn_blocks(machine, speed, eigen, group, draws)
    turning = 1j * np.eye(len(group)) - by_speed
    drawn = np.sort(np.linalg.eigvals(np.linalg.solve(turning, matrices)).real, axis=1)
    here = np.sort(np.linalg.eigvals(np.linalg.solve(turning, away)).real)
    off = sign * drawn[:, int(np.abs(here).argmin())]
    low, high = np.quantile(off, [0.025, 0.975]).tolist()
    return float(np.sqrt((off**2).mean())), (speed + low, speed + high)


def _by_speed(machine: Machine, speed: float, eigen: Eigen, group: Integers) -> Complexes:
    """Return how the eigenvalues of some modes move with the speed, shape (mode, mode)."""
    stiffness_by, damping_by, mass_by = machine.matrices_by_speed(speed)
    found = chosen(eigen.found, group)
    middle = complex(found.values.mean())
    moved = middle**2 * mass_by + middle * damping_by + stiffness_by
    right = found.left.conj() @ moved @ found.right.T
    return np.asarray(-np.linalg.solve(gram(machine, speed, found, found), right))


@frozen
class UnbalanceResponse(ByContent):
    """Motion on the rotation's line over the speed: ``q = Re(Q exp(i phi))``."""

    coordinates: tuple[str, ...]
    speed: Floats  # (speed,): rad/s
    motion: Complexes  # (speed, coordinate): naN at an undamped critical speed
    # (speed, coordinate): of the amplitude; NaN where nothing is known of the deviations
    std: Floats


def unbalance_response(
    source: Estimate | Model, speeds: Floats | float | str, *, record: int = 0
) -> UnbalanceResponse:
    """Return the motion that the identified unbalance makes at some speeds, with deviations.

    ``Z(Omega) Q = g(Omega)`` without forces at the inputs, by the delta method.

    Parameters
    ----------
    source : Estimate or Model
    speeds : array, shape (speed,), or float or str
        rad/s; one speed with its unit as text.
    record : int
        Whose values are taken of what every record has to itself.

    Returns
    -------
    UnbalanceResponse

    Raises
    ------
    InputError
        For a machine whose equations hold no unbalance, and as `rid.modes`.

    Examples
    --------
    >>> import rotorid as rid
    >>> found = rid.unbalance_response(rid.load_model("jeffcott"), "3000 rpm")
    >>> f"{abs(found.motion[0, 0]) * 1e6:.1f} um"
    '21.8 um'
    """
    if isinstance(speeds, str):
        speeds = finite_speed(speeds)
    return response_of(machine_of(source, record), np.atleast_1d(np.asarray(speeds, dtype=float)))


def response_of(machine: Machine, speeds: Floats) -> UnbalanceResponse:
    if not machine.linear.load_terms:
        raise InputError(
            f"the model {machine.model.name!r} without unbalance",
            "terms in cos(phi) and sin(phi)",
            "write the unbalance into its equations",
        )
    shape = (len(speeds), machine.linear.coordinates)
    motion = np.full(shape, np.nan, dtype=np.complex128)
    std = np.full(shape, np.nan)
    for k, speed in enumerate(speeds.tolist()):
        try:
            motion[k], slopes = machine.response(speed)
        except InputError:
            continue
        if machine.covariance is not None:
            std[k] = amplitude_std(motion[k], slopes @ machine.root)
    return UnbalanceResponse(machine.model.coordinates, speeds, motion, std)


def amplitude_std(value: Complexes, root: Complexes) -> Floats:
    """Return the deviation of |value|, which has a root of its covariance, (..., unknown).

    Where the value is small beside its deviations there is no direction: that of the vector then.
    """
    size = np.abs(value)
    whole = np.sqrt((np.abs(root) ** 2).sum(axis=-1))
    direction = np.where(size > 0, value / np.where(size > 0, size, 1.0), 1.0)
    along = np.linalg.norm((direction.conj()[..., None] * root).real, axis=-1)
    return np.asarray(np.where(size > whole, along, whole))
