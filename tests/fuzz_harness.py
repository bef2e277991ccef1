"""Commands on hostile files, in forked children with limits, held against what must always be.

A child runs its cases one after the other through `rotorid.cli.run`, so that a start costs
milliseconds, and tells over a pipe what came of each. A child that dies or hangs is a finding of
the case it was at, and another takes up the rest. What must hold of every case is in `faults_of`.
"""

import contextlib
import faulthandler
import gc
import importlib
import io
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

SECONDS = 5.0  # of the processor, that a command may take where `reference` takes REFERENCE
REFERENCE = 0.04
RUNS = 3  # of a case that takes more: slow is what is so in each
PATIENCE = 60.0  # of the clock, after which a child is ended: much else may run on the machine
BYTES = 1_000_000_000  # that a command may take in addition to what is loaded
ADDRESSES = 2 * BYTES  # allocators reserve more than they use; what is used is held against BYTES
LONGEST = 600  # characters of the one line of a refusal
# What commands load when they are called: loaded once, before the children are made.
LOADED = (
    *("rotorid.commands.identify", "rotorid.commands.files", "rotorid.commands.machines"),
    *("rotorid.commands.sensitivity", "rotorid.experiment.draft", "rotorid.rig.files"),
    *("rotorid.results.export", "rotorid.report.estimate_report", "rotorid.report.records"),
    *("rotorid.io.hdf5", "rotorid.io.formats"),
    *("pyarrow.parquet", "nptdms", "pyuff", "asammdf", "matplotlib.pyplot", "scipy.io"),
)


@dataclass(frozen=True)
class Case:
    """A command and the files it finds: `outputs` are those it may write."""

    name: str
    arguments: tuple[str, ...]
    files: Mapping[str, bytes] = field(default_factory=dict)
    prepare: Callable[[Path], object] | None = None  # for what is not bytes
    outputs: tuple[str, ...] = ()
    codes: tuple[int, ...] = (0, 1, 2, 3)
    says: str = ""  # what the refusal must say, among others

    def write(self, folder: Path) -> None:
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        if self.prepare is not None:
            self.prepare(folder)


@dataclass(frozen=True)
class Outcome:
    """What came of a case; `faults` is empty where all is as it must be."""

    name: str
    faults: Sequence[str]
    seconds: float = 0.0
    told: str = ""


Build = Callable[[], Case]


def faults_of(case: Case, code: object, out: str, told: str) -> list[str]:
    """Return what is wrong with an exit code and what was said."""
    found = []
    if code not in case.codes:
        found.append(f"exit {code}, not {' or '.join(map(str, case.codes))}")
    for word in ("Traceback (most recent", "internal error", "out of memory"):
        found += [word] * (word in told + out)
    if code == 2:
        if not (told.startswith("rotorid: ") and told.endswith("\n") and told.count("\n") == 1):
            found.append(f"{told.count(chr(10))} lines on stderr where there should be one")
        if len(told) > LONGEST:
            found.append(f"{len(told)} characters on stderr")
        if case.says not in told:
            found.append(f"does not say {case.says!r}")
    elif told and not told.startswith("rotorid: "):
        found.append("something else on stderr")
    unprintable = {c for c in told + out if not c.isprintable() and c != "\n"}
    return found + [f"prints {c!r}" for c in sorted(unprintable)[:3]]


