"""What is wrong with a whole record is told, where the misfit may not show it."""

from dataclasses import replace

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, levitated

import rotorid as rid
from rotorid.answer.judge import of_data


@pytest.fixture(scope="module")
def record() -> rid.Record:
    return levitated(1)


def lines_of(record: rid.Record, samples: np.ndarray) -> rid.Lines:
    changed = replace(record, samples=samples)
    return rid.spectra(changed, (2.0, 120.0), references=["r_x", "r_y"])


@pytest.mark.slow
def test_a_channel_that_is_cut_at_a_limit_is_told(record: rid.Record) -> None:
    assert not lines_of(record, record.samples).checks
    samples, x = record.samples.copy(), record.names.index("x")
    limit = np.quantile(np.abs(samples[:, x]), 0.98)
    samples[:, x] = np.clip(samples[:, x], -limit, limit)
    estimate = rid.identify(MODEL, lines_of(record, samples), KNOWN)
    told = [check for check in estimate.checks if check.about == "clipped"]
    assert [(", ".join(check.on), check.verdict) for check in told] == [("x", "warning")]


@pytest.mark.slow
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
    assert (told.about, ", ".join(told.on), told.verdict) == ("copied", "x, y", "warning")
    assert "y is -2 times x, noise and all" in told.found


def frozen(record: rid.Record, name: str, value: float | None = None) -> np.ndarray:
    """Return samples of which a channel stays at its last value, or at another, from 3.5 s on."""
    samples, column = record.samples.copy(), record.names.index(name)
    at = round(0.7 * len(samples))
    samples[at:, column] = samples[at - 1, column] if value is None else value
    return samples


@pytest.mark.slow
def test_a_sensor_that_stops_is_refused(record: rid.Record) -> None:
    with pytest.raises(rid.InputError, match=r"stuck, x: .* from 3.4998 to 5 s.*check its cable"):
        rid.identify(MODEL, lines_of(record, frozen(record, "x")), KNOWN)


@pytest.fixture(scope="module")
def stopped(record: rid.Record) -> rid.Estimate:
    return rid.identify(MODEL, lines_of(record, frozen(record, "F_x")), KNOWN)


def test_an_input_that_stops_is_told_before_any_suspect(stopped: rid.Estimate) -> None:
    found = stopped
    assert found.status == "rejected"
    assert found.warnings[0].startswith("before any suspect, see to stuck, F_x: ")
    assert sum("stuck, F_x" in text for text in found.warnings) == 1


def test_a_reference_that_stops_is_told(record: rid.Record) -> None:
    """It makes deviations too wide, and no answer wrong; at zero an axis may have been at rest."""
    for value, verdict in ((None, "warning"), (0.0, "note")):
        (told,) = lines_of(record, frozen(record, "r_x", value)).checks
        assert (told.about, ", ".join(told.on), told.verdict) == ("stuck reference", "r_x", verdict)


@pytest.mark.parametrize(
    ("names", "value", "verdict"),
    [(("r_x",), 7.0, "warning"), (("r_x",), 0.0, "note"), (("r_x", "r_y"), 0.0, "warning")],
)
def test_references_that_never_move_are_told(
    record: rid.Record, names: tuple[str, ...], value: float, verdict: str
) -> None:
    samples = record.samples.copy()
    samples[:, [record.names.index(name) for name in names]] = value
    told = lines_of(record, samples).checks
    assert [(check.on, check.verdict) for check in told] == [((name,), verdict) for name in names]
    assert "name the column of the excitation" in told[0].found


def test_a_sensor_that_plays_with_its_last_digit_is_told_first(record: rid.Record) -> None:
    samples = record.samples.copy()
    samples[:, record.names.index("x")] = 4e-6 + 1e-8 * np.random.default_rng(1).integers(
        -1, 2, len(samples)
    )
    (told,) = lines_of(record, samples).checks
    assert (told.about, ", ".join(told.on), told.verdict) == ("quantized", "x", "warning")
    (first,) = of_data([told], "rejected")
    assert first.text.startswith("before any suspect, see to quantized, x: 4e-06 m in every sample")
