"""Natural frequencies, damping and whirl, Campbell diagram and critical speeds (docs/modes.md).

Notation: lambda of ``L = lambda^2 M + lambda (D + Omega G) + K`` with right and left vectors x, y;
close modes are drawn from the block ``diag(lambda) + sum_u A_u dx_u``, ``A_u = - (Y^H dL_u X) /
(Y^H ((lambda_i + lambda_j) M + D + Omega G) X)``. An orbit is the sum of a circle of radius
``|X + i Y| / 2`` run through from x to y and one of radius ``|X - i Y| / 2`` the other way.

Roots are bracketed on a grid that holds the speeds between the eigenvalues of
``Omega^2 (i G - M) + i Omega D + K``, so that no two roots fall into one of its intervals where
matrices do not depend on the speed otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, Literal, TypeVar, cast

import numpy as np
import scipy.optimize

from rotorid.answer.estimate import Estimate
from rotorid.core.distributions import HALF_WIDTH
from rotorid.core.errors import InputError
from rotorid.core.linalg import coupled
from rotorid.core.notes import Note
from rotorid.core.units import finite_speed
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.core.watch import counting
from rotorid.models import Model
from rotorid.models.modal import Eigenmodes, distinct, eigenmodes, eigenvalues, parted, poles_of
from rotorid.results.machine import Machine, OfAMachine, machine_of

Whirl = Literal["forward", "backward", "planar", "mixed"]
PLANAR = 0.02  # orbits with a smaller ratio of axes are lines: no probe tells their sense
SILENT = 0.02  # places with a smaller share of the kinetic energy do not say how a mode whirls
_X = re.compile("[xX]")


def partners(coordinates: Sequence[str]) -> list[tuple[int, int]]:
    """Return the coordinates that are one of x and one of y at the same place, by their names."""
    places = {name: i for i, name in enumerate(coordinates)}
    found: list[tuple[int, int]] = []
    taken: set[int] = set()
    for name, i in places.items():
        for match in _X.finditer(name):
            letter = "Y" if match.group() == "X" else "y"
            other = name[: match.start()] + letter + name[match.end() :]
            if other in places and not {i, places[other]} & taken:
                found.append((i, places[other]))
                taken |= {i, places[other]}
    return found


def whirl_of(
    shape: Complexes, pairs: Sequence[tuple[int, int]], weight: Floats, speed: float
) -> Whirl:
    """Return how a mode whirls, forward being the way the rotor turns.

    `weight` holds the inertia of each coordinate, so that places of rest do not count.
    """
    if not pairs:
        return "planar"
    x, y = np.array(pairs).T
    inertia = weight[x] + weight[y]
    forward, backward = np.abs(shape[x] + 1j * shape[y]), np.abs(shape[x] - 1j * shape[y])
    energy = (inertia if inertia.any() else 1.0) * (forward**2 + backward**2)
    speaks = energy > SILENT * energy.sum()
    ratio = ((forward - backward)[speaks] / (forward + backward)[speaks]) * (-1 if speed < 0 else 1)
    if (np.abs(ratio) < PLANAR).all():
        return "planar"
    if ratio.min() < -PLANAR and ratio.max() > PLANAR:
        return "mixed"
    return "forward" if ratio.sum() > 0 else "backward"


Found = TypeVar("Found")
CLOSE = 4.0
"""Modes nearer than this many deviations of their distance, coupling included, are drawn: at 4 the
second-order term is a sixteenth of the first, and what the delta method states holds again."""
BESIDE = 3
"""Neighbours, by frequency, that each mode is held against: two planes of two modes that cross."""
TERMS = 1 << 22
"""Products of terms of the matrices and pairs of modes at a time: 64 MB."""
ROUNDING = 1e-9
"""Deviations, in Hz or of a damping ratio, that are none."""
DRAWS = 4000
"""Draws of the unknowns: a deviation comes out within 1.1 percent."""


@frozen
class NaturalMode:
    frequency_hz: float  # ``Im lambda / (2 pi)``, with which a free vibration rings
    std_hz: float | None  # ``None`` where nothing is known of the deviations
    damping_ratio: float  # ``- Re lambda / |lambda|``; negative for a mode that grows
    damping_std: float | None
    # {"forward", "backward", "planar", "mixed"}: forward is the way the rotor turns; mixed: forward
    # at some places and backward at others
    whirl: Whirl
    count: int  # 2 for a machine that is the same in two planes
    close: bool  # whether another mode is so close that deviations come from draws
    # (float, float) or None: holds 95 percent; not symmetric where modes come close
    interval_hz: tuple[float, float] | None
    eigenvalue: complex  # complex: lambda in rad/s
    shape: tuple[complex, ...]  # sequence of complex: of each coordinate, the largest 1
    # how far they may move if what is assumed is wrong; NaN at the speeds of the records
    std_assumed_hz: float = np.nan
    damping_std_assumed: float = np.nan


@frozen
class Modes(OfAMachine):
    """The natural frequencies of a machine at a speed, ascending, counted as in `Mode`."""

    machine: Machine = field(repr=False, compare=False)
    speed: float  # rad/s
    modes: tuple[NaturalMode, ...]
    rigid: int  # poles at zero: free motion, which is no mode
    real_poles: tuple[float, ...]  # real poles, in rad/s
    notes: tuple[Note, ...] = ()  # what is assumed at this speed, and what that may move


def modes(
    source: Estimate | Model,
    speed: float | str = 0.0,
    *,
    record: int = 0,
    rng: np.random.Generator | None = None,
) -> Modes:
    """Return natural frequencies, damping and whirl of a result or a model, with deviations.

    Of the machine that the equations describe, without forces at its inputs: what a controller or
    the negative stiffness of magnets adds is no part of it. Deviations follow by the delta method
    from the covariance of the parameters, and by draws where modes come close.

    Parameters
    ----------
    source : Estimate or Model
        A model is taken at its nominal values, without deviations.
    speed : float or str
        rad/s, or a text with unit; negative turns backward.
    record : int
        Whose values are taken of what every record has to itself.
    rng : numpy.random.Generator, optional
        Of the draws; by default one that makes the same draws each time.

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        For a result that leaves them undetermined, and for models that are not linear.

    Examples
    --------
    >>> import rotorid as rid
    >>> found = rid.modes(rid.load_model("three-mass"), "8400 rpm")
    >>> [round(mode.frequency_hz, 2) for mode in found.modes[:3]], found.modes[0].whirl
    ([36.85, 175.53, 175.53], 'forward')
    """
    machine = machine_of(source, record)
    at = Eigen(machine, finite_speed(speed), rng=rng)
    real = tuple(at.found.real.tolist())
    return Modes(machine, at.speed, tuple(at.modes()), at.found.rigid, real, tuple(at.assumed[1]))


def eigenvalues_at(machine: Machine, speed: float) -> Complexes:
    return _solved(eigenvalues, machine, speed)


def _solved(solve: Callable[..., Found], machine: Machine, speed: float) -> Found:
    """Solve for the modes of a machine at a speed; once, where these are the same at every one."""
    if (known := machine.solutions.get(solve.__name__)) is not None:
        return cast(Found, known)
    stiffness, damping, mass = machine.matrices(speed)
    try:
        found = solve(mass, damping, stiffness)
    except np.linalg.LinAlgError as error:
        raise InputError(
            str(error), "a machine with finite values", "check the values and their units"
        ) from None
    if machine.steady:
        machine.solutions[solve.__name__] = found
    return found


def chosen(found: Eigenmodes, modes: slice | Integers) -> Eigenmodes:
    return replace(
        found, values=found.values[modes], right=found.right[modes], left=found.left[modes]
    )


@frozen
class Eigen:
    """The modes of a machine at a speed, or its lowest, and how they follow from the unknowns."""

    machine: Machine
    speed: float
    lowest: int | None = None
    rng: np.random.Generator | None = None  # of draws; None: the same ones each time

    @cached_property
    def found(self) -> Eigenmodes:
        return chosen(_solved(eigenmodes, self.machine, self.speed), slice(self.lowest))

    @cached_property
    def groups(self) -> list[Integers]:
        """Which modes are one, as they are in general."""
        apart = distinct(eigenvalues_at(self.machine.elsewhere, self.speed))
        return self.found.grouped(tuple(map(len, apart)))

    @cached_property
    def whirls(self) -> list[Whirl]:
        """How each mode whirls.

        Modes of a machine that is the same in two planes are planar; those that coincide by chance
        whirl as they do when they part.
        """
        machine, speed, found = self.machine, self.speed, self.found
        pairs, weight = partners(machine.model.coordinates), machine.inertia(speed)
        whirls = [whirl_of(shape, pairs, weight, speed) for shape in found.right]
        if all(len(group) == 1 for group in found.distinct):
            return whirls
        parted_ = _solved(eigenmodes, machine.elsewhere, speed)
        apart = [i for group in parted_.distinct if len(group) == 1 for i in group]
        for group in found.distinct:
            for i in group if len(group) > 1 else ():
                alone = i in apart and len(parted_.values) == len(found.values)
                whirls[i] = whirl_of(parted_.right[i], pairs, weight, speed) if alone else "planar"
        return whirls

    @cached_property
    def slopes(self) -> Complexes:
        """D lambda / d unknown, (mode, unknown)."""
        machine, found = self.machine, self.found
        _, damping, mass = machine.matrices(self.speed)
        slopes = np.zeros((len(found.values), len(machine.values)), dtype=np.complex128)
        pencil = machine.pencil(self.speed)
        for group in found.distinct:
            value = complex(found.values[group].mean())
            left, right = found.left[group], found.right[group]
            gram = left.conj() @ (2 * value * mass + damping) @ right.T
            inner = pencil.slopes(value, left, right, machine.values)
            slopes[group] = parted(gram, inner, machine.spread)
        return slopes

    @cached_property
    def clusters(self) -> tuple[Integers, ...]:
        """The modes whose order or shapes are not certain, together: two or more each."""
        values, count = self.found.values, len(self.found.values)
        if count < 2 or self.machine.covariance is None:
            return ()
        root = self.machine.root
        pairs = np.array(
            [(i, j) for i in range(count) for j in range(i + 1, min(i + 1 + BESIDE, count))]
        ).reshape(-1, 2)
        apart = np.linalg.norm((self.slopes[pairs[:, 0]] - self.slopes[pairs[:, 1]]) @ root, axis=1)
        blocks = self._block(pairs)
        across = [np.linalg.norm(blocks[:, i, 1 - i] @ root, axis=1) for i in (0, 1)]
        spread = np.hypot(apart, 2 * np.sqrt(across[0] * across[1]))
        near = np.abs(np.diff(values[pairs], axis=1)[:, 0]) < CLOSE * spread
        joined = np.zeros((count, count), dtype=bool)
        joined[tuple(pairs[near & (spread > 1e-9 * np.abs(values[pairs[:, 0]]))].T)] = True
        return tuple(coupled(joined))

    def gram(self, one: Eigenmodes, two: Eigenmodes) -> Complexes:
        """Return ``Y^H ((lambda_i + lambda_j) M + D + Omega G) X``, Y of one and X of two."""
        _, damping, mass = self.machine.matrices(self.speed)
        sums = one.values[..., :, None] + two.values[..., None, :]
        left, right = one.left.conj(), two.right.swapaxes(-1, -2)
        return np.asarray(sums * (left @ mass @ right) + left @ damping @ right)

    def _block(self, group: Integers) -> Complexes:
        """Return A_u of modes, (mode, mode, unknown); of several groups, (group, mode)."""
        pencil, values = self.machine.pencil(self.speed), self.machine.values
        groups, size = group.reshape(-1, group.shape[-1]), group.shape[-1]
        parts: list[Any] = [np.zeros((0, size, size, len(values)), dtype=np.complex128)]
        chunk = max(1, TERMS // (size**2 * max(len(pencil.terms), 1)))
        for first in range(0, len(groups), chunk):
            here = chosen(self.found, groups[first : first + chunk])
            inner = pencil.slopes(here.values.mean(axis=1), here.left, here.right, values)
            right = inner.reshape(len(inner), size, -1)
            parts.append(-np.linalg.solve(self.gram(here, here), right).reshape(inner.shape))
        return np.concatenate(parts).reshape(*group.shape, size, len(values))

    def drawn(self, cluster: Integers, rng: np.random.Generator) -> Complexes:
        """Return draws of ``sum_u A_u dx_u`` of close modes, shape (draw, mode, mode)."""
        moved = rng.standard_normal((DRAWS, len(self.machine.values))) @ self.machine.root.T
        return np.asarray(np.einsum("iju,du->dij", self._block(cluster), moved))

    @property
    def draws(self) -> np.random.Generator:
        return np.random.default_rng(0) if self.rng is None else self.rng

    def spread(self, root: Floats) -> Floats:
        """Return what a root of the covariance makes of frequency (Hz) and damping ratio."""
        values, slopes = self.found.values, self.slopes
        frequency = np.linalg.norm((slopes.imag / (2 * np.pi)) @ root, axis=1)
        along = (values.conj()[:, None] * slopes).real / np.abs(values)[:, None] ** 2
        ratio = (values.real[:, None] * along - slopes.real) / np.abs(values)[:, None]
        return np.column_stack([frequency, np.linalg.norm(ratio @ root, axis=1)])

    @cached_property
    def assumed(self) -> tuple[Floats, list[Note]]:
        """What errors of what is assumed move frequency and damping ratio by, and notes on it."""
        numbers = {i: n for n, group in enumerate(self.groups, 1) for i in group.tolist()}
        whats = ("frequency", "damping ratio")
        names = [f"{what} of mode {numbers[i]}" for i in sorted(numbers) for what in whats]
        spread = self.deviations[0]
        std = np.zeros((0, 2)) if spread is None else np.where(spread > ROUNDING, spread, 0.0)
        return self.machine.assumed(self.speed, names, std, self.spread)

    @cached_property
    def deviations(self) -> tuple[Floats | None, Floats | None]:
        """Deviations of frequency (Hz) and damping ratio, and 95 % intervals: (mode, 2)."""
        if self.machine.covariance is None:
            return None, None
        values = self.found.values
        hertz, spread = values.imag / (2 * np.pi), self.spread(self.machine.root)
        intervals = hertz[:, None] + np.outer(spread[:, 0], [-HALF_WIDTH, HALF_WIDTH])
        draws = self.draws
        for cluster in self.clusters:
            drawn = np.linalg.eigvals(np.diag(values[cluster]) + self.drawn(cluster, draws))
            order = np.argsort(drawn.imag, axis=1, kind="stable")
            drawn = np.take_along_axis(drawn, order, axis=1)
            off = drawn.imag / (2 * np.pi) - hertz[cluster]
            spread[cluster, 0] = np.sqrt((off**2).mean(axis=0))
            damped = -drawn.real / np.abs(drawn)
            here = -values[cluster].real / np.abs(values[cluster])
            spread[cluster, 1] = np.sqrt(((damped - here) ** 2).mean(axis=0))
            low, high = np.quantile(off, [0.025, 0.975], axis=0)
            intervals[cluster] = hertz[cluster, None] + np.column_stack([low, high])
        return spread, intervals

    def modes(self) -> Iterator[NaturalMode]:
        spread, intervals = self.deviations
        for group in self.groups:
            value, first = complex(self.found.values[group].mean()), int(group[0])
            std = (None, None) if spread is None else tuple(spread[group].mean(axis=0).tolist())
            ends = None if intervals is None else tuple(intervals[group].mean(axis=0).tolist())
            shape, assumed = self.found.right[first], (np.nan, np.nan)
            if spread is not None:
                assumed = tuple(self.assumed[0][group].mean(axis=0).tolist())
            yield NaturalMode(
                frequency_hz=value.imag / (2 * np.pi),
                std_hz=std[0],
                damping_ratio=-value.real / abs(value),
                damping_std=std[1],
                whirl=self.whirls[first],
                interval_hz=ends,
                close=any(first in cluster for cluster in self.clusters),
                count=len(group),
                eigenvalue=value,
                shape=tuple((shape / shape[int(np.abs(shape).argmax())]).tolist()),
                std_assumed_hz=assumed[0],
                damping_std_assumed=assumed[1],
            )

    def by_speed(self, group: Integers) -> Complexes:
        """Return how the eigenvalues of some modes move with the speed, shape (mode, mode)."""
        stiffness_by, damping_by, mass_by = self.machine.matrices_by_speed(self.speed)
        found = chosen(self.found, group)
        middle = complex(found.values.mean())
        moved = middle**2 * mass_by + middle * damping_by + stiffness_by
        right = found.left.conj() @ moved @ found.right.T
        return np.asarray(-np.linalg.solve(self.gram(found, found), right))


POINTS = 61
"""Speeds of a diagram."""
SCAN = 120
"""Speeds at which modes above the rotation are counted, besides those from the eigenvalues."""
EXACT = 1e-10
"""Share of a speed to which a root is found."""
FALSE = 1e-6
"""Share of the speed by which a root may miss: more, and the count changed as a mode vanished."""
NEARBY = 1e-3
"""Share of a speed at which one looks beside it: a mode that still rings there turns along."""
ALIKE = 0.7
"""Overlap of shapes below which a step of the speed is halved to follow a curve."""
HALVINGS = 6
"""Halvings of a step at the most: curves that still part then touch one another."""
CURVES, SPARE = 24, 8
"""Curves of a diagram: the lowest; and those above that are followed with them, and may fall."""


@frozen
class CriticalSpeed:
    speed_rad_s: float  # negative for a rotor that turns backward
    std: float | None  # rad/s; ``None`` where nothing is known of the deviations
    # {"forward", "backward", "planar", "mixed"}: unbalance of a machine that is the same in two
    # planes excites forward ones alone
    whirl: Whirl
    damping_ratio: float  # of the mode there
    interval: tuple[float, float] | None  # (float, float) or None: holds 95 percent, rad/s
    std_assumed: float = np.nan  # rad/s; NaN within the speeds of the records
    notes: tuple[Note, ...] = ()  # what is assumed at that speed


@frozen
class Campbell(OfAMachine):
    machine: Machine = field(repr=False, compare=False)
    speed: Floats  # (speed,): rad/s
    # (speed, curve): naN where a mode does not oscillate; deviations are NaN where nothing is known
    # of them
    frequency_hz: Floats
    std_hz: Floats
    damping_ratio: Floats
    whirl: tuple[Whirl, ...]  # of each curve, at the last speed at which it oscillates
    critical: tuple[CriticalSpeed, ...]
    std_assumed_hz: Floats = field(default_factory=lambda: np.zeros((0, 0)))  # (speed, curve)

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is assumed at the critical speeds, and what that may move."""
        return tuple(note for each in self.critical for note in each.notes)


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
        Eigen(machine, speed, CURVES + SPARE, rng)
        for speed in counting(speeds.tolist(), "modes at speeds")
    ]
    order = _curves(eigen)
    shape = (len(speeds), order.shape[1])
    hertz, std, ratio, assumed = (np.full(shape, np.nan) for _ in range(4))
    for k, at in enumerate(eigen):
        there = order[k] >= 0
        values = at.found.values[order[k, there]]
        hertz[k, there] = values.imag / (2 * np.pi)
        ratio[k, there] = -values.real / np.abs(values)
        spread, _ = at.deviations
        if spread is not None:
            std[k, there] = spread[order[k, there], 0]
            assumed[k, there] = at.assumed[0][order[k, there], 0]
    ends = [int(np.flatnonzero(curve >= 0)[-1]) for curve in order.T]
    return Campbell(
        machine,
        speeds,
        hertz,
        std,
        ratio,
        tuple(eigen[k].whirls[int(order[k, curve])] for curve, k in enumerate(ends)),
        tuple(critical_speeds(machine, last, rng)),
        assumed,
    )


