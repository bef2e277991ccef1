"""JSON Schemas of `rotorid schema` take what the program reads, and no misspelt key."""

import contextlib
import io
import json
import tomllib
from functools import cache
from pathlib import Path

import jsonschema
import pytest
from working_folder import short_rig, simulated

from rotorid import cli

ROOT = Path(__file__).parents[1]
LIBRARY = ROOT / "src" / "rotorid"
SHIPPED = [
    *(("rig", path) for path in sorted((LIBRARY / "rig" / "library").glob("*.toml"))),
    *(("model", path) for path in sorted((LIBRARY / "models" / "library").glob("*.toml"))),
    *(("experiment", path) for path in sorted((ROOT / "examples").rglob("*.toml"))),
    *(("study", path) for path in sorted((ROOT / "docs").glob("*.toml"))),
]


@cache
def validator_of(kind: str) -> jsonschema.Draft202012Validator:
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        assert cli.run(["schema", kind]) == 0
    found = json.loads(shown.getvalue())
    jsonschema.Draft202012Validator.check_schema(found)
    return jsonschema.Draft202012Validator(found)


@pytest.mark.parametrize(("kind", "path"), SHIPPED, ids=lambda value: Path(value).stem)
def test_a_shipped_file_fits_and_a_misspelt_key_does_not(kind, path):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    kind = "rotor" if "sections" in table else kind
    validator = validator_of(kind)
    validator.validate(table)
    with pytest.raises(jsonschema.ValidationError, match="Additional properties"):
        validator.validate({**table, "tiitle": "x"})


def test_the_experiment_file_of_a_rig_fits(tmp_path):
    table = tomllib.loads(simulated(tmp_path, short_rig()).read_text(encoding="utf-8"))
    validator = validator_of("experiment")
    validator.validate(table)
    table["records"][0]["fundamentall"] = "20 Hz"
    with pytest.raises(jsonschema.ValidationError, match="fundamentall"):
        validator.validate(table)


def test_it_is_printed_and_written_again(tmp_path, output, refusal):
    target = tmp_path / "rig.json"
    for _ in range(2):  # what it wrote itself it may replace
        output("schema", "rig", "--out", target)
    assert target.read_text() == output("schema", "rig")
    target.write_text("{}")
    refusal("schema", "rig", "--out", target)
    assert target.read_text() == "{}"
