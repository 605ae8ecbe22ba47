"""Measurement and joint files: reading, checking, and the table as it was measured.

A measurement file has one row for each point that the tracker was asked for::

    pose,q1_deg,...,q6_deg,target,x_mm,y_mm,z_mm[,group,payload_kg,time_s,cycle,u95_mm,qw,qx,qy,qz,...]

Arms with another number of joints have as many columns; the travel of a prismatic joint is ``q1_mm``. Column order is
free and unknown columns are kept. A position that is empty, NaN or exactly 0,0,0 is a lost point. A column
``simulated`` (yes) marks data that no tracker measured. Errors name the file, the row (line of the file, the header
being line 1) and the column.
"""

import csv
import hashlib
import re
import unicodedata
import warnings
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.units import DEG, MM

JOINTS = [f"q{i}_deg" for i in range(1, 7)]
"""Joint columns of arms with six revolute joints."""
JOINT = re.compile(r"q([1-9]\d?)_(?:deg|mm)")
POSITION = ["x_mm", "y_mm", "z_mm"]
REQUIRED = ["pose", "target", *POSITION]
QUATERNION = ["qw", "qx", "qy", "qz"]
NUMERIC_EXTRAS = ["payload_kg", "time_s", "u95_mm", *QUATERNION]
REFERENCE_PREFIX = "ref"
LARGEST_ANGLE_DEG, LARGEST_POSITION_MM = 1e4, 1e6


@dataclass(frozen=True, eq=False)
class MeasurementSet:
    """Measurements as read: one row per asked-for point.

    Attributes
    ----------
    table : DataFrame
        Checked columns of the file format; ``row`` is the line in the file. Lost points have NaN positions.
    source : str
        File name for messages.
    sha256 : str
        Of the file's content.
    """

    table: pd.DataFrame
    source: str
    sha256: str

    @property
    def simulated(self):
        """Whether the file says so itself: any value but ``no`` in a column ``simulated``."""
        if "simulated" not in self.table.columns:
            return False
        return bool((~self.table["simulated"].astype(str).str.lower().isin(["", "no", "0", "false"])).any())

    @property
    def poses(self):
        """Number of poses asked for."""
        return int(self.table["pose_index"].nunique())

    @property
    def joint_columns(self):
        """Columns of joint values, in the order of the joints."""
        return joint_columns(list(self.table.columns))

    def joints(self):
        """Joints of each pose in the order of the file, shape (n, joints), radians (metres from columns in mm)."""
        columns = self.joint_columns
        units = [MM if name.endswith("_mm") else DEG for name in columns]
        return self.table.groupby("pose_index", sort=True)[columns].first().to_numpy() * units

    def check_joints(self, arm):
        """Refuse joint columns that are not those of an arm.

        Raises
        ------
        MeasurementError
            The sentence names the columns.
        """
        expected, found = arm.joint_columns, self.joint_columns
        if expected != found:
            missing = [name for name in expected if name not in found]
            which = f"missing column {', '.join(missing)}" if missing else f"there is a column {found[len(expected)]}"
            raise MeasurementError(
                f"{self.source}: row 1: {which}: {arm.name} has {len(expected)} joints between the links "
                f"{arm.base_link} and {arm.tip_link} (--base-link, --tip-link) with the columns {expected[0]} … "
                f"{expected[-1]}, found {', '.join(found)}"
            )

    def is_reference(self):
        """Mask of the rows that are reference points fixed to the ground."""
        return self.table["target"].str.lower().str.startswith(REFERENCE_PREFIX).to_numpy()

    def rotations(self):
        """Measured orientations of all rows, shape (rows, 3, 3), NaN where there is none; None without columns."""
        from scipy.spatial.transform import Rotation

        if QUATERNION[0] not in self.table.columns:
            return None
        w, x, y, z = self.table[QUATERNION].to_numpy().T
        have = np.isfinite(w)
        out = np.full((len(w), 3, 3), np.nan)
        if have.any():
            out[have] = Rotation.from_quat(np.column_stack([x, y, z, w])[have]).as_matrix()
        return out

    def uncertainties(self):
        """Expanded uncertainties of all rows, shape (rows,), metres, NaN where not given; None without a column."""
        return self.table["u95_mm"].to_numpy() * MM if "u95_mm" in self.table.columns else None

    def positions(self):
        """Positions of all rows, shape (rows, 3), metres; NaN where lost."""
        return self.table[POSITION].to_numpy() * MM


