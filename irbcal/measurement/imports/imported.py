"""What an import understood: the table, where each row comes from, and the measurement file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray
from irbcal.atomic import write_together
from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.measurement.columns import POSITION, QUATERNION
from irbcal.measurement.imports.column_map import ImportMap
from irbcal.measurement.imports.poses import pose_keys
from irbcal.measurement.table import MeasurementSet, ReadOnlyTables
from irbcal.names import csv_bytes
from irbcal.overwriting import refuse_overwriting
from irbcal.summary import Cell, Paragraph, Result, Table

SHOWN = 5
"""Rows that are shown of a table: as many as fit beside one another."""
LONGEST_CELL = 24


@dataclass(frozen=True, eq=False, repr=False)
class Imported(ReadOnlyTables, Result):
    """What was understood.

    Attributes
    ----------
    table : DataFrame
        Columns of a measurement file: degrees and millimetres, NaN where a point was lost. Each access hands out a
        copy.
    origin : DataFrame
        ``source`` (file) and ``row`` (line in it) of each row of ``table``. Each access hands out a copy.
    map : ImportMap
    warnings : tuple of str
    out : Path or None
        The file it was written to.
    """

    table: pd.DataFrame
    origin: pd.DataFrame
    map: ImportMap
    warnings: tuple[str, ...]
    out: Path | None = None

    @property
    def lost(self) -> BoolArray:
        """Mask of the rows without a position."""
        return self.table["x_mm"].isna().to_numpy()

    @property
    def poses(self) -> int:
        """Number of poses."""
        return len(pose_keys(self.table).unique())

    @property
    def targets(self) -> dict[str, tuple[int, int]]:
        """Number of measured and of lost points of each target, dict of str to (int, int)."""
        lost = pd.Series(self.lost).groupby(self.table["target"].to_numpy(), sort=True).agg(["size", "sum"])
        return {str(name): (int(row["size"] - row["sum"]), int(row["sum"])) for name, row in lost.iterrows()}

    @property
    def groups(self) -> dict[str, int]:
        """Number of poses of each group, sorted by name."""
        if "group" not in self.table.columns:
            return {}
        counts = self.table.groupby("group")["pose"].nunique()
        return {str(name): int(count) for name, count in counts.items()}

    def csv(self) -> bytes:
        """The measurement file as bytes; it is read back and compared before it is handed out.

        Raises
        ------
        MeasurementError
            If irbcal itself would refuse it or read other numbers.
        """
        return self._written()[0]

    def measurements(self) -> MeasurementSet:
        """The measurements as irbcal reads them from the measurement file.

        Raises
        ------
        MeasurementError
            As `csv`.
        """
        return self._written()[1]

    def _written(self) -> tuple[bytes, MeasurementSet]:
        written, origin = self.table, self.origin
        data = csv_bytes(_rounded(written))
        source = str(origin["source"].iloc[0])
        try:
            reread = table.parse(data, source)
        except MeasurementError as error:
            k = -1 if error.row is None else error.row - 2
            if not 0 <= k < len(origin):
                raise
            first, row = origin.iloc[k]
            prefix = MeasurementError("", file=source, row=error.row, column=error.column)
            reason = str(error).removeprefix(f"{prefix}: ")
            raise MeasurementError(reason, file=first, row=int(row), column=error.column) from None
        names = [
            *reread.joint_columns,
            *reread.programmed_columns,
            *POSITION,
            *(name for name in QUATERNION if name in written.columns),
        ]
        equal = np.isclose(reread.table[names], written[names], rtol=0, atol=1e-6, equal_nan=True)
        if len(reread) != len(written) or not equal.all():
            raise MeasurementError("the measurement file would not hold the numbers that were understood", file=source)
        return data, reread

    def written_to(self, out: str | PathLike[str]) -> "Imported":
        """Write the measurement file, whole or not at all.

        Parameters
        ----------
        out : str or Path

        Returns
        -------
        Imported
            The same with ``out`` set.

        Raises
        ------
        MeasurementError
            As `csv`.
        CalibrationError
            If the file cannot be written.
        CalibrationError
            If it is one of the files that were read.
        """
        out = Path(out)
        refuse_sources(out, self.origin["source"].unique())
        data = self.csv()
        write_together(out.parent, {out.name: data})
        return replace(self, out=out)

    def first_rows(self, count: int) -> list[dict[str, Any]]:
        """The first rows as they are understood, None for what is lost, with ``source`` and ``row``."""
        rows = self.table.head(count)
        values = rows.astype(object).where(rows.notna(), None).to_dict(orient="records")
        origins = self.origin.head(count).to_dict(orient="records")
        return [origin | row for origin, row in zip(origins, values, strict=True)]

    def to_frame(self) -> pd.DataFrame:
        """The table as a measurement file has it: degrees and millimetres."""
        return self.table

    def report(self) -> Sequence[Paragraph]:
        """Counts and warnings; what was not written yet is shown: its first rows and the map in use."""
        targets = ", ".join(
            f"{name} {count}" + (f" (and {lost} lost)" if lost else "") for name, (count, lost) in self.targets.items()
        )
        lines: list[Paragraph] = [
            f"{len(self.table)} rows, {self.poses} poses, {int(self.lost.sum())} lost points; points: {targets}",
            *(f"Note: {text}." for text in self.warnings),
        ]
        if self.out is not None:
            return [*lines, f"Written to {self.out}"]
        return [*lines, self._shown(), "The map in use:", self._map_in_use()]

    def _shown(self) -> Table:
        """The first rows, a column each, as a row has too many values for a page."""
        first = self.first_rows(SHOWN)
        rows: list[tuple[Cell, ...]] = [
            (str(name), *(_cell(row[name]) for row in first)) for name in self.table.columns
        ]
        title = f"The first rows of {first[0]['source']} as they would be understood:"
        return Table(title, ("row of file", *(str(row["row"]) for row in first)), tuple(rows), digits=4)

    def _map_in_use(self) -> str:
        import yaml

        values = self.map.model_dump(exclude_defaults=True, exclude={"about"})
        return str(yaml.safe_dump(values, sort_keys=False, default_flow_style=None)).rstrip()


def refuse_sources(out: Path, sources: Sequence[str | PathLike[str]]) -> None:
    """Refuse a file to write that is one of those to read.

    Raises
    ------
    CalibrationError
        If it is.
    """
    refuse_overwriting({"out": out}, list(sources))


def _cell(value: Any) -> Cell:
    if value is None or isinstance(value, float):
        return "" if value is None else float(value)
    text = str(value)
    return text if len(text) <= LONGEST_CELL else text[: LONGEST_CELL - 1] + "…"


def _rounded(frame: pd.DataFrame) -> pd.DataFrame:
    """The same with 1e-9 mm, degree or second as last place, and no minus zeros."""
    out = frame.copy()
    for name in out.columns:
        if pd.api.types.is_float_dtype(out[name]):
            out[name] = out[name].round(12 if name in QUATERNION else 9) + 0.0
    return out
