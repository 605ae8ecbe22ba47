"""From a Denavit-Hartenberg table, as data sheets and papers print it, to a URDF that everything else takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from irbcal import safe_files
from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.io import urdf
from irbcal.io.urdf import UrdfArm
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.modeling import frames
from irbcal.names import check_names
from irbcal.option_values import checked
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import DEG, MM

Convention: TypeAlias = Literal["modified", "standard"]
"""Craig's table (a and alpha lead to the joint's axis) or the classic one (they lead on from it)."""

CONVENTIONS: tuple[Convention, ...] = get_args(Convention)
UNITS = {"_deg": DEG, "_rad": 1.0, "_mm": MM, "_m": 1.0}
ANGLE, LENGTH = ("_deg", "_rad"), ("_mm", "_m")
TYPES = ("revolute", "prismatic", "fixed")


@dataclass(frozen=True, eq=False, repr=False)
class DhRobot(Result):
    """A robot made from a Denavit-Hartenberg table.

    Attributes
    ----------
    urdf : UrdfArm
        As any URDF is read.
    data : bytes
        The document.
    convention : str
    """

    urdf: UrdfArm
    data: bytes
    convention: str

    def report(self) -> list[Paragraph]:
        """Joints with their limits, and where the tip is at zero joints: to be compared with the controller."""
        arm = self.urdf.arm
        T = arm.forward(np.zeros((1, len(arm.joint_names))))[0]
        x, y, z = T[:3, 3] / MM
        roll, pitch, yaw = frames.rpy_from_matrix(T[:3, :3]) / DEG
        return [
            f"{arm.name}: {arm.joints_in_words} from a {self.convention} Denavit-Hartenberg table",
            Table.from_frame("Joints", self.to_frame()),
            f"At zero joints the tip is at {x:.3f}, {y:.3f}, {z:.3f} mm, turned by {roll:.3f}, {pitch:.3f}, {yaw:.3f} "
            "degrees (roll, pitch, yaw): compare this with your controller",
        ]

    CONTENT = "joints=to_frame"
    COLUMNS = "*joints"

    def joints(self) -> dict[str, Sequence[str] | FloatArray]:
        """Columns ``joint``, ``type``, ``lower`` and ``upper`` in degrees or mm, a row a joint."""
        arm = self.urdf.arm
        kinds = ["prismatic" if slides else "revolute" for slides in arm.table.prismatic]
        lower, upper = (np.round(limit / arm.joint_units, 6) for limit in (arm.lower, arm.upper))
        return {"joint": arm.joint_names, "type": kinds, "lower": lower, "upper": upper}

    def save(self, path: str | Path) -> Path:
        """Write the URDF."""
        safe_files.write_set({Path(path): self.data})
        return Path(path)


def urdf_from_dh(dh: TableLike, convention: Convention, *, name: str = "robot") -> DhRobot:
    """Make a URDF from a Denavit-Hartenberg table.

    Parameters
    ----------
    dh : str, Path or DataFrame
        A row for each joint in order, with the columns ``alpha``, ``a``, ``theta`` and ``d``, each with its unit:
        ``alpha_deg`` or ``alpha_rad``, ``a_mm`` or ``a_m`` and so on. ``theta`` (``d`` of a prismatic joint) is what is
        added to the joint. Optional: ``joint`` (its name), ``type`` (revolute, prismatic; fixed for a step without a
        joint, such as a flange), ``sign`` (-1 where the controller counts against the axis), ``lower`` and ``upper``
        with their unit (both empty: no limits).
    convention : {"modified", "standard"}
        ``modified`` (Craig; Nubiola 2011, eq. 5.2): ``Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d)``;
        ``standard``: ``Rot(z, theta) Trans(z, d) Trans(x, a) Rot(x, alpha)``. It cannot be told from the numbers.
    name : str
        Of the robot.

    Raises
    ------
    OptionError
        If the convention is another one.
    MeasurementError
        If the table does not keep the format.
    RobotError
        If there are not 2 to 20 joints, or names cannot be used.
    """
    checked("convention", convention, CONVENTIONS)
    table = InputTable.read(dh)
    source = table.source
    alpha, theta = (table.si(table.either(f"{kind}_deg", f"{kind}_rad")) for kind in ("alpha", "theta"))
    a, d = (table.si(table.either(f"{kind}_mm", f"{kind}_m")) for kind in ("a", "d"))
    kinds = table.choice("type", TYPES, "revolute").tolist()
    signs = table.choice("sign", ("1", "+1", "-1"), "1").astype(float)
    moving = [k for k, kind in enumerate(kinds) if kind != "fixed"]
    names = table.filled("joint") if "joint" in table else None
    labels = {k: f"joint_{i}" if names is None else str(names[k]) for i, k in enumerate(moving, start=1)}
    check_names([name, *labels.values()], RobotError, file=source)
    limits = _limits(table, kinds)
    T: FloatArray = np.eye(4)
    rows: list[tuple[str, FloatArray, str, float, FloatArray]] = []
    for k, kind in enumerate(kinds):
        turn, shift = frames.transform(frames.rot_x(alpha[k])), frames.transform(None, [a[k], 0.0, 0.0])
        spin, lift = frames.transform(frames.rot_z(theta[k])), frames.transform(None, [0.0, 0.0, d[k]])
        modified, standard = (turn @ shift @ spin @ lift, np.eye(4)), (np.eye(4), spin @ lift @ shift @ turn)
        first, last = modified if convention == "modified" else standard
        T = T @ first
        if kind != "fixed":
            rows.append((labels[k], T, kind, signs[k], limits[k]))
            T = np.eye(4)
        T = T @ last
    data = _document(name, rows, T)
    return DhRobot(urdf.from_bytes(data, source, "base_link", "tool0"), data, convention)


def _limits(table: InputTable, kinds: list[str]) -> FloatArray:
    """Lower and upper limits (rows, 2), SI units; NaN where there are none."""
    slides, out = np.array(kinds) == "prismatic", np.full((len(kinds), 2), np.nan)
    for side, name in enumerate(("lower", "upper")):
        for ending, lengths in (("_deg", False), ("_rad", False), ("_mm", True), ("_m", True)):
            values = table.optional(name + ending)
            fits = (slides == lengths) & np.isfinite(values)
            out[fits, side] = values[fits]
    for k, (kind, (low, high)) in enumerate(zip(kinds, out, strict=True)):
        if kind == "fixed":
            continue
        free = np.isnan([low, high]).all()
        if (free and kind == "prismatic") or not (free or low < high):
            raise table.fault(
                f"expected a lower and an upper limit of this {kind} joint in its unit, found {low:g} and {high:g}", k
            )
    return out


def _document(name: str, rows: list[tuple[str, FloatArray, str, float, FloatArray]], T_last_tip: FloatArray) -> bytes:
    from lxml import etree

    from irbcal.io import urdf_xml

    root = etree.Element("robot", name=name)
    root.append(etree.Comment(" irbcal: from a table of Denavit-Hartenberg parameters "))
    etree.SubElement(root, "link", name="base_link")
    parent = "base_link"
    for number, (label, T, kind, sign, (low, high)) in enumerate(rows, start=1):
        child = f"link_{number}"
        etree.SubElement(root, "link", name=child)
        endless = bool(np.isnan(low))
        joint = etree.SubElement(root, "joint", name=label, type="continuous" if endless else kind)
        etree.SubElement(joint, "parent", link=parent)
        etree.SubElement(joint, "child", link=child)
        urdf_xml.set_origin(joint, T)
        etree.SubElement(joint, "axis", xyz="0 0 1" if sign > 0 else "0 0 -1")
        if not endless:
            etree.SubElement(joint, "limit", lower=repr(float(low)), upper=repr(float(high)), effort="0", velocity="0")
        parent = child
    etree.SubElement(root, "link", name="tool0")
    last = etree.SubElement(root, "joint", name=f"{parent}-tool0", type="fixed")
    etree.SubElement(last, "parent", link=parent)
    etree.SubElement(last, "child", link="tool0")
    urdf_xml.set_origin(last, T_last_tip)
    etree.indent(root, "  ")
    return bytes(urdf_xml.serialised(etree.ElementTree(root)))
