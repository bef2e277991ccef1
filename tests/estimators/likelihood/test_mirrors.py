"""Answers that fit as well by a symmetry of the equations: found, told, and no false alarm."""

from dataclasses import replace
from itertools import product, takewhile
from types import SimpleNamespace

import numpy as np
import pytest
from bank import agrees, steady
from model_text import model_text

import rotorid as rid
from rotorid import Constraint, MaximumLikelihood, Plan, identify, predict_accuracy
from rotorid.likelihood import symmetric_answers as mirrors
from rotorid.likelihood.fit import _problem
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.symmetric_answers import Link, Mirrors, Web, exchanged
from rotorid.likelihood.unknowns import unknowns_of
from rotorid.testing import bind

OVERHUNG = model_text(
    "A disc beside its shaft's end, which bends with it",
    [
        "m*x'' + c*x' + k*x + kc*theta_y = F_x + Omega^2*(ux*cos(phi) - uy*sin(phi))",
        "m*y'' + c*y' + k*y - kc*theta_x = Omega^2*(ux*sin(phi) + uy*cos(phi))",
        "0.05*theta_x'' + ct*theta_x' + I_p*Omega*theta_y' + kt*theta_x - kc*y = 0",
        "0.05*theta_y'' + ct*theta_y' - I_p*Omega*theta_x' + kt*theta_y + kc*x = 0",
    ],
    "x m, y m, theta_x rad, theta_y rad",
    "F_x N",
    "m 5.0 kg, I_p 0.08 kg m^2, c 20.0 N s/m, ct 0.2 N m s, k 2e5 N/m, kt 3000.0 N m, "
    "kc -1.5e4 N, ux 4e-5 kg m, uy 2e-5 kg m",
)
WINGS = model_text(
    "A body between two wings",
    [
        "m1*x1'' + c1*x1' + k1*(x1 - x2) = 0",
        "m2*x2'' + c2*x2' + k2*x2 + k1*(x2 - x1) + k3*(x2 - x3) = F",
        "m3*x3'' + c3*x3' + k3*(x3 - x2) = 0",
    ],
    "x1 m, x2 m, x3 m",
    "F N",
    "m1 +1.0 kg, c1 +8.0 N s/m, k1 +2e5 N/m, m2 +3.0 kg, c2 +20.0 N s/m, k2 +3e5 N/m, "
    "m3 +0.6 kg, c3 +5.0 N s/m, k3 +3e5 N/m",
)
DISC, BODY = rid.parse_model(OVERHUNG), rid.parse_model(WINGS)
LINES = tuple(range(1, 30))
HERTZ = 50.0


def record_of(model, sensors, hertz=0.0, seed=0, silent=False):
    rng, loud = np.random.default_rng(seed), not silent
    forces = loud * 2.5 * np.exp(2j * np.pi * rng.random((len(LINES), len(model.inputs))))
    names = [each if isinstance(each, str) else each.name for each in sensors]
    noise = dict.fromkeys(names, 2e-8) | dict.fromkeys(model.inputs, 0.02 * loud)
    return steady(model, {}, forces, LINES, hertz=hertz, sensors=sensors, noise=noise, rng=rng)


def mirrors_of(model, records, estimator=None):
    """Return the problem of some records, and its symmetries at the nominal values."""
    chosen = estimator or MaximumLikelihood()
    bound = tuple(bind(model, record) for record in records)
    nuisances = unknowns_of(bound, chosen)
    prepared = prepare(model, chosen.knowledge(model), nuisances, False, model.nominal)
    problem = _problem(prepared, bound)
    return problem, Mirrors.of(problem, bound, prepared.layout.start)


def at_start(problem):
    return mirrors.Solution(problem.at(problem.layout.start), True, 0)


@pytest.fixture(scope="module")
def overhung():
    return record_of(DISC, ["x", "y"], HERTZ)


@pytest.fixture(scope="module")
def wings():
    return record_of(BODY, ["x2"])


