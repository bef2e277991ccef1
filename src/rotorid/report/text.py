"""How well an estimate predicts, as a table for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rotorid.estimate import Prediction
from rotorid.estimators.information import Information
from rotorid.tables import Table, table


def prediction_table(errors: Iterable[Mapping[str, Prediction | None]]) -> Table:
    """Return the relative error of each predicted channel, one column per record."""
    records = list(errors)
    headings = [f"record {i + 1}" for i in range(len(records))] if len(records) > 1 else ["error"]
    names = dict.fromkeys(name for record in records for name in record)
    rows = [(name, *(_error(record.get(name)) for record in records)) for name in names]
    return table(("relative", *headings), rows)


def information_lines(records: Iterable[Information | None]) -> list[str]:
    """Return the condition number of the regressor of each record, as it is quoted for robots."""
    return [
        f"condition number of the regressor: {told.scaled_condition_number:.4g} with its "
        f"columns scaled, {told.condition_number:.4g} in SI units as it is"
        for told in records
        if told is not None
    ]


def _error(prediction: Prediction | None) -> str:
    return "zero" if prediction is None else f"{100 * prediction.relative_error:.3g} %"
