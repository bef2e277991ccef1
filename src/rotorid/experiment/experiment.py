"""Experiment files to models, records and an estimator."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from rotorid.answer.estimate import Estimate
from rotorid.answer.identify import Estimator
from rotorid.core.errors import InputError, ReadError, naming, require_names, require_type
from rotorid.core.frozen import frozen
from rotorid.core.toml import members, parse_table, parse_toml, read_bytes, read_toml, table_within
from rotorid.core.units import to_si
from rotorid.core.watch import counting
from rotorid.data.filtered import filtered
from rotorid.data.lines import Lines
from rotorid.data.observation import Measured
from rotorid.data.order_tracking import phasors
from rotorid.data.record import Record
from rotorid.experiment import read, schema
from rotorid.experiment.duplicates import Overlaps, check_file
from rotorid.io import READERS, read_record
from rotorid.models import Model, load_model
from rotorid.models.equations import polynomial
from rotorid.models.knowledge import Constraint, Knowledge, Mode, in_units_of, unit_of_expression
from rotorid.models.model import Parameter
from rotorid.signals.angle import mark_angle
from rotorid.signals.average import KEYS
from rotorid.signals.inspection import Inspection, LineInspection, inspect_lines, inspect_record


@frozen
class Experiment:
    """What an experiment file says; its records are read when they are asked for.

    Parameters
    ----------
    file : str
        The experiment file, for messages.
    folder : Path
        Where the files of the records lie.
    entry : ExperimentFile
    model : Model
    channels : sequence of Recording
        Where the channels of each record come from.
    priors : Knowledge
        What is known beforehand.
    """

    file: str
    folder: Path
    entry: schema.ExperimentFile
    model: Model
    channels: tuple[read.Recording, ...]
    priors: Knowledge[float]

    @property
    def fixed(self) -> dict[str, float]:
        """Fixed parameters in SI."""
        return dict(self.priors.fixed)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """What is known of combinations of parameters beforehand."""
        return self.priors.constraints

    @property
    def files(self) -> list[Path]:
        """The files that are read: the experiment, its model, its records, what goes with them."""
        said = members(self.entry.model_dump())
        tables = (name for place, name in said if place.endswith(".dynamics.table") and name)
        return [
            Path(self.file),
            Path(self.file).parent / self.entry.model,
            *self.record_files,
            *(self.folder / r.quiet for r in self.entry.records if r.quiet is not None),
            *(self.folder / name for name in tables),
        ]

    @property
    def record_files(self) -> list[Path]:
        """The files of the records themselves."""
        return [path for plan in self.channels for path in plan.paths]

    def measured(self, method: schema.Method | None = None) -> list[Record]:
        """Read the samples of every record.

        Parameters
        ----------
        method : {"ls", "batch", "sequential", "ml"}, optional
            In place of the file's. Maximum likelihood takes the currents of linear force laws as
            they are; the others take forces.

        Raises
        ------
        InputError
            For files, columns, units and samples that cannot be used.
        """
        for number, entry in enumerate(self.entry.records):
            if entry.channel_kind != "samples":
                raise InputError(
                    f"a table of {entry.kind}",
                    "samples over time",
                    "take its lines, records(), or leave it out",
                    file=self.file,
                    place=f"records.{number}.kind",
                )
        currents = self.method(method) == "ml"
        return [read.measured(replace(plan, currents=currents)) for plan in self.channels]

    def require_records(self) -> None:
        """Refuse an experiment of measured natural frequencies alone.

        Raises
        ------
        InputError
            Where there is no record.
        """
        if not self.entry.records:
            found = "natural frequencies alone"
            cure = "add one; rotorid identify needs none"
            raise InputError(found, "a record: [[records]]", cure, file=self.file, place="records")

    def method(self, method: schema.Method | None = None) -> schema.Method:
        """Return the method to use: the one given, the file's, or what the model allows."""
        filtered = any(record.cutoff is not None for record in self.entry.records)
        allowed: schema.Method = "batch" if filtered or self.model.linear is None else "ml"
        return method or self.entry.estimator.method or allowed

    def _observed(self, *, currents: bool) -> list[Measured]:
        """Read every record: cut into periods, as the lines of the whole, or filtered."""
        found: list[Measured] = []
        seen = Overlaps(self.channels, self.file)
        for plan in counting(self.channels, "reading records"):
            try:
                several = _one(replace(plan, currents=currents), seen)
            except InputError as error:
                if error.place not in KEYS:
                    raise
                place = f"{plan.place}.{error.place}"
                raise InputError(
                    error.found, error.expected, error.cure, file=self.file, place=place
                ) from None
            told = read.shared_currents(plan)
            for one in several:
                said = replace(one, warnings=(*one.warnings, *told)) if told else one
                found.append(said.with_parameters(**plan.own) if plan.own else said)
        return seen.checked(found)

    @cached_property
    def _read(self) -> dict[bool, list[Measured]]:
        """What was read, with currents or with forces."""
        return {}

    def records(self, method: schema.Method | None = None) -> list[Measured]:
        """Read every record and cut it into periods, take the lines of the whole, or filter it.

        Parameters
        ----------
        method : {"ls", "batch", "sequential", "ml"}, optional
            As for `measured`.

        Raises
        ------
        InputError
            As `measured`, and for periods or lines that the record does not have.
        """
        # Without laws of force there is no current, and one reading serves both.
        currents = self.method(method) == "ml" or not any(plan.laws for plan in self.channels)
        if currents not in self._read:
            self._read[currents] = self._observed(currents=currents)
        return list(self._read[currents])

    def estimator(
        self, method: schema.Method | None = None, effort: schema.Effort | None = None
    ) -> Estimator:
        """Return the estimator that the file asks for, or that of another method.

        Parameters
        ----------
        method : {"ls", "batch", "sequential", "ml"}, optional
            In place of the file's.
        effort : {"quick", "normal", "thorough"}, optional
            Of maximum likelihood, in place of the file's.

        Raises
        ------
        InputError
            For a method that cannot honour what the file says.
        """
        method, entry = self.method(method), self.entry
        with naming(self.file):
            if method == "ml":
                from rotorid.likelihood.estimator import MaximumLikelihood

                return MaximumLikelihood(
                    **vars(replace(self.priors, modes=_modes(entry, self.model))),
                    **entry.estimator.unknown,
                    each=tuple(name for name, p in entry.parameters.items() if p.each),
                    effort=effort or entry.estimator.effort,
                )
            for place, found, expected in _of_ml_alone(entry):
                raise InputError(found, f"{expected} for this method", "use ml", place=place)
            from rotorid.linear.estimators import Batch, LeastSquares, Sequential

            told: dict[str, Any] = {"fixed": self.priors.fixed, "constraints": self.constraints}
            if method == "batch":
                return Batch(free_weight=entry.estimator.free_weight, **told)
            return (LeastSquares if method == "ls" else Sequential)(**told)

    def identify(self, method: schema.Method | None = None) -> Estimate:
        """Read the records and estimate, as ``rotorid identify`` does.

        Parameters
        ----------
        method : {"ls", "batch", "sequential", "ml"}, optional
            In place of the file's.

        Returns
        -------
        Estimate

        Raises
        ------
        InputError
            As `records`, `estimator` and `rotorid.identify`.
        """
        from rotorid.answer.identify import identify  # to read a file needs none of it

        with naming(self.file):
            return identify(self.model, self.records(method), self.estimator(method))


