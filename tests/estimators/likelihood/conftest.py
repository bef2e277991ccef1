"""The paper's rotor at the demo's noise, line by line, and Monte-Carlo figures of an estimator."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from bank import shaken, stated, times
from numpy.typing import NDArray

import rotorid as rid
from rotorid import Channel, Drive, Estimate, MaximumLikelihood, Misfit, Model, PeriodicRecord, Plan
from rotorid.testing import add_noise, line_record

Floats = NDArray[np.float64]
HARMONICS = (1, 3, 5, 7, 9, 11)
BEARINGS = ("x1", "y1", "x3", "y3")


@dataclass(frozen=True)
class Machine:
    model: Model
    truth: Mapping[str, float]
    shares: Sequence[float] = (0.5, 1.0, 1.0, -0.5)
    force_noise: float = 1.0
    position_noise: float = 22e-6

    @property
    def values(self) -> Floats:
        return self.model.values(self.truth)

    def forces(self, lines: Sequence[int]) -> np.ndarray:
        """Lines of 10 sin + 10 cos on every harmonic, shared out among the inputs."""
        return np.full((len(lines), 1), 5 - 5j) * np.array(self.shares)

    def record(
        self,
        sensors: Sequence[Channel | str] | None = None,
        *,
        hertz: float = 140.0,
        periods: int = 260,
        amplitude: float = 1.0,
        phase: float = 0.0,
        harmonics: Sequence[int] = HARMONICS,
    ) -> PeriodicRecord:
        """Return the record without noise."""
        return line_record(
            self.model,
            self.values,
            amplitude * self.forces(harmonics),
            harmonics=harmonics,
            fundamental=20.0,
            sample_rate=5000.0,
            periods=periods,
            speed=2 * np.pi * hertz,
            phase=phase,
            sensors=sensors,
        )

    def plan(self, sensors: Sequence[Channel | str] | None = None, hertz: float = 140.0) -> Plan:
        """Return what `record` is a record of, with its noise."""
        read = self.model.coordinates if sensors is None else sensors
        names = [s if isinstance(s, str) else s.name for s in read]
        noise, lines = self.noise((*self.model.inputs, *names)), (HARMONICS, 20.0, 5000.0, 260)
        return Plan(self.forces(HARMONICS), *lines, noise, 2 * np.pi * hertz, sensors)

    def noise(self, names: Sequence[str]) -> dict[str, float]:
        inputs = self.model.inputs
        return {n: self.force_noise if n in inputs else self.position_noise for n in names}

    def noisy(self, record: PeriodicRecord, rng: np.random.Generator) -> PeriodicRecord:
        return add_noise(record, self.noise(record.names), rng)

    def seen(
        self,
        rng: np.random.Generator | int,
        sensors: Sequence[Channel | str] | None = BEARINGS,
        **more: Any,
    ) -> PeriodicRecord:
        """Return a record with noise."""
        return self.noisy(self.record(sensors, **more), np.random.default_rng(rng))

    def identified(
        self, records: PeriodicRecord | Sequence[PeriodicRecord], **known: Any
    ) -> Estimate:
        """Return the estimate; one length is known, which bearing sensors do not tell."""
        estimator = MaximumLikelihood(**{"fixed": {"L1": 0.3}, **known})
        return rid.identify(self.model, records, estimator)

    def start(self, rng: np.random.Generator, spread: float = 0.4) -> dict[str, float]:
        """Return starts within +-spread of the truth, of what is not unbalance."""
        unbalance = {"xi", "zeta", "mu", "eta"}
        return {
            name: value * (1 + spread * rng.uniform(-1, 1))
            for name, value in self.truth.items()
            if name not in unbalance
        }


Draw = Callable[[np.random.Generator], tuple[Sequence[PeriodicRecord], MaximumLikelihood]]


@dataclass
class Statistics:
    names: list[str] = field(default_factory=list)
    directions: int = 0
    truth: list[float] = field(default_factory=list)
    errors: list[Floats] = field(default_factory=list)
    stds: list[Floats] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)
    misfits: list[Misfit] = field(default_factory=list)
    statuses: list[str] = field(default_factory=list)

    @classmethod
    def over_seeds(
        cls, model: Model, truth: Mapping[str, float], draw: Draw, seeds: int, seed: int
    ) -> "Statistics":
        """Run an estimator over seeds; every generator follows from one number."""
        found = cls()
        for sequence in np.random.SeedSequence(seed).spawn(seeds):
            records, estimator = draw(np.random.default_rng(sequence))
            found.add(rid.identify(model, records, estimator), truth)
        return found

    def add(self, estimate: Estimate, truth: Mapping[str, float]) -> None:
        # One good record in two thousand shows a creep of its angle, which is unknown then.
        asked = [
            k
            for k, value in enumerate(estimate.free)
            if value.name in truth or not value.name.startswith("phase[")
        ]
        free = [estimate.free[k] for k in asked]
        self.names = [value.name for value in free]
        self.truth = [truth[name] for name in self.names]
        self.statuses.append(estimate.status)
        error = np.array([value.value for value in free]) - self.truth
        self.append(error, estimate.covariance[np.ix_(asked, asked)], estimate.misfit)

    def append(self, error: Floats, covariance: Floats, misfit: Misfit) -> None:
        std = np.sqrt(np.diag(covariance))
        self.errors.append(error)
        self.stds.append(std)
        # An exact constraint leaves a direction without variance.
        size, along = np.linalg.eigh(covariance / np.outer(std, std))
        kept = size > 1e-10
        self.directions = int(kept.sum())
        self.distances.append(float(((error / std @ along[:, kept]) ** 2 / size[kept]).sum()))
        self.misfits.append(misfit)

    @property
    def p_values(self) -> Floats:
        return np.array([misfit.p_value for misfit in self.misfits])

    @property
    def expected(self) -> Floats:
        return np.array([misfit.expected for misfit in self.misfits])

    @property
    def rms(self) -> Floats:
        return np.sqrt((np.array(self.errors) ** 2).mean(axis=0))

    @property
    def stated(self) -> Floats:
        return np.sqrt((np.array(self.stds) ** 2).mean(axis=0))

    @property
    def coverage(self) -> Floats:
        return (np.abs(self.errors) < 1.959964 * np.array(self.stds)).mean(axis=0)

    @property
    def cost_deviation(self) -> float:
        """Mean of J less its expectation, in standard errors."""
        difference = np.array([misfit.cost for misfit in self.misfits]) - self.expected
        return float(difference.mean() / (difference.std(ddof=1) / np.sqrt(len(difference))))

    @property
    def distance_deviation(self) -> float:
        """Mean of (estimate - truth)' C^-1 (estimate - truth) less its expectation, likewise."""
        distance = np.array(self.distances)
        error = distance.std(ddof=1) / np.sqrt(len(distance))
        return float((distance.mean() - self.directions) / error)

    @property
    def rejected(self) -> float:
        return float((self.p_values < 0.05).mean())


