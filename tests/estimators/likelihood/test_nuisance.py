"""Unknowns of the measurement by their effects: gains, lags, force laws read again."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from bank import agrees, recovered, stated, steady, times
from differences import gradient_holds

import rotorid as rid
from rotorid import Channel, Drive, InputError, MaximumLikelihood, PeriodicRecord, identify, spectra
from rotorid.data.observation import Observation
from rotorid.experiment.schema import DynamicsEntry
from rotorid.force.channel_dynamics import (
    UNKNOWN,
    Constant,
    Dynamics,
    EddyCurrents,
    FirstOrder,
    Measured,
    SecondOrder,
)
from rotorid.force.laws import Differential, Flux
from rotorid.force.reading import ForceReading, forces
from rotorid.likelihood import unknowns as nuisances
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.effects import Scales
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.rivals_read import multiplied
from rotorid.likelihood.unknowns import Nuisances, Scalar, Unknown, bends, unknowns_of
from rotorid.models.knowledge import Knowledge
from rotorid.signals.spectrum import shifted, synthesize
from rotorid.testing import bind

# Calibration constants as unknowns; several records of one machine.


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "sign"), [("force", -1), ("position", 1)])
def test_common_delay(demo, bearings, kind, sign):
    """It costs nearly nothing: k1 .20 -> .22 % (theory.md, section 3)."""
    clean = demo.record(bearings)
    late = times(clean, bearings, np.exp(-5e-6j * clean.omega))
    record = demo.noisy(late, np.random.default_rng(31))
    estimate = demo.identified(record, delays=(kind,), effort="quick")
    assert estimate.status == "ok"
    delay = estimate[f"delay[{kind}]"]
    assert delay.value == pytest.approx(sign * 5e-6, abs=4 * delay.std)
    assert delay.unit == "s"
    assert 100 * estimate.std("k1") / demo.truth["k1"] == pytest.approx(0.22, abs=0.01)


def test_delay_of_one_channel_with_prior(demo, bearings):
    clean = demo.record(bearings)
    # 12 of 20 us were corrected on reading: the channel says so, with its deviation.
    late = times(clean, ["y3"], np.exp(-1j * clean.omega * (20e-6 - 12e-6)))
    late = stated(late, ["y3"], delay=12e-6, delay_std=10e-6)
    estimate = demo.identified(demo.noisy(late, np.random.default_rng(34)))
    agrees(estimate, {**demo.truth, "delay[y3]": 20e-6})
    assert estimate.std("delay[y3]") < 5e-6


@pytest.fixture(scope="module")
def driven(levitated):
    """Records of currents at two speeds, and what their identification takes."""
    known = {"fixed": {"L1": 0.3}, "constraints": (levitated.weighed,)}
    return levitated.seen(35, 140.0, 100.0), MaximumLikelihood(runout=True, **known)


def test_force_slope_of_each_input(levitated, driven):
    records, estimator = driven
    model = levitated.machine.model
    estimate = identify(model, records, replace(estimator, gains=("ki", "ks*")))
    each = {f"ks[{name}]": levitated.ks for name in model.inputs}
    agrees(estimate, {**levitated.truth, **each})
    assert estimate["ki[F_x1]"].unit == "N/A"
    assert estimate["ks[F_x1]"].unit == "N/m"


def test_force_slope_of_each_bearing(levitated, driven):
    """Inputs whose laws state the same have one in common; two bearings that differ, two."""
    records, estimator = driven
    records = [on_half(record, ("F_x3", "F_y3")) for record in records]
    model = levitated.machine.model
    estimate = identify(model, records, replace(estimator, gains=("ki", "ks")))
    each = {"ks[F_x1, F_y1]": levitated.ks, "ks[F_x3, F_y3]": 2 * levitated.ks}
    assert "ks" not in [value.name for value in estimate.parameters]
    agrees(estimate, levitated.truth | each)


def test_what_is_said_of_a_wrong_force_slope(levitated, driven):
    found = unknowns_of([bind(levitated.machine.model, driven[0][0])])
    cures = {unknown.scalars[0].name: unknown.cure for unknown in found}
    assert 'gains = ["ks"]' in cures["ks"]
    assert 'gains = ["ks*"]' in cures["ks[F_x1]"]


def on_half(record, inputs):
    """State twice the slope at half the displacement: the same force by another law."""
    for name in inputs:
        drive = record.channels[record.index(name)].drive
        halves = {place: 0.5 * share for place, share in drive.position.items()}
        record = stated(record, [name], drive=replace(drive, ks=2 * drive.ks, position=halves))
    return record


def test_nuisances_may_be_fixed_or_known(levitated, driven):
    records, estimator = driven
    known = {"fixed": {"L1": 0.3, "ki[F_x1]": 120.0}, "known": {"ks": (2e5, 2e3)}}
    estimator = replace(estimator, **known, gains=("ki", "ks"), constraints=())
    estimate = identify(levitated.machine.model, records, estimator)
    agrees(estimate, levitated.truth)
    assert "ki[F_x1]" not in [value.name for value in estimate.nuisance]
    assert estimate.std("ks") <= 2e3 * 1.01
    assert estimate.covariance.shape == (len(estimate.free),) * 2


def test_records_with_different_sensors_lines_and_speeds(demo, bearings):
    rng = np.random.default_rng(38)
    sensors = [*bearings[:2], Channel("probe", "m", reads={"x2": 1.0, "theta_y": -0.02})]
    records = [
        demo.seen(rng),
        demo.seen(rng, sensors, hertz=60.0, harmonics=(2, 3, 4, 6), periods=100),
        demo.seen(rng, hertz=0.0, harmonics=(1, 5, 9), periods=50),
    ]
    estimate = demo.identified(records)
    agrees(estimate, demo.truth)
    assert estimate.misfit.dof == 2 * (6 * 4 + 4 * 3 + 3 * 4) - 12
    assert estimate.periods == 50
    assert {m.record for m in estimate.line_misfit} == {0, 1, 2}
    alone = demo.identified(records[0])
    for value in estimate.free:
        assert value.std < alone.std(value.name) * 1.02


def test_combination_sensors_equal_the_coordinates_they_read(demo):
    """A full set of combinations is a change of coordinates: nothing else changes."""
    names = ["x1", "x3", "y1", "y3"]
    mixing = np.array([[1, 0.5, 0, 0], [-0.2, 1, 0, 0], [0, 0, 2, 0], [0, 0, 0.1, 1]])
    plain = demo.seen(40, names)
    spectra = plain.spectra.copy()
    spectra[:, :, 4:] = spectra[:, :, 4:] @ mixing.T
    reads = [dict(zip(names, row, strict=True)) for row in mixing.tolist()]
    channels = [Channel(f"s{i}", "m", reads=each) for i, each in enumerate(reads)]
    mixed = replace(plain, spectra=spectra, channels=(*plain.channels[:4], *channels))
    one, two = map(demo.identified, (plain, mixed))
    assert two.misfit.cost == pytest.approx(one.misfit.cost, rel=1e-8)
    for value in one.free:
        assert two.value(value.name) == pytest.approx(value.value, abs=1e-3 * value.std)


def test_redundant_sensors_count(demo, bearings):
    again = Channel("again", "m", reads={"x1": 1.0})
    estimate = demo.identified(demo.seen(41, [*bearings, again]))
    assert estimate.status == "ok"
    assert estimate.misfit.dof == 6 * 2 * 5 - 12


@pytest.mark.parametrize(
    ("place", "told"), [("x9", "a force law at 'x9'"), ("x1'", "a force law at a velocity")]
)
def test_refuses_a_force_law_where_no_displacement_is(demo, bearings, place, told):
    record = stated(demo.record(bearings), ["F_x1"], drive=Drive(120.0, 2e5, {place: 1.0}))
    with pytest.raises(InputError, match=f"F_x1: found {told}"):
        demo.identified(record)


def test_levers_of_a_force_law_are_parameters():
    """A rigid rotor whose currents act where L_a and L_b say, its sensors 20 mm further out."""
    model, ki, ks, out = rid.load_model("rigid"), 95.0, 4e5, 0.02
    levers = {"xa": ("x", "theta_y", "L_a", -1), "ya": ("y", "theta_x", "L_a", 1)}
    levers |= {"xb": ("x", "theta_y", "L_b", 1), "yb": ("y", "theta_x", "L_b", -1)}
    at = {p: {q: 1.0, f"{arm}*{tilt}": sign} for p, (q, tilt, arm, sign) in levers.items()}
    reads = {p: {**at[p], tilt: sign * out} for p, (_, tilt, _, sign) in levers.items()}

    def seen(further: float) -> PeriodicRecord:
        there = [
            Channel(f"s_{p}", "m", reads={q: 1.0, tilt: sign * (model.nominal[arm] + further)})
            for p, (q, tilt, arm, sign) in levers.items()
        ]
        forces = 10 * np.exp(1j * np.outer(np.arange(1, 6), [1.0, 2.0, 4.0, 7.0]))
        return steady(model, {}, forces, (1, 3, 5, 7, 9), 20.0, 5e3, 4, hertz=100, sensors=there)

    record = seen(out)
    spectra = record.spectra.copy()
    spectra[:, :, :4] = (spectra[:, :, :4] - ks * seen(0.0).spectra[:, :, 4:]) / ki
    channels = [Channel(f"F_{p}", "A", drive=Drive(ki, ks, at[p])) for p in levers]
    channels += [Channel(f"s_{p}", "m", reads=reads[p]) for p in levers]
    currents = replace(record, spectra=spectra, channels=tuple(channels))
    found = identify(model, currents, MaximumLikelihood(fixed={"L_a": model.nominal["L_a"]}))
    recovered(found, model.nominal)


def test_what_the_marks_leave_open_is_in_the_direction_of_the_unbalance(demo):
    """A phase known to 0.02 rad: the amplitude keeps its deviation, the direction takes it over."""
    record = demo.seen(41)
    exact = demo.identified(record, effort="quick")
    open_ = demo.identified(replace(record, phase_std=0.02))
    assert [v.name for v in open_.nuisance] == ["phase[0]"]
    assert "phase[0]" not in " ".join(open_.warnings)
    assert open_.std("phase[0]") == pytest.approx(0.02, rel=0.01)
    xi, zeta = demo.truth["xi"], demo.truth["zeta"]
    assert open_.std("xi") == pytest.approx(np.hypot(exact.std("xi"), 0.02 * zeta), rel=0.02)
    assert open_.std("zeta") == pytest.approx(np.hypot(exact.std("zeta"), 0.02 * xi), rel=0.02)
    assert open_.std("m2") == pytest.approx(exact.std("m2"), rel=1e-6)


def stretches(records, wanted):
    """A kind that the package does not have: a gain that grows with the square of frequency."""
    sensors = frozenset(s.channel.name for r in records for s in r.sensors)
    scales = Scales(
        sensors,
        lambda values, omega: 1 / (1 + values[0] * omega**2 + 0j),
        lambda values, omega: (-(omega**2) / (1 + values[0] * omega**2) + 0j)[:, None],
    )
    return [Unknown((Scalar("stretch[position]", "s^2", 0.0, additive=True),), sensors, (scales,))]


@pytest.mark.slow
def test_a_further_kind_is_one_function(demo, bearings, monkeypatch):
    """Start, fit, deviation, report and the record's covariance: nothing else knows of it."""
    size = 2e-7
    record = demo.record(bearings)
    longer = times(record, bearings, 1 + size * record.omega**2)
    noisy = demo.noisy(longer, np.random.default_rng(5))
    assert demo.identified(noisy, effort="quick").misfit.p_value < 1e-6
    monkeypatch.setattr(nuisances, "KINDS", (*nuisances.KINDS, stretches))
    estimate = demo.identified(noisy)
    agrees(estimate, {**demo.truth, "stretch[position]": size})
    assert estimate["stretch[position]"].std < size / 10
    assert "stretch[position]" in str(estimate)


