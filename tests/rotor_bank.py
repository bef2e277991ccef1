"""Random rotors and structures, their lines made with numpy alone: what the solver is tried on.

Nothing here uses the project's own response, so that a sign or a scale wrong in both places shows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from model_text import model_text
from numpy.typing import NDArray

from rotorid import Channel, Model, PeriodicRecord, load_model, parse_model

Floats, Complexes = NDArray[np.float64], NDArray[np.complex128]

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


class Rotor(NamedTuple):
    """Matrices of a rotor: M q'' + (D + Omega G) q' + K q = B u + Omega^2 Re(U exp(i phi))."""

    M: Floats
    D: Floats
    G: Floats
    K: Floats
    B: Floats
    U: Complexes

    def load(self, speed: float, phi: Floats) -> Floats:
        """Return the load of the unbalance, shape (sample, coordinate)."""
        return speed**2 * np.outer(np.exp(1j * phi), self.U).real

    def response(self, omega: float, speed: float, load: Complexes) -> Complexes:
        """Return the motion of all coordinates at one frequency."""
        whole = -(omega**2) * self.M + 1j * omega * (self.D + speed * self.G) + self.K
        return np.asarray(np.linalg.solve(whole, load))

    def lines(self, speed: float, omega: Floats, force: Complexes) -> Complexes:
        """Return all coordinates on lines, under forces and unbalance, shape (line, coordinate)."""
        right = force @ self.B.T + 0j
        right[np.isclose(omega, speed)] += speed**2 * self.U / 2
        w = omega[:, None, None]
        whole = -(w**2) * self.M + 1j * w * (self.D + speed * self.G) + self.K
        return np.linalg.solve(whole, right[:, :, None])[..., 0]


def _unbalance(p: Mapping[str, float], mass: str) -> Complexes:
    static = p[mass] * (p["xi"] + 1j * p["zeta"])
    dynamic = (p["I_t"] - p["I_p"]) * (p["mu"] + 1j * p["eta"])
    return np.array([static, -1j * static, dynamic, -1j * dynamic])


def jeffcott_rotor(p: Mapping[str, float]) -> Rotor:
    """A disc on an elastic shaft: x, y."""
    two, load = np.eye(2), p["m"] * (p["xi"] + 1j * p["zeta"]) * np.array([1, -1j])
    return Rotor(p["m"] * two, p["c"] * two, 0 * two, p["k"] * two, two, load)


def rigid_rotor(p: Mapping[str, float]) -> Rotor:
    """A rigid rotor with a force at each bearing and axis: x, y, theta_x, theta_y."""
    M = np.diag([p["m"], p["m"], p["I_t"], p["I_t"]])
    G, zero = np.zeros((4, 4)), np.zeros((4, 4))
    G[2, 3], G[3, 2] = p["I_p"], -p["I_p"]
    a, b = p["L_a"], p["L_b"]
    B = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, a, 0, -b], [-a, 0, b, 0]], dtype=float)
    return Rotor(M, zero, G, zero, B, _unbalance(p, "m"))


def three_mass_rotor(p: Mapping[str, float]) -> Rotor:
    """The paper's rotor: x1 y1 x2 y2 theta_x theta_y x3 y3.

    V = k1/2 [(x1 - x2 + L1 ty)^2 + (y1 - y2 - L1 tx)^2]
      + k2/2 [(x2 - x3 + L2 ty)^2 + (y2 - y3 - L2 tx)^2], K its second derivatives.
    """
    M = np.diag([p[n] for n in ("m1", "m1", "m2", "m2", "I_t", "I_t", "m3", "m3")])
    K, G = np.zeros((8, 8)), np.zeros((8, 8))
    for k, stretch in (
        ("k1", [1, 0, -1, 0, 0, p["L1"], 0, 0]),
        ("k1", [0, 1, 0, -1, -p["L1"], 0, 0, 0]),
        ("k2", [0, 0, 1, 0, 0, p["L2"], -1, 0]),
        ("k2", [0, 0, 0, 1, -p["L2"], 0, 0, -1]),
    ):
        K += p[k] * np.outer(stretch, stretch)
    G[4, 5], G[5, 4] = p["I_p"], -p["I_p"]
    B = np.eye(8)[:, [0, 1, 6, 7]]
    return Rotor(M, np.zeros((8, 8)), G, K, B, np.pad(_unbalance(p, "m2"), 2))


