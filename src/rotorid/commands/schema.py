"""``rotorid schema``."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

from rotorid.commands import OK
from rotorid.commands.console import as_text, check_outputs, say, write
from rotorid.core.files import Kind
from rotorid.core.toml import json_schema

FILES = {
    "experiment": ("rotorid.experiment.schema", "ExperimentFile"),
    "model": ("rotorid.models.loader", "ModelFile"),
    "rotor": ("rotorid.models.rotor.file", "RotorFile"),
    "rig": ("rotorid.rig.schema", "RigFile"),
}
"""The files that people write, and the class that says what may stand in each."""
SCHEMA = Kind("rotorid schema", rb'\{\s*"\$schema": "https://json-schema.org/')


def run(file: str, out: Path | None, force: bool) -> int:
    check_outputs((out, SCHEMA), force=force)
    module, name = FILES[file]
    text = json.dumps(json_schema(getattr(import_module(module), name)), indent=2) + "\n"
    if out is None:
        say(text)
    else:
        write((out, as_text(lambda: text)))
    return OK
