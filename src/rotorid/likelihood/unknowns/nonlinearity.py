"""A channel that bends: a sensor that reads too much far out, an iron that runs through a loop.

No setting asks for these: they are freed one at a time, to see what they explain.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import field
from functools import partial
from typing import Self

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats
from rotorid.data.observation import Observation
from rotorid.data.record import Channel
from rotorid.likelihood.effects import Adds, Effect
from rotorid.likelihood.unknowns.base import Scalar, Unknown, all_inputs
from rotorid.signals.spectrum import transfer_of_recording


@frozen
class Bend(Unknown):
    """Channels read too much by ``unknown * shape(samples)``."""

    rival = "term"
    cure: str = field(default="calibrate what bends over its range, or excite less", kw_only=True)

    def effects(self) -> Sequence[Effect]:
        return tuple(Adds(name, lines=partial(self._lines, name)) for name in self.on)

    def _lines(self, name: str, record: Observation) -> Complexes | None:
        lines, samples = record.lines, record.lines.samples
        if samples is None:
            return None
        column = lines.names.index(name)
        bent = samples.lines(self.shape(samples.values[:, column])[:, None])
        # Lines of samples become those of the quantity as the channel's own do.
        channel = [lines.channels[column]]
        corrected = transfer_of_recording(channel, lines.frequency, samples.sample_rate)
        return np.asarray((bent * corrected)[:, 0])

    @staticmethod
    @abstractmethod
    def shape(samples: Floats) -> Floats:
        """Return what is added to a signal for an unknown of one."""

    @classmethod
    def _of(cls, what: str, label: str, unit: str, channels: Sequence[Channel]) -> Self:
        unknown = Scalar(f"{what} {label}", unit, 0.0, additive=True)
        return cls((unknown,), frozenset(c.name for c in channels))


class Cubic(Bend):
    """``reading = quantity (1 + unknown * quantity^2)``: symmetric, as of opposed sensors."""

    @staticmethod
    def shape(samples: Floats) -> Floats:
        return np.asarray(samples**3)

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        found = []
        for unit, channels in _sensors(records).items():
            found += [cls._of("nonlinear", c.name, _per_square(unit), [c]) for c in channels]
            if len(channels) > 1:
                label = f"{channels[0].name} ... {channels[-1].name}"
                found.append(cls._of("nonlinear", label, _per_square(unit), channels))
        return found


class Hysteresis(Bend):
    """An input that lags by half the width of a loop, whichever way it goes: hysteresis."""

    @staticmethod
    def shape(samples: Floats) -> Floats:
        return np.asarray(np.sign(np.roll(samples, -1) - np.roll(samples, 1)))

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        channels = list(all_inputs(_with_samples(records)).values())
        found = [cls._of("hysteresis", c.name, c.unit, [c]) for c in channels]
        if len(channels) > 1:
            found.append(cls._of("hysteresis", "force", channels[0].unit, channels))
        return found


def _with_samples(records: Sequence[Observation]) -> list[Observation]:
    return [record for record in records if record.lines.samples is not None]


def _sensors(records: Sequence[Observation]) -> dict[str, list[Channel]]:
    there = {s.channel.name: s.channel for r in _with_samples(records) for s in r.direct}
    found: dict[str, list[Channel]] = {}
    for channel in there.values():
        found.setdefault(channel.unit, []).append(channel)
    return found


def _per_square(unit: str) -> str:
    return f"1/{unit}^2" if unit else "1"
