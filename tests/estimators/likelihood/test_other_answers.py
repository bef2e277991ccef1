"""More than one answer, valleys, and what the noise of forces informs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bank import steady, times
from result_cases import fit, problem_of
from rotor_bank import (
    ADVERSE,
    BEARINGS,
    COORDINATES,
    SETTINGS,
    UNBALANCE,
    Setting,
    modal_case,
    noisy_record,
    rotor_case,
    rotor_lines,
    structure_case,
)
from rotor_bank import Structure as Tower

from rotorid import InputError, MaximumLikelihood, identify, load_model, predict_accuracy
from rotorid.likelihood import other_answers as information
from rotorid.likelihood import solver
from rotorid.likelihood.inference import infer
from rotorid.likelihood.solver import Solution
from rotorid.likelihood.starts import searched
from rotorid.likelihood.symmetric_answers import Mirrors
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge
from rotorid.testing import bind_all

# Where an answer is doubted: noise that was taken for information, and other answers.


def unknowns_of(*names: str, additive: bool = False) -> SimpleNamespace:
    """Return a problem of some unknowns, all free and none of them a load: shifts, or sizes."""
    unknowns = [SimpleNamespace(name=n, nuisance=False) for n in names]
    free = np.arange(len(names))
    layout = SimpleNamespace(free=free, unknowns=unknowns, start=np.ones(len(names)))
    layout.additive = np.full(len(names), additive)
    layout.names = lambda which=slice(None): tuple(names[i] for i in free[which])
    return SimpleNamespace(layout=layout, affine=free[:0], rigid=free, exact=(), effort=1)


def point_at(unknowns, cost: float = 100.0, problem=None) -> SimpleNamespace:
    return SimpleNamespace(unknowns=np.array(unknowns), cost=cost, problem=problem)


def solution_at(*point) -> SimpleNamespace:
    return SimpleNamespace(point=point_at(*point), converged=True)


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
    problem = unknowns_of("m")
    problem.layout.start = np.array([start])
    solution = solution_at([at], 100.0, problem)
    solution.inference = inference
    return information._Minimum(solution)


def expecting(monkeypatch, *deviations: float) -> None:
    """Have the noise-free response give such a deviation, the last one again and again."""
    told = list(deviations)

    def next_of(*at):
        return np.array([told.pop(0) if len(told) > 1 else told[0]])

    monkeypatch.setattr(information, "predicted_deviations", next_of)


def doubts(
    monkeypatch, stated: float, predicted: float, *, loose: bool, about: bool, wider: float = 1.0
) -> tuple[bool, tuple[str, ...]]:
    """Tell whether a mass of 1 kg is called noise, and what has no end.

    `about`: a machine near would not tell it; `wider`: of its interval, over its deviation.
    """
    told = np.array([predicted]), np.zeros(1, bool)
    monkeypatch.setattr(information, "informed_by_noise", lambda at: told)
    monkeypatch.setattr(information._Minimum, "taken_about", lambda at: np.array([about]))
    monkeypatch.setattr(information, "explore", lambda *at: (np.array([wider]), None))
    expecting(monkeypatch, float(loose))
    noise, endless = minimum_of(stated).doubts()
    return bool(noise), endless


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
):
    assert doubts(monkeypatch, stated, predicted, loose=loose, about=False)[0] == doubt


@pytest.mark.parametrize("loose", [False, True])
def test_what_is_told_loosely_is_asked_about_the_start_too(monkeypatch, loose):
    assert doubts(monkeypatch, 0.05, 0.05, loose=loose, about=True)[0] == loose


@pytest.mark.parametrize(
    ("power", "share", "told"),
    [
        (0.29, 1.0, [False, False]),
        (0.31, 1.0, [True, False]),
        (0.9, 0.91, [True, False]),  # the other has .09 of its variance along that direction
        (0.9, 0.89, [True, True]),
    ],
)
def test_of_whom_the_noise_of_forces_makes_the_information(power, share, told):
    """Of .3 of the information along a direction, and of a tenth of an unknown's variance."""
    c, s = np.sqrt(share), np.sqrt(1 - share)
    root = np.array([[c, -s], [s, c]])
    noise = np.sqrt(power) * root[:, [0]].T[None]  # (input, row, free): along the first direction
    assert information._owed([noise], root).tolist() == told


