"""From files: experiment files that ask for maximum likelihood, and the exit codes."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import rotorid as rid
from rotorid import cli

PERIODS = 60
HEAD = 'model = "three-mass"\n'


def one(hertz: float = 140.0) -> str:
    return f"""
[[records]]
file = "{hertz:g}.h5"
sample_rate = "5 kHz"
speed = "{hertz:g} Hz"
phase = "0 deg"
fundamental = "20 Hz"
harmonics = [1, 3, 5, 7, 9, 11]
"""


PLACES = ("x1", "y1", "x3", "y3")
FORCES = "\n[channels]\n" + "".join(f'F_{p} = {{ column = "F_{p}", unit = "N" }}\n' for p in PLACES)
CURRENTS = "\n[channels]\n" + "\n".join(
    f'F_{p} = {{ law = "linear", current = {{ column = "F_{p}", unit = "A" }}, '
    f'position = "{p}", ki = "100 N/A", ks = "1.5e5 N/m" }}'
    for p in PLACES
)
SENSORS = "\n" + "".join(f'{p} = {{ column = "{p}", unit = "m" }}\n' for p in PLACES)
LENGTH = '\n[parameters]\nL1 = { fixed = "0.3 m" }\n'


def write(levitated, folder: Path, hertz: float, *, drives: bool, runout: bool) -> None:
    """Write forces (or the currents that make them) and what the bearing sensors read."""
    rig = levitated if runout else replace(levitated, runout={})
    record, rng = rig.record(hertz, drives=drives), np.random.default_rng(round(hertz))
    turns = np.outer(np.arange(record.samples) / record.samples, record.harmonics)
    period = 2 * (np.exp(2j * np.pi * turns) @ record.mean_spectrum).real
    clean = np.tile(period, (PERIODS, 1))
    noise = [0.2 / (120.0 if drives else 1.0)] * 4 + [4e-6] * 4
    samples = clean + noise * rng.standard_normal(clean.shape)
    with h5py.File(folder / f"{hertz:g}.h5", "w") as file:
        for name, column in zip(record.names, samples.T, strict=True):
            file[name] = column


@pytest.fixture(scope="module")
def folders(levitated, tmp_path_factory):
    plain, turning, driven = (tmp_path_factory.mktemp(n) for n in ("plain", "runout", "currents"))
    write(levitated, plain, 140.0, drives=False, runout=False)
    for hertz in (140.0, 100.0):
        write(levitated, turning, hertz, drives=False, runout=True)
        write(levitated, driven, hertz, drives=True, runout=True)
    return {"plain": plain, "runout": turning, "currents": driven}


def identify(folder: Path, text: str, *options: str) -> tuple[int, dict]:
    (folder / "run.toml").write_text(text)
    result = folder / "run.json"
    result.unlink(missing_ok=True)
    code = cli.run(["identify", str(folder / "run.toml"), "--json", str(result), *options])
    return code, json.loads(result.read_text())


def rows(data: dict) -> dict[str, dict]:
    return {row["name"]: row for key in ("derived", "nuisance", "parameters") for row in data[key]}


def test_runout_asks_where_each_angle_begins(folders):
    """A wrong zero of one record would pass for runout, and the unbalance be another one."""
    said = HEAD + one() + one(100.0) + FORCES + SENSORS + LENGTH
    untold = said.replace('phase = "0 deg"\n', "")
    runout = "\n[estimator]\nrunout = true\n"
    path = folders["runout"] / "run.toml"
    path.write_text(untold + runout)
    with pytest.raises(rid.InputError, match=r"records\.1\.phase: found nothing"):
        rid.load_experiment(path)
    for fine in (
        untold,  # without runout the misfit tells
        untold.replace('speed = "100 Hz"', 'speed = "0 Hz"') + runout,
        said.replace('phase = "0 deg"\n', "", 1) + runout,
    ):
        path.write_text(fine)
        assert len(rid.load_experiment(path).entry.records) == 2


def test_a_force_law_takes_no_derivative(folders):
    path = folders["currents"] / "run.toml"
    path.write_text(HEAD + one() + CURRENTS.replace('"x1"', '"x1\'"') + SENSORS)
    with pytest.raises(rid.InputError, match="holds a derivative"):
        rid.load_experiment(path)


@pytest.mark.slow
def test_headline_from_files(folders, levitated):
    """Coil currents and bearing sensors; one scale, one ruler."""
    options = '\n[estimator]\nmethod = "ml"\nrunout = true\ngains = ["ki", "ks"]\n'
    text = HEAD + one() + one(100.0) + CURRENTS + SENSORS + LENGTH + options
    code, data = identify(folders["currents"], text)
    assert code == 1
    assert data["status"] == "not_identifiable"
    assert any("scale together" in w for w in data["warnings"])
    assert "cure: weigh the rotor: a constraint on m1 + m2 + m3" in data["warnings"]
    mass = '\n[[constraints]]\nexpression = "m1 + m2 + m3"\nvalue = "12.98878 kg"\n'
    code, data = identify(folders["currents"], text + mass)
    assert code == 0
    assert data["status"] == "ok"
    found = rows(data)
    for name, value in levitated.truth.items():
        if not found[name].get("fixed"):
            assert found[name]["value"] == pytest.approx(value, abs=4.5 * found[name]["std"])
    assert found["ki[F_x1]"]["unit"] == "N/A"
    assert len(data["covariance"]) == 12 + 4 + 1 + 8


@pytest.mark.slow
def test_rejected_and_strict(folders):
    """A sensor that reads 2 % too much, not declared; then declared."""
    wrong = SENSORS.replace('"x1", unit = "m"', '"x1", unit = "m", scale = 1.02')
    code, data = identify(folders["plain"], HEAD + one() + FORCES + wrong + LENGTH)
    assert (code, data["status"]) == (3, "rejected")
    assert data["misfit"]["p_value"] < 1e-6
    assert data["suspects"][0]["term"] == "gain[x1]"
    assert any("the data reject the model" in w for w in data["warnings"])
    found = rows(data)["m1"]
    assert found["std_inflated"] > 1.5 * found["std"]
    declared = wrong.replace("scale = 1.02", "scale = 1.02, gain_std = 0.02")
    code, data = identify(folders["plain"], HEAD + one() + FORCES + declared + LENGTH, "--strict")
    assert (code, data["verdict"]) == (3, "ok under assumptions")
    code, data = identify(folders["plain"], HEAD + one() + FORCES + declared + LENGTH)
    assert (code, data["status"]) == (0, "ok")
    gain = rows(data)["gain[x1]"]
    assert gain["value"] == pytest.approx(1.02, abs=4 * gain["std"])


def test_knowledge_with_deviations(folders, demo):
    known = """
