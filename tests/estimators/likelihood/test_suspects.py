"""Where a model fails, and what the drawing of a rotor lacks: the right suspect first."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from bank import agrees, stated, steady, times
from model_text import model_text
from rotor_bank import COORDINATES, Rotor, rigid_rotor, three_mass_rotor
from rotor_files import CORED

import rotorid as rid
from rotorid import MaximumLikelihood, identify, load_model
from rotorid.force.channel_dynamics import UNKNOWN, Constant, FirstOrder
from rotorid.likelihood import rivals as suspects
from rotorid.likelihood import rivals_model as lacking
from rotorid.likelihood.rivals_model import K_SPEED, D, K, drawn_candidates, find_candidates
from rotorid.models.rotor.rotor_model import structure_of
from rotorid.models.structure import find_structure
from rotorid.testing import add_noise

# Where does the model fail: rejected, and the right suspect first.


BETA = 2 * 0.0005 / (2 * np.pi * 175.53)  # damping ratio 0.0005 at the first bending mode
DAMPED, TURNING = "damping k1, k2|damping k[12]", "rotating damping k.*"
IN_X = [COORDINATES.index(name) for name in ("x1", "x2", "theta_y", "x3")]


def damped(rotor: Rotor, speed: float, *, turning: bool = False) -> Rotor:
    """Damp in proportion to the stiffness, in the fixed or in the rotating frame: q' - Omega J q"""
    turn = np.zeros((8, 8))
    for x, y in ((0, 1), (2, 3), (4, 5), (6, 7)):
        turn[x, y], turn[y, x] = speed, -speed
    return rotor._replace(K=rotor.K + BETA * turning * rotor.K @ turn, D=BETA * rotor.K)


def stiffer_in_x(rotor: Rotor, truth: Mapping[str, float], spring: str, share: float) -> Rotor:
    stiffness = rotor.K.copy()
    other = three_mass_rotor({**truth, spring: (1 + share) * truth[spring]})
    stiffness[IN_X] = other.K[IN_X]
    return rotor._replace(K=stiffness)


def record_of(demo, rotor: Rotor, sensors: Sequence[str] | None = None) -> rid.PeriodicRecord:
    """Return the demo's record of a rotor with something that the shipped model does not have."""
    clean = demo.record(sensors)
    spectra = clean.spectra.copy()
    motion = rotor.lines(clean.speed, clean.omega, spectra[0, :, :4])
    spectra[:, :, 4:] = motion[:, [COORDINATES.index(name) for name in clean.names[4:]]]
    return replace(clean, spectra=spectra)


@pytest.fixture
def rotor(demo):
    return three_mass_rotor(demo.truth)


