"""What is assumed of a drawing: each entry against a record of a rotor that is otherwise."""

import re
from dataclasses import replace

import numpy as np
import pytest
from bank import steady
from result_cases import fit

import rotorid as rid
from rotorid.likelihood import assumptions
from rotorid.likelihood.starts import reduced
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge
from rotorid.testing import add_noise, bind_all

DRAWN = """
title = "two magnets, their sensors beside them, a wheel between"
sections = [
  { length = "120 mm", outer = "30 mm", inner = "8 mm", material = "steel", elements = 2 },
  { length = "200 mm", outer = "20 mm", material = "steel", stiffness = "s", elements = 4 },
  { length = "130 mm", outer = "32 mm", material = "core", elements = 2 },
]
[materials]
steel = { E = "210 GPa", G = "81 GPa", density = "7850 kg/m^3" }
core = { E = "105 GPa", G = "40.5 GPa", density = "7700 kg/m^3" }
[discs]
wheel = { at = "220 mm", mass = "m", I_t = "2.6e-3 kg m^2", I_p = "4.8e-3 kg m^2" }
[actuators]
A = { at = "50 mm" }
B = { at = "380 mm" }
[sensors]
a = { at = "90 mm" }
b = { at = "410 mm" }
[damping]
internal = "c"
[unbalance]
wheel = { at = "220 mm", x = "u", y = "v" }
[parameters]
s = { unit = "1", nominal = 1.0, positive = true }
m = { unit = "kg", nominal = 2.4, positive = true }
c = { unit = "s", nominal = 2.0e-6, positive = true }
u = { unit = "kg m", nominal = 8.0e-6 }
v = { unit = "kg m", nominal = -5.0e-6 }
"""
SENSORS = ("x_a", "y_a", "x_b", "y_b")
LINES = range(1, 40, 3)
NOISE = dict.fromkeys(("F_xA", "F_yA", "F_xB", "F_yB"), 0.5) | dict.fromkeys(SENSORS, 1e-6)


def clean(text=DRAWN, sensors=SENSORS, turned=0.0):
    """Return a record without noise; `turned`: by how much the magnet of F_xA is, in its plane."""
    model, rng = rid.parse_model(text), np.random.default_rng(3)
    forces = 20 * np.exp(2j * np.pi * rng.random((len(LINES), len(model.inputs))))
    forces[:, 1] += turned * forces[:, 0]
    return steady(model, {}, forces, list(LINES), 10.0, 2e4, 20, hertz=100, sensors=sensors)


def recorded(text=DRAWN):
    return add_noise(clean(text), NOISE, np.random.default_rng(4))


def fit_of(record, text=DRAWN, start=None):
    model = rid.parse_model(text)
    start = start or {name: value for name, value in model.nominal.items() if name not in "uv"}
    records = reduced(bind_all(model, [record]), model.nominal)
    return fit(records[0].model, records, Knowledge(start=start), Nuisances())


def assumed(found, about):
    return next(one for one in assumptions.assumptions(found) if one.about == about)


def test_a_rotor_of_few_shapes_assumes_what_the_whole_one_does(monkeypatch):
    record = recorded()
    whole = fit_of(record)
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
    few = fit_of(record)
    assert len(few.layout.model.coordinates) < 0.9 * len(whole.layout.model.coordinates)
    one, other = (list(assumptions.assumptions(found)) for found in (whole, few))
    assert [(each.about, each.size) for each in one] == [(each.about, each.size) for each in other]
    assert {"ground", "axes", "drawn E", "drawn places"} <= {each.about for each in one}
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_allclose(theirs.moved(few), mine.moved(whole), rtol=0.02, atol=1e-3)


