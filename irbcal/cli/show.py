"""What several commands print: tables of statistics, progress on stderr, JSON on stdout."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from irbcal import literals
from irbcal.literals import terminal
from irbcal.names import csv_bytes
from irbcal.summary import Paragraph, Remark, Table, print_table

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from irbcal.validation.verdict import Verdict


COUNTED = re.compile(r"(\d+) of (\d+)\b")
"""How a text of progress begins that says how far the work is."""
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


def print_rows(frame: pd.DataFrame, as_json: bool, decimals: int = 9) -> None:
    """A table for programs on stdout: CSV, or a line of JSON for each row, with null where there is no number."""
    if not as_json:
        sys.stdout.write(csv_bytes(frame, float_format=f"%.{decimals}f").decode())
        return
    for record in frame.astype(object).where(frame.notna(), None).to_dict(orient="records"):
        sys.stdout.write(json.dumps(record) + "\n")


def result(value: Any, json: bool, *lines: str, **content: Any) -> None:
    """What a result has to say, and lines after it; or its content as JSON, with more content before it."""
    if json:
        print_json({**content, **value.to_dict()})
    else:
        tell([*value.report(), *lines])


def written(value: Any, out: Path | None, json: bool) -> None:
    """A result, and the file that it was written to, if it was."""
    name = None if out is None else str(out)
    result(value, json, *([] if name is None else [f"Written to {name}"]), out=name)


def with_plot(file: Path | None, json: bool, compute: Callable[[], Any], save: Callable[[Any, Path], Any]) -> None:
    """A result, and its figure as a file on request, whose name is checked before anything is computed."""
    if file is not None:
        from irbcal.plotting.charts import check_name

        check_name(file)
    value = compute()
    if file is not None:
        save(value, file)
    result(value, json, *([f"Figure written to {file}"] if file is not None else ()))


LONG_FILE = 10_000_000
"""Bytes from which a file may be judged or corrected in pieces, which are counted while one waits."""


def long_file(*paths: Path) -> bool:
    """Whether one of some files is so long that its work is shown."""
    return any(path.is_file() and path.stat().st_size >= LONG_FILE for path in map(Path, paths))


@contextmanager
def progress(steps: int, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """A progress bar on stderr; yields a function to call with a text at the start of each step.

    A text such as ``3 of 20 robots`` says itself how far the work is; from then on the bar tells when it ends.

    With ``IRBCAL_PROGRESS=lines`` in the environment each text is a line behind the record separator (U+001E), for
    programs that run commands and show what they do.
    """
    if os.environ.get("IRBCAL_PROGRESS") == "lines" and not quiet:
        yield lambda text: print(f"\x1e{text}", file=sys.stderr, flush=True)
        return
    if quiet or not (sys.stderr.isatty() or "FORCE_COLOR" in os.environ):
        yield lambda text: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    from irbcal.terminal import Terminal

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Terminal(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=steps)

        def step(text: str) -> None:
            counted = COUNTED.match(text)
            if counted is None:
                bar.update(task, description=text, advance=1)
            else:
                bar.update(task, description=text, completed=int(counted[1]), total=int(counted[2]))

        yield step


def tell(paragraphs: Sequence[Paragraph]) -> None:
    """Print what a result has to say: paragraphs and tables, see `irbcal.summary`."""
    if not (_for_people() or any(isinstance(paragraph, Table) for paragraph in paragraphs)):
        print(*map(terminal, paragraphs), sep="\n")  # type: ignore[arg-type]  # no tables
        return
    from irbcal.terminal import Terminal

    console = Terminal()
    for paragraph in paragraphs:
        if isinstance(paragraph, Table):
            print_table(console, replace(paragraph, title=_lines(console, paragraph.title)))
        elif isinstance(paragraph, Remark):
            _remark(console, paragraph)
        else:
            console.print(_lines(console, paragraph), soft_wrap=True)


def _for_people() -> bool:
    """Whether output is styled and broken into lines, as the package rich does: it need not be loaded otherwise."""
    return sys.stdout.isatty() or "FORCE_COLOR" in os.environ


def _remark(console: Console, remark: Remark) -> None:
    """A remark: green where it is good, red where it is not to be trusted; of a note the head is yellow."""
    from rich.text import Text

    text = Text(_lines(console, remark))
    if remark.good is None:
        text.stylize("bold yellow", 0, len(remark.head) + 1)
    else:
        text.stylize("bold green" if remark.good else "bold red")
    console.print(text, soft_wrap=True)


def _lines(console: Console, text: str) -> str:
    """A text in lines that break between words, in a terminal; elsewhere as it is, so that lines can be searched for.

    Its lines go on with their own indent and two columns more.
    """
    from textwrap import wrap

    if not console.is_terminal:
        return text
    lines = []
    for paragraph in text.split("\n"):
        indent = " " * (len(paragraph) - len(paragraph.lstrip()))
        broken = wrap(
            paragraph,
            console.width,
            subsequent_indent=f"{indent}  " if indent else "",
            break_long_words=False,
            break_on_hyphens=False,
            drop_whitespace=True,
        )
        lines.append("\n".join(broken))
    return "\n".join(lines)


def say(text: str = "", whole: bool = False) -> None:
    """A line for people on stdout; ``whole``: one to copy, which no terminal's width breaks."""
    if not _for_people():
        print(terminal(text))
        return
    from irbcal.terminal import Terminal

    console = Terminal()
    console.print(text if whole else _lines(console, text), soft_wrap=True)


def warn(text: str) -> None:
    """A line on stderr, beside what programs read."""
    print(f"irbcal: {terminal(text)}", file=sys.stderr)


def this_command() -> str:
    """How the command is to be typed that is running: by its name where the shell finds it, else with its folder."""
    called = Path(sys.argv[0])
    installed = shutil.which("irbcal")
    if called.stem != "irbcal" or (installed is not None and Path(installed).resolve() == called.resolve()):
        return "irbcal"
    return literals.shell(str(called.absolute()))
