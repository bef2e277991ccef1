"""What happens when: the clocks of controller and logger merged into one repeating pattern."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.values import Floats, Integers

MAX_EVENTS = 20_000
MAX_DELAY = 100
"""Steps of the controller: each is a state of the loop, whose stability is looked at; real ones
take one or two."""


class Schedule(NamedTuple):
    """One pattern of events, repeated for ever.

    The events of one instant happen in this order: the controller reads and computes; commands
    whose delay is over take effect; the logger records.
    """

    duration: float  # length of the pattern in s
    # (event,): time in s of each event in the pattern, and until the next one
    offset: Floats
    length: Floats
    # (event,): number within the pattern of the control step, of the command that takes effect and
    # of the logged sample; -1 where the event is none of the kind
    control: Integers
    apply: Integers
    log: Integers
    # control steps and logged samples of the pattern
    controls: int
    logs: int
    lag: int  # control steps after which a command takes effect; 0 where it does in the same one


def check(part: object, *, positive: tuple[str, ...] = (), zero: tuple[str, ...] = ()) -> None:
    """Refuse values that are not positive, or negative, where they must not be."""
    for name in (*positive, *zero):
        value, strict = getattr(part, name), name in positive
        if value is None or value > 0 or (value == 0 and not strict):
            continue
        raise InputError(
            f"{name} = {value}",
            "more than 0" if strict else "0 or more",
            f"give a {'positive ' if strict else ''}size, without a sign",
            place=name,
        )


def check_rate(rate: float, place: str) -> None:
    if not (np.isfinite(rate) and rate > 0):
        raise InputError(
            f"{rate} Hz",
            "more than 0 Hz",
            "give how often its clock ticks in a second",
            place=place,
        )


def merge_clocks(control_rate: float, sample_rate: float, delay: float) -> Schedule:
    """Merge the clocks of controller and logger; both tick at t = 0."""
    check_rate(control_rate, "rate")
    check_rate(sample_rate, "sample_rate")
    if not (np.isfinite(delay) and delay >= 0):
        raise InputError(
            f"{delay} s",
            "0 s or more",
            "give how long the controller computes, or leave it out",
            place="delay",
        )
    if delay * control_rate > MAX_DELAY:
        raise InputError(
            f"{delay:g} s",
            f"at most {MAX_DELAY} steps of the controller, {MAX_DELAY / control_rate:g} s",
            "give how long the controller computes: a step or two",
            place="delay",
        )
    ratio = Fraction(sample_rate / control_rate).limit_denominator(MAX_EVENTS)
    logs, controls = ratio.numerator, ratio.denominator
    close = abs(float(ratio) * control_rate / sample_rate - 1) < 1e-12
    if not close or logs + controls > MAX_EVENTS:
        raise InputError(
            f"a controller at {control_rate:.12g} Hz and samples at {sample_rate:.12g} Hz",
            f"a ratio of whole numbers, at most {MAX_EVENTS} together",
            "choose rates of a simpler ratio",
            place="sample_rate",
        )
    steps = Fraction(delay * control_rate).limit_denominator(10**6)
    control = {Fraction(k, controls): k for k in range(controls)}
    log = {Fraction(k, logs): k for k in range(logs)}
    whole, part = divmod(steps, 1)
    apply = {Fraction(k + part, controls): k for k in range(controls)}
    times = sorted({*control, *log, *apply})
    duration = controls / control_rate
    ends = [*times[1:], Fraction(1)]

    def numbers(events: dict[Fraction, int]) -> Integers:
        return np.array([events.get(t, -1) for t in times], dtype=np.int64)

    return Schedule(
        duration=duration,
        offset=np.array([float(t) * duration for t in times]),
        length=np.array([float(b - a) * duration for a, b in zip(times, ends, strict=True)]),
        control=numbers(control),
        apply=numbers(apply),
        log=numbers(log),
        controls=controls,
        logs=logs,
        lag=int(whole),
    )
