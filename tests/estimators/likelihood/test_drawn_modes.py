"""Natural frequencies of a drawn rotor alone: what they determine, and what the drawing lacks."""

import re

import numpy as np
import pytest
import scipy.linalg
from rotor_files import CORED

import rotorid as rid

ALIKE = """
title = "a shaft that is the same from either end"
sections = [{ length = "500 mm", outer = "25 mm", material = "steel", elements = 6 }]
[materials]
steel = { E = "210 GPa", G = "81 GPa", density = "7850 kg/m^3" }
[discs]
wheel = { at = "250 mm", mass = "m_w", I_t = "1.5e-3 kg m^2", I_p = "2.8e-3 kg m^2" }
[parameters]
m_w = { unit = "kg", nominal = 1.2, positive = true }
"""
FREE, SPRUNG = {"k_s": 0.0}, {}
SHARE = 2e-4
KNOWN = {"s_A": 1.0, "s_B": 1.0, "m_w": 1.2, "k_s": 1e6}


def with_mass(text, at):
    extra = f'extra = {{ at = "{at}", mass = "50 g", I_t = "0 kg m^2", I_p = "0 kg m^2" }}'
    return text.replace("[discs]\n", f"[discs]\n{extra}\n")


def measured(text, *tests, count=3, **truth):
    """Return the lowest natural frequencies of each test, scattered by `SHARE`."""
    model, rng, found = rid.parse_model(text), np.random.default_rng(1), []
    for test in tests:
        m = model.require_linear().matrices(model.values(model.nominal | truth | test), 0.0)
        squares = scipy.linalg.eigh(m.K, m.M, eigvals_only=True)
        hertz = np.sqrt(squares[squares > (2 * np.pi) ** 2])[: 2 * count : 2] / (2 * np.pi)
        hertz *= 1 + SHARE * rng.standard_normal(len(hertz))
        found += [rid.Mode(f, SHARE * f, parameters=test) for f in hertz]
    return found


def identified(modes, fixed=None, text=CORED):
    settings = rid.MaximumLikelihood(fixed=fixed or {}, modes=modes)
    return rid.identify(rid.parse_model(text), [], settings)


def test_six_frequencies_give_two_stiffnesses_a_mass_and_a_support():
    truth = {"s_A": 1.15, "s_B": 0.9, "m_w": 1.25, "k_s": 1.2e6}
    estimate = identified(measured(CORED, FREE, SPRUNG, **truth))
    assert estimate.status == "ok"
    for name, value in truth.items():
        assert abs(estimate.value(name) - value) < 3 * estimate.std(name)
        assert estimate.std(name) < 0.005 * value


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("kept", "told"),
    [
        (slice(0, 3), "natural frequencies with k_s as it is in service: all that were measured"),
        (slice(0, 3), "at least 1 more measured in .*: 3 for 4 unknowns are too few"),
        (slice(3, 6), "at least 1 more measured in .*: 3 for 4 unknowns are too few"),
        (slice(0, 1), "at least 3 more measured in .*: 1 for 4 unknowns are too few"),
    ],
)
def test_too_few_are_refused_with_what_is_missing(kept, told):
    estimate = identified(measured(CORED, FREE, SPRUNG)[kept])
    assert estimate.status == "not_identifiable"
    assert any(np.isnan(v.std) for v in estimate.parameters)
    assert any(re.search(told, text) for text in estimate.warnings)
    assert not any("as many unknowns" in text for text in estimate.warnings)


@pytest.mark.slow
def test_as_many_as_there_are_unknowns_check_nothing_and_say_so():
    modes = measured(CORED, FREE, SPRUNG)
    told = "nothing is left over that could contradict the model"
    estimate = identified([*modes[:3], modes[3]])
    assert estimate.status == "ok"
    assert estimate.misfit.dof == 0
    assert any(told in text for text in estimate.warnings)
    assert not any(told in text for text in identified(modes).warnings)


@pytest.mark.slow
@pytest.mark.parametrize("at", ["0 mm", "500 mm"])
def test_which_end_carries_a_mass_is_not_told_by_a_shaft_that_is_the_same_from_either(at):
    modes = measured(with_mass(ALIKE, at), {}, count=4)
    estimate = identified(modes, text=ALIKE)
    assert estimate.status == "rejected"
    first, second = estimate.suspects[:2]
    assert first.term == "mass at x_left_end, y_left_end"  # they stand from left to right
    assert second.term == "mass at x_right_end, y_right_end"
    assert first.value == pytest.approx(0.05, rel=0.01)
    assert second.value == pytest.approx(0.05, rel=0.01)
    told = "which end carries it is not determined by these frequencies"
    assert any(told in text for text in estimate.warnings)
    mended = with_mass(ALIKE, at)
    assert identified(modes, text=mended).status == "ok"


@pytest.mark.slow
def test_the_end_is_told_where_the_shaft_is_another_from_either():
    modes = measured(with_mass(CORED, "0 mm"), FREE, count=5)
    estimate = identified(modes, KNOWN)
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term == "mass at x_left, y_left"
    assert estimate.suspects[0].value == pytest.approx(0.05, rel=0.02)
    assert not any("which end" in text for text in estimate.warnings)
    assert identified(modes, KNOWN, with_mass(CORED, "0 mm")).status == "ok"


@pytest.mark.slow
def test_a_fit_that_is_stiffer_than_drawn_is_found_by_frequencies():
    modes = measured(CORED, FREE, SPRUNG, s_A=1.2)
    estimate = identified(modes, {"s_A": 1.0})
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term == "prior s_A"
    assert estimate.suspects[0].value == pytest.approx(1.2, rel=0.02)
    assert "stiffness section 2" in {suspect.term for suspect in estimate.suspects[:4]}
