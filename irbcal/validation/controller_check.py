"""A robot's URDF against the poses that its controller reports: which numbers the controller computes with.

A controller that shows joints and the pose that it computes of them tells its own kinematics to the last digit. Where
they are the URDF's, programs corrected by irbcal meet a controller that computes as assumed; where they are not, the
URDF that equals the controller is the one to calibrate and to correct with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from irbcal.arrays import FloatArray, NameArray
from irbcal.identification.controller_fit import TOOL, ControllerFit, fit_controller
from irbcal.io import urdf as urdf_module
from irbcal.io.opening import open_robot
from irbcal.io.urdf import UrdfArm
from irbcal.measurement.column_names import QUATERNION
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.overwriting import refuse_overwriting
from irbcal.safe_files import write_together
from irbcal.summary import Paragraph, Remark, Result, Table, remarks, simulated_mark
from irbcal.units import DEG, MM
from irbcal.wording import first_of

FEWEST_ROWS = 12
"""Rows that are needed."""

LISTED_ROWS = 12
"""Rows of another moment that are named."""

ROUND = 50e-6
"""Median distance that rounding and motion between two readings leave at most, metres."""

OptionState = Literal["no sign of it", "seems to be on", "cannot be determined"]
"""Whether an absolute-accuracy option seems to be on."""


@dataclass(frozen=True, eq=False, repr=False)
class ControllerCheck(Result):
    """What a controller computes with, against a URDF.

    Attributes
    ----------
    source : str
    robot : str
        Name of the arm.
    fit : ControllerFit
    nominal : Arm
        As the URDF has it.
    labels : ndarray of str, shape (n,)
        Names of the rows: the column ``pose``, else their rows in the file.
    absolute_accuracy : str
        ``no sign of it``, ``seems to be on``, ``cannot be determined``.
    urdf : bytes
        The URDF that equals the controller.
    urdf_source : str
        The file that it was compared with.
    notes : tuple of str
    simulated : bool
        Whether the file of the poses says that it is simulated.
    """

    source: str
    robot: str
    fit: ControllerFit
    nominal: Arm
    labels: NameArray
    absolute_accuracy: OptionState
    urdf: bytes
    urdf_source: str
    notes: tuple[str, ...]
    simulated: bool = False

    @property
    def agreeing(self) -> int:
        """Number of rows whose joints and pose belong together."""
        return int((~self.fit.moment).sum())

    @property
    def other_moment(self) -> list[str]:
        """Names of the rows whose joints and pose are of different moments."""
        return [str(name) for name in self.labels[self.fit.moment]]

    def median_mm(self, fitted: bool = False) -> float:
        """Median distance of the rows that belong together from the URDF, or from the fitted numbers."""
        errors = self.fit.fitted_errors if fitted else self.fit.nominal_errors
        return float(np.median(errors[~self.fit.moment, 0])) / MM

    def save(self, out: str | PathLike[str]) -> None:
        """Write the URDF that equals the controller, whole or not at all.

        Raises
        ------
        CalibrationError
            If it cannot be written, or is one of the files that were read.
        """
        out = Path(out)
        refuse_overwriting({"out": out}, [self.source, self.urdf_source])
        write_together(out.parent, {out.name: self.urdf})

    COLUMNS = (
        "pose=labels nominal_mm,nominal_deg=fit.nominal_errors fitted_mm,fitted_deg=fit.fitted_errors "
        "other_moment=fit.moment"
    )
    CONTENT = (
        "robot rows=labels.__len__ rows_that_agree=agreeing rows_of_another_moment=other_moment "
        "urdf_median_mm=median_mm numbers absolute_accuracy notes simulated fitted_median_mm=fitted_median *own_frames"
    )

    @property
    def fitted_median(self) -> float:
        """Median distance with the fitted numbers, metres."""
        return self.median_mm(True) * MM

    @property
    def own_frames(self) -> dict[str, FloatArray | None]:
        """Base and tool of the controller where they differ from the URDF's, transforms."""
        differ = self.fit.frames_differ
        return {"base": self.fit.T_base if differ else None, "tool": self.fit.T_tool if differ else None}

    def numbers(self) -> list[dict[str, Any]]:
        """What differs: name, the URDF's value, the controller's, difference and standard deviation, mm and degrees."""
        rows = []
        for name, value, std in zip(self.fit.names, self.fit.values, self.fit.std, strict=True):
            kind = name.rstrip("0123456789")
            length = kind in ("a", "d", "b", "tool_x", "tool_y", "tool_z")
            unit = MM if length else DEG
            urdf = 0.0 if name in TOOL else float(getattr(self.nominal.table, kind)[int(name[len(kind) :]) - 1])
            rows.append(
                {
                    "number": name,
                    "unit": "mm" if length else "deg",
                    "urdf": urdf / unit,
                    "controller": (urdf + float(value)) / unit,
                    "difference": float(value) / unit,
                    "std": float(std) / unit,
                }
            )
        return rows

    def report(self) -> Sequence[Paragraph]:
        """How near, with which numbers, whether an option is on, which rows do not count."""
        fit, count = self.fit, len(self.labels)
        lines: list[Paragraph] = [
            f"{simulated_mark(self.simulated)}{self.agreeing} of {count} reported poses agree with {self.robot} to "
            f"{self.median_mm():.3f} mm (median; 95 % within "
            f"{np.percentile(fit.nominal_errors[~fit.moment, 0], 95) / MM:.3f} mm)."
        ]
        if fit.frames_differ:
            base, tool = (_frame_in_words(T) for T in (fit.T_base, fit.T_tool))
            lines.append(
                f"That is with frames of its own: base link at {base} in its base, its tool at {tool} in the tip link."
            )
        if fit.names:
            lines.append(f"With the numbers below they agree to {self.median_mm(True):.3f} mm (median).")
            rows = tuple(
                (row["number"], row["urdf"], row["controller"], row["difference"], row["std"], row["unit"])
                for row in self.numbers()
            )
            lines.append(
                Table(
                    "Numbers of the DHM table that differ",
                    ("number", "URDF", "controller", "difference", "±", "unit"),
                    rows,
                    4,
                )
            )
        else:
            lines.append("The controller computes with the numbers of the URDF.")
        lines.append(self._option_in_words())
        excluded = self.other_moment
        if excluded:
            listed = f"rows {first_of(excluded, LISTED_ROWS)}"
            lines.append(Remark("Note", f"left out, as joints and pose are of different moments, {listed}"))
        return [*lines, *remarks("Note", self.notes)]

    def _option_in_words(self) -> str:
        if self.absolute_accuracy == "seems to be on":
            return (
                "An absolute-accuracy option (or a factory calibration) seems to be on: nearly all numbers differ a "
                "little. Do not correct programs for a controller that corrects them itself."
            )
        if self.absolute_accuracy == "no sign of it":
            edition = "; a few other lengths or zeros are another edition of the model" if self.fit.names else ""
            return f"No sign of an absolute-accuracy option: it would change nearly all numbers a little{edition}."
        return "Whether an absolute-accuracy option is on cannot be determined: no rigid model explains the residuals."


