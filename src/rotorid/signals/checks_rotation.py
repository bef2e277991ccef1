"""Checks of the speed: whether the record shows the rotation that it is said to have.

Unbalance leaves a line at the speed in every sensor. Off the lines of the excitation it stands
alone in what the mean over periods leaves; on one of them it is seen only where nothing is excited.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Check, Floats, PeriodicRecord, Record, Verdict
from rotorid.signals.checks_samples import is_input
from rotorid.signals.sums import median

TONE = 200.0
"""Power of a line over the median around it from which on it is a tone: of 100,000 lines of noise
chance lifts one to 25."""

STEADY = 0.3
"""Difference between a tone's amplitudes in the two halves of the record, over their mean, up to
which it is one: random vibration of a light mode comes and goes."""

ALONE = 5.0
"""Size of a line on the grid that was not excited over the next one, from which on it is no
distortion, which spreads over many lines."""

NEAR = 0.03
"""Part of the speed within which a tone is the rotation with a speed that is off."""

SAME_UNIT = 0.005
"""Distance of a ratio of speeds from a factor of units up to which that is the mistake."""

GHOST = 1e-2
"""Power of a tone on the grid over that of the strongest below which it is that one's trace: of a
tone between two lines the mean of ten periods keeps a tenth at most, a hundredth of the power."""

SMALL = 1e-6
"""What the mean leaves, over the channel, below which it is rounding, or of no weight."""

WANDER = 100.0
"""Variance between periods of the rotation's line over that of the median line: in closed loop
noise differs by a factor of some ten between lines; a speed that wanders by 1e-3 gives 1e4."""
SIDEBAND = 6.0
"""Lines of the whole record on each side of a kept one that a drift of it fills."""

SQUARE = np.radians(20.0)
"""Distance of two sensors' phases from a right angle within which a tone is an orbit: hum comes
from one source, and stands in all sensors with one phase or its opposite."""

ROUND = 2.0
"""Ratio of the axes up to which an orbit is one of a rotor, on bearings that are alike in x and y
to a factor of two or so."""

CLEAR = 1e4
"""Power of a tone over the median from which on an orbit is the rotation: a light mode that random
forces drive goes round too, and stands 200 to 1000 times above."""

ON_GRID = 1e-3
"""Turns in a period, off a whole number, up to which a tone stands on the grid: 2 Hz in 2 kHz."""

_WIDTH = 101  # lines for the median
_MOST = 1 << 15  # samples looked at
_TURN = 2 * np.pi
_UNITS = (
    (60 / _TURN, "rad/s given as rpm"),
    (_TURN / 60, "rpm given as rad/s"),
    (60.0, "Hz given as rpm"),
    (1 / 60, "rpm given as Hz"),
    (_TURN, "Hz given as rad/s"),
    (1 / _TURN, "rad/s given as Hz"),
)


@frozen
class Tone:
    """A line that the excitation does not explain: its frequency in Hz and where it is clearest."""

    frequency: float
    strength: float
    channel: str


def tones(record: Record, periods: PeriodicRecord | None) -> list[Tone]:
    """Return the tones that sensors show beside the excitation, the clearest first."""
    sensors = [c for c, channel in enumerate(record.channels) if not is_input(channel)]
    found: list[Tone] = []
    if not sensors:
        return []
    on_grid = [] if periods is None else _on_grid(periods, sensors)
    for c in sensors:
        rest, level = _rest(record, periods, c)
        if len(rest) < 4 * _WIDTH:
            return []
        if np.sqrt(rest @ rest / len(rest)) <= SMALL * level:
            continue
        power, floor = _spectrum(rest)
        clear = _off_grid(rest, power, floor, record.sample_rate, record.names[c])
        clear = [t for t in clear if not _is_ghost(t, clear[0], record, periods, len(rest))]
        found += [t for t in clear if not _is_sideband(t, record, periods, len(rest))]
        found += [tone for tone in on_grid if tone.channel == record.names[c]]
    best: list[Tone] = []
    width = 2 * record.sample_rate / min(len(record.samples), _MOST)
    for tone in sorted(found, key=lambda t: -t.strength):
        if all(abs(tone.frequency - other.frequency) > width for other in best):
            best.append(tone)
    return best


def _rest(record: Record, periods: PeriodicRecord | None, c: int) -> tuple[Floats, float]:
    """Return what the mean over periods leaves of a channel, and its level without it taken."""
    first, count, size = 0, 1, min(len(record.samples), _MOST)
    if periods is not None:
        size = periods.samples
        first = round(periods.begin * record.sample_rate)
        count = min(len(record.samples) - first, max(_MOST, 2 * size)) // size
    part = record.samples[first : first + count * size, c].copy()
    folded = part.reshape(count, size)
    mean = folded.mean(axis=1 if periods is None else 0, keepdims=True)
    folded -= mean
    return part, float(np.sqrt(part @ part / len(part) + mean.var()))


@cache
def _window(count: int) -> Floats:
    return np.hanning(count)


def _spectrum(rest: Floats) -> tuple[Floats, Floats]:
    """Return the power of a windowed signal, and its floor around each line.

    Of one channel at a time: they stay in the cache, and take no memory anew.
    """
    spectrum = np.fft.rfft(rest * _window(len(rest)))
    power = np.square(spectrum.real)
    power += np.square(spectrum.imag)
    blocks = -(-len(power) // _WIDTH)
    # As many lines as fill the last block are taken from the first.
    filled = np.concatenate([power, power[: blocks * _WIDTH - len(power)]])
    medians = np.maximum(median(filled.reshape(blocks, _WIDTH)), 1e-20 * power.sum())
    return power, np.repeat(medians, _WIDTH)[: len(power)]


def _off_grid(rest: Floats, power: Floats, floor: Floats, rate: float, name: str) -> list[Tone]:
    clear = power[1:-1] > TONE * floor[1:-1]
    if not clear[_WIDTH:].any():
        return []
    peak = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])
    peak[:_WIDTH] = False  # noise that rises towards zero has no median around it there
    at = 1 + np.flatnonzero(peak & clear)
    strongest = at[np.argsort(-(power / floor)[at])][:5]
    found = []
    for k in strongest:
        turns = _steady(rest, _refined(power, int(k)) / len(rest))
        if turns is not None:
            found.append(Tone(turns * rate, float(power[k] / floor[k]), name))
    return found


def _is_ghost(
    tone: Tone, strongest: Tone, record: Record, periods: PeriodicRecord | None, samples: int
) -> bool:
    """Tell whether a tone on the grid is what the mean over periods holds of a much stronger one.

    Of a tone between the lines the mean keeps a little, and taking it away puts that on all lines.
    """
    if periods is None or tone.strength > GHOST * strongest.strength:
        return False
    turns = tone.frequency / periods.fundamental
    return abs(turns - round(turns)) * periods.fundamental < 2 * record.sample_rate / samples


def _is_sideband(tone: Tone, record: Record, periods: PeriodicRecord | None, samples: int) -> bool:
    """Tell whether a tone lies so close to a kept line that a slow change of that makes it."""
    if periods is None:
        return False
    beside = np.abs(periods.frequency - tone.frequency) < SIDEBAND * record.sample_rate / samples
    own = np.abs(periods.frequency - abs(record.speed) / _TURN) < 0.5 * periods.fundamental
    return bool((beside & ~own).any())


def _refined(power: Floats, k: int) -> float:
    """Return the place of a peak between the lines: a parabola through the logarithms."""
    left, here, right = np.log(np.maximum(power[k - 1 : k + 2], 1e-300))
    bend = left - 2 * here + right
    return k + float(0.5 * (left - right) / bend) if bend < 0 else float(k)


def _steady(rest: Floats, turns: float) -> float | None:
    """Return a tone's turns per sample, from its phases in both halves; None where it wavers."""
    half = len(rest) // 2
    wave = np.exp(-2j * np.pi * turns * np.arange(2 * half))
    window = _window(half)
    first, second = (wave[at] * window @ rest[at] for at in (slice(half), slice(half, 2 * half)))
    sizes = np.abs([first, second])
    if abs(sizes[0] - sizes[1]) > STEADY * sizes.mean():
        return None
    return float(turns + np.angle(second * np.conj(first)) / (2 * np.pi * half))


