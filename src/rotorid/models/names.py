"""Names and parameters that a file declares: of equations and of drawings alike."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from pydantic import Field

from rotorid.core.errors import ModelError
from rotorid.core.toml import Schema
from rotorid.core.units import check_unit, si_factor
from rotorid.models.model import Parameter
from rotorid.models.text import FUNCTIONS, RESERVED

MAX_NAMES = 500
_NAME = re.compile(r"[^\W\d]\w{0,63}")


class DeclaredParameter(Schema):
    """A parameter as a file declares it."""

    unit: str
    nominal: float | None = Field(None, allow_inf_nan=False)
    positive: bool = False

    def parameter(self, name: str) -> Parameter:
        """Return the parameter, in SI."""
        place = f"parameters.{name}.unit"
        unit = check_unit(self.unit, place=place)
        factor = si_factor(self.unit, place=place)
        nominal = None if self.nominal is None else self.nominal * factor
        if self.positive and nominal is not None and nominal <= 0:
            raise ModelError(
                f"{self.nominal}",
                "a positive number, since positive = true",
                "give a nominal above 0, or leave out positive",
                place=f"parameters.{name}.nominal",
            )
        return Parameter(name, unit, nominal, self.positive)


def check_names(tables: Mapping[str, Iterable[str]]) -> None:
    """Refuse names that are reserved, declared twice, or no names; by the table they stand in."""
    taken = {*RESERVED, "pi", *FUNCTIONS}
    for table, members in tables.items():
        for name in members:
            if not _NAME.fullmatch(name):
                raise ModelError(
                    f"the name {name[:60]!r}",
                    "a letter, then letters, digits and _, 64 in all at most",
                    "rename it",
                    place=table,
                )
            if name in taken:
                raise ModelError(
                    f"the name {name!r} again",
                    "a name used once and not reserved "
                    f"({', '.join([*RESERVED, 'pi', *FUNCTIONS])})",
                    "rename it",
                    place=table,
                )
            taken.add(name)
