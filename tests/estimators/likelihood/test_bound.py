"""The Cramer-Rao bound without data: the figures of theory.md, to the digits printed there."""

from dataclasses import replace

import numpy as np
import pytest

import rotorid as rid
from rotorid import Channel, Drive, InputError, MaximumLikelihood, predict_accuracy


def percent(estimate, *names):
    return [100 * estimate.std(name) / abs(estimate.value(name)) for name in names]


def assert_prints(found, text: str, slack: float = 0.02):
    """Measured deviations may be off by Monte-Carlo error: a slack relative to each."""
    for value, word in zip(found, text.split(), strict=True):
        rounding = 0.5 * 10.0 ** -len(word.partition(".")[2])
        assert value == pytest.approx(float(word), abs=rounding + slack * float(word))


def test_all_coordinates_base_parameters(demo):
    """Table of section 1, its last row: exact figures, not measured ones."""
    estimate = predict_accuracy(demo.model, demo.plan(), MaximumLikelihood(base=True))
    names = [
        *("m1", "m2", "m3", "I_t", "k1", "k2", "k1*L1", "k2*L2", "k1*L1^2 + k2*L2^2", "I_p"),
        *("m2*xi", "m2*zeta", "I_t*mu - I_p*mu", "I_t*eta - I_p*eta"),
    ]
    row = ".108 .080 .109 .732 .101 .101 .102 .101 .098 .043 .300 .183 1.56 .866"
    assert_prints(percent(estimate, *names), row, slack=0.015)
    assert estimate.method == "bound"
    assert estimate.misfit is None


UNBALANCE = ("m2*xi", "m2*zeta", "I_t*mu - I_p*mu", "I_t*eta - I_p*eta")
ROW = ("m1", "m2", "I_t", "I_p", "k1", "L2", *UNBALANCE)


@pytest.mark.parametrize(
    ("speeds", "options", "ks", "row", "slack"),
    [
        ((140.0,), {}, None, ".20 .10 1.28 .05 .20 .03 .33 .21 1.9 1.0", 0.02),
        ((140.0, 100.0), {}, None, ".15 .07 .94 .03 .16 .01 .90 .52 41 24", 0.02),
        ((140.0, 100.0), {"gains": ("ki",)}, 0.0, ".17 .02 1.88 .31 .17 .02 .90 .52 41 24", 0.04),
        (
            (140.0, 100.0),
            {"gains": ("ki", "ks")},
            2e5,
            ".42 .05 3.0 .79 .45 .25 .44 .30 28 12",
            0.04,
        ),
    ],
    ids=["bearing planes", "runout", "and currents", "of magnets"],
)
def test_bearing_planes(demo, levitated, bearings, speeds, options, ks, row, slack):
    """With runout where there are two speeds; currents have one scale and one ruler."""
    inputs, plans = demo.model.inputs, [demo.plan(bearings, hertz) for hertz in speeds]
    estimator = MaximumLikelihood(fixed={"L1": 0.3}, runout=len(speeds) > 1, **options)
    if ks is not None:
        drives = {u: Drive(120.0, ks, {q: 1.0}) for u, q in zip(inputs, bearings, strict=True)}
        small = dict.fromkeys(inputs, 1.0 / 120.0)
        plans = [
            replace(p, forces=np.asarray(p.forces) / 120, noise={**p.noise, **small}, drives=drives)
            for p in plans
        ]
        estimator = replace(estimator, constraints=(levitated.weighed,))
    assert_prints(percent(predict_accuracy(demo.model, plans, estimator), *ROW), row, slack)


def test_says_beforehand_what_stays_open(demo, bearings):
    estimate = predict_accuracy(demo.model, demo.plan(bearings))
    assert estimate.status == "not_identifiable"
    assert any(w.startswith("not identifiable: L1, I_t, I_p") for w in estimate.warnings)
    assert "cure: a sensor of theta_x or theta_y" in estimate.warnings
    assert np.isnan(estimate.std("L1"))
    assert predict_accuracy(demo.model, demo.plan([*bearings, "theta_x"])).status == "ok"


def test_accuracy_scales_as_it_should(demo, bearings):
    """Twice the noise, twice the deviation; four times the periods, half of it."""
    estimator = MaximumLikelihood(fixed={"L1": 0.3})
    plan = demo.plan(bearings)
    louder = replace(plan, noise={name: 2 * std for name, std in plan.noise.items()})
    longer = replace(plan, periods=4 * plan.periods)
    one, two, four = (predict_accuracy(demo.model, p, estimator) for p in (plan, louder, longer))
    for value in one.free:
        assert two.std(value.name) == pytest.approx(2 * value.std, rel=1e-6)
        assert four.std(value.name) == pytest.approx(value.std / 2, rel=1e-6)


def test_priors_and_values_enter(demo, bearings):
    plan = demo.plan([Channel(name, "m", gain_std=0.01) for name in bearings])
    estimator = MaximumLikelihood(fixed={"L1": 0.3})
    estimate = predict_accuracy(demo.model, plan, estimator)
    assert percent(estimate, "m1", "I_p") == pytest.approx([0.54, 0.51], abs=0.03)
    light = predict_accuracy(demo.model, plan, estimator, values={"m2": 6.0})
    assert light.value("m2") == 6.0
    assert light.std("m2") != estimate.std("m2")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"forces": [[1.0]]}, "forces of shape"),
        ({"sample_rate": 5001.0}, "a period of 250.05 samples"),
    ],
)
def test_refuses_plans_that_do_not_fit(demo, change, message):
    with pytest.raises(InputError, match=message):
        predict_accuracy(demo.model, replace(demo.plan(), **change))


def test_asks_for_values(demo):
    model = rid.load_model("three-mass")
    bare = replace(model, parameters=tuple(replace(p, nominal=None) for p in model.parameters))
    with pytest.raises(InputError, match="no value of m1"):
        predict_accuracy(bare, demo.plan())
    assert predict_accuracy(bare, demo.plan(), values=demo.truth).status == "ok"