@pytest.mark.parametrize(
    ("expected", "stated", "loose"),
    [(0.099, 0.0, False), (0.101, 0.0, True), (0.0, 0.099, False), (0.0, 0.101, True)],
)
def test_a_deviation_of_a_tenth_is_loose(monkeypatch, expected, stated, loose):
    """The one expected of the start, or the one stated."""
    expecting(monkeypatch, 2 * expected)
    asked = minimum_of(max(2 * stated, 1e-6), start=2.0, at=2.0)
    assert asked.loose.tolist() == [loose]
    assert asked.rigid.tolist() == [True]


@pytest.mark.parametrize(("factor", "kept"), [(2.9, True), (3.1, False), (1 / 2.9, True)])
def test_a_start_that_is_off_by_three_is_no_machine(factor, kept):
    (start,) = minimum_of(1.0, start=factor).about(0)
    assert start[0] == (factor if kept else 1.0)


@pytest.mark.parametrize(
    ("stated", "predicted", "taken"),
    [(0.0, 0.099, False), (0.0, 0.101, True), (0.02, 0.199, False), (0.02, 0.201, True)],
)
def test_what_no_machine_about_the_start_tells(monkeypatch, stated, predicted, taken):
    """Neither to a tenth of the value nor to ten stated deviations."""
    monkeypatch.setattr(information, "further_starts", lambda *at: [np.ones(1)])
    expecting(monkeypatch, predicted)
    assert minimum_of(stated).taken_about().tolist() == [taken]


@pytest.mark.parametrize(("informed", "taken"), [(9, False), (10, True)])
def test_eight_machines_about_the_start_are_asked(monkeypatch, informed, taken):
    """Beside the start itself; here it is the one of this number that the forces inform."""
    deviations = [np.inf] * 20
    deviations[informed - 1] = 0.0
    expecting(monkeypatch, *deviations)
    assert minimum_of(1.0).taken_about().tolist() == [taken]


@pytest.mark.parametrize(
    ("above", "distance", "answers"), [(14.9, 5.1, 1), (15.1, 5.1, 0), (14.9, 4.9, 0)]
)
def test_an_end_that_fits_as_well_and_lies_apart_is_another_answer(above, distance, answers):
    problem = unknowns_of("m", "k")
    solution = solution_at([1.0, 1.0], 100.0, problem)
    other = solution_at([1.0, 1.0 + 0.1 * distance], 100.0 + above, problem)
    linear = SimpleNamespace(undetermined=np.zeros(2, bool))
    solution.inference = SimpleNamespace(std=np.array([1.0, 0.1]), linear=linear)
    mirrors = SimpleNamespace(images=lambda solution: [], layout=problem.layout)
    found, _ = information.other_answers(mirrors, solution, [other])
    assert len(found) == answers


def ways(
    monkeypatch, above: float | None = None, chance: float = 0.5, *, loose: bool = False
) -> list[tuple[float, ...]]:
    """Return the stages of each further way that is gone; `above`: where the second one ends."""
    gone: list[tuple[float, ...]] = []

    def elsewhere(problem, start, solution, stages):
        gone.append(stages)
        ends = above is not None and len(gone) == 2
        return solution_at([9.0], 100.0 + above) if ends else None

    def solve(problem, start, stages, *, brief):
        return elsewhere(problem, start, None, stages) or solution_at([9.0], 1e9)

    monkeypatch.setattr(information, "elsewhere", elsewhere)
    monkeypatch.setattr(information, "solve", solve)
    expecting(monkeypatch, 1.0 if loose else 0.0)
    minimum_of(1e-3, chance=chance).minima()
    return gone


