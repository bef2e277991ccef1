"""What turns with the rotor: the line of a load once per revolution, against closed forms."""

import numpy as np
import pytest

import rotorid as rid
from rotorid import parse_model
from rotorid.answer.unbalance import with_unbalance
from rotorid.results.machine import machine_of

FILE = """
title = "a mass with an unbalance, and something more"
equations = ["m*x'' + c*x' + k*x = F + Omega^2*u*cos(phi + 0.5) + {more}"]
coordinates = {{ x = "m" }}
inputs = {{ F = "N" }}
parameters = {{ m = {{ unit = "kg", nominal = 2.0 }}, c = {{ unit = "N s/m", nominal = 30.0 }}, \
k = {{ unit = "N/m", nominal = 2e5 }}, u = {{ unit = "kg m", nominal = 4e-5 }}, \
b = {{ unit = "{unit}", nominal = 3e-5 }} }}
"""


def model_with(more: str, unit: str = "kg m") -> rid.Model:
    return parse_model(FILE.format(more=more, unit=unit))


def load_of(model: rid.Model, speed: float) -> complex:
    """Return the load of the model at its nominal values: that of one row."""
    found, _ = machine_of(model).load(speed)
    return complex(found[0])


def unbalance_at(model: rid.Model) -> complex:
    values = tuple(rid.Value(p.name, p.unit, p.nominal, 1e-9) for p in model.parameters)
    spread = 1e-18 * np.eye(len(values))
    (found,) = with_unbalance(
        model, rid.Estimate("m", "ml", "ok", values, covariance=spread)
    ).unbalance
    return found.amount * np.exp(1j * found.angle_rad)


BESIDE = [
    "b*Omega^2*cos(2*phi)",
    "b*Omega^2*sin(15*phi)",  # blades
    "b*Omega^2*cos(17*phi + 1)",
    "b*Omega^2*cos(63*phi)",
    "b*Omega^2*cos(255*phi)",
    "b*Omega^2*cos(1.5*phi)",  # the shaft of a gear
    "b*Omega^2*cos(2.5*phi + 0.2)",
    "b*Omega^2*sin(0.98*phi)",  # a motor that slips
    "b*Omega^2*cos(pi*phi)",
    "b*Omega^2*cos(1.0035*phi)",
    "b*Omega^2*cos(50*t)",  # not from the same zero, and turning as fast at 50 rad/s
    "b*Omega^2",
]


@pytest.mark.parametrize("more", BESIDE)
def test_what_turns_at_another_rate_is_no_unbalance(more):
    model = model_with(more)
    wanted = 4e-5 * np.exp(0.5j)
    near = 2e-3 if "1.0035" in more else 1e-7
    assert unbalance_at(model) == pytest.approx(wanted, rel=near)
    for speed in (50.0, -30.0):
        assert load_of(model, speed) == pytest.approx(wanted * speed**2, rel=near)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("cos(phi)", 1),
        ("sin(phi)", -1j),
        ("cos(phi)^3", 0.75),
        ("sin(phi)*cos(2*phi)", 0.5j),
        ("Omega*cos(phi - 1)", 7 * np.exp(-1j)),
        ("cos(phi)*cos(1.5*phi)^2", 0.5),  # 1 and two others: cos^2 = (1 + cos(3 phi))/2
    ],
)
def test_products_and_powers(text, wanted):
    model = model_with(f"b*{text}", "N")
    assert load_of(model, 7.0) == pytest.approx(4e-5 * 49 * np.exp(0.5j) + 3e-5 * wanted, rel=1e-9)


def test_what_has_no_number_is_refused_where_it_is_needed():
    model = model_with("b*cos(phi)/Omega", "N rad/s")
    assert np.isfinite(load_of(model, 1.0))
    with pytest.raises(rid.InputError, match="without a finite value at the speed 0"):
        load_of(model, 0.0)


@pytest.mark.parametrize("text", ["cos(Omega*t)", "sin(2*Omega*t + 0.3)", "cos(phi - Omega*t/3)"])
def test_a_rotation_counted_from_the_record_is_refused(text):
    with pytest.raises(rid.InputError, match=r"equation 1: found .*a load that turns.*write phi"):
        model_with(f"b*Omega^2*{text}")


@pytest.mark.parametrize("text", ["cos(314*t)", "exp(-3*t)*sin(phi)"])
def test_loads_of_the_time_are_loads(text):
    assert model_with(f"b*Omega^2*{text}").parameter_names[-1] == "b"
