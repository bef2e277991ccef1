"""The main job: a levitated rotor from the sensors and coil currents of its own bearings.

The shipped rig `three-mass`, with the four position sensors of its bearings alone. What is taken as
known is a length by a ruler and the rotor's mass by a scale; the constants of the bearings are not,
and start some per cent off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.answer.identify import identify
from rotorid.core.frozen import frozen
from rotorid.core.tables import Page, Table, table
from rotorid.data.record import PeriodicRecord
from rotorid.likelihood.estimator import MaximumLikelihood
from rotorid.models import Model
from rotorid.models.constraints import Constraint
from rotorid.report.estimate_report import estimate_report, verdict_of
from rotorid.results.evidence import with_evidence
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
    stated = [
        c.drive and replace(c.drive, ki=STATED * c.drive.ki, ks=STATED * c.drive.ks)
        for c in record.channels
    ]
    channels = [replace(c, drive=d) for c, d in zip(record.channels, stated, strict=True)]
    record = replace(record, channels=tuple(channels))
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


def machine_page(result: MachineResult) -> Page:
    """Return what was done, in sentences, and every quantity beside its truth."""
    periods, seconds = result.periods, result.periods.periods / result.periods.fundamental
    fixed = [f"{v.name} = {v.value:g} {v.unit}" for v in result.estimate.parameters if v.fixed]
    return [
        "A levitated rotor from its bearings: four position sensors, four coil currents",
        f"simulated: {seconds:g} s at {periods.sample_rate:g} Hz, "
        f"{periods.speed * 30 / math.pi:.0f} rpm, under a controller",
        f"inspected: {result.inspection.verdict}. {result.inspection.sentence}",
        f"known beforehand: {', '.join(fixed)}, {MASS} by a scale; the constants of the bearings "
        f"were stated {100 * (1 - STATED):.0f} % too small, and are unknown",
        f"identified: {verdict_of(result.estimate).sentence}",
        beside_the_truth(result),
    ]


def beside_the_truth(result: MachineResult) -> Table:
    rows = []
    for value in result.estimate.free:
        if value.name not in result.truth or not value.std:
            continue
        truth = result.truth[value.name]
        off = (value.value - truth) / value.std
        size = f"{100 * value.std / abs(truth):.2g}"
        unit = "" if value.unit == "1" else value.unit
        rows.append((value.name, f"{truth:.6g}", f"{value.value:.6g}", size, f"{off:+.1f}", unit))
    return table(("parameter", "true", "found", "std %", "off by std", "unit"), rows)


def machine_report(result: MachineResult) -> str:
    found = with_evidence(result.estimate, result.model, result.periods, result.estimator)
    return estimate_report(found)
