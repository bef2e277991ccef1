"""The paper's table beside that of the demonstration, for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.demo import DemoResult, findings
from rotorid.demo.paper import TABLE, printed_error
from rotorid.tables import Page, table


def demo_page(result: DemoResult) -> Page:
    """Return the paper's Table 1 beside the errors of all records here, and what they show."""
    names = result.estimators
    beside: list[tuple[str, ...]] = []
    spread: list[tuple[str, ...]] = []
    for row in TABLE:
        i = result.names.index(row.base)
        errors = [printed_error(row, name) for name in names]
        printed = ["" if error is None else f"{error:.3f}" for error in errors]
        median = [f"{result.median(name)[i]:.3f}" for name in names]
        rms = [f"{result.rms(name)[i]:.3f}" for name in names]
        bias = [f"{result.bias(name)[i]:+.3f}" for name in names]
        truth = (row.base, result.units[i], f"{result.truth[i]:.5g}")
        beside.append((*truth, *_paired(printed, median)))
        spread.append((row.base, *_paired(rms, bias), f"{result.bound_percent[i]:.3f}"))
    return [
        "Table 1, |error| in %: of one run, as the paper prints it;",
        f"and beside it the median of {result.runs} records here",
        table(("parameter", "unit", "true", *_headings(names, "median")), beside),
        f"The paper lists the unbalance times Omega^2: {_as_printed()}",
        "",
        f"Error in %: root mean square of {result.runs} records; and its mean, the bias;",
        "last the least that the data allow, the Cramer-Rao bound",
        table(("parameter", *_headings(names, "bias"), "bound"), spread),
        " ".join(findings(result)),
    ]


def _as_printed() -> str:
    rows = [row for row in TABLE if row.speed_power]
    return ", ".join(f"{row.quantity} = {row.true:.5g} {row.unit}" for row in rows)


def _paired(first: Sequence[str], second: Sequence[str]) -> tuple[str, ...]:
    return tuple(text for pair in zip(first, second, strict=True) for text in pair)


def _headings(names: Sequence[str], second: str) -> tuple[str, ...]:
    return _paired(names, [second] * len(names))
