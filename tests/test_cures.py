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
_VALUE = r'"[^"]*"|\{(?:[^{}]|\{[^{}]*\})*\}|\[[^\]]*\]|(?<=scale = )-?\d+|true|false'
SNIPPET = re.compile(rf"\b([A-Za-z]\w*) = ({_VALUE})")


def messages(folder, text: str) -> list[str]:
    """Return what is said of an experiment: its refusal, or warnings and checks of its answer."""
    path = folder / "wrong.toml"
    path.write_text(text, "utf-8")
    try:
        found = rid.load_experiment(path).identify()
    except InputError as error:
        return [str(error)]
    return [*found.warnings, *(f"{check.found}; {check.cure}" for check in found.checks)]


def written(text: str, said: str) -> list[tuple[str, str]]:
    """Return an experiment with what a message tells to write, for each such thing.

    A channel that the message names gets it; where it names none, the first that may have it.
    """
    found = []
    for key, value in SNIPPET.findall(said):
        if key == "positive":  # of the model file
            continue
        tables = [name for name, table in TABLES.items() if key in table.model_fields]
        file = tomlkit.parse(text)
        model = rid.load_model(file["model"])
        if not tables and key in model.parameter_names:
            tables, inside = ["parameters"], loads(f"value = {value}")["value"]
            file.setdefault("parameters", {})[key] = inside
        elif tables:
            inside = loads(f"value = {value}")["value"]
            place = file.setdefault(tables[0], {})
            if tables[0] == "records":
                place = place[0]
            elif tables[0] == "channels":
                named = [name for name in place if name in said] or [*place]
                place = place[named[0]]
            place[key] = inside
        found.append((f"{key} = {value}", tomlkit.dumps(file) if tables else ""))
    return found


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
        for snippet, cured in written(text, said):
            assert cured, f"{snippet!r} stands in no table: {said}"
            assert not accepted(folder, cured), f"{snippet!r} of: {said}"


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
