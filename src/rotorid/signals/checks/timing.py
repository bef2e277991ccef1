"""Checks of time: lost samples, second clocks, periods.

A shift of time tau turns each line by -omega tau. That of each period is flat with one clock for
excitation and recording, has a slope with two, and a step where samples were lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.distributions import median
from rotorid.core.linalg import steps_within, straightened
from rotorid.core.notes import Note, Severity
from rotorid.core.values import Booleans, Complexes, Floats, Integers, frozen
from rotorid.data.record import PeriodicRecord
from rotorid.signals.checks.registry import NO_SCATTER, period_check

STEP = 8.0
"""Deviations by which the shift changes at a step: of 1000 places chance gives 4.5 or so."""
SLOPE = 8.0
"""Deviations of the slope of the shift from which on the clocks differ: a lag of one period in the
next widens them, which is allowed for, but not beyond a few periods."""
WHOLE = 0.25
"""Distance of a step from whole samples up to which some were lost; else the delay changed."""
EXPLAINED = 0.8
"""Part of the lines' turning, in units of its noise, that one shift of time must explain."""
LEAST_PERIODS = 4
"""Periods below which a step or slope of the shift cannot be told from its scatter."""
MOST_STEPS = 5
"""Steps that are looked for in one record: with more, it is not worth a repair."""
SURE = 4.0
"""Deviations from which on a channel takes part in a step that the whole record shows."""
OF_TIME = 0.9
"""Part of the lines' drift, amplitudes included, that one slope of the shift must explain to be a
clock's: 0.999 and more of clocks 20 ppm apart, 0.7 and less of magnets whose gaps grow with heat,
which turn the lines of a closed loop, too."""
MISCOUNTED = 0.05
"""Distance from whole samples up to which a period was miscounted; clocks differ by less than one
sample in a period, and by whole ones by chance only."""
LEAST_SHIFT = 1e-4
"""Shift over the record, in samples, below which it is rounding."""
LITTLE = 1.0
"""Turn of a line in rad up to which no period is a turn further: noise has none in a million."""
BETTER_MATCH = 0.5
"""Gain in the coherence of two periods, times the number of lines that share it, for which a jump
by many samples is granted: the noise of one line five times above it changes the coherence by at
most 0.4, and that of several averages out."""


@frozen
class Shifts:
    tau: Floats  # (period,): s, positive where the period comes late
    noise: float  # its standard deviation in s, as the noise of the lines explains it
    explained: float  # part of the lines' turning that the shift explains, in units of their noise


@frozen
class _Lines:
    """Lines that the excitation alone makes, of some channels, and their noise."""

    z: Complexes  # (period, line, channel)
    harmonics: Integers
    omega: Floats
    noise: Floats  # (line, channel): variance between periods
    clear: Booleans  # (line, channel)

    @classmethod
    def of(cls, periods: PeriodicRecord, channels: Sequence[int]) -> _Lines:
        lines = _steady_lines(periods)
        z = periods.spectra[:, lines][:, :, list(channels)]
        power, steps = z.real**2 + z.imag**2, np.diff(z, axis=0)
        # The median, so that a single jump does not count as noise; 2 ln 2 makes it a variance.
        noise = median(steps.real**2 + steps.imag**2, axis=0) / (2 * np.log(2))
        level = np.sqrt(power.mean(axis=(0, 1)))
        noise = np.maximum(noise, np.maximum((NO_SCATTER * level) ** 2, 1e-300))
        clear = power.mean(axis=0) > 25.0 * noise
        return cls(z, periods.harmonics[lines], periods.omega[lines], noise, clear)

    @property
    def weight(self) -> Floats:
        return np.where(self.clear, 1.0 / self.noise, 0.0)

    def turned(self, tau: Floats) -> Complexes:
        return np.asarray(self.z * np.exp(1j * tau[:, None] * self.omega[:, None]))

    def told(self, tau: Floats) -> list[Shifts]:
        """Tell what shifts explain: tau (period, channel), or (period, 1) of all channels."""
        weight, z = self.weight, self.z
        parts = [(weight * lines.var(axis=0)).sum(axis=0) for lines in (z, self.turned(tau))]
        sizes = np.abs(z.mean(axis=0)) ** 2, (np.abs(z) ** 2).mean(axis=0)
        sharp = [(weight * size * self.omega[:, None] ** 2).sum(axis=0) for size in sizes]
        sums = np.stack([*parts, np.count_nonzero(weight, axis=0), *sharp])
        if tau.shape[1] == 1:
            sums = sums.sum(axis=1, keepdims=True)
        before, after, chance = sums[:3]
        much = before > 2 * chance
        explained = np.where(much, (before - after) / np.where(much, before - chance, 1.0), 1.0)
        noise = 1 / np.sqrt(2 * np.maximum(sums[3:].max(axis=0), 1e-300))
        every = zip(tau.T, noise.tolist(), explained.tolist(), strict=True)
        return [Shifts(*each) for each in every]


