"""Plain tables on stdout and lists of numbers from the command line, for the commands of the validation."""


def table(title, columns, rows):
    """Print a table.

    Parameters
    ----------
    title : str
    columns : sequence of str
        Headings, with units; the first column is text.
    rows : sequence of sequence
        Text, numbers (printed with three decimals unless given as (value, digits)), or None for nothing.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from irbcal.cli.show import say

    say(title)
    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for k, name in enumerate(columns):
        grid.add_column(name, justify="right" if k else "left", no_wrap=True)
    for row in rows:
        grid.add_row(*(cell(value) for value in row))
    Console(width=max(100, len(columns) * 14), markup=False).print(grid)


def cell(value, digits=3):
    """A value as text: numbers with three decimals unless given as (value, digits)."""
    if isinstance(value, tuple):
        value, digits = value
    if value is None:
        return "–"
    if isinstance(value, float):
        return format(value, f".{digits}f")
    return str(value)


def interval(ends, digits=3):
    """An interval as text, or a dash."""
    return "–" if ends is None else f"{ends[0]:.{digits}f} … {ends[1]:.{digits}f}"


def numbers(text, counts, option):
    """Numbers separated by commas, as a list of floats; a wrong call if there are not as many as one of the counts."""
    import math

    import typer

    try:
        values = [float(value) for value in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)):
        raise typer.BadParameter(f"expected {' or '.join(map(str, counts))} numbers, found {text!r}", param_hint=option)
    return values
