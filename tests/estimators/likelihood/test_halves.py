"""Halves of a record against each other, their loads by the rotor angle in each."""

from dataclasses import replace

import numpy as np
import pytest

from rotorid import MaximumLikelihood, identify
from rotorid.answer.machine_checks import agreement

TURN = 7  # the line of the rotation, 140 Hz


def turning(record, degrees: float):
    """Let the rotation's line turn from period to period, by so much in all, forwards."""
    phase = np.radians(degrees) * (np.arange(record.periods) / record.periods - 0.5)
    spectra = record.spectra.copy()
    spectra[:, list(record.harmonics).index(TURN)] *= np.exp(1j * phase)[:, None]
    return replace(record, spectra=spectra)


def stated(record, degrees: float):
    """State a speed with which the rotor turns further by so much over the record."""
    share = (record.time / record.time.max()) - 0.5
    return replace(record, angle=record.angle + np.radians(degrees) * share)


@pytest.fixture
def record(demo):
    """The demonstration without force at the speed of rotation, where only unbalance acts."""
    lines = [k for k in demo.harmonics if k != TURN]
    clean = demo.record(harmonics=demo.harmonics)
    still = demo.record(harmonics=demo.harmonics, amplitude=1e-9)
    spectra, at = clean.spectra.copy(), list(clean.harmonics).index(TURN)
    spectra[:, at] = still.spectra[:, at]
    assert len(lines) == 5
    return demo.noisy(replace(clean, spectra=spectra), np.random.default_rng(8))


@pytest.mark.slow
def test_a_speed_that_is_off_by_a_hundred_thousandth_is_told(demo, record):
    found = identify(demo.model, stated(record, 6.0), MaximumLikelihood())
    assert found.misfit.p_value > 1e-3  # no misfit of the mean shows it
    assert [w for w in found.warnings if w.startswith("speed: the unbalance turns with")]
    right = identify(demo.model, record, MaximumLikelihood())
    assert right.status == "ok"
    # The angle is no better known than by its creep, and the deviations know it.
    assert found.std("xi") > 3 * right.std("xi")
    (told,) = agreement(["xi"], np.array([[-7.0], [7.0]]), np.ones(1), {"xi"})
    assert "the speed is not the one stated, or wanders" in told.text


@pytest.mark.slow
def test_a_rotation_that_turns_as_stated_is_no_matter(demo, record):
    """Two degrees: less than what the checks of the rotation's line take for a wandering speed."""
    found = identify(demo.model, turning(stated(record, 2.0), 2.0), MaximumLikelihood())
    assert not [w for w in found.warnings if w.startswith("the halves of the record differ")]
    other = identify(demo.model, turning(record, 6.0), MaximumLikelihood())
    assert [w for w in other.warnings if w.startswith("speed: the unbalance turns with")]
