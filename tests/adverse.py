"""Adverse records: random machines, what was done to their records, and what it must be called.

A case spoils the plant, its samples, or what is said of them. Nothing here uses the project's own
response: samples come from matrices written down once more, so that a sign that is wrong in both
places shows. The edits and the table of cases are in `adverse_cases`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np
from rotor_bank import (
    PAPER,
    UNBALANCE,
    Complexes,
    Floats,
    Rotor,
    jeffcott_rotor,
    rigid_rotor,
    three_mass_rotor,
)

import rotorid as rid
from rotorid import Channel, Estimate, InputError, Model, Record, load_model

TURN = 2 * np.pi
WRONG = 5.0
"""Stated deviations beyond which a value is wrong: of a thousand right records with ten values
each, chance takes one in a hundred records of few periods there."""


@dataclass(frozen=True)
class Machine:
    """A model, a rotor that is one, and what its sensors read."""

    model: Model
    truth: Mapping[str, float]
    rotor: Rotor
    sensors: Mapping[str, Mapping[str, float]]
    fixed: tuple[str, ...] = ()

    def reading(self, name: str) -> Floats:
        row = np.zeros(len(self.rotor.M))
        for coordinate, share in self.sensors[name].items():
            row[self.model.coordinates.index(coordinate)] = share
        return row


def _varied(values: Mapping[str, float], rng: np.random.Generator, signed: str) -> dict[str, float]:
    found = {n: v * float(np.exp(0.2 * rng.standard_normal())) for n, v in values.items()}
    return {n: v * (rng.choice([-1, 1]) if n in signed.split() else 1) for n, v in found.items()}


def jeffcott(rng: np.random.Generator) -> Machine:
    """A disc on an elastic shaft."""
    model = load_model("jeffcott")
    p = _varied({n: model.nominal[n] for n in model.parameter_names}, rng, "xi zeta")
    p["c"] *= 3
    return Machine(model, p, jeffcott_rotor(p), {"x": {"x": 1.0}, "y": {"y": 1.0}})


def rigid(rng: np.random.Generator) -> Machine:
    """A rigid rotor with a sensor and a force at each bearing and axis."""
    model = load_model("rigid")
    p = _varied({n: model.nominal[n] for n in model.parameter_names}, rng, "xi zeta mu eta")
    sensors = {
        "s_xa": {"x": 1.0, "theta_y": -0.17}, "s_ya": {"y": 1.0, "theta_x": 0.17},
        "s_xb": {"x": 1.0, "theta_y": 0.21}, "s_yb": {"y": 1.0, "theta_x": -0.21},
    }  # fmt: skip
    return Machine(model, p, rigid_rotor(p), sensors, ("L_a",))


def three(rng: np.random.Generator, sensors: str = "x1 y1 x3 y3") -> Machine:
    """The paper's rotor, varied, with sensors at the bearings."""
    p = _varied(PAPER, rng, "xi zeta mu eta")
    p["I_p"] = min(p["I_p"], 1.9 * p["I_t"])
    read = {name: {name: 1.0} for name in sensors.split()}
    fixed = () if len(read) == 8 else ("L1",)
    return Machine(load_model("three-mass"), p, three_mass_rotor(p), read, fixed)


def three_eight(rng: np.random.Generator) -> Machine:
    """The same with every coordinate measured."""
    return three(rng, "x1 y1 x2 y2 theta_x theta_y x3 y3")


MACHINES = {"jeffcott": jeffcott, "rigid": rigid, "three": three, "eight": three_eight}
NOISE = {"jeffcott": 1e-6, "rigid": 1e-6, "three": 5e-6, "eight": 5e-6}  # m or rad, per sample
FUNDAMENTAL, RATE, LINES, ROTATION = 20.0, 4000.0, (1, 3, 5, 7, 9, 11), 7.0