# Dynamics of channels: known, known with a deviation, unknown; first and second order, eddy.


BANDWIDTH = Constant("bandwidth", "Hz", 1500.0)
KINDS = {
    "first order": FirstOrder(bandwidth=BANDWIDTH),
    "second order": SecondOrder(bandwidth=BANDWIDTH, damping=Constant("damping", "1", 0.7)),
    "eddy currents": EddyCurrents(eddy=Constant("eddy", "s", 3e-5)),
}


@pytest.mark.parametrize("name", KINDS)
def test_slopes_are_those_of_the_logarithm(name):
    dynamics, omega = KINDS[name], 2 * np.pi * np.array([1.0, 50.0, 900.0])
    values, step = dynamics.values, 1e-5
    for j in range(len(values)):
        moved = np.ones(len(values))
        moved[j] += step
        up, down = (np.log(dynamics.response(omega, values * f)) for f in (moved, 2 - moved))
        found = dynamics.slopes(omega, values)[:, j]
        np.testing.assert_allclose(found, (up - down) / (2 * step * values[j]), rtol=1e-7)


@pytest.mark.parametrize("name", KINDS)
def test_half_power_and_limits(name):
    dynamics = KINDS[name]
    assert abs(dynamics.response(np.array([1e-12]), dynamics.values)[0] - 1) < 1e-6
    at = 2 * np.pi * np.array([1500.0])
    wanted = {"first order": 1 / (1 + 1j), "second order": 1 / 1.4j}
    if name in wanted:
        assert dynamics.response(at, dynamics.values)[0] == pytest.approx(wanted[name])


