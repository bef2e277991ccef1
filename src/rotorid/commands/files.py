"""Commands of a screen or a file: each loads what it needs, so that all of them start quickly."""

from __future__ import annotations

import json
import os
import tomllib
from importlib import import_module
from pathlib import Path

from rotorid.commands import NO_ANSWER, OK
from rotorid.commands.console import STDOUT, Outputs, as_text, check_outputs, done, show, write
from rotorid.core.errors import InputError, printable
from rotorid.core.files import MARK, REPORT, Kind, check_apart
from rotorid.core.watch import watch

NOISE = 2026  # starts the generator of the noise, so that every run shows the same figures
SCHEMA = Kind("rotorid schema")
FILES = {
    "experiment": ("rotorid.experiment.schema", "ExperimentFile"),
    "model": ("rotorid.models.loader", "ModelFile"),
    "rotor": ("rotorid.models.rotor.drawing", "Rotor"),
    "rig": ("rotorid.rig.file", "RigFile"),
    "study": ("rotorid.studies.plan", "StudyFile"),
}
"""The files that people write, and the class that says what may stand in each."""


def models(name: str | None) -> int:
    from rotorid.models import load_model, shipped_models
    from rotorid.models.rotor.rotor_model import RotorModel
    from rotorid.report.records import model_list, model_page, rotor_page

    if name is None:
        show([model_list(load_model(shipped) for shipped in shipped_models())])
        return OK
    model = load_model(name)
    show(rotor_page(model) if isinstance(model, RotorModel) else model_page(model))
    return OK


def new(files: tuple[Path, ...], model: str | None, out: Path | None, force: bool) -> int:
    from rotorid.experiment.draft import DRAFT, before_inspecting, draft, things_open

    targets = check_outputs((out, DRAFT), force=force)
    check_apart(targets, [*files, *([] if model is None else [Path(model)])])
    watch("reading")
    folder = Path() if out is None else out.parent
    text = printable(draft(files, model, folder), keep="\n")
    write((STDOUT if out is None else out, as_text(lambda: text, DRAFT)))
    if out is not None:
        entry = tomllib.loads(text)
        left, first = printable(things_open(entry)), before_inspecting(entry)
        show([f"wrote {out}: {left}; next: {first}rotorid inspect {out}"])
    return OK


def schema(file: str, out: Path | None, force: bool) -> int:
    from rotorid.core.toml import json_schema

    check_outputs((out, SCHEMA), force=force)
    module, name = FILES[file]
    found = {**json_schema(getattr(import_module(module), name)), "$comment": MARK}
    text = json.dumps(found, indent=2) + "\n"
    write((STDOUT if out is None else out, as_text(lambda: text, SCHEMA)))
    return OK


def inspect(experiment: Path, answer: Outputs) -> int:
    from rotorid.core.notes import worst
    from rotorid.experiment.experiment import inspect_experiment, named_files
    from rotorid.report.records import inspection_page, inspection_report

    targets = answer.check()
    if targets:
        check_apart(targets, named_files(experiment))
    watch("reading")
    found, told = inspect_experiment(experiment)
    page = [part for one in found for part in inspection_page(one)]
    if told:
        page = [told, *page]

    def html() -> str:
        work = done(answer.given, named_files(experiment))
        return inspection_report(experiment.name, found, told, work)

    parts = [one.to_dict() for one in found]
    first = parts[0] if parts else {"checks": [], "told": told}
    whole = {**first, "verdict": worst(check for one in found for check in one.checks)}
    answer.give(page, whole if len(parts) < 2 else {**whole, "records": parts}, html)
    return OK


