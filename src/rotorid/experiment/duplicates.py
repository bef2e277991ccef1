"""Data given twice, and one zero of the rotor angle for several records (docs/experiments.md).

Of a few samples, chosen by their own digits and not by their place, the digits of all channels of
the next few are summed up to a number: by chance it stands in no two records.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from hashlib import blake2b, file_digest, shake_128
from itertools import combinations
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats, Integers, frozen, grouped
from rotorid.data.lines import Lines, PhasorClock, SilentClock
from rotorid.data.observation import Measured
from rotorid.data.record import PeriodicRecord, Record
from rotorid.data.table_lines import SAME, multiple_of
from rotorid.experiment.read import Recording, columns_of, is_reference
from rotorid.experiment.schema import ExperimentFile, RecordEntry
from rotorid.signals.average import RecordBlocks

Words = npt.NDArray[np.uint64]

WINDOW = 16
"""Samples that a print is of: of some channels with noise, alike in no two measurements."""
CHOSEN = np.uint64(1 << 60)
"""Below this is the sum of a sample that a print begins at: one in 16, 60 of 1000."""
MOST = 1 << 16
"""Prints that are kept of a record: the smallest, which two records that share samples share."""
FEWEST = 8
"""Prints that records share where they share samples: so many at one distance are no chance."""
NEARLY_ALL = 0.95
"""Share of the prints that are the same where samples are; coarse digits repeat by chance less."""


def _factors(text: str, count: int) -> Words:
    """Return odd numbers whose digits look like chance, and belong to a text."""
    return np.frombuffer(shake_128(text.encode()).digest(8 * count), np.uint64) | np.uint64(1)


_OF_WINDOW = _factors("", WINDOW)


class Prints:
    """The prints of a record and the samples that they begin at, taken while it is read."""

    def __init__(self, sensors: Sequence[str], source: str = "", rate: float = 1.0) -> None:
        self.source, self.rate = source, rate
        self.factors = [_factors(name, 1) for name in sensors]
        self.count, self.moves, self.digest = 0, False, blake2b()
        self.tail = np.empty(0, dtype=np.uint64)
        self.parts = [(self.tail, np.empty(0, dtype=np.int64))]

    def add(self, samples: Floats) -> None:
        """Go on with samples, shape (sample, sensor)."""
        fresh = np.zeros(len(samples), dtype=np.uint64)  # a number of the digits of each sample
        for column, factor in zip(samples.T, self.factors, strict=True):
            fresh += np.ascontiguousarray(column + 0.0).view(np.uint64) * factor  # one zero
        fresh = (fresh ^ fresh >> np.uint64(29)) * _OF_WINDOW[0]
        self.digest.update(fresh.data)
        sums = np.concatenate([self.tail, fresh])
        self.moves = self.moves or bool((sums != sums[:1]).any())
        inside = max(len(sums) - WINDOW, 0)
        places = 1 + np.flatnonzero(sums[1 : inside + 1] < CHOSEN)
        places = places[sums[places] != sums[places - 1]]  # what stands still tells nothing
        windows = sums[places[:, None] + np.arange(WINDOW)]
        prints = (windows * _OF_WINDOW).sum(axis=1, dtype=np.uint64)
        self.parts.append((prints, places + self.count - len(self.tail)))
        self.count += len(samples)
        self.tail = sums[inside:]

    @cached_property
    def kept(self) -> tuple[Words, Integers, np.uint64]:
        """Those that stand once, in rising order, and where; and up to which all are kept."""
        values, places = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        values, first, times = np.unique(values, return_index=True, return_counts=True)
        once = np.flatnonzero(times == 1)[:MOST]
        most = values[once[-1]] if len(once) == MOST else np.uint64(2**64 - 1)
        return values[once], places[first[once]], most


Shared = tuple[tuple[int, int], int, tuple[int, int]]
"""Two records, how many samples they share in every digit, and where these begin in each."""


def shared(records: Sequence[Prints]) -> list[Shared]:
    """Return what records share, in their order, of each pair of them."""
    if len(records) < 2:  # most experiments: nothing to load for them
        return []
    found = set[Shared]()
    same = grouped((r.digest.digest(), n) for n, r in enumerate(records) if r.moves)
    for first, *others in same.values():  # however often a print of them repeats
        found |= {((first, other), records[first].count, (0, 0)) for other in others}
    kept = [record.kept[:2] for record in records]
    distinct, column = np.unique(
        np.concatenate([values for values, _ in kept]), return_inverse=True
    )
    ends = np.cumsum([0, *(len(values) for values, _ in kept)])
    held = scipy.sparse.csr_array(
        (np.ones(len(column)), column, ends), (len(records), len(distinct))
    )
    alike = np.triu((held @ held.T).toarray() >= FEWEST, k=1)  # prints that two have in common
    for first, second in np.argwhere(alike).tolist():
        one, other = records[first], records[second]
        (mine, here), (its, there) = kept[first], kept[second]
        _, a, b = np.intersect1d(mine, its, assume_unique=True, return_indices=True)
        different, times = np.unique(here[a] - there[b], return_counts=True)
        lag, most = int(different[times.argmax()]), int(times.max())
        if most >= max(FEWEST, NEARLY_ALL * _prints_at(one, other, lag)):
            begin, end = max(lag, 0), min(one.count, other.count + lag)
            found.add(((first, second), end - begin, (begin, begin - lag)))
    return sorted(found)


def _prints_at(one: Prints, other: Prints, lag: int) -> int:
    """Return how many prints would be the same if all samples were, one beginning `lag` later."""
    begin, end = max(lag, 0), min(one.count, other.count + lag) - WINDOW
    (mine, here, all_to), (its, there, its_all_to) = one.kept, other.kept
    most = min(all_to, its_all_to)
    every = here[mine <= most], there[its <= most] + lag
    return max(int(((begin <= places) & (places < end)).sum()) for places in every)


_ALIKE = 0.95  # of independent noise, a correlation of eleven lines is so by a chance of 1e-10
_LATER = 0.999  # where one begins periods later: some lag or other brings any two hums so near
_FREEDOM = 8  # lines of periods, fewer of which may be alike by chance
_ROUNDING = 1e-7  # of single precision: scatter below it is none
_SHARE = 0.05  # of the shorter record: less of it twice makes no deviation 3 % too small
_ROWS = 3  # of phasors, within a twentieth of their noise: three are by a chance of 1e-9 or less
_DIGITS = 1e-6  # by which a frequency or a speed may differ and be the same
_COMPARED = 60  # records of which each is held against each: 1800 pairs take a second


def _twice(found: str, cure: str, *, file: str = "", place: str = "") -> InputError:
    once = "each measurement once: twice it counts as two"
    return InputError(found, once, cure, file=file, place=place)


def check_file(file: ExperimentFile, plans: Sequence[Recording]) -> None:
    """Refuse data twice; records may share a file where they take other times, lines or sensors."""
    read_from = list[tuple[RecordEntry, set[Path], set[tuple[str, ...]]]]()
    for plan in plans:
        entry, paths = plan.entry, {_resolved(path) for path in plan.paths}
        if entry.quiet is not None and _resolved(plan.folder / entry.quiet) in paths:
            expected = "one without excitation, which tells the noise"
            cure = "name another file, or leave quiet out"
            raise InputError("the record itself", expected, cure, place=f"{plan.place}.quiet")
        sensors = {  # the columns that they are read from; of responses, all
            column
            for name, one in plan.channels.items()
            if one.law is None and (name not in plan.model.inputs or one.kind == "responses")
            for column in columns_of(one)
        }
        for before, (other, files, columns) in enumerate(read_from):
            both = not apart(entry, other) and _lines_overlap(entry, other)
            if paths & files and sensors & columns and both:
                own = "times by skip and until" if entry.kind == "samples" else "rows"
                raise _twice(
                    f"the {entry.kind} of records.{before} again ({min(paths & files).name[:120]})",
                    f"remove one of the two, or give each its own {own}",
                    place=plan.place,
                )
        read_from.append((entry, paths, sensors))
    for number, mode in enumerate(file.modes):
        before = file.modes[:number].count(mode)
        if before > (mode.mode is None):  # two modes may have one frequency, where axes are alike
            found = f"the natural frequency of modes.{file.modes.index(mode)} again"
            cure = "remove one; of two modes of one frequency, give each its own mode = 1, 2"
            raise _twice(found, cure, place=f"modes.{number}")
    if file.estimator.unknown["runout"]:
        check_told(file.records)


def used(plan: Recording) -> Iterator[tuple[str, float, float]]:
    """Yield a digest of each file, its columns and rows, and from when to when it is used in s."""
    columns = sorted(column for one in plan.channels.values() for column in columns_of(one))
    of = blake2b(repr((columns, plan.entry.rows)).encode(), digest_size=8)
    for path in plan.paths:
        with path.open("rb") as stream:
            digest = file_digest(stream, of.copy).hexdigest()
        yield digest, plan.entry.skip or 0.0, plan.entry.until or 1e9


class Overlaps:
    """Finds samples that two records share, wherever they begin in each: excerpts of one run."""

    def __init__(self, plans: Sequence[Recording], file: str) -> None:
        self.plans, self.file = plans, file
        self.taken: dict[int, Prints] = {}
        self.waves: list[Wave] = []

    def begin(self, plan: Recording, record: Record | RecordBlocks) -> Callable[[Floats], None]:
        """Return what takes the prints of a record while its samples are read."""
        inputs = plan.model.inputs
        sensors = [n for n in record.names if n not in inputs and not is_reference(n)]
        columns = [record.names.index(n) for n in sensors]
        prints = self.taken[plan.number] = Prints(sensors, record.source, record.sample_rate)
        several = len(self.plans) > 1
        return lambda samples: prints.add(samples[:, columns]) if several else None

    def turns(self, plan: Recording, record: Record) -> None:
        """Hold the rotation in a record against that in those before it."""
        wave = wave_of(plan, record)
        if wave is not None:
            check_rotation(wave, self.waves, self.file)
            self.waves.append(wave)

    def checked(self, found: Sequence[Measured]) -> list[Measured]:
        """Return what was read, no two of it the same; of what may be, it is told."""
        numbers = list(self.taken)
        for (first, second), count, begins in shared(list(self.taken.values())):
            self._refuse((numbers[first], numbers[second]), count, begins)
        inputs = {name for plan in self.plans for name in plan.model.inputs}
        check_tables(found, inputs)
        told = alike(found, inputs)
        return [
            replace(one, warnings=(*one.warnings, told[number])) if number in told else one
            for number, one in enumerate(found)
        ]

    def _refuse(self, pair: tuple[int, int], count: int, begins: tuple[int, int]) -> None:
        one, other = (self.taken[k] for k in pair)
        entries = [self.plans[k].entry for k in pair]
        if not _lines_overlap(*entries):
            return
        # samples that neither record leaves out
        skips = (round((entry.skip or 0.0) * other.rate) for entry in entries)
        used = count - max(0, *(skip - at for skip, at in zip(skips, begins, strict=True)))
        if used > _SHARE * min(one.count, other.count):
            there, here = (begin / other.rate for begin in begins)
            moved = f": what is at {here:.4g} s here is at {there:.4g} s there"
            raise _twice(
                f"{used} samples that {Path(one.source).name[:120]} holds too, in every digit of "
                f"its sensors{moved * (here != there)}",
                "remove one of the two, or give each its own times by skip and until",
                file=other.source,
            )


def check_tables(found: Sequence[Measured], inputs: Collection[str]) -> None:
    tables = [one for one in found if isinstance(one, Lines)][:_COMPARED]
    for one, other in combinations(tables, 2):
        told = None
        if isinstance(one.clock, SilentClock) and isinstance(other.clock, SilentClock):
            told = _response_again(one, other)
        elif isinstance(one.clock, PhasorClock) and isinstance(other.clock, PhasorClock):
            told = _rows_again(one, other, inputs)
        if told is not None:
            raise _twice(
                f"{told} that {Path(one.source).name[:120]} holds too",
                "leave them out of one of the two records",
                file=other.source,
            )


def _response_again(one: Lines, other: Lines) -> str | None:
    if one.channels[0].name != other.channels[0].name:
        return None
    here, there = _common(other.frequency, one.frequency)
    for a, sensor in enumerate(other.channels[1:], start=1):
        for b in range(1, len(one.channels)):
            responses = np.stack([one.mean[there, b], other.mean[here, a]])
            matrices = one.covariance.matrices[there, b, b], other.covariance.matrices[here, a, a]
            if multiple_of(other.frequency[here], responses, np.stack(matrices).real) is not None:
                return f"the response of {sensor.name}, noise and all,"
    return None


def _rows_again(one: Lines, other: Lines, inputs: Collection[str]) -> str | None:
    names = [n for n in other.names if n in one.names and n not in inputs]
    here, there = _common(other.speed, one.speed)
    a, b = ([lines.names.index(n) for n in names] for lines in (other, one))
    first, second = one.mean[there][:, b], other.mean[here][:, a]
    spread = sum(
        np.einsum("kii->ki", lines.covariance.matrices[rows]).real[:, columns]
        for lines, rows, columns in ((one, there, b), (other, here, a))
    )
    near = np.abs(first - second) <= SAME * np.sqrt(spread)
    same = int((near.all(axis=1) & first.any(axis=1)).sum()) if names else 0
    if same < max(_ROWS, _SHARE * min(len(one.speed), len(other.speed))):
        return None
    return f"{same} rows"


def _common(here: Floats, there: Floats) -> tuple[Integers, Integers]:
    """Return where numbers stand that both hold, to the digits of a table."""
    nearest = np.abs(here[:, None] - there).argmin(axis=1)
    both = np.abs(here - there[nearest]) <= _DIGITS * np.abs(here)
    return np.flatnonzero(both), nearest[both]


def alike(found: Sequence[Measured], inputs: Collection[str]) -> dict[int, str]:
    """Say which records scatter from period to period as another does: noise does not repeat.

    It is told, not refused: what decays from one start, or hum that began alike, may repeat.
    """
    told = {}
    periodic = [(i, one) for i, one in enumerate(found) if isinstance(one, PeriodicRecord)]
    for (_, one), (second, other) in combinations(periodic[:_COMPARED], 2):
        names = [name for name in one.names if name not in inputs and name in other.names]
        known = [share for name in names if (share := _by_lag(one, other, name)) is not None]
        if not known:
            continue
        least = np.min(known, axis=0)
        lags = np.arange(len(least)) - (len(other.spectra) - 2)
        count = np.minimum(len(one.spectra), len(other.spectra) + lags) - np.maximum(lags, 0)
        told_from = np.where(lags == 0, _ALIKE, _LATER)
        told_from[(count - 1) * len(one.harmonics) < _FREEDOM] = np.inf
        at = int((least - told_from).argmax())
        if least[at] > told_from[at]:
            lag = int(lags[at])
            later = f", {abs(lag)} periods {'later' if lag > 0 else 'earlier'}" if lag else ""
            told[second] = (
                f"{other.source} scatters as {one.source} does, period by period{later} "
                f"(correlation {least[at]:.4f}): if they are one measurement, exported twice, "
                "remove one, or the deviations are too small"
            )
    return told


def _by_lag(one: PeriodicRecord, other: PeriodicRecord, name: str) -> Floats | None:
    """Correlate a sensor's changes between periods in two records, by lag; None without any."""
    if not np.array_equal(one.harmonics, other.harmonics):
        return None
    lines = [record.spectra[:, :, record.names.index(name)] for record in (one, other)]
    first, second = (np.diff(each, axis=0) for each in lines)
    norm = np.linalg.norm
    if norm(first) <= _ROUNDING * norm(lines[0]) or norm(second) <= _ROUNDING * norm(lines[1]):
        return None
    product = scipy.signal.fftconvolve(first, second[::-1].conj(), axes=0).sum(axis=1).real
    mine, its = ((np.abs(part) ** 2).sum(axis=1) for part in (first, second))
    power = np.convolve(mine, np.ones(len(its))) * np.convolve(np.ones(len(mine)), its)
    return np.asarray(product / np.sqrt(np.maximum(power, np.finfo(float).tiny)))


