"""The linear form of a model: M, D, G, K, B and the loads that turn with the rotor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError, ModelError
from rotorid.core.values import Array, Booleans, Complexes, Floats, Integers, frozen
from rotorid.models.equations import DERIVATIVES
from rotorid.models.expressions import (
    FUNCTIONS,
    RESERVED,
    Expression,
    evaluate,
    is_usable,
    product,
    symbol,
)

POINTS = 257  # rotor angles per turn: a load of 255 times per turn is still told from one of once
TURNS = 1000  # turns over which a load is looked at that none repeats, as that of a geared shaft
REPEATS = 1e-9  # share of its size by which a load may differ from turn to turn: rounding


@lru_cache(maxsize=1000)
def rotation_line(signal: Expression, speed: float) -> complex:
    """Return g of the part ``Re(g exp(i phi))`` of a load at a speed in rad/s; NaN if not finite.

    A load that depends on the time has none: it may turn as fast, but not from the same zero.
    """
    if symbol("t") in signal.free_symbols:
        return 0j
    angle = 2 * np.pi * np.arange(POINTS) / POINTS
    if _repeats(signal):
        weight = np.full(POINTS, 1 / POINTS)
    else:  # a window whose lines are far narrower than orders are apart
        angle = 2 * np.pi * np.arange(POINTS * TURNS) / POINTS
        weight = np.blackman(len(angle))
        weight /= weight.sum()
    wave = _wave(signal, angle, speed)
    if not np.isfinite(wave).all():
        return complex(np.nan, np.nan)
    return complex(2 * (weight * np.exp(-1j * angle)) @ wave)


def runs_by_time(signal: Expression) -> Expression | None:
    """Return the function of `Omega` times `t` in a load, which is to turn with the rotor."""
    if signal.kind in FUNCTIONS and {symbol("t"), symbol("Omega")} <= signal.free_symbols:
        return signal
    return next(filter(None, map(runs_by_time, signal.inner)), None)


@lru_cache(maxsize=1000)
def _repeats(signal: Expression) -> bool:
    angle = np.linspace(0.1, 6.1, 7)
    first = _wave(signal, angle, 1.0)
    later = [_wave(signal, angle + 2 * np.pi * turns, 1.0) for turns in (1, 2, 3)]
    size = np.abs([first, *later]).max(initial=0.0)
    with np.errstate(invalid="ignore"):  # infinite: not this one's to say
        return not any((np.abs(wave - first) > REPEATS * size).any() for wave in later)


def _wave(signal: Expression, angle: Floats, speed: float) -> Floats:
    return evaluate(signal, {"phi": angle, "Omega": speed}) * np.ones(len(angle))


@frozen
class Term:
    """``coefficient * monomial * signal`` in one row of the left sides."""

    row: int
    monomial: int
    coefficient: float
    signal: Expression


@frozen
class InputTerm:
    """``coefficient * monomial * input`` in one row of the right sides."""

    row: int
    input: int
    monomial: int
    coefficient: float


@frozen
class Matrices:
    """M, D, G, K (row, coordinate), B (row, input), and H (row, coordinate), in SI units.

    What depends on the speed otherwise than as Omega G is in D and K, at the speed asked for.
    H is structural damping: on lines above 0 Hz the stiffness is ``K + i H``.
    """

    M: Floats
    D: Floats
    G: Floats
    K: Floats
    B: Floats
    H: Floats


class TermKind(NamedTuple):
    """What terms of Z have in common: order of the derivative, factor of the speed, lag."""

    order: int
    factor: Expression
    structural: bool

    @property
    def matrix(self) -> str:
        gyroscopic = self.order == 1 and self.factor == symbol("Omega")
        return "H" if self.structural else "G" if gyroscopic else "KDM"[self.order]


class StiffnessTerm(NamedTuple):
    """``coefficient * monomial * factor(Omega) * d^order q / dt^order``, `structural`: times i."""

    kind: TermKind
    row: int
    column: int
    monomial: int
    coefficient: float


MATRICES = "MDGKH"
TURNING = MATRICES.index("G")


@dataclass(frozen=True, eq=False)
class StiffnessTable:
    """The terms of Z in columns: those of a drawing are tens of thousands."""

    kinds: tuple[TermKind, ...]
    # (term,)
    kind: Integers
    row: Integers
    column: Integers
    monomial: Integers
    coefficient: Floats  # (term,)

    def __len__(self) -> int:
        return len(self.coefficient)

    def __iter__(self) -> Iterator[StiffnessTerm]:
        columns = (each.tolist() for each in (*self._places, self.coefficient))
        for kind, *term in zip(*columns, strict=True):
            yield StiffnessTerm(self.kinds[kind], *term)

    @property
    def _places(self) -> tuple[Integers, ...]:
        return self.kind, self.row, self.column, self.monomial

    @cached_property
    def monomials(self) -> tuple[int, ...]:
        return tuple(np.unique(self.monomial).tolist())

    @cached_property
    def order(self) -> Integers:
        """Of the derivative, (term,)."""
        return np.array([kind.order for kind in self.kinds], dtype=np.int64)[self.kind]

    @cached_property
    def lag(self) -> Floats | Complexes:
        """What structural damping turns a term by, (term,): complex where there is any."""
        return np.array([1j if kind.structural else 1.0 for kind in self.kinds])[self.kind]

    def sizes(self, speed: float) -> Floats:
        factors = np.array([speed_factor(kind.factor, speed) for kind in self.kinds])
        return np.asarray(self.coefficient * factors[self.kind])

    def where(self, chosen: Booleans) -> StiffnessTable:
        kind, row, column, monomial = (each[chosen] for each in self._places)
        return StiffnessTable(self.kinds, kind, row, column, monomial, self.coefficient[chosen])


@frozen
class LinearForm:
    """Linear equations with constant coefficients: ``Z(omega) q = B u + g`` at line omega.

    ``Z = -omega^2 M + i omega (D + Omega G) + K``; every matrix is linear in the monomials.
    """

    # sizes
    rows: int
    coordinates: int
    inputs: int
    stiffness: StiffnessTable
    input_terms: tuple[InputTerm, ...]
    load_terms: tuple[Term, ...]  # g, on the right side; their signals hold t, phi and Omega only
    # parameter values, shape (parameter,), to those of the monomials, shape (monomial,)
    monomial_values: Callable[[Floats], Floats]
    monomials: int  # their number

    def matrices(self, values: ArrayLike, speed: float = 0.0) -> Matrices:
        return self.weighed(self.monomial_values(np.asarray(values, dtype=float)), speed)

    def weighed(self, mu: Floats, speed: float) -> Matrices:
        """Return the matrices at values of the monomials, (..., monomial)."""
        table, several = self.stiffness, mu.shape[:-1]
        sizes = np.where(self._matrix == TURNING, table.coefficient, table.sizes(speed))
        place = (self._matrix * self.rows + table.row) * self.coordinates + table.column
        size, count = len(MATRICES) * self.rows * self.coordinates, int(np.prod(several))
        places = np.arange(count)[:, None] * size + place
        entries = (sizes * mu[..., table.monomial]).ravel()
        summed = np.bincount(places.ravel(), entries, count * size)
        found = 0.0 + summed.reshape(*several, len(MATRICES), self.rows, self.coordinates)
        each = zip(MATRICES, np.moveaxis(found, -3, 0), strict=True)
        return Matrices(**dict(each), B=self.input_matrix(mu))

    @cached_property
    def _matrix(self) -> Integers:
        """Which of `MATRICES` each term is in, (term,)."""
        found = [MATRICES.index(kind.matrix) for kind in self.stiffness.kinds]
        return np.array(found, dtype=np.int64)[self.stiffness.kind]

    def input_matrix(self, mu: Floats) -> Floats:
        """Return B, shape (..., row, input), from the values of the monomials."""
        matrix = np.zeros((*mu.shape[:-1], self.rows, self.inputs))
        for term in self.input_terms:
            matrix[..., term.row, term.input] += term.coefficient * mu[..., term.monomial]
        return matrix

    def require_square(self, file: str = "") -> None:
        if self.rows != self.coordinates:
            told = f"{self.rows} equations for {self.coordinates} coordinates"
            expected = "as many of one as of the other"
            raise InputError(told, expected, "complete the model", file=file)

    def dynamic_stiffness(self, omega: ArrayLike, values: ArrayLike, speed: float) -> Complexes:
        """Return Z of each line, shape (line, row, coordinate)."""
        m = self.matrices(values, speed)
        s = 1j * np.asarray(omega, dtype=float)[:, None, None]
        return np.asarray(s**2 * m.M + s * (m.D + speed * m.G) + m.K + 1j * (s.imag > 0) * m.H)

    def sparse_stiffness(self, values: Floats, omega: float, speed: float) -> Any:
        """Return Z of one line, sparse, shape (row, coordinate): most of a drawing's is 0."""
        table, lines = self.stiffness, (1j * omega) ** np.arange(3)
        sizes = table.sizes(speed) * table.lag * lines[table.order]
        entries = sizes * self.monomial_values(values)[table.monomial], (table.row, table.column)
        return scipy.sparse.csc_array(entries, shape=(self.rows, self.coordinates))

    def response(
        self, omega: ArrayLike, values: ArrayLike, speed: float, right: Complexes
    ) -> Complexes:
        """Solve ``Z(omega_k) q_k = right_k`` for the coordinates, shape (line, coordinate)."""
        stiffness = self.dynamic_stiffness(omega, values, speed)
        self.require_square()
        return solved(stiffness, right[..., None], np.asarray(omega, dtype=float))[..., 0]

    def load_columns(self, time: ArrayLike, angle: ArrayLike, speed: float) -> Floats:
        """Return the columns of g: ``g = load_columns @ mu``."""
        at: dict[str, ArrayLike] = {"t": time, "phi": angle, "Omega": speed}
        columns = np.zeros((*np.shape(angle), self.rows, self.monomials))
        return np.asarray(self._filled(columns, lambda signal: evaluate(signal, at), speed))

    def rotation_columns(self, speed: float) -> Complexes:
        """Return the columns of g, of ``Re(g exp(i phi))``: what turns with the rotor."""
        columns = np.zeros((self.rows, self.monomials), dtype=complex)
        return np.asarray(self._filled(columns, lambda x: rotation_line(x, speed), speed))

    def _filled(self, columns: Any, value: Callable[[Expression], Any], speed: float) -> Any:
        values: dict[Expression, Any] = {}
        for term in self.load_terms:
            if term.signal not in values:
                values[term.signal] = value(term.signal)
            if not is_usable(values[term.signal]):
                raise _not_finite(term.signal, speed)
            columns[..., term.row, term.monomial] += term.coefficient * values[term.signal]
        return columns