def test_how_many_further_starts_are_tried(monkeypatch):
    """Three; ten on demand, or where one did not join the first way, wherever it ended."""
    assert len(ways(monkeypatch)) == 3
    tried = ways(monkeypatch, loose=True)
    assert [len(stages) for stages in tried] == [5] * 3 + [3, 14] * 3 + [3]
    assert tried[-1] == (0.1, 0.01, 0.0)
    assert [len(ways(monkeypatch, above)) for above in (0.0, 1e9)] == [10, 10]


@pytest.mark.parametrize(("chance", "stages"), [(0.0099, [5, 14, 3] * 3 + [5]), (0.0101, [5] * 3)])
def test_a_cost_that_chance_seldom_leaves_has_all_starts_tried(monkeypatch, chance, stages):
    assert [len(each) for each in ways(monkeypatch, chance=chance)] == stages


@pytest.mark.parametrize(
    ("above", "then"), [(-1.0, [3, 5, 14, 3, 5, 14, 3, 5]), (0.0, [5, 3, 14, 3, 14, 3, 14, 3])]
)
def test_once_a_start_ends_lower_the_others_go_their_whole_way(monkeypatch, above, then):
    assert [len(stages) for stages in ways(monkeypatch, above)] == [5, 5, *then]


@pytest.mark.parametrize(("wider", "loose", "bent"), [(7.9, 1, 0), (8.1, 1, 1), (8.1, 0, 0)])
def test_a_deviation_that_is_wider_by_eight_has_no_end(monkeypatch, wider, loose, bent):
    found = doubts(monkeypatch, 0.09, 1.0, loose=bool(loose), about=False, wider=wider)
    assert found[1] == ("m",) * bent


@pytest.mark.parametrize(("below", "lower"), [(0.9, False), (1.1, True)])
def test_a_minimum_is_lower_by_more_than_a_millionth(below, lower):
    found = information._lower([solution_at([1.0], 1e6 - below)], solution_at([1.0], 1e6))
    assert (found is not None) == lower


@pytest.mark.parametrize(("after", "cure"), [(0.32, "drive F against"), (0.34, "excite what")])
def test_an_excitation_that_tells_three_times_as_much_is_a_cure(monkeypatch, after, cure):
    problem = unknowns_of("m")
    problem.likelihoods = (SimpleNamespace(data=np.ones((1, 1))),)
    problem.layout.model = SimpleNamespace(inputs=("F",))
    told = iter([np.ones(1), np.array([after])])
    monkeypatch.setattr(information, "predicted_deviations", lambda *at: next(told))
    monkeypatch.setattr(information, "replace", lambda problem, **turned: problem)
    assert information._cure(problem, ("m",)).startswith(cure)


# Deviations where the cost is no parabola: those of the interval, not of the curvature.


def explored(name, seed):
    case = rotor_case(SETTINGS[name], seed)
    problem = problem_of(case, case.start)
    solution = searched(problem, problem.layout.start)
    known = ~solution.inference.linear.undetermined
    found = information.explore(solution.point, solution.inference, known)
    names = [problem.layout.unknowns[i].name for i in problem.layout.free]
    return dict(zip(names, found[0], strict=True)), solution, found[1]


def test_over_a_parabola_deviations_hold():
    wider, solution, lowest = explored("4 sensors, +-40 %", 1)
    assert max(wider.values()) < 1.05
    assert lowest is solution.point


def test_a_load_whose_factor_may_vanish_is_hardly_known():
    """I_p is 2.1 deviations from I_t, whose difference stands before mu and eta."""
    wider, _, _ = explored("4 sensors, noise x 10", 4)
    assert min(wider["mu"], wider["eta"]) > 3
    assert max(w for name, w in wider.items() if name not in ("mu", "eta")) < 1.2


