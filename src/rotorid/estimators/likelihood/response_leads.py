"""Mistakes of frequency responses: which derivative was measured, and how phases count."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.leads import Lead
from rotorid.estimators.likelihood.modal import pencil_at
from rotorid.estimators.likelihood.unknowns import Layout, linear_form
from rotorid.lines import SilentClock
from rotorid.models.modal import eigenmodes
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats
from rotorid.signals.covariance import lag_one_correlation

KINDS = ("positions", "velocities", "accelerations")
GROWS = 3.0
"""Deviations by which a damping is below zero before it counts: no free machine that grows has a
steady response, and a damping of zero is estimated as often below as above."""
ALIKE = 0.2
"""Correlation of the residuals of neighbouring lines from which they are not independent: those of
a Hann window have .44, independent ones .1 at most where there are a hundred."""
LEAST = 50
"""Lines below which chance makes neighbours as alike."""
NONE = 1e-9
"""Damping ratio below which a growth is rounding: of a model without damping."""


def is_response(record: Observation) -> bool:
    """Tell whether a record holds frequency responses."""
    return isinstance(record.lines.clock, SilentClock)


def response_leads(records: Sequence[Observation]) -> Iterator[Lead]:
    """Yield what may be mistaken in the frequency responses among some records."""
    orders = {s.order for r in records if is_response(r) for s in r.sensors}
    for order in range(len(KINDS)) if len(orders) == 1 else ():
        (said,) = orders
        if order != said:
            yield Lead(
                "derivative",
                f"responses of {KINDS[order]}, where {KINDS[said]} are said to be read",
                f'write reads = "x{chr(39) * order}" in channels of names of their own',
                _Shifted(said - order),
                float(order),
            )
    if orders:
        yield Lead(
            "lag",
            "phases that count the other way, lag for lead",
            "set lag = true in the channels, or take it out where it stands",
            _conjugated,
        )
        yield Lead(
            "sign[force]",
            "all responses upside down, as where the force sensor or the shaker is turned about",
            "set scale = -1 in each channel of the responses, or turn the force sensor",
            _Shifted(0, -1.0),
        )


class _Shifted:
    """Integrates or differentiates what sensors of responses read, or turns it about."""

    def __init__(self, order: int, sign: float = 1.0) -> None:
        self.order, self.sign = order, sign

    def __call__(self, records: Sequence[Observation]) -> list[Observation]:
        """Return the records with their sensors' lines times ``sign (i omega)^order``."""
        return [self._one(record) if is_response(record) else record for record in records]

    def _one(self, record: Observation) -> Observation:
        factor = np.ones(record.lines.mean.shape, dtype=np.complex128)
        columns = [sensor.column for sensor in record.sensors]
        factor[:, columns] = self.sign * (1j * record.lines.omega[:, None]) ** self.order
        return _times(record, factor)


def _times(record: Observation, factor: Complexes) -> Observation:
    covariance = record.lines.covariance
    matrices = covariance.matrices * factor[:, :, None] * factor[:, None, :].conj()
    lines = replace(
        record.lines,
        mean=record.lines.mean * factor,
        covariance=replace(covariance, matrices=matrices),
    )
    return record.with_lines(lines)


def _conjugated(records: Sequence[Observation]) -> list[Observation]:
    """Return the records with the phases of their responses turned about."""
    return [
        r.with_lines(replace(r.lines, mean=r.lines.mean.conj())) if is_response(r) else r
        for r in records
    ]


def growing_mode(
    layout: Layout, unknowns: Floats, covariance: Floats, records: Sequence[Observation]
) -> str | None:
    """Say that a machine whose responses were measured grows by itself: it would have none.

    `covariance` is that of all unknowns.
    """
    linear = linear_form(layout.model)
    if linear.rows != linear.coordinates:
        return None
    for number, record in enumerate(records):
        if not is_response(record):
            continue
        pencil = pencil_at(layout.of_record(number), float(record.lines.speed[0]))
        stiffness, damping, mass = pencil.matrices(unknowns)
        modes = eigenmodes(mass, damping, stiffness)
        for value, left, right in zip(modes.values, modes.left, modes.right, strict=True):
            gram = left.conj() @ (2 * value * mass + damping) @ right
            slope = pencil.slopes(value, left[None], right[None], unknowns)[0, 0] / gram
            std = float(np.sqrt(max(float(slope.real @ covariance @ slope.real), 0.0)))
            if value.real > max(GROWS * std, NONE * abs(value)):
                return (
                    f"a mode at {value.imag / (2 * np.pi):.4g} Hz with a damping ratio of "
                    f"{-value.real / abs(value):.3g}: a machine that grows by itself has no "
                    "frequency response, so the phases count the other way (set lag = true in "
                    "the channels), or a response has the wrong sign"
                )
    return None


def lines_alike(record: Observation, at: Evaluation) -> str | None:
    """Say that neighbouring lines of responses hold the same noise, as a window makes them."""
    if not is_response(record) or len(at.whitened) < LEAST:
        return None
    correlation = lag_one_correlation(at.whitened[:, :, None])
    if correlation < ALIKE:
        return None
    names = ", ".join(sensor.channel.name for sensor in record.sensors)
    return (
        f"the residuals of neighbouring lines of {names} are alike (correlation "
        f"{correlation:.2f}), as a window such as Hann makes them: the deviations are too small by "
        f"a factor of about {np.sqrt(1 + 2 * correlation):.2g}; keep every second line (every = 2)"
    )
