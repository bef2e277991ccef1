"""Where maximum likelihood turns over: what it doubts, looks for again, and takes for a signal."""

from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.likelihood import doubts as verdict
from rotorid.likelihood import starts as search
from rotorid.likelihood.inference import Inference
from rotorid.likelihood.solver import bounds_held
from rotorid.likelihood.whitening import find_scales


@pytest.mark.parametrize(("periods", "told"), [(11, 1), (12, 0)])
def test_twelve_periods_for_each_sensor_tell_a_wrong_model(periods: int, told: int) -> None:
    assert len(list(verdict.few_periods(closed_loop(0.11, periods)))) == told


@pytest.mark.parametrize(("coherence", "told"), [(0.09, 0), (0.11, 1)])
def test_noise_that_forces_and_sensors_share_shows_a_loop(coherence: float, told: int) -> None:
    assert len(list(verdict.few_periods(closed_loop(coherence, 11)))) == told


def closed_loop(coherence: float, periods: int) -> SimpleNamespace:
    """Return an answer from a record of a force and a sensor with coherent noise."""
    matrix = np.array([[4.0, 2 * np.sqrt(coherence)], [2 * np.sqrt(coherence), 1.0]])
    covariance = SimpleNamespace(kind="white", matrices=np.tile(matrix, (5, 1, 1)), dof=1e9)
    lines = SimpleNamespace(periods=periods, scatter=np.zeros(1), covariance=covariance)
    sensor = SimpleNamespace(column=1)
    record = SimpleNamespace(lines=lines, sensors=[sensor], input_columns=(0,))
    return SimpleNamespace(records=[record])


@pytest.mark.parametrize(("chance", "explained"), [(0.9e-6, False), (1.1e-6, True)])
def test_a_cost_that_chance_does_not_give_is_looked_at_again(chance: float, explained: bool):
    expectation = SimpleNamespace(p_value=lambda cost: chance)
    assert Inference(np.eye(1), None, 1.0, expectation, ()).explained == explained


@pytest.mark.parametrize(("share", "gone"), [(0.9e-9, True), (1.1e-9, False)])
def test_an_unknown_that_comes_to_nothing_has_vanished(share: float, gone: bool) -> None:
    problem = SimpleNamespace(layout=SimpleNamespace(free=np.array([0, 1])))
    point = SimpleNamespace(unknowns=np.array([5.0, 2.0 * share]))
    solution = SimpleNamespace(point=point, active=())
    assert search.vanished(problem, np.array([5.0, -2.0]), solution) == gone
    held = SimpleNamespace(point=point, active=(0,))
    assert not search.vanished(problem, np.array([5.0, -2.0]), held)


def test_further_starts_lie_about_the_given_one_and_are_the_same_ones_again() -> None:
    unknowns = [SimpleNamespace(nuisance=False)] * 200 + [SimpleNamespace(nuisance=True)]
    problem = SimpleNamespace(layout=SimpleNamespace(free=range(201), unknowns=unknowns))
    starts = np.array(list(search.further_starts(problem, np.ones(201))))
    assert len(starts) == 8
    assert (starts[:, 200] == 1).all()
    assert 1.39 < starts[:, :200].max() < 1.4
    assert 1 / 1.4 < starts.min() < 1 / 1.39
    np.testing.assert_array_equal(starts, list(search.further_starts(problem, np.ones(201))))


def test_a_finer_homotopy_is_tried_where_two_further_starts_failed() -> None:
    unknowns = [SimpleNamespace(nuisance=False)]
    layout = SimpleNamespace(free=range(1), unknowns=unknowns)
    ways = list(search._ways(SimpleNamespace(layout=layout, bounds=()), np.ones(1)))
    assert [way.number for way in ways] == [0, 1, 2, 0, *range(3, 9)]
    assert [way.stages is search.FINE_STAGES for way in ways] == [k == 3 for k in range(10)]
    assert pytest.approx([*10 ** np.arange(2.0, -4.5, -0.5), 0.0]) == search.FINE_STAGES


@pytest.mark.parametrize(("distance", "held"), [(0.9e-9, (0,)), (1.1e-9, ())])
def test_a_bound_holds_where_it_is_reached_but_for_rounding(distance, held) -> None:
    bounds = SimpleNamespace(
        values=lambda x: np.array([5.0 * distance]), sizes=lambda x: np.array([5.0])
    )
    assert bounds_held(SimpleNamespace(bounds=bounds), np.ones(1)) == held


@pytest.mark.parametrize(("deviations", "seen"), [(2.9, False), (3.1, True)])
def test_what_stands_three_deviations_out_of_its_noise_is_a_signal(
    deviations: float, seen: bool
) -> None:
    found = find_scales(
        np.full((6, 1, 1), 1e6 + 0j),
        np.zeros((6, 1), dtype=complex),
        np.ones((1, 1)),
        np.full((6, 1), 7e-6 + 0j),
        np.zeros(1),
        np.array([7e-6 / deviations]),
    )
    assert (found.coordinates == pytest.approx([7e-6])) == seen


def test_scales_of_a_stiffness_beyond_squaring() -> None:
    """A spring of 1e200 N/m: its square is no number, its scale is."""
    stiffness = np.array([[[1e200 + 0j]], [[2e200]]])
    tiny = np.full((2, 1), 1e-200 + 0j)
    found = find_scales(stiffness, np.ones((2, 1)), np.ones((1, 1)), tiny, np.zeros(1), np.zeros(1))
    assert found.rows[0] / found.coordinates[0] == pytest.approx(np.sqrt(2.5) * 1e200, rel=0.01)