def passed_through(record, truth, told, names):
    """Return a record whose channels went through dynamics, corrected by what is told of them."""
    gain = truth.response(record.omega, truth.values)
    factor = told.correction(record.omega) * (1 / gain if truth.actuator else gain)
    return stated(times(record, names, factor), names, dynamics=told)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("actuator", [True, False])
@pytest.mark.parametrize("name", KINDS)
def test_an_unknown_constant_that_channels_share_is_found(demo, bearings, name, actuator):
    """The amplifiers of all inputs, or the filters of all sensors, start 20 % off."""
    truth = replace(KINDS[name], actuator=actuator, shared="loop")
    names = demo.model.inputs if actuator else bearings
    off = {c.name: replace(c, value=1.2 * c.value, std=UNKNOWN) for c in truth.constants}
    guessed = replace(truth, **off)
    record = passed_through(demo.record(bearings), truth, guessed, names)
    estimate = demo.identified(record, start=demo.start(np.random.default_rng(3), 0.1))
    found = {v.name: v.value for v in estimate.nuisance}
    assert list(found) == [f"{c.name}[loop]" for c in truth.constants]
    for constant in truth.constants:
        assert found[f"{constant.name}[loop]"] == pytest.approx(constant.value, rel=1e-6)
    assert estimate.value("m2") == pytest.approx(demo.truth["m2"], rel=1e-7)


