"""The runner: what is tried, in which order it is told, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rotorid as rid
from rotorid import load_model
from rotorid.data.observation import bind
from rotorid.likelihood import rivals
from rotorid.likelihood import unknowns as channels
from rotorid.likelihood.case import Case, Rival, Slopes


def rival(
    term: str, kind="term", *, on=(), screened=0.0, left=0.0, gone=None, drop=0.0, **more
) -> Rival:
    """Return one that leaves so much of the cost, after a screening and at the minimum."""

    def at_minimum(way):
        if gone is not None:
            gone.append(term)
        return SimpleNamespace(cost=left)

    changed = SimpleNamespace(screened=lambda: screened, minimized=at_minimum)
    made = Rival(term, kind, lambda case: changed, term, "add it", 1.0, "kg", on, **more)
    object.__setattr__(made, "score", lambda slopes: (drop, 1.0))
    return made


def finding(term: str, left: float, kind="term", *, share=1.0, value=1.0, likely=False, on=()):
    said = rival(term, kind, on=on)
    return rivals.Finding(said, left, 1e6 - left, share, value, likely=likely)


def case_of(cost: float, expected: float = 100.0, records=("record",)) -> Case:
    """Return what was estimated, at this cost."""
    point = SimpleNamespace(cost=cost, unknowns=np.zeros(0))
    return Case(SimpleNamespace(), records, np.zeros(0), expected, None, point)


def named(case: Case) -> list[str]:
    """Try all rivals and return the terms that are told, the first suspect first."""
    *_, last = rivals.RivalSearch(case).trials()
    return [note.about for note in last.causes().notes[1:]]


@pytest.fixture
def catalogue(monkeypatch):
    """A catalogue of nothing, to be filled."""
    stages = {stage: [] for stage in rivals.CATALOGUE}
    monkeypatch.setattr(rivals, "CATALOGUE", stages)
    monkeypatch.setattr(Slopes, "turns", lambda case, small: [(case.point, small)])
    monkeypatch.setattr(Case, "screened", lambda case: 1000.0)

    def enter(stage: str, *entered: Rival) -> None:
        stages[stage].append(lambda case: iter(entered))

    return enter


@pytest.mark.parametrize(("cost", "freed", "asked"), [(299.0, 8, False), (301.0, 3, True)])
def test_how_many_small_changes_are_freed_before_mistakes_are_thought_of(
    catalogue, cost, freed, asked
) -> None:
    """Three where the misfit is three times what noise leaves; then mistakes are tried."""
    gone: list[str] = []
    small = [rival(f"mass {k}", left=310.0, gone=gone, drop=200.0 - 15 * k) for k in range(12)]
    catalogue("term", *small[::-1])
    catalogue("single", rival("swap", "mistake", left=400.0, gone=gone))
    # What was tried made it worse, and is not told.
    assert named(case_of(cost)) == [f"mass {k}" for k in range(freed, 12)]
    assert gone == [f"mass {k}" for k in range(freed)] + ["swap"] * asked


def test_a_mistake_that_explains_the_data_leaves_small_changes_out(catalogue) -> None:
    catalogue("single", rival("swap", "mistake", left=100.0))
    catalogue("several", rival("sign", "mistake", left=90.0))
    small = [rival(f"m {k}", left=9e3, drop=9.0) for k in range(4)]
    catalogue("term", *small)
    assert named(case_of(1e4)) == ["swap", "m 0", "m 1", "m 2"]


@pytest.mark.parametrize(
    ("best", "followed"), [(9.9, [9.9]), (10.1, [10.1, 100.0, 200.0, 300.0, 400.0])]
)
def test_which_mistakes_are_followed_after_the_screening(catalogue, best, followed) -> None:
    """One that leaves a hundredth, at once; where it explains the data the others stay. Else 5."""
    gone: list[str] = []
    costs = (500.0, 200.0, 100.0, 300.0, 600.0, best, 400.0)
    catalogue(
        "single",
        *(rival(str(c), "mistake", screened=c, left=100.0, gone=gone) for c in costs),
    )
    list(rivals.RivalSearch(case_of(1e6)).screened())
    assert gone == [str(cost) for cost in followed]


def test_what_was_tried_before_is_not_tried_again(catalogue) -> None:
    gone: list[str] = []
    catalogue("single", *(rival(t, "mistake", left=1e5, gone=gone) for t in ("a", "b")))
    list(rivals.RivalSearch(case_of(1e6), frozenset("a")).screened())
    assert gone == ["b"]


@pytest.mark.parametrize(("left", "line"), [(299.0, 0), (301.0, 1)])
@pytest.mark.parametrize("kind", ["term", "unit"])
def test_a_line_is_left_out_where_nothing_else_explains_the_data(
    catalogue, left, line, kind
) -> None:
    """Three times what noise leaves; another unit explains anything."""
    catalogue("trial", rival("other", kind, left=left))
    gone: list[str] = []
    catalogue("line", rival("line", "omission", left=90.0, gone=gone))
    named(case_of(1e6))
    assert len(gone) == max(line, kind == "unit")


@pytest.mark.parametrize(
    ("left", "alike"), [((100.0, 114.9), 2), ((100.0, 115.1), 1), ((200.0, 229.9), 2)]
)
def test_rivals_that_the_data_cannot_tell_apart(left, alike) -> None:
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
def test_rivals_that_are_even_have_an_order_of_their_own(costs, order, turned) -> None:
    names = ("force", "position")
    found = [finding(name, cost) for name, cost in zip(names, costs, strict=True)]
    ordered = rivals.ranked(
        found[::-1] if turned else found, 292.0, {("force",): 4, ("position",): 7}
    )
    assert tuple(f.rival.term for f in ordered) == order
    assert "the data cannot tell it from" in rivals.sentence(case_of(1e6, 292.0), ordered, "")


@pytest.mark.parametrize(
    ("likely", "order"),
    [(True, ["bound", "unit", "prior", "mass"]), (False, ["unit", "prior", "mass", "bound"])],
)
def test_where_kinds_stand_that_cannot_be_told_apart(likely, order) -> None:
    found = [
        finding("bound", 25.0, "bound", likely=likely),
        finding("mass", 25.0),
        finding("prior", 25.0, "known"),
        finding("unit", 25.0, "unit", on=("x",)),
        finding("delay", 25.0, on=("x",)),  # of the channel whose unit it may be
    ]
    assert [f.rival.term for f in rivals.ranked(found, 20.0, {})] == order


@pytest.mark.parametrize(("value", "first"), [(0.9, "x"), (1.1, "y"), (-1.1, "y")])
def test_a_channel_that_reads_too_little_comes_before_one_that_reads_too_much(value, first) -> None:
    found = [finding("x", 25.0, "gain", value=value), finding("y", 25.0)]
    assert rivals.ranked(found, 20.0, {("x",): 0})[0].rival.term == first


@pytest.mark.parametrize(("left", "enough"), [(875.0, True), (877.0, False)])
def test_a_rival_that_is_not_enough_is_said_to_be_none(left, enough) -> None:
    """Two mistakes at once: the best of one leaves more than three times what noise does."""
    told = rivals.sentence(case_of(1e6, 292.0), [finding("mass at x", left)], "")
    assert told.endswith("add it") == enough
    assert ("there is a second mistake or another one in its place" in told) != enough


@pytest.mark.parametrize(("share", "lead"), [(0.19, False), (0.21, True)])
def test_a_rival_that_explains_a_fifth_is_told(share, lead) -> None:
    told = rivals.sentence(case_of(1e6), [finding("mass at x", 200.0, share=share)], "")
    assert ("first suspect: mass at x" in told) == lead
    assert ("none of the 1 suspects explains" in told) != lead


@pytest.mark.parametrize(("apart", "value"), [(0.9e-3, 100.0), (1.1e-3, None)])
def test_speeds_that_fit_alike_are_no_speed(apart, value) -> None:
    found = [
        finding("speed[2]", left, "speed", value=size, on=("record 3",))
        for size, left in ((100.0, 70.0), (100.0 * (1 - apart), 70.5), (50.0, 200.0))
    ]
    first = rivals._one_speed(found, 60.0)[0]
    assert first.value == value
    said = "another speed of record 3 than the one given" in first.rival.says
    assert said == ("rotorid inspect" in first.rival.cure) == (value is None)


def entered(stage: str, case: object) -> list[Rival]:
    return [each for entry in rivals.CATALOGUE[stage] for each in entry(case)]


def test_half_a_right_angle_leads_to_where_a_record_begins(monkeypatch) -> None:
    """From the angles that are tried, and from that of the mark itself."""
    later = [SimpleNamespace(lines=SimpleNamespace(clock=None))] * 2
    monkeypatch.setattr(
        rivals.rivals_records,
        "later_phases",
        lambda records, starts: [(1, channels.phase(1, start=s)) for s in starts],
    )
    prepared = SimpleNamespace(layout=SimpleNamespace(index={}))
    case = SimpleNamespace(records=later, prepared=prepared)
    found = [*entered("angle", case), *entered("angle far", case)]
    asked = np.exp(1j * np.array([r.added.scalars[0].start for r in found]))
    every = np.exp(1j * np.deg2rad(np.arange(360.0)))
    assert np.degrees(np.abs(np.angle(every[:, None] / asked))).min(axis=1).max() < 23.0
    assert {r.way for r in found} == {"near", "both"}


@pytest.mark.parametrize(("name", "factor"), channels.FACTORS.items())
def test_factors_of_units_are_named(name, factor) -> None:
    for exact in (factor, 1 / factor):
        for off in (0.992, 1.008):  # between 9.807 and ten, the one that is nearer
            assert channels.snap(-off * exact) == pytest.approx(-exact, rel=1e-6)
            assert channels.factor_name(off * exact) == f" ({name})"
        assert channels.factor_name(-exact) == f" ({name}, upside down)"


@pytest.mark.parametrize(
    ("gain", "exact"),
    [(-1.029, -1.0), (-1.031, None), (0.971, 1.0), (0.969, None), (26.15, 25.4), (26.17, None)],
)
def test_how_close_a_gain_is_to_that_of_a_unit(gain, exact) -> None:
    assert channels.snap(gain) == (None if exact is None else pytest.approx(exact))


def jeffcott(speeds=(100.0,), sizes=(1.0, 1.0, 1.0, 1.0), frequency=(10.0, 20.0, 30.0)) -> Case:
    """Return a case of records of which only what stands here is known, before any estimate."""
    model = load_model("jeffcott")
    made = []
    for speed in speeds:
        lines = SimpleNamespace(
            speed=np.full(3, speed),
            frequency=np.array(frequency),
            names=("F_x", "F_y", "x", "y"),
            mean=np.outer([1j, -1.0, 1.0], sizes),
            passive=False,
        )
        record = SimpleNamespace(lines=lines, model=model, inputs=[], direct=[], indirect=[])
        made.append(record)
    case = SimpleNamespace(records=made, model=model, values=None, structure=None)
    case.prepared = SimpleNamespace(layout=SimpleNamespace(index={}))
    return case


def speeds_of(case) -> list[Rival]:
    return [r for r in entered("single", case) if r.kind == "speed"]


def test_speeds_that_were_mistaken() -> None:
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
        ("the rotor turning the other way", -100.0),
        *((f"the speed {said}", speed) for said, speed in right.items()),
        *((f"the speed {said}, and its direction reversed", -v) for said, v in right.items()),
    }


def estimated(case, costs=None):
    """Return the case at an estimate, where the last line fits worst."""
    each = [1.0] * len(case.records) if costs is None else costs
    worst = [SimpleNamespace(line_costs=np.array([0.0, 1.0, 2.0]) * cost) for cost in each]
    case.values, case.point = np.ones(5), SimpleNamespace(records=worst)
    return case


def test_the_speeds_of_all_records_and_of_single_ones() -> None:
    found = speeds_of(estimated(jeffcott((100.0, 200.0))))
    assert {r.term for r in found} == {"speed", "speed[0]", "speed[1]"}
    backwards = [r for r in found if r.says.endswith("turning the other way")]
    assert [r.value for r in backwards] == [None, -100.0, -200.0]
    assert "-954.93, -1909.86 rpm one after the other would do" in backwards[0].cure
    # What the lines show of one record is no speed of all.
    shown = [r for r in found if "which the data show" in r.says]
    assert {r.term for r in shown} == {"speed[0]", "speed[1]"}
    assert {round(abs(r.value) / (2 * np.pi)) for r in shown} == {20, 30}


def test_a_record_that_stood_still_may_have_turned() -> None:
    found = speeds_of(estimated(jeffcott((0.0, 200.0), frequency=(10.0, 20.0, 30.0))))
    still = [r.value / (2 * np.pi) for r in found if r.term == "speed[0]"]
    assert still == pytest.approx([10, -10, 30, -30, 20, -20])


def test_speeds_are_asked_of_the_four_records_that_fit_worst() -> None:
    case = estimated(jeffcott((100.0,) * 6), costs=(1.0, 6.0, 2.0, 5.0, 4.0, 3.0))
    asked = {r.term for r in speeds_of(case)} - {"speed"}
    assert asked == {f"speed[{k}]" for k in (1, 3, 4, 5)}


def with_sensors(case, names):
    """Return the case with so many sensors of one unit, and no input."""
    term = SimpleNamespace(coordinate=0)
    case.records[0].lines.names = names
    case.records[0].direct = [
        SimpleNamespace(channel=SimpleNamespace(name=name, unit="m"), order=0, terms=[term])
        for name in names
    ]
    return case


@pytest.mark.parametrize(("channels", "swaps"), [(8, 28), (9, 8)])
def test_swaps_of_many_like_channels_are_those_of_neighbours(channels, swaps) -> None:
    case = with_sensors(jeffcott(), tuple(f"x{k}" for k in range(channels)))
    found = [r for r in entered("single", case) if len(r.on) == 2]
    assert len(found) == swaps


@pytest.mark.parametrize(("times", "unlike"), [(4.9, False), (5.1, True), (1 / 5.1, True)])
def test_a_channel_unlike_the_others_of_its_kind(times, unlike) -> None:
    case = with_sensors(jeffcott(sizes=(1.0, 1.0, times)), ("a", "b", "c"))
    starts = {r.on[0]: r.added.scalars[0].start for r in entered("factor", case)}
    assert starts == pytest.approx({"a": 1.0, "b": 1.0, "c": 1 / times if unlike else 1.0})


@pytest.mark.parametrize(("harmonics", "held"), [((1, 7, 14), "2"), ((7, 21), "3"), ((1, 7), "")])
def test_runout_is_suspected_where_a_line_holds_it(demo, harmonics, held) -> None:
    """Of metres it would explain any misfit, by what leaks of it onto other lines."""
    lines = rid.Lines.of_periods(demo.record())
    assert lines.speed[0] == pytest.approx(2 * np.pi * 140)  # seven times 20 Hz
    clock = replace(lines.clock, harmonics=np.array(harmonics))
    record = bind(demo.model, replace(lines, clock=clock))
    case = SimpleNamespace(
        records=(record,), prepared=SimpleNamespace(layout=SimpleNamespace(index={}))
    )
    found = {r.term for r in entered("channel", case) if "order" in r.term}
    assert {term[-2] for term in found} == set(held)