def _on_grid(periods: PeriodicRecord, sensors: list[int]) -> list[Tone]:
    """Return of each sensor the line that stands alone among those that are not kept."""
    size, count = periods.samples, periods.periods
    power = np.abs(np.fft.rfft(periods.mean[:, sensors], axis=0) / size) ** 2
    power[0] = 0.0
    power[periods.harmonics] = 0.0
    if len(power) < 3:
        return []
    noise = periods.variance[:, sensors].mean(axis=0) / (size * count)
    place, (second, first) = np.argmax(power, axis=0), np.partition(power, -2, axis=0)[-2:]
    alone = first >= np.maximum(ALONE**2 * second, TONE * noise)
    strength = first / np.maximum(np.maximum(noise, 1e-30 * first), 1e-300)
    return [
        Tone(float(place[k] * periods.fundamental), float(strength[k]), periods.names[sensors[k]])
        for k in np.flatnonzero(alone)
    ]


def check_speed(record: Record, periods: PeriodicRecord | None = None) -> list[Check]:
    """Hold the speed against the tones of the sensors.

    Parameters
    ----------
    record : Record
    periods : PeriodicRecord, optional
        Its periods, where it has them: their mean takes the excitation away.
    """
    given = abs(record.speed) / _TURN
    found = tones(record, periods)
    if not found:
        return []
    samples = min(len(record.samples), _MOST)
    width = 1.5 * record.sample_rate / samples
    if given == 0:
        tone = found[0]
        text = (
            f"a line at {tone.frequency:.6g} Hz that is not excited, while the speed is 0: give "
            "the speed if it is the rotation; else hum, or another machine"
        )
        return [Check("speed", tone.channel, text, "note")]
    if any(abs(tone.frequency - given) <= width for tone in found):
        return []
    order = [t for t in found if not _is_order(t.frequency, given, width)]
    if not order:
        return []
    orbits = order[0].strength > CLEAR and _orbits(record, periods, order[0])
    hidden = _hidden(periods, given, width) and not orbits
    return [_told(order, given, hidden)]


