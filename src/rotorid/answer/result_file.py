"""Result files read: which of them hold an estimate, and none that somebody edited."""

from __future__ import annotations

from codecs import BOM_UTF8
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from rotorid.answer.estimate import SCHEMA, Estimate, adapter
from rotorid.answer.parts import Suspect
from rotorid.core.errors import ReadError, naming, require_type
from rotorid.core.files import read_regular
from rotorid.core.frozen import frozen
from rotorid.core.notes import VERDICTS, Note
from rotorid.core.toml import fault_in_line

RESULT_BYTES = 32_000_000
"""Of a result file: one of a thousand lines has 1 MB, and reading takes 20 bytes for each."""
RESULT_VALUES, RESULT_OBJECTS = 1_500_000, 300_000
"""Commas and braces of a result file: a covariance of 500 unknowns beside 1e5 lines; each that is
wrong takes half a kilobyte before the first is told."""
READABLE = ("rotorid-estimate/1", SCHEMA)
EDITED = 1e-6  # share by which covariance and deviations of a file differ that was not edited
_TOLD = 10_000  # faults of a file from which on none is picked out: each costs what it holds


def load_estimate(path: str | Path) -> Estimate:
    """Read a result file.

    Parameters
    ----------
    path : str or Path
        A file that `Estimate.save` wrote.

    Returns
    -------
    Estimate

    Raises
    ------
    ReadError
        Where the file cannot be read or is no result file.

    Examples
    --------
    >>> import tempfile
    >>> from rotorid import Value
    >>> path = Path(tempfile.mkdtemp()) / "run.json"
    >>> Estimate("one", "ls", "ok", (Value("m", "kg", 2.0, std=0.01),)).save(path)
    >>> load_estimate(path).value("m")
    2.0
    """
    require_type(path, str, Path, place="path")
    cure = "write one with identify --json"
    with naming(str(path)):
        content = read_regular(path, RESULT_BYTES, "a result file", cure).removeprefix(BOM_UTF8)
        if content.count(b",") > RESULT_VALUES or content.count(b"{") > RESULT_OBJECTS:
            raise ReadError(f"more than {RESULT_VALUES} values", "a result file", cure)
        try:
            head = _Head.model_validate_json(content)
            if head.schema_ not in READABLE:
                expected = " or ".join(map(repr, READABLE))
                raise ReadError(f"schema {head.schema_!r}", expected, cure)
            estimate = adapter().validate_json(content)
        except ValidationError as error:
            if (count := error.error_count()) > _TOLD:
                raise ReadError(f"{count} faults", "a result file", cure) from None
            fault = error.errors(include_url=False)[0]
            if fault["type"] == "json_invalid":
                found = f"no JSON ({fault['ctx']['error']})"
                raise ReadError(found, "a result file", cure) from None
            raise fault_in_line(fault, cure) from None
        if not estimate.notes:
            estimate = estimate.with_(notes=head.notes())
        if (wrong := _contradiction(estimate)) is not None:
            place, said = wrong
            expected = "deviations of zero or more that are those of the covariance"
            raise ReadError(said, expected, f"{cure}: this one was edited", place=place)
        return estimate


def _contradiction(estimate: Estimate) -> tuple[str, str] | None:
    """Return where deviations and covariance cannot be, or are not those of each other."""
    for kind in ("parameters", "nuisance", "derived"):
        for number, value in enumerate(getattr(estimate, kind)):
            for key in ("std", "std_inflated", "std_assumed"):
                if (getattr(value, key) or 0.0) < 0:
                    return f"{kind}.{number}.{key}", f"{getattr(value, key):g}"
    free, covariance = estimate.free, estimate.covariance
    if not len(covariance):
        return None
    if len(free) != len(covariance):
        return "covariance", f"{len(covariance)} rows for {len(free)} free quantities"
    size = np.sqrt(np.abs(np.diag(covariance)))
    std = np.array([s if v.std is None else v.std for v, s in zip(free, size, strict=True)])
    known = np.flatnonzero(np.isfinite(std) & np.isfinite(covariance).all(axis=1) & (std > 0))
    scaled = covariance[np.ix_(known, known)] / std[known, None] / std[known]
    off = np.abs(np.diag(scaled) - 1) > EDITED
    if off.any():
        i = int(known[off.argmax()])
        return "covariance", f"{covariance[i, i]:g} where {free[i].name} has a std of {std[i]:g}"
    if (np.abs(scaled - scaled.T) > EDITED).any():
        return "covariance", "a matrix that is not symmetric"
    if np.linalg.eigvalsh(scaled).min(initial=0.0) < -EDITED * len(scaled):
        return "covariance", "a combination of a negative variance"
    return None


_SEVERITIES = {word: severity for severity, word in VERDICTS.items()}


@frozen
class _Check:
    """A note on the data, as files of every version hold it."""

    check: str
    channel: str
    found: str
    verdict: Literal["ok", "note", "warning", "refused"]

    def note(self) -> Note:
        channels = tuple(self.channel.split(", ")) if self.channel else ()
        return Note(self.check, _SEVERITIES[self.verdict], self.found, on=channels)


class _Head(BaseModel, defer_build=True):
    """What says which kind of file it is, and what older files hold instead of notes."""

    schema_: str = Field(alias="schema")
    warnings: tuple[str, ...] = ()
    suspects: tuple[Suspect, ...] = ()
    checks: tuple[_Check, ...] = ()

    def notes(self) -> tuple[Note, ...]:
        return (
            *(Note("warning", "doubts", text) for text in self.warnings),
            *(
                Note(s.term, "doubts", value=s.value, unit=s.unit, drop=s.drop, share=s.share)
                for s in self.suspects
            ),
            *(check.note() for check in self.checks),
        )