def test_a_bandwidth_known_with_a_deviation_is_drawn_to_its_prior(demo):
    given = FirstOrder(bandwidth=replace(BANDWIDTH, std=1e-3), actuator=True)
    truth = replace(given, bandwidth=BANDWIDTH)
    (value,) = demo.identified(passed_through(demo.seen(5), truth, given, ["F_x1"])).nuisance
    assert value.name == "bandwidth[F_x1]"
    assert value.value == pytest.approx(1500.0, abs=4e-3)
    assert value.std == pytest.approx(1e-3, rel=1e-3)


def test_a_measured_response_is_linear_in_amplitude_and_phase():
    table = Measured(frequency=[0.0, 100.0], measured=[1.0, 0.5j])
    middle = table.response(np.array([2 * np.pi * 50.0]), table.values)[0]
    assert middle == pytest.approx(0.75 * np.exp(0.25j * np.pi))
    with pytest.raises(InputError, match=r"a line at 101 Hz.*0 to 100 Hz"):
        table.response(np.array([2 * np.pi * 101.0]), table.values)
    with pytest.raises(InputError, match="sort the table"):
        Measured(frequency=[1.0, 1.0], measured=[1.0, 1.0])
    with pytest.raises(InputError, match="leave such points out"):
        Measured(frequency=[1.0, 2.0], measured=[1.0, 0.0])
    assert table == Measured(frequency=[0.0, 100.0], measured=[1.0, 0.5j])


def test_constants_are_positive():
    with pytest.raises(ValueError, match=r"bandwidth: found .* more than 0"):
        DynamicsEntry(bandwidth="0 Hz")


# What is no factor of a line, as unknowns: a mass on a spring between two magnets.


MODEL = rid.load_model("jeffcott")
TRUTH = {"m": 2.0, "c": 60.0, "k": 4e5, "xi": 0.0, "zeta": 0.0}
MAGNET = Differential(K=4e-6, bias=2.0, gap=4e-4)
RATE, F0, PERIODS, SIZE = 5000.0, 10.0, 20, 500
LINES = np.array([1, 3, 5, 7, 9, 11, 15, 19, 23])


def samples(size: float) -> np.ndarray:
    """Return currents and displacements, x and y, of the true magnets, without noise."""
    rng = np.random.default_rng(1)
    omega = 2 * np.pi * F0 * LINES
    pushed = size * np.exp(2j * np.pi * rng.uniform(size=(len(LINES), 2)))
    moved = pushed / (TRUTH["k"] - TRUTH["m"] * omega**2 + 1j * omega * TRUTH["c"])[:, None]
    force, position = synthesize(pushed, LINES, SIZE), synthesize(moved, LINES, SIZE)
    current = MAGNET.flowing(force, position)
    return np.tile(np.concatenate([current, position], axis=1), (PERIODS, 1))