def _orbits(record: Record, periods: PeriodicRecord | None, tone: Tone) -> bool:
    """Tell whether a tone goes round: half of the sensors that show it have one square to them."""
    sensors = [c for c, channel in enumerate(record.channels) if not is_input(channel)]
    size = np.array([_amplitude(record, periods, c, tone.frequency) for c in sensors])
    found = np.abs(size) > np.abs(size).max() / ROUND**2
    size = size[found]
    ratio = size[:, None] / size
    square = np.abs(np.abs(np.angle(ratio)) - np.pi / 2) < SQUARE
    alike = np.abs(np.log(np.abs(ratio))) < np.log(ROUND)
    return bool((square & alike).any(axis=1).mean() >= 0.5)


def _amplitude(record: Record, periods: PeriodicRecord | None, c: int, frequency: float) -> complex:
    """Return the complex amplitude of a tone in a channel, the excitation taken away."""
    rest, length = _rest(record, periods, c)[0], 0 if periods is None else periods.samples
    wave = np.exp(-2j * np.pi * frequency / record.sample_rate * np.arange(len(rest)))
    found = complex((_window(len(rest)) * rest) @ wave) / len(rest) * 2
    turns = frequency * length / record.sample_rate
    if periods is not None and abs(turns - round(turns)) < ON_GRID:  # it is in the mean
        found += complex(periods.mean[:, c] @ wave[:length]) / length * 2
    return found


def check_wander(periods: PeriodicRecord) -> list[Check]:
    """Find a line of the rotation that scatters from period to period as no other does."""
    turns = abs(periods.speed) / (2 * np.pi * periods.fundamental)
    on = np.flatnonzero(np.abs(periods.harmonics - turns) < 0.5)
    others = np.flatnonzero(np.abs(periods.harmonics - turns) >= 0.5)
    if not periods.speed or not len(on) or len(others) < 2 or periods.periods < 4:
        return []
    variance = periods.spectra.var(axis=0, ddof=1)
    usual = median(variance[others], axis=0)
    ratio = variance[on[0]] / np.where(usual > 0, usual, np.inf)
    worst = int(np.argmax(ratio))
    if ratio[worst] < WANDER:
        return []
    hertz = periods.frequency[on[0]]
    text = (
        f"the line of the rotation, {hertz:g} Hz, scatters between periods {ratio[worst]:.3g} "
        "times as much as the others (variance): the speed wanders or is not the one stated; "
        "measure the angle (encoder or keyphasor), or hold the speed"
    )
    return [Check("wander", periods.names[worst], text, "warning")]


def _is_order(frequency: float, given: float, width: float) -> bool:
    multiple = max(1, round(frequency / given))
    return 1 < multiple <= 10 and abs(frequency - multiple * given) <= multiple * width


def _hidden(periods: PeriodicRecord | None, given: float, width: float) -> bool:
    """Tell whether the line of the rotation is on one that is excited."""
    if periods is None:
        return False
    return bool((np.abs(periods.frequency - given) < 2 * width).any())


def _told(found: list[Tone], given: float, hidden: bool) -> Check:
    near = [t for t in found if abs(t.frequency / given - 1) < NEAR]
    tone = near[0] if near else found[0]
    ratio = tone.frequency / given
    told = (
        f"the clearest line that is not excited stands at {tone.frequency:.6g} Hz "
        f"({60 * tone.frequency:.6g} rpm), the speed given is {given:.6g} Hz ({60 * given:.6g} rpm)"
    )
    verdict: Verdict = "warning"
    for factor, mistake in _UNITS:
        if abs(ratio / factor - 1) < SAME_UNIT:
            return Check("speed", tone.channel, f"{told}: {mistake}?", verdict)
    if near:
        text = f"{told}: give the speed that the record shows"
    elif hidden:
        text, verdict = f"{told}: hum, or is that the speed?", "note"
    else:
        text = f"{told}, where nothing stands: give the speed at which the machine ran"
    return Check("speed", tone.channel, text, verdict)
