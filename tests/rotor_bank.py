"""Random rotors and structures, their lines made with numpy alone: what the solver is tried on.

Nothing here uses the project's own response, so that a sign or a scale wrong in both places shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.models import Model, load_model
from rotorid.record import Channel, Complexes, Floats, PeriodicRecord

PERIODS = 260
SAMPLES = 250
RATE = 5000.0
COORDINATES = ("x1", "y1", "x2", "y2", "theta_x", "theta_y", "x3", "y3")
INPUTS = ("F_x1", "F_y1", "F_x3", "F_y3")
UNBALANCE = ("xi", "zeta", "mu", "eta")
BEARINGS = ("x1", "y1", "x3", "y3")
SENSORS = {8: COORDINATES, 5: (*BEARINGS, "x2"), 4: BEARINGS}
PAPER = {
    "m1": 0.83339, "m2": 11.322, "m3": 0.83339, "I_t": 2.5425e-2, "I_p": 4.8275e-2,
    "k1": 8.8357e5, "k2": 8.8357e5, "L1": 0.3, "L2": 0.3,
    "xi": 8.802e-06, "zeta": 1.5245e-05, "mu": 7.4346e-05, "eta": 1.28767e-4,
}  # fmt: skip


def random_rotor(rng: np.random.Generator, spread: float = 0.3) -> dict[str, float]:
    """Return the paper's rotor, each value times exp(spread * normal), unbalance of any sign."""
    values = {n: v * np.exp(spread * rng.standard_normal()) for n, v in PAPER.items()}
    return {n: v * (rng.choice([-1, 1]) if n in UNBALANCE else 1) for n, v in values.items()}


def rotor_lines(p: Mapping[str, float], speed: float, omega: Floats, force: Complexes) -> Complexes:
    """Return the eight coordinates of the three-mass rotor, shape (line, coordinate)."""
    inertia = np.diag([p[n] for n in ("m1", "m1", "m2", "m2", "I_t", "I_t", "m3", "m3")])
    gyro, stiffness = np.zeros((8, 8)), np.zeros((8, 8))
    gyro[4, 5], gyro[5, 4] = p["I_p"] * speed, -p["I_p"] * speed
    springs = (
        ("k1", {0: 1.0, 2: -1.0, 5: p["L1"]}), ("k1", {1: 1.0, 3: -1.0, 4: -p["L1"]}),
        ("k2", {2: 1.0, 6: -1.0, 5: p["L2"]}), ("k2", {3: 1.0, 7: -1.0, 4: -p["L2"]}),
    )  # fmt: skip
    for name, entries in springs:
        row = np.zeros(8)
        row[list(entries)] = list(entries.values())
        stiffness += p[name] * np.outer(row, row)
    right = np.zeros((len(omega), 8), dtype=complex)
    right[:, [0, 1, 6, 7]] = force
    static = p["m2"] * speed**2 * (p["xi"] + 1j * p["zeta"]) / 2
    dynamic = (p["I_t"] - p["I_p"]) * speed**2 * (p["mu"] + 1j * p["eta"]) / 2
    right[np.isclose(omega, speed), 2:6] += [static, -1j * static, dynamic, -1j * dynamic]
    w = omega[:, None, None]
    return np.linalg.solve(-(w**2) * inertia + 1j * w * gyro + stiffness, right[:, :, None])[..., 0]


def noisy_record(
    channels: Sequence[Channel],
    mean: Complexes,
    noise: Floats,
    harmonics: Sequence[int],
    rng: np.random.Generator | None,
    speed: float = 0.0,
    periods: int = PERIODS,
    samples: int = SAMPLES,
) -> PeriodicRecord:
    """Return periods of lines with white noise of a deviation per sample and channel."""
    spectra = np.repeat(mean[None], periods, axis=0)
    if rng is not None:
        drawn = rng.standard_normal((*spectra.shape, 2)).view(np.complex128)[..., 0]
        spectra = spectra + drawn * noise / np.sqrt(2 * samples)
    time = np.arange(samples)[None] / RATE
    blank = np.zeros((samples, len(channels)))
    return PeriodicRecord(
        tuple(channels), RATE, np.array(harmonics), spectra, blank, blank, speed, time, speed * time
    )


