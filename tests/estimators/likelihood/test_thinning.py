"""Few lines lead to the minimum of many."""

from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, levitated

import rotorid as rid
from rotorid.data.observation import bind
from rotorid.likelihood import assembly, solver
from rotorid.likelihood import starts as search
from rotorid.likelihood import starts as thinning
from rotorid.likelihood import summary as result
from rotorid.likelihood.problem import Point, Tangent
from rotorid.likelihood.response import _motion
from rotorid.likelihood.rivals import PLAIN
from rotorid.likelihood.solver import HOPELESS, Solution
from rotorid.likelihood.starts import FEW, WORTH, thinned
from rotorid.likelihood.whitening import Noise, noise_factor
from rotorid.signals.covariance import LineCovariance


@pytest.fixture(scope="module")
def record() -> rid.Record:
    return levitated(1)


def lines_of(record: rid.Record, count: int = 991) -> rid.Lines:
    lines = rid.spectra(record, (2.0, 2.0 + 0.2 * (count - 1)), references=["r_x", "r_y"])
    assert len(lines.frequency) == count
    return lines


def test_the_answer_is_that_of_all_lines(
    record: rid.Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = lines_of(record)
    by_few = rid.identify(MODEL, lines, KNOWN)
    monkeypatch.setattr(thinning, "FEW", 10**6)
    by_all = rid.identify(MODEL, lines, KNOWN)
    assert by_few.misfit == by_all.misfit or by_few.misfit.cost == pytest.approx(
        by_all.misfit.cost, rel=1e-9
    )
    for few, every in zip(by_few.parameters, by_all.parameters, strict=True):
        assert few.value == pytest.approx(every.value, abs=1e-3 * every.std)
        assert few.std == pytest.approx(every.std, rel=1e-3)


@pytest.mark.parametrize(("count", "fewer"), [(800, False), (801, True)])
def test_which_records_are_thinned(record: rid.Record, count: int, fewer: bool) -> None:
    seen = bind(MODEL, lines_of(record, count))
    found = thinned([seen])
    assert (found is not None) == fewer
    assert WORTH * FEW == 800
    if found is not None:
        assert 200 < len(found[0].lines.frequency) <= FEW == 400


def test_the_strongest_lines_lead_the_way(record: rid.Record) -> None:
    """And all that goes with a line goes with it."""
    lines = lines_of(record)
    mean = lines.mean.copy()
    strong = np.arange(3, 991, 6)
    mean[strong] *= 1e3
    loud = rid.Lines(**{**vars(lines), "mean": mean})
    found = thinned([bind(MODEL, loud)])
    assert found is not None
    few = found[0].lines
    where = np.searchsorted(lines.frequency, few.frequency)
    np.testing.assert_array_equal(lines.frequency[where], few.frequency)
    assert set(strong) <= set(where)
    assert {0, 990} <= set(where)
    np.testing.assert_array_equal(mean[where], few.mean)
    np.testing.assert_array_equal(lines.covariance.matrices[where], few.covariance.matrices)
    phi = few.clock.lines(lambda t, phi, speed: np.cos(phi)[..., None])
    whole = lines.clock.lines(lambda t, phi, speed: np.cos(phi)[..., None])
    np.testing.assert_allclose(whole[where], phi, rtol=1e-12)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("gain", "few"), [(1.3, True), (1.014, True), (1.01, False)])
def test_a_plain_mistake_is_looked_for_on_fewer_lines(
    record: rid.Record, gain: float, few: bool
) -> None:
    samples = record.samples.copy()
    samples[:, record.names.index("x")] *= gain
    lines = lines_of(replace(record, samples=samples))
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term in ("gain[x]", "gain[y]", "gain[F_x]", "gain[F_y]")
    misfit = estimate.misfit
    assert misfit is not None
    assert (misfit.cost > PLAIN * misfit.expected) == few
    told = [
        w for w in estimate.warnings if w.startswith("the data reject the model; first suspect")
    ]
    assert len(told) == 1
    assert told[0].endswith("of the 991 lines)") == few


