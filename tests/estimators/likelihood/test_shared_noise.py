"""Noise that sensors of frequency responses share: deviations are what the lines scatter by."""

from pathlib import Path

import numpy as np
import pytest
from model_text import model_text

import rotorid as rid

MODEL = model_text(
    "a bar on a spring, shaken beside its centre",
    ["m*x'' + c*x' + k*x + k*e*th = F", "J*th'' + c*b*th' + k*b*th + k*e*x = 0.1*F"],
    "x m, th rad",
    "F N",
    "m +2.2 kg, J +0.027 kg m^2, c +25.0 N s/m, k +2.3e4 N/m, e 0.012 m, b +0.022 m^2",
)
PLACES = (-0.15, -0.09, 0.1, 0.16)
NAMES = ("m", "J", "c", "k")


def answers(folder: Path, rng: np.random.Generator, common: float, own: float) -> rid.Estimate:
    """Identify the bar from four responses, with noise of one force and of each sensor."""
    (folder / "model.toml").write_text(MODEL)
    model = rid.load_model("model.toml", folder=folder)
    hertz = np.arange(4.0, 60.0)
    linear, values = model.linear, [model.nominal[n] for n in model.parameter_names]
    motion = np.linalg.solve(
        linear.dynamic_stiffness(2 * np.pi * hertz, values, 0.0), np.array([[1.0], [0.1]])
    )[:, :, 0]
    exact = motion @ np.array([np.ones(len(PLACES)), PLACES])
    force = rng.standard_normal((len(hertz), 1, 2)) @ np.array([1, 1j])
    each = rng.standard_normal((*exact.shape, 2)) @ np.array([1, 1j])
    size = np.abs(exact)
    found = exact * (1 + common * force) + own * size * each
    columns = {"f": hertz}
    channels = ""
    for i, place in enumerate(PLACES):
        columns |= {f"re{i}": found[:, i].real, f"im{i}": found[:, i].imag}
        columns[f"s{i}"] = np.hypot(common, own) * size[:, i]
        channels += (
            f's{i} = {{ input = "F", reads = "x + ({place})*th", real = "re{i}", imag = "im{i}", '
            f'unit = "m/N", std = "s{i}" }}\n'
        )
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(folder / "t.csv", table, "%.12g", ",", header=",".join(columns), comments="")
    (folder / "run.toml").write_text(
        'model = "model.toml"\n[[records]]\nkind = "responses"\nfile = "t.csv"\n'
        f'frequency = {{ column = "f", unit = "Hz" }}\n[channels]\n{channels}'
    )
    return rid.load_experiment(folder / "run.toml").identify()


def said(estimate: rid.Estimate) -> bool:
    return any("share noise on each line" in text for text in estimate.warnings)


@pytest.mark.slow
def test_noise_of_a_force_that_all_sensors_share(tmp_path):
    rng, off, truth = np.random.default_rng(4), [], rid.models.parse_model(MODEL).nominal
    for _ in range(8):
        found = answers(tmp_path, rng, 0.05, 0.005)
        assert found.status == "ok"
        assert said(found)
        off.append([(found.value(n) - truth[n]) / found.std(n) for n in NAMES])
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4  # 2.0 without


def test_noise_of_each_sensor_is_its_own(tmp_path):
    rng = np.random.default_rng(4)
    assert not any(said(answers(tmp_path, rng, 0.0, 0.05)) for _ in range(8))


def test_a_model_that_is_wrong_is_no_noise_in_common(tmp_path):
    answers(tmp_path, np.random.default_rng(4), 0.0, 0.05)
    text = (tmp_path / "model.toml").read_text()
    (tmp_path / "model.toml").write_text(text.replace("k*b*th + k*e*x", "k*b*th"))
    wrong = rid.load_experiment(tmp_path / "run.toml").identify()
    assert wrong.status == "rejected"
    assert not said(wrong)
