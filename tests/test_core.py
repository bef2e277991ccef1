"""What everything else stands on: TOML, tables, text on a screen, values, tails, units."""

import ast
import contextlib
import copy
import math
import pickle
from dataclasses import FrozenInstanceError, field, fields, replace
from typing import Any

import numpy as np
import pint
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from source_trees import nodes

from rotorid import InputError, ReadError
from rotorid.core.distributions import chance_of_any, f_limit
from rotorid.core.errors import CELL, LINE, PART, SENTENCE, one_line, printable, shortened
from rotorid.core.linalg import thin_qr, triangle
from rotorid.core.tables import page_html, page_text, table
from rotorid.core.toml import Schema, parse_toml
from rotorid.core.units import (
    MADE,
    PREFIXES,
    STEMS,
    base_powers,
    check_unit,
    multiply_units,
    quantity,
    read_unit,
    si_factor,
    to_si,
)
from rotorid.core.values import frozen, read_only, same

# TOML files checked against a schema: limits, and one line for every fault.


class Row(Schema):
    number: float


class File(Schema):
    rows: tuple[Row, ...] = ()
    title: str = ""


def test_a_key_of_32_parts_is_read_and_of_33_is_not():
    with pytest.raises(ReadError, match="unknown key 'a'"):
        parse_toml(b".".join([b"a"] * 32) + b" = 1", File)
    with pytest.raises(ReadError, match="a key of more than 32 parts"):
        parse_toml(b".".join([b"a"] * 33) + b" = 1", File)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("title = ", "no value in 'title ='.*write key = value"),
        (
            "title = a.csv",
            "line 1, column 9: found no value in 'title = a.csv'.*put texts in quotes",
        ),
        ('title = "a', "a text that does not end"),
        ("zzz = 1\nzzz = 2\n", "line 2.*a key that is there twice in 'zzz = 2'"),
        ("[rows", r"a table that is not closed in '\[rows'"),
        ("title", "a key without a value in 'title'"),
        (r'title = "C:\data"', "a backslash in .*write paths with /"),
        ("rows = [1, 2", "end of document: found a list that is not closed.*close it with"),
        (
            "rows = [{ number = 3 mm }]",
            "table .* not closed, or a value without quotes.*texts in q",
        ),
        ("rows = [3 mm]", "list .* not closed, or a value without quotes.*texts in quotes"),
        ("title = 'a' 'b'", "more behind the value"),
        (
            "rows = [{ nuber = 1 }]",
            r"rows\.0\.nuber: found the unknown key 'nuber'; .*did you mean",
        ),
        ("zzz = 1", "expected one of rows, title; remove it"),
        ("rows = [{}]", r"rows\.0\.number: found no such key; expected a value; add it"),
        ("rows = [{ number = 'x' }]", r"found 'x'; expected a valid number.*write such a value"),
        ("rows = [3]", r"rows\.0: found 3; expected a table, such as \{ key = value \}"),
        ("title = " + "9" * 5000, "a number of more than 400 digits.*with fewer digits"),
    ],
)
def test_faults_are_one_line_with_place_and_cure(text, message):
    with pytest.raises(ReadError, match=message) as found:
        parse_toml(text.encode(), File, file="a.toml")
    assert str(found.value).startswith("a.toml: ")
    assert "\n" not in str(found.value)


# Tables: one description, as text and as HTML.


SHOWN = table(
    ("name", "value", "unit", "note"),
    [("m1", "0.83", "kg", ""), ("k", "-12", "N/m", "fixed"), ("long name", "", "1", "x")],
)


def test_numbers_stand_to_the_right():
    assert SHOWN.numeric == (False, True, False, False)
    assert SHOWN.text().splitlines() == [
        "name       value  unit  note",
        "m1          0.83  kg",
        "k            -12  N/m   fixed",
        "long name         1     x",
    ]