Change = Callable[[np.ndarray], np.ndarray]
COLUMNS = {n: Channel(n, u) for n, u in (("i", "A"), ("j", "A"), ("x", "m"), ("y", "m"))}


def read_by(
    law: Differential,
    columns: np.ndarray,
    channels: Mapping[str, Channel] = COLUMNS,
    change: Change = lambda values: values,
    seed: int = 2,
    speed: float = 0.0,
) -> rid.Record:
    """Return a record of columns with noise, changed or not, its forces read by a law."""
    noise = np.random.default_rng(seed).standard_normal(columns.shape) * [5e-3, 5e-3, 1e-7, 1e-7]
    values = change(columns + noise)
    record = rid.Record([*channels.values()], values, RATE, speed=speed)
    pairs = (("x", "i"), ("y", "j"))
    readings = {f"F_{axis}": ForceReading(law, (flow,), {axis: 1.0}) for axis, flow in pairs}
    return forces(record, readings, period=SIZE)


def recorded(
    law: Differential, shared: dict[str, str] | None = None, size: float = 3.0
) -> rid.Record:
    """Return the record with its forces, of this size on each line, read with a law."""
    return read_by(replace(law, shared=shared or {}), samples(size))


def periods(
    law: Differential, shared: dict[str, str] | None = None, size: float = 3.0
) -> PeriodicRecord:
    return rid.average(recorded(law, shared, size), F0, harmonics=LINES)


STILL = {"xi": 0.0, "zeta": 0.0}


def answer(record, start: Mapping[str, float] | None = None, **fixed: float) -> rid.Estimate:
    return identify(MODEL, record, MaximumLikelihood(fixed={**STILL, **fixed}, start=start or {}))


UNKNOWN_LAW = {"gap": 4.2e-4, "bias": 1.9, "K": 4.3e-6}


@pytest.mark.parametrize("name", UNKNOWN_LAW)
def test_an_unknown_constant_is_found(name):
    """From 5 % off, within its deviations, common to both axes; the mass gives the scale."""
    law = replace(MAGNET, **{name: UNKNOWN_LAW[name]}, std={name: np.inf})
    found = answer(periods(law, {name: "magnets"}), m=TRUTH["m"])
    truth = getattr(MAGNET, name)
    agrees(found, {**TRUTH, f"{name}[magnets]": truth}, 4)
    assert found[f"{name}[magnets]"].std < 2e-3 * truth


def test_a_prior_widens_the_deviations_as_the_gain_does():
    """1 % of the gap is 2 % of k_i: of every force, and so of the mass.

    As long as the motion is so small that the bend of the law does not tell the gap.
    """
    law = replace(MAGNET, std={"gap": 0.01 * MAGNET.gap})
    plain, own = (answer(periods(each, size=0.3)) for each in (MAGNET, law))
    common = answer(periods(law, {"gap": "magnets"}, 0.3))
    assert [v.name for v in own.nuisance] == ["gap[F_x]", "gap[F_y]"]
    assert plain.std("m") < 6e-3 * TRUTH["m"]
    assert common.std("m") == pytest.approx(0.02 * TRUTH["m"], rel=0.1)
    assert own.std("m") == pytest.approx(0.02 * TRUTH["m"] / np.sqrt(2), rel=0.1)


def test_a_wrong_gap_is_suspected_by_its_name():
    """With the stiffness known; beyond the lines of a linear law it is the iron, too."""
    found = answer(periods(replace(MAGNET, gap=4.2e-4)), m=TRUTH["m"], k=TRUTH["k"])
    assert found.status == "rejected"
    suspect = {s.term: s for s in found.suspects}
    first = [s.term for s in found.suspects[:4]]
    assert {"gap", "iron"} <= {*first}
    assert suspect["gap"].value == pytest.approx(MAGNET.gap, rel=1e-3)
    assert suspect["iron"].value == pytest.approx(-2e-5, rel=0.02)
    told = " ".join(found.warnings)
    assert "of the force laws = " in told
    assert "have it estimated" in told


def derivatives_hold(observation: Observation, nuisances: Sequence[Unknown]) -> None:
    """Hold the gradient by the nuisances, away from their starts, against differences."""
    guess = {name: 1.1 * value for name, value in TRUTH.items()}
    layout = prepare(MODEL, Knowledge(), nuisances, False, guess).layout
    likelihood = assemble(layout, observation)
    x, scale = layout.start.copy(), np.abs(layout.start)
    sizes = {"A": 2e-4, "m": 4e-6, "N": 0.05, "1/m^2": 1e7}
    for j in np.flatnonzero(scale == 0):
        scale[j] = sizes.get(layout.unknowns[j].unit, 1.0)
    x[layout.parameters :] += 0.02 * scale[layout.parameters :]
    gradient_holds(partial(Evaluation, likelihood), x, scale, rtol=1e-5, atol=1e-6)


