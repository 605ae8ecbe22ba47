"""The errors that irbcal raises on purpose.

Every message is one sentence for the person at the keyboard: where (file, row, column), what was
expected, what was found. The command line prints it and exits with code 1; anything else keeps its
traceback. The same facts stand in the error as data, for programs that catch it.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike, fspath

LONGEST_MESSAGE = 4000
"""Characters; what was found in a damaged file may be the whole of it."""


class IrbcalError(Exception):
    """Base of all refusals; the message is written for the user.

    Parameters
    ----------
    message : str
        What was expected and what was found; the place is put before it.
    file : str or Path, optional
        The file that is refused.
    row, line : int, optional
        Row of a table, or line of a text: the line of the file, counted from 1. Both are kept as ``row``.
    column : str or sequence of str, optional
        The column or columns meant.
    parameter : str, optional
        Name of the option, argument or model parameter that is refused.

    Attributes
    ----------
    message
        Without its place.
    file, row, column, parameter
        As given, ``column`` as one text; None where unknown.

    Examples
    --------
    >>> raise MeasurementError("expected a number, found 'abc'", file="points.csv", row=3, column="x_mm")
    Traceback (most recent call last):
    irbcal.errors.MeasurementError: points.csv: row 3, column x_mm: expected a number, found 'abc'
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | PathLike[str] | None = None,
        row: int | None = None,
        line: int | None = None,
        column: str | Sequence[str] | None = None,
        parameter: str | None = None,
    ) -> None:
        self.message = message
        self.file = None if file is None else fspath(file)
        self.row = row if line is None else line
        self.column = column if column is None or isinstance(column, str) else ", ".join(column)
        self.parameter = parameter
        location = []
        if self.row is not None:
            location.append(f"{'row' if line is None else 'line'} {self.row}")
        if self.column is not None:
            location.append(f"{'columns' if ', ' in self.column else 'column'} {self.column}")
        super().__init__(_one_line(": ".join(piece for piece in (self.file, ", ".join(location), message) if piece)))


def _one_line(text: str) -> str:
    """A message that cannot act on a terminal, whatever stood in a file or its name: printable, and not endless."""
    plain = escaped(text)
    return plain if len(plain) <= LONGEST_MESSAGE else f"{plain[: LONGEST_MESSAGE - 500]} … {plain[-497:]}"


def escaped(text: str, but: str = "\u00a0") -> str:
    """A text of which a terminal obeys nothing: characters that are not printable are escapes, ``but`` these."""
    return "".join(char if char.isprintable() or char in but else ascii(char)[1:-1] for char in text)


class RobotError(IrbcalError):
    """A robot description (URDF) cannot be used."""


class MeasurementError(IrbcalError):
    """A measurement or joint file cannot be used."""


class IdentificationError(IrbcalError):
    """The measurements do not allow the identification that was asked for."""


class CalibrationError(IrbcalError):
    """A calibration folder cannot be read, written or trusted."""


class ProgramError(IrbcalError):
    """A robot program cannot be read, understood or rewritten."""


class OptionError(IrbcalError):
    """An option or argument of a function has a value that it does not know."""

    @classmethod
    def unknown(cls, parameter: str, value: object, choices: Sequence[str]) -> OptionError:
        """Refusal of a value that is not among the choices; the sentence lists them."""
        return cls(f"{parameter}: {not_among(value, choices)}", parameter=parameter)


def not_among(value: object, choices: Sequence[str]) -> str:
    """What to say of a value that is not among the choices: these, and the nearest one."""
    from difflib import get_close_matches

    expected = " or ".join(filter(None, [", ".join(choices[:-1]), choices[-1]]))
    folded = {choice.casefold(): choice for choice in reversed(choices)}
    near = get_close_matches(str(value).casefold(), folded, n=1)
    return f"expected {expected}, found {value!r}" + (f": did you mean {folded[near[0]]}?" if near else "")