@pytest.mark.sampled(0, parts=2)
@pytest.mark.parametrize("by_bearings", [False, True])
@pytest.mark.parametrize(
    ("fault", "first"),
    [
        ("damping", (DAMPED, DAMPED)),
        ("rotating damping", (TURNING, TURNING)),
        # Half a per cent between x and y: by the bearing sensors its ends are hardly told apart.
        (("k1", 0.005), ("asymmetry k1", "asymmetry .*")),
        (("k2", 0.005), ("asymmetry k2", "asymmetry .*")),
        (("k1", 0.05), ("asymmetry k1", "asymmetry k1")),
    ],
)
def test_the_term_that_lacks_is_suspected_first(demo, rotor, bearings, fault, first, by_bearings):
    if isinstance(fault, str):
        faulty = damped(rotor, 2 * np.pi * 140, turning=fault.startswith("rotating"))
    else:
        faulty = stiffer_in_x(rotor, demo.truth, *fault)
    clean = record_of(demo, faulty, bearings if by_bearings else None)
    fixed = {"L1": 0.3} if by_bearings else {}
    for seed in range(2):
        estimate = demo.identified(demo.noisy(clean, np.random.default_rng(seed)), fixed=fixed)
        assert estimate.status == "rejected"
        assert estimate.misfit.p_value < 1e-6
        assert any("the data reject the model" in warning for warning in estimate.warnings)
        assert re.fullmatch(first[by_bearings], estimate.suspects[0].term)


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "hertz"), [(70.0, 100.0), (170.0, 140.0), (-20.0, 100.0)])
def test_a_record_that_begins_at_another_angle(degrees, hertz):
    """Two Jeffcott rotors' runs, the second begun anywhere, as by hand; nothing says so."""
    model, rng = load_model("jeffcott"), np.random.default_rng(8)
    lines, records = np.array([1, 3, 5, 7, 9]), []
    forces = 0.5 * np.exp(1j * lines[:, None]) * [30.0, 20.0]
    noise = {"F_x": 0.05, "F_y": 0.05, "x": 1e-7, "y": 1e-7}
    for turns, begins in ((140.0, 0.0), (hertz, degrees)):
        heavy = (2e-5 + 1e-5j) * np.exp(1j * np.deg2rad(begins))
        truth = {"xi": heavy.real, "zeta": heavy.imag}
        run = steady(model, truth, forces, lines, 20.0, 5e3, hertz=turns, noise=noise, rng=rng)
        records.append(run)
    found = identify(model, records, MaximumLikelihood())
    first = found.suspects[0]
    assert (found.status, first.term) == ("rejected", "phase[1]")
    assert first.value == pytest.approx(np.deg2rad(degrees), abs=0.02)
    assert any('write phase = "unknown" in that record' in text for text in found.warnings)


def test_drop_is_what_a_fit_with_the_term_gains(demo, rotor):
    faulty = stiffer_in_x(rotor, demo.truth, "k1", 5e-3)
    record = demo.noisy(record_of(demo, faulty), np.random.default_rng(3))
    text = demo.model.file_text + 'fault = { unit = "1", nominal = 2e-3 }\n'
    for row in re.findall(r'^ *"(?:m\d\*x|I_t\*theta_y).*$', text, re.M):
        text = text.replace(row, re.sub(r"\bk1\b", "(k1 + k1*fault)", row))
    model = rid.parse_model(text)
    without, with_it = (identify(each, record, MaximumLikelihood()) for each in (demo.model, model))
    suspects = {suspect.term: suspect.drop for suspect in without.suspects}
    gained = without.misfit.cost - with_it.misfit.cost
    assert suspects["asymmetry k1"] == pytest.approx(gained, rel=0.1)
    assert "asymmetry k1" not in {suspect.term for suspect in with_it.suspects}
    ratio = np.sqrt(without.misfit.cost / without.misfit.expected)
    assert ratio > 1.2
    for value in without.parameters:
        assert value.std_inflated == pytest.approx(value.std * ratio)


BENDING = model_text(
    "A rigid rotor with one bending mode",
    [
        "m*x'' = F_xa + F_xb",
        "m*y'' = F_ya + F_yb",
        "I_t*theta_x'' + I_p*Omega*theta_y' = L_a*F_ya - L_b*F_yb",
        "I_t*theta_y'' - I_p*Omega*theta_x' = L_b*F_xb - L_a*F_xa",
        "m_q*q_x'' + d*q_x' + k_q*q_x = s_a*F_xa + F_xb",
        "m_q*q_y'' + d*q_y' + k_q*q_y = s_a*F_ya + F_yb",
    ],
    "x m, y m, theta_x rad, theta_y rad, q_x m, q_y m",
    "F_xa N, F_ya N, F_xb N, F_yb N",
    "m 7.4 kg, I_t 0.118 kg m^2, I_p 0.023 kg m^2, L_a 0.17 m, L_b 0.19 m, m_q 6.0 kg, "
    "d 30.0 N s/m, k_q 4.4e7 N/m, s_a 0.6 1",
)  # 430 Hz, three times the highest line