@dataclass(frozen=True)
class Setting:
    """One way to run a random rotor."""

    sensors: int = 4
    hertz: float = 140.0
    spread: float = 0.4
    single: bool = False
    noise: float = 1.0
    amplitude: float = 10.0
    log_uniform: bool = False
    machine: float = 0.3
    share: float | None = None

    @property
    def fixed_names(self) -> tuple[str, ...]:
        """What the records cannot tell: the unit of angle, and at rest what turns."""
        rest = ("I_p", *UNBALANCE) if self.hertz == 0 else ()
        return (*(("L1",) if self.sensors < 8 else ()), *rest)


@dataclass(frozen=True)
class Case:
    """A machine, its records, and where to start."""

    model: Model
    truth: Mapping[str, float]
    records: tuple[PeriodicRecord, ...]
    fixed: Mapping[str, float]
    start: Mapping[str, float]


def rotor_case(setting: Setting, seed: int) -> Case:
    """Return a random rotor in a setting."""
    rng = np.random.default_rng([seed, 20260101])
    model = load_model("three-mass")
    truth = random_rotor(rng, setting.machine)
    harmonics = (1, 3, 5, 7, 9, 11)
    omega = 2 * np.pi * 20.0 * np.array(harmonics)
    speed = 2 * np.pi * setting.hertz
    amplitude = setting.amplitude * np.exp(0.5 * rng.standard_normal(4)) / 2
    force = amplitude * np.exp(2j * np.pi * rng.random((6, 4)))
    if setting.share is not None:
        force = setting.amplitude / 2 * np.exp(2j * np.pi * rng.random((6, 1))) * np.ones(4)
        force[:, 2:] *= setting.share
    sensors = SENSORS[setting.sensors]
    channels = [Channel(n, model.units[n]) for n in (*INPUTS, *sensors)]
    noise = setting.noise * np.array([1.0] * 4 + [22e-6] * len(sensors))
    where = [COORDINATES.index(n) for n in sensors]
    parts = [np.eye(4)[k] for k in range(4)] if setting.single else [np.ones(4)]
    records = []
    for part in parts:
        motion = rotor_lines(truth, speed, omega, force * part)[:, where]
        mean = np.concatenate([force * part, motion], axis=1)
        records.append(noisy_record(channels, mean, noise, harmonics, rng, speed))
    fixed = {n: truth[n] for n in setting.fixed_names}
    start = {}
    for name, value in truth.items():
        if name not in fixed and name not in UNBALANCE:
            turn = rng.uniform(-1, 1)
            most = 1 + setting.spread
            factor = most**turn if setting.log_uniform else 1 + setting.spread * turn
            start[name] = value * factor
    return Case(model, truth, tuple(records), fixed, start)


SETTINGS = {
    f"{n} sensors, {label}": Setting(sensors=n, **options)
    for n in (8, 5, 4)
    for label, options in (
        ("+-40 %", {}),
        ("+-60 %", {"spread": 0.6}),
        ("standstill, +-40 %", {"hertz": 0.0}),
        ("standstill, +-60 %", {"hertz": 0.0, "spread": 0.6}),
        ("one axis at a time", {"single": True}),
        ("standstill, one axis at a time", {"single": True, "hertz": 0.0}),
        ("weak excitation", {"amplitude": 2.0}),
        ("noise x 10", {"noise": 10.0}),
    )
}

ADVERSE = {
    "standstill, equal forces": Setting(hertz=0.0, machine=0.0, share=1.0),
    "standstill, F3 = .95 F1": Setting(hertz=0.0, machine=0.0, share=0.95),
    "140 Hz, equal forces": Setting(machine=0.0, share=1.0),
    "140 Hz, F3 = .95 F1": Setting(machine=0.0, share=0.95),
    "random rotor, noise x 10": Setting(noise=10.0),
    "random rotor, noise x 10, five": Setting(noise=10.0, sensors=5),
}
