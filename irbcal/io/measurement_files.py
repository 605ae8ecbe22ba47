"""Measurement files, in irbcal's format or of other programs."""

from __future__ import annotations

import hashlib
import re
from os import PathLike
from pathlib import Path
from typing import TypeAlias

from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.measurement.column_names import JOINTS, in_degrees
from irbcal.measurement.input_table import column_names
from irbcal.measurement.table import MeasurementSet, MeasurementsLike
from irbcal.modeling.arm import Arm
from irbcal.safe_files import read_bytes
from irbcal.wording import first_of

MeasurementFiles: TypeAlias = "MeasurementsLike | list[str | PathLike[str]] | tuple[str | PathLike[str], ...]"
"""Measurements, or several files of other programs that hold them together, such as points and joints."""
MOST_NAMED = 20
"""Columns of a kind that a note names."""


def measurements_of(source: MeasurementFiles, arm: Arm) -> MeasurementSet:
    """Measurements of an arm, in irbcal's own format or in files of other programs.

    Parameters
    ----------
    source : as for `irbcal.read_measurements`, or several files
        Files in other formats are recognised with the arm; the notes of the measurements say what was understood.
    arm : Arm

    Raises
    ------
    MeasurementError
        If they cannot be read.
    """
    if isinstance(source, (list, tuple)):
        files = [Path(path) for path in source]
    elif isinstance(source, (str, PathLike)):
        files = [Path(source)]
    else:
        return table.read(source)
    if len(files) == 1:
        try:
            return table.read(files[0])
        except MeasurementError:
            if (
                not files[0].is_file()
                or files[0].suffix == ".parquet"
                or {*JOINTS, "q1_mm"} & {*map(in_degrees, column_names(files[0]))}
            ):
                raise  # its faults are those of irbcal's own format
    # to load what understands files of other programs takes a twentieth of a short calibration's time
    from irbcal.io.imported_files import recognised
    from irbcal.measurement.imports.recognition import AS_NAMED, NOT_USED

    try:
        imported = recognised(files, arm)
    except MeasurementError as error:
        option = re.search(r"--(set|joints|as)\b", error.message)
        if option is None:
            raise
        message = f"{error.message} ({option[0]} is an option of irbcal import, which writes a measurement file)"
        raise MeasurementError(message, file=error.file, row=error.row, column=error.column) from None
    content = b"".join(read_bytes(file, MeasurementError) for file in files)
    read = imported.measurements()
    named = " + ".join(file.name for file in files)
    joints = ", ".join(f"{name} is {text}" for name, text, _ in imported.columns if text.startswith("joint"))
    taken = [name for name, _, origin in imported.columns if origin == AS_NAMED]
    unused = [name for name, text, _ in imported.columns if text == NOT_USED]
    parts = [f"positions in {imported.map.units.lengths}", joints]
    parts += [
        f"{words}: {first_of(names, MOST_NAMED)}" for words, names in ((AS_NAMED, taken), (NOT_USED, unused)) if names
    ]
    note = (
        f"{named} was understood without a map ({'; '.join(parts)}): irbcal import shows it, and writes a map to change"
    )
    return read.changed(
        {"row": imported.origin["row"].to_numpy()},
        source=str(files[0]),
        sha256=hashlib.sha256(content).hexdigest(),
        notes=(note, *imported.notes),
    )
