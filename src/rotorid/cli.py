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
from click.shell_completion import CompletionItem

from rotorid.commands import INTERRUPTED, NO_ANSWER, OK, WRONG_INPUT

_FILE = click.Path(path_type=Path)
_HERE = Path(__file__).parent
_METHOD = click.Choice(["ls", "batch", "sequential", "ml"])
_SETTINGS = {"help_option_names": ["-h", "--help"]}


def _work(command: str, *, quiet: bool = False, **options: Any) -> int:
    """Load the module of a command and run it, without its tables where nobody reads them."""
    from rotorid.commands.console import STDOUT, silence

    work: Callable[..., int] = import_module(f"rotorid.commands.{command}").run
    with silence(quiet or STDOUT in options.values()):
        return work(**options)


def _example(command: str) -> str:
    """Return what stands below the options in the help of a command."""
    return f"\b\nExample:\n  {command}"


def _names_in(folder: str) -> Callable[..., list[CompletionItem]]:
    """Return what completes the name of a shipped model or rig, else that of a file."""

    def complete(context: object, parameter: object, incomplete: str) -> list[CompletionItem]:
        names = sorted(path.stem for path in (_HERE / folder / "library").glob("*.toml"))
        found = [CompletionItem(name) for name in names if name.startswith(incomplete)]
        return found or [CompletionItem(incomplete, type="file")]

    return complete


def _debug_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option(
        "--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."
    )(command)


def _output_options(command: Callable[..., Any]) -> Callable[..., Any]:
    command = _quiet_option(command)
    command = click.option("--report", type=_FILE, help="Write a report (HTML).")(command)
    told = "Write the result (JSON); - writes it, and nothing else, to the standard output."
    return click.option("--json", type=_FILE, help=told)(command)


def _quiet_option(command: Callable[..., Any]) -> Callable[..., Any]:
    return click.option(
        "--quiet", "-q", is_flag=True, help="Print no tables; warnings of usage and errors stay."
    )(command)


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


@cli.command(epilog=_example("rotorid demo --report demo.html"))
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


@cli.command(epilog=_example("rotorid inspect run.toml --report inspect.html"))
@click.argument("experiment", type=_FILE)
@_output_options
@_debug_option
def inspect(**options: Any) -> int:
    """Say what is in the records of EXPERIMENT, a draft too, before identifying."""
    return _work("inspect", **options)


@cli.command(epilog=_example("rotorid identify run.toml --json run.json --report run.html"))
@click.argument("experiment", type=_FILE)
@click.option("--method", type=_METHOD, help="In place of the file's.")
@click.option("--intervals", is_flag=True, help="Show 95 % intervals in place of deviations.")
@click.option("--strict", is_flag=True, help="Exit with 1 where the data reject the model.")
@_output_options
@_debug_option
@click.pass_obj
def identify(given: str, /, **options: Any) -> int:
    """Estimate the parameters of a machine from the records that EXPERIMENT names."""
    return _work("identify", given=given, **options)


@cli.command(epilog=_example("rotorid validate run.json other-run.toml"))
@click.argument("result", type=_FILE)
@click.argument("experiment", type=_FILE)
@_output_options
@_debug_option
def validate(**options: Any) -> int:
    """Predict the records in EXPERIMENT with RESULT, a file of identify --json."""
    return _work("validate", **options)


@cli.command(epilog=_example("rotorid report run.json --out run.html"))
@click.argument("result", type=_FILE)
@click.option("--out", type=_FILE, help="The report (HTML); else RESULT with the ending .html.")
@_quiet_option
@_debug_option
def report(**options: Any) -> int:
    """Write the report of RESULT again, a file of identify --json."""
    return _work("report", **options)


@cli.command(epilog=_example("rotorid export run.json --to run.mat"))
@click.argument("result", type=_FILE)
@click.option("--to", "target", required=True, type=_FILE, help="A file .csv, .mat or .tex.")
@_quiet_option
@_debug_option
def export(**options: Any) -> int:
    """Write the parameters of RESULT, and their covariance, for other programs."""
    return _work("export", **options)


@cli.command(epilog=_example("rotorid simulate three-mass --out run.h5"))
@click.argument("rig", required=False, shell_complete=_names_in("rig"))
@click.option("--out", type=_FILE, help="The record to write (.h5).")
@click.option("--seed", type=click.IntRange(min=0), help="Of the noise, in place of the file's.")
@click.option("--fault", multiple=True, metavar="NAME[=SIZE]", help="What the rig has besides.")
@click.option("--faults", is_flag=True, help="List the faults.")
@click.option("--force", is_flag=True, help="Replace files that simulate did not write itself.")
@_quiet_option
@_debug_option
def simulate(**options: Any) -> int:
    """Run the levitated RIG, a file or a shipped one, and record it as a logger does."""
    return _work("simulate", **options)


@cli.command(epilog=_example("rotorid new run.csv --model rigid --out run.toml"))
@click.argument("files", nargs=-1, required=True, type=_FILE, metavar="FILE...")
@click.option(
    "--model",
    help="A shipped model, or a model file: columns are matched to it.",
    shell_complete=_names_in("models"),
)
@click.option("--out", type=_FILE, help="The experiment file to write; else it is printed.")
@_debug_option
def new(**options: Any) -> int:
    """Write a draft experiment file for the records in FILE, with what is left to say."""
    return _work("new", **options)


@cli.command(epilog=_example("rotorid models three-mass"))
@click.argument("name", required=False, shell_complete=_names_in("models"))
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
