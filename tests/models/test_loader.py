"""Model files: what is read, what is refused, in one line that names file and place."""

import re

import pytest

from rotorid import InputError, ReadError, load_model, parse_model, shipped_models

FILE = """
title = "a mass on a spring"
equations = ["m*x'' + k*x = F"]
[coordinates]
x = "m"
[inputs]
F = "N"
[parameters]
m = { unit = "kg" }
k = { unit = "N/m" }
"""


def edited(*pairs):
    text = FILE
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def refusal(text):
    with pytest.raises(InputError) as caught:
        parse_model(text, file="bad.toml")
    message = str(caught.value)
    assert re.fullmatch(r"bad\.toml: (.+: )?found .+; expected .+; .+", message)
    assert len(message) < 600
    return message


def test_the_file_itself_is_good():
    model = parse_model(FILE)
    assert model.coordinates == ("x",)
    assert model.inputs == ("F",)
    assert model.parameter_names == ("m", "k")
    assert model.units == {"x": "m", "F": "N"}
    assert model.nominal == {}


def test_units_are_converted_to_si():
    grams = ('"kg" }', '"g", nominal = 250, positive = true }')
    model = parse_model(edited(grams, ('x = "m"', 'x = "mm"')))
    assert model.nominal == {"m": pytest.approx(0.25)}
    assert model.parameters[0].unit == "kg"
    assert model.parameters[0].positive
    assert model.units["x"] == "m"


@pytest.mark.parametrize("name", ["S", "E", "I", "N", "lambda", "beta", "class", "zeta", "Q", "_"])
def test_names_that_mean_something_elsewhere(name):
    model = parse_model(edited(("m*x''", f"{name}*x''"), ("m = {", f"{name} = {{")))
    assert model.base.names == (name, "k")


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([("title", "tittle")], "tittle: found the unknown key 'tittle'; .*did you mean title"),
        ([('title = "a mass on a spring"', "")], "title: found no such key"),
        ([("[inputs]", "[input]")], "input: found the unknown key 'input'.*did you mean inputs"),
        ([('unit = "kg"', 'units = "kg"')], r"parameters\.m\.units: found the unknown key"),
        ([('unit = "kg"', "unit = 1")], r"parameters\.m\.unit: found 1; expected a valid string"),
        ([('"kg"', '"kgg"')], r"parameters\.m\.unit: found unit 'kgg' \(unknown name kgg\)"),
        ([('"kg"', '"degC"')], r"parameters\.m\.unit: found unit 'degC'"),
        ([('"kg"', '"kg", nominal = nan')], r"parameters\.m\.nominal: found nan"),
        ([('"kg"', '"kg", nominal = -1, positive = true')], r"parameters\.m\.nominal: found -1"),
        ([("m = {", "m = 3 #")], r"parameters\.m: found 3; expected a table"),
        ([("k = {", "m = {")], "line 10.*: found a key that is there twice"),
        ([('F = "N"', 'x = "N"')], "inputs: found the name 'x' again"),
        ([("m = {", "F = {")], "parameters: found the name 'F' again"),
        ([("m = {", "Omega = {")], "parameters: found the name 'Omega' again"),
        ([("m = {", "m-a = {")], "parameters: found the name 'm-a'; expected a letter"),
        ([("m = {", '"m\\u0000" = {')], r"parameters: found the name 'm\\x00'"),
        ([('[inputs]\nF = "N"', "")], "unknown name .F."),
        ([('x = "m"', "")], r"coordinates: found \{\}"),
        ([("m*x'' + k*x", "m*x'' + k*x - k*x")], "equations: found 'k' in no equation"),
        ([("k*x", "k*(sin(x)^2 + cos(x)^2 - 1)")], "equations: found 'k' in no equation"),
        ([('F = "N"', 'F = "N"\nG = "N"')], "equations: found 'G' in no equation"),
        ([('x = "m"', 'x = "m"\ny = "m"')], "equations: found 'y' in no equation"),
        ([("= F", "F")], "equation 1: column 13: found 'F'.*write an operator before it"),
        ([("= F", "= F + q")], "equation 1: found the unknown name 'q'"),
        ([("= F", "= F*x")], r"equation 1: found the term F\*x with the input F"),
        ([('= F"', '= F", "x = x"')], "equation 2: found neither a coordinate nor a parameter"),
        ([('= F"', '= F", ""')], "equation 2: column 1: found the end of the text"),
        (
            [("k*x", "k*x + exp(x - 1000)")],
            "equation 1: found exp.-1000., too large or too small",
        ),
        ([("[\"m*x'' + k*x = F\"]", "[1]")], r"equations\.0: found 1"),
        ([("[\"m*x'' + k*x = F\"]", "[]")], r"equations: found \[\]"),
        ([("[\"m*x'' + k*x = F\"]", '"m = F"')], "equations: found 'm = F'"),
        ([("k = {", "z" * 900_000 + " = {")], "parameters: found the name 'zzz"),
        ([('x = "m"\n', "".join(f'x{i} = "m"\n' for i in range(501)))], "coordinates: found"),
        ([("k*x", "z" * 900_000)], "equation 1: found 900012 characters"),
    ],
)
def test_one_line_with_file_and_place(pairs, message):
    assert re.search(message, refusal(edited(*pairs)))


def test_many_equations_that_expand_are_too_many():
    names = [f"p{i}" for i in range(60)]
    square = f"({' + '.join(names)})*x''"
    wide = f"({' + '.join(names)})*({' + '.join(f'x^{i}' for i in range(1, 31))}) = F"
    text = edited(
        ("\"m*x'' + k*x = F\"", ", ".join([f'"{wide}"'] * 200 + [f'"{square} = F"'])),
        ("m = {", "".join(f'{n} = {{ unit = "1" }}\n' for n in names) + "#"),
        ("k = {", "#"),
    )
    assert "equation 3: found more than 5000 terms" in refusal(text)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("three_mass", "found no model 'three_mass'; expected one of emps, flexible"),
        ("three-mass.toml", "three-mass.toml: found no such file"),
        ("a" * 5000, "found no model 'aaa"),
        ("a" * 5000 + ".toml", "found file name too long"),
        ("a\0b", "found no model"),
        ("a\0b.toml", "found a null byte in the name"),
        (".", "found a folder"),
    ],
)
def test_names_of_no_model(tmp_path, name, message):
    with pytest.raises(ReadError, match=message):
        load_model(name, folder=tmp_path)


def test_a_file_in_a_folder_is_called_by_its_stem(tmp_path):
    (tmp_path / "mine.toml").write_text(FILE)
    (tmp_path / "bare").write_text(FILE)
    assert load_model("mine.toml", folder=tmp_path).name == "mine"
    assert load_model(tmp_path / "bare").name == "bare"


@pytest.mark.parametrize("name", shipped_models())
def test_shipped_models_are_files_like_any_other(tmp_path, name):
    from importlib.resources import files

    text = files("rotorid.models").joinpath(f"library/{name}.toml").read_text(encoding="utf-8")
    (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
    model, own = load_model(name), load_model(tmp_path / f"{name}.toml")
    assert own.name == model.name
    assert own.terms == model.terms
    assert own.base.names == model.base.names
    assert set(model.nominal) == set(model.parameter_names)
