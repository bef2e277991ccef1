"""The kernel: gradient, invariance, loads, indirect sensors, whitening, the expected cost."""

from dataclasses import replace
from fractions import Fraction
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
from bank import recovered, stated, times
from differences import gradient_holds
from levitated import MODEL as QUIET_MODEL
from levitated import QUICK, levitated, lines_of
from model_text import model_text

import rotorid as rid
from rotorid import Channel, Drive, InputError, Lines, PeriodicRecord, identify
from rotorid.data.lines import Beside
from rotorid.likelihood import inference as by_errors
from rotorid.likelihood import whitening
from rotorid.likelihood.assembly import assemble, every_load, load_lines, phase_steps
from rotorid.likelihood.cost import Evaluation, Likelihood
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.other_answers import _idle_share
from rotorid.likelihood.unknowns import Nuisances, Scalar, unknowns_of
from rotorid.likelihood.whitening import by_qr, by_reflections, projection
from rotorid.models.expressions import Expression, expression, product, symbol
from rotorid.signals.covariance import white_covariance
from rotorid.testing import bind

# The kernel: gradient, invariance, agreement with the output-error likelihood.


MODEL = rid.load_model("three-mass")
PARAMETERS = tuple(Scalar(p.name, p.unit, p.nominal or 0.0) for p in MODEL.parameters)


def layout_of(record: PeriodicRecord, nuisances: Nuisances | None = None) -> Layout:
    extra = unknowns_of([bind(MODEL, record)], nuisances or Nuisances())
    unknowns = (*PARAMETERS, *(unknown for nuisance in extra for unknown in nuisance.scalars))
    return Layout(MODEL, unknowns, nuisances=extra)


def likelihood(record: PeriodicRecord) -> Likelihood:
    return assemble(layout_of(record), bind(MODEL, record))


def everything_unknown(record: PeriodicRecord) -> PeriodicRecord:
    """Turn forces into currents, and let every calibration constant be unknown."""
    drives = {name: Drive(120.0, 2e5, {name[2:]: 1.0}) for name in MODEL.inputs}
    channels = [
        replace(channel, drive=drives.get(channel.name), gain_std=0.01, delay_std=1e-5)
        for channel in record.channels
    ]
    return replace(record, channels=tuple(channels), phase_known=False)


@pytest.mark.parametrize("relaxation", [0.0, 0.01, 10.0])
@pytest.mark.parametrize("sensors", [None, "bearings", "combination", "redundant"])
def test_gradient_agrees_with_differences(demo, bearings, sensors, relaxation):
    chosen = {
        None: None,
        "bearings": bearings,
        "combination": [
            "x1",
            "y1",
            Channel("a", "m", reads={"x2": 1.0, "theta_y": 0.05}),
            Channel("b", "m", reads={"y3": 1.0, "x3": -0.2}),
        ],
        "redundant": [*bearings, Channel("again", "m", reads={"x1": 1.0})],
    }[sensors]
    rng = np.random.default_rng(3)
    kernel = likelihood(demo.seen(rng, chosen, periods=40))
    x = demo.values * (1 + 0.2 * rng.uniform(-1, 1, 13))
    gradient_holds(lambda at: Evaluation(kernel, at, relaxation), x, x)


def test_gradient_by_every_nuisance_agrees_with_differences(demo):
    rng = np.random.default_rng(4)
    record = everything_unknown(demo.seen(rng, periods=40))
    asked = Nuisances(runout=True, gains=("ki", "ks*"), delays=("force", "position"))
    layout = layout_of(record, asked)
    kernel = assemble(layout, bind(MODEL, record))
    scale = np.where(layout.start != 0, np.abs(layout.start), 1e-6)  # runout in m, delay in s
    scale[layout.index["phase[0]"]] = 1.0
    x = layout.start + 0.1 * scale * rng.uniform(-1, 1, len(scale))
    assert len(x) == 13 + 4 + 4 + 8 + 8 + 2 + 8 + 1
    gradient_holds(partial(Evaluation, kernel), x, scale, rtol=2e-9)


