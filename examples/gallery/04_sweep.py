"""
A sweep, one axis after the other
=================================

Nothing repeats in a sweep, and the speed of the rotation fits no line. What was added to the
commands was recorded too: with these references noise is told from motion in any record.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import rotorid as rid
from rotorid import load_rig
from rotorid.signals.multisine import multisine

SECONDS, RATE = 5.0, 10e3
rig = load_rig("three-mass").rig
bearings = ("x1", "y1", "x3", "y3")
rig = replace(
    rig,
    sensors=tuple(s for s in rig.sensors if s.name in bearings),
    rotation=replace(rig.rotation, speed=2 * np.pi * 137.31),
)


def sweep(axis: str, seed: int) -> rid.Record:
    """Return a record of one axis swept from 5 to 230 Hz, with what was added as a column."""
    lines = range(round(5 * SECONDS), round(230 * SECONDS))
    signal = multisine(1 / SECONDS, lines, {axis: 0.6}, phases="schroeder")
    record = replace(rig, excitation=signal).run(SECONDS, np.random.default_rng(seed))
    added = signal.samples(RATE)
    return rid.Record(
        (*record.channels, rid.Channel(f"added to {axis}", "N")),
        np.column_stack([record.samples, added]),
        record.sample_rate,
        record.speed,
    )


records = [sweep(axis, seed) for seed, axis in enumerate(rig.model.inputs)]
names = ("F_x1", "x1", "x3", "added to F_x1")
figure, panels = plt.subplots(4, figsize=(8, 6), sharex=True, layout="constrained")
for panel, name in zip(panels, names, strict=True):
    panel.plot(np.arange(len(records[0].samples)) / RATE, records[0].column(name), lw=0.4)
    panel.set_ylabel(name)
panels[-1].set_xlabel("time in s")
plt.show()

# %%
# Each record becomes its lines in the band that was swept, with the covariance of their noise. The
# mark of the rotor angle counts from the same zero in all of them.

lines = [
    rid.spectra(record, ("5 Hz", "230 Hz"), references=[f"added to {axis}"])
    for record, axis in zip(records, rig.model.inputs, strict=True)
]
estimate = rid.identify(rig.model, lines, rid.MaximumLikelihood(fixed={"L1": "300 mm"}))
print(estimate)

# %%
for value in estimate.parameters:
    if not value.fixed:
        error = (value.value - rig.values[value.name]) / value.std
        print(f"{value.name:5} off by {error:+.2f} of its deviations")