def test_a_lower_floor_is_found_and_followed():
    """From beside the minimum the valley leads to it, and the answer is the minimum."""
    case = rotor_case(SETTINGS["4 sensors, noise x 10"], 4)
    problem = problem_of(case, case.start)
    solution = searched(problem, problem.layout.start)
    scale = solution.inference.linear.scale
    size, along = np.linalg.eigh(solution.inference.covariance / np.outer(scale, scale))
    change = 1.5 * np.sqrt(size[-1]) * along[:, -1] * scale
    off = solver.beside(solution.point, change)
    assert off.cost > solution.point.cost + 0.5
    _, lowest = information.explore(off, infer(off), np.ones(len(change), dtype=bool))
    assert lowest.cost < off.cost - 0.4
    ended = solver.Solution(off, True, 0)
    again, *_ = information.questioned(ended, Mirrors(problem.layout))
    assert again.point.cost == pytest.approx(solution.point.cost, abs=1e-3)


def floors(monkeypatch, rise: float | None, step: float = 1.0, at: float = 0.0) -> list[float]:
    """Return the steps that are tried along a valley; each rises so much, or meets a wall."""
    tried: list[float] = []

    def beside(point, change):
        tried.append(float(change[0]))
        if rise is None:
            return None
        return point_at(point.unknowns + change, point.cost + rise, point.problem)

    monkeypatch.setattr(information, "beside", beside)
    begin = point_at([at], 100.0, unknowns_of("m", additive=not at))
    list(information._floor(begin, np.array([step]), np.ones(1)))
    return tried


def test_how_a_valley_is_followed(monkeypatch):
    assert floors(monkeypatch, 3.9) == [1.0] * 40
    assert floors(monkeypatch, 4.1) == [1.0, 0.25, 0.0625, 0.015625]
    # By half the value, and no step shorter than 1 / 64, which .05 / 4 is.
    assert floors(monkeypatch, None, at=1.6) == pytest.approx([0.8, 0.2, 0.05])
    assert floors(monkeypatch, None, at=1.4) == pytest.approx([0.7, 0.175, 0.04375])
    assert floors(monkeypatch, None, at=2.2) == pytest.approx([1.0, 0.25, 0.0625, 0.015625])


def walked(monkeypatch, *rises: float) -> tuple[list[np.ndarray], list[float], float]:
    """Return the changes that are followed, where loads are asked, and how wide the last is.

    Three unknowns of deviations 1, 2 and 3, of which each point moves two deviations on.
    """
    changes, ends = [], []

    def floor(point, change, unit):
        changes.append(change)
        for k, rise in enumerate(rises, 1):
            yield point_at(2.0 * k * unit, 100.0 + rise, point.problem)

    monkeypatch.setattr(information, "_floor", floor)
    monkeypatch.setattr(
        information, "_of_loads", lambda end, unit: ends.append(end.cost) or 0 * unit
    )
    begin = point_at([0.0] * 3, 100.0, unknowns_of("m", "k", "c", additive=True))
    inference = SimpleNamespace(covariance=np.diag([1.0, 4.0, 9.0]), std=np.array([1.0, 2.0, 3.0]))
    found = information.explore(begin, inference, np.ones(3, bool))
    return changes, ends, found[0][2]


def test_how_far_a_valley_is_followed(monkeypatch):
    changes, _, _ = walked(monkeypatch, 0.5)
    assert len(changes) == 4  # the two weakest directions, both ways, by half a deviation
    assert sorted(abs(changes[-1]).tolist()) == pytest.approx([0, 0, 1.5])
    for rises, end, wider in (
        ((0.9,), 100.9, 2.0),  # less than one deviation tells no width
        ((1.21,), 101.21, 2 / 1.1),
        ((3.9, 8.9), 103.9, 4 / np.sqrt(8.9)),  # loads are asked where the rise is likely
        ((3.9, 9.1), 103.9, 2 / np.sqrt(3.9)),
        ((2.0, 4.1), 102.0, 4 / np.sqrt(4.1)),
    ):
        _, ends, found = walked(monkeypatch, *rises)
        assert ends == [end] * 4
        assert found == pytest.approx(wider)


# More than one answer, and noise taken for information: told, and no false alarm.


BEARING = [COORDINATES.index(name) for name in BEARINGS]


def estimated(case):
    return identify(case.model, case.records, MaximumLikelihood(fixed=case.fixed, start=case.start))


