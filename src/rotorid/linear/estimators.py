"""Least squares, batch and sequential: three weightings of one solve, on lines or on samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np

from rotorid.answer import machine_checks
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import LACKS, LATE, MATTERS, PULLED, RECORDS, weighed
from rotorid.core.errors import InputError
from rotorid.core.notes import Note, Severity
from rotorid.core.values import Floats, frozen
from rotorid.data.filtered import told_of
from rotorid.data.observation import Data, Records, bind_all
from rotorid.linear.family import LeastSquaresProblem, Posed, Solver
from rotorid.linear.regression import Regression, SampledRegression
from rotorid.linear.solve import (
    BLOCKS,
    FEWEST,
    Block,
    LeastSquaresSolution,
    Scatter,
    block_numbers,
    pooled,
    scatter_of_blocks,
    solve,
    wider,
)
from rotorid.models import Model
from rotorid.models.knowledge import Constraint
from rotorid.signals.spectrum import synthesize

MOVED = 1.0
"""Deviations that a force that is lacking, a lag or noise may move a parameter before it is told:
one leaves 83 % of intervals right where 95 % are promised."""
CLEAR = 3.0
"""Deviations between two records by which they differ by more than chance."""

DOUBTFUL, SURE = 4.0, 5.0
"""Deviations of the normal distribution of a lag between forces and motion from which on it is
told, where it moves a parameter by more than `MOVED`, and from which on the answer is turned away
(p < 1e-6), where it moves one by what the gate is sure of."""
CLEARER = 1.5
"""Times as clear as the force that is told as lacking a lag must be to turn an answer away: what
sticks where an axis turns is smeared by the filter, and looks like both (1.1 to 1.3 times)."""
UNSURE = 0.3
"""Share of what noise of the motion moves, and is taken off, that the deviations hold: it is taken
for white, and as strong below the cut-off as it is above."""


def filtered_records(records: Records) -> bool:
    found = [record.filtered is not None for record in records]
    if len({*found}) > 1:
        told, expected = "records with a cut-off beside others", "all of one kind"
        cure = "give every record a cut-off (cutoff, rid.filtered), or none"
        raise InputError(told, expected, cure, file=records[found.index(False)].lines.source)
    return all(found)


def refuse_filtered(records: Records, method: str) -> None:
    for record in records:
        if record.filtered is not None:
            raise InputError(
                f"a filtered record (cutoff) for {method}",
                "ls or batch for samples, lines for this method",
                "use ls; or give the fundamental, or for ml and a linear model the band, in place "
                "of the cut-off",
                file=record.lines.source,
            )


@frozen
class SampledProblem(Posed):
    """Regressions on the samples of all records, in the unknowns that exact constraints leave."""

    kind = SampledRegression

    @classmethod
    def of(
        cls, records: Records, given: Mapping[str, float | str], constraints: Sequence[Constraint]
    ) -> Self:
        """Return the problem that sees the motion as leaves least.

        Signs in a machine turn between samples; forces that jump where they are read, of a given
        motion, hold those of the samples.
        """
        posed = super().of(records, given, constraints)
        ways = zip(*(r.ways() for r in posed.regressions), strict=True)
        return min((replace(posed, regressions=way) for way in ways), key=cls.misfit)

    def misfit(self) -> float:
        return float(sum(r.misfit(self._plain) for r in self.regressions))

    @cached_property
    def _plain(self) -> Floats:
        """The base parameters where every row counts alike."""
        rows = np.ones(len(self.model.texts))
        solution = solve(self.blocks(lambda regression: rows))
        return np.nan_to_num(self.base(solution.values))

    def variance(self, regression: Any) -> Floats:
        """Return the variance of what least squares leaves of each row, (row,)."""
        return np.asarray(regression.variance(self._plain))

    def summarize(self, method: str, solved: Solver) -> Estimate:
        solution, scatter, values, pull = self.fit(solved)
        lacking, off = self.lacking(solution, scatter, pull)
        covariance = scatter.covariance + off.T @ off + UNSURE**2 * np.outer(pull, pull)
        solution = replace(solution, values=solution.values - pull)
        estimate = self.estimate(method, solution, covariance, unknown=scatter.alone)
        return estimate.with_notes(
            *self.told(scatter),
            *machine_checks.physical(self.full, estimate),
            *self.pulled(pull, scatter, values),
            *lacking,
            *machine_checks.prediction(estimate, self.noise(solution)),
            *self.unbalanced(solution),
            *machine_checks.agreement(self.names, *scatter.halves()),
            *self.apart(solved),
        )

    def fit(self, solved: Solver) -> tuple[LeastSquaresSolution, Scatter, Floats, Floats]:
        """Return a solution, what blocks say of it, its values as far as equations reach, its pull.

        The values are without the pull.
        """
        solution = solved(self)
        counts = [len(r.inputs) for r in self.regressions]
        numbers = np.repeat(block_numbers(counts, BLOCKS), len(self.model.texts))
        matrix, gains = solution.matrix, np.hstack(solution.gains)
        scatter = scatter_of_blocks(matrix, solution.residual, gains, numbers)
        pull = self.pull(solution)
        return solution, scatter, self.reached(solution) - pull, pull

    def noise(self, solution: LeastSquaresSolution) -> dict[str, float]:
        """Return the share of what is predicted that noise of the motion explains."""
        base, acting = np.nan_to_num(self.base(solution.values)), self.model.input_matrix
        found = [r.predicted(base) for r in self.regressions]
        rows = acting.any(axis=1) if acting.any() else self.model.coefficients[1].any(axis=0)
        to = np.linalg.pinv(acting[rows]) if acting.any() else np.eye(int(rows.sum()))
        whole, left = self._sizes(solution)[:, rows] @ to.T, np.zeros(len(to))
        for r in self.regressions:
            left += len(r.inputs) * np.einsum("ar,ab,br->r", whole, r.noise, whole)
        size = np.sum([each.size for each in found], axis=0)
        share = np.sqrt(left / np.where(size > 0, size, np.inf))
        return dict(zip(found[0].names, share.tolist(), strict=True))

    def unbalanced(self, solution: LeastSquaresSolution) -> Iterator[Note]:
        """Judge rows without a force or a known term by what they leave of their largest term."""
        base, whole = np.nan_to_num(self.base(solution.values)), self._sizes(solution)
        told = self.model.input_matrix.any(axis=1) | self.model.coefficients[1].any(axis=0)
        for row in np.flatnonzero(~told):
            terms = sum(((r.signals * whole[:, row]) ** 2).sum(axis=0) for r in self.regressions)
            left = sum((r.residual(base)[:, row] ** 2).sum() for r in self.regressions)
            noise = sum(
                len(r.inputs) * whole[:, row] @ r.noise @ whole[:, row] for r in self.regressions
            )
            if not (largest := np.max(terms)):
                continue
            error, unsure = np.sqrt([left / largest, noise / largest])
            if error > np.hypot(machine_checks.UNPREDICTED, 2 * unsure):
                text = (
                    f"row {row + 1}, which no force drives, leaves {100 * error:.3g} % of its "
                    f"largest term, of which noise explains {100 * unsure:.3g} %: the equations do "
                    "not describe this record"
                )
                cure = "check columns, units and signs"
                yield Note("prediction", "rejects", text, cure, value=float(error), unit="1")

    def _sizes(self, solution: LeastSquaresSolution) -> Floats:
        """Return what each row holds of each signal, (signal, row)."""
        coefficients, known = self.model.coefficients
        return np.asarray(coefficients @ np.nan_to_num(self.base(solution.values)) + known)

    def _weighted(self, solution: LeastSquaresSolution) -> Iterator[tuple[Any, Floats]]:
        """Yield each regression with its samples that count over the variance of each, (row,)."""
        first = 0
        for r in self.regressions:
            deviation = solution.deviation[first : first + len(self.model.texts)]
            yield r, r.told.sum(axis=0) / deviation**2
            first += r.target.size

    def pull(self, solution: LeastSquaresSolution) -> Floats:
        """Return what noise of the motion adds to the values, (free,).

        ``-(X'X)^-1 E[N' N theta]``, N what noise leaves on X: least squares takes it for motion.
        The theta is that without the pull: where noise is half of X, that of the solution is half.
        """
        whole, structure = self._sizes(solution), self.structure
        found, shrunk = np.zeros(len(self.names)), np.eye(len(self.names))
        gains = np.hstack(solution.gains)
        inverse = gains @ gains.T
        for r, weight in self._weighted(solution):
            seen = np.einsum("arf,ab,r->brf", structure, r.noise, weight)
            found -= np.einsum("brf,br->f", seen, whole)
            shrunk -= inverse @ np.einsum("brf,brg->fg", seen, structure)
        return np.linalg.solve(shrunk, inverse @ found)

    def pulled(self, pull: Floats, scatter: Scatter, values: Floats) -> Iterator[Note]:
        """Say what noise of the motion has moved most, and was taken off.

        A pull of all of the value leaves nothing of it: least squares has the other sign.
        """
        at, share = scatter.worst(pull)
        if share <= MOVED:
            return
        text = (
            f"noise in the motion pulls {self.names[at]} by {pull[at]:+.3g} {self._unit(at)}, "
            f"{share:.2g} deviations, which are taken off; the deviations hold {UNSURE:g} of that"
        )
        cure = "try a lower cut-off, as long as the motion lies well below"
        size, whole = abs(pull[at]), abs(values[at])
        severity: Severity = "says" if size <= UNSURE * whole else "doubts"
        severity = "rejects" if size > whole else severity
        yield Note(PULLED, severity, text, cure, (self.names[at],), share, "1")

    def lacking(
        self, solution: LeastSquaresSolution, scatter: Scatter, pull: Floats
    ) -> tuple[list[Note], Floats]:
        """Return notes on forces that are lacking or late, and what the former move, (force, free).

        The values are as uncertain as that: the covariance grows by the sum of ``change change'``.
        """
        travel = np.max([r.travel for r in self.regressions], axis=0)
        whole = self._sizes(solution)
        columns, noise = list[Floats](), np.zeros(1)
        for r, weight in self._weighted(solution):
            said, own, shared = r.further(travel, whole)
            columns.append(own.reshape(-1, own.shape[2]))
            noise = noise + weight @ shared
        every, free = np.concatenate(columns), not self.model.inputs
        size, clear, changes = scatter.with_column(solution, every, pull, noise, free=free)
        moved = [scatter.worst(change) for change in changes]
        shares = np.where(clear > DOUBTFUL, [share for _, share in moved], 0.0)
        lacks = int(np.where(shares > MOVED, clear, 0.0)[:-1].argmax())
        notes, rival = list[Note](), 0.0
        if (share := float(shares[lacks])) > MOVED:
            at, rival = moved[lacks][0], CLEARER * float(clear[lacks])
            lack, cure = said[lacks]
            by = self._by(at, clear[lacks], changes[lacks, at], share)
            text = f"{lack} {by}: they are wider by that"
            notes.append(Note(LACKS, "doubts", text, cure, (self.names[at],), share, "1"))
        if clear[-1]:
            lag, clearly = -float(size[-1]), float(clear[-1])
            notes += self.late(lag, clearly, changes[-1], rival, scatter)
        return notes, changes[:-1][shares[:-1] > MOVED]

    def _by(self, at: int, clear: float, change: float, share: float) -> str:
        return (
            f"({clear:.3g} deviations), which moves {self.names[at]} by {change:+.3g} "
            f"{self._unit(at)}, {share:.2g} deviations"
        )

    def late(
        self, lag: float, clear: float, change: Floats, rival: float, scatter: Scatter
    ) -> Iterator[Note]:
        """Judge a lag of the forces, s, which changes the values; or say what an unseen one does.

        Of forces that are late ``u(t - lag) = u - lag u'``: so look elastic parts and filters, too.
        """
        at, share = scatter.worst(change)
        cure = (
            "give the delay of the channels and its std, or look for filters before the logger, or "
            "for something elastic that the equations leave out"
        )
        if clear > DOUBTFUL and share > MOVED:
            way = "late" if lag > 0 else "early"
            by = self._by(at, clear, change[at], share)
            text = f"the forces come as if {abs(lag) * 1e3:.3g} ms {way} {by}"
            sure = clear > max(SURE, rival) and share > machine_checks.SURE
            severity: Severity = "rejects" if sure else "doubts"
            yield Note(LATE, severity, text, cure, (self.names[at],), share, "1")
            return
        # A command acts at the next sample as often as at its own, unless its delay is stated.
        records = [r.record.record for r in self.regressions]
        stated = max(c.delay_std for r in self.regressions for c in r.observation.inputs)
        doubt = stated or 1 / min(record.sample_rate for record in records)
        unseen = min(doubt, abs(lag) + 2 * abs(lag) / clear)
        spread = np.sqrt(np.diag(scatter.covariance))
        moves = np.where(spread > 0, np.abs(change), 0.0) / np.where(spread > 0, spread, 1.0)
        size = f"{unseen * 1e3:.3g} ms"
        note = Note("timing", "assumes", f"forces at most {size} early or late", cure, size=size)
        yield from weighed([(note, moves * unseen / abs(lag), MATTERS)], self.names)[1]

    def apart(self, solved: Solver) -> Iterator[Note]:
        """Judge whether records, each fitted alone, agree parameter by parameter."""
        alone = [replace(self, regressions=(r,)).fit(solved)[1:3] for r in self.regressions]
        values = np.array([found for _, found in alone])
        variance = np.array([np.diag(s.covariance) * wider(s.blocks - 1) ** 2 for s, _ in alone])
        variance[[s.alone | (s.blocks < FEWEST) for s, _ in alone]] = np.inf
        both = np.maximum(variance[:, None] + variance, 1e-300)
        off = np.nan_to_num(np.abs(values[:, None] - values) / np.sqrt(both))
        *pair, worst = np.unravel_index(int(off.argmax()), off.shape)
        if (figure := float(off.max())) <= CLEAR:
            return
        sources = [told_of(r.record.record) for r in self.regressions]
        told = ", ".join(f"{sources[k]}{values[k, worst]:.4g} of record {k + 1}" for k in pair)
        text = f"{self.names[worst]}, each fitted alone: {told}; {figure:.3g} deviations apart"
        severity: Severity = "rejects" if figure > machine_checks.APART else "doubts"
        cure = "identify the records apart: something differs between them, or the model lacks it"
        yield Note(RECORDS, severity, text, cure, (self.names[worst],), figure, "1")

    def told(self, scatter: Scatter) -> Iterator[Note]:
        """Say what the records and the blocks show."""
        count, seconds = scatter.blocks, sum(r.record.duration for r in self.regressions)
        alone = tuple(name for name, alone in zip(self.names, scatter.alone, strict=True) if alone)
        if alone:
            text = (
                f"a single one of {count} blocks of the record tells {', '.join(alone)}: "
                "no deviation can be stated"
            )
            yield Note("blocks", "doubts", text, "excite it more than once", on=alone)
        if scatter.memory:
            text = f"{count} blocks are correlated by {scatter.memory:.2f}: deviations are wider"
            yield Note("blocks", "doubts", text, "record longer")
        rests = dict.fromkeys(r.left_out for r in self.regressions if r.left_out)
        yield from (Note("at rest", "says", rest) for rest in rests)
        if self.model.nonlinear:
            one = self.regressions[0]
            text = f"terms that are not linear see the motion up to {one.highest:.4g} Hz"
            turning = f"; signs {'turn between' if one.between else 'are those of the'} samples"
            yield Note("nonlinear", "says", text + turning * bool(one.signs))
        text = (
            f"deviations from {count} blocks of {seconds / count:.3g} s, each left out in turn; "
            "they cover the scatter, and a share of what noise in the motion moves"
        )
        yield Note("blocks", "says", text)

    def _unit(self, free: int) -> str:
        return self.model.base.units[self.elimination.kept[free]]


Problem = LeastSquaresProblem | SampledProblem


@frozen
class LinearEstimator:
    method: ClassVar[str]
    on_samples: ClassVar[bool] = True  # whether it takes records without lines
    # physical parameters (SI, or texts with units) that are substituted
    fixed: Mapping[str, float | str] = field(default_factory=dict, kw_only=True)
    # exact ones, linear in the base parameters
    constraints: tuple[Constraint, ...] = field(default=(), kw_only=True)

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return the estimate of the base parameters.

        Raises
        ------
        InputError
            For records that do not fit the model, or knowledge that only ml can use.
        """
        return self._posed(model, records).summarize(self.method, self._solved)

    def solve(self, model: Model, records: Sequence[Data]) -> tuple[Problem, LeastSquaresSolution]:
        """Return the regression and its solution, without statistics.

        Raises
        ------
        InputError
            As `estimate`.
        """
        problem = self._posed(model, records)
        return problem, self._solved(problem)

    def _posed(self, model: Model, records: Sequence[Data]) -> Problem:
        bound = bind_all(model, records)
        kind: type[Problem] = SampledProblem if filtered_records(bound) else LeastSquaresProblem
        if not self.on_samples:
            refuse_filtered(bound, self.method)
        return kind.of(bound, self.fixed, self.constraints)

    def _solved(self, problem: Problem) -> LeastSquaresSolution:
        return solve(problem.blocks(partial(self._variance, problem)))

    def _variance(self, problem: Problem, regression: Any) -> Floats:
        return np.ones(len(regression.model.texts))


