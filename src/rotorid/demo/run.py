"""Section 3 of Levy and Arogeti, simulated and identified with fresh noise as often as asked for.

The bearings drive the rotor of the model `three-mass` by

    F_x3 = F_y1 = 2 F_x1 = -2 F_y3 = sum_{i=0..5} 10 sin(w_i t) + 10 cos(w_i t)

with w_i = 2 pi (20 + 40 i), at Omega = 2 pi 140 rad/s. The paper calls the second bearing 2; its
forces act on m3. It states neither noise nor sample rate: with those here its errors come out at
their own magnitude.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from rotorid.answer.estimate import Estimate
from rotorid.answer.identify import Estimator, identify
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.core.watch import counting, silent, watched
from rotorid.data.record import PeriodicRecord, Record
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


@frozen
class Example:
    """The first of the records, with its estimates: what the pictures show."""

    model: Model
    record: Record
    periods: PeriodicRecord
    estimates: Mapping[str, Estimate]


@frozen
class DemoResult:
    """Estimates over all runs beside the truth."""

    # base parameters of the model
    names: tuple[str, ...]
    units: tuple[str, ...]
    truth: Floats  # (base,)
    # mapping of estimator name to array, shape (run, base): estimates and the standard deviations
    # that they state
    values: Mapping[str, Floats]
    deviations: Mapping[str, Floats]
    # (base,): the least standard deviation that an unbiased estimate can have (Cramer and Rao)
    bound: Floats
    example: Example

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
        return {
            "runs": self.runs,
            "noise": {"force": FORCE_NOISE, "position": POSITION_NOISE},
            "estimators": {
                estimator: {
                    name: {
                        "bias_percent": float(bias),
                        "rms_percent": float(rms),
                        "median_abs_percent": float(median),
                    }
                    for name, bias, rms, median in zip(
                        self.names,
                        self.bias(estimator),
                        self.rms(estimator),
                        self.median(estimator),
                        strict=True,
                    )
                }
                for estimator in self.estimators
            },
            "bound": {
                name: {"rms_percent": float(least)}
                for name, least in zip(self.names, self.bound_percent, strict=True)
            },
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
    model = load_model("three-mass")
    names = model.base.names
    values = {name: np.empty((runs, len(names))) for name in estimators}
    deviations = {name: np.empty((runs, len(names))) for name in estimators}
    example = None
    with threadpool_limits(1, "blas"):  # matrices so small that threads only wait for each other
        children = counting(rng.spawn(runs), "identifying records of the paper's example")
        for run, child in enumerate(children):
            record = simulate_record(model, child)
            periods = average(record, FUNDAMENTAL, harmonics=HARMONICS)
            with watched(silent):
                found = {name: identify(model, periods, e) for name, e in estimators.items()}
            example = example or Example(model, record, periods, found)
            for name, estimate in found.items():
                values[name][run] = [estimate.value(base) for base in names]
                deviations[name][run] = [estimate[base].std or np.nan for base in names]
    assert example is not None
    truth = model.base_values(model.values(model.nominal))
    bounds = predict_accuracy(model, demo_plan(model), MaximumLikelihood(base=True))
    bound = np.array([bounds.std(name) for name in names], dtype=float)
    return DemoResult(names, model.base.units, truth, values, deviations, bound, example)