def worst(case, estimate):
    return max(
        abs(value.value - case.truth[value.name]) / value.std
        for value in estimate.parameters
        if not value.fixed and value.std and np.isfinite(value.std)
    )


@pytest.mark.sampled(0, parts=2)
@pytest.mark.parametrize("setting", ADVERSE)
def test_no_wrong_answer_is_called_ok(setting):
    """With 18 such rotors of the adverse bank a commit has 22 of equal or nearly equal forces.

    What errs in a tenth of them is found with 90 %.
    """
    for seed in range(2):
        case = rotor_case(ADVERSE[setting], 50 + seed)
        estimate = estimated(case)
        assert estimate.status != "ok" or worst(case, estimate) < 5, seed


@pytest.mark.slow
def test_pitch_at_rest_has_other_answers_and_a_cure():
    estimate = estimated(rotor_case(ADVERSE["standstill, equal forces"], 6))
    assert estimate.status == "not_identifiable"
    assert estimate.alternatives
    for told in ("not identifiable: other answers fit as well", "cure: "):
        assert any(w.startswith(told) for w in estimate.warnings)
    assert "I_t" in dict(estimate.alternatives[0].parameters)


@pytest.mark.sampled(2, parts=2)
@pytest.mark.parametrize("setting", ["8 sensors, +-40 %", "4 sensors, +-40 %", "5 sensors, +-40 %"])
@pytest.mark.parametrize("seed", [0, 2, 5, 11])  # rotors that can be: I_p below 2 I_t
def test_no_alarm_in_good_records(setting, seed):
    estimate = estimated(rotor_case(SETTINGS[setting], seed))
    assert estimate.status == "ok"
    assert not estimate.alternatives


def test_silent_sensors_are_refused():
    case = rotor_case(Setting(), 0)
    record = times(case.records[0], BEARINGS, 0)
    with pytest.raises(InputError, match=r"zero on every line of x1, y1, x3, y3; .*cables"):
        identify(case.model, record, MaximumLikelihood(fixed=case.fixed, start=case.start))


def test_accuracy_of_what_is_not_excited_is_none(demo):
    """Equal forces on a rotor of equal halves at rest: I_t +- 4e15 % is not an accuracy."""
    plan = replace(demo, shares=(1.0, 1.0, 1.0, 1.0)).plan(BEARINGS, hertz=0.0)
    fixed = {"L1": 0.3, "I_p": 0.048, "xi": 0.0, "zeta": 0.0, "mu": 0.0, "eta": 0.0}
    accuracy = predict_accuracy(demo.model, plan, MaximumLikelihood(fixed=fixed))
    assert accuracy.status == "not_identifiable"
    assert np.isnan(accuracy.std("I_t"))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("make", [structure_case, modal_case])
@pytest.mark.parametrize("modes", [3, 5])
def test_lightly_damped_from_ten_percent_off(make, modes):
    for seed in range(2, 4):
        case = make(Tower(modes=modes), seed)
        estimate = estimated(case)
        assert estimate.status == "ok"
        assert worst(case, estimate) < 5.5


def problem_at(case, record):
    problem = problem_of(case, case.truth, [record])
    return problem, np.array([case.truth[u.name] for u in problem.layout.unknowns])


@pytest.mark.parametrize(("size", "owed"), [(2.0, False), (1.0, True)])
def test_what_the_noise_of_the_forces_informs_is_told(size, owed):
    """Forces on all lines so many times their own noise: its share of the information is 1 / 5."""
    case = rotor_case(replace(SETTINGS["4 sensors, +-40 %"], noise=1e-3), 1)
    clean = case.records[0].spectra.mean(axis=0)
    rng = np.random.default_rng(4)
    drawn = rng.standard_normal((260, *clean.shape, 2)).view(complex)[..., 0]
    drawn[:, :, 4:] = 1e-3 * drawn[:, :, 4:] * np.abs(clean[:, 4:]).mean(axis=0)
    drawn[:, :, :4] *= np.abs(clean[:, :4]).mean() / np.abs(drawn[:, :, :4].mean(axis=0)).mean()
    problem, truth = problem_at(case, replace(case.records[0], spectra=size * clean + drawn))
    names = np.array([problem.layout.unknowns[i].name for i in problem.layout.free])
    told = information.informed_by_noise(problem.at(truth))[1]
    assert told[np.isin(names, ["m1", "k1", "I_t"])].all() == owed