def controller(
    poses: TableLike,
    robot: str | Path,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
) -> ControllerCheck:
    """Which numbers a controller computes with: ``irbcal controller`` as a function.

    Parameters
    ----------
    poses : str, Path or DataFrame
        Joints (``q1_deg`` … or ``q1_rad`` …, ``q1_mm`` or ``q1_m`` of a joint that slides) and the pose that the
        controller reports for them: ``x_mm``, ``y_mm``, ``z_mm`` (or ``x_m`` …) and ``qw``, ``qx``, ``qy``, ``qz``; all
        of these may begin with ``controller_``. Optional ``pose``.
    robot : str or Path
        URDF, a robot's name, or a calibration folder: the robot that it began from.
    base_link, tip_link, coupling : str, optional
        See `irbcal.read_urdf`.

    Returns
    -------
    ControllerCheck
        ``save(path)`` writes the URDF that equals the controller.

    Raises
    ------
    IrbcalError
        If an input is refused, or the poses are nowhere near those of the robot.
    """
    opened = open_robot(robot, nominal=True, base_link=base_link, tip_link=tip_link, coupling=coupling)
    urdf = opened.nominal_urdf
    q, T, labels, table = _read(poses, urdf.arm)
    fit = fit_controller(urdf.arm, q, T, table.source)
    data, notes = _written(urdf, fit)
    return ControllerCheck(
        table.source,
        urdf.arm.name,
        fit,
        urdf.arm,
        labels,
        _option(fit),
        data,
        str(opened.file),
        tuple(notes),
        table.simulated,
    )


