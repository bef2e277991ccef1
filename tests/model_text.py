"""Model files as tests write them: a line for the units of coordinates, inputs and parameters."""

import re
from collections.abc import Mapping, Sequence

from rotorid import Model, parse_model

Units = str | Mapping[str, str]
PARAMETER = re.compile(r"(?P<plus>\+)?(?:(?P<nominal>-?[\d.]+(?:e-?\d+)?) )?(?P<unit>.+)")


def model_text(title: str, equations: Sequence[str], *units: Units) -> str:
    """Return a model file: "x m, y m" for coordinates, then for inputs, and for parameters.

    A parameter may have a nominal value before its unit, with a sign where it is `positive`:
    "m +4.0 kg, c 30 N s/m, k N/m".
    """
    coordinates, inputs, parameters = map(_by_name, units)
    lines = [f'title = "{title}"', "equations = [", *(f'  "{text}",' for text in equations), "]"]
    for name, table in (("coordinates", coordinates), ("inputs", inputs)):
        entries = ", ".join(f'{_key(key)} = "{unit}"' for key, unit in table.items())
        lines.append(f"{name} = {{ {entries} }}")
    return "\n".join([*lines, "[parameters]", *map(_entry, parameters.items()), ""])


def model_of(equations: Sequence[str], *units: Mapping[str, str]) -> Model:
    """Return a model of equations, with the coordinates, inputs and parameters that they hold."""
    words = set(re.findall(r"\b[A-Za-z_]\w*", " ".join(equations)))
    held = ({name: unit for name, unit in each.items() if name in words} for each in units)
    return parse_model(model_text("of its equations", equations, *held))


def _by_name(units: Units) -> Mapping[str, str]:
    if not isinstance(units, str):
        return units
    return dict(part.split(" ", 1) for part in units.split(", ") if part)


def _key(name: str) -> str:
    return name if re.fullmatch(r"\w+", name, re.ASCII) else f'"{name}"'


def _entry(parameter: tuple[str, str]) -> str:
    name, told = parameter
    found = PARAMETER.fullmatch(told)
    assert found, told
    nominal = f", nominal = {found['nominal']}" if found["nominal"] else ""
    positive = ", positive = true" if found["plus"] else ""
    return f'{_key(name)} = {{ unit = "{found["unit"]}"{nominal}{positive} }}'
