"""The runner of rival hypotheses, and what it names: channels, lines, speeds, bounds."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bank import shaken, steady, times
from result_cases import fit

import rotorid as rid
from rotorid import Channel, Constraint, InputError, MaximumLikelihood, identify, load_model
from rotorid.likelihood import rivals
from rotorid.likelihood import rivals_read as leads
from rotorid.likelihood import unknowns as channels
from rotorid.likelihood.case import Case, Rival
from rotorid.likelihood.problem import Point
from rotorid.likelihood.relations import Relations
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge
from rotorid.models.structure import find_structure
from rotorid.testing import bind

# The runner: what is tried, in which order it is told, and what is said of it.


def rival(
    term: str, kind="term", *, on=(), screened=0.0, left=0.0, gone=None, drop=0.0, **more
) -> Rival:
    """Return one that leaves so much of the cost, after a screening and at the minimum."""

    def at_minimum(way):
        if gone is not None:
            gone.append(term)
        return SimpleNamespace(cost=left)

    changed = SimpleNamespace(screened=lambda most=np.inf: screened, minimized=at_minimum)
    made = Rival(term, term, "add it", lambda case: changed, 1.0, "kg", on, kind, **more)
    object.__setattr__(made, "score", lambda point: (drop, 1.0))
    return made


def finding(term: str, left: float, kind="term", *, share=1.0, value=1.0, likely=False, on=()):
    said = rival(term, kind, on=on)
    return rivals.Finding(said, left, 1e6 - left, share, value, likely=likely)


def case_of(cost: float, expected: float = 100.0, records=("record",)) -> Case:
    point = SimpleNamespace(cost=cost, unknowns=np.zeros(0))
    return Case(SimpleNamespace(effort=1), records, np.zeros(0), expected, None, point)


def named(case: Case) -> list[str]:
    """Try all rivals and return the terms that are told, the first suspect first."""
    *_, last = rivals.RivalSearch(case).trials()
    return [note.about for note in last.notes[1:]]


@pytest.fixture
def catalogue(monkeypatch):
    stages = {stage: [] for stage in rivals.CATALOGUE}
    monkeypatch.setattr(rivals, "CATALOGUE", stages)
    monkeypatch.setattr(Case, "screened", lambda case, most=np.inf: 1000.0)

    def enter(stage: str, *entered: Rival) -> None:
        stages[stage].append(lambda case: iter(entered))

    return enter


@pytest.mark.parametrize(("cost", "freed", "asked"), [(299.0, 8, False), (301.0, 3, True)])
def test_how_many_small_changes_are_freed_before_mistakes_are_thought_of(
    catalogue, cost, freed, asked
):
    """Three where the misfit is three times what noise leaves; then mistakes are tried."""
    gone: list[str] = []
    small = [rival(f"mass {k}", left=310.0, gone=gone, drop=200.0 - 15 * k) for k in range(12)]
    catalogue("term", *small[::-1])
    catalogue("single", rival("swap", "mistake", left=400.0, gone=gone))
    # What was tried made it worse, and is not told.
    assert named(case_of(cost)) == [f"mass {k}" for k in range(freed, 12)]
    assert gone == [f"mass {k}" for k in range(freed)] + ["swap"] * asked


def test_a_mistake_that_explains_the_data_leaves_small_changes_out(catalogue):
    catalogue("single", rival("swap", "mistake", left=100.0))
    catalogue("several", rival("sign", "mistake", left=90.0))
    catalogue("term", *[rival(f"m {k}", left=9e3, drop=9.0) for k in range(4)])
    assert named(case_of(1e4)) == ["swap", "m 0", "m 1", "m 2"]


@pytest.mark.parametrize(
    ("best", "followed"), [(9.9, [9.9]), (10.1, [10.1, 100.0, 200.0, 300.0, 400.0])]
)
def test_which_mistakes_are_followed_after_the_screening(catalogue, best, followed):
    """One that leaves a hundredth, at once; where it explains the data the others stay. Else 5."""
    gone: list[str] = []
    costs = (500.0, 200.0, 100.0, 300.0, 600.0, best, 400.0)
    told = {"left": 100.0, "gone": gone}
    catalogue("single", *(rival(str(c), "mistake", screened=c, **told) for c in costs))
    named(case_of(1e6))
    assert gone == [str(cost) for cost in followed]


@pytest.mark.parametrize(("best", "followed"), [(999.0, ["b"]), (1001.0, [])])
def test_other_numbers_of_modes_are_followed_where_they_are_better_than_these(
    catalogue, best, followed
):
    gone: list[str] = []
    costs = {"a": 2000.0, "b": best}
    catalogue("modes", *(rival(t, left=9e5, gone=gone, screened=c) for t, c in costs.items()))
    named(case_of(1e6))
    assert gone == followed


def test_what_was_tried_before_is_not_tried_again(catalogue):
    gone: list[str] = []
    catalogue("single", *(rival(t, "mistake", left=1e5, gone=gone) for t in ("a", "b")))
    list(rivals.RivalSearch(case_of(1e6), frozenset("a")).trials())
    assert gone == ["b"]


@pytest.mark.parametrize(("left", "line"), [(299.0, 0), (301.0, 1)])
@pytest.mark.parametrize("kind", ["term", "unit"])
def test_a_line_is_left_out_where_nothing_else_explains_the_data(catalogue, left, line, kind):
    """Three times what noise leaves; another unit explains anything."""
    catalogue("trial", rival("other", kind, left=left))
    gone: list[str] = []
    catalogue("line", rival("line", "omission", left=90.0, gone=gone))
    named(case_of(1e6))
    assert len(gone) == max(line, kind == "unit")


@pytest.mark.parametrize(
    ("left", "alike"), [((100.0, 114.9), 2), ((100.0, 115.1), 1), ((200.0, 229.9), 2)]
)
def test_rivals_that_the_data_cannot_tell_apart(left, alike):
    """Costs within 15, times what is left over what noise leaves."""
    found = [finding(f"mass {k}", cost) for k, cost in enumerate(left)]
    assert len(rivals.alike(found, 100.0)) == alike


@pytest.mark.parametrize(
    ("costs", "order"),
    [
        # The rounding of a processor decides nothing: inputs stand before sensors.
        ((322.4, 322.4051), ("force", "position")),
        ((322.4051, 322.4), ("force", "position")),
        ((323.4, 322.4), ("force", "position")),
        ((323.7, 322.4), ("position", "force")),
        # Where even the best leaves a misfit, a difference says less in proportion.
        ((34000.0, 33950.0), ("force", "position")),
        ((34000.0, 33800.0), ("position", "force")),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_rivals_that_are_even_have_an_order_of_their_own(costs, order, turned):
    names = ("force", "position")
    found = [finding(name, cost) for name, cost in zip(names, costs, strict=True)]
    columns = {("force",): 4, ("position",): 7}
    ordered = rivals.ranked(found[::-1] if turned else found, 292.0, columns)
    assert tuple(f.rival.term for f in ordered) == order
    assert "the data cannot tell it from" in rivals.sentence(case_of(1e6, 292.0), ordered)


@pytest.mark.parametrize(
    ("likely", "order"),
    [(True, ["bound", "unit", "prior", "mass"]), (False, ["unit", "prior", "mass", "bound"])],
)
def test_where_kinds_stand_that_cannot_be_told_apart(likely, order):
    found = [
        finding("bound", 25.0, "bound", likely=likely),
        finding("mass", 25.0),
        finding("prior", 25.0, "known"),
        finding("unit", 25.0, "unit", on=("x",)),
        finding("delay", 25.0, on=("x",)),  # of the channel whose unit it may be
    ]
    assert [f.rival.term for f in rivals.ranked(found, 20.0, {})] == order


@pytest.mark.parametrize(("value", "first"), [(0.9, "x"), (1.1, "y"), (-1.1, "y")])
def test_a_channel_that_reads_too_little_comes_before_one_that_reads_too_much(value, first):
    found = [finding("x", 25.0, "gain", value=value), finding("y", 25.0)]
    assert rivals.ranked(found, 20.0, {("x",): 0})[0].rival.term == first


@pytest.mark.parametrize(("left", "enough"), [(875.0, True), (877.0, False)])
def test_a_rival_that_is_not_enough_is_said_to_be_none(left, enough):
    """Two mistakes at once: the best of one leaves more than three times what noise does."""
    told = rivals.sentence(case_of(1e6, 292.0), [finding("mass at x", left)])
    assert told.endswith("add it") == enough
    assert ("there is a second mistake or another one in its place" in told) != enough


@pytest.mark.parametrize(("share", "lead"), [(0.19, False), (0.21, True)])
def test_a_rival_that_explains_a_fifth_is_told(share, lead):
    told = rivals.sentence(case_of(1e6), [finding("mass at x", 200.0, share=share)])
    assert ("first suspect: mass at x" in told) == lead
    assert ("none of the 1 suspects explains" in told) != lead


@pytest.mark.parametrize(("apart", "value"), [(0.9e-3, 100.0), (1.1e-3, None)])
def test_speeds_that_fit_alike_are_no_speed(apart, value):
    found = [
        finding("speed[2]", left, "speed", value=size, on=("record 3",))
        for size, left in ((100.0, 70.0), (100.0 * (1 - apart), 70.5), (50.0, 200.0))
    ]
    first = rivals._one_speed(found, 60.0)[0]
    assert first.value == value
    said = "another speed of record 3 than the one given" in first.rival.says
    assert said == ("rotorid inspect" in first.rival.cure) == (value is None)


PREPARED = SimpleNamespace(layout=SimpleNamespace(index={}))
PLACES = ("left_end", "A", "a", "wheel", "B", "b", "right_end")


def entered(stage: str, case: object) -> list[Rival]:
    return [each for entry in rivals.CATALOGUE[stage] for each in entry(case)]


def test_half_a_right_angle_leads_to_where_a_record_begins(monkeypatch):
    """From the angles that are tried, and from that of the mark itself."""
    later = [SimpleNamespace(lines=SimpleNamespace(clock=None))] * 2
    monkeypatch.setattr(
        rivals.rivals_read,
        "later_phases",
        lambda records, starts: [(1, channels.phase(1, start=s)) for s in starts],
    )
    case = SimpleNamespace(records=later, prepared=PREPARED)
    found = [*entered("angle", case), *entered("angle far", case)]
    asked = np.exp(1j * np.array([r.added.scalars[0].start for r in found]))
    every = np.exp(1j * np.deg2rad(np.arange(360.0)))
    assert np.degrees(np.abs(np.angle(every[:, None] / asked))).min(axis=1).max() < 23.0
    assert {r.way for r in found} == {"near", "both"}


@pytest.mark.parametrize(("name", "factor"), channels.FACTORS.items())
def test_factors_of_units_are_named(name, factor):
    for exact in (factor, 1 / factor):
        for off in (0.992, 1.008):  # between 9.807 and ten, the one that is nearer
            assert channels.snap(-off * exact) == pytest.approx(-exact, rel=1e-6)
            assert channels.factor_name(off * exact) == f" ({name})"
        assert channels.factor_name(-exact) == f" ({name}, upside down)"


@pytest.mark.parametrize(
    ("gain", "exact"),
    [(-1.029, -1.0), (-1.031, None), (0.971, 1.0), (0.969, None), (26.15, 25.4), (26.17, None)],
)
def test_how_close_a_gain_is_to_that_of_a_unit(gain, exact):
    assert channels.snap(gain) == (None if exact is None else pytest.approx(exact))


def jeffcott(speeds=(100.0,), sizes=(1.0, 1.0, 1.0, 1.0), frequency=(10.0, 20.0, 30.0)) -> Case:
    """Return a case of records of which only what stands here is known, before any estimate."""
    model = load_model("jeffcott")
    made = []
    for speed in speeds:
        known = {"names": ("F_x", "F_y", "x", "y"), "passive": False}
        lines = SimpleNamespace(speed=np.full(3, speed), frequency=np.array(frequency), **known)
        lines.mean = np.outer([1j, -1.0, 1.0], sizes)
        lines.covariance = SimpleNamespace(matrices=np.tile(1e-6 * np.eye(len(sizes)), (3, 1, 1)))
        record = SimpleNamespace(lines=lines, model=model, inputs=[], direct=[], indirect=[])
        record.input_columns = []
        made.append(record)
    known = {"model": model, "values": None, "structure": None}
    return SimpleNamespace(records=made, prepared=PREPARED, **known)


def speeds_of(case) -> list[Rival]:
    return [r for r in entered("single", case) if r.kind == "speed"]


def test_speeds_that_were_mistaken():
    """Of a rotor that is said to turn at 100 rad/s: what is right instead, either way round."""
    right = {
        "rad/s taken for rpm": 954.930,
        "rpm taken for rad/s": 10.472,
        "Hz taken for rpm": 6000.0,
        "rpm taken for Hz": 1.667,
        "rad/s taken for Hz": 15.915,
        "Hz taken for rad/s": 628.319,
        "twice the true one": 50.0,
        "half the true one": 200.0,
    }
    assert {(r.says, round(r.value, 3)) for r in speeds_of(jeffcott())} == {
        ("the rotor turning the other way, or x and y exchanged in every channel", -100.0),
        *((f"the speed {said}", speed) for said, speed in right.items()),
        *((f"the speed {said}, and its direction reversed", -v) for said, v in right.items()),
    }


def estimated(case, costs=None):
    """Return the case at an estimate, where the last line fits worst."""
    each = [1.0] * len(case.records) if costs is None else costs
    worst = [SimpleNamespace(line_costs=np.array([0.0, 1.0, 2.0]) * cost) for cost in each]
    case.values, case.point = np.ones(5), SimpleNamespace(records=worst)
    return case


def test_the_speeds_of_all_records_and_of_single_ones():
    found = speeds_of(estimated(jeffcott((100.0, 200.0))))
    assert {r.term for r in found} == {"speed", "speed[0]", "speed[1]"}
    backwards = [r for r in found if "turning the other way, or x and y" in r.says]
    assert [r.value for r in backwards] == [None, -100.0, -200.0]
    assert "-954.93, -1909.86 rpm one after the other would do" in backwards[0].cure
    # What the lines show of one record is no speed of all.
    shown = [r for r in found if "which the data show" in r.says]
    assert {r.term for r in shown} == {"speed[0]", "speed[1]"}
    assert {round(abs(r.value) / (2 * np.pi)) for r in shown} == {20, 30}


def test_a_record_that_stood_still_may_have_turned():
    found = speeds_of(estimated(jeffcott((0.0, 200.0), frequency=(10.0, 20.0, 30.0))))
    still = [r.value / (2 * np.pi) for r in found if r.term == "speed[0]"]
    assert still == pytest.approx([10, -10, 30, -30, 20, -20])


def test_speeds_are_asked_of_the_four_records_that_fit_worst():
    case = estimated(jeffcott((100.0,) * 6), costs=(1.0, 6.0, 2.0, 5.0, 4.0, 3.0))
    asked = {r.term for r in speeds_of(case)} - {"speed"}
    assert asked == {f"speed[{k}]" for k in (1, 3, 4, 5)}


def with_sensors(case, names):
    """Return the case with so many sensors of one unit, and no input."""
    term = SimpleNamespace(coordinate=0)
    channels = [SimpleNamespace(name=name, unit="m") for name in names]
    case.records[0].lines.names = names
    case.records[0].direct = [SimpleNamespace(channel=c, order=0, terms=[term]) for c in channels]
    return case


@pytest.mark.parametrize(("channels", "swaps"), [(8, 28), (9, 8)])
def test_swaps_of_many_like_channels_are_those_of_neighbours(channels, swaps):
    case = with_sensors(jeffcott(), tuple(f"x{k}" for k in range(channels)))
    found = [r for r in entered("single", case) if len(r.on) == 2]
    assert len(found) == swaps


@pytest.mark.parametrize(
    ("name", "own", "others"),
    [
        ("three-mass", "x1", {"x2", "x3", "y1", "y2", "y3"}),
        ("flexible", "x_A", {f"{a}_{p}" for a in "xy" for p in PLACES} - {"x_A"}),
    ],
)
def test_a_force_law_may_act_at_any_displacement_that_has_a_name(name, own, others):
    """Nobody writes a node between two places of a drawing, and none of a mesh."""
    drive = SimpleNamespace(ks=1e4, position={own: 1.0})
    record = SimpleNamespace(inputs=[SimpleNamespace(name="F", drive=drive)])
    case = SimpleNamespace(model=rid.load_model(name), records=[record])
    cures = [r.cure for r in rivals.rivals_read._positions(case)]
    assert sorted(cures) == sorted(f'set position = "{k}" of F in [channels]' for k in others)


@pytest.mark.parametrize(("times", "unlike"), [(4.9, False), (5.1, True), (1 / 5.1, True)])
def test_a_channel_unlike_the_others_of_its_kind(times, unlike):
    case = with_sensors(jeffcott(sizes=(1.0, 1.0, times)), ("a", "b", "c"))
    starts = {r.on[0]: r.added.scalars[0].start for r in entered("factor", case)}
    assert starts == pytest.approx({"a": 1.0, "b": 1.0, "c": 1 / times if unlike else 1.0})


@pytest.mark.parametrize(("harmonics", "held"), [((1, 7, 14), "2"), ((7, 21), "3"), ((1, 7), "")])
def test_runout_is_suspected_where_a_line_holds_it(demo, harmonics, held):
    """Of metres it would explain any misfit, by what leaks of it onto other lines."""
    lines = rid.Lines.of_periods(demo.record())
    assert lines.speed[0] == pytest.approx(2 * np.pi * 140)  # seven times 20 Hz
    clock = replace(lines.clock, harmonics=np.array(harmonics))
    record = bind(demo.model, replace(lines, clock=clock))
    case = SimpleNamespace(records=(record,), prepared=PREPARED)
    found = {r.term for r in entered("channel", case) if "order" in r.term}
    assert {term[-2] for term in found} == set(held)


# Mistakes that are no small changes: undone, the data fit, and the first suspect names them.


@pytest.fixture(scope="module")
def record(demo):
    """A record with little noise: what is wrong stands out."""
    return replace(demo, force_noise=0.05, position_noise=5e-7).seen(5, None, periods=60)


AXES = (("x", "y", 0.01), ("y", "x", -0.01))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("besides", "term", "unit", "size"),
    [
        ({("x1", "theta_y"): 0.005}, "plane[x1]", "m", 0.005),
        ({("x1", "theta_y"): 0.005, ("y1", "theta_x"): -0.005}, "plane[x1, y1]", "m", 0.005),
        ({("x1", "y1"): 0.01, ("y1", "x1"): -0.01}, "rotation[x1, y1]", "rad", 0.01),
        (
            {(f"{a}{end}", f"{b}{end}"): s for a, b, s in AXES for end in ("1", "2", "3")}
            | {("theta_x", "theta_y"): 0.01, ("theta_y", "theta_x"): -0.01},
            "rotation[x1, y1, x2, y2, x3, y3, theta_x, theta_y]",
            "rad",
            0.01,
        ),
    ],
)
def test_what_sensors_read_besides(demo, record, besides, term, unit, size):
    """One beside its plane; both, as a plane that is elsewhere; axes that are turned, or all."""
    mixing = np.eye(len(record.names))
    for (name, other), share in besides.items():
        mixing[record.index(name), record.index(other)] = share
    mixed = replace(record, spectra=record.spectra @ mixing.T)
    first = demo.identified(mixed, fixed={}).suspects[0]
    assert (first.term, first.unit) == (term, unit)
    assert first.value == pytest.approx(size, rel=0.05)


def test_a_load_where_the_model_has_none(demo, record):
    """20 g mm of unbalance on the first mass."""
    size = 2e-5 * record.speed**2 / 2
    loaded = shaken(shaken(record, 7, ("F_x1",), -size), 7, ("F_y1",), 1j * size)
    first = demo.identified(loaded, fixed={}).suspects[0]
    assert first.term in ("load at x1, y1", "load at x1", "load at y1")
    assert first.value == pytest.approx(2e-5, rel=0.05)


def test_what_undoes_a_mistake_undoes_it(demo, record):
    seen = bind(demo.model, record)
    twice = leads.exchanged(leads.exchanged(seen, [("x1", "y2")]), [("x1", "y2")])
    np.testing.assert_allclose(twice.lines.mean, seen.lines.mean)
    scaled = leads.multiplied(seen, {"x1": 2.0, "F_y1": -1.0})
    where = [seen.lines.names.index(n) for n in ("x1", "F_y1")]
    found, wanted = (at.lines.covariance.matrices[:, where[0], where[1]] for at in (scaled, seen))
    np.testing.assert_allclose(found, -2 * wanted)
    np.testing.assert_allclose(scaled.lines.scatter[:, :, where[0]], 2 * record.spectra[:, :, 4])


def test_planes_of_sensors_that_read_combinations(demo):
    pair = [
        Channel("s_x", "m", reads={"x2": 1.0, "theta_y": 0.1}),
        Channel("s_y", "m", reads={"y2": 1.0, "theta_x": -0.1}),
    ]
    plan = demo.plan([*pair, "x1", "y1"])
    seen = bind(demo.model, plan.lines(demo.model))
    structure = find_structure(demo.model, demo.values, 100.0)
    known = {"model": demo.model, "values": demo.values, "structure": structure}
    found = {frozenset(p) for p in leads.planes(SimpleNamespace(records=[seen], **known))}
    assert found >= {frozenset(p) for p in (("s_x", "s_y"), ("x1", "y1"), ("F_x1", "F_y1"))}
    assert len(found) == 4


# A line that something else fills is named, and only where nothing else explains the data.


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("harmonic", "told"),
    [
        (7, "which something else makes, such as a base that shakes"),
        (5, "where hum of the mains stands"),
    ],
)
def test_a_line_that_something_else_fills_is_named(records, harmonic, told):
    record = shaken(records[1], harmonic, ("x",), 2e-6 * np.exp(0.4j))
    estimate = identify(MODEL, record, MaximumLikelihood())
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term == f"line {10 * harmonic} Hz"
    assert estimate.suspects[0].share > 0.99
    assert f"the line at {10 * harmonic} Hz, {told}" in estimate.warnings[0]
    assert "leave it out of the harmonics" in estimate.warnings[0]


def test_the_drop_is_what_a_refit_without_the_line_gains(demo, record):
    bad = bind(demo.model, shaken(record, 3, ("x1", "x2", "x3"), 2e-8 * np.exp(0.4j)))
    found = fit(demo.model, [bad], Knowledge(), Nuisances())
    point = found.solution.point
    case = Case(found.problem, found.records, point.unknowns, found=point)
    drops = {line: drop for drop, _, line in leads._drops(case)}
    assert sorted(drops) == [0, 1, 2, 4, 5]  # not the rotation's, 140 Hz
    worst = max(drops, key=lambda k: drops[k])
    assert bad.lines.frequency[worst] == 60
    again = leads.without(case, 0, worst)
    assert case.point.cost - again.minimized().cost == pytest.approx(drops[worst], rel=0.02)


@pytest.mark.parametrize(("share", "told"), [(0.49, False), (0.51, True)])
def test_a_line_that_holds_half_of_the_misfit_is_one_too_many(monkeypatch, share, told):
    monkeypatch.setattr(leads, "_drops", lambda case: iter([(1e3 * share, 0, 1)]))
    lines = SimpleNamespace(frequency=np.array([20.0, 40.0]))
    point = SimpleNamespace(cost=1100.0)
    case = SimpleNamespace(records=[SimpleNamespace(lines=lines)], point=point, expected=100.0)
    assert len(list(leads._line(case))) == told


@pytest.mark.parametrize("hertz", [50.04, 149.86, 59.95, 180.1, 240.0])
def test_lines_of_the_mains(hertz):
    """A thousandth beside them, or on their multiples."""
    assert "hum of the mains" in leads.source(hertz)


@pytest.mark.parametrize("hertz", [0.01, 50.06, 60.07, 25.0, 30.0, 75.0, 90.0])
def test_other_lines_are_no_hum(hertz):
    assert "hum of the mains" not in leads.source(hertz)


def test_lines_of_the_rotation_are_no_odd_ones():
    """The first three orders, from a quarter of the lines' distance on; and lines of no period."""
    frequency = 10.0 * np.arange(1, 13) - 2.4
    lines = SimpleNamespace(frequency=frequency, speed=np.full(12, 2 * np.pi * 30.0), scatter=1)
    at = SimpleNamespace(problem=SimpleNamespace(equations=1, lines=12), residual=np.ones(24))
    at.jacobian = lambda: np.zeros((24, 0))
    known = SimpleNamespace(jacobian=lambda *at: np.zeros((0, 0)))
    none = np.zeros(0)
    layout = SimpleNamespace(free=none.astype(int), start=none, additive=none.astype(bool))
    problem = SimpleNamespace(layout=layout, exact=Relations((), 0), known=known)
    none = np.zeros(0)
    point = Point(problem, none, [at], none)
    case = SimpleNamespace(records=[SimpleNamespace(lines=lines)], point=point)
    assert [line for *_, line in leads._drops(case)] == [0, 1, 3, 4, 6, 7, 9, 10, 11]
    lines.frequency = frequency - 0.2  # .26 of the distance
    assert len(list(leads._drops(case))) == 12