@pytest.mark.parametrize("sensors", [None, "bearings"])
def test_equals_the_output_error_likelihood(demo, bearings, sensors):
    """J = sum c r^H V^-1 r, r = y - C Z^-1 (B u + g), V its covariance."""
    rng = np.random.default_rng(5)
    record = demo.seen(rng, bearings if sensors else None, periods=40)
    kernel = likelihood(record)
    x = demo.values * (1 + 0.01 * rng.uniform(-1, 1, 13))
    model, linear = demo.model, demo.model.require_linear()
    mu = model.monomial_values(x)
    stiffness = linear.dynamic_stiffness(record.omega, x, record.speed)
    reads = np.array([[float(c.name == q) for q in model.coordinates] for c in record.channels[4:]])
    compliance = reads @ np.linalg.inv(stiffness)
    transfer = compliance @ linear.input_matrix(mu)
    eye = np.broadcast_to(np.eye(len(reads)), (6, len(reads), len(reads)))
    gain = np.concatenate([-transfer, eye], axis=2)
    load = linear.load_columns(record.time[0], record.angle[0], record.speed) @ mu
    lines = np.fft.fft(load, axis=0)[record.harmonics] / record.samples
    mean = record.mean_spectrum
    error = (gain @ mean[:, :, None] - compliance @ lines[:, :, None])[:, :, 0]
    spread = gain @ white_covariance(record.spectra).matrices @ gain.conj().swapaxes(1, 2)
    solved = np.linalg.solve(spread, error[:, :, None])[:, :, 0]
    expected = 2 * (error.conj() * solved).real.sum()
    np.testing.assert_allclose(Evaluation(kernel, x).cost, expected, rtol=1e-9)


def test_corrected_lines_satisfy_the_equations_of_motion(demo):
    kernel = likelihood(demo.seen(6, periods=40))
    at = Evaluation(kernel, demo.values)
    data, motion = at.corrected()
    force = (at.inputs @ data[:, :4, None])[:, :, 0] + at.loads
    left = (at.stiffness @ motion[:, :, None])[:, :, 0] + force
    assert np.abs(left).max() < 1e-11 * np.abs(force).max()
    np.testing.assert_allclose(motion @ kernel.sensing.reads.T, data[:, 4:], rtol=1e-9)


def test_stays_finite_at_a_resonance(demo):
    """Z is never inverted: a line at an undamped resonance of the trial values is no harm."""
    record = demo.seen(8, periods=40)
    kernel = likelihood(record)
    omega, linear = [record.omega[4]], demo.model.require_linear()

    def stiffness(k1: float) -> np.ndarray:
        x = np.where(np.arange(13) == 5, k1, demo.values)
        return linear.dynamic_stiffness(omega, x, record.speed)[0]

    free = stiffness(0.0)
    roots = scipy.linalg.eigvals(free, (free - stiffness(1e6)) / 1e6)
    low = min(r.real for r in roots if np.isfinite(r) and 4e5 < r.real < 2e6)
    costs = []
    for k1 in (low * (1 - 1e-9), low, low * (1 + 1e-9)):
        x = demo.values.copy()
        x[5] = k1
        at = Evaluation(kernel, x)
        assert np.isfinite(at.jacobian()).all()
        costs.append(at.cost)
    np.testing.assert_allclose(costs, costs[1], rtol=1e-5)


# Loads that depend on time alone: the columns of g are those of the regression.


LOADED = model_text(
    "a mass on a spring, shaken at a frequency of its own",
    ["m*x'' + k*x = F + a*cos(2*pi*12.5*t)"],
    *("x m", "F N", "m kg, k N/m, a N"),
)