def apart(first: RecordEntry, second: RecordEntry) -> bool:
    """Tell whether two records of one file take other times of it, or other rows."""
    begin = max(first.skip or 0.0, second.skip or 0.0)
    if first.rows and second.rows:  # of two columns the readings tell
        alike = first.rows.column == second.rows.column
        return not alike or first.rows.value != second.rows.value
    return any(each.until is not None and each.until <= begin for each in (first, second))


def _lines_overlap(first: RecordEntry, second: RecordEntry) -> bool:
    """Tell whether two records of the same samples may use the same of them, and a same line."""
    if first.mask != second.mask and None not in (first.mask, second.mask):
        return False
    periods = {(each.fundamental, each.period_samples) for each in (first, second)}
    if first.harmonics and second.harmonics and len(periods) == 1:
        return not set(first.harmonics).isdisjoint(second.harmonics)
    if first.band is not None and second.band is not None:
        return max(first.band[0], second.band[0]) <= min(first.band[1], second.band[1])
    return True


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):  # links in a circle, a null byte: told when opened
        return path


SAME_SPEED = 1e-3
"""Share by which speeds may differ: the unbalance hardly answers otherwise then."""
ALIKE = 0.1
"""Share of the rotation's line that a turn as a whole may leave: noise, and a sweep that passes."""
TURNED = np.deg2rad(10.0)
"""Angle from which on a line is turned: no settling and no noise of a line so clear does that."""
LARGE = 100.0
"""Factor from which on a line as a whole is in another unit, mm for um: no balancing does that."""


