"""
The paper's table
=================

The numerical example of Levy and Arogeti: all eight coordinates measured, one period of the forces
260 times, 1 N and 22 um of noise on every sample. Twenty records with fresh noise, identified by
the paper's estimators and by maximum likelihood, beside the least error that an unbiased estimate
can have (the Cramer-Rao bound).
"""

import matplotlib.pyplot as plt
import numpy as np

from rotorid.demo import run_demo

result = run_demo(20, rng=np.random.default_rng(2026))
print(f"{'rms error in %':20}" + "".join(f"{name:>12}" for name in (*result.estimators, "bound")))
for row, name in enumerate(result.names):
    rms = [result.rms(estimator)[row] for estimator in result.estimators]
    print(f"{name:20}" + "".join(f"{x:12.3f}" for x in (*rms, result.bound_percent[row])))

# %%
figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
for estimator in result.estimators:
    axes.plot(result.rms(estimator), result.names, "o", label=estimator)
axes.plot(result.bound_percent, result.names, "k|", ms=12, label="bound")
axes.set_xscale("log")
axes.set_xlabel("rms error in %")
axes.legend()
plt.show()