def _curves(eigen: Sequence[Eigen]) -> Floats:
    """Return which mode each curve is at each speed, (speed, curve); -1 where it is none."""
    first = len(eigen[0].found.values)
    rows = [list(range(first))]
    for at, to in counting(list(pairwise(eigen)), "following modes over the speeds"):
        found = _followed(at, to, HALVINGS)
        rows.append([found.get(i, -1) for i in rows[-1]])
        new = [j for j in range(len(to.found.values)) if j not in found.values()]
        rows[-1] += new
    width = max(map(len, rows))
    table = np.array([[*row, *[-1] * (width - len(row))] for row in rows], dtype=np.int64)
    table = table[:, (table >= 0).any(axis=0)]
    height = [
        min(eigen[k].found.values[i].imag for k, i in enumerate(curve) if i >= 0)
        for curve in table.T
    ]
    return np.asarray(table[:, np.sort(np.argsort(height, kind="stable")[:CURVES])])


def _followed(at: Eigen, to: Eigen, left: int) -> dict[int, int]:
    """Return which mode at the next speed each mode is."""
    one, two = at.found, to.found
    crossed, back = at.gram(one, two), at.gram(two, one).T
    size = np.outer(*(np.abs(np.diag(at.gram(each, each))) for each in (one, two)))
    # 1 for the same shape.
    overlap = np.sqrt(np.abs(crossed * back) / np.where(size > 0, size, np.inf)).clip(0, 1)
    if not overlap.size:
        return {}
    away = np.abs(one.values.imag[:, None] - two.values.imag)
    scale = max(float(np.abs(one.values).max()), 1e-300)
    rows, columns = scipy.optimize.linear_sum_assignment(away / scale - overlap)
    sure = overlap[rows, columns] > ALIKE
    for placed, modes in ((rows, one), (columns, two)):
        for group in modes.distinct:
            if len(group) > 1:  # their vectors are any
                sure |= np.isin(placed, group)
    if sure.all() or left == 0:
        return dict(zip(rows.tolist(), columns.tolist(), strict=True))
    half = replace(at, speed=(at.speed + to.speed) / 2)
    first, second = _followed(at, half, left - 1), _followed(half, to, left - 1)
    return {i: second[j] for i, j in first.items() if j in second}


