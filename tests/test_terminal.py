"""What is printed cannot act on a terminal, in colour or not; what rich itself does there stays."""

import io

from rich.table import Table as RichTable
from rich.text import Text

from irbcal.summary import Result, Table
from irbcal.terminal import Terminal

EVIL = "a\x1b]0;title\x07\x1b[2J\x9b31m\r\u202e[red]b"


def shown(*items, **options):
    out = io.StringIO()
    console = Terminal(file=out, width=200, **options)
    for item in items:
        console.print(item)
    return out.getvalue()


def test_texts_tables_and_styles():
    table = RichTable("head")
    table.add_row(Text(EVIL))
    for text in (shown(EVIL, Text(EVIL), table), shown(EVIL, table, force_terminal=True, color_system=None)):
        assert not {char for char in text if not char.isprintable()} - {"\n"}
        assert "[red]b" in text
        assert text.count("\\x1b]0;title") > 1
    assert (
        shown(Text("good", style="bold green"), force_terminal=True, color_system="standard")
        == "\x1b[1;32mgood\x1b[0m\n"
    )


def test_results():
    class Sample(Result):
        def report(self):
            return [EVIL, Table(EVIL, (EVIL,), ((EVIL,),))]

    for text in (Sample().summary(), repr(Sample())):
        assert "\x1b" not in text
        assert "\\x1b" in text
