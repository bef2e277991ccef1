"""Whether references drive what was measured, and before it moves.

What is added to a command moves the machine later, never earlier. With phi the phase of
``y conj(r)`` on the lines on which r is strong, the sum of exp(i (phi + omega tau)) has its peak
where tau is the time by which y comes behind r: a reference that is late shows it before zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from rotorid.record import Booleans, Check, Complexes

STRONG = 1e-2
"""Power of a reference, beside that of its strongest lines, above which it excites."""
SMOOTH = 9
"""Lines over which power is taken: a line alone is strong or weak by chance."""
CLEAR = 6.0
"""Height of the peak over the median from which on a channel follows a reference: of ten thousand
places noise lifts one to 3.7, of a million to 4.5."""
ABSENT = 5.0
"""Height below which a reference drives nothing."""
WIDE = 1.5
"""Widths of the peak, 1 / bandwidth, by which it stands before zero: a loop that bends less than
its excitation is wide moves it by less than one."""
ALIKE = 0.8
"""Part of the highest peak from which on one nearer to zero is taken: excitation with a period has
one in each."""
MOST = 1 << 14
"""Lines that are looked at, the lowest: of 13 s up to 1.3 kHz, in which machines are excited."""
LEAST = 30
"""Lines that are strong, at the least, for a peak to be one."""
CHECK = "reference"
"""Name of the check: it widens deviations, and rejects nothing."""


def check_references(
    names: Sequence[str],
    references: Complexes,
    measured: Sequence[str],
    channels: Complexes,
    sample_rate: float,
) -> list[Check]:
    """Find references that are late, or that nothing follows.

    Parameters
    ----------
    names : sequence of str
        Of the references, whose lines from DC on are `references`, (line, reference).
    measured : sequence of str
        Of the channels, whose lines are `channels`, (line, channel).
    sample_rate : float
        Hz.
    """
    found = []
    samples = 2 * (len(references) - 1)
    references, channels = references[:MOST], channels[:MOST]
    for j, name in enumerate(names):
        strong = _strong(references[:, j])
        if strong.sum() < LEAST:
            continue
        peaks = [_peak(references[:, j], lines, strong) for lines in channels.T]
        height = max(peak[0] for peak in peaks)
        # Of axes that are swept in turn each follows the other's reference half a record late.
        clear = [(abs(place), c) for c, (high, place) in enumerate(peaks) if high > CLEAR]
        best = min(clear)[1] if clear else 0
        seconds = -peaks[best][1] * samples / sample_rate
        width = samples / strong.sum() / sample_rate  # one over the band
        if height < ABSENT:
            text = (
                "nothing that was measured follows it: it takes no motion away, and what it did "
                "not drive counts as noise; name the column of the excitation, or leave it out"
            )
            found.append(Check(CHECK, name, text, "warning"))
        elif clear and seconds > WIDE * width:
            text = (
                f"{measured[best]} follows it {seconds:.3g} s before it comes, "
                f"{round(seconds * sample_rate)} samples: it is late by as much at least, and "
                "deviations are too wide where that turns its phase within a window of lines; "
                "shift its column, or record it where it is added"
            )
            found.append(Check(CHECK, name, text, "warning"))
    return found


def _strong(lines: Complexes) -> Booleans:
    """Tell on which lines a reference is strong."""
    power = np.abs(lines) ** 2
    power[0] = 0.0
    smooth = scipy.ndimage.uniform_filter1d(power, SMOOTH)
    return np.asarray(smooth > STRONG * smooth.max())


def _peak(reference: Complexes, lines: Complexes, strong: Booleans) -> tuple[float, float]:
    """Return the height of the peak over the median, and its place in turns of the record."""
    cross = np.where(strong, lines * reference.conj(), 0.0)
    size = np.abs(cross)
    whole = np.zeros(scipy.fft.next_fast_len(2 * len(lines)), dtype=np.complex128)
    whole[: len(lines)] = cross / np.where(size > 0, size, 1.0)
    envelope = np.abs(scipy.fft.ifft(whole))
    middle = float(np.median(envelope))
    top = (envelope >= np.roll(envelope, 1)) & (envelope >= np.roll(envelope, -1))
    high = np.flatnonzero(top & (envelope >= ALIKE * envelope.max()))
    turns = (high / len(whole) + 0.5) % 1.0 - 0.5
    place = float(turns[np.abs(turns).argmin()])
    return (float(envelope.max()) / middle if middle > 0 else 0.0), place
