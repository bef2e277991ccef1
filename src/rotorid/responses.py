"""Frequency responses of a modal test: lines on which one input is 1 and the others are 0.

The deviation of an estimate ``H`` from `averages` averages with the coherence gamma^2 is, of its
real and of its imaginary part, ``|H| sqrt((1 - gamma^2) / (2 gamma^2 averages))`` (Bendat and
Piersol, Random Data); of the complex number it is the root of two times as much. With
`averages - 1` in place of `averages` the square has no bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from rotorid.errors import InputError
from rotorid.limits import MAGNITUDE
from rotorid.lines import Lines, SilentClock
from rotorid.record import Channel, Complexes, Floats
from rotorid.signals.covariance import KNOWN, Kind, LineCovariance
from rotorid.signals.spectrum import transfer_of_recording
from rotorid.units import quantity

POOLED = 20
"""Degrees of freedom to which deviations from coherence are pooled over neighbouring lines: with
fewer, single lines get weights of three times what they deserve by chance."""
FAINT = 0.01
"""A coherence below this says that the line holds noise: its own deviation would be noise too."""

SAME = 0.05
"""Share of the stated noise within which two responses are one: noise of their own agrees so well
on eight lines by a chance of 1e-20."""
LEAST_SAME = 8
"""Lines, fewer of which may agree by chance."""


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
    _check(hertz, found, len(sensors), source)
    order = np.argsort(hertz, kind="stable")
    order = order[hertz[order] > 0]
    told: tuple[str, ...] = ()
    kind: Kind
    if std is not None:
        variance = 2 * _checked_std(std, found, source)[order] ** 2
        dof, kind = KNOWN, "stated"
    else:
        gamma = _checked_coherence(coherence, found, source)
        kept = order[(gamma[order] >= FAINT).all(axis=1)]
        told, order = _faint(len(order) - len(kept), source, len(kept)), kept
        variance, dof = _from_coherence(found[order], gamma[order], _count(averages, source))
        kind = "coherence"
    _refuse_repeated(sensors, hertz[order], found[order], variance, source)
    channels = (driven, *sensors)
    transfer = transfer_of_recording(channels, hertz[order], 1.0)
    mean = np.column_stack([np.ones(len(order)), found[order]]) * transfer
    noise = np.column_stack([np.zeros(len(order)), variance]) * np.abs(transfer) ** 2
    matrices = (noise[:, :, None] * np.eye(len(channels))).astype(np.complex128)
    return Lines(
        channels=channels,
        frequency=hertz[order],
        speed=np.full(len(order), quantity(speed, "rad/s", place="speed")),
        mean=np.asarray(mean, dtype=np.complex128),
        covariance=LineCovariance(matrices, dof, kind),
        multiplicity=np.full(len(order), 2.0),
        clock=SilentClock(len(order)),
        source=source,
        warnings=told,
        passive=True,
    )


def _check(hertz: Floats, responses: Complexes, sensors: int, source: str) -> None:
    """Refuse numbers that are no responses."""
    if hertz.ndim != 1 or responses.shape != (len(hertz), sensors) or not sensors:
        raise InputError(
            f"responses of shape {responses.shape} for frequencies of shape {hertz.shape}",
            f"a row per frequency, {sensors or 'some'} sensors",
            "give one response per frequency and sensor",
            file=source,
        )
    within = (np.abs(responses) < MAGNITUDE).all(axis=1) & (hertz < MAGNITUDE)
    wrong = ~within | (hertz < 0)
    if wrong.any():
        row = int(wrong.argmax())
        raise InputError(
            f"line {row + 1}: {hertz[row]:g} Hz, response {responses[row]}",
            f"finite numbers below {MAGNITUDE:g}, no negative frequency",
            "leave that line out, or export the responses again",
            file=source,
        )
    apart = np.diff(np.sort(hertz[hertz > 0]))
    if not len(apart) or not (apart > 0).all():
        raise InputError(
            "one frequency" if not len(apart) else "a frequency that stands there twice",
            "two lines or more, each once",
            "give every response its column, and every input a record or an input of its own",
            file=source,
            place="frequency",
        )


def _refuse_repeated(
    sensors: Sequence[Channel], hertz: Floats, responses: Complexes, variance: Floats, source: str
) -> None:
    """Refuse a response that is another one, differentiated or times a number, noise and all."""
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
                file=source,
            )


def multiple_of(
    hertz: Floats, responses: Complexes, variance: Floats
) -> tuple[int, complex] | None:
    """Return n and c where one response is ``c (i omega)^n`` times another, noise and all.

    `responses` and `variance` have the shape (2, line).
    """
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


def _checked_std(std: ArrayLike, responses: Complexes, source: str) -> Floats:
    """Return deviations, shape (line, sensor)."""
    found = np.broadcast_to(np.asarray(std, dtype=np.float64), responses.shape)
    wrong = ~((found > 1 / MAGNITUDE) & (found < MAGNITUDE))
    if wrong.any():
        raise InputError(
            f"a deviation of {found[wrong][0]:g}",
            f"more than 0, and less than {MAGNITUDE:g}",
            "state how far real and imaginary part scatter from one average to the next",
            file=source,
            place="std",
        )
    return np.asarray(found)


def _checked_coherence(coherence: ArrayLike | None, responses: Complexes, source: str) -> Floats:
    """Return the coherence, shape (line, sensor), no nearer to 1 than its digits say."""
    if coherence is None:
        raise InputError(
            "neither std nor coherence",
            "what tells the noise of the responses",
            "write coherence beside each response, with averages; or std",
            file=source,
            place="coherence",
        )
    found = np.asarray(coherence, dtype=np.float64)
    if found.shape != responses.shape or not np.isfinite(found).all():
        raise InputError(
            f"coherence of shape {found.shape}"
            if found.shape != responses.shape
            else "a coherence that is no number",
            "one for each line and response",
            "give a coherence of the same lines",
            file=source,
            place="coherence",
        )
    if (found < 0).any() or (found > 1).any():
        raise InputError(
            f"a coherence of {found.max() if (found > 1).any() else found.min():g}",
            "numbers from 0 to 1",
            "divide percent by 100, or square it where the analyser gives its root",
            file=source,
            place="coherence",
        )
    if (found == 1).all():
        raise InputError(
            "a coherence of 1 on every line",
            "the coherence of several averages",
            "take it from more than one average, or state std",
            file=source,
            place="coherence",
        )
    return np.asarray(np.minimum(found, 1 - _half_digit(found)))


def _half_digit(numbers: Floats) -> float:
    """Return half of the last digit that numbers are written with: one printed as 1.000 is not."""
    for digits in range(1, 13):
        if (np.abs(np.round(numbers, digits) - numbers) < 1e-14).all():
            return float(0.5 * 10.0**-digits)
    return 1e-13


def _count(averages: int | None, source: str) -> int:
    """Return the number of averages, two at the least."""
    if averages is None or averages < 2:
        raise InputError(
            "no averages" if averages is None else f"averages = {averages}",
            "2 averages or more, of which the coherence is",
            "state them (of one average every coherence is 1), or give std",
            file=source,
            place="averages",
        )
    return int(averages)


def _faint(lost: int, source: str, left: int) -> tuple[str, ...]:
    """Say how many lines hold nothing but noise."""
    if left < 2:
        raise InputError(
            f"a coherence below {FAINT:g} on {'every line' if not left else 'all lines but one'}",
            "lines on which the response stands out of the noise",
            "excite more, or take another column: this one says that there is no response",
            file=source,
            place="coherence",
        )
    if not lost:
        return ()
    lines = f"{lost} line" + ("s" if lost > 1 else "")
    return (f"{lines} with a coherence below {FAINT:g} left out: noise alone",)


def _from_coherence(responses: Complexes, coherence: Floats, averages: int) -> tuple[Floats, int]:
    """Return variances, shape (line, sensor), and the degrees of freedom of each."""
    dof = averages - 1
    single = np.abs(responses) ** 2 * (1 - coherence) / (coherence * dof)
    beside = min(int(np.ceil((POOLED / dof - 1) / 2)), (len(single) - 1) // 2)
    if beside < 1:
        return single, dof
    window = np.ones(2 * beside + 1)
    count = np.convolve(np.ones(len(single)), window, "same")
    pooled = [np.convolve(column, window, "same") / count for column in single.T]
    return np.column_stack(pooled), dof * (2 * beside + 1)
