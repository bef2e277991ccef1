"""Maximum likelihood with noise in forces and positions, from any set of sensors.

A fit goes in steps: its first minimum at once, then what else there is to ask, a step each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Literal

from threadpoolctl import ThreadpoolController

from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import EFFORT
from rotorid.core.errors import NotConvergedError, require_each, require_names
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note, Severity
from rotorid.core.watch import Pace, watch, words
from rotorid.data.observation import Data, Records, bind_all, refuse_unread
from rotorid.likelihood.doubts import doubted
from rotorid.likelihood.fit import FIRST, CovarianceChoice, Fitting, Step
from rotorid.likelihood.rivals import Tried
from rotorid.likelihood.summary import nothing_found, summarize, trials_of
from rotorid.likelihood.unknowns import Nuisances
from rotorid.linear.estimators import refuse_filtered
from rotorid.models import Model
from rotorid.models.knowledge import Constraint, Knowledge, Mode

EFFORTS = {"quick": 0, "normal": 1, "thorough": 3}
"""Times as many further starts, when looking for the minimum and for other answers, and as many
mistakes refitted, as are enough nearly always; with 0 the first minimum is the answer."""
DONE = "done"  # what the last step says
TRYING = "trying possible mistakes"  # what that is where the data reject the model
NOTHING_TRIED = Tried()


@frozen
class Progress:
    """A step of a search: what comes next, how far that is, and the best answer so far.

    Parameters
    ----------
    say : str
        What is done next, such as "trying further starts"; "done" at the end.
    done : int
        How much of it is done.
    of : int, optional
        How much of it there is at most; None where nobody knows.
    left : float, optional
        Seconds that it still takes, by what was done of it; None where nothing tells.
    found : str
        The misfit of the best answer so far, and what noise would leave.
    answer : callable
        Makes `best`.

    Examples
    --------
    >>> Progress("trying further starts", 3, 12, left=19.7)
    <Progress: trying further starts, 3 of 12, about 20 s left>
    """

    say: str
    done: int = 0
    of: int | None = None
    left: float | None = None
    found: str = field(default="", repr=False)
    answer: Callable[[], Estimate | None] | None = field(default=None, repr=False, compare=False)

    @cached_property
    def best(self) -> Estimate | None:
        """The best answer so far, made when it is first asked for.

        Before the last step it says that the search has not ended, and its status is
        ``not_converged``.
        """
        return self.answer and self.answer()

    def __repr__(self) -> str:
        return f"<Progress: {words(self.say, self.done, self.of, self.left)}>"


class Search(Iterator[Progress]):
    """The steps of an estimate: each is taken when it is asked for.

    Whoever has seen enough asks for no more, and takes the best answer so far: after a
    ``KeyboardInterrupt`` too, which passes through. Steps are taken on one thread of the linear
    algebra: its matrices are so small that threads only wait for each other.
    """

    def __init__(self, steps: Iterator[Progress]) -> None:
        self._steps = steps
        self._threads = ThreadpoolController()
        self._pace = Pace()
        self._last: Progress | None = None

    def __next__(self) -> Progress:
        if self._last is None:
            watch(FIRST)
        with self._threads.limit(limits=1, user_api="blas"):
            step = next(self._steps)
        if step.say != DONE:
            watch(step.say, step.done, step.of, step.found)
        self._last = replace(step, left=self._pace.left(step.say, step.done, step.of))
        return self._last if step.say != FIRST else next(self)  # which passes the interrupt on

    @property
    def best(self) -> Estimate | None:
        """The best answer so far: None before the first step, the estimate after the last."""
        with self._threads.limit(limits=1, user_api="blas"):
            return None if self._last is None else self._last.best

    def finish(self) -> Estimate:
        for _ in self:
            pass
        estimate = self.best
        assert estimate is not None  # the last step has one
        return estimate


def _answer(model: Model, step: Step, trial: Tried = NOTHING_TRIED) -> Estimate:
    fit = step.best
    own = fit.records[0].model if fit.records else model  # perhaps a rotor with fewer shapes
    return doubted(own, summarize(own, fit, trial.notes), fit, speed=trial.speed)


def _so_far(model: Model, step: Step, trial: Tried = NOTHING_TRIED) -> Estimate:
    told = f"the search was stopped while {step.say}: this is the best answer so far"
    note = Note("interrupted", "unfinished", told, "let the search run to its end")
    return _ended_by(note, _answer(model, step, trial))


def _first(model: Model, step: Step) -> Estimate:
    """Return the first minimum as an answer: a doubtful one, and none that noise excludes."""
    estimate = _answer(model, step)
    none = any(note.severity in ("rejects", "unfinished") for note in estimate.notes)
    told = (
        "neither a lower one nor a mistake that explains its misfit was looked for"
        if none
        else "whether other answers fit as well was not asked"
    )
    severity: Severity = "unfinished" if none else "doubts"
    text = f"the first minimum, with little effort: {told}"
    return _ended_by(Note(EFFORT, severity, text, 'identify with effort = "normal"'), estimate)


def _ended_by(note: Note, estimate: Estimate) -> Estimate:
    """Return an answer of a search that did not end by itself, and so came to nothing else."""
    kept = tuple(other for other in estimate.notes if other.about != "search")
    return estimate.with_(notes=kept).with_notes(note)


@frozen
class MaximumLikelihood(Nuisances, Knowledge[float | str]):
    """``min sum_k c_k e_k^H V_k^-1 e_k`` over the lines: efficient, with error bars that hold.

    Forces and positions carry noise whose covariance is taken from the record itself; the true
    lines are profiled out, coordinates without a sensor are projected out. The parameters are the
    physical ones, or the base ones on request.

    Parameters
    ----------
    fixed : mapping of str to float
        Exact values of parameters or of nuisances: SI, or texts with units.
    constraints : sequence of Constraint
        Polynomials in the parameters that are known: exactly, and then eliminated, or with a
        deviation.
    known : mapping of str to (value, std)
        Values known with a deviation.
    start : mapping of str to float
        Where to start; else from batch, where every coordinate is measured, or from the nominal
        values, with the unbalance from zero.
    bounds : mapping of str to (lower, upper)
        Expressions such as ``"2*I_t - I_p"`` kept within bounds; parameters that the model calls
        positive are kept so anyway.
    modes : sequence of Mode
        Measured natural frequencies and damping ratios, beside the records or without any.
    base : bool
        Estimate the base parameters.
    covariance : {"auto", "white", "correlated"}
        Of the mean lines: from the scatter between periods, from neighbouring lines, or whichever
        the residual asks for.
    neighbours : int, optional
        Lines on each side for the correlated covariance.
    effort : {"quick", "normal", "thorough"}
        "quick" ends at the first minimum: neither other answers nor mistakes are looked for, and a
        note says so. "thorough" takes three times as many starts, and refits as many mistakes.

    References
    ----------
    Pintelon and Schoukens, System Identification: A Frequency Domain Approach; see the chapter on
    maximum likelihood in the documentation.

    Examples
    --------
    >>> MaximumLikelihood(fixed={"L1": 0.3}).fixed
    {'L1': 0.3}
    """

    base: bool = False
    covariance: CovarianceChoice = "auto"
    neighbours: int | None = None
    effort: Literal["quick", "normal", "thorough"] = "normal"

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, choices, cure in (
            ("covariance", ("auto", "white", "correlated"), "auto looks at the periods"),
            ("effort", tuple(EFFORTS), "quick ends at the first minimum"),
        ):
            require_names([getattr(self, key)], choices, f"{key} {{}}", f"choose one; {cure}")
        for name, kind in (("constraints", Constraint), ("modes", Mode)):
            object.__setattr__(self, name, require_each(getattr(self, name), kind, place=name))

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return the estimate; its status says whether there is one.

        Raises
        ------
        InputError
            For records that do not fit the model, knowledge that contradicts itself, or no start.
        ModelError
            Where the model is not linear in its coordinates.
        """
        return self.search(model, records).finish()

    def search(self, model: Model, records: Sequence[Data]) -> Search:
        """Return the estimate in steps: the first minimum at once, then what else there is to ask.

        Parameters
        ----------
        model : Model
        records : sequence of PeriodicRecord or Lines

        Returns
        -------
        Search
            An iterator; its last step has what `estimate` returns.

        Raises
        ------
        InputError, ModelError
            As `estimate`, here or at a step.
        """
        model.require_linear()
        require_names(self.each, model.parameter_names, "each of {}", place="each")
        knowledge = self.knowledge(model)
        bound: Records = ()
        if records or not self.modes:
            bound = bind_all(model, records)
        else:
            refuse_unread(model, bound)
        refuse_filtered(bound, "ml")
        return Search(self._answers(model, bound, knowledge))

    def _answers(self, model: Model, bound: Records, known: Knowledge[float]) -> Iterator[Progress]:
        """Yield the answer so far at each step of a fit, and at last the estimate."""
        times = EFFORTS[self.effort]
        how = self.base, self.covariance, self.neighbours, max(1, times)
        fitting = Fitting(model, known, self, *how)
        try:
            for step in fitting.steps(bound):
                if not times and step.say != FIRST:  # the first minimum is the last step
                    yield Progress(DONE, answer=partial(_first, model, step))
                    return
                so_far = partial(_so_far, model, step)
                yield Progress(step.say, step.done, step.of, found=step.found, answer=so_far)
        except NotConvergedError as error:
            none = nothing_found(model, bound, known.fixed, str(error))
            yield Progress(DONE, answer=lambda: none)
            return
        trial, step = NOTHING_TRIED, replace(step, say=TRYING)
        for trial in trials_of(step.best):
            so_far = partial(_so_far, model, step, trial)
            yield Progress(TRYING, trial.done, trial.of, found=step.found, answer=so_far)
        estimate = _answer(model, step, trial)
        yield Progress(DONE, answer=lambda: estimate)
