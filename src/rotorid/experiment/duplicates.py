"""Data given twice, and one zero of the rotor angle for several records (docs/experiments.md).

Of a few samples, chosen by their own digits and not by their place, the digits of all channels of
the next few are summed up to a number: by chance it stands in no two records.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from hashlib import blake2b, shake_128
from itertools import combinations
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.lines import Lines, PhasorClock, SilentClock
from rotorid.data.observation import Measured
from rotorid.data.record import PeriodicRecord, Record
from rotorid.data.table_lines import SAME, multiple_of
from rotorid.experiment.read import Recording, columns_of, is_reference
from rotorid.experiment.schema import ExperimentFile, ModeEntry, RecordEntry
from rotorid.models import Model
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


_FACTORS = np.frombuffer(shake_128(b"samples").digest(8 * 4096), np.uint64) | np.uint64(1)
"""Odd numbers whose digits look like chance."""


@frozen
class Prints:
    """The prints of a record that it holds once, in rising order, and the samples they begin at."""

    values: Words  # uint64 array, shape (print,)
    places: Integers  # (print,)
    most: np.uint64  # the largest print that is kept
    count: int  # samples of the record
    digest: bytes  # of all of them, in order; empty where nothing moves


class Printer:
    def __init__(self, sensors: Sequence[str] = (), source: str = "", rate: float = 1.0) -> None:
        self.sensors, self.source, self.rate = tuple(sensors), source, rate
        self.count, self.moves, self.digest = 0, False, blake2b()
        self.tail = np.empty(0, dtype=np.uint64)
        self.parts = [(self.tail, np.empty(0, dtype=np.int64))]

    def add(self, samples: Floats) -> None:
        """Go on with samples, shape (sample, channel)."""
        fresh = _sums(samples)
        self.digest.update(fresh.data)
        sums = np.concatenate([self.tail, fresh])
        self.moves = self.moves or bool((sums != sums[:1]).any())
        begin = self.count - len(self.tail)
        self.count += len(samples)
        inside = max(len(sums) - WINDOW, 0)
        places = 1 + np.flatnonzero(sums[1 : inside + 1] < CHOSEN)
        places = places[sums[places] != sums[places - 1]]  # what stands still tells nothing
        windows = sums[places[:, None] + np.arange(WINDOW)]
        prints = (windows * _FACTORS[:WINDOW]).sum(axis=1, dtype=np.uint64)
        self.parts.append((prints, places + begin))
        self.tail = sums[inside:]

    def prints(self) -> Prints:
        values, places = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        values, first, times = np.unique(values, return_index=True, return_counts=True)
        once = np.flatnonzero(times == 1)[:MOST]
        kept = values[once]
        most = kept[-1] if len(kept) == MOST else np.uint64(2**64 - 1)
        digest = self.digest.digest() if self.moves else b""
        return Prints(kept, places[first[once]], most, self.count, digest)


def _sums(samples: Floats) -> Words:
    """Return a number of the digits of each sample, (sample,): of all channels."""
    found = np.zeros(len(samples), dtype=np.uint64)
    for channel in range(samples.shape[1]):
        digits = np.ascontiguousarray(samples[:, channel] + 0.0).view(np.uint64)  # one zero
        found += digits * _FACTORS[WINDOW + channel % (len(_FACTORS) - WINDOW)]
    found ^= found >> np.uint64(29)
    return np.asarray(found * _FACTORS[0])


def candidates(records: Sequence[Prints]) -> list[tuple[int, int]]:
    """Return pairs of records that hold the same prints, or are the same, in rising order."""
    values = np.concatenate([record.values for record in records])
    owners = np.repeat(np.arange(len(records)), [len(record.values) for record in records])
    order = np.argsort(values, kind="stable")
    again = np.flatnonzero(values[order[1:]] == values[order[:-1]])
    pairs = zip(owners[order[again]].tolist(), owners[order[again + 1]].tolist(), strict=True)
    found = {pair for pair, times in Counter(pairs).items() if times >= FEWEST}
    first: dict[bytes, int] = {}
    for number, record in enumerate(records):
        if record.digest and (before := first.setdefault(record.digest, number)) != number:
            found.add((before, number))
    return sorted(found)


def shared(one: Prints, other: Prints) -> tuple[int, int, int] | None:
    """Return how many samples two records share, in every digit, and where they begin in each."""
    if one.digest and one.digest == other.digest:  # however often a print of them repeats
        return one.count, 0, 0
    _, mine, its = np.intersect1d(one.values, other.values, assume_unique=True, return_indices=True)
    if len(mine) < FEWEST:
        return None
    lags, times = np.unique(one.places[mine] - other.places[its], return_counts=True)
    lag = int(lags[times.argmax()])
    begin, end = max(lag, 0), min(one.count, other.count + lag)
    most = min(one.most, other.most)
    inside = max(
        int(((begin <= places) & (places < end - WINDOW)).sum())
        for places in (one.places[one.values <= most], other.places[other.values <= most] + lag)
    )
    if times.max() < max(FEWEST, NEARLY_ALL * inside):
        return None
    return end - begin, begin, begin - lag


_ALIKE = 0.95  # of independent noise, a correlation of eleven lines is so by a chance of 1e-10
_LATER = 0.999  # where one begins periods later: some lag or other brings any two hums so near
_FREEDOM = 8  # lines of periods, fewer of which may be alike by chance
_ROUNDING = 1e-7  # of single precision: scatter below it is none
_SHARE = 0.05  # of the shorter record: less of it twice makes no deviation 3 % too small
_ROWS = 3  # of phasors, within a twentieth of their noise: three are by a chance of 1e-9 or less
_DIGITS = 1e-6  # by which a frequency or a speed may differ and be the same
_COMPARED = 60  # records of which each is held against each: 1800 pairs take a second


def check_file(file: ExperimentFile, plans: Sequence[Recording], model: Model) -> None:
    """Refuse data twice; records may share a file where they take other times, lines or sensors."""
    records, read_from = file.records, list[tuple[set[Path], set[tuple[str, ...]]]]()
    for number, plan in enumerate(plans):
        paths = {_resolved(path) for path in plan.paths}
        if plan.entry.quiet is not None and _resolved(plan.folder / plan.entry.quiet) in paths:
            raise InputError(
                "the record itself",
                "one without excitation, which tells the noise",
                "name another file, or leave quiet out",
                place=f"records.{number}.quiet",
            )
        sensors = {  # the columns that they are read from; of responses, all
            column
            for name, entry in plan.channels.items()
            if entry.law is None and (name not in model.inputs or entry.kind == "responses")
            for column in columns_of(entry)
        }
        read_from.append((paths, sensors))
    for (first, one), (second, other) in combinations(enumerate(read_from), 2):
        pair, files = (records[first], records[second]), one[0] & other[0]
        begin = max(record.skip or 0.0 for record in pair)
        apart = any(record.until is not None and record.until <= begin for record in pair)
        if files and one[1] & other[1] and not apart and _lines_overlap(*pair):
            raise InputError(
                f"the samples of records.{first} again ({min(files).name[:120]})",
                "each sample once: twice it counts as two measurements",
                "remove one of the two, or give each its own times by skip and until",
                place=f"records.{second}",
            )
    check_modes(file.modes)
    if file.estimator.unknown["runout"]:
        check_told(records)


def check_modes(modes: Sequence[ModeEntry]) -> None:
    """Refuse a measured natural frequency twice; two modes may have one, where axes are alike."""
    for number, one in enumerate(modes):
        before = modes[:number].count(one)
        if before > (0 if one.mode is not None else 1):
            raise InputError(
                f"the natural frequency of modes.{modes.index(one)} again",
                "each measurement once",
                "remove one; of two modes of one frequency, give each its own mode = 1, 2",
                place=f"modes.{number}",
            )


class Overlaps:
    """Finds samples that two records share, wherever they begin in each: excerpts of one run."""

    def __init__(self, records: Sequence[RecordEntry], model: Model, file: str) -> None:
        self.records, self.model, self.inputs, self.file = records, model, model.inputs, file
        self.taken: dict[int, Printer] = {}
        self.waves: list[Wave] = []

    def begin(self, number: int, record: Record | RecordBlocks) -> Callable[[Floats], None]:
        """Return what takes the prints of a record while its samples are read."""
        sensors = tuple(n for n in record.names if n not in self.inputs and not is_reference(n))
        columns = [record.names.index(n) for n in sensors]
        printer = self.taken[number] = Printer(sensors, record.source, record.sample_rate)
        several = len(self.records) > 1
        return lambda samples: printer.add(samples[:, columns]) if several else None

    def turns(self, number: int, record: Record) -> None:
        """Hold the rotation in a record against that in those before it."""
        wave = wave_of(number, self.records[number], record, self.model)
        if wave is not None:
            self.waves.append(wave)
            check_rotation(self.waves, self.file)

    def checked(self, found: Sequence[Measured]) -> list[Measured]:
        """Return what was read, no two of it the same; of what may be, it is told."""
        by_sensors: dict[tuple[str, ...], dict[int, Prints]] = {}
        for number, taken in self.taken.items():
            by_sensors.setdefault(taken.sensors, {})[number] = taken.prints()
        for prints in by_sensors.values():
            numbers = list(prints)
            for pair in candidates(list(prints.values())):
                first, second = sorted(numbers[k] for k in pair)
                both = shared(prints[first], prints[second])
                if both is not None and _lines_overlap(self.records[first], self.records[second]):
                    self._refuse((first, second), *both)
        check_tables(found, self.inputs)
        told = alike(found, self.inputs)
        return [
            replace(one, warnings=(*one.warnings, told[number])) if number in told else one
            for number, one in enumerate(found)
        ]

    def _refuse(self, pair: tuple[int, int], count: int, *begins: int) -> None:
        one, other = (self.taken[k] for k in pair)
        rate = other.rate
        # samples that neither record leaves out
        skips = [round((self.records[k].skip or 0.0) * rate) for k in pair]
        used = count - max(skips[0] - begins[0], skips[1] - begins[1], 0)
        if used > _SHARE * min(one.count, other.count):
            there, here = (begin / rate for begin in begins)
            moved = f": what is at {here:.4g} s here is at {there:.4g} s there"
            raise InputError(
                f"{used} samples that {Path(one.source).name[:120]} holds too, in every digit of "
                f"its sensors{moved * (here != there)}",
                "each sample once: twice it counts as two measurements",
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
            raise InputError(
                f"{told} that {Path(one.source).name[:120]} holds too",
                "each measurement once: twice it counts as two",
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
        shares = (_by_lag(one, other, name) for name in names)
        if not (known := [share for share in shares if share is not None]):
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
    parts = []
    for record in (one, other):
        lines = record.spectra[:, :, record.names.index(name)]
        rest = np.diff(lines, axis=0)
        if np.linalg.norm(rest) <= _ROUNDING * np.linalg.norm(lines):
            return None
        parts.append(rest)
    first, second = parts
    size = len(first) + len(second) - 1
    turned = np.fft.fft(first, size, axis=0) * np.fft.fft(second[::-1].conj(), size, axis=0)
    product = np.fft.ifft(turned, axis=0).sum(axis=1).real
    mine, its = ((np.abs(part) ** 2).sum(axis=1) for part in parts)
    shared = np.convolve(mine, np.ones(len(its))) * np.convolve(np.ones(len(mine)), its)
    return np.asarray(product / np.sqrt(np.maximum(shared, np.finfo(float).tiny)))


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


def wave_of(number: int, entry: RecordEntry, record: Record, model: Model) -> Wave | None:
    """Return the rotation's line of a record; None at standstill, or where it has its own."""
    sensors = [c for c in record.names if c in model.coordinates]
    if record.speed == 0 or entry.parameters or not sensors:
        return None
    samples = np.column_stack([record.column(name) for name in sensors])
    window = np.hanning(len(samples))[:, None]
    window /= window.sum()
    centred = samples - (window * samples).sum(axis=0)
    wave = np.exp(-1j * record.rotor_angle())[:, None]
    phasors = (window * wave * centred).sum(axis=0)
    return Wave(number, record.speed, tuple(sensors), phasors, not turns_untold(entry))


def check_rotation(waves: list[Wave], file: str) -> None:
    """Refuse the last record where another unit, or another zero of the angle, tells it apart."""
    last = waves[-1]
    for other in waves[:-1]:
        factor = last.over(other)
        if factor is None or factor == 0:
            continue
        size, turn = abs(factor), float(np.angle(factor))
        if max(size, 1 / size) > LARGE:
            raise InputError(
                f"a rotation {size:.3g} times as large as in records.{other.number} in all of "
                f"{', '.join(last.sensors)}",
                "one size of it, since both turn at the same speed",
                "correct unit or scale of the sensors in this record: [records.channels]",
                file=file,
                place=f"records.{last.number}.channels",
            )
        if not (last.told or other.told) and abs(size - 1) <= ALIKE and abs(turn) > TURNED:
            raise InputError(
                f"the rotation at {np.rad2deg(turn):.3g} deg from where it is in "
                f"records.{other.number}, which turns at the same speed",
                "one zero of the rotor angle in all records, where nothing is said of it",
                'name the column of the mark (keyphasor, angle), or write phase = "unknown" in all '
                f"records but records.{other.number}",
                file=file,
                place=f"records.{last.number}.phase",
            )
