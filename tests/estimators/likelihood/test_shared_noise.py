"""Noise that sensors of frequency responses share: deviations are what the lines scatter by."""

import numpy as np
import pytest
from model_text import model_text

import rotorid as rid

BAR = model_text(
    "a bar on a spring, shaken beside its centre",
    ["m*x'' + c*x' + k*x + k*e*th = F", "J*th'' + c*b*th' + k*b*th + k*e*x = 0.1*F"],
    "x m, th rad",
    "F N",
    "m +2.2 kg, J +0.027 kg m^2, c +25.0 N s/m, k +2.3e4 N/m, e 0.012 m, b +0.022 m^2",
)
MODEL = rid.parse_model(BAR)
PLACES = (-0.15, -0.09, 0.1, 0.16)
NAMES = ("m", "J", "c", "k")


def responses(rng: np.random.Generator, common: float, own: float) -> rid.Lines:
    """Return four responses of the bar, with noise of one force and of each sensor."""
    hertz = np.arange(4.0, 60.0)
    values = MODEL.values(MODEL.nominal)
    right = np.tile([1.0, 0.1], (len(hertz), 1))
    motion = MODEL.require_linear().response(2 * np.pi * hertz, values, 0.0, right)
    exact = motion @ np.array([np.ones(len(PLACES)), PLACES])
    force = rng.standard_normal((len(hertz), 1, 2)) @ np.array([1, 1j])
    each = rng.standard_normal((*exact.shape, 2)) @ np.array([1, 1j])
    size = np.abs(exact)
    found = exact * (1 + common * force) + own * size * each
    sensors = [rid.Channel(f"s{p:+g}", "m", reads={"x": 1.0, "th": p}) for p in PLACES]
    std = np.hypot(common, own) * size
    return rid.response_lines(rid.Channel("F", "N"), sensors, hertz, found, std=std)


def said(estimate: rid.Estimate) -> bool:
    return any("share noise on each line" in text for text in estimate.warnings)


@pytest.mark.slow
def test_noise_of_a_force_that_all_sensors_share():
    rng, off = np.random.default_rng(4), []
    for _ in range(8):
        found = rid.identify(MODEL, responses(rng, 0.05, 0.005), "ml")
        assert found.status == "ok"
        assert said(found)
        off.append([(found.value(n) - MODEL.nominal[n]) / found.std(n) for n in NAMES])
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4  # 2.0 without


def test_noise_of_each_sensor_is_its_own():
    rng = np.random.default_rng(4)
    for _ in range(8):
        assert not said(rid.identify(MODEL, responses(rng, 0.0, 0.05), "ml"))


def test_a_model_that_is_wrong_is_no_noise_in_common():
    uncoupled = rid.parse_model(BAR.replace("k*b*th + k*e*x", "k*b*th"))
    wrong = rid.identify(uncoupled, responses(np.random.default_rng(4), 0.0, 0.05), "ml")
    assert wrong.status == "rejected"
    assert not said(wrong)