def test_derivatives_of_constants_against_differences():
    unknown = ("gap", "bias", "iron", "bias_difference", "saturation")
    law = replace(MAGNET, saturation=7000.0, std=dict.fromkeys(unknown, np.inf))
    observation = bind(MODEL, periods(law, {"bias": "magnets"}))
    nuisances = unknowns_of([observation], Nuisances())
    free = [n.scalars[0].name.partition("[")[0] for n in nuisances]
    assert free.count("bias") == 1
    assert free.count("gap") == free.count("iron") == free.count("saturation") == 2
    derivatives_hold(observation, nuisances)


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"gains": ("ki",)}, "an unknown ki"),
        ({"gains": ("ks*",)}, "an unknown ks"),
        ({"delays": ("force",)}, "an unknown delay of the forces"),
    ],
)
def test_constants_of_forces_need_a_force(asked, told):
    observation = bind(MODEL, periods(MAGNET))
    lines = observation.lines
    silent = observation.with_lines(replace(lines, mean=lines.mean * [0.0, 0.0, 1.0, 1.0]))
    with pytest.raises(InputError, match=f"{re.escape(told)}.*, but no force in any record"):
        unknowns_of([silent], Nuisances(**asked))


def test_derivatives_of_bends_against_differences():
    observation = bind(MODEL, periods(MAGNET))
    found = bends([observation], None)
    assert {n.scalars[0].name for n in found} == {
        "nonlinear x", "nonlinear y", "nonlinear x ... y",
        "hysteresis F_x", "hysteresis F_y", "hysteresis force",
    }  # fmt: skip
    derivatives_hold(observation, found)


def bent(change: Callable[[np.ndarray], np.ndarray], which: Sequence[int]) -> PeriodicRecord:
    """Return the record of a linear bearing, some channels of which are changed."""
    rng = np.random.default_rng(3)
    record = recorded(MAGNET)
    forced = np.stack([record.column(name) for name in ("F_x", "F_y")], axis=1)
    values = np.concatenate([forced, samples(3.0)[:, 2:]], axis=1)
    values[:, list(which)] = change(values[:, list(which)])
    values += rng.standard_normal(values.shape) * [1e-3, 1e-3, 1e-9, 1e-9]
    channels = [Channel(n, u) for n, u in (("F_x", "N"), ("F_y", "N"), ("x", "m"), ("y", "m"))]
    return rid.average(rid.Record(channels, values, RATE), F0, harmonics=LINES)


def first_suspects(record: PeriodicRecord) -> list[str]:
    found = answer(record, m=TRUTH["m"])
    assert found.status == "rejected"
    return [s.term for s in found.suspects[:3]]


def test_a_sensor_that_bends_is_named():
    def far_out(samples: np.ndarray) -> np.ndarray:
        return samples * (1 + 0.05 * (samples / np.abs(samples).max()) ** 2)

    assert first_suspects(bent(far_out, [2]))[0] == "nonlinear x"
    assert first_suspects(bent(far_out, [2, 3]))[0] == "nonlinear x ... y"


def test_a_force_that_runs_through_a_loop_is_named():
    def lagging(samples: np.ndarray) -> np.ndarray:
        held, out = np.zeros(samples.shape[1]), np.empty_like(samples)
        for _ in range(2):
            for k, value in enumerate(samples):
                held = np.clip(held, value - 0.2, value + 0.2)
                out[k] = held
        return out

    # What is recorded lies ahead of the force by the loop: so undone, the force lags.
    assert "hysteresis force" in first_suspects(bent(lambda s: 2 * s - lagging(s), [0, 1]))


def test_the_lines_of_another_constant_are_those_of_another_law():
    """Reading with the right gap, and reading with a wrong one that is put right, agree."""
    wrong = bind(MODEL, periods(replace(MAGNET, gap=4.2e-4, std={"gap": 1e-5}), {"gap": "g"}))
    right = periods(MAGNET)
    nuisances = unknowns_of([wrong], Nuisances())
    layout = prepare(MODEL, Knowledge(), nuisances, False, TRUTH).layout
    x = layout.start.copy()
    x[layout.index["gap[g]"]] = MAGNET.gap
    state = Evaluation(assemble(layout, wrong), x).state
    order = [wrong.lines.names.index(c.name) for c in wrong.channels]
    found = state.factors * wrong.lines.mean[:, order] - state.readings
    np.testing.assert_allclose(found[:, :2], right.mean_spectrum[:, :2], atol=1e-4)


