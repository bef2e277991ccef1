"""Checks of averaged periods: scatter, settling, shocks, drift, a wrong period.

*Notation*: z, shape (period, line, channel), are the lines of each period; s^2 is the variance of
a line between periods, from differences of neighbours, which a slow drift does not enter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rotorid.core.distributions import f_limit, median
from rotorid.core.notes import Note, Severity
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.data.record import PeriodicRecord, Record, some_periods, unread
from rotorid.signals.checks.channels import inputs_of, is_input, sensors_of
from rotorid.signals.checks.registry import (
    NO_SCATTER,
    Seen,
    first_used,
    period_check,
    record_check,
)
from rotorid.signals.period_search import find_period
from rotorid.signals.turning import without_waves

LEAST_PERIODS = 8  # periods below which a transient cannot be told from the scatter

_ROUNDING = 1e-9
_DRIFT, _LARGE = 4.0, 3.0
_DECAYS = 10.0
"""Ratio of the power at the begin and at the end of the first half from which on it dies away: what
is left of a transient as long as half the record; samples lost in its middle leave one level."""
_SLOPE = 15.0
"""Square of the slope over its own from which on the second half drifts: chance is 3e-7."""


@frozen
class Settling:
    periods: int = 0  # whole periods from the start that it disturbs
    # time in s to drop: as long again, in which the transient sinks below the scatter of the mean
    drop: float = 0.0
    # root mean square of the deviation of these periods from the settled ones, over all lines and
    # channels, in units of the scatter between the settled ones; 0 where there is none
    excess: float = 0.0

    @property
    def told(self) -> str:
        lasts = "period" if self.periods == 1 else f"{self.periods} periods"
        return (
            f"a transient in the first {lasts}, {self.excess:.3g} times the scatter of the later "
            "ones"
        )


def detect_settling(periods: PeriodicRecord) -> Settling:
    """Find the periods at the start that are not like those of the second half, on the kept lines.

    d of a period is the mean over lines and channels of |z - z_settled|^2 / s^2.
    """
    count = periods.periods
    if count < LEAST_PERIODS:
        return Settling()
    deviation = _deviation(periods.spectra)
    d = (deviation**2).mean(axis=1)
    # Against differences of neighbours the second half has d = 1; a drift in it makes it large.
    drifts = median(d[count // 2 :]) > _DRIFT
    last = 0 if drifts else _last_unsettled(d, deviation.shape[1])
    if last == 0:
        return Settling()
    return Settling(
        periods=last,
        drop=min(2 * last, count // 2) / periods.fundamental,
        excess=float(np.sqrt(d[:last].mean())),
    )


def _deviation(spectra: Complexes) -> Floats:
    count = len(spectra)
    settled = spectra[count // 2 :]
    place = np.arange(count) - count // 2 - (len(settled) - 1) / 2
    late = place[count // 2 :]
    # The straight line through the second half, where there is more than noise in it, goes.
    slope = np.einsum("p,pkc->kc", late, settled) / (late @ late)
    noise = (np.abs(np.diff(settled, axis=0)) ** 2).mean(axis=0) / 2
    strength = (np.abs(slope) ** 2 * (late @ late)).mean(axis=0)
    drifting = strength > _SLOPE * noise.mean(axis=0)
    spectra = spectra - place[:, None, None] * np.where(drifting, slope, 0.0)
    settled = spectra[count // 2 :]
    mean = settled.mean(axis=0)
    channel = np.sqrt((np.abs(mean) ** 2).mean(axis=0))
    # A drift that is left in the second half is no scatter: differences of neighbours hold less.
    scatter = np.sqrt((np.abs(np.diff(settled, axis=0)) ** 2).mean(axis=0) / 2)
    pooled = np.sqrt((scatter**2).mean(axis=0))
    level = np.sqrt((np.abs(spectra) ** 2).mean(axis=(0, 1)))  # a channel that stops has none late
    floor = np.maximum(pooled, np.maximum(_ROUNDING * np.maximum(channel, level), 1e-300))
    return np.asarray((np.abs(spectra - mean) / floor).reshape(count, -1))


def _last_unsettled(d: Floats, terms: int) -> int:
    """Return the number of periods at the start that are beyond chance.

    Chance explains the settled half's median and five times its spread, known from quartiles. What
    begins below three times the scatter biases no mean by more than its deviation.
    """
    half = len(d) // 2
    settled = np.sort(d[half:])
    low, middle, high = np.interp([0.25, 0.5, 0.75], np.linspace(0, 1, len(settled)), settled)
    if d[0] <= _LARGE**2 * middle:
        return 0
    late = d > middle + 5 * max((high - low) / 1.35, 1 / np.sqrt(terms))
    ends = np.flatnonzero(~late[:half] & ~late[1 : half + 1])
    if ends.size:
        return int(ends[0])
    # Longer than half the record: what dies away, not what was another level and stepped.
    begin, end = median(d[: half // 4]), median(d[half - half // 4 : half])
    return half if begin > _DECAYS * end else 0


FALSE_ALARM = 1e-7
"""Chance of an alarm on noise: with 260 periods of 12 channels 3 in 10,000 records."""
MOST_DIRECTIONS = 4
"""Independent directions of the scatter of a period: random motion that carries over puts the same
few numbers, position and velocity at its ends, on all lines: a mode has two."""
KNOCK = 3.0
"""Deviation of a period, over the scatter, below which a knock does not matter for the mean."""
LEAST_TO_JUDGE = 4
"""Periods below which none can be called the odd one: with three, two against one."""
DRIFT = 7.0
"""Deviations by which the lines' slope over the record must differ from zero to be a drift."""
UNSETTLED = 1e-5
"""Chance of an alarm where a handful of periods must tell: the first against the rest."""
UNLIKE = 0.5
"""Scatter of a handful of periods over their size from which on they do not repeat: if it is noise
after all, seven of them leave a fifth of it, too much for parameters."""
SILENT = 3.0
"""Size of a mean line over its deviation from which on it is there: of noise one in 8000."""