def test_a_load_that_periods_do_not_repeat_is_averaged_over_all_of_them():
    record = rid.Record([Channel("F"), Channel("x")], np.zeros((500, 2)), 1000.0)
    lines = Lines.of_periods(rid.average(record, 10.0, harmonics=[1, 2]))
    loads = every_load(Layout(rid.parse_model(LOADED), ()))
    columns, orders = load_lines(loads, lines, np.ones(1), False)
    np.testing.assert_array_equal(orders, [0.0])
    time = np.arange(500) / 1000.0
    wave = np.cos(2 * np.pi * 12.5 * time)
    wanted = [np.mean(wave * np.exp(-2j * np.pi * f * time)) for f in (10.0, 20.0)]
    found = columns[0][:, 0].sum(axis=-1)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


PHI, OMEGA = symbol("phi"), symbol("Omega")
COS, SIN = Expression("cos", (PHI,)), Expression("sin", (PHI,))
SQUARE = product([(COS, Fraction(2)), (SIN, Fraction(1)), (OMEGA, Fraction(-1))])


@pytest.mark.parametrize(
    ("signals", "steps"),
    [
        ([], 1),
        ([OMEGA], 1),
        ([product([(OMEGA, Fraction(2)), (COS, Fraction(1))]), SIN], 3),
        ([COS, SQUARE], 7),
        ([expression({SQUARE.factors: Fraction(1), (): Fraction(1)})], 7),
        ([product([(COS, Fraction(-1))])], 16),
        ([Expression("cos", (expression({((PHI, 1),): Fraction(2)}),))], 5),
        ([SIN, PHI], 16),
        ([product([(Expression("abs", (COS,)), Fraction(1)), (OMEGA, Fraction(1))])], 16),
    ],
)
def test_as_many_angles_as_a_load_has_orders(signals, steps):
    assert phase_steps(tuple(signals)) == steps


@pytest.mark.parametrize(
    "load", ["cos(phi) + b*Omega*sin(phi)^3*cos(phi)", "b*Omega*sin(phi)*exp(cos(phi))"]
)
def test_a_phase_turns_a_load_of_any_order(load):
    """The columns by order, turned and added, are those of the rotor angle moved."""
    text = LOADED.replace("cos(2*pi*12.5*t)", f"({load})") + 'b = { unit = "s" }\n'
    loads = every_load(Layout(rid.parse_model(text), ()))
    channels = (Channel("F"), Channel("x"))

    def columns(phase, unknown):
        angle = 2 * np.pi * 10.0 * np.arange(400) / 1000.0 + phase
        record = rid.Record(channels, np.zeros((400, 2)), 1000.0, 20 * np.pi, angle=angle)
        periods = rid.average(record, 10.0, harmonics=[1, 2, 3, 4])
        return load_lines(loads, Lines.of_periods(periods), np.ones(1), unknown)

    by_order, orders = columns(0.0, True)
    turned = np.tensordot(np.exp(1j * orders * 0.7), by_order, axes=1)
    wanted = columns(0.7, False)[0][0]
    np.testing.assert_allclose(turned, wanted, atol=1e-6 * np.abs(wanted).max())


# Sensors of derivatives, and sensors with parameters among their coefficients.


def derived(record: PeriodicRecord, name: str, order: int) -> PeriodicRecord:
    """Return the record with a sensor of a derivative in place of that of a position."""
    moved = times(record, [name], (1j * record.omega) ** order)
    reads = {name + "'" * order: 1.0}
    return stated(moved, [name], name=f"d{order}_{name}", unit="m/s^2", reads=reads)


@pytest.mark.parametrize("order", [1, 2])
def test_derivatives_give_what_positions_give(demo, bearings, order):
    record = demo.record([*bearings, "x2", "y2"])
    for name in ("x2", "y2"):
        record = derived(record, name, order)
    start = demo.start(np.random.default_rng(2), 0.1)
    exactly(demo, demo.identified(record, start=start))


def exactly(demo, estimate: rid.Estimate) -> None:
    recovered(estimate, demo.truth, 1e-6)
    assert max(p.relative_error for p in estimate.prediction.values()) < 1e-5


