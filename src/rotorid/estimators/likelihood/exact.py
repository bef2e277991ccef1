"""What is taken as exact though nobody said so, and how far a plausible error of it may move what.

Runout, the rotor angle, gains and delays of channels: what is not asked for is known exactly, and
deviations leave it out. An error v of it, in units of a plausible size, moves the parameters by
M v deviations and leaves L v in the residual. Unseen is what adds less to the cost than the warning
of a doubtful model needs, |L v|^2 < s. Of all v with |v|^2 + |L v|^2 / s <= 1 the worst moves
parameter i by the root of M_i (I + L' L / s)^-1 M_i'.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np

from rotorid.estimate_parts import DOUBTFUL
from rotorid.estimators.expectation import Expectation
from rotorid.estimators.likelihood.fit import Fit
from rotorid.estimators.likelihood.inference import along_relations
from rotorid.estimators.likelihood.nuisances import Nuisance
from rotorid.estimators.likelihood.nuisances.delay import Delay
from rotorid.estimators.likelihood.nuisances.gain import Gain
from rotorid.estimators.likelihood.nuisances.phase import Phase
from rotorid.estimators.likelihood.nuisances.runout import Runout
from rotorid.estimators.likelihood.nuisances.scale import Scale
from rotorid.estimators.likelihood.refits import Case
from rotorid.estimators.likelihood.tangent import tangent
from rotorid.frozen import frozen
from rotorid.record import Check, Floats

T = TypeVar("T")
MATTERS = 1.0
"""Deviations by which an unseen error moves a parameter, above which it is told."""
TAKEN_OVER = 1e-6
"""What is left of the scale's column when the parameters have taken their share, over its square,
below which they take it over: exactly so at the corrected lines, but for rounding."""
LED = 0.9
"""Correlation with the rotor angle from which on it makes most, four fifths, of a variance."""
FOLLOWS = 0.5
"""Relative change of a parameter, over that of the scale, from which it is said to follow."""


@frozen
class Kind:
    """Something that is taken as exact.

    Parameters
    ----------
    check : str
    nuisance : type of Nuisance
    unit : str
        Of the unknowns meant.
    size : float
        What it is plausibly wrong by, in SI.
    text, cure : str
        How it is taken, with the size as one would write it; what answers it.
    """

    check: str
    nuisance: type[Nuisance]
    unit: str
    size: float
    text: str
    cure: str


KINDS = (
    # Of a ground journal; balancing standards allow the probes of a good machine several times it.
    Kind("runout", Runout, "m", 1e-6, "taken as 0: 1 um of it", "runout = true estimates it"),
    # A mark is glued on, and a filter of 9 kHz turns 9000 rpm by as much.
    Kind(
        "rotor angle",
        Phase,
        "rad",
        np.pi / 180,
        "taken as exact: 1 deg of it",
        "directions count from the angle as given",
    ),
    # What calibrating by hand reaches.
    Kind(
        "gain", Gain, "1", 0.01, "taken as exact: 1 % of it", "gain_std says how well it is known"
    ),
    # A tenth of the sample time of many loggers, and the lag of a filter of 16 kHz.
    Kind(
        "delay",
        Delay,
        "s",
        10e-6,
        "taken as exact: 10 us of it",
        'delay = { std = ".." } says how well it is known',
    ),
)


def exactness(fit: Fit) -> list[Check]:
    """Say what is taken as exact, where a plausible error of it is beyond deviations and unseen."""
    every = [(kind, tuple(kind.nuisance.every(fit.records))) for kind in KINDS]
    point, added = fit.solution.point, [n for _, nuisances in every for n in nuisances]
    wide = Case(fit.prepared, fit.records, point).with_unknowns([Scale.of(None), *added])
    columns = wide.point.jacobian[:, len(fit.prepared.layout.free) :]
    told = _scale_note(fit, columns[:, 0])
    effects, first = [], 1
    for kind, nuisances in every:
        unknowns = [u for n in nuisances for u in n.unknowns]
        meant = [first + k for k, u in enumerate(unknowns) if u.unit == kind.unit]
        effect, first = columns[:, meant] * kind.size, first + len(unknowns)
        apart = told and kind.nuisance is Gain
        effects.append((kind, _differences(fit, effect, nuisances) if apart else effect))
    notes = [_note(fit, kind, moved) for kind, moved in moves_unseen(fit, effects)]
    return [*told, *_angle_note(fit), *(note for note in notes if note is not None)]


def _angle_note(fit: Fit) -> list[Check]:
    """Say where the stated uncertainty of the rotor angle is most of that of a parameter.

    Who gave a keyphasor has asked for no unknown, and looks for where these deviations come from.
    """
    layout, covariance = fit.prepared.layout, fit.inference.covariance
    unknowns = [layout.unknowns[i] for i in layout.free]
    asked = {n.unknowns[0].name for n in layout.nuisances if isinstance(n, Phase)}
    std = np.sqrt(np.diag(covariance).clip(0))
    unit = np.where((std > 0) & np.isfinite(std), std, np.inf)
    share = np.abs(covariance / unit / unit[:, None])
    turned = [k for k, u in enumerate(unknowns) if u.name in asked and u.std]
    led = [
        unknowns[j].name
        for j, i in enumerate(layout.free)
        if i < layout.named and turned and share[j, turned].max() > LED
    ]
    if not led:
        return []
    worst = np.degrees(max(unknowns[k].std or 0.0 for k in turned))
    text = (
        f"known to {worst:.2g} deg, which is most of the deviations of {', '.join(led)}: nobody "
        "knows how much later than the mark the columns are, so within a sample, unless "
        "angle_lag_std says it better"
    )
    return [Check("rotor angle", "", text, "note")]


def _differences(fit: Fit, effect: Floats, gains: Sequence[Nuisance]) -> Floats:
    """Return what gains do beside a scale common to all inputs, or to all sensors."""
    inputs, effect = {c.name for record in fit.records for c in record.inputs}, effect.copy()
    driven = np.array([bool(inputs & gain.channels) for gain in gains if isinstance(gain, Gain)])
    for group in (driven, ~driven):
        effect[:, group] -= effect[:, group].mean(axis=1, keepdims=True)
    return effect


def _scale_note(fit: Fit, column: Floats) -> list[Check]:
    """Say where a scale that is taken as exact is in masses and stiffnesses, and in no misfit.

    A rotor with all masses, stiffnesses and dampings one per cent larger moves as before under
    forces one per cent larger. column, shape (row,), is the derivative of the residual by the
    scale.
    """
    channels = [c for record in fit.records for c in record.inputs]
    read = [c.name for c in channels if c.law is not None or c.drive is not None]
    layout = fit.prepared.layout
    if not read or any(isinstance(n, Scale) for n in layout.nuisances):
        return []
    where = tangent(fit.solution.point, fit.problem.exact)  # what is weighed exactly stays
    directions = np.diag(where.scale) if where.basis is None else where.scale[:, None] * where.basis
    rest = fit.solution.point.jacobian @ directions
    size = np.sqrt((rest**2).sum(axis=0))
    unit = np.where(size > 0, size, 1.0)
    found = np.linalg.lstsq(rest / unit, column, rcond=1e-10)[0]
    left = column - rest / unit @ found
    if not np.isfinite(found).all() or left @ left > TAKEN_OVER * (column @ column):
        return []
    value = np.array([fit.solution.point.unknowns[i] for i in layout.free])
    share = np.abs(directions @ (found / unit)) / np.where(value != 0, np.abs(value), np.inf)
    names = [
        layout.unknowns[i].name
        for i, s in zip(layout.free, share, strict=True)
        if i < layout.named and s > FOLLOWS
    ]
    if not names:
        return []
    text = (
        f"taken as exact: 1 % of it is 1 % of {', '.join(names)}, beyond their deviations, and no "
        "misfit shows it; say how well it is known (force_scale_std), or weigh the rotor"
    )
    return [Check("force scale", ", ".join(dict.fromkeys(read)), text, "note")]


def unseen_excess(expected: Expectation) -> float:
    """Return what may be added to the expected cost before a warning tells."""
    if expected.dof <= 0 or expected.mean <= 0:
        return np.inf
    low, high = 0.0, expected.mean
    while expected.p_value(expected.mean + high) > DOUBTFUL:
        low, high = high, 2 * high
        if high > 1e12 * expected.mean:
            return np.inf
    for _ in range(30):
        middle = (low + high) / 2
        seen = expected.p_value(expected.mean + middle) < DOUBTFUL
        low, high = (low, middle) if seen else (middle, high)
    return high


def _note(fit: Fit, kind: Kind, moved: Floats) -> Check | None:
    """Return the note of a kind, from the deviations by which it may move each free unknown."""
    layout = fit.prepared.layout
    if not moved.max(initial=0.0) > MATTERS:
        return None
    worst = int(np.argmax(moved))
    name = layout.unknowns[layout.free[worst]].name
    size = f"{moved[worst]:.2g}" if moved[worst] < 99.5 else f"{moved[worst]:.0f}"
    text = f"{kind.text} may move {name} by {size} deviations unseen; {kind.cure}"
    return Check(kind.check, "", text, "note")


def moves_unseen(fit: Fit, effects: Sequence[tuple[T, Floats]]) -> Iterator[tuple[T, Floats]]:
    """Yield each kind with the deviations by which it may move each free unknown, unseen.

    effects hold what errors of the size of a kind do to the residual, shape (row, error).
    """
    layout, point = fit.prepared.layout, fit.solution.point
    along, scale, basis = along_relations(point, fit.problem.exact)
    orthogonal, triangle = np.linalg.qr(along)
    std = np.sqrt(np.diag(fit.inference.covariance).clip(0))
    named = np.array([i < layout.named and i not in layout.idle for i in layout.free], dtype=bool)
    unit = np.where(named & (std > 0), std, np.inf)
    unseen = unseen_excess(fit.inference.expectation)
    for kind, effect in effects:
        if not effect.any():
            continue
        taken = orthogonal.T @ effect
        left = effect - orthogonal @ taken
        moved = (scale / unit)[:, None] * (basis @ np.linalg.lstsq(triangle, taken, rcond=None)[0])
        _, sizes, ways = np.linalg.svd(np.linalg.qr(left, mode="r"))
        weight = np.ones(len(ways))
        weight[: len(sizes)] /= np.sqrt(1 + sizes**2 / unseen)
        yield kind, np.asarray(np.sqrt(((moved @ ways.T * weight) ** 2).sum(axis=1)))
