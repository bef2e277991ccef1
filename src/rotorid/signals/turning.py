"""The rotation beside the periods: its line at its own frequency, and the periods without it.

All samples of a channel hold the lines of the period and the waves cos(m phi), sin(m phi) together.
What the waves have in common with the lines is their own mean period. So the joint solution is that
of v, the waves less that mean: v a = x less its own, and the periods are those of x - waves a.
Within a tenth of a turn of a line it keeps the wave that it cannot be told from, beside a.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from rotorid.core.linalg import triangle
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.record import Steady, some_periods
from rotorid.signals.spectrum import line_spectra

ORDERS = (1, 2, 3)
"""Multiples taken out of the periods: unbalance, runout; what a misaligned or oval shaft does."""
APART = 0.1
"""Turns over the record by which a rotation gains on the nearest line, from which on both are told:
their deviations are 1.3 times those of lines alone where it is half a turn, 5.6 times here."""
SLIPS = 1e-3  # turns over the record from which on a slip is more than rounding of the scatter
LEAST = 4
"""Periods that tell a line, a mean and some scatter."""
SURE = 3.5
"""Deviations from which on the speed is the one that the lines show: chance takes one good record
in two thousand there, of eight periods one in a hundred, whose deviations are then too wide. As for
a rotation on a line."""
STATED = 5e-3
"""Share by which a stated speed is plausibly off, before the record tells: what a display of three
digits rounds at most, or what load changes in the slip of a motor."""
AT_ONCE = 1 << 15  # samples
ROUNDING = 1e-9  # what is left beside the line of a rotation, over that, below which it is rounding


def orders_apart(turns: float, periods: int, size: int) -> tuple[int, ...]:
    """Return the multiples of a rotation that stand on no line of the period; none without 1."""
    apart = [abs(m * turns - round(m * turns)) * periods >= SLIPS for m in ORDERS]
    found = [m for m in ORDERS if apart[m - 1] and m * turns < size / 2]
    return tuple(found) if 1 in found else ()


def scattered(moved: Complexes, periods: int) -> Complexes:
    """Return deviations of lines as scatter, a row a period, as strong at any lag."""
    n = np.arange(periods)
    chirp = np.exp(1j * np.pi / periods * n * (n + periods % 2))  # periodic of odd length too (Chu)
    chirp -= chirp.mean()
    chirp *= np.sqrt(periods * (periods - 1)) / np.linalg.norm(chirp)
    return np.asarray(np.multiply.outer(chirp, moved))


def waves(angle: Floats, orders: Iterable[int]) -> Floats:
    """Return cos(m phi) and sin(m phi), (..., 2 m)."""
    once = np.exp(1j * angle)
    return np.stack([part for m in orders for part in ((once**m).real, (once**m).imag)], axis=-1)


def without_waves(values: Floats, angle: Floats, orders: Iterable[int]) -> tuple[Floats, Floats]:
    """Return signals, (period, sample, signal), without the rotation, and its waves' sizes."""
    columns = waves(angle, orders)
    flat = (columns - columns.mean(axis=0)).reshape(-1, columns.shape[-1])
    found = np.linalg.lstsq(flat, values.reshape(len(flat), -1), rcond=None)[0]
    rest, size = values - columns @ found, np.abs(values).max(axis=(0, 1))
    rest[np.abs(rest) < ROUNDING * size] = 0.0
    return rest, found


@frozen
class Turning:
    """The line of a rotation beside the periods."""

    line: Complexes  # (channel,): where the angle is zero
    kept: Complexes  # (line, 2): what the lines keep of cos(phi) and sin(phi)
    noise: Complexes  # (period, channel): what else is at its frequency
    # factors that make scatter that of the joint solution: of that noise, and of each line, (line,)
    width: float
    widths: Floats


