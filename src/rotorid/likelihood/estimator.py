"""Maximum likelihood with noise in forces and positions, from any set of sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, fields
from functools import partial
from typing import Literal

from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError, NotConvergedError
from rotorid.core.frozen import frozen
from rotorid.data.measured_modes import Mode, in_units_of
from rotorid.data.observation import Data, Observation, bind_all
from rotorid.likelihood.fit import Fit, Rough, Step, answered, approached, located
from rotorid.likelihood.layout import linear_form
from rotorid.likelihood.preparation import Knowledge
from rotorid.likelihood.search import DONE, DOUBTING, Progress, Search, answers
from rotorid.likelihood.starts import FINER, NEGLIGIBLE, ROUGH, SHARE, reduced, shift_by_reduction
from rotorid.likelihood.summary import nothing_found
from rotorid.likelihood.unknowns import Nuisances
from rotorid.linear.by_samples import refuse_filtered
from rotorid.models import Model
from rotorid.models.priors import Bounds, Constraint, bounds_in_si, constraints_in_si, in_si


@frozen
class MaximumLikelihood:
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
    runout : bool
        Each position sensor reads an unknown 1x runout, common to all records.
    gains : sequence of {"ki", "ks", "ks*"}
        Constants of the force laws to estimate: the force per current of each input; the force
        per displacement, one for all or one per input.
    delays : sequence of {"force", "position"}
        One unknown delay common to all channels of the kind.
    each : sequence of str
        Parameters that every record has to itself: ``u_x[0]``, ``u_x[1]``, names that may stand
        in `fixed`, `known` and `start` too.
    modes : sequence of Mode
        Measured natural frequencies and damping ratios, beside the records or without any.
    force_scale_std : float
        Relative deviation of a scale common to all forces, `scale[force]`; 0 takes it as exact.
    base : bool
        Estimate the base parameters.
    covariance : {"auto", "white", "correlated"}
        Of the mean lines: from the scatter between periods, from neighbouring lines, or whichever
        the residual asks for.
    neighbours : int, optional
        Lines on each side for the correlated covariance.
    effort : {"full", "quick"}
        "quick" ends at the first minimum: neither other answers nor mistakes are looked for, and a
        note says so.

    References
    ----------
    Pintelon and Schoukens, System Identification: A Frequency Domain Approach; see the chapter on
    maximum likelihood in the documentation.

    Examples
    --------
    >>> MaximumLikelihood(fixed={"L1": 0.3}).fixed
    {'L1': 0.3}
    """

    fixed: Mapping[str, float | str] = field(default_factory=dict)
    constraints: tuple[Constraint, ...] = ()
    known: Mapping[str, tuple[float | str, float | str]] = field(default_factory=dict)
    start: Mapping[str, float | str] = field(default_factory=dict)
    bounds: Bounds = field(default_factory=dict)
    runout: bool = False
    gains: tuple[str, ...] = ()
    delays: tuple[str, ...] = ()
    each: tuple[str, ...] = ()
    modes: tuple[Mode, ...] = ()
    force_scale_std: float = 0.0
    base: bool = False
    covariance: Literal["auto", "white", "correlated"] = "auto"
    neighbours: int | None = None
    effort: Literal["full", "quick"] = "full"

    def __post_init__(self) -> None:
        if self.covariance not in ("auto", "white", "correlated"):
            raise InputError(
                f"covariance {self.covariance!r}",
                "auto, white or correlated",
                "choose one of the three; auto looks at the periods",
            )
        if self.effort not in ("full", "quick"):
            raise InputError(
                f"effort {self.effort!r}",
                "full or quick",
                "choose one of the two; quick ends at the first minimum",
            )
        for name in ("constraints", "gains", "delays", "each", "modes"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        _ = self.nuisances

    def knowledge(self, model: Model) -> Knowledge:
        """Return what is known beforehand of the parameters of a model, in SI.

        Raises
        ------
        InputError
            For a text that is no quantity of its parameter's unit.
        """
        pairs = self.known.items()
        values = in_si({name: pair[0] for name, pair in pairs}, model)
        deviations = in_si({name: pair[1] for name, pair in pairs}, model)
        return Knowledge(
            in_si(self.fixed, model),
            {name: (value, deviations[name]) for name, value in values.items()},
            in_si(self.start, model),
            constraints_in_si(self.constraints, model),
            bounds_in_si(self.bounds, model),
            tuple(in_units_of(model, mode) for mode in self.modes),
        )

    @property
    def nuisances(self) -> Nuisances:
        """Which constants of the measurement are unknown."""
        return Nuisances(**{key.name: getattr(self, key.name) for key in fields(Nuisances)})

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
        linear_form(model)
        _check_each(model, self.each)
        knowledge = self.knowledge(model)
        bound = bind_all(model, records) if records or not self.modes else ()
        refuse_filtered(bound, "ml")
        return Search(self._answers(model, bound, knowledge))

    def _answers(
        self, model: Model, bound: Sequence[Observation], knowledge: Knowledge
    ) -> Iterator[Progress]:
        try:
            steps = self._fitted(model, bound, knowledge)
            yield from answers(model, steps, quick=self.effort == "quick")
        except NotConvergedError as error:
            none = nothing_found(model, bound, knowledge.fixed, str(error))
            yield Progress(DONE, answer=lambda: none)

    def _fitted(
        self, model: Model, bound: Sequence[Observation], knowledge: Knowledge
    ) -> Iterator[Step]:
        """Fit; where the model is reduced, until the whole one would not move the estimate.

        The last step has the answer.
        """

        def found(records: Sequence[Observation], rough: Rough | None = None) -> Iterator[Step]:
            return located(
                records[0].model if records else model,
                records,
                knowledge,
                self.nuisances,
                base=self.base,
                covariance=self.covariance,
                neighbours=self.neighbours,
                rough=rough,
            )

        records: Sequence[Observation] = bound
        if bound and not self.base:
            known = {name: pair[0] for name, pair in knowledge.known.items()}
            values = {**known, **knowledge.start, **knowledge.fixed}
            records = reduced(bound, values, knowledge.modes, ROUGH)
        if not records or records[0].model is model:
            for step in found(bound):
                yield step
            yield Step(answered(step.fit), DOUBTING)
            return
        share = SHARE
        rough = approached(records, knowledge, self.nuisances, partial(reduced, bound, share=share))
        while True:
            records = reduced(bound, values if rough is None else rough.values, share=share)
            for step in found(records, rough):
                yield step
            at = step.fit
            whole = records[0].model is model
            if whole or _stands(at):
                answer = answered(at)
                if whole or answer.solution is at.solution or _stands(answer):
                    yield Step(answer, DOUBTING)
                    return
                at = answer
            rough = Rough.of(at, rough)
            share *= FINER


def _stands(found: Fit) -> bool:
    """Tell whether the whole rotor would not move what was found with a reduced one."""
    covariance = found.inference.covariance
    return shift_by_reduction(found.solution.point, covariance, found.records) <= NEGLIGIBLE


def _check_each(model: Model, each: Sequence[str]) -> None:
    """Refuse names of parameters that the model does not have."""
    for name in each:
        if name not in model.parameter_names:
            raise InputError(
                f"each of {name!r}",
                f"a parameter of the model: {', '.join(model.parameter_names)}",
                "take a name from there",
                place="each",
            )