def bending_rotor(rng) -> rid.PeriodicRecord:
    """Return a record of it as a rigid rotor has it: forces, and the readings at its ends."""
    true, harmonics = rid.parse_model(BENDING), (1, 3, 7, 12, 19, 28)
    read, bent = {}, {}
    for place, lever, share in (("a", -0.17, 0.6), ("b", 0.19, 1.0)):
        for axis, tilt, side in (("x", "theta_y", lever), ("y", "theta_x", -lever)):
            name, reads = f"s_{axis}{place}", {axis: 1.0, tilt: side}
            read[name] = rid.Channel(name, "m", reads=reads)
            bent[name] = rid.Channel(name, "m", reads={**reads, f"q_{axis}": share})
    forces = 1.5 * np.exp(6j * rng.random((6, 4)))
    sensors = list(bent.values())
    record = steady(true, {}, forces, harmonics, 5.0, 5e3, hertz=70, sensors=sensors)
    taken = replace(record, channels=(*record.channels[:4], *read.values()))
    return add_noise(taken, dict.fromkeys(true.inputs, 1e-2) | dict.fromkeys(read, 2e-7), rng)


@pytest.mark.slow
def test_a_rotor_that_bends_and_is_taken_for_rigid():
    fixed = {"L_a": 0.17, "xi": 0.0, "zeta": 0.0, "mu": 0.0, "eta": 0.0}
    record = bending_rotor(np.random.default_rng(1))
    estimate = identify(load_model("rigid"), record, MaximumLikelihood(fixed=fixed))
    first = estimate.suspects[0]
    assert (estimate.status, first.term, first.unit) == ("rejected", lacking.BENDS, "m/N")
    assert first.share > 0.9
    assert estimate.warnings[0].endswith(lacking.STIFFEN)


@pytest.mark.parametrize(
    ("name", "springs", "pairs"),
    [
        ("three-mass", ["k1", "k2"], {("x1", "y1"), ("x2", "y2"), ("x3", "y3")}),
        ("rigid", [], {("x", "y")}),
        ("jeffcott", ["k"], {("x", "y")}),
    ],
)
def test_structure_of_the_shipped_models(name, springs, pairs):
    """Only a rotor without a spring is suspected of bending."""
    model = load_model(name)
    structure = find_structure(model, model.values(model.nominal), 100.0)
    assert [found for found, _ in structure.springs] == springs
    angles = {("theta_x", "theta_y")} if "theta_x" in model.coordinates else set()
    assert {tuple(model.coordinates[k] for k in p) for p in structure.pairs} == pairs | angles
    terms = find_candidates(structure)
    names = [term.name for term in terms]
    assert len(names) == len(set(names))
    assert ("damping k1" in names) == (name == "three-mass")
    bends = [term for term in terms if term.name == lacking.BENDS]
    assert len(bends) == (not springs)
    for term in bends:
        assert len(term.scalars) == 3
        assert {e.order for e in term.effects} == {4}


# What the drawing of a rotor lacks is named first, with its size.


FLEXIBLE = rid.load_model("flexible").file_text
SENSORS = ["x_a", "y_a", "x_b", "y_b"]
LIGHT = '{name} = {{ at = "{at}", mass = "25 g", I_t = "0 kg m^2", I_p = "0 kg m^2" }}\n'


def recorded(text, *, lines=range(3, 93, 3), bandwidth=None):
    """Return a record of a drawing; the columns of the forces are those before the amplifier."""
    rng, model = np.random.default_rng(5), rid.parse_model(text)
    forces = 20 * np.exp(2j * np.pi * rng.random((len(lines), len(model.inputs))))
    record = steady(model, {}, forces, list(lines), 10.0, 2e4, 20, hertz=120, sensors=SENSORS)
    if bandwidth is not None:
        lead = 1 + 1j * record.fundamental * record.harmonics / bandwidth
        record = times(record, model.inputs, lead)
    noise = dict.fromkeys(model.inputs, 0.5) | dict.fromkeys(SENSORS, 1e-6)
    return add_noise(record, noise, rng)


FITS = {"s_A": 1.0, "s_B": 1.0}


