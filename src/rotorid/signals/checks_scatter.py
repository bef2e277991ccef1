"""Checks of averaged periods: their scatter, a transient, a knock, a slow drift.

*Notation*: z, shape (period, line, channel), are the lines of each period; s^2 is the variance of
a line between periods, from differences of neighbours, which a slow drift does not enter.
"""

from __future__ import annotations

import numpy as np

from rotorid.distributions import f_limit
from rotorid.record import Check, Complexes, Floats, PeriodicRecord, Verdict
from rotorid.signals.checks_samples import is_input
from rotorid.signals.settling import LEAST_PERIODS, detect_settling
from rotorid.signals.sums import median

NO_SCATTER = 1e-9
"""Scatter over level of a channel below which its periods are the same: sums of 64-bit numbers
leave 1e-13, no converter reaches 1e-8."""

FALSE_ALARM = 1e-7
"""Chance per period or channel of an alarm on noise: with 260 periods of 12 channels it comes to 3
in 10,000 records."""

MOST_DIRECTIONS = 4
"""Independent directions that the scatter of one period is granted, however many lines there are.
Random motion that carries over from period to period puts the same few numbers, position and
velocity at the ends of the period, on all lines: a mode has two."""

KNOCK = 3.0
"""Deviation of a period, in units of the scatter, below which a knock is no matter for the mean of
the others."""

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
"""Size of a mean line over its own deviation from which on it is there: noise alone exceeds it once
in 8000 lines."""


def check_identical(periods: PeriodicRecord) -> list[Check]:
    """Find channels without scatter: nothing tells how well their mean is known."""
    level = np.sqrt((periods.mean**2).mean(axis=0))
    scatter = np.sqrt(periods.variance.mean(axis=0))
    moving = np.ptp(periods.mean, axis=0) > NO_SCATTER * level
    same = moving & (scatter <= NO_SCATTER * level)
    if not same.any():
        return []
    if same[moving].all():
        text = (
            "no scatter between periods: the deviations of the result are unknown, not zero; "
            "record again if the periods were copied or computed"
        )
        return [Check("identical periods", "", text, "warning")]
    found = []
    for c in np.flatnonzero(same):
        channel = periods.channels[c]
        command = is_input(channel)
        text = "no scatter between periods, while other channels have some: " + (
            "taken as exact" if command else "computed or copied, not measured"
        )
        verdict: Verdict = "note" if command else "warning"
        found.append(Check("identical periods", channel.name, text, verdict))
    return found


def check_copied_periods(periods: PeriodicRecord) -> list[Check]:
    """Find periods that are earlier ones again: a file that holds a measurement twice.

    Periods that settled without noise are the same too, but then each is the same as the next.
    """
    z = periods.spectra - periods.mean_spectrum
    size = np.sqrt((np.abs(z) ** 2).sum(axis=(0, 1)))
    scatters = size > 0
    rows = (z[:, :, scatters] / size[scatters]).reshape(len(z), -1)
    first: dict[int, int] = {}
    for one, other in _equal_pairs(rows):
        if other > one + 1 and not _equal(rows[one], rows[one + 1]):
            first.setdefault(other, one)
    if not first:
        return []
    later, earlier = min(first.items())
    text = (
        f"{len(first)} of {len(z)} periods are earlier ones again, in every digit: period "
        f"{later + 1} is period {earlier + 1}: the file holds one measurement twice; take each "
        "period once, by until"
    )
    return [Check("copied periods", "", text, "warning")]


def _equal_pairs(rows: Complexes) -> list[tuple[int, int]]:
    """Return pairs of equal rows, the earlier first: candidates are neighbours in one number."""
    weights = np.cos(np.arange(2 * rows.shape[1]))
    key = np.concatenate([rows.real, rows.imag], axis=1) @ weights
    order = np.argsort(key, kind="stable")
    least = NO_SCATTER * np.linalg.norm(weights) * np.linalg.norm(rows, axis=1).max(initial=0.0)
    close = np.flatnonzero(np.diff(key[order]) <= least)
    pairs = ((int(min(order[k : k + 2])), int(max(order[k : k + 2]))) for k in close)
    return [pair for pair in pairs if _equal(rows[pair[0]], rows[pair[1]])]


def _equal(one: Complexes, other: Complexes) -> bool:
    """Tell whether two periods differ by rounding only, beside their scatter."""
    return bool(np.linalg.norm(one - other) <= NO_SCATTER * np.linalg.norm(one))


