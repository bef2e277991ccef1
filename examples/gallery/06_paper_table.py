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

import rotorid as rid
from rotorid.demo import FUNDAMENTAL, HARMONICS, run_demo, simulate_record

result = run_demo(20, rng=np.random.default_rng(2026))
print(f"{'rms error in %':20}" + "".join(f"{name:>12}" for name in (*result.values, "bound")))
for row, name in enumerate(result.names):
    rms = [result.rms(estimator)[row] for estimator in result.values]
    print(f"{name:20}" + "".join(f"{x:12.3f}" for x in (*rms, result.bound_percent[row])))

# %%
figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
for estimator in result.values:
    axes.plot(result.rms(estimator), result.names, "o", label=estimator)
axes.plot(result.bound_percent, result.names, "k|", ms=12, label="bound")
axes.set_xscale("log")
axes.set_xlabel("rms error in %")
axes.legend()
plt.show()

# %%
# The mean of the errors is the bias: least squares takes noisy positions as exact.
figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
for estimator, panel in zip(("ls", "ml"), axes, strict=True):
    panel.plot(result.errors(estimator).T, result.names, ".", color="tab:blue")
    panel.axvline(0, color="grey")
    panel.set_xlabel(f"error of {estimator} in %")
plt.show()

# %%
# One record: its spectrum before and after the line filter, the paper's Fig. 2.
model = rid.load_model("three-mass")
record = simulate_record(model, np.random.default_rng(1))
periods = rid.average(record, FUNDAMENTAL, harmonics=HARMONICS)
x1 = 1e6 * record.column("x1")
amplitude = 2 * np.abs(np.fft.rfft(x1, norm="forward"))
frequency = np.fft.rfftfreq(len(x1), 1 / record.sample_rate)
kept = 2e6 * np.abs(periods.mean_spectrum[:, periods.index("x1")])
figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
axes.semilogy(frequency[1:], amplitude[1:], color="0.7", lw=0.6, label="every line of the record")
axes.semilogy(periods.frequency, kept, "o", label="lines of the excitation")
axes.set_xlim(0, 260)
axes.set_xlabel("frequency in Hz")
axes.set_ylabel("amplitude of x1 in um")
axes.legend()
plt.show()