def first_suspect(text, drawing="", **more):
    """Return the first suspect of a record of one drawing, estimated by another: the shipped."""
    record, model = recorded(text, **more), rid.parse_model(drawing or FLEXIBLE)
    estimate = rid.identify(model, record, rid.MaximumLikelihood(fixed=FITS))
    assert estimate.status == "rejected"
    return estimate.suspects[0], " ".join(estimate.warnings), record


def accepted(text, record, fixed=FITS, **truth):
    """Check that the mended drawing is accepted, and what was hidden recovered to its bar."""
    estimate = rid.identify(rid.parse_model(text), record, rid.MaximumLikelihood(fixed=fixed))
    assert estimate.status == "ok"
    assert not estimate.suspects
    for name, value in truth.items():
        assert abs(estimate.value(name) - value) < 3 * estimate.std(name)
        assert estimate.std(name) < 0.05 * value


def drawn_with(old, new, more=""):
    assert old in FLEXIBLE
    return FLEXIBLE.replace(old, new) + more


def with_disc(at, mass="25 g", more=""):
    disc = LIGHT.format(name="extra", at=at).replace("25 g", mass)
    return drawn_with("[discs]\n", "[discs]\n" + disc, more)


MIDDLE = 'length = "30 mm", outer = "30 mm", material = "steel"'
FIT, ACTUATOR = 's_A = { unit = "1", nominal = 1.0', 'A = { at = "70 mm" }'
UNKNOWN_MASS = 'm_x = { unit = "kg", nominal = 0.01, positive = true }\n'
UNKNOWN_SECTION = 's_4 = { unit = "1", nominal = 1.0, positive = true }\n'
LACKS = {  # what is so, the first suspect, its value and bar, what is said, the mended drawing
    "a mass at one end": (
        with_disc("0 mm"),
        ("mass at x_left_end, y_left_end", 0.025, 0.02),
        "add it to the rotor file",
        (with_disc("0 mm", "m_x", UNKNOWN_MASS), FITS, {"m_x": 0.025}),
    ),
    "a section softer than drawn": (
        drawn_with(MIDDLE, f'{MIDDLE}, stiffness = "0.8"'),
        ("stiffness section 4", -0.2, 0.1),
        "",
        (drawn_with(MIDDLE, f'{MIDDLE}, stiffness = "s_4"', UNKNOWN_SECTION), FITS, {"s_4": 0.8}),
    ),
    "a fit stiffer than was thought": (
        drawn_with(FIT, FIT.replace("1.0", "1.2")),
        ("prior s_A", 1.2, 0.02),
        "cannot tell it from stiffness section 2",
        (FLEXIBLE, {"s_B": 1.0}, {"s_A": 1.2}),
    ),
    "an actuator beside its place": (
        (beside := drawn_with(ACTUATOR, ACTUATOR.replace("70", "74"))),
        ("plane[F_xA, F_yA]", 4e-3, 0.01),
        "give A in the rotor file the place",
        (beside, FITS, {}),
    ),
    "a hub that was drawn twice": (
        FLEXIBLE,
        ("mass at x_extra, y_extra", -0.025, 0.02),
        "",
        (FLEXIBLE, FITS, {}),
    ),
}


@pytest.mark.sampled(0, parts=2)
@pytest.mark.parametrize("what", LACKS)
def test_what_a_drawing_lacks_is_named_first(what):
    text, (term, value, bar), told, (mended, fixed, truth) = LACKS[what]
    drawn = with_disc("0 mm") if "extra" in term else FLEXIBLE
    first, warnings, record = first_suspect(text, drawn)
    assert first.term == term
    assert first.value == pytest.approx(value, rel=bar)
    assert told in warnings
    accepted(mended, record, fixed, **truth)


def with_lag(record, start):
    """Return a record whose forces are declared to have a bandwidth that is to be found."""
    bandwidth, forces = Constant("bandwidth", "Hz", start, UNKNOWN), record.names[:4]
    lag = FirstOrder(bandwidth=bandwidth, actuator=True, shared="amplifiers")
    return stated(times(record, forces, lag.correction(record.omega)), forces, dynamics=lag)