def check_repeats(periods: PeriodicRecord) -> list[Check]:
    """Tell whether a few periods are the same at all; many are told by their lines and noise."""
    if periods.periods >= LEAST_PERIODS:
        return []
    inputs = [c for c, channel in enumerate(periods.channels) if is_input(channel)]
    chosen = inputs or list(range(len(periods.channels)))
    z = periods.spectra[:, :, chosen]
    scatter = np.sqrt(z.var(axis=0, ddof=1).mean(axis=0))
    level = np.sqrt((np.abs(z) ** 2).mean(axis=(0, 1)))
    part = float(median(scatter / np.where(level > 0, level, np.inf)))
    if part <= UNLIKE:
        return []
    text = (
        f"{periods.periods} periods that differ by {100 * part:.3g} % of their size: the record "
        "does not repeat with this period: give the rate at which the excitation repeats, or use "
        "the record without periods"
    )
    return [Check("repeats", "", text, "warning")]


def check_silent(periods: PeriodicRecord) -> list[Check]:
    """Find lines that no channel holds, and channels that hold no line."""
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
    for wanted, what, cure in (
        (
            True,
            "input",
            "excite the machine, or give the rate at which it repeats as the fundamental",
        ),
        (
            False,
            "sensor",
            "raise the excitation, or look at the fundamental and at what its column holds",
        ),
    ):
        chosen = [c for c, channel in enumerate(periods.channels) if is_input(channel) == wanted]
        if not chosen:
            continue
        here = there[:, chosen]
        if not here.any():
            text = f"no line used of any {what} stands above its own noise: {cure}"
            found.append(Check("lines below noise", "", text, "warning"))
            continue
        for c in np.flatnonzero(~here.any(axis=0)):
            channel = periods.channels[chosen[c]].name
            text = f"no line used of it stands above its own noise, while other {what}s hold some"
            found.append(Check("lines below noise", channel, text, "note"))
        empty = np.flatnonzero(~here.any(axis=1))
        if empty.size and not found:
            text = f"{_listed(periods.frequency[empty])} Hz hold no {what} above its own noise"
            found.append(Check("lines below noise", "", text, "note"))
    return found


def _listed(values: Floats, most: int = 6) -> str:
    shown = ", ".join(f"{v:g}" for v in values[:most])
    return shown + (f" and {len(values) - most} more" if len(values) > most else "")


def check_settled(periods: PeriodicRecord) -> list[Check]:
    """Tell whether the start still holds a transient, with few periods too."""
    if periods.periods >= LEAST_PERIODS:
        found = detect_settling(periods)
        if not found.periods:
            return []
        text = f"{found.told}: skip {found.drop:g} s more"
        return [Check("settled", "", text, "warning")]
    if periods.periods < 3:
        text = f"{periods.periods} periods cannot show a transient: record 8 or more"
        return [Check("settled", "", text, "note")]
    worst, ratio = _first_against_rest(periods.spectra)
    if worst is None:
        return []
    text = (
        f"the first of {periods.periods} periods differs from the others by {ratio:.3g} times "
        f"their scatter: skip {1 / periods.fundamental:g} s more"
    )
    return [Check("settled", periods.names[worst], text, "warning")]


def _first_against_rest(spectra: Complexes) -> tuple[int | None, float]:
    """Compare the first of a few periods with the others, channel by channel, by F."""
    count, lines, channels = spectra.shape
    rest = spectra[1:]
    within = rest.var(axis=0, ddof=1)
    level = (np.abs(rest.mean(axis=0)) ** 2).mean(axis=0)
    floor = np.maximum(NO_SCATTER**2 * level, 1e-300)
    moved = np.abs(spectra[0] - rest.mean(axis=0)) ** 2 / (1 + 1 / (count - 1))
    ratio = moved.mean(axis=0) / np.maximum(within.mean(axis=0), floor)
    freedom = 2 * min(lines, MOST_DIRECTIONS)
    worst = int(np.argmax(ratio))
    limit = f_limit(UNSETTLED / channels, freedom, freedom * (count - 2))
    return (worst if ratio[worst] > limit else None), float(np.sqrt(ratio[worst]))


def check_knocks(periods: PeriodicRecord, first: int = 0) -> list[Check]:
    """Find single periods that are not like the others."""
    spectra = periods.spectra[first:]
    count = len(spectra)
    if count < LEAST_TO_JUDGE:
        return []
    size = _without_trend(spectra)
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
    starts = periods.time[first + knocked, 0]
    which = ", ".join(
        f"{first + p + 1} ({t:.4g} s)" for p, t in zip(knocked[:5], starts[:5], strict=False)
    )
    text = (
        f"period {which}{' and more' if knocked.size > 5 else ''} deviates by up to {factor:.3g} "
        "times the scatter of the others: something knocked; leave it out or record again"
    )
    return [Check("knock", ", ".join(periods.names[c] for c in channels), text, "warning")]