@dataclass
class Trial:
    """One record on its way: the plant, its samples, and what is said of them."""

    machine: Machine
    rng: np.random.Generator
    forces: Complexes
    noise: float
    periods: int = 40
    rotation: float = ROTATION  # in units of the fundamental
    columns: dict[str, Floats] = field(default_factory=dict)
    rate: float = RATE
    speed: float = ROTATION * FUNDAMENTAL  # Hz, as said
    fundamental: float = FUNDAMENTAL
    harmonics: tuple[int, ...] = LINES
    skip: float = 0.0
    method: str = "ml"
    options: dict[str, Any] = field(default_factory=dict)
    reads: dict[str, Mapping[str, float]] = field(default_factory=dict)
    cubic: tuple[int, float] | None = None

    @property
    def inputs(self) -> list[str]:
        return list(self.machine.model.inputs)

    @property
    def sensors(self) -> list[str]:
        return list(self.machine.sensors)

    @property
    def size(self) -> int:
        return round(RATE / FUNDAMENTAL)

    def change(self, **matrices: Any) -> None:
        self.machine = replace(self.machine, rotor=self.machine.rotor._replace(**matrices))


def new_trial(kind: str, rng: np.random.Generator) -> Trial:
    """Return a random machine, excited on four or two axes with random phases."""
    machine = MACHINES[kind](rng)
    count = len(machine.model.inputs)
    size = 5 * np.exp(0.3 * rng.standard_normal(count))
    forces = size * np.exp(1j * TURN * rng.random((len(LINES), count)))
    return Trial(machine, rng, forces, NOISE[kind])


