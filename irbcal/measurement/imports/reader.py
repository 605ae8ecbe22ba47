"""Import: foreign measurement files, understood by a map, as the table that irbcal reads.

::

    found = understand(["export.csv"], column_map.read_map("robodk"))
    found.table        # pose, q1_deg …, target, x_mm, y_mm, z_mm …
    found.csv()        # the measurement file, read back before it is handed out

Units are those that the map declares; numbers that look like others are refused, never converted by guess.
"""

import fnmatch
import re
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement import columns as columns_module
from irbcal.measurement import table
from irbcal.measurement.columns import POSITION, QUATERNION
from irbcal.measurement.imports import dialect
from irbcal.measurement.imports.dialect import short
from irbcal.measurement.imports.part import (
    ANGLE_DEG,
    LENGTH_MM,
    ROW,
    SOURCE,
    Part,
    excuses,
    joint_values,
    undeclared,
)

SAME_JOINTS = 1e-6
"""Joints that differ by no more are the same, degrees or mm."""
MOST_RADIANS = 2.0 * np.pi + 1e-3
"""No angle of a file declared as degrees is larger: these are radians."""
MOST_TURNS = 8.0 * np.pi
"""An angle of a file declared as radians is larger: these are degrees."""
SMALLEST_REACH_MM, LARGEST_REACH_MM = 20.0, 200e3
"""No tracker measures a robot whose farthest point is nearer than the one or farther than the other."""
ENOUGH = 3
"""Poses from which on joints and positions are judged by their size."""


@dataclass(frozen=True, eq=False)
class Imported:
    """What was understood.

    Attributes
    ----------
    table : DataFrame
        Columns of a measurement file: degrees and millimetres, NaN where a point was lost.
    origin : DataFrame
        ``source`` (file) and ``row`` (line in it) of each row of ``table``.
    map : ImportMap
    warnings : list of str
    """

    table: pd.DataFrame
    origin: pd.DataFrame
    map: object
    warnings: list

    @property
    def lost(self):
        """Mask of the rows without a position."""
        return self.table["x_mm"].isna().to_numpy()

    @property
    def poses(self):
        """Number of poses."""
        return len(_pose_keys(self.table).unique())

    @property
    def targets(self):
        """Number of measured and of lost points of each target, dict of str to (int, int)."""
        lost = pd.Series(self.lost).groupby(self.table["target"].to_numpy(), sort=True).agg(["size", "sum"])
        return {name: (int(row["size"] - row["sum"]), int(row["sum"])) for name, row in lost.iterrows()}

    def csv(self):
        """The measurement file as bytes; it is read back and compared before it is handed out.

        Raises
        ------
        MeasurementError
            If irbcal itself would refuse it or read other numbers.
        """
        data = _rounded(self.table).to_csv(index=False, lineterminator="\n").encode("utf-8")
        source = self.origin["source"].iloc[0]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "measurements.csv")
            path.write_bytes(data)
            try:
                seen = table.read(path)
            except MeasurementError as error:
                reason = str(error).removeprefix(f"{path}: ")
                found = re.match(r"row (\d+)", reason)
                if found and 2 <= int(found[1]) < len(self.origin) + 2:
                    source, row = self.origin.iloc[int(found[1]) - 2]
                    reason = f"row {row}{reason[found.end() :]}"
                raise MeasurementError(f"{source}: {reason}") from None
        columns = [*seen.joint_columns, *POSITION, *(name for name in QUATERNION if name in self.table.columns)]
        same = np.isclose(seen.table[columns], self.table[columns], rtol=0, atol=1e-6, equal_nan=True)
        if len(seen.table) != len(self.table) or not same.all():
            raise MeasurementError(f"{source}: the measurement file would not hold the numbers that were understood")
        return data


