"""What is assumed: each entry against a record in which it is wrong, and how it is told."""

from dataclasses import replace

import numpy as np
import pytest
from bank import steady
from coast_down import KNOWN, RPM, TRIAL, coast
from coast_down import MODEL as COAST_DOWN
from coast_down import TRUTH as COAST
from model_text import model_text

import rotorid as rid
from rotorid import Estimate, MaximumLikelihood, Note, identify, load_model
from rotorid.demo import demo_plan
from rotorid.likelihood import assumptions, doubts
from rotorid.models.structure import find_structure
from rotorid.testing import add_noise, phasor_lines

MODEL = load_model("three-mass")
COASTING = rid.parse_model(COAST_DOWN)
PLAN = demo_plan(MODEL)
TRUTH = MODEL.nominal
SENSORS = ("x1", "y1", "x3", "y3")
MASS = sum(TRUTH[name] for name in ("m1", "m2", "m3"))
CONSTRAINED = rid.Constraint("m1 + m2 + m3", MASS)


def measured(forces=PLAN.forces, periods=PLAN.periods):
    lines = PLAN.harmonics, PLAN.fundamental, PLAN.sample_rate, periods
    return steady(MODEL, TRUTH, forces, *lines, hertz=140.0, sensors=SENSORS)


RECORD = add_noise(measured(), PLAN.noise, np.random.default_rng(7))
LINES = dict(zip(RECORD.names, np.asarray(RECORD.spectra).mean(axis=0).T, strict=True))


def answer(record=RECORD, **given) -> Estimate:
    given = {"fixed": {"L1": TRUTH["L1"]}, **given}
    start = {name: value for name, value in TRUTH.items() if name not in given["fixed"]}
    return identify(MODEL, record, MaximumLikelihood(start=start, **given))


@pytest.fixture(scope="module")
def fitted():
    """Return the answer of the record as it is, what is assumed of it, and the fit."""
    kept = []
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(doubts, "assumed", lambda found, fit: kept.append(fit) or found)
        found = answer(constraints=(CONSTRAINED,))
    return found, list(assumptions.assumptions(kept[0])), kept[0]


def with_errors(errors: dict[str, np.ndarray]):
    """Return the record with errors on the lines of some channels."""
    added = np.stack([errors.get(n, 0.0 * LINES[n]) for n in RECORD.names], axis=1)
    return replace(RECORD, spectra=np.asarray(RECORD.spectra) + added)


def turned(forces, angle):
    """Return what the sensors read besides, with the magnet of F_x1 turned toward y."""
    shares = np.asarray(forces).astype(complex)
    more = np.zeros_like(shares)
    more[:, MODEL.inputs.index("F_y1")] = angle * shares[:, MODEL.inputs.index("F_x1")]
    there, here = (np.asarray(measured(f).spectra).mean(axis=0) for f in (shares + more, shares))
    return {n: (there - here)[:, RECORD.names.index(n)] for n in SENSORS}


def casing(natural):
    """Return what the sensors read besides on a casing of 50 rotors' mass, by its own motion."""
    omega, found = 2 * np.pi * np.asarray(RECORD.frequency), {}
    give = 1 / (natural**2 - omega**2 + 0.1j * natural * omega)
    for axis in "xy":
        moved = -give * (LINES[f"F_{axis}1"] + LINES[f"F_{axis}3"]) / (50 * MASS)
        found |= {f"{axis}{place}": -moved for place in (1, 3)}
    return found


def small(errors, by=0.05):
    return {name: by * lines for name, lines in errors.items()}


@pytest.mark.parametrize(
    ("about", "size", "error", "errors"),
    [
        ("cross-talk", "0.1 %", 0, {"x1": 1e-3 * LINES["y1"]}),
        ("cross-talk", "0.1 %", 2, {"y1": 1e-3 * LINES["x3"]}),
        ("axes", "0.1 deg", 1, {"y1": np.radians(0.1) * LINES["x1"]}),
        ("axes", "0.1 deg", 4, turned(PLAN.forces, np.radians(0.1))),
        ("ground", "50 rotor masses, free", 0, casing(0.0)),
        ("ground", "50 rotor masses, on mounts of 8 Hz", 0, casing(2 * np.pi * 8)),
    ],
)
def test_an_error_moves_the_answer_as_its_column_says(fitted, about, size, error, errors):
    found, every, fit = fitted
    (one,) = (each for each in every if (each.about, each.size) == (about, size))
    said = -fit.solution.point.linear.taken(one.effect[:, error])
    other = answer(with_errors(small(errors)), constraints=(CONSTRAINED,))
    names = fit.layout.names()
    moved = np.array([other.value(n) - found.value(n) for n in names]) / 0.05
    std = fit.inference.std
    sign = np.sign(said @ (moved / std**2))  # a turn may be to either side
    np.testing.assert_allclose(sign * said / std, moved / std, atol=0.02, rtol=0.02)
    assert np.abs(moved / std).max() > 0.2


