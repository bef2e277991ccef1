"""
Bearing sensors only: what they can tell
========================================

No sensor at the disc, the forces known: what does a record of the bearings' own sensors hold, and
what does each further sensor or known length add? Asked before anything is measured: the least
deviations that any unbiased estimate can have, from the model, the forces and the noise alone.
"""

import matplotlib.pyplot as plt
import numpy as np

import rotorid as rid

model = rid.load_model("three-mass")
lines = [1, 3, 5, 7, 9, 11]
wave = np.outer(10 - 10j * np.ones(len(lines)), [0.5, 1.0, 1.0, -0.5])
noise = {name: 1.0 for name in model.inputs} | {name: 22e-6 for name in model.coordinates}


def deviations(sensors: tuple[str, ...], known: rid.MaximumLikelihood) -> dict[str, float]:
    """Return the deviations in percent that an experiment promises."""
    plan = rid.Plan(wave, lines, "20 Hz", "5 kHz", 260, noise, speed="8400 rpm", sensors=sensors)
    found = rid.predict_accuracy(model, plan, known)
    return {v.name: 100 * v.std / abs(v.value) for v in found.parameters if not v.fixed}


ruler = rid.MaximumLikelihood(fixed={"L1": "300 mm"})
cases = {
    "all eight coordinates": deviations(model.coordinates, rid.MaximumLikelihood()),
    "bearing planes, L1 known": deviations(("x1", "y1", "x3", "y3"), ruler),
    "one bearing and the disc, L1 known": deviations(("x1", "y1", "x2", "y2"), ruler),
}
for name in ("m1", "m2", "I_t", "I_p", "k1", "L2"):
    shown = [f"{case[name]:8.3f}" for case in cases.values()]
    print(f"{name:4}", *shown, "%")

# %%
# Without any length the unit of angle is open: the answer says so, and what would cure it.

bare = rid.predict_accuracy(
    model,
    rid.Plan(wave, lines, "20 Hz", "5 kHz", 260, noise, "8400 rpm", ("x1", "y1", "x3", "y3")),
    rid.MaximumLikelihood(),
)
print(bare.status)
print(*bare.warnings, sep="\n")

# %%
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for name, case in cases.items():
    axes.plot(list(case), list(case.values()), "o", label=name)
axes.set_yscale("log")
axes.set_ylabel("std in %")
axes.legend()
plt.show()
