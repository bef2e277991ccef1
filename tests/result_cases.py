"""Machines whose results are used, each with its truth: rotors to balance, rotors with close modes.

Their lines are made with numpy alone, and what should come out is in closed form or by another
solver than the package's own.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
from linear_machines import SUPPORTED
from rotor_bank import RATE, noisy_record

import rotorid as rid
from rotorid import Drive
from rotorid.core.values import Complexes, Floats
from rotorid.likelihood.inference import Inference
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.solver import Solution, solve
from rotorid.results.machine import machine_of
from rotorid.results.modes import critical_speeds
from rotorid.testing import bind_all

HARMONICS = (1, 3, 5, 7, 9, 11)
OMEGA = 2 * np.pi * 20.0 * np.array(HARMONICS)
PLANES = ["F_xa,F_ya", "F_xb,F_yb"]
PERIODS = 100
KS = 2e5


@dataclass(frozen=True)
class Balanced:
    """What became of one rotor: status, the amounts before, left and stated, (plane,)."""

    status: str
    before: Floats = field(default_factory=lambda: np.zeros(0))
    left: Floats = field(default_factory=lambda: np.zeros(0))
    stated: Floats = field(default_factory=lambda: np.zeros(0))


def rigid_lines(p: Mapping[str, float], speed: float, force: Complexes) -> Complexes:
    """Return x, y, theta_x, theta_y of a free rigid rotor on the lines."""
    inertia = np.diag([p["m"], p["m"], p["I_t"], p["I_t"]])
    gyro = np.zeros((4, 4))
    gyro[2, 3], gyro[3, 2] = p["I_p"] * speed, -p["I_p"] * speed
    a, b = p["L_a"], p["L_b"]
    push = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, a, 0, -b], [-a, 0, b, 0]])
    right = force @ push.T + 0j
    static = p["m"] * speed**2 * (p["xi"] + 1j * p["zeta"]) / 2
    dynamic = (p["I_t"] - p["I_p"]) * speed**2 * (p["mu"] + 1j * p["eta"]) / 2
    right[np.isclose(OMEGA, speed)] += [static, -1j * static, dynamic, -1j * dynamic]
    w = OMEGA[:, None, None]
    return np.linalg.solve(-(w**2) * inertia + 1j * w * gyro, right[:, :, None])[..., 0]


def in_planes(p: Mapping[str, float]) -> Complexes:
    """Return the unbalance of a rigid rotor in the planes of its bearings, kg m."""
    force = p["m"] * (p["xi"] + 1j * p["zeta"])
    moment = (p["I_t"] - p["I_p"]) * (p["mu"] + 1j * p["eta"])
    matrix = np.array([[1, 1], [-1j * p["L_a"], 1j * p["L_b"]]])
    return np.linalg.solve(matrix, np.array([force, moment]))


def balanced(seed: int) -> Balanced:
    """Identify and balance a random rigid rotor: four sensors with runout, unknown k_i, two speeds.

    Known are its mass, by weighing, and where its bearings are.
    """
    rng = np.random.default_rng([seed, 12])
    model = rid.load_model("rigid")
    truth = {n: v * np.exp(0.2 * rng.standard_normal()) for n, v in model.nominal.items()}
    for name in ("xi", "zeta", "mu", "eta"):
        truth[name] *= rng.choice([-1, 1])
    ki = 120.0 * (1 + 0.05 * rng.standard_normal(4))
    runout = 8e-6 * (rng.standard_normal(4) + 1j * rng.standard_normal(4)) / 2
    a, b = truth["L_a"], truth["L_b"]
    reads = np.array([[1, 0, 0, -a], [0, 1, a, 0], [1, 0, 0, b], [0, 1, -b, 0]])
    names = ("s_xa", "s_ya", "s_xb", "s_yb")
    shares = [
        {q: float(c) for q, c in zip(model.coordinates, row, strict=True) if c} for row in reads
    ]
    drives = zip(model.inputs, shares, strict=True)
    channels = [rid.Channel(n, "N", drive=Drive(120.0, KS, position=s)) for n, s in drives]
    channels += [rid.Channel(n, "m", reads=s) for n, s in zip(names, shares, strict=True)]
    records = []
    for hertz in (140.0, 100.0):
        speed = 2 * np.pi * hertz
        force = 6.0 * np.exp(0.3 * rng.standard_normal(4) + 2j * np.pi * rng.random((6, 4)))
        there = rigid_lines(truth, speed, force) @ reads.T
        seen = there + np.where(np.isclose(OMEGA, speed)[:, None], runout / 2, 0)
        current = (force - KS * there) / ki
        noise = np.array([5e-4] * 4 + [5e-7] * 4)
        mean = np.concatenate([current, seen], axis=1)
        records.append(noisy_record(channels, mean, noise, HARMONICS, rng, speed, PERIODS))
    start = {n: truth[n] * rng.uniform(0.8, 1.2) for n in ("I_t", "I_p")}
    estimator = rid.MaximumLikelihood(
        fixed={n: truth[n] for n in ("m", "L_a", "L_b")}, start=start, runout=True, gains=("ki",)
    )
    estimate = rid.identify(model, records, estimator)
    if estimate.status != "ok":
        return Balanced(estimate.status)
    found = rid.balance(estimate, PLANES, "140 Hz")
    added = [c.unbalance_kg_m * np.exp(1j * c.angle_rad) for c in found.corrections]
    before = in_planes(truth)
    stated = np.array([plane.unbalance_kg_m for plane in found.residual])
    return Balanced("ok", np.abs(before), np.abs(before + added), stated)


CLOSE = (
    SUPPORTED.replace("m*x'' + c*x' + 2*k_x*x =", "m*x'' + c*x' + 2*k_x*x + e*y = F_x +")
    .replace("m*y'' + c*y' + 2*k_y*y =", "m*y'' + c*y' + 2*k_y*y + e*x = F_y +")
    .replace("2*L^2*k_x*theta_y = 0", "2*L^2*k_x*theta_y = T_y")
    .replace('T = "N m"', 'F_x = "N"\nF_y = "N"\nT = "N m"\nT_y = "N m"')
    .replace("L = {", 'e = { unit = "N/m", nominal = 500.0 }\nL = {')
)
"""Two bounce modes that lie within some deviations of each other, and hardly touch."""
SPLIT = 80.0
"""N/m between k_x and k_y of the close machine; its deviations are of the same size."""
TO, CRITICAL = 700.0, 3
"""rad/s; below it lie three critical speeds, and in some machines a fourth."""


@dataclass(frozen=True)
class Found:
    """Modes and critical speeds of one record: value, deviation, interval, truth, by row."""

    status: str
    frequency: Floats = field(default_factory=lambda: np.zeros((0, 5)))
    damping: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    critical: Floats = field(default_factory=lambda: np.zeros((0, 5)))
    close: tuple[bool, ...] = ()


def close_matrices(p: Mapping[str, float], speed: float) -> tuple[Floats, Floats, Floats]:
    """Return M, D + Omega G and K of the machine with close modes."""
    gyro = np.zeros((4, 4))
    gyro[2, 3], gyro[3, 2] = p["I_p"] * speed, -p["I_p"] * speed
    stiffness = np.diag(
        [2 * p["k_x"], 2 * p["k_y"]] + [2 * p["L"] ** 2 * p[k] for k in ("k_y", "k_x")]
    )
    stiffness[0, 1] = stiffness[1, 0] = p["e"]
    damping = np.diag([p["c"], p["c"], p["d"], p["d"]]) + gyro
    return np.diag([p["m"], p["m"], p["I_t"], p["I_t"]]), damping, stiffness


def true_modes(p: Mapping[str, float], speed: float) -> Complexes:
    """Return lambda of the modes, ascending."""
    mass, damping, stiffness = close_matrices(p, speed)
    own = np.diag(mass)[:, None]
    unit = 300.0
    companion = np.block(
        [[np.zeros((4, 4)), unit * np.eye(4)], [-stiffness / own / unit, -damping / own]]
    )
    values = scipy.linalg.eigvals(companion)
    kept = values[values.imag > 1e-9 * np.abs(values)]
    return kept[np.argsort(kept.imag)]


def true_criticals(p: Mapping[str, float]) -> Floats:
    """Return the speeds at which a frequency is that of the rotation, by a fine grid."""
    grid = np.linspace(50.0, TO, 261)
    over = np.array([true_modes(p, s).imag - s for s in grid])
    found = []
    for j in range(over.shape[1]):
        for k in np.flatnonzero(np.diff(np.sign(over[:, j]))):
            low, high = grid[k], grid[k + 1]
            for _ in range(60):
                middle = (low + high) / 2
                same = (true_modes(p, middle).imag[j] - middle) * over[k, j] > 0
                low, high = (middle, high) if same else (low, middle)
            found.append(low)
    return np.sort(found)


@dataclass(frozen=True)
class Case:
    """A machine with two close modes, its record, and what is known of it and where to start."""

    model: rid.Model
    truth: Mapping[str, float]
    record: rid.PeriodicRecord
    known: Mapping[str, float]
    start: Mapping[str, float]


@functools.cache
def _close_model() -> rid.Model:
    return rid.parse_model(CLOSE, name="close")


def close_case(seed: int, speed: float = 800.0, periods: int = PERIODS, stream: int = 13) -> Case:
    """Return a random machine with two close modes; its noise of the mean is that of PERIODS."""
    rng = np.random.default_rng([seed, stream])
    model = _close_model()
    truth = {n: v * np.exp(0.1 * rng.standard_normal()) for n, v in model.nominal.items()}
    truth["k_y"] = truth["k_x"] + SPLIT * rng.standard_normal()
    truth["e"] = 0.5 * SPLIT * rng.standard_normal()
    harmonics = np.arange(1, 16)
    channels = [rid.Channel(n, model.units[n]) for n in (*model.inputs, *model.coordinates)]
    force = np.array([8.0, 8.0, 1.0, 1.0]) * np.exp(2j * np.pi * rng.random((15, 4)))
    mass, damping, stiffness = close_matrices(truth, speed)
    w = 2 * np.pi * 10.0 * harmonics[:, None, None]
    dynamic = -(w**2) * mass + 1j * w * damping + stiffness
    motion = np.linalg.solve(dynamic, force[..., None])[..., 0]
    noise = np.array([1.0, 1.0, 0.1, 0.1, 4e-6, 4e-6, 2e-5, 2e-5]) * np.sqrt(periods / PERIODS)
    mean = np.concatenate([force, motion], axis=1)
    samples = int(RATE / 10)
    record = noisy_record(channels, mean, noise, harmonics, rng, speed, periods, samples)
    known = {n: truth[n] for n in ("L",)} | {"xi": 0.0, "zeta": 0.0}
    start = {n: truth[n] * rng.uniform(0.9, 1.1) for n in model.parameter_names if n not in known}
    return Case(model, truth, record, known, start)


def minimum_from_the_truth(case: Case) -> tuple[Solution, Inference]:
    """Return the minimum without the search from afar: thousands of records take seconds."""
    start = {name: case.truth[name] for name in case.start}
    knowledge = rid.MaximumLikelihood(fixed=case.known, start=start).knowledge(case.model)
    prepared = prepare(case.model, knowledge, (), base=False, guess=start)
    problem = prepared.of(bind_all(case.model, [case.record]))
    solution = solve(problem, prepared.layout.start, (0.0,))
    assert solution.converged
    return solution, solution.inference


def errors_at_the_minimum(case: Case) -> dict[str, float]:
    """Return errors over their stated deviations, by name."""
    solution, inference = minimum_from_the_truth(case)
    layout, std = solution.point.problem.layout, np.sqrt(np.diag(inference.covariance))
    names = [layout.unknowns[i].name for i in layout.free]
    rows = zip(names, solution.point.unknowns[layout.free].tolist(), std.tolist(), strict=True)
    return {name: (value - case.truth[name]) / deviation for name, value, deviation in rows}


def identified(seed: int, speed: float = 800.0) -> Found:
    """Identify a random machine with two close modes, and hold its modes against the truth."""
    case = close_case(seed, speed)
    truth = case.truth
    estimator = rid.MaximumLikelihood(fixed=case.known, start=case.start)
    estimate = rid.identify(case.model, [case.record], estimator)
    if estimate.status != "ok":
        return Found(estimate.status)
    found = rid.modes(estimate, speed=speed)
    values = true_modes(truth, speed)
    frequency = [
        (m.frequency_hz, m.std_hz, *m.interval_hz, v.imag / (2 * np.pi))
        for m, v in zip(found.modes, values, strict=True)
    ]
    ratios = [
        (m.damping_ratio, m.damping_std, -v.real / abs(v))
        for m, v in zip(found.modes, values, strict=True)
    ]
    near = critical_speeds(machine_of(estimate), TO)[:CRITICAL]
    criticals = [
        (c.speed_rad_s, c.std, *c.interval, t)
        for c, t in zip(near, true_criticals(truth)[:CRITICAL], strict=True)
    ]
    return Found(
        "ok",
        np.array(frequency),
        np.array(ratios),
        np.array(criticals),
        tuple(m.close for m in found.modes),
    )


def covered(rows: Floats) -> Floats:
    """Return which intervals hold the truth."""
    return (rows[:, 2] <= rows[:, 4]) & (rows[:, 4] <= rows[:, 3])
