"""What forward and inverse kinematics found: rows for the commands fk and ik, and for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray, plain
from irbcal.modeling import frames
from irbcal.modeling.inverse.along_path import SingularPlace
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

SHOWN = 10
"""Rows of a result that are shown to people."""


@dataclass(frozen=True, eq=False, repr=False)
class ForwardResult(Result):
    """Where a robot ends for n rows of commanded joints.

    Attributes
    ----------
    T_base_tip : ndarray, shape (n, 4, 4)
        Poses of the tip link in the base link, metres.
    tip, base : str
        Names of these links.
    target : str or None
        The reflector asked for.
    points : ndarray, shape (n, 3), or None
        Its places in the measuring frame, metres; None without a target.
    std : ndarray, shape (n, 3), or None
        Standard deviations of x, y and z, of the reflector or, without one, of the tip, metres; None unless asked for.
        They are those of the identified parameters: what the model cannot describe is in the held-out errors only.
    heldout_mean, heldout_rms : float or None
        Of the calibration's held-out errors, metres; None where there are none, or ``std`` was not asked for.
    interval : ndarray, shape (n, 3), or None
        Half-widths that hold 95 % of a coordinate's errors, metres; None unless asked for.
    outside : ndarray of bool, shape (n,), or None
        Whether a joint is outside the ranges of the calibration's fit; None unless intervals were asked for.
    note : str
        How many poses are outside, in which joints and by how much; empty where none is, or nothing is known.
    given : DataFrame or None
        The table that the joints came from, texts; None where they came as numbers.
    """

    T_base_tip: FloatArray
    tip: str
    base: str
    target: str | None = None
    points: FloatArray | None = None
    std: FloatArray | None = None
    heldout_mean: float | None = None
    heldout_rms: float | None = None
    interval: FloatArray | None = None
    outside: BoolArray | None = None
    note: str = ""
    given: pd.DataFrame | None = None

    def __len__(self) -> int:
        return len(self.T_base_tip)

    def to_frame(self, as_written: bool = False) -> pd.DataFrame:
        """A row for each row of joints, as the command fk prints it, beside what was read with them (``given``).

        Returns
        -------
        DataFrame
            ``x_mm, y_mm, z_mm`` of the target in the measuring frame; without a target of the tip in the base link, and
            ``qw, qx, qy, qz`` (unit quaternion, scalar first). ``std_x_mm`` and so on where asked for; ``x_u95_mm`` and
            so on and ``outside`` with intervals.
        """
        import pandas as pd

        from irbcal.measurement.columns import with_input_columns

        if self.points is None:
            table = poses_to_frame(self.T_base_tip)
        else:
            table = pd.DataFrame(self.points / MM, columns=["x_mm", "y_mm", "z_mm"])
        if self.std is not None:
            for name, values in zip("xyz", self.std.T, strict=True):
                table[f"std_{name}_mm"] = values / MM
        if self.interval is not None and self.outside is not None:
            for name, values in zip("xyz", self.interval.T, strict=True):
                table[f"{name}_u95_mm"] = values / MM
            table["outside"] = np.array(self.outside)
        return with_input_columns(self.given, table, as_written)

    def to_dict(self) -> dict[str, Any]:
        """Names of the links and of the target, and the rows as the command fk prints them, ready for JSON."""
        rows = plain(self.to_frame().to_dict(orient="records"))
        return {"tip": self.tip, "base": self.base, "target": self.target, "rows": rows}

    @property
    def caution(self) -> str:
        """What standard deviations do not say, and poses outside the joint ranges; empty where there is nothing."""
        if self.heldout_mean is None or self.heldout_rms is None:
            return self.note
        text = (
            "standard deviations are those of the parameters; held-out errors of this calibration: mean "
            f"{self.heldout_mean / MM:.3f} mm, rms {self.heldout_rms / MM:.3f} mm"
        )
        return f"{text}. {self.note}" if self.note else text

    def report(self) -> Sequence[Paragraph]:
        """What is where, and the first rows."""
        subject = f"{self.tip} in {self.base}" if self.target is None else f"{self.target} in the measuring frame"
        lines: list[Paragraph] = [f"{len(self)} {'poses' if self.target is None else 'places'} of {subject}"]
        lines += [self.caution] if self.caution else []
        return [*lines, _first_rows(self.to_frame())]


@dataclass(frozen=True, eq=False, repr=False)
class InverseJoints(Result):
    """Commanded joints for poses of a robot's tip.

    Attributes
    ----------
    joints : ndarray, shape (m, joints)
        Radians (metres for prismatic joints); NaN where a pose has none. One row for each pose, or, with all branches,
        for each branch of each pose that reaches it within the joint limits.
    row : ndarray of int, shape (m,)
        The pose that the joints are for, from 0.
    branch : ndarray of str, shape (m,), or None
        Name of the branch; None unless all were asked for.
    note : ndarray of str, shape (m,)
        Why there are no joints, or that they are outside the limits; else empty.
    columns : tuple of str
        Names of the joints' columns in files: ``q1_deg`` and so on, ``q1_mm`` of a prismatic joint.
    units : ndarray, shape (joints,)
        SI value of one unit of each column.
    coupling : ndarray, shape (joints, joints), optional
        Of the arm, see `irbcal.modeling.coupling`: tables hold joints as the controller counts them.
    given : DataFrame or None
        The table that the poses came from, texts; None where they came as numbers.
    singular : tuple of SingularPlace
        Where a path comes near to a singularity; empty unless the poses were followed as a path.
    """

    joints: FloatArray
    row: IntArray
    branch: NameArray | None
    note: NameArray
    columns: tuple[str, ...]
    units: FloatArray
    coupling: FloatArray | None = None
    given: pd.DataFrame | None = None
    singular: tuple[SingularPlace, ...] = ()

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def found(self) -> BoolArray:
        """Which rows have joints, shape (m,)."""
        return np.logical_and.reduce(np.isfinite(self.joints), axis=1)

    def to_frame(self, as_written: bool = False) -> pd.DataFrame:
        """The rows as the command ik prints them, beside what was read with the poses (``given``).

        Returns
        -------
        DataFrame
            The joint columns (degrees, mm; NaN where there is no solution) and ``note``; with all branches first
            ``row`` (of the poses, from 1) and ``branch``.
        """
        import pandas as pd

        from irbcal.measurement.columns import with_input_columns

        q = self.joints if self.coupling is None else self.joints @ np.linalg.inv(self.coupling).T
        table = pd.DataFrame(q / self.units, columns=list(self.columns))
        if self.branch is not None:
            table.insert(0, "branch", self.branch)
            table.insert(0, "row", self.row + 1)
        table["note"] = self.note
        return with_input_columns(self.given, table, as_written, self.row)

    def to_dict(self) -> dict[str, Any]:
        """The rows as the command ik prints them, ready for JSON: None where there is no solution."""
        return {"rows": plain(self.to_frame().to_dict(orient="records"))}

    def report(self) -> Sequence[Paragraph]:
        """How many poses have joints, and the first rows."""
        if self.branch is not None:
            headline = f"{len(self)} ways to reach {len(set(self.row.tolist()))} poses within the joint limits"
        else:
            headline = f"joints for {int(self.found.sum())} of {len(self)} poses"
        return [headline, *(singularity.in_words() for singularity in self.singular), _first_rows(self.to_frame())]


def _first_rows(table: pd.DataFrame) -> Table:
    title = f"the first {SHOWN} of {len(table)} rows" if len(table) > SHOWN else "rows"
    return Table.of(title, table.head(SHOWN), digits=6)


def poses_to_frame(T_base_tip: FloatArray) -> pd.DataFrame:
    """Poses (n, 4, 4) as a table: ``x_mm, y_mm, z_mm, qw, qx, qy, qz`` (unit quaternion, scalar first, qw >= 0)."""
    import pandas as pd

    values = np.column_stack([T_base_tip[:, :3, 3] / MM, frames.quaternion_from_matrix(T_base_tip[:, :3, :3])])
    return pd.DataFrame(values, columns=["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"])
