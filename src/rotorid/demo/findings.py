"""What the demonstration shows, in words that follow from its figures."""

from __future__ import annotations

import numpy as np

from rotorid.core.values import Floats
from rotorid.demo.paper import TABLE, printed_error
from rotorid.demo.run import DemoResult

ENOUGH = 10  # records, below which bias cannot be told from scatter
FIRM = 2.0  # standard errors


def findings(result: DemoResult) -> list[str]:
    """Return sentences on what the errors of all records show."""
    sentences = [_sizes(result)]
    if result.runs < ENOUGH:
        return [*sentences, "From so few bias cannot be told from scatter: take more runs."]
    have = set(result.estimators)
    if {"ls", "batch-100"} <= have:
        sentences += [_least_squares(result)]
    if {"sequential", "batch-100"} <= have:
        sentences += [_sequential(result)]
    if {"batch-10", "batch-100"} <= have:
        sentences += [_free_weight(result)]
    if "ml" in have:
        sentences += [_maximum_likelihood(result)]
    return [*sentences, *_draws(result), *_deviations(result)]


def _sizes(result: DemoResult) -> str:
    records = f"{result.runs} records" if result.runs > 1 else "one record"
    parts = []
    for name in result.estimators:
        rms = result.rms(name)
        parts.append(f"{rms.min():.2g} to {rms.max():.2g} % ({name})")
    return (
        f"Over {records} with fresh noise, the rms errors of the {len(result.names)} base "
        f"parameters are {_listed(parts)}."
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
    worse = np.exp(np.median(np.log(result.rms("ls") / result.rms("batch-100"))))
    share, other = (
        100 * float(np.median(bias_share(result, name))) for name in ("ls", "batch-100")
    )
    bias = result.bias("ls")
    low = int((bias < 0).sum())
    compared = f"{worse:.1f} times those of batch-100" if worse > 1 else "no larger"
    text = (
        f"The errors of ls are {compared} (median over the parameters), and bias makes up "
        f"{share:.0f} % of their mean square, against {other:.0f} % for batch-100"
    )
    if share < 50:
        return f"{text}."
    return (
        f"{text}: it finds {low} of {len(bias)} parameters too small, by {-np.median(bias):.1f} % "
        "in the median, since it takes the noisy positions for exact; its stated deviations do "
        "not cover that."
    )


def _sequential(result: DemoResult) -> str:
    ratio = result.rms("sequential") / result.rms("batch-100")
    alike = max(ratio.max(), 1 / ratio.min()) < 1.15
    return (
        "The paper finds the sequential estimator and weight 100 alike, and these records "
        f"{'agree' if alike else 'disagree'}: the ratio of their errors is {ratio.min():.2f} to "
        f"{ratio.max():.2f}."
    )


def log_ratios(result: DemoResult, first: str, second: str) -> tuple[Floats, Floats, float, float]:
    """Compare the rms errors of two estimators that saw the same noise."""
    squares = [result.errors(name) ** 2 for name in (first, second)]
    sums = [square.sum(axis=0) for square in squares]
    ratios = 0.5 * np.log(sums[0] / sums[1])
    left_out = 0.5 * np.log((sums[0] - squares[0]) / (sums[1] - squares[1]))
    factor = np.sqrt(len(left_out) - 1)
    deviations = factor * left_out.std(axis=0)
    mean = left_out.mean(axis=1)
    return ratios, deviations, float(ratios.mean()), float(factor * mean.std())


def _free_weight(result: DemoResult) -> str:
    ranked = [(printed_error(r, "batch-100"), printed_error(r, "batch-10")) for r in TABLE]
    ahead = sum(a < b for a, b in ranked if a is not None and b is not None)
    ratios, deviations, mean, deviation = log_ratios(result, "batch-100", "batch-10")
    if mean < -FIRM * deviation:
        verdict = "That is reproduced"
    elif mean > FIRM * deviation:
        verdict = "That is not reproduced: on average it is the other way round"
    else:
        verdict = "That is not reproduced: on average they differ by no more than chance"
    better = int((ratios < -FIRM * deviations).sum())
    worse = int((ratios > FIRM * deviations).sum())
    most = int(ratios.argmax())
    text = (
        f"The paper, from one run, ranks weight 100 before weight 10, in {ahead} of "
        f"{len(ranked)} parameters. {verdict}, the rms error of weight 100 being "
        f"{np.exp(mean):.3f} +- {np.exp(mean) * deviation:.3f} times that of weight 10 (geometric "
        f"mean over the parameters); beyond two standard errors it is smaller in {better} of "
        f"{len(ratios)} and larger in {worse}"
    )
    if worse:
        large, small = (result.rms(name)[most] for name in ("batch-100", "batch-10"))
        text += f", most so for {result.names[most]} ({large:.3g} against {small:.3g} %)"
    return f"{text}. {_trade(result)}"


def _trade(result: DemoResult) -> str:
    names = ("batch-100", "batch-10")
    bias = [float(np.median(np.abs(result.bias(n)))) for n in names]
    scatter = [float(np.median(result.errors(n).std(axis=0))) for n in names]
    traded = bias[0] < bias[1] and scatter[0] > scatter[1]
    text = (
        f"the median |bias| is {bias[0]:.2f} with 100 and {bias[1]:.2f} % with 10, the median "
        f"scatter {scatter[0]:.3f} and {scatter[1]:.3f} %."
    )
    return (
        f"A larger weight takes bias away and adds variance: {text}"
        if traded
        else text.capitalize()
    )


def _maximum_likelihood(result: DemoResult) -> str:
    least = result.bound_percent
    ratios = {name: result.rms(name) / least for name in result.estimators}
    own = ratios.pop("ml")
    text = (
        f"No unbiased estimate can do better than the Cramer-Rao bound: the rms errors of ml are "
        f"{own.min():.2f} to {own.max():.2f} times that"
    )
    if not ratios:
        return f"{text}."
    others = np.concatenate(list(ratios.values()))
    return f"{text}, those of the others {others.min():.1f} to {others.max():.1f} times."


def _draws(result: DemoResult) -> list[str]:
    ranks = [
        float((np.abs(result.errors(name)[:, result.names.index(row.base)]) < printed).mean())
        for name in result.estimators
        for row in TABLE
        if (printed := printed_error(row, name)) is not None
    ]
    if not ranks:
        return []
    return [
        f"The {len(ranks)} errors that the paper prints are single draws; they lie between "
        f"percentiles {100 * min(ranks):.0f} and {100 * max(ranks):.0f} of the errors here."
    ]


def _deviations(result: DemoResult) -> list[str]:
    honest = [name for name in result.estimators if name != "ls"]
    ratios = np.concatenate([result.scatter_over_stated(name) for name in honest])
    if not honest or not np.isfinite(ratios).all():
        return []
    return [
        f"The scatter of {_listed(honest)} is {ratios.min():.2f} to {ratios.max():.2f} times the "
        "standard deviation that each estimate states."
    ]


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
