"""Lists: files of joints, of poses and of known targets."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement import columns, quaternion_columns
from irbcal.measurement.columns import JOINTS, POSITION, QUATERNION, TableLike
from irbcal.names import from_cell


def read_joints(table: TableLike, joints: Sequence[str] = JOINTS, *, once: bool = False) -> FloatArray:
    """Read a list of joints.

    Parameters
    ----------
    table : str, Path or DataFrame
        ``-`` is standard input.
    joints : sequence of str
        The columns, ``arm.joint_columns``; ``q1_deg`` to ``q6_deg`` unless given. Where the table has programmed joints
        beside them (``c1_deg`` …), these are taken.
    once : bool
        Take each pose of a plan once where the table has a row for each of its targets, see `first_rows`.

    Returns
    -------
    q : ndarray, shape (n, joints)
        Radians (metres from columns in mm).

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format.
    """
    return joints_with_cells(table, joints, once=once)[0]


def joints_with_cells(
    table: TableLike, joints: Sequence[str] = JOINTS, *, once: bool = False
) -> tuple[FloatArray, pd.DataFrame]:
    """As `read_joints`, and the rows that they stand in: texts, with all columns of the table."""
    cells, source, _ = columns.read(table, joints, stdin=True)
    joints = columns.commanded(cells.columns, joints, source)
    if once and {"pose", "target"} <= set(cells.columns):
        cells = cells[first_rows(cells, joints, source)]
    return columns.in_si(cells, joints, source), cells


def first_rows(cells: pd.DataFrame, joints: Sequence[str], source: str) -> BoolArray:
    """The first row of each pose in a table with a row for each target, such as a plan for the tracker.

    Parameters
    ----------
    cells : DataFrame
        Texts, with the columns ``pose`` and ``joints``, and ``cycle`` if need be.
    joints : sequence of str
    source : str
        File name for messages.

    Returns
    -------
    ndarray of bool, shape (rows,)

    Raises
    ------
    MeasurementError
        If two rows of a pose have other joints.
    """
    keys = [name for name in ("pose", "cycle") if name in cells.columns]
    by_pose = cells[keys].apply(lambda column: column.str.strip())
    firsts = cells[list(joints)].groupby([by_pose[name] for name in keys], sort=False).transform("first")
    for name in joints:
        differs = (cells[name] != firsts[name]).to_numpy()
        if differs.any():
            k = int(np.argmax(differs))
            raise MeasurementError(
                f"expected the joints of the pose's first row ({firsts[name].iloc[k]}), found {cells[name].iloc[k]!r}",
                file=source,
                row=int(cells.index[k]),
                column=name,
            )
    return ~by_pose.duplicated().to_numpy(dtype=bool)


def read_poses(table: TableLike) -> FloatArray:
    """Read a list of poses with columns ``x_mm, y_mm, z_mm, qw, qx, qy, qz``.

    Parameters
    ----------
    table : str, Path or DataFrame
        ``-`` is standard input.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        ``T_base_tip``, metres.

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format.
    """
    return poses_with_cells(table)[0]


def poses_with_cells(table: TableLike) -> tuple[FloatArray, pd.DataFrame]:
    """As `read_poses`, and the rows that they stand in: texts, with all columns of the table."""
    cells, source, _ = columns.read(table, [*POSITION, *QUATERNION], stdin=True)
    T = np.zeros((len(cells), 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, 3] = columns.in_si(cells, POSITION, source)
    values = pd.DataFrame({"row": cells.index} | {name: columns.numbers(cells, name, source) for name in QUATERNION})
    quaternion_columns.check(values, source)
    T[:, :3, :3] = quaternion_columns.rotations(values)
    return T, cells


def read_targets(table: TableLike) -> dict[str, FloatArray]:
    """Read a list of known reflector positions with columns ``target``, ``x_mm``, ``y_mm``, ``z_mm``.

    Parameters
    ----------
    table : str, Path or DataFrame

    Returns
    -------
    dict of str to ndarray, shape (3,)
        Positions in the tip link, metres.

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format.
    """
    cells, source, _ = columns.read(table, ["target", *POSITION])
    places = columns.in_si(cells, POSITION, source)
    names = cells["target"].str.strip().map(from_cell)
    columns.refuse_unfit_names(names, "target", source)
    if names.duplicated().any():
        row = names.index[names.duplicated()][0]
        raise MeasurementError(
            f"{names[row]!r} stands there more than once", file=source, row=int(row), column="target"
        )
    return dict(zip(names, places, strict=True))
