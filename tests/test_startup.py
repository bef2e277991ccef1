"""What begins quickly loads nothing that it does not need."""

import os
import subprocess
import sys

import pytest

import rotorid as rid

HEAVY = {
    "h5py",
    "jinja2",
    "lark",
    "matplotlib",
    "numba",
    "numpy",
    "pandas",
    "pint",
    "pydantic",
    "rich",
    "scipy",
    "sympy",
}
COMPLETION = {"_ROTORID_COMPLETE": "bash_complete", "COMP_WORDS": "rotorid id", "COMP_CWORD": "1"}


def loaded(code: str, environment: dict[str, str] | None = None) -> tuple[set[str], str]:
    """Return the packages that a process has loaded when it ends, and what it printed."""
    told = (
        f"import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); {code}"
    )
    process = subprocess.run(
        [sys.executable, "-c", told],
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        check=True,
    )
    return {name.partition(".")[0] for name in process.stderr.split()}, process.stdout


@pytest.mark.parametrize(
    ("code", "environment", "printed"),
    [
        ("import rotorid", {}, ""),
        ("from rotorid.cli import run; run(['--help'])", {}, "identify"),
        ("from rotorid.cli import run; run(['simulate', '-h'])", {}, "RIG"),
        ("from rotorid.cli import run; run([])", COMPLETION, "plain,identify\n"),
    ],
)
def test_what_is_not_needed_is_not_loaded(
    code: str, environment: dict[str, str], printed: str
) -> None:
    packages, out = loaded(code, environment)
    assert "rotorid" in packages
    assert not packages & HEAVY
    assert printed in out


def test_public_names_are_there_and_listed() -> None:
    for name in rid.__all__:
        assert getattr(rid, name) is not None
    assert set(rid.__all__) <= set(dir(rid))
    assert rid.__version__
    with pytest.raises(AttributeError, match="nothing"):
        _ = rid.nothing


def test_a_function_wins_over_the_module_of_its_name() -> None:
    """`rid.identify` is the function, whichever was imported first."""
    code = "import rotorid.identify, rotorid.predict; import rotorid as rid; "
    assert loaded(code + "print(callable(rid.identify), callable(rid.predict))")[1] == "True True\n"
