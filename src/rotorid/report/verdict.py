"""What an estimate comes to, in one sentence, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rotorid.estimate import Estimate
from rotorid.estimate_parts import DOUBTFUL, EXPLAINS
from rotorid.frozen import frozen

OPEN, CURE = "not identifiable: ", "cure: "  # how warnings begin that an estimate states
AS_NOISE = 1.5
"""Difference over noise, root mean square, up to which a channel is predicted as well as noise
allows: with tens of lines chance makes 1.3 of it."""
TOLD = 0.5
"""Relative error from which on it is not told: a prediction from noisy forces beside a resonance
says nothing of the fit, which the misfit does."""
METHODS = {
    "ml": "maximum likelihood",
    "batch": "batch least squares",
    "sequential": "sequential least squares",
    "ls": "least squares",
}


@frozen
class Verdict:
    """A sentence, steps to take (what to do, or what to mind), and what is left open."""

    sentence: str
    steps: tuple[str, ...] = ()
    left_open: tuple[str, ...] = ()


def verdict_of(estimate: Estimate) -> Verdict:
    """Return what an estimate comes to."""
    warnings = tuple(estimate.warnings)
    if estimate.status == "ok":
        return Verdict(_accepted(estimate), warnings)
    if estimate.status == "rejected":
        return Verdict(_rejected(estimate), warnings)
    if estimate.status == "not_identifiable":
        return _open(estimate)
    told = "Not converged: the search did not arrive at an answer, and the values are none."
    return Verdict(told, warnings)


def _accepted(estimate: Estimate) -> str:
    """Say what the parameters explain, and how well against the noise."""
    free = sum(not value.fixed for value in estimate.parameters)
    few = "this parameter explains" if free == 1 else f"these {free} parameters explain"
    text = f"Accepted: {few} {_explained(estimate) or 'the records'}"
    return f"{text}{_against_noise(estimate)}."


def _explained(estimate: Estimate) -> str:
    """Return which channels are predicted, and how closely."""
    errors = [p.relative_error for p in estimate.prediction.values() if p is not None]
    if not errors:
        return f"{len(estimate.modes)} natural frequencies" if estimate.modes else ""
    worst = max(errors)
    names = [name for name, p in estimate.prediction.items() if p is not None]
    count = f"{len(errors)} {_kind(estimate, names)}" if len(errors) > 1 else names[0]
    return f"{count} to {100 * worst:.2g} %" if worst < TOLD else count


def _kind(estimate: Estimate, names: list[str]) -> str:
    """Return what channels are, by their units."""
    records = estimate.evidence.records if estimate.evidence else ()
    units = {c.unit for record in records for c in record.channels if c.name in names}
    kinds = {"N": "forces", "m": "positions", "A": "currents"}
    return kinds.get(units.pop(), "channels") if len(units) == 1 else "channels"


def _against_noise(estimate: Estimate) -> str:
    """Return how the misfit compares with noise, as far as anything tells."""
    if estimate.misfit is not None:
        p = estimate.misfit.p_value
        if p >= DOUBTFUL:
            return ", as well as the noise allows"
        return f", though not as well as the noise allows (chance {p:.1g}): read what follows"
    ratios = [ratio for _, _, ratio in channel_ratios(estimate) if np.isfinite(ratio)]
    if not ratios:
        return "; nothing tells how much of the rest is noise"
    worst = max(ratios)
    if worst <= AS_NOISE:
        return ", as well as the noise allows"
    return f"; the rest is up to {worst:.2g} times what noise makes"


def channel_ratios(estimate: Estimate) -> Iterator[tuple[int, str, float]]:
    """Yield record, channel, and its difference over its noise, root mean square; NaN if unknown.

    Both are taken over all lines before they are compared.
    """
    for number, record in enumerate(estimate.evidence.records if estimate.evidence else ()):
        for channel in record.channels:
            if channel.difference:
                noise = float(np.mean(np.square(channel.noise))) if channel.noise else 0.0
                wrong = float(np.mean(np.square(channel.difference)))
                yield number, channel.name, (wrong / noise) ** 0.5 if noise > 0 else np.nan


def _rejected(estimate: Estimate) -> str:
    """Say what stands out."""
    text = "Rejected: the values below do not explain the records"
    if estimate.misfit is not None and estimate.misfit.expected > 0:
        times = estimate.misfit.cost / estimate.misfit.expected
        if times > 1:
            text += f", whose misfit is {times:.3g} times what noise leaves"
    if not estimate.suspects:
        return f"{text}. Nothing that was tried explains it alone."
    first = estimate.suspects[0]
    if first.share is not None and first.share < EXPLAINS:
        return f"{text}. Nothing that was tried explains a fifth of it alone."
    share = "" if first.share is None else f", which would explain {100 * first.share:.0f} % of it"
    freed = ""
    if first.value is not None:
        unit = "" if first.unit in ("", "1") else f" {first.unit}"
        freed = f" (freed it comes to {first.value:.4g}{unit})"
    return f"{text}. What stands out: {first.term}{share}{freed}."


def _open(estimate: Estimate) -> Verdict:
    """Say which combinations the records leave open, and what would determine them."""
    left = [w.removeprefix(OPEN) for w in estimate.warnings if w.startswith(OPEN)]
    cures = [w.removeprefix(CURE) for w in estimate.warnings if w.startswith(CURE)]
    others = [w for w in estimate.warnings if not w.startswith((OPEN, CURE))]
    told = "the records do not determine every parameter"
    if len(left) > 2:
        told = f"{left[0]}, and {len(left) - 1} more combinations"
    elif left:
        told = "; ".join(left)
    elif estimate.alternatives:
        count = len(estimate.alternatives)
        told = f"{count + 1} answers fit as well as one another"
    every = tuple(left) if len(left) > 2 else ()
    return Verdict(f"Not identifiable: {told}.", (*cures, *others), every)