def test_a_value_that_is_held_and_a_relation_move_the_answer_as_their_columns_say(fitted):
    found, every, fit = fitted
    by = {one.about: one for one in every}
    names, linear, std = fit.layout.names(), fit.solution.point.linear, fit.inference.std
    longer = answer(fixed={"L1": 1.0005 * TRUTH["L1"]}, constraints=(CONSTRAINED,))
    heavier = answer(constraints=(rid.Constraint("m1 + m2 + m3", 1.0005 * MASS),))
    for about, other in (("L1", longer), ("m1 + m2 + m3", heavier)):
        one = next(one for name, one in by.items() if name.startswith(about))
        said = (one.step - linear.taken(one.effect))[:, 0]
        moved = np.array([other.value(n) - found.value(n) for n in names]) / 0.05
        np.testing.assert_allclose(said / std, moved / std, atol=0.02, rtol=0.02)
        assert np.abs(moved / std).max() > 5


def test_a_trial_mass_beside_its_place_moves_the_answer_as_its_columns_say(monkeypatch):
    kept = []
    monkeypatch.setattr(doubts, "assumed", lambda found, fit: kept.append(fit) or found)

    speed, channels = RPM * np.pi / 30, [rid.Channel("x", "m"), rid.Channel("y", "m")]

    def turned_by(trial: complex, **stated) -> Estimate:
        plain, other = (phasor_lines(channels, speed, coast(RPM, at), 1e-6) for at in (0, trial))
        known = {"t_x": TRIAL.real, "t_y": TRIAL.imag, **stated}
        records = [plain, other.with_parameters(**known)]
        return identify(COASTING, records, MaximumLikelihood(fixed=KNOWN))

    found, every = turned_by(TRIAL), list(assumptions.assumptions(kept[0]))
    one, two = [
        next(each.effect for each in every if each.about == about)
        for about in ("trial mass[1]", "unbalance[1]")
    ]
    assert not any(each.about.startswith("t_") for each in every)
    said = -kept[0].solution.point.linear.taken(np.column_stack([one, two]))
    names, std = kept[0].layout.names(), kept[0].inference.std
    moved = 0.01 * abs(TRIAL)  # of the rotor's own, along x and y
    errors = (0.01 * TRIAL, np.radians(2.0) * 1j * TRIAL, moved, 1j * moved)
    for column, error in zip(said.T, errors, strict=True):
        other = turned_by(TRIAL - 0.01 * error)
        moved = np.array([other.value(n) - found.value(n) for n in names]) / 0.01
        np.testing.assert_allclose(column / std, moved / std, atol=0.05, rtol=0.02)
        assert np.abs(moved / std).max() > 1
    # Weighed well, the rotor's own unbalance may have moved all the same.
    turned_by(TRIAL, t_x=(TRIAL.real, 1e-9), t_y=(TRIAL.imag, 1e-9))
    about = {each.about for each in assumptions.assumptions(kept[-1])}
    assert "unbalance[1]" in about
    assert "trial mass[1]" not in about