def test_a_sign_that_no_record_tells_is_that_of_the_start(overhung):
    told = (
        "no record tells the sign of kc: that of its start is taken; "
        "a sensor of theta_x or theta_y would tell; "
        "where physics tells, positive = true in the model says so"
    )
    costs = []
    for start, sign in ((-1.6e4, -1.0), (1.6e4, 1.0)):
        found = identify(DISC, overhung, MaximumLikelihood(start={"kc": start}))
        assert found.status == "ok"
        assert found.value("kc") == pytest.approx(sign * 1.5e4, abs=5 * found.std("kc"))
        assert told in found.warnings
        assert found.alternatives == ()
        costs.append(found.misfit.cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-6)


def test_the_mirror_image_is_turned_to_the_start(overhung, monkeypatch):
    # A search that ended in the mirror image, as noisy records make it.
    plain = identify(DISC, overhung, MaximumLikelihood(start={"kc": -1.6e4}))
    nominal = mirrors.Mirrors._agreement
    monkeypatch.setattr(
        mirrors.Mirrors, "_agreement", lambda self, x: lambda turn: -nominal(self, x)(turn)
    )
    turned = identify(DISC, overhung, MaximumLikelihood(start={"kc": -1.6e4}))
    assert turned.value("kc") == pytest.approx(-plain.value("kc"), rel=1e-9)
    assert turned.std("kc") == pytest.approx(plain.std("kc"), rel=1e-6)
    assert turned.misfit.cost == pytest.approx(plain.misfit.cost, rel=1e-9)
    names = [value.name for value in plain.free]
    sign = np.where(np.array(names) == "kc", -1.0, 1.0)
    scale = np.array([plain.std(name) for name in names])
    size, back = np.outer(scale, scale), turned.covariance * np.outer(sign, sign)
    np.testing.assert_allclose(back / size, plain.covariance / size, atol=1e-6)


def test_a_sensor_a_prior_or_the_model_tells_a_sign(overhung):
    tilted = record_of(DISC, ["x", "y", "theta_x"], HERTZ)
    positive = OVERHUNG.replace("nominal = -1.5e4", "nominal = 1.5e4, positive = true")
    assert mirrors_of(DISC, [tilted])[1].turns == ()
    assert mirrors_of(rid.parse_model(positive), [overhung])[1].turns == ()
    for more, turns in ((15.2, 0), (14.8, 1)):  # misfit of the other sign
        known = MaximumLikelihood(known={"kc": (-1.5e4, 3e4 / np.sqrt(more))})
        assert len(mirrors_of(DISC, [overhung], known)[1].turns) == turns
    both = MaximumLikelihood(constraints=(Constraint("kc - 3*m", -15015.0),))
    assert mirrors_of(DISC, [overhung], both)[1].turns == ()


def test_a_bound_tells_a_sign(overhung):
    found = identify(DISC, overhung, MaximumLikelihood(bounds={"kc": (None, 0.0)}))
    assert found.status == "ok"
    assert not [w for w in found.warnings if "sign" in w]


def test_two_signs_of_which_the_start_has_one_are_both_answers():
    # kd couples back to y what kc couples to theta: only their product is told.
    text = OVERHUNG.replace("- kc*y = 0", "- kd*y = 0").replace("+ kc*x = 0", "+ kd*x = 0")
    text += 'kd = { unit = "N", nominal = -1.5e4 }\n'
    model = rid.parse_model(text)
    record = record_of(model, ["x", "y"], HERTZ)
    knowledge = {"kd": (-1.5e4, 1.5e4), "kc": (-1.5e4, 1.5e4)}
    problem, found = mirrors_of(model, [record], MaximumLikelihood(known=knowledge))
    (turn,) = found.turns
    assert {problem.layout.unknowns[i].name for i in turn.turned} == {"kc", "kd"}
    x = problem.layout.start.copy()
    x[problem.layout.index["kd"]] *= -1
    solution = mirrors.Solution(problem.at(x), True, 0)
    assert found.as_started(solution) is solution


