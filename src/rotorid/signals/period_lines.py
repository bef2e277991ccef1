"""Which samples make a period, and which lines of it are kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from rotorid.errors import InputError
from rotorid.record import Channel, Integers

KEYS = frozenset({"fundamental", "period_samples", "harmonics", "band", "skip"})
"""What an error of this module is about, by the place that it names."""


class Sampled(Protocol):
    """A record, or one that is read in blocks."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels."""
        ...

    @property
    def sample_rate(self) -> float:
        """Hz."""
        ...

    @property
    def source(self) -> str:
        """Where the samples come from."""
        ...

    @property
    def speed(self) -> float:
        """Mean speed in rad/s."""
        ...


def period_size(record: Sampled, fundamental: float | None, samples: int | None) -> int:
    """Return the samples of a period, which are a whole number."""
    key = "period_samples" if fundamental is None else "fundamental"
    if (fundamental is None) == (samples is None):
        raise _error(
            record,
            key,
            "neither or both of fundamental and period_samples",
            "one of them",
            "give the fundamental frequency or the samples of a period",
        )
    exact = record.sample_rate / _positive(record, fundamental) if samples is None else samples
    size = round(exact) if math.isfinite(exact) else 0
    if not math.isfinite(exact) or abs(exact - size) > 1e-6 * abs(exact):
        source = "" if fundamental is None else f" ({record.sample_rate:g} / {fundamental:g} Hz)"
        raise _error(
            record,
            key,
            f"a period of {exact:.6g} samples{source}",
            "a whole number of samples",
            "give a lower common fundamental and multiply the harmonics, or resample",
        )
    if size < 2:
        raise _error(record, key, f"a period of {size} samples", "2 or more", "sample faster")
    return size


def _positive(record: Sampled, fundamental: float | None) -> float:
    """Return a fundamental that is one."""
    if fundamental is None or not (math.isfinite(fundamental) and fundamental > 0):
        raise _error(
            record,
            "fundamental",
            f"a fundamental of {fundamental} Hz",
            "more than 0 Hz",
            "give the rate at which the excitation repeats",
        )
    return fundamental


def lines_of(
    record: Sampled,
    size: int,
    harmonics: Sequence[int] | None,
    band: tuple[float, float] | None,
) -> Integers:
    """Return the harmonics to keep, increasing."""
    key = "band" if harmonics is None else "harmonics"
    if (harmonics is None) == (band is None):
        raise _error(
            record,
            key,
            "neither or both of harmonics and band",
            "one of them",
            "say which lines to keep",
        )
    chosen: Sequence[int] = () if harmonics is None else harmonics
    shown = f"the harmonics {list(chosen)}"
    if band is not None:
        spacing = record.sample_rate / size
        shown = f"the band {band[0]:g} to {band[1]:g} Hz"
        if not band[1] <= (size // 2 + 1e-6) * spacing:
            raise _error(
                record,
                key,
                f"a band up to {band[1]:g} Hz",
                f"lines up to {record.sample_rate / 2:g} Hz, half the sample rate",
                "lower its upper end",
            )
        if not 0 <= band[0] <= band[1]:
            raise _error(
                record, key, shown, "0 Hz or more, the lower end first", "put the lower end first"
            )
        chosen = range(
            math.ceil(band[0] / spacing - 1e-6), math.floor(band[1] / spacing + 1e-6) + 1
        )
    if not len(chosen):
        raise _error(record, key, f"no line in {shown}", "at least one line", "widen it")
    lines = sorted({int(k) for k in chosen if 0 <= k <= size // 2 and k == int(k)})
    if len(lines) < len(chosen):
        raise _error(
            record,
            key,
            shown,
            f"different whole numbers from 0 to {size // 2}, half the samples of a period",
            "name each line once, counted from the fundamental, or lower the fundamental",
        )
    return np.array(lines, dtype=np.int64)


def first_sample(record: Sampled, skip: float, start: float = 0.0) -> int:
    """Return the number of samples to skip, of a record whose first is taken at a time `start`."""
    if not (math.isfinite(skip) and skip >= 0):
        raise _error(
            record,
            "skip",
            f"skip of {skip} s",
            "0 s or more",
            "give the time from the start of the record, in s",
        )
    return max(0, math.ceil((skip - start) * record.sample_rate - 1e-6))


def too_short(record: Sampled, left: int, size: int) -> InputError:
    """Return the error for a record without two periods."""
    return InputError(
        f"{left} samples after skip, {left // size} whole periods",
        f"at least two periods of {size} samples",
        "record longer, skip less, or give the rate at which the excitation repeats",
        file=record.source,
    )


def check_nyquist(record: Sampled, size: int, lines: Integers) -> None:
    """Refuse a correction of the Nyquist line, whose phase is not in the samples."""
    corrected = [c.name for c in record.channels if c.hold or c.delay or c.delay_std]
    if corrected and 2 * lines[-1] == size:
        raise _error(
            record,
            "harmonics",
            f"the Nyquist line with the hold or delay of {corrected[0]}",
            "lines below the Nyquist frequency",
            "leave that line out",
        )


def _error(record: Sampled, key: str, found: str, expected: str, cure: str) -> InputError:
    return InputError(found, expected, cure, file=record.source, place=key)
