"""What a record holds, channel by channel, before anything is identified."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.notes import Note, worst
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.data.lines import Lines, PhasorClock
from rotorid.data.record import PeriodicRecord, Record
from rotorid.signals.average import average
from rotorid.signals.checks.channels import is_input
from rotorid.signals.checks.registry import check_record
from rotorid.signals.period_search import common_period

CREST = 3.0
"""Crest factor of an input that is worth a note: a multisine has 1.4 to 2, noise 4."""
CLEAR = 10.0
"""Size of a mean line over its deviation from which on a record without a list holds it."""
ORDERS = (1, 2, 3)
"""Multiples of the rotation whose amplitudes are shown."""
MOST_LINES = 400
"""Lines kept where nothing says which: the strongest."""


LEVELS = ("name", "unit", "snr_db", "low", "high")
SAMPLED = ("rms", "crest_factor", "coherence", "odd", "even", "orders")
"""What a result file tells of each channel, and of one with samples too."""


@frozen
class ChannelFacts:
    name: str
    unit: str
    # extremes, and root mean square about the mean, in SI
    low: float
    high: float
    rms: float = 0.0
    at: float = 0.0  # of a table: where it is largest, rpm, or Hz of a response
    crest_factor: float | None = None  # peak over rms of one mean period
    # power of the kept lines over that of their noise, of one period; of a table, of the median row
    snr_db: float | None = None
    coherence: float | None = None  # least share, over the kept lines, of what repeats
    # size of odd and even lines that are not kept, over that of the kept ones, noise taken off
    odd: float | None = None
    even: float | None = None
    # amplitudes in SI at 1, 2, 3 times the rotation; empty at standstill
    orders: tuple[float, ...] = ()


class Judged:
    checks: tuple[Note, ...]

    @property
    def verdict(self) -> str:
        return worst(self.checks)

    @property
    def sentence(self) -> str:
        return SENTENCES[self.verdict]


@frozen
class Inspection(Judged):
    record: Record
    periods: PeriodicRecord | None  # none where the record does not repeat
    found: bool  # the period was found here, not given
    checks: tuple[Note, ...]
    channels: tuple[ChannelFacts, ...]
    # (channel, channel), or None: of the deviations from the mean over periods
    noise_correlation: Floats | None

    @property
    def source(self) -> str:
        return self.record.source

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as `rotorid inspect --json` writes it."""
        periods = self.periods
        return {
            "verdict": self.verdict,
            "checks": [check.as_check for check in self.checks],
            "period_samples": None if periods is None else periods.samples,
            "periods": None if periods is None else periods.periods,
            "harmonics": None if periods is None else periods.harmonics,
            "sample_rate_hz": self.record.sample_rate,
            "speed_rad_s": self.record.speed,
            "channels": [{k: getattr(c, k) for k in (*LEVELS, *SAMPLED)} for c in self.channels],
        }


SENTENCES: dict[str, str] = {
    "ok": "The record is suitable for identification.",
    "note": "The record is suitable; read the notes.",
    "warning": "Resolve the warnings first: errors may exceed the stated standard deviations.",
    "refused": "The record cannot be used as it is: see what is refused.",
}
"""What to do with a record, by the gravest verdict of its checks."""


def inspect_record(
    record: Record,
    *,
    period_samples: int | None = None,
    harmonics: Sequence[int] | None = None,
    band: tuple[float, float] | None = None,
    skip: float = 0.0,
    whole: bool = False,
) -> Inspection:
    """Look at a record as a technician would; period and lines are found where they are not given.

    In a `whole` record, such as a sweep, what repeats is its rotation: it has no periods.
    """
    size = period_samples
    found = size is None
    if size is None and not whole:
        size = _period(record, skip)
    periods, correlation = None, None
    if size is not None:
        lines = None if harmonics is None else list(harmonics)
        if lines is None and band is None:
            lines = _clear_lines(record, size, skip)
        if lines is None or lines:
            periods = average(record, period_samples=size, harmonics=lines, band=band, skip=skip)
    if periods is None:
        told = "no period found: see docs/inspect.md for records that do not repeat"
        none = Note("period", "says", told)
        if whole:
            none = Note("period", "passes", "no period, as the file says: taken as a whole")
        checks: tuple[Note, ...] = (*check_record(record), none)
    else:
        checks = (*periods.checks, *_crests(periods))
        z: Complexes = periods.spectra - periods.mean_spectrum
        scale, level = np.sqrt((np.abs(z) ** 2).mean(axis=0)), np.abs(periods.mean_spectrum)
        flat = z / np.where(scale > 1e-9 * level.max(axis=0), scale, np.inf)
        flat = flat.reshape(-1, z.shape[2])
        correlation = np.abs(flat.conj().T @ flat) / max(len(flat), 1)
    return Inspection(
        record=record,
        periods=periods,
        found=found,
        checks=checks,
        channels=tuple(_facts(record, periods, c) for c in range(len(record.channels))),
        noise_correlation=correlation,
    )


def _period(record: Record, skip: float) -> int | None:
    first = round(skip * record.sample_rate)
    found = common_period(list(record.samples[first:].T))
    if found is None:
        return None
    best = found[0]
    nice = best.fundamental(record.sample_rate)
    size = round(best.samples) if nice is None else round(record.sample_rate / nice)
    return size if 2 <= size <= (len(record.samples) - first) // 2 else None


