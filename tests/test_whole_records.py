"""Experiment files of records without periods, end to end through the command."""

import json
from pathlib import Path

import numpy as np
import pytest
from test_spectra import RATE, SPEED, TRUTH, levitated

from rotorid import cli

EXPERIMENT = """
model = "jeffcott"

[[records]]
file = "run.csv"
sample_rate = "5 kHz"
speed = "{rpm} rpm"
band = ["2 Hz", "200 Hz"]
{noise}

[channels]
F_x = {{ column = "fx", unit = "N", hold = "zero-order" }}
F_y = {{ column = "fy", unit = "N", hold = "zero-order" }}
x = {{ column = "px", unit = "um" }}
{y}

[parameters]
m = {{ start = "5.5 kg" }}
c = {{ start = "450 N s/m" }}
k = {{ start = "4.3e5 N/m" }}
"""
HEADER = "fx,fy,px,py,ex,ey,ay"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    for name, record in (("run", levitated(1)), ("quiet", levitated(2, excitation=0.0))):
        samples = record.samples * [1, 1, 1e6, 1e6, 1, 1]
        # The acceleration, as a sensor of its own would give it: from the equation of motion.
        y = record.column("y")
        rate = np.gradient(y, 1 / RATE)
        samples = np.column_stack([samples, np.gradient(rate, 1 / RATE)])
        np.savetxt(folder / f"{name}.csv", samples, delimiter=",", header=HEADER, comments="")
    return folder


def identify(folder: Path, noise: str, y: str = 'y = { column = "py", unit = "um" }') -> dict:
    text = EXPERIMENT.format(noise=noise, y=y, rpm=SPEED * 30 / np.pi)
    (folder / "run.toml").write_text(text, encoding="utf-8")
    assert cli.run(["identify", str(folder / "run.toml"), "--json", str(folder / "run.json")]) == 0
    return json.loads((folder / "run.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("noise", ['references = ["ex", "ey"]', 'quiet = "quiet.csv"'])
def test_a_record_without_periods_is_identified(folder: Path, noise: str) -> None:
    found = identify(folder, noise)
    assert found["status"] == "ok"
    for row in found["parameters"]:
        assert abs(row["value"] - TRUTH[row["name"]]) < 4 * row["std"], row


def test_what_was_assumed_of_the_noise_is_said(folder: Path) -> None:
    assert any("free of noise" in warning for warning in identify(folder, "")["warnings"])


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        ('references = ["ex"]\nquiet = "quiet.csv"', "one of them"),
        ('references = ["ex"]\nfundamental = "10 Hz"', "remove references"),
        ('references = ["none"]', "none"),
    ],
)
def test_what_does_not_go_together_is_refused(
    folder: Path, noise: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = EXPERIMENT.format(noise=noise, y='y = { column = "py", unit = "um" }', rpm=3000)
    (folder / "wrong.toml").write_text(text, encoding="utf-8")
    assert cli.run(["identify", str(folder / "wrong.toml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_least_squares_asks_for_periods(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    identify(folder, 'references = ["ex", "ey"]')
    capsys.readouterr()
    assert cli.run(["identify", str(folder / "run.toml"), "--method", "batch"]) == 2
    assert "whole periods for this method" in capsys.readouterr().err