def test_stiffness_that_follows_the_speed_passes_for_mass_between_the_speeds_of_a_table():
    speed, channels = RPM * np.pi / 30, [rid.Channel("x", "m"), rid.Channel("y", "m")]
    # 10 % more at the highest speed: k(Omega) - m Omega^2 is k - (m - seal) Omega^2.
    seal = 0.1 * COAST["k"] / speed.max() ** 2

    def seen(**known) -> Estimate:
        tables = []
        for trial in (0.0, TRIAL):
            bare = coast(RPM, trial)[:, 0]
            whirl = bare / (1 + bare * seal / (COAST["u_x"] + 1j * COAST["u_y"] + trial))
            found = np.column_stack([whirl, -1j * whirl])
            tables.append(phasor_lines(channels, speed, found, 2e-7))
        records = [tables[0], tables[1].with_parameters(t_x=TRIAL.real, t_y=TRIAL.imag)]
        return identify(COASTING, records, MaximumLikelihood(fixed={**KNOWN, **known}))

    found = seen()
    assert found.verdict == "ok under assumptions"
    (told,) = [one for one in found.assumptions if one.assumed == "k over the speed"]
    off = found.value("m") - COAST["m"]
    assert off == pytest.approx(-seal, rel=0.05)
    assert abs(off) > 5 * found.std("m")
    assert next(v.std_assumed for v in found.parameters if v.name == "m") > 0.9 * abs(off)
    assert told.cure.startswith("weigh the rotor")
    assert seen(m=COAST["m"]).status == "rejected"  # as it says


def bowed(bow: complex) -> Estimate:
    """Return the answer of two tables of a shaft that is bent by `bow` at its disc."""
    speed, channels, tables = RPM * np.pi / 30, [rid.Channel("x", "m"), rid.Channel("y", "m")], []
    for trial in (0.0, TRIAL):
        unbalance = COAST["u_x"] + 1j * COAST["u_y"] + trial
        more = 1 + COAST["k"] * bow / (unbalance * speed**2)
        found = coast(RPM, trial) * more[:, None]
        tables.append(phasor_lines(channels, speed, found, 2e-7))
    records = [tables[0], tables[1].with_parameters(t_x=TRIAL.real, t_y=TRIAL.imag)]
    return identify(COASTING, records, MaximumLikelihood(fixed=KNOWN))


def test_a_bow_passes_for_unbalance_until_the_speeds_tell_them_apart(monkeypatch):
    far = bowed(2e-6 - 1e-6j)
    assert far.status == "rejected"
    assert far.suspects[0].term == "bow at x, y"
    assert far.suspects[0].value == pytest.approx(np.hypot(2e-6, 1e-6), rel=0.05)
    kept = []
    monkeypatch.setattr(doubts, "assumed", lambda found, fit: kept.append(fit) or found)
    straight, names = bowed(0.0), kept[0].layout.names()
    (bow,) = (one for one in assumptions.assumptions(kept[0]) if one.about == "bow")
    said = kept[0].solution.point.linear.taken(bow.effect)
    for column, way in zip(said.T, (1e-6, 1e-6j), strict=True):
        bent, std = bowed(0.01 * way), kept[0].inference.std
        moved = np.array([bent.value(n) - straight.value(n) for n in names]) / 0.01
        np.testing.assert_allclose(column / std, moved / std, atol=0.05, rtol=0.02)
        assert np.abs(moved / std).max() > 1


GYRO = rid.parse_model(
    model_text(
        "tilting rotor",
        ["I*a'' + I_p*Omega*b' = M_a", "I*b'' - I_p*Omega*a' = M_b"],
        "a rad, b rad",
        "M_a N m, M_b N m",
        "I 0.2 kg m^2, I_p 0.3 kg m^2",
    )
)


def tilted(hertz: float, model: rid.Model = GYRO, **changed) -> Estimate:
    """Return the answer of a rotor that is said to turn at 50 Hz and turns at `hertz`."""
    rng = np.random.default_rng(5)
    noise = {"M_a": 1e-3, "M_b": 1e-3, "a": 1e-7, "b": 1e-7}
    forces, harmonics = np.exp(1j * rng.uniform(0, 6, (6, 2))), [1, 3, 4, 7, 9, 12]
    record = steady(GYRO, {}, forces, harmonics, hertz=hertz, noise=noise, rng=rng)
    kept = [k for k, name in enumerate(record.names) if name in (*model.inputs, "a", "b")]
    parts = {"spectra": record.spectra, "mean": record.mean, "variance": record.variance}
    parts = {part: np.asarray(values)[..., kept] for part, values in parts.items()}
    parts["channels"] = tuple(record.channels[k] for k in kept)
    said = replace(record, speed=2 * np.pi * 50.0, **parts, **changed)
    return identify(model, said, MaximumLikelihood())


