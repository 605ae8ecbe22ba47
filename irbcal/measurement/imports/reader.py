"""Import: foreign measurement files, understood by a map, as the table that irbcal reads.

::

    found = import_measurements("export.csv", as_="robodk", out="measured.csv")
    found.table             # pose, q1_deg …, target, x_mm, y_mm, z_mm …
    found.measurements()    # what irbcal reads from the measurement file

Units are those that the map declares; numbers that look like others are refused, never converted by guess.
"""

from collections import Counter
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import pandas as pd

from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.columns import POSITION, QUATERNION, joint_columns, programmed_columns
from irbcal.measurement.imports import dialect, poses
from irbcal.measurement.imports.column_map import ImportMap
from irbcal.measurement.imports.imported import Imported, refuse_sources
from irbcal.measurement.imports.joining import join, read_joints
from irbcal.measurement.imports.map_file import Changes, read_map
from irbcal.measurement.imports.part import ROW, SOURCE, SourceFile, declared_units, undeclared
from irbcal.measurement.imports.plausible import check_joint_sizes, check_reach, strange


def import_measurements(
    *sources: str | PathLike[str],
    as_: str | PathLike[str] | ImportMap,
    out: str | PathLike[str] | None = None,
    joints: str | PathLike[str] | None = None,
    set_: Changes = (),
    dry_run: bool = False,
) -> Imported:
    """Turn files of other programs into measurements: ``irbcal import`` as a function.

    Parameters
    ----------
    *sources : str or Path
        Files of one kind.
    as_ : str, Path or ImportMap
        Which columns mean what: name of a preset (`map_file.presets`), a map file (YAML), or a map.
    out : str or Path, optional
        Measurement file to write (CSV), whole or not at all. Without it, nothing is written.
    joints : str or Path, optional
        Joints file for sources that hold points only: ``q1_deg`` … and, optional, ``c1_deg`` …, ``pose``,
        ``group`` and ``target`` (a row for each point then), or a program whose targets are joints.
    set_ : dict, or sequence of str
        Changes of the map, such as ``{"units.lengths": "mm"}`` or ``["units.lengths=mm"]``.
    dry_run : bool
        Write nothing, even with ``out``.

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
        maps = [] if isinstance(as_, ImportMap) or not Path(as_).is_file() else [as_]
        refuse_sources(Path(out), [*sources, *([] if joints is None else [joints]), *maps])
    if isinstance(as_, ImportMap):
        if set_:
            raise OptionError("set_: expected no changes beside an ImportMap: change the map itself", parameter="set_")
        import_map = as_
    else:
        import_map = read_map(as_, set_)
    found = understand(sources, import_map, joints)
    if out is None or dry_run:
        found.csv()  # refuses what could not be written
        return found
    return found.written_to(out)


def understand(
    sources: Sequence[str | PathLike[str]], import_map: ImportMap, joints: str | PathLike[str] | None = None
) -> Imported:
    """Understand foreign files by a map.

    Parameters
    ----------
    sources : sequence of str or Path
        Files of one kind.
    import_map : ImportMap
    joints : str or Path, optional
        Joints file for sources that hold points only: in irbcal's own format (``q1_deg`` …, optional ``c1_deg`` …,
        ``pose`` and ``group``), unless ``joints_file`` of the map says otherwise.

    Returns
    -------
    Imported

    Raises
    ------
    MeasurementError
        If a file does not fit the map; the sentence names file, row, column, what was expected and what was found.
    """
    given = None if joints is None else read_joints(joints, import_map)
    elsewhere = given is not None and "target" in given.columns
    _check_declared(import_map, joints is not None, str(sources[0]), elsewhere)
    parts: list[pd.DataFrame] = []
    counted: Counter[str | None] = Counter()
    for path in sources:
        part = SourceFile(dialect.read(path, import_map.file, import_map.lost_texts), import_map, elsewhere)
        own = part.file_fields.get("target")  # logs of one target each count the same poses
        parts.append(part.frame(counted[own]))
        counted[own] += len(part.table.cells)
    frame = pd.concat(parts, ignore_index=True)
    for name in ("group", "cycle"):
        if name in frame.columns:
            frame[name] = frame[name].fillna("")
    warnings: list[str] = []
    if joints is not None and given is not None:
        frame, warnings = join(frame, given, joints, import_map)
    else:
        if import_map.pose_by == "joints" and not import_map.names_poses:
            frame["pose"] = poses.runs(frame).astype(str)
        check_joint_sizes(frame, frame[SOURCE].iloc[0], import_map.units.joints or "deg", import_map)
    poses.apply_joint_rules(frame, import_map)
    frame = poses.together(frame)
    poses.check_one_pose_one_joints(frame)
    unknown = [name for name in import_map.rename if name not in set(frame["target"])]
    if unknown:
        warnings.append(f"There is no target {', '.join(unknown)} to rename")
    frame["target"] = frame["target"].replace(import_map.rename)
    warnings += poses.name_groups(frame, import_map)
    check_reach(frame, import_map)
    warnings += strange(frame)
    programmed = programmed_columns(frame.columns, str(sources[0]))
    order = ["pose", *joint_columns(frame.columns), *programmed, "target", *POSITION]
    order += [
        name for name in ("group", "cycle", "u95_mm", *QUATERNION, "time_s", "payload_kg") if name in frame.columns
    ]
    order += [name for name in frame.columns if name not in (*order, SOURCE, ROW)]
    origin = frame[[SOURCE, ROW]].rename(columns=str.strip)
    return Imported(frame[order], origin, import_map, tuple(warnings))


def _check_declared(import_map: ImportMap, with_joints_file: bool, source: str, targets_elsewhere: bool) -> None:
    """Refuse a map that leaves open what must be declared."""
    declared_units(import_map, source)
    columns = import_map.columns
    has_target = (
        targets_elsewhere
        or columns.target is not None
        or import_map.fixed.target
        or isinstance(columns.position, dict)
        or any("{target}" in text for text in (*import_map.names, import_map.file_name or ""))
    )
    if not has_target:
        undeclared(source, "the target", "fixed.target=smr1", "another name, or columns.target")
    if columns.joints and with_joints_file:
        raise MeasurementError(
            "expected joints from one place, found columns.joints in the map and a joints file; leave one out "
            "(--set columns.joints=null)",
            file=source,
        )
    if not columns.joints and not with_joints_file:
        raise MeasurementError(
            "this map finds points only: expected a joints file (--joints JOINTS.csv) or columns.joints in the map, "
            "found neither",
            file=source,
            parameter="joints",
        )