def read(path):
    """Read a measurement file.

    Parameters
    ----------
    path : str or Path
        CSV, or Parquet where pyarrow is installed.

    Returns
    -------
    MeasurementSet

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    raw, source, digest = _read_columns(path, ["pose", None, *REQUIRED[1:]])
    table = pd.DataFrame({"row": raw.index})
    for name in joint_columns(list(raw.columns)):
        table[name] = _numbers(raw, name, source, _expected_joint(name))
    for name in POSITION:
        table[name] = _numbers(raw, name, source, "a position in mm or nothing", lost=True)
    for name in ("pose", "target"):
        table[name] = _names(raw, name, source)
    for name in [c for c in raw.columns if c not in table.columns]:
        if name in NUMERIC_EXTRAS:
            table[name] = _numbers(raw, name, source, "a number or nothing", lost=True)
        else:
            if name in ("group", "cycle"):
                _refuse_control_characters(raw[name].astype(str), name, source)
            table[name] = raw[name].to_numpy()
    xyz = table[POSITION].to_numpy()
    lost = np.isnan(xyz).any(axis=1) | (xyz == 0.0).all(axis=1)
    table.loc[lost, POSITION] = np.nan
    table["pose_index"] = _pose_index(table, source)
    _check_sizes(table, source)
    _check_quaternions(table, source)
    return MeasurementSet(table, source, digest)


read_measurements = read
MeasurementsLike = object


def read_joints(path, columns=JOINTS):
    """Read a file of joints.

    Parameters
    ----------
    path : str or Path
    columns : sequence of str
        ``arm.joint_columns``; ``q1_deg`` to ``q6_deg`` unless given.

    Returns
    -------
    q : ndarray, shape (n, joints)
        Radians (metres from columns in mm).

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    raw, source, _ = _read_columns(path, list(columns))
    values = [_numbers(raw, name, source, _expected_joint(name)) for name in columns]
    return np.column_stack(values) * [MM if name.endswith("_mm") else DEG for name in columns]


def joint_columns(names):
    """Joint columns among column names, ordered by the joints' numbers; only whole series from joint 1."""
    numbered = {int(match[1]): name for name in names if (match := JOINT.fullmatch(name))}
    columns = []
    while len(columns) + 1 in numbered:
        columns.append(numbered[len(columns) + 1])
    return columns


def _expected_joint(name):
    return "a joint's travel in mm" if name.endswith("_mm") else "a joint angle in degrees"


def read_poses(path):
    """Read a file of poses with columns ``x_mm, y_mm, z_mm, qw, qx, qy, qz``.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        ``T_base_tip``, metres.

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    from scipy.spatial.transform import Rotation

    raw, source, _ = _read_columns(path, [*POSITION, *QUATERNION])
    table = pd.DataFrame({"row": raw.index})
    for name in POSITION:
        table[name] = _numbers(raw, name, source, "a position in mm")
    for name in QUATERNION:
        table[name] = _numbers(raw, name, source, "a quaternion's number")
    _check_quaternions(table, source)
    T = np.zeros((len(table), 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, :3] = Rotation.from_quat(table[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
    T[:, :3, 3] = table[POSITION].to_numpy() * MM
    return T


def read_targets(path):
    """Read a file of known reflector positions with columns ``target``, ``x_mm``, ``y_mm``, ``z_mm``.

    Returns
    -------
    dict of str to ndarray, shape (3,)
        Positions in the tip link, metres.

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    raw, source, _ = _read_columns(path, ["target", *POSITION])
    columns = [_numbers(raw, name, source, "a position in mm") for name in POSITION]
    names = raw["target"].str.strip()
    if names.duplicated().any():
        row = names.index[names.duplicated()][0]
        raise MeasurementError(f"{source}: row {row}, column target: {names[row]!r} stands there more than once")
    return dict(zip(names, np.column_stack(columns) * MM, strict=True))