def understand(sources, import_map, joints=None):
    """Understand foreign files by a map.

    Parameters
    ----------
    sources : sequence of str or Path
        Files of one kind.
    import_map : ImportMap
    joints : str or Path, optional
        Joints file for sources that hold points only: in irbcal's own format (``q1_deg`` …, optional ``pose`` and
        ``group``), unless ``joints_file`` of the map says otherwise.

    Returns
    -------
    Imported

    Raises
    ------
    MeasurementError
        If a file does not fit the map; the sentence names file, row, column, what was expected and what was found.
    """
    _check_declared(import_map, joints is not None, str(sources[0]))
    parts, counted = [], Counter()
    for path in sources:
        part = Part(dialect.read(path, import_map.file, excuses(import_map)), import_map)
        own = part.file_fields.get("target")  # logs of one target each count the same poses
        parts.append(part.frame(counted[own]))
        counted[own] += len(part.table.cells)
    frame = pd.concat(parts, ignore_index=True)
    for name in ("group", "cycle"):
        if name in frame.columns:
            frame[name] = frame[name].fillna("")
    warnings = []
    if joints is not None:
        frame = _join(frame, joints, import_map, warnings)
    elif import_map.pose_by == "joints" and not _names_poses(import_map):
        frame["pose"] = _runs(frame).astype(str)
    columns = columns_module.joint_columns(list(frame.columns))
    if joints is None:
        _check_joint_sizes(frame, frame[SOURCE].iloc[0], import_map.units.joints, import_map)
    _apply_joint_rules(frame, columns, import_map)
    frame = _poses_together(frame)
    _check_one_pose_one_joints(frame, columns)
    strange = [name for name in import_map.rename if name not in set(frame["target"])]
    if strange:
        warnings.append(f"There is no target {', '.join(strange)} to rename")
    frame["target"] = frame["target"].replace(import_map.rename)
    _group(frame, import_map, warnings)
    _check_reach(frame, import_map)
    warnings += _warnings(frame, columns)
    order = ["pose", *columns, "target", *POSITION]
    order += [
        name for name in ("group", "cycle", "u95_mm", *QUATERNION, "time_s", "payload_kg") if name in frame.columns
    ]
    order += [name for name in frame.columns if name not in (*order, SOURCE, ROW)]
    origin = frame[[SOURCE, ROW]].rename(columns=str.strip)
    return Imported(frame[order], origin, import_map, warnings)


def _names_poses(import_map):
    """Whether the source gives its poses names."""
    patterns = [*import_map.names, import_map.file_name or ""]
    return import_map.columns.pose is not None or any("{pose}" in text for text in patterns)


def _check_declared(import_map, with_joints_file, source):
    """Refuse a map that leaves open what must be declared."""
    columns, units = import_map.columns, import_map.units
    has_target = (
        columns.target is not None
        or import_map.fixed.target
        or isinstance(columns.position, dict)
        or any("{target}" in text for text in (*import_map.names, import_map.file_name or ""))
    )
    if units.lengths is None:
        undeclared(source, "the unit of the positions", "units.lengths=mm", "m or inch")
    if columns.joints and units.joints is None:
        undeclared(source, "the unit of the joints", "units.joints=deg", "rad, or a list with a unit for each joint")
    if columns.time is not None and units.time is None:
        undeclared(source, "the unit of the time", "units.time=s", "ms or iso")
    if not has_target:
        undeclared(source, "the target", "fixed.target=smr1", "another name, or columns.target")
    if columns.joints and with_joints_file:
        raise MeasurementError(
            f"{source}: expected joints from one place, found columns.joints in the map and a joints file; "
            "leave one out (--set columns.joints=null)"
        )
    if not columns.joints and not with_joints_file:
        raise MeasurementError(
            f"{source}: this map finds points only: expected a joints file (--joints JOINTS.csv) or columns.joints in "
            "the map, found neither"
        )


