"""Equations at random, from their text to an estimate: an answer, or an `InputError`."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from model_text import model_of

from rotorid import Batch, Channel, InputError, LeastSquares, Record, Sequential, average

ATOMS = st.sampled_from(
    ["x", "x'", "x''", "y", "y'", "y''", *"abcabc", "2", "0.5", "pi", "Omega", "phi", "t", "1e-3"]
)


def larger(inner):
    pair = st.tuples(inner, st.sampled_from("+-***/"), inner).map("({0[0]} {0[1]} {0[2]})".format)
    names = st.sampled_from(["sin", "cos", "tan", "exp", "sqrt", "abs", "sign", "tanh"])
    call = st.tuples(names, inner).map("{0[0]}({0[1]})".format)
    powers = st.sampled_from(["2", "3", "-1", "0.5", "(1/3)"])
    return pair | call | st.tuples(inner, powers).map("{0[0]}^{0[1]}".format)


SUMS = st.lists(st.recursive(ATOMS, larger, max_leaves=6), min_size=1, max_size=4).map(" + ".join)
RIGHT = st.sampled_from(["F", "0", "2*F", "b*F", "F - G"])
EQUATIONS = st.lists(
    st.tuples(SUMS, RIGHT).map("{0[0]} + a*x'' = {0[1]}".format), min_size=1, max_size=2
)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(EQUATIONS, st.integers(0, 2), st.integers(0, 100))
def test_an_answer_or_an_input_error(equations, turns, seed):
    units = [dict.fromkeys("xy", "m"), dict.fromkeys("FG", "N"), dict.fromkeys("abc", "kg")]
    try:
        model = model_of(equations, *units)
    except InputError:
        return
    assert model.unit_faults is not None
    assert model.linear is None or model.linear.rows == len(equations)
    names = [*model.inputs, *model.coordinates]
    samples = np.random.default_rng(seed).standard_normal((60, len(names)))
    record = Record([Channel(n) for n in names], samples, 200.0, 2 * np.pi * 10 * turns)
    periodic = average(record, period_samples=20, harmonics=[0, 1, 2, 3])
    for method in (LeastSquares, Batch, Sequential):
        try:
            estimate = method().estimate(model, [periodic])
        except InputError:
            continue
        assert estimate.status in ("ok", "rejected", "not_identifiable")
        assert str(estimate)
