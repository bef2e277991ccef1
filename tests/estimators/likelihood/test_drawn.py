"""What the drawing of a rotor lacks is named first, with its size."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid as rid
import rotorid.models
from rotorid.force.channel_dynamics import UNKNOWN, Constant, FirstOrder
from rotorid.likelihood import rivals as suspects
from rotorid.likelihood.rivals_model import K_SPEED, D, K, drawn_candidates
from rotorid.models.rotor.rotor_model import structure_of
from rotorid.signals.spectrum import synthesize
from rotorid.testing import add_noise, line_record

FLEXIBLE = (Path(rotorid.models.__file__).parent / "library" / "flexible.toml").read_text(
    encoding="utf-8"
)
SENSORS = ["x_a", "y_a", "x_b", "y_b"]
LIGHT = '{name} = {{ at = "{at}", mass = "25 g", I_t = "0 kg m^2", I_p = "0 kg m^2" }}\n'


def recorded(text, *, lines=range(3, 93, 3), bandwidth=None):
    """Return a record of a drawing; the columns of the forces are those before the amplifier."""
    rng, model = np.random.default_rng(5), rid.parse_model(text)
    forces = 20 * np.exp(2j * np.pi * rng.random((len(lines), len(model.inputs))))
    record = line_record(
        model,
        model.values(model.nominal),
        forces,
        harmonics=list(lines),
        fundamental=10.0,
        sample_rate=20000.0,
        periods=20,
        speed=2 * np.pi * 120,
        sensors=SENSORS,
    )
    if bandwidth is not None:
        lead = 1 + 1j * record.fundamental * record.harmonics / bandwidth
        spectra = record.spectra.copy()
        spectra[:, :, :4] *= lead[:, None]
        mean = synthesize(spectra.mean(axis=0), record.harmonics, record.samples)
        record = replace(record, spectra=spectra, mean=mean)
    noise = dict.fromkeys(model.inputs, 0.5) | dict.fromkeys(SENSORS, 1e-6)
    return add_noise(record, noise, rng)


FITS = {"s_A": 1.0, "s_B": 1.0}


def first_suspect(text, **more):
    """Return the first suspect of a record of one drawing, estimated by the shipped one."""
    record = recorded(text, **more)
    estimate = rid.identify(rid.load_model("flexible"), record, rid.MaximumLikelihood(fixed=FITS))
    assert estimate.status == "rejected"
    return estimate.suspects[0], estimate, record


def accepted(text, record, fixed=FITS, **truth):
    """Check that the mended drawing is accepted, and what was hidden recovered to its bar."""
    estimate = rid.identify(rid.parse_model(text), record, rid.MaximumLikelihood(fixed=fixed))
    assert estimate.status == "ok"
    assert not estimate.suspects
    for name, value in truth.items():
        assert abs(estimate.value(name) - value) < 3 * estimate.std(name)
        assert estimate.std(name) < 0.05 * value


def with_disc(at, mass="25 g"):
    disc = LIGHT.format(name="extra", at=at).replace("25 g", mass)
    return FLEXIBLE.replace("[discs]\n", "[discs]\n" + disc)


def with_unknown(text, name, unit, nominal):
    return text + f'{name} = {{ unit = "{unit}", nominal = {nominal}, positive = true }}\n'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("at", "end", "nominal"), [("530 mm", "right", 0.025), ("0 mm", "left", 0.01)]
)
def test_a_mass_at_one_end_of_the_shaft(at, end, nominal):
    first, estimate, record = first_suspect(with_disc(at))
    assert first.term == f"mass at x_{end}_end, y_{end}_end"
    assert first.value == pytest.approx(0.025, rel=0.02)
    assert any("add it to the rotor file" in text for text in estimate.warnings)
    accepted(with_unknown(with_disc(at, "m_x"), "m_x", "kg", nominal), record, m_x=0.025)


@pytest.mark.slow
def test_a_mass_that_is_missing_has_a_negative_sign():
    """The wheel's hub was drawn twice: 25 g too much at the left end."""
    record = recorded(FLEXIBLE)
    model = rid.parse_model(with_disc("0 mm"))
    estimate = rid.identify(model, record, rid.MaximumLikelihood(fixed=FITS))
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term == "mass at x_extra, y_extra"
    assert estimate.suspects[0].value == pytest.approx(-0.025, rel=0.02)


