"""Good records: random machines whose every record a right model explains.

Six machines: those of `adverse`, with samples; random rotors and towers, with lines alone; the
shipped rig in closed loop, with samples. Noise, number of periods and speed vary.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import count

import adverse
import numpy as np
from adverse import FUNDAMENTAL, LINES, UNBALANCE
from rotor_bank import SETTINGS, Structure, rotor_case, structure_case

import rotorid as rid
from rotorid.models import Model
from rotorid.record import PeriodicRecord
from rotorid.rig.file import load_rig
from rotorid.rig.rig import Rig

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
    """Return a machine with samples."""
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
        record = adverse.record_of(trial)
        return (rid.average(record, FUNDAMENTAL, harmonics=trial.harmonics),)

    what = f"{kind}, {trial.periods} periods, {turns} turns, noise {trial.noise:.2g}"
    estimator = rid.MaximumLikelihood(fixed=fixed, start=start)
    return Good(what, trial.machine.model, truth, records, estimator)


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
        case = next(c for c in drawn if c.truth["I_p"] < 1.9 * c.truth["I_t"])
    estimator = rid.MaximumLikelihood(fixed=case.fixed, start=case.start)
    return Good(what, case.model, case.truth, lambda: case.records, estimator)


@cache
def _rig() -> Rig:
    return load_rig("three-mass").rig


def levitated(kind: str, seed: int) -> Good:
    """Return the shipped rig in closed loop."""
    rng = np.random.default_rng([seed, 43])
    rig, seconds = _rig(), float(rng.choice([3.0, 6.0, 10.0]))

    def records() -> tuple[PeriodicRecord, ...]:
        record = rig.run(seconds, rng)
        return (rid.average(record, 20.0, harmonics=[1, 3, 5, 7, 9, 11]),)

    truth = rig.values
    return Good(f"{seconds:g} s", rig.model, truth, records, rid.MaximumLikelihood())


MACHINES: dict[str, Callable[[str, int], Good]] = {
    "jeffcott": sampled,
    "rigid": sampled,
    "three": sampled,
    "rotor": listed,
    "tower": listed,
    "rig": levitated,
}


def good_record(kind: str, seed: int) -> Good:
    """Return one good record of a machine."""
    return MACHINES[kind](kind, seed)