def test_a_narrow_terminal_gets_the_columns_below_each_other():
    lines = SHOWN.text(width=18).splitlines()
    assert max(map(len, lines)) <= 18
    told = {0: "name       value", 5: "name       unit", 7: "k          N/m", 10: "name       note"}
    assert {number: lines[number] for number in told} == told
    assert SHOWN.text(width=1).count("long name") == 3


def test_html_escapes_and_marks_numbers():
    html = table(("<a>", "b"), [("x & y", "3")]).html()
    assert '<th>&lt;a&gt;</th><th class="number">b</th>' in html
    assert '<th scope="row">x &amp; y</th><td class="number">3</td>' in html


def test_words_that_begin_with_a_number_are_words():
    rows = [("x1", "3 samples at the limit of 5e-4 m: lower the gain", "4.05 %", "-1.2e-05")]
    shown = table(("channel", "found", "error", "value"), rows)
    assert shown.numeric == (False, False, True, True)
    assert '<td class="flow">3 samples' in shown.html()


def test_a_page_sets_tables_apart():
    one = table(("a",), [("b",)])
    assert page_text(["first", one, one, "last", one]) == "first\n\na\nb\n\na\nb\n\nlast\n\na\nb"
    assert page_html(["1 < 2", one]).startswith("<p>1 &lt; 2</p><table>")


def test_a_table_without_rows_shows_its_headings():
    empty = table(("a", "b"), [])
    assert (empty.text(), empty.numeric) == ("a  b", (False, False))


def test_cells_of_thirty_characters_may_be_broken():
    assert "flow" not in table(("a", "b"), [("x", "w" * 29)]).html()
    assert '<td class="flow">' in table(("a", "b"), [("x", "w" * 30)]).html()


# Other people's text on a screen and in generated files: printable, cut, and never a key.


@given(st.text())
def test_what_is_shown_is_printable(text):
    assert printable(text).isprintable()
    assert printable(text) == text or not text.isprintable()
    assert one_line(text).isprintable()
    assert page_text([text, table([text, "b"], [[text, text]])]).replace("\n", "").isprintable()


def test_escapes_are_python_s():
    assert printable("a\x1b[31mb\u202ec\udcffd\n") == "a\\x1b[31mb\\u202ec\\udcffd\\n"
    assert printable("µ 日 é\n", keep="\n") == "µ 日 é\n"
    assert one_line(" a \n b ") == "a b"


@pytest.mark.parametrize("most", [PART, LINE, CELL, SENTENCE])
def test_long_texts_keep_both_ends(most):
    text = "begin" + "\x1b" * 200_000 + "end"
    assert len(one_line(text, most)) == most
    assert one_line(text, most).startswith("begin\\x1b")
    assert one_line(text, most).endswith("\\x1bend")
    assert shortened("x" * most, most) == "x" * most
    assert " ... " in shortened("x" * (most + 1), most)


def test_the_cure_is_never_cut_away():
    long = "y" * 200_000
    told = str(InputError(long, long, "write it otherwise", file=long, place=long))
    assert told.endswith("; write it otherwise")
    assert len(told) < 5 * (PART + 20)


def test_cells_and_sentences_are_cut():
    shown = page_text(["z" * 200_000, table(["w" * 200_000, "b"], [["v" * 200_000, "1"]])])
    assert max(map(len, shown.splitlines())) <= SENTENCE
    assert len(shown) < SENTENCE + 4 * CELL


# Values: equal by content, arrays read-only.


@frozen
class Sample:
    """A value with an array and a note that does not count."""

    data: Any
    note: str = field(default="", compare=False)


