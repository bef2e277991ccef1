"""A folder with a record, its experiment file and a result, for tests of the command line."""

from pathlib import Path

import numpy as np

import rotorid as rid
from rotorid import load_rig

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


def write_record(folder: Path, scale: float = 1.0) -> None:
    """Write run.csv, a noisy record; all columns times `scale`."""
    model = rid.load_model("jeffcott")
    angle = 2 * np.pi * np.outer(np.arange(200) / 200, [1, 2, 5])
    record = rid.simulate(
        model,
        model.values(model.nominal),
        np.column_stack([np.cos(angle).sum(axis=1), np.sin(angle).sum(axis=1)]),
        sample_rate=2000.0,
        periods=20,
        speed=2 * np.pi * 30,
        noise={"F_x": 0.01, "F_y": 0.01, "x": 1e-9, "y": 1e-9},
        rng=np.random.default_rng(5),
    )
    samples = record.samples * scale
    np.savetxt(folder / "run.csv", samples, delimiter=",", header="fx,fy,x,y", comments="")


def make(folder: Path, scale: float = 1.0) -> Path:
    """Write run.csv, run.toml and rig.toml; all columns times `scale`."""
    write_record(folder, scale)
    (folder / "run.toml").write_text(BY_BATCH)
    (folder / "rig.toml").write_text(load_rig("three-mass").text.replace('"13 s"', '"0.2 s"'))
    return folder
