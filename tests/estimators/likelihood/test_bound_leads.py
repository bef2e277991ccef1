"""A wrong bound is a suspect like a wrong value, and what contradicts itself is refused."""

from dataclasses import replace

import numpy as np
import pytest

from rotorid import Constraint, InputError, MaximumLikelihood, identify, load_model
from rotorid.testing import add_noise, line_record

TRUTH = {"m": 2.0, "c": 30.0, "k": 2e5}
MODEL = load_model("jeffcott")


@pytest.fixture(scope="module")
def record():
    """A rotor on a shaft at 1800 rpm, with little noise."""
    clean = line_record(
        MODEL,
        MODEL.values({**MODEL.nominal, **TRUTH}),
        np.array([[3 - 4j, 5], [5j, 4 - 3j], [4, -5j], [-3j, 4]]),
        harmonics=(1, 2, 3, 7),
        fundamental=10.0,
        sample_rate=2000.0,
        periods=40,
        speed=2 * np.pi * 30.0,
    )
    noise = {"F_x": 0.02, "F_y": 0.02, "x": 2e-7, "y": 2e-7}
    return add_noise(clean, noise, np.random.default_rng(3))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("bounds", "term", "value"),
    [
        # Without the bound all is said; a force in kilograms would keep it, and explain as much.
        ({"k": (2.05e5, None)}, "bound k >= 205000", 2e5),
        ({"c": (None, 20.0)}, "bound c <= 20", 30.0),
        ({"k/2 - 1e4*m": (None, 7e4)}, "bound k/2 - 1e4*m <= 70000", 8e4),
        ({"k": (2.05e5, None), "c": (None, 20.0)}, "bound k >= 205000, c <= 20", None),
    ],
)
def test_a_wrong_bound_is_the_first_suspect(record, bounds, term, value):
    estimate = identify(MODEL, record, MaximumLikelihood(bounds=bounds))
    assert estimate.status == "rejected"
    first = estimate.suspects[0]
    assert first.term == term
    assert first.share > 0.999
    assert first.value == (None if value is None else pytest.approx(value, rel=2e-3))
    assert "first suspect" in estimate.warnings[0]
    assert "check th" in estimate.warnings[0]


@pytest.mark.slow
def test_a_sign_that_the_model_forbids_is_looked_for_in_the_channels(record):
    """All forces upside down: a negative rotor would explain it, and m >= 0 is right."""
    spectra = record.spectra.copy()
    spectra[:, :, :2] *= -1
    bounds = {name: (0.0, None) for name in ("m", "k")}
    wrong = replace(record, spectra=spectra)
    estimate = identify(MODEL, wrong, MaximumLikelihood(bounds=bounds))
    assert estimate.suspects[0].term == "sign[F_x, F_y]"


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "likely"), [(2e5 / 1.49, True), (2e5 / 1.51, False)])
def test_a_bound_far_from_what_it_forbids_is_not_the_likeliest_mistake(record, limit, likely):
    """A force in other units would keep it, and explain as much."""
    estimate = identify(MODEL, record, MaximumLikelihood(bounds={"k": (None, limit)}))
    assert (estimate.suspects[0].term == f"bound k <= {limit:g}") == likely


def test_without_a_bound_held_nothing_is_said_of_bounds(record):
    estimator = MaximumLikelihood(fixed={"m": 2.1}, bounds={"k": (1e5, None)})
    estimate = identify(MODEL, record, estimator)
    assert estimate.suspects
    assert not [s.term for s in estimate.suspects if s.term.startswith("bound")]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"fixed": {"m": 2.0}, "constraints": (Constraint("m", 2.0051, 1e-3),)},
            r"m = 2, fixed, which m = 2.0051 contradicts",
        ),
        ({"fixed": {"m": 2.0}, "bounds": {"m": (2.1, None)}}, r"m = 2, fixed, which m >= 2.1"),
        (
            {"known": {"m": (3.0, 1e-3)}, "bounds": {"m": (None, 2.5)}},
            r"m = 3, known with a deviation, which m <= 2.5 contradicts",
        ),
    ],
)
def test_what_contradicts_itself_is_refused(record, given, said):
    with pytest.raises(InputError, match=said) as caught:
        identify(MODEL, record, MaximumLikelihood(**given))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "given",
    [
        {"fixed": {"m": 2.0}, "constraints": (Constraint("m", 2.0049, 1e-3),)},
        {"known": {"m": (2.0, 1e-3)}, "bounds": {"m": (1.9, 2.1), "m*k": (1.0, None)}},
        {"known": {"m": (2.0, 1e-3)}, "constraints": (Constraint("m", 2.01, 1e-2),)},
    ],
)
def test_what_agrees_is_taken(record, given):
    assert identify(MODEL, record, MaximumLikelihood(**given)).status in ("ok", "rejected")
