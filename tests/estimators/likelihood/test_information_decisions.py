"""Where an answer is doubted: noise that was taken for information, and other answers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.likelihood import other_answers as information
from rotorid.likelihood.other_answers import Valley


def problem_of(*names: str) -> SimpleNamespace:
    """Return a problem of some unknowns, all free and none of them a load."""
    unknowns = [SimpleNamespace(name=name, nuisance=False) for name in names]
    layout = SimpleNamespace(free=np.arange(len(names)), unknowns=unknowns)
    return SimpleNamespace(layout=layout, affine=np.zeros(0, dtype=int), exact=())


def solution_at(unknowns, cost: float = 100.0, problem=None) -> SimpleNamespace:
    """Return a minimum."""
    point = SimpleNamespace(unknowns=np.array(unknowns), cost=cost, problem=problem)
    return SimpleNamespace(point=point, converged=True)


def minimum_of(
    stated: float, start: float = 1.0, at: float = 1.0, chance: float = 0.5
) -> information._Minimum:
    """Return the minimum of a problem of one unknown, with its deviation."""
    inference = SimpleNamespace(
        covariance=np.array([[stated**2]]),
        std=np.array([stated]),
        linear=SimpleNamespace(undetermined=np.zeros(1, bool)),
        expectation=SimpleNamespace(p_value=lambda cost: chance),
    )
    problem, begin = problem_of("m"), np.array([start])
    return information._Minimum(problem, begin, solution_at([at], problem=problem), inference)


def expecting(monkeypatch, *deviations: float) -> None:
    """Have the noise-free response give such a deviation, the last one again and again."""
    told = list(deviations)

    def next_of(*at):
        return np.array([told.pop(0) if len(told) > 1 else told[0]])

    monkeypatch.setattr(information, "predicted_deviations", next_of)


def doubted(monkeypatch, stated: float, predicted: float, *, loose: bool, about: bool) -> bool:
    """Tell whether a mass of 1 kg is called noise; `about`: a machine near would not tell it."""
    monkeypatch.setattr(
        information, "informed_by_noise", lambda at: (np.array([predicted]), np.zeros(1, bool))
    )
    monkeypatch.setattr(information._Minimum, "taken_about", lambda at: np.array([about]))
    monkeypatch.setattr(information, "explore", lambda *at: Valley(np.ones(1), None))
    expecting(monkeypatch, 1.0 if loose else 0.0)
    return bool(minimum_of(stated).doubt(information.Doubt()).noise)


@pytest.mark.parametrize(
    ("stated", "predicted", "doubt"),
    [
        (0.05, 0.149, False),  # three times as much is noise
        (0.05, 0.151, True),
        (0.0099 / 9.9, 0.0099, False),  # ten times, of what is predicted to a hundredth
        (0.0099 / 10.1, 0.0099, True),
        (0.0101 / 9.9, 0.0101, True),
    ],
)
@pytest.mark.parametrize("loose", [False, True])
def test_deviations_much_smaller_than_predicted_are_noise(
    monkeypatch, stated, predicted, doubt, loose
) -> None:
    assert doubted(monkeypatch, stated, predicted, loose=loose, about=False) == doubt


@pytest.mark.parametrize("loose", [False, True])
def test_what_is_told_loosely_is_asked_about_the_start_too(monkeypatch, loose) -> None:
    assert doubted(monkeypatch, 0.05, 0.05, loose=loose, about=True) == loose


@pytest.mark.parametrize(
    ("power", "share", "told"),
    [
        (0.29, 1.0, [False, False]),
        (0.31, 1.0, [True, False]),
        (0.9, 0.91, [True, False]),  # the other has .09 of its variance along that direction
        (0.9, 0.89, [True, True]),
    ],
)
def test_of_whom_the_noise_of_forces_makes_the_information(power, share, told) -> None:
    """Of .3 of the information along a direction, and of a tenth of an unknown's variance."""
    c, s = np.sqrt(share), np.sqrt(1 - share)
    root = np.array([[c, -s], [s, c]])
    noise = np.sqrt(power) * root[:, [0]].T[None]  # (input, row, free): along the first direction
    found = information._owed([noise], root)
    assert found.tolist() == told


@pytest.mark.parametrize(
    ("expected", "stated", "loose"),
    [(0.099, 0.0, False), (0.101, 0.0, True), (0.0, 0.099, False), (0.0, 0.101, True)],
)
def test_a_deviation_of_a_tenth_is_loose(monkeypatch, expected, stated, loose) -> None:
    """The one expected of the start, or the one stated."""
    expecting(monkeypatch, 2 * expected)
    asked = minimum_of(max(2 * stated, 1e-6), start=2.0, at=2.0)
    assert asked.loose.tolist() == [loose]
    assert asked.rigid.tolist() == [True]


@pytest.mark.parametrize(("factor", "kept"), [(2.9, True), (3.1, False), (1 / 2.9, True)])
def test_a_start_that_is_off_by_three_is_no_machine(factor, kept) -> None:
    (start,) = minimum_of(1.0, start=factor).about(0)
    assert start[0] == (factor if kept else 1.0)


