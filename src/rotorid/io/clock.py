"""Sample times, stated rates and the file's rate held against each other."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import permutations
from typing import TypeVar

import numpy as np

from rotorid.core.errors import InputError, ReadError
from rotorid.core.units import converts, si_factor
from rotorid.core.values import Booleans, Complexes, Floats, frozen
from rotorid.io.table import Column, Rate

LATE, EARLY = 1.75, 0.25
"""Median steps from which on a sample is missing, or too many: halfway from 1.5, late, to 2."""
SAME_RATE = 1e-4
"""Difference of two rates that does not matter: a mass moves by .02 %, less than any deviation."""
BEARABLE = 1e-3
"""Error of the interpolation, relative to a line, up to which samples are put on a grid."""
NEGLIGIBLE = 1e-4
"""Error of a line, relative, that times off their grid may leave without being put right: below the
noise of the highest line that is asked for, or of that at half the sample rate."""
_ROUNDED = 0.6  # of the last digit of the stamps: half a digit, and what a line fitted to them adds
_TAPS = 12  # of the interpolation: 1e-4 at a quarter of the sample rate, for a jitter of a tenth
_BLOCK = 1 << 16

_NAMED = re.compile(r"t|time\b.*|zeit|clock|timestamp|x_value|x_axis|abscissa", re.I)
_UNIT_IN_NAME = re.compile(
    r"(?:^|[/_ :])(?:t|time)(?:[\s_/]+|\s*(?=[\[(]))[\[(]?(?P<unit>[munµ]?s|min)[\])]?$", re.I
)
"""Sample times with the unit in their name: t/ms, time_ms, t [ms]."""
_NO_PATH = re.compile(r"\b([A-Za-z0-9])/([xyzXYZ])\b")  # plane and axis
UNITS = ("s", "ms", "us", "ns", "min", "h")
"""Units in which sample times are written."""
STRANGE = 3.0
"""Factor between the rate stated and that of a column without a unit, in whatever unit is nearest,
from which on it is none of times in such a unit: rates are misstated by two, by a half."""

Numbers = TypeVar("Numbers", Floats, Complexes)


def leaf(name: str) -> str:
    """Return the last part of a path; "Pos A/X" is none."""
    return _NO_PATH.sub(r"\1 \2", name).rsplit("/", 1)[-1]


def is_time(name: str, unit: str | None) -> bool:
    """Tell whether a column holds sample times by its name, where its unit does not contradict."""
    named = _UNIT_IN_NAME.search(name) or _NAMED.fullmatch(leaf(name))
    return named is not None and (not unit or converts(unit, "s"))


def unit_of_time(name: str, unit: str | None) -> str | None:
    """Return the unit of sample times: that of the column, or else that in its name."""
    named = _UNIT_IN_NAME.search(name)
    return unit or (named["unit"].lower() if named else None)


@frozen
class FileClock:
    rate: Rate
    even: bool  # the steps are equal but for the digits in which the times are written
    # in s, root mean square: of the deviation from equal steps, or of a step, if clocks wander
    jitter: float


def read_clock(time: Floats, first: float | None = None) -> FileClock:
    """Judge sample times in s; refuse those that stand still, run backward or miss samples.

    `first` is that of the file's first sample, from which a record's times count.
    """
    if len(time) < 2 or not np.all(np.isfinite(time)):
        raise ReadError(
            "sample times that are not finite" if len(time) > 1 else "a single sample",
            "equidistant sample times",
            "give sample_rate in place of the time column",
            place="time",
        )
    steps = np.diff(time)
    step = float(np.median(steps))
    wrong = np.flatnonzero(~((steps < LATE * step) & (steps > EARLY * step)))
    if wrong.size or step <= 0:
        raise _gap(time, step, wrong, time[0] if first is None else first)
    count = len(time)
    span = float(time[-1] - time[0])
    index = np.arange(count) - (count - 1) / 2
    centred = time - time.mean()
    slope = float(index @ centred / (index @ index))
    deviation = centred - slope * index
    resolution = _resolution(time)
    furthest = float(np.abs(deviation).max())
    even = furthest <= max(NEGLIGIBLE * slope / np.pi, _spacing(time)) or (
        resolution <= slope / 2 and furthest <= _ROUNDED * resolution
    )
    rate = Rate((count - 1) / span, max(resolution, 2 * furthest) / span)  # both ends may be off
    jitter = min(np.sqrt(np.mean(deviation**2)), np.std(steps))
    return FileClock(rate, even, float(jitter))


def error_as_they_are(time: Floats, rate: float, frequency: float) -> float:
    """Return the most that a wave is off, relative, where samples count as taken on a grid."""
    off = time - time[0] - np.arange(len(time)) / rate
    return float(np.pi * frequency * np.ptp(off))


def even_rate(time: Floats) -> Rate | None:
    try:
        clock = read_clock(time)
    except ReadError:
        return None
    return clock.rate if clock.even else None


def _gap(time: Floats, step: float, wrong: np.ndarray, origin: float) -> ReadError:
    first = int(wrong[0]) if wrong.size else 0
    size = time[first + 1] - time[first]
    cure = "leave time out and give sample_rate, if only the time stamps are wrong"
    ends = np.concatenate([[-1], wrong, [len(time) - 1]])
    longest = int(np.argmax(np.diff(ends)))
    begin, end = int(ends[longest]) + 1, int(ends[longest + 1])
    if step > 0 and size >= LATE * step and end > begin:
        stretch = [] if begin == 0 else [f'skip = "{time[begin] - origin:.9g} s"']
        if end < len(time) - 1:
            stretch.append(f'until = "{time[end] + step / 2 - origin:.9g} s"')
        cure = f"use the longest stretch without: {' and '.join(stretch)}; or {cure}"
    return ReadError(
        f"a step of {size:.6g} s after sample {first} (t = {time[first]:.9g} s)"
        + (f", {wrong.size} such in all" if wrong.size > 1 else ""),
        f"steps of {step:.6g} s: no dropped samples",
        cure,
        place="time",
    )


def _spacing(time: Floats) -> float:
    """Return what the arithmetic that led to times may have rounded."""
    return 4 * float(np.spacing(np.abs(time).max()))


def _resolution(time: Floats) -> float:
    """Return the decimal digit to which times are written, or else that of their numbers."""
    least = _spacing(time)
    some = np.concatenate([time[:500], time[-500:]])  # a digit that a thousand lack is in none
    for digit in 10.0 ** np.arange(0, -13, -1):
        if digit < least:
            break
        if np.abs(some / digit - np.round(some / digit)).max() * digit < least:
            return float(digit)
    return least


def onto_grid(
    time: Floats, samples: Floats, rate: float, highest: float | None
) -> tuple[Floats, float, float]:
    """Interpolate samples to equal steps.

    Return besides the relative error (rms) of a wave of the frequency `highest`, which bounds that
    of lines below; and that frequency, where None was given the highest that bears it.
    """
    count = int(np.floor((time[-1] - time[0]) * rate * (1 + 1e-12) + 1e-6)) + 1
    offset = time - time[0]
    grid = np.minimum(np.arange(count) / rate, offset[-1])
    if highest is None:
        highest = rate / 2
        while interpolation_error(offset, grid, highest) > BEARABLE and highest > rate / 100:
            highest *= 0.8
    found = _interpolated(offset, grid, samples)
    return found, interpolation_error(offset, grid, highest), highest


def interpolation_error(time: Floats, grid: Floats, frequency: float) -> float:
    wave, exact = (np.exp(2j * np.pi * frequency * times)[:, None] for times in (time, grid))
    return float(np.sqrt(np.mean(np.abs(_interpolated(time, grid, wave) - exact) ** 2)))


def _interpolated(time: Floats, grid: Floats, samples: Numbers) -> Numbers:
    """Return samples on a grid, by polynomials through `_TAPS` of them around each point."""
    taps = min(_TAPS, len(time))
    found = np.empty((len(grid), samples.shape[1]), samples.dtype)
    for begin in range(0, len(grid), _BLOCK):
        points = grid[begin : begin + _BLOCK]
        nearest = np.searchsorted(time, points, side="right")
        first = np.clip(nearest - taps // 2, 0, len(time) - taps)
        taken = first[:, None] + np.arange(taps)
        nodes = time[taken]
        weights = np.ones_like(nodes)
        for tap, other in permutations(range(taps), 2):
            span = nodes[:, tap] - nodes[:, other]
            weights[:, tap] *= (points - nodes[:, other]) / span
        for channel, values in enumerate(samples.T):
            found[begin : begin + _BLOCK, channel] = (weights * values[taken]).sum(axis=1)
    return found


TOGETHER = 0.01  # samples by which columns may begin apart: clocks are written to a microsecond
BESIDE = 0.5  # samples up to which no sample stands beside the wrong one


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
        self, samples: Floats, valid: Booleans, skip: float
    ) -> tuple[RecordClock, Floats, Booleans]:
        """Leave out what follows the end, and what precedes `skip` where it holds defects."""
        samples, valid = samples[self.begin : self.end], valid[self.begin : self.end]
        times, later = self.stamps, skip - self.start
        first = math.ceil(later * self.rate - 1e-6) if times is None else _first_at(times, later)
        if first <= 0 or np.isfinite(samples[:first]).all():
            return self, samples, valid
        passed, left = first / self.rate, None
        if times is not None:
            passed = float(times[first] - times[0]) if first < len(times) else passed
            left = times[first:]
        clock = replace(self, stamps=left, start=self.start + passed)
        return clock, samples[first:], valid[first:]


def _first_at(stamps: Floats, time: float) -> int:
    later = np.flatnonzero(stamps - stamps[:1] >= time - 1e-9)
    return int(later[0]) if len(later) else len(stamps)


def weigh_clock(
    given: float | None,
    stamps: Floats | None,
    columns: Iterable[Column],
    overrule: bool,
    fundamental: float | None,
    limits: tuple[float, float | None],
    unused: Iterable[tuple[str, Column]],
) -> RecordClock:
    """Weigh what is said of the sample rate here, by the stamps, the file, and `unused` times."""
    several = list(columns)
    stated = _stated_rate([column.rate for column in several if column.rate is not None])
    if stamps is not None:
        begin, end = _stretch(stamps, *limits)
        told = read_clock(used := stamps[begin:end], float(stamps[0]))
        if given is not None:
            _check_rate(given, told.rate, "the time column", "remove the wrong one")
        rate = given or _whole_multiple(told.rate, fundamental, exactly=told.even)
        start, uneven = float(used[0] - stamps[0]), None if told.even else used
        clock = RecordClock(rate, uneven, told.jitter, begin=begin, end=end, start=start)
    else:
        if given is not None and stated is not None and not overrule:
            cure = "leave sample_rate out, or give overrule = true if the file is wrong"
            _check_rate(given, stated, "the file", cure)
        said, until = stated if given is None else Rate(given), limits[1]
        if said is None:
            found = "no sample rate and no time column, nor does the file state a rate"
            raise InputError(found, "one of sample_rate and time", "give one")
        rate = given or _whole_multiple(said, fundamental, exactly=True)
        for name, column in unused if not overrule else ():
            _check_unused(rate, fundamental, name, column)
        last = None if until is None else max(0, math.ceil(until * rate - 1e-6))
        clock = RecordClock(rate, end=last)
    starts = [column.start for column in several if column.start is not None]
    return clock if overrule else replace(clock, warnings=_check_starts(starts, rate))


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
    for rate in rates:
        if abs(rate.hertz / rates[0].hertz - 1) > SAME_RATE + rate.rounding + rates[0].rounding:
            found = f"columns sampled at {rates[0].hertz:.9g} Hz and at {rate.hertz:.9g} Hz"
            cure = "put them into records of their own, or write one rate"
            raise ReadError(found, "columns of one rate", cure, place="sample_rate")
    return rates[0] if rates else None


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
    found = f"columns that begin {apart:.6g} s apart, as the file has it"
    cure = "export the stretch that they share, or give overrule = true if the file is wrong"
    raise ReadError(found, "synchronous columns with a common start", cure, place="time")


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


def _check_unused(rate: float, fundamental: float | None, name: str, column: Column) -> None:
    """Refuse a rate that the equal steps of a column of times contradict."""
    unit, told = unit_of_time(name, column.unit), even_rate(column.values)
    counts = unit is None and told is not None and abs(told.hertz - 1) <= SAME_RATE  # samples
    if told is None or counts or not is_time(name, column.unit):
        return
    rates = {u: told.hertz / si_factor(u, "s") for u in ((unit,) if unit else UNITS)}
    likely, found = min(rates.items(), key=lambda pair: abs(math.log(pair[1] / rate)))
    # Ticks of a counter, hours or what else it may be says nothing of the rate.
    strange = unit is None and abs(math.log(found / rate)) > math.log(STRANGE)
    if strange or abs(rate / found - 1) <= SAME_RATE + told.rounding:
        return
    said = f'"{name}"' if column.unit else f'{{ column = "{name}", unit = "{likely}" }}'
    cure = (
        f"write time = {said} in place of sample_rate, or overrule = true if that column is wrong"
    )
    if fundamental is not None:
        new = fundamental * found / rate
        cure += f"; a fundamental that was counted from that rate is {new:.9g} Hz"
    raise InputError(
        f"{rate:.9g} Hz, where the column {name!r} has steps of {1 / found:.6g} s: {found:.9g} Hz",
        "one sample rate",
        cure,
        place="sample_rate",
    )


def _whole_multiple(rate: Rate, fundamental: float | None, *, exactly: bool) -> float:
    """Return the whole multiple of the fundamental that the digits of a rate allow, or the rate."""
    if fundamental is None or not 0 < fundamental < rate.hertz:
        return rate.hertz
    whole = round(rate.hertz / fundamental) * fundamental
    near = abs(rate.hertz / whole - 1) <= rate.rounding
    return whole if near or not exactly else rate.hertz


def on_grid(
    clock: RecordClock, samples: Floats, valid: Booleans, highest: float | None
) -> tuple[RecordClock, Floats, Booleans]:
    """Put samples onto a uniform grid; those that are near enough to it are taken as they are."""
    if (stamps := clock.stamps) is None:
        return clock, samples, valid
    if highest is not None and error_as_they_are(stamps, clock.rate, highest) <= NEGLIGIBLE:
        return clock, samples, valid
    # What is left out may be no number, and must not spoil its neighbours.
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
    # in few digits, so that records of one logger say the same, which is told once
    size = "below 0.001" if error < 1e-5 else f"of {100 * error:.1g}"
    told = (
        f"the sample times jitter by {clock.jitter:.1g} s (rms): samples interpolated to equal "
        f"steps, with an error {size} % at {frequency:.4g} Hz; if only the stamps jitter, give "
        "sample_rate in place of time"
    )
    clock = replace(clock, warnings=(*clock.warnings, told))
    return clock, found[:, :-1], found[:, -1] > 0.999
