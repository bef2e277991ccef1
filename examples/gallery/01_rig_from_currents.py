"""
A levitated rotor from its coil currents
========================================

The main use: a flexible rotor on magnetic bearings, the bearings' own four position sensors, four
coil currents, one length by a ruler and one mass by a scale. Everything else is unknown, the
constants of the bearings included.

The machine is simulated, so that the truth can stand beside the answer: the shipped rig
``three-mass``, 8400 rpm, under a PID on each axis, 13 s at 10 kHz, with noise on sensors and
currents and with random forces on the rotor that nobody measures.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import rotorid as rid
from rotorid import load_rig

rig = load_rig("three-mass").rig
bearings = ("x1", "y1", "x3", "y3")
rig = replace(rig, sensors=tuple(s for s in rig.sensors if s.name in bearings))
record = rig.run(13.0, np.random.default_rng(1))
print(record)

# %%
# The excitation repeats every 50 ms. The record is cut into these periods; what differs from one to
# the next is noise, and what they share is motion, on the lines that were excited.

periods = rid.average(record, "20 Hz", harmonics=[1, 3, 5, 7, 9, 11])

# %%
# What is known beforehand: the distance from the first bearing to the disc, and the rotor's mass.
# ``gains`` says which constants of the bearings are to be found: the force per current of each
# axis, and the force per displacement.

known = rid.MaximumLikelihood(
    fixed={"L1": "300 mm"},
    constraints=(rid.Constraint("m1 + m2 + m3", "12.98878 kg"),),
    gains=("ki", "ks"),
)
estimate = rid.identify(rig.model, periods, known)
print(estimate)

# %%
# Against the truth, each error over the deviation that the answer states: most should lie within
# one, and hardly any beyond three.

truth = {**rig.values, **{f"ki[{name}]": 120.0 for name in rig.model.inputs}, "ks": 2e5}
found = [value for value in estimate.free if value.name in truth]
errors = [(value.value - truth[value.name]) / value.std for value in found]

figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
axes.axhspan(-1.96, 1.96, color="0.9", label="95 % intervals")
axes.plot([value.name for value in found], errors, "o")
axes.set_ylabel("error / std")
axes.set_ylim(-4, 4)
axes.tick_params(axis="x", rotation=60)
axes.legend()
plt.show()