def _period(trial: Trial, lines: Mapping[int, Complexes]) -> Floats:
    """Return one period of lines, shape (sample, channel)."""
    count = len(next(iter(lines.values())))
    spectrum = np.zeros((trial.size // 2 + 1, count), dtype=complex)
    for k, values in lines.items():
        spectrum[k] = values
    return np.asarray(np.fft.irfft(spectrum, n=trial.size, axis=0) * trial.size)


def measure(trial: Trial) -> None:
    """Fill the columns: steady motion under forces and unbalance, and white noise."""
    m, speed = trial.machine.rotor, TURN * FUNDAMENTAL * trial.rotation
    force = dict(zip(LINES, trial.forces, strict=True))
    motion = {k: m.response(TURN * FUNDAMENTAL * k, speed, m.B @ f) for k, f in force.items()}
    once = np.zeros(len(m.M), dtype=complex)
    if speed:
        once = m.response(speed, speed, m.U * speed**2)
    if trial.cubic is not None:
        row, k3 = trial.cubic
        at = _bent(trial, motion, once, row, k3)
        motion = {k: v + at.get(k, 0) for k, v in {**dict.fromkeys(at, 0), **motion}.items()}
    count = trial.periods * trial.size
    time = np.arange(count) / RATE
    u = np.tile(_period(trial, force), (trial.periods, 1))
    q = np.tile(_period(trial, motion), (trial.periods, 1))
    q += (once * np.exp(1j * speed * time)[:, None]).real
    read = np.stack([*map(trial.machine.reading, trial.sensors)], axis=1)
    noise = trial.rng.standard_normal((count, u.shape[1] + read.shape[1]))
    values = np.concatenate([u + 0.3 * noise[:, : u.shape[1]], q @ read], axis=1)
    values[:, u.shape[1] :] += trial.noise * noise[:, u.shape[1] :]
    trial.columns = dict(zip([*trial.inputs, *trial.sensors], values.T.copy(), strict=True))


def _bent(
    trial: Trial, linear: Mapping[int, Complexes], once: Complexes, row: int, k3: float
) -> dict[int, Complexes]:
    """Return what a cubic spring at a coordinate adds to the lines: fixed point iteration."""
    m, speed, size = trial.machine.rotor, TURN * FUNDAMENTAL * trial.rotation, trial.size
    count, turns = len(m.M), round(trial.rotation)
    where, added = np.eye(count)[:, row] + 0j, np.zeros((size // 2, count), dtype=complex)
    base = np.zeros_like(added)
    for k, v in linear.items():
        base[k] = v
    base[turns] += once / 2
    peak = np.abs(np.fft.irfft(np.pad(base[:, row], (0, 1)), n=size) * size).max()
    flexible = {k: m.response(TURN * FUNDAMENTAL * k, speed, where) for k in range(1, size // 2)}
    for _ in range(40):
        whole = np.zeros((size // 2 + 1, count), dtype=complex)
        whole[:-1] = base + added
        x = np.fft.irfft(whole[:, row], n=size) * size
        f = np.fft.rfft(-k3 * x * (x / peak) ** 2)[: size // 2] / size
        bent = np.stack([flexible[k] * f[k] if k else 0 * where for k in range(size // 2)])
        added = added + 0.5 * (bent - added)
    return {k: added[k] for k in range(1, size // 2) if np.abs(added[k]).any()}


def record_of(trial: Trial) -> Record:
    units, model = trial.machine.model.units, trial.machine.model
    channels = []
    for name in trial.columns:
        if name in model.inputs or name in model.coordinates:
            channels.append(Channel(name, units[name]))
        else:
            reads = trial.reads.get(name, trial.machine.sensors[name])
            channels.append(Channel(name, "m", reads=dict(reads)))
    samples = np.stack(list(trial.columns.values()), axis=1)
    return Record(channels, samples, trial.rate, speed=TURN * trial.speed)


def estimate_of(trial: Trial) -> Estimate:
    """Identify: what is held is held at its true value, what is not starts 20 % off."""
    truth, machine = trial.machine.truth, trial.machine
    kept = {"harmonics": trial.harmonics, "skip": trial.skip}
    periods = rid.average(record_of(trial), trial.fundamental, **kept)
    if trial.method != "ml":
        return rid.identify(machine.model, periods, trial.method)
    fixed = {name: truth[name] for name in machine.fixed} | trial.options.get("fixed", {})
    start = {
        name: value * (1 + 0.2 * trial.rng.uniform(-1, 1))
        for name, value in truth.items()
        if name not in fixed and name not in UNBALANCE
    }
    options = {**trial.options, "fixed": fixed, "start": start | trial.options.get("start", {})}
    return rid.identify(machine.model, periods, rid.MaximumLikelihood(**options))


@dataclass(frozen=True)
class Outcome:
    """What was said of a record, and how far off the values are, in stated deviations."""

    status: str
    error: float
    worst: str
    said: tuple[str, ...]

    @property
    def wrong(self) -> bool:
        """Whether a wrong answer is called right."""
        return self.status == "ok" and not self.error <= WRONG


def outcome(estimate: Estimate, truth: Mapping[str, float]) -> Outcome:
    off = {
        v.name: abs(v.value - truth[v.name]) / v.std
        for v in estimate.parameters
        if v.name in truth and not v.fixed and v.std
    }
    worst = max(off, key=lambda n: off[n], default="")
    checks = [str(c) for c in estimate.checks if c.verdict not in ("ok",)]
    terms = [s.term for s in estimate.suspects[:3]]
    said = (*terms, *checks, *estimate.warnings)
    return Outcome(estimate.status, off.get(worst, 0.0), worst, said)


Edit = Callable[[Trial], None]
LEADS = ("[", "speed", "mass", "asymmetry", "stiffness", "prior", "load at", "line ")
"""What the words of suspects hold."""


@dataclass(frozen=True)
class Case:
    """One way to spoil a record.

    `plant` acts before the samples are made, `data` on them or on what is said of them. `called`:
    the statuses that are right; `ok` only ever with a right answer. `words`: one of them is said.
    """

    what: str
    machines: str
    called: str
    words: tuple[str, ...] = ()
    plant: Edit | None = None
    data: Edit | None = None

    def run(self, seed: int, *, leads: bool = True) -> Outcome:
        """Return what is said of one record; without leads, which take their time, the rest."""
        if leads:
            return self._outcome(seed)
        with patch("rotorid.likelihood.summary.suspected", lambda *_: iter(())):
            return self._outcome(seed)

    def _outcome(self, seed: int) -> Outcome:
        rng = np.random.default_rng([seed, sum(map(ord, self.what)), len(self.what)])
        kinds = self.machines.split()
        trial = new_trial(kinds[seed % len(kinds)], rng)
        truth = dict(trial.machine.truth)
        if self.plant is not None:
            self.plant(trial)
        measure(trial)
        try:
            if self.data is not None:
                self.data(trial)
            estimate = estimate_of(trial)
        except InputError as error:
            return Outcome("refused", 0.0, "", (str(error),))
        return outcome(estimate, truth)

    @property
    def by_leads(self) -> bool:
        """Whether its words are those of suspects, not of checks."""
        return any(lead in word for lead in LEADS for word in self.words)

    def holds(self, found: Outcome, *, leads: bool = True) -> bool:
        """Tell whether it was called what it must be called, as far as that needs no leads."""
        asked = self.words if leads or not self.by_leads else ()
        named = not asked or any(w in text for w in asked for text in found.said)
        return found.status in self.called.split() and named and not found.wrong
