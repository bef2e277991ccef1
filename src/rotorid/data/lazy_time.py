"""Times and angles of many samples at one rate and speed: three numbers until somebody looks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats

T = TypeVar("T")


@frozen
class Steady:
    """A quantity that grows evenly from sample to sample, over whole periods."""

    first: int  # number of the first sample
    shape: tuple[int, int]  # (int, int): periods, and samples of each
    # Hz, and the time in s of sample 0
    sample_rate: float
    start: float = 0.0
    # ``offset + slope t``: of the time itself 0 and 1, of an angle the phase and the speed
    offset: float = 0.0
    slope: float = 1.0

    def __call__(self) -> Floats:
        return self.head(self.shape[0])

    def head(self, periods: int) -> Floats:
        last = self.first + periods * self.shape[1]
        values = np.arange(self.first, last, dtype=np.float64)
        values /= self.sample_rate
        values += self.start
        if self.slope != 1.0:
            values *= self.slope
        if self.offset != 0.0:
            values += self.offset
        return values.reshape(periods, self.shape[1])

    @property
    def mean(self) -> float:
        middle = self.first + (self.shape[0] * self.shape[1] - 1) / 2
        return self.offset + self.slope * (self.start + middle / self.sample_rate)

    @property
    def in_period(self) -> float:
        """By how much it grows in a period."""
        return self.slope * self.shape[1] / self.sample_rate


class WhenRead:
    """A field of a frozen dataclass that takes an array, or what makes it when it is first read."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: object | None, owner: type) -> Floats:
        if instance is None:
            raise AttributeError(self.name)  # the field has no default
        value = vars(instance)[self.name]
        if callable(value):
            value = value()
            value.flags.writeable = False
            vars(instance)[self.name] = value
        return np.asarray(value)

    def __set__(self, instance: object, value: Floats | Callable[[], Floats]) -> None:
        vars(instance)[self.name] = value


def unread(value: object, name: str) -> Any:
    """Return a field as it was given: an array, or what will make it."""
    return vars(value)[name]


def head_of(value: object, name: str) -> Floats:
    """Return a field of times or angles in the first period, (1, sample), without the others."""
    given = unread(value, name)
    return np.asarray(given.head(1) if isinstance(given, Steady) else given[:1])


def mean_of(value: object, name: str) -> float:
    given = unread(value, name)
    return given.mean if isinstance(given, Steady) else float(given.mean())


def changed(value: T, **changes: Any) -> T:
    """Return a copy with other fields, as `dataclasses.replace`, without reading the others."""
    kept = {f.name: vars(value)[f.name] for f in fields(value) if f.init}  # type: ignore[arg-type]
    return type(value)(**kept | changes)
