"""What several commands print: tables of statistics, progress on stderr, JSON on stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from irbcal.summary import Table, Told, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from irbcal.validation.verdict import Verdict


FAIL_IF_WORSE = "End with exit code 3 unless the verdict is better than the nominal robot, and trusted."
NOT_TRUSTED = 3
"""Exit code on request."""


def fail(verdict: Verdict, wanted: bool) -> None:
    """End with an exit code of its own where a verdict cannot be trusted, if that is wanted."""
    if wanted and not verdict.trusted:
        raise typer.Exit(NOT_TRUSTED)


def print_json(value: Any) -> None:
    """One JSON document on stdout."""
    json.dump(value, sys.stdout, indent=1, allow_nan=False)
    sys.stdout.write("\n")


@contextmanager
def progress(steps: int, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """A progress bar on stderr; yields a function to call with a text at the start of each step."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task("starting", total=steps)

        def step(text: str) -> None:
            bar.update(task, description=text, advance=1)

        yield step


def tell(told: Sequence[Told]) -> None:
    """Print what a result has to say: paragraphs and tables, see `irbcal.summary`."""
    from rich.console import Console

    console = Console(markup=False, highlight=False, emoji=False)
    for item in told:
        if isinstance(item, Table):
            print_table(console, item)
        elif item.startswith(("Verdict: ", "Doubt: ", "Tolerance: ", "Against a pass: ")):
            _verdict(console, item)
        elif item.startswith("Note: "):
            note(item.removeprefix("Note: "))
        else:
            console.print(item, soft_wrap=True)


def _verdict(console: Console, text: str) -> None:
    """A verdict or a doubt: bold, and red where it is not to be trusted."""
    from rich.text import Text

    good = text.startswith(("Verdict: Better", "Verdict: On these", "Tolerance: PASS"))
    console.print(Text(text, style="bold" if good else "bold red"), soft_wrap=True)


def say(text: str = "") -> None:
    """A line for people on stdout."""
    from rich.console import Console

    Console().print(text, highlight=False, markup=False, soft_wrap=True)


def note(text: str) -> None:
    """A remark that the reader should not miss."""
    from rich.console import Console
    from rich.text import Text

    Console().print(Text.assemble(("Note: ", "bold yellow"), text), soft_wrap=True)
