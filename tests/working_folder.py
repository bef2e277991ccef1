"""A folder with a record, its experiment file and a result, for tests of the command line."""

from pathlib import Path

import numpy as np
from io_writers import write_table

import rotorid as rid
from rotorid import cli, load_rig

EXPERIMENT = """
model = "jeffcott"

[[records]]
file = "run.csv"
sample_rate = "2 kHz"
speed = "30 Hz"
fundamental = "10 Hz"
harmonics = [1, 2, 3, 5]

[channels]
F_x = { column = "fx", unit = "N" }
F_y = { column = "fy", unit = "N" }
x = { column = "x", unit = "m" }
y = { column = "y", unit = "m" }
"""
BY_BATCH = EXPERIMENT + '\n[estimator]\nmethod = "batch"\n'


def shaken(
    *,
    periods: int = 20,
    speed: float = 2 * np.pi * 30,
    phase: float = 0.0,
    noise: float = 0.01,
) -> rid.Record:
    """Return the shipped rotor under three lines: periods of 200 samples at 2 kHz; noise in N."""
    model = rid.load_model("jeffcott")
    angle = 2 * np.pi * np.outer(np.arange(200) / 200, [1, 2, 5])
    forces = np.column_stack([np.cos(angle) @ [3.0, 2, 1], np.sin(angle) @ [2.0, 1, 3]])
    when = {"sample_rate": 2000.0, "periods": periods, "speed": speed, "phase": phase}
    if noise:
        when["noise"] = {"F_x": noise, "F_y": noise, "x": 1e-9, "y": 1e-9}
    rng = np.random.default_rng(5)
    return rid.simulate(model, model.values(model.nominal), forces, rng=rng, **when)


def write_record(folder: Path, scale: float = 1.0) -> None:
    """Write run.csv, a noisy record; all columns times `scale`."""
    write_table(folder / "run.csv", "fx,fy,x,y", shaken().samples * scale)


def make(folder: Path, scale: float = 1.0) -> Path:
    """Write run.csv, run.toml and rig.toml; all columns times `scale`."""
    write_record(folder, scale)
    (folder / "run.toml").write_text(BY_BATCH)
    (folder / "rig.toml").write_text(short_rig())
    return folder


def load(folder: Path, text: str) -> rid.Experiment:
    """Write an experiment file into a folder, and read it."""
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    return rid.load_experiment(folder / "experiment.toml")


def simulated(folder: Path, rig: str) -> Path:
    """Write rig.toml and its record, run.h5; return the experiment file that comes with it."""
    (folder / "rig.toml").write_text(rig)
    assert cli.run(["simulate", str(folder / "rig.toml"), "--out", str(folder / "run.h5")]) == 0
    return folder / "run.toml"


def short_rig() -> str:
    """Return the text of a shipped rig that settles and records for a fifth of a second."""
    text = load_rig("three-mass").text
    return text.replace('"13 s"', '"0.2 s"').replace('settling = "2 s"', 'settling = "0.2 s"')
