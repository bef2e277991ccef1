"""What begins quickly loads nothing that it does not need."""

import os
import subprocess
import sys

import pytest
from working_folder import make

import rotorid as rid

HEAVY = {
    *("h5py", "jinja2", "matplotlib", "numba", "numpy", "pandas", "pint", "plotly", "pydantic"),
    *("rich", "scipy", "sympy"),
}
COMPLETION = {"_ROTORID_COMPLETE": "bash_complete", "COMP_WORDS": "rotorid id", "COMP_CWORD": "1"}


def modules(code: str, environment: dict[str, str] | None = None) -> tuple[set[str], str]:
    """Return the modules that a process has loaded when it ends, and what it printed."""
    told = (
        f"import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); {code}"
    )
    command, env = [sys.executable, "-c", told], {**os.environ, **(environment or {})}
    process = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    return set(process.stderr.split()), process.stdout


@pytest.mark.parametrize(
    ("code", "environment", "printed"),
    [
        ("import rotorid", {}, ""),
        ("from rotorid.cli import run; run(['--help'])", {}, "identify"),
        ("from rotorid.cli import run; run(['simulate', '-h'])", {}, "RIG"),
        ("from rotorid.cli import run; print(run([]))", COMPLETION, "plain,identify\n0\n"),
    ],
)
def test_what_is_not_needed_is_not_loaded(code, environment, printed):
    names, out = modules(code, environment)
    packages = {name.partition(".")[0] for name in names}
    assert "rotorid" in packages
    assert not packages & HEAVY
    assert printed in out


@pytest.mark.slow
def test_identify_loads_what_a_batch_of_a_shipped_model_needs(tmp_path):
    """No algebra, no formats but the file's own, no other method, no pictures."""
    path = make(tmp_path) / "run.toml"
    names, out = modules(f"from rotorid.cli import run; run(['identify', {str(path)!r}])")
    assert "jeffcott, batch" in out
    packages = {name.partition(".")[0] for name in names}
    assert not packages & (HEAVY - {"numpy", "pydantic", "scipy"})
    parts = ("linalg", "sparse", "special", "stats", "signal", "optimize", "interpolate", "ndimage")
    slow = {"numpy.ma", *(f"scipy.{part}" for part in parts)}
    slow -= modules("import numpy")[0]  # numpy 1 loads its masked arrays by itself
    ours = {"likelihood.estimator", "models.rotor", "rig"}
    tables = {"experiment.table_records"}
    assert names & {*slow, *(f"rotorid.{name}" for name in ours | tables)} == set()


def test_public_names_are_there_and_listed():
    for name in rid.__all__:
        assert getattr(rid, name) is not None
    assert set(rid.__all__) <= set(dir(rid))
    assert rid.__version__
    with pytest.raises(AttributeError, match="nothing"):
        _ = rid.nothing
