"""``rotorid schema``."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

from rotorid.commands import OK
from rotorid.commands.console import STDOUT, as_text, check_outputs, write
from rotorid.core.files import MARK, Kind
from rotorid.core.toml import json_schema

FILES = {
    "experiment": ("rotorid.experiment.schema", "ExperimentFile"),
    "model": ("rotorid.models.loader", "ModelFile"),
    "rotor": ("rotorid.models.rotor.rotor_file", "RotorFile"),
    "rig": ("rotorid.rig.file_schema", "RigFile"),
}
"""The files that people write, and the class that says what may stand in each."""
SCHEMA = Kind("rotorid schema")


def run(file: str, out: Path | None, force: bool) -> int:
    check_outputs((out, SCHEMA), force=force)
    module, name = FILES[file]
    found = {**json_schema(getattr(import_module(module), name)), "$comment": MARK}
    text = json.dumps(found, indent=2) + "\n"
    write((STDOUT if out is None else out, as_text(lambda: text, SCHEMA)))
    return OK