@pytest.mark.slow
def test_amplifiers_slower_than_said():
    """All sensors as slow as that say the same: y = h f / D, the unbalance, unknown, takes h."""
    first, warnings, record = first_suspect(FLEXIBLE, bandwidth=800.0)
    assert first.term == "bandwidth[force]"
    assert first.value == pytest.approx(800, rel=0.01)
    assert "cannot tell it from bandwidth[position])" in warnings
    accepted(FLEXIBLE, with_lag(record, 1500.0), **{"bandwidth[amplifiers]": 800.0})


@pytest.mark.slow
def test_a_reduced_rotor_is_searched_as_a_whole(monkeypatch):
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 1e6)
    monkeypatch.setattr(suspects, "LARGEST", 4e7)
    assert first_suspect(with_disc("530 mm"))[0].term == "mass at x_right_end, y_right_end"


def matrices(term, shape):
    found = {at: np.zeros(shape) for at in (K, K_SPEED, D)}
    for entry in term.effects:
        found[entry.order, entry.speed_power][entry.row, entry.column] += entry.coefficient
    return found


def test_terms_of_the_shaft_are_the_derivatives_of_its_matrices():
    text = FLEXIBLE.replace(MIDDLE, f'{MIDDLE}, stiffness = "s_M"')
    text += 's_M = { unit = "1", nominal = 1.0 }\n'
    model, speed = rid.parse_model(text), 700.0
    values = model.values(model.nominal)
    structure = structure_of(model, values, speed)
    terms = {t.name: t for t in drawn_candidates(structure, model, values)}
    stiffer = model.values(model.nominal | {"s_M": 2.0})
    one, other = (model.require_linear().matrices(v, speed) for v in (values, stiffer))
    found = matrices(terms["stiffness section 4"], one.K.shape)
    size = np.abs(one.K).max()
    bent = found[K] + speed * found[K_SPEED]
    np.testing.assert_allclose(bent, other.K - one.K, rtol=1e-9, atol=1e-12 * size)
    np.testing.assert_allclose(found[D], other.D - one.D, rtol=1e-9, atol=1e-18 * size)
    parts = [t for name, t in terms.items() if name.startswith("stiffness section")]
    added = sum(matrices(t, one.K.shape)[K] for t in parts)
    shaft = matrices(terms["stiffness shaft"], one.K.shape)[K]
    np.testing.assert_allclose(added, shaft, atol=1e-9 * size)
    assert len(parts) == len(model.rotor.sections)
    assert len([name for name in terms if name.startswith("stiffness joint")]) == len(parts) - 1


def test_the_ends_of_a_shaft_have_names():
    assert {"x_left_end", "theta_y_right_end"} <= set(rid.load_model("flexible").coordinates)
    taken = FLEXIBLE.replace("[discs]\n", "[discs]\n" + LIGHT.format(name="left_end", at="9 mm"))
    with pytest.raises(rid.ModelError, match="left_end and right_end the ends"):
        rid.parse_model(taken)


# Natural frequencies of a drawn rotor alone: what they determine, and what the drawing lacks.


ALIKE = """
title = "a shaft that is the same from either end"
sections = [{ length = "500 mm", outer = "25 mm", material = "steel", elements = 6 }]
[materials]
steel = { E = "210 GPa", G = "81 GPa", density = "7850 kg/m^3" }
[discs]
wheel = { at = "250 mm", mass = "m_w", I_t = "1.5e-3 kg m^2", I_p = "2.8e-3 kg m^2" }
[parameters]
m_w = { unit = "kg", nominal = 1.2, positive = true }
"""
FREE, SPRUNG = {"k_s": 0.0}, {}
SHARE = 2e-4
KNOWN = {"s_A": 1.0, "s_B": 1.0, "m_w": 1.2, "k_s": 1e6}


def with_mass(text, at):
    extra = f'extra = {{ at = "{at}", mass = "50 g", I_t = "0 kg m^2", I_p = "0 kg m^2" }}'
    return text.replace("[discs]\n", f"[discs]\n{extra}\n")