def test_a_parameter_may_be_a_coefficient_of_a_sensor(demo):
    leaning = Channel("leaning", "m", reads={"x1": 1.0, "theta_y": -0.3})
    record = demo.record([leaning, "y1", "x3", "y3"])
    record = stated(record, ["leaning"], reads={"x1": 1.0, "L1*theta_y": -1.0})
    start = demo.start(np.random.default_rng(3), 0.05)
    estimate = demo.identified(record, fixed={"L2": 0.3}, start=start)
    exactly(demo, estimate)
    assert "leaning" in estimate.prediction


@pytest.mark.parametrize("transient", [None, 2])
def test_gradient_with_indirect_sensors_agrees_with_differences(demo, bearings, transient):
    rng = np.random.default_rng(5)
    record = derived(demo.seen(rng, [*bearings, "x2", "theta_y"], periods=40), "x2", 2)
    arm = {"name": "arm", "unit": "m", "reads": {"L1*theta_y": 1.0, "y3": 0.1}}
    record = stated(record, ["theta_y"], **arm)
    lines = replace(Lines.of_periods(record), transient=transient)
    kernel = assemble(Layout(MODEL, PARAMETERS), bind(MODEL, lines))
    x = demo.values * (1 + 0.1 * rng.uniform(-1, 1, 13))
    gradient_holds(partial(Evaluation, kernel), x, x, rtol=1e-8, atol=1e-8)


def test_least_squares_needs_positions(demo):
    record = derived(demo.record(), "x2", 2)
    with pytest.raises(InputError, match=r"no sensor of x2.*use ml"):
        identify(demo.model, record, rid.LeastSquares())


# Projecting out what no sensor reads: by reflections that are formed, and one by one.


@pytest.fixture
def machine():
    """Two lines of 17 rows and 15 coordinates, of which 12 combinations are hidden."""
    rng = np.random.default_rng(0)
    stiffness = rng.standard_normal((2, 17, 15)) + 1j * rng.standard_normal((2, 17, 15))
    return stiffness, np.linalg.qr(rng.standard_normal((15, 12)))[0]


@pytest.mark.parametrize("way", [by_qr, by_reflections])
def test_nothing_is_left_of_what_is_hidden_and_its_motion_explains_the_rest(machine, way):
    stiffness, hidden = machine
    found = way(stiffness, hidden)
    eye = np.broadcast_to(np.eye(5), (2, 5, 5))
    null = found.null_h
    np.testing.assert_allclose(null @ null.conj().transpose(0, 2, 1), eye, atol=1e-13)
    assert np.abs(null @ stiffness @ hidden).max() < 1e-12
    w = np.arange(1.0, 13.0) * (1 + 2j)
    left = stiffness @ (hidden @ w)
    np.testing.assert_allclose(found.motion(-left), np.stack(2 * [hidden @ w]), rtol=1e-11)


def test_twelve_hidden_coordinates_are_many(machine, monkeypatch):
    stiffness, hidden = machine
    monkeypatch.setattr(whitening, "by_reflections", lambda *_: "one by one")
    assert projection(stiffness, hidden) == "one by one"
    assert projection(stiffness, hidden[:, 1:]) != "one by one"
    assert projection(stiffness, hidden[:, :0]) is None


# The expected cost of a whole record by its equation errors: mean, variance, what it leaves.


LINES = 500


def evaluated(errors: np.ndarray, rows: np.ndarray | None = None) -> SimpleNamespace:
    """Return an evaluation that holds equation errors of two channels of unit noise behind rows."""
    lines, equations = errors.shape
    factor = np.broadcast_to(np.eye(2), (lines, 2, 2))
    return SimpleNamespace(
        problem=SimpleNamespace(
            equations=equations,
            multiplicity=np.full(lines, 2.0),
            noise=SimpleNamespace(factor=factor),
        ),
        columns=factor if rows is None else rows,
        errors=lambda: errors,
        null_h=None,
    )


def complex_noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)