EXCHANGED = {"m1": 0.6, "k1": 3e5, "c1": 5.0, "m3": 1.0, "k3": 2e5, "c3": 8.0}


def test_wings_may_change_places_from_every_start(wings):
    for start in ({}, EXCHANGED):
        found = identify(BODY, wings, MaximumLikelihood(start={**BODY.nominal, **start}))
        assert found.status == "not_identifiable"
        (other,) = found.alternatives
        assert other.cost == pytest.approx(found.misfit.cost, rel=1e-9)
        values = dict(other.parameters)
        for a, b in (("m1", "m3"), ("c1", "c3"), ("k1", "k3")):
            assert values[a] == pytest.approx(found.value(b), rel=1e-9)
            assert values[b] == pytest.approx(found.value(a), rel=1e-9)
        told = "cure: m1, c1 and k1 may change places with m3, c3 and k3"
        assert any(told in w for w in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize(
    "cure",
    [
        {"bounds": {"m1 - m3": (0.0, None)}},
        {"known": {"m1": (1.0, 0.05)}},
        {"known": {"k3": (3e5, 1e4)}},
        {"fixed": {"k1": 2e5}},
    ],
)
def test_what_is_told_as_a_cure_cures(wings, cure):
    told = {**cure.get("known", {}), **cure.get("fixed", {})}
    start = {name: value for name, value in EXCHANGED.items() if name not in told}
    agrees(identify(BODY, wings, MaximumLikelihood(start=start, **cure)), BODY.nominal, 5)


@pytest.mark.parametrize(("fixed", "tried"), [({}, False), ({"k1": 2e5}, True)])
def test_hidden_parts_change_places_before_the_search_only_where_something_known_does(
    wings, fixed, tried
):
    spectra = wings.spectra.copy()
    spectra[:, ::2] *= [1.0, 1.1]  # every other line of the sensor: no machine explains that
    search = MaximumLikelihood(fixed=fixed).search(BODY, [replace(wings, spectra=spectra)])
    said = {step.say for step in takewhile(lambda step: "mistakes" not in step.say, search)}
    assert "trying further starts" in said
    assert ("trying hidden parts in other places" in said) == tried


def test_a_value_that_is_hardly_known_does_not_tell_the_places(wings):
    found = identify(BODY, wings, MaximumLikelihood(known={"m1": (1.0, 0.5)}))
    assert found.status == "not_identifiable"
    assert any("may change places" in w for w in found.warnings)


def test_a_plan_tells_what_it_will_not_tell():
    plan = Plan([[1.0]] * 19, range(1, 20), 10.0, 1000.0, 50, {"F": 1e-2, "x2": 1e-8})
    for sensors, status in ((["x2"], "not_identifiable"), (["x2", "x1"], "ok")):
        found = predict_accuracy(BODY, replace(plan, sensors=sensors))
        assert found.status == status
        assert len(found.alternatives) == (status != "ok")
    plan = replace(plan, noise={"F_x": 1e-2}, speed=2 * np.pi * HERTZ, sensors=["x", "y"])
    assert any("sign of kc" in w for w in predict_accuracy(DISC, plan).warnings)


def test_natural_frequencies_do_not_tell_wings_apart():
    modes = tuple(rid.Mode(hz, 0.1) for hz in (40.0, 80.0, 130.0))
    problem, found = mirrors_of(BODY, [], MaximumLikelihood(modes=modes))
    start = problem.layout.start
    (exchange,) = [each for each in found.exchanges if each.places[0] == 6]
    assert problem.at(start).cost > 1
    assert problem.at(exchange.of(start)).cost == pytest.approx(problem.at(start).cost, rel=1e-9)


def test_a_sensor_of_a_wing_cures():
    assert identify(BODY, record_of(BODY, ["x2", "x1"]), MaximumLikelihood()).status == "ok"
    # A sensor of both alike tells nothing.
    channel = rid.Channel("sum", "m", reads={"x1": 0.5, "x2": 1.0, "x3": 0.5})
    _, found = mirrors_of(BODY, [record_of(BODY, [channel])])
    assert len(found.exchanges) == 1


def test_numbers_in_the_equations_go_with_the_places():
    text = WINGS.replace("nominal = 0.6", "nominal = 1.0").replace("nominal = 5.0", "nominal = 8.0")
    text = text.replace('k3 = { unit = "N/m", nominal = 3e5', 'k3 = { unit = "N/m", nominal = 2e5')
    text = text.replace("k3*", "2*k3*").replace("m3*", "2*m3*").replace("c3*", "2*c3*")
    model = rid.parse_model(text)
    problem, found = mirrors_of(model, [record_of(model, ["x2"])])
    (exchange,) = found.exchanges
    np.testing.assert_allclose(exchange.factors, [0.5] * 3 + [1] * 3 + [2] * 3, rtol=1e-9)
    told = exchanged(problem.layout, exchange, problem.layout.start)
    assert "expression = 'm1 - 2*m3', min or max = '0 kg'" in told


def test_fixed_wings_stay_where_they_are(wings):
    assert mirrors_of(BODY, [wings], MaximumLikelihood(fixed={"m1": 1.0}))[1].exchanges == ()


FLYING = model_text(
    "A shaft with a wheel at either end, seen at its middle",
    [
        "m1*x1'' + k1*(x1 - x + L1*theta) = 0",
        "M*x'' + k1*(x - x1 - L1*theta) + k3*(x - x3 + L3*theta) = F",
        "J*theta'' + k1*L1*(L1*theta + x1 - x) + k3*L3*(L3*theta + x - x3) = 0",
        "m3*x3'' + k3*(x3 - x - L3*theta) = 0",
    ],
    "x1 m, x m, theta rad, x3 m",
    "F N",
    "m1 +1.0 kg, k1 +2e5 N/m, L1 +0.3 m, M +3.0 kg, J +0.05 kg m^2, k3 +3e5 N/m, "
    "L3 +0.2 m, m3 +0.6 kg",
)


@pytest.mark.parametrize(("text", "sensor"), [(WINGS, "x2"), (FLYING, "x")])
def test_exchanges_cost_the_same_and_nothing_else_does(text, sensor):
    # FLYING: the tilt turns its sign while the ends change places.
    model = rid.parse_model(text)
    problem, found = mirrors_of(model, [record_of(model, [sensor])])
    (exchange,) = found.exchanges
    rng = np.random.default_rng(5)
    x = problem.layout.start * (1 + 0.05 * rng.uniform(-1, 1, len(problem.layout.start)))
    cost = problem.at(x).cost
    assert problem.at(exchange.of(x)).cost == pytest.approx(cost, rel=1e-9)
    pairs = [(i, j) for i, j in enumerate(exchange.places) if i < j]
    for chosen in product((False, True), repeat=len(pairs)):
        if all(chosen) or not any(chosen):
            continue
        y = x.copy()
        for (i, j), swapped in zip(pairs, chosen, strict=True):
            if swapped:
                y[[i, j]] = x[[j, i]]
        assert abs(problem.at(y).cost / cost - 1) > 1e-6
    assert "may change places" in exchanged(problem.layout, exchange, problem.layout.start)


def drawn(rng):
    """Return a machine of springs and levers whose couplings may have any sign."""
    n = int(rng.integers(2, 5))
    names = [f"q{i}" for i in range(n)]
    rows = [f"m{i}*{q}'' + d*{q}' + k{i}*{q}" for i, q in enumerate(names)]
    parameters = {f"m{i}": rng.uniform(0.5, 2) for i in range(n)}
    parameters |= {f"k{i}": rng.uniform(1e5, 4e5) for i in range(n)} | {"d": 30.0}
    for i in range(n):
        for j in range(i):
            if i - j == 1 or rng.random() < 0.5:
                name = f"s{rng.integers(3)}"
                parameters[name] = rng.choice([-1, 1]) * rng.uniform(2e4, 5e4)
                rows[i] += f" + {name}*{names[j]}"
                rows[j] += f" + {name}*{names[i]}"
    rows[0] += " - F"
    told = {name: f"{float(value)!r} 1" for name, value in parameters.items()}
    equations = [f"{row} = 0" for row in rows]
    return model_text("drawn", equations, dict.fromkeys(names, "m"), "F N", told), names


@pytest.mark.parametrize("seed", range(12))
def test_turns_of_drawn_machines_are_all_that_cost_the_same(seed):
    rng = np.random.default_rng(seed)
    text, names = drawn(rng)
    model = rid.parse_model(text)
    read = [name for name in names if rng.random() < 0.3] or [names[0]]
    problem, found = mirrors_of(model, [record_of(model, read)])
    layout = problem.layout
    x = layout.start * (1 + 0.03 * rng.uniform(-1, 1, len(layout.start)))
    cost = problem.at(x).cost
    signed = [i for i, u in enumerate(layout.unknowns) if u.name.startswith("s")]
    turned = {frozenset(): True}
    for turn in found.turns:
        turned |= {frozenset(turn.turned) ^ other: True for other in turned}
    for signs in product((1.0, -1.0), repeat=len(signed)):
        y = x.copy()
        y[signed] *= signs
        which = frozenset(i for i, sign in zip(signed, signs, strict=True) if sign < 0)
        same = abs(problem.at(y).cost / cost - 1) < 1e-9
        assert same == (which in turned), (text, read, which)


def test_a_lever_in_squares_is_turned_to_its_start_and_not_told():
    text = OVERHUNG.replace("kt*", "2*L^2*k*").replace("kt = ", "L = ")
    text = text.replace('"N m", nominal = 3000.0', '"m", nominal = 0.087')
    model = rid.parse_model(text)
    problem, found = mirrors_of(model, [record_of(model, ["x", "y", "theta_x", "theta_y"], HERTZ)])
    (turn,) = found.turns
    assert turn.coordinates == ()
    assert [problem.layout.unknowns[i].name for i in turn.turned] == ["L"]
    start = problem.layout.start
    solution = mirrors.Solution(problem.at(turn.of(start)), True, 0)
    assert (found.as_started(solution).point.unknowns == start).all()


@pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("jeffcott", ["x"]),
        ("rigid", ["x", "y"]),
        ("three-mass", ["x1", "y1", "x3", "y3"]),
        ("three-mass", ["x1", "y1"]),
    ],
)
def test_shipped_models_have_no_symmetry_with_their_usual_sensors(name, sensors):
    model = rid.load_model(name)
    _, found = mirrors_of(model, [record_of(model, sensors, 48.0)])
    assert (found.turns, found.exchanges) == ((), ())


