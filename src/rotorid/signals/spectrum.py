"""Line spectra: DFT, synthesis, differentiation, and what a hold and a delay do to a line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rotorid.record import Channel, Complexes, Floats, Integers


def line_spectra(samples: ArrayLike, harmonics: ArrayLike) -> Complexes:
    """Return the lines of signals, the line filter: ``X_k = mean_n(x_n exp(-2 pi i k n / N))``."""
    spectrum = np.fft.rfft(np.asarray(samples, dtype=float), axis=-2, norm="forward")
    return np.asarray(spectrum[..., np.asarray(harmonics), :])


def synthesize(lines: ArrayLike, harmonics: ArrayLike, samples: int) -> Floats:
    """Return one period of the signals that have these lines and no others."""
    lines = np.asarray(lines, dtype=complex)
    full = np.zeros((*lines.shape[:-2], samples // 2 + 1, lines.shape[-1]), dtype=complex)
    full[..., np.asarray(harmonics), :] = lines
    return np.asarray(np.fft.irfft(full, n=samples, axis=-2, norm="forward"))


def differentiate(
    lines: ArrayLike, harmonics: Integers, samples: int, sample_rate: float, order: int
) -> Complexes:
    """Return the lines of a time derivative: ``(i omega_k)^order X_k``.

    The Nyquist line of an even number of samples shows the cosine only, whose odd derivatives
    vanish at the samples: there they are zero.
    """
    omega = 2 * np.pi * sample_rate / samples * harmonics
    factor = (1j * omega) ** order
    if order % 2:
        factor = np.where(2 * harmonics == samples, 0, factor)
    return np.asarray(np.asarray(lines) * factor[:, None])


def transfer_of_recording(
    channels: Sequence[Channel], frequency: Floats, sample_rate: float
) -> Complexes:
    """Return quantity / recording on each line: what corrects the lines of a record.

    A command held over T = 1/sample_rate acts as ``sinc(f T) exp(-i pi f T)`` times its samples;
    samples that lag by tau are multiplied by ``exp(2 pi i f tau)``; known dynamics divide the
    lines of a sensor and multiply those of an actuator.
    """
    turns = frequency / sample_rate
    hold = np.sinc(turns) * np.exp(-1j * np.pi * turns)
    columns = [
        np.exp(2j * np.pi * frequency * channel.delay)
        * (hold if channel.hold else 1.0)
        * (1.0 if channel.dynamics is None else channel.dynamics.correction(2 * np.pi * frequency))
        for channel in channels
    ]
    return np.asarray(np.stack(columns, axis=-1))
