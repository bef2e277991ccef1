"""``rotorid identify`` and ``rotorid validate``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.answer.estimate import Estimate, verdict
from rotorid.answer.identify import Estimator, identify
from rotorid.answer.parts import Provenance
from rotorid.commands import NO_ANSWER, OK, REJECTED
from rotorid.commands.console import Outputs, done, environment, source_of
from rotorid.core.errors import InputError, naming
from rotorid.core.files import check_apart
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note
from rotorid.core.tables import Page
from rotorid.core.toml import parse_toml
from rotorid.core.watch import watch
from rotorid.data.observation import Data, Measured
from rotorid.experiment import Experiment, load_experiment
from rotorid.experiment.duplicates import apart
from rotorid.experiment.schema import ExperimentFile
from rotorid.models import Model

if TYPE_CHECKING:
    from rotorid.likelihood.estimator import Search


def run(
    experiment: Path,
    method: Any,
    effort: Any,
    strict: bool,
    intervals: bool,
    answer: Outputs,
) -> int:
    """Identify what an experiment file describes; the exit code says whether there is an answer."""
    targets = answer.check()
    watch("reading")
    plan = load_experiment(experiment)
    check_apart(targets, plan.files)
    estimator, records = plan.estimator(method, effort), plan.records(method)
    watch("identifying")
    with naming(str(experiment)):
        estimate = identify(plan.model, records, _BestSoFar(estimator))
    if targets or answer.json is not None:  # what is written says more than a screen
        watch("predicting")
        estimate = _with_evidence(estimate, plan, records, estimator)
        estimate = estimate.with_(provenance=provenance(plan, answer.given))

    def html() -> str:
        # Pictures take their time to load.
        from rotorid.report.estimate_report import estimate_report

        return estimate_report(estimate)

    page = estimate.summary(intervals=intervals)
    answer.give(page, estimate.to_json, html)
    if estimate.status == "rejected" or (strict and estimate.verdict != "ok"):
        return REJECTED
    return OK if estimate.status == "ok" else NO_ANSWER


@frozen
class _BestSoFar:
    """An estimator of which an interrupt leaves the best answer so far; another one ends it."""

    whole: Estimator

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        begin = getattr(self.whole, "search", None)
        if begin is None:  # done at once
            return self.whole.estimate(model, records)
        search: Search = begin(model, records)
        try:
            return search.finish()
        except KeyboardInterrupt:
            watch("ending with the best answer so far")
            if (best := search.best) is None:
                raise
            return best


def _with_evidence(
    estimate: Estimate, plan: Experiment, records: Sequence[Measured], estimator: Estimator
) -> Estimate:
    """Return an estimate with what its report shows; if that fails, the answer stands alone."""
    from rotorid.results.evidence import with_evidence  # for what is written alone

    try:
        return with_evidence(estimate, plan.model, records, estimator)
    except (Exception, KeyboardInterrupt) as error:
        interrupted = any(note.about == "interrupted" for note in estimate.notes)
        if isinstance(error, KeyboardInterrupt) and interrupted:
            raise  # for the second time
        told = f"nothing of the records is kept for a report: {type(error).__name__}: {error}"
        return estimate.with_notes(Note("report", "remarks", told.removesuffix(": ")))


def provenance(plan: Experiment, command: str) -> Provenance:
    from rotorid import __version__  # its look-up takes its time

    files = (path for path in dict.fromkeys(plan.files) if path.is_file())
    text, model = Path(plan.file).read_text(encoding="utf-8"), plan.model
    made_by = (__version__, command, model.file_text, model.held, environment())
    return Provenance(tuple(map(source_of, files)), text, *made_by)


def validate(result: Path, experiment: Path, answer: Outputs) -> int:
    from rotorid.answer.predict import at_best_phase, channel_errors, verdict_of
    from rotorid.answer.result_file import load_estimate
    from rotorid.linear.family import information_of
    from rotorid.report import estimate_report as report

    targets = answer.check()
    estimate = load_estimate(result)
    watch("reading")
    plan = load_experiment(experiment)
    plan.require_records()
    check_apart(targets, [result, *plan.files])
    if estimate.model != (name := plan.model.name):  # parameters may have the same names
        said = f"a result of the model {estimate.model[:60]!r}"
        expected = f"one of {name[:60]!r}, the model of the experiment"
        cure = "name the model of the result in the experiment, or identify with this one"
        raise InputError(said, expected, cure, file=str(result))
    records = plan.records("ml" if estimate.method == "ml" else "batch")
    with naming(str(result)):
        turned = [at_best_phase(plan.model, estimate, r, k) for k, r in enumerate(records)]
        placed = [record for record, _ in turned]
        found = [channel_errors(plan.model, estimate, r, k) for k, r in enumerate(placed)]
        told = [information_of(plan.model, estimate, record) for record in placed]
    reached = verdict_of(found)
    lead = f"{reached.verdict}: {reached.sentence}"
    conditions = report.information_lines(told)
    page: Page = [lead, report.validation_table(found), *conditions]
    fitted = [] if estimate.verdict == "ok" else [f"note: the result is {verdict(estimate)}"]
    fitted += [
        f"note: nothing tells the rotor angle of record {number + 1}: {np.rad2deg(angle):.4g} deg, "
        "which fits best, was taken: the amount of the unbalance is tested, its direction is not"
        for number, (_, angle) in enumerate(turned)
        if angle is not None
    ]
    page = [*page, *fitted, *_its_own(estimate, plan), *reached.cures]

    def html() -> str:
        from rotorid.results.evidence import record_evidence

        shown = record_evidence(estimate, plan.model, placed, another=True)
        work = [*done(answer.given, [result, *plan.files]), *conditions, *fitted]
        return report.validation_report(estimate, plan.model, found, shown, work)

    rows = [{"record": k, **vars(one)} for k, record in enumerate(found) for one in record]
    content = {"verdict": reached.verdict, "channels": rows}
    answer.give(page, content, html)
    return OK if reached.verdict == "predicts" else NO_ANSWER


def _its_own(estimate: Estimate, plan: Experiment) -> list[str]:
    """Return notes on records of which the result was made; other times or rows are others."""
    made = estimate.provenance
    if made is None:
        return []
    before = parse_toml(made.experiment.encode(), ExperimentFile).records
    sums = {source.sha256 for source in made.files} - {""}
    held = {p for p in {*plan.record_files} if p.is_file() and source_of(p).sha256 in sums}
    again = list[Path]()
    for one in plan.channels:
        for path in held.intersection(one.paths):
            own = [e for e in before if path.name in {Path(p).name for p in e.paths}]
            again += [path] if any(not apart(e, one.entry) for e in own or before) else []
    return [
        f"note: {path} is a record that the result was made of, which proves little: take another"
        for path in dict.fromkeys(again)
    ]
