"""The residual of least squares against its scatter: moments, chances, and machines that differ."""

import numpy as np
import pytest
from severities import doubting, rejecting

import rotorid as rid
from rotorid.answer import machine_checks as gate
from rotorid.core.distributions import Expectation
from rotorid.linear.solve import Fitted, misfit

FAMILY = ("ls", "batch", "sequential")
FREE, LINES, ROWS = 3, 6, 2
MULTIPLICITY = np.array([2.0, 2, 2, 2, 2, 1])
"""The last line is that of Nyquist: real."""


def complexes(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def drawn_equations(rng, dof=10**12):
    """Return what draws a fit of random equations, solved with weights that are not the best."""
    design, mixed = complexes(rng, LINES, ROWS, FREE), complexes(rng, LINES, ROWS, ROWS)
    design[-1], mixed[-1] = design[-1].real, mixed[-1].real
    covariance = mixed @ mixed.conj().swapaxes(1, 2) * rng.uniform(0.1, 9.0, (LINES, 1, 1))
    size = MULTIPLICITY[:, None] * rng.uniform(0.2, 5.0, (LINES, ROWS))
    matrix = np.concatenate([(size[..., None] * part) for part in (design.real, design.imag)])
    right = np.concatenate([design.real, design.imag])
    normal = np.einsum("krf,krg->fg", right, matrix)
    solved = np.linalg.solve(
        normal, np.moveaxis(size[..., None] * design.conj(), -1, 0).reshape(FREE, -1)
    )
    gains = solved.reshape(FREE, LINES, ROWS)

    def draw():
        noise = np.einsum("krs,ks->kr", mixed, complexes(rng, LINES, ROWS)) / np.sqrt(2)
        noise[-1] = mixed[-1] @ rng.standard_normal(ROWS)
        noise *= np.sqrt(covariance[:, 0, 0].real / (np.abs(mixed[:, 0]) ** 2).sum(axis=1))[:, None]
        answer = np.einsum("fkr,kr->f", gains, noise).real
        return Fitted(
            noise - design @ answer, design, gains, covariance, np.ones(ROWS), MULTIPLICITY, dof
        )

    return draw


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", range(3))
def test_mean_and_variance_are_those_of_the_residual(number):
    rng = np.random.default_rng([5, number])
    draw = drawn_equations(rng)
    found = [misfit([draw()]) for _ in range(4000)]
    costs, expected = np.array([cost for cost, _ in found]), found[0][1]
    assert costs.mean() == pytest.approx(expected.mean, rel=0.04)
    assert costs.var() == pytest.approx(expected.variance, rel=0.12)
    chances = np.array([each.p_value(cost) for cost, each in found])
    for chance in (0.05, 0.5):
        spread = np.sqrt(chance * (1 - chance) / len(chances))
        assert (chances < chance).mean() == pytest.approx(chance, abs=4 * spread + 0.02)


def test_few_periods_leave_a_larger_and_wider_cost():
    rng = np.random.default_rng(6)
    known = misfit([drawn_equations(rng)()])[1]
    rng = np.random.default_rng(6)
    few = misfit([drawn_equations(rng, dof=9)()])[1]
    assert few.mean == pytest.approx(known.mean * 9 / 8)  # the mean of F with 18 of freedom
    assert few.variance / few.mean**2 > 1.2 * known.variance / known.mean**2


JEFFCOTT = rid.load_model("jeffcott").substitute({"xi": 0.0, "zeta": 0.0})
HARMONICS = np.array([1, 3, 5, 7, 9, 11])
TRUTH = np.array([2.0, 60.0, 2e5])


def shaken(rng, apart=1.0, position=3e-7, periods=40):
    """Return periods of a disc shaken at standstill, its second stiffness so many times the first.

    Closed form, line by line; noise of .2 N, and of so many metres.
    """
    s = 2j * np.pi * 20.0 * HARMONICS
    force = 5 * np.exp(2j * np.pi * rng.random((len(HARMONICS), 2)))
    mass, damping, stiffness = TRUTH
    stiff = stiffness * np.array([1.0, apart])
    motion = force / ((mass * s**2 + damping * s)[:, None] + stiff)
    samples = 250
    time = np.arange(samples) / samples
    waves = np.exp(2j * np.pi * np.outer(time, HARMONICS))
    clean = np.hstack([(waves @ force).real, (waves @ motion).real])
    size = np.array([0.2, 0.2, position, position])
    noisy = np.tile(clean, (periods, 1)) + size * rng.standard_normal((samples * periods, 4))
    channels = [rid.Channel(name) for name in ("F_x", "F_y", "x", "y")]
    return rid.average(rid.Record(channels, noisy, 5000.0), 20.0, harmonics=HARMONICS)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("method", FAMILY)
def test_a_right_model_is_what_its_noise_leaves(method, monkeypatch):
    chances, judge = [], gate.residual
    monkeypatch.setattr(
        gate, "residual", lambda c, e: (chances.append(e.p_value(c)), judge(c, e))[1]
    )
    rng = np.random.default_rng(7)
    found = [rid.identify(JEFFCOTT, shaken(rng), method) for _ in range(60)]
    assert {estimate.status for estimate in found} == {"ok"}
    assert 0.35 < np.mean(chances) < 0.65
    assert min(chances) > 1e-4


@pytest.mark.parametrize("method", FAMILY)
def test_a_wrong_model_is_turned_away(method):
    """A stiffness that differs by 2 % between two axes: the prediction is off by a few per cent."""
    estimate = rid.identify(JEFFCOTT, shaken(np.random.default_rng(8), apart=1.02), method)
    assert estimate.status == "rejected"
    assert any("times what noise leaves of them" in text for text in estimate.warnings)
    assert estimate.prediction["F_y"].relative_error < gate.UNPREDICTED


@pytest.mark.slow
def test_the_bias_of_noise_is_that_of_many_records(monkeypatch):
    """What halves tell of a bias is, in the mean, by what many answers are off."""
    told, judge = [], gate.noise_bias
    monkeypatch.setattr(gate, "noise_bias", lambda n, b, s: (told.append(b), judge(n, b, s))[1])
    rng = np.random.default_rng(9)
    found = [rid.identify(JEFFCOTT, shaken(rng, position=4e-5), "ls") for _ in range(60)]
    values = np.array([[v.value for v in e.parameters] for e in found])
    names = [v.name for v in found[0].parameters]
    order = [names.index(name) for name in ("m", "c", "k")]
    error = values[:, order].mean(axis=0) - TRUTH
    scatter = values[:, order].std(axis=0) / np.sqrt(len(values))
    bias = np.array(told)[:, order].mean(axis=0)
    assert (np.abs(error) > 6 * scatter)[[0, 2]].all()  # there is one
    assert (np.abs(bias - error) < 4 * scatter + 0.1 * np.abs(error)).all()


def test_a_bias_is_told_and_then_turned_away():
    std = np.array([1.0, 0.0])
    for bias, doubts, faults in ((0.9, 0, 0), (-1.1, 1, 0), (9.9, 1, 0), (-10.1, 0, 1)):
        notes = list(gate.noise_bias(["m", "fixed"], np.array([bias, 99.0]), std))
        assert (len(doubting(notes)), len(rejecting(notes))) == (doubts, faults)


def test_a_residual_is_doubted_and_then_turned_away():
    expected = Expectation(20.0, 40.0, 20)
    seen = {0.002: (0, 0), 5e-4: (1, 0), 2e-6: (1, 0), 5e-7: (0, 1)}
    for chance, counts in seen.items():
        low, high = 20.0, 200.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if expected.p_value(middle) > chance else (low, middle)
        notes = list(gate.residual(low, expected))
        assert (len(doubting(notes)), len(rejecting(notes))) == counts