def test_a_slip_that_no_rotation_in_the_lines_shows_is_assumed_away(fitted):
    found, slow = tilted(50.0), tilted(49.5)
    (told,) = (one for one in found.assumptions if one.assumed == "speed")
    (moves,) = next(one for one in found.shifts if one.about == "speed").moves["I_p"]
    assert told.parameter == "I_p"
    assert slow.value("I_p") - found.value("I_p") == pytest.approx(moves, rel=0.02)
    assert told.moves == pytest.approx(0.01 * found.value("I_p") / found.std("I_p"), rel=0.02)
    for marked in (tilted(50.0, phase_std=1e-3), fitted[0]):  # a mark, or the unbalance seen
        assert "speed" not in {one.assumed for one in marked.assumptions}


TILT = ["I*a'' + I_p*Omega*b' = M_a", "I*b'' - I_p*Omega*a' = M_b"]
BOTH = "I*a'' + I*b'' + I_p*Omega*b' - I_p*Omega*a' = M_a + M_b"


@pytest.mark.parametrize(
    ("equations", "inputs", "verdict"),
    [
        (TILT[:1], "M_a N m", "ok under assumptions"),
        ([*TILT, BOTH], "M_a N m, M_b N m", "not_converged"),  # noise of rank two in three rows
    ],
)
def test_as_many_equations_as_there_are_are_asked(equations, inputs, verdict):
    values = "I 0.2 kg m^2, I_p 0.3 kg m^2"
    model = rid.parse_model(model_text("rotor", equations, "a rad, b rad", inputs, values))
    found = tilted(50.0, model)
    assert found.verdict == verdict
    for one in (one for one in found.shifts if one.about == "speed"):
        assert np.abs(one.moves["I_p"]) == pytest.approx(0.01 * found.value("I_p"), rel=0.02)


def test_one_ruler_scales_lengths_to_either_side():
    """A lever of -0.18 m is 1 % longer too, and so is the inertia: nothing else moves it."""
    equations = ["m*x'' = F_a + F_b", "I*th'' = L_a*F_a + L_b*F_b"]
    parameters = "m 9 kg, I 0.2 kg m^2, L_a -0.18 m, L_b 0.22 m"
    text = model_text("rotor", equations, "x m, th rad", "F_a N, F_b N", parameters)
    model, forces = rid.parse_model(text), [[4, 1j], [2, 3], [1 - 1j, 2]]
    noise = {"F_a": 0.01, "F_b": 0.01, "x": 1e-9, "th": 1e-9}
    record = steady(model, {}, forces, (1, 3, 5), noise=noise, rng=np.random.default_rng(1))
    found = identify(model, record, MaximumLikelihood(fixed={"L_a": -0.18, "L_b": 0.22}))
    (told,) = [one for one in found.assumptions if one.assumed == "all lengths"]
    assert told.parameter == "I"
    assert told.moves == pytest.approx(0.01 * found.value("I") / found.std("I"), rel=1e-3)


def test_gains_that_are_all_stated_are_not_assumed():
    """Beside forces that laws make, whose common scale is."""
    channels = [
        replace(c, gain_std=0.01, drive=rid.Drive(1.0, 0.0, {"x1": 1.0}) if c.unit == "N" else None)
        for c in RECORD.channels
    ]
    told = {one.assumed for one in answer(replace(RECORD, channels=tuple(channels))).assumptions}
    assert told
    assert "gain" not in told


@pytest.mark.parametrize(
    ("equations", "coordinates", "parameters", "mass"),
    [
        (["5*x'' + c*x' + k*x = F"], "x m", "c 3 N s/m, k 4e5 N/m", 5.0),
        (
            ["r*V*x'' + c*x' + k*x = F"],
            "x m",
            "r 8e3 kg/m^3, V 5e-4 m^3, c 3 N s/m, k 4e5 N/m",
            4.0,
        ),
        (
            ["m*x'' + k*(x - z) = F", "m*z'' + k*(z - x) + c*z' = 0"],
            "x m, z m",
            "m 2 kg, c 3 N s/m, k 4e5 N/m",
            4.0,
        ),
        (["m*x'' + k*x = F", "n*y'' + k*y = 0"], "x m, y m", "m 2 kg, n 3 kg, k 4e5 N/m", 2.0),
    ],
    ids=["a number", "a product", "two in one plane", "two planes that are unlike"],
)
def test_the_mass_that_a_casing_carries(equations, coordinates, parameters, mass):
    model = rid.parse_model(model_text("machine", equations, coordinates, "F N", parameters))
    structure = find_structure(model, model.values(model.nominal), 0.0)
    assert structure.mass == pytest.approx(mass)
    assert not structure.pairs