def _read_joints(path, import_map):
    """A joints file, DataFrame of joints and, where it has them, pose and group."""
    from irbcal.measurement.imports.column_map import Dialect

    given = import_map.joints_file
    text = dialect.read(path, given.file if given else Dialect())
    if given:
        names, units, pose, group = given.columns.joints, given.units.joints, given.columns.pose, given.columns.group
    else:
        names = columns_module.joint_columns(text.names)
        units = [name.rpartition("_")[2] for name in names]
        pose, group = ("pose" if "pose" in text.names else None), ("group" if "group" in text.names else None)
        if not names:
            raise MeasurementError(
                f"{path}: row {text.header_line}: expected the columns q1_deg, q2_deg … (q1_mm of a rail; "
                f"optional pose and group), or joints_file in the map, found {', '.join(map(short, text.names[:40]))}"
            )
    places = [text.find(name, f"joint {k}") for k, name in enumerate(names, 1)]
    text = text.with_decimal(places)
    frame = pd.DataFrame(joint_values(text, places, units))
    frame[ROW] = text.lines
    for key, column in (("pose", pose), ("group", group)):
        if column is not None:
            frame[key] = text.text(text.find(column, f"the {key}")).to_numpy()
    _check_joint_sizes(frame, path, units, import_map)
    return frame


def _join(frame, path, import_map, warnings):
    """Add the joints of a joints file, by the poses' names or by their order."""
    joints = _read_joints(path, import_map)
    how = import_map.join or ("name" if _names_poses(import_map) and "pose" in joints.columns else "order")
    columns = columns_module.joint_columns(list(joints.columns))
    if how == "name":
        if "pose" not in joints.columns:
            raise MeasurementError(
                f"{path}: row 1: expected a column pose to join by name, found none; --set join=order joins by order"
            )
        double = joints["pose"].duplicated()
        if double.any():
            k = int(np.flatnonzero(double)[0])
            raise MeasurementError(
                f"{path}: row {joints[ROW][k]}, column pose: expected each pose once, found {joints['pose'][k]!r} again"
            )
        place = pd.Index(joints["pose"]).get_indexer(frame["pose"])
        if (place < 0).any():
            row = frame.iloc[int(np.flatnonzero(place < 0)[0])]
            raise MeasurementError(
                f"{row[SOURCE]}: row {row[ROW]}: expected a pose of {path} ({short(str(joints['pose'][0]))} …), found "
                f"{short(row['pose'])!r}; --set join=order joins by order"
            )
    else:
        place, named = pd.factorize(frame["pose"])
        _check_counts(frame, len(named), len(joints), path, import_map)
    frame = frame.copy()
    frame[columns] = joints[columns].to_numpy()[place]
    if "group" in joints.columns and "group" not in frame.columns:
        frame["group"] = joints["group"].to_numpy()[place]
    if how == "order" and "pose" in joints.columns and not _names_poses(import_map) and joints["pose"].is_unique:
        frame["pose"] = joints["pose"].to_numpy()[place]
    unused = np.setdiff1d(np.arange(len(joints)), place)
    if len(unused):
        warnings.append(
            f"{len(unused)} poses of {path} have no row in the measurements, the first in row {joints[ROW][unused[0]]}"
        )
    if how == "name":  # the joints file knows the order in which the robot visited them
        frame = frame.iloc[np.argsort(place, kind="stable")].reset_index(drop=True)
    return frame


def _check_counts(frame, poses, rows, path, import_map):
    """Joining by order needs as many poses as rows of joints, in every file that counts its own."""
    if not _names_poses(import_map) and "{target}" in (import_map.file_name or ""):
        counts = frame.groupby("target", sort=False)["pose"].nunique()
        wrong = counts[counts != rows]
        if len(wrong):
            source = frame[SOURCE][frame["target"] == wrong.index[0]].iloc[0]
            raise MeasurementError(
                f"{source}: expected {rows} rows, as many as {path} has, found {wrong.iloc[0]}: the order does not "
                "tell which is missing or too much; join by name"
            )
    if poses != rows:
        raise MeasurementError(
            f"{frame[SOURCE].iloc[0]}: expected {rows} poses, as many as {path} has rows, found {poses}; "
            "joining by order needs as many"
        )


