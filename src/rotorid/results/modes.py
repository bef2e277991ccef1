"""Natural frequencies, damping and whirl, with deviations.

Where a coordinate x and its partner y move as ``Re(X exp(i omega t))``, ``Re(Y exp(i omega t))``,
the orbit is the sum of a circle of radius ``|X + i Y| / 2`` run through from x to y and one of
radius ``|X - i Y| / 2`` run through the other way. Tilts turn as positions do.

Notation: lambda of ``L = lambda^2 M + lambda (D + Omega G) + K`` with right and left vectors x, y;
``d lambda = - y^H dL x / y^H (2 lambda M + D + Omega G) x`` (delta method). Where modes come so
close that their order or their shapes are not certain, the eigenvalues of the block
``diag(lambda) + sum_u A_u dx_u``, with ``A_u = - (Y^H dL_u X) / (Y^H ((lambda_i + lambda_j) M +
D + Omega G) X)``, are drawn from the covariance.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, TypeVar, cast

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.units import quantity
from rotorid.core.values import Complexes, Floats, Integers
from rotorid.models import Model
from rotorid.models.modal import Eigenmodes, distinct, eigenmodes, eigenvalues, parted
from rotorid.results.machine import Machine, machine_of

Whirl = Literal["forward", "backward", "planar", "mixed"]
PLANAR = 0.02
"""Orbits with a smaller ratio of axes are lines: no probe tells their sense."""
SILENT = 0.02
"""Places with a smaller share of the kinetic energy do not say how a mode whirls."""
_X = re.compile("[xX]")


def partners(coordinates: Sequence[str]) -> list[tuple[int, int]]:
    """Return the coordinates that are one of x and one of y at the same place, by their names.

    >>> partners(["x1", "y1", "theta_x", "theta_y", "q"])
    [(0, 1), (2, 3)]
    """
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
    x, y = (np.array([pair[side] for pair in pairs]) for side in (0, 1))
    inertia = weight[x] + weight[y]
    if not inertia.any():
        inertia = np.ones(len(x))
    forward, backward = np.abs(shape[x] + 1j * shape[y]), np.abs(shape[x] - 1j * shape[y])
    energy = inertia * (forward**2 + backward**2)
    if not energy.any():
        return "planar"
    speaks = energy > SILENT * energy.sum()
    whole = forward + backward
    ratio = np.where(whole > 0, (forward - backward) / np.where(whole > 0, whole, 1.0), 0.0)
    ratio = ratio[speaks] * (-1.0 if speed < 0 else 1.0)
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
DRAWS = 4000
"""Draws of the unknowns: a deviation comes out within 1.1 percent."""
NORMAL = 1.959964
"""Deviations to each side that hold 95 percent of a normal distribution."""


@frozen
class NaturalMode:
    """One natural frequency of a machine."""

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


@frozen
class Modes:
    """The distinct natural frequencies of a machine at a speed, in ascending order.

    They are counted as measured ones are (`Mode`): without rigid-body modes, and once where the
    machine is the same in two planes.
    """

    model: str
    speed: float  # rad/s
    coordinates: tuple[str, ...]
    modes: tuple[NaturalMode, ...]
    rigid: int  # poles at zero: free motion, which is no mode
    real_poles: tuple[float, ...]  # real poles, in rad/s
    status: str  # of the estimate
    remarks: tuple[str, ...]


@frozen
class Eigen:
    """The modes of a machine at a speed with the derivatives of their eigenvalues."""

    found: Eigenmodes
    # (mode, unknown): d lambda / d unknown; empty where nothing is known of the unknowns
    slopes: Complexes
    # sequence of int arrays: modes that come close to one another, by two or more
    clusters: tuple[Integers, ...]


def modes(
    source: Estimate | Model,
    *,
    speed: float | str = 0.0,
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
    >>> found = rid.modes(rid.load_model("three-mass"), speed="8400 rpm")
    >>> [round(mode.frequency_hz, 2) for mode in found.modes[:3]], found.modes[0].whirl
    ([36.85, 175.53, 175.53], 'forward')
    """
    machine = machine_of(source, record)
    omega = finite_speed(speed)
    return modes_at(machine, omega, rng)


