"""Commands on hostile files, in forked children with limits, held against what must always be.

A child runs its cases one after the other through `rotorid.cli.run`, so that a start costs
milliseconds, and tells over a pipe when one begins and what came of it. A child that dies or
hangs is a finding of the case it was at, and another takes up the rest. What must hold of every
case is in `faults_of`.
"""

import faulthandler
import gc
import importlib
import json
import math
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

SECONDS = 5.0  # of the processor, that a command may take
PATIENCE = 60.0  # of the clock, after which a child is ended: much else may run on the machine
BYTES = 1_000_000_000  # that a command may take in addition to what is loaded
ADDRESSES = 2 * BYTES  # allocators reserve more than they use; what is used is held against BYTES
LONGEST = 600  # characters of the one line of a refusal
CODES = (0, 1, 2, 3)
# What commands load when they are called: loaded once, before the children are made.
LOADED = (
    *("rotorid.commands.identify", "rotorid.commands.inspect", "rotorid.commands.validate"),
    *("rotorid.commands.modes", "rotorid.commands.balance", "rotorid.models"),
    *("rotorid.report.record_tables", "rotorid.experiment.draft", "rotorid.rig.files"),
    *("rotorid.results.export", "rotorid.report.estimate_report"),
    *("rotorid.io.hdf5", "rotorid.io.formats"),
    *("pyarrow.parquet", "nptdms", "pyuff", "asammdf", "matplotlib.pyplot", "scipy.io"),
)


@dataclass(frozen=True)
class Case:
    """A command and the files it finds: `outputs` are those it may write."""

    name: str
    arguments: tuple[str, ...]
    files: Mapping[str, bytes] = field(default_factory=dict)
    prepare: Callable[[Path], object] | None = None  # for what is not bytes: pipes, links
    outputs: tuple[str, ...] = ()
    codes: tuple[int, ...] = CODES
    says: str = ""  # what the refusal must say, among others


@dataclass(frozen=True)
class Outcome:
    """What came of a case; `faults` is empty where all is as it must be."""

    name: str
    code: int | None
    seconds: float
    bytes: int
    told: str
    faults: tuple[str, ...]
    status: str = ""


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
    found = {}
    for root, folders, files in os.walk(folder):
        for name in [*folders, *files]:
            path = os.path.join(root, name)
            state = os.lstat(path)
            changed = 0 if name in folders else state.st_mtime_ns
            found[os.path.relpath(path, folder)] = (state.st_mode, state.st_size, changed)
    return {n: (m, 0 if os.path.isdir(folder / n) else s, t) for n, (m, s, t) in found.items()}


def _file_faults(case: Case, code: object, before: object, folder: Path) -> list[str]:
    after = _contents(folder)
    assert isinstance(before, dict)
    changed = {name for name in {*before, *after} if before.get(name) != after.get(name)}
    allowed = set() if code == 2 else set(case.outputs)
    return [f"changed {name}" for name in sorted(changed - allowed)[:3]]


def _numbers(value: object, key: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, float):
        yield key, value
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield from _numbers(inner, f"{key}.{name}")
    elif isinstance(value, list):
        for inner in value:
            yield from _numbers(inner, key)


def _result_faults(case: Case, folder: Path) -> tuple[str, list[str]]:
    """Return the status of the result that was written, and what is wrong with it."""
    path = folder / "out.json"
    if "out.json" not in case.outputs or not path.is_file():
        return "", []
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        return "", [f"a result that is no JSON: {error}"]
    status = str(result.get("status", result.get("verdict", "")))
    found = []
    if status in ("ok", "predicts"):
        endless = [key for key, number in _numbers(result) if not math.isfinite(number)]
        found += [f"{status} with{key} not finite" for key in endless[:3]]
        missing = [v["name"] for v in result.get("parameters", ()) if v.get("value") is None]
        found += [f"{status} without a value of {name}" for name in missing[:3]]
    return status, found


