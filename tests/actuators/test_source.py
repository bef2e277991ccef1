"""Laws kept with the forces that they read: inverted, and followed with other constants."""

from dataclasses import replace

import numpy as np
import pytest

from rotorid import Channel, Record
from rotorid.force.laws import Differential, Flux, LawConstant
from rotorid.force.reading import ForceReading, forces

MAGNET = Differential(
    constant=4e-6,
    bias=2.0,
    gap=4e-4,
    angle=0.3,
    bias_difference=0.05,
    iron=1e-5,
    saturation=7000.0,
)
FIELDS = {"K": "constant"}
TURN = np.linspace(0, 6 * np.pi, 200)
CURRENT, POSITION = 1.2 * np.cos(TURN), 8e-5 * np.sin(TURN / 3 + 0.4)


def test_the_current_is_found_again() -> None:
    found = MAGNET.flowing(MAGNET.force(CURRENT, POSITION), POSITION)
    np.testing.assert_allclose(found, CURRENT, atol=1e-12)


@pytest.mark.parametrize("saturation", [7000.0, np.inf])
def test_the_current_of_magnets_without_bias(saturation: float) -> None:
    """Their bias is no constant that could be another: it is known to be none."""
    law = replace(MAGNET, bias=0.0, bias_difference=0.0, saturation=saturation)
    found = law.flowing(law.force(CURRENT, POSITION), POSITION)
    np.testing.assert_allclose(found, CURRENT, atol=1e-9)
    assert set(law.constants) == {"K", "gap", "angle", "iron", "saturation"}


def test_what_no_current_gives_is_given_by_the_most() -> None:
    most = MAGNET.force(MAGNET.most, 0.0)
    found = MAGNET.flowing(np.array([2.0, -2.0]) * most, np.zeros(2))
    np.testing.assert_allclose(found, [MAGNET.most, -MAGNET.most])


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("K", 1e-7), ("bias", -0.1), ("gap", 2e-5), ("angle", 0.05),
        ("bias_difference", -0.08), ("iron", 5e-6), ("saturation", -500.0),
    ],
)  # fmt: skip
def test_another_constant_is_another_law(name: str, change: float) -> None:
    key = FIELDS.get(name, name)
    other = replace(MAGNET, **{key: getattr(MAGNET, key) + change})
    found = MAGNET.changed(CURRENT, POSITION, {name: change})
    np.testing.assert_allclose(found, other.force(CURRENT, POSITION), rtol=1e-13)


def test_a_knee_is_a_saturation_counted_from_none() -> None:
    """b_s = 1.5 b_0 is (1 / 1.5)^4 of a knee, and the derivative at none is finite."""
    plain = replace(MAGNET, saturation=np.inf)
    saturated = replace(plain, saturation=1.5 * plain.bias / plain.gap)
    found = plain.changed(CURRENT, POSITION, {"knee": 1.5**-4})
    np.testing.assert_allclose(found, saturated.force(CURRENT, POSITION), rtol=1e-13)
    slope = plain.changed(CURRENT, POSITION, {"knee": 1e-30j}).imag / 1e-30
    step = plain.changed(CURRENT, POSITION, {"knee": 1e-6}) - plain.force(CURRENT, POSITION)
    np.testing.assert_allclose(slope, step / 1e-6, atol=1e-4 * np.abs(slope).max())


def test_flux_laws_scale() -> None:
    law = Flux(2e-4, 2, 0.3, std={"area": 2e-6}, shared={"area": "poles"})
    force = law.force(0.6, 0.5)
    assert law.flowing(force, np.zeros(1)) == force
    other = law.changed(force, np.zeros(1), {"area": 1e-5, "angle": -0.1})
    assert other == pytest.approx(Flux(2.1e-4, 2, 0.2).force(0.6, 0.5), rel=1e-14)
    assert law.constants["area"] == LawConstant("m^2", 2e-4, 2e-6, True, "poles")
    assert not law.constants["angle"].std


def test_a_force_keeps_its_law() -> None:
    record = Record(
        [Channel("i", "A", gain_std=0.02), Channel("x", "m")],
        np.stack([CURRENT, POSITION], axis=1),
        1e3,
    )
    law = replace(MAGNET, shared={"gap": "bearings"})
    reading = ForceReading(law, ("i",), {"x": 1.0})
    channel = forces(record, {"F": reading}).channels[0]
    assert channel.law == replace(law, position={"x": 1.0})
    assert channel.gain_std == 0.02
