"""A rotor in passive bearings from two coast-downs, one with a trial mass: what to take off, where.

    python examples/coast_down.py [seed]

Writes two tables of 1x phasors, as a balancing instrument gives them (rpm, um peak to peak, phase
lag in degrees), the model and the experiment file into a folder of its own, and identifies them as
`rotorid identify experiment.toml` does. docs/experiments.md has the keys.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import rotorid as rid

MODEL = """title = "One disc on an elastic shaft in passive bearings, with a trial mass"
equations = [
  "m*x'' + c*x' + k*x = Omega^2*((u_x + t_x)*cos(phi) - (u_y + t_y)*sin(phi))",
  "m*y'' + c*y' + k*y = Omega^2*((u_x + t_x)*sin(phi) + (u_y + t_y)*cos(phi))",
]
coordinates = { x = "m", y = "m" }
[parameters]
m = { unit = "kg", nominal = 4.0, positive = true }
c = { unit = "N s/m", nominal = 100.0, positive = true }
k = { unit = "N/m", nominal = 1.5e6, positive = true }
u_x = { unit = "kg m" }
u_y = { unit = "kg m" }
t_x = { unit = "kg m" }
t_y = { unit = "kg m" }
"""
RECORD = """
[[records]]
kind = "phasors"
file = "{file}"
speed = {{ column = "n", unit = "rpm" }}
"""
REST = """
[records.parameters]
t_x = { fixed = "50 g mm" }
[channels]
x = { amplitude = "ax", phase = "px", unit = "um", std = "2 um", lag = true, peak_to_peak = true }
y = { amplitude = "ay", phase = "py", unit = "um", std = "2 um", lag = true, peak_to_peak = true }
[parameters]
t_x = { fixed = "0 g mm" }
t_y = { fixed = "0 g mm" }
"""


def coast_down(path: Path, trial: float, rng: np.random.Generator) -> None:
    """Write the table of a rotor of 5 kg, 150 N s/m, 1e6 N/m and 112 g mm at -27 degrees."""
    rpm = np.linspace(7000, 2000, 40)
    speed = rpm * np.pi / 30
    whirl = (1e-4 - 5e-5j + trial) * speed**2 / (1e6 - 5.0 * speed**2 + 150j * speed)
    columns = [rpm]
    for phasor in (whirl, -1j * whirl):
        noisy = phasor + 1e-6 * (rng.standard_normal(40) + 1j * rng.standard_normal(40))
        columns += [2e6 * np.abs(noisy), -np.degrees(np.angle(noisy))]
    header = "n,ax,px,ay,py"
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")


def main(seed: int = 0) -> rid.Estimate:
    """Identify the rotor, and say what to take off."""
    folder, rng = Path(tempfile.mkdtemp()), np.random.default_rng(seed)
    coast_down(folder / "bare.csv", 0.0, rng)
    coast_down(folder / "trial.csv", 5e-5, rng)
    (folder / "model.toml").write_text(MODEL)
    records = RECORD.format(file="bare.csv") + RECORD.format(file="trial.csv")
    path = folder / "experiment.toml"
    path.write_text('model = "model.toml"\n' + records + REST)
    experiment = rid.load_experiment(path)
    estimate = rid.identify(experiment.model, experiment.records(), experiment.estimator())
    unbalance = estimate.value("u_x") + 1j * estimate.value("u_y")
    critical = np.sqrt(estimate.value("k") / estimate.value("m")) * 30 / np.pi
    print(f"{folder}\n{estimate}\n")
    print(
        f"critical speed {critical:.1f} rpm; take off {1e6 * abs(unbalance):.2f} g mm at "
        f"{np.degrees(np.angle(unbalance)):.2f} degrees from the mark, or put it on opposite"
    )
    return estimate


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
