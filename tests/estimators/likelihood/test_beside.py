"""The expected cost of a whole record by its equation errors: mean, variance, what it leaves."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, levitated, lines_of

from rotorid import identify
from rotorid.data.lines import Beside
from rotorid.data.observation import bind
from rotorid.likelihood import expected_cost as by_errors
from rotorid.likelihood.other_answers import _idle_share

LINES = 500


@dataclass
class Errors:
    """An evaluation that holds equation errors of unit noise, and nothing else."""

    values: np.ndarray
    null_h: None = None

    @property
    def problem(self):
        return SimpleNamespace(
            equations=self.values.shape[1],
            multiplicity=np.full(len(self.values), 2.0),
            noise=SimpleNamespace(factor=self.columns),
        )

    @property
    def columns(self):
        return np.broadcast_to(np.eye(self.values.shape[1]), (len(self.values), 2, 2))

    def errors(self):
        return self.values


def complex_noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)


def beside(rng: np.random.Generator, references: int, **more) -> Beside:
    columns = np.column_stack([complex_noise(rng, LINES, references), np.ones(LINES)])
    number = np.arange(LINES)
    return Beside(columns, np.ones(LINES, dtype=bool), number, number, **more)


@pytest.mark.slow
@pytest.mark.parametrize(("references", "quiet"), [(0, False), (4, False), (0, True)])
def test_mean_and_variance_of_the_sum(references, quiet):
    """Noise of unit size on two equations, 120 times: as predicted by counting."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(120):
        noise = complex_noise(rng, LINES, 2) if quiet else None
        near = beside(rng, references, noise=noise)
        found.append(by_errors._sum_of(Errors(complex_noise(rng, LINES, 2)), near, [0, 1]))
    cost, mean = np.array([s.cost for s in found]), np.mean([s.mean for s in found])
    variance = np.mean([s.variance for s in found])
    assert abs(cost.mean() - mean) < 3 * np.sqrt(variance / 120)
    assert 0.7 < cost.var(ddof=1) / variance < 1.4
    # Chi-squared would be four of each equation of a line; here it is far off.
    assert variance < 0.5 * 4 * 2 * LINES or quiet
    assert variance > 2 * 4 * 2 * LINES or not quiet


def test_noise_of_the_channels_is_told_by_the_errors():
    """Three channels behind two equations that change from line to line."""
    rng = np.random.default_rng(3)
    rows = complex_noise(rng, 400, 2, 3) * np.linspace(0.1, 3, 400)[:, None, None]
    truth = np.array([4.0, 1.0, 0.25])
    noise = complex_noise(rng, 400, 3) * np.sqrt(truth)
    errors = (rows @ noise[:, :, None])[:, :, 0]
    found = by_errors._channel_noise(rows, errors, np.ones(3))
    assert found / truth == pytest.approx(1, abs=0.5)
    assert 5 < found[0] / found[2] < 40


def test_noise_of_the_channels_is_told_in_ten_rounds():
    """Of two channels behind one equation: v + v^2 (1 - s) / s^2 from v, s the sum of both."""
    told = np.array([3.0, 1.0])
    for _ in range(10):
        told = told + told**2 * (1 - told.sum()) / told.sum() ** 2
    start = np.array([3.0, 1.0])
    found = by_errors._channel_noise(np.ones((5, 1, 2)) + 0j, np.ones((5, 1)) + 0j, start)
    assert found == pytest.approx(told, rel=1e-12)


def test_some_hundreds_of_lines_tell_the_noise(monkeypatch):
    seen, told = [], by_errors._channel_noise

    def watched(rows, *rest):
        seen.append(len(rows))
        return told(rows, *rest)

    monkeypatch.setattr(by_errors, "_channel_noise", watched)
    number = np.arange(1600)
    near = Beside(np.ones((1600, 1)) + 0j, number >= 0, number, number)
    by_errors._whitened(Errors(complex_noise(np.random.default_rng(8), 1600, 2)), near, [0, 1])
    assert seen == [400]


def test_a_line_that_stands_out_is_in_its_own_cost_alone():
    rng = np.random.default_rng(6)
    errors = complex_noise(rng, LINES, 2)
    errors[250] *= 100
    near = beside(rng, 1)
    ordinary = near.ordinary.copy()
    ordinary[250] = False
    hidden = by_errors._sum_of(Errors(errors), near, [0, 1])
    seen = by_errors._sum_of(Errors(errors), replace(near, ordinary=ordinary), [0, 1])
    assert seen.cost > 5 * seen.mean
    assert hidden.cost < 1.1 * hidden.mean