def _read_columns(path, required):
    path = Path(path)
    source = str(path)
    try:
        data = path.read_bytes()
    except IsADirectoryError:
        raise MeasurementError(f"{source}: expected a file, found a folder") from None
    except FileNotFoundError:
        raise MeasurementError(f"{source}: there is no such file") from None
    except PermissionError:
        raise MeasurementError(f"{source}: no permission to read this file") from None
    if not data.strip():
        raise MeasurementError(f"{source}: the file is empty, expected a header and rows")
    parse = _parse_parquet if path.suffix == ".parquet" else _parse_csv
    raw = parse(data, source, required)
    if raw.empty:
        raise MeasurementError(f"{source}: the file has a header but no rows")
    return raw, source, hashlib.sha256(data).hexdigest()


def _check_header(names, required, source):
    """Refuse a header that lacks a required column or names one twice; None stands for the joints."""
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise MeasurementError(f"{source}: row 1: column {double[0]!r} stands there more than once")
    if None in required:  # joints, however many: up to the last one in the header
        numbers = sorted(int(match[1]) for name in names if (match := JOINT.fullmatch(name)))
        double = [k for k in set(numbers) if numbers.count(k) > 1]
        if double:
            raise MeasurementError(f"{source}: row 1: joint {double[0]} stands there in degrees and in mm")
        joints = [
            f"q{k}_deg" for k in range(1, (numbers[-1] if numbers else len(JOINTS)) + 1) if f"q{k}_mm" not in names
        ]
        place = required.index(None)
        required = [*required[:place], *joints, *required[place + 1 :]]
    missing = [name for name in required if name not in names]
    if missing:
        hint = ""
        if any(name.removesuffix("_deg") + "_rad" in names for name in missing):
            hint = "; joints are expected in degrees (q1_deg … q6_deg), found radians"
        elif any(name.removesuffix("_mm") + "_m" in names for name in missing):
            hint = "; positions are expected in millimetres (x_mm, y_mm, z_mm), found metres"
        found = ", ".join(name if len(name) < 40 else name[:40] + "…" for name in names[:40])
        raise MeasurementError(f"{source}: row 1: missing column {', '.join(missing)}; found {found}{hint}")


def _parse_csv(data, source, required):
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise MeasurementError(f"{source}: row {line}: expected UTF-8 text, found other bytes") from None
    if not text.strip():
        raise MeasurementError(f"{source}: the file is empty, expected a header and rows")
    if "\x00" in text:
        raise MeasurementError(f"{source}: expected a text file with commas, found binary data")
    header = next(line for line in text.splitlines() if line.strip())
    if "," not in header and (";" in header or "\t" in header):
        found = "semicolons" if ";" in header else "tabs"
        raise MeasurementError(f"{source}: row 1: expected commas between the columns, found {found}")
    names = [name.strip() for name in next(csv.reader([header]), [])]
    _check_header(names, required, source)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            raw = pd.read_csv(
                StringIO(text), dtype=str, header=None, keep_default_na=False, skip_blank_lines=False, index_col=False
            )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning) as error:
        reason = " ".join(str(error).split()).removeprefix("Error tokenizing data. C error: ")
        raise MeasurementError(f"{source}: not a table with as many values in each row as names: {reason}") from None
    raw = raw.fillna("")
    raw.index = raw.index + 1  # lines of the file
    raw = raw[(raw != "").any(axis=1)]
    raw = raw.iloc[1:]
    raw.columns = names
    return raw


def _parse_parquet(data, source, required):
    try:
        raw = pd.read_parquet(BytesIO(data))
    except ImportError:
        raise MeasurementError(f"{source}: reading Parquet needs the package pyarrow, which is absent") from None
    except Exception as error:  # whatever pyarrow raises on a damaged file
        raise MeasurementError(f"{source}: not a Parquet file: {error}") from None
    raw.columns = [str(name).strip() for name in raw.columns]
    _check_header(list(raw.columns), required, source)
    raw.index = range(1, len(raw) + 1)
    return raw.astype(str)