@period_check("identical periods", "the periods scatter, so that deviations can be stated")
def check_identical(periods: PeriodicRecord) -> Iterator[Note]:
    level = np.sqrt((periods.mean**2).mean(axis=0))
    scatter = np.sqrt(periods.variance.mean(axis=0))
    moving = np.ptp(periods.mean, axis=0) > NO_SCATTER * level
    same = moving & (scatter <= NO_SCATTER * level)
    if not same.any():
        return
    if same[moving].all():
        text = (
            "no scatter between periods: the deviations of the result are unknown, not zero; "
            "record again if the periods were copied or computed"
        )
        yield Note("identical periods", "warns", text)
        return
    for channel in (periods.channels[c] for c in np.flatnonzero(same)):
        command = is_input(channel)
        severity: Severity = "says" if command else "warns"
        told = "taken as exact" if command else "computed or copied, not measured"
        text = f"no scatter between periods, while other channels have some: {told}"
        yield Note("identical periods", severity, text, on=(channel.name,))


@period_check("copied periods", "no period is an earlier one again")
def check_copied_periods(periods: PeriodicRecord) -> list[Note]:
    """Find periods that are earlier ones again, but not where each is as the next: no noise."""
    z = periods.spectra - periods.mean_spectrum
    size = np.sqrt((np.abs(z) ** 2).sum(axis=(0, 1)))
    scatters = size > 0
    rows = (z[:, :, scatters] / size[scatters]).reshape(len(z), -1)
    first: dict[int, int] = {}
    # Equal rows are neighbours in one number of each.
    weights = np.cos(np.arange(2 * rows.shape[1]))
    key = np.concatenate([rows.real, rows.imag], axis=1) @ weights
    order = np.argsort(key, kind="stable")
    least = NO_SCATTER * np.linalg.norm(weights) * np.linalg.norm(rows, axis=1).max(initial=0.0)
    for k in np.flatnonzero(np.diff(key[order]) <= least):
        one, other = sorted(order[k : k + 2].tolist())
        apart = other > one + 1 and _equal(rows[one], rows[other])
        if apart and not _equal(rows[one], rows[one + 1]):
            first.setdefault(other, one)
    if not first:
        return []
    later, earlier = min(first.items())
    text = (
        f"{len(first)} of {len(z)} periods are earlier ones again, in every digit: period "
        f"{later + 1} is period {earlier + 1}: the file holds one measurement twice; take each "
        "period once, by until"
    )
    return [Note("copied periods", "warns", text)]