@frozen
class Wave:
    """The rotation's line of the sensors of a record; `told`: where its angle begins is said."""

    number: int
    speed: float
    sensors: tuple[str, ...]
    phasors: Complexes
    told: bool = False

    def over(self, other: Wave) -> complex | None:
        """Return by which factor a line is that of another one as a whole; None where it is not."""
        near = abs(self.speed - other.speed) <= SAME_SPEED * abs(other.speed)
        size = np.abs(other.phasors)
        if not near or self.sensors != other.sensors or not size.all():
            return None
        ratios = self.phasors / other.phasors
        factor = complex(ratios.mean())
        return factor if np.abs(ratios - factor).max() <= ALIKE * abs(factor) else None


def check_told(records: Sequence[RecordEntry]) -> None:
    """Refuse runout beside records whose angle begins anywhere: another unbalance fits as well."""
    untold = [k for k, record in enumerate(records) if turns_untold(record)]
    if len(untold) > 1:
        raise InputError(
            f"nothing, nor in records.{untold[0]}, which turns too",
            "the rotor angle at the first sample of each record, where runout is to be told from "
            "unbalance",
            'write phase = "0 deg" in all of them if the mark of the rotor started them, or name '
            "the column of the mark: keyphasor, angle",
            place=f"records.{untold[1]}.phase",
        )


