"""Checks of the data before any model: what a record or its periods show by themselves.

A check is a function in a module of this package, entered beside it, and named nowhere else::

    @record_check("clipped", "no channel is cut at a limit")
    def check_clipped(seen: Seen) -> Iterator[Note]: ...
"""

from __future__ import annotations

import pkgutil
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache, cached_property, partial
from importlib import import_module
from typing import Any, TypeVar

import numpy as np

from rotorid.core.notes import Note
from rotorid.core.values import Floats, frozen
from rotorid.data.record import Channel, PeriodicRecord, Record

NO_SCATTER = 1e-9
"""Scatter over level below which periods are the same: rounding is 1e-13, a converter 1e-8."""

F = TypeVar("F", bound=Callable[..., Iterable[Note]])


@frozen
class _Check:
    in_order: str  # what is said where it finds nothing, if anything
    function: Callable[[Any], Iterable[Note]]
    unless: tuple[str, ...]  # checks that, where they warn, explain what this one would find
    needs: Callable[[Any], bool]


_ENTERED: defaultdict[str, dict[str, _Check]] = defaultdict(dict)


def _entering(
    of: str,
    name: str,
    in_order: str = "",
    *unless: str,
    needs: Callable[[Any], bool] = lambda seen: True,
    whole: bool = False,  # of records without periods too
) -> Callable[[F], F]:
    def entered(function: F) -> F:
        _ENTERED[of][name] = _Check(in_order, function, unless, needs)
        if whole:
            _ENTERED["whole"][name] = _Check("", function, (), lambda seen: True)
        return function

    return entered


period_check = partial(_entering, "periods")
record_check = partial(_entering, "record")
whole_check = partial(_entering, "whole")


@cache
def _checks() -> dict[str, dict[str, _Check]]:
    package = __name__.rpartition(".")[0]
    for module in pkgutil.iter_modules(import_module(package).__path__, f"{package}."):
        import_module(module.name)
    # In the order of the modules, whichever of them something else has loaded before.
    return {of: dict(sorted(checks.items(), key=_module)) for of, checks in _ENTERED.items()}


def _module(entry: tuple[str, _Check]) -> str:
    return entry[1].function.__module__


def found_by(of: str, seen: Any) -> tuple[Note, ...]:
    """Return what all checks find, and for those that find nothing that they passed."""
    checks = {name: check for name, check in _checks()[of].items() if check.needs(seen)}

    @cache
    def found(name: str) -> list[Note]:
        others = [note for other in checks.keys() & {*checks[name].unless} for note in found(other)]
        told = all(note.severity == "says" for note in others)
        return list(checks[name].function(seen)) if told else []

    notes: list[Note] = []
    for name, check in checks.items():
        passed = [Note(name, "passes", check.in_order)] if check.in_order else []
        same: dict[Note, tuple[str, ...]] = {}  # of several channels, said once
        for note in found(name) or passed:
            bare = replace(note, on=())
            same[bare] = (*same.get(bare, ()), *note.on)
        notes += [replace(note, on=on) for note, on in same.items()]
    return tuple(notes)


def first_used(record: Record, periods: PeriodicRecord) -> int:
    return round((periods.begin - record.start) * record.sample_rate)


@frozen
class Seen:
    record: Record
    periods: PeriodicRecord | None = None
    excerpt: Record | None = None
    channels: tuple[Channel, ...] | None = None  # what is fitted, where not all are
    references: tuple[str, ...] = ()

    @cached_property
    def part(self) -> Record:
        """The samples in which channels are looked at one by one."""
        part = self.record if self.excerpt is None else self.excerpt
        if self.channels is not None:
            columns = [part.index(channel.name) for channel in self.channels]
            return Record(self.channels, part.samples[:, columns], part.sample_rate)
        if part.valid is None:
            return part
        return replace(part, samples=part.samples[part.valid], angle=None, valid=None)

    @property
    def untorn(self) -> bool:
        """Whether samples follow one another: a mask tears the course of time."""
        return self.record.valid is None

    @cached_property
    def scatter(self) -> Floats | None:
        """The standard deviation of a sample between periods; 0 where it is rounding."""
        if self.periods is None:
            return None
        scatter = np.sqrt(self.periods.variance.mean(axis=0))
        level = np.sqrt((self.periods.mean**2).mean(axis=0))
        return np.asarray(np.where(scatter > NO_SCATTER * level, scatter, 0.0))


def check_record(
    record: Record, periods: PeriodicRecord | None = None, *, excerpt: Record | None = None
) -> tuple[Note, ...]:
    """Return notes on the samples; channels are looked at one by one in the `excerpt`."""
    return found_by("record", Seen(record, periods, excerpt))


def check_periods(periods: PeriodicRecord, seen: Iterable[Note] = ()) -> tuple[Note, ...]:
    """Return notes on periods, unless what was `seen` is that they are none."""
    wrong = any(note.about == "given period" and note.severity == "refuses" for note in seen)
    return () if wrong else found_by("periods", periods)