def load_experiment(path: str | Path, *, folder: str | Path | None = None) -> Experiment:
    """Read an experiment file.

    Parameters
    ----------
    path : str or Path
    folder : str or Path, optional
        Where the files of the records lie; without it, where the experiment file lies.

    Returns
    -------
    Experiment

    Raises
    ------
    InputError
        For a file that cannot be read, or says what cannot be done, with the key.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "run.toml"
    >>> _ = path.write_text('''
    ... model = "jeffcott"
    ... [[records]]
    ... file = "run.csv"
    ... sample_rate = "2 kHz"
    ... fundamental = "10 Hz"
    ... harmonics = [1, 2]
    ... [channels]
    ... F_x = { column = "fx", unit = "N" }
    ... F_y = { column = "fy", unit = "N" }
    ... x = { column = "x", unit = "um" }
    ... y = { column = "y", unit = "um" }''')
    >>> load_experiment(path).model.name
    'jeffcott'
    """
    require_type(path, str, Path, place="path")
    path = Path(path)
    ending = path.suffix.lower()
    if ending in READERS and ending != ".txt" and os.path.exists(path):
        expected = "an experiment file, which says what is in the records"
        cure = f"write one: rotorid new {path} --model three-mass --out experiment.toml"
        raise ReadError(f"a file of the ending {ending}, a record", expected, cure, file=str(path))
    entry = read_toml(path, schema.ExperimentFile)
    where = path.parent if folder is None else Path(folder)
    try:
        model = load_model(entry.model, folder=path.parent)
    except InputError as error:
        raise error if error.file else error.at(file=str(path), place="model") from None
    with naming(str(path)):
        plans = []
        read.check_shared(entry.records, entry.channels)
        for number, record in enumerate(entry.records):
            plan = read.plan_record(number, record, entry.channels, model, where)
            own = own_values(record.parameters, model, f"{plan.place}.parameters")
            plans.append(replace(plan, own=own))
        names = ["force", "position", *dict.fromkeys(name for p in plans for name in p.channels)]
        require_names(entry.estimator.unknown["delays"], names, place="estimator.delays")
        check_file(entry, plans)
        return Experiment(
            file=str(path),
            folder=where,
            entry=entry,
            model=model,
            channels=tuple(plans),
            priors=knowledge_of(entry, model),
        )


