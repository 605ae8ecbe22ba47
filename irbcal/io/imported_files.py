"""Files of other programs, imported as measurements.

::

    imported = import_measurements("export.xlsx", robot="irb120", out="measured.csv")
    imported.table             # pose, q1_deg …, target, x_mm, y_mm, z_mm …
    imported.measurements()    # what irbcal reads from the measurement file
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import open_robot
from irbcal.measurement import table, text_files
from irbcal.measurement.imports.column_map import (
    Changes,
    DeclaredColumns,
    ImportMap,
    changed,
    read_map,
    validated,
    values_of,
)
from irbcal.measurement.imports.reader import Imported, understand
from irbcal.measurement.imports.recognition import recognise
from irbcal.modeling.arm import Arm
from irbcal.overwriting import refuse_overwriting

OWN_FORMAT = "irbcal"
"""The preset of irbcal's own format."""
QUANTITY_OF = {"units.lengths": "lengths", "units.joints": "joints", "joints_file.units.joints": "joints"}
"""Keys of a map that declare a unit -> the quantity whose unit it is."""


def import_measurements(
    *sources: str | PathLike[str],
    as_: str | PathLike[str] | ImportMap | None = None,
    robot: str | Path | None = None,
    out: str | PathLike[str] | None = None,
    joints: str | PathLike[str] | None = None,
    set_: Changes = (),
    dry_run: bool = False,
    package_dirs: Sequence[str | PathLike[str]] = (),
) -> Imported:
    """Turn files of other programs into measurements: ``irbcal import`` as a function.

    Parameters
    ----------
    *sources : str or Path
        Files of one kind.
    as_ : str, Path or ImportMap, optional
        Which columns mean what: a preset's name, a map file (YAML), or a map. Recognised unless given.
    robot : str or Path, optional
        The nominal robot, whose trial fit proves units and columns that are recognised.
    out : str or Path, optional
        Measurement file to write (CSV), whole or not at all; with the map beside it (OUT.map.yaml) where that was
        recognised. Without it, nothing is written.
    joints : str or Path, optional
        Joints where the sources hold points only: a program whose targets are joints, or a file with q1_deg … and, at
        will, c1_deg …, pose, group and target (a row for each point then).
    set_ : dict, or sequence of str
        Changes of the map, such as units.lengths=mm.
    dry_run : bool
        Show the first rows as they would be understood; write nothing.
    package_dirs : sequence of str or Path
        Folders in which packages that a xacro file of the robot names are looked up first.

    Returns
    -------
    Imported
        Degrees and millimetres in its table; ``measurements()`` gives what the other functions take.

    Raises
    ------
    MeasurementError
        If a file does not fit the map; the sentence names file, row, column, what was expected and what was found.
    OptionError
        If ``set_`` is to change an `ImportMap`.
    """
    if not sources:
        raise OptionError("sources: expected one file or more, found none", parameter="sources")
    if out is not None:
        maps = [as_] if isinstance(as_, (str, PathLike)) and Path(as_).is_file() else []
        files = [*sources, *([] if joints is None else [joints]), *maps]
        refuse_overwriting({"out": out}, [text_files.file_of(path) for path in files])
    if as_ is None:
        folders = [Path(folder) for folder in package_dirs]
        arm = None if robot is None else open_robot(robot, nominal=True, package_dirs=folders).nominal
        imported = recognised(sources, arm, joints, set_)
    else:
        if isinstance(as_, ImportMap) and set_:
            raise OptionError("set_: expected no changes beside an ImportMap: change the map itself", parameter="set_")
        own = as_ == OWN_FORMAT
        import_map = as_ if isinstance(as_, ImportMap) else _own_map(sources[0], set_) if own else read_map(as_, set_)
        imported = understand(sources, import_map, joints)
    if out is None or dry_run:
        imported.csv()  # refuses what could not be written
        return imported
    return imported.written_to(out)


def recognised(
    sources: Sequence[str | PathLike[str]],
    arm: Arm | None = None,
    joints: str | PathLike[str] | None = None,
    set_: Changes = (),
) -> Imported:
    """Understand files without a map.

    Parameters
    ----------
    sources : sequence of str or Path
        Files with points, and optionally one with joints.
    arm : Arm, optional
        The nominal robot, whose trial fit proves units and columns.
    joints : str or Path, optional
        The file with joints.
    set_ : dict, or sequence of str
        Units that are declared, and changes of the map that was recognised.

    Raises
    ------
    MeasurementError
        If they are not understood.
    """
    if len(sources) == 1 and joints is None and _of_own_format(sources[0]):
        return understand(sources, _own_map(sources[0], set_))
    if len(sources) > 1 and all(map(_of_own_format, sources)):
        raise MeasurementError(
            "each of these files is a whole measurement file of irbcal: put the rows into one file, with a column "
            "session where tracker or reflectors were moved between them, or calibrate one and add the other (--with)",
            file=str(sources[1]),
        )
    changes = dict(set_) if isinstance(set_, Mapping) else dict(text.partition("=")[::2] for text in set_)
    units = {
        QUANTITY_OF[key.strip()]: str(value).strip() for key, value in changes.items() if key.strip() in QUANTITY_OF
    }
    of_columns = {key.strip(): value for key, value in changes.items() if key.strip().startswith("columns.")}
    columns = None
    if of_columns:
        values = changed("{}", "--set", _as_given(of_columns, set_))
        columns = validated(DeclaredColumns, values["columns"], "--set columns")
    recognition = recognise(sources, arm, joints, units, columns)
    import_map = recognition.map
    declared = {*QUANTITY_OF, "columns.joints", "columns.position"}
    of_map = {key: value for key, value in changes.items() if key.strip() not in declared}
    if of_map:
        values = changed(_yaml_of(import_map), "the recognised map", _as_given(of_map, set_))
        import_map = validated(ImportMap, values, "the recognised map")
    imported = recognition.imported
    if of_map or imported is None:
        imported = understand(recognition.sources, import_map, recognition.joints)
    return replace(imported, notes=(*recognition.notes, *imported.notes), columns=recognition.columns)


def _as_given(changes: Mapping[str, Any], set_: Changes) -> Changes:
    """Some of the changes, as a dict or as texts, as all of them were given."""
    return changes if isinstance(set_, Mapping) else [f"{key}={value}" for key, value in changes.items()]


def _yaml_of(import_map: ImportMap) -> str:
    import yaml

    return str(yaml.safe_dump(import_map.model_dump(exclude_defaults=True), allow_unicode=True))


def _own_map(path: str | PathLike[str], set_: Changes) -> ImportMap:
    """The preset of irbcal's own format, with the joints that a file has; errors as `read_map`."""
    values, source = values_of(OWN_FORMAT, set_)
    preset = values_of(OWN_FORMAT)[0]["columns"]
    names, delimiter = text_files.header_of(text_files.table_bytes(str(path)))
    if values["file"]["delimiter"] == ",":
        values["file"]["delimiter"] = delimiter
    count = next(k for k in itertools.count() if f"q{k + 1}_deg" not in names)
    for key, letter in (("joints", "q"), ("programmed", "c")):
        if count and values["columns"].get(key) == preset[key]:
            values["columns"][key] = [f"{letter}{k}_deg" for k in range(1, count + 1)]
    return validated(ImportMap, values, source)


def _of_own_format(path: str | PathLike[str]) -> bool:
    try:
        table.read(path)
    except MeasurementError:
        return False
    return True