@contextmanager
def _captured(folder: Path) -> Iterator[list[str]]:
    """Take what is written to the descriptors 1 and 2, from C too."""
    said: list[str] = []
    streams = [os.memfd_create(name) for name in ("out", "err")]
    kept, before = [os.dup(1), os.dup(2)], (sys.stdout, sys.stderr)
    here = os.getcwd()
    os.chdir(folder)
    for number, stream in zip((1, 2), streams, strict=True):
        os.dup2(stream, number)
    sys.stdout = open(1, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
    try:
        yield said
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        sys.stdout, sys.stderr = before
        os.chdir(here)
        for number, saved in zip((1, 2), kept, strict=True):
            os.dup2(saved, number)
            os.close(saved)
        for stream in streams:
            said.append(os.pread(stream, 10_000_000, 0).decode("utf-8", "replace"))
            os.close(stream)


def _peak() -> int:
    status = Path("/proc/self/status").read_text()
    return next(int(s.split()[1]) for s in status.splitlines() if s.startswith("VmHWM")) * 1024


def _reset_peak() -> int:
    Path("/proc/self/clear_refs").write_text("5")
    return _peak()


def _processor() -> float:
    """Return the seconds of the processor that this process took, with its children that read."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _largest() -> int:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024


def _clear(folder: Path) -> None:
    for entry in folder.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()


def run_case(case: Case, folder: Path) -> Outcome:
    """Run a case in this process, in an empty folder, and hold it against what must be."""
    from rotorid.cli import run

    _clear(folder)
    for name, content in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    if case.prepare is not None:
        case.prepare(folder)
    before, held, started, largest = _contents(folder), _reset_peak(), _processor(), _largest()
    code: object = None
    with _captured(folder) as said:
        try:
            code = run(list(case.arguments))
        except BaseException:
            traceback.print_exc()
    seconds = _processor() - started
    more = max(_peak(), _largest() if _largest() > largest else 0) - held
    gc.collect()  # what a process of its own tidies at its end: children that read files
    out, told = said
    faults = faults_of(case, code, out, told) + _file_faults(case, code, before, folder)
    status, wrong = _result_faults(case, folder)
    faults += wrong
    if seconds > SECONDS:
        faults.append(f"{seconds:.1f} s")
    if more > BYTES:
        faults.append(f"{more / 1e9:.1f} GB")
    exit_code = code if isinstance(code, int) else None
    return Outcome(case.name, exit_code, seconds, more, told[-2000:], tuple(faults), status)


def _serve(builds: Sequence[Build], numbers: Sequence[int], pipe: int) -> None:
    """Run cases in a child, and tell of each when it begins and what came of it."""
    os.setsid()
    faulthandler.disable()  # a signal is told by the parent
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    tempfile.tempdir = str(folder)  # what a command leaves in the folder of passing files is seen
    warnings.resetwarnings()
    warnings.simplefilter("always")
    for kind in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
        warnings.simplefilter("ignore", kind)
    tell = lambda *what: os.write(pipe, (json.dumps(what) + "\n").encode())  # noqa: E731
    tell("folder", str(folder))
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for number in numbers:
        case = builds[number]()
        tell("begin", number, case.name)
        outcome = run_case(case, folder)
        if outcome.seconds > SECONDS:  # other work on the machine slows this one down too
            outcome = min(outcome, run_case(case, folder), key=lambda o: o.seconds)
        tell("end", number, asdict(outcome))
    _clear(folder)


class _Child:
    """A forked child, the cases it has left, and the one it is at."""

    def __init__(self, builds: Sequence[Build], left: list[int]) -> None:
        self.left, self.at, self.since, self.text = left, "", time.monotonic(), b""
        self.folder = ""
        self.pipe, end = os.pipe()
        sys.stdout.flush()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # threads: what is loaded has some
            self.process = os.fork()
        if not self.process:
            os.close(self.pipe)
            code = 70
            try:
                _serve(builds, left, end)
                code = 0
            except BaseException:
                traceback.print_exc(file=sys.__stderr__)
            finally:
                os._exit(code)
        os.close(end)

    def read(self) -> Iterator[Outcome]:
        """Yield the outcomes that have come; at the end of the pipe the process is reaped."""
        data = os.read(self.pipe, 1 << 16)
        self.text += data
        *lines, self.text = self.text.split(b"\n")
        for line in lines:
            word, *rest = json.loads(line)
            self.since = time.monotonic()
            if word == "folder":
                self.folder = rest[0]
            elif word == "begin":
                self.at = rest[1]
            else:
                self.left.remove(rest[0])
                self.at = ""
                yield Outcome(**{**rest[1], "faults": tuple(rest[1]["faults"])})
        if not data:
            yield from self._ended()

    def _ended(self) -> Iterator[Outcome]:
        _, status = os.waitpid(self.process, 0)
        os.close(self.pipe)
        self.pipe = -1
        shutil.rmtree(self.folder, ignore_errors=True)
        if os.WIFSIGNALED(status):
            number = os.WTERMSIG(status)
            fault = "hangs" if number == signal.SIGKILL else signal.Signals(number).name
        elif os.WEXITSTATUS(status):
            fault = f"the process ended with {os.WEXITSTATUS(status)}"
        else:
            return
        if not self.at:
            raise RuntimeError(f"a child died between two cases: {fault}")
        self.left.pop(0)
        yield Outcome(self.at, None, time.monotonic() - self.since, 0, "", (fault,))


def run_cases(
    builds: Sequence[Build], *, workers: int = 2, warm: Sequence[Case] = ()
) -> Iterator[Outcome]:
    """Run cases in children, as many at a time as there are workers, and yield their outcomes.

    What a command loads and keeps is there before the children are made: by cases that warm up.
    """
    for module in LOADED:
        with suppress(ImportError):
            importlib.import_module(module)
    gc.collect()
    gc.freeze()  # what is loaded is not looked through after every case
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        for case in warm:
            run_case(case, Path(folder))
    gc.collect()
    gc.freeze()
    shares = [list(range(first, len(builds), workers)) for first in range(workers)]
    children = [_Child(builds, share) for share in shares if share]
    while children:
        ready, _, _ = select.select([c.pipe for c in children], [], [], 0.5)
        for child in list(children):
            if child.pipe in ready:
                yield from child.read()
            elif child.at and time.monotonic() - child.since > PATIENCE:
                os.kill(child.process, signal.SIGKILL)
            if child.pipe < 0:
                children.remove(child)
                if child.left:
                    children.append(_Child(builds, child.left))
