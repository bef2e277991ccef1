"""Forces on a coordinate are told alike however its equation is typed, or it is said why not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from linear_machines import estimate_of

import rotorid as rid
from rotorid import parse_model
from rotorid.answer.unbalance import with_unbalance
from rotorid.likelihood.rivals_model import find_candidates
from rotorid.models.structure import find_structure, force_balance

PLANES = {
    "jeffcott": ["x,y"],
    "rigid": ["x - L_a*theta_y, y + L_a*theta_x", "F_xb,F_yb"],
    "three-mass": ["x1,y1", "x3,y3"],
}


def rewritten(model: rid.Model, change) -> rid.Model:
    """Return a model whose equations were changed, as lists of left and right sides."""
    sides = [tuple(part.strip() for part in text.split("=")) for text in model.texts]
    text = model.file_text
    start = text.index("equations = [")
    head, rest = text[:start], text[text.index("]\n", start) :]
    made = ",\n".join(f'"{left} = {right}"' for left, right in change(sides))
    return parse_model(f"{head}equations = [{made}\n{rest}", name=model.name)


def times(row: int, factor: str):
    def change(sides):
        sides = list(sides)
        sides[row] = tuple(f"{factor}*({side})" for side in sides[row])
        return sides

    return change


def exchanged(one: int, other: int):
    def change(sides):
        sides = list(sides)
        sides[one], sides[other] = sides[other], sides[one]
        return sides

    return change


def summed(into: int, other: int, share: str = "1"):
    def change(sides):
        sides = list(sides)
        pairs = zip(sides[into], sides[other], strict=True)
        sides[into] = tuple(f"{a} + {share}*({b})" for a, b in pairs)
        return sides

    return change


def answers(model: rid.Model) -> dict:
    """Return what is read from the equations as forces: planes, corrections, terms that lack."""
    estimate = estimate_of(model)
    planes = {
        u.plane: u.amount * np.exp(1j * u.angle_rad)
        for u in with_unbalance(model, estimate).unbalance
    }
    found = rid.balance(estimate, PLANES[model.name], "6000 rpm")
    masses = [c.unbalance_kg_m * np.exp(1j * c.angle_rad) for c in found.corrections]
    return planes | {"masses": np.array(masses), "rotor": found.rotor_mass, "share": found.share}


CHANGES = [
    *[("jeffcott", times(row, factor)) for row in (0, 1) for factor in ("2", "-1")],
    *[("jeffcott", times(1, factor)) for factor in ("1000", "0.3")],
    ("jeffcott", exchanged(0, 1)),
    ("jeffcott", lambda sides: exchanged(0, 1)(times(0, "-0.001")(sides))),
    ("rigid", times(0, "-1")),
    ("rigid", times(3, "1000")),
    ("rigid", lambda sides: exchanged(0, 1)(exchanged(1, 2)(sides))),
    *[("three-mass", times(row, "-2.5")) for row in (3, 5)],  # no input in them
    ("three-mass", lambda sides: times(2, "3")(times(0, "2")(sides))),
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("name", "change"), CHANGES)
def test_a_factor_an_order_and_a_sign_change_nothing(name, change):
    model = rid.load_model(name)
    wanted, found = answers(model), answers(rewritten(model, change))
    assert found.keys() == wanted.keys()
    for key, value in wanted.items():
        assert found[key] == pytest.approx(value, rel=1e-6, abs=1e-12), key


@pytest.mark.parametrize("name", ["jeffcott", "three-mass"])
def test_a_result_by_base_parameters_tells_the_same(name):
    model = rid.load_model(name)
    told = []
    for each in (model, rewritten(model, times(1, "-2"))):
        base = each.base_values([each.nominal[n] for n in each.parameter_names])
        values = [rid.Value(n, "1", float(v)) for n, v in zip(each.base.names, base, strict=True)]
        told.append(with_unbalance(each, rid.Estimate(name, "ls", "ok", tuple(values))).unbalance)
    assert [u.plane for u in told[0]] == [u.plane for u in told[1]]
    assert [u.amount for u in told[1]] == pytest.approx([u.amount for u in told[0]], rel=1e-9)
    assert told[0]


SUMS = [
    ("jeffcott", summed(0, 1), "holds inertia that equation 2 does not"),
    ("jeffcott", summed(1, 0, "-0.5"), "holds inertia that equation 1 does not"),
    ("three-mass", summed(0, 2), "holds inertia that equation 3 does not"),
]


@pytest.mark.parametrize(("name", "change", "told"), SUMS)
def test_sums_of_equations_are_refused_with_a_cure(name, change, told):
    model = rewritten(rid.load_model(name), change)
    with pytest.raises(rid.InputError, match=f"{told}.*write that equation as the force on x"):
        rid.balance(estimate_of(model), PLANES[name][:1], "6000 rpm")
    if name == "jeffcott":
        assert with_unbalance(model, estimate_of(model)).unbalance == ()
        assert told in with_unbalance(model, estimate_of(model)).notes[0].found


def test_what_an_input_does_needs_no_coordinate():
    wanted = answers(rid.load_model("jeffcott"))["masses"]
    model = rewritten(rid.load_model("jeffcott"), summed(0, 1))
    found = rid.balance(estimate_of(model), ["F_x,F_y"], "6000 rpm").corrections[0]
    amount = found.unbalance_kg_m * np.exp(1j * found.angle_rad)
    assert amount == pytest.approx(wanted[0], rel=1e-6)


UNITS = {"F": "N", "i": "A", "m": "kg", "k": "N/m", "ki": "N/A", "u": "kg m"}
UNITS |= {"w": "1/s^2", "b": "1/kg", "e": "m"}


def one_of(*equations: str) -> rid.Model:
    """Return a model of what stands in some equations."""
    held = {name for text in equations for name in re.findall(r"\b[a-zA-Z]+", text)}

    def table(names):
        return ", ".join(f'{n} = {{ unit = "{UNITS[n]}" }}' for n in names if n in held)

    inputs = ", ".join(f'{n} = "{UNITS[n]}"' for n in ("F", "i") if n in held)
    places = ", ".join(f'{n} = "m"' for n in ("x", "y") if n in held)
    return parse_model(f"""