@pytest.mark.parametrize(
    ("first", "second", "alike"),
    [
        (1.0, 1.0, True),
        (float("nan"), float("nan"), True),
        (np.array([1.0, np.nan]), np.array([1.0, np.nan]), True),
        (np.array([1j, np.nan]), np.array([1j, np.nan]), True),
        (complex("nan"), complex("nan"), True),
        (np.array([1, 2]), np.array([1, 2]), True),
        (np.array(["a"]), np.array(["a"]), True),
        ({"a": np.zeros(2)}, {"a": np.zeros(2)}, True),
        ((1, [np.ones(1)]), (1, [np.ones(1)]), True),
        (Sample(np.ones(3)), Sample(np.ones(3)), True),
        (None, None, True),
        (1.0, 2.0, False),
        (1.0, float("nan"), False),
        (float("nan"), 1.0, False),
        (np.array([1.0, 2.0]), np.array([1.0, 3.0]), False),
        (np.zeros((2, 1)), np.zeros(2), False),
        (np.zeros(2), np.zeros(3), False),
        ({"a": 1}, {"b": 1}, False),
        ({"a": 1}, {"a": 1, "b": 1}, False),
        ((1, 2), (1,), False),
        (np.array([1.0]), np.array(["a"]), False),
        (Sample(np.ones(3)), Sample(np.zeros(3)), False),
        (None, 0.0, False),
    ],
)
def test_values_are_alike_by_what_they_hold(first, second, alike):
    assert same(first, second) == alike
    assert (Sample(first) == Sample(second)) == alike
    assert (Sample(first) != Sample(second)) != alike


def test_what_does_not_count_is_not_compared():
    assert Sample(1, "a") == Sample(1, "b")
    assert Sample(1) != 1
    with pytest.raises(TypeError, match="unhashable"):
        hash(Sample(np.zeros(1)))


def test_a_read_only_view_leaves_its_source_writeable():
    source = np.zeros(2)
    view = read_only(source)
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 1
    source[0] = 2
    assert view[0] == 2


# The decorator of values: what `dataclass(frozen=True)` gives, with methods that are shared.


@frozen
class Mass:
    name: str
    value: float = 1.0
    note: str = field(default="", compare=False)
    table: tuple[float, ...] = field(default=(), repr=False)


@frozen
class Heavier(Mass):
    more: int = 0


@frozen
class Empty:
    pass


@pytest.mark.parametrize(
    ("first", "second", "alike"),
    [
        (("m",), ("m",), True),
        (("m", 1.0, "a"), ("m", 1.0, "b"), True),
        (("m", 2.0), ("m", 1.0), False),
        (("m", 1.0, "", (1.0,)), ("m", 1.0, "", (2.0,)), False),
    ],
)
def test_equality_text_and_hash_are_those_of_a_dataclass(first, second, alike):
    one, other = Mass(*first), Mass(*second)
    assert (one == other) == (hash(one) == hash(other)) == alike
    assert repr(one) == f"Mass(name='m', value={one.value}, note={one.note!r})"


def test_one_class_is_not_another():
    assert Mass("m") != Heavier("m")
    assert Heavier("m", more=1) != 1
    assert Heavier("m", more=1) != Heavier("m", more=2)
    assert Empty() == Empty()
    assert hash(Empty()) == hash(Empty())
    assert repr(Empty()) == "Empty()"
    assert len({Mass("m"), Mass("m", note="again"), Heavier("m")}) == 2


def test_nothing_is_set_afterwards():
    mass = Mass("m")
    with pytest.raises(FrozenInstanceError, match="value"):
        mass.value = 2.0
    with pytest.raises(FrozenInstanceError, match="value"):
        del mass.value
    with pytest.raises(FrozenInstanceError, match="another"):
        mass.another = 2.0
    assert replace(mass, value=2.0) == Mass("m", 2.0)
    assert [each.name for each in fields(Heavier)] == ["name", "value", "note", "table", "more"]


def test_copies_are_equal():
    mass = Heavier("m", 2.0, more=3)
    assert copy.deepcopy(mass) == mass == pickle.loads(pickle.dumps(mass))


def test_every_value_of_the_package_is_made_by_it():
    """But for those whose `==` is identity, which nothing shared could say better."""
    own = [
        (file, kind.name)
        for file, kind in nodes(ast.ClassDef)
        if "dataclass(frozen=True)" in map(ast.unparse, kind.decorator_list)
    ]
    assert not own, "take rotorid.core.values"


# Tails of distributions and where they end.


