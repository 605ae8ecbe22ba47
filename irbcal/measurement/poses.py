"""Other views of measured points: three of a pose as one full pose, all in a frame of three points."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement.cleaning import by_pose
from irbcal.measurement.points import PointSet
from irbcal.measurement.registration import register
from irbcal.modeling import frames

TOOL = "tool"
"""Name of the target frame that stands for all reflectors of the tool."""


def as_poses(
    points: PointSet, source: str = "the measurements", shape: Mapping[str, FloatArray] | None = None
) -> tuple[PointSet, Mapping[str, FloatArray]]:
    """Turn the points of each pose into one measured pose of the tool.

    Three points of the tool that are not on a line tell its orientation, too (Nubiola 2011, section 2.1).

    The reflectors are taken as one rigid body. Its frame has its origin in the reflectors' centre and the axes of the
    coordinates in which its shape is given.

    Parameters
    ----------
    points : PointSet
    source : str
        File name for messages.
    shape : dict of str to ndarray, shape (3,), optional
        Places of the reflectors relative to one another, metres; by default found from all poses together.

    Returns
    -------
    points : PointSet
        One point with an orientation for each pose that saw three reflectors; other poses are gone.
    shape : dict of str to ndarray, shape (3,)
        To be used for other measurements of the same tool.

    Raises
    ------
    MeasurementError
        If no pose saw three reflectors, or if they lie on a line.
    """
    if len(points.target_names) < 3:
        raise MeasurementError(
            f"a full pose needs three targets on the tool, found {', '.join(points.target_names)}", file=source
        )
    every = np.ones(len(points), dtype=bool)
    measured = by_pose(points.pose, points.names(), points.xyz, every, points.target_names)
    registration = register(measured, points.target_names, source, shape, plural="targets")
    if registration is None:
        raise MeasurementError("a full pose needs three targets on the tool; no pose saw three at a time", file=source)
    T_world_shape = frames.inverse(registration.T_frame_pose[registration.with_references])
    centre = np.mean(list(registration.references.values()), axis=0)
    n = int(registration.with_references.sum())
    registered = points.select(registration.with_references)
    poses = replace(
        registered,
        pose=np.arange(n),
        target=np.zeros(n, dtype=int),
        xyz=T_world_shape[:, :3, :3] @ centre + T_world_shape[:, :3, 3],
        target_names=(TOOL,),
        rotation=T_world_shape[:, :3, :3],
        u95=None,
    )
    return poses, registration.references


def in_frame_of(
    points: PointSet, references: Mapping[str, FloatArray], names: Sequence[str], source: str = "the measurements"
) -> tuple[PointSet, dict[str, FloatArray]]:
    """Everything in the frame of three reference points (Nubiola 2011, sections 3.3 and 7.1).

    Parameters
    ----------
    points : PointSet
    references : dict of str to ndarray, shape (3,)
        Places of the references, metres.
    names : sequence of three str
        The first two lie on the x axis, the second further along; the third on the positive y axis.
    source : str
        File name for messages.

    Returns
    -------
    points : PointSet
    references : dict of str to ndarray, shape (3,)

    Raises
    ------
    MeasurementError
        If a reference is not known or the three lie on a line.
    """
    missing = [name for name in names if name not in references]
    if len(names) != 3 or missing:
        raise MeasurementError(
            f"a frame needs three reference points, found {', '.join(references) or 'none'}"
            + (f" but not {missing[0]}" if missing else ""),
            file=source,
        )
    try:
        T = frames.inverse(frames.from_three_points(*(references[name] for name in names)))
    except ValueError as error:
        raise MeasurementError(f"{', '.join(names)}: {error}", file=source) from None
    rotation = None if points.rotation is None else T[:3, :3] @ points.rotation
    references_moved = {name: frames.apply(T, xyz[None])[0] for name, xyz in references.items()}
    return replace(points, xyz=frames.apply(T, points.xyz), rotation=rotation), references_moved