def _clear_lines(record: Record, size: int, skip: float) -> list[int]:
    every = average(record, period_samples=size, harmonics=list(range(size // 2 + 1)), skip=skip)
    mean = np.abs(every.mean_spectrum)
    deviation = np.sqrt(every.spectra.var(axis=0, ddof=1) / every.periods)
    rounding = 1e-9 * mean.max(axis=0)
    strength = (mean / np.maximum(CLEAR * deviation, rounding + 1e-300)).max(axis=1)
    strength[0] = 0.0
    strongest = np.argsort(-strength)[:MOST_LINES]
    return sorted(int(k) for k in strongest if strength[k] > 1)


def _crests(periods: PeriodicRecord) -> Iterator[Note]:
    for c, channel in enumerate(periods.channels):
        crest = _crest(periods.mean[:, c])
        if is_input(channel) and crest is not None and crest > CREST:
            text = "other phases (minimize_crest) excite more with the same peak"
            yield Note(
                "crest factor", "says", f"crest factor {crest:.3g}: {text}", on=(channel.name,)
            )


def _crest(mean: Floats) -> float | None:
    moved = mean - mean.mean()
    size = float(np.sqrt((moved**2).mean()))
    return float(np.abs(moved).max() / size) if size > 0 else None


def _facts(record: Record, periods: PeriodicRecord | None, c: int) -> ChannelFacts:
    used = slice(None) if record.valid is None else record.valid
    samples = record.samples[used, c]
    if not len(samples):
        raise InputError("no samples", "a record", "check the file", file=record.source)
    channel = record.channels[c]
    size = float(samples.std())
    low, high = float(samples.min()), float(samples.max())
    orders: tuple[float, ...] = ()
    if record.speed:
        angle = record.rotor_angle()[used]
        column = samples - samples.mean() if record.valid is None else samples
        waves = (np.exp(-1j * n * angle) for n in ORDERS)
        orders = tuple(float(2 * np.abs(np.mean(column * wave))) for wave in waves)
    facts = ChannelFacts(channel.name, channel.unit, low, high, size, orders=orders)
    if periods is None:
        return facts
    z = periods.spectra[:, :, c]
    noise = z.var(axis=0, ddof=1)
    mean = np.abs(z.mean(axis=0)) ** 2
    total = float(noise.sum())
    signal = max(float((mean - noise / periods.periods).sum()), 0.0)
    share = mean / np.maximum((np.abs(z) ** 2).mean(axis=0), 1e-300)
    odd, even = _distortion(periods, c)
    return replace(
        facts,
        crest_factor=_crest(periods.mean[:, c]),
        snr_db=float(10 * np.log10(signal / total)) if signal > 0 and total > 0 else None,
        coherence=float(share.min()) if mean.any() else None,
        odd=odd,
        even=even,
    )


def _distortion(periods: PeriodicRecord, c: int) -> tuple[float | None, float | None]:
    power = np.abs(np.fft.rfft(periods.mean[:, c], norm="forward")) ** 2
    noise = float(periods.variance[:, c].mean()) / (periods.samples * periods.periods)
    lines = np.arange(len(power))
    highest = int(periods.harmonics.max())
    turns = periods.turns
    near = np.zeros(len(lines), dtype=bool)
    if turns > 0.5:
        near = np.abs(lines / turns - np.round(lines / turns)) * turns < 0.5
    free = (lines > 0) & (lines <= 3 * highest) & ~np.isin(lines, periods.harmonics) & ~near
    kept = float(power[periods.harmonics].sum())
    chosen = [free & (lines % 2 == parity) for parity in (1, 0)]
    excess = [max(float((power[at] - noise).sum()), 0.0) if at.any() else None for at in chosen]
    odd, even = (float(np.sqrt(e / kept)) if kept and e is not None else None for e in excess)
    return odd, even


@frozen
class LineInspection(Judged):
    lines: Lines
    checks: tuple[Note, ...]
    channels: tuple[ChannelFacts, ...]  # least and largest amplitudes

    @property
    def source(self) -> str:
        return self.lines.source

    @property
    def turning(self) -> bool:
        """Whether each row has a speed of its own: phasors, not responses."""
        return isinstance(self.lines.clock, PhasorClock)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, the same of a table, which has neither samples nor periods."""
        lines = self.lines
        return {
            "verdict": self.verdict,
            "checks": [check.as_check for check in self.checks],
            **dict.fromkeys(("period_samples", "periods", "harmonics", "sample_rate_hz")),
            "speed_rad_s": float(lines.speed[0]) if len(set(lines.speed.tolist())) == 1 else None,
            "kind": "phasors" if self.turning else "responses",
            "rows": len(lines.frequency),
            "frequency_hz": [lines.frequency.min(), lines.frequency.max()],
            "channels": [{key: getattr(c, key) for key in LEVELS} for c in self.channels],
        }


def inspect_lines(lines: Lines) -> LineInspection:
    turning = isinstance(lines.clock, PhasorClock)
    size = (2.0 if turning else 1.0) * np.abs(lines.mean)
    noise = np.diagonal(lines.covariance.matrices, axis1=1, axis2=2).real
    where = lines.speed * 30 / np.pi if turning else lines.frequency
    driven = None if turning else lines.channels[0]  # the input of a response is one by definition
    found = []
    for c, channel in enumerate(lines.channels):
        if channel is driven:
            continue
        told = noise[:, c] > 0
        ratio = np.abs(lines.mean[told, c]) ** 2 / noise[told, c]
        middle = float(np.median(ratio)) if told.any() else 0.0
        found.append(
            ChannelFacts(
                channel.name,
                channel.unit if driven is None else f"({channel.unit})/({driven.unit})",
                float(size[:, c].min()),
                float(size[:, c].max()),
                at=float(where[np.argmax(size[:, c])]),
                snr_db=float(10 * np.log10(middle)) if middle > 0 else None,
            )
        )
    return LineInspection(lines, lines.checks, tuple(found))
