"""
Balancing without a trial run
=============================

A levitated rotor is identified from its bearings' sensors and coil currents; what came out says
which masses to mount in two planes, and how much unbalance is left at most. The machine is
simulated, so that what is really left can be computed.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import rotorid as rid
from rotorid import load_rig

rig = load_rig("three-mass").rig
bearings = ("x1", "y1", "x3", "y3")
rig = replace(rig, sensors=tuple(s for s in rig.sensors if s.name in bearings))
record = rig.run(13.0, np.random.default_rng(3))
periods = rid.average(record, "20 Hz", harmonics=[1, 3, 5, 7, 9, 11])
estimate = rid.identify(rig.model, periods, rid.MaximumLikelihood(fixed={"L1": "300 mm"}))
for plane in estimate.unbalance:
    degrees = np.degrees(plane.angle_rad)
    print(f"{plane.plane}: {plane.amount:.4g} {plane.unit} at {degrees:.1f} degrees")

# %%
# Two planes on the disc, 20 mm to either side of its middle: the disc has a tilt besides its
# eccentricity, so that one plane would not do.

planes = ("x2 - 0.02*theta_y, y2 + 0.02*theta_x", "x2 + 0.02*theta_y, y2 - 0.02*theta_x")
found = rid.balance(estimate, planes, "8400 rpm", radius="60 mm")
for correction, residual in zip(found.corrections, found.residual, strict=True):
    (mass, angle), *_ = correction.masses
    print(
        f"{1e3 * mass:.3f} g at {np.degrees(angle):.1f} degrees; with 95 % less than "
        f"{1e6 * residual.unbalance_kg_m:.2f} g mm is left"
    )

# %%
# What is really left: the response of the true rotor to its true unbalance, before and after.

linear, speed = rig.model.require_linear(), 2 * np.pi * 140
values = rig.model.values(rig.values)
mu = rig.model.monomial_values(values)
quarter = linear.load_columns(np.zeros(2), np.array([0.0, np.pi / 2]), speed) @ mu
load = quarter[0] - 1j * quarter[1]
added = np.zeros_like(load)
disc = ("x2", "y2", "theta_x", "theta_y")
x, y, theta_x, theta_y = (rig.model.coordinates.index(name) for name in disc)
for correction, arm in zip(found.corrections, (0.02, -0.02), strict=True):
    vector = speed**2 * correction.unbalance_kg_m * np.exp(1j * correction.angle_rad)
    added[[x, theta_y]] += vector * np.array([1.0, -arm])
    added[[y, theta_x]] += -1j * vector * np.array([1.0, arm])
stiffness = linear.dynamic_stiffness([speed], values, speed)[0]
before, after = (np.abs(np.linalg.solve(stiffness, right)) for right in (load, load + added))
kept = [rig.model.coordinates.index(name) for name in ("x1", "x2", "x3")]
print("before, um at bearing a, disc, bearing b:", (1e6 * before[kept]).round(2))
print("after:", (1e6 * after[kept]).round(4))

figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
places = np.arange(3)
axes.bar(places - 0.2, 1e6 * before[kept], 0.4, label="before")
axes.bar(places + 0.2, 1e6 * after[kept], 0.4, label="after")
axes.set_yscale("log")
axes.set_xticks(places, ["bearing a", "disc", "bearing b"])
axes.set_ylabel("1x of the free rotor, um")
axes.set_ylim(top=400)
axes.legend(loc="upper center", ncols=2)
plt.show()
