"""Sensors of derivatives, and sensors with parameters among their coefficients."""

from dataclasses import replace

import numpy as np
import pytest
from differences import gradient_holds

from rotorid import (
    Channel,
    InputError,
    LeastSquares,
    Lines,
    MaximumLikelihood,
    PeriodicRecord,
    identify,
)
from rotorid.data.observation import bind
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.unknowns import Scalar


def derived(record: PeriodicRecord, name: str, order: int) -> PeriodicRecord:
    """Return the record with a sensor of a derivative in place of that of a position."""
    index = record.index(name)
    reads = {name + "'" * order: 1.0}
    channels = list(record.channels)
    channels[index] = Channel(f"d{order}_{name}", "m/s^2", reads=reads)
    spectra = record.spectra.copy()
    spectra[:, :, index] *= (1j * record.omega) ** order
    return replace(record, channels=tuple(channels), spectra=spectra)


def leaned(record: PeriodicRecord, model) -> PeriodicRecord:
    """Return the record whose sensor x1 reads ``x1 - L1*theta_y`` instead."""
    x1, theta = record.index("x1"), record.index("theta_y")
    spectra = record.spectra.copy()
    spectra[:, :, x1] -= 0.3 * spectra[:, :, theta]
    channels = list(record.channels)
    channels[x1] = Channel("leaning", "m", reads={"x1": 1.0, "L1*theta_y": -1.0})
    keep = [k for k, c in enumerate(channels) if c.name not in ("theta_x", "theta_y", "x2", "y2")]
    return replace(
        record,
        channels=tuple(channels[k] for k in keep),
        spectra=spectra[:, :, keep],
        mean=record.mean[:, keep],
        variance=record.variance[:, keep],
    )


@pytest.mark.parametrize("order", [1, 2])
def test_derivatives_give_what_positions_give(demo, bearings, order):
    record = demo.record([*bearings, "x2", "y2"])
    for name in ("x2", "y2"):
        record = derived(record, name, order)
    start = demo.start(np.random.default_rng(2), 0.1)
    estimate = identify(demo.model, record, MaximumLikelihood(fixed={"L1": 0.3}, start=start))
    for name, value in demo.truth.items():
        assert estimate.value(name) == pytest.approx(value, rel=1e-6), name
    assert max(p.relative_error for p in estimate.prediction.values()) < 1e-5


def test_a_parameter_may_be_a_coefficient_of_a_sensor(demo):
    record = leaned(demo.record(), demo.model)
    start = demo.start(np.random.default_rng(3), 0.05)
    estimate = identify(demo.model, record, MaximumLikelihood(fixed={"L2": 0.3}, start=start))
    for name, value in demo.truth.items():
        assert estimate.value(name) == pytest.approx(value, rel=1e-6), name
    assert "leaning" in estimate.prediction
    assert max(p.relative_error for p in estimate.prediction.values()) < 1e-5


@pytest.mark.parametrize("transient", [None, 2])
def test_gradient_with_indirect_sensors_agrees_with_differences(demo, bearings, transient):
    rng = np.random.default_rng(5)
    record = demo.noisy(demo.record([*bearings, "x2", "theta_y"], periods=40), rng)
    record = derived(record, "x2", 2)
    theta = record.index("theta_y")
    channels = list(record.channels)
    channels[theta] = Channel("arm", "m", reads={"L1*theta_y": 1.0, "y3": 0.1})
    record = replace(record, channels=tuple(channels))
    lines = replace(Lines.of_periods(record), transient=transient)
    model = demo.model
    unknowns = tuple(Scalar(p.name, p.unit, p.nominal or 0.0) for p in model.parameters)
    kernel = assemble(Layout(model, unknowns), bind(model, lines))
    x = demo.values * (1 + 0.1 * rng.uniform(-1, 1, 13))
    gradient_holds(kernel.evaluate, x, x, rtol=1e-8, atol=1e-8)


def test_least_squares_needs_positions(demo):
    record = derived(demo.record(), "x2", 2)
    with pytest.raises(InputError, match=r"no sensor of x2.*use ml"):
        identify(demo.model, record, LeastSquares())
