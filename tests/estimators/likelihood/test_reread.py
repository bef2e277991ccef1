"""What is no factor of a line, as unknowns: a mass on a spring between two magnets."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from rotorid import (
    Channel,
    InputError,
    MaximumLikelihood,
    PeriodicRecord,
    Record,
    average,
    identify,
    load_model,
    spectra,
)
from rotorid.data.observation import Observation, bind
from rotorid.force.channel_dynamics import Constant, Dynamics, FirstOrder
from rotorid.force.laws import Differential, Flux
from rotorid.force.reading import ForceReading, forces
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.preparation import Knowledge, prepare
from rotorid.likelihood.rivals_channels import multiplied
from rotorid.likelihood.unknowns import (
    Nuisances,
    Unknown,
    cubics,
    hystereses,
    unknowns_of,
)
from rotorid.signals.spectrum import shifted, synthesize

MODEL = load_model("jeffcott")
TRUTH = {"m": 2.0, "c": 60.0, "k": 4e5, "xi": 0.0, "zeta": 0.0}
MAGNET = Differential(constant=4e-6, bias=2.0, gap=4e-4)
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


def recorded(law: Differential, shared: dict[str, str] | None = None, size: float = 3.0) -> Record:
    """Return the record with its forces, of this size on each line, read with a law."""
    rng = np.random.default_rng(2)
    noise = rng.standard_normal((PERIODS * SIZE, 4)) * [5e-3, 5e-3, 1e-7, 1e-7]
    channels = [Channel(n, u) for n, u in (("i", "A"), ("j", "A"), ("x", "m"), ("y", "m"))]
    record = Record(channels, samples(size) + noise, RATE)
    law = replace(law, shared=shared or {})
    readings = {
        "F_x": ForceReading(law, ("i",), {"x": 1.0}),
        "F_y": ForceReading(law, ("j",), {"y": 1.0}),
    }
    return forces(record, readings, period=SIZE)


def periods(
    law: Differential, shared: dict[str, str] | None = None, size: float = 3.0
) -> PeriodicRecord:
    return average(recorded(law, shared, size), F0, harmonics=LINES)


STILL = {"xi": 0.0, "zeta": 0.0}


UNKNOWN = {"gap": 4.2e-4, "bias": 1.9, "constant": 4.3e-6}


@pytest.mark.parametrize("name", UNKNOWN)
def test_an_unknown_constant_is_found(name: str) -> None:
    """From 5 % off, within its deviations, common to both axes; the mass gives the scale."""
    law = replace(MAGNET, **{name: UNKNOWN[name]}, std={name: np.inf})
    label = {"constant": "K"}.get(name, name)
    found = identify(
        MODEL, periods(law, {name: "magnets"}), MaximumLikelihood(fixed={"m": TRUTH["m"], **STILL})
    )
    value = next(v for v in found.nuisance if v.name == f"{label}[magnets]")
    truth = getattr(MAGNET, name)
    assert found.status == "ok"
    assert value.std < 2e-3 * truth
    assert abs(value.value - truth) < 4 * value.std
    assert abs(found.value("k") - TRUTH["k"]) < 4 * found.std("k")
    assert abs(found.value("c") - TRUTH["c"]) < 4 * found.std("c")


def test_a_prior_widens_the_deviations_as_the_gain_does() -> None:
    """1 % of the gap is 2 % of k_i: of every force, and so of the mass.

    As long as the motion is so small that the bend of the law does not tell the gap.
    """
    law, ml = replace(MAGNET, std={"gap": 0.01 * MAGNET.gap}), MaximumLikelihood(fixed=STILL)
    plain = identify(MODEL, periods(MAGNET, size=0.3), ml)
    own = identify(MODEL, periods(law, size=0.3), ml)
    common = identify(MODEL, periods(law, {"gap": "magnets"}, 0.3), ml)
    assert [v.name for v in own.nuisance] == ["gap[F_x]", "gap[F_y]"]
    assert plain.std("m") < 6e-3 * TRUTH["m"]
    assert common.std("m") == pytest.approx(0.02 * TRUTH["m"], rel=0.1)
    assert own.std("m") == pytest.approx(0.02 * TRUTH["m"] / np.sqrt(2), rel=0.1)


def test_a_wrong_gap_is_suspected_by_its_name() -> None:
    """With the stiffness known; beyond the lines of a linear law it is the iron, too."""
    found = identify(
        MODEL,
        periods(replace(MAGNET, gap=4.2e-4)),
        MaximumLikelihood(fixed={"m": TRUTH["m"], "k": TRUTH["k"], **STILL}),
    )
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
    at = likelihood.evaluate(x)
    gradient = 2 * at.jacobian().T @ at.residual
    for j in range(layout.parameters, len(x)):
        costs = []
        for step in (-1e-5, 1e-5):
            moved = x.copy()
            moved[j] += step * scale[j]
            costs.append(likelihood.evaluate(moved).cost)
        found = (costs[1] - costs[0]) / 2e-5
        assert gradient[j] * scale[j] == pytest.approx(found, rel=1e-5, abs=1e-6 * at.cost)


def test_derivatives_of_constants_against_differences() -> None:
    law = replace(
        MAGNET,
        saturation=7000.0,
        std=dict.fromkeys(("gap", "bias", "iron", "bias_difference", "saturation"), np.inf),
    )
    observation = bind(MODEL, periods(law, {"bias": "magnets"}))
    nuisances = unknowns_of([observation], Nuisances())
    free = [n.scalars[0].name.partition("[")[0] for n in nuisances]
    assert free.count("bias") == 1
    assert free.count("gap") == free.count("iron") == free.count("saturation") == 2
    derivatives_hold(observation, nuisances)


def test_derivatives_of_bends_against_differences() -> None:
    observation = bind(MODEL, periods(MAGNET))
    bends = [*cubics([observation], None), *hystereses([observation], None)]
    assert {n.scalars[0].name for n in bends} == {
        "nonlinear x", "nonlinear y", "nonlinear x ... y",
        "hysteresis F_x", "hysteresis F_y", "hysteresis force",
    }  # fmt: skip
    derivatives_hold(observation, bends)


def bent(change: Callable[[np.ndarray], np.ndarray], which: Sequence[int]) -> PeriodicRecord:
    """Return the record of a linear bearing, some channels of which are changed."""
    rng = np.random.default_rng(3)
    record = recorded(MAGNET)
    forced = np.stack([record.column(name) for name in ("F_x", "F_y")], axis=1)
    values = np.concatenate([forced, samples(3.0)[:, 2:]], axis=1)
    values[:, list(which)] = change(values[:, list(which)])
    values += rng.standard_normal(values.shape) * [1e-3, 1e-3, 1e-9, 1e-9]
    channels = [Channel(n, u) for n, u in (("F_x", "N"), ("F_y", "N"), ("x", "m"), ("y", "m"))]
    return average(Record(channels, values, RATE), F0, harmonics=LINES)


def first_suspects(record: PeriodicRecord) -> list[str]:
    found = identify(MODEL, record, MaximumLikelihood(fixed={**STILL, "m": TRUTH["m"]}))
    assert found.status == "rejected"
    return [s.term for s in found.suspects[:3]]


def test_a_sensor_that_bends_is_named() -> None:
    def far_out(samples: np.ndarray) -> np.ndarray:
        return samples * (1 + 0.05 * (samples / np.abs(samples).max()) ** 2)

    assert first_suspects(bent(far_out, [2]))[0] == "nonlinear x"
    assert first_suspects(bent(far_out, [2, 3]))[0] == "nonlinear x ... y"


def test_a_force_that_runs_through_a_loop_is_named() -> None:
    def lagging(samples: np.ndarray) -> np.ndarray:
        held, out = np.zeros(samples.shape[1]), np.empty_like(samples)
        for _ in range(2):
            for k, value in enumerate(samples):
                held = np.clip(held, value - 0.2, value + 0.2)
                out[k] = held
        return out

    # What is recorded lies ahead of the force by the loop: so undone, the force lags.
    assert "hysteresis force" in first_suspects(bent(lambda s: 2 * s - lagging(s), [0, 1]))


def test_the_lines_of_another_constant_are_those_of_another_law() -> None:
    """Reading with the right gap, and reading with a wrong one that is put right, agree."""
    wrong = bind(MODEL, periods(replace(MAGNET, gap=4.2e-4, std={"gap": 1e-5}), {"gap": "g"}))
    right = periods(MAGNET)
    nuisances = unknowns_of([wrong], Nuisances())
    layout = prepare(MODEL, Knowledge(), nuisances, False, TRUTH).layout
    x = layout.start.copy()
    x[layout.index["gap[g]"]] = MAGNET.gap
    state = assemble(layout, wrong).evaluate(x).state
    order = [wrong.lines.names.index(c.name) for c in wrong.channels]
    found = state.factors * wrong.lines.mean[:, order] - state.readings
    np.testing.assert_allclose(found[:, :2], right.mean_spectrum[:, :2], atol=1e-4)


@pytest.mark.slow
def test_records_without_periods_keep_their_samples_for_it() -> None:
    law = replace(MAGNET, gap=4.1e-4, std={"gap": np.inf})
    record = recorded(law, {"gap": "magnets"})
    lines = spectra(record, (5.0, 250.0), inputs=("F_x", "F_y"))
    assert lines.samples is not None
    assert np.shares_memory(lines.samples.values, record.samples)
    plain = replace(record, channels=tuple(replace(c, law=None) for c in record.channels))
    assert spectra(plain, (5.0, 250.0), inputs=("F_x", "F_y")).samples is None
    found = identify(MODEL, lines, MaximumLikelihood(fixed={"m": TRUTH["m"], **STILL}))
    gap = next(v for v in found.nuisance if v.name == "gap[magnets]")
    assert abs(gap.value - MAGNET.gap) < max(5 * gap.std, 2e-3 * MAGNET.gap)


def test_what_is_shared_is_stated_alike() -> None:
    record = recorded(replace(MAGNET, std={"gap": 1e-5}), {"gap": "magnets"})
    channels = list(record.channels)
    channels[1] = replace(channels[1], law=replace(channels[1].law, gap=5e-4))
    mixed = average(replace(record, channels=channels), F0, harmonics=LINES)
    with pytest.raises(InputError, match=r"channels\.F_x\.gap: found gap of magnets as 0\.0004"):
        identify(MODEL, mixed, "ml")


def test_what_every_law_may_have_wrong() -> None:
    every = {n.scalars[0].name for n in unknowns_of([bind(MODEL, periods(MAGNET))])}
    assert {"gap", "bias", "iron", "bias_difference", "saturation", "K"} <= every
    record = recorded(MAGNET)
    flux = tuple(replace(c, law=None if c.law is None else Flux(2e-4)) for c in record.channels)
    fluxes = average(replace(record, channels=flux), F0, harmonics=LINES)
    every = {n.scalars[0].name for n in unknowns_of([bind(MODEL, fluxes)])}
    assert "area" in every
    assert not {"gap", "saturation"} & every


def misread(
    change: Callable[[np.ndarray], None],
    sensor: Channel,
    dynamics: Mapping[str, Dynamics] | None = None,
) -> PeriodicRecord:
    """Return a record whose columns, i, j, x and y, are not what they are said to be."""
    values = samples(1.0)
    values += np.random.default_rng(2).standard_normal(values.shape) * [5e-3, 5e-3, 1e-7, 1e-7]
    change(values)
    channels = [
        replace(channel, dynamics=(dynamics or {}).get(channel.name))
        for channel in (Channel("i", "A"), Channel("j", "A"), sensor, Channel("y", "m"))
    ]
    laws = {
        f"F_{axis}": ForceReading(MAGNET, (flow,), {axis: 1.0})
        for axis, flow in (("x", "i"), ("y", "j"))
    }
    return average(forces(Record(channels, values, RATE), laws, period=SIZE), F0, harmonics=LINES)


def larger(values: np.ndarray) -> None:
    values[:, 2] *= 1.03


def later(values: np.ndarray) -> None:
    values[:, 2] = shifted(values[:, 2], -2e-5 * RATE, SIZE)


@pytest.mark.parametrize(
    ("change", "stated", "name", "true"),
    [
        (larger, {"gain_std": 0.05}, "gain[x]", 1.03),
        (later, {"delay_std": 1e-4}, "delay[x]", 2e-5),
    ],
)
def test_what_a_sensor_reads_wrong_goes_through_the_law(
    change: Callable[[np.ndarray], None], stated: dict[str, float], name: str, true: float
) -> None:
    """Its gain and its lag are in the force too, which was read with it."""
    record = misread(change, Channel("x", "m", **stated))
    found = identify(MODEL, record, MaximumLikelihood(fixed=STILL))
    assert found.status == "ok"
    assert abs(found[name].value - true) < 4 * found[name].std
    assert found[name].std < 0.05 * abs(true)
    for each in ("m", "c", "k"):
        assert abs(found.value(each) - TRUTH[each]) < 4 * found.std(each)


@pytest.mark.parametrize("columns", [[0, 1], [2, 3], [0, 1, 2, 3]])
def test_the_law_takes_what_there_was_and_not_what_the_sensor_let_through(
    columns: list[int],
) -> None:
    """A known bandwidth of 1 kHz: k_s times its lag would be half of the damping."""
    known = FirstOrder(bandwidth=Constant("bandwidth", "Hz", 1000.0))

    def lagging(values: np.ndarray) -> None:
        frequency = np.fft.rfftfreq(len(values), 1 / RATE)
        gain = known.response(2 * np.pi * frequency, known.values)[:, None]
        values[:, columns] = np.fft.irfft(np.fft.rfft(values[:, columns], axis=0) * gain, axis=0)

    record = misread(
        lagging, Channel("x", "m"), {name: known for k, name in enumerate("ijxy") if k in columns}
    )
    found = identify(MODEL, record, MaximumLikelihood(fixed=STILL))
    assert found.status == "ok"
    for each in ("m", "c", "k"):
        assert abs(found.value(each) - TRUTH[each]) < 4 * found.std(each)


def upside_down(values: np.ndarray) -> None:
    values[:, 2] *= -1


def in_mils(values: np.ndarray) -> None:
    values[:, 2] /= 25.4


def currents_exchanged(values: np.ndarray) -> None:
    values[:, :2] = values[:, 1::-1]


def current_upside_down(values: np.ndarray) -> None:
    values[:, 0] *= -1


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("change", "told"),
    [
        (larger, r"first suspect: gain\[x\] = 1.03"),
        (upside_down, r"x upside down.* to \d\d\..* cannot tell it from sign\[(F_)?x\]"),
        (in_mils, r"first suspect: x reading 0.03937 times the quantity"),
        (
            currents_exchanged,
            r"F_x with F_y exchanged.* to \d\d\..*cannot tell it from swap\[x, y\]",
        ),
        (current_upside_down, r"x upside down.* to \d\d\..* cannot tell it from sign"),
    ],
)
def test_a_mistaken_column_is_undone_before_the_law(
    change: Callable[[np.ndarray], None], told: str
) -> None:
    """The law reads the force again, with the column as it should have been."""
    found = identify(
        MODEL, misread(change, Channel("x", "m")), MaximumLikelihood(fixed=STILL, start=TRUTH)
    )
    assert found.status != "ok"  # exchanged, nothing is where its law could be read
    assert any(re.search(told, warning) for warning in found.warnings), found.warnings


def test_what_is_undone_of_a_late_sensor_is_the_record_without_the_mistake() -> None:
    """A delay that is known is taken out of what the law had read, and of what it reads again."""

    def late(values: np.ndarray) -> None:
        values[:, 2] = shifted(values[:, 2], -1.0, SIZE)

    def late_and_upside_down(values: np.ndarray) -> None:
        late(values)
        values[:, 2] *= -1

    sensor = Channel("x", "m", delay=1 / RATE)
    right = bind(MODEL, misread(late, sensor))
    found = multiplied(bind(MODEL, misread(late_and_upside_down, sensor)), {"x": -1.0})
    size = np.abs(right.lines.mean).max(axis=0)
    # The law of the mean period is not the mean of the law: second order in the noise.
    np.testing.assert_allclose(found.lines.mean / size, right.lines.mean / size, atol=1e-3)


@pytest.mark.parametrize(("share", "read_again"), [(0.99, True), (1.01, False)])
def test_no_magnet_reads_a_displacement_beyond_its_gap(share: float, read_again: bool) -> None:
    """There forces fall to nothing, and records of nothing would agree with any machine."""
    record = bind(MODEL, periods(MAGNET))
    assert record.lines.samples is not None
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
    noise = np.random.default_rng(9).standard_normal(values.shape) * [5e-3, 5e-3, 1e-7, 1e-7]
    channels = [Channel(n, u) for n, u in (("i", "A"), ("j", "A"), ("x", "m"), ("y", "m"))]
    record = Record(channels, values + noise, RATE, speed=speed)
    laws = {
        f"F_{axis}": ForceReading(MAGNET, (flow,), {axis: 1.0})
        for axis, flow in (("x", "i"), ("y", "j"))
    }
    return average(forces(record, laws, period=SIZE), F0, harmonics=LINES)


def test_runout_goes_through_the_law_of_the_magnet() -> None:
    """The force is read k_s of the runout too large; two speeds tell it from the unbalance."""
    found = identify(MODEL, [turning(11), turning(23)], MaximumLikelihood(runout=True))
    assert found.status == "ok"
    assert found["xi"].std < 1e-7
    for name, value in {**TRUTH, "xi": UNBALANCE.real, "zeta": UNBALANCE.imag}.items():
        assert abs(found.value(name) - value) < 4 * found.std(name), name
    for name, value in RUNOUT.items():
        for part, true in (("cos", value.real), ("sin", -value.imag)):
            runout = found[f"runout[{name}].{part}"]
            assert abs(runout.value - true) < 4 * runout.std
            assert runout.std < 1e-7
