"""What is wrong with a whole record is told, where the misfit may not show it."""

from dataclasses import replace

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, levitated

import rotorid as rid


@pytest.fixture(scope="module")
def record() -> rid.Record:
    return levitated(1)


def lines_of(record: rid.Record, samples: np.ndarray) -> rid.Lines:
    changed = replace(record, samples=samples)
    return rid.spectra(changed, (2.0, 120.0), references=["r_x", "r_y"])


def test_a_channel_that_is_cut_at_a_limit_is_told(record: rid.Record) -> None:
    assert not lines_of(record, record.samples).checks
    samples, x = record.samples.copy(), record.names.index("x")
    limit = np.quantile(np.abs(samples[:, x]), 0.98)
    samples[:, x] = np.clip(samples[:, x], -limit, limit)
    estimate = rid.identify(MODEL, lines_of(record, samples), KNOWN)
    told = [check for check in estimate.checks if check.check == "clipped"]
    assert [(check.channel, check.verdict) for check in told] == [("x", "warning")]


def test_references_that_are_not_logged_to_the_end_are_told(record: rid.Record) -> None:
    """What they drove counts as noise then: too little is left of it in the misfit."""
    samples = record.samples.copy()
    samples[len(samples) // 2 :, [record.names.index(name) for name in ("r_x", "r_y")]] = 0.0
    wrong = rid.identify(MODEL, lines_of(record, samples), KNOWN)
    right = rid.identify(MODEL, lines_of(record, record.samples), KNOWN)
    assert right.status == "ok"
    assert not [w for w in right.warnings if "far below" in w]
    assert wrong.misfit is not None
    assert wrong.misfit.cost < 0.95 * wrong.misfit.expected
    assert any("is far below" in w and "references are late" in w for w in wrong.warnings)


def test_one_column_for_two_sensors_is_told(record: rid.Record) -> None:
    samples = record.samples.copy()
    samples[:, record.names.index("y")] = -2 * samples[:, record.names.index("x")]
    (told,) = lines_of(record, samples).checks
    assert (told.check, told.channel, told.verdict) == ("copied", "x, y", "warning")
    assert "y is -2 times x, noise and all" in told.found