def shifts_of(
    periods: PeriodicRecord, channels: Sequence[int], start: Floats | None = None
) -> Shifts | None:
    """Return the shift of each period, or None where no line is clear enough."""
    seen = _Lines.of(periods, channels)
    if not seen.clear.any():
        return None
    # From period to period first: small steps, so that no phase wraps.
    cross, omega = (seen.weight * seen.z[1:] * seen.z[:-1].conj()).sum(axis=2), seen.omega
    late = _coarse(cross, omega, periods) if start is None else np.diff(start)
    strength = np.abs(cross)
    for _ in range(4):
        phase = np.angle(cross * np.exp(1j * late[:, None] * omega))
        total = (strength * omega**2).sum(axis=1)
        late = late - (strength * omega * phase).sum(axis=1) / np.maximum(total, 1e-300)
    tau = np.concatenate([[0.0], np.cumsum(late)])
    for _ in range(3):  # each period against the mean of all: sums of steps wander with the noise
        turned = seen.turned(tau[:, None])
        cross = (seen.weight * turned * turned.mean(axis=0).conj()).sum(axis=2)
        strength = np.abs(cross) * seen.omega
        slope = (strength * np.angle(cross)).sum(axis=1)
        tau = tau - slope / np.maximum((strength * seen.omega).sum(axis=1), 1e-300)
    return seen.told((tau - tau[0])[:, None])[0]


def _small_shifts(periods: PeriodicRecord) -> dict[int, Shifts] | None:
    """Return each channel's shift, all at once; None where a line turns by more than `LITTLE`."""
    seen = _Lines.of(periods, range(len(periods.channels)))
    mean = seen.z.mean(axis=0)
    phase = np.angle(np.where(seen.clear, seen.z * mean.conj(), 1.0))
    if not seen.clear.any() or np.abs(phase).max() > LITTLE:
        return None
    strength = seen.weight * np.abs(mean) ** 2 * seen.omega[:, None]
    information = (strength * seen.omega[:, None]).sum(axis=0)
    slopes = strength / np.where(information > 0, information, 1.0)
    tau = -np.einsum("plc,lc->pc", phase, slopes)
    every = seen.told(tau - tau[0])
    return {int(c): every[c] for c in np.flatnonzero(seen.clear.any(axis=0))}


def _steady_lines(periods: PeriodicRecord) -> Booleans:
    lines = periods.harmonics > 0
    if periods.speed:
        order = np.round(periods.harmonics / periods.turns)
        others = lines & (np.abs(periods.harmonics - order * periods.turns) >= 0.5)
        lines = others if others.any() else lines
    return np.asarray(lines)


