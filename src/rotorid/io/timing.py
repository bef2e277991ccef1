"""The clock of a record: what is said of its sample rate, weighed; its samples on a grid."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from rotorid.errors import InputError, ReadError
from rotorid.frozen import frozen
from rotorid.io.clock import (
    BEARABLE,
    NEGLIGIBLE,
    SAME_RATE,
    error_as_they_are,
    onto_grid,
    read_clock,
)
from rotorid.io.table import Column, Rate
from rotorid.record import Booleans, Floats

TOGETHER = 0.01
"""Samples by which columns may begin apart: clocks are written to a microsecond."""
BESIDE = 0.5
"""Samples up to which no sample stands beside the wrong one."""


@frozen
class RecordClock:
    """The sample rate of a record, the samples that count, and their stamps where these jitter."""

    rate: float
    stamps: Floats | None = None
    jitter: float = 0.0
    warnings: tuple[str, ...] = ()

    begin: int = 0
    end: int | None = None
    start: float = 0.0

    def cut(
        self, samples: Floats, valid: Booleans | None, skip: float
    ) -> tuple[RecordClock, Floats, Booleans | None]:
        """Leave out what follows the end, and what precedes `skip` where it holds defects."""
        samples = samples[self.begin : self.end]
        valid = None if valid is None else valid[self.begin : self.end]
        if self.stamps is None:
            first = math.ceil((skip - self.start) * self.rate - 1e-6)
        else:
            first = _first_at(self.stamps, skip - self.start)
        if first <= 0 or np.isfinite(samples[:first]).all():
            return self, samples, valid
        stamps = None if self.stamps is None else self.stamps[first:]
        passed = first / self.rate if stamps is None or not len(stamps) else stamps[0]
        if stamps is not None and self.stamps is not None:
            passed -= self.stamps[0]
        clock = replace(self, stamps=stamps, start=self.start + float(passed))
        return clock, samples[first:], None if valid is None else valid[first:]


def _first_at(stamps: Floats, time: float) -> int:
    """Return the number of samples before a time, counted from the first stamp."""
    later = np.flatnonzero(stamps - stamps[:1] >= time - 1e-9)
    return int(later[0]) if len(later) else len(stamps)


def weigh_clock(
    given: float | None,
    stamps: Floats | None,
    columns: Iterable[Column],
    overrule: bool,
    fundamental: float | None,
    limits: tuple[float, float | None],
) -> RecordClock:
    """Weigh what is said of the sample rate here, by the stamps, and by the file."""
    several = list(columns)
    stated = _stated_rate([column.rate for column in several if column.rate is not None])
    clock = _weighed(given, stamps, stated, overrule, fundamental, limits)
    starts = [column.start for column in several if column.start is not None]
    told = () if overrule else _check_starts(starts, clock.rate)
    return replace(clock, warnings=(*clock.warnings, *told))


def _weighed(
    given: float | None,
    stamps: Floats | None,
    stated: Rate | None,
    overrule: bool,
    fundamental: float | None,
    limits: tuple[float, float | None],
) -> RecordClock:
    """Return the clock by one of the three, held against the others."""
    if stamps is not None:
        begin, end = _stretch(stamps, *limits)
        used = stamps[begin:end]
        told = read_clock(used)
        found = told.rate
        if given is not None:
            _check_rate(given, found, "the time column", "remove the wrong one")
        rate = given or _whole_multiple(found, fundamental, exactly=told.even)
        start = float(used[0] - stamps[0])
        uneven = None if told.even else used
        return RecordClock(rate, uneven, told.jitter, begin=begin, end=end, start=start)
    until = limits[1]

    def ending(rate: float) -> int | None:
        return None if until is None else max(0, math.ceil(until * rate - 1e-6))

    if given is not None:
        if stated is not None and not overrule:
            _check_rate(
                given,
                stated,
                "the file",
                "leave sample_rate out, or give overrule = true if the file is wrong",
            )
        return RecordClock(given, end=ending(given))
    if stated is None:
        raise InputError(
            "no sample rate and no time column, nor does the file state a rate",
            "one of sample_rate and time",
            "give one",
        )
    rate = _whole_multiple(stated, fundamental, exactly=True)
    return RecordClock(rate, end=ending(rate))


def _stretch(stamps: Floats, skip: float, until: float | None) -> tuple[int, int]:
    """Return the samples whose times count: up to the end, from `skip` if there is a gap before."""
    end = len(stamps) if until is None else _first_at(stamps, until)
    first = _first_at(stamps, skip) if skip > 0 else 0
    if 0 < first < end:
        try:
            read_clock(stamps[: first + 1])
        except ReadError:
            return first, end
    return 0, end


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


def _check_starts(starts: Sequence[float], rate: float) -> tuple[str, ...]:
    """Refuse columns that begin at other times: their samples would stand side by side wrongly."""
    apart = max(starts, default=0.0) - min(starts, default=0.0)
    if abs(apart) * rate <= TOGETHER:
        return ()
    if abs(apart) * rate <= BESIDE:
        return (
            f"columns that begin {apart:.3g} s apart, as the file has it: taken as one time; the "
            "later ones have a delay of minus that",
        )
    raise ReadError(
        f"columns that begin {apart:.6g} s apart, as the file has it",
        "columns of one clock that begin together",
        "export the stretch that they share, or give overrule = true if the file is wrong",
        place="time",
    )


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
    clock: RecordClock, samples: Floats, valid: Booleans | None, highest: float | None
) -> tuple[Floats, Booleans | None, tuple[str, ...]]:
    """Put samples at uneven times onto a uniform grid; refuse where the lines cannot bear it.

    Samples that are so near to it that the highest line does not tell are taken as they are.
    """
    stamps = np.zeros(0) if clock.stamps is None else clock.stamps
    if highest is not None and error_as_they_are(stamps, clock.rate, highest) <= NEGLIGIBLE:
        return samples, valid, ()
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
        return found, None, (told,)
    return found[:, :-1], found[:, -1] > 0.999, (told,)
