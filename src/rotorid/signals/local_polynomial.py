"""Covariance of the noise on the lines of a whole record, window by window.

In 2h + 1 lines, with A(j) = 1 + a_1 j + a_2 j^2 a pair of poles that all channels share, or 1,

    z_j = [ (G_0 + G_1 j + .. + G_S j^S) r_j + (t_0 + .. + t_S j^S) ] / A(j) + a W_j.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy

from rotorid.core.values import Booleans, Complexes, Floats, Integers, frozen

ORDERS = (2, 4, 6, 8)
"""S, of which the least is taken that leaves no bend: each is held against the next."""
BENT = 1.03
"""An order that leaves this much more than the next one leaves motion: chance makes a percent.
Motion makes deviations too wide (a resonance of 4 Hz in a window of 6 Hz: 1.3 times)."""
PROBED = 200
"""Lines on which orders are compared."""
PER_CHANNEL = 5
"""n over the channels, at least: n = 19 for 8 channels gave J / dof 1.08, V being too bad."""
ALONE = 1e-3
"""Chance with which noise alone makes some line of a record stand out of its window."""
PASSES = 3
"""Rounds of leaving lines out: those beside a strong one show once it is gone."""
LEAST = 12
"""n is at least this, however few the channels: fewer compare orders by chance."""
POLES = 2
"""Poles of a window: one resonance. Two of them in one window take a higher order."""
RESONANT = 1e-3
"""Chance with which noise alone gives a window poles. With none, 6 s of noise on a lightly damped
rotor left 1.3 to 2.5 times the noise near its resonances, and J was 1 % too low."""
NARROWEST = 0.5
"""Lines by which a pole lies off the real axis, at least: a decay to 1 / 20 within the record. What
is narrower does not decay: hum, or a rotation otherwise than stated, leaks as 1 / (j - j_0)."""
CHUNK = 256
"""Lines at a time, so that memory stays that of the lines."""


@frozen
class Local:
    matrices: Complexes  # (line, channel, channel)
    dof: int
    # mean share of a line's noise that the polynomial takes up, missing from its residual
    leverage: float
    order: int
    half: int
    # lines that noise does not explain: a rotation otherwise than stated, hum
    standing_out: Integers
    bent: bool = False  # even the highest order leaves motion in the residual


def half_width(channels: int, references: int, rotating: bool, order: int) -> int:
    """Return the least h that leaves enough degrees of freedom."""
    columns = columns_of(references, rotating, order)
    return -(-(max(PER_CHANNEL * channels, LEAST) + columns - 1) // 2)


def columns_of(references: int, rotating: bool, order: int) -> int:
    return (order + 1) * (references + 1) + (2 if rotating else 0)


def local_covariance(
    channels: Complexes,
    references: Complexes,
    rotation: Complexes,
    lines: Integers,
) -> Local:
    """Return C of chosen lines, of all from DC on, by the least order that leaves no bend."""
    windows = [_Windows(channels, references, rotation, order) for order in ORDERS]
    fitting = [each for each in windows if 2 * each.half + 1 <= len(channels)]
    probed = lines[:: max(1, len(lines) // PROBED)]

    def left(each: _Windows) -> Floats:
        return np.diagonal(each.local(probed).matrices, axis1=1, axis2=2).real

    this = left(fitting[0]) if len(fitting) > 1 else np.zeros((0, channels.shape[1]))
    for each, above in pairwise(fitting):
        following = left(above)
        typical = np.median(following, axis=0)
        typical = np.where(typical > 0, typical, 1.0)
        if (this / typical).mean() <= BENT * (following / typical).mean():
            return each.local(lines)
        this = following
    return replace(fitting[-1].local(lines), bent=len(fitting) > 1)


@frozen
class _Windows:
    channels: Complexes
    references: Complexes
    rotation: Complexes
    order: int

    @cached_property
    def half(self) -> int:
        turning = self.rotation.shape[1] > 0
        return half_width(self.channels.shape[1], self.references.shape[1], turning, self.order)

    @cached_property
    def dof(self) -> int:
        turning = self.rotation.shape[1] > 0
        return 2 * self.half + 1 - columns_of(self.references.shape[1], turning, self.order)

    def local(self, lines: Integers) -> Local:
        """Return C of lines; lines that stand out of their window are left out of those beside."""
        count, dof = self.channels.shape[1], self.dof
        # The share of A that a line of noise alone reaches once in a thousand records.
        chance = 1 - ALONE / max(len(lines), 1)
        limit = scipy.special.betaincinv(count, max(dof - count, 1), chance)
        ordinary = np.ones(len(self.channels), dtype=bool)
        found, lever, share = self.covariances(lines, ordinary)
        for last in range(PASSES):
            fresh = lines[ordinary[lines] & (share > limit)]
            ordinary[fresh] = False
            if not len(fresh) or last == PASSES - 1:
                break
            again = self.touched(lines, fresh)  # the other windows are as they were
            found[again], lever[again], share[again] = self.covariances(lines[again], ordinary)
        leverage = float(lever.mean()) if len(lines) else 0.0
        return Local(found, dof, leverage, self.order, self.half, lines[~ordinary[lines]])

    def _first(self, lines: Integers) -> Integers:
        return np.clip(lines - self.half, 0, len(self.channels) - 2 * self.half - 1)

    def touched(self, lines: Integers, fresh: Integers) -> Booleans:
        first, fresh = self._first(lines), np.sort(fresh)
        inside = np.searchsorted(fresh, (first, first + 2 * self.half + 1))
        return np.asarray(inside[1] > inside[0])

    def covariances(self, lines: Integers, ordinary: Booleans) -> tuple[Complexes, Floats, Floats]:
        """Return C, each line's leverage, and its share of A = n C in its own direction."""
        width, count = 2 * self.half + 1, self.channels.shape[1]
        first = self._first(lines)
        found = np.empty((len(lines), count, count), dtype=np.complex128)
        share, taken = np.zeros(len(lines)), np.zeros(len(lines))
        for start in range(0, len(lines), CHUNK):
            part = slice(start, start + CHUNK)
            window = first[part, None] + np.arange(width)
            middle = lines[part] - first[part]
            kept = ordinary[window]
            offset = (window - lines[part, None]) / self.half
            powers = offset[:, :, None] ** np.arange(self.order + 1)
            references, rotation = self.references[window], self.rotation[window]
            regression = _Regression(self.half, references, rotation, powers, offset, kept)
            data = self.channels[window] * kept[:, :, None]
            degrees = np.maximum(self.dof - (~kept).sum(axis=1), count)
            orthogonal, left, resonant = regression.resonant(data, degrees)
            found[part] = left.transpose(0, 2, 1) @ left.conj()
            found[part] /= (degrees - POLES / count * resonant)[:, None, None]
            each = np.arange(len(middle))
            lever = (np.abs(orthogonal[each, middle]) ** 2).sum(axis=1)
            taken[part] = lever
            own = left[each, middle] / np.sqrt(np.maximum(1 - lever, 1e-12))[:, None]
            share[part] = _share(found[part] * degrees[:, None, None], own)
        return found, taken, share