def levitated(seed):
    """Return case and record of a rotor in its loop, on lines of 0.1 Hz without the rotation."""
    case, rng = rotor_case(SETTINGS["4 sensors, +-40 %"], seed), np.random.default_rng(5)
    harmonics, speed = np.arange(100, 1200), case.records[0].speed
    omega = 2 * np.pi * 0.1 * harmonics
    still = case.truth | dict.fromkeys(UNBALANCE, 0.0)
    unit = np.eye(4)[:, None] * np.ones((4, len(omega), 4))
    compliance = np.stack([rotor_lines(still, speed, omega, f)[:, BEARING] for f in unit], axis=2)
    control = (6e5 + 600j * omega)[:, None, None] * np.eye(4)
    added = 0.1 * np.exp(2j * np.pi * rng.random((len(omega), 4, 1)))
    force = np.linalg.solve(np.eye(4) + control @ compliance, added)
    mean = np.concatenate([force, compliance @ force], axis=1)[:, :, 0]
    noise = np.array([1.2] * 4 + [2e-6] * 4)
    channels = case.records[0].channels
    return case, noisy_record(channels, mean, noise, harmonics, rng, speed, 40, 50_000)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [2, 6])
def test_what_only_a_resonance_makes_of_the_noise_of_forces_is_no_information(seed):
    """Beside the modes of a rotor that floats the loop leaves hardly a force: noise is measured."""
    problem, truth = problem_at(*levitated(seed))
    point = problem.at(truth)
    noise = information._by_noise(point)
    assert information._owed(noise, information._predicted(point).root).any()
    assert information._borne_out(point)[0].min() < 0.05
    assert not information.informed_by_noise(point)[1].any()


def test_fewer_equations_than_unknowns_leave_something_open():
    """One line, two sensors: four numbers for five unknowns."""
    model = load_model("jeffcott")
    noise = {"F_x": 0.1, "F_y": 0.1, "x": 1e-8, "y": 1e-8}
    rng = np.random.default_rng(1)
    record = steady(model, {}, [[3 - 4j, 5j]], [3], hertz=30, noise=noise, rng=rng)
    assert identify(model, record, "ml").status == "not_identifiable"


@pytest.mark.slow
def test_a_lower_minimum_becomes_the_answer():
    """A search that ended at the higher of two minima is set right by the further starts."""
    case = rotor_case(ADVERSE["standstill, equal forces"], 6)
    problem = problem_of(case, case.start)
    mirrors = Mirrors(problem.layout)
    found = searched(problem, problem.layout.start)
    lowest, _, others, _ = information.questioned(found, mirrors)
    assert others
    higher = Solution(max(others, key=lambda p: p.cost), True, 0)
    again, _, others, _ = information.questioned(higher, mirrors)
    assert again.point.cost < higher.point.cost - 1e-3
    assert again.point.cost == pytest.approx(lowest.point.cost, abs=1e-3)
    assert all(other.cost >= again.point.cost for other in others)


def test_two_periods_take_the_misfit_for_noise(demo):
    """Where two periods scatter too little by chance, the misfit widens the deviations."""
    record = demo.seen(3, None)
    two = record.spectra[:2]
    spectra = two.mean(axis=0) + 0.1 * (two - two.mean(axis=0))
    few = replace(record, spectra=spectra, time=record.time[:2], angle=record.angle[:2])
    found = fit(demo.model, bind_all(demo.model, [few]), Knowledge(), Nuisances())
    over = found.solution.point.cost / found.inference.expectation.mean
    assert over > 10
    plain = infer(found.solution.point).covariance
    assert found.inference.covariance[0, 0] / plain[0, 0] == pytest.approx(over)
