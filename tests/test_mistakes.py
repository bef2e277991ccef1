"""Deliberate mistakes in an experiment file are named, by the first suspect, a check or a warning.

What a message tells to write is accepted by the reader, in the table where the key may stand.
"""

import json
import re
from tomllib import loads

import numpy as np
import pytest
import tomlkit
from io_writers import write_table
from mistakes import MISTAKES, MISTAKES_IN_LEVERS, THREE, judge

import rotorid as rid
from rotorid import InputError, cli

ENTRIES = {
    "estimator": "EstimatorEntry",
    "records": "RecordEntry",
    "channels": "ChannelEntry",
    "parameters": "ParameterEntry",
}

_VALUE = r'"[^"]*"|\{(?:[^{}]|\{[^{}]*\})*\}|\[[^\]]*\]|(?<=samples = )\d+|(?<=scale = )-?\d+|true'
_ONE = rf"\b[A-Za-z]\w* = (?:{_VALUE})"
SNIPPET = re.compile(rf"\b([A-Za-z]\w*) = ({_VALUE})")
CURE = re.compile(rf"({_ONE}(?: with {_ONE})*)(?: in place of (?:the )?(\w+))?")
"""What a message tells to write, things that belong together with their "with"."""


def written(text: str, said: str, cure: str, instead: str, keys: dict[str, set[str]]) -> str:
    """Return an experiment with what a message tells to write; empty where no table takes a key.

    A channel that the message names gets it, or the first one; of a current, in its table.
    """
    file = tomlkit.parse(text)
    file["records"][0].pop(instead, None)
    for key, value in SNIPPET.findall(cure):
        inside = loads(f"value = {value}")["value"]
        tables = [name for name, known in keys.items() if key in known]
        if not tables and key in rid.load_model(file["model"]).parameter_names:
            tables, inside = ["parameters"], {key: inside}
        if not tables:
            return ""
        place = file.setdefault(tables[0], {})
        if tables[0] == "records":
            place = place[0]
        elif tables[0] == "channels":
            place = place[next((name for name in place if name in said), next(iter(place)))]
            place = place["current"] if key == "scale" and "current" in place else place
        place.update(inside if tables[0] == "parameters" else {key: inside})
    return tomlkit.dumps(file)


def accepted(folder, text: str) -> str:
    """Return why the reader refuses an experiment; nothing where it does not."""
    path = folder / "cured.toml"
    path.write_text(text, "utf-8")
    try:
        experiment = rid.load_experiment(path)
        experiment.records()
        experiment.estimator()
    except InputError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("mistakes")


@pytest.fixture(scope="module")
def keys(folder):
    """Return which keys the tables of an experiment take."""
    assert cli.run(["schema", "experiment", "--out", str(folder / "schema.json")]) == 0
    found = json.loads((folder / "schema.json").read_text())["$defs"]
    return {table: {*found[entry]["properties"]} for table, entry in ENTRIES.items()}


def test_mistakes_are_many():
    assert len(MISTAKES) >= 45
    assert len(MISTAKES_IN_LEVERS) >= 40


astray = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # such estimates overflow


@astray
@pytest.mark.sampled(1, parts=3)
@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.what)
def test_a_mistake_is_named_and_its_cures_are_accepted(mistake, folder, keys):
    """Those of the rigid rig are asked for more below, where its sensors read parameters."""
    verdict = judge(mistake, folder)
    if mistake.rig == THREE:
        assert verdict.named, verdict
        assert verdict.status != "ok"
    text = mistake.edited(folder)
    for said in verdict.said:
        for cure, instead in CURE.findall(said):
            if cure == "positive = true":  # of the model file
                continue
            cured = written(text, said, cure, instead, keys)
            assert cured, f"{cure!r} stands in no table: {said}"
            assert not accepted(folder, cured), f"{cure!r} of: {said}"


@astray
@pytest.mark.sampled(0, parts=3)
@pytest.mark.parametrize("mistake", MISTAKES_IN_LEVERS, ids=lambda mistake: mistake.what)
def test_a_mistake_is_named_first_where_sensors_read_parameters(mistake, folder):
    """As in drafts: by the first suspect, or by those that fit as well as it."""
    verdict = judge(mistake, folder)
    assert verdict.by in ("first suspect", "told with the first"), verdict
    assert verdict.status != "ok"


@pytest.mark.parametrize("missing", [(500, 3000), (3, 3000), (500, 3998)])
@pytest.mark.parametrize("skip", [None, 0.2])
def test_the_longest_stretch_without_a_gap_is_read(tmp_path, missing, skip):
    """Also where the record skips some of it already; times count from the file's first sample."""
    time = np.delete(7.0 + np.arange(4000) / 3e3, missing)
    write_table(tmp_path / "run.csv", "t,x", time, np.sin(time), fmt="%.12g")
    given = {} if skip is None else {"skip": skip}
    with pytest.raises(InputError, match="longest stretch") as refused:
        rid.read_record(tmp_path / "run.csv", columns=["x"], time="t", **given)
    told = {key: loads(f"v = {value}")["v"] for key, value in SNIPPET.findall(str(refused.value))}
    record = rid.read_record(tmp_path / "run.csv", columns=["x"], time="t", **{**given, **told})
    first = 0 if skip is None else 600
    ends = np.array([first - 1, *(m for m in missing if m > first), 4000])
    assert len(record.samples) == max(np.diff(ends)) - 1
