"""Section 3 of Levy and Arogeti: its Table 1 as printed, and its records with fresh noise.

The bearings drive the rotor of the model `three-mass` by

    F_x3 = F_y1 = 2 F_x1 = -2 F_y3 = sum_{i=0..5} 10 sin(w_i t) + 10 cos(w_i t)

with w_i = 2 pi (20 + 40 i), at Omega = 2 pi 140 rad/s. The paper calls the second bearing 2; its
forces act on m3. It states neither noise nor sample rate: with those here its errors come out at
their own magnitude. In the table the units of the stiffnesses are corrected (the paper prints N m,
N m^2 and N m^3).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from rotorid.answer.identify import Estimator, identify
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.core.watch import counting, silent, watched
from rotorid.data.record import Record
from rotorid.likelihood.bound import Plan, predict_accuracy
from rotorid.likelihood.estimator import MaximumLikelihood
from rotorid.linear.estimators import Batch, LeastSquares, Sequential
from rotorid.models import Model, load_model
from rotorid.rig.steady_state import simulate
from rotorid.signals.average import average

SPEED = 2 * np.pi * 140.0  # rad/s
FUNDAMENTAL = 20.0  # Hz
HARMONICS = (1, 3, 5, 7, 9, 11)
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


@frozen
class PaperRow:
    base: str  # name of the base parameter of the model `three-mass`
    quantity: str  # what the paper lists
    unit: str  # of the paper's quantity
    true: float  # as printed
    errors: tuple[float, float, float, float]  # |error| in % of one run, in the order of `COLUMNS`
    speed_power: int = 0  # the paper's quantity is the base parameter times Omega to this power


TABLE = (
    PaperRow("m1", "m1", "kg", 8.3339e-01, (0.120, 0.177, 0.150, 0.963)),
    PaperRow("m2", "m2", "kg", 1.1322e01, (0.219, 0.298, 0.223, 1.245)),
    PaperRow("m3", "m3", "kg", 8.3339e-01, (0.268, 0.350, 0.287, 1.266)),
    PaperRow("I_t", "I_t", "kg m^2", 2.5425e-02, (0.182, 0.222, 0.157, 0.986)),
    PaperRow("k1", "k1", "N/m", 8.8357e05, (0.119, 0.178, 0.139, 0.996)),
    PaperRow("k2", "k2", "N/m", 8.8357e05, (0.305, 0.403, 0.311, 1.466)),
    PaperRow("k1*L1", "k1 L1", "N", 2.6507e05, (0.194, 0.243, 0.214, 1.014)),
    PaperRow("k2*L2", "k2 L2", "N", 2.6507e05, (0.259, 0.362, 0.259, 1.430)),
    PaperRow(
        "k1*L1^2 + k2*L2^2",
        "k1 L1^2 + k2 L2^2",
        "N m",
        1.5904e05,
        (0.229, 0.306, 0.220, 1.225),
    ),
    PaperRow("I_p", "I_p", "kg m^2", 4.8275e-02, (0.308, 0.344, 0.357, 1.042)),
    PaperRow("m2*xi", "xi m2 Omega^2", "N", 7.7112e01, (0.031, 0.045, 0.048, 0.956), 2),
    PaperRow("m2*zeta", "zeta m2 Omega^2", "N", 1.3356e02, (0.352, 0.430, 0.346, 1.372), 2),
    PaperRow(
        "I_t*mu - I_p*mu",
        "mu (I_t - I_p) Omega^2",
        "N m",
        -1.3145e00,
        (1.389, 1.692, 1.340, 3.868),
        2,
    ),
    PaperRow(
        "I_t*eta - I_p*eta",
        "eta (I_t - I_p) Omega^2",
        "N m",
        -2.2767e00,
        (0.984, 0.943, 0.910, 1.202),
        2,
    ),
)


def printed_error(row: PaperRow, estimator: str) -> float | None:
    """Return the error in % that the paper prints for an estimator; None where it has none."""
    return dict(zip(COLUMNS, row.errors, strict=True)).get(estimator)


@frozen
class DemoResult:
    """Estimates over all runs beside the truth, base parameters in the order of the table."""

    units: tuple[str, ...]
    truth: Floats  # (base,)
    # mapping of estimator name to array, shape (run, base): estimates and the standard deviations
    # that they state
    values: Mapping[str, Floats]
    deviations: Mapping[str, Floats]
    # (base,): the least standard deviation that an unbiased estimate can have (Cramer and Rao)
    bound: Floats

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(row.base for row in TABLE)

    @property
    def estimators(self) -> tuple[str, ...]:
        return tuple(self.values)

    @property
    def runs(self) -> int:
        return min(len(values) for values in self.values.values())

    def errors(self, estimator: str) -> Floats:
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

    def scatter_over_stated(self, estimator: str) -> Floats:
        """Return the scatter of the estimates over the deviation they state, shape (base,)."""
        stated = np.sqrt((self.deviations[estimator] ** 2).mean(axis=0))
        return np.asarray(self.values[estimator].std(axis=0, ddof=1) / stated)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, as ``rotorid demo --json`` writes them."""

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
                for name in self.estimators
            },
            "bound": told(rms_percent=self.bound_percent),
        }