def critical_speeds(
    machine: Machine, to: float, rng: np.random.Generator | None = None
) -> list[CriticalSpeed]:
    """Return the critical speeds between standstill and a speed, in ascending order."""
    sign = -1.0 if to < 0 else 1.0
    grid = _grid(machine, to)
    above = []  # by how much modes lie above the rotation, those that do, the highest first
    for speed in counting(grid, "looking for critical speeds"):
        over = eigenvalues_at(machine, sign * speed).imag - speed
        above.append(np.sort(over[over > 0])[::-1])
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
        found += _critical(Eigen(machine, sign * root, rng=rng))
    return found


def _grid(machine: Machine, to: float) -> list[float]:
    """Return the speeds, above 0, at which modes above the rotation are counted."""
    last = abs(to)
    stiffness, damping, mass = machine.matrices(to / 2)
    gyroscopic = machine.matrices_by_speed(to / 2)[1]
    # Approximate critical speeds: those of the matrices as they are half way.
    values = poles_of(1j * gyroscopic - mass, 1j * (damping - to / 2 * gyroscopic), stiffness)
    real = np.abs(values.real)[np.abs(values.imag) < np.abs(values.real)]
    seeds = np.sort(real[(real > 0) & (real < 2 * last)])
    between = (seeds[:-1] + seeds[1:]) / 2
    beside = np.concatenate([seeds * (1 - NEARBY), seeds * (1 + NEARBY), between])
    regular = np.linspace(0, last, SCAN + 1)[1:]
    first = min([last * 1e-3, *(seeds[:1] / 2)])
    points = np.concatenate([[first], regular, beside[(beside > first) & (beside < last)]])
    found: list[float] = np.unique(points).tolist()
    return found