def finite_speed(speed: float | str, place: str = "speed") -> float:
    found = quantity(speed, "rad/s", place=place)
    if not np.isfinite(found):
        raise InputError(f"{speed}", "a finite speed", "give 0 at standstill", place=place)
    return float(found)


def modes_at(machine: Machine, speed: float, rng: np.random.Generator | None = None) -> Modes:
    eigen = eigen_at(machine, speed)
    spread, intervals = deviations(machine, speed, eigen, rng)
    whirls = whirls_of(machine, speed, eigen.found)
    found = tuple(
        _mode(eigen, group, whirls, spread, intervals)
        for group in eigen.found.grouped(pattern_of(machine, speed))
    )
    return Modes(
        machine.model.name,
        speed,
        machine.model.coordinates,
        found,
        eigen.found.rigid,
        tuple(eigen.found.real.tolist()),
        machine.status,
        machine.remarks,
    )


def pattern_of(machine: Machine, speed: float) -> tuple[int, ...]:
    """Return how many modes each distinct natural frequency has, in general."""
    return tuple(len(group) for group in distinct(eigenvalues_at(machine.elsewhere, speed)))


def eigenmodes_at(machine: Machine, speed: float) -> Eigenmodes:
    return _solved(eigenmodes, machine, speed)


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


def _mode(
    eigen: Eigen,
    group: Integers,
    whirls: Sequence[Whirl],
    spread: Floats | None,
    intervals: Floats | None,
) -> NaturalMode:
    value = complex(eigen.found.values[group].mean())
    std = (None, None) if spread is None else tuple(spread[group].mean(axis=0).tolist())
    first = int(group[0])
    shape = eigen.found.right[first]
    return NaturalMode(
        frequency_hz=value.imag / (2 * np.pi),
        std_hz=std[0],
        damping_ratio=-value.real / abs(value),
        damping_std=std[1],
        whirl=whirls[first],
        interval_hz=None if intervals is None else tuple(intervals[group].mean(axis=0).tolist()),
        close=any(first in cluster for cluster in eigen.clusters),
        count=len(group),
        eigenvalue=value,
        shape=tuple((shape / shape[int(np.abs(shape).argmax())]).tolist()),
    )


def whirls_of(machine: Machine, speed: float, found: Eigenmodes) -> list[Whirl]:
    """Return how each mode whirls.

    Modes of a machine that is the same in two planes are planar; those that coincide by chance
    whirl as they do when they part.
    """
    pairs = partners(machine.model.coordinates)
    weight = machine.inertia(speed)
    whirls = [whirl_of(shape, pairs, weight, speed) for shape in found.right]
    if all(len(group) == 1 for group in found.distinct):
        return whirls
    parted_ = eigenmodes_at(machine.elsewhere, speed)
    apart = [i for group in parted_.distinct if len(group) == 1 for i in group]
    for group in found.distinct:
        for i in group if len(group) > 1 else ():
            alone = i in apart and len(parted_.values) == len(found.values)
            whirls[i] = whirl_of(parted_.right[i], pairs, weight, speed) if alone else "planar"
    return whirls


def eigen_at(machine: Machine, speed: float, lowest: int | None = None) -> Eigen:
    """Return the modes of a machine, or its lowest, and how they follow from the unknowns."""
    found = eigenmodes_at(machine, speed)
    if lowest is not None:
        found = chosen(found, slice(lowest))
    _, damping, mass = machine.matrices(speed)
    if machine.covariance is None:
        return Eigen(found, np.zeros((len(found.values), 0), dtype=np.complex128), ())
    slopes = np.zeros((len(found.values), len(machine.values)), dtype=np.complex128)
    pencil = machine.pencil(speed)
    for group in found.distinct:
        value = complex(found.values[group].mean())
        left, right = found.left[group], found.right[group]
        gram = left.conj() @ (2 * value * mass + damping) @ right.T
        inner = pencil.slopes(value, left, right, machine.values)
        slopes[group] = parted(gram, inner, machine.spread)
    return Eigen(found, slopes, _clusters(machine, speed, found, slopes))