def report(result: Path, out: Path | None, force: bool) -> int:
    from rotorid.answer.result_file import load_estimate
    from rotorid.report.estimate_report import WITHOUT, estimate_report

    target = result.with_suffix(".html") if out is None else out
    targets = check_outputs((target, REPORT), force=force)
    estimate = load_estimate(result)
    sources = [] if estimate.provenance is None else estimate.provenance.files
    there = (Path(source.file) for source in sources if os.path.isfile(source.file))
    check_apart(targets, [result, *there])
    watch("writing the report")
    write((target, as_text(lambda: estimate_report(estimate), REPORT)))
    show([*([] if estimate.evidence else [WITHOUT]), f"report: {target}"])
    return OK


def export(result: Path, target: Path, speed: str, force: bool) -> int:
    from rotorid.answer.result_file import load_estimate
    from rotorid.results.export import EXPORT, exported, known_ending, plant_of

    known_ending(target)
    targets = check_outputs((target, EXPORT), force=force)
    estimate = load_estimate(result)
    check_apart(targets, [result])
    write((target, lambda: exported(estimate, target, speed=speed)))
    found = f"{len(estimate.parameters)} parameters, {len(estimate.nuisance)} nuisance"
    if target.suffix.lower() in (".json", ".mat"):
        plant = plant_of(estimate, speed)
        space = f"state space of {0 if plant is None else len(plant.A)} states at {speed}"
        found = space if target.suffix.lower() == ".json" else f"{found}, {space}"
    show([f"{target}: {found}"])
    return OK


def simulate(
    rig: str | None,
    out: Path | None,
    seed: int | None,
    fault: tuple[str, ...],
    faults: bool,
    example: str | None,
    force: bool,
) -> int:
    from rotorid.report.records import fault_page, record_page
    from rotorid.rig.file import load_rig
    from rotorid.rig.files import (
        RECORD,
        example_files,
        experiment_path,
        experiment_text,
        record_bytes,
    )

    if faults:
        show(fault_page())
        return OK
    if example is not None:
        made = {Path(name): content for name, content in example_files(example).items()}
        check_outputs(*((path, RECORD) for path in made), force=force)
        watch("running")
        write(*made.items())
        show([f"wrote {', '.join(map(str, made))}; what to do with them: docs/{example}.md"])
        return OK
    if rig is None or out is None:
        expected = "rotorid simulate RIG --out FILE, or rotorid simulate --faults"
        cure = "name both: a rig, such as three-mass, and the record to write, such as run.h5"
        raise InputError("no RIG" if rig is None else "no --out", expected, cure)
    experiment = experiment_path(out, rig)
    targets = check_outputs((out, RECORD), (experiment, RECORD), force=force)
    plan = load_rig(rig).with_faults(fault)
    check_apart(targets, [Path(rig), Path(plan.model)])
    watch("running")
    record = plan.record(seed)
    write(
        (out, lambda: record_bytes(record, rig_text=plan.text, faults=fault)),
        (experiment, as_text(lambda: experiment_text(plan, record, out.name), RECORD)),
    )
    show(record_page(record, str(out), str(experiment)))
    return OK


def study(
    study: Path,
    out: Path,
    workers: int | None,
    scheduler: str | None,
    resume: bool,
    summary: bool,
) -> int:
    from rotorid.studies import run
    from rotorid.studies.plan import load_study
    from rotorid.studies.study_summary import summarize_study

    if summary:
        found = summarize_study(load_study(study), out)
    else:
        found = run.study(study, out, workers=workers, scheduler=scheduler, resume=resume)
    show(found.page)
    return OK if any(group.statuses.keys() - {"failed"} for group in found.groups) else NO_ANSWER


def demo(runs: int, machine: Path | None, answer: Outputs) -> int:
    import numpy as np

    from rotorid import demo as shows

    check_apart(answer.check(machine), [])
    shown = shows.run_machine(np.random.default_rng(NOISE))
    Outputs(None, machine).give(shows.machine_page(shown), {}, lambda: shows.machine_report(shown))
    result = shows.run_demo(runs, rng=np.random.default_rng(NOISE))
    told = ["", "The example of Levy and Arogeti", *shows.demo_page(result)]
    answer.give(told, result.to_dict(), lambda: shows.demo_report(result))
    return OK
