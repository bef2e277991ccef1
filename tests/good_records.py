"""Good records: random machines whose every record a right model explains.

Six machines: those of `adverse`, with samples; random rotors and towers, with lines alone; the
shipped rig in closed loop, with samples. Noise, number of periods and speed vary.

A record is good if it informs: no parameter but the unbalance has a Cramer-Rao deviation above a
quarter of its value at the truth. Of a random rotor of four sensors, driven weakly or at rest, 1 in
40 has: I_t +- 222 %, or k1 +- 54 %, which is to be refused rather than called ok.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import count

import adverse
import numpy as np
from adverse import FUNDAMENTAL, LINES, TURN, UNBALANCE
from rotor_bank import (
    COORDINATES,
    SETTINGS,
    Case,
    Complexes,
    Structure,
    rotor_case,
    rotor_lines,
    structure_case,
)

import rotorid as rid
from rotorid import Model, PeriodicRecord, load_rig

INFORMS = 0.25
"""Share of its value that the Cramer-Rao deviation of a parameter may have in a good record."""
ROTORS = [name for name in SETTINGS if "at a time" not in name and "noise" not in name]


@dataclass(frozen=True)
class Good:
    """A machine, how to get its records, and how to identify them."""

    what: str
    model: Model
    truth: Mapping[str, float]
    records: Callable[[], tuple[PeriodicRecord, ...]]
    estimator: rid.MaximumLikelihood


def sampled(kind: str, seed: int) -> Good:
    rng = np.random.default_rng([seed, 41])
    if kind == "three" and seed % 2:
        kind = "eight"
    trial = adverse.new_trial(kind, rng)
    trial.noise *= float(10 ** rng.uniform(-1, 0.7))
    trial.periods = int(rng.choice([20, 30, 60, 150]))
    turns = int(rng.choice([3, 5, 7, 8, 9]))
    trial.rotation, trial.speed = float(turns), turns * FUNDAMENTAL
    trial.harmonics = tuple(sorted({*LINES, turns}))
    truth = trial.machine.truth
    start = {n: v * rng.uniform(0.8, 1.2) for n, v in truth.items() if n not in UNBALANCE}
    fixed = {n: truth[n] for n in trial.machine.fixed}
    start = {n: v for n, v in start.items() if n not in fixed}

    def records() -> tuple[PeriodicRecord, ...]:
        adverse.measure(trial)
        return (rid.average(adverse.record_of(trial), FUNDAMENTAL, harmonics=trial.harmonics),)

    what = f"{kind}, {trial.periods} periods, {turns} turns, noise {trial.noise:.2g}"
    estimator = rid.MaximumLikelihood(fixed=fixed, start=start)
    return Good(what, trial.machine.model, truth, records, estimator)


def rotor_bound(case: Case) -> dict[str, float]:
    """Return the Cramer-Rao deviations of a random rotor at the truth, all unknowns freed at once.

    With the true forces profiled out, y - H u has the covariance of y plus H (that of u) H^H.
    """
    record, truth = case.records[0], dict(case.truth)
    omega = TURN * 20.0 * np.asarray(record.harmonics, dtype=float)
    mean = record.spectra.mean(axis=0)
    scatter = record.spectra.std(axis=0, ddof=1) / np.sqrt(len(record.spectra))
    noise = np.sqrt((scatter**2).mean(axis=0))
    where = [COORDINATES.index(c.name) for c in record.channels[4:]]

    def read(p: Mapping[str, float], force: Complexes, speed: float) -> Complexes:
        return rotor_lines(p, speed, omega, force)[:, where]

    speed = record.speed
    calm = truth | dict.fromkeys(UNBALANCE, 0.0)
    ones = [np.eye(4)[[k]] * np.ones((len(omega), 1)) for k in range(4)]
    response = np.stack([read(calm, one + 0j, speed) for one in ones], axis=2)
    driven = (response * noise[:4] ** 2) @ response.conj().transpose(0, 2, 1)
    root = np.linalg.cholesky(noise[4:, None] ** 2 * np.eye(len(where)) + driven)
    names = [n for n in truth if n not in case.fixed]
    columns = []
    for name in names:
        step = 1e-4 * truth[name]
        ends = [read(truth | {name: truth[name] + s * step}, mean[:, :4], speed) for s in (1, -1)]
        slope = np.linalg.solve(root, ((ends[0] - ends[1]) / 2e-4)[:, :, None])[:, :, 0].ravel()
        columns.append(np.sqrt(2) * np.concatenate([slope.real, slope.imag]))
    triangle = np.linalg.qr(np.stack(columns, axis=1), mode="r")
    spread = np.linalg.solve(triangle, np.eye(len(names)))
    return dict(zip(names, np.sqrt((spread**2).sum(axis=1)), strict=True))


def informs(case: Case) -> bool:
    """Tell whether a rotor's record informs: see the head of this file."""
    bound = rotor_bound(case)
    return max(share for name, share in bound.items() if name not in UNBALANCE) < INFORMS


def listed(kind: str, seed: int) -> Good:
    """Return a random rotor or tower with lines alone."""
    if kind == "tower":
        modes = (2, 3, 5)[seed % 3]
        what = f"{modes} modes"
        case = structure_case(Structure(modes=modes, off=0.05, lines=40 * modes), 900 + seed)
    else:
        what = ROTORS[seed % len(ROTORS)]
        drawn = (rotor_case(SETTINGS[what], 900 + 10_000 * k + seed) for k in count())
        # A rotor has I_p <= 2 I_t.
        case = next(c for c in drawn if c.truth["I_p"] < 1.9 * c.truth["I_t"] and informs(c))
    estimator = rid.MaximumLikelihood(fixed=case.fixed, start=case.start)
    return Good(what, case.model, case.truth, lambda: case.records, estimator)


_plan = cache(lambda: load_rig("three-mass"))


def levitated(kind: str, seed: int) -> Good:
    rng = np.random.default_rng([seed, 43])
    rig, seconds = _plan().rig, float(rng.choice([3.0, 6.0, 10.0]))

    def records() -> tuple[PeriodicRecord, ...]:
        return (rid.average(rig.run(seconds, rng), 20.0, harmonics=[1, 3, 5, 7, 9, 11]),)

    return Good(f"{seconds:g} s", rig.model, rig.values, records, rid.MaximumLikelihood())


MACHINES: dict[str, Callable[[str, int], Good]] = {
    **dict.fromkeys(("jeffcott", "rigid", "three"), sampled),
    **dict.fromkeys(("rotor", "tower"), listed),
    "rig": levitated,
}


def good_record(kind: str, seed: int) -> Good:
    return MACHINES[kind](kind, seed)
