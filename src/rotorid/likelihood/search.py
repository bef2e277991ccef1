"""A fit in steps: its first minimum at once, then what else there is to ask, a step each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property, partial

from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import EFFORT
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note
from rotorid.core.watch import Pace, watch, words
from rotorid.likelihood.doubts import doubted
from rotorid.likelihood.fit import Fit, Step
from rotorid.likelihood.summary import summarize, trials_of
from rotorid.models import Model

DONE = "done"
"""What the last step says."""
DOUBTING = "asking what may be wrong"
"""What comes last."""
TRYING = "trying possible mistakes"
"""What that is where the data reject the model."""


def _nothing() -> None:
    """Return no answer."""


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
    answer: Callable[[], Estimate | None] = field(default=_nothing, repr=False, compare=False)

    @cached_property
    def best(self) -> Estimate | None:
        """The best answer so far, made when it is first asked for.

        Before the last step it says that the search has not ended, and its status is
        ``not_converged``.
        """
        return self.answer()

    def __repr__(self) -> str:
        return f"<Progress: {words(self.say, self.done, self.of, self.left)}>"


class Search(Iterator[Progress]):
    r"""The steps of an estimate: each is taken when it is asked for.

    Whoever has seen enough asks for no more, and takes the best answer so far: after a
    ``KeyboardInterrupt`` too, which passes through.

    Examples
    --------
    >>> import numpy as np, rotorid as rid
    >>> model = rid.parse_model('''
    ... title = "a free mass"
    ... equations = ["m*x\'\' = F_x"]
    ... coordinates = { x = "m" }
    ... inputs = { F_x = "N" }
    ... parameters = { m = { unit = "kg", nominal = 3.0 } }''')
    >>> angle = np.pi * np.arange(4000) / 100.0
    >>> motion = np.column_stack([-3.0 * np.pi**2 * np.cos(angle), 0.75 * np.cos(angle)])
    >>> noise = np.random.default_rng(1).normal(scale=0.01, size=motion.shape)
    >>> channels = [rid.Channel("F_x"), rid.Channel("x")]
    >>> record = rid.Record(channels, motion + noise, sample_rate=100.0)
    >>> search = rid.MaximumLikelihood().search(model, [rid.average(record, 0.5, harmonics=[1])])
    >>> next(search)
    <Progress: trying further starts, 1 of 12>
    >>> search.best.status, round(search.best.value("m"), 2)
    ('not_converged', 4.0)
    >>> search.finish().status
    'ok'
    """

    def __init__(self, steps: Iterator[Progress]) -> None:
        self._steps = steps
        self._pace = Pace()
        self._last: Progress | None = None

    def __next__(self) -> Progress:
        """Take the next step."""
        if self._last is None:
            watch("looking for the first minimum")
        step = next(self._steps)
        if step.say != DONE:
            watch(step.say, step.done, step.of)
        self._last = replace(step, left=self._pace.left(step.say, step.done, step.of))
        return self._last

    @property
    def best(self) -> Estimate | None:
        """The best answer so far: None before the first step, the estimate after the last."""
        return None if self._last is None else self._last.best

    def finish(self) -> Estimate:
        """Take the steps that are left, and return the estimate."""
        for _ in self:
            pass
        estimate = self.best
        assert estimate is not None  # the last step has one
        return estimate


def answers(model: Model, steps: Iterator[Step], *, quick: bool) -> Iterator[Progress]:
    """Yield the answer so far at each step of a fit, and at last the estimate.

    With little effort the first minimum is the last step.
    """
    for step in steps:
        if quick:
            yield Progress(DONE, answer=partial(_first, model, step))
            return
        yield Progress(step.say, step.done, step.of, answer=partial(_so_far, model, step))
    causes: Callable[[], tuple[Note, ...]] = tuple
    step = replace(step, say=TRYING)
    for trial in trials_of(step.best):
        causes = trial.causes
        so_far = partial(_so_far, model, step, causes)
        yield Progress(TRYING, trial.done, trial.of, answer=so_far)
    estimate = _answer(model, step, causes())
    yield Progress(DONE, answer=lambda: estimate)


def _model_of(model: Model, fit: Fit) -> Model:
    """Return the model of a fit, which may be a rotor with fewer shapes."""
    return fit.records[0].model if fit.records else model


def _answer(model: Model, step: Step, causes: Sequence[Note] = ()) -> Estimate:
    """Return the answer at a step, with all doubts about it that are cheap."""
    fit = step.best
    own = _model_of(model, fit)
    return doubted(own, summarize(own, fit, causes), fit)


def _so_far(model: Model, step: Step, causes: Callable[[], tuple[Note, ...]] = tuple) -> Estimate:
    """Return the answer at a step that is not the last."""
    told = f"the search was stopped while {step.say}: this is the best answer so far"
    note = Note("interrupted", "unfinished", told, "let the search run to its end")
    return _ended_by(note, _answer(model, step, causes()))


def _first(model: Model, step: Step) -> Estimate:
    """Return the first minimum as an answer: a doubtful one, and none that noise excludes."""
    estimate = _answer(model, step)
    none = any(note.severity in ("rejects", "unfinished") for note in estimate.notes)
    told = (
        "neither a lower one nor a mistake that explains its misfit was looked for"
        if none
        else "whether other answers fit as well was not asked"
    )
    note = Note(
        EFFORT,
        "unfinished" if none else "doubts",
        f"the first minimum, with little effort: {told}",
        "identify with full effort",
    )
    return _ended_by(note, estimate)


def _ended_by(note: Note, estimate: Estimate) -> Estimate:
    """Return an answer of a search that did not end by itself, and so came to nothing else."""
    kept = tuple(other for other in estimate.notes if other.about != "search")
    return estimate.with_(notes=kept).with_notes(note)