@frozen
class LeastSquares(LinearEstimator):
    """``min |F theta - b|^2`` over all rows and samples alike.

    The derivatives in F are taken as free of noise. They are not: noise in the regressors
    attenuates the estimates, most in rows whose right side is zero, and on the paper's rotor this
    bias is nearly all of the error. The stated deviations cover the scatter, not the bias. On
    samples the bias of white noise is computed and taken off.

    Parameters
    ----------
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    References
    ----------
    Levy and Arogeti, equations (2) and (3).

    Examples
    --------
    >>> LeastSquares(fixed={"L1": 0.3}).fixed
    {'L1': 0.3}
    """

    method = "ls"


@frozen
class Batch(LinearEstimator):
    """``min (F theta - b)' Sigma^-1 (F theta - b)``, Sigma diagonal, all rows at once.

    A row with a measured force has that force's variance at each sample; a row without has
    `free_weight` times the largest of them. The paper calls the free weight k and alpha. A large
    one takes bias away and adds variance.

    Parameters
    ----------
    free_weight : float
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    References
    ----------
    Levy and Arogeti, equations (3), (4), (8) and (9). What (9) calls sigma is a variance.

    Examples
    --------
    >>> Batch(free_weight=10.0).free_weight
    10.0
    """

    method = "batch"
    free_weight: float = 100.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.free_weight) and self.free_weight > 0):
            expected, cure = "a positive number", "take 100, as the paper does"
            raise InputError(f"free_weight {self.free_weight}", expected, cure)

    def _variance(self, problem: Problem, regression: Any) -> Floats:
        variance, free = problem.variance(regression), ~problem.model.input_matrix.any(axis=1)
        largest = np.where(free, 0.0, variance).max(axis=-1, keepdims=True)
        return np.where(free, self.free_weight * np.where(largest > 0, largest, 1.0), variance)


