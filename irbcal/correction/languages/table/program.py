"""A CSV program and the way back into its file: new numbers in their columns, the text of all others as it was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray, lock
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.notation import DECIMALS, QUATERNION_DECIMALS, numbers_from_poses
from irbcal.correction.program import Goals, Kind, Left, Note, Stop
from irbcal.measurement.columns import QUATERNION, joint_units

if TYPE_CHECKING:
    import pandas as pd

MARK = "irbcal_filtered"
"""Name of the column that marks a corrected file."""


@dataclass(frozen=True, eq=False, repr=False)
class TableProgram:
    """A CSV program as read.

    Attributes
    ----------
    source : str
        File name for messages.
    kind : str
        ``joint`` or ``pose``.
    columns : tuple of str
        Names of the columns with the numbers.
    values : ndarray, shape (n, joints) or (n, 4, 4)
        Joints in radians (metres for prismatic joints), or ``T_base_tip`` in metres; locked.
    rows : ndarray of int, shape (n,)
        Lines in the file.
    data : bytes
        The file.
    table : DataFrame
        All columns in the text of the file.
    newline : str
        Line end of the file.
    byte_order_mark : bool
        Whether the file begins with one.
    fingerprint : str or None
        Of the calibration that this program was already corrected with.
    """

    source: str
    kind: Kind
    columns: tuple[str, ...]
    values: FloatArray
    rows: IntArray
    data: bytes
    table: pd.DataFrame
    newline: str
    byte_order_mark: bool
    fingerprint: str | None

    def __post_init__(self) -> None:
        lock(self)

    @property
    def notes(self) -> tuple[Note, ...]:
        """There is nothing in a table that the corrections do not know about."""
        return ()

    def left(self) -> tuple[Left, ...]:
        """Every row is to be corrected."""
        return ()

    def goals(self) -> list[Goals]:
        """All rows."""
        names = tuple(f"row {row}" for row in self.rows.tolist())
        return [Goals(self.kind, np.arange(len(names)), names, self.rows, self.values)]

    def stops(self) -> list[Stop]:
        """A row a stop, in the order of the file."""
        return [Stop(row, k, k - 1 if k else None) for k, row in enumerate(self.rows.tolist())]

    def refused(self, goals: Goals, fake: Corrected) -> list[str]:
        """Everything can be written into a table."""
        return [""] * len(goals.names)

    def with_fake_targets(self, found: Sequence[tuple[Goals, Corrected]], fingerprint: str | None) -> dict[str, bytes]:
        """The table with the joints or poses of the rows that are corrected, marked in a column."""
        ((_, fake),) = found
        values = fake.q if self.kind == "joint" else fake.T_fake
        return {self.source: with_values(self, values, fingerprint, fake.ok) if fake.ok.any() else self.data}


def with_values(
    program: TableProgram,
    values: ArrayLike,
    fingerprint: str | None = None,
    rows: ArrayLike | None = None,
    more: Mapping[str, FloatArray] | None = None,
) -> bytes:
    """Bytes of the program with new values; all other columns keep their text.

    Parameters
    ----------
    program : TableProgram
    values : ndarray, shape (n, joints) or (n, 4, 4)
        Joints in radians (metres for prismatic joints), or ``T_base_tip`` in metres.
    fingerprint : str, optional
        Of the calibration, for the column that marks a corrected file; without it there is none.
    rows : ndarray of bool, shape (n,), optional
        Rows that get their new values, the others keep their text (their new values may be NaN) and get no mark;
        all by default.
    more : dict of str to ndarray, shape (n,), optional
        Numbers of other columns that are new, too, in the units of the file.

    Returns
    -------
    bytes

    Raises
    ------
    ValueError
        If a value is not finite, not rigid or of the wrong shape.
    """
    new = np.asarray(values, dtype=float)
    n = len(program.table)
    chosen = np.ones(n, dtype=bool) if rows is None else np.asarray(rows, dtype=bool)
    if new.shape != program.values.shape or chosen.shape != (n,) or not np.isfinite(new[chosen]).all():
        raise ValueError(f"expected finite values of shape {program.values.shape}")
    if program.kind == "pose":
        near = program.table[QUATERNION].to_numpy(dtype=float)
        numbers = numbers_from_poses(new[chosen], near[chosen])
    else:
        numbers = new[chosen] / joint_units(program.columns)
    changed = dict(zip(program.columns, numbers.T, strict=True))
    changed |= {name: column[chosen] for name, column in (more or {}).items()}
    columns = []
    for name in program.table.columns:
        if name == MARK and fingerprint is not None:
            continue
        text = program.table[name].to_numpy(dtype=object)
        column = _new_column(name, changed[name], text, chosen) if name in changed else ("%s", _quoted(text))
        columns.append((_quoted(np.array([name], dtype=object))[0], *column))
    if fingerprint is not None:
        columns.append((MARK, "%s", _quoted(np.where(chosen, fingerprint, "").astype(object))))
    flat = np.empty((n, len(columns)), dtype=object)
    for k, (_, _, cells) in enumerate(columns):
        flat[:, k] = cells
    body = (",".join(form for _, form, _ in columns) + program.newline) * n % tuple(flat.ravel())
    head = ",".join(name for name, _, _ in columns) + program.newline
    return (head + body).encode("utf-8-sig" if program.byte_order_mark else "utf-8")


def _new_column(name: str, values: FloatArray, text: NameArray, chosen: BoolArray) -> tuple[str, NameArray]:
    """Format and cells of a column with new values for the chosen rows."""
    decimals = QUATERNION_DECIMALS if name in QUATERNION else DECIMALS
    form = f"%.{decimals}f"
    rounded = np.round(values, decimals) + 0.0  # no negative zero
    if chosen.all():
        return form, rounded.astype(object)
    cells = text.copy()
    cells[chosen] = [form % value for value in rounded.tolist()]
    return "%s", _quoted(cells)


def _quoted(cells: NameArray) -> NameArray:
    """Cells with the quotation marks that CSV asks for."""
    joined = "\x00".join(cells)
    if not any(char in joined for char in ',"\r\n'):
        return cells
    return np.array(
        ['"' + cell.replace('"', '""') + '"' if any(char in cell for char in ',"\r\n') else cell for cell in cells],
        dtype=object,
    )