@dataclass(frozen=True)
class Levitated:
    """The demo's rotor driven by currents: F = k_i i + k_s x, and sensors with runout.

    The currents are such that k_i i is the demo's force.
    """

    machine: Machine
    ki: Mapping[str, float]
    ks: float
    runout: Mapping[str, tuple[float, float]]

    @property
    def truth(self) -> dict[str, float]:
        constants = {f"ki[{name}]": value for name, value in self.ki.items()}
        vectors = {
            f"runout[{sensor}].{part}": value
            for sensor, vector in self.runout.items()
            for part, value in zip(("cos", "sin"), vector, strict=True)
        }
        return {**self.machine.truth, **constants, "ks": self.ks, **vectors}

    @property
    def weighed(self) -> rid.Constraint:
        """The mass of the rotor, known exactly."""
        return rid.Constraint("m1 + m2 + m3", sum(self.truth[name] for name in ("m1", "m2", "m3")))

    def record(self, hertz: float, *, drives: bool = True) -> PeriodicRecord:
        """Return a record of currents (or, without drives, of forces) and bearing sensors."""
        model = self.machine.model
        where = dict(zip(model.inputs, BEARINGS, strict=True))
        stiff = with_force_slope(model, where) if drives else model
        truth = {**self.machine.truth, "ks": self.ks}
        record = replace(self.machine, model=stiff, truth=truth).record(BEARINGS, hertz=hertz)
        for name, place in where.items() if drives else ():
            law = Drive(self.ki[name], self.ks, {place: 1.0})
            record = stated(times(record, [name], 1 / law.ki), [name], unit="A", drive=law)
        for sensor, (cos, sin) in self.runout.items():
            record = shaken(record, round(hertz / 20.0), [sensor], (cos - 1j * sin) / 2)
        return record

    def seen(
        self, rng: np.random.Generator | int, *speeds: float, drives: bool = True
    ) -> list[PeriodicRecord]:
        """Return records with noise at some speeds, in Hz."""
        rng = np.random.default_rng(rng)
        return [self.noisy(self.record(hertz, drives=drives), rng) for hertz in speeds]

    def noisy(self, record: PeriodicRecord, rng: np.random.Generator) -> PeriodicRecord:
        noise = self.machine.noise(record.names)
        drives = {c.name: c.drive.ki for c in record.channels if c.drive}
        return add_noise(record, {n: s / drives.get(n, 1.0) for n, s in noise.items()}, rng)


def with_force_slope(model: Model, where: Mapping[str, str]) -> Model:
    equations, rest = model.file_text.split("[coordinates]")
    for name, coordinate in where.items():
        equations = re.sub(rf"\b{name}\b", f"{name} + ks*{coordinate}", equations)
    return rid.parse_model(f'{equations}[coordinates]{rest}ks = {{ unit = "N/m" }}\n')


@pytest.fixture(scope="session")
def levitated(demo):
    ki = dict.fromkeys(("F_x1", "F_y1", "F_x3", "F_y3"), 120.0)
    runout = {"x1": (5e-6, -3e-6), "y1": (2e-6, 4e-6), "x3": (-6e-6, 1e-6), "y3": (3e-6, 3e-6)}
    return Levitated(demo, ki, 2e5, runout)


@pytest.fixture(scope="session")
def demo():
    model = rid.load_model("three-mass")
    return Machine(model, model.nominal)


@pytest.fixture(scope="session")
def bearings():
    return BEARINGS


@pytest.fixture(scope="session")
def statistics():
    return Statistics