[parameters]
L1 = { value = "300 mm", std = "0.5 mm" }
m1 = { start = "1 kg", min = "0.1 kg" }

[[constraints]]
expression = "m1 + m2 + m3"
value = "12.99 kg"
std = "10 g"

[[constraints]]
expression = "2*I_t - I_p"
min = "0 kg m^2"
"""
    code, data = identify(folders["plain"], HEAD + one() + FORCES + SENSORS + known)
    assert (code, data["status"]) == (0, "ok")
    found = rows(data)
    assert found["L1"]["std"] == pytest.approx(0.5e-3, rel=0.05)
    assert found["I_p"]["value"] == pytest.approx(demo.truth["I_p"], abs=4 * found["I_p"]["std"])
    assert data["misfit"]["dof"] == 48 + 2 - 13


@pytest.mark.slow
def test_unknown_phase_and_delays(folders):
    turned = one(100.0).replace('"0 deg"', '"unknown"')
    late = FORCES.replace('"F_x1", unit = "N"', '"F_x1", unit = "N", delay = { std = "5 us" }')
    options = '\n[estimator]\nrunout = true\ndelays = ["position"]\neffort = "quick"\n'
    text = HEAD + one() + turned + late + SENSORS + LENGTH + options
    code, data = identify(folders["runout"], text)
    assert (code, data["status"]) == (0, "ok")
    found = rows(data)
    for name in ("phase[1]", "delay[position]", "delay[F_x1]"):
        assert found[name]["value"] == pytest.approx(0.0, abs=4.5 * found[name]["std"])
    alone = HEAD + turned + FORCES + SENSORS + LENGTH
    (folders["runout"] / "alone.toml").write_text(alone)
    assert cli.run(["identify", str(folders["runout"] / "alone.toml"), "--method", "batch"]) == 2