@pytest.mark.parametrize(
    ("stated", "predicted", "taken"),
    [(0.0, 0.099, False), (0.0, 0.101, True), (0.02, 0.199, False), (0.02, 0.201, True)],
)
def test_what_no_machine_about_the_start_tells(monkeypatch, stated, predicted, taken) -> None:
    """Neither to a tenth of the value nor to ten stated deviations."""
    monkeypatch.setattr(information, "further_starts", lambda *at: [np.ones(1)])
    expecting(monkeypatch, predicted)
    assert minimum_of(stated).taken_about().tolist() == [taken]


@pytest.mark.parametrize(("informed", "taken"), [(9, False), (10, True)])
def test_eight_machines_about_the_start_are_asked(monkeypatch, informed, taken) -> None:
    """Beside the start itself; here it is the one of this number that the forces inform."""
    deviations = [np.inf] * 20
    deviations[informed - 1] = 0.0
    expecting(monkeypatch, *deviations)
    assert minimum_of(1.0).taken_about().tolist() == [taken]


@pytest.mark.parametrize(
    ("above", "distance", "answers"), [(14.9, 5.1, 1), (15.1, 5.1, 0), (14.9, 4.9, 0)]
)
def test_an_end_that_fits_as_well_and_lies_apart_is_another_answer(above, distance, answers):
    problem = problem_of("m", "k")
    solution = solution_at([1.0, 1.0], 100.0, problem)
    other = solution_at([1.0, 1.0 + 0.1 * distance], 100.0 + above, problem)
    inference = SimpleNamespace(
        std=np.array([1.0, 0.1]), linear=SimpleNamespace(undetermined=np.zeros(2, bool))
    )
    mirrors = SimpleNamespace(images=lambda solution: [], layout=problem.layout)
    found = information.other_answers(mirrors, solution, inference, [other])
    assert len(found.alternatives) == answers


def ways(
    monkeypatch, above: float | None = None, chance: float = 0.5, *, loose: bool = False
) -> list[tuple[float, ...]]:
    """Return the stages of each further way that is gone; `above`: where the second one ends."""
    gone: list[tuple[float, ...]] = []

    def elsewhere(problem, start, solution, stages):
        gone.append(stages)
        ends = above is not None and len(gone) == 2
        return solution_at([9.0], 100.0 + above) if ends else None

    monkeypatch.setattr(information, "elsewhere", elsewhere)
    expecting(monkeypatch, 1.0 if loose else 0.0)
    minimum_of(1e-3, chance=chance).minima()
    return gone


def test_how_many_further_starts_are_tried(monkeypatch) -> None:
    """Three; eight on demand, or where one ended elsewhere at a cost that is not far above."""
    assert len(ways(monkeypatch)) == 3
    tried = ways(monkeypatch, loose=True)
    assert len(tried) == 8
    assert [len(stages) for stages in tried] == [5] * 3 + [3] * 5
    assert tried[-1] == (0.1, 0.01, 0.0)
    assert [len(ways(monkeypatch, above)) for above in (149.0, 151.0)] == [8, 3]


@pytest.mark.parametrize(("chance", "count"), [(0.0099, 8), (0.0101, 3)])
def test_a_cost_that_chance_seldom_leaves_has_all_starts_tried(monkeypatch, chance, count):
    assert len(ways(monkeypatch, chance=chance)) == count


@pytest.mark.parametrize(("wider", "loose", "bent"), [(7.9, 1, 0), (8.1, 1, 1), (8.1, 0, 0)])
def test_a_deviation_that_is_wider_by_eight_has_no_end(monkeypatch, wider, loose, bent) -> None:
    yes, one = np.ones(1, bool), np.ones(1)
    monkeypatch.setattr(information, "informed_by_noise", lambda at: (one, ~yes))
    monkeypatch.setattr(information._Minimum, "taken_about", lambda at: ~yes)
    monkeypatch.setattr(information, "explore", lambda *at: Valley(np.array([wider]), None))
    expecting(monkeypatch, float(loose))
    assert minimum_of(0.09).doubt(information.Doubt()).bent == ("m",) * bent


@pytest.mark.parametrize(("below", "lower"), [(0.9, False), (1.1, True)])
def test_a_minimum_is_lower_by_more_than_a_millionth(below, lower) -> None:
    found = information._lower([solution_at([1.0], 1e6 - below)], solution_at([1.0], 1e6))
    assert (found is not None) == lower


@pytest.mark.parametrize(("after", "cure"), [(0.32, "drive F against"), (0.34, "excite what")])
def test_an_excitation_that_tells_three_times_as_much_is_a_cure(monkeypatch, after, cure) -> None:
    problem = problem_of("m")
    problem.likelihoods, problem.layout.model = ("record",), SimpleNamespace(inputs=("F",))
    told = iter([np.ones(1), np.array([after])])
    monkeypatch.setattr(information, "predicted_deviations", lambda *at: next(told))
    monkeypatch.setattr(information, "_turned", lambda problem, column: problem)
    doubt = information.Doubt(noise=("m",))
    assert information._cure(problem, np.ones(1), doubt).startswith(cure)