MIDDLE = 'length = "30 mm", outer = "30 mm", material = "steel"'


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.2, 0.8])
def test_a_section_that_is_otherwise_than_drawn(factor):
    text = FLEXIBLE.replace(MIDDLE, f'{MIDDLE}, stiffness = "{factor}"')
    first, _, record = first_suspect(text)
    assert first.term == "stiffness section 4"
    assert first.value == pytest.approx(factor - 1, abs=0.1 * abs(factor - 1))
    mended = FLEXIBLE.replace(MIDDLE, f'{MIDDLE}, stiffness = "s_4"')
    accepted(with_unknown(mended, "s_4", "1", 1.0), record, s_4=factor)


@pytest.mark.slow
def test_a_fit_that_is_stiffer_than_was_thought():
    thought = 's_A = { unit = "1", nominal = 1.0'
    assert thought in FLEXIBLE
    first, estimate, record = first_suspect(
        FLEXIBLE.replace(thought, thought.replace("1.0", "1.2"))
    )
    assert first.term == "prior s_A"
    assert first.value == pytest.approx(1.2, rel=0.02)
    assert any("cannot tell it from stiffness section 2" in text for text in estimate.warnings)
    accepted(FLEXIBLE, record, {"s_B": 1.0}, s_A=1.2)


@pytest.mark.slow
def test_sensors_beside_the_place_where_they_are_drawn():
    text = FLEXIBLE.replace('a = { at = "115 mm" }', 'a = { at = "119 mm" }')
    first, _, record = first_suspect(text)
    assert first.term == "plane[x_a, y_a]"
    assert first.value == pytest.approx(4e-3, rel=0.01)
    accepted(text, record)


@pytest.mark.slow
def test_an_actuator_beside_the_place_where_it_is_drawn():
    text = FLEXIBLE.replace('A = { at = "70 mm" }', 'A = { at = "74 mm" }')
    first, estimate, record = first_suspect(text)
    assert first.term == "plane[F_xA, F_yA]"
    assert first.value == pytest.approx(4e-3, rel=0.01)
    assert any("give A in the rotor file the place" in w for w in estimate.warnings)
    accepted(text, record)


def with_lag(record, start):
    """Return a record whose forces are declared to have a bandwidth that is to be found."""
    lag = FirstOrder(
        bandwidth=Constant("bandwidth", "Hz", start, UNKNOWN), actuator=True, shared="amplifiers"
    )
    channels = [replace(c, dynamics=lag) if c.unit == "N" else c for c in record.channels]
    factor = np.ones(record.spectra.shape[1:], dtype=complex)
    factor[:, :4] = lag.correction(record.omega)[:, None]
    spectra = record.spectra * factor
    mean = synthesize(spectra.mean(axis=0), record.harmonics, record.samples)
    return replace(record, channels=tuple(channels), spectra=spectra, mean=mean)


@pytest.mark.slow
def test_amplifiers_slower_than_said():
    """All sensors as slow as that say the same: y = h f / D, the unbalance, unknown, takes h."""
    first, estimate, record = first_suspect(FLEXIBLE, bandwidth=800.0)
    assert first.term == "bandwidth[force]"
    assert first.value == pytest.approx(800, rel=0.01)
    assert any("cannot tell it from bandwidth[position])" in text for text in estimate.warnings)
    lagging = with_lag(record, 1500.0)
    accepted(FLEXIBLE, lagging, **{"bandwidth[amplifiers]": 800.0})


@pytest.mark.slow
def test_a_reduced_rotor_is_searched_as_a_whole(monkeypatch):
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 1e6)
    monkeypatch.setattr(suspects, "LARGEST", 4e7)
    assert first_suspect(with_disc("530 mm"))[0].term == "mass at x_right_end, y_right_end"


def matrices(term, shape):
    """Return the matrices that the entries of a term make."""
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
    np.testing.assert_allclose(
        found[K] + speed * found[K_SPEED], other.K - one.K, rtol=1e-9, atol=1e-12 * size
    )
    np.testing.assert_allclose(found[D], other.D - one.D, rtol=1e-9, atol=1e-18 * size)
    parts = [t for name, t in terms.items() if name.startswith("stiffness section")]
    np.testing.assert_allclose(
        sum(matrices(t, one.K.shape)[K] for t in parts),
        matrices(terms["stiffness shaft"], one.K.shape)[K],
        atol=1e-9 * size,
    )
    assert len(parts) == len(model.rotor.sections)
    assert len([name for name in terms if name.startswith("stiffness joint")]) == len(parts) - 1


def test_the_ends_of_a_shaft_have_names():
    model = rid.load_model("flexible")
    assert {"x_left_end", "theta_y_right_end"} <= set(model.coordinates)
    taken = FLEXIBLE.replace("[discs]\n", "[discs]\n" + LIGHT.format(name="left_end", at="9 mm"))
    with pytest.raises(rid.ModelError, match="left_end and right_end the ends"):
        rid.parse_model(taken)
