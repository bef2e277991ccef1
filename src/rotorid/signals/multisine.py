"""Multisines: sums of sines of one fundamental, so that whole periods have no leakage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from rotorid.core.errors import InputError, require_positive
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.signals.spectrum import synthesize

Phases = Literal["zero", "schroeder", "random"]


@frozen
class Multisine:
    """Periodic signals, ``u(t) = sum_k Re(A_k exp(2 pi i k f0 t))``."""

    fundamental: float  # f0 in Hz
    harmonics: Integers  # (line,): k, increasing, 1 or more
    # (line, signal): A, in the unit of the signals: |A| is the peak of a line
    amplitudes: Complexes
    names: tuple[str, ...]  # of the signals
    unit: str = "N"

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "harmonics", _harmonics(self.harmonics))
        object.__setattr__(self, "amplitudes", np.asarray(self.amplitudes, dtype=complex))
        expected = (len(self.harmonics), len(self.names))
        if self.amplitudes.shape != expected or not np.isfinite(self.amplitudes).all():
            raise InputError(
                f"amplitudes of shape {self.amplitudes.shape}",
                f"finite numbers of shape {expected}: one row per harmonic, one column per signal",
                "give each harmonic its row and each signal its column",
                place="amplitudes",
            )
        cure = "give the rate at which the signal repeats"
        require_positive(self.fundamental, "Hz", cure, place="fundamental")

    def samples(self, sample_rate: float) -> Floats:
        """Return one period, shape (sample, signal); the rate is a multiple of the fundamental."""
        exact = sample_rate / self.fundamental
        count = round(exact)
        if abs(exact - count) > 1e-9 * exact:
            raise InputError(
                f"{sample_rate:g} Hz for a fundamental of {self.fundamental:g} Hz",
                "a whole multiple of the fundamental",
                "choose the fundamental so that a period is a whole number of samples",
                place="sample_rate",
            )
        highest = self.harmonics[-1]
        if count <= 2 * highest:
            raise InputError(
                f"{sample_rate:g} Hz for a line at {highest * self.fundamental:g} Hz",
                f"more than {2 * highest * self.fundamental:g} Hz",
                "sample faster or leave the high lines out",
                place="sample_rate",
            )
        return synthesize(self.amplitudes / 2, self.harmonics, count)

    @property
    def rms(self) -> Floats:
        return np.asarray(np.sqrt((np.abs(self.amplitudes) ** 2).sum(axis=0) / 2))

    @property
    def crest_factor(self) -> Floats:
        """Peak over root mean square of each signal, between samples too, shape (signal,)."""
        fine = synthesize(self.amplitudes / 2, self.harmonics, _fine(self.harmonics))
        peak = np.abs(fine).max(axis=0)
        return np.asarray(peak / np.where(self.rms > 0, self.rms, np.inf))

    def scaled(self, factors: ArrayLike) -> Multisine:
        return replace(self, amplitudes=self.amplitudes * np.asarray(factors))


def _harmonics(harmonics: ArrayLike) -> Integers:
    given = np.atleast_1d(np.asarray(harmonics))
    whole = given.astype(np.int64)
    if given.ndim != 1 or not given.size or (whole != given).any() or whole[0] < 1:
        cure = "count harmonics from the fundamental, which is 1"
        raise InputError(f"harmonics {list(given.ravel()[:8])}", "whole numbers from 1", cure)
    if (np.diff(whole) <= 0).any():
        raise InputError(f"harmonics {list(whole[:8])}", "increasing numbers", "sort them")
    return whole


def _fine(harmonics: Integers) -> int:
    """Return samples enough to see the peaks: 32 for the shortest wave, as a power of two."""
    return int(2 ** np.ceil(np.log2(32 * harmonics[-1])))


def odd_harmonics(highest: int) -> Integers:
    return np.arange(1, highest + 1, 2, dtype=np.int64)


def full_harmonics(highest: int) -> Integers:
    return np.arange(1, highest + 1, dtype=np.int64)


def leave_out(harmonics: ArrayLike, group: int, rng: np.random.Generator) -> Integers:
    """Leave a random line out of each group: odd distortion falls on odd ones, even on even."""
    lines = _harmonics(harmonics)
    if group < 2:
        raise InputError(f"groups of {group}", "2 or more", "choose larger groups", place="group")
    out = [start + rng.integers(group) for start in range(0, len(lines) - group + 1, group)]
    return np.delete(lines, out)


def schroeder_phases(power: ArrayLike) -> Floats:
    """Return the phases of a sweep, ``-2 pi sum_{j<n} (n - j) p_j``, p_j the share of line j."""
    part = np.asarray(power, dtype=float)
    part = part / part.sum()
    return np.asarray(-2 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(part))[:-1]]))


def multisine(
    fundamental: float,
    harmonics: ArrayLike,
    amplitude: Mapping[str, float | Sequence[float]],
    *,
    phases: Phases = "schroeder",
    apart: bool = False,
    unit: str = "N",
    rng: np.random.Generator | None = None,
) -> Multisine:
    """Build a multisine of peaks `amplitude`; `apart` gives each line to one signal, in turn."""
    lines = _harmonics(harmonics)
    names = tuple(amplitude)
    try:
        size = np.stack([np.broadcast_to(amplitude[name], len(lines)) for name in names], axis=1)
    except ValueError:
        raise InputError(
            "amplitudes of another number than the harmonics",
            f"one, or {len(lines)}, for each signal",
            "give one amplitude for all harmonics, or a list of one for each",
            place="amplitude",
        ) from None
    if apart:
        turn = np.arange(len(lines))[:, None] % len(names)
        size = np.where(turn == np.arange(len(names)), size, 0.0)
    angle = np.zeros(size.shape)
    if phases == "random":
        if rng is None:
            raise InputError("random phases without rng", "a generator", "pass rng", place="rng")
        angle = rng.uniform(0, 2 * np.pi, size.shape)
    elif phases == "schroeder":
        for j, column in enumerate(size.T):
            used = column != 0
            if used.any():
                angle[used, j] = schroeder_phases(column[used] ** 2)
    return Multisine(fundamental, lines, size * np.exp(1j * angle), names, unit)


def orthogonal(signals: Multisine) -> tuple[Multisine, ...]:
    """Return as many runs as signals, orthogonal on every line: amplitudes times a DFT matrix."""
    turns = scipy.linalg.dft(len(signals.names)).conj()
    return tuple(replace(signals, amplitudes=signals.amplitudes * turn) for turn in turns)


def minimize_crest(signals: Multisine, *, steps: int = 8) -> Multisine:
    """Return the multisine with phases that lower the crest factor; amplitudes are kept.

    The norms of order 2p, whose limit is the peak, are minimized for p = 2, 4, 8, ..., each from
    the last. The given phases and a few sweeps serve as starts, and the lowest peak is kept.
    """
    with threadpool_limits(1, "blas"):  # matrices so small that threads only wait for each other
        columns = [
            _flattened(tuple(signals.harmonics.tolist()), tuple(column.tolist()), steps)
            if np.abs(column).any()
            else column
            for column in signals.amplitudes.T
        ]
    return replace(signals, amplitudes=np.stack(columns, axis=1))


@lru_cache(maxsize=16)  # a second or two, and the same rig is often read again
def _flattened(numbers: tuple[int, ...], phasors: tuple[complex, ...], steps: int) -> Complexes:
    harmonics, amplitudes = np.array(numbers), np.array(phasors)
    used = np.abs(amplitudes) > 0
    lines, size, count = harmonics[used], np.abs(amplitudes[used]), _fine(harmonics)
    rms = np.sqrt((size**2).sum() / 2)

    def cost(angle: Floats, p: int) -> tuple[float, Floats]:
        """Logarithm of the norm of order 2p over the rms, and its gradient."""
        u = synthesize((size * np.exp(1j * angle) / 2)[:, None], lines, count)[:, 0] / rms
        peak = np.abs(u).max()
        relative = (u / peak) ** (2 * p - 1)
        mean = np.mean(relative * u / peak)
        weight = np.fft.rfft(relative / peak / mean, norm="forward")[lines]
        slope = (1j * size * np.exp(1j * angle) * weight.conj()).real / rms
        return float(np.log(peak) + np.log(mean) / (2 * p)), slope

    given = np.angle(amplitudes[used])
    best, lowest = given, cost(given, 2**20)[0]
    sweep = schroeder_phases(size**2)
    # Sweeps that take one period, and 1.4 of it: more starts gain below 1 %.
    for start in (given, sweep, sweep * 1.4):
        angle = start
        for step in range(1, steps + 1):
            angle = scipy.optimize.minimize(
                cost, angle, args=(2**step,), jac=True, method="L-BFGS-B", options={"maxiter": 300}
            ).x
            peak = cost(angle, 2**20)[0]
            if peak < lowest:
                best, lowest = angle, peak
    flattened = amplitudes.copy()
    flattened[used] = size * np.exp(1j * best)
    return flattened
