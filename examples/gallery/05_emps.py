"""
A real machine with friction: EMPS
==================================

The electro-mechanical positioning system of Janot, Gautier and Brunot (2019): one sliding axis, a
motor and a ball screw. Its data are free, but not ours to pass on: this page shows what comes out
where they lie in the folder that ``ROTORID_DATA`` names, and says so where they do not.
"""

# sphinx_gallery_thumbnail_path = "images/report.png"
import os
from pathlib import Path

import matplotlib.pyplot as plt

import rotorid as rid

data = Path(os.environ.get("ROTORID_DATA", "no-data")) / "emps"
print("the data are", "here" if data.is_dir() else "not here: nothing more is shown")

# %%
# Friction is not linear in the motion, so the method is least squares; two settled periods of the
# command, the lines up to 40 Hz. Published are 95.11 kg, 203.5 N s/m, 20.39 N and -3.16 N.

if data.is_dir():
    here = Path(__file__).parent if "__file__" in globals() else Path.cwd()  # as a page is built
    folder = here.parent / "emps"
    experiment = rid.load_experiment(folder / "experiment.toml", folder=data)
    estimate = experiment.identify()
    print(estimate)

# %%
# The result predicts the force of another record; half a period of both.

if data.is_dir():
    other = rid.load_experiment(folder / "validate.toml", folder=data)
    (periods,) = other.records()
    error = rid.predict(experiment.model, estimate, periods)["F"].relative_error
    print(f"relative error of the force: {100 * error:.2f} %")

    (record,) = rid.with_evidence(estimate, experiment.model, [periods]).evidence.records
    force, half = record.channels[0], len(record.time_s) // 2
    figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
    axes.plot(record.time_s[:half], force.wave_measured[:half], "0.6", lw=2.5, label="measured")
    axes.plot(record.time_s[:half], force.wave_predicted[:half], lw=1, label="predicted")
    axes.set_xlabel("time in s")
    axes.set_ylabel("force in N")
    axes.legend()
    plt.show()
