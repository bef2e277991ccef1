"""Who follows a search is told of every step of it, and may end it."""

import pytest
from rotor_bank import SETTINGS, rotor_case

from rotorid import MaximumLikelihood, identify
from rotorid.likelihood.watch import Interrupted, watched

CASE = rotor_case(SETTINGS["8 sensors, +-40 %"], 1)
ESTIMATOR = MaximumLikelihood(fixed=CASE.fixed, start=CASE.start, covariance="white")


def test_a_watch_is_told_of_every_step_and_changes_nothing():
    steps: list[str] = []
    with watched(lambda stage, done=0, of=None: steps.append(stage)):
        followed = identify(CASE.model, CASE.records, ESTIMATOR)
    alone = identify(CASE.model, CASE.records, ESTIMATOR)
    assert len(steps) > 5
    assert followed.to_json() == alone.to_json()


def test_no_descent_passes_over_an_interrupt():
    def stop(stage: str, done: int = 0, of: int | None = None) -> None:
        raise Interrupted

    with watched(stop), pytest.raises(Interrupted):
        identify(CASE.model, CASE.records, ESTIMATOR)