def test_a_start_that_joins_the_first_way_is_not_gone_on_all_lines(
    record: rid.Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A misfit is believed once two starts led to it; a whole record is solved once for that."""
    samples = record.samples.copy()
    samples[:, record.names.index("x")] *= 1.01
    lines, ways = lines_of(replace(record, samples=samples)), []

    def counting(*given: object) -> Solution:
        ways.append(solver.solve(*given))
        return ways[-1]

    monkeypatch.setattr(search, "solve", counting)
    monkeypatch.setattr(result, "suspected", lambda *_: iter(()))
    assert rid.identify(MODEL, lines, KNOWN).status == "rejected"
    assert len(ways) == 1
    problem, trail = ways[0].point.problem, ways[0].trail
    start = 1.2 * problem.layout.start
    assert solver.joins(problem, start, trail)
    for share, joined in ((0.9, True), (1.1, False)):
        moved = [point * (1 + share * solver.JOINED) for point in trail]
        assert solver.joins(problem, start, moved) == joined
    assert not solver.joins(problem, start, ())


def test_the_noise_of_a_record_is_factored_once(
    record: rid.Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On all lines, few and a hundred; what is set free to see what it does changes no noise.

    The halves of the record, which are held against each other, are records of their own.
    """
    factored = []

    def counting(covariance: LineCovariance, *rest: Any) -> Noise:
        factored.append(len(covariance.matrices))
        return noise_factor(covariance, *rest)

    monkeypatch.setattr(assembly, "noise_factor", counting)
    assert rid.identify(MODEL, lines_of(record), KNOWN).status == "ok"
    *once, first, last = factored
    assert first == last == 991 // 2 + 1
    assert len(once) == 3
    assert sorted(once)[1] <= FEW < max(once) == 991


def test_a_rotor_that_floats_at_dc() -> None:
    """Lines that are singular are solved by the least motion, the others exactly."""
    rng = np.random.default_rng(0)
    stiffness = rng.standard_normal((4, 3, 3)) + 1j * rng.standard_normal((4, 3, 3))
    stiffness[0] = np.diag([1.0, 2.0, 0.0])
    stiffness[1] = np.diag([1.0, 2.0, 1e-17])
    right = rng.standard_normal((4, 3, 2)) + 0j
    for first in (0, 1):
        found = _motion(stiffness[first:], right[first:])
        for z, f, q in zip(stiffness[first:], right[first:], found, strict=True):
            np.testing.assert_allclose(q, np.linalg.lstsq(z, f, rcond=None)[0], rtol=1e-9)
    for share, asked in ((0.5, 0), (2.0, 1)):  # of SINGULAR: |Z| |q| / |f| of a line
        with patch.object(np.linalg, "lstsq", wraps=np.linalg.lstsq) as least:
            _motion(np.diag([1.0, 1e-10 / share])[None] + 0j, np.eye(2)[None] + 0j)
        assert least.call_count == asked
    wide = _motion(stiffness[2:, :2], right[2:, :2])
    np.testing.assert_allclose(
        wide[0], np.linalg.lstsq(stiffness[2, :2], right[2, :2], rcond=None)[0]
    )


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("gain", "hopeless"), [(-1.0, True), (1.01, False)])
def test_no_way_is_gone_on_all_lines_where_a_few_say_that_it_is_hopeless(
    record: rid.Record, monkeypatch: pytest.MonkeyPatch, gain: float, hopeless: bool
) -> None:
    """With a sensor upside down a dozen ways are tried, none of which all lines could mend."""
    samples = record.samples.copy()
    samples[:, record.names.index("x")] *= gain
    lines, steps = lines_of(replace(record, samples=samples)), []

    def counting(point: Point, *rest: object) -> Tangent:
        steps.append(len(point.records[0].problem.data))
        return tangent(point, *rest)

    tangent = solver.tangent
    monkeypatch.setattr(solver, "tangent", counting)
    monkeypatch.setattr(result, "suspected", lambda *_: iter(()))
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status != "ok"
    assert (estimate.misfit.cost > HOPELESS * 8 * 991) == hopeless
    assert (len(lines.frequency) not in steps) == hopeless


def test_from_near_the_minimum_few_lines_would_only_lead_away(
    record: rid.Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    solutions, steps = [], []

    def watched(*given: Any) -> Solution:
        solutions.append(solver.solve(*given))
        return solutions[-1]

    monkeypatch.setattr(search, "solve", watched)
    rid.identify(MODEL, lines_of(record), KNOWN)
    minimum = solutions[0].point

    def counting(point: Point, *rest: Any) -> Tangent:
        steps.append(len(point.records[0].problem.data))
        return tangent(point, *rest)

    tangent = solver.tangent
    monkeypatch.setattr(solver, "tangent", counting)
    found = solver.settle(minimum.problem, minimum.unknowns * (1 + 1e-4))
    assert set(steps) == {991}
    assert found.converged
    assert found.point.cost == pytest.approx(minimum.cost, rel=1e-9)
    solver.solve(minimum.problem, minimum.unknowns, solver.STAGES[-1:])
    assert set(steps) == {991, len(minimum.problem.sketch.likelihoods[0].data)}