def test_ends_in_passive_bearings_change_places():
    # Forces tell the ends of the three-mass rotor; without them a sensor in the middle does not.
    model = rid.load_model("three-mass")
    records = [record_of(model, ["x2", "y2"], 48.0, silent=silent) for silent in (False, True)]
    assert mirrors_of(model, records[:1])[1].exchanges == ()
    problem, found = mirrors_of(model, records[1:])
    (exchange,) = found.exchanges
    told = exchanged(problem.layout, exchange, problem.layout.start)
    assert told.startswith("m1, k1 and L1 may change places with m3, k2 and L2")
    x = problem.layout.start * np.linspace(0.97, 1.03, len(problem.layout.start))
    cost = problem.at(x).cost
    assert problem.at(exchange.of(x)).cost == pytest.approx(cost, rel=1e-9)


def test_a_sign_within_its_deviation_is_not_told(overhung):
    problem, found = mirrors_of(DISC, [overhung])
    solution = at_start(problem)
    count = len(problem.layout.free)
    for deviations, told in ((4.9, 0), (5.1, 1)):  # between kc and -kc
        linear = SimpleNamespace(undetermined=np.zeros(count, dtype=bool))
        inference = SimpleNamespace(std=np.full(count, 3e4 / deviations), linear=linear)
        assert len(list(found.notes(solution, inference))) == told
    inference.linear.undetermined[:] = True
    assert not list(found.notes(solution, inference))


