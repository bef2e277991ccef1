"""A zero-phase low-pass, and derivatives of what it lets pass: for records without periods."""

from __future__ import annotations

import numpy as np
import scipy

from rotorid.frozen import frozen
from rotorid.record import Channel, Floats
from rotorid.signals.spectrum import transfer_of_recording

ORDER = 4
"""Of the Butterworth filter that is run forward and backward: the published one (Janot et al.)."""
END = 1e-3
"""Share of the weight of a filtered sample that may lie beyond the ends of its stretch.

What the record would have gone on to there is guessed, at most as wrong as the motion is large;
a thousandth of it is below what any model of friction leaves.
"""


@frozen
class LowPass:
    """``1 / (1 + (f / f_c)^8)`` for each cut-off: Butterworth of 4th order, forward and backward.

    Parameters
    ----------
    sample_rate : float
        Hz.
    cutoffs : sequence of float
        Hz; the filters of all of them, one after the other.
    """

    sample_rate: float
    cutoffs: tuple[float, ...]

    def gain(self, frequency: Floats) -> Floats:
        """Return the factor of each frequency (Hz)."""
        total = np.ones_like(frequency)
        for cutoff in self.cutoffs:
            total /= 1 + (frequency / cutoff) ** (2 * ORDER)
        return total

    def memory(self) -> int:
        """Return how many samples away the weights of a filtered sample add up to `END`."""
        count = int(np.ceil(32 * self.sample_rate / min(self.cutoffs)))
        gain = self.gain(scipy.fft.rfftfreq(count, 1 / self.sample_rate))
        weights = np.abs(scipy.fft.irfft(gain, n=count))
        far = 2 * np.cumsum(weights[: count // 2 : 1][::-1])[::-1]
        return int(np.argmax(far <= END * weights.sum()))

    def apply(
        self, samples: Floats, order: int = 0, channels: tuple[Channel, ...] | None = None
    ) -> Floats:
        """Return a derivative of the filtered samples, shape (sample, signal).

        The stretch is continued beyond its ends point by point (odd), about the line between
        them, so that filter and derivative are products on its lines: exact, no differences. What
        the `channels` are known to do, delay, hold and dynamics, is undone on the same lines.
        """
        count = len(samples)
        time = np.arange(count) / self.sample_rate
        slope = (samples[-1] - samples[0]) / time[-1]
        centred = samples - samples[0] - np.multiply.outer(time, slope)
        extended = np.concatenate([centred, -centred[-2:0:-1]])
        frequency = scipy.fft.rfftfreq(len(extended), 1 / self.sample_rate)
        factor = (self.gain(frequency) * (2j * np.pi * frequency) ** order)[:, None]
        late = np.zeros(samples.shape[1])
        if channels is not None:
            transfer = transfer_of_recording(channels, frequency, self.sample_rate)
            factor = factor * transfer
            late = np.angle(transfer[1]) / (2 * np.pi * frequency[1])
        lines = scipy.fft.rfft(extended, axis=0) * factor
        found = scipy.fft.irfft(lines, n=len(extended), axis=0)[:count]
        if order == 0:
            found += samples[0] + (time[:, None] + late) * slope
        elif order == 1:
            found += slope
        return np.asarray(found)

    def noise_of(self, samples: Floats, order: int) -> Floats:
        """Return the deviation that white noise leaves on a filtered derivative, shape (signal,).

        The noise is what the filter takes away; motion above the cut-off counts as noise too.
        """
        frequency = np.linspace(0, self.sample_rate / 2, 4097)
        gain = self.gain(frequency)
        taken = np.sqrt(((samples - self.apply(samples)) ** 2).mean(axis=0))
        left = (gain * (2 * np.pi * frequency) ** order) ** 2
        return np.asarray(taken * np.sqrt(left.mean() / ((1 - gain) ** 2).mean()))
