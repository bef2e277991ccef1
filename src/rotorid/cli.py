"""The command line: what commands there are, their options, and what an error becomes.

Nothing here does work or loads what works: each command is handed to the module of its name in
`rotorid.commands`, or to the function of its name in `files` or `machines` there.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import shlex
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial, wraps
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from rotorid.commands import BROKEN_PIPE, INTERRUPTED, NO_ANSWER, OK, SIGNALLED, WRONG_INPUT
from rotorid.commands.console import STDOUT, Outputs, progress, put, silence
from rotorid.core.errors import LINE, InputError, UnfinishedError, one_line
from rotorid.core.files import Kind
from rotorid.core.watch import watch

MAX_RUNS = 100_000  # of the demonstration: a day's work
_FILE = click.Path(path_type=Path)
_HERE = Path(__file__).parent
_METHOD = click.Choice(["ls", "batch", "sequential", "ml"])
_PLANE = "A place, or the pair of coordinates or inputs of its force: x2,y2. Again for more."
_MODULES = {
    **{"balance": "machines", "modes": "machines", "study": "files", "validate": "identify"},
    **dict.fromkeys(
        ("demo", "export", "inspect", "models", "new", "report", "schema", "simulate"), "files"
    ),
}
_Command = Callable[..., Any]
_SETTINGS = {"help_option_names": ["-h", "--help"]}


def _work(command: str, *, quiet: bool = False, **options: Any) -> int:
    """Load what does the work of a command and run it, without tables where nobody reads them."""
    targets = (*options.values(), *options.get("answer", ()))
    with progress(quiet), silence(quiet or STDOUT in targets):
        watch("loading")
        module = import_module(f"rotorid.commands.{_MODULES.get(command, command)}")
        work: Callable[..., int] = getattr(module, command if command in _MODULES else "run")
        # What is beyond all bounds is told by the checks of an answer, not by numpy on stderr.
        with import_module("numpy").errstate(over="ignore", invalid="ignore", divide="ignore"):
            try:
                return work(**options)
            except EOFError as error:  # which click would take for an interrupt
                raise InputError(
                    "a truncated file",
                    "a whole file",
                    "copy or write it again",
                ) from error


def _names_in(folder: str) -> Callable[..., list[CompletionItem]]:
    """Return what completes the name of a shipped model or rig, else that of a file."""

    def complete(context: object, parameter: object, incomplete: str) -> list[CompletionItem]:
        names = sorted(path.stem for path in (_HERE / folder / "library").glob("*.toml"))
        found = [CompletionItem(name) for name in names if name.startswith(incomplete)]
        return found or [CompletionItem(incomplete, type="file")]

    return complete


_flag = partial(click.option, is_flag=True)
_file_option = partial(click.option, type=_FILE)
_debug_option = _flag("--debug", expose_value=False, help="Show the traceback of an error.")
_force_option = _flag(
    "--force", help="Overwrite files not written by this command; a link is followed."
)
_quiet_option = _flag(
    "--quiet", "-q", help="Suppress tables and progress; usage warnings and errors remain."
)
_json_option = _file_option(
    "--json", help="Write the result (JSON); - writes it, and nothing else, to the standard output."
)
_strict_option = _flag(
    "--strict", help="Exit with status 3 also if the result is doubtful or rests on assumptions."
)
_report_option = _file_option("--report", help="Write a report (HTML).")
_experiment, _result = (click.argument(name, type=_FILE) for name in ("experiment", "result"))
_record_option = click.option(
    "--record",
    type=click.IntRange(min=0),
    default=0,
    help="Index (from 0) of the record whose own parameters are used.",
)


def _answers(command: _Command) -> _Command:
    """Give a command the options of where its answer goes."""
    return _report_option(_json_option(_writes(command)))


def _writes(command: _Command) -> _Command:
    return _quiet_option(_force_option(_debug_option(command)))


@click.group(no_args_is_help=False, context_settings=_SETTINGS)
@click.version_option(package_name="rotorid", prog_name="rotorid")
@_debug_option
def cli() -> None:
    """Physical parameters of magnetically levitated rotors, from measured forces and positions."""


def _command(example: str) -> Callable[[Callable[[], None]], click.Command]:
    """Make a command of a function: its name, its help, whose first line lists it, an example."""

    def make(command: Callable[[], None]) -> click.Command:
        name, summary = command.__name__, str(command.__doc__).partition("\n")[0]

        @click.pass_obj
        @wraps(command)
        def work(given: str, /, **options: Any) -> int:
            if "json" in options:
                json, report, force = (options.pop(key) for key in ("json", "report", "force"))
                kind = Kind(f"rotorid {name} --json")
                options["answer"] = Outputs(json, report, force, given, kind)
            return _work(name, **options)

        return cli.command(short_help=summary, epilog=f"\b\nExample:\n  {example}")(work)

    return make


@_command("rotorid demo --machine machine.html --report paper.html")
@click.option(
    "--runs",
    type=click.IntRange(min=1, max=MAX_RUNS),
    default=60,
    show_default=True,
    help="Records of the paper's example, each with its own noise.",
)
@_file_option("--machine", help="Write the report of the levitated machine (HTML).")
@_answers
def demo() -> None:
    """Identify a simulated machine and compare with its true values.

    The levitated machine is known by the sensors and currents of its bearings alone. Then the
    paper's example: its Table 1 is printed beside the paper's; --json and --report are of it.
    """


@_command("rotorid inspect run.toml --report inspect.html")
@_experiment
@_answers
def inspect() -> None:
    """Check the records of an experiment, or of a draft."""


@_command("rotorid identify run.toml --json run.json --report run.html")
@_experiment
@click.option("--method", type=_METHOD, help="Method (default: from the file).")
@click.option(
    "--effort",
    type=click.Choice(["quick", "normal", "thorough"]),
    help="Extent of the search: quick ends at the first minimum; thorough takes more starts.",
)
@_flag("--intervals", help="Show 95 % intervals instead of standard deviations.")
@_strict_option
@_answers
def identify() -> None:
    """Estimate machine parameters from the records of an experiment.

    Ctrl-C ends a search that takes long with the best answer so far. The exit code is 0 where the
    status is ok, 3 where it is rejected, and 1 where there is no answer.
    """


@_command("rotorid validate run.json other-run.toml")
@_result
@_experiment
@_answers
def validate() -> None:
    """Validate a result on other records.

    RESULT is a file of identify --json.
    """


@_command('rotorid modes run.json --speed "8400 rpm" --to "20000 rpm"')
@click.argument("source", metavar="RESULT-OR-MODEL", shell_complete=_names_in("models"))
@click.option("--speed", default="0 rpm", show_default=True, help='Such as "8400 rpm".')
@click.option("--to", help="Upper speed of Campbell diagram and critical-speed search.")
@_record_option
@_strict_option
@_answers
def modes() -> None:
    """Natural frequencies, damping, whirl, critical speeds.

    They are those of a result, of a model file or of a shipped model.
    """


@_command('rotorid balance run.json --plane x1,y1 --plane x3,y3 --radius "30 mm"')
@_result
@click.argument("more", nargs=-1, metavar="")
@click.option("--plane", "planes", multiple=True, metavar="P", help=_PLANE)
@click.option("--speed", multiple=True, help='Such as "8400 rpm" (default: those of the records).')
@click.option(
    "--at", multiple=True, metavar="Q[=WEIGHT]", help="Coordinate to minimize (default: all)."
)
@click.option("--radius", help='Radius of the correction masses, such as "30 mm".')
@click.option("--masses", help='Available masses, such as "0.5 g, 1 g, 2 g".')
@click.option("--holes", type=int, help="Number of holes in each plane, the first at 0 deg.")
@_record_option
@_strict_option
@_answers
def balance() -> None:
    """Compute correction masses and residual unbalance."""


@_command("rotorid sensitivity loop.toml --report sensitivity.html")
@_experiment
@click.option(
    "--pair", multiple=True, metavar="E=R", help="Input and its reference column: F_x1=r_x1."
)
@_answers
def sensitivity() -> None:
    """Sensitivity of the loops after ISO 14839-3, and its zone.

    EXPERIMENT names the columns of the references, or --pair does.
    """


@_command("rotorid report run.json --out run.html")
@_result
@_file_option("--out", help="Report to write (HTML; default: RESULT with the ending .html).")
@_writes
def report() -> None:
    """Regenerate the report of a result (HTML).

    RESULT is a file of identify --json.
    """


@_command("rotorid export run.json --to run.mat")
@_result
@_file_option("--to", "target", required=True, help="A file .csv, .mat, .tex, .json.")
@click.option("--speed", default="0 rpm", show_default=True, help="Speed of the state space.")
@_writes
def export() -> None:
    """Export a result to CSV, MATLAB, TeX or JSON.

    The file holds the parameters of RESULT and their covariance.
    """


@_command("rotorid simulate three-mass --out run.h5")
@click.argument("rig", required=False, shell_complete=_names_in("rig"))
@_file_option("--out", help="Record to write (.h5).")
@click.option("--seed", type=click.IntRange(min=0), help="Noise seed (default: from the rig file).")
@click.option("--fault", multiple=True, metavar="NAME[=SIZE]", help="Add a fault; see --faults.")
@_flag("--faults", help="List the faults.")
@click.option(
    "--example",
    type=click.Choice(["your-rig", "sweep", "sensitivity"]),
    help="Write the files that this page of the documentation begins with, into this folder.",
)
@_writes
def simulate() -> None:
    """Simulate a logged record of a levitated rig.

    RIG is a file or a shipped name; none is needed for --faults and --example.
    """


@_command("rotorid new run.csv --model rigid --out run.toml")
@click.argument("files", nargs=-1, required=True, type=_FILE, metavar="FILE...")
@click.option(
    "--model",
    help="A shipped model, or a model file: columns are matched to it.",
    shell_complete=_names_in("models"),
)
@_file_option("--out", help="Experiment file to write (default: standard output).")
@_force_option
@_debug_option
def new() -> None:
    """Draft the experiment file of a record.

    Missing entries are marked with "?".
    """


@_command("rotorid models three-mass")
@click.argument("name", required=False, shell_complete=_names_in("models"))
@_debug_option
def models() -> None:
    """List the shipped models, or show one.

    Shown are the equations and parameters of NAME, or of a file.
    """


@_command("rotorid study study.toml --out results")
@click.argument("study", type=_FILE)
@_file_option("--out", required=True, help="Folder of the results.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes (default: all processors).")
@click.option("--scheduler", help="Dask scheduler in their place, such as tcp://10.0.0.1:8786.")
@_flag("--resume", help="Go on with the results in the folder; no case runs twice.")
@_flag("--summary", help="Summarize what the folder holds, and run nothing.")
@_quiet_option
@_debug_option
def study() -> None:
    """Run many identifications as one job, and summarize them.

    STUDY names a rig, or experiment files, and what varies. The folder gets results.parquet, a row
    per case, summary.json, summary.html, and the files of the worst cases.
    """


@_command("rotorid schema experiment --out experiment.schema.json")
@click.argument("file", type=click.Choice(["experiment", "model", "rotor", "rig", "study"]))
@_file_option("--out", help="File to write (JSON; default: standard output).")
@_force_option
@_debug_option
def schema() -> None:
    """JSON Schema of a kind of file, for editors.

    With it an editor completes and underlines what people write.
    """


def run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit code; errors become one line on stderr."""
    given = shlex.join(["rotorid", *arguments])
    try:
        code = cli.main(list(arguments), "rotorid", standalone_mode=False, obj=given)
        put("", sys.stdout)  # what click has printed may wait in a buffer
        return int(code or OK)
    except (click.Abort, KeyboardInterrupt):
        return _say("interrupted", INTERRUPTED)
    except SystemExit as end:  # a signal; or click's way out, of a completion or without a reader
        if (code := int(end.code or OK)) > SIGNALLED:
            return _say("terminated", code)
        return BROKEN_PIPE if code else OK
    except click.exceptions.Exit as end:  # the reader of the output has gone
        return end.exit_code
    except Exception as error:
        with contextlib.suppress(OSError):
            put("", sys.stdout)
        if isinstance(error, BrokenPipeError):  # of click's: as where we print ourselves
            return BROKEN_PIPE
        if "--debug" in arguments:
            raise
        return _say(*_explained(error))


