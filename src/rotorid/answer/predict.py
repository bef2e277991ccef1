"""How well an estimate predicts a record, its own or better another one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from rotorid.answer.derived import base_of
from rotorid.answer.estimate import Estimate, Prediction, check_units
from rotorid.core.errors import InputError
from rotorid.data.observation import Data, Observation, bind_all
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.problem import Point
from rotorid.likelihood.response import by_likelihood
from rotorid.likelihood.unknowns import Nuisances, own_parameters, unknowns_of
from rotorid.linear.estimators import filtered_records
from rotorid.linear.regression import Predicted, Regression, SampledRegression, relative_errors
from rotorid.models import Model
from rotorid.models.knowledge import Knowledge


def predict(
    model: Model, estimate: Estimate, records: Data | Sequence[Data]
) -> dict[str, Prediction | None]:
    """Return how well an estimate predicts records, channel by channel.

    Where every coordinate is measured, inputs are predicted: what the equations of motion leave
    over is laid to the inputs, ``B u = Z q - g``. Where some are hidden, readings are:
    ``y = C Z^-1 (B u + g)``.

    Parameters
    ----------
    model : Model
        The one that was identified.
    estimate : Estimate
    records : PeriodicRecord, Lines or FilteredRecord, or sequence of them
        The same records, or better other ones.

    Returns
    -------
    dict of channel name to Prediction
        ``|lines(measured - predicted)| / |lines(measured)|``; ``None`` for a channel that is zero.

    Raises
    ------
    InputError
        For an estimate that is not of this model, or that lacks values, and for a rotor angle of
        unknown phase.

    References
    ----------
    Levy and Arogeti, equation (12).

    Examples
    --------
    >>> import rotorid as rid
    >>> model = rid.load_model("jeffcott")
    >>> turn = 2 * np.pi * np.arange(100) / 100
    >>> forces = np.column_stack([400.0 * np.cos(3 * turn), 300.0 * np.sin(5 * turn)])
    >>> values = model.values(model.nominal)
    >>> record = rid.simulate(model, values, forces, sample_rate=1000.0, periods=3,
    ...                       speed=2 * np.pi * 30.0)
    >>> periods = rid.average(record, 10.0, harmonics=[1, 3, 5])
    >>> estimate = rid.identify(model, periods, rid.LeastSquares())
    >>> predict(model, estimate, periods)["F_x"].relative_error < 1e-3
    True
    """
    data = records if isinstance(records, Sequence) else [records]
    return relative_errors(predict_lines(model, estimate, data))


def predict_lines(
    model: Model, estimate: Estimate, records: Sequence[Data], first: int = 0
) -> list[Predicted]:
    """Return the lines that an estimate predicts, record by record, beside the measured ones.

    What every record has to itself is taken from the record of the same number, `first` that of
    the first one here.
    """
    for number, record in enumerate(records, start=first):
        own = record.own if isinstance(record, Observation) else record.parameters
        _check(model, estimate, number, own)
    bound = bind_all(model, records)
    filtered = filtered_records(bound)
    if filtered or model.linear is None:
        reduced = model.substitute({v.name: v.value for v in estimate.parameters if v.fixed})
        found = base_of(reduced, estimate, physical=False)
        assert found is not None  # all values are there
        equations = SampledRegression if filtered else Regression
        return [equations(replace(r, model=reduced)).predicted(found[0]) for r in bound]
    return by_likelihood(bound, _at_estimate(model, estimate, bound, first).records)


def missing_values(
    model: Model, estimate: Estimate, number: int = 0, given: Iterable[str] = ()
) -> list[str]:
    """Return what the model needs and neither estimate nor record names, physical or base.

    `number` is that of the record, `given` the parameters that it states itself.
    """
    found = {v.name for v in estimate.parameters}
    names = model.parameter_names
    told = {*given, *(n for n in names if n in found or f"{n}[{number}]" in found)}
    if {*names} <= told:
        return []
    if any(f"{n}[{k}]" in found for n in names for k in (0, number)):
        return [n for n in names if n not in told]
    fixed = {v.name: v.value for v in estimate.parameters if v.fixed}
    if not fixed.keys() <= {*model.parameter_names}:
        return sorted(fixed.keys() - {*model.parameter_names})
    return [name for name in model.substitute(fixed).base.names if name not in found]


def _at_estimate(
    model: Model, estimate: Estimate, records: Sequence[Observation], first: int
) -> Point:
    values = {v.name: v.value for v in (*estimate.parameters, *estimate.nuisance)}
    numbered, names = list[Observation](), model.parameter_names
    for number, record in enumerate(records, first):
        if not record.lines.phase_known:
            raise InputError(
                "a rotor angle of unknown phase",
                "a known phase",
                "give the phase, or a keyphasor or angle column",
                file=record.lines.source,
            )
        found = {n: values[f"{n}[{number}]"] for n in names if f"{n}[{number}]" in values}
        numbered.append(replace(record, own={**found, **record.own}))
    own = own_parameters(numbered, Nuisances())
    base = not {*names} <= values.keys() | {name for n in own for name in n.on}
    # The phase of a record is its own, and says nothing of another's.
    shared = [
        n
        for n in unknowns_of(records)
        if {u.name for u in n.scalars} <= values.keys() and n.record is None
    ]
    # Parameters of the estimate's single records are in `own`, under the numbers of these ones.
    single = {f"{n}[{k}]" for n in names for k in range(len(values))}
    held = {v.name: v.value for v in estimate.parameters if v.fixed and v.name not in single}
    known = {v.name for v in estimate.parameters} - single | {
        u.name for n in shared for u in n.scalars
    }
    start = {name: values[name] for name in known - held.keys()}
    prepared = prepare(model, Knowledge(fixed=held, start=start), [*own, *shared], base, {})
    return prepared.of(records).at(prepared.layout.start)


def _check(model: Model, estimate: Estimate, number: int, given: Iterable[str]) -> None:
    missing = missing_values(model, estimate, number, given)
    if missing:
        raise InputError(
            f"a result of {estimate.model!r} without {missing[0]!r}",
            f"the parameters of {model.name!r}: {', '.join(model.parameter_names)}, or its base "
            f"parameters: {', '.join(model.base.names)}",
            "use the result and the experiment of one model",
        )
    check_units(estimate, model.parameter_units)
    unknown = [value.name for value in estimate.parameters if not np.isfinite(value.value)]
    if unknown:
        raise InputError(
            f"a result that leaves {', '.join(unknown)} undetermined",
            "a value of every parameter",
            "fix one or measure more, then identify again",
        )
