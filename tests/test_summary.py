"""Results that speak: as text, as a table in a notebook, short in the interpreter."""

from lxml import html

from irbcal.summary import Speaks, Table, as_text

TABLE = Table(
    "Errors, mm", ("model", "points", "mean"), (("a<b", 3, 0.12345), ("[red]c", None, 2.0)), bold=frozenset({1})
)


class Result(Speaks):
    def __init__(self, words):
        self.words = words

    def told(self):
        return [self.words, TABLE]


def test_numbers_have_their_digits_and_names_stay_as_they_are():
    text = as_text([TABLE, "Note: [bold]x"])
    assert "a<b" in text
    assert "[red]c" in text
    assert "0.123" in text
    assert "–" in text
    assert text.splitlines()[0] == "Errors, mm"
    assert text.splitlines()[-1] == "Note: [bold]x"


def test_numbers_stand_on_the_right():
    assert TABLE.on_the_right() == [False, True, True]
    rows = [line for line in as_text([TABLE]).splitlines() if "0.123" in line or "2.000" in line]
    assert len({line.rstrip().index(".") for line in rows}) == 1


def test_html_is_escaped_and_whole():
    page = Result("<script>")._repr_html_()
    assert "<script>" not in page
    table = html.fragment_fromstring(page).find(".//table")
    assert [cell.text_content() for cell in table.findall(".//td")] == ["a<b", "3", "0.123", "[red]c", "–", "2.000"]


def test_a_long_headline_is_cut():
    assert repr(Result("short")) == "<Result: short>"
    assert len(repr(Result("x" * 10_000))) < 2_000
