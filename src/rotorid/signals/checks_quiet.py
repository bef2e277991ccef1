"""Whether a quiet record is of the machine as it ran while it was excited.

The noise of a loop is that of its speed and its controller. What the unbalance does tells both: as
motion of the rotation in every channel it is as large with excitation as without.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Channel, Check, Complexes, Floats

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
class Motion:
    """Lines of a record, from DC on.

    Parameters
    ----------
    channels, driven : complex array, shape (line, ...)
        And those of what drove it, where it is known.
    rotation : complex array, shape (line, 2)
        exp(+-i phi); (line, 0) at standstill.
    place : float
        The speed in lines.
    """

    channels: Complexes
    driven: Complexes
    rotation: Complexes
    place: float

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
    record: Motion,
    quiet: Motion,
    speeds: tuple[float, float],
    shown: float | None = None,
) -> list[Check]:
    """Hold a quiet record against the one it goes with.

    Parameters
    ----------
    channels : sequence of Channel
    record, quiet : Motion
    speeds : (float, float)
        As stated of each, rad/s.
    shown : float, optional
        What the lines of the quiet record show, rad/s.
    """
    stated, other = speeds
    cure = "record the machine without excitation at the speed and under the control of the record"
    if abs(other - stated) > NEARLY * abs(stated):
        text = (
            f"taken at {other * 30 / np.pi:.6g} rpm, the record at {stated * 30 / np.pi:.6g}: "
            f"noise of another loop; {cure}"
        )
        return [Check("quiet", "", text, "warning")]
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
    text = (
        f"where the rotation is said to be it moves by {2 * its[worst]:.3g} {unit}, in the record "
        f"by {2 * mine[worst]:.3g}: {_why(shown)}, and its noise is another; {cure}"
    )
    return [Check("quiet", channels[worst].name, text, "warning")]


def _why(shown: float | None) -> str:
    """Say what the difference comes of."""
    if shown is None:
        return "one of the two was taken at another speed than stated, or under another controller"
    return f"it was taken at {shown * 30 / np.pi:.6g} rpm, as its lines show"
