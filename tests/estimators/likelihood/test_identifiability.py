"""What records do not determine: the combination is named, the cure is named, the cure works."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from bank import agrees

from rotorid.likelihood.identifiability import _exponents, _rotation_left_out
from rotorid.testing import add_noise, bind


@pytest.fixture
def rng():
    return np.random.default_rng(21)


def lines_of(estimate, start: str) -> list[str]:
    return [w.removeprefix(start) for w in estimate.warnings if w.startswith(start)]


lost = partial(lines_of, start="not identifiable: ")
cures_of = partial(lines_of, start="cure: ")


@pytest.mark.slow
def test_the_unit_of_angle(demo, rng):
    estimate = demo.identified(demo.seen(rng), fixed={})
    assert estimate.status == "not_identifiable"
    assert lost(estimate) == [
        "L1, I_t, I_p, L2, mu, eta scale together (L1, L2 as s; I_t, I_p as s^2; mu, eta as s^-1)"
    ]
    known = "fix one of L1, I_t, I_p, L2, mu, eta"
    assert cures_of(estimate) == [known, "a sensor of theta_x or theta_y"]
    # What is determined is still given, with its deviation.
    assert estimate.value("m2") == pytest.approx(demo.truth["m2"], abs=4 * estimate.std("m2"))
    assert np.isnan(estimate.value("L1"))
    assert np.isnan(estimate.std("k1*L1"))
    truth = demo.truth
    for name, value in {
        "L2/L1": 1.0,
        "I_t/L1^2": truth["I_t"] / 0.09,
        "I_p/L1^2": truth["I_p"] / 0.09,
        "mu*L1": truth["mu"] * 0.3,
        "m2*xi": truth["m2"] * truth["xi"],
    }.items():
        assert estimate.value(name) == pytest.approx(value, abs=4.5 * estimate.std(name))
        assert 0 < estimate.std(name) < 0.1 * abs(estimate.value(name))
    assert estimate["I_t/L1^2"].unit == "kg"


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["L1", "L2", "I_t", "I_p"])
def test_fixing_a_member_cures_the_unit_of_angle(demo, rng, name):
    agrees(demo.identified(demo.seen(rng), fixed={name: demo.truth[name]}), demo.truth)


def test_a_sensor_cures_the_unit_of_angle(demo, bearings, rng):
    agrees(demo.identified(demo.seen(rng, [*bearings, "theta_y"]), fixed={}), demo.truth)


@pytest.mark.slow
def test_runout_at_one_speed(levitated, rng):
    """Four combinations of unbalance and runout; a second speed separates them."""
    truth, machine = levitated.truth, levitated.machine
    one, other = levitated.seen(rng, 140.0, 100.0, drives=False)
    estimate = machine.identified(one, runout=True)
    assert estimate.status == "not_identifiable"
    found = lost(estimate)
    assert len(found) == 4
    for text, name in zip(found, ("xi", "zeta", "mu", "eta"), strict=True):
        assert text.startswith(f"{name}, runout[")
    cures = cures_of(estimate)
    assert cures[0] == "fix 4 of them, such as xi, zeta, mu, eta"
    assert "a further record at another speed, such as 100 Hz" in cures
    # Masses and stiffnesses have their deviations all the same.
    for name in ("m1", "m2", "I_t", "I_p", "k1", "L2"):
        assert estimate.value(name) == pytest.approx(truth[name], abs=4 * estimate.std(name))
    agrees(machine.identified([one, other], runout=True), truth)
    fixed = {name: truth[name] for name in ("L1", "xi", "zeta", "mu", "eta")}
    agrees(machine.identified(one, fixed=fixed, runout=True), truth)


@pytest.mark.slow
def test_unknown_gains_and_no_mass(levitated, rng):
    truth, machine = levitated.truth, levitated.machine
    records = levitated.seen(rng, 140.0, 100.0)
    options = {"runout": True, "gains": ("ki", "ks")}
    estimate = machine.identified(records, **options)
    assert estimate.status == "not_identifiable"
    members = "m1, m2, m3, I_t, I_p, k1, k2, ki[F_x1], ki[F_y1], ki[F_x3], ki[F_y3], ks"
    assert lost(estimate) == [f"{members} scale together"]
    assert cures_of(estimate) == [
        f"fix one of {members} (ki[F_x1], ki[F_y1], ki[F_x3], ki[F_y3]: leave "
        '"ki" out of gains; ks: leave "ks" out of gains)',
        "weigh the rotor: a constraint on m1 + m2 + m3",
    ]
    ratio = truth["m2"] / truth["m1"]
    assert estimate.value("m2/m1") == pytest.approx(ratio, abs=4 * estimate.std("m2/m1"))
    # A scale weighs masses, not whatever has the unit kg.
    agrees(machine.identified(records, constraints=(levitated.weighed,), **options), truth)
    agrees(machine.identified(records, fixed={"L1": 0.3, "m2": truth["m2"]}, **options), truth)


def test_gains_of_force_channels_need_a_mass_too(demo, rng):
    record = demo.seen(rng)
    estimate = demo.identified(record, gains=("ki",))
    assert estimate.status == "not_identifiable"
    assert "m1, m2, m3, I_t, I_p, k1, k2, ki[F_x1]" in estimate.warnings[0]
    cured = demo.identified(record, fixed={"L1": 0.3, "m2": demo.truth["m2"]}, gains=("ki",))
    assert cured.status == "ok"
    assert cured.value("ki[F_x1]") == pytest.approx(1.0, abs=4 * cured.std("ki[F_x1]"))


@pytest.mark.slow
def test_everything_open_at_once(levitated, rng):
    """No length, no mass, four force slopes: two scales, each named by itself."""
    records = levitated.seen(rng, 140.0, 100.0)
    estimate = levitated.machine.identified(records, fixed={}, runout=True, gains=("ki", "ks*"))
    first, second = lost(estimate)
    assert first.startswith("m1, m2, m3, I_t, I_p, k1, k2, ki[F_x1]")
    assert second.startswith("L1, I_t, I_p, L2, mu, eta scale together")
    assert cures_of(estimate)[0] == "fix 2 of them, such as m1, L1"
    value, truth = estimate.value("I_t/m1/L1^2"), levitated.truth
    wanted = truth["I_t"] / truth["m1"] / truth["L1"] ** 2
    assert value == pytest.approx(wanted, abs=4 * estimate.std("I_t/m1/L1^2"))


def test_unknown_phase_of_the_only_record(demo, rng):
    """The direction of the unbalance is open, its size is not; with another record it is known."""
    known, turned = demo.seen(rng), demo.seen(rng, phase=1.0)
    turned = replace(turned, phase_known=False, angle=turned.angle - 1.0)
    alone = demo.identified(turned)
    assert alone.status == "not_identifiable"
    assert lost(alone) == ["xi, zeta, mu, eta, phase[0] are determined only together"]
    agrees(demo.identified([known, turned]), {**demo.truth, "phase[1]": 1.0}, 4)


@pytest.mark.slow
def test_unbalance_without_a_line_of_the_rotation(demo, rng):
    estimate = demo.identified(demo.seen(rng, harmonics=(1, 3, 5, 9, 11)))
    assert lost(estimate) == [f"{name} is not determined" for name in ("xi", "zeta", "mu", "eta")]
    cures = cures_of(estimate)
    assert "a further record at another speed, such as 100 Hz" in cures
    told = "the line of the rotation, 140 Hz, on which the unbalance acts: add 7 to harmonics"
    assert cures.index(told) == 1  # behind known values


@pytest.mark.parametrize(("hertz", "told"), [(140.019, 1), (140.021, 0)])
def test_a_rotation_within_a_thousandth_of_a_line_is_on_it(demo, bearings, hertz, told):
    """Lines stand 20 Hz apart."""
    record = demo.record(bearings, hertz=hertz, harmonics=(1, 3, 5, 9, 11))
    assert len(list(_rotation_left_out(bind(demo.model, record), ""))) == told


@pytest.mark.slow
def test_standstill(demo, rng):
    """No gyroscopic moment, no unbalance; a record of the turning rotor cures it."""
    still = demo.seen(rng, hertz=0.0)
    estimate = demo.identified(still)
    assert estimate.status == "not_identifiable"
    assert lost(estimate) == [
        f"{name} is not determined" for name in ("I_p", "xi", "zeta", "mu", "eta")
    ]
    cures = cures_of(estimate)
    assert "a further record at another speed, such as 20 Hz" in cures
    assert estimate.value("I_t") == pytest.approx(demo.truth["I_t"], abs=4 * estimate.std("I_t"))
    agrees(demo.identified([still, demo.seen(rng, hertz=20.0)]), demo.truth)


@pytest.mark.slow
def test_noise_free_records_tell_the_same(demo, bearings):
    clean = demo.record(bearings)
    estimate = demo.identified(clean, fixed={})
    assert estimate.status == "not_identifiable"
    assert estimate.value("L2/L1") == pytest.approx(1.0, rel=1e-9)
    record = add_noise(clean, dict.fromkeys(demo.model.inputs, 1e-3), np.random.default_rng(0))
    assert demo.identified(record, fixed={}).status == "not_identifiable"


@pytest.mark.parametrize(
    ("relative", "powers"),
    [
        ([1.0, 2.0, -1.0], [1, 2, -1]),
        ([0.5, 0.25], [2, 1]),
        ([1.0, 0.0], []),  # one that does not move is no power of the other's factor
        ([1.0, 1e-9], []),
        ([1.0, 0.7071], []),
        ([1.0, 6.0], [1, 6]),
        ([1.0, 7.0], []),
    ],
)
def test_members_scale_together_only_as_whole_powers_of_one_factor(relative, powers):
    change = np.array(relative)
    assert _exponents(change, np.ones(len(change))) == powers


@pytest.mark.parametrize("value", [0.0, 5e-324, 1e-313, -1e-310])
def test_a_value_that_does_nothing_may_be_next_to_0(value):
    """An unbalance that acts on no line: the search leaves it anywhere."""
    assert _exponents(np.ones(1), np.array([value])) == []
    assert _exponents(np.ones(2), np.array([1.0, value])) == []
    assert _exponents(np.ones(2), np.full(2, value)) == []
    assert _exponents(np.ones(1), np.array([1e-300])) == [1]


def test_gains_without_the_line_of_the_rotation(levitated, rng):
    """The search takes an unbalance that acts on nothing towards 0, past the least number."""
    every = levitated.record(140.0)
    kept = every.harmonics != 7
    without = replace(every, harmonics=every.harmonics[kept], spectra=every.spectra[:, kept])
    seen = levitated.noisy(without, rng)
    estimate = levitated.machine.identified(
        seen, constraints=(levitated.weighed,), gains=("ki", "ks")
    )
    assert estimate.status == "not_identifiable"
    assert lost(estimate) == [f"{name} is not determined" for name in ("xi", "zeta", "mu", "eta")]
    assert any(cure.endswith("add 7 to harmonics") for cure in cures_of(estimate))
