"""Options that a function refuses, told as the command line tells wrong calls."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from irbcal.errors import OptionError


@contextmanager
def wrong_calls(**options: str) -> Iterator[None]:
    """Turn an `OptionError` into a wrong call (exit code 2) that names the option.

    Parameters
    ----------
    **options : str
        What parameters are called on the command line where that is not ``--parameter``.
    """
    import typer

    try:
        yield
    except OptionError as error:
        name = error.parameter or ""
        hint = options.get(name, f"--{name.replace('_', '-')}") if name else None
        raise typer.BadParameter(str(error), param_hint=hint) from None


def path_to_write(text: str | Path) -> Path:
    """A path as typed; an empty text, such as of a shell variable that is not set, would be the current folder."""
    import typer

    if not str(text).strip():
        raise typer.BadParameter("expected a name, found an empty text")
    return Path(text)
