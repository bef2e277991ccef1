"""What messages tell to write is accepted by the reader, in the table where the key may stand."""

import re
from tomllib import loads

import mistakes
import numpy as np
import pytest
import tomlkit
from io_writers import write_table

import rotorid as rid
from rotorid import InputError
from rotorid.experiment import schema

TABLES = {
    "estimator": schema.EstimatorEntry,
    "records": schema.RecordEntry,
    "channels": schema.ChannelEntry,
    "parameters": schema.ParameterEntry,
}
_VALUE = r'"[^"]*"|\{(?:[^{}]|\{[^{}]*\})*\}|\[[^\]]*\]|(?<=samples = )\d+|(?<=scale = )-?\d+|true'
_ONE = rf"\b[A-Za-z]\w* = (?:{_VALUE})"
SNIPPET = re.compile(rf"\b([A-Za-z]\w*) = ({_VALUE})")
CURE = re.compile(rf"({_ONE}(?: with {_ONE})*)(?: in place of (?:the )?(\w+))?")
"""What a message tells to write, things that belong together with their "with"."""


def messages(folder, text: str) -> list[str]:
    """Return what is said of an experiment: its refusal, or warnings and checks of its answer."""
    path = folder / "wrong.toml"
    path.write_text(text, "utf-8")
    try:
        found = rid.load_experiment(path).identify()
    except InputError as error:
        return [str(error)]
    return [*found.warnings, *(f"{check.found}; {check.cure}" for check in found.checks)]


def written(text: str, said: str, cure: str, instead: str) -> str:
    """Return an experiment with what a message tells to write; empty where no table takes a key.

    A channel that the message names gets it, or the first one; of a current, in its table.
    """
    file = tomlkit.parse(text)
    file["records"][0].pop(instead, None)
    for key, value in SNIPPET.findall(cure):
        inside = loads(f"value = {value}")["value"]
        tables = [name for name, table in TABLES.items() if key in table.model_fields]
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
    return tmp_path_factory.mktemp("cures")


FAST = ("the hold left out",)


@pytest.mark.parametrize(
    "mistake",
    [
        pytest.param(each, id=each.what, marks=() if each.what in FAST else pytest.mark.slow)
        for each in mistakes.MISTAKES
    ],
)
def test_the_cures_of_a_mistake_are_accepted(mistake, folder):
    text = mistake.edit(mistakes.experiment_of(mistake.rig, folder))
    for said in messages(folder, text):
        for cure, instead in CURE.findall(said):
            if cure == "positive = true":  # of the model file
                continue
            cured = written(text, said, cure, instead)
            assert cured, f"{cure!r} stands in no table: {said}"
            assert not accepted(folder, cured), f"{cure!r} of: {said}"


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
