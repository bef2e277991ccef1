"""Studies run: cases given out to processes, their rows kept as they come."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

from rotorid.core.errors import InputError
from rotorid.core.watch import watch
from rotorid.studies.plan import load_study
from rotorid.studies.store import Store, held
from rotorid.studies.study_case import FAILED, STOPPED, Row, StudyCase
from rotorid.studies.study_summary import StudySummary, summarize_study

TRIES = 2
"""Processes that a case may end before it is recorded as failed: somebody may have killed one."""
AHEAD = 2
"""Cases given out for each worker, so that none waits for the next; all others are not made yet."""

_ALONE = {  # one thread of linear algebra, and sums in the same order in every process
    "PYTHONHASHSEED": "0",
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    **dict.fromkeys(("NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"),
}


class Processes:
    """Processes in which cases run, one for each thread that asks; each serves many cases."""

    def __init__(self) -> None:
        self._own = threading.local()
        self.all: list[subprocess.Popen[str]] = []
        self.closed = False  # what ends from now on is not to be tried again

    def run(self, case: StudyCase) -> Row:
        """Return the row of a case; one that ends its process is tried again, or has failed."""
        for _ in range(TRIES):
            process, begun = self._process(), time.monotonic()
            with TemporaryDirectory() as folder:  # whose files outlive a process that is killed
                if answer := _asked(process, case, folder):
                    return dict(json.loads(answer))
                process.kill()
                process.communicate()
            self.all.remove(process)
            self._own.process = None
            seconds = time.monotonic() - begun
            if seconds >= case.timeout:
                told = f"not done within {case.timeout:g} s; raise timeout and --resume"
                break
            told = f"its process ended, code {process.returncode} (memory?); --resume repeats it"
        return case.row(FAILED, seconds, verdict=STOPPED, error=told)

    def _process(self) -> subprocess.Popen[str]:
        held: subprocess.Popen[str] | None = getattr(self._own, "process", None)
        if self.closed:
            raise CancelledError
        if held is None:
            held = self._own.process = subprocess.Popen(
                [sys.executable, "-m", "rotorid.studies.study_case"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                env={**os.environ, **_ALONE, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                start_new_session=True,  # an interrupt is for the study, not for its cases
            )
            self.all.append(held)
        return held


def _asked(process: subprocess.Popen[str], case: StudyCase, folder: str) -> str:
    """Send a case, with a folder for its files; return the answer, empty where it ended first."""
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(BrokenPipeError):
        process.stdin.write(json.dumps((asdict(case), folder)) + "\n")
        process.stdin.flush()
    answer = process.stdout.readline()
    return answer if answer.endswith("\n") else ""


_OF_A_WORKER = Processes()


def run_apart(case: StudyCase) -> Row:
    """Run a case in a process of its own beside a worker of a cluster."""
    return _OF_A_WORKER.run(case)


Workers = tuple[Callable[[StudyCase], "Future[Row]"], Callable[[], int]]
"""Who takes a case, and how many they are at the time."""


@contextmanager
def _here(workers: int) -> Iterator[Workers]:
    """Give cases out to processes of this machine."""
    processes, pool = Processes(), ThreadPoolExecutor(workers)
    try:
        yield lambda case: pool.submit(processes.run, case), lambda: workers
    finally:
        processes.closed = True
        for process in processes.all:
            process.kill()
        pool.shutdown(cancel_futures=True)
        for process in processes.all:
            process.communicate()


@contextmanager
def _on_cluster(url: str) -> Iterator[Workers]:
    """Give cases out to the workers of a Dask scheduler."""
    try:
        from distributed import Client
    except ImportError:
        found, cure = "no package distributed", "pip install 'rotorid[cluster]'"
        raise InputError(found, "it, to reach a scheduler", cure, place="--scheduler") from None
    try:
        client = Client(url)
    except (OSError, ValueError) as error:
        found, cure = f"no scheduler at {url} ({error})", "start one: dask scheduler"
        raise InputError(found, "such as tcp://10.0.0.1:8786", cure, place="--scheduler") from None
    with client:
        pool = client.get_executor()
        yield lambda case: pool.submit(run_apart, case), lambda: sum(client.nthreads().values())


def study(
    study: str | Path,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
) -> StudySummary:
    """Run a study, many identifications as one job, and return its summary.

    Parameters
    ----------
    study : str or Path
        A study file (TOML).
    out : str or Path
        The folder of its results: `results.parquet`, a row per case, and the summary.
    workers : int, optional
        Processes on this machine; one for each processor without it.
    scheduler : str, optional
        A Dask scheduler in place of these, such as ``"tcp://10.0.0.1:8786"``.
    resume : bool
        Go on with what is in the folder.

    Returns
    -------
    StudySummary
        Accuracy by point of the grid, errors, worst cases, and ``fleet``: of machines with serial
        numbers, each parameter's common value, scatter, results, and who differs or changed.

    Raises
    ------
    InputError
        For a study file that says what cannot be done, and a folder of other results or a run.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "study.toml").write_text('''
    ... rig = "three-mass"
    ... cases = 2
    ... vary.duration = "1 s"''')
    >>> found = study(folder / "study.toml", folder / "results", workers=1)
    >>> found.groups[0].cases, found.groups[0].statuses
    (2, {'ok': 2})
    """
    if workers is not None and workers not in range(1, 10**4):
        raise InputError(repr(workers), "a number of processes", "write 2, say", place="workers")
    plan, folder = load_study(study), Path(out)
    with held(folder):
        store = Store(folder, plan.identity, resume=resume, timeout=plan.entry.timeout)
        started = _on_cluster(scheduler) if scheduler else _here(workers or os.cpu_count() or 1)
        with started as (submit, count):
            waiting = (number for number in range(len(plan)) if number not in store)
            running: set[Future[Row]] = set()
            while True:
                watch("identifying", len(store), len(plan))
                room = max(0, max(1, AHEAD * count()) - len(running))
                running.update(submit(plan.case(number)) for number in islice(waiting, room))
                if not running:
                    break
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    store.add(future.result())
        store.close()
    return summarize_study(plan, folder)
