"""Base, tool and links from moves of one joint at a time, as far as they were moved (Nubiola 2011, chapter 3).

Axes 1 and 2 give the base (section 3.2), the last two the tool (section 3.4.2), all six every link (section 3.1), with
parallel axes forced into one direction where that is wanted (section 3.1.3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification.axis_calibration import (
    PARALLEL,
    PARALLELS,
    AxisCalibration,
    BaseOfAxes,
    ToolOfAxes,
    base_of_axes,
    calibrate_by_axes,
    tool_of_axes,
)
from irbcal.identification.choices import Parallel
from irbcal.io.opening import open_robot
from irbcal.measurement import cleaning, table
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.input_table import read_targets
from irbcal.measurement.points import PointSet
from irbcal.measurement.table import MeasurementsLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.option_values import checked, number
from irbcal.summary import Paragraph, Result, Table, remarks, simulated_mark
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

IdentifiedPart: TypeAlias = Literal["base", "tool", "links"]
PARTS: tuple[IdentifiedPart, ...] = get_args(IdentifiedPart)


@dataclass(frozen=True, eq=False, repr=False)
class ByCircles(Result):
    """What the circles of one-joint moves tell of a robot; None for parts that were not asked for or not moved.

    Attributes
    ----------
    robot : str
    base : BaseOfAxes or None
    tool : ToolOfAxes or None
    links : AxisCalibration or None
    drawn : dict of str to ndarray, shape (3,), or None
        Places of targets as drawn, in the tip link, metres.
    excluded : tuple of Exclusion
    notes : tuple of str
    simulated : bool
    """

    robot: str
    base: BaseOfAxes | None
    tool: ToolOfAxes | None
    links: AxisCalibration | None
    drawn: Mapping[str, FloatArray] | None
    excluded: tuple[Exclusion, ...]
    notes: tuple[str, ...]
    simulated: bool

    def compared(self) -> pd.DataFrame | None:
        """The tool as drawn and as measured (Nubiola 2011, Table 3.1); None without both.

        Returns
        -------
        DataFrame or None
            ``target``, ``drawn_x_mm`` …, ``measured_x_mm`` …, ``error_mm`` and, of three targets or more,
            ``error_moved_mm``: what is left when the whole tool may be moved, as play on the flange would move it.
        """
        import pandas as pd

        if self.tool is None or self.drawn is None:
            return None
        names = [name for name in self.tool.targets if name in self.drawn]
        drawn, measured = (np.array([targets[name] for name in names]) for targets in (self.drawn, self.tool.targets))
        columns: dict[str, Any] = {"target": names}
        for kind, places in (("drawn", drawn), ("measured", measured)):
            columns |= {f"{kind}_{axis}_mm": places[:, k] / MM for k, axis in enumerate("xyz")}
        columns["error_mm"] = np.linalg.norm(measured - drawn, axis=1) / MM
        if len(names) >= 3:
            moved = frames.apply(frames.rigid_fit(drawn, measured), drawn)
            columns["error_moved_mm"] = np.linalg.norm(measured - moved, axis=1) / MM
        return pd.DataFrame(columns)

    CONTENT = "robot simulated compared excluded notes base tool links"

    def to_frame(self) -> pd.DataFrame:
        """A row for each number: ``part``, ``name``, ``value``, ``std`` and ``unit``; of the tool also by target."""
        import pandas as pd

        rows: list[tuple[str, str, float, float, str]] = []
        if self.base is not None:
            values = frames.to_xyz_angles(self.base.T_world_base)
            for k, name in enumerate(("x", "y", "z", "alpha", "beta", "gamma")):
                unit, size = ("mm", MM) if k < 3 else ("deg", DEG)
                rows.append(("base", name, float(values[k] / size), float(self.base.std[k] / size), unit))
        if self.tool is not None:
            for target, xyz in self.tool.targets.items():
                for k, axis in enumerate("xyz"):
                    std = float(self.tool.std[target][k] / MM)
                    rows.append(("tool", f"{target} {axis}", float(xyz[k] / MM), std, "mm"))
        if self.links is not None:
            rows += [("links", r.name, r.value, r.std, r.unit) for r in self.links.to_frame().itertuples(index=False)]
        return pd.DataFrame(rows, columns=["part", "name", "value", "std", "unit"])

    def report(self) -> Sequence[Paragraph]:
        """Base, tool and links, the tool against its drawing, and what was left out."""
        start = simulated_mark(self.simulated)
        parts = [name for name in PARTS if getattr(self, name) is not None]
        out: list[Paragraph] = [f"{start}{self.robot} by the circles of one-joint moves: {', '.join(parts)}"]
        for section in (self.base, self.tool, self.links):
            out += [] if section is None else section.report()
        compared = self.compared()
        if compared is not None:
            names = ("target", *(f"{kind} {a}" for kind in ("drawn", "measured") for a in "xyz"), "error", "moved")
            title = f"{start}The tool as drawn and as measured, mm"
            out.append(Table.from_frame(title, compared, names[: compared.shape[1]]))
            if "error_moved_mm" in compared:
                out.append(
                    "moved: what is left of the error when the whole tool may be moved, as on a flange with play."
                )
        return [
            *out,
            *left_out(self.excluded),
            *remarks("Note", self.notes),
        ]


def circles(
    measurements: MeasurementsLike,
    robot: str | Path | Arm,
    *,
    part: IdentifiedPart | None = None,
    parallel: Parallel = "hayati",
    tolerance: float = PARALLEL,
    drawn: str | Path | Mapping[str, ArrayLike] | None = None,
) -> ByCircles:
    """Base from axes 1 and 2, tool from the last two, links from all six: from the circles of one-joint moves alone.

    Parameters
    ----------
    measurements : str, Path, DataFrame or MeasurementSet
        With groups ``axis1``, ``axis2`` … in which only that joint moves.
    robot : str, Path or Arm
        URDF, name of a robot, or nominal arm.
    part : str, optional
        ``base`` (section 3.2), ``tool`` (section 3.4) or ``links`` (section 3.1) alone; by default all that the groups
        allow.
    parallel : str
        Of the links: ``hayati`` keeps the tilt between nearly parallel axes, ``forced`` gives them one direction
        (section 3.1.3).
    tolerance : float
        Axes closer than this are parallel for ``forced``, radians.
    drawn : str, Path or dict, optional
        Places of the targets as drawn, ``target,x_mm,y_mm,z_mm`` in the tip link (a dict: metres), to be compared with
        the tool (Nubiola 2011, Table 3.1).

    Returns
    -------
    ByCircles
        Lengths in metres, angles in radians (`ByCircles.to_dict` and ``to_frame``: mm and degrees).

    Raises
    ------
    OptionError
        If an option has no such value or belongs to a part that is not wanted.
    MeasurementError
        If the file cannot be read or no drawn target was measured.
    IdentificationError
        If the moves do not give a part that is asked for, or any.
    """
    if part is not None:
        checked("part", part, PARTS)
    checked("parallel", parallel, PARALLELS)
    tolerance = number("tolerance", tolerance, 0.0, np.pi / 2)
    if drawn is not None and part not in (None, "tool"):
        raise OptionError(f"drawn: places as drawn are compared with the tool, not with the {part}", parameter="drawn")
    if parallel == "forced" and part not in (None, "links"):
        raise OptionError(f"parallel: it is for the links, the {part} needs none", parameter="parallel")
    arm = robot if isinstance(robot, Arm) else open_robot(robot, nominal=True).nominal
    measured = table.read(measurements).of_arm(arm)
    cleaned = cleaning.clean(measured)
    points = cleaned.points
    cad = read_targets(drawn) if isinstance(drawn, (str, Path)) else drawn
    try:
        wanted_parts = PARTS if part is None else (part,)
        able = [name for name in wanted_parts if part is not None or _possible(name, arm, points)]
        if not able:
            raise IdentificationError(
                "there are no groups axis1 and axis2 for the base, nor of the last two joints for the tool"
            )
        base = base_of_axes(arm, points) if "base" in able else None
        tool = tool_of_axes(arm, points) if "tool" in able else None
        links = calibrate_by_axes(arm, points, parallel, tolerance) if "links" in able else None
    except IdentificationError as error:
        raise IdentificationError(str(error), file=measured.source) from None
    if parallel == "forced" and links is None:
        raise OptionError("parallel: it is for the links, which need moves of all six joints", parameter="parallel")
    cad_xyz = None if cad is None else {name: np.asarray(xyz, dtype=float) for name, xyz in cad.items()}
    if cad_xyz is not None:
        if tool is None:
            raise OptionError("drawn: there are no moves of the last two joints to measure the tool", parameter="drawn")
        if not set(cad_xyz) & set(tool.targets):
            raise MeasurementError(
                f"no drawn reflector was measured; reflectors are {', '.join(tool.targets)}", file=measured.source
            )
    return ByCircles(arm.name, base, tool, links, cad_xyz, cleaned.excluded, tuple(cleaned.notes), measured.simulated)


def _possible(part: IdentifiedPart, arm: Arm, points: PointSet) -> bool:
    """Whether the groups of a part are there."""
    n, groups = len(arm.joint_names), {str(group) for group in points.groups}
    needed = {"base": (1, 2), "tool": (n - 1, n), "links": range(1, n + 1)}[part]
    return {f"axis{k}" for k in needed} <= groups and (part != "links" or arm.six_revolute)
