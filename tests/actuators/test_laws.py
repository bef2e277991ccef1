"""Force laws against closed forms, differences and Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid import InputError
from rotorid.force.entry import LawEntry
from rotorid.force.laws import MU0, Differential, Flux, Linear

MAGNET = Differential(constant=1.2e-5, bias=2.5, gap=4e-4, angle=np.radians(22.5))

SINGLE = Differential(constant=1.2e-5, bias=0.0, gap=4e-4, angle=np.radians(22.5), iron=2e-5)


def test_linear_is_what_it_says() -> None:
    law = Linear(ki=120.0, ks=2e5)
    np.testing.assert_allclose(law.force([0.0, 1.0], [1e-4, 0.0]), [20.0, 120.0])
    assert law.linearize(1.0, 1e-5) is law


def test_slopes_at_the_origin_are_the_closed_forms() -> None:
    slope, c = MAGNET.linearize(), np.cos(MAGNET.angle)
    assert slope.ki == pytest.approx(4 * 1.2e-5 * 2.5 / 4e-4**2 * c, rel=1e-14)
    assert slope.ks == pytest.approx(4 * 1.2e-5 * 2.5**2 / 4e-4**3 * c**2, rel=1e-14)


@given(st.floats(-2.0, 2.0), st.floats(-3e-4, 3e-4))
def test_slopes_are_the_derivatives_of_the_force(current: float, position: float) -> None:
    slope = MAGNET.linearize(current, position)
    di, dx = 1e-5, 1e-9
    by_current = MAGNET.force(current + di, position) - MAGNET.force(current - di, position)
    by_position = MAGNET.force(current, position + dx) - MAGNET.force(current, position - dx)
    assert by_current / (2 * di) == pytest.approx(slope.ki, rel=1e-6)
    assert by_position / (2 * dx) == pytest.approx(slope.ks, rel=1e-5)


@given(st.floats(-20.0, 20.0), st.floats(-3e-4, 3e-4))
def test_without_bias_one_magnet_works_at_a_time(current: float, position: float) -> None:
    """It pulls with the square of its current, to its own side, over its own gap."""
    c, side = np.cos(SINGLE.angle), np.sign(current)
    gap = 4.2e-4 - side * position * c
    force = SINGLE.force(current, position)
    assert force == pytest.approx(side * 1.2e-5 * c * current**2 / gap**2, rel=1e-12)
    assert SINGLE.guess(force, np.float64(position)) == pytest.approx(current, rel=1e-9)
    if abs(current) > 0.01:
        slope = SINGLE.linearize(current, position)
        assert slope.ki == pytest.approx(2 * force / current, rel=1e-12)
        assert slope.ks == pytest.approx(2 * force * side * c / gap, rel=1e-12)


def test_geometry_gives_the_constant_of_a_horseshoe() -> None:
    entry = LawEntry(law="differential", area="2 cm^2", turns=100, bias="2 A", gap="0.5 mm")
    law = entry.build()
    assert isinstance(law, Differential)
    flux = MU0 * 100 * 2.0 / (2 * 5e-4)
    assert law.force(0.0, 0.0) == 0.0
    single = law.constant * (2.0 / 5e-4) ** 2
    assert single == pytest.approx(2 * 2e-4 * flux**2 / (2 * MU0), rel=1e-12)


@pytest.mark.parametrize(
    ("law", "at"),
    [
        (Linear(120.0, 2e5, std={"ki": 2.4, "ks": 1e4}), (0.7, 1e-4)),
        (
            replace(MAGNET, std={"constant": 1e-7, "bias": 0.01, "gap": 4e-6, "angle": 0.01}),
            (0.7, 1e-4),
        ),
        (replace(SINGLE, std={"constant": 1e-7, "gap": 4e-6, "iron": 1e-6}), (-0.7, 1e-4)),
        (Flux(2e-4, 2, 0.3, std={"area": 2e-6, "angle": 0.01}), (0.9, 0.4)),
    ],
)
def test_deviation_of_the_force_is_that_of_drawn_constants(law, at) -> None:
    rng = np.random.default_rng(2)
    forces = []
    for _ in range(4000):
        drawn = {n: getattr(law, n) + std * rng.normal() for n, std in law.std.items()}
        forces.append(replace(law, **drawn).force(*at))
    assert law.force_std(*at) == pytest.approx(np.std(forces), rel=0.05)


def test_deviation_of_the_slopes() -> None:
    law = replace(MAGNET, std={"gap": 4e-6})
    slope = law.linearize()
    assert slope.std["ki"] == pytest.approx(2 * 0.01 * slope.ki, rel=1e-12)
    assert slope.std["ks"] == pytest.approx(3 * 0.01 * slope.ks, rel=1e-12)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Differential(1e-5, 2.0, 0.0), r"gap: found gap = 0.0; expected more than 0 m"),
        (lambda: Differential(1e-5, -2.0, 4e-4), r"bias = -2.0; expected 0 or more"),
        (lambda: Differential(1e-5, 2.0, np.nan), r"gap = nan"),
        (
            lambda: replace(SINGLE, std={"bias": 0.1}),
            r"bias = 0 A, with a deviation of 0.1 A; expected ex",
        ),
        (lambda: Differential(1e-5, 0.0, 4e-4, bias_difference=0.1), r"bias_difference = 0.1"),
        (lambda: SINGLE.linearize(), r"the force has no slope; expected a current other than 0"),
        (lambda: Differential(1e-5, 2.0, 4e-4, angle=2.0), r"less than 90 degrees"),
        (lambda: Linear(0.0), r"ki = 0.0; expected not zero"),
        (lambda: Linear(1.0, std={"ks": -1.0}), r"ks_std = -1.0"),
        (lambda: Flux(0.0), r"area = 0.0"),
        (lambda: Flux(1e-4, poles=0), r"poles = 0"),
        (lambda: MAGNET.force([0.0, 2.6], 0.0), r"current 2.6 A at sample 1, 1 such in all; "),
        (lambda: MAGNET.force(0.0, 5e-4), r"position 0.0005 m, .* less than the gap"),
        (lambda: MAGNET.force(np.nan, 0.0), r"current nan A"),
    ],
)
def test_bad_constants_and_states_are_refused(build, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build()


@given(st.floats(-2.4, 2.4), st.floats(-3.9e-4, 3.9e-4))
def test_opposed_magnets_are_odd(current: float, position: float) -> None:
    """Turned around, the pair pulls the other way."""
    ahead, behind = MAGNET.force(current, position), MAGNET.force(-current, -position)
    assert ahead == pytest.approx(-behind, rel=1e-12)


def test_flux_and_current_laws_agree() -> None:
    rng = np.random.default_rng(1)
    current, position = rng.uniform(-2, 2, 50), rng.uniform(-3e-4, 3e-4, 50)
    law = Flux(area=2e-4, poles=2, angle=MAGNET.angle)
    densities = law.densities(MAGNET, current, position)
    np.testing.assert_allclose(
        law.force(*densities), MAGNET.force(current, position), rtol=1e-12, atol=1e-10
    )