def _root(machine: Machine, sign: float, k: int, low: float, high: float) -> float | None:
    """Return the speed at which the mode that is number k from the top rings with the rotation."""

    def over(speed: float) -> float:
        values = np.sort(eigenvalues_at(machine, sign * speed).imag)[::-1]
        return float(values[k] - speed) if k < len(values) else -speed

    if over(low) * over(high) > 0:
        return None
    root = float(scipy.optimize.brentq(over, low, high, xtol=EXACT * high, rtol=EXACT))
    if max(abs(over(root * (1 - NEARBY))), abs(over(root * (1 + NEARBY)))) < EXACT * root:
        return None  # it turns with the rotor at every speed: I_p = I_t
    return root if abs(over(root)) < FALSE * root else None


def _critical(eigen: Eigen) -> Iterator[CriticalSpeed]:
    """Yield what is at a critical speed: one, or those of modes that coincide there by chance."""
    speed = eigen.speed
    for group in eigen.groups:
        near = int(group[0])
        value = eigen.found.values[near]
        if abs(value.imag - abs(speed)) <= FALSE * abs(speed):
            found = CriticalSpeed(
                speed, None, eigen.whirls[near], float(-value.real / abs(value)), None
            )
            yield found if eigen.machine.covariance is None else _deviating(found, eigen, near)


