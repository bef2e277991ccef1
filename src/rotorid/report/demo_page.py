"""The paper's table beside that of the demonstration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.demo import DemoResult, findings
from rotorid.demo.paper import COLUMNS, TABLE, PaperRow, printed_error
from rotorid.tables import Page, Table, table

FIRST = ("ml",)
"""Estimators whose columns come first, beside the bound."""


def demo_page(result: DemoResult) -> Page:
    """Return the errors of all records here, then the paper's table beside them."""
    records = f"{result.runs} records" if result.runs > 1 else "one record"
    return [
        verdict_of(result),
        "",
        f"Error in %, root mean square of {records}; first the least that the data allow,",
        "the Cramer-Rao bound",
        sizes(result),
        "Table 1, |error| in %: of one run, as the paper prints it;",
        f"and beside it the median of {records} here",
        beside_the_paper(result),
        f"The paper lists the unbalance times Omega^2: {as_printed()}",
        "",
        f"Mean error of {records} in %, the bias",
        means(result),
        *findings(result),
    ]


def verdict_of(result: DemoResult) -> str:
    """Say how near to the least possible error each kind of method comes."""
    over = {name: result.rms(name) / result.bound_percent for name in result.estimators}
    others = np.concatenate([ratio for name, ratio in over.items() if name not in FIRST])
    best = np.concatenate([ratio for name, ratio in over.items() if name in FIRST])
    return (
        f"Maximum likelihood finds the {len(result.names)} base parameters with {best.min():.2f} "
        f"to {best.max():.2f} times the least error that the data allow, the paper's methods with "
        f"{others.min():.2g} to {others.max():.2g} times."
    )


def ordered(result: DemoResult) -> list[str]:
    """Return the estimators, those first that matter most."""
    return sorted(result.estimators, key=lambda name: name not in FIRST)


def sizes(result: DemoResult) -> Table:
    """Return the rms error of every estimator, the bound and maximum likelihood first."""
    names = ordered(result)
    rows = [
        (row.base, f"{result.bound_percent[i]:.3f}", *(f"{result.rms(n)[i]:.3f}" for n in names))
        for row, i in _numbered(result)
    ]
    return table(("parameter", "bound", *names), rows)


def beside_the_paper(result: DemoResult) -> Table:
    """Return the errors that the paper prints, each with the median here; and the truth."""
    names = [name for name in result.estimators if name in COLUMNS]
    rows = []
    for row, i in _numbered(result):
        printed = [printed_error(row, name) for name in names]
        pairs = [
            (f"{error:.3f}", f"{result.median(name)[i]:.3f}")
            for name, error in zip(names, printed, strict=True)
            if error is not None
        ]
        flat = [text for pair in pairs for text in pair]
        rows.append((row.base, f"{result.truth[i]:.5g}", result.units[i], *flat))
    headings = [text for name in names for text in (name, "here")]
    return table(("parameter", "true", "unit", *headings), rows)


def means(result: DemoResult) -> Table:
    """Return the mean error of every estimator."""
    names = ordered(result)
    rows = [
        (row.base, *(f"{result.bias(name)[i]:+.3f}" for name in names))
        for row, i in _numbered(result)
    ]
    return table(("parameter", *names), rows)


def as_printed() -> str:
    """Return what the paper prints of the unbalance, with its units."""
    rows = [row for row in TABLE if row.speed_power]
    return ", ".join(f"{row.quantity} = {row.true:.5g} {row.unit}" for row in rows)


def _numbered(result: DemoResult) -> Sequence[tuple[PaperRow, int]]:
    return [(row, result.names.index(row.base)) for row in TABLE]
