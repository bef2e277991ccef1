"""Tables of 1x phasors: a row per speed, each a line of its own.

The signal is ``Re(X exp(i phi))``, phi the rotor angle. A row is a line at ``omega = |Omega|``,
its model evaluated at its own speed; where the rotor turns backward, phi runs backward too, and
the line is the conjugate of the phasor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rotorid.distributions import gamma_tail
from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.limits import MAGNITUDE
from rotorid.lines import Lines, PhasorClock
from rotorid.record import Channel, Check, Complexes, Floats, Integers
from rotorid.signals.covariance import KNOWN, LineCovariance
from rotorid.signals.spectrum import transfer_of_recording

SAME_SPEED = 1e-9
"""Relative difference of speeds that are the same reading of an instrument: rounding of units."""
REPEATED = 5
"""Repeated readings per channel at least: with two, one record in hundreds is rejected falsely."""
CONTRADICTED = 1e-4
"""Chance of the scatter of repeated readings below which the stated deviations are doubted."""

CONSTANT = 1e-3
"""Chance of scatter that grows so with the amplitude below which it is no constant's."""
GROWING = (1e-2, 1e6, 65)
"""Shares of the square of the largest amplitude that are tried, over the constant, and how many:
steps of a third, which move deviations by less than they are known to."""


@frozen
class _Rows:
    """Rows of a table, sorted by speed: phasors as lines, and what is stated of their noise."""

    speed: Floats
    lines: Complexes
    std: Floats | None

    def part(self, rows: Integers) -> _Rows:
        """Return some of the rows."""
        return _Rows(
            self.speed[rows], self.lines[rows], None if self.std is None else self.std[rows]
        )

    @property
    def groups(self) -> Integers:
        """The number of the speed of each row, equal where speeds are."""
        apart = np.diff(self.speed) > SAME_SPEED * np.abs(self.speed[1:])
        return np.concatenate([[0], np.cumsum(apart)]).astype(np.int64)


def phasor_lines(
    channels: Sequence[Channel],
    speed: ArrayLike,
    phasors: ArrayLike,
    std: ArrayLike | None = None,
    *,
    source: str = "",
    checks: Sequence[Check] = (),
) -> Lines:
    """Return the lines of a table of 1x phasors, a row per speed.

    The signal of a channel is ``Re(X exp(i phi))``. Noise is told by `std`, or by repeated readings
    at the same speed: these are averaged, and their scatter, pooled over all speeds with the cross
    terms between channels kept, is the covariance of each reading. Where it grows with the
    amplitude, as a gain's does, its variance is a constant and a share of the amplitude's square.

    Parameters
    ----------
    channels : sequence of Channel
        Inputs that are missing are taken as zero: the machine runs in passive bearings.
    speed : array, shape (row,)
        rad/s; negative backward.
    phasors : complex array, shape (row, channel)
        X, amplitudes not peak to peak, in SI.
    std : array, optional
        Deviation of the amplitude, which is that of the real and of the imaginary part; shape
        (row, channel), or what broadcasts to it.
    source : str
        For messages.
    checks : sequence of Check
        What the table showed already.

    Returns
    -------
    Lines

    Raises
    ------
    InputError
        For shapes that do not fit, numbers that are not finite, a speed of 0, deviations that are
        not positive, and a table that nothing tells the noise of.

    Examples
    --------
    >>> table = phasor_lines([Channel("x", "m")], [100.0, 200.0], [[1e-6], [2e-6j]], 1e-8)
    >>> table.omega.round(), table.covariance.kind
    (array([100., 200.]), 'stated')
    """
    turning = np.asarray(speed, dtype=np.float64)
    given = np.asarray(phasors, dtype=np.complex128)
    _check(channels, turning, given, source)
    known = None if std is None else _deviations(std, given, source)
    order = np.argsort(turning, kind="stable")
    as_lines = np.array(np.where(turning[:, None] < 0, given.conj(), given) / 2, np.complex128)
    rows, told = _without_doubles(_Rows(turning, as_lines, known).part(order))
    if known is None:
        rows, covariance, said = _repeated(rows, channels, source)
        told += said
    else:
        covariance = _stated(rows)
        told += _doubted(rows)
    found = lines_at_speeds(channels, rows.speed, rows.lines, covariance, 1.0)
    return replace(found, source=source, warnings=told, checks=tuple(checks))


