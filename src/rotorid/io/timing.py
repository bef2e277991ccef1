"""The clock of a record: what is said of its sample rate, weighed; its samples on a grid."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.errors import InputError, ReadError
from rotorid.io.clock import BEARABLE, SAME_RATE, onto_grid, read_clock
from rotorid.io.table import Column, Rate
from rotorid.record import Booleans, Floats


@dataclass(frozen=True)
class RecordClock:
    """The sample rate of a record, and its stamps in s where they are not equidistant."""

    rate: float
    stamps: Floats | None = None
    jitter: float = 0.0
    warnings: tuple[str, ...] = ()

    def end(self, count: int, until: float | None) -> int:
        """Return the number of samples before `until`, in s."""
        if until is None:
            return count
        if self.stamps is not None:
            return int(np.searchsorted(self.stamps - self.stamps[0], until, side="left"))
        return min(count, max(0, math.ceil(until * self.rate - 1e-6)))


def weigh_clock(
    given: float | None,
    stamps: Floats | None,
    columns: Iterable[Column],
    overrule: bool,
    fundamental: float | None,
) -> RecordClock:
    """Weigh what is said of the sample rate here, by the stamps, and by the file."""
    stated = _stated_rate([column.rate for column in columns if column.rate is not None])
    if stamps is not None:
        told = read_clock(stamps)
        found = told.rate
        if given is not None:
            _check_rate(given, found, "the time column", "remove the wrong one")
        rate = given or _whole_multiple(found, fundamental, exactly=told.even)
        return RecordClock(rate, None if told.even else stamps, told.jitter)
    if given is not None:
        if stated is not None and not overrule:
            _check_rate(
                given,
                stated,
                "the file",
                "leave sample_rate out, or give overrule = true if the file is wrong",
            )
        return RecordClock(given)
    if stated is None:
        raise InputError(
            "no sample rate and no time column, nor does the file state a rate",
            "one of sample_rate and time",
            "give one",
        )
    return RecordClock(_whole_multiple(stated, fundamental, exactly=True))


def _stated_rate(rates: Sequence[Rate]) -> Rate | None:
    """Return the rate that the file states for its columns, which is one."""
    if not rates:
        return None
    for rate in rates:
        if abs(rate.hertz / rates[0].hertz - 1) > SAME_RATE + rate.rounding + rates[0].rounding:
            raise ReadError(
                f"columns sampled at {rates[0].hertz:.9g} Hz and at {rate.hertz:.9g} Hz",
                "columns of one rate",
                "put them into records of their own, or write one rate",
                place="sample_rate",
            )
    return rates[0]


def _check_rate(given: float, found: Rate, teller: str, cure: str) -> None:
    if abs(given / found.hertz - 1) > SAME_RATE + found.rounding:
        ratio = found.hertz / given
        unit = ""
        for factor, name in ((1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"), (1 / 60, "min")):
            if teller == "the time column" and abs(ratio / factor - 1) < 0.01:
                unit = f'; if its times are in {name}: time = {{ column = .., unit = "{name}" }}'
        raise InputError(
            f"{given:.9g} Hz, where {teller} says {found.hertz:.9g} Hz",
            "one sample rate",
            cure + unit,
            place="sample_rate",
        )


def _whole_multiple(rate: Rate, fundamental: float | None, *, exactly: bool) -> float:
    """Return the whole multiple of the fundamental that the digits of a rate allow, or the rate.

    Samples that go onto a grid anyway go onto one that fits the period (not `exactly`).
    """
    if fundamental is None or not 0 < fundamental < rate.hertz:
        return rate.hertz
    whole = round(rate.hertz / fundamental) * fundamental
    near = abs(rate.hertz / whole - 1) <= rate.rounding
    return whole if near or not exactly else rate.hertz


def on_grid(
    clock: RecordClock, samples: Floats, valid: Booleans | None, end: int, highest: float | None
) -> tuple[Floats, Booleans | None, str]:
    """Put samples at uneven times onto a uniform grid; refuse where the lines cannot bear it."""
    stamps = clock.stamps[:end] if clock.stamps is not None else np.zeros(0)
    used = samples
    if valid is not None:  # what is left out may be no number, and must not spoil its neighbours
        used = np.column_stack([np.where(valid[:, None], samples, 0.0), valid])
    found, error, frequency = onto_grid(stamps, used, clock.rate, highest)
    if error > BEARABLE:
        worst = int(np.argmax(np.abs(np.diff(stamps) * clock.rate - 1)))
        raise ReadError(
            f"times off by {clock.jitter:.3g} s (rms), most after sample {worst} "
            f"(t = {stamps[worst]:.9g} s), which leave an error of {100 * error:.2g} % at "
            f"{frequency:.6g} Hz",
            f"at most {100 * BEARABLE:g} % on the highest line",
            "keep lines of lower frequency, cut the record there, or give sample_rate in place of "
            "time if the samples are equidistant and only their stamps are not",
            place="time",
        )
    told = (
        f"the sample times jitter by {clock.jitter:.2g} s (rms): samples interpolated to "
        f"{clock.rate:.9g} Hz, with an error of {100 * error:.1g} % at {frequency:.4g} Hz; if only "
        "the stamps jitter, give sample_rate in place of time"
    )
    if valid is None:
        return found, None, told
    return found[:, :-1], found[:, -1] > 0.999, told