def _contents(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Return mode, and of files size and time of the last change, of everything in a folder."""
    states = {path: path.lstat() for path in folder.rglob("*")}
    return {
        str(path.relative_to(folder)): (state.st_mode, 0, 0)
        if path.is_dir()
        else (state.st_mode, state.st_size, state.st_mtime_ns)
        for path, state in states.items()
    }


def _file_faults(
    case: Case, code: object, before: Mapping[str, object], after: Mapping[str, object]
) -> list[str]:
    changed = {name for name in {*before, *after} if before.get(name) != after.get(name)}
    allowed = set() if code == 2 else set(case.outputs)
    return [f"changed {name}" for name in sorted(changed - allowed)[:3]]


def _result_faults(case: Case, folder: Path) -> list[str]:
    """Return what is wrong with the result that was written."""
    path, endless = folder / "out.json", list[str]()
    if "out.json" not in case.outputs or not path.is_file():
        return []
    try:
        result = json.loads(path.read_text(encoding="utf-8"), parse_constant=endless.append)
    except ValueError as error:
        return [f"a result that is no JSON: {error}"]
    status = result.get("status", result.get("verdict"))
    if status not in ("ok", "predicts"):
        return []
    empty = None in [value.get("value") for value in result.get("parameters", ())]
    wrong = endless or ["a parameter without a value"] * empty
    return [f"{status} with {what}" for what in wrong[:3]]


def _memory() -> tuple[int, int]:
    """Return the peak of what this process held, and what a child is born with."""
    lines = Path("/proc/self/status").read_text().splitlines()
    told = {name: rest.split() for name, _, rest in (line.partition(":") for line in lines)}
    return 1024 * int(told["VmHWM"][0]), 1024 * int(told["RssAnon"][0])


def _processor() -> float:
    """Return the seconds of the processor that this process took, with its children that read."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def reference() -> float:
    """Return the seconds of the processor that reading a text of fixed length takes here and now.

    A machine that is slow, or has other work that empties its caches, takes more for this too.
    """
    started = _processor()
    sorted(map(float, ("1.25 7 -3e5 " * 60_000).split()))
    return _processor() - started


def too_slow(seconds: float) -> bool:
    """Return whether a command takes more than it may on this machine, as it is now."""
    return seconds > SECONDS and seconds > SECONDS * reference() / REFERENCE


def _largest() -> int:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024


def _clear(folder: Path) -> None:
    for entry in folder.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()


class _Streams:
    """The descriptors 1 and 2 of a child, so that what is written from C is read too."""

    def __init__(self) -> None:
        for number in (1, 2):
            os.dup2(os.memfd_create(str(number)), number)
        sys.stdout = open(1, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115

    def taken(self) -> list[str]:
        """Return what was written since the last time."""
        said = []
        for number, stream in enumerate((sys.stdout, sys.stderr), start=1):
            with suppress(OSError, ValueError):
                stream.flush()
            said.append(os.pread(number, 10_000_000, 0).decode("utf-8", "replace"))
            os.ftruncate(number, 0)
            os.lseek(number, 0, os.SEEK_SET)
        return said


def _run_case(case: Case, folder: Path, streams: _Streams) -> Outcome:
    """Run a case in this process, in an empty folder, and hold it against what must be."""
    from rotorid.cli import run

    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    _clear(folder)
    case.write(folder)
    Path("/proc/self/clear_refs").write_text("5")  # the peak is counted from here
    before, started, largest = _contents(folder), _processor(), _largest()
    held, born = _memory()
    code: object = None
    try:
        code = run(list(case.arguments))
    except BaseException:
        traceback.print_exc()
    seconds = _processor() - started
    more = max(_memory()[0] - held, _largest() - born if _largest() > largest else 0)
    gc.collect()  # what a process of its own tidies at its end: children that read files
    out, told = streams.taken()
    faults = faults_of(case, code, out, told)
    faults += _file_faults(case, code, before, _contents(folder)) + _result_faults(case, folder)
    if more > BYTES:
        faults.append(f"{more / 1e9:.1f} GB")
    return Outcome(case.name, faults, seconds, told[-2000:])


def _judged(case: Case, folder: Path, streams: _Streams) -> Outcome:
    """Run a case, and again where it is slow: other work may have been in its way."""
    runs, slow = list[Outcome](), True
    while slow and len(runs) < RUNS:
        runs.append(_run_case(case, folder, streams))
        slow = too_slow(runs[-1].seconds)
    late = [f"{min(run.seconds for run in runs):.1f} s"] * slow
    faults = dict.fromkeys(fault for run in runs for fault in run.faults)
    return replace(runs[-1], faults=[*late, *faults])


def _serve(builds: Sequence[Build], pipe: int, folder: Path) -> None:
    """Run cases in a child, and tell what came of each."""
    os.setsid()
    faulthandler.disable()  # a signal is told by the parent
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    os.chdir(folder)
    tempfile.tempdir = str(folder)  # what a command leaves in the folder of passing files is seen
    warnings.resetwarnings()
    warnings.simplefilter("always")
    for kind in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
        warnings.simplefilter("ignore", kind)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    streams = _Streams()
    for build in builds:
        outcome = _judged(build(), folder, streams)
        os.write(pipe, (json.dumps(asdict(outcome)) + "\n").encode())


def _fork() -> int:
    sys.stdout.flush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads: what is loaded has some
        return os.fork()


def _until_the_end(builds: Sequence[Build]) -> Iterator[Outcome]:
    """Yield the outcomes of one child; where it ends early, that is what came of its last case."""
    reading, writing = os.pipe()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        process = _fork()
        if not process:
            try:
                _serve(builds, writing, Path(folder))
                os._exit(0)
            finally:
                os._exit(70)
        os.close(writing)
        done = 0
        with open(reading, encoding="utf-8") as lines:
            for line in lines:
                done += 1
                yield Outcome(**json.loads(line))
        code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    if code:
        died = signal.Signals(-code).name if code < 0 else f"the process ended with {code}"
        fault = "hangs" if code == -signal.SIGALRM else died
        yield Outcome(builds[done]().name, (fault,))


def run_cases(builds: Sequence[Build], *, warm: Sequence[Case] = ()) -> Iterator[Outcome]:
    """Run cases in children, and yield their outcomes.

    What a command loads and keeps is there before the children are made: by cases that warm up.
    """
    from rotorid.cli import run

    for module in LOADED:
        with suppress(ImportError):
            importlib.import_module(module)
    for case in warm:
        said = io.StringIO()
        with (
            tempfile.TemporaryDirectory(prefix="fuzz-") as folder,
            contextlib.chdir(folder),
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
        ):
            case.write(Path())
            run(list(case.arguments))
    gc.collect()
    gc.freeze()  # what is loaded is not looked through after every case
    done = 0
    while done < len(builds):
        for outcome in _until_the_end(builds[done:]):
            done += 1
            yield outcome
