"""Lines of periodic samples: DFT, derivatives, hold, delay and dynamics of a channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats, Integers
from rotorid.data.record import Channel


def line_spectra(samples: ArrayLike, harmonics: ArrayLike) -> Complexes:
    """Return the lines of signals, the line filter: ``X_k = mean_n(x_n exp(-2 pi i k n / N))``."""
    spectrum = np.fft.rfft(np.asarray(samples, dtype=float), axis=-2, norm="forward")
    return np.asarray(spectrum[..., np.asarray(harmonics), :])


def lines_within(band: tuple[float, float], sample_rate: float, samples: int) -> Integers:
    """Return the numbers of the lines in a band, in Hz, both ends included."""
    low, high, spacing = *band, sample_rate / samples
    if not 0 <= low <= high <= sample_rate / 2 * (1 + 1e-9):
        expected = f"0 Hz to {sample_rate / 2:g} Hz, half the sample rate, the lower end first"
        cure = "give the band in which the machine was excited"
        raise InputError(f"the band {low:g} to {high:g} Hz", expected, cure, place="band")
    found = np.arange(np.ceil(low / spacing - 1e-6), np.floor(high / spacing + 1e-6) + 1)
    if not len(found):
        raise InputError(
            f"no line between {low:g} and {high:g} Hz, lines are {spacing:g} Hz apart",
            "at least one line",
            "widen the band, or record longer",
            place="band",
        )
    return found.astype(np.int64)


def synthesize(lines: ArrayLike, harmonics: ArrayLike, samples: int) -> Floats:
    lines = np.asarray(lines, dtype=complex)
    full = np.zeros((*lines.shape[:-2], samples // 2 + 1, lines.shape[-1]), dtype=complex)
    full[..., np.asarray(harmonics), :] = lines
    return np.asarray(np.fft.irfft(full, n=samples, axis=-2, norm="forward"))


def differentiate(
    lines: ArrayLike, harmonics: Integers, samples: int, sample_rate: float, order: int
) -> Complexes:
    """Return ``(i omega_k)^order X_k``; the Nyquist line is a cosine: odd derivatives vanish."""
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


def top_of(left: float, here: float, right: float) -> float:
    """Return how far from the middle of three neighbours the top of their parabola lies."""
    bend = left - 2 * here + right
    return float(0.5 * (left - right) / bend) if bend < 0 else 0.0


_HALF = 64
_BETA = 18.9  # 180 dB beside the lines
"""A sinc over 128 samples under Kaiser's window: right to 1e-9 up to 0.45 of the sample rate."""


def shifted(samples: Floats, steps: float, period: int | None = None) -> Floats:
    """Return a signal `steps` samples later; 64 at each end are as right as `extended` is."""
    whole = int(np.floor(steps + 1e-9))
    part = steps - whole
    if abs(steps) < 1e-9:
        return samples
    offsets = np.arange(1 - _HALF, 1 + _HALF)
    away = offsets - part
    weights = np.sinc(away) * np.i0(_BETA * np.sqrt(np.maximum(1 - (away / _HALF) ** 2, 0.0)))
    weights /= weights.sum()
    first, last = whole + offsets[0], whole + offsets[-1]
    whole_signal = extended(samples, max(-first, 0), max(last, 0), period)
    begin = max(first, 0)
    window = whole_signal[begin : begin + len(samples) + last - first]
    return np.asarray(scipy.signal.correlate(window, weights, mode="valid"))


def extended(samples: Floats, before: int, after: int, period: int | None) -> Floats:
    """Continue a signal beyond its ends: from a period away, or turned about its last value."""
    count = len(samples)
    if period is not None and period <= count:
        head = samples[:period][np.arange(-before, 0) % period]
        tail = samples[count - period :][np.arange(after) % period]
        return np.concatenate([head, samples, tail])
    if max(before, after) < count:
        return np.pad(samples, (before, after), "reflect", reflect_type="odd")
    return np.pad(samples, (before, after), "edge")


REACH = 512
"""Samples beyond the ends of a record: the slowest amplifier has forgotten them."""
AMPLIFIED = 10.0
"""What a channel lets less than a tenth through of is noise, and is not made any larger."""


def quantity(
    column: Floats, channel: Channel, sample_rate: float, period: int | None = None
) -> Floats:
    """Return a column without its delay, by interpolation, or its dynamics, line by line."""
    if channel.dynamics is None:
        return shifted(column, channel.delay * sample_rate, period)
    goes_round = period is not None and len(column) % period == 0
    reach = 0 if goes_round else min(REACH, len(column) - 1, period or REACH)
    whole = extended(column, reach, reach, period)
    turns = np.asarray(np.fft.rfftfreq(len(whole)), dtype=np.float64)
    frequency = np.clip(turns * sample_rate, *channel.dynamics.band)
    factor = transfer_of_recording([channel], frequency, sample_rate)[:, 0]
    factor = factor / np.maximum(np.abs(factor) / AMPLIFIED, 1.0)
    lines = np.fft.rfft(whole) * factor
    return np.asarray(np.fft.irfft(lines, len(whole))[reach : len(whole) - reach])
