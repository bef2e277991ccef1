"""The columns of a table, as an experiment file names them: numbers in SI, one in each row."""

from __future__ import annotations

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.units import si_factor, to_si
from rotorid.core.values import Complexes, Floats
from rotorid.experiment.schema import ChannelEntry
from rotorid.io.record import check_magnitude, check_stated, largest_of
from rotorid.io.table import Table


@frozen
class Columns:
    """The columns of a table, in SI."""

    table: Table
    overrule: bool

    def si(self, column: str, unit: str | None, expected: str, place: str) -> Floats:
        """Return a column in the unit that is expected."""
        found = self.table.read([self._key(column, place)]).popitem()[1]
        declared = unit or found.unit
        if declared is None:
            raise InputError(
                "no unit", f"a unit that converts to {expected}", "write it", place=place
            )
        factor = si_factor(declared, expected, place=f"{place}.unit")
        if unit and found.unit and not self.overrule:
            check_stated(unit, found.unit, f"{place}.unit")
        wrong = ~np.isfinite(found.values)
        if wrong.any():
            raise InputError(
                f"{found.values[wrong][0]} in row {int(wrong.argmax()) + 1} of {column!r}",
                "a number in every row",
                "fill it in, or delete the row",
                place=place,
            )
        check_magnitude(largest_of(found.values), factor, place)
        return np.asarray(found.values * factor)

    def has(self, column: str) -> bool:
        """Tell whether there is a column of that name."""
        try:
            self.table.find(column)
        except InputError:
            return False
        return True

    def _key(self, column: str, place: str) -> str:
        try:
            return self.table.find(column)
        except InputError as error:
            raise error.at(place=place) from None


def complex_column(rows: Columns, name: str, entry: ChannelEntry, expected: str) -> Complexes:
    """Return X of a channel in a unit: what the instrument states, as Re(X exp(i phi)) has it."""
    place = f"channels.{name}"
    if entry.polar:
        size = rows.si(entry.amplitude or "", entry.unit, expected, f"{place}.amplitude")
        turned = rows.si(entry.phase or "", entry.phase_unit, "rad", f"{place}.phase")
        if (size < 0).any():
            raise InputError(
                f"the amplitude {size.min():g} in row {int(size.argmin()) + 1}",
                "0 or more",
                "turn its phase by 180 deg, or give a signed reading as real",
                place=f"{place}.amplitude",
            )
        check_lengths(size, turned, place)
        found = size * np.exp(1j * turned)
    else:
        real = rows.si(entry.real or "", entry.unit, expected, f"{place}.real")
        imag = rows.si(entry.imag or "", entry.unit, expected, f"{place}.imag")
        check_lengths(real, imag, place)
        found = real + 1j * imag
    found = found.conj() if entry.lag else found
    return np.asarray(_factor(rows, entry, place) * found)


def _factor(rows: Columns, entry: ChannelEntry, place: str) -> float:
    """Return what amplitudes as they stand are multiplied by."""
    scale = 1.0 if entry.scale is None else entry.scale
    if isinstance(scale, str):
        try:
            scale = rows.table.scalar(scale)
        except InputError as error:
            raise error.at(place=f"{place}.scale") from None
    return float(scale) / 2 if entry.peak_to_peak else float(scale)


def std_column(rows: Columns, name: str, entry: ChannelEntry, expected: str) -> Floats | None:
    """Return the deviation of the amplitude in a unit, a column or one for all rows."""
    if entry.std is None:
        return None
    place = f"channels.{name}.std"
    if rows.has(entry.std):
        found = rows.si(entry.std, entry.unit, expected, place)
    else:
        found = np.array([to_si(entry.std, expected, place=place)])
    if not (found > 0).all():
        raise InputError(
            f"{found.min():g} in row {int(found.argmin()) + 1}" if len(found) > 1 else entry.std,
            "a deviation of more than 0",
            "state how far the amplitude scatters: the last digit of the instrument at least",
            place=place,
        )
    return np.asarray(abs(_factor(rows, entry, f"channels.{name}")) * found)


def check_lengths(one: Floats, other: Floats | Complexes, place: str) -> None:
    """Refuse columns of different lengths."""
    if len(one) != len(other):
        raise InputError(
            f"{len(one)} and {len(other)} rows", "columns of one length", "cut them", place=place
        )
