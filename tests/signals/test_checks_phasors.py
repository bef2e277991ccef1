"""What a table of phasors shows before any model, at the limits."""

import numpy as np
import pytest

from rotorid.signals.checks.channels import check_phases, check_probes


def found(phasors: list[complex], std: float | None = None) -> list[tuple[str, str]]:
    column = np.array(phasors, dtype=np.complex128)[:, None]
    deviation = None if std is None else np.full(column.shape, std)
    return [(c.about, c.verdict) for c in check_probes(["x"], column, deviation)]


def test_a_probe_that_reads_nothing_or_ever_the_same() -> None:
    assert found([0, 0]) == [("dead", "refused")]
    assert found([0, 1]) == []
    assert found([1j, 1j, 1j]) == [("dead", "refused")]
    assert found([1j, 1j]) == []  # two rows may well agree


@pytest.mark.parametrize(("highest", "silent"), [(2.8, True), (3.2, False)])
def test_a_probe_that_does_not_rise_above_its_noise(highest: float, silent: bool) -> None:
    assert found([1, 1.1j, highest], 1.0) == ([("silent", "warning")] if silent else [])
    assert found([1, 1.1j, highest]) == []


@pytest.mark.parametrize(
    ("phases", "degrees", "verdicts"),
    [
        ([0.0, 1.0, 1.4], True, []),
        ([0.0, 1.0, 1.6], True, ["warning"]),
        ([0.0, 1.6], True, []),  # two rows say little
        ([0.0, 3.0, 6.2], True, ["warning"]),
        ([0.0, 3.0, 6.4], True, []),
        ([0.0, 3.0, 12.4], False, []),
        ([0.0, 3.0, 12.7], False, ["refused"]),
        ([0.0, -12.7], False, ["refused"]),
    ],
)
def test_phases_that_are_hardly_in_their_unit(
    phases: list[float], degrees: bool, verdicts: list[str]
) -> None:
    checks = check_phases("x", np.array(phases), degrees=degrees)
    assert [c.verdict for c in checks] == verdicts
