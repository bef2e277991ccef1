"""The values of an estimate beside what was known beforehand."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

from rotorid.estimate import Estimate
from rotorid.estimate_page import FAR, HALF_WIDTH, ROUNDING, as_zero
from rotorid.estimate_parts import Value
from rotorid.evidence import Prior
from rotorid.frozen import frozen

WIDTH = 140  # of a row's bars, in pixels
PLAIN = (1e-3, 1e7)
"""Sizes between which a number is written without an exponent."""
_MARGIN = 4
PM = "\N{PLUS-MINUS SIGN}"


@frozen
class Bar:
    """Two intervals on one scale: their ends in pixels, and in words."""

    before: tuple[float, float]
    after: tuple[float, float]
    told: str


@frozen
class Row:
    """A quantity as the page shows it."""

    name: str
    value: str
    half: str
    percent: str
    unit: str
    before: str
    moved: str
    bar: Bar | None


@frozen
class Group:
    """Rows that belong together, under a title."""

    rows: tuple[Row, ...]
    title: str = ""


def groups(estimate: Estimate) -> list[Group]:
    """Return parameters, constants of the measurement, and what follows from them."""
    names = {value.name for value in estimate.parameters}
    derived = [value for value in estimate.derived if value.name not in names]
    free = [value for value in estimate.parameters if not value.fixed]
    parts: Iterable[tuple[str, Sequence[Value]]] = (
        ("", free),
        ("of the measurement", estimate.nuisance),
        ("what follows from them", derived),
    )
    known = estimate.evidence
    return [
        Group(tuple(_row(v, known.prior(v.name) if known else None) for v in part), title)
        for title, part in parts
        if part
    ]


def any_known(estimate: Estimate) -> bool:
    """Tell whether anything that was estimated was known beforehand."""
    known = estimate.evidence
    return known is not None and any(known.prior(value.name) for value in estimate.free)


def fixed(estimate: Estimate) -> list[str]:
    """Return what was held, in words."""
    return [f"{v.name} = {v.value:.6g}{_unit(v.unit)}" for v in estimate.parameters if v.fixed]


def relations(estimate: Estimate) -> list[str]:
    """Return what was known of combinations, in words."""
    every = (*estimate.parameters, *estimate.nuisance)
    named = {value.name for value in every}
    known = estimate.evidence.known if estimate.evidence else ()
    return [
        f"{prior.name} = {prior.value:.6g}{_spread(prior)}{_unit(_unit_of(prior.name, every))}"
        for prior in known
        if prior.name not in named
    ]


def _unit_of(expression: str, every: Sequence[Value]) -> str:
    """Return the unit of a sum of values that have one unit; nothing for anything else."""
    units = {value.name: value.unit for value in every}
    found = {units.get(term.strip()) for term in re.split(r"[+-]", expression)}
    return (found.pop() or "") if len(found) == 1 else ""


def _spread(prior: Prior) -> str:
    return f" {PM} {HALF_WIDTH * prior.std:.2g}" if prior.std else " exactly"


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def _row(value: Value, prior: Prior | None) -> Row:
    half = HALF_WIDTH * value.std if value.std else math.nan
    number = figures(as_zero(value.value, value.std or 0.0), half)
    if not math.isfinite(value.value):
        number = "not determined"
    far = half > FAR * HALF_WIDTH * abs(value.value)  # a percentage of what may as well be zero
    percent = math.nan if far else 100 * half / abs(value.value) if value.value else math.nan
    return Row(
        value.name,
        number,
        two_digits(half),
        two_digits(percent),
        "" if value.unit == "1" else value.unit,
        "" if prior is None else _before(prior),
        "" if prior is None else _moved(value, prior),
        None if prior is None else _bar(value, prior),
    )


def _before(prior: Prior) -> str:
    half = HALF_WIDTH * prior.std
    if not half > 0:
        return f"{prior.value:.6g} exactly"
    return f"{figures(prior.value, half)} {PM} {two_digits(half)}"


def _moved(value: Value, prior: Prior) -> str:
    """Return how far the value is from what was known, in deviations of that."""
    if not prior.std > 0 or not math.isfinite(value.value):
        return ""
    moved = (value.value - prior.value) / prior.std
    if abs(moved) < ROUNDING:
        return "0 std"
    return f"{moved:+.2g} std".replace("-", "\N{MINUS SIGN}")


def _bar(value: Value, prior: Prior) -> Bar | None:
    """Return what was known and what is known now, on a scale that holds both."""
    half = HALF_WIDTH * (value.std or 0.0)
    ends = [
        (prior.value - HALF_WIDTH * prior.std, prior.value + HALF_WIDTH * prior.std),
        (value.value - half, value.value + half),
    ]
    low, high = min(a for a, _ in ends), max(b for _, b in ends)
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return None
    scale = (WIDTH - 2 * _MARGIN) / (high - low)

    def pixels(pair: tuple[float, float]) -> tuple[float, float]:
        first, last = (_MARGIN + scale * (x - low) for x in pair)
        if last - first < 1:  # to be seen
            first, last = (first + last) / 2 - 0.5, (first + last) / 2 + 0.5
        return round(first, 1), round(last, 1)

    now = f"{figures(value.value, half)} {PM} {two_digits(half)}"
    told = f"before {_before(prior)}, now {now}"
    return Bar(pixels(ends[0]), pixels(ends[1]), told)


def figures(value: float, half: float) -> str:
    """Return a number with as many digits as its half-width leaves."""
    if not math.isfinite(value):
        return ""
    if value == 0 or not (math.isfinite(half) and half > 0):
        return f"{value:.6g}"
    places = 1 - math.floor(math.log10(half))
    if PLAIN[0] <= abs(value) < PLAIN[1] and -3 <= places <= 9:
        return f"{round(value, places):.{max(places, 0)}f}"
    digits = math.floor(math.log10(abs(value))) + places + 1
    return f"{value:#.{min(max(digits, 2), 12)}g}".rstrip(".")


def two_digits(number: float) -> str:
    """Return a number with two digits; nothing for none."""
    if not math.isfinite(number):
        return ""
    if 10 <= abs(number) < PLAIN[1]:
        return f"{float(f'{number:.2g}'):.0f}"
    return f"{number:#.2g}".rstrip(".")
