"""The gate of every method: can it be a machine, does it predict, do its halves agree."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bank import steady
from linear_machines import estimate_of, written
from severities import doubting, rejecting

import rotorid as rid
from rotorid import Estimate, load_model
from rotorid.answer import machine_checks as gate
from rotorid.answer.judge import CONTRADICTING, of_data
from rotorid.core.distributions import Expectation
from rotorid.linear.family import misfit
from rotorid.testing import add_noise

FAMILY = ("ls", "batch", "sequential")
METHODS = (*FAMILY, "ml")
RIGID = load_model("rigid")


def rigid_estimate(std: float = 1e-4, **changes: float) -> Estimate:
    return estimate_of(RIGID, {"m": 7.6, "I_t": 0.118, "I_p": 0.0212, **changes}, std=std)


def test_a_machine_passes():
    assert gate.physical(RIGID, rigid_estimate()) == []


def test_a_polar_inertia_above_twice_the_transverse_one_is_no_machine():
    found = gate.physical(RIGID, rigid_estimate(I_t=0.0077, I_p=0.036))
    assert len(rejecting(found)) == 1
    assert "polar inertia of 0.036" in rejecting(found)[0]
    assert "0.0154" in rejecting(found)[0]
    assert gate.physical(RIGID, rigid_estimate(I_t=0.018, I_p=0.0359)) == []


def test_three_deviations_turn_it_away():
    """2 I_t - I_p = -0.0006; its deviation is sqrt(5) std."""
    for deviations, rejected in ((2.9, False), (3.1, True)):
        std = 0.0006 / np.sqrt(5) / deviations
        found = gate.physical(RIGID, rigid_estimate(std=std, I_t=0.0177, I_p=0.036))
        assert (len(rejecting(found)), len(doubting(found))) == (rejected, 0)
        found = gate.physical(RIGID, rigid_estimate(std=1 / deviations, m=-1.0))
        assert ("m = -1" in " ".join(rejecting(found))) == rejected
        assert ("m = -1" in " ".join(doubting(found))) == (not rejected)


def test_a_value_at_its_limit_is_told_once():
    for mass, told in (
        (0.0, "m is held at its limit, 0"),
        (-1e-9, "m = -1e-09 kg, which the model"),
    ):
        (note,) = gate.physical(RIGID, rigid_estimate(std=1e-3, m=mass))
        assert note.text.startswith(told)
        assert note.severity == "doubts"


def test_what_is_fixed_counts_in_the_balance():
    known = rigid_estimate()
    fixed = tuple(replace(v, fixed=v.name == "I_t", std=0.0) for v in known.parameters)
    smaller = replace(known, parameters=fixed, covariance=1e-8 * np.eye(8))
    assert gate.physical(RIGID, smaller) == []
    heavy = tuple(replace(v, value=1.0) if v.name == "I_p" else v for v in fixed)
    assert rejecting(gate.physical(RIGID, replace(smaller, parameters=heavy)))


@pytest.mark.parametrize(
    ("inertia", "stiffness", "doubted"),
    [
        (1000.0, 1000.0, True),  # positions in m that are told as mm
        (1e-3, 1e-3, True),
        (110.0, 110.0, True),
        (90.0, 90.0, False),
        (1 / 110.0, 1 / 110.0, True),
        (1 / 90.0, 1 / 90.0, False),
        (1000.0, 2900.0, True),
        (1000.0, 3100.0, False),
        (1.0, 1.0, False),
    ],
)
def test_one_factor_in_all_values_is_a_unit(inertia, stiffness, doubted):
    model = load_model("jeffcott")
    size = {"m": inertia, "k": stiffness, "c": 7.0}
    values = {name: factor * model.nominal[name] for name, factor in size.items()}
    found = gate.physical(model, estimate_of(model, values, std=1e-9))
    assert not rejecting(found)
    assert bool(doubting(found)) == doubted
    if doubted:
        assert "look the units up" in doubting(found)[0]


TILTING = written(
    "a tilting disc",
    ["It*a'' + Ip*Omega*b' + k*a = Ma", "It*b'' - Ip*Omega*a' + k*b = Mb"],
    "a rad, b rad",
    "Ma N m, Mb N m",
    "It 0.01 kg m^2, Ip 0.01 kg m^2, k 1e3 N m/rad",
)


def tilting_estimate(ratio: float, std: float = 1e-3) -> Estimate:
    """Return an estimate whose polar inertia is so many of its deviations."""
    return estimate_of(TILTING, {"It": 0.03, "Ip": ratio * std}, std=std)


def test_a_rotor_that_turns_the_other_way_is_told():
    """Nobody called Ip positive: it is the sense of rotation that it contradicts."""
    assert gate.physical(TILTING, tilting_estimate(3.1)) == []
    assert gate.physical(TILTING, tilting_estimate(-2.9)) == []
    (fault,) = rejecting(gate.physical(TILTING, tilting_estimate(-3.1)))
    assert "a polar inertia of -0.0031 about a, b" in fault
    assert "the speed is stated backwards" in fault


SEAL, PLANES = ("cq", "cq 0.8 kg"), ("16*I_p", "I_p 0.05 kg m^2")  # over the square of .25 m


@pytest.mark.parametrize(
    ("coupling", "size", "faults"),
    [(SEAL, 5.0, 0), (SEAL, -1.0, 0), (PLANES, 0.1, 0), (PLANES, -0.1, 1), (PLANES, 0.4, 1)],
)
def test_a_seal_is_no_polar_inertia(coupling, size, faults):
    """Of displacements only what is in kg m^2 is one: 2 m = 4 kg bounds 16 I_p."""
    name, parameter = coupling
    model = written(
        "a mass between two planes, coupled by the speed",
        [f"m*x'' + {name}*Omega*y' + k*x = F", f"m*y'' - {name}*Omega*x' + k*y = G"],
        *("x m, y m", "F N, G N", f"m 2.0 kg, k 1e5 N/m, {parameter}"),
    )
    estimate = estimate_of(model, {"cq": size, "I_p": size}, std=1e-4)
    assert len(rejecting(gate.physical(model, estimate))) == faults


IN_X, IN_Y = "m*x'' + k*x", "n*y'' + k*y"


def in_planes(*equations: str) -> rid.Model:
    parameters = "m 2.0 kg, n 3.0 kg, k 1e5 N/m"
    return written("two planes", equations, "x m, y m", "F N, G N", parameters)


@pytest.mark.parametrize(
    "equations",
    [
        [f"{IN_X} = F", f"{IN_Y} = G"],
        [f"{IN_Y} = G", f"{IN_X} = F"],
        [f"-({IN_Y}) = -G", f"{IN_X} = F"],
        [f"2*({IN_X}) = 2*F", f"{IN_Y} = G"],
        [f"{IN_X} + {IN_Y} = F + G", f"{IN_X} - ({IN_Y}) = F - G"],
    ],
)
def test_equations_stand_in_any_order(equations):
    model = in_planes(*equations)

    def judged(m: float) -> list[rid.Note]:
        return gate.physical(model, estimate_of(model, {"m": m}, std=1e-4))

    assert judged(2.0) == []
    if "+ n" not in equations[0]:  # of sums no equation is that of x
        assert "a negative inertia of x" in rejecting(judged(-2.0))[0]


@pytest.mark.parametrize(
    ("mass", "hertz", "faults"),
    [(-2e-7, (1.0, 10.0), 1), (-2e-9, (1.0, 10.0), 0), (-2e-9, (300.0,), 1), (-2e-9, (), 1)],
)
def test_a_mass_that_is_rounding_of_the_forces_is_not_judged(mass, hertz, faults):
    """At 10 Hz 1e-9 of a stiffness of 1e5 N/m is the force of 2.5e-8 kg."""
    model = in_planes(f"{IN_X} = F", f"{IN_Y} = G")
    estimate = estimate_of(model, {"m": mass}, std=0.0, lines_hz=hertz)
    assert len(rejecting(gate.physical(model, estimate))) == faults


TOWER = written(
    "two storeys, nothing declared",
    ["m1*x1'' + k*(x1 - x2) = F", "m2*x2'' + k*(x2 - x1) + g*x2 = 0"],
    *("x1 m, x2 m", "F N", "m1 kg, m2 kg, k N/m, g N/m"),
)
STOREYS = {"m1": 3.0, "m2": 2.0, "k": 900.0, "g": 2500.0}


def tower(seed, truth=STOREYS, periods=8, break_after=None):
    """Return periods of the tower; the force is 5 N on each line, the noise a thousandth."""
    record = steady(TOWER, truth, np.full((4, 1), 5.0), (1, 2, 3, 4), 1.0, 100.0, periods)
    spectra = record.spectra.copy()
    spectra[break_after or periods :, :, 1:] *= 1.2
    size = 1e-3 * np.sqrt(2 * record.samples) * np.abs(spectra[0]).mean(axis=0)
    noise = dict(zip(record.names, size, strict=True))
    return add_noise(replace(record, spectra=spectra), noise, np.random.default_rng(seed))


def estimator(method, truth=STOREYS, **options):
    return rid.MaximumLikelihood(start=truth, **options) if method == "ml" else method


@pytest.mark.parametrize("method", METHODS)
def test_a_negative_mass_is_turned_away_by_every_method(method):
    truth = {**STOREYS, "m2": -2.0}
    estimate = rid.identify(TOWER, tower(1, truth), estimator(method, truth))
    assert estimate.status == "rejected"
    assert any("negative inertia of x2" in text for text in estimate.warnings)


@pytest.mark.parametrize("method", FAMILY)
def test_equations_that_do_not_describe_the_record_are_turned_away(method):
    record = tower(2)
    wrong = replace(record, spectra=record.spectra[:, ::-1])
    assert rid.identify(TOWER, wrong, method).status == "rejected"


def test_noise_is_no_fault_of_the_prediction():
    estimate = rigid_estimate()
    for error, noise, told in ((0.8, 0.1, 1), (0.8, 0.4, 0), (0.49, 0.0, 0), (0.51, 0.0, 1)):
        off = replace(estimate, prediction={"F_xa": rid.Prediction(error)})
        assert len(rejecting(gate.prediction(off, {"F_xa": noise}))) == told


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("broken", [True, False])
def test_halves_that_differ_are_turned_away(method, broken):
    record = tower(3, periods=60, break_after=30 if broken else None)
    # Left to choose, ml takes the covariance that holds the break, and is as unsure as it should.
    estimate = rid.identify(TOWER, record, estimator(method, covariance="white"))
    told = any("halves of the record differ" in text for text in estimate.warnings)
    assert told == broken
    assert (estimate.status == "rejected") == broken


def test_halves_within_six_deviations_agree():
    std = np.array([1.0, 0.0])
    for apart, faults in ((5.9, 0), (6.1, 1)):
        halves = np.array([[apart, 9.0], [-apart, -9.0]])
        assert len(rejecting(gate.agreement(["a", "fixed"], halves, std))) == faults
    (told,) = gate.agreement(["xi"], np.array([[-7.0], [7.0]]), np.ones(1), {"xi"})
    assert "the speed is not the one stated, or wanders" in told.text


@pytest.mark.parametrize("method", ["ls", "ml"])
@pytest.mark.parametrize(("periods", "held"), [(7, False), (8, True)])
def test_halves_of_four_periods_are_held_against_each_other(monkeypatch, method, periods, held):
    seen, agreement = [], gate.agreement

    def watched(names, halves, *rest):
        seen.append(bool(np.any(halves)))
        return agreement(names, halves, *rest)

    monkeypatch.setattr(gate, "agreement", watched)
    rid.identify(TOWER, tower(3, periods=periods), estimator(method))
    assert any(seen) == held


@pytest.mark.parametrize(
    ("chance", "status", "told"),
    [
        (0.9e-6, "rejected", "the data reject the model"),
        (1.1e-6, "ok", "the model is doubtful"),
        (0.4e-3, "ok", "the model is doubtful"),
        (0.6e-3, "ok", None),
    ],
)
def test_a_misfit_that_chance_gives_once_in_a_million_is_rejected(
    monkeypatch, chance, status, told
):
    record, p_value = tower(3, periods=60), Expectation.p_value
    found = pytest.approx(rid.identify(TOWER, record, estimator("ml")).misfit.cost, rel=1e-6)
    monkeypatch.setattr(
        Expectation, "p_value", lambda self, cost: chance if cost == found else p_value(self, cost)
    )
    estimate = rid.identify(TOWER, record, estimator("ml"))
    assert estimate.status == status
    doubt = f": ok, but doubtful (p = {chance:.1g})" if told == "the model is doubtful" else ""
    assert doubt in str(estimate.summary()[0])
    for text in ("the data reject the model", "the model is doubtful"):
        assert any(warning.startswith(text) for warning in estimate.warnings) == (text == told)


def test_identical_periods_state_no_deviations():
    periods = steady(TOWER, STOREYS, np.full((2, 1), 5.0), (1, 2), 1.0, 100.0, 5)
    estimate = rid.identify(TOWER, periods, "ls")
    assert all(v.std is None for v in estimate.parameters)
    assert any("no deviations can be stated" in text for text in estimate.warnings)


def test_identical_periods_hold_no_noise_that_biases(monkeypatch):
    model, forces = load_model("jeffcott"), [[0, 0], [200, 0], [0, -150j]]
    judged: list[str] = []
    monkeypatch.setattr(gate, "noise_bias", lambda *rest: judged.append("") or ())
    for noise in ({}, {"F_x": 0.1, "F_y": 0.1, "x": 1e-8, "y": 1e-8}):
        known = {"noise": noise, "rng": np.random.default_rng(6)}
        record = steady(model, {}, forces, (1, 3, 5), 10.0, 1000.0, 8, hertz=30, **known)
        rid.LeastSquares().estimate(model, [record])
        assert bool(judged) == bool(noise)


def test_methods_go_by_their_names():
    with pytest.raises(rid.InputError, match="one of ls, batch, sequential, ml"):
        rid.identify(TOWER, [], "mle")


def test_a_cost_too_good_to_be_chance_is_told():
    """Scatter between periods that the mean does not have: each period off, the sum right."""
    record = tower(5, periods=20)
    size = np.abs(record.mean_spectrum).mean(axis=0)
    pairs = np.random.default_rng(5).standard_normal((10, *record.spectra.shape[1:], 2))
    noise = 0.05 * size[:, None] * np.stack([pairs, -pairs], axis=1) @ np.array([1, 1j])
    noisy = replace(record, spectra=record.spectra + noise.reshape(record.spectra.shape))
    estimate = rid.identify(TOWER, noisy, estimator("ml", covariance="white"))
    assert any("too good to be chance" in text for text in estimate.warnings)


@pytest.mark.parametrize("check", sorted(CONTRADICTING))
def test_what_the_data_contradict_is_no_plain_answer(check):
    warned = of_data([rid.Note(check, "warns", "something", on=("x",))], "ok")
    assert len(warned) == 1
    for severity in ("passes", "says"):
        assert not of_data([rid.Note(check, severity, "something", on=("x",))], "ok")
    assert rigid_estimate().with_notes(*warned).status == "rejected"


def test_other_warnings_of_the_data_leave_the_answer():
    coarse = rid.Note("quantized", "warns", "coarse", on=("x",))
    assert not of_data([coarse], "ok")
    (told,) = of_data([coarse], "rejected")  # but a channel at rest is looked at first
    assert told.text == "before any suspect, see to quantized, x: coarse"


# The residual of least squares against its scatter: moments, chances, and machines that differ.


FREE, LINES, ROWS = 3, 6, 2
MULTIPLICITY = np.array([2.0, 2, 2, 2, 2, 1])
"""The last line is that of Nyquist: real."""


def complexes(rng, *shape):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def drawn_equations(rng, dof):
    """Return what draws a fit of random equations, solved with weights that are not the best."""
    design, mixed = complexes(rng, LINES, ROWS, FREE), complexes(rng, LINES, ROWS, ROWS)
    design[-1], mixed[-1] = design[-1].real, mixed[-1].real
    covariance = mixed @ mixed.conj().swapaxes(1, 2) * rng.uniform(0.1, 9.0, (LINES, 1, 1))
    size = MULTIPLICITY[:, None] * rng.uniform(0.2, 5.0, (LINES, ROWS))
    matrix = np.concatenate([(size[..., None] * part) for part in (design.real, design.imag)])
    right = np.concatenate([design.real, design.imag])
    normal = np.einsum("krf,krg->fg", right, matrix)
    weighted = np.moveaxis(size[..., None] * design.conj(), -1, 0).reshape(FREE, -1)
    gains = np.linalg.solve(normal, weighted).reshape(FREE, LINES, ROWS)

    def draw():
        noise = np.einsum("krs,ks->kr", mixed, complexes(rng, LINES, ROWS)) / np.sqrt(2)
        noise[-1] = mixed[-1] @ rng.standard_normal(ROWS)
        noise *= np.sqrt(covariance[:, 0, 0].real / (np.abs(mixed[:, 0]) ** 2).sum(axis=1))[:, None]
        answer = np.einsum("fkr,kr->f", gains, noise).real
        return SimpleNamespace(
            residual=noise - design @ answer,
            design=design,
            gains=gains,
            scatter=SimpleNamespace(matrices=covariance, dof=dof),
            size=np.ones(ROWS),
            weight=MULTIPLICITY,
        )

    return draw


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", range(3))
def test_mean_and_variance_are_those_of_the_residual(number):
    draw = drawn_equations(np.random.default_rng([5, number]), 10**12)
    found = [misfit([draw()]) for _ in range(2000)]
    costs, expected = np.array([cost for cost, _ in found]), found[0][1]
    assert costs.mean() == pytest.approx(expected.mean, rel=0.04)
    assert costs.var() == pytest.approx(expected.variance, rel=0.12)
    chances = np.array([each.p_value(cost) for cost, each in found])
    for chance in (0.05, 0.5):
        spread = np.sqrt(chance * (1 - chance) / len(chances))
        assert (chances < chance).mean() == pytest.approx(chance, abs=4 * spread + 0.02)


def test_few_periods_leave_a_larger_and_wider_cost():
    draws = (drawn_equations(np.random.default_rng(6), dof) for dof in (10**12, 9))
    known, few = (misfit([draw()])[1] for draw in draws)
    assert few.mean == pytest.approx(known.mean * 9 / 8)  # the mean of F with 18 of freedom
    assert few.variance / few.mean**2 > 1.2 * known.variance / known.mean**2


JEFFCOTT = rid.load_model("jeffcott").substitute({"xi": 0.0, "zeta": 0.0})
HARMONICS = np.array([1, 3, 5, 7, 9, 11])
TRUTH = np.array([2.0, 60.0, 2e5])


def shaken(rng, apart=1.0, position=3e-7, periods=40):
    """Return periods of a disc shaken at standstill, its second stiffness so many times the first.

    Closed form, line by line; noise of .2 N, and of so many metres.
    """
    s = 2j * np.pi * 20.0 * HARMONICS
    force = 5 * np.exp(2j * np.pi * rng.random((len(HARMONICS), 2)))
    mass, damping, stiffness = TRUTH
    stiff = stiffness * np.array([1.0, apart])
    motion = force / ((mass * s**2 + damping * s)[:, None] + stiff)
    samples = 250
    waves = np.exp(2j * np.pi * np.outer(np.arange(samples) / samples, HARMONICS))
    clean = np.tile((waves @ np.hstack([force, motion])).real, (periods, 1))
    noisy = clean + [0.2, 0.2, position, position] * rng.standard_normal(clean.shape)
    channels = [rid.Channel(name) for name in ("F_x", "F_y", "x", "y")]
    return rid.average(rid.Record(channels, noisy, 5000.0), 20.0, harmonics=HARMONICS)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("method", FAMILY)
def test_a_right_model_is_what_its_noise_leaves(method, monkeypatch):
    chances, judge = [], gate.residual
    monkeypatch.setattr(
        gate, "residual", lambda c, e: (chances.append(e.p_value(c)), judge(c, e))[1]
    )
    rng = np.random.default_rng(7)
    found = [rid.identify(JEFFCOTT, shaken(rng), method) for _ in range(60)]
    assert {estimate.status for estimate in found} == {"ok"}
    assert 0.35 < np.mean(chances) < 0.65
    assert min(chances) > 1e-4


@pytest.mark.parametrize("method", FAMILY)
def test_a_wrong_model_is_turned_away(method):
    """A stiffness that differs by 2 % between two axes: the prediction is off by a few per cent."""
    estimate = rid.identify(JEFFCOTT, shaken(np.random.default_rng(8), apart=1.02), method)
    assert estimate.status == "rejected"
    assert any("times what noise leaves of them" in text for text in estimate.warnings)
    assert estimate.prediction["F_y"].relative_error < gate.UNPREDICTED


@pytest.mark.slow
def test_the_bias_of_noise_is_that_of_many_records(monkeypatch):
    """What halves tell of a bias is, in the mean, by what many answers are off."""
    told, judge = [], gate.noise_bias
    monkeypatch.setattr(gate, "noise_bias", lambda n, b, s: (told.append(b), judge(n, b, s))[1])
    rng = np.random.default_rng(9)
    found = [rid.identify(JEFFCOTT, shaken(rng, position=4e-5), "ls") for _ in range(60)]
    values = np.array([[v.value for v in e.parameters] for e in found])
    names = [v.name for v in found[0].parameters]
    order = [names.index(name) for name in ("m", "c", "k")]
    error = values[:, order].mean(axis=0) - TRUTH
    scatter = values[:, order].std(axis=0) / np.sqrt(len(values))
    bias = np.array(told)[:, order].mean(axis=0)
    assert (np.abs(error) > 6 * scatter)[[0, 2]].all()  # there is one
    assert (np.abs(bias - error) < 4 * scatter + 0.1 * np.abs(error)).all()


def test_a_bias_is_told_and_then_turned_away():
    std = np.array([1.0, 0.0])
    for bias, doubts, faults in ((0.9, 0, 0), (-1.1, 1, 0), (9.9, 1, 0), (-10.1, 0, 1)):
        notes = list(gate.noise_bias(["m", "fixed"], np.array([bias, 99.0]), std))
        assert (len(doubting(notes)), len(rejecting(notes))) == (doubts, faults)


def test_a_residual_is_doubted_and_then_turned_away():
    expected = Expectation(20.0, 40.0, 20)
    seen = {0.002: (0, 0), 5e-4: (1, 0), 2e-6: (1, 0), 5e-7: (0, 1)}
    for chance, counts in seen.items():
        notes = list(gate.residual(expected.exceeded(chance), expected))
        assert (len(doubting(notes)), len(rejecting(notes))) == counts