def _coarse(cross: Complexes, omega: Floats, periods: PeriodicRecord) -> Floats:
    """Return the shift in whole samples at which the cross-correlation is largest."""
    size = periods.samples
    full = np.zeros((len(cross), size // 2 + 1), dtype=complex)
    full[:, np.round(omega / (2 * np.pi * periods.fundamental)).astype(int)] = cross
    at = np.argmax(np.fft.irfft(full, n=size, axis=1), axis=1)
    late = np.where(at > size // 2, at - size, at) / periods.sample_rate
    # Lines with a common divisor repeat within the period: of equal matches the smallest shift.
    strength = np.abs(cross)
    lines = strength.sum(axis=1) ** 2 / np.maximum((strength**2).sum(axis=1), 1e-300)
    still = _match(cross, omega, 0.0) + BETTER_MATCH / np.maximum(lines, 1.0)
    return np.asarray(np.where(_match(cross, omega, late) > still, late, 0.0))


def _match(cross: Complexes, omega: Floats, late: Floats | float) -> Floats:
    turned = cross * np.exp(1j * np.reshape(late, (-1, 1)) * omega)
    return np.asarray(turned.real.sum(axis=1) / np.maximum(np.abs(cross).sum(axis=1), 1e-300))


@frozen
class StepFit:
    """The shift as a line with one step: slope per period, step with its deviation."""

    slope: float
    step: float
    step_std: float
    place: int


StepFits = dict[int, StepFit]
"""The fit of each channel, by the number of the channel."""


def _fitted(channels: Mapping[int, Shifts], at: ArrayLike) -> StepFits:
    """Fit a line and a step to the shift of each channel, the step before a period `at`."""
    taus = np.stack([shifts.tau for shifts in channels.values()])
    period, at = np.arange(taus.shape[1]), np.broadcast_to(at, len(taus))
    step = at[:, None]
    # A loss within a period splits that period, the one before the step or behind it: they are
    # left to themselves.
    split = [(period == q) & (q > 0) & (q < len(period) - 1) for q in (step - 1, step)]
    columns = np.broadcast_arrays(1.0, period - period.mean(), period >= step, *split)
    table = np.stack(columns, axis=2)
    inverse = np.linalg.pinv(table)
    solved = inverse @ taus[:, :, None]
    left, unknowns = (taus[:, :, None] - table @ solved)[:, :, 0], table.any(axis=1).sum(axis=1)
    found, root = StepFits(), np.linalg.norm(inverse[:, 2], axis=1)
    for k, (channel, shifts) in enumerate(channels.items()):
        std = _long_run(left[k], int(unknowns[k]), shifts.noise) * float(root[k])
        found[channel] = StepFit(float(solved[k, 1, 0]), float(solved[k, 2, 0]), std, int(at[k]))
    return found


def _places(taus: Floats) -> Integers:
    """Return the period before which a step explains most of each shift, taus (channel, period)."""
    gain, size = steps_within(straightened(taus))
    explained = gain**2 / np.where(size > 1e-9 * taus.shape[1], size, np.inf)
    return np.asarray(1 + np.argmax(explained, axis=1))


def _long_run(left: Floats, unknowns: int, noise: float) -> float:
    """Return the deviation of a period, times what its memory adds to sums over many."""
    size = float(np.sqrt((left**2).sum() / max(len(left) - unknowns, 1)))
    memory = float(left[1:] @ left[:-1] / max(float(left @ left), 1e-300))
    memory = min(max(memory, 0.0), 0.9)
    return max(size, noise) * float(np.sqrt((1 + memory) / (1 - memory)))


@period_check("lost samples", "every period comes when it should")
def check_timing(periods: PeriodicRecord) -> list[Note]:
    if periods.periods < LEAST_PERIODS:
        return []
    channels = {c: s for c, s in _each_shift(periods).items() if s.explained >= EXPLAINED}
    found: list[Note] = []
    for _ in range(MOST_STEPS):
        step = _largest_step(periods, channels)
        if step is None:
            break
        check, channels = step
        found.append(check)
    return found + _clocks(periods, channels, stepped=bool(found))


def _of_time(periods: PeriodicRecord, channels: Sequence[int]) -> bool:
    """Tell whether the lines of some channels drift as a shift of time makes them, and no more."""
    seen = _Lines.of(periods, channels)
    z, omega, noise = seen.z, seen.omega, seen.noise
    mean, place = z.mean(axis=0), np.arange(len(z)) - (len(z) - 1) / 2
    weight = np.where(np.abs(mean) ** 2 > 25.0 * noise, np.abs(mean) ** 2 / noise, 0.0)
    size = float(place @ place)
    relative = np.einsum("p,plc->lc", place, z) / size / np.where(weight > 0, mean, 1.0)
    sharp = np.maximum((weight * omega[:, None] ** 2).sum(axis=0), 1e-300)
    late = -(weight * omega[:, None] * relative.imag).sum(axis=0) / sharp
    left = relative + 1j * omega[:, None] * late
    whole, rest = (float((weight * np.abs(part) ** 2).sum()) for part in (relative, left))
    chance = np.count_nonzero(weight) / size
    return bool(rest - chance < (1 - OF_TIME) * max(whole - chance, 0.0))


def _each_shift(periods: PeriodicRecord) -> dict[int, Shifts]:
    if not _steady_lines(periods).any():
        return {}
    small = _small_shifts(periods)
    if small is not None:
        return small
    whole = shifts_of(periods, range(len(periods.channels)))
    if whole is None:
        return {}
    # A transient may look like a shift of all; one that makes things worse is none.
    start = whole.tau if whole.explained > 0 else None
    each = {c: shifts_of(periods, [c], start) for c in range(len(periods.channels))}
    return {c: shifts for c, shifts in each.items() if shifts is not None}


def _largest_step(
    periods: PeriodicRecord, channels: dict[int, Shifts]
) -> tuple[Note, dict[int, Shifts]] | None:
    """Return the clearest step by whole samples, and the shifts without it."""
    if not channels:
        return None
    fits = _fitted(channels, _places(np.stack([shifts.tau for shifts in channels.values()])))
    clear = {
        c: abs(f.step) / f.step_std
        for c, f in fits.items()
        if abs(f.step) > STEP * f.step_std and _abrupt(channels[c].tau, f)
    }
    if not clear:
        return None
    at = fits[max(clear, key=lambda c: clear[c])].place
    same = _fitted(channels, at)
    moved = {c: f for c, f in same.items() if abs(f.step) > SURE * f.step_std}
    weights = np.array([f.step_std**-2 for f in moved.values()])
    amount = float(weights @ np.array([-f.step for f in moved.values()]) / weights.sum())
    amount *= periods.sample_rate
    # A first period that stands alone may as well be a transient.
    if at == 1 or abs(amount) < 0.5 or abs(amount - round(amount)) > WHOLE:
        return None
    rest = {
        c: Shifts(np.where(np.arange(len(s.tau)) >= at, s.tau - same[c].step, s.tau), s.noise, 1.0)
        if c in moved
        else s
        for c, s in channels.items()
    }
    return _lost(periods, amount, at, moved, same), rest


def _lost(
    periods: PeriodicRecord, amount: float, at: int, moved: StepFits, every: StepFits
) -> Note:
    names = [periods.names[c] for c in moved]
    # A channel that would show the loss and does not has kept its samples.
    lost = amount / periods.sample_rate
    still = [c for c, f in every.items() if c not in moved and lost > SURE * f.step_std]
    only = f" in {', '.join(names)} only" if still else ""
    number = max(1, round(abs(amount)))
    kind = "lost" if amount > 0 else "too many"
    begin = periods.time[at - 1, 0]
    end = periods.time[min(at, periods.periods - 1), -1]
    severity: Severity = "refuses" if only or periods.speed else "warns"
    return Note(
        "lost samples",
        severity,
        f"{number} {'sample' if number == 1 else 'samples'} {kind}{only} between {begin:.5g} and "
        f"{end:.5g} s: use the part before or behind, or record again",
        on=tuple(names) if only else (),
    )


def _abrupt(tau: Floats, fit: StepFit) -> bool:
    """Tell a step from a bend: most of it lies between the two periods before and behind."""
    low, high = max(fit.place - 2, 0), min(fit.place + 1, len(tau) - 1)
    local = tau[high] - tau[low] - fit.slope * (high - low)
    return bool(abs(local - fit.step) < 0.5 * abs(fit.step))


def _clocks(periods: PeriodicRecord, channels: dict[int, Shifts], *, stepped: bool) -> list[Note]:
    """Say where periods come ever later: the period given is not the true one, or two clocks."""
    length = periods.samples / periods.sample_rate
    lines = {}
    for c, shifts in channels.items():
        place = np.arange(len(shifts.tau)) - (len(shifts.tau) - 1) / 2
        size = float(place @ place)
        slope = float(place @ shifts.tau) / size
        left = shifts.tau - shifts.tau.mean() - slope * place
        lines[c] = slope, _long_run(left, 2, shifts.noise) / float(np.sqrt(size))
    least = LEAST_SHIFT / periods.sample_rate / periods.periods
    moving = {c: slope for c, (slope, std) in lines.items() if abs(slope) > max(SLOPE * std, least)}
    if not moving or not (stepped or _of_time(periods, list(moving))):
        return []
    order = sorted(lines, key=lambda c: lines[c])
    low, high = lines[order[0]], lines[order[-1]]
    if high[0] - low[0] > max(SLOPE * float(np.hypot(low[1], high[1])), least):
        rates = [lines[c][0] / length for c in order]
        cut = 1 + int(np.argmax(np.diff(rates)))
        first, second = (
            tuple(periods.names[c] for c in sorted(part)) for part in (order[:cut], order[cut:])
        )
        apart = 1e6 * float(np.median(rates[cut:]) - np.median(rates[:cut]))
        text = (
            f"{', '.join(first)} and {', '.join(second)} run on two clocks, {apart:.3g} ppm apart: "
            "record all channels with one clock, or resample one group"
        )
        return [Note("clocks", "refuses", text, on=second)]
    weights = np.array([lines[c][1] ** -2 for c in order])
    slope = float(weights @ np.array([lines[c][0] for c in order]) / weights.sum())
    true = periods.fundamental / (1 + slope / length)
    late = slope * periods.sample_rate
    cure = "give the rates that the clocks have, or let one clock drive excitation and logger"
    if round(late) and abs(late - round(late)) <= MISCOUNTED:
        cure = f"write period_samples = {periods.samples + round(late)} in place of the fundamental"
    text = (
        f"every period comes {abs(slope) * 1e6:.3g} us {'late' if slope > 0 else 'early'} "
        f"({1e6 * slope / length:+.3g} ppm): the data repeat with {true:.8g} Hz, not "
        f"{periods.fundamental:.8g}; {cure}"
    )
    return [Note("period", "warns", text)]
