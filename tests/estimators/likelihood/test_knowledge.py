"""What is known beforehand: values, deviations, bounds, constraints."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rotorid import Constraint, InputError


@pytest.fixture(scope="module")
def noisy(demo):
    return demo.seen(11)


@pytest.fixture(scope="module")
def found(demo, noisy):
    """Return the estimate from one record with what is known besides a length."""
    return partial(demo.identified, noisy)


@pytest.fixture(scope="module")
def free(found):
    return found()


def test_linear_constraint_is_exact(found):
    estimate = found(constraints=(Constraint("m1 + m2 + m3", 12.98878),))
    total = sum(estimate.value(name) for name in ("m1", "m2", "m3"))
    assert total == pytest.approx(12.98878, rel=1e-14)
    assert estimate.misfit.dof == 48 - 12 + 1
    # The covariance has no spread along the constraint.
    along = np.array([float(value.name in ("m1", "m2", "m3")) for value in estimate.free])
    assert along @ estimate.covariance @ along < 1e-20
    assert estimate.status == "ok"


def test_product_constraint_is_exact(demo, found, free):
    """The static unbalance was weighed: m2 xi, and the stiffness of a bearing times its length."""
    static = demo.truth["m2"] * demo.truth["xi"]
    known = (Constraint("m2*xi", static), Constraint("k1*L1^2 - k2*L2^2", 0.0))
    estimate = found(constraints=known)
    assert estimate.value("m2*xi") == pytest.approx(static, rel=1e-13)
    assert estimate.std("m2*xi") < 1e-9 * abs(estimate.value("m2*xi"))
    one, other = (estimate.value(f"k{i}") * estimate.value(f"L{i}") ** 2 for i in (1, 2))
    assert one == pytest.approx(other, rel=1e-13)
    assert estimate.misfit.dof == free.misfit.dof + 2
    assert estimate.misfit.cost > free.misfit.cost
    assert estimate.std("k2") < free.std("k2")


def test_constraint_with_deviation_is_a_measurement(demo, found, free):
    """Between no constraint and the exact one, and equal to each in the limits."""
    known = [Constraint("m1 + m2 + m3", 12.98878, std) for std in (1e3, 1e-3, 0.0)]
    loose, firm, exact = (found(constraints=(each,)) for each in known)
    for value in free.free:
        scale = free.std(value.name)
        assert loose.value(value.name) == pytest.approx(value.value, abs=1e-3 * scale)
        assert loose.std(value.name) == pytest.approx(scale, rel=1e-4)
        assert exact.std(value.name) <= firm.std(value.name) * (1 + 1e-4)
        assert firm.std(value.name) <= scale * 1.01
    assert loose.misfit.dof == free.misfit.dof + 1
    assert loose.misfit.expected == pytest.approx(free.misfit.expected + 1, abs=1e-3)
    assert demo.truth["m2"] == pytest.approx(firm.value("m2"), abs=4 * firm.std("m2"))


def test_value_with_deviation_equals_constraint_with_deviation(found):
    one = found(fixed={}, known={"L1": (0.3, 0.5e-3)})
    other = found(fixed={}, constraints=(Constraint("L1", 0.3, 0.5e-3),))
    assert one.misfit.cost == pytest.approx(other.misfit.cost, rel=1e-9)
    for value in one.free:
        assert other.value(value.name) == pytest.approx(value.value, abs=1e-4 * value.std)
        assert other.std(value.name) == pytest.approx(value.std, rel=1e-4)
    # theory.md, section 3: a length measured to 0.5 mm moves I_p from .05 to .34 %.
    assert 100 * one.std("I_p") / one.value("I_p") == pytest.approx(0.34, abs=0.02)


def test_bound_that_does_not_bind_changes_nothing(found, free):
    bounded = found(bounds={"2*I_t - I_p": (0.0, None), "m1": (0.5, 1.5)})
    assert [v.value for v in bounded.parameters] == [v.value for v in free.parameters]
    assert bounded.warnings == ()


@pytest.mark.slow
def test_bound_that_binds_is_an_equality(found, free):
    """I_p <= 2 I_t of a rotor whose estimate lies beyond it; J rises as little as it must."""
    limit = 2 * free.value("I_t") - free.value("I_p") + 2 * free.std("I_t")
    bounded = found(bounds={"2*I_t - I_p": (limit, None)})
    held = 2 * bounded.value("I_t") - bounded.value("I_p")
    assert held == pytest.approx(limit, rel=1e-12)
    equality = found(constraints=(Constraint("2*I_t - I_p", limit),))
    assert bounded.misfit.cost == pytest.approx(equality.misfit.cost, rel=1e-9)
    assert any("2*I_t - I_p >= " in warning for warning in bounded.warnings)
    assert bounded.std("I_t") == pytest.approx(free.std("I_t"), rel=0.05)


@pytest.mark.slow
def test_several_bounds_release_what_need_not_hold(found, free):
    """Two bounds, of which only one binds once the other holds."""
    # k1 and m1 are strongly correlated: pushing k1 up lifts m1 far beyond its own bound.
    names = [value.name for value in free.free]
    assert free.correlation[names.index("m1"), names.index("k1")] > 0.8
    bounds = {
        "k1": (free.value("k1") + 3 * free.std("k1"), None),
        "m1": (free.value("m1") + 0.5 * free.std("m1"), None),
    }
    estimate = found(bounds=bounds)
    assert estimate.value("k1") == pytest.approx(bounds["k1"][0], rel=1e-12)
    assert estimate.value("m1") > bounds["m1"][0] * (1 + 1e-6)
    assert sum("is active" in warning for warning in estimate.warnings) == 1


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        ((Constraint("m1", 1.0), Constraint("2*m1", 3.0)), "repeat or contradict"),
        ((Constraint("L1", 0.3),), "holds no free parameter"),
        ((Constraint("m1 + m9", 1.0),), "unknown name 'm9'"),
        ((Constraint("m1/m2", 1.0),), "a polynomial in the parameters"),
    ],
)
def test_refuses_constraints_without_sense(found, constraints, message):
    with pytest.raises(InputError, match=message):
        found(constraints=constraints)


def test_exact_constraints_on_base_parameters(demo):
    known = {"base": True, "constraints": (Constraint("m1 - m3", 0.0),)}
    estimate = demo.identified(demo.seen(12, None), fixed={}, **known)
    assert estimate.value("m1") == pytest.approx(estimate.value("m3"), rel=1e-13)
    assert estimate.misfit.dof == 83


def test_start_may_be_given_in_part(demo, noisy):
    told = [replace(p, nominal=None) if p.name == "m2" else p for p in demo.model.parameters]
    bare = replace(demo, model=replace(demo.model, parameters=tuple(told)))
    with pytest.raises(InputError, match="no start of m2"):
        bare.identified(noisy)
    estimate = bare.identified(noisy, start={"m2": 9.0})
    assert estimate.value("m2") == pytest.approx(demo.truth["m2"], rel=5e-3)