def test_a_line_that_is_left_out_weighs_a_millionth(demo, record):
    seen = bind(demo.model, record)
    case = SimpleNamespace(records=[seen], reading=lambda records: records)
    (without,) = leads.without(case, 0, 2)
    ratio = without.lines.covariance.matrices / seen.lines.covariance.matrices
    weight = 1 / np.sqrt(np.abs(ratio[:, 0, 0]))
    assert weight == pytest.approx([1, 1, 1e-6, 1, 1, 1])


# One wrong speed among several records: the record is named, and its own speed told.


TRUTH = {"m": 2.0, "c": 30.0, "k": 2e5, "xi": 2e-5, "zeta": 1e-5}
MODEL = load_model("jeffcott")


def turning(hertz, harmonics, rng, truth, noise=1e-7):
    """Return a record of a turning disc with little noise."""
    forces = np.array([[3 - 4j, 5], [5j, 4 - 3j], [4, -5j], [-3j, 4], [5, 3j], [2j, -4]])
    noises = {"F_x": 0.02, "F_y": 0.02, "x": noise, "y": noise}
    forces = forces[: len(harmonics)]
    return steady(MODEL, truth, forces, harmonics, hertz=hertz, noise=noises, rng=rng)


@pytest.fixture(scope="module")
def records():
    """Records at 20, 30 and 40 Hz, whose lines stand at 10 to 70 Hz."""
    rng = np.random.default_rng(8)
    return [turning(hertz, (1, 2, 3, 4, 5, 7), rng, TRUTH) for hertz in (20.0, 30.0, 40.0)]


