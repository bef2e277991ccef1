"""The search: its steps and who watches them, few lines before many, plain mistakes first."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from levitated import KNOWN, MODEL, levitated
from levitated import QUICK as BRIEF
from rotor_bank import SETTINGS, rotor_case
from threadpoolctl import threadpool_info, threadpool_limits

import rotorid as rid
from rotorid import InputError
from rotorid.core.watch import watched
from rotorid.likelihood import rivals as plain
from rotorid.likelihood import solver
from rotorid.likelihood import starts as search
from rotorid.likelihood import summary as result
from rotorid.likelihood.estimator import Search
from rotorid.likelihood.problem import Point, Problem, Tangent
from rotorid.likelihood.response import _motion
from rotorid.likelihood.rivals import PLAIN
from rotorid.likelihood.solver import HOPELESS, Solution
from rotorid.likelihood.starts import FEW, PLAIN_LINES, WORTH, thinned
from rotorid.testing import bind

# A search tells its first minimum at once, and whoever follows it may end it.


CASE = rotor_case(SETTINGS["8 sensors, +-40 %"], 0)
ESTIMATOR = rid.MaximumLikelihood(fixed=CASE.fixed, start=CASE.start, covariance="white")
QUICK = replace(ESTIMATOR, effort="quick")
WRONG = replace(ESTIMATOR, fixed={**CASE.fixed, "L1": 1.2 * CASE.truth["L1"]})


def about(estimate: rid.Estimate, what: str) -> list[tuple[str, str]]:
    return [(note.severity, note.cure) for note in estimate.notes if note.about == what]


@pytest.fixture(scope="module")
def right():
    return list(ESTIMATOR.search(CASE.model, CASE.records))


@pytest.fixture(scope="module")
def wrong():
    return list(WRONG.search(CASE.model, CASE.records))


def test_the_first_step_has_an_answer_and_says_that_it_is_not_the_last():
    search = ESTIMATOR.search(CASE.model, CASE.records)
    assert search.best is None
    step = next(search)
    assert step.best is search.best
    assert step.best.status == "not_converged"
    assert about(step.best, "interrupted") == [("unfinished", "let the search run to its end")]
    for name, true in CASE.truth.items():
        assert abs(step.best.value(name) - true) < 6 * step.best.std(name) + 1e-12


def test_steps_are_taken_on_one_thread_of_the_linear_algebra():
    def threads() -> int:
        return max(each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas")

    def steps():
        seen.append(threads())
        yield rid.Progress("halfway", answer=lambda: seen.append(threads()))

    seen: list[int] = []
    with threadpool_limits(2, "blas"):
        search = Search(steps())
        assert next(search).say == "halfway"
        assert search.best is None
        assert threads() == 2
    assert seen == [1, 1]


def test_the_last_step_is_the_estimate(right):
    assert [step.say for step in right][-2:] == ["asking what may be wrong", "done"]
    assert right[-1].best.status == "ok"
    search = ESTIMATOR.search(CASE.model, CASE.records)
    next(search)
    for estimate in (search.finish(), ESTIMATOR.estimate(CASE.model, CASE.records)):
        assert estimate.to_json() == right[-1].best.to_json()


def test_little_effort_ends_at_the_first_minimum_and_says_so(right):
    first = right[0].best
    quick = QUICK.estimate(CASE.model, CASE.records)
    assert quick.parameters == first.parameters
    assert quick.misfit == first.misfit
    assert quick.status == "ok"
    assert about(quick, "effort") == [("doubts", 'identify with effort = "normal"')]
    assert str(quick).startswith("three-mass, ml: ok, but doubtful (little effort)\n")
    assert len(list(QUICK.search(CASE.model, CASE.records))) == 1


def test_a_first_minimum_that_noise_does_not_explain_is_no_answer():
    quick = replace(WRONG, effort="quick").estimate(CASE.model, CASE.records)
    assert quick.misfit.p_value < 1e-6
    assert quick.status == "not_converged"
    assert not quick.suspects
    assert [severity for severity, _ in about(quick, "effort")] == ["unfinished"]


def test_thorough_takes_three_times_as_many_starts(right, wrong):
    thorough, asked = replace(ESTIMATOR, effort="thorough"), list[int | None]()

    def note(say: str, done: int = 0, of: int | None = None, best: str = "") -> None:
        if say.startswith("asking whether other"):
            asked.append(of)

    with watched(note):
        last = thorough.estimate(CASE.model, CASE.records)
    assert asked[-1] == 9
    assert last.parameters == right[-1].best.parameters
    first = next(replace(WRONG, effort="thorough").search(CASE.model, CASE.records))
    assert (first.of, wrong[0].of) == (28, 12)


def test_further_starts_are_steps_with_how_far_they_are(wrong):
    ways = [step for step in wrong if step.say == "trying further starts"]
    assert len(ways) > 1
    assert [step.done for step in ways] == list(range(1, len(ways) + 1))
    assert ways[0].left is None
    assert all(step.of == 12 and step.left > 0 for step in ways[1:])
    costs = [step.best.misfit.cost for step in ways]
    assert costs == sorted(costs, reverse=True)
    assert wrong[-1].best.status == "rejected"
    assert wrong[-1].best.suspects


def test_a_watch_changes_nothing_and_is_told_of_mistakes_that_are_tried(wrong):
    told: list[tuple[str, int, int | None]] = []
    with watched(lambda say, done=0, of=None, best="": told.append((say, done, of))):
        followed = WRONG.estimate(CASE.model, CASE.records)
    assert followed.to_json() == wrong[-1].best.to_json()
    assert told[0] == ("looking for the first minimum", 0, None)
    assert told[-1][0] == "trying possible mistakes"
    tried = [(done, of) for say, done, of in told if say == "trying possible mistakes"]
    assert len(tried) > 5
    assert all(of is not None and 0 < done <= of for done, of in tried[:-1])


def test_what_is_suspected_so_far_is_in_the_best_so_far(wrong):
    tried = [step.best for step in wrong if step.say == "trying possible mistakes"]
    drops = [max((s.drop for s in best.suspects), default=0.0) for best in tried]
    assert 0 < drops[len(drops) // 2] <= drops[-1]
    assert {best.status for best in tried} == {"not_converged"}
    assert tried[-1].suspects == wrong[-1].best.suspects


def test_no_step_changes_how_numpy_treats_errors():
    with np.errstate(all="raise"):
        for _ in QUICK.search(CASE.model, CASE.records):
            assert set(np.geterr().values()) == {"raise"}


@pytest.mark.parametrize("when", ["trying further starts", "trying possible mistakes"])
def test_an_interrupt_passes_through_and_leaves_the_best_so_far(when):
    search = WRONG.search(CASE.model, CASE.records)
    with watched(interrupting(when)), pytest.raises(KeyboardInterrupt):
        search.finish()
    assert about(search.best, "interrupted")
    assert search.best.status == "not_converged"


def interrupting(when: str) -> Callable[..., None]:
    """Return a watch that interrupts the second time when something is said."""
    seen: list[str] = []

    def stop(say: str, done: int = 0, of: int | None = None, best: str = "") -> None:
        seen.append(say)
        if say == when and (seen.count(when) > 1 or of is None):
            raise KeyboardInterrupt

    return stop


def test_any_other_effort_is_refused():
    with pytest.raises(InputError, match="effort 'some'; expected one of quick, normal, thorough"):
        rid.MaximumLikelihood(effort="some")


# Few lines lead to the minimum of many.


@pytest.fixture(scope="module")
def record():
    return levitated(1)


def lines_of(record: rid.Record, count: int = 991) -> rid.Lines:
    lines = rid.spectra(record, (2.0, 2.0 + 0.2 * (count - 1)), references=["r_x", "r_y"])
    assert len(lines.frequency) == count
    return lines


@pytest.fixture(scope="module")
def lines(record):
    return lines_of(record)


def test_the_answer_is_that_of_all_lines(lines, monkeypatch):
    by_few = rid.identify(MODEL, lines, BRIEF)
    monkeypatch.setattr(search, "FEW", 10**6)
    by_all = rid.identify(MODEL, lines, BRIEF)
    assert by_few.misfit.cost == pytest.approx(by_all.misfit.cost, rel=1e-9)
    for few, every in zip(by_few.parameters, by_all.parameters, strict=True):
        assert few.value == pytest.approx(every.value, abs=1e-3 * every.std)
        assert few.std == pytest.approx(every.std, rel=1e-3)


def louder(record: rid.Record, gain: float, *, exchanged: bool = False) -> rid.Lines:
    """Return the lines where x has another gain; before that, the sensors may be exchanged."""
    samples, (x, y) = record.samples.copy(), map(record.names.index, "xy")
    if exchanged:
        samples[:, [x, y]] = samples[:, [y, x]]
    samples[:, x] *= gain
    return lines_of(replace(record, samples=samples))


@pytest.fixture
def steps(monkeypatch):
    """Return on how many lines each step is taken, from then on."""
    seen, tangent = [], solver.tangent

    def counting(point: Point, *rest: Any) -> Tangent:
        seen.append(len(point.records[0].problem.data))
        return tangent(point, *rest)

    monkeypatch.setattr(solver, "tangent", counting)
    return seen


@pytest.fixture
def ways(monkeypatch):
    """Return where each way from a start ends, from then on."""
    seen: list[Solution] = []

    def counting(*given: Any, **how: Any) -> Solution:
        seen.append(solver.solve(*given, **how))
        return seen[-1]

    monkeypatch.setattr(search, "solve", counting)
    return seen


@pytest.mark.parametrize(("count", "fewer"), [(800, False), (801, True)])
def test_which_records_are_thinned(record, count, fewer):
    found = thinned([bind(MODEL, lines_of(record, count))])
    assert (found is not None) == fewer
    assert WORTH * FEW == 800
    if found is not None:
        assert 200 < len(found[0].lines.frequency) <= FEW == 400


def test_the_strongest_lines_lead_the_way(lines):
    """And all that goes with a line goes with it."""
    mean = lines.mean.copy()
    strong = np.arange(3, 991, 6)
    mean[strong] *= 1e3
    few = thinned([bind(MODEL, replace(lines, mean=mean))])[0].lines
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
@pytest.mark.parametrize(("gain", "few"), [(1.014, True), (1.01, False)])
def test_a_plain_mistake_is_looked_for_on_fewer_lines(record, gain, few):
    estimate = rid.identify(MODEL, louder(record, gain), KNOWN)
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term in ("gain[x]", "gain[y]", "gain[F_x]", "gain[F_y]")
    assert (estimate.misfit.cost > PLAIN * estimate.misfit.expected) == few
    rejected = "the data reject the model; first suspect"
    (told,) = [w for w in estimate.warnings if w.startswith(rejected)]
    assert told.endswith("of the 991 lines)") == few


def test_a_start_that_joins_the_first_way_is_not_gone_on_all_lines(record, monkeypatch, ways):
    """A misfit is believed once two starts led to it; a whole record is solved once for that."""
    monkeypatch.setattr(result, "suspected", lambda *_: iter(()))
    assert rid.identify(MODEL, louder(record, 1.01), KNOWN).status == "rejected"
    assert len(ways) == 1
    problem, trail = ways[0].point.problem, ways[0].trail
    start = 1.2 * problem.layout.start
    assert solver.joins(problem, start, trail)
    for share, joined in ((0.9, True), (1.1, False)):
        moved = [point * (1 + share * solver.JOINED) for point in trail]
        assert solver.joins(problem, start, moved) == joined
    assert not solver.joins(problem, start, ())


def test_a_rotor_that_floats_at_dc():
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
    least = np.linalg.lstsq(stiffness[2, :2], right[2, :2], rcond=None)[0]
    np.testing.assert_allclose(wide[0], least)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("gain", "hopeless"), [(-1.0, True), (1.01, False)])
def test_no_way_is_gone_on_all_lines_where_a_few_say_that_it_is_hopeless(
    record, monkeypatch, steps, gain, hopeless
):
    """With a sensor upside down a dozen ways are tried, none of which all lines could mend."""
    lines = louder(record, gain)
    monkeypatch.setattr(result, "suspected", lambda *_: iter(()))
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status != "ok"
    assert (estimate.misfit.cost > HOPELESS * 8 * 991) == hopeless
    assert (len(lines.frequency) not in steps) == hopeless


def test_from_near_the_minimum_few_lines_would_only_lead_away(lines, steps, ways):
    rid.identify(MODEL, lines, BRIEF)
    minimum = ways[0].point
    steps.clear()
    found = solver.settle(minimum.problem, minimum.unknowns * (1 + 1e-4))
    assert set(steps) == {991}
    assert found.converged
    assert found.point.cost == pytest.approx(minimum.cost, rel=1e-9)
    solver.solve(minimum.problem, minimum.unknowns, solver.STAGES[-1:])
    assert set(steps) == {991, len(minimum.problem.sketch.likelihoods[0].data)}


# Mistakes that are plain are told on a hundred lines, before thousands are searched.


@pytest.mark.slow
@pytest.mark.parametrize("term", ["swap[x, y]", "sign[x]"])
def test_what_is_plain_is_told_before_anything_is_searched(record, term, monkeypatch, steps):
    swapped = term == "swap[x, y]"
    lines = louder(record, 1.0 if swapped else -1.0, exchanged=swapped)
    monkeypatch.setattr(plain.RivalSearch, "trials", None)
    monkeypatch.setattr(plain, "searched", None)
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status == "rejected"
    assert term in [suspect.term for suspect in estimate.suspects]
    assert all(suspect.share == pytest.approx(1.0, abs=0.01) for suspect in estimate.suspects)
    assert "first suspect" in estimate.warnings[0]
    assert "of the 991 lines" in estimate.warnings[0]
    assert 991 not in steps
    for name, true in (("m", 5.0), ("k", 4e5)):  # those of the machine, not of the mistake
        assert estimate.value(name) == pytest.approx(true, rel=0.02)


@pytest.mark.slow
def test_what_no_single_mistake_explains_is_searched_on_a_hundred_lines(record, monkeypatch):
    """Here two: sensors exchanged, one of them a quarter short."""
    lines, asked = louder(record, 0.25, exchanged=True), []

    def counting(problem: Problem, *rest: object) -> object:
        asked.append(len(problem.likelihoods[0].data))
        return searched(problem, *rest)

    searched = plain.searched
    monkeypatch.setattr(plain, "searched", counting)
    monkeypatch.setattr(plain.RivalSearch, "trials", lambda _: iter([plain.Tried()]))
    assert rid.identify(MODEL, lines, KNOWN).status in ("rejected", "not_converged")
    assert len(asked) == 1
    assert asked[0] <= PLAIN_LINES == 100


@pytest.mark.parametrize(
    ("costs", "followed"),
    [((10.0, 19.9, 20.1), 2), ((10.0,) * 6, 4), ((10.0, 14.0, 16.0, 12.0, 11.0), 4)],
)
def test_which_mistakes_are_followed(costs, followed):
    """Four at the most, screened within twice the lowest cost; those that explain are kept."""

    def changed(cost: float) -> SimpleNamespace:
        there = SimpleNamespace(point=SimpleNamespace(cost=cost), gross=False)
        return SimpleNamespace(screened=lambda: cost, settled=lambda way: there)

    mistakes = [SimpleNamespace(change=lambda _, cost=cost: changed(cost)) for cost in costs]
    found = plain._without_a_mistake(None, mistakes)
    assert [there.point.cost for _, there in found] == sorted(costs)[:followed]