def _explained(error: Exception) -> tuple[str, int]:
    """Return what went wrong in words, and the exit code.

    What users meet is an `InputError` or an error of the machine with the name of a file.
    Anything else is a fault of the program, whatever its class.
    """
    if isinstance(error, click.UsageError):
        path = error.ctx.command_path if error.ctx else "rotorid"
        return f"{one_line(error.format_message(), LINE - 60)} See {path} --help.", WRONG_INPUT
    if isinstance(error, click.ClickException):
        return error.format_message(), WRONG_INPUT
    if isinstance(error, InputError):
        return str(error), WRONG_INPUT
    if isinstance(error, UnfinishedError):
        return str(error), NO_ANSWER
    if isinstance(error, OSError) and error.filename is not None:
        return f"{one_line(str(error.filename))}: {error.strerror}", WRONG_INPUT
    if isinstance(error, FileNotFoundError):  # without a name: where relative paths begin
        found = "found no working folder, as it was deleted; expected one that is there"
        return f"{found}; change to another folder (cd)", WRONG_INPUT
    if isinstance(error, OSError):
        return error.strerror or str(error), WRONG_INPUT
    if isinstance(error, MemoryError):
        return "out of memory; use a shorter record or fewer lines", WRONG_INPUT
    name, said = type(error).__name__, one_line(str(error))
    if isinstance(error, OverflowError | FloatingPointError) or name == "LinAlgError":
        found = "a numerical failure"
        cure = "check units and scales; --debug shows where"
        return f"{found} ({name}: {said}); expected columns of ordinary size; {cure}", NO_ANSWER
    return f"internal error, {name}: {said}; --debug shows where", NO_ANSWER


def _say(message: str, code: int) -> int:
    """Print one line on stderr, if anyone reads it."""
    with contextlib.suppress(OSError):
        put(f"rotorid: {one_line(message, LINE)}\n", sys.stderr)
    return code


def _stop(number: int, _: object) -> None:
    """Clear away what is half done, as an interrupt does."""
    raise SystemExit(SIGNALLED + number)


def _prepare(arguments: Sequence[str]) -> None:
    """Make a process fit for a terminal, a pipe and a supervisor."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        # What is ignored stays so, as under nohup.
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _stop)
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:  # closed: the next file to be opened would take its place
            os.open(os.devnull, os.O_RDWR)
    if "--debug" not in arguments and not sys.warnoptions:
        # What libraries have to say is for developers; what users must know stands in the answer.
        warnings.simplefilter("ignore")
        logging.lastResort = None
    # What a command loads stays until its end: to search it for garbage takes a tenth of a start.
    gc.set_threshold(100_000)
    # pydantic would look for its plugins in every package that is installed.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def main() -> None:
    arguments = sys.argv[1:]
    _prepare(arguments)
    sys.exit(run(arguments))
