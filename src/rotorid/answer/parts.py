"""What an estimate consists of: values, misfit, suspects, other answers, where it comes from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PlainSerializer, Strict

from rotorid.answer.evidence import Count, Evidence, Number
from rotorid.answer.judge import Status, ordered
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.notes import VERDICTS, Note
from rotorid.core.values import ByContent, Floats, read_only

Optional = Annotated[float, Strict()] | None
Flag = Annotated[bool, Strict()]


@frozen
class Value:
    """A named quantity with its standard deviation.

    Parameters
    ----------
    name : str
    unit : str
        SI.
    value : float
        NaN where it is not determined.
    std : float or None
        ``None`` where the method gives none; 0 for a fixed value.
    std_inflated : float or None
        As if all of the misfit were noise.
    fixed : bool
        Known beforehand and not estimated.
    """

    name: str
    unit: str
    value: Number
    std: Optional = None
    std_inflated: Optional = None
    fixed: Flag = False


DOUBTFUL = 1e-3
"""The p-value from which on a misfit is what noise leaves; below it the model is doubtful."""
EXPLAINS = 0.2
"""Least share of the excess misfit with which a suspect is a lead."""


@frozen
class Misfit:
    """The misfit at the estimate, against what noise alone would leave."""

    cost: Number
    expected: Number
    dof: Count
    p_value: Number


@frozen
class LineMisfit:
    """The misfit of one line of one record (counted from 0), against what noise would leave."""

    record: Count
    frequency_hz: Number
    cost: Number
    expected: Number


@frozen
class Suspect:
    """What the model may lack, or a channel get wrong.

    Parameters
    ----------
    term : str
        ``damping k1``, ``gain[x1]``, ``swap[x1, y1]``, ...
    drop : float
        Drop of the cost if the term were free.
    share : float or None
        Share of the excess misfit that it explains.
    value : float or None
        Its estimate when it is freed.
    unit : str
        Of `value`.
    """

    term: str
    drop: Number
    share: Optional = None
    value: Optional = None
    unit: str = ""


def _pairs(rows: Any) -> Any:
    """Return ``(name, value)`` from rows of a file; pairs as they are."""
    if not isinstance(rows, list):
        return rows
    return tuple(
        (r["name"], r["value"]) if isinstance(r, dict) and len(r) == 2 else r for r in rows
    )


def _rows(pairs: tuple[tuple[str, float], ...]) -> list[dict[str, Any]]:
    return [{"name": name, "value": value} for name, value in pairs]


Pairs = Annotated[tuple[tuple[str, Number], ...], BeforeValidator(_pairs), PlainSerializer(_rows)]


@frozen
class Alternative:
    """Another answer that fits as well: its misfit, and ``(name, value)`` of each parameter."""

    cost: Number
    parameters: Pairs


@frozen
class ModeFit:
    """A measured natural frequency beside that of the estimate.

    Parameters
    ----------
    mode : int
        Its number among the distinct natural frequencies, from 1.
    speed_rad_s : float
    frequency_hz, std_hz : float
        As measured.
    fitted_hz, fitted_std_hz : float
        Of the estimate, with the deviation that follows from those of the parameters.
    damping_ratio, damping_std : float or None
        As measured; ``None`` where it was not.
    fitted_damping_ratio : float
    parameters : sequence of (name, value)
        What was otherwise in the test.
    """

    mode: Count
    speed_rad_s: Number
    frequency_hz: Number
    std_hz: Number
    fitted_hz: Number
    fitted_std_hz: Number
    damping_ratio: Optional = None
    damping_std: Optional = None
    fitted_damping_ratio: Optional = None
    parameters: Pairs = ()


@frozen
class Unbalance:
    """The unbalance of one plane: what stands there too much, and in which direction.

    Parameters
    ----------
    plane : str
        The coordinates on which it acts: ``x2, y2``; ``theta_x, theta_y`` for a couple.
    unit : str
        kg m, or kg m^2 of a couple.
    amount : float
    angle_rad : float
        In the rotor, counted from the zero of the rotor angle.
    std, angle_std_rad : float or None
        ``None`` where the estimate states no deviations.
    """

    plane: str
    unit: str
    amount: Number
    angle_rad: Number
    std: Optional = None
    angle_std_rad: Optional = None


@frozen
class SourceFile:
    """A file that went into an estimate, and the sha256 of its content in hexadecimal.

    Empty where the file is beyond 16 GB, or made of holes for the most part.
    """

    file: str
    sha256: str


@frozen
class Provenance:
    """Where an estimate comes from.

    Parameters
    ----------
    files : sequence of SourceFile
        Records and models that were read.
    experiment : str
        The experiment file's text.
    version : str
        Of rotorid.
    command : str
        As it was given.
    model : str
        The model file's text, whole, so that the result needs no other file.
    held : sequence of (name, value)
        What was substituted in the model before it was identified, SI.
    environment : str
        Versions of Python and of what computes: other ones may differ in the last digits.
    """

    files: tuple[SourceFile, ...] = ()
    experiment: str = ""
    version: str = ""
    command: str = ""
    model: str = ""
    held: Pairs = ()
    environment: str = ""


@frozen
class Prediction:
    """How well an estimate predicts one channel: ``|residual| / |measured|`` on the lines."""

    relative_error: Number


def _undetermined(value: Value) -> Value:
    """Give what is not determined no finite deviation either."""
    if math.isnan(value.value) and value.std is None:
        return replace(value, std=math.nan, std_inflated=math.nan)
    return value


def _square(rows: Any) -> Floats:
    if any(len(row) != len(rows) for row in rows):
        raise ValueError("a square matrix")
    return np.array(rows, dtype=float).reshape(len(rows), len(rows))


def _told(notes: Sequence[Note]) -> list[dict[str, Any]]:
    """Return notes as a file holds them: drop and share only where there is one."""
    return [
        {k: v for k, v in vars(note).items() if v is not None or k not in ("drop", "share")}
        for note in notes
    ]


_OPEN = ("not identifiable: ", "cure: ")  # what is open, and what would cure it


if TYPE_CHECKING:
    Values = tuple[Value, ...]
    Covariance = Floats
else:
    Values = tuple[Annotated[Value, AfterValidator(_undetermined)], ...]
    Covariance = Annotated[
        tuple[tuple[Number, ...], ...], AfterValidator(_square), PlainSerializer(np.ndarray.tolist)
    ]


@frozen
class Answer(ByContent):
    """The fields of an `Estimate`, where each is explained, and what only they decide."""

    model: str
    method: str
    status: Status
    parameters: Values
    nuisance: Values = ()
    derived: Values = ()
    covariance: Covariance = field(default_factory=lambda: np.zeros((0, 0)))
    misfit: Misfit | None = None
    prediction: dict[str, Prediction | None] = field(default_factory=dict)
    lines_hz: tuple[Number, ...] = ()
    periods: Count = 0
    notes: Annotated[tuple[Note, ...], PlainSerializer(_told)] = ()
    condition_number: Optional = None
    line_misfit: tuple[LineMisfit, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    modes: tuple[ModeFit, ...] = ()
    unbalance: tuple[Unbalance, ...] = ()
    provenance: Provenance | None = None
    evidence: Evidence | None = None

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance, dtype=float)
        object.__setattr__(self, "covariance", read_only(covariance))
        object.__setattr__(self, "notes", ordered(self.notes))
        if self.status == "ok" and (found := _not_finite(self)):
            raise InputError(
                f"no finite {found} in an estimate called ok",
                "finite numbers",
                "check units and scales of the columns, or call it not_converged",
            )

    @property
    def on_answer(self) -> tuple[Note, ...]:
        """The notes on the answer itself, without its possible causes."""
        found = (note for note in self.notes if note.drop is None)
        return tuple(note for note in found if note.severity not in VERDICTS)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notes on the answer, in words; what is open and what would cure it are named so."""
        return tuple(
            _OPEN[bool(note.cure)] + note.text if note.severity == "open" else note.text
            for note in self.on_answer
        )

    @property
    def checks(self) -> tuple[Note, ...]:
        """The notes on the data, and on what was taken as exact."""
        return tuple(note for note in self.notes if note.severity in VERDICTS)

    @property
    def suspects(self) -> tuple[Suspect, ...]:
        """What the model may lack, or a channel get wrong: what explains most first."""
        return tuple(
            Suspect(note.about, note.drop, note.share, note.value, note.unit)
            for note in self.notes
            if note.drop is not None
        )

    @property
    def free(self) -> tuple[Value, ...]:
        """The quantities of the rows of `covariance`, in order."""
        return (*(value for value in self.parameters if not value.fixed), *self.nuisance)

    @property
    def correlation(self) -> Floats:
        """Correlation matrix of `free`, shape (free, free)."""
        deviation = np.sqrt(np.diag(self.covariance))
        scale = np.where(deviation > 0, deviation, 1.0)
        return np.asarray(self.covariance / np.outer(scale, scale))


def _not_finite(answer: Answer) -> str:
    estimated = len(answer.parameters) + len(answer.nuisance)
    for k, value in enumerate((*answer.parameters, *answer.nuisance, *answer.derived)):
        known = [value.std, value.std_inflated] if math.isfinite(value.value) else []
        if k < estimated:
            known.append(value.value)
        if not all(x is None or math.isfinite(x) for x in known):
            return f"{value.name} or deviation of it"
    misfit = answer.misfit
    if misfit is not None and not math.isfinite(misfit.cost):
        return "misfit"
    stated = [value.std is not None for value in answer.free]
    covariance = answer.covariance
    if len(stated) == len(covariance):  # without scatter nothing is stated of a value
        covariance = covariance[np.ix_(stated, stated)]
    return "" if np.isfinite(covariance).all() else "covariance"