def test_an_image_is_settled_only_where_it_costs_something_else(overhung, monkeypatch):
    problem, found = mirrors_of(DISC, [overhung])
    solution = at_start(problem)
    settled = []
    monkeypatch.setattr(mirrors, "settle", lambda *at: settled.append(at) or solution)
    cost = solution.point.cost
    assert found._image(solution, found.turns[0]).point.cost == pytest.approx(cost, rel=1e-9)
    assert settled == []
    for above, count in ((2e-9, 1), (0.5e-9, 1), (149.0, 2), (151.0, 2)):
        image = SimpleNamespace(cost=cost + above * (cost if above < 1 else 1.0))
        monkeypatch.setattr(type(problem), "at", lambda *_, image=image: image)
        found._image(solution, found.turns[0])
        assert len(settled) == count


def test_six_turns_are_combined_and_seven_are_not(overhung):
    problem, _ = mirrors_of(DISC, [overhung])
    for count, every in ((6, 63), (7, 7)):
        turns = tuple(mirrors.Symmetry((), np.ones(count)) for _ in range(count))
        assert len(list(Mirrors(problem.layout, turns)._every_turn())) == every


def test_places_of_many_records_are_searched_in_the_first(wings, monkeypatch):
    records = [wings, record_of(BODY, ["x2", "x1"])]
    terms = 17  # of the first record: 8 of the wings, 7 of the body, its force, its sensor
    problem, found = mirrors_of(BODY, records)
    assert found.exchanges == ()
    for most, count in ((terms, 1), (terms - 1, 0)):
        monkeypatch.setattr(mirrors, "LARGE", most)
        problem, found = mirrors_of(BODY, records)
        assert len(found.exchanges) == count
        assert found.images(at_start(problem)) == []


