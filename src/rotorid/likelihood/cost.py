"""The likelihood of one record: whitened residual, its derivative, and their kernel.

Notation (theory, section 3), for one line; rows and coordinates are scaled, see `whitening`:

    z = [u; y]         measured mean, covariance C = F F^H
    E                  calibration of the channels: true = E z (gain, delay)
    q = R v + H w      v: what the sensors read, true, v = E_y y - r; w: hidden coordinates
    P = -Z             the dynamic stiffness, negative
    s = L z + h        equation error without w: L = [B, P R] E, h = g - P R r
    N                  orthonormal basis of the left null space of P H, see `whitening`
    e = N^H s          with covariance V = N^H (L C L^H + sigma^2 S) N = U^H U
    eps = U^-H e       the whitened residual; J = sum c |eps|^2

Where the sensors outnumber what they can read, the contradictions among them are further rows of
s: ``X^H v``, X a basis of the left null space of the sensor matrix. The derivative is that at the
corrected lines (docs/maximum-likelihood.md, section 1).
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy

from rotorid.core.linalg import triangle
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.lines import Lines
from rotorid.likelihood.effects import Calibration
from rotorid.likelihood.relations import Monomials
from rotorid.likelihood.whitening import (
    Ends,
    Noise,
    Projection,
    Sizes,
    Transient,
    as_complex,
    projection,
)


@frozen
class Entries:
    """Entries of ``[P, B]``, sums of ``coefficient * weights[kind] * mu[monomial]``."""

    # (term,): columns are the coordinates, then the inputs
    row: Integers
    column: Integers
    monomial: Integers
    kind: Integers
    coefficient: Floats  # (term,)
    # (line, kind): what the terms of a kind have in common on each line: a power of i omega, and of
    # the speed
    weights: Complexes
    orders: Integers  # (kind,): n of that power
    columns: int

    @cached_property
    def _place(self) -> Integers:
        where = self.row * self.columns + self.column
        return np.asarray(where * self.weights.shape[1] + self.kind)

    def matrix(self, mu: Floats, rows: int) -> Complexes:
        kinds, values = self.weights.shape[1], self.coefficient * mu[self.monomial]
        summed = np.bincount(self._place, values, minlength=rows * self.columns * kinds)
        found = as_complex(self.weights @ summed.reshape(-1, kinds).T)
        return found.reshape(-1, rows, self.columns)


@frozen
class EntrySlopes:
    """Derivatives of ``[P, B] @ sources`` by the unknowns, which are linear in the sources.

    They are a sparse matrix times the sources, these times the weights of each kind.
    """

    # (unknown and row, kind and source): where it is not zero, a pair of a term and an unknown
    pattern: scipy.sparse.csr_array
    # (pair,): whose derivative is multiplied by the coefficient
    monomial: Integers
    unknown: Integers
    coefficient: Floats
    rows: int

    @classmethod
    def of(cls, entries: Entries, monomials: Monomials, rows: int) -> EntrySlopes:
        factors, count = monomials.factors[entries.monomial], monomials.unknowns
        kinds = entries.weights.shape[1]
        term, which = np.nonzero(factors < count)
        once = np.unique(term * count + factors[term, which])  # a power is one factor
        term, unknown = np.divmod(once, count)
        target = unknown * rows + entries.row[term]
        order = np.argsort(target, kind="stable")
        term, unknown = term[order], unknown[order]
        source = entries.kind[term] * entries.columns + entries.column[term]
        ends = np.searchsorted(target[order], np.arange(count * rows + 1))
        coefficient, shape = entries.coefficient[term], (count * rows, kinds * entries.columns)
        pattern = scipy.sparse.csr_array((coefficient, source, ends), shape)
        return cls(pattern, entries.monomial[term], unknown, coefficient, rows)

    def of_sources(self, sources: Complexes, weights: Complexes, slopes: Floats) -> Complexes:
        """Return the derivatives, (unknown, row, line); `slopes` are those of the monomials."""
        weighed = np.multiply(weights.T[:, None], sources.T, order="C").reshape(-1, len(sources))
        matrix = copy.copy(self.pattern)  # scipy would look through the indices of a new one
        matrix.data = self.coefficient * slopes[self.monomial, self.unknown]
        parts = matrix @ weighed.view(float)
        return as_complex(parts.view(complex).reshape(-1, self.rows, len(sources)))


@frozen
class Sensing:
    """What the sensors tell of the coordinates: ``q = right @ v + hidden @ w``."""

    right: Floats  # (coordinate, sensor)
    hidden: Floats  # (coordinate, hidden)
    # (contradiction, sensor): ``redundancy @ v = 0`` for what the sensors can read
    redundancy: Floats
    reads: Floats  # (sensor, coordinate): C, with ``v = reads @ q``


@frozen
class Likelihood:
    """The whitened residual of one record as a function of the unknowns."""

    entries: Entries
    slopes: EntrySlopes  # of the entries
    monomials: Monomials  # of all unknowns
    load: Complexes  # (order, line, row, load): g for each order of the rotor angle
    loading: Integers  # (load,): the monomials by which these are multiplied
    rows: int  # number of equations
    sensing: Sensing
    calibration: Calibration
    data: Complexes  # (line, channel): mean lines, inputs first, then sensors
    noise: Noise  # covariance C of the mean lines, factored as F F^H
    scales: Sizes  # what rows and coordinates were divided by
    multiplicity: Floats  # (line,): c: 2, or 1 for the real lines
    # how many of the last rows are sensors, each with its channel behind those of the inputs
    indirect: int
    transient: Transient | None  # what the loose ends of the window add
    order: list[int]  # where the channels stand in the record
    # the loads as `load` has them, on other lines: such as by another angle
    loads_on: Callable[[Lines], Complexes]

    @property
    def coordinates(self) -> int:
        return len(self.sensing.right)

    @property
    def inputs(self) -> int:
        """Number of channels that are no direct sensors."""
        return int(self.data.shape[1] - self.sensing.right.shape[1])

    @property
    def all_rows(self) -> int:
        """Number of equations and of contradictions among sensors."""
        return self.rows + len(self.sensing.redundancy)

    @property
    def equations(self) -> int:
        """Number of rows that no hidden motion explains."""
        return int(self.all_rows - self.sensing.hidden.shape[1])

    @cached_property
    def parts(self) -> Floats:
        """Weights of the real and the imaginary part of each line, shape (line, 2, 1, 1)."""
        root = np.sqrt(self.multiplicity)
        parts = np.stack([root, np.where(self.multiplicity == 1.0, 0.0, root)], axis=1)
        return parts[:, :, None, None]

    @property
    def lines(self) -> int:
        return len(self.data)

    @cached_property
    def units(self) -> Complexes:
        """A one in each equation by itself, (line, row, equation)."""
        ones = np.eye(self.all_rows, dtype=np.complex128)[:, : self.rows]
        return np.broadcast_to(ones, (self.lines, *ones.shape))

    @cached_property
    def load_monomials(self) -> Monomials:
        return replace(self.monomials, factors=self.monomials.factors[self.loading])

    @cached_property
    def loaded(self) -> slice:
        """The unknowns in the loads, and what stands between them."""
        factors = self.load_monomials.factors
        factors = factors[factors < self.monomials.unknowns]
        return slice(factors.min(), factors.max() + 1) if factors.size else slice(0)

    def load_at(self, phase: Complexes) -> Complexes:
        """Return the loads of all orders of the rotor angle together, (line, row, load)."""
        if len(phase) == 1 and phase[0] == 1:
            return as_complex(self.load[0])
        return as_complex(np.einsum("o,olrg->lrg", phase, self.load))


class Evaluation:
    """Residual and Jacobian of one record at one point; real parts over imaginary ones.

    By line are `stiffness`, `inputs`, `plain` and `columns`: P, B, the columns of the true channels
    [B, P R], and L; `null_h`: N^H, None where no coordinate is hidden; `whitener`: U; `whitened`:
    eps; `line_costs`. `cost` is J. An equally stiff `like` has the projection already.
    """

    def __init__(
        self,
        problem: Likelihood,
        unknowns: Floats,
        relaxation: float = 0.0,
        affine: Integers | None = None,
        like: Evaluation | None = None,
    ) -> None:
        self.problem, self.unknowns, self._relaxation = problem, unknowns, relaxation
        self.mu = problem.monomials.values(unknowns)
        self.state = problem.calibration.at(unknowns)
        self._set_columns()
        self._set_projection(like)
        gain = self._projected(self.columns) @ problem.noise.factor
        root = gain.conj().transpose(0, 2, 1)
        if relaxation > 0:
            root = np.concatenate([root, relaxation * self._granted()], axis=1)
        self._gain = gain
        self.whitener = triangle(root)
        self.lower = self.whitener.conj().transpose(0, 2, 1)
        self._affine = np.zeros(0, dtype=np.int64) if affine is None else affine
        self.ends: Ends | None = None
        self._set_rows(self._affine)

    def with_data(self, problem: Likelihood) -> Evaluation:
        """Return the evaluation of the same machine with other lines and loads, whitened alike."""
        other = copy.copy(self)
        other.problem = problem
        other._set_rows(self._affine[:0])
        return other

    def _set_rows(self, affine: Integers) -> None:
        """Find the errors of the rows, and their derivatives by affine unknowns behind them.

        What the loose ends of the window do best is taken out of both.
        """
        transient, count = self.problem.transient, self.problem.rows
        self.load = self.problem.load_at(self.state.phase)
        rows = self._errors_of_rows()[:, :, None]
        if len(affine):
            rows = np.concatenate([rows, self._affine_directions(affine)], axis=2)
        whitened = self._white(rows)
        self._loose = np.zeros((len(rows), count, rows.shape[2]), dtype=np.complex128)
        if transient is not None:
            if self.ends is None:
                units = self.problem.units if self.null_h is None else self.null_h[:, :, :count]
                whitened_units = as_complex(np.linalg.solve(self.lower, units))
                self._end_columns = transient.columns(whitened_units)
                self.ends = Ends.of(self.stacked(self._end_columns))
            tau = self.ends.tau(self.stacked(whitened))
            self._loose = transient.rows(tau, count)
            rows[:, :count] += self._loose
            whitened = as_complex(whitened + self._end_columns @ tau)
        self._rows, self._whitened_rows = rows, whitened

    def _set_columns(self) -> None:
        p, n = self.problem, self.problem.coordinates
        matrix = p.entries.matrix(self.mu, p.all_rows)
        self.stiffness, self.inputs = matrix[:, :, :n], matrix[:, :, n:]
        sensors = self.stiffness @ p.sensing.right
        sensors[:, p.rows :] = p.sensing.redundancy
        self.plain = np.concatenate([self.inputs, sensors], axis=2)
        factors = self.state.factors[:, None, :]
        self.columns = self.plain * factors if p.calibration.every else self.plain

    def _errors_of_rows(self) -> Complexes:
        p = self.problem
        error = (self.columns @ p.data[:, :, None])[:, :, 0]
        error[:, : p.rows] += self.loads
        if p.calibration.every:
            error -= (self.plain @ self.state.readings[:, :, None])[:, :, 0]
        return as_complex(error)

    def _set_projection(self, like: Evaluation | None) -> None:
        hidden = self.problem.sensing.hidden
        self._projection: Projection | None
        if (
            like is not None
            and np.array_equal(hidden, like.problem.sensing.hidden)
            and np.array_equal(self.stiffness, like.stiffness)
        ):
            self._projection = like._projection
        else:
            self._projection = projection(self.stiffness, hidden)
        self.null_h = None if self._projection is None else self._projection.null_h

    def _projected(self, rows: Complexes) -> Complexes:
        return rows if self.null_h is None else as_complex(self.null_h @ rows)

    def _white(self, rows: Complexes) -> Complexes:
        return as_complex(np.linalg.solve(self.lower, self._projected(rows)))

    def _granted(self) -> Complexes:
        """Return S^1/2 N, shape (line, row, equation): the errors granted to the equations."""
        if self.null_h is None:
            return self.problem.units.transpose(0, 2, 1)
        return as_complex(self.null_h.conj().transpose(0, 2, 1)[:, : self.problem.rows])

    def _affine_directions(self, affine: Integers) -> Complexes:
        """Return d(rows of s) / d affine unknowns, shape (line, row, affine unknown)."""
        p = self.problem
        columns = np.zeros((p.lines, p.all_rows, len(affine)), dtype=np.complex128)
        columns[:, : p.rows] = self.load @ p.load_monomials.jacobian(self.unknowns)[:, affine]
        for bound in p.calibration.rotating:
            mine, (_, added) = np.isin(bound.unknowns, affine), bound.slopes(self.unknowns)
            where = np.searchsorted(affine, bound.unknowns[mine])
            read = self.plain[:, :, [bound.channel]] * np.asarray(added)[:, :, mine]
            columns[:, :, where] -= read
        return columns

    @property
    def load_factors(self) -> Floats:
        return np.asarray(self.mu[self.problem.loading])

    @property
    def loads(self) -> Complexes:
        return as_complex(self.load @ self.load_factors)

    def errors(self) -> Complexes:
        """Return e, the equation errors that no hidden motion and no loose end explains."""
        return self._projected(self._rows[:, :, :1])[:, :, 0]

    def whitened_columns(self) -> Complexes:
        """Return the whitened residual of a one in each channel, (line, equation, channel)."""
        return self._white(self.columns)

    @property
    def affine_jacobian(self) -> Floats:
        return self.stacked(self._whitened_rows[:, :, 1:])

    def shift(self, change: Floats) -> None:
        """Move the affine unknowns; nothing but s moves, and linearly."""
        self.unknowns = self.unknowns.copy()
        self.unknowns[self._affine] += change
        self.mu = self.problem.monomials.values(self.unknowns)
        self.state = self.problem.calibration.at(self.unknowns)
        moving = [self._rows, self._whitened_rows]
        for rows in moving if self.problem.transient is None else [*moving, self._loose]:
            rows[:, :, 0] += rows[:, :, 1:] @ change

    @property
    def loose(self) -> Complexes:
        """What the loose ends of the window do best, in the rows of equations."""
        return self._loose[:, :, 0]

    @property
    def whitened(self) -> Complexes:
        return self._whitened_rows[:, :, 0]

    @property
    def line_costs(self) -> Floats:
        size = (self.whitened.real**2 + self.whitened.imag**2).sum(axis=1)
        return np.asarray(self.problem.multiplicity * size)

    @property
    def cost(self) -> float:
        return float(self.line_costs.sum())

    @property
    def equations(self) -> int:
        """Number of equations of motion; rows of sensors stand behind them."""
        return int(self.problem.rows - self.problem.indirect)

    @property
    def forces(self) -> int:
        """Number of inputs of the machine; they are the first channels."""
        return int(self.problem.inputs - self.problem.indirect)

    @property
    def residual(self) -> Floats:
        """The real residual, shape (line * 2 * equation,); J is its squared length."""
        return self.stacked(self.whitened[:, :, None])[:, 0]

    def residual_like(self, other: Evaluation) -> Floats:
        """Return the residual turned, line by line, as near as it goes to the rows of another.

        Rows whitened at two points differ by a unitary matrix too, which no derivative holds.
        """
        turn = other._whitened_gain @ self._whitened_gain.conj().transpose(0, 2, 1)
        for _ in range(3):  # to the nearest unitary matrix (Schulz), many times faster than by SVD
            turn = 1.5 * turn - 0.5 * turn @ (turn.conj().transpose(0, 2, 1) @ turn)
        return self.stacked(turn @ self.whitened[:, :, None])[:, 0]

    @cached_property
    def _whitened_gain(self) -> Complexes:
        return as_complex(np.linalg.solve(self.lower, self._gain))

    def stacked(self, whitened: Complexes) -> Floats:
        """Return real over imaginary parts, (line, equation, column) -> (real equation, column)."""
        (lines, equations, columns), parts = whitened.shape, self.problem.parts
        stacked = np.empty((lines, 2, equations, columns))
        np.multiply(whitened.real, parts[:, 0], out=stacked[:, 0])
        np.multiply(whitened.imag, parts[:, 1], out=stacked[:, 1])
        return stacked.reshape(-1, columns)

    def period_residual(self, spectra: Complexes) -> Complexes:
        """Return the whitened residual of each period, shape (period, line, equation)."""
        deviation = np.ascontiguousarray((spectra - self.problem.data).transpose(1, 2, 0))
        rows = self.whitened_columns() @ deviation + self.whitened[:, :, None]
        return as_complex(rows.transpose(2, 0, 1))

    def channel_shares(self) -> Floats:
        """Return how much of the whitened noise each channel brings, shape (line, channel).

        ``|g_i|^2`` of the columns g_i of U^-H N^H L diag(C)^1/2; they sum to about the number of
        equations.
        """
        deviation = np.sqrt((np.abs(self.problem.noise.factor) ** 2).sum(axis=2))
        columns = self._white(self.columns * deviation[:, None, :])
        return np.asarray((np.abs(columns) ** 2).sum(axis=1))

    def read_at(self, ratio: Complexes) -> Complexes:
        """Return what sensors read of the inputs at ``i omega ratio`` in place of ``i omega``.

        (line, sensor), scaled; `ratio` (line,).
        """
        p, n, forces = self.problem, self.problem.coordinates, self.forces
        weights = p.entries.weights * ratio[:, None] ** p.entries.orders
        matrix = replace(p.entries, weights=weights).matrix(self.mu, p.rows)
        driven, given = matrix[:, :, n : n + forces], self.state.factors * self.corrected()[0]
        answering = np.concatenate([matrix[:, :, :n], matrix[:, :, n + forces :]], axis=2)
        found = np.linalg.solve(answering, -driven @ given[:, :forces, None])[:, :, 0]
        return np.concatenate([found[:, n:], found[:, :n] @ p.sensing.reads.T], axis=1)

    def corrected(self) -> tuple[Complexes, Complexes]:
        """Return the corrected lines: channels (line, channel) and coordinates (line, n).

        They satisfy the equations of motion exactly (with sigma = 0), and are what the
        likelihood takes for the truth behind the measured lines.
        """
        p, sensing = self.problem, self.problem.sensing
        multiplier = np.linalg.solve(self.whitener, self.whitened[:, :, None])
        correction = p.noise.factor @ (self._gain.conj().transpose(0, 2, 1) @ multiplier)
        data = p.data - correction[:, :, 0]
        true = self.state.factors * data
        reading = true - self.state.readings
        motion = reading[:, p.inputs :] @ sensing.right.T
        if self._projection is not None:
            left = self._rows[:, :, 0] - (self.columns @ correction)[:, :, 0]
            if self._relaxation > 0:
                granted = (self._granted() @ multiplier)[:, :, 0]
                left[:, : p.rows] -= self._relaxation**2 * granted
            motion = motion + self._projection.motion(left)
        return data, motion

    def directions(self) -> Complexes:
        p = self.problem
        data, motion = self.corrected()
        forces = (self.state.factors * data - self.state.readings)[:, : p.inputs]
        sources = np.concatenate([motion, forces], axis=1)
        slopes = p.monomials.jacobian(self.unknowns)
        columns = np.zeros((p.lines, p.monomials.unknowns, p.all_rows), dtype=np.complex128)
        found = p.slopes.of_sources(sources, p.entries.weights, slopes)
        columns[:, :, : p.rows] = found.transpose(2, 0, 1)
        jacobian = columns.transpose(0, 2, 1)
        jacobian[:, : p.rows, p.loaded] += self.load @ slopes[p.loading, p.loaded]
        for bound in p.calibration.every:
            logarithm, added = bound.slopes(self.unknowns)
            line = self.columns[:, :, [bound.channel]] * data[:, [bound.channel], None]
            line = line * logarithm - self.plain[:, :, [bound.channel]] * added
            jacobian[:, :, bound.unknowns] += line
        if (phase := p.calibration.phase_unknown) is not None:
            turned = p.load_at(1j * p.calibration.phase_orders * self.state.phase)
            jacobian[:, : p.rows, phase] += turned @ self.load_factors
        return jacobian

    def readings_of(self, motion: Complexes) -> Complexes:
        """Return what the sensors read of a motion, (line, coordinate), scaled: (line, sensor)."""
        p, equations, forces = self.problem, self.equations, self.forces
        indirect = -(self.stiffness[:, equations : p.rows] @ motion[:, :, None])[:, :, 0]
        own = np.arange(p.rows - equations)  # the equation of a reading is scaled, as all are
        indirect /= self.inputs[:, equations + own, forces + own]
        return np.concatenate([indirect, motion @ p.sensing.reads.T], axis=1)

    def whiten(self, rows: Complexes) -> Floats:
        """Project and whiten columns of rows, (line, row, column) -> (real equation, column)."""
        whitened = self.stacked(self._white(rows))
        return whitened if self.ends is None else self.ends.rest(whitened)

    def whitened_loads(self, loads: Complexes) -> Floats:
        """Return what loads on the equations, (line, row), do to the residual, (real equation,)."""
        rows = np.zeros((self.problem.lines, self.problem.all_rows, 1), dtype=np.complex128)
        rows[:, : loads.shape[1], 0] = loads
        return self.whiten(rows)[:, 0]

    def jacobian(self) -> Floats:
        return self.whiten(self.directions())
