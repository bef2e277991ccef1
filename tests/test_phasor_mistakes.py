"""Mistakes in tables of phasors and about trial masses are named."""

import re
from pathlib import Path

import numpy as np
import pytest
from coast_down import PROBES, RPM, TRIAL, TRUTH, Change, identify, of_two, write_two

import rotorid as rid
from rotorid import InputError

# Mistakes of a table of phasors: none ends well with a wrong answer, and each is told.


NOISE = 1e-6
FEW = RPM[::2]
TWO = of_two()


def silent(rpm: np.ndarray, phasors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    parts = np.random.default_rng(1).standard_normal((2, len(rpm)))
    return rpm, np.column_stack([phasors[:, 0], 0.5 * NOISE * (parts[0] + 1j * parts[1])])


CHANGES: dict[str, Change] = {
    "": lambda rpm, phasors: (rpm, phasors),
    "swapped": lambda rpm, phasors: (rpm, phasors[:, ::-1]),
    # What `write` calls degrees are radians.
    "radians": lambda rpm, x: (rpm, np.abs(x) * np.exp(1j * np.radians(np.angle(x)))),
    "silent": silent,
    "backward": lambda rpm, phasors: (-rpm, phasors),
    "slower": lambda rpm, phasors: (rpm / 60, phasors),
    "faster": lambda rpm, phasors: (rpm * 60, phasors),
}


def measured(folder: Path, change: Change = CHANGES[""], text: str = TWO) -> rid.Estimate:
    """Identify two noisy coast-downs whose tables were changed."""
    write_two(folder, FEW, NOISE, 3, change)
    return identify(folder, text)


def worst(estimate: rid.Estimate) -> float:
    return max(abs(estimate.value(n) - v) / (estimate.std(n) or 0.0) for n, v in TRUTH.items())


def test_the_tables_as_they_are(tmp_path):
    estimate = measured(tmp_path)
    assert estimate.status == "ok"
    assert worst(estimate) < 3


@pytest.mark.sampled(1, parts=2)
@pytest.mark.parametrize(
    ("change", "old", "new", "told"),
    [
        ("slower", "", "", "speeds of the table 60 times as large .Hz taken for rpm"),
        ("", "std =", "lag = true, std =", "first suspect: phases that count the other"),
        ("", 'phase = "px",', 'phase = "px", lag = true,', "first suspect: the phase of x"),
        ("swapped", "", "", "first suspect: x with y exchanged"),
        ("radians", "", "", "first suspect: phases in radians taken for degrees"),
        ("backward", "", "", "first suspect: the rotor turning the other way"),
        ("silent", "", "", r"first suspect: gain\[y\]"),
        ("faster", "", "", "speeds of the table 0.01667 times as large .rpm taken for Hz"),
        (
            "",
            '"20 g mm"',
            '"-20 g mm"',
            r"first suspect: the trial mass .* at 21[.0-9]+ deg instead of -21.8",
        ),
    ],
)
def test_a_mistake_is_told(tmp_path, change, old, new, told):
    estimate = measured(tmp_path, CHANGES[change], TWO.replace(old, new) if old else TWO)
    assert estimate.status in ("rejected", "not_converged", "not_identifiable")
    assert any(re.search(told, warning) for warning in estimate.warnings)


def test_degrees_read_as_radians_are_refused(tmp_path):
    text = TWO.replace("std =", 'phase_unit = "rad", std =')
    with pytest.raises(InputError, match=r"phase unit, x: phases up to 1\d\d.*phase_unit = .deg."):
        measured(tmp_path, text=text)


def test_a_row_that_is_written_twice_counts_once(tmp_path):
    estimate = measured(tmp_path, lambda rpm, x: (np.append(rpm, rpm[3]), np.vstack([x, x[3]])))
    plain = measured(tmp_path)
    assert estimate.status == "ok"
    assert any("1 row at 2769.23 rpm, the same" in w for w in estimate.warnings)
    np.testing.assert_allclose(estimate.covariance, plain.covariance, rtol=1e-9)


@pytest.mark.parametrize(("factor", "status"), [(5.2, "ok"), (20, "ok"), (60, "rejected")])
def test_only_speeds_off_by_a_unit_are_doubted(tmp_path, factor, status):
    """A start that is far off is none of the speeds' business, but for the factors of units."""
    assert measured(tmp_path, lambda rpm, phasors: (rpm / factor, phasors)).status == status


def test_a_start_that_is_off_in_one_parameter_says_nothing_of_the_speeds(tmp_path):
    text = TWO + 'c = { start = "216 N s/m" }\n'
    assert measured(tmp_path, CHANGES["slower"], text).status == "ok"


def test_rad_per_s_for_hz_is_a_doubt_only(tmp_path):
    estimate = measured(tmp_path, lambda rpm, phasors: (rpm / (2 * np.pi), phasors))
    assert estimate.status == "ok"
    assert any("6.283 times as large (Hz taken for rad/s)" in w for w in estimate.warnings)


@pytest.mark.slow
@pytest.mark.parametrize(("row", "factor", "speed"), [(9, 1.1, 1.0), (4, 1.0, 10.0)])
def test_a_row_that_is_wrong_is_found(tmp_path, row, factor, speed):
    """A reading by ten per cent, a speed by a factor of ten."""

    tables = iter([True, False])  # the first of two

    def mistyped(rpm: np.ndarray, phasors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rpm, phasors = rpm.copy(), phasors.copy()
        if next(tables):
            rpm[row] *= speed
            phasors[row] *= factor
        return rpm, phasors

    estimate = measured(tmp_path, mistyped)
    assert estimate.status in ("rejected", "not_identifiable")
    where = rf"first suspect: the row at {FEW[row] * speed:.6g} rpm of record 1"
    assert re.search(where, estimate.warnings[0])


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("std", "status", "told"),
    [
        ("30 um", "ok", r"the stated std is too large, 0\.0\d+ times as much would do"),
        ("0.1 um", "rejected", r"stated std is too small \((9|1\d)(\.\d)? times as much"),
    ],
)
def test_a_std_that_is_no_std_is_told(tmp_path, std, status, told):
    estimate = measured(tmp_path, text=TWO.replace("1 um", std))
    assert estimate.status == status
    assert any(re.search(told, w) for w in estimate.warnings)


@pytest.mark.slow
def test_one_probe_tells_phases_that_count_backward(tmp_path):
    text = TWO.replace(PROBES, PROBES.partition("y =")[0]).replace("std =", "lag = true, std =")
    estimate = measured(tmp_path, text=text)
    assert estimate.status != "ok"
    assert "lag" in [s.term for s in estimate.suspects][:3]


# A trial mass at another angle than was said, and exchanged files: both named, with a cure.


@pytest.fixture
def folder(tmp_path):
    write_two(tmp_path, noise=1e-7)
    return tmp_path


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "trial",
    [TRIAL.conjugate(), -TRIAL, complex(TRIAL * np.exp(1.2j))],
    ids=["counted the other way", "on the other side", "elsewhere"],
)
def test_a_trial_mass_at_a_wrong_angle(folder, trial):
    told = TWO.replace('"5e-5 kg m"', f'"{trial.real!r} kg m"')
    estimate = identify(folder, told.replace('"20 g mm"', f'"{trial.imag!r} kg m"'))
    assert estimate.status != "ok"
    (found,) = [s for s in estimate.suspects if s.term == "trial mass[1]"]
    assert found.share > 0.999
    assert found.value == pytest.approx(np.angle(TRIAL), abs=0.02)
    first = estimate.warnings[0]
    assert "trial mass" in first
    assert "exchanged" in first
    assert "unknown" not in first


@pytest.mark.slow
def test_the_files_of_two_runs_exchanged(folder):
    exchanged = TWO.replace("bare.csv", "other.csv").replace("run.csv", "bare.csv")
    estimate = identify(folder, exchanged.replace("other.csv", "run.csv"))
    told = estimate.warnings[0]
    assert "swap[record 1, record 2]" in {s.term for s in estimate.suspects[:2]}
    assert "exchanged" in told
    assert "unknown" not in told