def rotor_lines(p: Mapping[str, float], speed: float, omega: Floats, force: Complexes) -> Complexes:
    """Return the eight coordinates of the three-mass rotor, shape (line, coordinate)."""
    return three_mass_rotor(p).lines(speed, omega, force)


def noisy_record(
    channels: Sequence[Channel],
    mean: Complexes,
    noise: Floats,
    harmonics: Sequence[int],
    rng: np.random.Generator | None,
    speed: float = 0.0,
    periods: int = PERIODS,
    samples: int = SAMPLES,
    rate: float = RATE,
) -> PeriodicRecord:
    """Return periods of lines with white noise of a deviation per sample and channel."""
    spectra = np.repeat(mean[None], periods, axis=0)
    if rng is not None:
        drawn = rng.standard_normal((*spectra.shape, 2)).view(np.complex128)[..., 0]
        spectra = spectra + drawn * noise / np.sqrt(2 * samples)
    time = np.arange(samples)[None] / rate
    blank = np.zeros((samples, len(channels)))
    parts = (np.array(harmonics), spectra, blank, blank)
    return PeriodicRecord(tuple(channels), rate, *parts, speed, time, speed * time)


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


def model_of(equations: list[str], coordinates: list[str], units: Mapping[str, str]) -> Model:
    """Return a model with one input F and parameters above 0, by their units."""
    parameters = {name: f"+{unit}" for name, unit in units.items()}
    where = dict.fromkeys(coordinates, "m")
    return parse_model(model_text("a structure", equations, where, "F N", parameters))


@dataclass(frozen=True)
class Structure:
    """A chain of masses on springs, one end held: a tower, lightly damped."""

    modes: int = 5
    off: float = 0.1
    lines: int = 240
    noise: float = 0.01

    def model(self) -> Model:
        """Return the equations, damping in proportion to masses and stiffnesses."""
        equations, n = [], self.modes
        for i in range(1, n + 1):
            below = f"q{i} - q{i - 1}" if i > 1 else "q1"
            rate = f"q{i}' - q{i - 1}'" if i > 1 else "q1'"
            text = f"m{i}*q{i}'' + alpha*m{i}*q{i}' + k{i}*({below}) + beta*k{i}*({rate})"
            if i < n:
                text += f" - k{i + 1}*(q{i + 1} - q{i}) - beta*k{i + 1}*(q{i + 1}' - q{i}')"
            equations.append(f"{text} = {'F' if i == n else '0'}")
        kinds = (("m", "kg"), ("k", "N/m"))
        units = {f"{kind}{i}": unit for kind, unit in kinds for i in range(1, n + 1)}
        coordinates = [f"q{i}" for i in range(1, n + 1)]
        return model_of(equations, coordinates, {**units, "alpha": "1/s", "beta": "s"})


def chain_response(p: Mapping[str, float], n: int, omega: Floats) -> Complexes:
    """Return the motion of each mass for a unit force on the last, shape (line, mass)."""
    inertia = np.diag([p[f"m{i}"] for i in range(1, n + 1)])
    stiffness = np.zeros((n, n))
    for i in range(n):
        row = np.eye(n)[i] - (np.eye(n)[i - 1] if i else 0)
        stiffness += p[f"k{i + 1}"] * np.outer(row, row)
    damping = p["alpha"] * inertia + p["beta"] * stiffness
    w = omega[:, None, None]
    force = np.zeros((len(omega), n, 1), dtype=complex)
    force[:, -1] = 1.0
    return np.linalg.solve(-(w**2) * inertia + 1j * w * damping + stiffness, force)[..., 0]


