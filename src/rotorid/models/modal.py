"""Eigenvalues of ``lambda^2 M + lambda D + K`` with their left and right vectors.

The pencil is scaled first: rows and columns to entries of one size, since metres stand beside
radians and newtons beside newton metres, and lambda by a frequency of the machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from rotorid.core.values import Complexes, Floats, Integers, frozen

Matrix = Floats | Complexes
FREE = 1e-14
"""Singular value of the stiffness, rows and columns brought to one size, below which a motion is
free: rounding leaves some 1e-16. Bearings of 1e4 N/m under a shaft in elements of 2 mm leave 1e-12;
a share of the highest frequency, that of the shortest element or of the stiffest support, would
take such a mode for free motion."""
UNDAMPED = 1e-12
"""Damping and gyroscopic effect of a free motion, beside the largest that act there, below which
there is none: rounding leaves some 1e-16."""
OVERDAMPED = 1e-7  # share of the eigenvalue below which its imaginary part is rounding: a real pole
ALIKE = 1e-8  # share within which eigenvalues are one, of a machine that is the same in two planes
REGULAR = 1e6  # condition of the scaled M up to which it is divided by: ten digits are left
SWEEPS = 8  # sweeps of the scaling: each takes the root of what is left
BLOCK = 4  # vectors of a block: as many as there are free motions at rest, in two planes
SPARE = 36  # vectors of a Krylov space beyond three times as many as there are modes to be found
PAYS = 3  # times as many coordinates as vectors from which on such a space pays
FOUND = 1e-6  # error of a vector that is found: its eigenvalue's is about the square of that
ASTRAY = 0.1
"""The same from which on no larger space tells more: with parts of 1e10 times their stiffness, on
which a search may come, the lowest modes are rounding."""
ROUNDED = 10  # times the rounding of K q, up to which an error may be that of all its products
BLURRED = 1e-4  # error up to which rounding is an excuse: eight digits of an eigenvalue are left
EPS = float(np.finfo(float).eps)
SAME = 1e-12  # share of a space's vectors that is rounding


@frozen
class Eigenmodes:
    """Oscillating modes in ascending order of frequency; rigid-body modes are left out."""

    values: Complexes  # (mode,): lambda in rad/s, its imaginary part positive
    # (mode, coordinate) and (mode, row): ``(lambda^2 M + lambda D + K) right = 0`` and ``left^H
    # (...) = 0``
    right: Complexes
    left: Complexes
    rigid: int = 0  # poles at zero: of free motion
    # real poles, in rad/s, in ascending order
    real: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def distinct(self) -> list[Integers]:
        """Which modes are one: those of a machine that is the same in two planes."""
        return distinct(self.values)

    def grouped(self, pattern: Sequence[int]) -> list[Integers]:
        """Return which modes are one, by how many are in general: some coincide by chance."""
        distinct = self.distinct
        if len(distinct) == len(pattern) or sum(pattern) != len(self.values):
            return distinct
        return np.split(np.arange(len(self.values)), np.cumsum(pattern)[:-1])


def distinct(values: Complexes) -> list[Integers]:
    """Return which eigenvalues, ascending, are one."""
    near = np.abs(np.diff(values)) <= ALIKE * np.abs(values[1:])
    return np.split(np.arange(len(values)), np.flatnonzero(~near) + 1) if len(values) else []


def eigenmodes(mass: Matrix, damping: Matrix, stiffness: Matrix) -> Eigenmodes:
    """Return the oscillating modes of ``M q'' + D q' + K q = 0``; D holds gyroscopic terms too.

    Structural damping makes K complex: it is that of positive frequencies, as the modes are.
    """
    return _Scaled.of(mass, damping, stiffness).eigenmodes()


def many(coordinates: int, count: int) -> bool:
    """Tell whether a few modes of so many coordinates are found sooner by themselves."""
    return PAYS * (3 * count + SPARE) <= coordinates


def lowest_modes(
    mass: Matrix, damping: Matrix, stiffness: Matrix, count: int, near: float
) -> Eigenmodes:
    """Return the lowest oscillating modes of `eigenmodes`, `count` of them or more.

    Of a machine of many coordinates from a space of few vectors (block Arnoldi on ``(q, lambda q)``
    about `near`, in rad/s, below the first frequency), which grows until they are found. Right and
    left vectors lie in it, so that errors of both leave their product in an eigenvalue.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where such a space does not hold them: the parts are too unlike, or few modes oscillate.
    """
    whole, size = _Scaled.of(mass, damping, stiffness), 3 * count + SPARE
    if not many(len(mass), count):
        return whole.eigenmodes()
    shifted = _Shifted(whole, near / whole.unit)
    while PAYS * size <= len(mass) * (1 + shifted.symmetric):  # one side serves as both
        found = shifted.within(size).eigenmodes(count)
        enough = len(found.values) == count
        error, rounding = shifted.error(found) if enough else (np.inf, 0.0)
        if error <= max(FOUND, min(ROUNDED * rounding, BLURRED)):
            return found
        if error > ASTRAY or rounding > BLURRED:
            break
        size *= 2
    raise np.linalg.LinAlgError("lowest modes that are rounding, or none")


def eigenvalues(mass: Matrix, damping: Matrix, stiffness: Matrix) -> Complexes:
    """Return the eigenvalues of `eigenmodes` alone, in a third of its time."""
    pencil = _Scaled.of(mass, damping, stiffness)
    values, _, _ = pencil.poles(vectors=False)
    order, _, _ = pencil.told_apart(values)
    return np.asarray(values[order] * pencil.unit, dtype=np.complex128)


def poles_of(mass: Matrix, damping: Matrix, stiffness: Matrix) -> Complexes:
    """Return the finite roots of ``det(lambda^2 M + lambda D + K)``."""
    pencil = _Scaled.of(mass, damping, stiffness)
    values, _, _ = pencil.poles(vectors=False)
    return np.asarray(values[np.isfinite(values)] * pencil.unit)


@frozen
class _Scaled:
    stiffness: Matrix
    damping: Matrix
    mass: Matrix
    row: Floats
    column: Floats
    unit: float
    # (coordinate, vector): to which all motion is held, where that is not any
    space: Floats | None = None

    @classmethod
    def of(cls, mass: Matrix, damping: Matrix, stiffness: Matrix) -> _Scaled:
        matrices = [stiffness, damping, mass]
        if not all(np.abs(m).max(initial=0.0) < 1e150 for m in matrices):
            raise np.linalg.LinAlgError("a machine beyond all bounds")
        both = (mass != 0) & (stiffness != 0)
        ratio = np.abs(stiffness[both] / mass[both])
        unit = float(np.exp(0.5 * np.log(ratio).mean())) if both.any() else 1.0
        sizes = [np.abs(each) * unit**power for power, each in enumerate(matrices)]
        row, column = _scales(np.sum(sizes, axis=0))
        k, d, m = (row[:, None] * each * column * unit**p for p, each in enumerate(matrices))
        if not (np.isfinite(k).all() and np.isfinite(d).all() and np.isfinite(m).all()):
            raise np.linalg.LinAlgError("a machine beyond all bounds")
        return cls(k, d, m, row, column, unit)

    def eigenmodes(self, count: int | None = None) -> Eigenmodes:
        """Return the oscillating modes, the lowest `count` of them."""
        values, right, left = self.poles()
        order, real, rigid = self.told_apart(values)
        order = order[:count]
        shapes = (v if self.space is None else self.space @ v for v in (right, left))
        right, left = (np.asarray(shape[:, order].T, dtype=np.complex128) for shape in shapes)
        return Eigenmodes(
            np.asarray(values[order] * self.unit, dtype=np.complex128),
            right * self.column,
            left * self.row,
            rigid,
            np.sort(values[real].real * self.unit),
        )

    def poles(self, *, vectors: bool = True) -> tuple[Complexes, Complexes, Complexes]:
        """Return lambda, infinite ones too, with right and left vectors as columns.

        Where every coordinate has inertia, M is taken to the other side: ten times as fast as the
        pencil of two matrices, and as exact. Not where a damped free motion leaves a pole beside
        zero: rounding would make the two a slow oscillation.
        """
        k, d, m = self.stiffness, self.damping, self.mass
        n, (free, held) = len(k), self.free
        companion, heavy = np.zeros((2 * n, 2 * n), dtype=np.result_type(k, d, m)), None
        companion[:n, n:] = np.eye(n)
        if n and not (free and held) and np.linalg.cond(m) < REGULAR:
            companion[n:] = -np.linalg.solve(m, np.concatenate([k, d], axis=1))
        else:
            companion[n:, :n], companion[n:, n:], heavy = -k, -d, np.zeros_like(companion)
            heavy[:n, :n], heavy[n:, n:] = np.eye(n), m
        undamped = self.space is not None and not d.any()
        if undamped:  # those of lambda^2, half as many
            companion, heavy = companion[n:, :n], None if heavy is None else m
        found: Any = scipy.linalg.eig(
            companion, heavy, left=vectors, right=vectors, homogeneous_eigvals=True
        )
        none = np.zeros((2 * n, 0), dtype=np.complex128)
        (over, under), left, right = found if vectors else (found, none, none)
        lower: Any = left[-n:] if heavy is not None else np.linalg.solve(m.conj().T, left[-n:])
        finite = np.abs(under) > 1e-14 * np.abs(over)
        values: Complexes = np.full(len(over), np.inf, dtype=np.complex128)
        values[finite] = over[finite] / under[finite]
        if undamped:
            roots = np.sqrt(values)
            values = np.concatenate([roots, -roots])
            right, lower = np.tile(right, 2), np.tile(lower, 2)
        return values, right[:n], lower

    @cached_property
    def free(self) -> tuple[int, int]:
        """How many motions are free, and on how many of them damping acts.

        By ranks: a double pole at zero comes out at the root of rounding. Of a free motion
        ``lambda^2 M + lambda D`` remains: zero is a pole once, and twice where D does not act.
        """
        row, column = _scales(np.abs(self.stiffness))
        if self.space is not None:  # whose vectors mix all sizes; a free motion's would be rounding
            row, column = np.ones(len(row)), np.ones(len(row))
        left, sizes, right = np.linalg.svd(row[:, None] * self.stiffness * column)
        largest = sizes.max(initial=0.0) if self.space is None else 1.0  # that of the whole machine
        free = sizes <= FREE * largest
        rows, columns = row[:, None] * left[:, free], column[:, None] * right[free].conj().T
        acting = rows.conj().T @ self.damping @ columns
        largest = (np.abs(rows).T @ np.abs(self.damping) @ np.abs(columns)).max(initial=0.0)
        held = np.linalg.svd(acting, compute_uv=False) > UNDAMPED * largest
        return int(free.sum()), int(held.sum())

    def told_apart(self, values: Complexes) -> tuple[Integers, Integers, int]:
        finite, size = np.isfinite(values), np.abs(values)
        moving = finite.copy()
        free, held = self.free
        moving[np.argsort(size, kind="stable")[: 2 * free - held]] = False
        with np.errstate(invalid="ignore"):
            kept = moving & (values.imag > OVERDAMPED * size)
            real = moving & (np.abs(values.imag) <= OVERDAMPED * size)
        order = np.flatnonzero(kept)[np.argsort(values[kept].imag, kind="stable")]
        return order, np.flatnonzero(real), int((finite & ~moving).sum())


@frozen
class _Shifted:
    """A machine of many coordinates about a real pole, sparse."""

    whole: _Scaled
    at: float

    @cached_property
    def matrices(self) -> tuple[Any, Any, Any]:
        k, d, m = self.whole.stiffness, self.whole.damping, self.whole.mass
        return scipy.sparse.csc_array(k), scipy.sparse.csc_array(d), scipy.sparse.csc_array(m)

    @cached_property
    def factors(self) -> Any:
        k, d, m = self.matrices
        try:
            return scipy.sparse.linalg.splu(k + self.at * (d + self.at * m))
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from None

    def solved(self, right: Any, side: str) -> Any:
        """Solve L(at) q = right, or with its transpose on the side "T", its adjoint on "H"."""
        if np.iscomplexobj(right) and not np.iscomplexobj(self.whole.stiffness):
            return self.solved(right.real, side) + 1j * self.solved(right.imag, side)
        return self.factors.solve(right, side)

    @cached_property
    def symmetric(self) -> bool:
        """Whether it was, before scaling rounded it."""
        return all(abs(e - e.T).max() <= 4 * EPS * abs(e).max() for e in self.matrices)

    def within(self, size: int) -> _Scaled:
        """Hold the machine to the space of its vectors near, `size` on either side."""
        parts = [self._krylov(size, side) for side in ("N" if self.symmetric else "NT")]
        halves = ((p.real, p.imag) if np.iscomplexobj(p) else (p,) for p in parts)
        every = np.concatenate([half for both in halves for half in both], axis=1)
        left, sizes, _ = np.linalg.svd(every, full_matrices=False)
        space = left[:, sizes > SAME * sizes[0]]
        k, d, m = (np.asarray(space.T @ (each @ space)) for each in self.matrices)
        return replace(self.whole, stiffness=k, damping=d, mass=m, space=space)

    def _krylov(self, size: int, side: str) -> Floats | Complexes:
        """Return q of the vectors (mu q, q) that blocks from anywhere lead to; lambda = at + mu."""
        _, d, m = (each if side == "N" else each.T for each in self.matrices)
        slope, n = d + 2 * self.at * m, d.shape[0]
        spread = np.cos(np.outer(np.arange(n) + 1.0, np.arange(BLOCK) + 1.0) ** 2)
        block = np.linalg.qr(np.concatenate([spread, 0 * spread]))[0]
        found: Any = block.astype(self.whole.stiffness.dtype)
        for _ in range(size // BLOCK):
            q, p = block[:n], block[n:]
            block = np.concatenate([-self.solved(slope @ q + m @ p, side), q])
            for _ in range(2):  # once more, for what rounding has left
                block = block - found @ (found.conj().T @ block)
            block = np.linalg.qr(block)[0]
            found = np.concatenate([found, block], axis=1)
        return np.asarray(found[:n])

    def error(self, found: Eigenmodes) -> tuple[float, float]:
        """Return how far vectors are from those of the machine, at most, and by rounding alone."""
        values, worst, rounding = found.values / self.whole.unit, 0.0, 0.0
        sides = (("N", found.right / self.whole.column), ("H", found.left / self.whole.row))
        for side, vectors in sides:
            k, d, m = (each if side == "N" else each.conj().T for each in self.matrices)
            at = values if side == "N" else values.conj()
            q = vectors.T
            left = self.solved(at**2 * (m @ q) + at * (d @ q) + k @ q, side)
            rounded = EPS * self.solved(abs(k) @ np.abs(q), side)
            for_one = np.linalg.norm([left, rounded], axis=1) / np.linalg.norm(q, axis=0)
            for_one *= np.maximum(1.0, self.at / np.abs(at)) ** 2  # M hides what K lacks below it
            worst, rounding = np.maximum((worst, rounding), for_one.max(axis=1))
        return worst, rounding


def _scales(size: Floats) -> tuple[Floats, Floats]:
    """Return factors of rows and columns that bring the largest entry of each to about one."""
    row, column = np.ones(len(size)), np.ones(size.shape[1])
    for _ in range(SWEEPS):
        left = row[:, None] * size * column
        across, along = left.max(axis=1), left.max(axis=0)
        row /= np.sqrt(np.where(across > 0, across, 1.0))
        column /= np.sqrt(np.where(along > 0, along, 1.0))
    return row, column


def parted(gram: Complexes, slopes: Complexes, toward: Floats) -> Complexes:
    """Return the derivatives of eigenvalues that coincide here, (mode, unknown), by frequency.

    They belong to the vectors of ``G^-1 dL`` with which they part on the way `toward`, (unknown,).
    `gram`, (mode, mode), is ``G = Y^H (2 lambda M + D) X``; `slopes`, (mode, mode, unknown),
    ``Y^H (lambda^2 dM + lambda dD + dK) X`` by each unknown.
    """
    solved = -np.linalg.solve(gram, slopes.reshape(len(gram), -1)).reshape(slopes.shape)
    if len(gram) == 1:
        return np.asarray(solved[0])
    values, vectors = np.linalg.eig(solved @ toward)
    vectors = vectors[:, np.argsort(values.imag, kind="stable")]
    away = np.linalg.solve(vectors, solved.transpose(2, 0, 1) @ vectors)
    return np.asarray(np.einsum("uii->iu", away))
