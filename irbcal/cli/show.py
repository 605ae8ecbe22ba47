"""What several commands print: tables of statistics, progress on stderr, JSON on stdout."""

import json
import sys
from collections.abc import Sequence
from contextlib import contextmanager

from irbcal.summary import Table, Told

COLUMNS = (
    ("points", "n", "d"),
    ("mean", "mean_mm", ".3f"),
    ("sigma", "sigma_mm", ".3f"),
    ("max", "max_mm", ".3f"),
    ("mean+3σ", "mean_plus_3sigma_mm", ".3f"),
    ("rms", "rms_mm", ".3f"),
)


def print_json(value):
    """One JSON document on stdout."""
    json.dump(value, sys.stdout, indent=1, allow_nan=False)
    sys.stdout.write("\n")


@contextmanager
def progress(steps, quiet=False):
    """A progress bar on stderr; yields a function to call with a text at the start of each step."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task("starting", total=steps)

        def step(text):
            bar.update(task, description=text, advance=1)

        yield step


def statistics_table(title, rows):
    """Print a table of statistics in mm.

    Parameters
    ----------
    title : str
    rows : list of tuple
        (label, model, statistics dict, whether it is a headline).
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    say(f"{title}, mm")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    table.add_column("model")
    for name, _, _ in COLUMNS:
        table.add_column(name, justify="right")
    previous = None
    for label, model, values, headline in rows:
        cells = [format(values[key], form) for _, key, form in COLUMNS]
        table.add_row("" if label == previous else label, model, *cells, style="bold" if headline else None)
        previous = label
    Console(markup=False).print(table)


def tell(told: Sequence[Told]) -> None:
    """Print what a result has to say: paragraphs and tables, see `irbcal.summary`."""
    from rich.console import Console

    console = Console(markup=False, highlight=False, emoji=False)
    for item in told:
        if isinstance(item, Table):
            console.print(item.title, soft_wrap=True)
            console.print(item.for_terminal())
        else:
            console.print(item, soft_wrap=True)


def say(text=""):
    """A line for people on stdout."""
    from rich.console import Console

    Console().print(text, highlight=False, markup=False, soft_wrap=True)


def note(text):
    """A remark that the reader should not miss."""
    from rich.console import Console
    from rich.text import Text

    Console().print(Text.assemble(("Note: ", "bold yellow"), text), soft_wrap=True)


def orientation(model, values):
    """One line on orientation errors."""
    say(
        f"Orientation errors, {model}: mean {values['mean_deg']:.4f}, sigma {values['sigma_deg']:.4f}, "
        f"max {values['max_deg']:.4f} degrees ({values['n']} poses)"
    )


def exclusions(excluded, most=8):
    """Lines that count the left-out points by reason and name the first of each."""
    by_reason = {}
    for item in excluded:
        by_reason.setdefault(item["reason"].split(":")[0], []).append(item)
    lines = []
    for reason, items in by_reason.items():
        where = ", ".join(f"{item['pose']}/{item['target']}" for item in items[:most])
        more = f" … and {len(items) - most} more" if len(items) > most else ""
        lines.append(f"  {len(items)} × {reason} (pose/target {where}{more})")
    return lines
