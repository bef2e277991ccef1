import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid.core.errors import InputError
from rotorid.core.units import (
    _by_pint,
    _by_table,
    _table,
    check_unit,
    multiply_units,
    si_factor,
    to_si,
)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("8400 rpm", "rad/s", 2 * math.pi * 140),
        ("140 Hz", "rad/s", 2 * math.pi * 140),
        ("0.14 kHz", "rad/s", 2 * math.pi * 140),
        ("8400 rev/min", "rad/s", 2 * math.pi * 140),
        ("3 rad/s", "rad/s", 3.0),
        ("180 deg/s", "rad/s", math.pi),
        ("60 rpm", "Hz", 1.0),
        ("1 rad/s", "Hz", 1 / (2 * math.pi)),
        ("5 1/s", "Hz", 5.0),
        ("5 kHz", "Hz", 5000.0),
        ("90 deg", "rad", math.pi / 2),
        ("-0.5 mm", "m", -5e-4),
        ("2e5 N/m", "N/m", 2e5),
        ("+.5e-3 kg*m**2", "kg m^2", 5e-4),
        ("3 N·m", "N m", 3.0),
        ("3 Nm", "N m", 3.0),
        ("22 µm", "m", 22e-6),
        ("1 kg m²", "kg m^2", 1.0),
        ("3", "1", 3.0),
        ("2 %", "1", 0.02),
        (3, "1", 3.0),
    ],
)
def test_quantities(text: object, unit: str, value: float) -> None:
    assert to_si(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "found"),
    [
        ("8400", "rad/s", "without a unit"),
        (8400, "rad/s", "without a unit"),
        ("140 1/s", "rad/s", "'1/s'"),  # radians or revolutions?
        ("5 N", "m", "'N'"),
        ("5 furlongz", "m", "furlongz"),
        ("20 degC", "K", "degC"),
        ("3 dB", "1", "dB"),
        ("1,5 mm", "m", "1,5 mm"),
        ("1.2.3 mm", "m", "1.2.3 mm"),
        ("nan m", "m", "nan m"),
        ("1e999 m", "m", "1e999 m"),
        ("m", "m", "'m'"),
        ("", "m", "''"),
        (True, "1", "True"),
        (None, "m", "None"),
        ([1], "m", "[1]"),
        ("3 m^99", "m", "m^99"),
        ("3 m**9**9**9**9", "m", "9**9"),
        ("3 9**9**9**9**9", "1", "9**9"),
        ("3 __import__('os')", "m", "__import__"),
        ("3 " + "m" * 10_000, "m", "mmmm"),
        ("3 " + "(" * 30 + "m" + ")" * 29, "m", "((("),
    ],
)
def test_refused_quantities(text: object, unit: str, found: str) -> None:
    with pytest.raises(InputError, match="expected") as caught:
        to_si(text, unit, place="records.0.speed")
    assert found in caught.value.found
    assert len(str(caught.value)) < 300
    assert caught.value.place == "records.0.speed"


@pytest.mark.parametrize(
    ("declared", "si", "factor"),
    [
        ("N s/m", "N s/m", 1.0),
        ("N*s/m", "N*s/m", 1.0),
        ("kg m^2", "kg m^2", 1.0),
        ("mm", "m", 1e-3),
        ("N/mm", "N/m", 1e3),
        ("kN s/m", "N s/m", 1e3),
        ("g mm^2", "kg m^2", 1e-9),
        ("mrad", "rad", 1e-3),
        ("deg", "rad", math.pi / 180),
        ("rpm", "rad/s", 2 * math.pi / 60),
        ("mT", "T", 1e-3),
        ("lbf/inch", "N/m", 175.12683524647645),
        ("%", "1", 0.01),
        ("1", "1", 1.0),
    ],
)
def test_declared_units(declared: str, si: str, factor: float) -> None:
    assert check_unit(declared) == si
    assert si_factor(declared) == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize("text", ["", " ", "kgg", "m/", "2 m", "m^0.5", "degC"])
def test_refused_units(text: str) -> None:
    with pytest.raises(InputError, match="a unit such as"):
        check_unit(text)