def excitation(model: Model) -> Floats:
    """Return one period of the forces in N, shape (sample, input)."""
    samples = round(SAMPLE_RATE / FUNDAMENTAL)
    angle = 2 * np.pi * np.outer(np.arange(samples) / samples, HARMONICS)
    wave = AMPLITUDE * (np.sin(angle) + np.cos(angle)).sum(axis=1)
    return np.asarray(np.outer(wave, [SHARES[name] for name in model.inputs]))


def demo_plan(model: Model) -> Plan:
    line = AMPLITUDE * (1 - 1j) / 2  # of a sine and a cosine
    shares = [SHARES[name] for name in model.inputs]
    return Plan(
        forces=np.outer(np.full(len(HARMONICS), line), shares),
        harmonics=HARMONICS,
        fundamental=FUNDAMENTAL,
        sample_rate=SAMPLE_RATE,
        periods=PERIODS,
        noise=_noise(model),
        speed=SPEED,
    )


def _noise(model: Model) -> dict[str, float]:
    return {
        **dict.fromkeys(model.inputs, FORCE_NOISE),
        **dict.fromkeys(model.coordinates, POSITION_NOISE),
    }


def simulate_record(model: Model, rng: np.random.Generator | None = None) -> Record:
    """Return a record of the example in steady state; without `rng` free of noise."""
    return simulate(
        model,
        model.values(model.nominal),
        excitation(model),
        sample_rate=SAMPLE_RATE,
        periods=PERIODS,
        speed=SPEED,
        noise=_noise(model) if rng is not None else None,
        rng=rng,
    )


def run_demo(
    runs: int = 60,
    *,
    rng: np.random.Generator,
    estimators: Mapping[str, Estimator] = ESTIMATORS,
) -> DemoResult:
    """Simulate the paper's example `runs` times and identify it with every estimator."""
    if runs < 1:
        raise InputError(f"{runs} runs", "one or more", "ask for 60", place="runs")
    model, names = load_model("three-mass"), [row.base for row in TABLE]
    values = {name: np.empty((runs, len(names))) for name in estimators}
    deviations = {name: np.empty((runs, len(names))) for name in estimators}
    with threadpool_limits(1, "blas"):  # matrices so small that threads only wait for each other
        children = counting(rng.spawn(runs), "identifying records of the paper's example")
        for run, child in enumerate(children):
            periods = average(simulate_record(model, child), FUNDAMENTAL, harmonics=HARMONICS)
            for name, estimator in estimators.items():
                with watched(silent):
                    estimate = identify(model, periods, estimator)
                values[name][run] = [estimate.value(base) for base in names]
                deviations[name][run] = [estimate[base].std or np.nan for base in names]
    order = [model.base.names.index(name) for name in names]
    truth = model.base_values(model.values(model.nominal))[order]
    least = predict_accuracy(model, demo_plan(model), MaximumLikelihood(base=True))
    bound = np.array([least.std(name) for name in names], dtype=float)
    return DemoResult(tuple(model.base.units[i] for i in order), truth, values, deviations, bound)
