"""From two runs, one with a trial mass, to the correction: by the command line alone."""

import json

import numpy as np
import pytest

from rotorid import cli

MODEL = """
title = "Jeffcott rotor with a trial plane"
equations = [
  "m*x'' + c*x' + k*x = ki*i_x + Omega^2*((u_x + t_x)*cos(phi) - (u_y + t_y)*sin(phi))",
  "m*y'' + c*y' + k*y = ki*i_y + Omega^2*((u_x + t_x)*sin(phi) + (u_y + t_y)*cos(phi))",
]
[coordinates]
x = "m"
y = "m"
[inputs]
i_x = "A"
i_y = "A"
[parameters]
ki = { unit = "N/A", nominal = 100.0, positive = true }
m = { unit = "kg", nominal = 4.0, positive = true }
c = { unit = "N s/m", nominal = 80.0, positive = true }
k = { unit = "N/m", nominal = 8e5, positive = true }
u_x = { unit = "kg m", nominal = 0 }
u_y = { unit = "kg m", nominal = 0 }
t_x = { unit = "kg m", nominal = 0 }
t_y = { unit = "kg m", nominal = 0 }
"""
EXPERIMENT = """
model = "rotor.toml"
[[records]]
file = "bare.csv"
sample_rate = "1 kHz"
fundamental = "10 Hz"
harmonics = [1, 3, 5, 7, 8, 9]
speed = "3000 rpm"
phase = "0 deg"
"""
TRIAL = """
[[records]]
file = "trial.csv"
sample_rate = "1 kHz"
fundamental = "10 Hz"
harmonics = [1, 3, 5, 7, 8, 9]
speed = "3000 rpm"
phase = "0 deg"
[records.parameters]
t_x = { fixed = "0 g mm" }
t_y = { fixed = "150 g mm" }
"""
REST = """
[channels]
i_x = { column = "ix", unit = "mA" }
i_y = { column = "iy", unit = "mA" }
x = { column = "x", unit = "um" }
y = { column = "y", unit = "um" }
[parameters]
t_x = { fixed = "0 g mm" }
t_y = { fixed = "0 g mm" }
"""
RUNOUT_UNKNOWN = """
[estimator]
runout = true
"""
TRUTH = {"m": 5.0, "c": 60.0, "k": 1e6, "ki": 120.0}
UNBALANCE, MOUNTED = 9e-5 - 6e-5j, 150e-6j
PERIODS, SPEED = 30, 2 * np.pi * 50.0


def run_of(unbalance: complex, rng: np.random.Generator) -> np.ndarray:
    """Return currents (mA) and readings (um) of a settled run with noise."""
    omega = 2 * np.pi * 10.0 * np.array([1, 3, 5, 7, 8, 9])
    current = 0.2 * np.exp(2j * np.pi * rng.random((6, 2)))
    current[2] = 0  # the rotation has its line for itself
    load = TRUTH["ki"] * current
    load[2] = SPEED**2 * unbalance * np.array([1, -1j])
    stiffness = TRUTH["k"] + 1j * omega * TRUTH["c"] - omega**2 * TRUTH["m"]
    waves = np.exp(1j * np.outer(np.arange(100 * PERIODS) / 1000.0, omega))
    motion = load / stiffness[:, None]
    table = np.column_stack([1e3 * (waves @ current).real, 1e6 * (waves @ motion).real])
    return table + np.array([0.5, 0.5, 0.5, 0.5]) * rng.standard_normal(table.shape)


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(8)
    (tmp_path / "rotor.toml").write_text(MODEL)
    for name, unbalance in (("bare", UNBALANCE), ("trial", UNBALANCE + MOUNTED)):
        table = run_of(unbalance, rng)
        np.savetxt(f"{name}.csv", table, delimiter=",", header="ix,iy,x,y", comments="")
    return tmp_path


def balanced(*options: str) -> tuple[complex, float]:
    """Return the correction and the stated residual of what `rotorid balance` writes, kg m."""
    arguments = ["balance", "run.json", "--plane", "x,y", "--json", "b.json", "--force", *options]
    assert cli.run(arguments) == 0
    with open("b.json") as file:
        found = json.load(file)
    (one,), (left,) = found["corrections"], found["residual"]
    return one["unbalance_kg_m"] * np.exp(1j * one["angle_rad"]), left["unbalance_kg_m"]


@pytest.mark.slow
def test_a_trial_mass_is_the_scale_where_no_force_is_known(runs, capsys):
    (runs / "run.toml").write_text(EXPERIMENT + TRIAL + REST)
    assert cli.run(["identify", "run.toml", "--json", "run.json"]) == 0
    with open("run.json") as file:
        found = {each["name"]: each for each in json.load(file)["parameters"]}
    for name, value in TRUTH.items():
        assert abs(found[name]["value"] - value) < 4 * found[name]["std"] < 0.05 * value
    added, stated = balanced("--report", "b.html", "--radius", "40 mm")
    assert abs(added + UNBALANCE) < stated < 0.05 * abs(UNBALANCE)
    page = (runs / "b.html").read_text()
    assert "rotorid balance run.json" in page
    # With the trial mass left where it is, so much less is to be added.
    after, _ = balanced("--record", "1")
    assert after == pytest.approx(added - MOUNTED, abs=1e-9)


def test_without_it_there_is_no_scale(runs, capsys):
    (runs / "run.toml").write_text(EXPERIMENT + REST)
    cli.run(["identify", "run.toml", "--json", "run.json"])
    assert cli.run(["balance", "run.json", "--plane", "x,y"]) == 2
    assert "a result that leaves m, c, k undetermined" in capsys.readouterr().err


@pytest.mark.slow
def test_it_does_not_part_runout_from_unbalance(runs, capsys):
    """It moves the reading as much whatever the runout is: only the speed parts them."""
    (runs / "run.toml").write_text(EXPERIMENT + TRIAL + REST + RUNOUT_UNKNOWN)
    cli.run(["identify", "run.toml", "--json", "run.json"])
    assert cli.run(["balance", "run.json", "--plane", "x,y"]) == 2
    said = capsys.readouterr().err
    assert "at a second speed where runout is unknown" in said
    assert "with a trial mass where no force is known" in said