def _one(plan: read.Recording, seen: Overlaps) -> Sequence[Measured]:
    """Read one record by what is made of it; responses to several inputs are several."""
    entry, skip = plan.entry, plan.entry.skip or 0.0
    if entry.channel_kind != "samples":
        return _read_table(plan)
    if entry.made == "periods":
        return [read.averaged(plan, partial(seen.begin, plan))]
    record = read.measured(plan)
    seen.begin(plan, record)(record.samples)
    if entry.made == "run-up":
        return [phasors(record, entry.revolutions, skip=skip)]
    if entry.cutoff is not None:
        steps, left_out = entry.decimate or 1, entry.leave_out or ()
        return [filtered(record, entry.cutoff, decimate=steps, leave_out=left_out, skip=skip)]
    seen.turns(plan, record)
    return [read.lines_of(plan, record)]


def _read_table(plan: read.Recording) -> Sequence[Lines]:
    from rotorid.experiment import table_records  # which few records need

    if plan.entry.kind == "phasors":
        return table_records.read_phasors(plan)
    return table_records.read_responses(plan)


def inspect_experiment(path: Path) -> tuple[list[Inspection | LineInspection], str]:
    """Inspect every record of an experiment file; say why it was read as a draft, if it was."""
    try:
        plan = load_experiment(path)
    except InputError as error:
        entries = _draft_records(path)
        if entries is None:
            raise
        told = f"a draft, shown with its columns as they are in the file: {error}"
        return [_inspect_draft(path.parent, entry) for entry in entries], told
    found: list[Inspection | LineInspection] = []
    for one in counting(plan.channels, "inspecting records"):
        entry = one.entry
        if entry.channel_kind == "samples":
            cut = entry.made == "run-up"
            found.append(_inspected(read.measured(one), entry, entry.band, cut=cut))
            continue
        for lines in _read_table(one):
            named = lines.source or ", ".join(entry.paths)
            found.append(inspect_lines(replace(lines, source=named)))
    told = "; ".join(map(_measured_mode, plan.entry.modes))
    return found, told and f"measured natural frequencies: {told}"


def _measured_mode(mode: schema.ModeEntry) -> str:
    told, ratio = f"{mode.frequency:g} Hz, std {mode.std:g} Hz", mode.damping
    told += f", damping ratio {ratio.value:g}, std {ratio.std:g}" if ratio else ""
    with_ = [f"{name} = {value}" for name, value in mode.parameters.items()]
    return ", ".join([told, f"at {mode.speed * 30 / math.pi:g} rpm", *with_])


def named_files(path: Path) -> list[Path]:
    """Return an experiment file, a draft too, and every file that a text in it names."""
    found = list[Path]()
    for _, value in members(parse_table(read_bytes(path), file=str(path))):
        with suppress(OSError, ValueError):  # texts that are no names of files
            if isinstance(value, str) and (path.parent / value).is_file():
                found.append(path.parent / value)
    return [path, *reversed(found)]