@pytest.mark.parametrize("r", [0.0, 0.5, 0.9, 1 - 1e-9])
def test_the_chance_that_any_of_three_is_far_out_is_hardly_overrated(r):
    """The sum of the chances would overrate it threefold where the three are one and the same."""
    draws = np.random.default_rng(3).standard_normal((500_000, 4))
    alike = np.sqrt(r) * draws[:, :1] + np.sqrt(1 - r) * draws[:, 1:]
    truth = float((np.abs(alike).max(axis=1) > 2.5758293).mean())  # 1 % of each alone
    found = chance_of_any(0.01, np.full((3, 3), r) + (1 - r) * np.eye(3))
    assert 0.97 * truth < found < 1.1 * truth


@pytest.mark.parametrize(("first", "second"), [(1, 7), (2, 9), (2, 518), (8, 30)])
@pytest.mark.parametrize("chance", [0.4, 1e-3, 1e-9])
def test_a_limit_is_exceeded_with_its_chance(first, second, chance):
    tail = scipy.special.fdtrc(first, second, f_limit(chance, first, second))
    assert tail == pytest.approx(chance, rel=1e-9)


# Units and quantities.


@pytest.mark.parametrize("shape", [(5, 5), (399, 5), (400, 5), (4013, 24), (600, 80)])
def test_a_tall_matrix_is_factored_in_blocks(shape):
    matrix = np.random.default_rng(0).standard_normal(shape)
    basis, upper = thin_qr(matrix)
    np.testing.assert_allclose(basis @ upper, matrix, atol=1e-13)
    np.testing.assert_allclose(basis.T @ basis, np.eye(shape[1]), atol=1e-14)
    for found in (upper, triangle(matrix)):
        np.testing.assert_allclose(np.abs(found), np.abs(np.linalg.qr(matrix)[1]), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("8400 rpm", "rad/s", 2 * math.pi * 140),
        ("140 Hz", "rad/s", 2 * math.pi * 140),
        ("8400 rev/min", "rad/s", 2 * math.pi * 140),
        ("1 rad/s", "Hz", 1 / (2 * math.pi)),
        ("5 1/s", "Hz", 5.0),
        ("90 deg", "rad", math.pi / 2),
        ("-0.5 mm", "m", -5e-4),
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
def test_quantities(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "told"),
    [
        ("8400", "rad/s", "such as '8400 rpm' or '8400 rad/s';"),
        ("300", "m", "such as '300 mm' or '300 m';"),
        ("3", "kg", "such as '3 kg';"),
        ("", "rad", "such as '1 deg' or '1 rad';"),
        ("8400 1/min", "rad/s", "write 'rpm' or 'rad/s'"),
        ("8400 U/min", "rad/s", r"\(U: write rev for a revolution, rpm for one in a minute\)"),
    ],
)
def test_the_unit_that_people_use_is_named(text, unit, told):
    with pytest.raises(InputError, match=told):
        to_si(text, unit)


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
def test_refused_quantities(text, unit, found):
    with pytest.raises(InputError, match="expected") as caught:
        to_si(text, unit, place="records.0.speed")
    assert found in caught.value.found
    assert len(str(caught.value)) < 300
    assert caught.value.place == "records.0.speed"


@pytest.mark.parametrize(
    ("declared", "si", "factor"),
    [
        ("N*s/m", "N*s/m", 1.0),
        ("mm", "m", 1e-3),
        ("g mm^2", "kg m^2", 1e-9),
        ("deg", "rad", math.pi / 180),
        ("rpm", "rad/s", 2 * math.pi / 60),
        ("lbf/inch", "N/m", 175.12683524647645),
        ("%", "1", 0.01),
        ("1", "1", 1.0),
        ("Millivolts", "V", 1e-3),
        ("mN.m", "N m", 1e-3),
        ("Millimeters_per_second", "m/s", 1e-3),
        ("pound_force", "N", 4.4482216152605),
    ],
)
def test_declared_units(declared, si, factor):
    assert check_unit(declared) == si
    assert si_factor(declared) == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize("text", ["", " ", "kgg", "m/", "2 m", "m^0.5", "degC"])
