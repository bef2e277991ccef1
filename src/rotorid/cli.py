"""The command line: parses, calls plain functions, prints what they return."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from rotorid import __version__
from rotorid.demo import DemoResult, run_demo
from rotorid.errors import InputError, NotConvergedError, NotIdentifiableError
from rotorid.estimate import Estimate, load_estimate
from rotorid.estimators.information import information_of
from rotorid.experiment import load_experiment
from rotorid.identify import identify as identify_model
from rotorid.io.output import check_apart, check_target, write_files
from rotorid.models import Model, load_model, shipped_models
from rotorid.predict import predict
from rotorid.record import PeriodicRecord
from rotorid.report import text

OK, NO_ANSWER, WRONG_INPUT, BROKEN_PIPE, INTERRUPTED = 0, 1, 2, 141, 130
_FILE = click.Path(path_type=Path)


class _Console(Console):
    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def _print(renderable: Any) -> None:
    width = None if sys.stdout.isatty() else 200
    _Console(width=width, highlight=False).print(renderable)


@contextmanager
def _progress(description: str) -> Iterator[Callable[[int, int], None]]:
    """Show the progress of long work on a terminal; nothing where the output is a pipe."""
    with Progress(
        console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()
    ) as progress:
        task = progress.add_task(description, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def _debug_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option(
        "--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."
    )(command)


def _output_options(command: Callable[..., Any]) -> Callable[..., Any]:
    command = click.option("--report", type=_FILE, help="Write a report (HTML).")(command)
    return click.option("--json", type=_FILE, help="Write the result (JSON).")(command)


@click.group(no_args_is_help=False, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rotorid")
@_debug_option
def cli() -> None:
    """Physical parameters of magnetically levitated rotors, from measured forces and positions."""


@cli.command()
@click.option("--seeds", default=60, show_default=True, help="Records, each with its own noise.")
@_output_options
@_debug_option
def demo(seeds: int, json: Path | None, report: Path | None) -> int:
    """Simulate the seed's example, identify it, and print its Table 1 beside the seed's."""
    _check(json, report)
    with _progress("simulating and identifying") as progress:
        result = run_demo(seeds, rng=np.random.default_rng(2026), progress=progress)
    _write((json, result.save), (report, partial(_write_demo_report, result)))
    _print(text.demo_tables(result))
    return OK


@cli.command()
@click.argument("experiment", type=_FILE)
@click.option("--method", type=click.Choice(["ls", "batch", "sequential", "ml"]))
@click.option("--strict", is_flag=True, help="Exit with 1 where the data reject the model.")
@_output_options
@_debug_option
def identify(
    experiment: Path, method: Any, strict: bool, json: Path | None, report: Path | None
) -> int:
    """Estimate the parameters of a machine from the records that EXPERIMENT names."""
    _check(json, report)
    with _progress("reading"):
        plan = load_experiment(experiment)
        check_apart([path for path in (json, report) if path is not None], plan.files)
        estimator, records = plan.estimator(method), plan.records(method)
    with _progress("identifying"):
        try:
            estimate = identify_model(plan.model, records, estimator)
        except (NotIdentifiableError, NotConvergedError) as error:
            if error.estimate is None:
                raise
            estimate = error.estimate
        except InputError as error:
            raise error.at(file=str(experiment)) from None
    write_report = partial(_write_estimate_report, estimate, plan.model, records)
    _write((json, estimate.save), (report, write_report))
    _print(text.estimate_tables(estimate))
    return _exit_code(estimate, strict)


def _check(*targets: Path | None) -> None:
    for path in targets:
        if path is not None:
            check_target(path)


def _write(*outputs: tuple[Path | None, Callable[[Path], object]]) -> None:
    write_files({path: write for path, write in outputs if path is not None})


def _write_estimate_report(
    estimate: Estimate, model: Model, records: Sequence[PeriodicRecord], path: Path
) -> None:
    from rotorid.report.html import write_estimate_report  # plots take their time to load

    write_estimate_report(estimate, model, records, path)


def _write_demo_report(result: DemoResult, path: Path) -> None:
    from rotorid.report.html import write_demo_report

    write_demo_report(result, path)


def _exit_code(estimate: Estimate, strict: bool) -> int:
    answered = estimate.status == "ok" or (estimate.status == "rejected" and not strict)
    return OK if answered else NO_ANSWER


@cli.command()
@click.argument("result", type=_FILE)
@click.argument("experiment", type=_FILE)
@_debug_option
def validate(result: Path, experiment: Path) -> int:
    """Predict the forces of the records in EXPERIMENT with RESULT, a file of identify --json."""
    estimate = load_estimate(result)
    with _progress("reading"):
        plan = load_experiment(experiment)
        records = plan.records("ml" if estimate.method == "ml" else "batch")
    try:
        errors = [predict(plan.model, estimate, record) for record in records]
        told = [information_of(plan.model, estimate, record) for record in records]
    except InputError as error:
        raise error.at(file=str(result)) from None
    _print(text.prediction_table(errors))
    for line in text.information_lines(told):
        _print(line)
    return OK


@cli.command()
@click.argument("rig")
@click.option("--out", required=True, type=_FILE, help="The record to write (.h5).")
@click.option("--seed", type=click.IntRange(min=0), help="Of the noise, in place of the file's.")
@click.option("--force", is_flag=True, help="Replace files that simulate did not write itself.")
@_debug_option
def simulate(rig: str, out: Path, seed: int | None, force: bool) -> int:
    """Run the levitated RIG, a file or a shipped one, and record it as a logger does."""
    from rotorid.report.rig import record_summary  # its compiler takes its time to load
    from rotorid.rig.export import experiment_path, experiment_text, require_own, write_record
    from rotorid.rig.file import load_rig

    experiment = experiment_path(out, rig)
    _check(out, experiment)
    if not force:
        require_own(out)
        require_own(experiment)
    plan = load_rig(rig)
    with _progress("running"):
        record = plan.run(seed)
    described = experiment_text(plan, record, out.name)
    _write(
        (out, partial(write_record, record, rig_text=plan.text)),
        (experiment, lambda path: path.write_text(described, encoding="utf-8")),
    )
    _print(record_summary(record, str(out), str(experiment)))
    return OK


@cli.command()
@click.argument("name", required=False)
@_debug_option
def models(name: str | None) -> int:
    """List the shipped models; or show the equations and parameters of NAME, or of a file."""
    if name is None:
        _print(text.model_list(load_model(shipped) for shipped in shipped_models()))
    else:
        _print(text.model_description(load_model(name)))
    return OK


def run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit code; errors become one line on stderr."""
    try:
        code = cli.main(args=list(arguments), prog_name="rotorid", standalone_mode=False)
        sys.stdout.flush()
        return int(code or OK)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except (click.Abort, KeyboardInterrupt):
        return _say("interrupted", INTERRUPTED)
    except Exception as error:
        if "--debug" in arguments:
            raise
        return _explain(error)


def _explain(error: Exception) -> int:
    """Say in one line what went wrong, and return the exit code."""
    if isinstance(error, click.UsageError):
        path = error.ctx.command_path if error.ctx else "rotorid"
        return _say(f"{error.format_message()} See {path} --help.", WRONG_INPUT)
    if isinstance(error, click.ClickException):
        return _say(error.format_message(), WRONG_INPUT)
    if isinstance(error, NotIdentifiableError | NotConvergedError):
        return _say(str(error), NO_ANSWER)
    if isinstance(error, OSError) and error.filename is not None:
        return _say(f"{error.filename}: {error.strerror}", WRONG_INPUT)
    if isinstance(error, ValueError | OSError):
        return _say(str(error), WRONG_INPUT)
    if isinstance(error, MemoryError):
        return _say("out of memory; use a shorter record or fewer lines", WRONG_INPUT)
    name = type(error).__name__
    return _say(f"internal error, {name}: {error}; --debug shows where", NO_ANSWER)


def _say(message: str, code: int) -> int:
    print("rotorid:", " ".join(message.split()), file=sys.stderr)
    return code


def main() -> None:
    """Run the command line of this process."""
    sys.exit(run(sys.argv[1:]))
