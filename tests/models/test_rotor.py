"""Rotors from drawings: elements against ROSS and closed forms, files, and what they refuse."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from packaging.requirements import Requirement
from result_cases import fit
from rotor_files import random_rotor, uniform

import rotorid as rid
import rotorid.models
from rotorid.likelihood import other_answers as information
from rotorid.likelihood import solver
from rotorid.likelihood import starts as reduction
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge
from rotorid.models.modal import eigenmodes
from rotorid.models.rotor.fem import bending, points_of
from rotorid.models.rotor.rotor_model import inertia
from rotorid.report.drawn import drawing
from rotorid.testing import add_noise, bind_all, line_record

BETA = (4.730040744862704, 7.853204624095838, 10.995607838001671)
SENSORS = ["x_a", "y_a", "x_b", "y_b"]
FLEXIBLE = Path(rid.models.__file__).parent / "library" / "flexible.toml"
GOLDEN = Path(__file__).with_name("ross.npz")


def frequencies(model, speed=0.0):
    m = model.require_linear().matrices(model.values(model.nominal), speed)
    scale = 1 / np.sqrt(np.diag(m.M))
    scaled = [scale[:, None] * each * scale for each in (m.K, m.M)]
    return np.sqrt(np.abs(scipy.linalg.eigh(*scaled, eigvals_only=True)))


@pytest.mark.parametrize("number", range(20))
def test_matrices_equal_those_of_ross(number):
    model = rid.parse_model(random_rotor(np.random.default_rng(number)))
    own = model.require_linear().matrices([], 100.0)
    with np.load(GOLDEN) as golden:
        for name, matrix in (("M", own.M), ("K", own.K), ("G", own.G), ("C", own.D)):
            theirs = golden[f"{name}{number}"]
            np.testing.assert_allclose(matrix, theirs, rtol=1e-9, atol=1e-12 * np.abs(theirs).max())


def test_the_extra_installs_no_ross_that_is_not_read():
    """3.0 has other names and tables of its bearings: `from_ross` would take them wrongly."""
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    extra = tomllib.loads(text)["project"]["optional-dependencies"]["ross"]
    (ross,) = (one for one in map(Requirement, extra) if one.name == "ross-rotordynamics")
    assert [v in ross.specifier for v in ("2.2", "2.3.0", "2.9", "3.0.0", "3.1")] == [0, 1, 1, 0, 0]


@pytest.mark.filterwarnings("ignore")  # ROSS's own, of what it looks for
def test_a_rotor_goes_to_ross_and_back():
    pytest.importorskip("ross", reason="ROSS is not installed: pip install rotorid[ross]")
    model = rid.parse_model(random_rotor(np.random.default_rng(3)))
    again = rid.from_ross(model.to_ross({}))
    one, other = (m.require_linear().matrices(m.values(m.nominal), 7.0) for m in (model, again))
    for name in "MDGK":
        mine, theirs = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(theirs, mine, rtol=1e-12, atol=1e-12 * np.abs(mine).max())


def test_a_thin_free_beam_has_the_frequencies_of_its_closed_form_at_the_rate_of_the_element():
    speed = np.sqrt(210e9 / 7850) * 0.2e-3 / 4
    exact = np.array(BETA) ** 2 * speed
    errors = []
    for elements in (10, 20):
        model = rid.parse_model(uniform(outer="0.2 mm", length="1 m", elements=elements))
        errors.append(frequencies(model)[4:10:2] / exact - 1)
    assert (errors[1] > 0).all()
    assert (errors[1] < 5e-4).all()
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 4, atol=0.3)


def test_a_simply_supported_beam_has_the_frequencies_of_its_closed_form():
    more = """
    [supports]
    left = { at = "0 m", k = "1e12 N/m" }
    right = { at = "1 m", k = "1e12 N/m" }
    """
    model = rid.parse_model(uniform(outer="5 mm", elements=12, more=more))
    exact = (np.pi * np.arange(1, 4)) ** 2 * np.sqrt(210e9 / 7850) * 0.005 / 4
    np.testing.assert_allclose(frequencies(model)[:6:2], exact, rtol=3e-4)


@pytest.mark.parametrize(
    ("outer", "middle"), [("60 mm", None), ("10 mm", "0.3 m"), ("10 mm", "0.5 m")]
)
def test_elements_that_are_not_given_make_three_bending_frequencies_converge(outer, middle):
    """A place in the middle does not end the division."""
    more = f'[actuators]\nA = {{ at = "{middle}" }}' if middle else ""
    found = rid.parse_model(uniform(outer=outer, more=more).replace(", elements = 8", "")).rotor
    fine = bending(rid.parse_model(uniform(outer=outer, elements=120)).rotor)
    np.testing.assert_allclose(bending(found), fine, rtol=1.5e-3)


def test_no_more_elements_than_it_takes_are_made():
    found = rid.parse_model(uniform(outer="60 mm").replace(", elements = 8", "")).rotor
    fine = bending(rid.parse_model(uniform(outer="60 mm", elements=120)).rotor)
    coarse = rid.parse_model(uniform(outer="60 mm", elements=len(found.nodes) // 2)).rotor
    assert (np.abs(bending(coarse) - fine) > 1.5e-3 * fine).any()
    drawn = rid.load_model("flexible").rotor
    assert sum(section.elements for section in drawn.sections) > len(drawn.sections)


def drawn_record(model, rng, lines=range(3, 63, 3)):
    """Return a periodic record of a model with four sensors, with noise on its lines."""
    forces = 20 * np.exp(2j * np.pi * rng.random((len(lines), len(model.inputs))))
    when = {"fundamental": 10.0, "sample_rate": 20000.0, "periods": 20, "speed": 2 * np.pi * 120}
    values = model.values(model.nominal)
    record = line_record(model, values, forces, harmonics=list(lines), sensors=SENSORS, **when)
    noise = dict.fromkeys(model.inputs, 0.5) | dict.fromkeys(SENSORS, 1e-6)
    return add_noise(record, noise, rng)


@pytest.mark.slow
def test_internal_external_and_structural_damping_are_told_apart():
    text = FLEXIBLE.read_text(encoding="utf-8")
    text = text.replace(LOSS, f'{LOSS}\nexternal = "c_e"\nstructural = "eta"')
    text += 'c_e = { unit = "1/s", nominal = 2.0 }\neta = { unit = "1", nominal = 4e-3 }\n'
    model = rid.parse_model(text)
    start = {"c_i": 1e-6, "c_e": 1.0, "eta": 2e-3}
    record = drawn_record(model, np.random.default_rng(2))
    estimate = rid.identify(model, record, rid.MaximumLikelihood(start=start))
    assert estimate.status == "ok"
    for name, value in model.nominal.items():
        assert abs(estimate.value(name) - value) < 4 * estimate.std(name)
    for name in start:
        assert estimate.std(name) < 0.2 * model.nominal[name]


def test_structural_damping_is_half_the_loss_factor_of_each_mode():
    linear = rid.parse_model(uniform(more="[damping]\nstructural = 0.02")).require_linear()
    m = linear.matrices([], 0.0)
    assert np.allclose(m.H, 0.02 * m.K)
    modes = eigenmodes(m.M, m.D, m.K + 1j * m.H)
    ratio = -modes.values.real / np.abs(modes.values)
    np.testing.assert_allclose(ratio[:6], np.sin(np.arctan(0.02) / 2), rtol=1e-6)
    # At rest nothing lags: the stiffness of the line at 0 Hz is real.
    assert not linear.dynamic_stiffness([0.0], [], 0.0).imag.any()


def test_a_support_may_depend_on_the_speed():
    more = """
    [supports]
    seal = { at = "0.5 m", kxx = "k_0 + k_2*Omega^2", kxy = "q*Omega", kyx = "-q*Omega", c = "c" }
    [parameters]
    k_0 = { unit = "N/m", nominal = 1e5 }
    k_2 = { unit = "N s^2/m", nominal = 0.5 }
    q = { unit = "N s/m", nominal = 20.0 }
    c = { unit = "N s/m", nominal = 40.0 }
    """
    model = rid.parse_model(uniform(more=more))
    bare = rid.parse_model(uniform()).require_linear().matrices([], 0.0)
    m = model.require_linear().matrices(model.values(model.nominal), 300.0)
    x, y = (model.coordinates.index(name) for name in ("x_seal", "y_seal"))
    added = (m.K - bare.K)[np.ix_([x, y], [x, y])]
    expected = [[1e5 + 0.5 * 300**2, 6000], [-6000, 0]]
    np.testing.assert_allclose(added, expected, rtol=1e-9, atol=1e-6)
    assert m.D[x, x] == m.D[y, y] == 40.0


@pytest.fixture(scope="module")
def reducible():
    model = rid.load_model("flexible")
    return model, drawn_record(model, np.random.default_rng(3))


def spied(monkeypatch, told=None):
    """Reduce the shipped rotor too; return coordinates and shift of each reduction that is held."""
    seen: list[tuple[int, float]] = []
    shift = reduction.shift_by_reduction

    def shift_seen(point, covariance, records):
        found = shift(point, covariance, records) if told is None else told[len(seen)]
        seen.append((len(records[0].model.coordinates), found))
        return found

    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
    monkeypatch.setattr("rotorid.likelihood.fit.shift_by_reduction", shift_seen)
    return seen


@pytest.mark.slow
def test_a_reduced_rotor_gives_the_answer_of_the_whole_one(monkeypatch, reducible):
    model, record = reducible
    whole = rid.identify(model, record, "ml")  # with all its coordinates
    seen = spied(monkeypatch)
    start = {name: 1.1 * value for name, value in model.nominal.items() if name[0] != "u"}
    estimate = rid.identify(model, record, rid.MaximumLikelihood(start=start))
    assert seen[-1][0] < 0.6 * len(model.coordinates)
    assert seen[-1][1] < 0.01
    for name in model.parameter_names:
        assert abs(estimate.value(name) - whole.value(name)) < 0.01 * whole.std(name)
        np.testing.assert_allclose(estimate.std(name), whole.std(name), rtol=2e-3)


@pytest.mark.slow
def test_shapes_are_taken_again_until_they_do_not_move_the_answer(monkeypatch, reducible):
    model, record = reducible
    # A hundredth of a deviation is negligible.
    seen = spied(monkeypatch, [0.0101, 0.0099])

    assert rid.identify(model, record, "ml").status == "ok"
    first, finer = (size for size, _ in seen)
    assert first < finer < len(model.coordinates)


def test_shapes_below_rounding_are_not_taken(monkeypatch, reducible):
    model, record = reducible
    seen = []

    def reduced(self, reads, omega, speed, values, share):
        seen.append(share)
        return self

    monkeypatch.setattr(type(model), "reduced", reduced)
    bound = bind_all(model, [record])
    for share in (1.1e-13, 0.9e-13):
        reduction.reduced(bound, model.nominal, share=share)
    assert seen == [1.1e-13, 0]  # with 0 the whole rotor is solved


def test_a_rotor_is_reduced_to_its_shapes_on_a_few_lines_of_a_few_speeds():
    omega, speed = np.meshgrid(np.arange(10.0, 1010.0, 10.0), np.arange(0.0, 50.0, 10.0))
    points = points_of(omega.ravel(), speed.ravel())
    assert {turning for _, turning in points} == {0, 20, 40}
    assert len(points) == 3 * (24 + 1)
    assert sorted(points)[0] == (3, 0)  # near rest
    assert sorted(points)[-1] == (1000, 40)


def test_ways_from_further_starts_end_on_few_shapes(monkeypatch, reducible):
    model, record = reducible
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
    seen = []

    def watched(problem, *rest):
        sizes = [len(p.layout.model.coordinates) for p in (problem.sketch, problem)]
        at = elsewhere(problem, *rest)
        seen.append((*sizes, at))
        return at

    elsewhere = information.elsewhere
    monkeypatch.setattr("rotorid.likelihood.other_answers.elsewhere", watched)
    rid.identify(model, record, "ml")
    assert len(seen) == information.ALWAYS
    for few, many, at in seen:
        assert few < 0.8 * many
        assert at is None


def test_an_interrupt_on_few_shapes_leaves_the_point_that_was_reached(monkeypatch, reducible):
    model, record = reducible
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
    reached, tangent = [], solver.tangent

    def third(point, *rest):
        reached.append(point.unknowns)
        if len(reached) == 3:
            raise KeyboardInterrupt
        return tangent(point, *rest)

    monkeypatch.setattr("rotorid.likelihood.solver.tangent", third)
    first, second = model.parameter_names[:2]
    search = rid.MaximumLikelihood(start={first: 1.3, second: 0.8}).search(model, [record])
    with pytest.raises(KeyboardInterrupt):
        search.finish()
    assert search.best.status == "not_converged"
    found = [search.best.value(name) for name in (first, second)]
    np.testing.assert_allclose(found, reached[-1][:2])
    assert found != [1.3, 0.8]


@pytest.mark.slow
def test_what_is_told_of_a_reduction_that_is_too_coarse_is_what_it_does(monkeypatch, reducible):
    model, record = reducible
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
    knowledge = Knowledge(start=model.nominal)
    bound = bind_all(model, [record])
    coarse = reduction.reduced(bound, model.nominal, share=1e-3)
    found, whole = (fit(r[0].model, r, knowledge, Nuisances()) for r in (coarse, bound))
    covariance = found.inference.covariance
    told = reduction.shift_by_reduction(found.solution.point, covariance, found.records)
    off = found.solution.point.unknowns - whole.solution.point.unknowns
    size = np.sqrt(np.diag(whole.inference.covariance))
    true = np.abs(off / size).max()
    assert true > 1
    assert 0.5 < told / true < 2


def test_the_page_of_a_rotor_shows_its_drawing_and_its_mass(output):
    page = output("models", "flexible")
    assert "D disc, A actuator, s sensor, u unbalance" in page
    assert "4.1668 kg" in page
    assert "255  wheel      disc, unbalance" in page
    assert "530  right_end" in page


def test_mass_and_inertia_of_a_cylinder():
    model = rid.parse_model(uniform(outer="80 mm", length="0.5 m"))
    mass = 7850 * np.pi * 0.04**2 * 0.5
    about = mass * (0.5**2 / 12 + 0.04**2 / 4), mass * 0.04**2 / 2
    np.testing.assert_allclose(inertia(model, {}), [mass, 0.25, *about])
    m = model.require_linear().matrices([], 0.0)
    tilted = np.zeros(len(model.coordinates))
    tilted[0::4], tilted[3::4] = model.rotor.positions, 1.0
    assert np.abs(m.K @ tilted).max() < 1e-9 * np.abs(m.K).max()


A, STEEL = 'a = { at = "115 mm" }', 'material = "steel"'
LONG, MASS, LOSS = 'length = "40 mm"', 'mass = "m_w"', 'internal = "c_i"'
FAULTS = (
    (LONG, 'length = "-40 mm"', r"sections\.0\.length: found -0\.04 m"),
    ('outer = "16 mm"', 'outer = "16 mm", inner = "16 mm"', r"sections\.0\.inner: found inner"),
    (STEEL, 'material = "stel"', r"found the material 'stel'"),
    (A, 'a = { at = "1150 mm" }', r"a\.at: found a place at 1\.15 m"),
    (A, 'A = { at = "115 mm" }', r"found 'A' at 0\.07 m and, in"),
    (A, 'a = { at = "70 mm" }', r"found 'a' and 'A' at 0\.07 m"),
    (A, 'node3 = { at = "115 mm" }', r"found the place 'node3'"),
    (A, 'a = { at = "115 kg" }', r"sensors\.a\.at: found unit 'kg'"),
    (A, 'a = { at = "115" }', r"found '115' without a unit"),
    (LONG, f"{LONG}, elements = 1000000", r"elements: found 1000000"),
    (MASS, 'mass = "m_w + 1"', r"discs\.wheel\.mass: found a term in 1"),
    (MASS, 'mass = "c_i"', r"discs\.wheel\.mass: found a term in s"),
    (MASS, 'mass = "m_x"', r"discs\.wheel\.mass: found 'm_x'"),
    (MASS, 'mass = "m_w*Omega/Omega"', r"discs\.wheel\.mass"),
    (MASS, 'mass = "-1 kg"', r"discs\.wheel\.mass: found -1"),
    (A, 'a = { at = "c_i" }', r"sensors\.a\.at: found a term in s"),
    ('G = "81 GPa"', 'G = "81 MPa"', r"steel: found E = 2\.1e\+11 Pa"),
    ('E = "210 GPa"', 'E = "s_A"', r"materials\.steel\.E: found a term in 1"),
    ('s_A = { unit = "1", nominal = 1.0,', 's_A = { unit = "1",', r"found s_A without nominal"),
    ("[damping]", "[dampings]", r"found the unknown key 'dampings'"),
)


@pytest.mark.parametrize(("one", "other", "told"), FAULTS)
def test_a_wrong_drawing_is_refused_in_one_line(one, other, told):
    text = "\ufeff" + FLEXIBLE.read_text(encoding="utf-8")  # as editors of Windows begin files
    assert rid.parse_model(text.encode()).coordinates
    with pytest.raises(rid.InputError, match=told) as caught:
        rid.parse_model(text.replace(one, other, 1).encode(), file="flexible.toml")
    assert str(caught.value).startswith("flexible.toml: ")
    assert "\n" not in str(caught.value)


def pushed_rotor(at, more=""):
    """Return a shaft on two springs with a magnet, and a sensor at a place."""
    return rid.parse_model(
        uniform(length="0.5 m", elements=6)
        + f"""
        [actuators]
        A = {{ at = "0.1 m" }}
        [sensors]
        a = {{ at = "{at}" }}
        [supports]
        l = {{ at = "0 m", k = "k", c = "20 N s/m" }}
        r = {{ at = "0.5 m", k = "k", c = "20 N s/m" }}
        [parameters]
        k = {{ unit = "N/m", nominal = 2e5 }}
        {more}"""
    )


UNKNOWN = 'z = { unit = "mm", nominal = 295 }'


@pytest.mark.parametrize("start", [174, 295, 406])
def test_the_place_of_a_sensor_may_be_a_parameter(start):
    """From afar too: the shaft is divided anew where the sensor turns out to sit."""
    true, rng = pushed_rotor("290 mm"), np.random.default_rng(1)
    forces = 20 * np.exp(2j * np.pi * rng.random((20, 2)))
    when = {"fundamental": 5.0, "sample_rate": 5000.0, "periods": 20, "speed": 100.0}
    noise = {"x_a": 1e-6, "y_a": 1e-6, "theta_x_a": 1e-4, "theta_y_a": 1e-4}
    values, lines = true.values({"k": 2.2e5}), list(range(2, 42, 2))
    record = line_record(true, values, forces, harmonics=lines, sensors=[*noise], **when)
    record = add_noise(record, noise | dict.fromkeys(true.inputs, 0.1), rng)
    model = pushed_rotor("z", UNKNOWN.replace("295", str(start)))
    found = rid.identify(model, record, "ml")
    assert found.verdict in ("ok", "ok under assumptions")
    assert found.std("z") < 1e-5
    assert abs(found.value("z") - 0.29) < 4 * found.std("z")
    assert abs(found.value("k") - 2.2e5) < 4 * found.std("k")
    # What predicts divides the shaft there too: of the 48 ppm noise makes nearly all.
    assert rid.predict(model, found, record)["x_a"].relative_error < 1e-4
    # Its own place is no assumption any more: 5 mm of it would be as much.
    assert next(v.std_assumed for v in found.parameters if v.name == "z") < 1e-4
    with pytest.raises(rid.InputError, match="z in no equation of the model, and in nothing"):
        rid.identify(pushed_rotor("0.29 m", UNKNOWN), record, "ml")


def test_one_plane_is_enough_where_the_other_does_not_move_it(tmp_path):
    model, rng = pushed_rotor("290 mm"), np.random.default_rng(2)
    (tmp_path / "rotor.toml").write_text(model.file_text)

    def found(speed, other="", sign=1):
        forces = 20 * np.exp(2j * np.pi * rng.random((8, 2))) * [1, not speed]
        record = line_record(
            model,
            model.values({"k": 2.2e5}),
            forces,
            harmonics=list(range(2, 18, 2)),
            sensors=["x_a"],
            **{"fundamental": 5.0, "sample_rate": 1000.0, "periods": 1, "speed": speed},
        )
        noise = rng.standard_normal((4000, 3)) * [0.5, 0.5, 1e-6]
        table = np.tile(record.mean, (20, 1)) + noise
        np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="fx,fy,x", comments="")
        (tmp_path / "experiment.toml").write_text(
            f"""
            model = "rotor.toml"
            [[records]]
            file = "run.csv"
            sample_rate = "1 kHz"
            speed = "{speed} rad/s"
            fundamental = "5 Hz"
            harmonics = [2, 4, 6, 8, 10, 12, 14, 16]
            [channels]
            F_xA = {{ column = "fx", unit = "N" }}
            x_a = {{ column = "x", unit = "m", scale = {sign} }}
            {other}"""
        )
        return rid.load_experiment(tmp_path / "experiment.toml").identify()

    # At rest the force in y, which is large, does not move x.
    for estimate in (found(0.0), found(100.0, "F_yA = { scale = 0 }")):
        assert estimate.status == "ok"
        assert abs(estimate.value("k") - 2.2e5) < 4 * estimate.std("k") < 100
    gains = found(0.0, "[estimator]\ngains = ['ki']")
    assert gains.status == "ok"
    assert [value.name for value in gains.nuisance] == ["ki[F_xA]"]
    assert found(0.0, sign=-1).suspects[0].term in ("sign[F_xA]", "sign[x_a]")
    with pytest.raises(rid.InputError, match=r"no channel of the input F_yA.*scale = 0"):
        found(100.0)
    second = model.file_text.replace("[actuators]", '[actuators]\nB = { at = "400 mm" }')
    (tmp_path / "rotor.toml").write_text(second)
    nothing = "\n".join(f"{name} = {{ scale = 0 }}" for name in ("F_xB", "F_yB", "F_yA"))
    assert found(100.0, nothing).status == "ok"


def test_a_rotor_is_drawn_with_what_stands_on_it():
    above, below, *marks = drawing(rid.load_model("flexible").rotor).curves
    assert above.x[-1] == pytest.approx(530)
    assert above.y.max() == -below.base.min() == 16.0
    named = {curve.label: dict(zip(curve.told, curve.x, strict=True)) for curve in marks}
    assert named["sensor"] == {"a": 115.0, "b": 500.0}
    assert named["actuator"] == {"A": 70.0, "B": 450.0}
    assert named["disc"] == {"wheel": 255.0}