def test_too_few_lines_and_no_noise_tell_nothing():
    rng = np.random.default_rng(7)
    near = beside(rng, 1)
    few = slice(0, 20)
    short = Beside(near.columns[few], near.ordinary[few], near.centre[few], near.where[few])
    assert by_errors._sum_of(Errors(complex_noise(rng, 20, 2)), short, [0, 1]) is None
    nothing = Errors(np.zeros((LINES, 2), dtype=complex))
    assert by_errors._sum_of(nothing, near, [0, 1]) is None


@dataclass
class Mode(Errors):
    """Errors of one equation of two channels, the first of which weighs more beside a mode."""

    rows: np.ndarray = None

    @property
    def problem(self):
        noise = SimpleNamespace(factor=np.broadcast_to(np.eye(2), (LINES, 2, 2)))
        return SimpleNamespace(noise=noise)

    @property
    def columns(self):
        return self.rows


def test_loads_of_a_quiet_record_tell_no_noise():
    """They leak into all of its lines; errors come out of one size, beside the mode and away.

    With sizes told by the quiet record J was .35 % below what it should be, in 240 records.
    """
    rng = np.random.default_rng(9)
    offset = np.arange(LINES) - 250.5
    rows = np.stack([50 / (1 + offset**2), np.ones(LINES)], axis=1)[:, None, :] + 0j
    noise, still = complex_noise(rng, 2, LINES, 2)
    still[:, 1] += 300 / offset
    errors = (rows @ noise[:, :, None])[:, :, 0]
    white, _ = by_errors._whitened(Mode(errors, rows=rows), beside(rng, 0, noise=still), [0, 1])
    size, near = (np.abs(white) ** 2).sum(axis=1), np.abs(offset) < 12
    assert 0.5 < size[near].mean() / size[~near].mean() < 2


@pytest.fixture(scope="module")
def lines():
    return lines_of(levitated(3))


@pytest.mark.parametrize(("wide", "low", "high"), [(1.0, 0.97, 1.03), (1.08, 0.97, 1.03)])
def test_noise_that_bends_moves_the_expectation(lines, wide, low, high):
    """C a little too large, as of noise that bends in its window: the misfit is no smaller."""
    covariance = replace(lines.covariance, matrices=wide * lines.covariance.matrices)
    misfit = identify(MODEL, replace(lines, covariance=covariance), KNOWN).misfit
    assert low < misfit.cost / misfit.expected < high
    assert 1e-3 < misfit.p_value < 1 - 1e-3


def test_a_covariance_that_holds_motion_is_told(lines):
    """C much too large is no bend of noise: the cost is too good, and that is said."""
    covariance = replace(lines.covariance, matrices=1.15 * lines.covariance.matrices)
    estimate = identify(MODEL, replace(lines, covariance=covariance), KNOWN)
    assert estimate.misfit.cost < 0.9 * estimate.misfit.expected


def test_columns_exchanged_are_exchanged_in_the_quiet_record_too():
    """Sensors taken for one another, one upside down: as if both records were logged so."""
    record, quiet = levitated(2), levitated(4, excitation=0.0)
    matrix = np.eye(6)
    matrix[2:4, 2:4] = [[0.0, 1.0], [-1.0, 0.0]]
    logged = [replace(each, samples=each.samples @ matrix.T) for each in (record, quiet)]
    expected = lines_of(logged[0], quiet=logged[1])
    found = bind(MODEL, lines_of(record, quiet=quiet)).with_columns(matrix[:4, :4]).lines
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12)
    np.testing.assert_allclose(found.beside.noise, expected.beside.noise, rtol=1e-12)


def test_what_a_controller_makes_of_noise_drives_the_rotor():
    """Noise of an input that is larger than V allows is force: V - s^2 b b^H stays positive."""
    rng = np.random.default_rng(8)
    rows = complex_noise(rng, 5, 2, 3)
    matrices = rows @ rows.conj().transpose(0, 2, 1)
    lower, columns = np.linalg.cholesky(matrices), complex_noise(rng, 5, 2, 2)
    factor = np.stack([np.diag([10.0, 1e-3])] * 5).astype(complex)  # of the loop; of an amplifier
    at = SimpleNamespace(
        whitened_columns=lambda: np.linalg.solve(lower, columns),
        problem=SimpleNamespace(noise=SimpleNamespace(factor=factor)),
    )
    share = _idle_share(at, 2)
    np.testing.assert_allclose(share[:, 1], 1.0)
    for line in range(5):
        left = matrices[line] - (10 * share[line, 0]) ** 2 * np.outer(
            columns[line, :, 0], columns[line, :, 0].conj()
        )
        smallest, largest = np.linalg.eigvalsh(left)
        assert abs(smallest) < 1e-9 * largest