@pytest.mark.slow
def test_records_without_periods_keep_their_samples_for_it():
    law = replace(MAGNET, gap=4.1e-4, std={"gap": np.inf})
    record = recorded(law, {"gap": "magnets"})
    lines = spectra(record, (5.0, 250.0), inputs=("F_x", "F_y"))
    assert np.shares_memory(lines.samples.values, record.samples)
    plain = stated(record, record.names, law=None)
    assert spectra(plain, (5.0, 250.0), inputs=("F_x", "F_y")).samples is None
    known = MaximumLikelihood(fixed={**STILL, "m": TRUTH["m"]}, effort="quick")
    gap = identify(MODEL, lines, known)["gap[magnets]"]
    assert abs(gap.value - MAGNET.gap) < max(5 * gap.std, 2e-3 * MAGNET.gap)


def test_what_is_shared_is_stated_alike():
    record = recorded(replace(MAGNET, std={"gap": 1e-5}), {"gap": "magnets"})
    other = stated(record, ["F_x"], law=replace(record.channels[0].law, gap=5e-4))
    mixed = rid.average(other, F0, harmonics=LINES)
    with pytest.raises(InputError, match=r"channels\.F_x\.gap: found gap of magnets as 0\.0004"):
        identify(MODEL, mixed, "ml")


def test_what_every_law_may_have_wrong():
    every = {n.scalars[0].name for n in unknowns_of([bind(MODEL, periods(MAGNET))])}
    assert {"gap", "bias", "iron", "bias_difference", "saturation", "K"} <= every
    flux = stated(recorded(MAGNET), MODEL.inputs, law=Flux(2e-4))
    fluxes = rid.average(flux, F0, harmonics=LINES)
    every = {n.scalars[0].name for n in unknowns_of([bind(MODEL, fluxes)])}
    assert "area" in every
    assert not {"gap", "saturation"} & every


def misread(
    change: Change, sensor: Channel, dynamics: Mapping[str, Dynamics] | None = None
) -> PeriodicRecord:
    """Return a record whose columns, i, j, x and y, are not what they are said to be."""
    channels = {
        name: replace(channel, dynamics=(dynamics or {}).get(name))
        for name, channel in (COLUMNS | {"x": sensor}).items()
    }
    return rid.average(read_by(MAGNET, samples(1.0), channels, change), F0, harmonics=LINES)


def larger(values: np.ndarray) -> np.ndarray:
    return values * [1, 1, 1.03, 1]


def later(values: np.ndarray, samples: float = 2e-5 * RATE) -> np.ndarray:
    late = shifted(values[:, 2], -samples, SIZE)
    return np.column_stack([values[:, :2], late, values[:, 3]])


@pytest.mark.parametrize(
    ("change", "stated", "name", "true"),
    [(larger, {"gain_std": 0.05}, "gain[x]", 1.03), (later, {"delay_std": 1e-4}, "delay[x]", 2e-5)],
)
def test_what_a_sensor_reads_wrong_goes_through_the_law(change, stated, name, true):
    """Its gain and its lag are in the force too, which was read with it."""
    found = answer(misread(change, Channel("x", "m", **stated)))
    agrees(found, {**TRUTH, name: true}, 4)
    assert found[name].std < 0.05 * abs(true)


@pytest.mark.parametrize("columns", [[0, 1], [2, 3], [0, 1, 2, 3]])
def test_the_law_takes_what_there_was_and_not_what_the_sensor_let_through(columns):
    """A known bandwidth of 1 kHz: k_s times its lag would be half of the damping."""
    known = FirstOrder(bandwidth=Constant("bandwidth", "Hz", 1000.0))

    def lagging(values: np.ndarray) -> np.ndarray:
        frequency = np.fft.rfftfreq(len(values), 1 / RATE)
        gain = np.ones((len(frequency), 4), dtype=complex)
        gain[:, columns] = known.response(2 * np.pi * frequency, known.values)[:, None]
        return np.fft.irfft(np.fft.rfft(values, axis=0) * gain, axis=0)

    dynamics = {name: known for k, name in enumerate("ijxy") if k in columns}
    agrees(answer(misread(lagging, Channel("x", "m"), dynamics)), TRUTH, 4)


