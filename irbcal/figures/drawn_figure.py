"""A figure of matplotlib that shows itself in a notebook and can be written as a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irbcal.errors import IrbcalError
from irbcal.figures import style
from irbcal.figures.style import SIZE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = tuple(f".{kind}" for kind in style.KINDS)


@dataclass(frozen=True, eq=False)
class DrawnFigure:
    """One figure.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        To be changed before it is saved, if need be.
    """

    figure: Figure

    @classmethod
    def of(cls, draw: Callable[..., Any], *data: Any, size: tuple[float, float] = SIZE) -> DrawnFigure:
        """Draw in the house's style: ``draw`` takes a figure and the data; ``size`` is in inches."""
        return cls(style.drawn(draw, size, *data))

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the figure as PNG, SVG or PDF, as the ending of the path says: whole, or not at all.

        Raises
        ------
        IrbcalError
            If the ending is none of these or the file cannot be written.
        """
        from irbcal.atomic import write_together

        path = check_name(path)
        write_together(path.parent, {path.name: style.as_bytes(self.figure, path.suffix[1:])})
        return path

    def _repr_png_(self) -> bytes:
        return style.as_bytes(self.figure)


def check_name(path: str | PathLike[str]) -> Path:
    """Refuse endings that are no figure's, before any work is done; the path with its ending in small letters."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise IrbcalError(f"figures end in {', '.join(SUFFIXES)}", file=path)
    return path.with_suffix(path.suffix.lower())
