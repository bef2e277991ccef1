"""The command line: what commands there are, their options, and what an error becomes.

Nothing here does work or loads what works: each command is handed to the module of its name in
`rotorid.commands`, which is imported then.
"""

from __future__ import annotations

import gc
import shlex
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from rotorid.commands import INTERRUPTED, NO_ANSWER, OK, WRONG_INPUT

_FILE = click.Path(path_type=Path)
_METHOD = click.Choice(["ls", "batch", "sequential", "ml"])
_SETTINGS = {"help_option_names": ["-h", "--help"]}


def _work(command: str, **options: Any) -> int:
    """Load the module of a command and run it."""
    work: Callable[..., int] = import_module(f"rotorid.commands.{command}").run
    return work(**options)


def _debug_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option(
        "--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."
    )(command)


def _output_options(command: Callable[..., Any]) -> Callable[..., Any]:
    command = click.option("--report", type=_FILE, help="Write a report (HTML).")(command)
    return click.option("--json", type=_FILE, help="Write the result (JSON).")(command)


def _print_version(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from rotorid import __version__  # its look-up takes its time

        click.echo(f"rotorid, version {__version__}")
        context.exit()


@click.group(no_args_is_help=False, context_settings=_SETTINGS)
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_print_version,
    help="Show the version and exit.",
)
@_debug_option
def cli() -> None:
    """Physical parameters of magnetically levitated rotors, from measured forces and positions."""


@cli.command()
@click.option(
    "--runs",
    type=click.IntRange(min=1),
    default=60,
    show_default=True,
    help="Records, each with its own noise.",
)
@_output_options
@_debug_option
def demo(**options: Any) -> int:
    """Simulate the paper's example, identify it, and print its Table 1 beside the paper's."""
    return _work("demo", **options)


@cli.command()
@click.argument("experiment", type=_FILE)
@_output_options
@_debug_option
def inspect(**options: Any) -> int:
    """Say what is in the records of EXPERIMENT, a draft too, before identifying."""
    return _work("inspect", **options)


@cli.command()
@click.argument("experiment", type=_FILE)
@click.option("--method", type=_METHOD, help="In place of the file's.")
@click.option("--strict", is_flag=True, help="Exit with 1 where the data reject the model.")
@_output_options
@_debug_option
@click.pass_obj
def identify(given: str, /, **options: Any) -> int:
    """Estimate the parameters of a machine from the records that EXPERIMENT names."""
    return _work("identify", given=given, **options)


@cli.command()
@click.argument("result", type=_FILE)
@click.argument("experiment", type=_FILE)
@_output_options
@_debug_option
def validate(**options: Any) -> int:
    """Predict the records in EXPERIMENT with RESULT, a file of identify --json."""
    return _work("validate", **options)


@cli.command()
@click.argument("result", type=_FILE)
@click.option("--out", type=_FILE, help="The report (HTML); else RESULT with the ending .html.")
@_debug_option
def report(**options: Any) -> int:
    """Write the report of RESULT again, a file of identify --json."""
    return _work("report", **options)


@cli.command()
@click.argument("result", type=_FILE)
@click.option("--to", "target", required=True, type=_FILE, help="A file .csv, .mat or .tex.")
@_debug_option
def export(**options: Any) -> int:
    """Write the parameters of RESULT, and their covariance, for other programs."""
    return _work("export", **options)


@cli.command()
@click.argument("rig", required=False)
@click.option("--out", type=_FILE, help="The record to write (.h5).")
@click.option("--seed", type=click.IntRange(min=0), help="Of the noise, in place of the file's.")
@click.option("--fault", multiple=True, metavar="NAME[=SIZE]", help="What the rig has besides.")
@click.option("--faults", is_flag=True, help="List the faults.")
@click.option("--force", is_flag=True, help="Replace files that simulate did not write itself.")
@_debug_option
def simulate(**options: Any) -> int:
    """Run the levitated RIG, a file or a shipped one, and record it as a logger does."""
    return _work("simulate", **options)


@cli.command()
@click.argument("files", nargs=-1, required=True, type=_FILE, metavar="FILE...")
@click.option("--model", help="A shipped model, or a model file: columns are matched to it.")
@click.option("--out", type=_FILE, help="The experiment file to write; else it is printed.")
@_debug_option
def new(**options: Any) -> int:
    """Write a draft experiment file for the records in FILE, with what is left to say."""
    return _work("new", **options)


@cli.command()
@click.argument("name", required=False)
@_debug_option
def models(**options: Any) -> int:
    """List the shipped models; or show the equations and parameters of NAME, or of a file."""
    return _work("models", **options)


def run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit code; errors become one line on stderr."""
    given = shlex.join(["rotorid", *arguments])
    try:
        code = cli.main(args=list(arguments), prog_name="rotorid", standalone_mode=False, obj=given)
        sys.stdout.flush()
        return int(code or OK)
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
    # What a command loads stays until its end: to search it for garbage takes a tenth of a start.
    gc.set_threshold(100_000)
    sys.exit(run(sys.argv[1:]))
