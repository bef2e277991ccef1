"""What is assumed of a drawing: each entry against a record of a rotor that is otherwise."""

import numpy as np
import pytest
from bank import steady

import rotorid as rid
from rotorid import MaximumLikelihood, identify
from rotorid.likelihood import assumptions, doubts
from rotorid.testing import add_noise

DRAWN = """
title = "two magnets, their sensors beside them, a wheel between"
sections = [
  { length = "120 mm", outer = "30 mm", inner = "8 mm", material = "steel", elements = 2 },
  { length = "200 mm", outer = "20 mm", material = "steel", stiffness = "s", elements = 4 },
  { length = "130 mm", outer = "32 mm", material = "core", elements = 2 },
]
[materials]
steel = { E = "210 GPa", G = "81 GPa", density = "7850 kg/m^3" }
core = { E = "105 GPa", G = "40.5 GPa", density = "7700 kg/m^3" }
[discs]
wheel = { at = "220 mm", mass = "m", I_t = "2.6e-3 kg m^2", I_p = "4.8e-3 kg m^2" }
[actuators]
A = { at = "60 mm" }
B = { at = "380 mm" }
[sensors]
a = { at = "90 mm" }
b = { at = "410 mm" }
[damping]
internal = "c"
[unbalance]
wheel = { at = "220 mm", x = "u", y = "v" }
[parameters]
s = { unit = "1", nominal = 1.0, positive = true }
m = { unit = "kg", nominal = 2.4, positive = true }
c = { unit = "s", nominal = 2.0e-6, positive = true }
u = { unit = "kg m", nominal = 8.0e-6 }
v = { unit = "kg m", nominal = -5.0e-6 }
"""
SENSORS = ("x_a", "y_a", "x_b", "y_b")
LINES = range(1, 40, 3)


def recorded(text=DRAWN, seed=3):
    model, rng = rid.parse_model(text), np.random.default_rng(seed)
    forces = 20 * np.exp(2j * np.pi * rng.random((len(LINES), len(model.inputs))))
    record = steady(model, {}, forces, list(LINES), 10.0, 2e4, 20, hertz=100, sensors=SENSORS)
    noise = dict.fromkeys(model.inputs, 0.5) | dict.fromkeys(SENSORS, 1e-6)
    return add_noise(record, noise, rng)


def fit_of(record, text=DRAWN):
    """Return the fit of an answer that is accepted."""
    model, kept = rid.parse_model(text), []
    start = {name: value for name, value in model.nominal.items() if name not in "uv"}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(doubts, "assumed", lambda found, fit: kept.append(fit) or found)
        assert identify(model, record, MaximumLikelihood(start=start)).status == "ok"
    return kept[0]


def test_a_rotor_of_few_shapes_assumes_what_the_whole_one_does(monkeypatch):
    record = recorded()
    whole = fit_of(record)
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
    reduced = fit_of(record)
    assert len(reduced.layout.model.coordinates) < 0.9 * len(whole.layout.model.coordinates)
    one, other = (list(assumptions.assumptions(fit)) for fit in (whole, reduced))
    assert [(each.about, each.size) for each in one] == [(each.about, each.size) for each in other]
    assert {"ground", "axes"} <= {each.about for each in one}
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_allclose(theirs.moved(reduced), mine.moved(whole), rtol=1e-3, atol=1e-3)
