"""What the demonstration shows, in five sentences that follow from its figures."""

from __future__ import annotations

import numpy as np

from rotorid.core.values import Floats
from rotorid.demo.paper import DemoResult

ENOUGH = 10  # records, below which bias cannot be told from scatter
FIRM = 2.0  # standard errors


def findings(result: DemoResult) -> list[str]:
    sentences = [_against_bound(result)]
    if result.runs < ENOUGH:
        return [*sentences, f"Fewer than {ENOUGH} records cannot tell bias from scatter."]
    have = set(result.estimators)
    if {"ls", "batch-100"} <= have:
        sentences += [_least_squares(result)]
    if {"sequential", "batch-100"} <= have:
        sentences += [_sequential(result)]
    if {"batch-10", "batch-100"} <= have:
        sentences += [_free_weight(result)]
    return [*sentences, *_deviations(result)]


def _against_bound(result: DemoResult) -> str:
    records = f"{result.runs} records" if result.runs > 1 else "one record"
    names = sorted(result.estimators, key=lambda name: name != "ml")
    ratios = [(name, result.rms(name) / result.bound_percent) for name in names]
    told = ", ".join(f"{name} {over.min():.2f} to {over.max():.2f}" for name, over in ratios)
    return (
        f"The rms errors of the {len(result.names)} base parameters over {records}, as multiples "
        f"of the Cramer-Rao bound: {told}."
    )


def bias_share(result: DemoResult, estimator: str) -> Floats:
    """Return the share of bias in the mean square error, shape (base,).

    The square of the mean error is freed of the part that scatter over few records gives it.
    """
    errors = result.errors(estimator)
    chance = errors.var(axis=0, ddof=1) / len(errors)
    square = (errors**2).mean(axis=0)
    return np.asarray(((errors.mean(axis=0) ** 2 - chance) / square).clip(0, 1))


def _least_squares(result: DemoResult) -> str:
    share, other = (
        100 * float(np.median(bias_share(result, name))) for name in ("ls", "batch-100")
    )
    text = (
        f"Bias is {share:.0f} % of the mean square error of ls, and {other:.0f} % of that of "
        "batch-100 (median over the parameters)"
    )
    if share < 50:
        return f"{text}."
    bias = result.bias("ls")
    return (
        f"{text}: ls treats the noisy positions as exact, so that {int((bias < 0).sum())} of "
        f"{len(bias)} parameters come out too small, and its deviations do not cover the bias."
    )


def ratio_of_errors(result: DemoResult, first: str, second: str) -> tuple[float, float]:
    """Return log of the ratio of rms errors, mean over the parameters, and its deviation.

    Both estimators saw the same noise: the deviation leaves out one record after the other.
    """
    squares = [result.errors(name) ** 2 for name in (first, second)]
    sums = [square.sum(axis=0) for square in squares]
    left_out = 0.5 * np.log((sums[0] - squares[0]) / (sums[1] - squares[1])).mean(axis=1)
    mean = 0.5 * np.log(sums[0] / sums[1]).mean()
    return float(mean), float(np.sqrt(len(left_out) - 1) * left_out.std())


def _times(mean: float, deviation: float) -> str:
    return f"{np.exp(mean):.3f} +- {np.exp(mean) * deviation:.3f}"


def _sequential(result: DemoResult) -> str:
    ratio = _times(*ratio_of_errors(result, "sequential", "batch-100"))
    return (
        "The paper finds the sequential estimator and weight 100 alike; here the ratio of their "
        f"rms errors is {ratio} (geometric mean over the parameters)."
    )


def _free_weight(result: DemoResult) -> str:
    mean, deviation = ratio_of_errors(result, "batch-100", "batch-10")
    verdict = "is not significant"
    if abs(mean) > FIRM * deviation:
        verdict = "is reproduced" if mean < 0 else "is reversed"
    return (
        "The paper, from one run, ranks weight 100 before weight 10; here the ratio of their rms "
        f"errors is {_times(mean, deviation)}, so the ranking {verdict}."
    )


def _deviations(result: DemoResult) -> list[str]:
    """Return how the scatter compares with what is stated; bias is not in it, nor then ls."""
    honest = [name for name in result.estimators if name != "ls"]
    ratios = np.concatenate([result.scatter_over_stated(name) for name in honest])
    if not honest or not np.isfinite(ratios).all():
        return []
    return [
        f"The scatter of {', '.join(honest)} is {ratios.min():.2f} to {ratios.max():.2f} times "
        "the standard deviation that each estimate states."
    ]