def told_otherwise(record, hertz):
    speed = 2 * np.pi * hertz
    return replace(record, speed=speed, angle=np.asarray(record.time) * speed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "hertz", "words"),
    [
        (1, 30 * np.pi / 30, "speed of record 2"),  # rad/s taken for rpm
        (0, 30.0, "a speed of record 1 of 1200 rpm, which the data show"),
    ],
)
def test_the_record_with_a_wrong_speed_is_named(records, number, hertz, words):
    given = [told_otherwise(r, hertz) if k == number else r for k, r in enumerate(records)]
    estimate = identify(MODEL, given, MaximumLikelihood())
    first = estimate.suspects[0]
    assert (first.term, first.unit) == (f"speed[{number}]", "rad/s")
    assert first.value == pytest.approx(records[number].speed, rel=1e-6)
    assert words in estimate.warnings[0]
    assert f"{records[number].speed * 30 / np.pi:.6g} rpm would do" in estimate.warnings[0]


# A wrong bound is a suspect like a wrong value, and what contradicts itself is refused.


STIFF = {"m": 2.0, "c": 30.0, "k": 2e5}


@pytest.fixture(scope="module")
def stiff_record():
    return turning(30.0, (1, 2, 3, 7), np.random.default_rng(3), STIFF, noise=2e-7)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("bounds", "term", "value"),
    [
        ({"c": (None, 20.0)}, "bound c <= 20", 30.0),
        # Without the bound all is said; a force in kilograms would keep it, and explain as much.
        ({"k": (2.05e5, None)}, "bound k >= 205000", 2e5),
        ({"k/2 - 1e4*m": (None, 7e4)}, "bound k/2 - 1e4*m <= 70000", 8e4),
        ({"k": (2.05e5, None), "c": (None, 20.0)}, "bound k >= 205000, c <= 20", None),
    ],
)
def test_a_wrong_bound_is_the_first_suspect(stiff_record, bounds, term, value):
    estimate = identify(MODEL, stiff_record, MaximumLikelihood(bounds=bounds))
    assert estimate.status == "rejected"
    first = estimate.suspects[0]
    assert first.term == term
    assert first.share > 0.999
    assert first.value == (None if value is None else pytest.approx(value, rel=2e-3))
    assert "first suspect" in estimate.warnings[0]
    assert "check th" in estimate.warnings[0]