def _deviating(found: CriticalSpeed, eigen: Eigen, near: int) -> CriticalSpeed:
    """Return a critical speed with its deviations."""
    speed, sign = eigen.speed, -1.0 if eigen.speed < 0 else 1.0
    group = next(g for g in (*eigen.clusters, *eigen.found.distinct) if near in g)
    by_speed = sign * eigen.by_speed(group)
    slope = complex(np.trace(by_speed)) / len(group)
    along = -eigen.slopes[[near]].imag / (slope.imag - 1)

    def by(root: Floats) -> Floats:
        return np.asarray(np.linalg.norm(along @ root, axis=1))

    (std,) = by(eigen.machine.root).tolist()
    ends = (-HALF_WIDTH * std, HALF_WIDTH * std)
    if any(near in c for c in eigen.clusters):
        std, ends = _drawn(eigen, group, by_speed)
    names = [f"critical speed {speed * 30 / np.pi:.5g} rpm"]
    (moved,), notes = eigen.machine.assumed(speed, names, np.array([std]), by)
    ends = (speed + ends[0], speed + ends[1])
    return replace(found, std=std, interval=ends, std_assumed=float(moved), notes=tuple(notes))


def _drawn(eigen: Eigen, group: Integers, by_speed: Complexes) -> tuple[float, tuple[float, float]]:
    speed, sign = eigen.speed, -1.0 if eigen.speed < 0 else 1.0
    away = np.diag(eigen.found.values[group]) - 1j * abs(speed) * np.eye(len(group))
    matrices = away + eigen.drawn(group, eigen.draws)
    turning = 1j * np.eye(len(group)) - by_speed
    drawn = np.sort(np.linalg.eigvals(np.linalg.solve(turning, matrices)).real, axis=1)
    here = np.sort(np.linalg.eigvals(np.linalg.solve(turning, away)).real)
    off = sign * drawn[:, int(np.abs(here).argmin())]
    low, high = np.quantile(off, [0.025, 0.975]).tolist()
    return float(np.sqrt((off**2).mean())), (low, high)


