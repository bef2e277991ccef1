"""Checks of reference signals and of noise-only records.

With phi the phase of ``y conj(r)``, the sum of exp(i (phi + omega tau)) has its peak where tau is
the time by which y comes behind r: a reference that is late shows it before zero. Excitation or
none, a loop of one speed and controller answers the unbalance alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from rotorid.core.notes import Note
from rotorid.core.values import Booleans, Complexes, Floats, frozen
from rotorid.data.record import Channel

STRONG = 1e-2
"""Power of a reference, beside that of its strongest lines, above which it excites."""
SMOOTH = 9
"""Lines over which power is taken: a line alone is strong or weak by chance."""
CLEAR = 6.0
"""Height of the peak over the median from which on it is no noise: of a million places 4.5."""
ABSENT = 5.0
"""Height below which a reference drives nothing."""
WIDE = 1.5
"""Widths of the peak, 1 / bandwidth, by which it stands before zero: a loop that bends less than
its excitation is wide moves it by less than one."""
ALIKE = 0.8
"""Part of the highest peak from which on a nearer one is taken: of each period there is one."""
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
) -> Iterator[Note]:
    """Find references that are late, or that nothing follows; lines from DC on, (line, column)."""
    samples = 2 * (len(references) - 1)
    references, channels = references[:MOST], channels[:MOST]
    for j, name in enumerate(names):
        power = np.abs(references[:, j]) ** 2
        power[0] = 0.0
        smooth = scipy.ndimage.uniform_filter1d(power, SMOOTH)
        strong = np.asarray(smooth > STRONG * smooth.max())
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
            yield Note(CHECK, "warns", text, on=(name,))
        elif clear and seconds > WIDE * width:
            text = (
                f"{measured[best]} follows it {seconds:.3g} s before it comes, "
                f"{round(seconds * sample_rate)} samples: it is late by as much at least, and "
                "deviations are too wide where that turns its phase within a window of lines; "
                "shift its column, or record it where it is added"
            )
            yield Note(CHECK, "warns", text, on=(name,))


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


AROUND = 12
"""Lines on each side of the rotation that tell how large it is, and how sure that is."""
SURE = 6.0
"""Deviations by which it differs; of tens of channels chance makes four."""
UNLIKE = 0.3
"""Part of it by which it differs: a speed that is not held to a per cent changes it by a few, and
at another speed nothing is left where the rotation is said to be."""
NEARLY = 0.05
"""Part of the speed up to which another one hardly changes the noise of a loop."""


@frozen
class DrivenMotion:
    """Lines of a record, from DC on."""

    # (line, ...): and those of what drove it, where it is known
    channels: Complexes
    driven: Complexes
    rotation: Complexes  # (line, 2): exp(+-i phi); (line, 0) at standstill
    place: float  # the speed in lines

    def turning(self) -> tuple[Floats, Floats] | None:
        """Return the size of the rotation in each channel, and its deviation."""
        middle = round(self.place)
        lines = np.arange(middle - AROUND, middle + AROUND + 1)
        if not self.rotation.shape[1] or lines[0] < 1 or lines[-1] >= len(self.channels):
            return None
        powers = ((lines - middle) / AROUND)[:, None] ** np.arange(2)
        driven = (self.driven[lines][:, :, None] * powers[:, None, :]).reshape(len(lines), -1)
        design = np.concatenate([self.rotation[lines], driven, powers], axis=1)
        size = np.sqrt((np.abs(design) ** 2).sum(axis=0))
        basis, triangle = np.linalg.qr(design / np.where(size > 0, size, 1.0))
        degrees = len(lines) - design.shape[1]
        if degrees < AROUND or not size[0] > 0:
            return None
        told = basis.conj().T @ self.channels[lines]
        left = self.channels[lines] - basis @ told
        noise = np.sqrt((np.abs(left) ** 2).sum(axis=0) / degrees)
        first = np.linalg.lstsq(triangle, np.eye(len(triangle)), rcond=None)[0][0]
        return np.abs(first @ told) / size[0], noise * np.linalg.norm(first) / size[0]


def check_quiet(
    channels: Sequence[Channel],
    record: DrivenMotion,
    quiet: DrivenMotion,
    speeds: tuple[float, float],
    shown: float | None = None,
) -> list[Note]:
    """Compare a quiet record with its record; speeds as stated, and as its lines show, rad/s."""
    stated, other = speeds
    cure = "record the machine without excitation at the speed and under the control of the record"
    if abs(other - stated) > NEARLY * abs(stated):
        text = (
            f"taken at {other * 30 / np.pi:.6g} rpm, the record at {stated * 30 / np.pi:.6g}: "
            f"noise of another loop; {cure}"
        )
        return [Note("quiet", "warns", text)]
    sizes, its_sizes = record.turning(), quiet.turning()
    if sizes is None or its_sizes is None:
        return []
    (mine, std), (its, its_std) = sizes, its_sizes
    apart = np.abs(mine - its)
    unlike = apart > UNLIKE * np.maximum(mine, its)
    sure = np.where(unlike, apart / np.maximum(np.hypot(std, its_std), 1e-300), 0.0)
    worst = int(np.argmax(sure))
    if sure[worst] <= SURE:
        return []
    unit = channels[worst].unit
    why = "one of the two was taken at another speed than stated, or under another controller"
    if shown is not None:
        why = f"it was taken at {shown * 30 / np.pi:.6g} rpm, as its lines show"
    text = (
        f"where the rotation is said to be it moves by {2 * its[worst]:.3g} {unit}, in the record "
        f"by {2 * mine[worst]:.3g}: {why}, and its noise is another; {cure}"
    )
    return [Note("quiet", "warns", text, on=(channels[worst].name,))]