def _without_trend(spectra: Complexes) -> Floats:
    """Return the size of each period's deviation in units of the scatter: (period, channel)."""
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


def check_drift(periods: PeriodicRecord) -> list[Check]:
    """Find lines that change slowly: their slope against the lines of the record beside it."""
    count = periods.periods
    if count < LEAST_PERIODS:
        return []
    place = np.linspace(-1.0, 1.0, count)
    place /= np.sqrt((place**2).sum())
    z = periods.spectra - periods.mean_spectrum
    slope = np.einsum("p,pkc->kc", place, z)
    left = z - place[:, None, None] * slope
    variance = _slow_variance(left)
    level = np.sqrt((np.abs(periods.mean_spectrum) ** 2).mean(axis=0))
    floor = np.maximum((NO_SCATTER * level) ** 2, 1e-300)
    strength = (np.abs(slope) ** 2 / np.maximum(variance, floor)).mean(axis=0)
    lines = periods.spectra.shape[1]
    freedom = 2 * min(lines, MOST_DIRECTIONS)
    limit = DRIFT**2 / lines
    if (strength > limit).any():
        limit = max(limit, f_limit(FALSE_ALARM, freedom, 2 * len(_beside(count))))
    rest = _beside_rotation(periods, ratio := np.abs(slope) ** 2 / np.maximum(variance, floor))
    alone = rest is not None and (strength > limit).any() and (rest <= limit).all()
    if alone and _turns(periods, slope, ratio):
        return [_creeping(periods, ratio)]
    found = []
    for c in np.flatnonzero(strength > limit):
        k = int(np.argmax(np.abs(slope[:, c])))
        ends = 2 * np.abs(slope[k, c]) * place[-1]
        size = np.abs(periods.mean_spectrum[k, c])
        text = (
            f"the line at {periods.frequency[k]:g} Hz changes by {100 * ends / size:.3g} % over "
            f"the record, {ends / np.sqrt(max(variance[k, c], floor[c])):.3g} times its scatter: "
            "warm up before recording, or take a shorter record"
        )
        found.append(Check("drift", periods.names[c], text, "warning"))
    return found


def _beside_rotation(periods: PeriodicRecord, ratio: Floats) -> Floats | None:
    """Return the mean over lines without that of the rotation, (channel,); None without one."""
    turns = abs(periods.speed) / (2 * np.pi * periods.fundamental)
    others = np.abs(periods.harmonics - turns) >= 0.5
    if not periods.speed or others.all() or not others.any():
        return None
    return np.asarray(ratio[others].mean(axis=0))


def _turns(periods: PeriodicRecord, slope: Complexes, ratio: Floats) -> bool:
    """Tell whether the line that changes most turns, as with a speed, or grows, as with a gain."""
    k, c = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    relative = slope[k, c] * np.conj(periods.mean_spectrum[k, c])
    return bool(abs(relative.imag) > abs(relative.real))


def _creeping(periods: PeriodicRecord, ratio: Floats) -> Check:
    """Say that the line of the rotation alone changes slowly."""
    hertz = abs(periods.speed) / (2 * np.pi)
    worst = int(np.argmax(ratio.max(axis=0)))
    text = (
        f"the line of the rotation, {hertz:g} Hz, changes slowly and no other does: the speed is "
        "not quite the one stated; give it to more digits, or measure the angle (encoder or "
        "keyphasor)"
    )
    return Check("speed", periods.names[worst], text, "warning")


def _beside(count: int) -> list[int]:
    """Return the lines of the whole record beside a kept one that tell its slow noise."""
    return [j % count for m in range(2, min(7, count // 2)) for j in (m, -m)]


def _slow_variance(left: Complexes) -> Floats:
    """Return the variance of a period's lines as far as it is slow, shape (line, channel).

    From the lines of the whole record beside each line, the first (which a curved drift fills)
    left out: noise that carries over from period to period is larger there than the scatter.
    """
    count = len(left)
    beside = np.fft.fft(left, axis=0)[_beside(count)]
    near = (np.abs(beside) ** 2).mean(axis=0) / count
    return np.asarray(np.maximum(near, (np.abs(left) ** 2).mean(axis=0)))
