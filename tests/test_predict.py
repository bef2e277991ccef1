"""Predictions: an independent computation of the figure, and every kind of estimate."""

import numpy as np
import pytest

import rotorid as rid
from rotorid import InputError, load_rig, predict, with_evidence
from rotorid.linear.family import information
from rotorid.report.estimate_report import verdict_of
from rotorid.testing import line_record

HARMONICS = (1, 3, 5, 7, 9, 11)
SPEED = 2 * np.pi * 140


@pytest.fixture(scope="module")
def model():
    return rid.load_model("three-mass")


def record_of(model, rng, *, shares=(0.5, 1.0, 1.0, -0.5), sensors=None):
    """Return a simulated record, with the paper's excitation unless told otherwise."""
    time = np.arange(250) / 5000.0
    wave = sum(10 * np.sin(w * time) + 10 * np.cos(w * time) for w in 40 * np.pi * np.r_[1:12:2])
    record = rid.simulate(
        model,
        model.values(model.nominal),
        np.outer(wave, shares),
        sample_rate=5000.0,
        periods=60,
        speed=SPEED,
        noise={**dict.fromkeys(model.inputs, 1.0), **dict.fromkeys(model.coordinates, 5e-6)},
        rng=rng,
    )
    names = [*model.inputs, *(model.coordinates if sensors is None else sensors)]
    kept = rid.Record(
        tuple(rid.Channel(name) for name in names),
        np.column_stack([record.column(name) for name in names]),
        record.sample_rate,
        record.speed,
        record.angle,
    )
    return rid.average(kept, 20.0, harmonics=HARMONICS)


@pytest.mark.parametrize("method", [rid.LeastSquares(), rid.Batch(), rid.Sequential()])
def test_the_figure_is_that_of_the_residual_of_the_rows_with_forces(model, method, rng):
    periods = record_of(model, rng)
    estimate = rid.identify(model, periods, method)
    found = predict(model, estimate, periods)
    values = {p.name: p.value for p in estimate.parameters}
    lines = dict(zip(periods.names, periods.mean_spectrum.T, strict=True))
    # Row 1 by hand: m1 x1'' + k1 (x1 - x2) + k1 L1 theta_y.
    predicted = (
        -(periods.omega**2) * values["m1"] * lines["x1"]
        + values["k1"] * (lines["x1"] - lines["x2"])
        + values["k1*L1"] * lines["theta_y"]
    )
    wanted = np.linalg.norm(predicted - lines["F_x1"]) / np.linalg.norm(lines["F_x1"])
    assert found["F_x1"].relative_error == pytest.approx(wanted, rel=1e-12)
    check_same(found, estimate.prediction)


def check_same(found, wanted):
    assert found.keys() == wanted.keys()
    for name, prediction in wanted.items():
        assert found[name].relative_error == pytest.approx(prediction.relative_error, rel=1e-10)


def test_another_record_is_predicted_within_its_noise(model, rng):
    estimate = rid.identify(model, record_of(model, rng), rid.Batch())
    other = record_of(model, rng, shares=(1.0, -0.5, 0.5, 1.0))
    assert max(p.relative_error for p in predict(model, estimate, other).values()) < 0.03


def test_fixed_parameters_stay_in_the_prediction(model, rng):
    periods = record_of(model, rng)
    estimate = rid.identify(model, periods, rid.Batch(fixed={"L1": 0.3, "m2": 11.322}))
    check_same(predict(model, estimate, periods), estimate.prediction)


@pytest.mark.parametrize("fixed", [{"L1": 0.3}, {"L1": 0.3, "m1": 0.83339}])
def test_outputs_are_predicted_where_coordinates_are_hidden(model, fixed, rng):
    periods = record_of(model, rng, sensors=("x1", "y1", "x3", "y3"))
    estimate = rid.identify(model, periods, rid.MaximumLikelihood(fixed=fixed))
    found = predict(model, estimate, periods)
    assert list(found) == ["x1", "y1", "x3", "y3"]
    for name, prediction in estimate.prediction.items():
        assert found[name].relative_error == pytest.approx(prediction.relative_error, rel=1e-9)
    # By a result of batch too: the outputs follow from its derived physical parameters.
    batch = rid.identify(model, record_of(model, rng), rid.Batch())
    assert max(p.relative_error for p in predict(model, batch, periods).values()) < 0.1


def test_nuisances_take_part_in_the_prediction(model, rng):
    lines = line_record(
        model,
        model.values(model.nominal),
        np.full((6, 1), 5 - 5j) * np.array([0.5, 1.0, 1.0, -0.5]),
        harmonics=HARMONICS,
        fundamental=20.0,
        sample_rate=5000.0,
        periods=60,
        speed=SPEED,
    )
    shifted = lines.spectra * np.exp(-1j * lines.omega * 80e-6)[None, :, None]
    shifted[..., :4] = lines.spectra[..., :4]
    noise = rng.standard_normal((2, *shifted.shape)) * 1e-4 * np.abs(shifted)
    late = rid.PeriodicRecord(
        **{**vars(lines), "spectra": shifted + noise[0] + 1j * noise[1]},
    )
    estimate = rid.identify(model, late, rid.MaximumLikelihood(delays=("position",)))
    assert estimate.value("delay[position]") == pytest.approx(80e-6, rel=0.05)
    found = predict(model, estimate, late)
    error = max(p.relative_error for p in found.values())
    blind = estimate.with_(nuisance=(), covariance=estimate.covariance[:-1, :-1])
    assert max(p.relative_error for p in predict(model, blind, late).values()) > 5 * error


def test_a_result_of_another_model_is_refused(model, rng):
    estimate = rid.identify(model, record_of(model, rng), rid.Batch())
    with pytest.raises(InputError, match="without 'm'; expected the parameters of 'jeffcott'"):
        predict(rid.load_model("jeffcott"), estimate, record_of(model, rng))


def test_information_grows_with_the_square_of_the_forces(model, rng):
    weak = information(model, record_of(model, np.random.default_rng(1)))
    shares = tuple(10 * s for s in (0.5, 1.0, 1.0, -0.5))
    strong = information(model, record_of(model, np.random.default_rng(1), shares=shares))
    masses = [weak.names.index("m1"), weak.names.index("k1")]
    ratio = np.diag(strong.matrix)[masses] / np.diag(weak.matrix)[masses]
    assert ratio == pytest.approx([100.0, 100.0], rel=0.2)
    assert weak.scaled_condition_number < weak.condition_number


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def test_currents_are_told_in_amperes(rng):
    """What a law makes a force of is compared as it was measured."""
    model = rid.load_model("three-mass")
    periods = rid.average(load_rig("three-mass").rig.run(1.0, rng), "20 Hz", harmonics=HARMONICS)
    shown = with_evidence(rid.identify(model, periods, "ml"), model, periods)
    channels = shown.evidence.records[0].channels
    assert {c.unit for c in channels if c.name in model.inputs} == {"A"}
    size = np.abs(periods.mean_spectrum[0, periods.names.index("F_x1")])
    assert channels[0].measured[0] == pytest.approx(2 * size, rel=1e-5)
    assert "explain 4 currents to" in verdict_of(shown).sentence