title = "one"
equations = {list(equations)}
coordinates = {{ {places} }}
inputs = {{ {inputs} }}
parameters = {{ {table([*UNITS][2:])} }}""")


TURNING = "Omega^2*cos(phi)"


@pytest.mark.parametrize(
    ("equation", "scale"),
    [
        (f"m*x'' + k*x = F + u*{TURNING}", 1),
        (f"-m*x'' - k*x = -F - u*{TURNING}", -1),
        (f"m*x'' + k*x = -F + u*{TURNING}", 1),  # a sensor of force the other way
        (f"m*x'' + k*x = 2*F + u*{TURNING}", 1),  # two magnets
        (f"m*x'' + 2*k*x = 0.5*F + u*{TURNING}", 1),
        (f"2*m*x'' + 2*k*x = F + 2*u*{TURNING}", 1),  # half the mass is asked for
        (f"2*m*x'' + 4*k*x = 2*F + 2*u*{TURNING}", 2),
        (f"1.37*(m*x'' + 2*k*x - F - u*{TURNING}) = 0", 1.37),
        (f"m*x'' + k*x = 50*i + u*{TURNING}", 1),
        (f"m*x'' + k*x = ki*i + u*{TURNING}", 1),
        (f"m*x'' + k*x = 2*ki*i + u*{TURNING}", 1),
        (f"3*m*x'' + 3*k*x = 3*ki*i + 3*u*{TURNING}", 3),
        (f"m*x'' + 2*k*x = u*{TURNING}", 1),
        (f"0.5*m*x'' + k*x = 0.5*u*{TURNING}", 1),  # half a rotor
        (f"2*x'' + 2e4*x = F + u*{TURNING}", 1),
    ],
)
def test_what_was_typed_tells_the_scale(equation, scale):
    model = one_of(equation)
    found = force_balance(model, np.array([[np.sign(scale) * 2.0]]))
    assert not found.faults
    assert found.scales == pytest.approx([scale])
    fixed = model.substitute({name: 3.7 for name in model.parameter_names})
    assert force_balance(fixed, np.array([[np.sign(scale) * 2.5]])).scales == pytest.approx([scale])


@pytest.mark.parametrize(
    ("equation", "told"),
    [
        (f"2*m*x'' + 2*k*x = 2*u*{TURNING}", "the balance of forces times 2"),
        (f"2*m*x'' + k*x = 2*F + 2*u*{TURNING}", "the balance of forces times 2"),
        (f"2*m*x'' + 3*k*x = 2*F + 2*u*{TURNING}", "the balance of forces times 2"),
        (f"x'' + w*x = b*F + e*{TURNING}", "whose terms are in m s^-2"),
    ],
)
def test_what_does_not_tell_the_scale_is_said(equation, told):
    found = force_balance(one_of(equation), np.array([[2.0]]))
    assert told in found.faults[0]


def test_numbers_alone_do_not_tell_a_multiple():
    found = force_balance(one_of("4*x'' + 4e4*x = 2*F", "m*y'' + k*y = 0"), np.eye(2))
    assert found.faults == {0: "equation 1, which may be the balance of forces times 2"}


def test_a_spring_that_pulls_unlike_is_told():
    model = one_of("m*x'' + k*(x - y) = F", "m*y'' + 2*k*(y - x) = 0")
    found = force_balance(model, np.eye(2))
    assert "couple x and y unlike (2 to 1)" in found.faults[0]


def test_terms_that_lack_have_the_size_that_they_have_at_the_coordinate():
    model = rid.load_model("jeffcott")
    doubled = rewritten(model, times(1, "2"))
    values = np.array([model.nominal[name] for name in model.parameter_names])
    plain, twice = (find_structure(each, values, 500.0) for each in (model, doubled))
    candidates = [
        {c.name: c for c in find_candidates(s, ["m", "m"]) if c.name.endswith("x, y")}
        for s in (plain, twice)
    ]
    assert candidates[0].keys() == candidates[1].keys() >= {"mass at x, y", "load at x, y"}
    for name, one in candidates[0].items():
        found, expected = candidates[1][name].effects, one.effects
        sizes = [each.coefficient * (1 + (each.row == 1)) for each in expected]
        assert [each.coefficient for each in found] == pytest.approx(sizes)
        places = [replace(each, coefficient=1.0) for each in expected]
        assert [replace(each, coefficient=1.0) for each in found] == places


def test_nothing_is_said_of_a_place_whose_forces_no_equation_tells():
    model = rewritten(rid.load_model("jeffcott"), summed(0, 1))
    values = np.array([model.nominal[name] for name in model.parameter_names])
    found = find_candidates(find_structure(model, values, 500.0), ["m", "m"])
    assert not [c.name for c in found if c.name.startswith(("mass at", "load at", "stiffness to"))]