def _clusters(
    machine: Machine, speed: float, found: Eigenmodes, slopes: Complexes
) -> tuple[Integers, ...]:
    """Return the modes whose order or shapes are not certain, together."""
    values, root, count = found.values, machine.root, len(found.values)
    if count < 2:
        return ()
    pairs = np.array(
        [(i, j) for i in range(count) for j in range(i + 1, min(i + 1 + BESIDE, count))]
    ).reshape(-1, 2)
    apart = np.linalg.norm((slopes[pairs[:, 0]] - slopes[pairs[:, 1]]) @ root, axis=1)
    blocks = block_of(machine, speed, found, pairs)
    across = [np.linalg.norm(blocks[:, i, 1 - i] @ root, axis=1) for i in (0, 1)]
    spread = np.hypot(apart, 2 * np.sqrt(across[0] * across[1]))
    near = np.abs(np.diff(values[pairs], axis=1)[:, 0]) < CLOSE * spread
    joined = np.arange(count)
    for i, j in pairs[near & (spread > 1e-9 * np.abs(values[pairs[:, 0]]))]:
        joined[joined == joined[j]] = joined[i]
    groups = (np.flatnonzero(joined == k) for k in np.unique(joined))
    return tuple(group for group in groups if len(group) > 1)


def block_of(machine: Machine, speed: float, found: Eigenmodes, group: Integers) -> Complexes:
    """Return A_u of some modes, shape (mode, mode, unknown); of several groups, (group, mode)."""
    pencil = machine.pencil(speed)
    groups, size = group.reshape(-1, group.shape[-1]), group.shape[-1]
    parts = []
    chunk = max(1, TERMS // (size**2 * max(len(pencil.row), 1)))
    for first in range(0, len(groups), chunk):
        here = chosen(found, groups[first : first + chunk])
        inner = pencil.slopes(here.values.mean(axis=1), here.left, here.right, machine.values)
        right = inner.reshape(len(inner), size, -1)
        parts.append(-np.linalg.solve(gram(machine, speed, here, here), right).reshape(inner.shape))
    shape = (*group.shape, size, len(machine.values))
    return np.concatenate(parts).reshape(shape) if parts else np.zeros(shape, dtype=np.complex128)


def chosen(found: Eigenmodes, modes: slice | Integers) -> Eigenmodes:
    return replace(
        found, values=found.values[modes], right=found.right[modes], left=found.left[modes]
    )


def gram(machine: Machine, speed: float, one: Eigenmodes, two: Eigenmodes) -> Complexes:
    """Return ``Y^H ((lambda_i + lambda_j) M + D + Omega G) X``, Y of one and X of two."""
    _, damping, mass = machine.matrices(speed)
    sums = one.values[..., :, None] + two.values[..., None, :]
    left, right = one.left.conj(), two.right.swapaxes(-1, -2)
    return np.asarray(sums * (left @ mass @ right) + left @ damping @ right)


def drawn_blocks(
    machine: Machine, speed: float, eigen: Eigen, cluster: Integers, rng: np.random.Generator
) -> Complexes:
    """Return draws of ``sum_u A_u dx_u`` of close modes, shape (draw, mode, mode)."""
    block = block_of(machine, speed, eigen.found, cluster)
    moved = rng.standard_normal((DRAWS, len(machine.values))) @ machine.root.T
    return np.asarray(np.einsum("iju,du->dij", block, moved))


def deviations(
    machine: Machine, speed: float, eigen: Eigen, rng: np.random.Generator | None = None
) -> tuple[Floats | None, Floats | None]:
    """Return the deviations of frequency (Hz) and damping ratio, and intervals of 95 percent (Hz).

    Shapes (mode, 2); ``None`` where nothing is known of the unknowns.
    """
    if machine.covariance is None:
        return None, None
    values, root = eigen.found.values, machine.root
    hertz = values.imag / (2 * np.pi)
    frequency = np.linalg.norm((eigen.slopes.imag / (2 * np.pi)) @ root, axis=1)
    along = (values.conj()[:, None] * eigen.slopes).real / np.abs(values)[:, None] ** 2
    ratio = (values.real[:, None] * along - eigen.slopes.real) / np.abs(values)[:, None]
    spread = np.column_stack([frequency, np.linalg.norm(ratio @ root, axis=1)])
    intervals = hertz[:, None] + np.outer(frequency, [-NORMAL, NORMAL])
    draws = np.random.default_rng(0) if rng is None else rng
    for cluster in eigen.clusters:
        moved = drawn_blocks(machine, speed, eigen, cluster, draws)
        drawn = np.linalg.eigvals(np.diag(values[cluster]) + moved)
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
