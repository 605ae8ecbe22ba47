"""A figure that shows itself in a notebook and can be written as a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from irbcal.atomic import write_together
from irbcal.errors import OptionError
from irbcal.figures import charts
from irbcal.figures.charts import Figure

Kind: TypeAlias = Literal["svg", "png"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, eq=False, repr=False)
class Picture:
    """One figure.

    Attributes
    ----------
    figure : Figure
    mark : str
        Words before the caption, such as that the data are simulated.
    """

    figure: Figure
    mark: str = ""

    def svg(self) -> str:
        """The figure with caption and legend as SVG."""
        return charts.file(self.figure, "svg", self.mark).decode("utf-8")

    def save(self, path: str | Path) -> Path:
        """Write the figure as SVG or PNG, as the ending of the path says: whole, or not at all.

        Raises
        ------
        OptionError
            If the ending is another one.
        CalibrationError
            If the file cannot be written.
        """
        path = Path(path)
        for kind in KINDS:
            if path.suffix == f".{kind}":
                write_together(path.parent, {path.name: charts.file(self.figure, kind, self.mark)})
                return path
        raise OptionError(f"expected a name that ends in .svg or .png, found {path.name!r}", file=path)

    def _repr_svg_(self) -> str:
        return self.svg()

    def __repr__(self) -> str:
        return f"<Picture {self.figure.name}: {self.mark}{self.figure.caption[:200]}>"


SIMULATED = "SIMULATED data. "
"""Mark of pictures of simulated data."""
