"""Machines whose results are known, loops of the rig, and fits as a whole.

Lines are made with numpy alone, and what should come out is in closed form or by another solver
than the package's own: the loop's sensitivity by rotor, hold and controller.
"""

import functools
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import scipy.linalg
import scipy.signal
from linear_machines import SUPPORTED, estimate_of
from rotor_bank import RATE, Case, noisy_record, rigid_rotor
from scipy.optimize import brentq

import rotorid as rid
from rotorid import Drive, Model, load_rig
from rotorid.core.values import Complexes, Floats
from rotorid.data.observation import Observation
from rotorid.likelihood.fit import CovarianceChoice, Fit, Fitting, answered
from rotorid.likelihood.inference import Inference
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.problem import Problem
from rotorid.likelihood.solver import Solution, solve
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge
from rotorid.results.machine import machine_of
from rotorid.results.modes import critical_speeds
from rotorid.results.sensitivity import AxisSensitivity, zone_of
from rotorid.rig.rig import Rig, excitation_table
from rotorid.signals.multisine import Multisine
from rotorid.testing import bind_all, parse_rig

HARMONICS = (1, 3, 5, 7, 9, 11)
OMEGA = 2 * np.pi * 20.0 * np.array(HARMONICS)
PLANES = ["F_xa,F_ya", "F_xb,F_yb"]
PERIODS = 100
KS = 2e5
Effort = Literal["normal", "quick"]


@dataclass(frozen=True)
class Balanced:
    """What became of one rotor: status, the amounts before, left and stated, (plane,)."""

    status: str
    before: Floats = field(default_factory=lambda: np.zeros(0))
    left: Floats = field(default_factory=lambda: np.zeros(0))
    stated: Floats = field(default_factory=lambda: np.zeros(0))


def in_planes(p: Mapping[str, float]) -> Complexes:
    """Return the unbalance of a rigid rotor in the planes of its bearings, kg m.

    Of the resultant m e, and of the moment of the products of inertia that a tilt makes:
    (I_t - I_p)(mu + i eta) turns about x.
    """
    force = p["m"] * (p["xi"] + 1j * p["zeta"])
    moment = (p["I_t"] - p["I_p"]) * (p["mu"] + 1j * p["eta"])
    # theta_x: L_a F_ya - L_b F_yb, with F_y = -i U: -i (a U_a - b U_b) = moment
    matrix = np.array([[1, 1], [-1j * p["L_a"], 1j * p["L_b"]]])
    return np.linalg.solve(matrix, np.array([force, moment]))


def balanced(seed: int, effort: Effort = "normal") -> Balanced:
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
        there = rigid_rotor(truth).lines(speed, OMEGA, force) @ reads.T
        seen = there + np.where(np.isclose(OMEGA, speed)[:, None], runout / 2, 0)
        current = (force - KS * there) / ki
        noise = np.array([5e-4] * 4 + [5e-7] * 4)
        mean = np.concatenate([current, seen], axis=1)
        records.append(noisy_record(channels, mean, noise, HARMONICS, rng, speed, PERIODS))
    start = {n: truth[n] * rng.uniform(0.8, 1.2) for n in ("I_t", "I_p")}
    fixed = {n: truth[n] for n in ("m", "L_a", "L_b")}
    measured = {"runout": True, "gains": ("ki",), "effort": effort}
    estimator = rid.MaximumLikelihood(fixed=fixed, start=start, **measured)
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
    .replace('T = "N m"', 'F_x = "N", F_y = "N", T = "N m", T_y = "N m"')
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
    k_x, k_y, arm = 2 * p["k_x"], 2 * p["k_y"], p["L"] ** 2
    stiffness = np.diag([k_x, k_y, arm * k_y, arm * k_x])
    stiffness[0, 1] = stiffness[1, 0] = p["e"]
    damping = np.diag([p["c"], p["c"], p["d"], p["d"]]) + gyro
    return np.diag([p["m"], p["m"], p["I_t"], p["I_t"]]), damping, stiffness


def true_modes(p: Mapping[str, float], speed: float) -> Complexes:
    """Return lambda of the modes, ascending."""
    mass, damping, stiffness = close_matrices(p, speed)
    own = np.diag(mass)[:, None]
    unit = 300.0
    below = [-stiffness / own / unit, -damping / own]
    companion = np.block([[np.zeros((4, 4)), unit * np.eye(4)], below])
    values = scipy.linalg.eigvals(companion)
    kept = values[values.imag > 1e-9 * np.abs(values)]
    return kept[np.argsort(kept.imag)]


