"""Bounds that hold with equality where the data reject the model: each may be wrong by itself.

A bound is knowledge like a value with a deviation, and a wrong one explains a misfit as well. The
cost without it is found by minimizing again from the estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.refits import Case
from rotorid.estimators.likelihood.solver import bounds_held
from rotorid.frozen import frozen
from rotorid.record import Floats

CLOSE = 1.5
"""Factor of the limit within which what was set free makes the bound the likeliest mistake: a limit
is guessed or mistyped by less, and a unit is off by 2 or more (but for rms, 1.41, where both are
told)."""


@frozen
class HeldBound:
    """A bound that holds with equality, or several of them.

    Parameters
    ----------
    texts : sequence of str
        As ``k >= 205000``.
    limit : float
        The value of the expression at the bound.
    row : int
        The bound that tells the value of the expression.
    unit : str
        Of a single parameter, else empty.
    """

    texts: tuple[str, ...]
    limit: float
    row: int
    unit: str

    @property
    def term(self) -> str:
        """The name among the suspects."""
        return f"bound {', '.join(self.texts)}"

    def dropped(self, case: Case) -> Case:
        """Return the case without the bound."""
        bounds = case.prepared.bounds
        kept = [i for i, text in enumerate(bounds.texts) if text not in self.texts]
        prepared = replace(case.prepared, bounds=bounds.subset(np.array(kept, dtype=np.int64)))
        return Case(prepared, case.records, case.point)

    def value(self, case: Case, unknowns: Floats) -> float:
        """Return what the expression is at a point."""
        bounds = case.prepared.bounds
        return self.limit + _way(self.texts[0]) * float(bounds.values(unknowns)[self.row])

    def close(self, value: float) -> bool:
        """Tell whether a value is so near to the limit that the bound is the likeliest mistake."""
        return self.limit != 0 and 1 / CLOSE < value / self.limit < CLOSE

    def told(self, value: float) -> tuple[str, str]:
        """Say what it would be without the bound, and what to do about it."""
        listed = ", ".join(self.texts)
        if len(self.texts) > 1:
            return f"the bounds {listed}, which hold with equality", "check these bounds"
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        expression = self.texts[0].rpartition(_RELATION[_way(self.texts[0])])[0]
        said = f"{expression} = {value:.6g}{unit}, which the bound {listed} does not let it be"
        if self.limit == 0:
            return said, (
                "look at the signs of the channels and of the terms; where it may have that sign, "
                "take the bound (positive, min, max) away"
            )
        return said, "check that bound (min, max), or take it away"


_RELATION = {1.0: " >= ", -1.0: " <= "}


def _way(text: str) -> float:
    """Return 1 for a lower bound, -1 for an upper one."""
    return 1.0 if _RELATION[1.0] in text else -1.0


def held_bounds(case: Case) -> list[HeldBound]:
    """Return each bound that holds with equality, and where there are several all together."""
    bounds, layout = case.prepared.bounds, case.prepared.layout
    rows = bounds_held(case.point.problem, case.point.unknowns)
    nothing = np.zeros(len(case.point.unknowns))
    found: dict[str, HeldBound] = {}
    for row in rows:
        text = bounds.texts[row]
        expression = text.rpartition(_RELATION[_way(text)])[0]
        at = layout.index.get(expression)
        unit = "" if at is None else layout.unknowns[at].unit
        limit = -_way(text) * float(bounds.values(nothing)[row])
        found.setdefault(text, HeldBound((text,), limit, row, unit))
    return [*found.values(), *_together(list(found.values()))]


def _together(single: Sequence[HeldBound]) -> list[HeldBound]:
    """Return all bounds as one, where there are several."""
    if len(single) < 2:
        return []
    texts = tuple(text for held in single for text in held.texts)
    return [replace(single[0], texts=texts)]
