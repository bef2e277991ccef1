"""Tables of 1x phasors and of frequency responses to lines (docs/maximum-likelihood.md).

The signal is ``Re(X exp(i phi))``, a row a line at ``|Omega|``; where the rotor turns backward, phi
runs backward too, and the line is the conjugate of the phasor.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError, naming
from rotorid.core.notes import Note
from rotorid.core.units import MAGNITUDE, quantity
from rotorid.core.values import Booleans, Complexes, Floats, Integers
from rotorid.data.lines import Analyser, Lines, PhasorClock, SilentClock, Window
from rotorid.data.record import Channel
from rotorid.signals.covariance import KNOWN, Kind, LineCovariance
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

PHASOR_STD = "state how far the readings scatter: the last digit of the instrument at least"
RESPONSE_STD = "state how far real and imaginary part scatter from one average to the next"


TWO_OF_A_LINE = 2  # readings that a mean and a slope over the speed take
UNEVEN = 1e-6  # chance below which readings of one speed follow it


def phasor_lines(
    channels: Sequence[Channel],
    speed: ArrayLike,
    phasors: ArrayLike,
    std: ArrayLike | None = None,
    *,
    same_speed: float = 0.0,
    source: str = "",
    checks: Sequence[Note] = (),
) -> Lines:
    """Return the lines of a table of 1x phasors, a row per speed.

    Noise is told by `std`, or by repeated readings at the same speed, or at speeds within
    `same_speed` in rad/s of the lowest of them: these are averaged, and their
    scatter, pooled over all speeds with the cross terms between channels kept, is the covariance of
    each reading. Where it grows with the amplitude, its variance is ``a + b |X|^2``.

    Speeds in rad/s, (row,), negative backward; phasors in SI, amplitudes not peak to peak, (row,
    channel); `std` of the amplitude, which is that of the real and of the imaginary part, broadcast
    to them. Inputs that are missing are taken as zero: the machine runs in passive bearings.
    """
    turning = np.asarray(speed, dtype=np.float64)
    given = np.asarray(phasors, dtype=np.complex128)
    with naming(source):
        still = "a speed other than 0"
        named, stands = ("phasor", "speed", "channel"), turning == 0
        _refuse_rows(named, given, turning, len(channels), stands, still)
        known = None if std is None else _deviations(std, given, PHASOR_STD)
        order = np.argsort(turning, kind="stable")
        as_lines: Complexes = given / 2
        as_lines = np.asarray(np.where(turning[:, None] < 0, as_lines.conj(), as_lines))
        rows, told = _without_doubles(turning[order], as_lines[order])
        turning, recorded = turning[order[rows]], as_lines[order[rows]]
        groups = _groups(turning, same_speed)
        count = np.bincount(groups)
        mean = np.zeros((len(count), recorded.shape[1]), dtype=np.complex128)
        np.add.at(mean, groups, recorded)
        scatter = recorded - (mean / count[:, None])[groups]
        if known is None:
            _check_even(scatter, turning, groups)
            first = np.flatnonzero(np.diff(groups, prepend=-1))
            turning, recorded = np.bincount(groups, turning) / count, (recorded - scatter)[first]
            covariance, said = _repeated(scatter, groups, recorded, channels)
        else:
            stated = known[order[rows]]
            covariance = _diagonal(stated**2 / 2, KNOWN, "stated")
            said = _doubted(scatter, groups, stated)
    notes = {"warnings": told + said, "checks": tuple(checks)}
    return lines_at_speeds(channels, turning, recorded, covariance, 1.0, source=source, **notes)


def lines_at_speeds(
    channels: Sequence[Channel],
    speed: Floats,
    lines: Complexes,
    covariance: LineCovariance,
    sample_rate: float,
    **told: Any,
) -> Lines:
    """Return 1x lines as recorded, a speed each, corrected for hold, delay and dynamics."""
    hertz, turning = np.abs(speed) / (2 * np.pi), {"speed": speed, "clock": PhasorClock(speed)}
    return _corrected(channels, hertz, lines, covariance, sample_rate, **turning, **told)


def _corrected(
    channels: Sequence[Channel],
    frequency: Floats,
    lines: Complexes,
    covariance: LineCovariance,
    sample_rate: float,
    **told: Any,
) -> Lines:
    transfer = transfer_of_recording(channels, frequency, sample_rate)
    return Lines(
        channels=tuple(channels),
        frequency=frequency,
        mean=np.asarray(lines * transfer, dtype=np.complex128),
        covariance=covariance.times(transfer),
        multiplicity=np.full(len(frequency), 2.0),
        passive=True,
        **told,
    )


def _diagonal(variance: Floats, dof: int, kind: Kind) -> LineCovariance:
    matrices = variance[:, :, None] * np.eye(variance.shape[1])
    return LineCovariance(matrices.astype(np.complex128), dof, kind)


def _refuse_rows(
    named: tuple[str, str, str],
    values: Complexes,
    rows: Floats,
    columns: int,
    wrong: Booleans,
    otherwise: str,
) -> None:
    """Refuse a table of another shape, and rows that are `wrong` or not finite."""
    what, row, column = named
    if rows.ndim != 1 or not values.size or values.shape != (len(rows), columns):
        found = f"{what}s of shape {values.shape} for rows of shape {rows.shape}"
        cure = f"give one {what} per {row} and {column}"
        raise InputError(found, f"a row per {row}, {columns or 'some'} {column}s", cure)
    possible = (np.abs(values) < MAGNITUDE).all(axis=1) & (np.abs(rows) < MAGNITUDE)
    bad = np.flatnonzero(~possible | wrong)
    if len(bad):
        found = f"a {row} of {rows[bad[0]]:g} in row {bad[0] + 1}, {what}s {values[bad[0]]}"
        cure = "correct that row, or leave it out"
        raise InputError(found, f"finite numbers below {MAGNITUDE:g}, {otherwise}", cure)


def _deviations(std: ArrayLike, values: Complexes, cure: str, row: bool = True) -> Floats:
    found = np.broadcast_to(np.asarray(std, dtype=np.float64), values.shape)
    wrong = np.argwhere(~((found > 1 / MAGNITUDE) & (found < MAGNITUDE)))
    if len(wrong):
        raise InputError(
            f"a deviation of {found[tuple(wrong[0])]:g}" + f" in row {wrong[0][0] + 1}" * row,
            f"more than 0, and less than {MAGNITUDE:g}",
            cure,
            place="std",
        )
    return found


def _groups(speed: Floats, same: float = 0.0) -> Integers:
    """Return the number of the reading of the speed, of rows that are sorted by it."""
    found, first = [0], float(speed[0])
    for each in speed[1:].tolist():
        apart = each - first > max(same, SAME_SPEED * abs(each))
        found.append(found[-1] + apart)
        first = each if apart else first
    return np.array(found)


def _check_even(scatter: Complexes, speed: Floats, groups: Integers) -> None:
    """Refuse readings that are no repeated ones: what follows the speed is more than scatter."""
    count = np.bincount(groups)
    off = speed - (np.bincount(groups, speed) / count)[groups]
    square = np.bincount(groups, off**2)
    told = (count > TWO_OF_A_LINE) & (square > 0)
    along = np.zeros((len(count), scatter.shape[1]), dtype=np.complex128)
    np.add.at(along, groups, off[:, None] * scatter)
    follows = (np.abs(along[told]) ** 2 / square[told, None]).sum(axis=0)
    whole = (np.abs(scatter[told[groups]]) ** 2).sum(axis=0)
    dof, left = int(told.sum()), int((count[told] - TWO_OF_A_LINE).sum())
    if not dof:
        return
    exact = np.where(whole > 0, np.inf, 0.0)  # where nothing else is left
    ratio = np.divide(follows / dof, (whole - follows) / left, where=whole > follows, out=exact)
    chance = float(scipy.special.fdtrc(2 * dof, 2 * left, ratio.max()))
    if chance * len(whole) < UNEVEN and (follows > whole - follows).any():
        raise InputError(
            f"readings that follow the speed within {np.abs(off).max() * 30 / np.pi:.3g} rpm of "
            "their mean more than they scatter",
            "repeated readings of one speed",
            "state a smaller same_speed, or std beside the unit of each channel",
            place="same_speed",
        )


def _without_doubles(speed: Floats, lines: Complexes) -> tuple[Integers, tuple[str, ...]]:
    """Return the rows that do not repeat one of the same speed to the last digit: typed twice."""
    table = np.column_stack([_groups(speed), lines.real, lines.imag])
    first = np.unique(table, axis=0, return_index=True)[1]
    kept = np.union1d(first, np.flatnonzero(~lines.any(axis=1)))
    left = len(speed) - len(kept)
    if not left:
        return kept, ()
    out = sorted({float(s) for s in np.delete(speed, kept)})
    where = ", ".join(f"{s * 30 / np.pi:.6g}" for s in out[:3]) + (" .." if len(out) > 3 else "")
    told = (
        f"{left} row{'s' * (left > 1)} at {where} rpm, the same as another to the last digit: left "
        "out, since a reading that is written twice is one reading"
    )
    return kept, (told,)


def _repeated(
    scatter: Complexes, groups: Integers, mean: Complexes, channels: Sequence[Channel]
) -> tuple[LineCovariance, tuple[str, ...]]:
    count = np.bincount(groups)
    dof = len(groups) - len(count)
    least = REPEATED * len(channels)
    if dof < least:
        raise InputError(
            "no std and no speed twice" if not dof else f"{dof} repeated readings and no std",
            f"a stated deviation, or {least} repeated readings for {len(channels)} channels",
            "write std beside the unit of each channel (how far its amplitude scatters, in its "
            "unit), or read more speeds twice or more",
            place="std",
        )
    shares = [_share(scatter[:, c], mean[:, c], groups) for c in range(len(channels))]
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
        for low, high in [np.sqrt(2 * reading[c, c].real) * np.sort(growth[:, c])[[0, -1]]]
    )
    return LineCovariance(matrices, dof, "repeated", shared=len(count)), told


def _share(scatter: Complexes, mean: Complexes, groups: Integers) -> float:
    """Return b / a of a variance ``a + b |X|^2``, by likelihood; 0 where a alone will do."""
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
    return float(grid[best]) if scipy.special.gammaincc(0.5, gain / 2) < CONSTANT else 0.0


def _doubted(scatter: Complexes, groups: Integers, std: Floats) -> tuple[str, ...]:
    dof = 2 * (len(groups) - groups[-1] - 1) * std.shape[1]
    squares = float((np.abs(2 * scatter) ** 2 / std**2).sum())
    if not dof or scipy.special.gammaincc(dof / 2, squares / 2) > CONTRADICTED:
        return ()
    return (
        f"readings at the same speed scatter {np.sqrt(squares / dof):.3g} times as much as their "
        "std says: state a larger std, or leave it out where enough speeds were read twice",
    )


POOLED = 20
"""Degrees of freedom to which lines are pooled: fewer give some of them three times the weight."""
FAINT = 0.01
"""A coherence below this says that the line holds noise: its own deviation would be noise too."""
SAME = 0.05
"""Share of the noise within which two responses are one: on eight lines chance is 1e-20."""
LEAST_SAME = 8
"""Lines, fewer of which may agree by chance."""
EVEN = 0.05
"""Share of a step by which even steps differ: the digits of a table. Those of a sweep grow."""


def response_lines(
    driven: Channel,
    sensors: Sequence[Channel],
    frequency: ArrayLike,
    responses: ArrayLike,
    *,
    std: ArrayLike | None = None,
    coherence: ArrayLike | None = None,
    averages: int | None = None,
    speed: float | str = 0.0,
    window: Window | None = None,
    spacing: float | None = None,
    source: str = "",
) -> Lines:
    """Return the lines of frequency responses to one input.

    The input is 1 on every line, exactly, and all others are 0; sensors read column j of H, with
    noise that is independent from sensor to sensor and from line to line. Neighbouring lines are
    not independent where a window was used: take every second line then.

    Parameters
    ----------
    driven : Channel
        The input; others are zero.
    sensors : sequence of Channel
    frequency : array, shape (line,)
        Hz. A line at 0 Hz is left out.
    responses : complex array, shape (line, sensor)
        Reading per input, in SI, with ``exp(+i omega t)``.
    std : array, optional
        Deviation of real and of imaginary part; shape (line, sensor), or what broadcasts to it.
    coherence : array, shape (line, sensor), optional
        In place of `std`, with `averages`.
    averages : int, optional
        Averages of the responses, independent ones.
    speed : float or str
        Of the rotor, in rad/s.
    window : {"rectangular", "hann", "none"}, optional
        Of the analyser; "none" where each of its blocks holds a response from rest to rest (burst,
        impact), or where sines were stepped. Without it the worst is assumed.
    spacing : float, optional
        Hz from line to line of the analyser, of which some may be left out here; found from
        `frequency`.
    source : str
        For messages.

    Returns
    -------
    Lines

    Raises
    ------
    InputError
        For shapes that do not fit, numbers that are not finite, deviations that are not positive,
        coherence outside 0 to 1, responses that nothing tells the noise of, and two sensors that
        hold one response: its derivatives and multiples are no measurements of their own.

    Examples
    --------
    >>> force, motion = Channel("F_x", "N"), Channel("x", "m")
    >>> lines = response_lines(force, [motion], [10.0, 20.0], [[1e-6], [3e-6j]], std=1e-9)
    >>> lines.names, lines.mean[1]
    (('F_x', 'x'), array([1.+0.e+00j, 0.+3.e-06j]))
    """
    hertz = np.asarray(frequency, dtype=np.float64)
    found = np.asarray(responses, dtype=np.complex128)
    with naming(source):
        positive = "no negative frequency"
        named, below = ("response", "frequency", "sensor"), hertz < 0
        _refuse_rows(named, found, hertz, len(sensors), below, positive)
        apart = np.diff(np.sort(hertz[hertz > 0]))
        if not len(apart) or not (apart > 0).all():
            raise InputError(
                "one frequency" if not len(apart) else "a frequency that stands there twice",
                "two lines or more, each once",
                "give every response its column, and every input a record or an input of its own",
                place="frequency",
            )
        order = np.argsort(hertz, kind="stable")
        order = order[hertz[order] > 0]
        told: tuple[str, ...] = ()
        dof: int = KNOWN
        kind: Kind = "stated"
        if std is not None:
            variance = 2 * _deviations(std, found, RESPONSE_STD, row=False)[order] ** 2
        else:
            with naming(place="coherence"):
                gamma = _checked_coherence(coherence, found)
                kept = order[(gamma[order] >= FAINT).all(axis=1)]
                told, order = _faint(len(order) - len(kept), len(kept)), kept
            variance, dof = _from_coherence(found[order], gamma[order], averages)
            kind = "coherence"
        _refuse_repeated(sensors, hertz[order], found[order], variance)
        if window not in (None, *get_args(Window)):
            known = f"one of {', '.join(get_args(Window))}"
            raise InputError(f"{window!r}", known, "leave it out for another one", place="window")
    step = line_spacing(hertz) if spacing is None else spacing
    made = Analyser(step, window, averages if std is None else None)
    one, exact = np.ones((len(order), 1)), np.zeros((len(order), 1))
    return _corrected(
        (driven, *sensors),
        hertz[order],
        np.hstack([one, found[order]]),
        _diagonal(np.hstack([exact, variance]), dof, kind),
        1.0,
        speed=np.full(len(order), quantity(speed, "rad/s", place="speed")),
        clock=SilentClock(len(order)),
        analyser=made,
        source=source,
        warnings=told,
    )


def line_spacing(hertz: Floats) -> float:
    """Return the even step of frequencies, some of which may be missing; 0 where there is none."""
    steps = np.diff(np.unique(hertz))
    if not len(steps):
        return 0.0
    count = np.round(steps / steps.min())
    step = float(steps.sum() / count.sum())
    return step if (np.abs(steps - count * step) <= EVEN * step).all() else 0.0


def _refuse_repeated(
    sensors: Sequence[Channel], hertz: Floats, responses: Complexes, variance: Floats
) -> None:
    for i, j in combinations(range(len(sensors)), 2):
        known = multiple_of(hertz, responses[:, [i, j]].T, variance[:, [i, j]].T)
        if known is not None:
            order, ratio = known
            raise InputError(
                f"one response in {sensors[i].name} and {sensors[j].name}, noise and all: "
                f"{ratio.real:.4g} times (i omega)^{order} of the first is the second",
                "responses that were measured apart",
                "keep the one that was measured, leave out what was computed from it; as "
                "measurements of their own they make deviations too small",
            )


def multiple_of(
    hertz: Floats, responses: Complexes, variance: Floats
) -> tuple[int, complex] | None:
    """Return n and c of one response ``c (i omega)^n`` times another, noise too; (2, line)."""
    kept = (np.abs(responses) > 0).all(axis=0)
    if kept.sum() < LEAST_SAME:
        return None
    omega, (one, other) = 2j * np.pi * hertz[kept], responses[:, kept]
    own = np.sqrt((variance[:, kept] / np.abs(responses[:, kept]) ** 2).sum(axis=0).mean())
    for order in range(-2, 3):
        ratio = other / (one * omega**order)
        if np.std(ratio) < SAME * own * abs(ratio.mean()):
            return order, complex(ratio.mean())
    return None


def _checked_coherence(coherence: ArrayLike | None, responses: Complexes) -> Floats:
    """Return the coherence, shape (line, sensor), no nearer to 1 than its digits say."""
    if coherence is None:
        cure = "write coherence beside each response, with averages; or std"
        raise InputError("neither std nor coherence", "what tells the noise of the responses", cure)
    found = np.asarray(coherence, dtype=np.float64)
    if found.shape != responses.shape:
        expected = "one for each line and response"
        cure = "give a coherence of the same lines"
        raise InputError(f"coherence of shape {found.shape}", expected, cure)
    wrong = found[~((found >= 0) & (found <= 1))]
    if wrong.size:
        cure = "divide percent by 100, or square it where the analyser gives its root"
        raise InputError(f"a coherence of {wrong[0]:g}", "numbers from 0 to 1", cure)
    if (found == 1).all():
        expected = "the coherence of several averages"
        cure = "take it from more than one average, or state std"
        raise InputError("a coherence of 1 on every line", expected, cure)
    # Half of the last digit that numbers are written with: one printed as 1.000 is not.
    written = (n for n in range(1, 13) if (np.abs(np.round(found, n) - found) < 1e-14).all())
    digits = next(written, None)
    return np.asarray(np.minimum(found, 1 - (1e-13 if digits is None else 0.5 * 10.0**-digits)))


def _faint(lost: int, left: int) -> tuple[str, ...]:
    if left < 2:
        raise InputError(
            f"a coherence below {FAINT:g} on {'every line' if not left else 'all lines but one'}",
            "lines on which the response stands out of the noise",
            "excite more, or take another column: this one says that there is no response",
        )
    if not lost:
        return ()
    lines = f"{lost} line" + ("s" if lost > 1 else "")
    return (f"{lines} with a coherence below {FAINT:g} left out: noise alone",)


def _from_coherence(
    responses: Complexes, coherence: Floats, averages: int | None
) -> tuple[Floats, int]:
    """Return variances, shape (line, sensor), and the degrees of freedom of each."""
    if averages is None or averages < 2:
        raise InputError(
            "no averages" if averages is None else f"averages = {averages}",
            "2 averages or more, of which the coherence is",
            "state them (of one average every coherence is 1), or give std",
            place="averages",
        )
    dof = int(averages) - 1
    single = np.abs(responses) ** 2 * (1 - coherence) / (coherence * dof)
    beside = min(int(np.ceil((POOLED / dof - 1) / 2)), (len(single) - 1) // 2)
    if beside < 1:
        return single, dof
    window = np.ones(2 * beside + 1)
    count = np.convolve(np.ones(len(single)), window, "same")
    pooled = [np.convolve(column, window, "same") / count for column in single.T]
    return np.column_stack(pooled), dof * (2 * beside + 1)
