"""Projecting out what no sensor reads: by reflections that are formed, and one by one."""

import numpy as np
import pytest

from rotorid.likelihood import whitening
from rotorid.likelihood.whitening import by_qr, by_reflections, projection


@pytest.fixture
def machine():
    """Two lines of 17 rows and 15 coordinates, of which 12 combinations are hidden."""
    rng = np.random.default_rng(0)
    stiffness = rng.standard_normal((2, 17, 15)) + 1j * rng.standard_normal((2, 17, 15))
    return stiffness, np.linalg.qr(rng.standard_normal((15, 12)))[0]


@pytest.mark.parametrize("way", [by_qr, by_reflections])
def test_nothing_is_left_of_what_is_hidden_and_its_motion_explains_the_rest(machine, way):
    stiffness, hidden = machine
    found = way(stiffness, hidden)
    eye = np.broadcast_to(np.eye(5), (2, 5, 5))
    np.testing.assert_allclose(
        found.null_h @ found.null_h.conj().transpose(0, 2, 1), eye, atol=1e-13
    )
    assert np.abs(found.null_h @ stiffness @ hidden).max() < 1e-12
    w = np.arange(1.0, 13.0) * (1 + 2j)
    left = stiffness @ (hidden @ w)
    np.testing.assert_allclose(found.motion(-left), np.stack(2 * [hidden @ w]), rtol=1e-11)


def test_twelve_hidden_coordinates_are_many(machine, monkeypatch):
    stiffness, hidden = machine
    monkeypatch.setattr(whitening, "by_reflections", lambda *_: "one by one")
    assert projection(stiffness, hidden) == "one by one"
    assert projection(stiffness, hidden[:, 1:]) != "one by one"
    assert projection(stiffness, hidden[:, :0]) is None
