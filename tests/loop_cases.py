"""The shipped rig with one axis excited at a time: commands behind the sum, and what was added.

What the loop's sensitivity is exactly comes in closed form from rotor, hold and controller.
"""

from __future__ import annotations

import functools
import tempfile
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.signal
from rotor_bank import RATE, noisy_record

import rotorid as rid
from rotorid import load_rig
from rotorid.core.values import Complexes, Floats
from rotorid.results.sensitivity import zone_of
from rotorid.rig.rig import Rig, excitation_table
from rotorid.signals.multisine import Multisine

FUNDAMENTAL = 5.0
LAST = 50
"""Lines of 5 Hz: the peak of the loop lies between them."""


@functools.cache
def rig_of(stiffness: float = 2e5, damping: float = 800.0) -> Rig:
    """Return the shipped rig with other settings of its controllers, N/m and N s/m."""
    text = (resources.files("rotorid.rig") / "library" / "three-mass.toml").read_text()
    for old, new in (
        ('2e5 N/m"    #', f'{stiffness:g} N/m" #'),
        ("800 N s/m", f"{damping:g} N s/m"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rig.toml"
        file.write_text(text)
        return load_rig(file).rig


@dataclass(frozen=True)
class Loop:
    """One axis of a rig whose sensitivity is known exactly: on lines, and its peak."""

    lines: Floats
    sensitivity: Complexes
    peak: float


@functools.cache
def loop(stiffness: float, damping: float, axis: int = 0) -> Loop:
    """Return the loop of an axis, on lines of 5 Hz but those that the rotation has."""
    rig = rig_of(stiffness, damping)
    lines = FUNDAMENTAL * np.arange(1, LAST + 1)
    peak = np.abs(exact(np.arange(FUNDAMENTAL, FUNDAMENTAL * 10, 0.05), axis, rig)).max()
    return Loop(lines, exact(lines, axis, rig), float(peak))


def played(on: Loop, noise: float, periods: int, rng: np.random.Generator) -> rid.PeriodicRecord:
    """Return periods of e and r on the lines of a loop; S has the noise of `noise` on each."""
    harmonics = np.round(on.lines / FUNDAMENTAL).astype(int)
    r = np.exp(2j * np.pi * rng.random(len(harmonics)))
    mean = np.column_stack([on.sensitivity * r, r])
    channels = [rid.Channel("e"), rid.Channel("r")]
    samples = int(RATE / FUNDAMENTAL)
    # Of the mean over the periods, and of a complex number.
    scatter = np.array([noise * np.sqrt(periods * samples), 0.0])
    return noisy_record(channels, mean, scatter, harmonics, rng, 0.0, periods, samples)


@dataclass(frozen=True)
class Graded:
    """What became of a loop: its peak, what was found, and the interval."""

    peak: float
    found: float
    interval: tuple[float, float]

    @classmethod
    def of(cls, peak: float, axis: rid.AxisSensitivity) -> Graded:
        """Hold what was found against the peak."""
        return cls(peak, axis.peak, axis.interval)

    @property
    def wrong(self) -> bool:
        """Whether the zone is none of those named."""
        low, high = (zone_of(end) for end in self.interval)
        return not low <= zone_of(self.peak) <= high

    @property
    def undecided(self) -> bool:
        """Whether the interval lies across a limit."""
        return zone_of(self.interval[0]) != zone_of(self.interval[1])

    @property
    def off_db(self) -> float:
        """How far off the peak is, in dB."""
        return float(20 * np.log10(self.found / self.peak))

    @property
    def held(self) -> bool:
        """Whether the interval holds the peak."""
        return self.interval[0] <= self.peak <= self.interval[1]


STIFFNESS = (1.5e5, 2e5, 3e5)
DAMPING = tuple(np.geomspace(340.0, 900.0, 10).round().tolist())
"""Of controllers that make peaks of 1.9 to 6.3 on the shipped rotor: zones A to D."""


def by_periods(seed: int, noise: tuple[float, float] = (0.005, 0.03)) -> Graded:
    """Grade a random loop by its periods; S has noise of up to 3 percent of 1 on every line."""
    rng = np.random.default_rng([seed, 14839])
    on = loop(float(rng.choice(STIFFNESS)), float(rng.choice(DAMPING)))
    size = noise[0] * (noise[1] / noise[0]) ** rng.random()
    record = played(on, size, int(rng.integers(10, 40)), rng)
    return Graded.of(on.peak, rid.sensitivity(record, {"e": "r"})[0])


def by_noise(seed: int) -> list[Graded]:
    """Grade two coupled loops by a whole record with noise added to both commands.

    Each S is 1 beside a resonance whose peak is known exactly.
    """
    rng = np.random.default_rng([seed, 14840])
    samples, rate = 20000, 1000.0
    r = rng.standard_normal((samples, 2))
    e, peaks = [], []
    for j in range(2):
        b, a = scipy.signal.iirpeak(rng.uniform(40.0, 150.0), rng.uniform(2.0, 5.0), fs=rate)
        top = rng.uniform(1.0, 4.5) * np.asarray(b) + np.asarray(a)
        e.append(scipy.signal.lfilter(top, a, r[:, j]) + 0.1 * rng.standard_normal(samples))
        peaks.append(np.abs(scipy.signal.freqz(top, a, 20000)[1]).max())
    e[0] = e[0] + 0.2 * r[:, 1]
    channels = [rid.Channel(name) for name in ("e1", "e2", "r1", "r2")]
    record = rid.Record(channels, np.column_stack([*e, r]), sample_rate=rate)
    found = rid.sensitivity(record, {"e1": "r1", "e2": "r2"}, band=("20 Hz", "300 Hz"))
    return [Graded.of(peak, axis) for peak, axis in zip(peaks, found, strict=True)]


def sampled_loop(
    stiffness: float,
    rate: float,
    seconds: int,
    rng: np.random.Generator,
    damping: float = 14.0,
    gain: float = 1.0,
    noise: tuple[float, float] = (1e-7, 0.01),
) -> tuple[rid.Record, float]:
    """Return e and r of a mass on a spring under a sampled controller, and the peak of S.

    2 kg on 2e5 N/m, its damping in N s/m; the controller of `stiffness` in N/m and `rate` in
    N s/m with a lag of first order; noise of the sensor, which the loop takes round, and of e.
    """
    sampling, lag = 5000.0, 0.3
    plant = scipy.signal.cont2discrete(
        ([0.5], [1.0, damping / 2.0, 1e5]), 1 / sampling, method="zoh"
    )
    above, below = np.ravel(plant[0]), plant[1]
    kick = rate * sampling * lag
    acts = np.array([stiffness + kick, -stiffness * (1 - lag) - kick])
    lags = np.array([1.0, lag - 1])
    closed = np.polyadd(np.polymul(below, lags), np.polymul(above, acts))
    whole, back = np.polymul(below, lags), np.polymul(below, acts)
    count = round(seconds * sampling)
    lines = np.fft.rfftfreq(count, 1 / sampling)
    spectrum = np.fft.rfft(rng.standard_normal(count))
    r = np.fft.irfft(np.where((lines > 5) & (lines < 1500), spectrum, 0), count)
    r *= 3.0 / r.std()
    sensor, beside = rng.standard_normal((2, count)) * np.array(noise)[:, None]
    e = scipy.signal.lfilter(whole, closed, r) - scipy.signal.lfilter(back, closed, sensor) + beside
    exact = scipy.signal.freqz(whole, closed, np.arange(8, 400, 0.01), fs=sampling)[1]
    channels = [rid.Channel("e"), rid.Channel("r")]
    record = rid.Record(channels, np.column_stack([e, gain * r]), sample_rate=sampling)
    return record, float(np.abs(exact).max())


NARROW = ((1e4, 4.0, 12.0), (2e4, 10.0, 14.0), (3e4, 14.0, 14.0), (1.5e5, 100.0, 60.0))
"""Controllers and damping that make peaks of 2.46, 3.10, 3.90 and 2.89, 1.2 to 11 Hz wide."""


def by_few_lines(seed: int) -> Graded:
    """Grade a loop by a short record: its peak is narrower than windows of lines, or little more.

    Records of 2 to 8 s, noise of .1 to 3 percent and more at the peak.
    """
    rng = np.random.default_rng([seed, 14842])
    stiffness, rate, damping = NARROW[rng.integers(len(NARROW))]
    noise = (float(np.exp(rng.uniform(np.log(1e-7), np.log(2e-6)))), float(rng.uniform(0.01, 0.2)))
    seconds = int(rng.choice([2, 4, 8]))
    record, exact = sampled_loop(stiffness, rate, seconds, rng, damping, noise=noise)
    (axis,) = rid.sensitivity(record, {"e": "r"}, band=("8 Hz", "400 Hz"))
    return Graded.of(exact, axis)


def by_the_rig(seed: int, periods: int = 20) -> Graded:
    """Grade an axis of the shipped rig by a record of its simulation."""
    rng = np.random.default_rng([seed, 14841])
    axis = int(rng.integers(4))
    record = measured(excited(axis, FUNDAMENTAL, LAST, 3.0), periods, rng)
    cut = rid.average(record, FUNDAMENTAL, harmonics=list(range(1, LAST + 1)))
    return Graded.of(exact_peak(axis), rid.sensitivity(cut, pair(axis))[0])


def excited(axis: int, fundamental: float, count: int, amplitude: float) -> Rig:
    """Return the rig with a multisine on one axis."""
    rig = rig_of()
    harmonics = np.arange(1, count + 1)
    phases = np.exp(1j * np.pi * harmonics * (harmonics - 1) / count)  # Schroeder
    lines = np.zeros((count, len(rig.model.inputs)), dtype=complex)
    lines[:, axis] = amplitude * phases
    played = Multisine(fundamental, harmonics, lines, rig.model.inputs)
    return replace(rig, excitation=played)


def measured(rig: Rig, periods: int, rng: np.random.Generator) -> rid.Record:
    """Return what a logger has: commands behind the sum, and what was added to them."""
    assert rig.excitation is not None
    count = round(rig.logger.sample_rate / rig.excitation.fundamental)
    found = rig.run(periods * count / rig.logger.sample_rate, rng)
    names = list(rig.model.inputs)
    commands = found.samples[:, [found.names.index(name) for name in names]]
    table = excitation_table(rig)
    added = np.tile(table, (periods, 1))[: len(commands)]
    channels = [*(rid.Channel(f"e_{n}") for n in names), *(rid.Channel(f"r_{n}") for n in names)]
    return rid.Record(
        channels,
        np.column_stack([commands, added]),
        sample_rate=rig.logger.sample_rate,
        speed=found.speed,
    )


def pair(axis: int) -> dict[str, str]:
    """Return the channels of one axis."""
    name = rig_of().model.inputs[axis]
    return {f"e_{name}": f"r_{name}"}


def exact_peak(axis: int) -> float:
    """Return the peak of S_jj up to the last line."""
    return float(np.abs(exact(np.arange(FUNDAMENTAL, FUNDAMENTAL * LAST, 0.25), axis)).max())


def exact(frequency: np.ndarray, axis: int, of: Rig | None = None) -> np.ndarray:
    """Return S_jj of the sampled loop in closed form: ``(I - C P)^-1`` at exp(i omega T).

    P is the rotor between a command, held from `delay` after the instant of its reading for one
    period, and the next readings.
    """
    rig = rig_of() if of is None else of
    plant = rid.state_space(rig.model.substitute({}), speed=rig.rotation.speed)
    n, inputs = len(plant.A), len(plant.inputs)
    names = [name for name, _ in plant.states]
    where = [names.index(sensor) for sensor in rig.feedback]
    slope = np.array([part.slopes for part in rig.parts])  # ki and ks of each magnet
    a = plant.A + plant.B @ np.diag(slope[:, 1]) @ np.eye(n)[where]
    b = plant.B @ np.diag(slope[:, 0])
    period, late = rig.controller.period, rig.delay

    def held(time: float) -> tuple[np.ndarray, np.ndarray]:
        whole = scipy.linalg.expm(np.block([[a, b], [np.zeros((inputs, n + inputs))]]) * time)
        return whole[:n, :n], whole[:n, n:]

    (first, old), (second, new) = held(late), held(period - late)
    omega = 2 * np.pi * np.asarray(frequency)
    response = rig.controller.response(omega)
    found = []
    for w, c in zip(omega, response, strict=True):
        z = np.exp(1j * w * period)
        # x+ = Phi x + Gamma u of the last command, held till `late`, and of the new one.
        drive = second @ old / z + new
        p = np.linalg.solve(z * np.eye(n) - second @ first, drive)[where]
        found.append(np.linalg.inv(np.eye(inputs) - c @ p)[axis, axis])
    return np.array(found)
