"""The kernel: gradient, invariance, agreement with the output-error likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from differences import gradient_holds

from rotorid import Channel, Drive, Lines, PeriodicRecord, load_model
from rotorid.data.observation import bind
from rotorid.likelihood import cost
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.cost import Likelihood
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.unknowns import Nuisances, Scalar, unknowns_of
from rotorid.signals.covariance import LineCovariance, correlated_covariance, white_covariance

MODEL = load_model("three-mass")


def layout_of(record: PeriodicRecord, nuisances: Nuisances | None = None) -> Layout:
    model = MODEL
    parameters = [Scalar(p.name, p.unit, p.nominal or 0.0) for p in model.parameters]
    extra = unknowns_of([bind(model, record)], nuisances or Nuisances())
    unknowns = (*parameters, *(unknown for nuisance in extra for unknown in nuisance.scalars))
    return Layout(model, unknowns, nuisances=extra)


def likelihood(record: PeriodicRecord) -> Likelihood:
    return assemble(layout_of(record), bind(MODEL, record))


def everything_unknown(record: PeriodicRecord) -> PeriodicRecord:
    """Turn forces into currents, and let every calibration constant be unknown."""
    position = {"F_x1": "x1", "F_y1": "y1", "F_x3": "x3", "F_y3": "y3"}
    channels = []
    for channel in record.channels:
        drive = None
        if channel.name in position:
            drive = Drive(120.0, 2e5, {position[channel.name]: 1.0})
        channels.append(replace(channel, drive=drive, gain_std=0.01, delay_std=1e-5))
    return replace(record, channels=tuple(channels), phase_known=False)


@pytest.mark.parametrize("relaxation", [0.0, 0.01, 10.0])
@pytest.mark.parametrize("sensors", [None, "bearings", "combination", "redundant"])
def test_gradient_agrees_with_differences(demo, bearings, sensors, relaxation):
    chosen = {
        None: None,
        "bearings": bearings,
        "combination": [
            "x1",
            "y1",
            Channel("a", "m", reads={"x2": 1.0, "theta_y": 0.05}),
            Channel("b", "m", reads={"y3": 1.0, "x3": -0.2}),
        ],
        "redundant": [*bearings, Channel("again", "m", reads={"x1": 1.0})],
    }[sensors]
    rng = np.random.default_rng(3)
    kernel = likelihood(demo.noisy(demo.record(chosen, periods=40), rng))
    x = demo.values * (1 + 0.2 * rng.uniform(-1, 1, 13))
    gradient_holds(lambda at: kernel.evaluate(at, relaxation), x, x)


def test_gradient_by_every_nuisance_agrees_with_differences(demo, bearings):
    rng = np.random.default_rng(4)
    record = everything_unknown(demo.noisy(demo.record(bearings, periods=40), rng))
    layout = layout_of(
        record, Nuisances(runout=True, gains=("ki", "ks*"), delays=("force", "position"))
    )
    kernel = assemble(layout, bind(MODEL, record))
    scale = np.where(layout.start != 0, np.abs(layout.start), 1e-6)  # runout in m, delay in s
    scale[layout.index["phase[0]"]] = 1.0
    x = layout.start + 0.1 * scale * rng.uniform(-1, 1, len(scale))
    assert len(x) == 13 + 4 + 4 + 8 + 8 + 2 + 8 + 1
    gradient_holds(kernel.evaluate, x, scale, rtol=2e-9)


@pytest.mark.parametrize("sensors", [None, "bearings"])
def test_equals_the_output_error_likelihood(demo, bearings, sensors):
    """J = sum c r^H V^-1 r, r = y - C Z^-1 (B u + g), V its covariance."""
    rng = np.random.default_rng(5)
    record = demo.noisy(demo.record(bearings if sensors else None, periods=40), rng)
    kernel = likelihood(record)
    x = demo.values * (1 + 0.01 * rng.uniform(-1, 1, 13))
    model, linear = demo.model, demo.model.require_linear()
    mu = model.monomial_values(x)
    stiffness = linear.dynamic_stiffness(record.omega, x, record.speed)
    reads = np.array([[float(c.name == q) for q in model.coordinates] for c in record.channels[4:]])
    compliance = reads @ np.linalg.inv(stiffness)
    transfer = compliance @ linear.input_matrix(mu)
    gain = np.concatenate(
        [-transfer, np.broadcast_to(np.eye(len(reads)), (6, len(reads), len(reads)))], axis=2
    )
    load = linear.load_columns(record.time[0], record.angle[0], record.speed) @ mu
    lines = np.fft.fft(load, axis=0)[record.harmonics] / record.samples
    mean = record.mean_spectrum
    error = (gain @ mean[:, :, None] - compliance @ lines[:, :, None])[:, :, 0]
    spread = gain @ white_covariance(record.spectra).matrices @ gain.conj().swapaxes(1, 2)
    solved = np.linalg.solve(spread, error[:, :, None])[:, :, 0]
    expected = 2 * (error.conj() * solved).real.sum()
    np.testing.assert_allclose(kernel.evaluate(x).cost, expected, rtol=1e-9)


def test_corrected_lines_satisfy_the_equations_of_motion(demo, bearings):
    record = demo.noisy(demo.record(bearings, periods=40), np.random.default_rng(6))
    kernel = likelihood(record)
    at = kernel.evaluate(demo.values)
    data, motion = at.corrected()
    force = (at.inputs @ data[:, :4, None])[:, :, 0] + at.loads
    left = (at.stiffness @ motion[:, :, None])[:, :, 0] + force
    assert np.abs(left).max() < 1e-11 * np.abs(force).max()
    np.testing.assert_allclose(motion @ kernel.sensing.reads.T, data[:, 4:], rtol=1e-9)


def test_cost_does_not_see_the_units_of_channels(demo, bearings):
    """The whole covariance goes with the data: factors cancel."""
    record = demo.noisy(demo.record(bearings, periods=40), np.random.default_rng(7))
    covariance = correlated_covariance(record.spectra)
    layout = layout_of(record)
    before = (
        assemble(layout, bind(MODEL, Lines.of_periods(record, covariance)))
        .evaluate(demo.values)
        .cost
    )
    # The same readings through sensors that read a thousandth.
    factor = np.array([1.0] * 4 + [1e-3] * 4)
    channels = tuple(
        c if i < 4 else replace(c, name=f"s{i}", reads={c.name: 1e-3})
        for i, c in enumerate(record.channels)
    )
    scaled = replace(record, channels=channels, spectra=record.spectra * factor)
    matrices = covariance.matrices * np.outer(factor, factor)
    after = assemble(
        layout,
        bind(
            MODEL, Lines.of_periods(scaled, LineCovariance(matrices, covariance.dof, "correlated"))
        ),
    )
    np.testing.assert_allclose(after.evaluate(demo.values).cost, before, rtol=1e-9)


def test_stays_finite_at_a_resonance(demo, bearings):
    """Z is never inverted: a line at an undamped resonance of the trial values is no harm."""
    record = demo.noisy(demo.record(bearings, periods=40), np.random.default_rng(8))
    kernel = likelihood(record)
    omega = record.omega[4]

    def determinant(k1: float) -> float:
        x = demo.values.copy()
        x[5] = k1
        z = demo.model.require_linear().dynamic_stiffness([omega], x, record.speed)[0]
        scale = np.sqrt(np.outer(np.abs(z).max(axis=1), np.abs(z).max(axis=1)))
        return float(np.linalg.det(z / scale).real)

    grid = np.linspace(4e5, 2e6, 400)
    signs = np.sign([determinant(k) for k in grid])
    crossing = int(np.flatnonzero(np.diff(signs))[0])
    low, high = grid[crossing], grid[crossing + 1]
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if determinant(middle) * determinant(low) > 0 else (low, middle)
    costs = []
    for k1 in (low * (1 - 1e-9), low, low * (1 + 1e-9)):
        x = demo.values.copy()
        x[5] = k1
        at = kernel.evaluate(x)
        assert np.isfinite(at.jacobian()).all()
        costs.append(at.cost)
    np.testing.assert_allclose(costs, costs[1], rtol=1e-5)


def test_a_rotor_as_stiff_is_projected_once(demo, bearings, monkeypatch):
    """With another unbalance it is, with another mass not; either evaluation is right."""
    kernel, x = likelihood(demo.record(bearings)), demo.values
    at, names = kernel.evaluate(x), [p.name for p in MODEL.parameters]
    count = []
    project = cost.projection
    monkeypatch.setattr(cost, "projection", lambda *given: count.append(1) or project(*given))
    for name, projected in (("xi", 0), ("m2", 1)):
        moved = x * np.where(np.array(names) == name, 1.1, 1.0)
        fresh = kernel.evaluate(moved)
        count.clear()
        found = kernel.evaluate(moved, like=at)
        assert len(count) == projected
        np.testing.assert_allclose(found.residual, fresh.residual, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.jacobian() * x, fresh.jacobian() * x, rtol=1e-9, atol=1e-9)
