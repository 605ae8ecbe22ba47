"""Sets of poses as models see them: what figures of pose errors (`irbcal.plotting.pose_errors`) draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from irbcal.arrays import FloatArray, IntArray, Locked, NameArray, group_means
from irbcal.error_statistics import Statistics

POSITION, FROM_FEATURE = "position error", "distance from feature"
"""What errors are: of a tracker's points, or of rows at features."""


@dataclass(frozen=True, eq=False, repr=False)
class ModelErrors(Locked):
    """Errors of one model on one set of poses."""

    statistics: Statistics
    """Of all points."""
    distance: FloatArray
    """Shape (m,). Of each point, metres."""
    per_pose: FloatArray
    """Shape (n,). Mean distance of each pose's points, metres."""
    intervals: Mapping[str, Sequence[float]] | None
    """95 % intervals of the statistics by their names, mm."""
    vector: FloatArray | None
    """Shape (m, 3). Measured minus predicted place of each point along the axes of the base link, metres."""
    rotation: FloatArray | None
    """Shape (m,). Angle between measured and predicted target frame, radians, NaN where there is none."""

    def __repr__(self) -> str:
        return f"<ModelErrors: {len(self.distance)} points, mean {self.statistics.mean_mm:.3f} mm>"

    def mean_vector(self, pose: IntArray) -> FloatArray:
        """Mean error vector of each pose, shape (n, 3), metres."""
        assert self.vector is not None
        return group_means(self.vector, pose)


@dataclass(frozen=True, eq=False, repr=False)
class PoseErrors(Locked):
    """One set of poses, held out, fitted or measured later, as the models see it."""

    name: str
    """``held-out``, ``fitted`` or another name."""
    pose: IntArray
    """Shape (m,). Which pose each point belongs to."""
    pose_names: tuple[str, ...]
    groups: tuple[str, ...]
    """One for each pose."""
    target: tuple[str, ...]
    """One for each point."""
    models: Mapping[str, ModelErrors]
    """``nominal`` and, but for the level of that name, ``calibrated``."""
    positions: FloatArray | None
    """Shape (m, 3). Measured place of each point in the base link, metres."""
    error_name: str = field(default=POSITION, kw_only=True)
    """What the errors are: ``position error``, or ``distance from feature``."""
    arm: FloatArray | None = field(default=None, kw_only=True)
    """Shape (k, 3). A line along the arm at home in the base link, metres, see
    `irbcal.modeling.commanded_joints.line_at_home`.
    """
    extra: Mapping[str, NameArray] = field(default_factory=dict, kw_only=True)
    """Values of shape (m,). Columns of the measurements that are only carried along, see
    `MeasurementSet.extra_columns`.
    """

    def __repr__(self) -> str:
        return f"<PoseErrors: {len(self.pose_names)} {self.name} poses, {len(self.pose)} points, {dict(self.models)!r}>"

    @property
    def plural(self) -> str:
        """What the errors are, of several."""
        return "distances from features" if self.error_name == FROM_FEATURE else f"{self.error_name}s"

    @property
    def axis(self) -> str:
        """What stands at a short axis."""
        return "error (mm)" if self.error_name == POSITION else "distance (mm)"

    @property
    def each(self) -> str:
        """What has one error each."""
        return "points" if self.error_name == POSITION else "rows"

    @property
    def proves(self) -> bool:
        """Whether the fit never saw these poses."""
        return self.name != "fitted"

    def mean_place(self) -> FloatArray:
        """Mean measured place of each pose's points in the base link, shape (n, 3), metres."""
        assert self.positions is not None
        return group_means(self.positions, self.pose)