def lines_at_speeds(
    channels: Sequence[Channel],
    speed: Floats,
    lines: Complexes,
    covariance: LineCovariance,
    sample_rate: float,
) -> Lines:
    """Return 1x lines as recorded, a speed each, corrected for hold, delay and dynamics."""
    frequency = np.abs(speed) / (2 * np.pi)
    transfer = transfer_of_recording(channels, frequency, sample_rate)
    matrices = covariance.matrices * (transfer[:, :, None] * transfer[:, None, :].conj())
    return Lines(
        channels=tuple(channels),
        frequency=frequency,
        speed=speed,
        mean=lines * transfer,
        covariance=replace(covariance, matrices=matrices),
        multiplicity=np.full(len(frequency), 2.0),
        clock=PhasorClock(speed),
        passive=True,
    )


def _check(channels: Sequence[Channel], speed: Floats, phasors: Complexes, source: str) -> None:
    """Refuse rows that are no table of phasors."""
    shape = (len(speed), len(channels)) if speed.ndim == 1 else ()
    if not len(speed) or phasors.shape != shape:
        raise InputError(
            f"phasors of shape {phasors.shape} for speeds of shape {speed.shape}",
            f"a row per speed, {len(channels)} channels",
            "give one phasor per speed and channel",
            file=source,
        )
    within = (np.abs(phasors) < MAGNITUDE).all(axis=1) & (np.abs(speed) < MAGNITUDE)
    wrong = ~within | (speed == 0)
    if wrong.any():
        row = int(wrong.argmax())
        still = speed[row] == 0
        raise InputError(
            f"{'a speed of 0' if still else 'numbers that are not finite'} in row {row + 1}",
            f"finite numbers below {MAGNITUDE:g}, a speed other than 0",
            "give the row a speed and a reading, or leave it out",
            file=source,
        )


def _deviations(std: ArrayLike, phasors: Complexes, source: str) -> Floats:
    """Return the stated deviations, shape (row, channel)."""
    found = np.broadcast_to(np.asarray(std, dtype=np.float64), phasors.shape)
    possible = (found > 1 / MAGNITUDE) & (found < MAGNITUDE)
    if not possible.all():
        row, column = np.argwhere(~possible)[0]
        raise InputError(
            f"a deviation of {found[row, column]:g} in row {row + 1}",
            f"more than 0, and less than {MAGNITUDE:g}",
            "state how far the readings scatter: the last digit of the instrument at least",
            file=source,
            place="std",
        )
    return found


def _without_doubles(rows: _Rows) -> tuple[_Rows, tuple[str, ...]]:
    """Leave out rows that repeat one of the same speed to the last digit: typed twice."""
    groups, lines = rows.groups, rows.lines
    kept: list[int] = []
    for row, group in enumerate(groups):
        before = [k for k in kept if groups[k] == group]
        if not any((lines[k] == lines[row]).all() and lines[row].any() for k in before):
            kept.append(row)
    left = len(groups) - len(kept)
    if not left:
        return rows, ()
    out = sorted({float(s) for s in np.delete(rows.speed, kept)})
    where = ", ".join(f"{s * 30 / np.pi:.6g}" for s in out[:3]) + (" .." if len(out) > 3 else "")
    told = (
        f"{left} row{'s' * (left > 1)} at {where} rpm, the same as another to the last digit: left "
        "out, since a reading that is written twice is one reading"
    )
    return rows.part(np.array(kept, dtype=np.int64)), (told,)


def _stated(rows: _Rows) -> LineCovariance:
    """Return the covariance of stated deviations, of each part of a phasor X = 2 lines."""
    assert rows.std is not None
    variance = rows.std**2 / 2
    matrices = variance[:, :, None] * np.eye(variance.shape[1])
    return LineCovariance(matrices.astype(np.complex128), KNOWN, "stated")