def test_refused_units(text):
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
def test_products(factors, unit):
    assert multiply_units(factors) == unit


_UNITS = st.sampled_from(["kg", "m", "s", "N", "N/m", "N s/m", "kg m^2", "A", "V", "N m"])


@given(st.lists(st.tuples(_UNITS, st.integers(-3, 3)), max_size=5))
def test_products_keep_the_dimension(factors):
    """The text of a product parses, and converts to the product with factor 1."""
    product = " * ".join(f"({unit})^{power}" for unit, power in factors if power) or "1"
    if len(product) <= 64:
        assert si_factor(multiply_units(factors), product) == pytest.approx(1.0)


@given(st.text(max_size=80))
def test_any_text_is_a_unit_or_an_input_error(text):
    with contextlib.suppress(InputError):
        assert si_factor(text) > 0


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
FORMS = [  # a product of a name, and what goes with a power of it
    ("{}", "1", 1),
    ("{}^2", "1", 2),
    ("1/{}", "1", -1),
    ("kg {}/(s^2 A)", "kg/s^2/A", 1),
    ("N * m**2/{}", "N m^2", -1),
    ("({} m)^-2", "m^-2", -2),
]


@pytest.fixture(scope="module")
def theirs():
    """Return what pint makes of every name in base units."""
    every = {*MADE, *(first + stem for first in PREFIXES for stem in STEMS)}
    return {name: PINT.Quantity(1.0, name).to_base_units() for name in every - OTHERWISE - REFUSED}


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("form", "rest", "power"), FORMS)
def test_the_table_of_units_says_what_pint_says(form, rest, power, theirs):
    """Factor and dimension of each name, alone and in products."""
    factor = PINT.Quantity(1.0, rest.replace(" ", "*")).to_base_units()
    for name, one in theirs.items():
        text = form.format(name)
        ours, expected = read_unit(text), factor * one**power
        assert math.isclose(ours.size, expected.magnitude, rel_tol=1e-12), text
        powers = {BASE.get(n, n): p for n, p in dict(expected._units).items()}
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
def test_products_are_read_from_left_to_right(text, expected):
    assert read_unit(text).atoms == read_unit(expected).atoms


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ("m//s, m*/s, /m, m*, (), (m, m), m^2^3, ^2, m1", r"no product of units|unknown name"),
        ("h^99 h^99, ((h^99)^99)^99, ((um^-99)^99)^9, Tm^99", "too large or too small"),
        # A plural of a product or a constant of nature is no unit of a rotor.
        ("Nms, Pas, c, alpha, Ns/m", "unknown name"),
    ],
)
def test_what_is_no_unit_is_refused(texts, message):
    for text in texts.split(", "):
        with pytest.raises(InputError, match=message):
            si_factor(text)


@pytest.mark.parametrize(
    ("unit", "factor"), [("rpm", 2 * math.pi / 60), ("kilohertz", 2e3 * math.pi)]
)
def test_quantities_of_pint_are_taken(unit, factor):
    assert quantity(PINT.Quantity(3.0, unit), "rad/s") == pytest.approx(3 * factor)
    assert quantity(PINT.Quantity(3.0, "lbf/inch"), "N/m") == pytest.approx(3 * si_factor("lbf/in"))
    assert quantity(PINT.Quantity(3.0, "percent"), "1") == pytest.approx(0.03)
    with pytest.raises(InputError, match="converts to m"):
        quantity(PINT.Quantity(3.0, unit), "m")


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
def test_names_that_are_mistaken(text, cure):
    """German for degrees is no gigaradian, and no 400th of a turn either."""
    for expected in ("rad", "kg", "Hz", "rad/s"):
        with pytest.raises(InputError, match=cure):
            to_si(text, expected)
    assert to_si("100 gon", "rad") == pytest.approx(math.pi / 2)
    assert to_si("1 t", "kg") == 1000
