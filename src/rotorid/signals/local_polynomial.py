"""Covariance of the noise on the lines of a whole record, window by window.

In a window of 2h + 1 lines around each line, every channel is fitted by

    z_j = (G_0 + G_1 j + .. + G_S j^S) r_j + (t_0 + .. + t_S j^S) + a W_j,

r the lines of references, t the transient, W the lines of exp(+-i phi). What is left over, E, has
n = 2h + 1 - columns complex degrees of freedom, and C = E E^H / n (Pintelon, Schoukens,
Vandersteen, Barbe 2010).
"""

from __future__ import annotations

import numpy as np

from rotorid.record import Complexes, Integers

ORDER = 2
"""S: a window of a few Hz bends no more than a parabola (held against 3: the same J / dof)."""
PER_CHANNEL = 5
"""n is at least this many times the channels: with fewer, V is estimated too badly to whiten with
(n = 19 for 8 channels gave J / dof 1.08)."""
CHUNK = 256
"""Lines at a time, so that memory stays that of the lines."""


def half_width(channels: int, references: int, rotating: bool) -> int:
    """Return the least h that leaves enough degrees of freedom."""
    columns = columns_of(references, rotating)
    return -(-(PER_CHANNEL * channels + columns - 1) // 2)


def columns_of(references: int, rotating: bool) -> int:
    """Return the number of columns of a window's regression."""
    return (ORDER + 1) * (references + 1) + (2 if rotating else 0)


def local_covariance(
    channels: Complexes,
    references: Complexes,
    rotation: Complexes,
    lines: Integers,
    half: int,
) -> tuple[Complexes, int]:
    """Return C of chosen lines, (line, channel, channel), and its degrees of freedom.

    Parameters
    ----------
    channels, references, rotation : complex array, shape (every line, ...)
        All lines of the record from DC on; `rotation` empty at standstill.
    lines : int array, shape (line,)
        The lines that are asked for.
    half : int
        h. At the ends of the spectrum a window stands beside its line.
    """
    width = 2 * half + 1
    first = np.clip(lines - half, 0, len(channels) - width)
    window = first[:, None] + np.arange(width)
    offset = (window - lines[:, None]) / half
    powers = offset[:, :, None] ** np.arange(ORDER + 1)
    dof = width - columns_of(references.shape[1], rotation.shape[1] > 0)
    count = channels.shape[1]
    found = np.empty((len(lines), count, count), dtype=np.complex128)
    for start in range(0, len(lines), CHUNK):
        part = slice(start, start + CHUNK)
        design = _design(references[window[part]], rotation[window[part]], powers[part])
        orthogonal, _ = np.linalg.qr(design)
        data = channels[window[part]]
        left = data - orthogonal @ (orthogonal.conj().transpose(0, 2, 1) @ data)
        found[part] = left.transpose(0, 2, 1) @ left.conj() / dof
    return found, dof


def _design(references: Complexes, rotation: Complexes, powers: np.ndarray) -> Complexes:
    """Return the columns of each window at length one, shape (window, line, column)."""
    driven = references[:, :, :, None] * powers[:, :, None, :]
    flat = driven.reshape(*references.shape[:2], -1)
    design = np.concatenate([flat, powers + 0j, rotation], axis=2)
    size = np.sqrt((np.abs(design) ** 2).sum(axis=1, keepdims=True))
    return np.asarray(design / np.where(size > 0, size, 1.0))
