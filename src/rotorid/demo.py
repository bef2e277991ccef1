"""The demonstration: a levitated machine beside its truth, and the paper's example.

The machine is the shipped rig `three-mass`, with the four position sensors of its bearings alone.
What is taken as known is a length by a ruler and the rotor's mass by a scale; the constants of the
bearings are not, and start some per cent off.

The example is passage 3 of Levy and Arogeti: its Table 1 as printed, and its records with fresh
noise.

The bearings drive the rotor of the model `three-mass` by

    F_x3 = F_y1 = 2 F_x1 = -2 F_y3 = sum_{i=0..5} 10 sin(w_i t) + 10 cos(w_i t)

with w_i = 2 pi (20 + 40 i), at Omega = 2 pi 140 rad/s. The paper calls the second bearing 2; its
forces act on m3; it prints the stiffnesses in N m, N m^2 and N m^3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from rotorid.answer.estimate import Estimate
from rotorid.answer.identify import Estimator, identify
from rotorid.core.errors import InputError
from rotorid.core.tables import Page, Table, table
from rotorid.core.values import Floats, frozen
from rotorid.core.watch import counting, silent, watched
from rotorid.data.record import PeriodicRecord, Record
from rotorid.likelihood.bound import Plan, predict_accuracy
from rotorid.likelihood.estimator import MaximumLikelihood
from rotorid.linear.estimators import Batch, LeastSquares, Sequential
from rotorid.models import Model, load_model
from rotorid.models.knowledge import Constraint
from rotorid.report.drawn import BLUE, GREEN, GREY, PINK, RED, SKY, Axis, Curve, Panel
from rotorid.report.estimate_report import estimate_report, verdict_of
from rotorid.report.html import Passage, page_of
from rotorid.results.evidence import with_evidence
from rotorid.rig.file import load_rig
from rotorid.rig.steady_state import simulate
from rotorid.signals.average import average
from rotorid.signals.inspection import Inspection, inspect_record
from rotorid.signals.spectrum import synthesize

SPEED = 2 * np.pi * 140.0  # rad/s
AMPLITUDE = 10.0  # N, of each sine and each cosine
SHARES = {"F_x1": 0.5, "F_y1": 1.0, "F_x3": 1.0, "F_y3": -0.5}
PERIODS = 260
SAMPLE_RATE = 5000.0  # Hz
FORCE_NOISE = 1.0  # N, per sample
POSITION_NOISE = 22e-6  # m or rad, per sample

ESTIMATORS: Mapping[str, Estimator] = {
    "batch-100": Batch(free_weight=100.0),
    "batch-10": Batch(free_weight=10.0),
    "sequential": Sequential(),
    "ls": LeastSquares(),
    "ml": MaximumLikelihood(base=True),
}

# Columns of the paper's table and the estimators here that they correspond to.
COLUMNS = {
    "batch-100": "1-step MLE, k = 100",
    "batch-10": "1-step MLE, k = 10",
    "sequential": "Sequential MLE",
    "ls": "1-step MLSE, Sigma = I",
}


class PaperRow(NamedTuple):
    base: str  # name of the base parameter of the model `three-mass`
    unit: str  # of what the paper lists
    true: float  # as printed
    errors: tuple[float, ...]  # |error| in % of one run, in the order of `COLUMNS`
    speed_power: int = 0  # the paper lists the base parameter times Omega to this power


TABLE = (
    PaperRow("m1", "kg", 0.83339, (0.120, 0.177, 0.150, 0.963)),
    PaperRow("m2", "kg", 11.322, (0.219, 0.298, 0.223, 1.245)),
    PaperRow("m3", "kg", 0.83339, (0.268, 0.350, 0.287, 1.266)),
    PaperRow("I_t", "kg m^2", 0.025425, (0.182, 0.222, 0.157, 0.986)),
    PaperRow("k1", "N/m", 8.8357e05, (0.119, 0.178, 0.139, 0.996)),
    PaperRow("k2", "N/m", 8.8357e05, (0.305, 0.403, 0.311, 1.466)),
    PaperRow("k1*L1", "N", 2.6507e05, (0.194, 0.243, 0.214, 1.014)),
    PaperRow("k2*L2", "N", 2.6507e05, (0.259, 0.362, 0.259, 1.430)),
    PaperRow("k1*L1^2 + k2*L2^2", "N m", 1.5904e05, (0.229, 0.306, 0.220, 1.225)),
    PaperRow("I_p", "kg m^2", 0.048275, (0.308, 0.344, 0.357, 1.042)),
    PaperRow("m2*xi", "N", 77.112, (0.031, 0.045, 0.048, 0.956), 2),
    PaperRow("m2*zeta", "N", 133.56, (0.352, 0.430, 0.346, 1.372), 2),
    PaperRow("I_t*mu - I_p*mu", "N m", -1.3145, (1.389, 1.692, 1.340, 3.868), 2),
    PaperRow("I_t*eta - I_p*eta", "N m", -2.2767, (0.984, 0.943, 0.910, 1.202), 2),
)


@frozen
class DemoResult:
    """Estimates over all runs beside the truth, base parameters in the order of the table."""

    units: tuple[str, ...]
    truth: Floats  # (base,)
    # by the name of an estimator, shape (run, base): estimates, and the deviations they state
    values: Mapping[str, Floats]
    deviations: Mapping[str, Floats]
    # (base,): the least standard deviation that an unbiased estimate can have (Cramer and Rao)
    bound: Floats

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(row.base for row in TABLE)

    @property
    def runs(self) -> int:
        return min(len(values) for values in self.values.values())

    @property
    def records(self) -> str:
        return f"{self.runs} records" if self.runs > 1 else "one record"

    def errors(self, estimator: str) -> Floats:
        """Return the errors in %, (run, base)."""
        return 100 * (self.values[estimator] / self.truth - 1)

    def bias(self, estimator: str) -> Floats:
        return np.asarray(self.errors(estimator).mean(axis=0))

    def rms(self, estimator: str) -> Floats:
        return np.asarray(np.sqrt((self.errors(estimator) ** 2).mean(axis=0)))

    def median(self, estimator: str) -> Floats:
        return np.asarray(np.median(np.abs(self.errors(estimator)), axis=0))

    @property
    def bound_percent(self) -> Floats:
        return np.asarray(100 * self.bound / np.abs(self.truth))

    @property
    def by_merit(self) -> list[str]:
        """The estimators, first the one that stands beside the bound."""
        return sorted(self.values, key=lambda name: name != "ml")

    def scatter_over_stated(self, estimator: str) -> Floats:
        stated = np.sqrt((self.deviations[estimator] ** 2).mean(axis=0))
        return np.asarray(self.values[estimator].std(axis=0, ddof=1) / stated)

    def to_dict(self) -> dict[str, Any]:
        def told(**figures: Floats) -> dict[str, dict[str, float]]:
            return {
                name: {key: float(values[i]) for key, values in figures.items()}
                for i, name in enumerate(self.names)
            }

        return {
            "runs": self.runs,
            "noise": {"force": FORCE_NOISE, "position": POSITION_NOISE},
            "estimators": {
                name: told(
                    bias_percent=self.bias(name),
                    rms_percent=self.rms(name),
                    median_abs_percent=self.median(name),
                )
                for name in self.values
            },
            "bound": told(rms_percent=self.bound_percent),
        }


def demo_plan(model: Model) -> Plan:
    line = AMPLITUDE * (1 - 1j) / 2  # of a sine and a cosine
    force = dict.fromkeys(model.inputs, FORCE_NOISE)
    position = dict.fromkeys(model.coordinates, POSITION_NOISE)
    return Plan(
        forces=np.full((len(HARMONICS), 1), line) * [SHARES[name] for name in model.inputs],
        harmonics=HARMONICS,
        fundamental=FUNDAMENTAL,
        sample_rate=SAMPLE_RATE,
        periods=PERIODS,
        noise={**force, **position},
        speed=SPEED,
    )


def simulate_record(model: Model, rng: np.random.Generator | None = None) -> Record:
    """Return a record of the example in steady state; without `rng` free of noise."""
    plan = demo_plan(model)
    return simulate(
        model,
        model.values(model.nominal),
        synthesize(plan.forces, plan.harmonics, round(SAMPLE_RATE / FUNDAMENTAL)),
        sample_rate=plan.sample_rate,
        periods=plan.periods,
        speed=plan.speed,
        noise=plan.noise if rng is not None else None,
        rng=rng,
    )


def run_demo(
    runs: int = 60,
    *,
    rng: np.random.Generator,
    estimators: Mapping[str, Estimator] = ESTIMATORS,
) -> DemoResult:
    if runs < 1:
        raise InputError(f"{runs} runs", "one or more", "ask for 60", place="runs")
    model, names = load_model("three-mass"), [row.base for row in TABLE]
    found = {name: np.empty((2, runs, len(names))) for name in estimators}
    with threadpool_limits(1, "blas"):  # matrices so small that threads only wait for each other
        children = counting(rng.spawn(runs), "identifying records of the paper's example")
        for run, child in enumerate(children):
            periods = average(simulate_record(model, child), FUNDAMENTAL, harmonics=HARMONICS)
            for name, estimator in estimators.items():
                with watched(silent):
                    estimate = identify(model, periods, estimator)
                read = [(estimate.value(base), estimate[base].std or np.nan) for base in names]
                found[name][:, run] = np.transpose(read)
    values, deviations = ({name: each[i] for name, each in found.items()} for i in range(2))
    order = [model.base.names.index(name) for name in names]
    truth = model.base_values(model.values(model.nominal))[order]
    least = predict_accuracy(model, demo_plan(model), MaximumLikelihood(base=True))
    bound = np.array([least.std(name) for name in names], dtype=float)
    return DemoResult(tuple(model.base.units[i] for i in order), truth, values, deviations, bound)


ENOUGH = 10  # records, below which bias cannot be told from scatter
FIRM = 2.0  # standard errors from which on a difference counts


def findings(result: DemoResult) -> list[str]:
    ratios = ((name, result.rms(name) / result.bound_percent) for name in result.by_merit)
    told = ", ".join(f"{name} {over.min():.2f} to {over.max():.2f}" for name, over in ratios)
    bound = (
        f"The rms errors of the {len(result.names)} base parameters over {result.records}, as "
        f"multiples of the Cramer-Rao bound: {told}."
    )
    if result.runs < ENOUGH:
        return [bound, f"Fewer than {ENOUGH} records cannot tell bias from scatter."]
    share, other = (100 * np.median(bias_share(result, name)) for name in ("ls", "batch-100"))
    bias = (
        f"Bias is {share:.0f} % of the mean square error of ls, and {other:.0f} % of that of "
        "batch-100 (median over the parameters)"
    )
    if share >= 50:
        small = int((result.bias("ls") < 0).sum())
        bias += (
            f": ls treats the noisy positions as exact, so that {small} of {len(result.names)} "
            "parameters come out too small, and its deviations do not cover the bias"
        )
    alike = ratio_of_errors(result, "sequential", "batch-100")
    mean, deviation = ratio_of_errors(result, "batch-100", "batch-10")
    ranking = "is not significant"
    if abs(mean) > FIRM * deviation:
        ranking = "is reproduced" if mean < 0 else "is reversed"
    honest = [name for name in result.values if name != "ls"]  # bias is in no deviation
    over = np.concatenate([result.scatter_over_stated(name) for name in honest])
    return [
        bound,
        f"{bias}.",
        "The paper finds the sequential estimator and weight 100 alike; here the ratio of their "
        f"rms errors is {_times(*alike)} (geometric mean over the parameters).",
        "The paper, from one run, ranks weight 100 before weight 10; here the ratio of their rms "
        f"errors is {_times(mean, deviation)}, so the ranking {ranking}.",
        f"The scatter of {', '.join(honest)} is {over.min():.2f} to {over.max():.2f} times the "
        "standard deviation that each estimate states.",
    ]


def bias_share(result: DemoResult, estimator: str) -> Floats:
    """Return the share of bias in the mean square error, (base,), less what scatter gives it."""
    errors = result.errors(estimator)
    chance = errors.var(axis=0, ddof=1) / len(errors)
    square = (errors**2).mean(axis=0)
    return np.asarray(((errors.mean(axis=0) ** 2 - chance) / square).clip(0, 1))


def ratio_of_errors(result: DemoResult, first: str, second: str) -> tuple[float, float]:
    """Return mean log ratio of rms errors, and its jackknife deviation: both saw the same noise."""
    squares = [result.errors(name) ** 2 for name in (first, second)]
    sums = [square.sum(axis=0) for square in squares]
    left_out = 0.5 * np.log((sums[0] - squares[0]) / (sums[1] - squares[1])).mean(axis=1)
    mean = 0.5 * np.log(sums[0] / sums[1]).mean()
    return float(mean), float(np.sqrt(len(left_out) - 1) * left_out.std())


def _times(mean: float, deviation: float) -> str:
    return f"{np.exp(mean):.3f} +- {np.exp(mean) * deviation:.3f}"


def sizes(result: DemoResult) -> Table:
    columns = {"bound": result.bound_percent}
    columns |= {name: result.rms(name) for name in result.by_merit}
    rows = np.column_stack(list(columns.values()))
    told = ([f"{value:.3f}" for value in row] for row in rows)
    named = zip(result.names, told, strict=True)
    return table(("parameter", *columns), [(name, *row) for name, row in named])


def beside_the_paper(result: DemoResult) -> Table:
    medians = [result.median(name) for name in COLUMNS]
    rows = []
    for i, row in enumerate(TABLE):
        pairs = zip(row.errors, (median[i] for median in medians), strict=True)
        errors = (f"{error:.3f}" for pair in pairs for error in pair)
        rows.append((row.base, f"{result.truth[i]:.5g}", result.units[i], *errors))
    headings = [text for name in COLUMNS for text in (name, "here")]
    return table(("parameter", "true", "unit", *headings), rows)


COLOURS = {"batch-100": BLUE, "batch-10": SKY, "sequential": GREEN, "ls": RED}


def rms_panel(result: DemoResult) -> Panel:
    place = np.arange(len(result.names), dtype=float)
    curves = [
        Curve(result.rms(name), place, name, COLOURS.get(name, PINK), "dots")
        for name in result.values
    ]
    bound = Curve(result.bound_percent, place, "the least possible", GREY, "diamonds")
    axis = Axis(f"rms error in %, {result.records}", log=True)
    return Panel("", axis, Axis(names=result.names), (*curves, bound), height=4)


CONDITIONS = (
    "Model three-mass, the paper's equations (7), turning at 140 rev/s; forces on the bearings at "
    f"20, 60, 100, 140, 180 and 220 Hz; {PERIODS} periods of 20 Hz. The paper states neither "
    f"sample rate nor noise; here they are {SAMPLE_RATE:g} Hz, and white noise of "
    f"{FORCE_NOISE:g} N on every sample of a force and of {1e6 * POSITION_NOISE:g} um or urad on "
    "every sample of a position, at which its errors come out at their own size. Units of the "
    "paper's stiffnesses are corrected."
)


def demo_tables(result: DemoResult) -> tuple[Passage, ...]:
    printed = (f"({r.base}) Omega^2 = {r.true:.5g} {r.unit}" for r in TABLE if r.speed_power)
    named = (f"{name} is their {column}" for name, column in COLUMNS.items())
    return (
        Passage(
            "Errors of every estimator",
            f"Root mean square in %, over {result.records}. The bound is the least that an "
            "unbiased estimate can have (Cramer and Rao).",
            sizes(result),
            panels=(rms_panel(result),),
        ),
        Passage(
            "Table 1 of the paper",
            "Size of the error of the one run that the paper prints, in %, and beside it the "
            f"median here of {result.records}. {'; '.join(named)}. The paper lists the unbalance "
            f"times Omega^2, whose errors in % are the same: {', '.join(printed)}.",
            beside_the_paper(result),
            after=CONDITIONS,
        ),
    )


def demo_page(result: DemoResult) -> Page:
    page: list[str | Table] = []
    for part in demo_tables(result):
        page += [f"{part.title}. {part.caption}", *([part.table] if part.table else [])]
    return [*page, *findings(result)]


def demo_report(result: DemoResult) -> str:
    first, *others = findings(result)
    page = Passage(
        "Identification of a flexible rotor on magnetic bearings",
        lead=f"The numerical example of Levy and Arogeti, section 3, simulated {result.runs} times "
        "with fresh noise and identified by each of their estimators and by maximum likelihood",
        verdict=first,
        mood="good",
        parts=(Passage("What the figures show", items=tuple(others)), *demo_tables(result)),
    )
    return page_of(page, tab="rotorid demo")


RIG = "three-mass"
SENSORS = ("x1", "y1", "x3", "y3")  # in the planes of the bearings
SECONDS = 13.0
FUNDAMENTAL = 20.0  # Hz
HARMONICS = (1, 3, 5, 7, 9, 11)
STATED = 0.95  # of the constants of the bearings: what a data sheet may be off
WEIGHED = 0.005  # kg, deviation of the scale
MASS = "m1 + m2 + m3"


@frozen
class MachineResult:
    model: Model
    inspection: Inspection
    periods: PeriodicRecord
    estimator: MaximumLikelihood  # what was known beforehand
    estimate: Estimate
    # of the parameters, and of the constants of the bearings by their names in the estimate
    truth: Mapping[str, float]


def run_machine(rng: np.random.Generator) -> MachineResult:
    rig = load_rig(RIG).rig
    rig = replace(rig, sensors=tuple(s for s in rig.sensors if s.name in SENSORS))
    record = rig.run(SECONDS, rng)
    laws = {name: part.law.linearize() for name, part in rig.actuators.items() if part.law}
    truth = {**rig.values, **{f"ki[{name}]": law.ki for name, law in laws.items()}}
    truth["ks"] = next(iter(laws.values())).ks
    stated = [
        c.drive and replace(c.drive, ki=STATED * c.drive.ki, ks=STATED * c.drive.ks)
        for c in record.channels
    ]
    channels = [replace(c, drive=d) for c, d in zip(record.channels, stated, strict=True)]
    record = replace(record, channels=tuple(channels))
    periods = average(record, FUNDAMENTAL, harmonics=HARMONICS)
    total = sum(rig.values[name] for name in ("m1", "m2", "m3"))
    known = MaximumLikelihood(
        fixed={"L1": rig.values["L1"]},
        constraints=(Constraint(MASS, total + WEIGHED * rng.standard_normal(), WEIGHED),),
        gains=("ki", "ks"),
    )
    size = round(record.sample_rate / FUNDAMENTAL)
    found = inspect_record(record, period_samples=size, harmonics=HARMONICS)
    return MachineResult(
        rig.model, found, periods, known, identify(rig.model, periods, known), truth
    )


def machine_page(result: MachineResult) -> Page:
    periods, seconds = result.periods, result.periods.periods / result.periods.fundamental
    fixed = [f"{v.name} = {v.value:g} {v.unit}" for v in result.estimate.parameters if v.fixed]
    return [
        "A levitated rotor from its bearings: four position sensors, four coil currents",
        f"simulated: {seconds:g} s at {periods.sample_rate:g} Hz, "
        f"{periods.speed * 30 / math.pi:.0f} rpm, under a controller",
        f"inspected: {result.inspection.verdict}. {result.inspection.sentence}",
        f"known beforehand: {', '.join(fixed)}, {MASS} by a scale; the constants of the bearings "
        f"were stated {100 * (1 - STATED):.0f} % too small, and are unknown",
        f"identified: {verdict_of(result.estimate).sentence}",
        beside_the_truth(result),
    ]


def beside_the_truth(result: MachineResult) -> Table:
    rows = []
    for value in result.estimate.free:
        if value.name not in result.truth or not value.std:
            continue
        truth = result.truth[value.name]
        off = (value.value - truth) / value.std
        size = f"{100 * value.std / abs(truth):.2g}"
        unit = "" if value.unit == "1" else value.unit
        rows.append((value.name, f"{truth:.6g}", f"{value.value:.6g}", size, f"{off:+.1f}", unit))
    return table(("parameter", "true", "found", "std %", "off by std", "unit"), rows)


def machine_report(result: MachineResult) -> str:
    found = with_evidence(result.estimate, result.model, result.periods, result.estimator)
    return estimate_report(found)