@frozen
class _Regression:
    """Some windows, (window, line, ...), and the columns that stand for the motion in them."""

    half: int
    references: Complexes
    rotation: Complexes
    powers: Floats
    offset: Floats
    kept: Booleans

    def among(self, chosen: Integers) -> _Regression:
        return replace(self, **{n: v[chosen] for n, v in vars(self).items() if n != "half"})

    def fitted(
        self, data: Complexes, denominator: Complexes | float = 1.0
    ) -> tuple[Complexes, Complexes]:
        """Return orthonormal columns, and what they leave."""
        powers = self.powers / np.asarray(denominator)[..., None]
        driven = self.references[:, :, :, None] * powers[:, :, None, :]
        flat = driven.reshape(*self.references.shape[:2], -1)
        design = np.concatenate([flat, powers + 0j, self.rotation], axis=2)
        size = np.sqrt((np.abs(design) ** 2).sum(axis=1, keepdims=True))
        design /= np.where(size > 0, size, 1.0)
        orthogonal, _ = np.linalg.qr(design * self.kept[:, :, None])
        return orthogonal, data - orthogonal @ (orthogonal.conj().transpose(0, 2, 1) @ data)

    def resonant(self, data: Complexes, degrees: Integers) -> tuple[Complexes, Complexes, Booleans]:
        """Fit data, with poles in the windows where they explain more than chance does."""
        (orthogonal, left), resonant = self.fitted(data), np.zeros(len(data), dtype=bool)
        size = np.sqrt((np.abs(left) ** 2).mean(axis=1, keepdims=True))
        size = np.where(size > 0, size, 1.0)
        chance = scipy.special.chdtri(2 * POLES, RESONANT) / 2 / (degrees * data.shape[2])
        inverse, gained = self.poles(data / size, orthogonal)
        tried = np.flatnonzero((gained > chance) & inverse.any(axis=1))
        if not len(tried):
            return orthogonal, left, resonant
        denominator = 1 - self.offset[tried, :, None] * inverse[tried, None]
        columns, rest = self.among(tried).fitted(data[tried], denominator.prod(axis=2))
        before, after = (
            (np.abs(part / size[tried]) ** 2).sum(axis=(1, 2)) for part in (left[tried], rest)
        )
        better = after < before * (1 - chance[tried])
        resonant[tried[better]] = True
        orthogonal[resonant], left[resonant] = columns[better], rest[better]
        return orthogonal, left, resonant

    def poles(self, scaled: Complexes, orthogonal: Complexes) -> tuple[Complexes, Floats]:
        """Return the poles' inverses, and the share of the residual that they explain.

        `orthogonal` are the columns without poles. By linear least squares for a_1 and a_2: what A
        is multiplied with is noise too, so that lines far from the poles weigh more. That will do;
        weights of the last A (Sanathanan, Koerner 1963) ran astray where noise is all there is.
        """
        turned = scaled[:, :, :, None] * self.offset[:, :, None, None] ** np.arange(POLES + 1)
        flat = turned.reshape(*scaled.shape[:2], -1)
        left = flat - orthogonal @ (orthogonal.conj().transpose(0, 2, 1) @ flat)
        rows = left.reshape(len(left), -1, POLES + 1)
        turned = np.concatenate([rows[:, :, 1:], rows[:, :, :1]], axis=2)
        triangle: Complexes = np.asarray(np.linalg.qr(turned, mode="r"))
        u, s, vh = np.linalg.svd(triangle[:, :POLES, :POLES])
        along = (u.conj().transpose(0, 2, 1) @ triangle[:, :POLES, POLES:])[:, :, 0]
        seen = s > 1e-9 * s[:, :1]  # a column that the references hold says nothing of poles
        moved = np.where(seen, along / np.where(seen, s, 1.0), 0.0)
        a = -(vh.conj().transpose(0, 2, 1) @ moved[:, :, None])[:, :, 0]
        whole = (np.abs(triangle[:, :, POLES]) ** 2).sum(axis=1)
        gained = (np.abs(np.where(seen, along, 0.0)) ** 2).sum(axis=1)
        root = np.sqrt(a[:, 0] ** 2 - 4 * a[:, 1])
        inverse = np.stack([-a[:, 0] + root, -a[:, 0] - root], axis=1) / 2
        lines = self.half / np.where(inverse == 0, 1e-12, inverse)
        decays = (np.abs(lines.imag) > NARROWEST) | (np.abs(lines.real) > self.half)  # hum does not
        return np.where(decays, inverse, 0.0), gained / np.where(whole > 0, whole, 1.0)


def _share(sums: Complexes, own: Complexes) -> Floats:
    """Return ``e^H A^-1 e``, at most one; zero where A is singular."""
    scale = np.sqrt(np.diagonal(sums, axis1=1, axis2=2).real)
    safe = np.where(scale > 0, scale, 1.0)
    whole = sums / (safe[:, :, None] * safe[:, None, :])
    whole = whole + 1e-12 * np.eye(sums.shape[1])
    scaled = own / safe
    solved = np.linalg.solve(whole, scaled[:, :, None])[:, :, 0]
    return np.asarray((scaled.conj() * solved).sum(axis=1).real)