def _runs(frame):
    """Number poses from 1: neighbouring rows with the same joints, until a target comes again."""
    columns = columns_module.joint_columns(list(frame.columns))
    q = frame[columns].to_numpy()
    new = np.r_[True, np.abs(np.diff(q, axis=0)).max(axis=1) > SAME_JOINTS]
    new |= (frame[SOURCE] != frame[SOURCE].shift()).to_numpy()
    run = np.cumsum(new)
    again = frame.groupby([pd.Series(run), frame["target"]]).cumcount()
    return pd.Series(pd.factorize(pd.MultiIndex.from_arrays([run, again]))[0] + 1, index=frame.index)


def _check_joint_sizes(frame, source, units, import_map):
    """Refuse joints (as read, in degrees and mm) whose size contradicts the declared units."""
    columns = columns_module.joint_columns(list(frame.columns))
    units = [units] * len(columns) if isinstance(units, str) else units
    if import_map.trust_units or len(frame[columns].drop_duplicates()) < ENOUGH:
        return
    for unit, other in (("deg", "rad"), ("rad", "deg")):
        mine = [name for name, its in zip(columns, units, strict=True) if its == unit]
        if not mine:
            continue
        size = frame[mine].abs() / ANGLE_DEG[unit]
        largest = float(size.to_numpy().max())
        column = size.max().idxmax()
        if (unit == "deg" and 0.0 < largest <= MOST_RADIANS) or (unit == "rad" and largest > MOST_TURNS):
            row = frame[ROW].iloc[int(size[column].to_numpy().argmax())]
            raise MeasurementError(
                f"{source}: row {row}, joint {column.partition('_')[0][1:]}: expected joints in {unit} as "
                f"declared, found {largest:.4g} as the largest angle of all: these look like {other} (units.joints: "
                f"{other}; trust_units: true takes them as they are)"
            )


def _apply_joint_rules(frame, columns, import_map):
    """Readings to irbcal's joints, in place."""
    rules = import_map.joints
    n = len(columns)
    for key, given in (("signs", rules.signs), ("offsets_deg", rules.offsets_deg)):
        if given is not None and len(given) != n:
            raise MeasurementError(
                f"the map: joints.{key}: expected {n} numbers, one for each joint, found {len(given)}"
            )
    if rules.signs is None and rules.offsets_deg is None and not rules.add:
        return
    matrix = np.eye(n)
    for to, of in rules.add.items():
        if not (1 <= to <= n and 1 <= of <= n and to != of):
            raise MeasurementError(f"the map: joints.add: expected two different joints of 1 to {n}, found {to}: {of}")
        matrix[to - 1, of - 1] = 1.0
    offsets = np.array(rules.offsets_deg if rules.offsets_deg is not None else np.zeros(n))
    sliding = [k for k, name in enumerate(columns) if name.endswith("_mm") and offsets[k]]
    if sliding:
        raise MeasurementError(f"the map: joints.offsets_deg: expected 0 for joint {sliding[0] + 1}, which slides")
    signs = np.array(rules.signs if rules.signs is not None else np.ones(n))
    frame[columns] = (frame[columns].to_numpy() @ matrix.T) * signs + offsets


def _pose_keys(frame):
    return frame["pose"] + "\n" + frame["cycle"].astype(str) if "cycle" in frame.columns else frame["pose"]


def _poses_together(frame):
    """Rows of a pose (and cycle) beside one another, poses in the order in which they first appear."""
    order = np.argsort(pd.factorize(_pose_keys(frame))[0], kind="stable")
    return frame.iloc[order].reset_index(drop=True)


def _check_one_pose_one_joints(frame, columns):
    index = pd.factorize(_pose_keys(frame))[0]
    first = np.unique(index, return_index=True)[1][index]
    q = frame[columns].to_numpy()
    off = np.abs(q - q[first])
    if (off > SAME_JOINTS).any():
        k = int(np.flatnonzero((off > SAME_JOINTS).any(axis=1))[0])
        joint = int(off[k].argmax())
        row, other = frame.iloc[k], frame.iloc[first[k]]
        raise MeasurementError(
            f"{row[SOURCE]}: row {row[ROW]}: expected the joints of pose {short(row['pose'])} as in row {other[ROW]} "
            f"of {other[SOURCE]} (joint {joint + 1}: {q[first[k], joint]:.6g}), found {q[k, joint]:.6g}"
        )