def test_what_is_zero_or_free_or_stated_with_a_deviation_is_not_held():
    def about(found):
        return {one.assumed for one in found.assumptions}

    assert "L1" in about(answer())
    known = answer(fixed={}, known={"L1": (TRUTH["L1"], 1e-4)})
    assert "L1" not in about(known)
    # A deviation of its own holds the error: the interval is as wide as the assumption said.
    assert known.std("L2") == pytest.approx(np.hypot(answer().std("L2"), 1e-4), rel=0.02)


def test_what_errors_may_do_is_the_root_of_the_sum_of_their_squares(fitted):
    _, every, fit = fitted
    found = answer(constraints=(CONSTRAINED,))
    worst = {}
    for one in every:
        worst[one.about] = np.maximum(worst.get(one.about, 0.0), one.moved(fit))
    total = np.sqrt(sum(np.square(list(worst.values()))))
    for name, expected in zip(fit.layout.names(), total, strict=True):
        assert found[name].std_assumed == pytest.approx(expected * found.std(name), rel=1e-6)


def test_first_stands_what_moves_a_parameter_most_of_all(fitted, monkeypatch):
    found, every, fit = fitted
    monkeypatch.setattr(assumptions.Assumed, "moved", lambda one, fit: one.step[:, 0])

    def moving(about: str, *by: float) -> assumptions.Assumed:
        """Return what moves the first unknowns by so many deviations, and no other."""
        step = np.pad(by, (0, len(fit.layout.free) - len(by)))[:, None]
        return replace(every[0], about=about, step=step)

    def order(*every: assumptions.Assumed) -> list[str]:
        monkeypatch.setattr(assumptions, "assumptions", lambda _: every)
        monkeypatch.setattr(assumptions, "contradicted", lambda *_: ())
        return [one.assumed for one in assumptions.assumed(found, fit).assumptions]

    far, other = moving("far", 60.0, 40), moving("other", 0, 0, 9)
    many = moving("many", 50, 39, 8, 1)
    assert order(many, other, far) == ["far", "other", "many"]
    assert order(moving("near", 59.0), far) == ["far", "near"]


@pytest.mark.parametrize(
    ("about", "moves", "told"),
    [("model", 4.9, False), ("model", 5.1, True), ("gain", 0.9, False), ("gain", 1.1, True)],
)
def test_from_how_many_deviations_on_an_assumption_is_told(fitted, monkeypatch, about, moves, told):
    found, every, fit = fitted
    one = next(one for one in every if one.about == about)
    # What the parameters take over whole is unseen, whatever its size.
    stiffness = fit.layout.names().index("k1")
    effect = moves * fit.inference.std[stiffness] * fit.solution.point.jacobian[:, [stiffness]]
    monkeypatch.setattr(
        assumptions, "assumptions", lambda _: [replace(one, effect=effect, errors=())]
    )
    said = assumptions.assumed(found, fit).assumptions
    assert [each.parameter for each in said] == ["k1"] * told


def test_where_nothing_is_free_nothing_is_moved():
    model = rid.parse_model(
        model_text("one", ["m*x'' + k*x = F"], "x m", "F N", "m 2 kg, k 8e4 N/m")
    )
    modes = (rid.Mode(31.83, 0.05),)
    found = identify(model, [], MaximumLikelihood(fixed=model.nominal, modes=modes))
    assert found.status == "ok"
    assert not found.assumptions


def noted(moves: float, *, doubtful: bool = False) -> Estimate:
    mass = rid.Value("m", "kg", 2.0, std=0.01, std_assumed=0.01 * moves)
    note = Note("gain", "assumes", "exact", "weigh it", ("m",), moves, "1", size="1 %")
    misfit = rid.Misfit(40.0, 10.0, 10, 1e-5 if doubtful else 0.5)
    return Estimate(
        "one", "ml", "ok", (mass,), covariance=np.array([[1e-4]]), misfit=misfit, notes=(note,)
    )


def test_the_verdict_rests_on_five_deviations():
    assert noted(4.9).verdict == "ok"
    assert noted(5.1).verdict == "ok under assumptions"
    assert noted(10.1, doubtful=True).verdict == "doubtful"
    assert str(noted(4.9)).startswith("one, ml: ok\n")
    first = "one, ml: ok under assumptions (gain: 1 % would shift m by 5.1 std)\n"
    assert str(noted(5.1)).startswith(first)
    assert noted(5.1).to_dict()["verdict"] == "ok under assumptions"
    (told,) = noted(5.1).to_dict()["assumptions"]
    expected = {"assumed": "gain", "size": "1 %", "parameter": "m", "moves": 5.1}
    assert told == {**expected, "cure": "weigh it"}


