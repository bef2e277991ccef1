"""Mistakes that are no small changes: undone, the data fit, and the first suspect names them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rotorid import Channel, MaximumLikelihood, identify
from rotorid.answer.estimate import EXPLAINS
from rotorid.data.observation import bind
from rotorid.likelihood import rivals_channels as leads
from rotorid.models.structure import find_structure


@pytest.fixture(scope="module")
def record(demo):
    """A record with little noise: what is wrong stands out."""
    quiet = replace(demo, force_noise=0.05, position_noise=5e-7)
    return quiet.noisy(demo.record(periods=60), np.random.default_rng(5))


def with_spectra(record, change):
    spectra = record.spectra.copy()
    change(spectra, record.names)
    return replace(record, spectra=spectra)


def exchange(*pairs):
    def change(spectra, names):
        for a, b in pairs:
            i, j = names.index(a), names.index(b)
            spectra[:, :, [i, j]] = spectra[:, :, [j, i]]

    return change


def scale(factor, *channels):
    def change(spectra, names):
        for name in channels:
            spectra[:, :, names.index(name)] *= factor

    return change


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "term", "value"),
    [
        (exchange(("x1", "y1")), "swap[x1, y1]", None),
        (scale(-1.0, "x2"), "sign[x2]", -1.0),
        (scale(1e-3, "y3"), "unit[y3]", 1e-3),
        (scale(-1 / 25.4, "x1"), "gain[x1]", -1 / 25.4),
    ],
)
def test_mistakes_are_named(demo, record, change, term, value):
    estimate = identify(demo.model, with_spectra(record, change), MaximumLikelihood())
    assert estimate.status != "ok"
    first = estimate.suspects[0]
    assert first.term == term
    assert first.share > 0.999
    assert first.value == (None if value is None else pytest.approx(value, rel=1e-3))
    assert first.term.partition("[")[2].rstrip("]").split(", ")[0] in estimate.warnings[0]
    assert "first suspect" in estimate.warnings[0]


def test_a_known_value(demo, record):
    estimate = identify(demo.model, record, MaximumLikelihood(fixed={"m2": 12.0}))
    first = estimate.suspects[0]
    assert first.term == "prior m2"
    assert first.value == pytest.approx(demo.truth["m2"], rel=0.01)
    known = MaximumLikelihood(known={"L1": (0.31, 0.0005)})
    assert identify(demo.model, record, known).suspects[0].term == "prior L1"


def test_a_sensor_beside_its_plane(demo, record):
    """It reads 5 mm of theta_y besides; the model says nothing of it."""

    def change(spectra, names):
        spectra[:, :, names.index("x1")] += 0.005 * spectra[:, :, names.index("theta_y")]

    estimate = identify(demo.model, with_spectra(record, change), MaximumLikelihood())
    first = estimate.suspects[0]
    assert (first.term, first.unit) == ("plane[x1]", "m")
    assert first.value == pytest.approx(0.005, rel=0.05)


def test_a_plane_that_is_elsewhere(demo, record):
    """Both sensors read 5 mm of their angles: x + theta_y l, y - theta_x l."""

    def change(spectra, names):
        spectra[:, :, names.index("x1")] += 0.005 * spectra[:, :, names.index("theta_y")]
        spectra[:, :, names.index("y1")] -= 0.005 * spectra[:, :, names.index("theta_x")]

    estimate = identify(demo.model, with_spectra(record, change), MaximumLikelihood())
    first = estimate.suspects[0]
    assert (first.term, first.unit) == ("plane[x1, y1]", "m")
    assert first.value == pytest.approx(0.005, rel=0.05)


def test_axes_that_are_turned(demo, record):
    def change(spectra, names):
        i, j = names.index("x1"), names.index("y1")
        x, y = spectra[:, :, i].copy(), spectra[:, :, j].copy()
        spectra[:, :, i], spectra[:, :, j] = x + 0.01 * y, y - 0.01 * x

    estimate = identify(demo.model, with_spectra(record, change), MaximumLikelihood())
    assert estimate.suspects[0].term == "rotation[x1, y1]"
    assert estimate.suspects[0].value == pytest.approx(0.01, rel=0.05)


def test_a_load_where_the_model_has_none(demo, record):
    """20 g mm of unbalance on the first mass."""
    size = 2e-5 * record.speed**2 / 2
    once = list(record.harmonics).index(7)

    def change(spectra, names):
        spectra[:, once, names.index("F_x1")] -= size
        spectra[:, once, names.index("F_y1")] -= -1j * size

    estimate = identify(demo.model, with_spectra(record, change), MaximumLikelihood())
    first = estimate.suspects[0]
    assert first.term in ("load at x1, y1", "load at x1", "load at y1")
    assert first.value == pytest.approx(2e-5, rel=0.05)


@pytest.mark.slow
def test_nothing_explains_noise_in_the_wrong_place(demo, record):
    """Errors at random on every line and channel: where no suspect explains a fifth, it says so."""
    rng = np.random.default_rng(8)
    shape = record.spectra.shape[1:]
    wrong = 1 + 0.02 * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    changed = replace(record, spectra=record.spectra * wrong)
    estimate = identify(demo.model, changed, MaximumLikelihood())
    assert estimate.status != "ok"
    told = estimate.suspects[0].share > EXPLAINS
    assert ("none of the" in estimate.warnings[0]) != told


def test_what_undoes_a_mistake_undoes_it(demo, record):
    seen = bind(demo.model, record)
    twice = leads.exchanged(leads.exchanged(seen, [("x1", "y2")]), [("x1", "y2")])
    np.testing.assert_allclose(twice.lines.mean, seen.lines.mean)
    scaled = leads.multiplied(seen, {"x1": 2.0, "F_y1": -1.0})
    where = [seen.lines.names.index(n) for n in ("x1", "F_y1")]
    np.testing.assert_allclose(
        scaled.lines.covariance.matrices[:, where[0], where[1]],
        -2 * seen.lines.covariance.matrices[:, where[0], where[1]],
    )
    np.testing.assert_allclose(scaled.lines.scatter[:, :, where[0]], 2 * record.spectra[:, :, 4])


def test_planes_of_sensors_that_read_combinations(demo):
    pair = [
        Channel("s_x", "m", reads={"x2": 1.0, "theta_y": 0.1}),
        Channel("s_y", "m", reads={"y2": 1.0, "theta_x": -0.1}),
    ]
    plan = demo.plan([*pair, "x1", "y1"])
    seen = bind(demo.model, plan.lines(demo.model))
    structure = find_structure(demo.model, demo.values, 100.0)
    case = SimpleNamespace(
        records=[seen], model=demo.model, values=demo.values, structure=structure
    )
    found = {frozenset(p) for p in leads.planes(case)}
    assert {"s_x", "s_y"} in found
    assert {"x1", "y1"} in found
    assert {"F_x1", "F_y1"} in found
    assert len(found) == 4