def beside(rng: np.random.Generator, references: int, **more) -> Beside:
    columns = np.column_stack([complex_noise(rng, LINES, references), np.ones(LINES)])
    number = np.arange(LINES)
    return Beside(columns, np.ones(LINES, dtype=bool), number, number, **more)


@pytest.mark.slow
@pytest.mark.parametrize(("references", "quiet"), [(0, False), (4, False), (0, True)])
def test_mean_and_variance_of_the_sum(references, quiet):
    """Noise of unit size on two equations, 120 times: as predicted by counting."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(120):
        noise = complex_noise(rng, LINES, 2) if quiet else None
        near = beside(rng, references, noise=noise)
        found.append(by_errors._sum_of(evaluated(complex_noise(rng, LINES, 2)), near, [0, 1]))
    cost, mean, variance = np.transpose(found)
    mean, variance = mean.mean(), variance.mean()
    assert abs(cost.mean() - mean) < 3 * np.sqrt(variance / 120)
    assert 0.7 < cost.var(ddof=1) / variance < 1.4
    # Chi-squared would be four of each equation of a line; here it is far off.
    assert variance < 0.5 * 4 * 2 * LINES or quiet
    assert variance > 2 * 4 * 2 * LINES or not quiet


def test_noise_of_the_channels_is_told_by_the_errors():
    """Three channels behind two equations that change from line to line."""
    rng = np.random.default_rng(3)
    rows = complex_noise(rng, 400, 2, 3) * np.linspace(0.1, 3, 400)[:, None, None]
    truth = np.array([4.0, 1.0, 0.25])
    noise = complex_noise(rng, 400, 3) * np.sqrt(truth)
    errors = (rows @ noise[:, :, None])[:, :, 0]
    found = by_errors._channel_noise(rows, errors, np.ones(3))
    assert found / truth == pytest.approx(1, abs=0.5)
    assert 5 < found[0] / found[2] < 40


def test_noise_of_the_channels_is_told_in_ten_rounds():
    """Of two channels behind one equation: v + v^2 (1 - s) / s^2 from v, s the sum of both."""
    told = np.array([3.0, 1.0])
    for _ in range(10):
        told = told + told**2 * (1 - told.sum()) / told.sum() ** 2
    start = np.array([3.0, 1.0])
    found = by_errors._channel_noise(np.ones((5, 1, 2)) + 0j, np.ones((5, 1)) + 0j, start)
    assert found == pytest.approx(told, rel=1e-12)


def test_some_hundreds_of_lines_tell_the_noise(monkeypatch):
    seen, told = [], by_errors._channel_noise

    def watched(rows, *rest):
        seen.append(len(rows))
        return told(rows, *rest)

    monkeypatch.setattr(by_errors, "_channel_noise", watched)
    number = np.arange(1600)
    near = Beside(np.ones((1600, 1)) + 0j, number >= 0, number, number)
    by_errors._whitened(evaluated(complex_noise(np.random.default_rng(8), 1600, 2)), near, [0, 1])
    assert seen == [400]


def test_a_line_that_stands_out_is_in_its_own_cost_alone():
    rng = np.random.default_rng(6)
    errors = complex_noise(rng, LINES, 2)
    errors[250] *= 100
    near = beside(rng, 1)
    ordinary = near.ordinary.copy()
    ordinary[250] = False
    hidden, expected, _ = by_errors._sum_of(evaluated(errors), near, [0, 1])
    assert hidden < 1.1 * expected
    near = replace(near, ordinary=ordinary)
    seen, expected, _ = by_errors._sum_of(evaluated(errors), near, [0, 1])
    assert seen > 5 * expected


def test_too_few_lines_and_no_noise_tell_nothing():
    rng = np.random.default_rng(7)
    near = beside(rng, 1)
    few = slice(0, 20)
    short = Beside(near.columns[few], near.ordinary[few], near.centre[few], near.where[few])
    assert by_errors._sum_of(evaluated(complex_noise(rng, 20, 2)), short, [0, 1]) is None
    assert by_errors._sum_of(evaluated(np.zeros((LINES, 2), dtype=complex)), near, [0, 1]) is None


def test_loads_of_a_quiet_record_tell_no_noise():
    """They leak into all of its lines; errors come out of one size, beside the mode and away.

    With sizes told by the quiet record J was .35 % below what it should be, in 240 records.
    """
    rng = np.random.default_rng(9)
    offset = np.arange(LINES) - 250.5
    rows = np.stack([50 / (1 + offset**2), np.ones(LINES)], axis=1)[:, None, :] + 0j
    noise, still = complex_noise(rng, 2, LINES, 2)
    still[:, 1] += 300 / offset
    errors = (rows @ noise[:, :, None])[:, :, 0]
    white, _ = by_errors._whitened(evaluated(errors, rows), beside(rng, 0, noise=still), [0, 1])
    size, near = (np.abs(white) ** 2).sum(axis=1), np.abs(offset) < 12
    assert 0.5 < size[near].mean() / size[~near].mean() < 2


@pytest.fixture(scope="module")
def lines():
    return lines_of(levitated(3))


@pytest.mark.parametrize(("wide", "low", "high"), [(1.0, 0.97, 1.03), (1.08, 0.97, 1.03)])
def test_noise_that_bends_moves_the_expectation(lines, wide, low, high):
    """C a little too large, as of noise that bends in its window: the misfit is no smaller."""
    covariance = replace(lines.covariance, matrices=wide * lines.covariance.matrices)
    misfit = identify(QUIET_MODEL, replace(lines, covariance=covariance), QUICK).misfit
    assert low < misfit.cost / misfit.expected < high
    assert 1e-3 < misfit.p_value < 1 - 1e-3


def test_a_covariance_that_holds_motion_is_told(lines):
    """C much too large is no bend of noise: the cost is too good, and that is said."""
    covariance = replace(lines.covariance, matrices=1.15 * lines.covariance.matrices)
    estimate = identify(QUIET_MODEL, replace(lines, covariance=covariance), QUICK)
    assert estimate.misfit.cost < 0.9 * estimate.misfit.expected


def test_columns_exchanged_are_exchanged_in_the_quiet_record_too():
    """Sensors taken for one another, one upside down: as if both records were logged so."""
    record, quiet = levitated(2, 1.0), levitated(4, 1.0, excitation=0.0)
    matrix = np.eye(6)
    matrix[2:4, 2:4] = [[0.0, 1.0], [-1.0, 0.0]]
    logged = [replace(each, samples=each.samples @ matrix.T) for each in (record, quiet)]
    expected = lines_of(logged[0], quiet=logged[1])
    found = bind(QUIET_MODEL, lines_of(record, quiet=quiet)).with_columns(matrix[:4, :4]).lines
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12)
    np.testing.assert_allclose(found.beside.noise, expected.beside.noise, rtol=1e-12)


def test_what_a_controller_makes_of_noise_drives_the_rotor():
    """Noise of an input that is larger than V allows is force: V - s^2 b b^H stays positive."""
    rng = np.random.default_rng(8)
    rows = complex_noise(rng, 5, 2, 3)
    matrices = rows @ rows.conj().transpose(0, 2, 1)
    lower, columns = np.linalg.cholesky(matrices), complex_noise(rng, 5, 2, 2)
    factor = np.stack([np.diag([10.0, 1e-3])] * 5).astype(complex)  # of the loop; of an amplifier
    problem = SimpleNamespace(noise=SimpleNamespace(factor=factor))
    white = np.linalg.solve(lower, columns)
    at = SimpleNamespace(whitened_columns=lambda: white, problem=problem)
    share = _idle_share(at, 2)
    np.testing.assert_allclose(share[:, 1], 1.0)
    for line in range(5):
        idle = 10 * share[line, 0] * columns[line, :, 0]
        left = matrices[line] - np.outer(idle, idle.conj())
        smallest, largest = np.linalg.eigvalsh(left)
        assert abs(smallest) < 1e-9 * largest
