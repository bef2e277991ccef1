"""The scale of all forces: with a deviation, or as exact and said to be so."""

from dataclasses import replace

import numpy as np
import pytest

from rotorid import Batch, Constraint, InputError, MaximumLikelihood, identify, parse_model
from rotorid.data.record import Drive
from rotorid.testing import add_noise, line_record

FOLLOWING = "m1, m2, m3, I_t, I_p, k1, k2"


@pytest.fixture
def record(levitated):
    quiet = replace(levitated, runout={})
    return quiet.noisy(quiet.record(140.0), np.random.default_rng(36))


def test_a_scale_is_in_masses_and_stiffnesses_and_not_in_lengths(levitated, record):
    """The share of the displacement, ks x, scales with that of the current."""
    model, fixed = levitated.machine.model, {"L1": 0.3}
    plain = identify(model, record, MaximumLikelihood(fixed=fixed))
    found = identify(model, record, MaximumLikelihood(fixed=fixed, force_scale_std=0.01))
    assert found.status == "ok"
    assert found["scale[force]"].value == pytest.approx(1.0, abs=1e-6)
    for name in FOLLOWING.split(", "):
        expected = np.hypot(plain.std(name), 0.01 * plain.value(name))
        assert found.std(name) == pytest.approx(expected, rel=1e-3)
    for name in ("L2", "xi", "zeta"):
        assert found.std(name) == pytest.approx(plain.std(name), rel=1e-3)


def test_a_mass_that_is_known_tells_the_scale(levitated, record):
    truth = levitated.truth
    total = sum(truth[name] for name in ("m1", "m2", "m3"))
    weighed = Constraint("m1 + m2 + m3", 1.02 * total, 1e-5 * total)
    found = identify(
        levitated.machine.model,
        record,
        MaximumLikelihood(fixed={"L1": 0.3}, force_scale_std=0.1, constraints=(weighed,)),
    )
    scale = found["scale[force]"]
    assert scale.value == pytest.approx(1.02, abs=4 * scale.std)
    assert scale.std < 0.006  # what the record leaves of the masses, at this noise
    assert not [c for c in found.checks if c.about == "force scale"]


def test_a_scale_taken_as_exact_is_told_where_no_misfit_shows_it(levitated, record, demo, bearings):
    model, fixed = levitated.machine.model, {"L1": 0.3}
    found = identify(model, record, MaximumLikelihood(fixed=fixed))
    (note,) = [c for c in found.checks if c.about == "force scale"]
    assert note.verdict == "note"
    assert ", ".join(note.on) == "F_x1, F_y1, F_x3, F_y3"
    assert note.found.startswith(f"assumed exact: 1 % of error shifts {FOLLOWING} by 1 %")
    weighed = MaximumLikelihood(fixed={**fixed, "m2": levitated.truth["m2"]})
    assert not [c for c in identify(model, record, weighed).checks if c.about == "force scale"]
    total = sum(levitated.truth[name] for name in ("m1", "m2", "m3"))
    for gains in ((), ("ki",), ("ki", "ks")):  # the rotor on a scale, exactly
        chosen = MaximumLikelihood(
            fixed=fixed, constraints=(Constraint("m1 + m2 + m3", total),), gains=gains
        )
        checks = identify(model, record, chosen).checks
        assert not [c for c in checks if c.about == "force scale"]
    # Forces that were measured as such have a calibration of their own: gain_std.
    forces = demo.noisy(demo.record(bearings), np.random.default_rng(3))
    plain = identify(demo.model, forces, MaximumLikelihood(fixed=fixed))
    assert not [c for c in plain.checks if c.about == "force scale"]


def test_a_scale_is_a_share():
    with pytest.raises(InputError, match=r"force_scale_std: found 1\.5; expected a share"):
        MaximumLikelihood(force_scale_std=1.5)
    assert not hasattr(Batch(), "force_scale_std")


@pytest.mark.parametrize(("held", "follows"), [(0.49, "m, k"), (0.51, "m")])
def test_what_follows_the_scale_by_half_is_named(held, follows):
    """A part of the stiffness is held: 1 % of the scale is 0.51 or 0.49 % of the rest."""
    model = parse_model(HELD)
    values = model.values({"m": 2.0, "k": 2e5, "h": held * 2e5})
    forces = np.array([[3 - 4j], [5], [4 + 1j], [-3j]])
    lines = {"harmonics": [1, 2, 5, 9], "fundamental": 5.0, "sample_rate": 2000.0, "periods": 60}
    clean = line_record(model, values, forces, **lines)
    force, motion = clean.channels
    driven = replace(clean, channels=(replace(force, drive=Drive(1.0, 0.0, {"x": 1.0})), motion))
    record = add_noise(driven, {"F": 1e-4, "x": 1e-10}, np.random.default_rng(7))
    found = identify(model, record, MaximumLikelihood(fixed={"h": held * 2e5}))
    (note,) = [c for c in found.checks if c.about == "force scale"]
    assert f" shifts {follows} by 1 %" in note.found


HELD = """
title = "a mass on a spring of which a part is known"
equations = ["m*x'' + k*x - h*x = F"]
coordinates = { x = "m" }
inputs = { F = "N" }
[parameters]
m = { unit = "kg", nominal = 2.0 }
k = { unit = "N/m", nominal = 2e5 }
h = { unit = "N/m", nominal = 1e5 }
"""