def _equal(one: Complexes, other: Complexes) -> bool:
    return bool(np.linalg.norm(one - other) <= NO_SCATTER * np.linalg.norm(one))


@period_check("repeats", "the periods repeat")
def check_repeats(periods: PeriodicRecord) -> list[Note]:
    """Tell whether a few periods are the same at all; many are told by their lines and noise."""
    if periods.periods >= LEAST_PERIODS:
        return []
    chosen = inputs_of(periods.channels) or list(range(len(periods.channels)))
    z = periods.spectra[:, :, chosen]
    scatter = np.sqrt(z.var(axis=0, ddof=1).mean(axis=0))
    level = np.sqrt((np.abs(z) ** 2).mean(axis=(0, 1)))
    part = float(median(scatter / np.where(level > 0, level, np.inf)))
    if part <= UNLIKE:
        return []
    text = (
        f"{periods.periods} periods that differ by {100 * part:.3g} % of their size: the record "
        "does not repeat with this period: set fundamental to the repetition frequency, or use "
        "the record without periods"
    )
    return [Note("repeats", "warns", text)]


_CURES = {
    "input": "excite the machine, or give the rate at which it repeats as the fundamental",
    "sensor": "raise the excitation, or look at the fundamental and at what its column holds",
}


@period_check("lines below noise", "every line that is used stands above its noise")
def check_silent(periods: PeriodicRecord) -> list[Note]:
    found = []
    deviation = np.sqrt(periods.spectra.var(axis=0, ddof=1) / periods.periods)
    freedom = 2 * (periods.periods - 1)
    if periods.periods < LEAST_PERIODS:  # too few to judge a line by itself
        deviation = np.broadcast_to(np.sqrt((deviation**2).mean(axis=0)), deviation.shape)
        freedom *= min(len(deviation), MOST_DIRECTIONS)
    mean = np.abs(periods.mean_spectrum)
    noisy = deviation.max(axis=0) > NO_SCATTER * np.maximum(mean.max(axis=0), 1e-300)
    # The deviation is itself a guess: what chance exceeds as seldom, by F.
    ratio = np.sqrt(f_limit(np.exp(-(SILENT**2)), 2, freedom))
    there = mean > np.where(noisy, ratio * deviation, NO_SCATTER * mean.max(axis=0))
    for what, cure in _CURES.items():
        chosen = (inputs_of if what == "input" else sensors_of)(periods.channels)
        if not chosen:
            continue
        here = there[:, chosen]
        if not here.any():
            text = f"no line used of any {what} stands above its own noise: {cure}"
            found.append(Note("lines below noise", "warns", text))
            continue
        for c in np.flatnonzero(~here.any(axis=0)):
            channel = periods.channels[chosen[c]].name
            text = f"no line used of it stands above its own noise, while other {what}s hold some"
            found.append(Note("lines below noise", "says", text, on=(channel,)))
        empty = np.flatnonzero(~here.any(axis=1))
        if empty.size and not found:
            shown = ", ".join(f"{v:g}" for v in periods.frequency[empty[:6]])
            shown += f" and {len(empty) - 6} more" if len(empty) > 6 else ""
            text = f"{shown} Hz hold no {what} above its own noise"
            found.append(Note("lines below noise", "says", text))
    return found