FASTEST = 1e9  # speed in rad/s above which nothing turns: the rim of a metre would outrun light
SINGULAR = 1e12  # condition of a scaled dynamic stiffness from which on it is singular to rounding


def solved(stiffness: Array, right: Array, omega: Floats, size: Floats | None = None) -> Array:
    """Solve ``Z_k q_k = right_k``, (line, row, several); `size`: of Z's parts, which may cancel."""
    # Rows and columns in units of their own size, so that the condition means something.
    size = np.abs(stiffness) if size is None else size
    row = 1 / np.maximum(size.max(axis=2), 1e-300)
    column = 1 / np.maximum((size * row[..., None]).max(axis=1), 1e-300)
    scaled = stiffness * row[..., None] * column[:, None, :]
    condition = np.linalg.cond(scaled)
    if (condition > SINGULAR).any():
        where = omega[int(condition.argmax())] / (2 * np.pi)
        expected = "lines away from undamped resonances and free motion"
        cure = "leave that line out or give the model damping or support"
        raise InputError(f"a singular dynamic stiffness at {where:g} Hz", expected, cure)
    return np.asarray(np.linalg.solve(scaled, right * row[..., None]) * column[..., None])


@lru_cache(maxsize=1000)
def speed_factor(factor: Expression, speed: float) -> float:
    """Return the value of an expression that holds Omega at the most, at a speed in rad/s."""
    value = float(evaluate(factor, {"Omega": speed}))
    if not is_usable(value):
        raise _not_finite(factor, speed)
    return value