def true_criticals(p: Mapping[str, float]) -> Floats:
    """Return the speeds at which a frequency is that of the rotation, by a fine grid."""

    def ahead(speed: float, mode: int) -> float:
        return true_modes(p, speed).imag[mode] - speed

    grid = np.linspace(50.0, TO, 66)
    over = np.array([true_modes(p, s).imag - s for s in grid])
    found = []
    for j in range(over.shape[1]):
        for k in np.flatnonzero(np.diff(np.sign(over[:, j]))):
            found.append(brentq(ahead, grid[k], grid[k + 1], args=(j,)))
    return np.sort(found)


CLOSE_MODEL = rid.parse_model(CLOSE, name="close")


def close_case(seed: int, speed: float = 800.0, periods: int = PERIODS, stream: int = 13) -> Case:
    """Return a random machine with two close modes; its noise of the mean is that of PERIODS."""
    rng = np.random.default_rng([seed, stream])
    model = CLOSE_MODEL
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
    return Case(model, truth, (record,), known, start)


def minimum_from_the_truth(case: Case) -> tuple[Solution, Inference]:
    """Return the minimum without the search from afar: thousands of records take seconds."""
    problem = problem_of(case, {name: case.truth[name] for name in case.start})
    solution = solve(problem, problem.layout.start, (0.0,))
    assert solution.converged
    return solution, solution.inference


def values_at_the_minimum(case: Case) -> tuple[dict[str, float], Floats]:
    """Return what is free, by name, and its covariance."""
    solution, inference = minimum_from_the_truth(case)
    layout = solution.point.problem.layout
    names = [layout.unknowns[i].name for i in layout.free]
    values = solution.point.unknowns[layout.free].tolist()
    return dict(zip(names, values, strict=True)), inference.covariance


def errors_at_the_minimum(case: Case) -> dict[str, float]:
    """Return errors over their stated deviations, by name."""
    values, covariance = values_at_the_minimum(case)
    rows = zip(values.items(), np.sqrt(np.diag(covariance)).tolist(), strict=True)
    return {name: (value - case.truth[name]) / deviation for (name, value), deviation in rows}


def found_at_the_minimum(seed: int, speed: float = 800.0) -> Found:
    """Hold the modes at the minimum next to the truth against it: the same without the search."""
    case = close_case(seed, speed)
    values, covariance = values_at_the_minimum(case)
    fixed = tuple(case.fixed)
    assert [*values] == [name for name in case.model.parameter_names if name not in fixed]
    at = {**case.fixed, **values}
    return held(case, estimate_of(case.model, at, fixed=fixed, covariance=covariance), speed)


def held(case: Case, estimate: rid.Estimate, speed: float) -> Found:
    """Hold modes and critical speeds of an estimate against the truth."""
    truth = case.truth
    found = rid.modes(estimate, speed=speed)
    values = true_modes(truth, speed)
    pairs, turn = list(zip(found.modes, values, strict=True)), 2 * np.pi
    hertz = [(m.frequency_hz, m.std_hz, *m.interval_hz, v.imag / turn) for m, v in pairs]
    ratios = [(m.damping_ratio, m.damping_std, -v.real / abs(v)) for m, v in pairs]
    near = critical_speeds(machine_of(estimate), TO)[:CRITICAL]
    criticals = [
        (c.speed_rad_s, c.std, *c.interval, t)
        for c, t in zip(near, true_criticals(truth)[:CRITICAL], strict=True)
    ]
    rows = map(np.array, (hertz, ratios, criticals))
    return Found("ok", *rows, tuple(m.close for m in found.modes))


def covered(rows: Floats) -> Floats:
    """Return which intervals hold the truth."""
    return (rows[:, 2] <= rows[:, 4]) & (rows[:, 4] <= rows[:, 3])


# The shipped rig with one axis excited at a time: commands behind the sum, and what was added.


FUNDAMENTAL = 5.0
LAST = 50
"""Lines of 5 Hz: the peak of the loop lies between them."""