def _inspected(
    record: Record,
    entry: schema.RecordKeys,
    band: tuple[float, float] | None = None,
    *,
    cut: bool = False,
) -> Inspection:
    size = read.period_of(record, entry)
    return inspect_record(
        record,
        period_samples=size,
        harmonics=entry.harmonics,
        band=band,
        skip=entry.skip or 0.0,
        whole=cut or (size is None and bool({"band", "cutoff"} & entry.model_fields_set)),
    )


def _draft_records(path: Path) -> list[schema.DraftRecord] | None:
    """Return the records of a file that leaves something open, None where it does not."""
    try:
        data = read_bytes(path)
    except ReadError:  # told where the file is read in earnest
        return None
    entries = table_within(data).get("records")
    tables = entries if isinstance(entries, list) else []
    records = [one if isinstance(one, dict) else {} for one in tables]
    keys = [one.keys() for one in records]
    if not keys or not all(one & {"file", "files"} for one in keys):
        return None
    turned = {"angle", "keyphasor"}
    if any(one.get("kind", "samples") != "samples" and not one.keys() & turned for one in records):
        return None  # a table, which holds no samples to be shown
    periodic = all(one & {"fundamental", "period_samples"} for one in keys)
    if periodic and f'"{schema.OPEN}"'.encode() not in data:
        return None
    return parse_toml(data, schema.DraftFile, file=str(path)).records


def _inspect_draft(folder: Path, entry: schema.DraftRecord) -> Inspection:
    if schema.OPEN in entry.paths:
        raise ReadError("no name of a file", "the file of a record", "name it")
    paths = [folder / name for name in entry.paths]
    record = read_record(paths, mask=entry.mask, skip=entry.skip or 0.0, **read.said_of(entry))
    mark = entry.keyphasor if entry.angle is None else entry.angle.column
    if mark in record.names:
        bare, marks = read.without_mark(record, mark)
        turned: dict[str, Any] = {}
        if entry.keyphasor:
            with suppress(InputError):  # what is wrong with it is told once the file is finished
                seen = mark_angle(marks, record.sample_rate, source=record.source)
                turned = {"speed": seen.speed, "angle": seen.angle}
        record = replace(bare, **turned)
    return _inspected(record, entry)


def knowledge_of(entry: schema.ExperimentFile, model: Model) -> Knowledge[float]:
    expressions = []
    for number, one in enumerate(entry.constraints):
        place = f"constraints.{number}"
        unit = unit_of_expression(one.expression, model, place)
        expressions.append((one.expression, _in_si(one, unit, place)))
    _check_once(entry, model)
    parameters = {n: _told(n, one, model, "parameters") for n, one in entry.parameters.items()}
    every = (*parameters.items(), *expressions)
    fixed, values, stds, start = (
        {name: told[key] for name, told in parameters.items() if key in told}
        for key in ("fixed", "value", "std", "start")
    )
    return Knowledge(
        fixed=fixed,
        constraints=tuple(
            Constraint(expression, told["value"], told.get("std", 0.0))
            for expression, told in expressions
            if "value" in told
        ),
        known={name: (value, stds[name]) for name, value in values.items()},
        start=start,
        bounds={n: (t.get("min"), t.get("max")) for n, t in every if t.keys() & {"min", "max"}},
    )


def own_values(
    entries: Mapping[str, schema.OwnEntry], model: Model, place: str
) -> dict[str, tuple[float, float]]:
    """Return the parameters that a record has to itself, value and deviation in SI."""
    told = {name: _told(name, one, model, place) for name, one in entries.items()}
    return {n: (t.get("fixed", t.get("value", 0.0)), t.get("std", 0.0)) for n, t in told.items()}


def _parameter(name: str, model: Model, place: str) -> Parameter:
    known = {parameter.name: parameter for parameter in model.parameters}
    require_names([name], known, "{}, which is no parameter of the model", place=place)
    return known[name]