@pytest.mark.slow
def test_a_sign_that_the_model_forbids_is_looked_for_in_the_channels(stiff_record):
    """All forces upside down: a negative rotor would explain it, and m >= 0 is right."""
    bounds = {name: (0.0, None) for name in ("m", "k")}
    wrong = times(stiff_record, ["F_x", "F_y"], -1)
    estimate = identify(MODEL, wrong, MaximumLikelihood(bounds=bounds))
    assert estimate.suspects[0].term == "sign[F_x, F_y]"


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "likely"), [(2e5 / 1.49, True), (2e5 / 1.51, False)])
def test_a_bound_far_from_what_it_forbids_is_not_the_likeliest_mistake(stiff_record, limit, likely):
    """A force in other units would keep it, and explain as much."""
    estimate = identify(MODEL, stiff_record, MaximumLikelihood(bounds={"k": (None, limit)}))
    assert (estimate.suspects[0].term == f"bound k <= {limit:g}") == likely


def test_without_a_bound_held_nothing_is_said_of_bounds(stiff_record):
    estimator = MaximumLikelihood(fixed={"m": 2.1}, bounds={"k": (1e5, None)})
    estimate = identify(MODEL, stiff_record, estimator)
    assert estimate.suspects
    assert not [s.term for s in estimate.suspects if s.term.startswith("bound")]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"fixed": {"m": 2.0}, "constraints": (Constraint("m", 2.0051, 1e-3),)},
            r"m = 2, fixed, which m = 2.0051 contradicts",
        ),
        ({"fixed": {"m": 2.0}, "bounds": {"m": (2.1, None)}}, r"m = 2, fixed, which m >= 2.1"),
        (
            {"known": {"m": (3.0, 1e-3)}, "bounds": {"m": (None, 2.5)}},
            r"m = 3, known with a deviation, which m <= 2.5 contradicts",
        ),
    ],
)
def test_what_contradicts_itself_is_refused(stiff_record, given, said):
    with pytest.raises(InputError, match=said) as caught:
        identify(MODEL, stiff_record, MaximumLikelihood(**given))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "given",
    [
        {"fixed": {"m": 2.0}, "constraints": (Constraint("m", 2.0049, 1e-3),)},
        {"known": {"m": (2.0, 1e-3)}, "bounds": {"m": (1.9, 2.1), "m*k": (1.0, None)}},
        {"known": {"m": (2.0, 1e-3)}, "constraints": (Constraint("m", 2.01, 1e-2),)},
    ],
)
def test_what_agrees_is_taken(stiff_record, given):
    assert identify(MODEL, stiff_record, MaximumLikelihood(**given)).status in ("ok", "rejected")


def test_a_unit_of_all_forces_may_be_that_of_all_positions():
    assert "of all forces or currents, or of all positions" in leads._unit(["F"], "force", 1e3).cure
    assert "the scale of x1, and" in leads._unit(["x1"], "x1", 1e3).cure