def measured(text, *tests, count=3, **truth):
    """Return the lowest natural frequencies of each test, scattered by `SHARE`."""
    model, rng, found = rid.parse_model(text), np.random.default_rng(1), []
    for test in tests:
        m = model.require_linear().matrices(model.values(model.nominal | truth | test), 0.0)
        squares = scipy.linalg.eigh(m.K, m.M, eigvals_only=True)
        hertz = np.sqrt(squares[squares > (2 * np.pi) ** 2])[: 2 * count : 2] / (2 * np.pi)
        hertz *= 1 + SHARE * rng.standard_normal(len(hertz))
        found += [rid.Mode(f, SHARE * f, parameters=test) for f in hertz]
    return found


def identified(modes, fixed=None, text=CORED):
    settings = rid.MaximumLikelihood(fixed=fixed or {}, modes=modes)
    return rid.identify(rid.parse_model(text), [], settings)


def test_six_frequencies_give_two_stiffnesses_a_mass_and_a_support():
    truth = {"s_A": 1.15, "s_B": 0.9, "m_w": 1.25, "k_s": 1.2e6}
    estimate = identified(measured(CORED, FREE, SPRUNG, **truth))
    agrees(estimate, truth, 3)
    assert all(estimate.std(name) < 0.005 * value for name, value in truth.items())


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("kept", "told"),
    [
        (slice(0, 3), "natural frequencies with k_s as it is in service: all that were measured"),
        (slice(0, 3), "at least 1 more measured in .*: 3 for 4 unknowns are too few"),
        (slice(3, 6), "at least 1 more measured in .*: 3 for 4 unknowns are too few"),
        (slice(0, 1), "at least 3 more measured in .*: 1 for 4 unknowns are too few"),
    ],
)
def test_too_few_are_refused_with_what_is_missing(kept, told):
    estimate = identified(measured(CORED, FREE, SPRUNG)[kept])
    assert estimate.status == "not_identifiable"
    assert any(np.isnan(v.std) for v in estimate.parameters)
    assert any(re.search(told, text) for text in estimate.warnings)
    assert not any("as many unknowns" in text for text in estimate.warnings)


@pytest.mark.slow
def test_as_many_as_there_are_unknowns_check_nothing_and_say_so():
    modes = measured(CORED, FREE, SPRUNG)
    told = "nothing is left over that could contradict the model"
    estimate = identified([*modes[:3], modes[3]])
    assert estimate.status == "ok"
    assert estimate.misfit.dof == 0
    assert any(told in text for text in estimate.warnings)
    assert not any(told in text for text in identified(modes).warnings)


@pytest.mark.slow
def test_which_end_carries_a_mass_is_not_told_by_a_shaft_that_is_the_same_from_either():
    modes = measured(with_mass(ALIKE, "500 mm"), {}, count=4)
    estimate = identified(modes, text=ALIKE)
    assert estimate.status == "rejected"
    first, second = estimate.suspects[:2]
    assert first.term == "mass at x_left_end, y_left_end"  # they stand from left to right
    assert second.term == "mass at x_right_end, y_right_end"
    assert first.value == pytest.approx(0.05, rel=0.01)
    assert second.value == pytest.approx(0.05, rel=0.01)
    told = "which end carries it is not determined by these frequencies"
    assert any(told in text for text in estimate.warnings)
    assert identified(modes, text=with_mass(ALIKE, "500 mm")).status == "ok"


@pytest.mark.slow
def test_the_end_is_told_where_the_shaft_is_another_from_either():
    modes = measured(with_mass(CORED, "0 mm"), FREE, count=5)
    estimate = identified(modes, KNOWN)
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term == "mass at x_left, y_left"
    assert estimate.suspects[0].value == pytest.approx(0.05, rel=0.02)
    assert not any("which end" in text for text in estimate.warnings)
    assert identified(modes, KNOWN, with_mass(CORED, "0 mm")).status == "ok"


# What bearings add where forces act, and a mass that one record has to itself.