# What shifts or settles leaves other traces too: they are told once.
DISTURBED = ("lost samples", "settled")


@period_check("settled", "no transient is left", "lost samples")
def check_settled(periods: PeriodicRecord) -> list[Note]:
    if periods.periods >= LEAST_PERIODS:
        found = detect_settling(periods)
        if not found.periods:
            return []
        text = f"{found.told}: skip {found.drop:g} s more"
        early = tuple(range(round(found.drop * periods.fundamental)))
        return [Note("settled", "warns", text, periods=early)]
    if periods.periods < 3:
        text = f"{periods.periods} periods cannot show a transient: record 8 or more"
        return [Note("settled", "says", text)]
    count, lines, channels = periods.spectra.shape
    rest = periods.spectra[1:]
    level = (np.abs(rest.mean(axis=0)) ** 2).mean(axis=0)
    within = np.maximum(rest.var(axis=0, ddof=1).mean(axis=0), NO_SCATTER**2 * level)
    moved = np.abs(periods.spectra[0] - rest.mean(axis=0)) ** 2 / (1 + 1 / (count - 1))
    ratio = moved.mean(axis=0) / np.maximum(within, 1e-300)
    freedom, worst = 2 * min(lines, MOST_DIRECTIONS), int(np.argmax(ratio))
    if ratio[worst] <= f_limit(UNSETTLED / channels, freedom, freedom * (count - 2)):
        return []
    text = (
        f"the first of {count} periods differs from the others by {np.sqrt(ratio[worst]):.3g} "
        f"times their scatter: skip {1 / periods.fundamental:g} s more"
    )
    return [Note("settled", "warns", text, on=(periods.names[worst],), periods=(0,))]