def upside_down(values: np.ndarray) -> np.ndarray:
    return values * [1, 1, -1, 1]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("change", "told"),
    [
        (larger, r"first suspect: gain\[x\] = 1.03"),
        (upside_down, r"x upside down.* to \d\d\..* cannot tell it from sign\[(F_)?x\]"),
        (lambda v: v / [1, 1, 25.4, 1], r"first suspect: x reading 0.03937 times the quantity"),
        (
            lambda v: v[:, [1, 0, 2, 3]],
            r"F_x with F_y exchanged.* to \d\d\..*cannot tell it from swap\[x, y\]",
        ),
        (lambda v: v * [-1, 1, 1, 1], r"x upside down.* to \d\d\..* cannot tell it from sign"),
    ],
    ids=["gain", "upside down", "mils", "currents exchanged", "current upside down"],
)
def test_a_mistaken_column_is_undone_before_the_law(change, told):
    """The law reads the force again, with the column as it should have been."""
    found = answer(misread(change, Channel("x", "m")), TRUTH)
    assert found.status != "ok"  # exchanged, nothing is where its law could be read
    assert any(re.search(told, warning) for warning in found.warnings), found.warnings


def test_what_is_undone_of_a_late_sensor_is_the_record_without_the_mistake():
    """A delay that is known is taken out of what the law had read, and of what it reads again."""

    def bound(change: Change) -> Observation:
        late = misread(lambda values: change(later(values, 1.0)), replace(sensor, delay=1 / RATE))
        return bind(MODEL, late)

    sensor = Channel("x", "m")
    right = bound(lambda values: values)
    found = multiplied(bound(upside_down), {"x": -1.0})
    size = np.abs(right.lines.mean).max(axis=0)
    # The law of the mean period is not the mean of the law: second order in the noise.
    np.testing.assert_allclose(found.lines.mean / size, right.lines.mean / size, atol=1e-3)


@pytest.mark.parametrize(("share", "read_again"), [(0.99, True), (1.01, False)])
def test_no_magnet_reads_a_displacement_beyond_its_gap(share, read_again):
    """There forces fall to nothing, and records of nothing would agree with any machine."""
    record = bind(MODEL, periods(MAGNET))
    largest = np.abs(record.lines.samples.column(2, record.lines.channels[2])).max()
    found = multiplied(record, {"x": share * MAGNET.gap / largest})
    assert found.lines.names.index("F_x") == 0
    same = np.allclose(found.lines.mean[:, 0], record.lines.mean[:, 0], rtol=1e-3)
    assert same != read_again


UNBALANCE, RUNOUT = 5e-6 - 2e-6j, {"x": 3e-6 + 1e-6j, "y": -2e-6 + 2e-6j}


def turning(line: int) -> PeriodicRecord:
    """Return a record of the turning mass, read by sensors of a track that is not round."""
    rng = np.random.default_rng(line)
    omega = 2 * np.pi * F0 * LINES
    force = 1.0 * np.exp(2j * np.pi * rng.uniform(size=(len(LINES), 2)))
    at, speed = list(LINES).index(line), 2 * np.pi * F0 * line
    load = np.zeros_like(force)
    load[at] = 0.5 * TRUTH["m"] * speed**2 * UNBALANCE * np.array([1.0, -1j])
    stiff = TRUTH["k"] - TRUTH["m"] * omega**2 + 1j * omega * TRUTH["c"]
    moved = synthesize((force + load) / stiff[:, None], LINES, SIZE)
    current = MAGNET.flowing(synthesize(force, LINES, SIZE), moved)
    track = np.zeros_like(force)
    track[at] = 0.5 * np.array(list(RUNOUT.values()))
    read = moved + synthesize(track, LINES, SIZE)
    values = np.tile(np.concatenate([current, read], axis=1), (PERIODS, 1))
    return rid.average(read_by(MAGNET, values, seed=9, speed=speed), F0, harmonics=LINES)


def test_runout_goes_through_the_law_of_the_magnet():
    """The force is read k_s of the runout too large; two speeds tell it from the unbalance."""
    found = identify(MODEL, [turning(11), turning(23)], MaximumLikelihood(runout=True))
    assert found["xi"].std < 1e-7
    track = {
        f"runout[{name}].{part}": true
        for name, value in RUNOUT.items()
        for part, true in (("cos", value.real), ("sin", -value.imag))
    }
    agrees(found, {**TRUTH, "xi": UNBALANCE.real, "zeta": UNBALANCE.imag, **track}, 4)
    assert all(found[name].std < 1e-7 for name in track)