def _names(raw, name, source):
    """Names of a column, an array of str; every row must have one that can be shown."""
    values = raw[name].astype(str).str.strip()
    if (values == "").any():
        row = values.index[values == ""][0]
        raise MeasurementError(f"{source}: row {row}, column {name}: expected a name, found nothing")
    _refuse_control_characters(values, name, source)
    return values.to_numpy()


def _refuse_control_characters(values, name, source):
    """Names go to terminals, tables and pages: what would act there instead of being shown is refused."""
    for value in values.unique():
        if any(unicodedata.category(character) == "Cc" for character in value):
            row = values.index[values == value][0]
            raise MeasurementError(f"{source}: row {row}, column {name}: expected a name, found {value!r}")


def _numbers(raw, name, source, expected, lost=False):
    text = raw[name].str.strip()
    values = pd.to_numeric(text, errors="coerce")
    absent = text.str.lower().isin(["", "nan", "<na>", "none"])
    bad = ~absent & values.isna() | np.isinf(values)
    if not lost:
        bad |= absent
    if bad.any():
        row = bad.index[bad][0]
        found = repr(text[row]) if text[row] else "nothing"
        raise MeasurementError(f"{source}: row {row}, column {name}: expected {expected}, found {found}")
    return values.to_numpy(dtype=float)


def _check_sizes(table, source):
    """Refuse numbers that no robot cell holds and uncertainties that are none."""
    bounds = [
        (name, -largest, largest, _expected_joint(name))
        for name in joint_columns(list(table.columns))
        for largest in [LARGEST_POSITION_MM if name.endswith("_mm") else LARGEST_ANGLE_DEG]
    ]
    bounds += [(name, -LARGEST_POSITION_MM, LARGEST_POSITION_MM, "a position within 1 km in mm") for name in POSITION]
    if "u95_mm" in table.columns:
        bounds.append(("u95_mm", 1e-6, LARGEST_POSITION_MM, "an uncertainty above zero in mm or nothing"))
    for name, low, high, expected in bounds:
        values = table[name].to_numpy()
        bad = (values < low) | (values > high)
        if bad.any():
            k = int(np.flatnonzero(bad)[0])
            row = table["row"].iloc[k]
            raise MeasurementError(f"{source}: row {row}, column {name}: expected {expected}, found {values[k]:g}")


def _check_quaternions(table, source):
    """Orientations are whole unit quaternions or absent; made exactly unit here."""
    present = [name for name in QUATERNION if name in table.columns]
    if not present:
        return
    if len(present) < 4:
        missing = ", ".join(name for name in QUATERNION if name not in present)
        raise MeasurementError(f"{source}: row 1: missing column {missing}; an orientation needs qw, qx, qy, qz")
    q = table[QUATERNION].to_numpy()
    given = np.isfinite(q)
    norm = np.linalg.norm(np.where(given, q, 0.0), axis=1)
    bad = (given.any(axis=1) & ~given.all(axis=1)) | (given.all(axis=1) & (np.abs(norm - 1) > 1e-3))
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        found = ", ".join(f"{value:g}" for value in q[k])
        raise MeasurementError(
            f"{source}: row {table['row'][k]}, columns qw, qx, qy, qz: expected a unit quaternion or nothing, "
            f"found {found}"
        )
    table[QUATERNION] = q / np.where(norm > 0, norm, 1.0)[:, None]


def _pose_index(table, source):
    """Number poses in the order of the file; one pose (and cycle) has one set of joints."""
    key = table["pose"]
    if "cycle" in table.columns:
        key = key + " / " + table["cycle"].astype(str)
    index = pd.factorize(key)[0]
    columns = joint_columns(list(table.columns))
    joints = table[columns].to_numpy()
    first = np.unique(index, return_index=True)[1]
    differ = np.abs(joints - joints[first][index]).max(axis=1) > 1e-6
    if differ.any():
        k = int(np.flatnonzero(differ)[0])
        column = columns[int(np.argmax(np.abs(joints[k] - joints[first[index[k]]])))]
        raise MeasurementError(
            f"{source}: row {table['row'][k]}, column {column}: expected the joints of pose {table['pose'][k]} as in "
            f"row {table['row'][first[index[k]]]}, found {joints[k, columns.index(column)]:g}"
        )
    return index
