"""Records without periods of machines that are not linear, with known truth.

The motion is chosen, the force follows from the equations: no solver, no start-up.
"""

import numpy as np
from linear_machines import written
from scipy.signal import lfilter

import rotorid as rid

AXIS = rid.load_model("emps")
AXIS_TRUE = {"M": 95.0, "Fv": 200.0, "Fc": 20.0, "offset": -3.0}
SPRING, UNITS = ["m*x'' + d*x' + k*x + h*x^3 = F"], "m kg, d N s/m, k N/m, h N/m^3"
DUFFING = written("a hardening spring", SPRING, "x m", "F N", UNITS)
DUFFING_TRUE = {"m": 2.0, "d": 8.0, "k": 800.0, "h": 4e5}


def motion(
    rng: np.random.Generator, seconds: float, rate: float, band: tuple[float, float], size: float
) -> tuple[np.ndarray, ...]:
    """Return position, velocity and acceleration of waves whose frequencies do not repeat."""
    waves = 14
    time = np.arange(int(seconds * rate)) / rate
    omega = 2 * np.pi * rng.uniform(*band, waves)
    turn = np.outer(time, omega) + rng.uniform(0, 2 * np.pi, waves)
    part = size * rng.uniform(0.5, 1, waves) * np.sqrt(2 / waves)
    return np.sin(turn) @ part, np.cos(turn) @ (part * omega), -np.sin(turn) @ (part * omega**2)


def coloured(
    rng: np.random.Generator, count: int, std: float, seconds: float, rate: float
) -> np.ndarray:
    """Return noise that remembers itself for so many seconds."""
    memory = np.exp(-1 / (seconds * rate))
    return std * lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.standard_normal(count))


def measured(force: np.ndarray, position: np.ndarray, names: tuple[str, str], rate: float):
    channels = [rid.Channel(names[0], "N"), rid.Channel(names[1], "m")]
    return rid.Record(channels, np.column_stack([force, position]), rate)


def axis_force(velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    t = AXIS_TRUE
    return t["M"] * acceleration + t["Fv"] * velocity + t["Fc"] * np.sign(velocity) + t["offset"]


def presliding(velocity: np.ndarray, rate: float, way: float) -> np.ndarray:
    """Return Dahl's friction, of size 1, which turns within a way of `way`."""
    found, z = np.zeros(len(velocity)), 0.0
    for k, v in enumerate(velocity):
        z += (v - abs(v) * z) / (way * rate)
        found[k] = z
    return found


UNMODELLED = {
    "spring": lambda q, v, a: q,
    "hardening": lambda q, v, a: q**3,
    "drag": lambda q, v, a: v * np.abs(v),
    "one-sided": lambda q, v, a: np.abs(v),
    "stribeck": lambda q, v, a: np.exp(-np.abs(v) / 0.03) * np.sign(v),
    "load": lambda q, v, a: np.abs(a) * np.sign(v),
    "varying mass": lambda q, v, a: q * a,
    "cogging": lambda q, v, a: np.sin(2 * np.pi * q / 0.02),
    "long cogging": lambda q, v, a: np.sin(2 * np.pi * q / 0.2),
    "stroke": lambda q, v, a: q * np.sign(v),
    "pre-sliding": lambda q, v, a: presliding(v, 1000.0, 5e-3),
}


def axis(
    rng: np.random.Generator,
    *,
    lacks: str = "",
    share: float = 0.1,
    seconds: float = 15.0,
    noise: float = 4.0,
    memory: float = 0.05,
    position_noise: float = 1e-6,
) -> rid.Record:
    """Return a record of an axis with Coulomb friction, `share` of the force besides unmodelled."""
    q, v, a = motion(rng, seconds, 1000.0, (0.2, 2.5), 0.05)
    force = axis_force(v, a)
    if lacks:
        more = UNMODELLED[lacks](q, v, a)
        force += share * np.sqrt((force**2).mean() / (more**2).mean()) * more
    force += coloured(rng, len(q), noise, memory, 1000.0)
    return measured(force, q + position_noise * rng.standard_normal(len(q)), ("F", "q"), 1000.0)


def duffing(
    rng: np.random.Generator, *, noise: float = 1.0, position_noise: float = 1e-6
) -> rid.Record:
    """Return a record of a mass on a hardening spring."""
    x, v, a = motion(rng, 10.0, 1000.0, (1.0, 6.0), 0.03)
    t = DUFFING_TRUE
    force = t["m"] * a + t["d"] * v + t["k"] * x + t["h"] * x**3
    force += coloured(rng, len(x), noise, 0.02, 1000.0)
    return measured(force, x + position_noise * rng.standard_normal(len(x)), ("F", "x"), 1000.0)


def dwelling(rng: np.random.Generator, *, moves: int = 14, noise: float = 1.0) -> rid.Record:
    """Return a record of the axis that moves and rests; at rest friction is any up to Fc."""
    rate, parts, at = 1000.0, [], 0.0
    for number in range(moves):
        count = int(rng.uniform(0.4, 0.9) * rate)
        s, seconds = np.arange(count) / count, count / rate
        way = rng.uniform(0.05, 0.15) * (-1) ** number
        q = at + way * (10 * s**3 - 15 * s**4 + 6 * s**5)
        v = way * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds
        a = way * (60 * s - 180 * s**2 + 120 * s**3) / seconds**2
        parts.append(np.column_stack([axis_force(v, a), q]))
        at += way
        rest = int(rng.uniform(0.3, 0.9) * rate)
        held = AXIS_TRUE["offset"] + rng.uniform(-14, 14)
        parts.append(np.column_stack([np.full(rest, held), np.full(rest, at)]))
    samples = np.concatenate(parts)
    force = samples[:, 0] + coloured(rng, len(samples), noise, 0.05, rate)
    position = samples[:, 1] + 1e-6 * rng.standard_normal(len(samples))
    return measured(force, position, ("F", "q"), rate)
