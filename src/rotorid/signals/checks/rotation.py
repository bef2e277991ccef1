"""Checks of the speed: whether the record shows the rotation that is stated.

A tone of frequency f leaves ``(-1)^k sinc(k - f T)`` on line k of a record of length T. Unbalance
leaves one in every sensor, alone in what the mean over periods leaves, or where nothing is excited.
"""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import scipy

from rotorid.core.distributions import f_limit, median
from rotorid.core.linalg import column_lengths
from rotorid.core.notes import Note, Severity
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.record import PeriodicRecord, Record, Steady, unread
from rotorid.signals.checks.channels import sensors_of
from rotorid.signals.checks.registry import NO_SCATTER, Seen, first_used, period_check, record_check
from rotorid.signals.spectrum import top_of

_FITTED = 1 << 17  # samples from which the speed is fitted: more tell nothing new
_BLOCK = 1 << 16  # samples at once, so that memory does not grow with the record
NOTICED = 1e-3
"""Part of the unbalance lost, or leaked into a line, from which on it is worth a warning."""


@frozen
class Synchronism:
    turns: float  # mean revolutions per period
    # angle in rad by which the rotation gains on the nearest whole number of turns, over all
    # periods
    slip: float
    drift: float  # change of the speed in rad/s over the record, by regression
    loss: float  # part of the unbalance's line that averaging over the periods loses
    # (line,): size of exp(i phi) on each kept line; 1 where all of it is, the line of the rotation
    # itself set to 0
    leakage: Floats


