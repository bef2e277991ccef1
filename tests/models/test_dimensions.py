"""Units of equations: what was typed wrong is said, what may be right is not."""

import pytest

from rotorid import load_model, parse_model, shipped_models

MODEL = """
title = "a mass on a spring"
equations = ["EQUATION"]
coordinates = { x = "m" }
inputs = { F = "N" }
parameters = { m = { unit = "kg" }, k = { unit = "N/m" }, l = { unit = "m" } }
"""


@pytest.mark.parametrize("name", shipped_models())
def test_the_shipped_models_agree(name):
    assert load_model(name).unit_faults == ()


@pytest.mark.parametrize(
    "text",
    [
        "m*x'' + k*(x - l) = F",
        "m*x'' + k*(x - l) + m*9.81*sin(phi) = F",  # 9.81 has a unit of its own
        "m*x'' + k*l*tanh(phi) - k*abs(x)*sign(x') = F",
        "m*x'' + 2*m*Omega*x' + k*l*cos(phi) = F",
    ],
)
def test_equations_that_agree(text):
    assert parse_model(MODEL.replace("EQUATION", text)).unit_faults == ()


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("m*x' + k*(x - l) = F", "kg m s^-1 and in kg m s^-2"),
        ("m*x'' + k*l*x = F", "kg m s^-2 and in kg m^2 s^-2"),
        ("m*x'' + m*Omega*x + k*l = F", "kg m s^-1"),
    ],
)
def test_equations_that_do_not(text, units):
    (fault,) = parse_model(MODEL.replace("EQUATION", text)).unit_faults
    assert fault.startswith("equation 1 adds terms in ")
    assert units in fault
