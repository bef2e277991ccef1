"""A bank of problems with known truth, for every estimator.

Each problem is a model as a user would type it, or a shipped one, and a periodic motion that
fulfils its equations to rounding. The physics is written a second time here, by hand in numpy (of
rotors in `rotor_bank`): nothing of the package computes the truth. Below it stand helpers for any
test: what holds a truth, and records of a model's own lines.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import SimpleNamespace
from typing import TypeVar

import numpy as np
import pytest
from model_text import model_text
from numpy.typing import ArrayLike
from rotor_bank import PAPER, Rotor, rigid_rotor, three_mass_rotor

import rotorid as rid
from rotorid import Batch, Channel, Estimate, LeastSquares, Model, PeriodicRecord, Record, average
from rotorid.testing import add_noise, line_record

FAMILY = (LeastSquares, Batch, rid.Sequential)
family = pytest.mark.parametrize("method", FAMILY, ids=lambda m: m.__name__)
Columns = Mapping[str, np.ndarray]
R = TypeVar("R", Record, PeriodicRecord)


@dataclass(frozen=True)
class Grid:
    """Samples of one period, with the rotation that fits in it."""

    samples: int = 240
    sample_rate: float = 1200.0
    turns: int = 0  # revolutions in a period
    phase: float = 0.0

    @property
    def omega(self) -> float:
        """Fundamental in rad/s."""
        return 2 * np.pi * self.sample_rate / self.samples

    @property
    def speed(self) -> float:
        return self.turns * self.omega

    @property
    def time(self) -> np.ndarray:
        return np.arange(self.samples) / self.sample_rate

    @property
    def angle(self) -> np.ndarray:
        return self.speed * self.time + self.phase


def wave(
    grid: Grid, harmonics: Sequence[int], size: float, shift: float = 0.0, offset: float = 0.0
) -> SimpleNamespace:
    """Return a multisine with its derivatives in closed form: q, dq, ddq."""
    total = SimpleNamespace(q=np.full(grid.samples, offset), dq=0.0, ddq=0.0)
    for n, harmonic in enumerate(harmonics):
        omega = harmonic * grid.omega
        angle = omega * grid.time + 0.7 * n**2 + shift
        a = size / (1 + n)
        total.q = total.q + a * np.cos(angle)
        total.dq = total.dq - a * omega * np.sin(angle)
        total.ddq = total.ddq - a * omega**2 * np.cos(angle)
    return total


@dataclass(frozen=True)
class Problem:
    """A model, its true parameters, and motions that fulfil it.

    ``columns(p, grid)`` returns one period of every channel for parameters ``p``.
    """

    name: str
    truth: Mapping[str, float]
    columns: Callable[[SimpleNamespace, Grid], Columns]
    harmonics: Sequence[int]
    base: Sequence[str]
    text: str = ""  # of a model file; without it a shipped model of that name
    grids: Sequence[Grid] = (Grid(),)
    fixed: Sequence[str] = ()
    follow: Sequence[str] | None = None
    linear: bool = False
    reads: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @cached_property
    def model(self) -> Model:
        name = self.name
        return rid.parse_model(self.text, name=name) if self.text else rid.load_model(name)

    @property
    def derived(self) -> Sequence[str]:
        """Names of what follows from the base parameters: these themselves, if nothing else."""
        return self.base if self.follow is None else self.follow

    @property
    def known(self) -> dict[str, float]:
        return {name: self.truth[name] for name in self.fixed}

    @property
    def true_base(self) -> dict[str, float]:
        """Values of the base parameters, from their names: no map of the package is used."""
        return {name: combination(name, self.truth) for name in self.base}

    def record(
        self,
        grid: Grid | None = None,
        *,
        periods: int = 3,
        noise: Mapping[str, float] | None = None,
        rng: np.random.Generator | None = None,
    ) -> Record:
        grid = grid or self.grids[0]
        columns = dict(self.columns(SimpleNamespace(**self.truth), grid))
        samples = np.tile(np.column_stack(list(columns.values())), (periods, 1))
        if noise and rng is not None:
            deviation = np.array([noise.get(name, 0.0) for name in columns])
            samples = samples + deviation * rng.standard_normal(samples.shape)
        channels = [Channel(name, reads=self.reads.get(name)) for name in columns]
        angle = grid.speed * np.arange(len(samples)) / grid.sample_rate + grid.phase
        return Record(channels, samples, grid.sample_rate, grid.speed, angle, source=self.name)

    def periodic(self, grid: Grid | None = None, **options: object) -> PeriodicRecord:
        grid = grid or self.grids[0]
        record = self.record(grid, **options)  # type: ignore[arg-type]
        return average(record, period_samples=grid.samples, harmonics=self.harmonics)

    @property
    def records(self) -> list[PeriodicRecord]:
        return [self.periodic(grid) for grid in self.grids]

    def noisy(
        self, periods: int, seed: int, grid: Grid | None = None, level: float = 0.01
    ) -> PeriodicRecord:
        """Return a record whose channels have noise of a share of what they hold."""
        clean = self.record(grid, periods=2)
        noise = dict(zip(clean.names, level * clean.samples.std(axis=0), strict=True))
        rng = np.random.default_rng(seed)
        return self.periodic(grid, periods=periods, noise=noise, rng=rng)


def recovered(estimate: Estimate, truth: Mapping[str, float], rel: float = 1e-9) -> None:
    """Check that what is estimated is the truth."""
    for name, value in truth.items():
        assert estimate.value(name) == pytest.approx(value, rel=rel), name


def names(text: str) -> tuple[str, ...]:
    return tuple(text.split(", "))


def combination(name: str, truth: Mapping[str, float]) -> float:
    """Return the value of a combination of monomials from its name, as interface.md spells it."""
    total = 0.0
    for sign, term in re.findall(r"(^|\+ |- )([^ ]+)", name):
        product = -1.0 if sign == "- " else 1.0
        for factor in term.split("*"):
            symbol, _, power = factor.partition("^")
            number = truth[symbol] if symbol in truth else float(symbol)
            product *= number ** int(power or 1)
        total += product
    return total


def line_response(
    grid: Grid,
    harmonics: Sequence[int],
    stiffness: Callable[[float], np.ndarray],
    right: np.ndarray,
) -> np.ndarray:
    """Solve ``Z(omega) q = right`` by hand, line by line; samples of q (sample, coordinate)."""
    spectrum = np.fft.fft(right, axis=0)
    keep = np.zeros(grid.samples, dtype=bool)
    keep[list(harmonics)] = True
    answer = np.zeros((grid.samples, right.shape[1]), dtype=complex)
    for k in np.flatnonzero(keep):
        answer[k] = np.linalg.solve(stiffness(k * grid.omega), spectrum[k])
        if k:
            answer[-k] = answer[k].conj()
    return np.fft.ifft(answer, axis=0).real


# ---------------------------------------------------------------------------------------------
# The shipped models.


def rotor_columns(
    rotor: Callable[[Mapping[str, float]], Rotor], names: str, harmonics: Sequence[int]
) -> Callable[[SimpleNamespace, Grid], Columns]:

    def columns(p: SimpleNamespace, grid: Grid) -> Columns:
        M, D, G, K, B, _ = made = rotor(vars(p))
        turns = np.outer(grid.omega * grid.time, harmonics)
        u = np.outer(10 * (np.sin(turns) + np.cos(turns)).sum(axis=1), (0.5, 1.0, 1.0, -0.5))
        right = u @ B.T + made.load(grid.speed, grid.angle)

        def stiffness(omega: float) -> np.ndarray:
            return -(omega**2) * M + 1j * omega * (D + grid.speed * G) + K

        q = line_response(grid, harmonics, stiffness, right)
        return dict(zip(names.split(), np.column_stack([u, q]).T, strict=True))

    return columns


THREE_MASS = Problem(
    name="three-mass",
    truth={
        **{name: PAPER[name] for name in ("m1", "m2", "m3", "I_t", "I_p", "k1", "k2", "L1", "L2")},
        "xi": 77.112 / 11.322 / (2 * np.pi * 140) ** 2,
        "zeta": 133.56 / 11.322 / (2 * np.pi * 140) ** 2,
        "mu": -1.3145 / (2.5425e-2 - 4.8275e-2) / (2 * np.pi * 140) ** 2,
        "eta": -2.2767 / (2.5425e-2 - 4.8275e-2) / (2 * np.pi * 140) ** 2,
    },
    columns=rotor_columns(
        three_mass_rotor,
        "F_x1 F_y1 F_x3 F_y3 x1 y1 x2 y2 theta_x theta_y x3 y3",
        (1, 3, 5, 7, 9, 11),
    ),
    harmonics=(1, 3, 5, 7, 9, 11),
    grids=(Grid(250, 5000.0, turns=7),),
    base=names(
        "m1, m2, m2*xi, m2*zeta, m3, I_t, I_t*mu - I_p*mu, I_t*eta - I_p*eta, I_p, "
        "k1, k1*L1, k1*L1^2 + k2*L2^2, k2, k2*L2"
    ),
    follow=names("m1, m2, m3, I_t, I_p, k1, k2, L1, L2, xi, zeta, mu, eta"),
    linear=True,
)


RIGID = Problem(
    name="rigid",
    truth={
        **{"m": 8.0, "I_t": 0.21, "I_p": 0.034, "L_a": 0.2, "L_b": 0.25},
        **{"xi": 5e-6, "zeta": -3e-6, "mu": 4e-5, "eta": 2e-5},
    },
    fixed=("L_a", "L_b"),
    columns=rotor_columns(rigid_rotor, "F_xa F_ya F_xb F_yb x y theta_x theta_y", (1, 2, 3, 5, 8)),
    harmonics=(1, 2, 3, 5, 8),
    grids=(Grid(turns=5), Grid(turns=3, phase=0.4)),
    base=names("m, m*xi, m*zeta, I_t, I_t*mu - I_p*mu, I_t*eta - I_p*eta, I_p"),
    follow=names("m, I_t, I_p, xi, zeta, mu, eta"),
    linear=True,
)


def jeffcott_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    x, y = wave(grid, (1, 2, 4), 1e-4), wave(grid, (1, 2, 4), 2e-4, shift=1.0)
    pull = p.m * grid.speed**2
    c, s = np.cos(grid.angle), np.sin(grid.angle)
    return {
        "y": y.q,  # in another order than the model's
        "x": x.q,
        "F_x": p.m * x.ddq + p.c * x.dq + p.k * x.q - pull * (p.xi * c - p.zeta * s),
        "F_y": p.m * y.ddq + p.c * y.dq + p.k * y.q - pull * (p.xi * s + p.zeta * c),
    }


JEFFCOTT = Problem(
    name="jeffcott",
    truth={"m": 4.0, "c": 75.0, "k": 9e5, "xi": 1.5e-5, "zeta": -2.5e-5},
    columns=jeffcott_columns,
    harmonics=(1, 2, 4),
    grids=(Grid(turns=4, phase=-1.1),),
    base=names("m, m*xi, m*zeta, c, k"),
    follow=names("m, c, k, xi, zeta"),
    linear=True,
)


def emps_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    q = wave(grid, (1, 2, 3), 0.1)
    return {"q": q.q, "F": p.M * q.ddq + p.Fv * q.dq + p.Fc * np.sign(q.dq) + p.offset}


EMPS = Problem(
    name="emps",
    truth={"M": 95.1, "Fv": 203.5, "Fc": 20.4, "offset": -3.2},
    columns=emps_columns,
    harmonics=(0, 1, 2, 3, 5, 8, 13),
    base=names("M, Fv, Fc, offset"),
)

# ---------------------------------------------------------------------------------------------
# Models as a user would type them.


def arm_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    a, b = wave(grid, (1, 2, 3), 0.8), wave(grid, (1, 2, 4), 1.1, shift=0.5, offset=0.4)
    h = p.m2 * p.l1 * p.r2
    sum_inertia = p.J2 + p.m2 * p.r2**2
    c2, s2 = np.cos(b.q), np.sin(b.q)
    first, both = np.cos(a.q), np.cos(a.q + b.q)
    tau1 = (
        (p.J1 + p.m1 * p.r1**2 + p.m2 * p.l1**2 + sum_inertia + 2 * h * c2) * a.ddq
        + (sum_inertia + h * c2) * b.ddq
        - h * s2 * (2 * a.dq * b.dq + b.dq**2)
        + 9.81 * ((p.m1 * p.r1 + p.m2 * p.l1) * first + p.m2 * p.r2 * both)
    )
    tau2 = (
        (sum_inertia + h * c2) * a.ddq
        + sum_inertia * b.ddq
        + h * s2 * a.dq**2
        + 9.81 * p.m2 * p.r2 * both
    )
    return {"tau1": tau1, "tau2": tau2, "q1": a.q, "q2": b.q}


ARM = Problem(
    name="arm",
    text=model_text(
        "robot arm of two links in a vertical plane",
        [
            "(J1 + m1*r1^2)*q1'' + m2*l1^2*(sin(q2)^2 + cos(q2)^2)*q1''"
            " + (J2 + m2*r2^2)*(q1'' + q2'') + m2*l1*r2*cos(q2)*(2*q1'' + q2'')"
            " - m2*l1*r2*sin(q2)*q2'*(2*q1' + q2')"
            " + 9.81*((m1*r1 + m2*l1)*cos(q1) + m2*r2*cos(q1 + q2)) = tau1",
            "(J2 + m2*r2^2)*(q1'' + q2'') + m2*l1*r2*(cos(q2)*q1'' + sin(q2)*q1'^2)"
            " + 9.81*m2*r2*(cos(q1)*cos(q2) - sin(q1)*sin(q2)) = tau2",
        ],
        "q1 rad, q2 rad",
        "tau1 N m, tau2 N m",
        "m1 kg, m2 kg, l1 m, r1 m, r2 m, J1 kg m^2, J2 kg m^2",
    ),
    truth={"m1": 3.0, "m2": 2.0, "l1": 0.5, "r1": 0.22, "r2": 0.31, "J1": 0.07, "J2": 0.03},
    columns=arm_columns,
    harmonics=tuple(range(25)),
    base=names("m1*r1 + m2*l1, m1*r1^2 + m2*l1^2 + J1, m2*l1*r2, m2*r2, m2*r2^2 + J2"),
    follow=("l1",),
)

ARM_OF_KNOWN_LENGTH = replace(
    ARM,
    fixed=("l1",),
    base=names("m1*r1 + 0.5*m2, m1*r1^2 + 0.25*m2 + J1, m2*r2, m2*r2^2 + J2"),
    follow=(),
)


def duffing_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    x = wave(grid, (1, 2, 3), 0.02, offset=-0.004)
    unbalance = p.m * p.e * grid.speed**2 * np.cos(grid.angle)
    spring = p.k * x.q + p.k_3 * x.q**3
    return {"P": p.m * x.ddq + p.d * x.dq + spring + 9.81 * p.m - unbalance, "x": x.q}


DUFFING = Problem(
    name="duffing",
    text=model_text(
        "hardening spring under a rotating weight",
        ["P = m*(x'' + 9.81) + d*x' + (k + k_3*x**2)*x - m*e*Omega^2*cos(phi)"],
        "x m",
        "P N",
        "m kg, d N s/m, k N/m, k_3 N/m^3, e m",
    ),
    truth={"m": 2.0, "d": 11.0, "k": 4000.0, "k_3": 3e6, "e": 1e-4},
    columns=duffing_columns,
    harmonics=tuple(range(12)),
    grids=(Grid(turns=4, phase=0.3), Grid(turns=2)),
    base=names("m, m*e, d, k, k_3"),
    follow=names("m, d, k, k_3, e"),
)


def hoist_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    z = wave(grid, (1, 3), 0.05)
    return {"F": p.m * (z.ddq + 9.81) + p.c * z.dq, "z": z.q}


HOIST = Problem(
    name="hoist",
    text=model_text("a load", ["m*z'' = F - c*z' - m*9.81"], "z m", "F N", "m kg, c N s/m"),
    truth={"m": 30.0, "c": 50.0},
    columns=hoist_columns,
    harmonics=(0, 1, 3),
    base=("m", "c"),
    linear=True,
)


def table_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    y, t = wave(grid, (1, 2, 5), 1e-3), wave(grid, (1, 3, 4), 2e-3, shift=0.8)
    left, right = p.k_l * (y.q - 0.3 * t.q), p.k_r * (y.q + 0.4 * t.q)
    up = p.m * y.ddq + left + right + p.c * y.dq
    turn = p.J * t.ddq - 0.3 * left + 0.4 * right + 1.5 * p.c * t.dq - 0.05 * 9.81 * p.m * t.q
    # up = 2 A + 2 B, turn = -0.25 A + 0.5 B + T
    a = 0.3 * up + 0.001 * np.sin(3 * grid.omega * grid.time)
    b = up / 2 - a
    return {"A": a, "B": b, "T": turn + 0.25 * a - 0.5 * b, "s1": y.q - 0.3 * t.q, "theta": t.q}


TABLE = Problem(
    name="table",
    text=model_text(
        "table on two springs; forces that enter several rows",
        [
            "m*y'' + c*y' + k_l*(y - 0.3*theta) + k_r*(y + 0.4*theta) = 2*(A + B)",
            "J*theta'' + 1.5*c*theta' - 0.3*k_l*(y - 0.3*theta) + 0.4*k_r*(y + 0.4*theta)"
            " - 0.05*9.81*m*theta = -A/4 + B/2 + T",
        ],
        "y m, theta rad",
        "A N, B N, T N m",
        "m kg, J kg m^2, c N s/m, k_l N/m, k_r N/m",
    ),
    truth={"m": 12.0, "J": 0.9, "c": 35.0, "k_l": 2.4e4, "k_r": 3.1e4},
    columns=table_columns,
    harmonics=(1, 2, 3, 4, 5),
    base=names("m, J, c, k_l, k_r"),
    linear=True,
    reads={"s1": {"y": 1.0, "theta": -0.3}},
)


def odd_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    q = wave(grid, (1, 2, 3), 0.2)
    shape = getattr(p, "lambda") + p.S * np.cos(2 * grid.angle)
    force = p.I * q.ddq + shape * q.q + p.E * np.abs(q.dq) * q.dq + p.β * np.tanh(q.dq / 0.5)
    return {"N": force - p.Q * np.sin(grid.angle) ** 2, "γ": q.q}


ODD = Problem(
    name="odd",
    text=model_text(
        "names that mean something elsewhere; a shaft that is not round",
        ["N = I*γ'' + (lambda + S*cos(2*phi))*γ + E*abs(γ')*γ' + β*tanh(2*γ') - Q*sin(phi)^2"],
        "γ m",
        "N N",
        "S N/m, E N s^2/m^2, I kg, lambda N/m, β N, Q N",
    ),
    truth={"S": 40.0, "E": 7.0, "I": 3.0, "lambda": 900.0, "β": 5.0, "Q": 2.0},
    columns=odd_columns,
    harmonics=tuple(range(16)),
    grids=(Grid(turns=3, phase=0.2),),
    base=names("S, E, I, lambda, β, Q"),
)


def chain_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    """Two masses on a hardening spring, the second one free: x2'' follows from the stretch."""
    d = wave(grid, (1, 2), 0.01)
    pull = p.k * d.q + p.k_3 * d.q**3
    spectrum = np.fft.rfft(-pull / p.m_2)
    omega = grid.omega * np.arange(len(spectrum))
    spectrum[0] = 0
    x2 = np.fft.irfft(spectrum / -(np.where(omega > 0, omega, 1) ** 2), grid.samples)
    x1_second = -pull / p.m_2 - d.ddq
    return {"F": p.m_1 * x1_second - pull, "x1": x2 - d.q, "x2": x2}


CHAIN = Problem(
    name="chain",
    text=model_text(
        "two masses on a hardening spring, one of them free",
        [
            "m_1*x1'' + k*(x1 - x2) + k_3*(x1 - x2)^3 = F",
            "m_2*x2'' = k*(x1 - x2) + k_3*(x1 - x2)^3",
        ],
        "x1 m, x2 m",
        "F N",
        "m_1 kg, m_2 kg, k N/m, k_3 N/m^3",
    ),
    truth={"m_1": 1.5, "m_2": 0.8, "k": 5000.0, "k_3": 2e7},
    columns=chain_columns,
    harmonics=(1, 2, 3, 4, 5, 6),
    base=names("m_1, m_2, k, k_3"),
)


def train_columns(p: SimpleNamespace, grid: Grid) -> Columns:
    M = np.diag([p.a, p.b, p.c])
    K = p.k * np.array([[1, -1, 0], [-1, 1, 0], [0, 0, 0]])
    K = K + p.h * np.array([[0, 0, 0], [0, 1, -1], [0, -1, 1]])
    D = np.array([[0, 0, 0], [0, 0, 0], [0, 0, p.d]])
    harmonics = (1, 2, 3, 5)
    u = sum(np.cos(h * grid.omega * grid.time + h**2) for h in harmonics)
    right = np.column_stack([u, 0 * u, 0 * u])
    q = line_response(grid, harmonics, lambda w: -(w**2) * M + 1j * w * D + K, right)
    return {"u": u, "x": q[:, 0], "y": q[:, 1], "z": q[:, 2]}


TRAIN = Problem(
    name="train",
    text=model_text(
        "three masses in a row, driven at one end: three stages",
        [
            "c*z'' + d*z' + h*(z - y) = 0",
            "b*y'' + k*(y - x) + h*(y - z) = 0",
            "a*x'' + k*(x - y) = u",
        ],
        "x m, y m, z m",
        "u N",
        "a kg, b kg, c kg, k N/m, h N/m, d N s/m",
    ),
    truth={"a": 1.0, "b": 2.0, "c": 1.5, "k": 3000.0, "h": 5000.0, "d": 20.0},
    columns=train_columns,
    harmonics=(1, 2, 3, 5),
    base=names("a, b, c, k, h, d"),
    linear=True,
)

SHIPPED = (THREE_MASS, RIGID, JEFFCOTT, EMPS)
BANK = (*SHIPPED, ARM, ARM_OF_KNOWN_LENGTH, DUFFING, HOIST, TABLE, ODD, CHAIN, TRAIN)


def agrees(estimate: Estimate, truth: Mapping[str, float], deviations: float = 4.5) -> None:
    """Check that an estimate is accepted, and holds the truth within its deviations."""
    assert estimate.status == "ok", estimate.warnings
    for value in estimate.free:
        near = pytest.approx(truth[value.name], abs=deviations * value.std)
        assert value.value == near, value.name


def times(record: PeriodicRecord, names: Sequence[str], factor: ArrayLike) -> PeriodicRecord:
    """Return a record of which some channels are multiplied, by a number or by one of each line."""
    spectra = record.spectra.copy()
    spectra[:, :, [record.index(name) for name in names]] *= np.reshape(factor, (-1, 1))
    return replace(record, spectra=spectra)


def shaken(
    record: PeriodicRecord, harmonic: int, names: Sequence[str], size: complex
) -> PeriodicRecord:
    """Return a record of which one line of some channels holds something more."""
    spectra = record.spectra.copy()
    line = list(record.harmonics).index(harmonic)
    spectra[:, line, [record.index(name) for name in names]] += size
    return replace(record, spectra=spectra)


def stated(record: R, names: Sequence[str], **changes: object) -> R:
    """Return a record of some of whose channels something else is said."""
    told = [replace(c, **changes) if c.name in names else c for c in record.channels]
    return replace(record, channels=tuple(told))


def steady(
    model: Model,
    truth: Mapping[str, float],
    forces: ArrayLike,
    harmonics: Sequence[int],
    fundamental: float = 10.0,
    rate: float = 2000.0,
    periods: int = 40,
    *,
    hertz: float = 0.0,
    sensors: Sequence[Channel | str] | None = None,
    noise: Mapping[str, float] | None = None,
    rng: np.random.Generator | None = None,
) -> PeriodicRecord:
    """Return a record of a linear machine line by line, with noise where a generator draws it."""
    record = line_record(
        model,
        model.values({**model.nominal, **truth}),
        forces,
        harmonics=harmonics,
        fundamental=fundamental,
        sample_rate=rate,
        periods=periods,
        speed=2 * np.pi * hertz,
        sensors=sensors,
    )
    return record if rng is None else add_noise(record, noise or {}, rng)


def noise_record(names: str, period: int = 20, harmonics: Sequence[int] = (1, 2)) -> PeriodicRecord:
    """Return three periods of channels that hold noise and nothing else."""
    samples = np.random.default_rng(7).standard_normal((3 * period, len(names)))
    record = Record([Channel(name) for name in names], samples, 10.0)
    return average(record, period_samples=period, harmonics=harmonics)
