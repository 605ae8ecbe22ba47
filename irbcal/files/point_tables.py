"""Used points and poses in ``calibration.json``, column by column."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field, StringConstraints, model_validator

from irbcal.files.section import Names, Section


class PointTable(Section):
    """Every used point, column by column: what the report's figures are drawn from.

    ``row`` counts the poses of `PoseTable`; places are in the measuring frame; uncertainties and orientations (unit
    quaternion, scalar first) are null where a point has none, and the columns are empty where no point has.
    """

    pose: Names
    group: Names
    target: Names
    heldout: list[bool]
    nominal_mm: list[float]
    calibrated_mm: list[float]
    row: list[int] = Field(default_factory=list)
    x_mm: list[float] = Field(default_factory=list)
    y_mm: list[float] = Field(default_factory=list)
    z_mm: list[float] = Field(default_factory=list)
    u95_mm: list[float | None] = Field(default_factory=list)
    qw: list[float | None] = Field(default_factory=list)
    qx: list[float | None] = Field(default_factory=list)
    qy: list[float | None] = Field(default_factory=list)
    qz: list[float | None] = Field(default_factory=list)

    @model_validator(mode="after")
    def _of_one_length(self) -> PointTable:
        n = len(self.pose)
        for name in type(self).model_fields:
            column: list[Any] = getattr(self, name)
            added_later = not type(self).model_fields[name].is_required()
            if len(column) != n and not (added_later and not column):
                raise ValueError(f"column {name} has {len(column)} values for {n} points")
        return self


class PoseTable(Section):
    """Every used pose, column by column; one column of ``joints`` (degrees, mm) and ``came_from`` for each joint.

    ``came_from`` has one character for each pose: ``+`` where the joint was reached from below, ``-`` from above, ``0``
    where that is not known. ``previous`` holds the joints of the stop before, as ``joints``, null where that is not
    known; ``number`` counts the poses of a session in the order in which the robot visited them. Older files have
    neither. The payload's mass, the three columns of its place in the tip link and the torques of the joints are empty
    where no pose has any.
    """

    pose: Names
    group: Names
    heldout: list[bool]
    joints: list[list[float]]
    number: list[float] = Field(default_factory=list)
    came_from: list[Annotated[str, StringConstraints(pattern=r"^[+0-]*$")]]
    previous: list[list[float | None]] = Field(default_factory=list)
    payload_kg: list[float | None] = Field(default_factory=list)
    payload_place_mm: list[list[float | None]] = Field(default_factory=list)
    torques_nm: list[list[float]] = Field(default_factory=list)

    @model_validator(mode="after")
    def _of_one_length(self) -> PoseTable:
        n = len(self.pose)
        columns: list[Sequence[Any]] = [self.group, self.heldout, *self.joints, *self.came_from, *self.previous]
        columns += [self.number] if self.number else []
        columns += [*([self.payload_kg] if self.payload_kg else []), *self.payload_place_mm, *self.torques_nm]
        counts = {len(self.joints), len(self.came_from), len(self.previous or self.joints)}
        if any(len(column) != n for column in columns) or len(counts) > 1:
            raise ValueError(f"every column must have {n} values, one for each pose")
        return self
