"""Tables: one description, as text and as HTML."""

from rotorid.core.tables import page_html, page_text, table

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
    assert lines[0] == "name       value"
    assert lines[5] == "name       unit"
    assert lines[7] == "k          N/m"
    assert lines[10] == "name       note"
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
    assert table(("a", "b"), []).text() == "a  b"
    assert table(("a", "b"), []).numeric == (False, False)


def test_cells_of_thirty_characters_may_be_broken():
    assert "flow" not in table(("a", "b"), [("x", "w" * 29)]).html()
    assert '<td class="flow">' in table(("a", "b"), [("x", "w" * 30)]).html()
