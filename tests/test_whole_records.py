"""Experiment files of records without periods, end to end through the command."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, RATE, SPEED, TRUTH, levitated

import rotorid as rid
from rotorid import InputError, cli
from rotorid.experiment.duplicates import ALIKE, LARGE, SAME_SPEED, TURNED, Wave, check_rotation
from rotorid.likelihood.unknowns import Nuisances, phases
from rotorid.testing import bind_all

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


@pytest.mark.sampled(1)
@pytest.mark.parametrize("noise", ['references = ["ex", "ey"]', 'quiet = "quiet.csv"'])
def test_a_record_without_periods_is_identified(folder: Path, noise: str) -> None:
    found = identify(folder, noise)
    assert found["status"] == "ok"
    for row in found["parameters"]:
        assert abs(row["value"] - TRUTH[row["name"]]) < 4 * row["std"], row


@pytest.mark.slow
def test_what_was_assumed_of_the_noise_is_said(folder: Path) -> None:
    assert any("free of noise" in warning for warning in identify(folder, "")["warnings"])


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        ('references = ["ex"]\nquiet = "quiet.csv"', "one of references and quiet"),
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


@pytest.mark.slow
def test_least_squares_asks_for_periods(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    identify(folder, 'references = ["ex", "ey"]')
    capsys.readouterr()
    assert cli.run(["identify", str(folder / "run.toml"), "--method", "batch"]) == 2
    assert "whole periods for this method" in capsys.readouterr().err


TURNING = """
model = "jeffcott"

[[records]]
file = "first.csv"
sample_rate = "5 kHz"
{turning}
band = ["2 Hz", "200 Hz"]
references = ["ex", "ey"]

[[records]]
file = "second.csv"
sample_rate = "5 kHz"
{turning}
band = ["2 Hz", "200 Hz"]
references = ["ex", "ey"]
{second}

[channels]
F_x = {{ column = "fx", unit = "N", hold = "zero-order" }}
F_y = {{ column = "fy", unit = "N", hold = "zero-order" }}
x = {{ column = "px", unit = "um" }}
y = {{ column = "py", unit = "um" }}
"""


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two records of one rotor: the second begins an eighth of a turn later in its rotation."""
    folder = tmp_path_factory.mktemp("turning")
    later = round(np.pi / 4 / SPEED * RATE)
    for name, seed, first in (("first", 1, 0), ("second", 2, later)):
        record = levitated(seed, excitation=5.0)
        samples = (record.samples * [1, 1, 1e6, 1e6, 1, 1])[first:]
        np.savetxt(folder / f"{name}.csv", samples, delimiter=",", header=HEADER[:-3], comments="")
    return folder


def turning_file(folder: Path, turning: str, second: str = "") -> Path:
    path = folder / "run.toml"
    path.write_text(TURNING.format(turning=turning, second=second), encoding="utf-8")
    return path


@pytest.mark.slow
def test_records_that_count_the_angle_from_two_zeros_are_refused(turning: Path) -> None:
    """One unbalance would have two directions; fitted, it takes minutes to reject them."""
    speed = f'speed = "{SPEED * 30 / np.pi} rpm"'
    bare = rid.load_experiment(turning_file(turning, speed))
    with pytest.raises(
        InputError, match=r"run.toml: records.1.phase: .* at 4[0-9.]+ deg .*phase = \"unknown\""
    ):
        bare.records()
    for said in ('phase = "unknown"', 'phase = "0 deg"', f'phase = "{SPEED * 0.002} rad"'):
        assert len(rid.load_experiment(turning_file(turning, speed, said)).records()) == 2
    other = f'speed = "{1.1 * SPEED * 30 / np.pi} rpm"'  # it does not: nothing can be said
    assert len(rid.load_experiment(turning_file(turning, other)).records()) == 2
    assert len(rid.load_experiment(turning_file(turning, "")).records()) == 2


@pytest.mark.sampled(1)
@pytest.mark.parametrize("turn", [2.0, 3.1, 4.5])
def test_an_unknown_phase_starts_where_the_rotation_stands(turn: float) -> None:
    """From the other side of the circle the search ended nowhere, after minutes."""
    later = round(turn / SPEED * RATE)
    runs = [levitated(seed) for seed in (1, 2)]
    runs[1] = replace(runs[1], samples=runs[1].samples[later:], phase_known=False)
    lines = [rid.spectra(run, (2.0, 200.0), references=["r_x", "r_y"]) for run in runs]
    (asked,) = phases(bind_all(MODEL, lines), Nuisances())
    there = np.angle(np.exp(1j * SPEED * later / RATE))
    assert np.abs(np.angle(np.exp(1j * (asked.scalars[0].start - there)))) < 0.1
    elsewhere = replace(lines[0], speed=1.03 * lines[0].speed)
    (asked,) = phases(bind_all(MODEL, [elsewhere, lines[1]]), Nuisances())
    assert asked.scalars[0].start == 0.0
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status == "ok"
    (phase,) = (value for value in estimate.nuisance if value.name == "phase[1]")
    assert phase.std
    assert abs(np.angle(np.exp(1j * (phase.value - there)))) < 4 * phase.std


@pytest.mark.slow
def test_a_record_in_another_unit_is_refused(turning: Path) -> None:
    """Its rotation is a thousand times that of the other, which turns at the same speed."""
    told = f'speed = "{SPEED * 30 / np.pi} rpm"'
    second = 'phase = "unknown"\n[records.channels]'
    for name in "xy":
        second += f'\n{name} = {{ column = "p{name}", unit = "mm" }}'
    with pytest.raises(
        InputError, match=r"records.1.channels: found a rotation [0-9.]+e\+03 times .* correct unit"
    ):
        rid.load_experiment(turning_file(turning, told, second)).records()
    scaled = second.replace('"mm"', '"nm"').replace("e-3", "")
    with pytest.raises(InputError, match=r"records.1.channels: found a rotation 0.001[0-9]* times"):
        rid.load_experiment(turning_file(turning, told, scaled)).records()


def test_a_wave_that_is_another_as_a_whole() -> None:
    wave = Wave(0, 300.0, ("x", "y"), np.array([1e-5, 2e-5j]))

    def factor(phasors: np.ndarray, speed: float = 300.0) -> complex | None:
        return Wave(1, speed, ("x", "y"), phasors).over(wave)

    turn = np.exp(0.5j)
    assert factor(wave.phasors * turn) == pytest.approx(turn)
    assert factor(wave.phasors * turn, 301.0) is None
    assert factor(wave.phasors * turn, 300.2) == pytest.approx(turn)
    assert factor(wave.phasors * [turn, 1.0]) is None  # another machine
    assert wave.over(Wave(1, 300.0, ("x", "y"), np.zeros(2) + 0j)) is None
    assert (SAME_SPEED, ALIKE, round(np.rad2deg(TURNED), 9), LARGE) == (1e-3, 0.1, 10.0, 100.0)


@pytest.mark.parametrize("factor", [1.2 * np.exp(0.5j), 90.0, np.exp(0.15j)])
def test_another_unbalance_is_no_mistake(factor: complex) -> None:
    wave = Wave(0, 300.0, ("x", "y"), np.array([1e-5, 2e-5j]))
    check_rotation([wave, replace(wave, number=1, phasors=factor * wave.phasors)], "run.toml")
    turned = replace(wave, number=1, phasors=1j * wave.phasors, told=True)
    check_rotation([wave, turned], "run.toml")