def _not_finite(value: Expression, speed: float) -> InputError:
    if abs(speed) > FASTEST:
        return InputError(
            f"a speed of {speed:g} rad/s",
            f"at most {FASTEST:g}, whose powers are finite numbers",
            "give the speed of the rotor, with its unit",
        )
    return InputError(
        f"{value} without a finite value at the speed {speed:g} rad/s",
        "a division by something other than zero",
        "give the speed of the record, or rewrite the term",
    )


def motion_factor(
    signal: Expression, coordinates: Sequence[str]
) -> tuple[int, int, Expression] | None:
    """Split a signal into a coordinate's derivative and a factor that holds Omega at the most."""
    moving = [s for s in signal.free_symbols if str(s) not in RESERVED]
    if len(moving) != 1 or (alone := (moving[0], Fraction(1))) not in signal.factors:
        return None
    factor = product(f for f in signal.factors if f != alone)
    if not factor.free_symbols <= {symbol("Omega")}:
        return None
    name = str(moving[0]).rstrip("'")
    return coordinates.index(name), len(str(moving[0])) - len(name), factor


def classify(
    terms: Sequence[Term], coordinates: Sequence[str]
) -> tuple[StiffnessTable, tuple[Term, ...]]:
    """Split left-side terms into entries of Z and loads g."""
    motion = {symbol(name + dots) for name in coordinates for dots in DERIVATIVES}
    kinds: dict[TermKind, int] = {}
    entries, loads = [], []
    for term in terms:
        if not term.signal.free_symbols & motion:
            loads.append(Term(term.row, term.monomial, -term.coefficient, term.signal))
            continue
        found = motion_factor(term.signal, coordinates)
        if found is None:
            told = f"the term {term.signal}"
            expected = "equations linear in the coordinates with constant coefficients"
            cure = "use ls, batch or sequential, which need no linearity"
            raise ModelError(told, expected, cure, place=f"equation {term.row + 1}")
        column, order, factor = found
        number = kinds.setdefault(TermKind(order, factor, structural=False), len(kinds))
        entries.append((number, term.row, column, term.monomial, term.coefficient))
    *places, coefficient = np.array(entries, dtype=float).reshape(-1, 5).T
    kind, row, where, monomial = (place.astype(np.int64) for place in places)
    return StiffnessTable(tuple(kinds), kind, row, where, monomial, coefficient), tuple(loads)
