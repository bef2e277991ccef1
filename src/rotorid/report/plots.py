"""What the pictures of an estimate show: inputs or readings, measured and predicted."""

from __future__ import annotations

import numpy as np

from rotorid.estimate import Estimate
from rotorid.filtered import FilteredRecord
from rotorid.models import Model
from rotorid.observation import Measured
from rotorid.plots.pictures import ForceWaves
from rotorid.predict import missing_values, predict_lines
from rotorid.record import PeriodicRecord
from rotorid.signals.spectrum import synthesize


def speaks_of(model: Model, estimate: Estimate, record: Measured, number: int) -> bool:
    """Tell whether an estimate leaves nothing open that a prediction of this record needs."""
    known = all(np.isfinite(v.value) for v in estimate.parameters) and record.phase_known
    return known and not missing_values(model, estimate, number, record.parameters)


def force_waves(
    model: Model, estimate: Estimate, record: PeriodicRecord | FilteredRecord, number: int = 0
) -> ForceWaves | None:
    """Return a record's channels as measured and as an estimate predicts them.

    ``None`` where the estimate leaves a parameter open or is of another model, and where the
    phase of the rotor is not known.
    """
    if not speaks_of(model, estimate, record, number):
        return None
    (found,) = predict_lines(model, estimate, [record], number)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(found.size > 0, np.sqrt(found.wrong / found.size), np.nan)
    if isinstance(record, FilteredRecord):
        time = np.arange(len(found.measured)) * record.decimate / record.record.sample_rate
        waves = (found.measured.real, found.predicted.real)
        return ForceWaves(found.names, found.units, time, *waves, error)
    return ForceWaves(
        found.names,
        found.units,
        np.arange(record.samples) / record.sample_rate,
        synthesize(found.measured, record.harmonics, record.samples),
        synthesize(found.predicted, record.harmonics, record.samples),
        error,
    )