def _group(frame, import_map, warnings):
    """Name the groups of poses by the map's rules, in place; poses that no rule fits keep what they have."""
    if not import_map.groups:
        return
    number, names = pd.factorize(frame["pose"])
    names = pd.Series(names, dtype=object)
    own = np.full(len(names), "", dtype=object)
    open_ = np.ones(len(names), dtype=bool)
    for rule in import_map.groups:
        if rule.poses is not None:
            fits = names.str.fullmatch(fnmatch.translate(rule.poses)).to_numpy(dtype=bool)
        else:
            place = np.arange(1, len(names) + 1)
            fits = (place >= (rule.first or 1)) & (place <= (rule.last or len(names)))
        if not fits.any():
            warnings.append(f"The rule for group {rule.group} fits no pose")
        own[fits & open_] = rule.group
        open_ &= ~fits
    before = (
        frame["group"].to_numpy(dtype=object) if "group" in frame.columns else np.full(len(frame), "", dtype=object)
    )
    frame["group"] = np.where(open_[number], before, own[number])


def _check_reach(frame, import_map):
    """Refuse positions whose size contradicts the declared unit, and files in which every point is lost."""
    xyz = frame[POSITION].to_numpy()
    have = np.isfinite(xyz).all(axis=1)
    source = frame[SOURCE].iloc[0]
    if not have.any():
        raise MeasurementError(f"{source}: expected measured points, found only lost ones ({len(frame)} rows)")
    reach = np.where(have, np.linalg.norm(np.where(have[:, None], xyz, 0.0), axis=1), 0.0)
    k = int(reach.argmax())
    size = reach[k]
    if import_map.trust_units or (have.sum() < ENOUGH and size < LARGEST_REACH_MM):
        return
    if not SMALLEST_REACH_MM <= size <= LARGEST_REACH_MM:
        unit = import_map.units.lengths
        row = frame.iloc[k]
        wrong = "near" if size < SMALLEST_REACH_MM else "far"
        raise MeasurementError(
            f"{row[SOURCE]}: row {row[ROW]}: expected positions in {unit} as declared, found the farthest of all "
            f"points at {size / LENGTH_MM[unit]:.4g} {unit}, too {wrong} for a tracker: the unit is another "
            "(units.lengths; trust_units: true takes it as it is)"
        )


def _warnings(frame, columns):
    """What the user should look at, in sentences."""
    out = []
    lost = frame["x_mm"].isna()
    for name, all_lost in lost.groupby(frame["target"]).all().items():
        if all_lost:
            out.append(f"Every point of target {name} is lost")
    key = pd.DataFrame({"pose": _pose_keys(frame), "target": frame["target"]})
    again = key.duplicated()
    if again.any():
        row = frame.iloc[int(np.flatnonzero(again)[0])]
        out.append(
            f"{int(again.sum())} rows repeat a target of a pose, the first is {row['pose']}/{row['target']} "
            f"in row {row[ROW]} of {row[SOURCE]}"
        )
    q = frame[columns].to_numpy()
    still = [str(k) for k in range(1, len(columns) + 1) if np.ptp(q[:, k - 1]) <= SAME_JOINTS]
    if still and frame["pose"].nunique() >= ENOUGH:
        out.append(f"Joint {', '.join(still)} never moves")
    return out


def _rounded(frame):
    """The same with 1e-9 mm, degree or second as last place, and no minus zeros."""
    out = frame.copy()
    for name in out.columns:
        if pd.api.types.is_float_dtype(out[name]):
            out[name] = out[name].round(12 if name in QUATERNION else 9) + 0.0
    return out
