"""Fuzzing guided by coverage, for as long as one wants: `make fuzz`.

    python tests/fuzz_atheris.py model --seconds 600

A target hands bytes to one part of the package; an `InputError` is an answer, any other exception
a finding, as are more than five seconds and more than a gigabyte beyond what is loaded. What is
found stands in the folder `fuzz-findings`; to run one again, name the file:

    python tests/fuzz_atheris.py model fuzz-findings/model-crash-...

The files tried start from the good ones of `fuzz_files.py` and from the corpus; those that reach
new code are kept in `.fuzz`, and start the next run.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["rotorid"]):
    import rotorid.answer.result_file
    import rotorid.core.toml
    import rotorid.experiment.experiment
    import rotorid.experiment.schema
    import rotorid.io.table
    import rotorid.io.text
    import rotorid.models.expressions
    import rotorid.models.parser
    import rotorid.rig.file
from corpus import CASES
from corpus.texts import EXPRESSIONS, named
from fuzz_files import FORMATS
from fuzz_harness import BYTES, SECONDS

from rotorid import InputError

LOADED = 700  # MB of what is imported, with the counters of the coverage
LONGEST = 20_000  # bytes of a file that is tried: what is wrong shows in small ones


def try_model(data: bytes) -> None:
    model = rotorid.models.loader.parse_model(data)
    str(model)


def try_toml(data: bytes) -> None:
    """Parse an experiment or a rig, by the first byte."""
    if data[:1] == b"r":
        rotorid.rig.file.parse_rig(data[1:].decode("utf-8", "replace"), folder=FOLDER)
    else:
        schema = rotorid.experiment.schema.ExperimentFile
        rotorid.core.toml.parse_toml(data[1:], schema)


def try_result(data: bytes) -> None:
    estimate = rotorid.answer.result_file.load_estimate(laid(data, "result.json"))
    str(estimate)
    estimate.save(os.devnull)


def try_csv(data: bytes) -> None:
    read_all(rotorid.io.text.open_delimited(laid(data, "run.csv")))


def try_mat(data: bytes) -> None:
    read_all(rotorid.io.table.open_table(laid(data, "run.mat")))


TARGETS: dict[str, tuple[Callable[[bytes], None], tuple[str, ...]]] = {
    "model": (try_model, ("model", "equations")),
    "toml": (try_toml, ("experiment", "phasors", "rig")),
    "result": (try_result, ("result",)),
    "csv": (try_csv, ("csv", "txt", "lvm")),
    "mat": (try_mat, ("mat4", "mat5", "mat5-packed")),
}
FOLDER = tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None)


def laid(data: bytes, name: str) -> Path:
    """Return a file that holds these bytes, in memory where the machine has such a folder."""
    path = Path(FOLDER) / name
    path.write_bytes(data)
    return path


def read_all(table: object) -> None:
    """Read every column that a table names."""
    for name in table.names[:20]:  # type: ignore[attr-defined]
        table.read([table.find(name)])  # type: ignore[attr-defined]


def seeds(target: str, folder: Path) -> None:
    """Lay down the files from which a target starts."""
    folder.mkdir(parents=True, exist_ok=True)
    found = [data for name in TARGETS[target][1] for data in FORMATS[name].good()]
    if target == "model":
        found += [named(text) for text in EXPRESSIONS.values() if len(text) < 2000]
    names = {"result": "result.json", "csv": "run.csv", "mat": "run.mat"}
    if target in names:
        cases = [case().files.get(names[target], b"") for case in CASES.values()]
        found += sorted({data for data in cases if 0 < len(data) < LONGEST})
    if target == "toml":
        laid(FORMATS["model"].good()[0], "model.toml")  # that of the rigs
        rigs = FORMATS["rig"].good()
        found = [b"e" + data for data in found if data not in rigs] + [b"r" + d for d in rigs]
    for number, data in enumerate(found):
        (folder / f"good-{number:03}").write_bytes(data)


def main() -> None:
    """Fuzz a target until the time is over or something is found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("file", nargs="?", help="what was found, to run it again")
    asked = parser.parse_args()
    work = TARGETS[asked.target][0]

    def once(data: bytes) -> None:
        try:
            work(data)
        except InputError as error:
            told = str(error)
            if "\n" in told or not told:
                raise AssertionError(f"no one line: {told!r}") from error

    kept, findings = Path(".fuzz") / asked.target, Path("fuzz-findings")
    findings.mkdir(exist_ok=True)
    seeds(asked.target, kept)
    options = [
        f"-max_total_time={asked.seconds}",
        f"-timeout={SECONDS:.0f}",
        f"-rss_limit_mb={LOADED + BYTES // 10**6}",
        f"-max_len={LONGEST}",
        f"-artifact_prefix={findings}/{asked.target}-",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *options, asked.file or str(kept)], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