@pytest.fixture(scope="module")
def fitted():
    """Return a record, and the fit of a rotor reduced to its shapes."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
        record = recorded()
        return record, fit_of(record)


def larger(pattern, share):
    """Return the drawing with each number of a pattern larger by a share."""
    found = re.compile(pattern.replace("#", "([0-9.]+)"))
    assert found.search(DRAWN)
    return found.sub(lambda m: m[0].replace(m[1], repr(float(m[1]) * (1 + share))), DRAWN)


@pytest.mark.parametrize(
    ("kind", "errors", "pattern", "by"),
    [
        ("E", ["E[core]"], 'core = { E = "# GPa", G = "40.5', 0.03),
        ("density", ["density[core]"], 'G = "40.5 GPa", density = "#', 0.01),
        ("diameters", ["diameters[outer 3]"], 'outer = "# mm", material = "core"', 0.001),
        ("lengths", ["lengths[all]"], '(?:length|at) = "# mm"', 0.01),
        ("places", ["plane[F_xA, F_yA]"], 'A = { at = "# mm"', 4.5 / 50),
        ("places", ["plane[x_b]", "plane[y_b]"], 'b = { at = "# mm"', 4.5 / 410),
    ],
)
def test_a_drawing_that_is_otherwise_moves_the_answer_as_its_column_says(
    fitted, monkeypatch, kind, errors, pattern, by
):
    """By a hundredth of the plausible error; E with G, which follows it."""
    monkeypatch.setattr("rotorid.models.rotor.rotor_model.WORTH", 0.0)
    record, found = fitted
    one = assumed(found, f"drawn {kind}")
    errors = [one.names.index(name) for name in errors]
    linear, std = found.solution.point.linear, found.inference.std
    said = -linear.taken(one.effect[:, errors].sum(axis=1, keepdims=True))[:, 0] / std
    text = larger(pattern, 0.01 * by)
    if kind == "E":
        text = text.replace('G = "40.5', 'G = "40.51215')
    before = found.solution.point.unknowns
    start = dict(zip(found.layout.model.parameter_names, before.tolist(), strict=True))
    after = fit_of(record, text, start).solution.point.unknowns
    moved = (after - before)[found.layout.free] / (0.01 * std)
    np.testing.assert_allclose(said, moved, rtol=0.02, atol=0.02 * np.abs(moved).max())
    assert np.abs(moved).max() > 5


KI, KS = 80.0, 2e4


def currents(text=DRAWN, turned=0.0):
    """Return a record whose forces are KI i + KS x, x the displacement of a magnet along itself."""
    record = clean(text, (*SENSORS, "x_A", "y_A", "x_B", "y_B"), turned)
    at = {name: record.spectra[:, :, k] for k, name in enumerate(record.names)}
    at["F_yA"], along = at["F_yA"] - turned * at["F_xA"], {**at}
    along["x_A"] = at["x_A"] + turned * at["y_A"]
    spectra, channels = [], []
    for channel in record.channels[:4]:
        place = f"{channel.name[2]}_{channel.name[3]}"
        spectra.append((at[channel.name] - KS * along[place]) / KI)
        channels.append(replace(channel, unit="A", drive=rid.Drive(KI, KS, {place: 1.0})))
    spectra += [at[name] for name in SENSORS]
    channels += record.channels[4:8]
    changed = {"spectra": np.stack(spectra, axis=2), "channels": tuple(channels)}
    blank = {name: getattr(record, name)[..., :8] for name in ("mean", "variance")}
    noise = {name: size / KI if name[0] == "F" else size for name, size in NOISE.items()}
    return add_noise(replace(record, **changed, **blank), noise, np.random.default_rng(4))


@pytest.mark.parametrize(
    ("about", "error", "change"),
    [
        (
            "drawn places",
            "plane[F_xA, F_yA]",
            {"text": larger('A = { at = "# mm"', 1e-3 * 4.5 / 50)},
        ),
        ("axes", "turn[F_xA]", {"turned": 1e-3 * np.radians(0.1)}),
    ],
)
def test_a_magnet_elsewhere_or_turned_is_driven_there_too(about, error, change):
    found = fit_of(currents())
    one = assumed(found, about)
    column = one.effect[:, [one.names.index(error)]]
    said = found.solution.point.linear.taken(column)[:, 0] / found.inference.std
    other = fit_of(currents(**change))
    moved = (other.solution.point.unknowns - found.solution.point.unknowns)[found.layout.free]
    moved /= 1e-3 * found.inference.std
    # Without the displacement there it would be a thirtieth, or a half.
    np.testing.assert_allclose(said, moved, rtol=0.02, atol=0.02 * np.abs(moved).max())


def test_a_tolerance_of_the_drawing_is_what_is_assumed():
    more = '[tolerances]\nE = "0.5 %"\ndensity = "0 %"\nplaces = "2 mm"\n[parameters]\n'
    text = DRAWN.replace("[parameters]\n", f'{more}E_c = {{ unit = "GPa", nominal = 105 }}\n')
    text = text.replace('core = { E = "105 GPa"', 'core = { E = "E_c"')
    found = fit_of(recorded(), text)
    sizes = {one.about: one.size for one in assumptions.assumptions(found)}
    assert (sizes["drawn E"], sizes["drawn places"]) == ("0.5 %", "2 mm")
    assert "drawn density" not in sizes
    # What is a parameter is free, or fixed: not drawn.
    assert assumed(found, "drawn E").names == ("E[steel]",)
    with pytest.raises(rid.InputError, match="tolerances"):
        rid.parse_model(text.replace('"0.5 %"', '"-1 %"'))


@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.05, 0.05])
def test_a_wrong_modulus_beside_a_free_section_is_never_plainly_ok(share):
    """By five thirds of what is plausible, and so is what the free section takes over."""
    modulus = f'E = "{210 * (1 + share)} GPa", G = "{81 * (1 + share)} GPa"'
    true = DRAWN.replace('E = "210 GPa", G = "81 GPa"', modulus)
    noise = {name: 30 * size for name, size in NOISE.items()}
    record = add_noise(clean(true), noise, np.random.default_rng(5))
    model = rid.parse_model(DRAWN)
    start = {name: value for name, value in model.nominal.items() if name not in "uv"}
    found = rid.identify(model, record, rid.MaximumLikelihood(start=start))
    assert found.status == "ok"
    assert found.verdict != "ok"
    told = next(one for one in found.assumptions if one.assumed == "drawn E")
    off = abs(found.value("s") - 1) / found.std("s")
    assert off > 5
    assert told.parameter == "s"
    assert off == pytest.approx(5 / 3 * told.moves, rel=0.3)