@frozen
class UnbalanceResponse(OfAMachine):
    """Motion on the rotation's line over the speed: ``q = Re(Q exp(i phi))``."""

    machine: Machine = field(repr=False, compare=False)
    speed: Floats  # (speed,): rad/s
    motion: Complexes  # (speed, coordinate): naN at an undamped critical speed
    # (speed, coordinate): of the amplitude; NaN where nothing is known of the deviations
    std: Floats
    std_assumed: Floats  # if what is assumed is wrong; NaN at the speeds of the records
    notes: tuple[Note, ...] = ()


def unbalance_response(
    source: Estimate | Model, speeds: Floats | float | str | Sequence[str], *, record: int = 0
) -> UnbalanceResponse:
    """Return the motion that the identified unbalance makes at some speeds, with deviations.

    ``Z(Omega) Q = g(Omega)`` without forces at the inputs, by the delta method.

    Parameters
    ----------
    source : Estimate or Model
    speeds : array, shape (speed,), or float or str
        rad/s, or with their units as texts.
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
    each = np.atleast_1d(np.asarray(speeds, dtype=object)).tolist()
    return response_of(machine_of(source, record), np.array([finite_speed(s) for s in each]))


def response_of(machine: Machine, speeds: Floats) -> UnbalanceResponse:
    if not machine.linear.load_terms:
        expected = "terms in cos(phi) and sin(phi)"
        cure = "write the unbalance into its equations"
        raise InputError(f"the model {machine.model.name!r} without unbalance", expected, cure)
    shape = (len(speeds), machine.linear.coordinates)
    motion = np.full(shape, np.nan, dtype=np.complex128)
    std, assumed, notes = np.full(shape, np.nan), np.full(shape, np.nan), list[Note]()
    for k, speed in enumerate(speeds.tolist()):
        try:
            motion[k], slopes = machine.response(speed)
        except InputError:
            continue
        if machine.covariance is not None:
            by = partial(_amplitude, motion[k], slopes)
            std[k] = by(machine.root)
            names = [f"{q} at {speed * 30 / np.pi:.5g} rpm" for q in machine.model.coordinates]
            assumed[k], said = machine.assumed(speed, names, std[k], by)
            notes += said
    told = (motion, std, assumed, tuple(notes))
    return UnbalanceResponse(machine, speeds, *told)


def _amplitude(motion: Complexes, slopes: Complexes, root: Floats) -> Floats:
    return amplitude_std(motion, slopes @ root)


def amplitude_std(value: Complexes, root: Complexes) -> Floats:
    """Return the deviation of |value|, which has a root of its covariance, (..., unknown).

    Where the value is small beside its deviations there is no direction: that of the vector then.
    """
    size = np.abs(value)
    whole = np.sqrt((np.abs(root) ** 2).sum(axis=-1))
    direction = np.where(size > 0, value / np.where(size > 0, size, 1.0), 1.0)
    along = np.linalg.norm((direction.conj()[..., None] * root).real, axis=-1)
    return np.asarray(np.where(size > whole, along, whole))