def turning(
    passes: Callable[[], Iterable[Floats]],
    angle: Steady | Floats,
    recorded: Floats,
    orders: tuple[int, ...],
    turns: float,
    lines: Integers,
    add: Callable[[Floats], None],
) -> Turning:
    """Find the rotation in periods, of which each pass yields all, and `add` them without it.

    `recorded`: their mean period, of so many `turns`. Of all samples a triangle of QR is kept.
    """
    size, each, count = recorded.shape[0], 2 * len(orders), angle.shape[0]
    period, step = np.zeros((size, each)), max(1, AT_ONCE // size)
    for begin in range(0, count, step):
        some = some_periods(angle, begin, min(begin + step, count))
        period += waves(some, orders).sum(axis=0) / count

    def parts() -> Iterator[tuple[Floats, Floats]]:
        begin = 0
        for periods in passes():
            yield periods, some_periods(angle, begin, begin + len(periods))
            begin += len(periods)

    root = np.zeros((0, each + recorded.shape[1]))
    for periods, phi in parts():
        beside = np.concatenate([waves(phi, orders) - period, periods - recorded], axis=2)
        root = triangle(np.concatenate([root, beside.reshape(-1, beside.shape[2])]))
    root /= np.sqrt(count * size)
    root, right = root[:each, :each], root[:each, each:]
    found, inverse = np.linalg.solve(root, right), np.linalg.solve(root, np.eye(each))
    leak, mean = line_spectra(period, lines), recorded - period @ found
    # No load stands for further multiples: no line keeps them.
    kept = np.where(abs(lines - turns)[:, None] * count < APART, leak[:, :2], 0.0)
    leak[:, :2] -= kept
    brought = (np.abs(leak @ inverse) ** 2).sum(axis=1)
    own = float((inverse[:2] ** 2).sum()) / 4
    noise, taken = list[Complexes](), np.zeros(len(lines))
    for periods, phi in parts():
        columns = waves(phi, orders)
        cleared = periods - columns @ found
        add(cleared)
        if count < LEAST:  # all at its frequency is taken: a line further on tells the noise
            phi = phi - phi[:, :1] + 2 * np.pi * np.arange(size) / size
        noise.append((np.exp(-1j * phi)[:, None] @ (cleared - mean))[:, 0] / size)
        beside = line_spectra(columns - period, lines) @ inverse
        taken += (np.abs(beside) ** 2).sum(axis=(0, 2)) / count
    width = float(np.sqrt(own * (count - 1) / (count - 1 - (count >= LEAST))))
    widths = np.sqrt((1 + brought) * (count - 1) / np.maximum(count - 1 - taken, ROUNDING))
    line = (found[0] - 1j * found[1]) / 2
    return Turning(line, kept, np.concatenate(noise), width, widths)


def slip(found: Turning, time: Floats, angle: Floats) -> tuple[float, float]:
    """Return by how many rad/s a rotation is faster than its angle, and the deviation of that.

    Its noise has a slope, less what the mean period and the line took of it; `time` and `angle`:
    where each period begins.
    """
    line, noise = found.line, found.noise
    basis, _ = np.linalg.qr(np.column_stack([np.ones(len(time)), np.exp(-1j * angle)]))
    column = time - time.mean() + 0j
    column -= basis @ (basis.conj().T @ column)
    size = np.maximum((np.abs(noise) ** 2).mean(axis=0), (ROUNDING * np.abs(line)) ** 2)
    weight = np.where(size > 0, 1 / np.where(size > 0, size, 1.0), 0.0)
    power = float((np.abs(column) ** 2).sum() * (weight @ np.abs(line) ** 2))
    if not power:
        return 0.0, np.inf
    along = (1j * column)[:, None] * line
    rate = float(((along.conj() * noise).real @ weight).sum()) / power
    each = (along.conj() * (noise - rate * along)).real @ weight
    std = max(float(np.linalg.norm(each)) / power, (2 * power) ** -0.5)
    taken = 3  # the mean period, the line and the slope hold noise of one period each
    return rate, std * float(np.sqrt(len(noise) / (len(noise) - taken)))


def also_kept(found: Turning) -> Complexes:
    """Return what the lines of the periods keep of a rotation, (line, channel)."""
    return found.kept @ [2 * found.line.real, -2 * found.line.imag]


def plausible_slip(speed: float, off: float, std: float) -> float:
    """Return by how much a stated speed errs (root mean square), where the lines show `off`."""
    size = STATED * abs(speed)
    trust = 1 / np.hypot(1, std / size)  # 0 where the lines tell nothing
    return float(np.hypot(trust**2 * off, size * np.sqrt(1 - trust**2)))