@pytest.mark.parametrize(
    ("factors", "unit"),
    [
        ([], "1"),
        ([("N/m", 1), ("m", 1)], "N"),
        ([("N/m", 1), ("m", 2)], "N m"),
        ([("kg", 1), ("m", 1)], "kg m"),
        ([("kg m^2", 1), ("rad", 1)], "kg m^2"),
        ([("N s/m", 1), ("m", 2)], "N m s"),
        ([("kg", 1), ("rad/s", 2), ("m", 1)], "N"),
        ([("rad", 1)], "rad"),
        ([("rad", 2)], "1"),
        ([("m", 1), ("m", -1)], "1"),
        ([("m", -2)], "1/m^2"),
        ([("N/A", 1)], "N/A"),
        ([("N", 1), ("A", -1), ("m", -1)], "N/(A m)"),
        ([("Nm", 1), ("m", -1)], "N"),
    ],
)
def test_products(factors: list[tuple[str, int]], unit: str) -> None:
    assert multiply_units(factors) == unit


_UNITS = st.sampled_from(["kg", "m", "s", "N", "N/m", "N s/m", "kg m^2", "A", "V", "N m"])


@given(st.lists(st.tuples(_UNITS, st.integers(-3, 3)), max_size=5))
def test_products_keep_the_dimension(factors: list[tuple[str, int]]) -> None:
    """The text of a product parses, and converts to the product with factor 1."""
    product = " * ".join(f"({unit})^{power}" for unit, power in factors if power) or "1"
    if len(product) <= 64:
        assert si_factor(multiply_units(factors), product) == pytest.approx(1.0)


@given(st.text(max_size=80))
def test_any_text_is_a_unit_or_an_input_error(text: str) -> None:
    with contextlib.suppress(InputError):
        assert si_factor(text) > 0


@given(st.floats(-1e12, 1e12), st.sampled_from(["um", "mm", "m", "km", "inch"]))
def test_quantities_as_written(number: float, unit: str) -> None:
    assert to_si(f"{number!r} {unit}", "m") == pytest.approx(number * si_factor(unit), rel=1e-12)


def test_a_unit_of_64_characters_is_read_and_of_65_is_not():
    text = "m *" + "m*" * 30 + "m"
    assert len(text) == 64
    assert si_factor(text) == 1.0
    with pytest.raises(InputError, match="no product of units"):
        si_factor(text.replace("m *", "m * "))


@pytest.mark.parametrize("name", _table())
def test_the_table_of_common_units_says_what_pint_says(name: str) -> None:
    """Factor, symbols, dimension and the kind of rate, alone and in products."""
    for form in ("{}", "{}^2", "1/{}", "kg {}/(s^2 A)", "N * m**2/{}"):
        ours, theirs = (read(form.format(name)) for read in (_by_table, _by_pint))
        assert ours is not None
        assert theirs is not None
        assert ours.factor == pytest.approx(theirs.factor, rel=1e-14)
        assert (ours.atoms, ours.dimension) == (theirs.atoms, theirs.dimension)
        assert ours.turns == theirs.turns


@pytest.mark.parametrize("text", ["N/m/s", "furlong", "m^2.5", "(N m)^2", "N/(m/s)", "m 1"])
def test_what_the_table_does_not_hold_is_for_pint(text: str) -> None:
    assert _by_table(text) is None


@pytest.mark.parametrize(
    ("text", "cure"),
    [
        ("70 Grad", "Grad: write deg"),
        ("70 grad", "grad: write deg"),
        ("1 krad", "krad: write rad"),
        ("1 ton", "ton: write t for 1000 kg"),
        ("2 bit", "bit: write 1"),
        ("20 Bq", "Bq: write 1"),
        ("3 kB/s", "kB: write 1"),
        ("140 Hz*deg", "turns in a second, times an angle"),
    ],
)
def test_names_that_are_mistaken(text: str, cure: str) -> None:
    """German for degrees is no gigaradian, and no 400th of a turn either."""
    for expected in ("rad", "kg", "Hz", "rad/s"):
        with pytest.raises(InputError, match=cure):
            to_si(text, expected)
    assert to_si("100 gon", "rad") == pytest.approx(math.pi / 2)
    assert to_si("1 t", "kg") == 1000