@period_check("knock", "no period stands out", *DISTURBED)
def check_knocks(periods: PeriodicRecord) -> list[Note]:
    count = periods.periods
    if count < LEAST_TO_JUDGE:
        return []
    size = _without_trend(periods.spectra)
    typical = median(size, axis=0)
    out = size > KNOCK**2 * np.maximum(typical, 1e-300)
    if out.any():
        # Slow random motion puts one number, its change over the period, on all lines.
        limit = f_limit(FALSE_ALARM / size.shape[1], 1, max(count // 2, 1))
        out &= size > limit * np.maximum(typical, 1e-300)
    knocked = np.flatnonzero(out.any(axis=1))
    # What is true of many periods is no knock.
    if not knocked.size or knocked.size > max(1, count // 10):
        return []
    ratio = size / np.maximum(typical, 1e-12 * size.max())  # periods of few levels may be equal
    worst = int(knocked[np.argmax(ratio[knocked].max(axis=1))])
    channels = np.flatnonzero(out[knocked].any(axis=0))
    factor = float(np.sqrt(ratio[worst].max()))
    starts = periods.time[knocked, 0]
    listed = ", ".join(f"{p + 1} ({t:.4g} s)" for p, t in zip(knocked[:5], starts, strict=False))
    text = (
        f"period {listed}{' and more' if knocked.size > 5 else ''} deviates by up to {factor:.3g} "
        "times the scatter of the others: an external shock; leave these periods out or record "
        "again"
    )
    on, which = tuple(periods.names[c] for c in channels), tuple(knocked.tolist())
    return [Note("knock", "warns", text, on=on, periods=which)]


def _without_trend(spectra: Complexes) -> Floats:
    level = np.sqrt((np.abs(spectra.mean(axis=0)) ** 2).mean(axis=0))
    floor = np.maximum((NO_SCATTER * level) ** 2, 1e-300)[:, None]
    size = np.empty((2, spectra.shape[2], len(spectra)))
    powers = np.zeros((2, *spectra.shape[1:], len(spectra)))
    for part in (spectra.real, spectra.imag):
        each = np.ascontiguousarray(np.moveaxis(part, 0, -1))  # periods last: they are sorted
        powers[0] += np.square(each - median(each)[..., None])
        # The middle of the two neighbours is the best guess of a period in slow change.
        powers[1, ..., 1:-1] += np.square(each[..., 1:-1] - (each[..., :-2] + each[..., 2:]) / 2)
        powers[1, ..., 0] += np.square(each[..., 0] - each[..., 1])
        powers[1, ..., -1] += np.square(each[..., -1] - each[..., -2])
    for kind, power in enumerate(powers):
        typical = np.maximum(median(power)[..., None], floor)
        size[kind] = (power / typical).mean(axis=0)
    # A knock stands out both from the whole and from its neighbours; a drift only from the whole.
    return np.asarray(size.min(axis=0).T)


@period_check("drift", "no line drifts", *DISTURBED, "knock")
def check_drift(periods: PeriodicRecord) -> Iterator[Note]:
    """Find lines that change slowly: their slope against the lines of the record beside it."""
    count = periods.periods
    if count < LEAST_PERIODS:
        return
    place = np.linspace(-1.0, 1.0, count)
    place /= np.sqrt((place**2).sum())
    z = periods.spectra - periods.mean_spectrum
    slope = np.einsum("p,pkc->kc", place, z)
    left = z - place[:, None, None] * slope
    # Slow noise: of the lines of the whole record beside each line, but the first, which a curved
    # drift fills. What carries over from period to period is larger there than the scatter.
    beside = [j % count for m in range(2, min(7, count // 2)) for j in (m, -m)]
    near = (np.abs(np.fft.fft(left, axis=0)[beside]) ** 2).mean(axis=0) / count
    variance = np.maximum(near, (np.abs(left) ** 2).mean(axis=0))
    level = np.sqrt((np.abs(periods.mean_spectrum) ** 2).mean(axis=0))
    floor = np.maximum((NO_SCATTER * level) ** 2, 1e-300)
    strength = (np.abs(slope) ** 2 / np.maximum(variance, floor)).mean(axis=0)
    lines = periods.spectra.shape[1]
    freedom = 2 * min(lines, MOST_DIRECTIONS)
    limit = DRIFT**2 / lines
    if (strength > limit).any():
        limit = max(limit, f_limit(FALSE_ALARM, freedom, 2 * len(beside)))
    ratio, others = np.abs(slope) ** 2 / np.maximum(variance, floor), ~periods.on_rotation
    alone = bool(periods.speed) and others.any() and not others.all()
    if alone and (strength > limit).any() and (ratio[others].mean(axis=0) <= limit).all():
        most = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        relative = slope[most] * np.conj(periods.mean_spectrum[most])
        # It turns, as with a speed, and does not grow, as with a gain.
        if abs(relative.imag) > abs(relative.real):
            hertz = abs(periods.speed) / (2 * np.pi)
            text = (
                f"the line of the rotation, {hertz:g} Hz, changes slowly and no other does: the "
                "speed is not quite the one stated; give it to more digits, or measure the angle "
                "(encoder or keyphasor)"
            )
            yield Note("speed", "warns", text, on=(periods.names[most[1]],))
            return
    for c in np.flatnonzero(strength > limit):
        k = int(np.argmax(np.abs(slope[:, c])))
        ends = 2 * np.abs(slope[k, c]) * place[-1]
        size = np.abs(periods.mean_spectrum[k, c])
        text = (
            f"the line at {periods.frequency[k]:g} Hz changes by {100 * ends / size:.3g} % over "
            f"the record, {ends / np.sqrt(max(variance[k, c], floor[c])):.3g} times its scatter: "
            "warm up before recording, or take a shorter record"
        )
        yield Note("drift", "warns", text, on=(periods.names[c],))


RAMP = 1.0
"""A ramp's line over the deviation of the mean line from which on it biases as much as noise."""
LEAST = 6
"""Periods below which a beginning, a middle and an end say little."""
BENT = 0.2
"""Distance of the middle from the straight line, over the rise, from which on it is no ramp."""
ROUNDING = 1e-9
"""A ramp's line over the channel's own below which it is rounding."""


def ramps(record: Record, periods: PeriodicRecord, offsets: Floats) -> Floats:
    """Return the rise d of each offset in a period, d / (2 pi k) on line k; 0 where no matter.

    `offsets`: the mean of each period, (period, channel).
    """
    none = np.zeros(len(record.channels))
    size, count = periods.samples, periods.periods
    first = first_used(record, periods)
    lines = periods.harmonics > 0
    whole = (len(record.samples) - first) // size
    if record.valid is not None or whole != count or count < LEAST or not lines.any():
        return none
    middle = count // 2
    begin, half, end = offsets[[0, middle, count - 1]]
    rise = (end - begin) / (count - 1)
    power = np.abs(periods.spectra - periods.mean_spectrum)[:, lines] ** 2
    std = np.sqrt(power.sum(axis=0) / (count - 1) / count)
    line = np.abs(rise) / (2 * np.pi * periods.harmonics[lines, None])
    level = np.sqrt((np.abs(periods.mean_spectrum) ** 2).mean(axis=0))
    told = (line > np.maximum(RAMP * std, ROUNDING * level)).any(axis=0)
    straight = np.abs(half - begin - middle * rise) <= BENT * (count - 1) * np.abs(rise)
    return np.where(told & straight, rise, 0.0)


def without_ramps(record: Record, periods: PeriodicRecord, rise: Floats) -> Record:
    place = (np.arange(len(record.samples)) - len(record.samples) / 2) / periods.samples
    return replace(record, samples=record.samples - place[:, None] * rise)


def ramp_notes(periods: PeriodicRecord, rise: Floats) -> tuple[Note, ...]:
    return tuple(
        Note(
            "drift",
            "says",
            f"the offset drifts by {abs(d) * (periods.periods - 1):.3g} {channel.unit} over the "
            "record: a straight line was taken out",
            on=(channel.name,),
        )
        for channel, d in zip(periods.channels, rise, strict=True)
        if d
    )


HELD = 0.25
"""Share of a channel's power, the strongest line aside, which the lines given hold at the period of
the record, at the least: one wave is the rotation, or hum, and repeats with a period of its own."""
BETTER = 4.0
"""How many times more of it they hold with another period; how many times less two periods differ
than one if it is two: noise makes both differ alike."""
LOOKED_AT = 1 << 15
"""Samples that are looked at: more of them tell nothing new."""


@record_check(
    "given period",
    "the record repeats with the period given",
    needs=lambda seen: seen.periods is not None and seen.untorn,
)
def check_period(seen: Seen) -> Iterator[Note]:
    """Hold the period given against the one that the record shows, by the power on its lines."""
    record, periods = seen.record, seen.periods
    assert periods is not None
    size, first = periods.samples, first_used(record, periods)
    chosen = inputs_of(record.channels) or list(range(len(record.channels)))
    power = (periods.mean.var(axis=0) + periods.variance.mean(axis=0))[chosen]

    def held(mean: Floats) -> float:
        lines = periods.harmonics[(periods.harmonics > 0) & (2 * periods.harmonics <= len(mean))]
        on = 2 * np.abs(np.fft.rfft(mean, axis=0, norm="forward")[lines]) ** 2
        share = (on.sum(axis=0) - on.max(axis=0, initial=0.0)) / np.maximum(power, 1e-300)
        return float(share.max())

    if len(periods.harmonics) < 2 or (given := held(periods.mean[:, chosen])) >= HELD:
        return
    samples = record.samples[first : first + max(LOOKED_AT, 8 * size), chosen]
    found = {round(p.samples) for column in samples.T if (p := find_period(column)) is not None}
    cut = (
        (samples[: len(samples) // n * n].reshape(-1, n, len(chosen)), n) for n in found - {size}
    )
    shown, best = max(((held(part.mean(axis=0)), n) for part, n in cut), default=(0.0, size))
    if shown < max(HELD, BETTER * given):
        return
    hertz = periods.fundamental
    yield Note(
        "given period",
        "refuses",
        f"the record repeats after {best} samples, not after the {size} given: the lines given "
        f"hold {100 * shown:.2g} % of a channel's power there, {100 * given:.2g} % here",
        f"write period_samples = {best} in place of the fundamental; or, if the fundamental is "
        f'{hertz:.9g} Hz, sample_rate = "{hertz * best:.9g} Hz" with overrule = true',
    )


MULTIPLES = (2, 3)
"""Multiples of the period that are tried: half the line spacing given is the usual mistake."""
DIFFERENT = 0.01
"""Part of the power in which successive periods differ: below it nothing is at stake."""
SYNCHRONOUS = 0.05
"""Distance from whole turns, in so many periods, within which the rotation explains it."""


@record_check(
    "multiple period",
    "the record repeats after one period",
    "given period",
    needs=lambda seen: seen.periods is not None and seen.untorn,
)
def check_multiple(seen: Seen) -> list[Note]:
    record, periods = seen.record, seen.periods
    assert periods is not None
    size = periods.samples
    first = first_used(record, periods)
    count = min(len(record.samples) - first, max(LOOKED_AT, 8 * size)) // size
    chosen = inputs_of(record.channels) or list(range(len(record.channels)))
    if count < 2 * max(MULTIPLES):
        return []
    samples = record.samples[first : first + count * size, chosen]
    samples = samples.reshape(count, size, len(chosen))
    power = np.asarray(samples.var(axis=(0, 1)))
    if periods.rotation is not None:
        angle = some_periods(unread(periods, "angle"), 0, count)
        samples, _ = without_waves(samples, angle, periods.rotation.orders)
    alone = _difference(samples, 1, power)
    turns = periods.turns
    for multiple in MULTIPLES:
        turned = abs(multiple * turns - round(multiple * turns)) < SYNCHRONOUS
        if turned and abs(turns - round(turns)) > SYNCHRONOUS:
            samples = _without_orders(samples, turns, multiple)
            alone = _difference(samples, 1, power)
        apart = _difference(samples, multiple, power)
        clear = (alone > DIFFERENT) & (alone > BETTER * apart)
        if clear.any():
            names = tuple(record.names[chosen[c]] for c in np.flatnonzero(clear))
            true = periods.fundamental / multiple
            text = (
                f"the record repeats after {multiple} periods, not after one: the fundamental is "
                f"{true:.6g} Hz, not {periods.fundamental:.6g}; multiply the harmonics by "
                f"{multiple}"
            )
            return [Note("multiple period", "warns", text, on=names)]
    return []


def _without_orders(samples: Floats, turns: float, multiple: int) -> Floats:
    """Take out the orders of the rotation, whole in a multiple; (period, sample, channel)."""
    count, size, channels = samples.shape
    used = count - count % multiple
    joined = samples[:used].reshape(-1, multiple * size, channels)
    lines = np.fft.rfft(joined, axis=1)
    once = round(turns * multiple)
    lines[:, once :: max(once, 1)] = 0.0
    left = np.fft.irfft(lines, n=multiple * size, axis=1)
    return np.asarray(left.reshape(used, size, channels))


def _difference(samples: Floats, lag: int, power: Floats) -> Floats:
    """Return half the power of what differs between periods so far apart, over that of all."""
    change = samples[lag:] - samples[:-lag]
    return np.asarray((change**2).mean(axis=(0, 1)) / (2 * np.maximum(power, 1e-300)))
