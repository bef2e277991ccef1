"""A search tells its first minimum at once, and whoever follows it may end it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rotor_bank import SETTINGS, rotor_case

import rotorid as rid
from rotorid import InputError
from rotorid.core.watch import watched

CASE = rotor_case(SETTINGS["8 sensors, +-40 %"], 0)
ESTIMATOR = rid.MaximumLikelihood(fixed=CASE.fixed, start=CASE.start, covariance="white")
QUICK = replace(ESTIMATOR, effort="quick")
WRONG = replace(ESTIMATOR, fixed={**CASE.fixed, "L1": 1.2 * CASE.truth["L1"]})


def about(estimate: rid.Estimate, what: str) -> list[tuple[str, str]]:
    return [(note.severity, note.cure) for note in estimate.notes if note.about == what]


def test_the_first_step_has_an_answer_and_says_that_it_is_not_the_last() -> None:
    search = ESTIMATOR.search(CASE.model, CASE.records)
    assert search.best is None
    step = next(search)
    assert step.best is search.best
    assert step.best.status == "not_converged"
    assert about(step.best, "interrupted") == [("unfinished", "let the search run to its end")]
    for name, true in CASE.truth.items():
        assert abs(step.best.value(name) - true) < 6 * step.best.std(name) + 1e-12


def test_the_last_step_is_the_estimate() -> None:
    steps = list(ESTIMATOR.search(CASE.model, CASE.records))
    assert [step.say for step in steps][-2:] == ["asking what may be wrong", "done"]
    estimate = ESTIMATOR.estimate(CASE.model, CASE.records)
    assert estimate.status == "ok"
    assert steps[-1].best.to_json() == estimate.to_json()
    search = ESTIMATOR.search(CASE.model, CASE.records)
    next(search)
    assert search.finish().to_json() == estimate.to_json()


def test_little_effort_ends_at_the_first_minimum_and_says_so() -> None:
    first = next(ESTIMATOR.search(CASE.model, CASE.records)).best
    quick = QUICK.estimate(CASE.model, CASE.records)
    assert quick.parameters == first.parameters
    assert quick.misfit == first.misfit
    assert quick.status == "ok"
    assert about(quick, "effort") == [("doubts", "identify with full effort")]
    assert str(quick).startswith("three-mass, ml: ok, but doubtful (little effort)\n")
    assert len(list(QUICK.search(CASE.model, CASE.records))) == 1


def test_a_first_minimum_that_noise_does_not_explain_is_no_answer() -> None:
    quick = replace(WRONG, effort="quick").estimate(CASE.model, CASE.records)
    assert quick.misfit.p_value < 1e-6
    assert quick.status == "not_converged"
    assert not quick.suspects
    assert [severity for severity, _ in about(quick, "effort")] == ["unfinished"]


def test_further_starts_are_steps_with_how_far_they_are() -> None:
    steps = list(WRONG.search(CASE.model, CASE.records))
    ways = [step for step in steps if step.say == "trying further starts"]
    assert len(ways) > 1
    assert [step.done for step in ways] == list(range(1, len(ways) + 1))
    assert ways[0].left is None
    assert all(step.of == 12 and step.left > 0 for step in ways[1:])
    costs = [step.best.misfit.cost for step in ways]
    assert costs == sorted(costs, reverse=True)
    assert steps[-1].best.status == "rejected"
    assert steps[-1].best.suspects


def test_a_watch_changes_nothing_and_is_told_of_mistakes_that_are_tried() -> None:
    told: list[tuple[str, int, int | None]] = []
    with watched(lambda say, done=0, of=None: told.append((say, done, of))):
        followed = rid.identify(CASE.model, CASE.records, WRONG)
    alone = rid.identify(CASE.model, CASE.records, WRONG)
    assert followed.to_json() == alone.to_json()
    assert told[0] == ("looking for the first minimum", 0, None)
    assert told[-1][0] == "trying possible mistakes"
    tried = [(done, of) for say, done, of in told if say == "trying possible mistakes"]
    assert len(tried) > 5
    assert all(of is not None and 0 < done <= of for done, of in tried[:-1])


def test_what_is_suspected_so_far_is_in_the_best_so_far() -> None:
    steps = list(WRONG.search(CASE.model, CASE.records))
    tried = [step.best for step in steps if step.say == "trying possible mistakes"]
    drops = [max((s.drop for s in best.suspects), default=0.0) for best in tried]
    assert 0 < drops[len(drops) // 2] <= drops[-1]
    assert {best.status for best in tried} == {"not_converged"}
    assert tried[-1].suspects == steps[-1].best.suspects


def test_no_step_changes_how_numpy_treats_errors() -> None:
    with np.errstate(all="raise"):
        for _ in QUICK.search(CASE.model, CASE.records):
            assert set(np.geterr().values()) == {"raise"}


@pytest.mark.parametrize("when", ["trying further starts", "trying possible mistakes"])
def test_an_interrupt_passes_through_and_leaves_the_best_so_far(when: str) -> None:
    search = WRONG.search(CASE.model, CASE.records)
    with watched(interrupting(when)), pytest.raises(KeyboardInterrupt):
        search.finish()
    assert about(search.best, "interrupted")
    assert search.best.status == "not_converged"


def interrupting(when: str) -> Callable[..., None]:
    """Return a watch that interrupts the second time when something is said."""
    seen: list[str] = []

    def stop(say: str, done: int = 0, of: int | None = None) -> None:
        seen.append(say)
        if say == when and (seen.count(when) > 1 or of is None):
            raise KeyboardInterrupt

    return stop


def test_any_other_effort_is_refused() -> None:
    with pytest.raises(InputError, match="effort 'some'; expected one of full, quick"):
        rid.MaximumLikelihood(effort="some")
