"""Rank, null space and scale of columns, with every tolerance and its reason in one place."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotorid.core.values import Booleans, Complexes, Floats, Integers

Number = TypeVar("Number", np.float64, np.complex128)

SENSORS = 1e-9
"""Share by which sensors that read the same differ: gains and places are known to 1e-4 at best."""


def sensor_rank(reads: Floats) -> int:
    """Return how many combinations of coordinates the sensors tell apart; reads (sensor, q)."""
    if not reads.size:
        return 0
    values = np.linalg.svd(reads, compute_uv=False)
    return int((values > SENSORS * values[0]).sum())


def column_lengths(matrix: Floats | Complexes) -> Floats:
    """Return the length of each column to divide it by: 1 of a column that is zero."""
    length = np.sqrt((np.abs(matrix) ** 2).sum(axis=0))
    return np.where(length > 0, length, 1.0)


def whole_svd(matrix: Floats) -> tuple[Floats, Floats, Floats]:
    """Return U, S and V^H, a value per column: 0 of what fewer rows than columns leave open."""
    rows, columns = matrix.shape
    if rows < columns:
        matrix = np.pad(matrix, ((0, columns - rows), (0, 0)))
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    return left[:rows], values, right


BLOCK = 200
"""Rows that are factored at once of a tall matrix: as many stay in the cache."""


def _blocks(matrix: NDArray[Number]) -> tuple[NDArray[Number], NDArray[Number]] | None:
    """Return a tall matrix in blocks of rows, and the rest; None of one that is not tall."""
    rows, columns = matrix.shape
    if rows < 2 * BLOCK or 4 * columns > BLOCK:
        return None
    whole = rows - rows % BLOCK
    return matrix[:whole].reshape(-1, BLOCK, columns), matrix[whole:]


def thin_qr(matrix: Floats) -> tuple[Floats, Floats]:
    """Return Q, orthonormal columns, and R; of a tall matrix by the triangles of its blocks."""
    if (parts := _blocks(matrix)) is None:
        return np.linalg.qr(matrix)
    (blocks, rest), columns = parts, matrix.shape[1]
    bases, triangles = np.linalg.qr(blocks)
    above, last = thin_qr(np.concatenate([triangles.reshape(-1, columns), rest]))
    own, below = np.split(above, [len(above) - len(rest)])
    basis = (bases @ own.reshape(triangles.shape)).reshape(-1, columns)
    return np.concatenate([basis, below]), last


def triangle(matrix: NDArray[Number]) -> NDArray[Number]:
    """Return R of QR, of a matrix or of each of many: numpy's "r" makes a mask at every call."""
    if matrix.ndim == 2 and (parts := _blocks(matrix)) is not None:
        blocks, rest = parts
        return triangle(np.concatenate([triangle(blocks).reshape(-1, matrix.shape[1]), rest]))
    reflected, _ = np.linalg.qr(matrix, mode="raw")
    rows = reflected.swapaxes(-1, -2)[..., : min(matrix.shape[-2:]), :]
    return np.where(_upper(*rows.shape[-2:]), rows, reflected.dtype.type(0))


@lru_cache(maxsize=64)
def _upper(rows: int, columns: int) -> Booleans:
    return np.triu(np.ones((rows, columns), dtype=bool))


def coupled(matrix: NDArray[Any]) -> list[Integers]:
    """Return the groups that a matrix couples, the lowest first; scipy's graphs load slowly."""
    links = (matrix != 0) | (matrix != 0).T
    left, groups = links.any(axis=0), list[Integers]()
    while left.any():
        group = np.arange(len(links)) == left.argmax()
        while (links[group].any(axis=0) & ~group).any():
            group |= links[group].any(axis=0)
        groups.append(np.flatnonzero(group))
        left &= ~group
    return groups


def covariance_root(covariance: Floats) -> Floats:
    """Return R with ``R R' = covariance``, by correlations: variances may be 1e20 apart."""
    size = np.sqrt(np.diag(covariance).clip(0))
    scale = np.where(size > 0, size, 1.0)
    values, along = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * along * np.sqrt(values.clip(0)))


def leave_out(share: Floats, score: Floats, least: float) -> tuple[Floats, Floats]:
    """Return ``(1 - share)^-1 score``, of an answer without one group of rows (the jackknife).

    With the share ``G_b X_b``, of values ``G @ right side`` with the design X, and the score
    ``G_b e_b``, e_b the group's residual; or with ``X_b G_b`` and e_b, for its residual without it.
    What the group tells alone, singular values of ``1 - share`` up to `least`, is left out of the
    result, and returned beside it, (n, directions).
    """
    left, size, right = np.linalg.svd(np.eye(len(share)) - share)
    told = size > least
    return right[told].T @ ((left[:, told].T @ score) / size[told]), right[~told].T


def straightened(rows: Floats) -> Floats:
    """Return rows, (.., period), less their mean and slope."""
    place = np.arange(rows.shape[-1]) - (rows.shape[-1] - 1) / 2
    rows = rows - rows.mean(axis=-1, keepdims=True)
    return np.asarray(rows - np.multiply.outer(rows @ place / (place @ place), place))


def steps_within(rest: Floats) -> tuple[Floats, Floats]:
    """Return straightened rows times steps behind 1, 2, .. periods, and the steps' squared lengths.

    The steps are straightened too; of shapes (.., step) and (step,).
    """
    count = rest.shape[-1]
    place, behind = np.arange(count) - (count - 1) / 2, np.arange(count - 1, 0, -1)
    moment = np.cumsum(place[::-1])[-2::-1]
    size = behind - behind**2 / count - moment**2 / (place @ place)
    return np.cumsum(rest[..., ::-1], axis=-1)[..., -2::-1], np.asarray(size)