@frozen
class Sequential(LinearEstimator):
    """Weighted least squares in stages, no weight to choose.

    The first stage takes the rows with a measured input, ``D_1 theta_1 = b_1``; each later one the
    rows that share parameters with what is known, ``D_i theta_i = b_i - D_ij theta_j``, the right
    side being forces that the shaft transmits. Each stage is weighted by the variance over
    periods of its right side at each sample.

    Parameters
    ----------
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    Notes
    -----
    The paper's (5) and (6) lack an inverse; its (10) has x2'' where x3'' belongs, its (11) I_p in
    the column of I_p. The stages here are derived from the model, whatever it is.

    References
    ----------
    Levy and Arogeti, equations (5), (6), (10) and (11).

    Examples
    --------
    >>> Sequential().fixed
    {}
    """

    method = "sequential"
    on_samples = False

    def _solved(self, problem: Problem) -> LeastSquaresSolution:
        """Solve stage by stage; the gains carry the error of each stage into the next."""
        count, holds = len(problem.names), (problem.structure != 0).any(axis=0)
        values = np.full(count, np.nan)
        equations = [problem.free_equations(r) for r in problem.regressions]
        gains = [np.zeros((count, *target.shape), dtype=complex) for _, target in equations]
        condition, directions = 1.0, np.zeros((count, 0))
        waiting: list[int] = []
        for planned, _ in problem.stages:
            # Rows whose unknowns the stage before left open wait for the rows of this one.
            rows = [*waiting, *planned]
            own = np.flatnonzero(holds[rows].any(axis=0) & ~np.isfinite(values))
            known = np.flatnonzero(np.isfinite(values))
            designs, blocks = [design[:, rows] for design, _ in equations], list[Block]()
            every = zip(problem.regressions, designs, equations, strict=True)
            for regression, design, (_, target) in every:
                right = target[:, rows] - design[:, :, known] @ values[known]
                variance = _variance(problem, regression, rows, values)
                blocks.append(Block(design[:, :, own], right, variance, regression.record))
            solution = solve(blocks)
            # d theta_i = P_i (e_i - D_ij d theta_j), d theta_j as found before.
            response = sum(
                np.einsum("fkr,krj->fj", gain, design[:, :, known]).real
                for gain, design in zip(solution.gains, designs, strict=True)
            )
            for total, gain in zip(gains, solution.gains, strict=True):
                total[own] = -np.einsum("fj,jkr->fkr", response, total[known])
                total[np.ix_(own, np.arange(total.shape[1]), np.array(rows))] += gain
            values[own] = solution.values
            condition = max(condition, solution.condition_number)
            directions = np.zeros((count, solution.undetermined.shape[1]))
            directions[own] = solution.undetermined
            waiting = [row for row in rows if (holds[row] & np.isnan(values))[own].any()]
        return LeastSquaresSolution(values, tuple(gains), condition, directions)


def _variance(problem: Problem, regression: Regression, rows: list[int], values: Floats) -> Floats:
    """Return the variance over periods of a stage's right side, shape (sample, row)."""
    forced = (regression.model.input_matrix != 0).any(axis=1)[rows]
    variance = problem.variance(regression)[:, rows]
    if forced.all():
        return variance
    base = problem.base(np.where(np.isfinite(values), values, 0.0))
    record = regression.record
    left = -regression.period_residual(base)[..., rows]
    right = synthesize(left, record.harmonics, record.samples)
    power = (right.mean(axis=0) ** 2).mean(axis=0)
    transmitted = pooled(right.var(axis=0, ddof=1), power, record.periods)
    return np.where(forced, variance, transmitted)
