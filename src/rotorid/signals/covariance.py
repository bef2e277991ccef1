"""Covariance of mean lines, from their scatter between periods or from neighbouring lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.values import Arrays, Complexes, frozen

Kind = Literal[
    "white",  # the scatter between periods
    "correlated",  # neighbouring lines of periods
    "references",  # a local polynomial with references
    "quiet",  # a quiet record
    "inputs",  # a local polynomial with the measured inputs for references
    "stated",  # the user
    "known",  # a plan
    "repeated",  # repeated readings
    "coherence",  # that of responses: diagonal, and each variance has `dof` of its own
]
"""Where a covariance came from."""

KNOWN = 10**12
"""Degrees of freedom of a covariance that is known."""
FLOOR = 1e-9
"""Least deviation of a mean line, relative to the size of its channels: rounding and no more."""


@frozen
class LineCovariance(Arrays):
    # (line, channel, channel): ``E (z_k - E z_k)(z_k - E z_k)^H``, cross terms between channels
    # kept
    matrices: Complexes
    dof: int  # complex degrees of freedom of the estimate
    kind: Kind
    # share of a line's noise that is not in its own covariance: 1 for the scatter of periods, less
    # where the residual of the line itself is among those that the covariance is made of
    apart: float = 1.0
    shared: int = 1  # how many lines have their covariance from one estimate, of as many together

    def times(self, factors: Complexes) -> LineCovariance:
        products = factors[:, :, None] * factors[:, None, :].conj()
        return replace(self, matrices=self.matrices * products)


def white_covariance(spectra: Complexes) -> LineCovariance:
    """Covariance of the mean from the scatter between independent periods (period, line, channel).

    ``C_k = sum_p (z_kp - z_k)(z_kp - z_k)^H / (P (P - 1))``; P - 1 degrees of freedom.
    """
    periods = _periods(spectra)
    scatter = np.moveaxis(spectra - spectra.mean(axis=0), 0, -1)
    matrices = scatter @ scatter.conj().swapaxes(-1, -2) / (periods * (periods - 1))
    return LineCovariance(matrices, periods - 1, "white")


def correlated_covariance(spectra: Complexes, neighbours: int | None = None) -> LineCovariance:
    """Covariance of the mean from the lines of the whole record beside each kept line.

    With ``G_kj = sum_p z_kp exp(-2 pi i j p / P)``, the line j record lines away,
    ``C_k = sum_{0 < |j| <= m} G_kj G_kj^H / (2 m P^2)``. Right where the noise carries over from
    period to period, as true random motion in closed loop does: there the scatter between periods
    holds a term that cancels in the mean. 2 m degrees of freedom, P - 1 where m is half of P.
    """
    periods = _periods(spectra)
    m = max(1, round(periods / 12)) if neighbours is None else neighbours
    offsets = [j % periods for j in (*range(-m, 0), *range(1, m + 1))]
    distinct = sorted(set(offsets) - {0})
    if m < 1 or 2 * m > periods:
        raise InputError(
            f"{m} neighbouring lines", f"1 to {periods // 2}", "take fewer or record longer"
        )
    record_lines = np.moveaxis(np.fft.fft(spectra, axis=0)[distinct], 0, -1)
    matrices = record_lines @ record_lines.conj().swapaxes(-1, -2) / (len(distinct) * periods**2)
    return LineCovariance(matrices, len(distinct), "correlated")


def lag_one_correlation(residual: Complexes) -> float:
    """Return the residual's correlation with that a period later; lines and rows count alike."""
    scatter = residual - residual.mean(axis=0)
    power = (np.abs(scatter) ** 2).sum(axis=0)
    # Rounding leaves a scatter of its own where there is no noise.
    noisy = power > 1e-24 * (np.abs(residual) ** 2).sum(axis=0)
    if not noisy.any():
        return 0.0
    lagged = (scatter[1:] * scatter[:-1].conj()).real.sum(axis=0)
    return float((lagged[noisy] / power[noisy]).mean())


def is_correlated(residual: Complexes) -> bool:
    """Tell whether the lag-one correlation is three deviations off that of independent periods."""
    periods, lines = residual.shape[:2]
    if periods < 8:
        return False
    real_lines = np.count_nonzero(~residual.imag.any(axis=(0, 2)))  # DC, Nyquist
    distance = abs(lag_one_correlation(residual) + 1 / periods)
    return bool(distance > 3 / np.sqrt(periods * (2 * lines - real_lines)))


def choose_covariance(spectra: Complexes, residual: Complexes) -> LineCovariance:
    return correlated_covariance(spectra) if is_correlated(residual) else white_covariance(spectra)


def _periods(spectra: Complexes) -> int:
    if len(spectra) < 2:
        raise InputError(f"{len(spectra)} periods", "2 or more", "record longer")
    return len(spectra)