def test_the_table_tells_what_errors_may_do_and_the_text_the_three_largest(tmp_path):
    shown = str(noted(5.1))
    assert "m           2.000  0.010   0.50               0.051  kg" in shown
    found = answer()
    text = str(found)
    assert len(found.assumptions) > 3
    assert sum("std unseen" in line for line in text.splitlines()) == 3
    assert f"note, {len(found.assumptions) - 3} more assumptions" in text
    found.save(tmp_path / "run.json")
    again = rid.load_estimate(tmp_path / "run.json")
    assert again == found
    assert again.assumptions == found.assumptions
    assert str(again) == text


# What contradicts an assumption in one direction, which a misfit summed over all does not show.


def along(found: Estimate) -> Note | None:
    return next((note for note in found.notes if note.about == "direction"), None)


@pytest.mark.parametrize(("gain", "doubtful"), [(1.0, False), (1.0012, False), (1.0026, True)])
def test_a_gain_that_the_misfit_hides_is_seen_in_its_direction(gain, doubtful):
    record = with_errors({"x1": (gain - 1) * LINES["x1"]})
    found = answer(record)
    assert found.status == "ok"
    assert found.misfit.p_value > 1e-3
    told = along(found)
    assert (told is not None) == doubtful
    assert (found.verdict == "doubtful") == doubtful
    if told is not None:
        assert "gain[x1]" in told.on
        assert str(found).startswith(f"three-mass, ml: ok, but doubtful ({told.value:.2g} std off")
        # A free gain lies as many of its deviations from one.
        channels = [replace(c, gain_std=0.1 * (c.name == "x1")) for c in record.channels]
        free = answer(replace(record, channels=tuple(channels)))["gain[x1]"]
        assert told.value == pytest.approx(abs(free.value - 1) / free.std, rel=0.03)


def test_errors_of_a_plausible_size_are_suspected_together_where_none_alone_explains():
    def first(gains):
        found = answer(with_errors({n: (g - 1) * LINES[n] for n, g in gains.items()}))
        assert found.status == "rejected"
        return found.suspects[0]

    off = 0.002 * np.array([1, -2, 0.5, 1, -1, 2, -0.5, 1.5])
    several = first(dict(zip(LINES, 1 + off, strict=True)))
    assert several.term == "gain"
    assert several.value is None
    assert several.share > 0.8
    assert first({"y3": 1.02}).term == "gain[y3]"  # one by itself says more


def test_known_values_that_contradict_each_other_are_named():
    """The misfit is raised by 24, of 36 that are expected."""
    apart = 4.9 * np.hypot(1e-3, 1e-3)
    lengths = {"L1": (0.3, 3e-4), "L2": (TRUTH["L2"] * (1 + apart), 1e-3 * TRUTH["L2"])}
    told = along(answer(fixed={}, known=lengths))
    assert told is not None
    assert {"L1", "L2"} == {*told.on}
    assert "which contradict each other" in told.text
    assert told.value == pytest.approx(4.9, abs=1.2)


def test_known_values_contradict_each_other_however_few_the_periods():
    """Their deviations are stated: no noise of lines is in what parts the two."""
    few = add_noise(measured(periods=12), PLAN.noise, np.random.default_rng(7))
    size = 0.02
    known = {"m2": (TRUTH["m2"] * (1 + 4.8 * np.hypot(size, size)), size * TRUTH["m2"])}
    told = along(answer(few, known=known, force_scale_std=size))
    assert told is not None
    assert {*told.on} == {"m2", "scale[force]"}


@pytest.mark.slow
def test_one_right_model_in_twenty_is_contradicted_at_five_percent(monkeypatch):
    """Of a family of 42 tests at 5 % together, a few less: along the tree of pairs alone."""
    monkeypatch.setattr(assumptions, "DOUBTFUL", 0.05)
    children = np.random.default_rng(11).spawn(400)
    records = (add_noise(measured(), PLAN.noise, child) for child in children)
    seen = sum(along(answer(record)) is not None for record in records)
    assert 0.025 * 400 < seen < 0.07 * 400
