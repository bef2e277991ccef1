"""Checks of the data before any model: what a record or its periods show by themselves.

A check is a function in a module of this package, entered beside it, and named nowhere else::

    @record_check("clipped", "no channel is cut at a limit", lambda seen: (seen.part,))
    def check_clipped(record: Record) -> Iterator[Note]: ...
"""

from __future__ import annotations

import pkgutil
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib import import_module
from typing import Any, TypeVar

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.notes import Note
from rotorid.core.values import Floats
from rotorid.data.record import Channel, PeriodicRecord, Record

NO_SCATTER = 1e-9
"""Scatter over level of a channel below which its periods are the same: sums of 64-bit numbers
leave 1e-13, no converter reaches 1e-8."""

F = TypeVar("F", bound=Callable[..., Iterable[Note]])
Arguments = Callable[[Any], tuple[Any, ...] | None]


@frozen
class Check:
    """A check of a record, or of its periods."""

    in_order: str  # what is said where it finds nothing, if anything
    arguments: Arguments  # of what is seen; None where there is nothing to look at
    function: Callable[..., Iterable[Note]]


_ENTERED: defaultdict[type, dict[str, Check]] = defaultdict(dict)


def record_check(name: str, in_order: str, arguments: Arguments) -> Callable[[F], F]:
    return _entering(SeenRecord, name, in_order, arguments)


def period_check(
    name: str, in_order: str, arguments: Arguments = lambda seen: (seen.periods,)
) -> Callable[[F], F]:
    return _entering(SeenPeriods, name, in_order, arguments)


def whole_check(name: str, arguments: Arguments) -> Callable[[F], F]:
    return _entering(SeenWhole, name, "", arguments)


def _entering(of: type, name: str, in_order: str, arguments: Arguments) -> Callable[[F], F]:
    def entered(function: F) -> F:
        _ENTERED[of][name] = Check(in_order, arguments, function)
        return function

    return entered


@cache
def _checks() -> dict[type, dict[str, Check]]:
    package = __name__.rpartition(".")[0]
    for module in pkgutil.iter_modules(import_module(package).__path__, f"{package}."):
        import_module(module.name)
    return _ENTERED


@dataclass(kw_only=True)
class _Seen:
    """What is looked at, and what was found."""

    _found: dict[str, list[Note] | None] = field(default_factory=dict)

    def notes(self, name: str) -> list[Note] | None:
        """Return what a check found, empty where all is in order; None where it does not apply."""
        if name not in self._found:
            one = _checks()[type(self)][name]
            arguments = one.arguments(self)
            self._found[name] = None if arguments is None else list(one.function(*arguments))
        return self._found[name]

    def warned(self, *names: str) -> bool:
        return any(note.severity != "says" for name in names for note in self.notes(name) or ())

    def told(self) -> tuple[Note, ...]:
        """Return what all checks found, and for those that found nothing that they passed."""
        notes: list[Note] = []
        for name, one in _checks()[type(self)].items():
            found = self.notes(name)
            passed = found == [] and one.in_order
            notes += [Note(name, "passes", one.in_order)] if passed else found or ()
        return tuple(notes)


def first_used(record: Record, periods: PeriodicRecord) -> int:
    """Return the number of the sample of a record at which its periods begin."""
    return round((periods.begin - record.start) * record.sample_rate)


@dataclass(kw_only=True)
class SeenRecord(_Seen):
    """A record as checks see it."""

    record: Record
    periods: PeriodicRecord | None
    excerpt: Record | None

    @cached_property
    def part(self) -> Record:
        """The samples in which channels are looked at one by one."""
        part = self.record if self.excerpt is None else self.excerpt
        if part.valid is None:
            return part
        return replace(part, samples=part.samples[part.valid], angle=None, valid=None)

    @property
    def untorn(self) -> bool:
        """Whether samples follow one another: a mask tears the course of time."""
        return self.record.valid is None

    @property
    def begin(self) -> float:
        """Time in s of the first sample that is used."""
        return -np.inf if self.periods is None else self.periods.begin

    @cached_property
    def scatter(self) -> Floats | None:
        """The standard deviation of a sample between periods; 0 where it is rounding."""
        if self.periods is None:
            return None
        scatter = np.sqrt(self.periods.variance.mean(axis=0))
        level = np.sqrt((self.periods.mean**2).mean(axis=0))
        return np.asarray(np.where(scatter > NO_SCATTER * level, scatter, 0.0))


@dataclass(kw_only=True)
class SeenPeriods(_Seen):
    """The periods of a record as checks see them."""

    periods: PeriodicRecord

    @cached_property
    def deviations(self) -> Floats:
        """What differs from period to period, shape (value, channel); 0 where it is rounding."""
        spectra = self.periods.spectra
        z = spectra - self.periods.mean_spectrum
        level = np.sqrt((np.abs(spectra) ** 2).mean(axis=(0, 1)))
        noisy = np.sqrt((np.abs(z) ** 2).mean(axis=(0, 1))) > NO_SCATTER * level
        flat = np.where(noisy, z, 0.0).reshape(-1, z.shape[2])
        return np.concatenate([flat.real, flat.imag])


@dataclass(kw_only=True)
class SeenWhole(_Seen):
    """A record that is used as a whole, as checks see it."""

    record: Record  # every channel, over the time that is used
    channels: tuple[Channel, ...]  # what is fitted of it
    references: tuple[str, ...]  # of which only what stops is told: no line of them is used

    @cached_property
    def used(self) -> Record:
        columns = [self.record.index(channel.name) for channel in self.channels]
        return Record(self.channels, self.record.samples[:, columns], self.record.sample_rate)


def check_record(
    record: Record, periods: PeriodicRecord | None = None, *, excerpt: Record | None = None
) -> tuple[Note, ...]:
    """Look at the samples of a record: dead, clipped, quantized and copied channels, the speed.

    The scatter of its `periods` tells rounding from noise; `excerpt` is the part of a long record
    in which the channels are looked at one by one. One note passes for each thing that was looked
    at and found in order.
    """
    return SeenRecord(record=record, periods=periods, excerpt=excerpt).told()


def check_periods(periods: PeriodicRecord) -> tuple[Note, ...]:
    """Look at averaged periods: scatter, settling, knocks, drift, lost samples, clocks."""
    return SeenPeriods(periods=periods).told()


def check_whole(
    record: Record, channels: tuple[Channel, ...], references: tuple[str, ...]
) -> tuple[Note, ...]:
    """Return what is wrong with a record that is used as a whole; see `SeenWhole`."""
    return SeenWhole(record=record, channels=channels, references=references).told()
