"""The main job: a levitated rotor from the sensors and coil currents of its own bearings.

The shipped rig `three-mass`, with the four position sensors of its bearings alone. What is taken as
known is a length by a ruler and the rotor's mass by a scale; the constants of the bearings are not,
and start some per cent off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.answer.identify import identify
from rotorid.core.frozen import frozen
from rotorid.data.record import Drive, PeriodicRecord
from rotorid.likelihood.estimator import MaximumLikelihood
from rotorid.models import Model
from rotorid.models.constraints import Constraint
from rotorid.rig.file import load_rig
from rotorid.signals.average import average
from rotorid.signals.inspection import Inspection, inspect_record

RIG = "three-mass"
SENSORS = ("x1", "y1", "x3", "y3")  # in the planes of the bearings
SECONDS = 13.0
FUNDAMENTAL = 20.0  # Hz
HARMONICS = (1, 3, 5, 7, 9, 11)
STATED = 0.95  # of the constants of the bearings: what a data sheet may be off
WEIGHED = 0.005  # kg, deviation of the scale
MASS = "m1 + m2 + m3"


@frozen
class MachineResult:
    """A machine, what its record showed, and what came out beside the truth."""

    model: Model
    inspection: Inspection
    periods: PeriodicRecord
    estimator: MaximumLikelihood  # what was known beforehand
    estimate: Estimate
    # of the parameters, and of the constants of the bearings by their names in the estimate
    truth: Mapping[str, float]


def run_machine(rng: np.random.Generator) -> MachineResult:
    """Run the rig, look at its record, and identify it from what its bearings measure."""
    rig = load_rig(RIG).rig
    rig = replace(rig, sensors=tuple(s for s in rig.sensors if s.name in SENSORS))
    record = rig.run(SECONDS, rng)
    laws = {name: part.law.linearize() for name, part in rig.actuators.items() if part.law}
    truth = {**rig.values, **{f"ki[{name}]": law.ki for name, law in laws.items()}}
    truth["ks"] = next(iter(laws.values())).ks
    channels = tuple(
        c if c.drive is None else replace(c, drive=_stated(c.drive)) for c in record.channels
    )
    record = replace(record, channels=channels)
    periods = average(record, FUNDAMENTAL, harmonics=HARMONICS)
    total = sum(rig.values[name] for name in ("m1", "m2", "m3"))
    known = MaximumLikelihood(
        fixed={"L1": rig.values["L1"]},
        constraints=(Constraint(MASS, total + WEIGHED * rng.standard_normal(), WEIGHED),),
        gains=("ki", "ks"),
    )
    size = round(record.sample_rate / FUNDAMENTAL)
    found = inspect_record(record, period_samples=size, harmonics=HARMONICS)
    return MachineResult(
        rig.model, found, periods, known, identify(rig.model, periods, known), truth
    )


def _stated(drive: Drive) -> Drive:
    """Return the law of a bearing as a data sheet may have it."""
    return replace(drive, ki=STATED * drive.ki, ks=STATED * drive.ks)