def _scatter(rows: _Rows) -> tuple[Complexes, Integers]:
    """Return the readings less the mean of their speed, and the numbers of the speeds."""
    groups = rows.groups
    count = np.bincount(groups)
    mean = np.zeros((len(count), rows.lines.shape[1]), dtype=np.complex128)
    np.add.at(mean, groups, rows.lines)
    return rows.lines - (mean / count[:, None])[groups], groups


def _repeated(
    rows: _Rows, channels: Sequence[Channel], source: str
) -> tuple[_Rows, LineCovariance, tuple[str, ...]]:
    """Return a row per speed, with the covariance that repeated readings show, and what is said."""
    scatter, groups = _scatter(rows)
    count = np.bincount(groups)
    dof = len(groups) - len(count)
    least = REPEATED * rows.lines.shape[1]
    if dof < least:
        raise InputError(
            "no std and no speed twice" if not dof else f"{dof} repeated readings and no std",
            f"a stated deviation, or {least} repeated readings for {rows.lines.shape[1]} channels",
            "write std beside the unit of each channel (how far its amplitude scatters, in its "
            "unit), or read more speeds twice or more",
            file=source,
            place="std",
        )
    first = np.flatnonzero(np.diff(groups, prepend=-1))
    mean = (rows.lines - scatter)[first]
    shares = [_share(scatter[:, c], mean[:, c], groups) for c in range(mean.shape[1])]
    growth = np.sqrt(1 + np.array(shares) * np.abs(mean) ** 2)
    scatter = scatter / growth[groups]
    reading = np.einsum("ri,rj->ij", scatter, scatter.conj()) / dof
    matrices = reading * growth[:, :, None] * growth[:, None, :] / count[:, None, None]
    told = tuple(
        f"repeated readings of {channel.name} scatter by {low:.3g} {channel.unit} at the smallest "
        f"amplitude and by {high:.3g} {channel.unit} at the largest: their deviation was taken "
        "to grow with the amplitude"
        for c, channel in enumerate(channels)
        if shares[c] > 0
        for low, high in [2 * np.sqrt(reading[c, c].real / 2) * _ends(growth[:, c])]
    )
    covariance = LineCovariance(matrices, dof, "repeated", shared=len(count))
    return _Rows(rows.speed[first], mean, None), covariance, told


def _ends(values: Floats) -> Floats:
    return np.array([values.min(), values.max()])


def _share(scatter: Complexes, mean: Complexes, groups: Integers) -> float:
    """Return b / a of a variance ``a + b |X|^2`` of readings; 0 where a alone will do.

    By likelihood: the scatter of n readings of one speed is a sum of 2 (n - 1) squares.
    """
    count, power = np.bincount(groups), np.bincount(groups, np.abs(scatter) ** 2)
    weight, size = count - 1.0, np.abs(mean) ** 2
    used = weight > 0
    weight, power, size = weight[used], power[used], size[used]
    if not power.any() or not size.any():
        return 0.0

    def cost(share: float) -> float:
        growth = 1 + share * size
        level = (power / growth).sum() / weight.sum()
        return float((weight * np.log(level * growth)).sum())

    grid = np.geomspace(GROWING[0], GROWING[1], GROWING[2]) / size.max()
    costs = [cost(share) for share in grid]
    best = int(np.argmin(costs))
    gain = 2 * (cost(0.0) - costs[best])
    return float(grid[best]) if gamma_tail(gain / 2, 0.5) < CONSTANT else 0.0


def _doubted(rows: _Rows) -> tuple[str, ...]:
    """Say where repeated readings scatter otherwise than their deviations state."""
    assert rows.std is not None
    scatter, groups = _scatter(rows)
    dof = 2 * (len(groups) - groups[-1] - 1) * rows.lines.shape[1]
    squares = float((np.abs(2 * scatter) ** 2 / rows.std**2).sum())
    if not dof or gamma_tail(squares / 2, dof / 2) > CONTRADICTED:
        return ()
    return (
        f"readings at the same speed scatter {np.sqrt(squares / dof):.3g} times as much as their "
        "std says: state a larger std, or leave it out where enough speeds were read twice",
    )