def _told(
    name: str, entry: schema.ParameterEntry | schema.OwnEntry, model: Model, place: str
) -> dict[str, float]:
    """Return in SI what is said of a parameter."""
    place = f"{place}.{name}"
    parameter = _parameter(name, model, place)
    told = _in_si(entry, parameter.unit, place)
    # A trial mass of none is 0 in a record, whatever the model says of those that are there.
    zero = isinstance(entry, schema.OwnEntry)
    for key in {"fixed", "value", "start"} & told.keys():
        if parameter.positive and (told[key] < 0 or (told[key] == 0 and not zero)):
            expected = "more than 0, since the model says positive = true"
            cure = "correct one of them"
            raise InputError(f"{told[key]:g}", expected, cure, place=f"{place}.{key}")
    return told


def _in_si(entry: schema.PriorKeys | schema.OwnEntry, unit: str, place: str) -> dict[str, float]:
    found = {}
    for key in ("fixed", "value", "std", "start", "min", "max"):
        quantity = getattr(entry, key, None)
        if quantity is not None:
            found[key] = to_si(quantity, unit, place=f"{place}.{key}")
    if found.get("std", 1.0) <= 0:
        expected = "a deviation of more than 0"
        cure = "leave it out for an exact value"
        raise InputError(f"{found['std']:g}", expected, cure, place=f"{place}.std")
    return found


def _check_once(entry: schema.ExperimentFile, model: Model) -> None:
    """Refuse a measurement stated twice: a multiple of what has value and deviation already."""
    names = model.parameter_names
    known = {
        frozenset([(tuple(int(n == name) for n in names), 1.0)]): f"parameters.{name}"
        for name, one in entry.parameters.items()
        if one.value is not None and one.std is not None
    }
    for number, one in enumerate(entry.constraints):
        if one.value is None or one.std is None:
            continue
        terms = {p: float(c) for p, c in polynomial(one.expression, names).items() if c}
        largest = max(terms.items(), key=lambda term: (abs(term[1]), term[0]), default=((), 1.0))[1]
        what = frozenset((tuple(p), round(c / largest, 12)) for p, c in terms.items())
        place = f"constraints.{number}"
        if (other := known.setdefault(what, place)) != place:
            raise InputError(
                f"{one.expression[:60]!r}, which is what {other} states, or a multiple of it",
                "each measurement once: twice it counts as two",
                "remove one; of two weighings state the mean, and its own std",
                place=place,
            )


def _modes(entry: schema.ExperimentFile, model: Model) -> tuple[Mode, ...]:
    found = []
    for number, one in enumerate(entry.modes):
        place = f"modes.{number}"
        for name in one.parameters:
            _parameter(name, model, f"{place}.parameters.{name}")
        damping = None if one.damping is None else (one.damping.value, one.damping.std)
        said = {name: str(value) for name, value in one.parameters.items()}
        with naming(place=place):
            mode = Mode(one.frequency, one.std, damping, one.speed, said, one.mode)
            found.append(in_units_of(model, mode))
    return tuple(found)


def _of_ml_alone(entry: schema.ExperimentFile) -> Iterator[tuple[str, str, str]]:
    """Yield the place of what ml alone can weigh, what stands there, and what others expect."""
    exact = "exact values, the same in all records,"
    if entry.modes:
        yield "modes", "measured natural frequencies", "records alone"
    for key, value in entry.estimator.unknown.items():
        if value:
            told = f"{key} = {str(value).lower()}"
            yield f"estimator.{key}", told, "a measurement without unknown constants"
    differ = "parameters that differ between records"
    known: dict[str, schema.PriorKeys] = {f"parameters.{n}": p for n, p in entry.parameters.items()}
    known |= {f"constraints.{number}": c for number, c in enumerate(entry.constraints)}
    for place, one in known.items():
        if isinstance(one, schema.ParameterEntry) and one.each:
            yield f"{place}.each", differ, exact
        if one.std is not None:
            yield f"{place}.std", "a deviation", exact
        if one.bounded:
            yield f"{place}.min, max", "a bound", exact
    channels = [("", entry.channels)]
    for number, record in enumerate(entry.records):
        channels.append((f"records.{number}.", record.channels))
        if record.parameters:
            yield f"records.{number}.parameters", differ, exact
    # Of filtered samples it bounds the lag of the forces that may be unseen.
    on_samples = all(record.cutoff is not None for record in entry.records)
    for place, each in channels:
        stds = ((name, key) for name, channel in each.items() for key in channel.deviations)
        for name, key in stds:
            if not (on_samples and key == "delay.std"):
                yield f"{place}channels.{name}.{key}", "a deviation", exact
