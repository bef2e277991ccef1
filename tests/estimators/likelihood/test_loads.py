"""Loads that depend on time alone: the columns of g are those of the regression."""

from fractions import Fraction

import numpy as np
import pytest

import rotorid as rid
from rotorid import Lines
from rotorid.likelihood.assembly import every_load, load_lines, phase_steps
from rotorid.likelihood.layout import Layout
from rotorid.models.expressions import Expression, number, product, symbol

MODEL = """
title = "a mass on a spring, shaken at a frequency of its own"
equations = ["m*x'' + k*x = F + a*cos(2*pi*12.5*t)"]
coordinates = { x = "m" }
inputs = { F = "N" }
parameters = { m = { unit = "kg" }, k = { unit = "N/m" }, a = { unit = "N" } }
"""


def test_a_load_that_periods_do_not_repeat_is_averaged_over_all_of_them():
    model = rid.parse_model(MODEL)
    channels = (rid.Channel("F"), rid.Channel("x"))
    record = rid.Record(channels, np.zeros((500, 2)), 1000.0)
    periods = rid.average(record, 10.0, harmonics=[1, 2])
    layout = Layout(model, ())
    lines = Lines.of_periods(periods)
    columns, orders = load_lines(every_load(layout), lines, np.ones(1), False)
    np.testing.assert_array_equal(orders, [0.0])
    time = np.arange(500) / 1000.0
    wave = np.cos(2 * np.pi * 12.5 * time)
    wanted = [np.mean(wave * np.exp(-2j * np.pi * f * time)) for f in (10.0, 20.0)]
    found = columns[0][:, 0].sum(axis=-1)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


PHI, OMEGA = symbol("phi"), symbol("Omega")
COS, SIN = Expression("cos", (PHI,)), Expression("sin", (PHI,))
SQUARE = product([(COS, Fraction(2)), (SIN, Fraction(1)), (OMEGA, Fraction(-1))])


@pytest.mark.parametrize(
    ("signals", "steps"),
    [
        ([], 1),
        ([OMEGA], 1),
        ([product([(OMEGA, Fraction(2)), (COS, Fraction(1))]), SIN], 3),
        ([COS, SQUARE], 7),
        ([Expression("sum", (SQUARE, number(1)))], 7),
        ([product([(COS, Fraction(-1))])], 16),
        ([Expression("cos", (product([(PHI, Fraction(1)), (number(2), Fraction(1))]),))], 5),
        ([SIN, PHI], 16),
        ([product([(Expression("abs", (COS,)), Fraction(1)), (OMEGA, Fraction(1))])], 16),
    ],
)
def test_as_many_angles_as_a_load_has_orders(signals, steps):
    assert phase_steps(signals) == steps


@pytest.mark.parametrize(
    "load", ["cos(phi) + b*Omega*sin(phi)^3*cos(phi)", "b*Omega*sin(phi)*exp(cos(phi))"]
)
def test_a_phase_turns_a_load_of_any_order(load):
    """The columns by order, turned and added, are those of the rotor angle moved."""
    text = MODEL.replace("cos(2*pi*12.5*t)", f"({load})").replace(
        "parameters = {", 'parameters = { b = { unit = "s" },'
    )
    model = rid.parse_model(text)
    loads = every_load(Layout(model, ()))
    channels = (rid.Channel("F"), rid.Channel("x"))

    def columns(phase, unknown):
        angle = 2 * np.pi * 10.0 * np.arange(400) / 1000.0 + phase
        record = rid.Record(channels, np.zeros((400, 2)), 1000.0, 20 * np.pi, angle=angle)
        periods = rid.average(record, 10.0, harmonics=[1, 2, 3, 4])
        return load_lines(loads, Lines.of_periods(periods), np.ones(1), unknown)

    by_order, orders = columns(0.0, True)
    turned = np.tensordot(np.exp(1j * orders * 0.7), by_order, axes=1)
    wanted = columns(0.7, False)[0][0]
    np.testing.assert_allclose(turned, wanted, atol=1e-6 * np.abs(wanted).max())