@functools.cache
def rig_of(stiffness: float = 2e5, damping: float = 800.0) -> Rig:
    """Return the shipped rig with other settings of its controllers, N/m and N s/m."""
    text = load_rig("three-mass").text
    for old, new in (
        ('2e5 N/m"    #', f'{stiffness:g} N/m" #'),
        ("800 N s/m", f"{damping:g} N s/m"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    return parse_rig(text).rig


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
    """The peak of a loop, and what was found of it."""

    peak: float
    axis: AxisSensitivity

    @property
    def wrong(self) -> bool:
        """Whether the zone is none of those named."""
        low, high = map(zone_of, self.axis.interval)
        return not low <= zone_of(self.peak) <= high

    @property
    def off_db(self) -> float:
        return self.axis.peak_db - 20 * np.log10(self.peak)

    @property
    def held(self) -> bool:
        low, high = self.axis.interval
        return low <= self.peak <= high


STIFFNESS = (1.5e5, 2e5, 3e5)
DAMPING = tuple(np.geomspace(340.0, 900.0, 10).round().tolist())
"""Of controllers that make peaks of 1.9 to 6.3 on the shipped rotor: zones A to D."""


def by_periods(seed: int, noise: tuple[float, float] = (0.005, 0.03)) -> Graded:
    """Grade a random loop by its periods; S has noise of up to 3 percent of 1 on every line."""
    rng = np.random.default_rng([seed, 14839])
    on = loop(float(rng.choice(STIFFNESS)), float(rng.choice(DAMPING)))
    size = noise[0] * (noise[1] / noise[0]) ** rng.random()
    record = played(on, size, int(rng.integers(10, 40)), rng)
    return Graded(on.peak, rid.sensitivity(record, {"e": "r"})[0])


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
    moving = [0.5], [1.0, damping / 2.0, 1e5]
    plant = scipy.signal.cont2discrete(moving, 1 / sampling, method="zoh")
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


def by_few_lines(seed: int, lengths: Sequence[int] = (2, 4, 8)) -> Graded:
    """Grade a loop by a short record: its peak is narrower than windows of lines, or little more.

    Records of some seconds, noise of .1 to 3 percent and more at the peak.
    """
    rng = np.random.default_rng([seed, 14842])
    stiffness, rate, damping = NARROW[rng.integers(len(NARROW))]
    noise = (float(np.exp(rng.uniform(np.log(1e-7), np.log(2e-6)))), float(rng.uniform(0.01, 0.2)))
    seconds = int(rng.choice(lengths))
    record, exact = sampled_loop(stiffness, rate, seconds, rng, damping, noise=noise)
    (axis,) = rid.sensitivity(record, {"e": "r"}, band=("8 Hz", "400 Hz"))
    return Graded(exact, axis)


def by_the_rig(seed: int, periods: int = 20) -> Graded:
    """Grade an axis of the shipped rig by a record of its simulation."""
    rng = np.random.default_rng([seed, 14841])
    axis = int(rng.integers(4))
    found = rid.sensitivity(measured(axis, periods, rng), pair(axis))[0]
    return Graded(exact_peak(axis), found)


def measured(axis: int, periods: int, rng: np.random.Generator) -> rid.PeriodicRecord:
    """Return what a logger has with a multisine on one axis.

    These are commands behind the sum, and what was added to them.
    """
    rig, harmonics = rig_of(), np.arange(1, LAST + 1)
    names = rig.model.inputs
    lines = np.zeros((LAST, len(names)), dtype=complex)
    lines[:, axis] = 3.0 * np.exp(1j * np.pi * harmonics * (harmonics - 1) / LAST)  # Schroeder
    played = replace(rig, excitation=Multisine(FUNDAMENTAL, harmonics, lines, names))
    found = played.run(periods / FUNDAMENTAL, rng)
    commands = found.samples[:, [found.names.index(name) for name in names]]
    added = np.tile(excitation_table(played), (periods, 1))[: len(commands)]
    channels = [rid.Channel(f"{kind}_{name}") for kind in "er" for name in names]
    samples, rate = np.hstack([commands, added]), rig.logger.sample_rate
    record = rid.Record(channels, samples, sample_rate=rate, speed=found.speed)
    return rid.average(record, FUNDAMENTAL, harmonics=harmonics)


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


# A problem, and a fit as a whole, without the steps on the way to it.


def problem_of(
    case: Case, start: Mapping[str, float], records: Sequence[rid.PeriodicRecord] = ()
) -> Problem:
    """Return the problem of a case without unknowns of the measurement, from a start."""
    prepared = prepare(case.model, Knowledge(case.fixed, start=start), (), False, {})
    return prepared.of(bind_all(case.model, records or case.records))


def fit(
    model: Model,
    records: Sequence[Observation],
    knowledge: Knowledge,
    nuisances: Nuisances,
    *,
    covariance: CovarianceChoice = "auto",
) -> Fit:
    """Return the minimum with its deviations."""
    steps = Fitting(model, knowledge, nuisances, covariance=covariance).located(records)
    return answered(deque(steps, maxlen=1).pop().fit)