@pytest.mark.parametrize(("count", "told"), [(3000, [()]), (3001, [(), (3000,)])])
def test_places_are_searched_among_three_thousand_terms(overhung, monkeypatch, count, told):
    problem, _ = mirrors_of(DISC, [overhung])
    asked = []

    def web(*given):
        asked.append(given[4:])
        return SimpleNamespace(links=[None] * count)

    monkeypatch.setattr(mirrors, "_web", web)
    monkeypatch.setattr(mirrors, "_turns", lambda *_: ())
    monkeypatch.setattr(mirrors, "_exchanges", lambda *_: ())
    Mirrors.of(problem, (), problem.layout.start)
    assert asked == told


# Places in a web that is made by hand.


def wings_web(second=1.0):
    """Return two wings of a body: masses 0 and 1, springs 2 and 3, rows 4 to 6, columns 7 to 9.

    Node 10 is the sensor of the body. The coefficient of the second spring is given.
    """
    links = [Link("sensor", 10, 9, (), 1.0)]
    for wing, size in ((0, 1.0), (1, second)):
        row, column, mass, spring = 4 + wing, 7 + wing, wing, 2 + wing
        links += [
            Link(2, row, column, (mass,), -1.0),
            Link(0, row, column, (spring,), size),
            Link(0, row, 9, (spring,), -size),
            Link(0, 6, column, (spring,), -size),
            Link(0, 6, 9, (spring,), size),
        ]
    colours = ["m", "m", "k", "k", "row", "row", "row", "q", "q", "q", "alone"]
    return Web(tuple(links), colours, {10})


def test_what_takes_too_long_is_left(monkeypatch):
    monkeypatch.setattr(mirrors, "EFFORT", 0)
    assert list(wings_web().exchanges([0, 1, 2, 3])) == []


def test_coefficients_are_one_number_to_ten_digits():
    for off, same in ((0.9e-8, True), (1.2e-8, False)):
        web = wings_web(second=1 + off)
        (places,) = web.exchanges([0, 1, 2, 3])
        assert (web.followed(places, dict.fromkeys(range(11), 1.0)) is not None) == same
