"""The Cramer-Rao bound: what accuracy an experiment can give, before it is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rotorid.answer.estimate import Estimate
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.units import quantity
from rotorid.data.lines import Lines
from rotorid.data.observation import bind
from rotorid.data.record import Channel, Drive, PeriodicRecord
from rotorid.likelihood.fit import Fit
from rotorid.likelihood.other_answers import doubt_notes, other_answers
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.response import simulated
from rotorid.likelihood.solver import Solution
from rotorid.likelihood.summary import summarize
from rotorid.likelihood.symmetric_answers import Mirrors
from rotorid.likelihood.unknowns import unknowns_of
from rotorid.models import Model
from rotorid.models.knowledge import Knowledge
from rotorid.signals.covariance import KNOWN, LineCovariance

if TYPE_CHECKING:
    from rotorid.likelihood.estimator import MaximumLikelihood


@frozen
class Plan:
    """One run of an experiment that is not made yet.

    Parameters
    ----------
    forces : complex array, shape (line, input)
        Lines of the inputs, half the amplitude of a cosine; currents where there are `drives`.
    harmonics : sequence of int
        The multiples of the fundamental that the lines are.
    fundamental, sample_rate : float or str
        Hz.
    periods : int
    noise : mapping of channel name to float
        Standard deviation of white noise per sample, SI or texts with a unit; channels left out
        get a billionth of their size.
    speed : float or str
        rad/s.
    sensors : sequence of Channel or str, optional
        What is read; every coordinate where not given.
    drives : mapping of input name to Drive
        Inputs that are known by their current.
    phase_known : bool

    Examples
    --------
    >>> plan = Plan([[500.0, 0.0]], harmonics=[3], fundamental=10.0, sample_rate=1000.0,
    ...             periods=100, noise={"F_x": 1.0, "F_y": 1.0, "x": 1e-6, "y": 1e-6})
    >>> plan.periods
    100
    """

    forces: ArrayLike
    harmonics: Sequence[int]
    fundamental: float | str
    sample_rate: float | str
    periods: int
    noise: Mapping[str, float | str]
    speed: float | str = 0.0
    sensors: Sequence[Channel | str] | None = None
    drives: Mapping[str, Drive] = field(default_factory=dict)
    phase_known: bool = True

    def record(self, model: Model) -> PeriodicRecord:
        """Return one period as a record whose sensors read nothing yet.

        Raises
        ------
        InputError
            For forces that do not fit the lines and inputs, or a period of no whole samples.
        """
        lines = np.array(self.harmonics, dtype=np.int64)
        forces = np.asarray(self.forces, dtype=np.complex128)
        if forces.shape != (len(lines), len(model.inputs)):
            told, cure = f"forces of shape {forces.shape}", "give one line per harmonic"
            raise InputError(told, f"({len(lines)}, {len(model.inputs)}): (line, input)", cure)
        rate = quantity(self.sample_rate, "Hz", place="sample_rate")
        speed = quantity(self.speed, "rad/s", place="speed")
        exact = rate / quantity(self.fundamental, "Hz", place="fundamental")
        samples = round(exact)
        if abs(exact - samples) > 1e-6 * exact:
            told = f"a period of {exact:.6g} samples"
            raise InputError(told, "a whole number", "change the sample rate")
        read = model.coordinates if self.sensors is None else self.sensors
        channels = [Channel(n, model.units[n], drive=self.drives.get(n)) for n in model.inputs]
        channels += [Channel(s, model.units.get(s, "")) if isinstance(s, str) else s for s in read]
        time = np.arange(samples)[None] / rate
        spectra = np.zeros((1, len(lines), len(channels)), dtype=np.complex128)
        spectra[0, :, : len(model.inputs)] = forces
        blank = np.zeros((samples, len(channels)))
        every, turns = tuple(channels), (speed, time, speed * time, self.phase_known)
        return PeriodicRecord(every, rate, lines, spectra, blank, blank, *turns, source="plan")

    def covariance(self, record: PeriodicRecord) -> LineCovariance:
        """Return the covariance of the mean lines, known exactly."""
        given = ((self.noise.get(c.name, 0.0), c.unit or "1", c.name) for c in record.channels)
        std = np.array([quantity(n, unit, place=f"noise of {name}") for n, unit, name in given])
        variance = np.diag(std**2 / (record.samples * self.periods)).astype(np.complex128)
        matrices = np.repeat(variance[None], len(record.harmonics), axis=0)
        return LineCovariance(matrices, KNOWN, "white")

    def lines(self, model: Model) -> Lines:
        """Return the lines of the run, with a covariance that is known exactly.

        Raises
        ------
        InputError
            As `record`.
        """
        record = self.record(model)
        return Lines.of_periods(record, self.covariance(record))


def predict_accuracy(
    model: Model,
    plans: Plan | Sequence[Plan],
    estimator: MaximumLikelihood | None = None,
    values: Mapping[str, float] | None = None,
) -> Estimate:
    """Return the Cramer-Rao bound: the least deviations that an unbiased estimate can have.

    No data are needed: the motion follows from the model, the excitation and the truth that is
    assumed, the information from the derivative of the likelihood there. With n periods the
    deviations that `MaximumLikelihood` reaches and states are larger by about n / (n - t), t the
    equations per line that the parameters leave over.

    Parameters
    ----------
    model : Model
    plans : Plan or sequence of Plan
        The runs, identified together; none, where measured modes are all there is.
    estimator : MaximumLikelihood, optional
        What is known and what is not, as it will be for the identification.
    values : mapping of str to float, optional
        The truth assumed, in place of the nominal values of the model; nuisances may be among
        them.

    Returns
    -------
    Estimate
        Of method ``bound``: the values assumed, and their bounds as ``std``. Where the plan leaves
        something open its status and its warnings say what, and what would cure it.

    Raises
    ------
    InputError
        For plans that do not fit the model, or a parameter without value.

    Examples
    --------
    >>> from rotorid.models import load_model
    >>> model = load_model("jeffcott")
    >>> plan = Plan([[500.0, 0.0], [0.0, 500.0]], harmonics=[3, 5], fundamental=10.0,
    ...             sample_rate=1000.0, periods=100, speed=2 * np.pi * 30.0,
    ...             noise={"F_x": 1.0, "F_y": 1.0, "x": 1e-6, "y": 1e-6})
    >>> accuracy = predict_accuracy(model, plan)
    >>> accuracy.status, bool(0 < accuracy.std("m") < 0.01 * accuracy.value("m"))
    ('ok', True)
    """
    from rotorid.likelihood.estimator import MaximumLikelihood

    chosen = MaximumLikelihood() if estimator is None else estimator
    runs = [plans] if isinstance(plans, Plan) else list(plans)
    records = tuple(bind(model, plan.lines(model)) for plan in runs)
    known = chosen.knowledge(model)
    truth = {**model.nominal, **(values or {}), **known.fixed}
    guess = _guess(model, truth, known, base=chosen.base)
    told = replace(known, start={**known.start, **guess})
    nuisances = unknowns_of(records, chosen)
    prepared = prepare(model, told, nuisances, chosen.base, guess)
    unknowns = prepared.layout.start
    numbered, layout = enumerate(records), prepared.layout
    likelihoods = tuple(simulated(layout, record, unknowns, k) for k, record in numbered)
    problem = replace(prepared, likelihoods=likelihoods)
    solution = Solution(problem.at(unknowns), True, 0)
    inference, mirrors = solution.inference, Mirrors.of(problem, records, unknowns)
    answers, exchanges = other_answers(mirrors, solution)
    notes = *doubt_notes(problem, answers, exchanges), *mirrors.notes(solution, inference)
    fit = Fit(solution, inference, records, notes, answers)
    estimate = summarize(model, fit)
    return estimate.with_(
        method="bound",
        misfit=None,
        prediction={},
        line_misfit=(),
        periods=min((plan.periods for plan in runs), default=0),
    )


def _guess(
    model: Model, truth: Mapping[str, float], known: Knowledge[float], *, base: bool
) -> dict[str, float]:
    if missing := [name for name in model.parameter_names if name not in truth]:
        told, expected = f"no value of {', '.join(missing)}", "a value of every parameter"
        raise InputError(told, expected, "give values, or nominal values in the model file")
    if not base:
        return dict(truth)
    reduced = model.substitute(known.held(model))
    values = reduced.base_values(reduced.values(truth)).tolist()
    return {**truth, **dict(zip(reduced.base.names, values, strict=True))}