TWO = (60.0, 40.0)
"""Hz, of the records between which a mass changes."""
LEFT_OUT = {
    "ks": lambda rng: np.diag(np.repeat(rng.uniform(3e4, 2e5, 2), 2)),
    "cross-coupling of the bearings": lambda rng: np.kron(
        np.diag(rng.uniform(1e4, 5e4, 2)), [[0.0, 1.0], [-1.0, 0.0]]
    ),
}
OWN = ("m", "I_t")
SLEEVE = "mass beside x, y"


def on_bearings(what: str, seed: int) -> tuple[list[rid.PeriodicRecord], dict[str, float]]:
    """Return records of a random rigid rotor that the shipped model does not describe."""
    rng, model = np.random.default_rng([seed, 20]), load_model("rigid")
    truth = {n: v * float(np.exp(0.3 * rng.standard_normal())) for n, v in model.nominal.items()}
    truth["I_p"] = min(truth["I_p"], 1.5 * truth["I_t"])
    own = what.rpartition(" ")[2]
    lines, records = [1, 3, 5, 6, 7, 9, 11, 13, 17, 21, 25], []
    for hertz in TWO if own in OWN else TWO[:1]:
        changed = {own: truth[own] * (1 + rng.uniform(0.02, 0.1))} if records else {}
        forces = 10 * (rng.standard_normal((11, 4, 2)) @ [1, 1j])
        forces[lines.index(6)] = 0
        clean = steady(model, truth, forces, lines, hertz=hertz)
        rotor, spectra = rigid_rotor(truth | changed), clean.spectra.copy()
        if what in LEFT_OUT:
            rotor = rotor._replace(K=rotor.K - rotor.B @ LEFT_OUT[what](rng) @ rotor.B.T)
        elif what == SLEEVE:
            z = truth["L_b"] * rng.uniform(0.3, 0.9) * rng.choice([-1, 1])
            moved = np.array([[1.0, 0.0, 0.0, z], [0.0, 1.0, -z, 0.0]])
            added = truth["m"] * rng.uniform(0.01, 0.05) * moved.T @ moved
            rotor = rotor._replace(M=rotor.M + added)
        spectra[:, :, 4:] = rotor.lines(clean.speed, clean.omega, spectra[0, :, :4])
        level = np.sqrt((np.abs(spectra[0]) ** 2).mean(axis=0) * clean.samples)
        noise = dict(zip(clean.names, 3e-3 * level, strict=True))
        records.append(add_noise(replace(clean, spectra=spectra), noise, rng))
    return records, truth


def told_on_bearings(what: str, seed: int, each: tuple[str, ...] = ()) -> rid.Estimate:
    records, truth = on_bearings(what, seed)
    fixed = {name: truth[name] for name in ("L_a", "L_b")}
    start = {name: 1.1 * truth[name] for name in {"m", "I_t", "I_p"} - {*each}}
    start |= {f"{name}[{k}]": 1.1 * truth[name] for name in each for k in range(2)}
    return identify(load_model("rigid"), records, MaximumLikelihood(fixed, start=start, each=each))


NAMES = [*LEFT_OUT, SLEEVE, *(f"differs between records: {name}" for name in OWN)]


@pytest.mark.parametrize("what", NAMES)
def test_what_bearings_add_and_a_mass_that_changed_are_named(what):
    found = told_on_bearings(what, 0)
    assert (found.status, found.suspects[0].term) == ("rejected", what)
    assert found.suspects[0].share > 0.99
    if what.endswith(OWN):  # what it says to write is accepted, as are records alike
        own = what.rpartition(" ")[2]
        assert told_on_bearings(what, 0, each=(own,)).status == "ok"
        assert told_on_bearings("", 0).status == "ok"


@pytest.mark.sampled(0, parts=2)
@pytest.mark.parametrize("what", NAMES)
def test_nine_of_ten_are_named(what):
    named = [told_on_bearings(what, seed).suspects[0].term == what for seed in range(1, 11)]
    assert sum(named) >= 9
