import contextlib
import math

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid import InputError
from rotorid.core.units import (
    _table,
    base_powers,
    check_unit,
    multiply_units,
    quantity,
    read_unit,
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


PINT: pint.UnitRegistry[float] = pint.UnitRegistry()
PINT.define("newton_meter = newton * meter = Nm")  # pint: 1000 m/kg
PINT.define("thousandth_inch = 0.001 * inch = mil = mils")  # pint: an angle
PINT.define("@alias revolution = rev")
PINT.define("@alias revolutions_per_minute = cpm = CPM = RPM")
PINT.define("@alias standard_gravity = gn")
PINT.define("@alias pound = lbm")
PINT.define("@alias kilogram_force = kp")
PINT.define("@alias metric_horsepower = PS")  # pint: petasiemens
PINT.define("@alias ampere = amps")  # pint: attometers per second
BASE = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K"}
OTHERWISE = {"hbar", "hbars", "damps"}  # Planck's constant; a length over a time
REFUSED = {"krad", "Mrad", "grad", "Grad", "Gs"}


@pytest.mark.sampled(10)
@pytest.mark.parametrize("prefix", ["", "u", "m", "k", "milli", "kilo"])
@pytest.mark.parametrize(
    "form", ["{}", "{}^2", "1/{}", "kg {}/(s^2 A)", "N * m**2/{}", "({} m)^-2"]
)
def test_the_table_of_units_says_what_pint_says(form: str, prefix: str) -> None:
    """Factor and dimension of each name, alone and in products."""
    names = [
        name for name in _table() if name.startswith(prefix) and name not in OTHERWISE | REFUSED
    ]
    assert len(names) > 30
    for name in names:
        text = form.format(name)
        ours, theirs = read_unit(text), PINT.Quantity(1.0, PINT.parse_units(text)).to_base_units()
        assert ours.factor == pytest.approx(theirs.magnitude, rel=1e-12), text
        powers = {BASE.get(n, n): p for n, p in dict(theirs._units).items()}
        angle = powers.pop("radian", 0)
        powers.pop("count", 0)
        base = base_powers(ours.atoms)
        assert base.pop("rad", 0) == angle, text
        assert base == powers, text
        assert dict(ours.dimension.powers) == powers, text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("N/m/s", "N/(m s)"),
        ("N/m*s", "N s/m"),
        ("(N m)^2", "N^2 m^2"),
        ("N/(m/s)", "N s/m"),
        ("((m))", "m"),
        ("m 1", "m"),
        ("1/s^-1", "s"),
        ("m^-2", "1/m^2"),
    ],
)
def test_products_are_read_from_left_to_right(text: str, expected: str) -> None:
    assert read_unit(text).atoms == read_unit(expected).atoms


@pytest.mark.parametrize(
    "text", ["m//s", "m*/s", "/m", "m*", "()", "(m", "m)", "m^2^3", "^2", "m1"]
)
def test_what_is_no_product_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"no product of units|unknown name"):
        si_factor(text)


@pytest.mark.parametrize("text", ["h^99 h^99", "((h^99)^99)^99", "((um^-99)^99)^9", "Tm^99"])
def test_what_no_number_holds_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="too large or too small"):
        si_factor(text)


@pytest.mark.parametrize(
    ("unit", "factor"), [("rpm", 2 * math.pi / 60), ("kilohertz", 2e3 * math.pi)]
)
def test_quantities_of_pint_are_taken(unit: str, factor: float) -> None:
    assert quantity(PINT.Quantity(3.0, unit), "rad/s") == pytest.approx(3 * factor)
    assert quantity(PINT.Quantity(3.0, "lbf/inch"), "N/m") == pytest.approx(3 * si_factor("lbf/in"))
    assert quantity(PINT.Quantity(3.0, "percent"), "1") == pytest.approx(0.03)
    with pytest.raises(InputError, match="converts to m"):
        quantity(PINT.Quantity(3.0, unit), "m")


@pytest.mark.parametrize("text", ["Nms", "Pas", "c", "alpha", "Ns/m"])
def test_names_that_look_like_units_are_unknown(text: str) -> None:
    """A plural of a product or a constant of nature is no unit of a rotor."""
    with pytest.raises(InputError, match="unknown name"):
        si_factor(text)


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
        ("3 G", "G: write 1e-4 T"),
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