def structure_case(structure: Structure, seed: int) -> Case:
    """Return a random tower, its record and a start some way off in frequency."""
    n, rng = structure.modes, np.random.default_rng([seed, 7])
    truth = {f"m{i}": 100 * np.exp(0.2 * rng.standard_normal()) for i in range(1, n + 1)}
    truth |= {f"k{i}": 1e6 * np.exp(0.2 * rng.standard_normal()) for i in range(1, n + 1)}
    low, high = 100 * np.pi / (2 * n + 1), 200.0
    ratio = rng.uniform(0.003, 0.01)
    truth |= {"alpha": ratio * low, "beta": ratio / high}
    harmonics = np.arange(1, structure.lines + 1)
    samples = 4 * structure.lines
    fundamental = 1.15 * high / (2 * np.pi) / structure.lines
    omega = 2 * np.pi * fundamental * harmonics
    force = 50 * np.exp(2j * np.pi * rng.random((len(harmonics), 1)))
    sensors = sorted({1, (n + 1) // 2, n}) if n > 2 else [1, 2]
    motion = (force * chain_response(truth, n, omega))[:, [i - 1 for i in sensors]]
    mean = np.concatenate([force, motion], axis=1)
    size = np.median(np.abs(mean), axis=0) * np.sqrt(samples)
    noise = size * structure.noise * np.array([0.1] + [1.0] * len(sensors))
    model = structure.model()
    channels = [Channel("F", "N"), *(Channel(f"q{i}", "m") for i in sensors)]
    drawn = (rng, 0.0, 30, samples, fundamental * samples)
    record = noisy_record(channels, mean, noise, harmonics, *drawn)
    common = (1 + structure.off * rng.choice([-1, 1])) ** 2
    start = {k: v * (1 + 0.05 * rng.uniform(-1, 1)) for k, v in truth.items()}
    start |= {f"k{i}": common * start[f"k{i}"] for i in range(1, n + 1)}
    start |= {name: truth[name] * 2 ** rng.uniform(-1, 1) for name in ("alpha", "beta")}
    return Case(model, truth, (record,), {}, start)


def modal_case(structure: Structure, seed: int) -> Case:
    """Return an aircraft-like structure: modes of known shape, unknown mass, stiffness, damping."""
    n, rng = structure.modes, np.random.default_rng([seed, 8])
    hertz = 5 * np.cumprod(1 + rng.uniform(0.15, 0.5, n))
    ratio = rng.uniform(0.003, 0.01, n)
    shapes = rng.uniform(0.3, 1, (3, n)) * rng.choice([-1, 1], (3, n))
    mass = np.exp(0.3 * rng.standard_normal(n)) * 20
    names = [f"q{i}" for i in range(1, n + 1)]
    equations = [
        f"m{i}*q{i}'' + c{i}*q{i}' + k{i}*q{i} = {shapes[0, i - 1]:.17g}*F" for i in range(1, n + 1)
    ]
    kinds = {"m": "kg", "k": "N/m", "c": "N s/m"}.items()
    units = {f"{kind}{i}": unit for kind, unit in kinds for i in range(1, n + 1)}
    model = model_of(equations, names, units)
    w = 2 * np.pi * hertz
    truth = {f"m{i + 1}": mass[i] for i in range(n)}
    truth |= {f"k{i + 1}": mass[i] * w[i] ** 2 for i in range(n)}
    truth |= {f"c{i + 1}": 2 * ratio[i] * mass[i] * w[i] for i in range(n)}
    fundamental = 1.2 * hertz[-1] / structure.lines
    harmonics = np.arange(int(4 / fundamental), structure.lines + 1)
    omega = 2 * np.pi * fundamental * harmonics[:, None]
    force = 50 * np.exp(2j * np.pi * rng.random((len(harmonics), 1)))
    modes = shapes[0] / (mass * (w**2 - omega**2 + 2j * ratio * w * omega)) * force
    mean = np.concatenate([force, modes @ shapes.T], axis=1)
    samples = 4 * structure.lines
    noise = np.median(np.abs(mean), axis=0) * np.sqrt(samples) * structure.noise
    channels = [Channel("F", "N")]
    for j, row in enumerate(shapes):
        channels.append(Channel(f"s{j}", "m", reads=dict(zip(names, row.tolist(), strict=True))))
    noise = noise * np.array([0.1, 1, 1, 1])
    drawn = (rng, 0.0, 30, samples, fundamental * samples)
    record = noisy_record(channels, mean, noise, harmonics, *drawn)
    start = {k: v * (1 + 0.05 * rng.uniform(-1, 1)) for k, v in truth.items()}
    for i in range(1, n + 1):
        start[f"k{i}"] *= (1 + structure.off * rng.choice([-1, 1])) ** 2
        start[f"c{i}"] *= 2 ** rng.uniform(-1, 1)
    return Case(model, truth, (record,), {}, start)
