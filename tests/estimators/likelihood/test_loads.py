"""Loads that depend on time alone: the columns of g are those of the regression."""

import numpy as np

import rotorid as rid
from rotorid.estimators.likelihood.assembly import load_lines
from rotorid.estimators.likelihood.unknowns import Layout, physical_factors
from rotorid.lines import Lines

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
    layout = Layout(model, (), physical_factors(model), False)
    where = {tuple(sorted(f)): i for i, f in enumerate(layout.monomial_factors)}
    columns, orders = load_lines(layout, Lines.of_periods(periods), where, False)
    np.testing.assert_array_equal(orders, [0.0])
    time = np.arange(500) / 1000.0
    wave = np.cos(2 * np.pi * 12.5 * time)
    wanted = [np.mean(wave * np.exp(-2j * np.pi * f * time)) for f in (10.0, 20.0)]
    found = columns[0][:, 0].sum(axis=-1)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