def turns_untold(record: RecordEntry) -> bool:
    if record.kind != "samples" or record.angle is not None or record.keyphasor is not None:
        return False
    return bool(record.speed.value) and "phase" not in record.model_fields_set


def wave_of(plan: Recording, record: Record) -> Wave | None:
    """Return the rotation's line of a record; None at standstill, or where it has its own."""
    sensors = [c for c in record.names if c in plan.model.coordinates]
    if record.speed == 0 or plan.own or not sensors:
        return None
    samples = np.column_stack([record.column(name) for name in sensors])
    window = np.hanning(len(samples))[:, None]
    window /= window.sum()
    centred = samples - (window * samples).sum(axis=0)
    wave = np.exp(-1j * record.rotor_angle())[:, None]
    phasors = (window * wave * centred).sum(axis=0)
    return Wave(plan.number, record.speed, tuple(sensors), phasors, not turns_untold(plan.entry))


def check_rotation(last: Wave, before: Sequence[Wave], file: str) -> None:
    """Refuse a record that another unit, or another zero of the angle, tells from those before."""
    for other in before:
        factor = last.over(other)
        if not factor:
            continue
        size, turn, place = abs(factor), float(np.angle(factor)), f"records.{last.number}"
        if max(size, 1 / size) > LARGE:
            raise InputError(
                f"a rotation {size:.3g} times as large as in records.{other.number} in all of "
                f"{', '.join(last.sensors)}",
                "one size of it, since both turn at the same speed",
                "correct unit or scale of the sensors in this record: [records.channels]",
                file=file,
                place=f"{place}.channels",
            )
        if not (last.told or other.told) and abs(size - 1) <= ALIKE and abs(turn) > TURNED:
            raise InputError(
                f"the rotation at {np.rad2deg(turn):.3g} deg from where it is in "
                f"records.{other.number}, which turns at the same speed",
                "one zero of the rotor angle in all records, where nothing is said of it",
                'name the column of the mark (keyphasor, angle), or write phase = "unknown" in all '
                f"records but records.{other.number}",
                file=file,
                place=f"{place}.phase",
            )