def _option(fit: ControllerFit) -> OptionState:
    if float(np.median(fit.fitted_errors[~fit.moment, 0])) > ROUND:
        return "cannot be determined"
    return "seems to be on" if fit.nearly_all else "no sign of it"


def _written(urdf: UrdfArm, fit: ControllerFit) -> tuple[bytes, list[str]]:
    """The URDF that equals the controller, and what it does not hold."""
    notes = []
    data = urdf_module.to_bytes(urdf, fit.arm, comment="irbcal: made equal to a controller's kinematics")
    if fit.frames_differ:
        notes.append("the URDF holds the controller's numbers of the arm, not its base frame and tool")
    elif not np.allclose(fit.T_tool, np.eye(4), rtol=0, atol=1e-12):
        moved = urdf_module.with_tip_moved(data, urdf.arm.name, urdf.arm.tip_link, fit.T_tool)
        if moved is None:
            notes.append(
                f"the URDF does not hold what differs at the tool: {urdf.arm.tip_link} hangs on a joint that moves"
            )
        data = data if moved is None else moved
    return data, notes


def _frame_in_words(T: FloatArray) -> str:
    values = frames.to_xyz_angles(T) / np.array([MM] * 3 + [DEG] * 3) + 0.0
    return (
        "("
        + ", ".join(f"{value:.3f}" for value in values[:3])
        + " mm; "
        + ", ".join(f"{value:.4f}" for value in values[3:])
        + " deg about x, y, z)"
    )


def _read(poses: TableLike, arm: Arm) -> tuple[FloatArray, FloatArray, NameArray, InputTable]:
    """Joints (n, joints), reported poses (n, 4, 4), names of the rows, and the table."""
    table = InputTable.read(poses)

    def first(*names: str) -> str:
        return table.either(*([name for name in names if name in table][:1] or names))

    units = [("mm", "m") if slides else ("deg", "rad") for slides in arm.table.prismatic]
    q = table.si([first(*(f"q{k}_{unit}" for unit in pair)) for k, pair in enumerate(units, 1)])
    prefixes = ("controller_", "")
    xyz = [first(*(f"{prefix}{axis}_{unit}" for unit in ("mm", "m") for prefix in prefixes)) for axis in "xyz"]
    quaternion = table.quaternions([first(*(f"{prefix}{name}" for prefix in prefixes)) for name in QUATERNION])
    assert quaternion is not None, "its columns are there"
    if len(table) < FEWEST_ROWS:
        raise table.fault(f"expected {FEWEST_ROWS} rows or more, found {len(table)}")
    T = np.tile(np.eye(4), (len(table), 1, 1))
    T[:, :3, :3] = frames.matrix_from_quaternion(quaternion)
    T[:, :3, 3] = table.si(xyz)
    names = table.texts("pose") if "pose" in table else table.rows.astype(str).astype(object)
    return arm.check_joints(arm.from_controller(q)), T, names, table
