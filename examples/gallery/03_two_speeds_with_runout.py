"""
Two speeds tell runout from unbalance
=====================================

The track of a position sensor is never round. At one speed its runout and the unbalance look alike;
unbalance grows with the square of the speed and runout does not, so that a second speed tells them
apart.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import rotorid as rid
from rotorid import load_rig
from rotorid.rig.parts import SensorRunout

plan = load_rig("three-mass").rig
bearings = ("x1", "y1", "x3", "y3")
sensors = tuple(
    replace(s, runout=(SensorRunout(1, 4e-6, 1e-6),)) for s in plan.sensors if s.name in bearings
)


def record(speed: float, seed: int) -> rid.PeriodicRecord:
    """Return the periods of a record at a speed in revolutions per second."""
    rotation = replace(plan.rotation, speed=2 * np.pi * speed)
    run = replace(plan, sensors=sensors, rotation=rotation).run(13.0, np.random.default_rng(seed))
    return rid.average(run, "20 Hz", harmonics=[1, 3, 5, 7, 9, 11])


slow, fast = record(100.0, 1), record(140.0, 2)

# %%
# Where runout is taken as zero, the data contradict the model: four micrometres are a lot. The
# first warning names what would explain it; at one speed that may be a load, which moves the same
# lines.

quiet = rid.MaximumLikelihood(fixed={"L1": "300 mm"})
for name, records in (("140 rev/s alone", [fast]), ("both speeds", [slow, fast])):
    found = rid.identify(plan.model, records, quiet)
    print(f"{name}: {found.status}; {found.warnings[0] if found.warnings else 'no warning'}")

# %%
# With runout unknown, one speed does not determine the unbalance; two do.

open_ = replace(quiet, runout=True)
print("one speed:", rid.identify(plan.model, fast, open_).status)
both = rid.identify(plan.model, [slow, fast], open_)
print(both)

# %%
truth, names = plan.values, ("xi", "zeta", "mu", "eta")
cases = {"runout taken as 0": rid.identify(plan.model, fast, quiet), "two speeds": both}
figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
for shift, (label, case) in zip((-0.1, 0.1), cases.items(), strict=True):
    size = np.array([abs(truth[name]) for name in names])
    error = np.array([case.value(name) - truth[name] for name in names]) / size
    std = np.array([case.std(name) for name in names]) / size
    axes.errorbar(np.arange(4) + shift, 100 * error, 196 * std, fmt="o", capsize=3, label=label)
axes.axhline(0, color="0.6", lw=0.8)
axes.set_xticks(range(4), names)
axes.set_ylabel("error and 95 % interval, %")
axes.legend()
plt.show()