def synchronism(periods: PeriodicRecord) -> Synchronism:
    """Compare the rotor angle with the periods: it is averaged and filtered as the data are.

    What leaks is not periodic: an error of about the leakage times the amplification there.
    """
    omega0, size = 2 * np.pi * periods.fundamental, periods.samples
    angle = unread(periods, "angle")
    if isinstance(angle, Steady) and isinstance(unread(periods, "time"), Steady):
        turns, drift = angle.in_period / (2 * np.pi), 0.0
        length = (periods.periods * size - 1) / periods.sample_rate
        once = np.exp(1j * angle.in_period * np.arange(periods.periods)).mean()
        mean = once * np.exp(1j * angle.head(1)[0])
    else:
        phi, time = periods.angle.reshape(-1), periods.time.reshape(-1)
        some = slice(None, None, max(1, len(time) // _FITTED))
        place, beyond = time[some] - time.mean(), phi[some] - phi.mean()
        speed = np.polynomial.polynomial.polyfit(place, beyond, 2)
        length = float(time[-1] - time[0])
        turns, drift = float(speed[1] / omega0), 2 * float(speed[2]) * length
        step = max(1, _BLOCK // size)
        parts = (periods.angle[k : k + step] for k in range(0, periods.periods, step))
        mean = sum(np.exp(1j * part).sum(axis=0) for part in parts) / periods.periods
    nearest = round(turns)
    sizes = np.abs(np.fft.fft(mean, norm="forward"))
    return Synchronism(
        turns=turns,
        slip=(turns - nearest) * omega0 * length,
        drift=drift,
        loss=float(1 - sizes[nearest % size]),
        leakage=np.where(periods.harmonics == nearest, 0.0, sizes[periods.harmonics]),
    )


def rotation_warnings(periods: PeriodicRecord) -> tuple[str, ...]:
    """Say how far a rotation leaks into the lines of the period as they were recorded."""
    if periods.speed == 0:
        return ()
    found = synchronism(periods)
    worst = int(np.argmax(found.leakage))
    if found.loss < NOTICED and found.leakage[worst] < NOTICED:
        return ()
    line = periods.frequency[worst]
    return (
        f"the rotation is not synchronous with the excitation: {found.turns:.6g} revolutions per "
        f"period, {np.degrees(found.slip):.3g} degrees off over {periods.periods} periods, the "
        f"speed changing by {abs(found.drift) / (2 * np.pi) * 60:.3g} rpm; the line of the "
        f"unbalance loses {100 * found.loss:.2g} % and leaks up to "
        f"{100 * found.leakage[worst]:.2g} % into the line at {line:g} Hz",
    )


TONE = 200.0
"""Power over the median around it from which on a line is a tone: noise in 100,000 lines has 25."""
STEADY = 0.3
"""Difference between a tone's amplitudes in the two halves of the record, over their mean, up to
which it is one: random vibration of a light mode comes and goes."""
ALONE = 5.0
"""Size of a line on the grid over the next from which on it is no distortion, which spreads."""
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
RESTLESS = 4.0
"""Variance of a rotation's phase between periods over that of its amplitude from which on it is no
noise, and over one by their number from which on it takes more of the line, half of it, than the
deviation of that: what a drive's control leaves is less."""
BY_CHANCE = 1e-6
"""Chance with which noise has such a ratio; noise that carries over from period to period, more."""
SIDEBAND = 6.0
"""Lines of the whole record on each side of a kept one that a drift of it fills."""
SQUARE = np.radians(20.0)
"""Distance of two sensors' phases from a right angle within which a tone is an orbit: hum comes
from one source, and stands in all sensors with one phase or its opposite."""
ROUND = 2.0
"""Ratio of the axes of an orbit of a rotor: bearings are alike in x and y to a factor of two."""
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
    sensors = sensors_of(record.channels)
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
        if periods is not None:
            spacing = record.sample_rate / len(rest)
            clear = [t for t in clear if not _is_ghost(t, clear[0], periods, spacing)]
            # So close to a kept line a slow change of that makes it.
            lines = periods.frequency[~periods.on_rotation]
            near = [(np.abs(lines - t.frequency) < SIDEBAND * spacing).any() for t in clear]
            clear = [t for t, beside in zip(clear, near, strict=True) if not beside]
        found += clear
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
        first = first_used(record, periods)
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
    """Return the power of a windowed signal of one channel, and its floor around each line."""
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
        top = top_of(*np.log(np.maximum(power[k - 1 : k + 2], 1e-300)))
        turns = _steady(rest, float(k + top) / len(rest))
        if turns is not None:
            found.append(Tone(turns * rate, float(power[k] / floor[k]), name))
    return found


def _is_ghost(tone: Tone, strongest: Tone, periods: PeriodicRecord, spacing: float) -> bool:
    """Tell whether a tone on the grid is what the mean over periods holds of a stronger one."""
    turns = tone.frequency / periods.fundamental
    near = abs(turns - round(turns)) * periods.fundamental < 2 * spacing
    return near and tone.strength <= GHOST * strongest.strength


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


@record_check(
    "speed", "no line contradicts the speed", "given period", needs=lambda seen: seen.untorn
)
def check_speed(seen: Seen) -> list[Note]:
    record, periods = seen.record, seen.periods
    given = abs(record.speed) / _TURN
    found = tones(record, periods)
    if not found:
        return []
    width = 1.5 * record.sample_rate / min(len(record.samples), _MOST)
    if given == 0:
        text = (
            f"a line at {found[0].frequency:.6g} Hz that is not excited, while the speed is 0: "
            "give the speed if it is the rotation; else hum, or another machine"
        )
        return [Note("speed", "says", text, on=(found[0].channel,))]
    if any(abs(tone.frequency - given) <= width for tone in found) or _is_shown(periods):
        return []
    orders = [max(1, round(tone.frequency / given)) for tone in found]
    others = [
        tone
        for tone, n in zip(found, orders, strict=True)
        if not (1 < n <= 10 and abs(tone.frequency - n * given) <= n * width)
    ]
    if not others:
        return []
    orbits = others[0].strength > CLEAR and _orbits(record, periods, others[0])
    excited = periods is not None and (np.abs(periods.frequency - given) < 2 * width).any()
    if record.angle is not None:
        told = (
            f"the clearest line stands at {others[0].frequency:.6g} Hz, the mark tells a rotation "
            f"at {given:.6g} Hz, where nothing stands: count its pulses per revolution"
        )
        return [Note("speed", "says", told, on=(others[0].channel,))]
    return [_wrong_speed(others, given, bool(excited and not orbits))]


def _is_shown(periods: PeriodicRecord | None) -> bool:
    """Tell whether a rotation beside the periods stands out of the noise, as only the right can."""
    if periods is None or periods.rotation is None:
        return False
    own = periods.rotation.spectra
    noise = own.std(axis=0) / np.sqrt(len(own))
    return bool((np.abs(own.mean(axis=0)) ** 2 > TONE * noise**2).any())


def _orbits(record: Record, periods: PeriodicRecord | None, tone: Tone) -> bool:
    """Tell whether a tone goes round: half of the sensors that show it have one square to them."""
    sensors = sensors_of(record.channels)
    size = np.array([_amplitude(record, periods, c, tone.frequency) for c in sensors])
    found = np.abs(size) > np.abs(size).max() / ROUND**2
    size = size[found]
    ratio = size[:, None] / size
    square = np.abs(np.abs(np.angle(ratio)) - np.pi / 2) < SQUARE
    alike = np.abs(np.log(np.abs(ratio))) < np.log(ROUND)
    return bool((square & alike).any(axis=1).mean() >= 0.5)


def _amplitude(record: Record, periods: PeriodicRecord | None, c: int, frequency: float) -> complex:
    rest, length = _rest(record, periods, c)[0], 0 if periods is None else periods.samples
    wave = np.exp(-2j * np.pi * frequency / record.sample_rate * np.arange(len(rest)))
    found = complex((_window(len(rest)) * rest) @ wave) / len(rest) * 2
    turns = frequency * length / record.sample_rate
    if periods is not None and abs(turns - round(turns)) < ON_GRID:  # it is in the mean
        found += complex(periods.mean[:, c] @ wave[:length]) / length * 2
    return found


@period_check("wander", "the line of the rotation scatters as the others do")
def check_wander(periods: PeriodicRecord) -> list[Note]:
    if periods.rotation is not None:
        return _wandering(periods, periods.rotation.spectra)
    on, others = np.flatnonzero(periods.on_rotation), np.flatnonzero(~periods.on_rotation)
    if not periods.speed or not len(on) or len(others) < 2 or periods.periods < 4:
        return []
    apart = periods.spectra - periods.mean_spectrum
    own, variance = apart[:, on[0]], (np.abs(apart[:, others]) ** 2).mean(axis=0)
    level = np.sqrt((np.abs(periods.mean_spectrum) ** 2).mean(axis=0))
    usual = np.maximum(median(variance, axis=0), (NO_SCATTER * level) ** 2)
    # The speed moves a line in one phase, or slowly; a tone between the lines goes round.
    slow, fixed = (own[1:] * own[:-1].conj()).real.mean(axis=0), np.abs((own**2).mean(axis=0))
    ratio = np.maximum(slow, fixed) / np.where(usual > 0, usual, np.inf)
    worst = int(np.argmax(ratio))
    if ratio[worst] < WANDER:
        return []
    hertz = periods.frequency[on[0]]
    text = (
        f"the line of the rotation, {hertz:g} Hz, scatters between periods {ratio[worst]:.3g} "
        "times as much as the others (variance): the speed wanders or is not the one stated; "
        "measure the angle (encoder or keyphasor), or hold the speed"
    )
    return [Note("wander", "warns", text, on=(periods.names[worst],))]


def _wandering(periods: PeriodicRecord, own: Complexes) -> list[Note]:
    """Hold the phase of a line against its amplitude: noise moves both alike, the speed the one."""
    mean = own.mean(axis=0)
    clearest = int(np.argmax(np.abs(mean) / np.maximum(own.std(axis=0), 1e-300)))
    apart = own[:, clearest] / mean[clearest] - 1 if mean[clearest] else np.zeros(1, complex)
    phase, amplitude = float((apart.imag**2).mean()), float((apart.real**2).mean())
    chance = f_limit(BY_CHANCE, max(len(own) - 2, 1), max(len(own) - 2, 1))
    if phase < max(RESTLESS, chance) * amplitude or phase * len(own) < RESTLESS:
        return []
    text = (
        f"the rotation strays from its angle by {np.degrees(np.sqrt(phase)):.3g} degrees from "
        "period to period: the speed wanders or is not the one stated; measure the angle (encoder "
        "or keyphasor), or hold the speed"
    )
    return [Note("wander", "warns", text, on=(periods.names[clearest],))]


def _wrong_speed(found: list[Tone], given: float, hidden: bool) -> Note:
    near = [t for t in found if abs(t.frequency / given - 1) < NEAR]
    tone = near[0] if near else found[0]
    ratio = tone.frequency / given
    told = (
        f"the clearest line that is not excited stands at {tone.frequency:.6g} Hz "
        f"({60 * tone.frequency:.6g} rpm), the speed given is {given:.6g} Hz ({60 * given:.6g} rpm)"
    )
    mistakes = [what for factor, what in _UNITS if abs(ratio / factor - 1) < SAME_UNIT]
    if mistakes:
        why = f": {mistakes[0]}?"
    elif near:
        why = ": give the speed that the record shows"
    elif hidden:
        why = ": mains interference, or the actual speed?"
    else:
        why = ", where nothing stands: give the speed at which the machine ran"
    severity: Severity = "says" if hidden and not mistakes and not near else "warns"
    return Note("speed", severity, told + why, on=(tone.channel,), value=tone.frequency, unit="Hz")


AROUND = 12
"""Lines on each side of the strongest that tell where the tone stands."""
APART = 1.5
"""Lines within which a tone stands in place of the rotation as stated; further off, beside it."""
GRID = 41
"""Places within a line of the strongest that are tried before the best is refined."""
MUCH = 4.0
"""How much less power the tone leaves in each channel, on average, at a speed other than the one
stated and less than APART from it. A speed that wanders, or a second tone, gains less than that."""


def shown_rotation(
    lines: Complexes, motion: Complexes, rotation: Complexes, standing_out: Integers, stated: float
) -> float | None:
    """Return where the lines show a rotation, in lines; None where that is as stated.

    `motion` is what motion follows besides, `rotation` what the rotation as stated puts there.
    """
    distance = np.abs(standing_out - stated)
    near = standing_out[distance < NEAR * stated]
    if not len(near):
        return None
    if distance.min() < AROUND and (moved := _moved(lines, motion, stated)) is not None:
        return moved
    apart = near[np.abs(near - stated) > APART]
    if not len(apart) or apart.max() + AROUND >= len(lines):  # before them there are plenty
        return None
    around = np.arange(apart.min() - AROUND, apart.max() + AROUND + 1)
    usual = np.median(np.abs(lines[around]) ** 2, axis=0)
    size = np.abs(lines[apart]) ** 2 / np.where(usual > 0, usual, np.inf)
    strongest = int(apart[size.sum(axis=1).argmax()])
    return _place(lines, np.column_stack([motion, rotation]), strongest)[0]


def _moved(lines: Complexes, motion: Complexes, stated: float) -> float | None:
    """Return a place within APART of the one stated that takes up much more; None without."""
    nearest = round(stated)
    if nearest + AROUND >= len(lines):
        return None
    window = np.arange(nearest - AROUND, nearest + AROUND + 1)
    reach = APART - 1.0  # to each side; a place is looked for within a line of it
    tried = [_place(lines, motion, nearest, aside) for aside in (-reach, reach)]
    place, left = min(tried, key=lambda found: found[1])
    gain = _left(lines[window], motion[window], window, stated) - left
    near = abs(place - stated) <= APART
    return place if near and gain > np.log(MUCH) * lines.shape[1] else None


def _place(
    lines: Complexes, design: Complexes, middle: int, aside: float = 0.0
) -> tuple[float, float]:
    """Return where about a line a tone takes up most, and the logarithm of what it leaves."""
    window = np.arange(middle - AROUND, middle + AROUND + 1)
    misfit = partial(_left, lines[window], design[window], window)
    places = middle + aside + np.linspace(-1, 1, GRID)
    best = places[int(np.argmin(list(map(misfit, places))))]
    step = places[1] - places[0]
    found = scipy.optimize.minimize_scalar(
        misfit, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-5}
    )
    return float(found.x), float(found.fun)


def _left(lines: Complexes, design: Complexes, window: Integers, place: float) -> float:
    """Return the logarithm of what a tone at a place leaves, summed over the channels."""
    tone = np.where(window % 2, -1.0, 1.0) * np.sinc(window - place)
    columns = np.column_stack([design, tone])
    basis, _ = np.linalg.qr(columns / column_lengths(columns))
    left = lines - basis @ (basis.conj().T @ lines)
    return float(np.log(np.maximum((np.abs(left) ** 2).sum(axis=0), 1e-300)).sum())
