"""An earlier calibration whose measurements are fitted again together with new ones.

A robot is never frozen: a calibration keeps the points that it was made from, and new poses are fitted together with
them, each session with its own base and tool. On a UR10, 30 to 60 new poses with 600 old ones did what 200 do alone.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import CalibrationError, OptionError, RobotError
from irbcal.io import robots, urdf
from irbcal.io.calibration_folder import CalibrationLike, Saved, folder_of, opened
from irbcal.io.schema import Record
from irbcal.measurement.blocks import MARK, block_of
from irbcal.measurement.motions import payload_of
from irbcal.measurement.points import PointSet
from irbcal.measurement.sessions import OF_POSES, joined
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Motion

SAME_ROBOT = 1e-9
"""Nominal constants (metres, radians) that agree within this are those of one robot."""


@dataclass(frozen=True, eq=False)
class Earlier:
    """What an earlier calibration gives to a new one.

    Attributes
    ----------
    record : Record
    sessions : tuple of (name, PointSet, Motion)
        All its points, fitted and held out, by session, with the targets' plain names.
    folder : Path or None
        Where it lies.
    """

    record: Record
    sessions: tuple[tuple[str, PointSet, Motion], ...]
    folder: Path | None = None

    def __post_init__(self) -> None:
        lock(self)

    @property
    def poses(self) -> int:
        """Number of its poses."""
        return sum(points.poses for _, points, _ in self.sessions)

    def robot(self) -> Path:
        """Its nominal robot: a file of the same name here, or known by name; else the folder, which holds it, too.

        Files are taken by their content: another file of that name is not.

        Raises
        ------
        OptionError
            If it is not.
        """
        section = self.record.robot
        here = Path(section.urdf)
        if here.is_file() and hashlib.sha256(here.read_bytes()).hexdigest() == section.urdf_sha256:
            return here
        for known in robots.NAMED:
            if Path(known.file).name != section.urdf:
                continue
            try:
                path = known.path()
            except RobotError:
                continue
            if hashlib.sha256(path.read_bytes()).hexdigest() == section.urdf_sha256:
                return path
        if self.folder is not None:
            return self.folder
        raise OptionError(
            f"robot: the earlier calibration was made from {section.urdf}, which is neither here nor known by name: "
            "name its file",
            parameter="robot",
        )

    def check(self, arm: Arm) -> None:
        """Refuse another nominal robot.

        Raises
        ------
        OptionError
            If its constants or joints are not those of the earlier calibration's.
        """
        own = self.record.arm(calibrated=False)
        pairs = [
            (getattr(own.table, name), getattr(arm.table, name)) for name in ("alpha", "a", "theta", "d", "beta", "b")
        ]
        pairs += [(own.T_base_0, arm.T_base_0), (own.T_last_tip, arm.T_last_tip)]
        same = own.joint_names == arm.joint_names and all(
            a.shape == b.shape and np.abs(a - b).max() < SAME_ROBOT for a, b in pairs
        )
        if not same:
            raise OptionError(
                f"robot: {arm.name} is not the nominal robot of the earlier calibration, which is {own.name} from "
                f"{self.record.robot.urdf}",
                parameter="robot",
            )


def calibrated_before(file: Path) -> list[str]:
    """A note on a URDF that a calibration wrote."""
    mark = urdf.fingerprint(file.read_bytes(), str(file))
    if mark is None:
        return []
    return [
        f"The URDF is that of an earlier calibration ({mark[:8]}), whose joint map is not in it: what this calibration "
        "finds takes its place, and programs are corrected for a controller that computes with this URDF. To add "
        "measurements to the earlier one, use --with and its folder."
    ]


def taken_from(saved: Saved) -> list[str]:
    """A note on a robot that is that of a calibration."""
    name = saved.folder.resolve().name
    return [
        f"The robot is the one that the calibration {name} began from. Its measurements are fitted together with the "
        "new ones, so that its joint map is kept as far as they say so; held out are new poses only."
    ]


def earlier_of(calibration: CalibrationLike) -> Earlier:
    """Open an earlier calibration to add measurements to it.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one

    Returns
    -------
    Earlier

    Raises
    ------
    CalibrationError
        If it cannot be read or does not hold its measured points.
    """
    record = opened(calibration)
    name, folder = "earlier", None
    if isinstance(calibration, (str, os.PathLike)):
        folder = folder_of(calibration)
        name = folder.resolve().name.replace(MARK, "-") or name
    used = [found for heldout in (False, True) if (found := record.used_points(heldout)) is not None]
    if not used:
        what = (
            "is from rows at features, which are calibrated together" if record.features else "has no measured points"
        )
        raise CalibrationError(f"this calibration {what}: nothing can be added to it", parameter="with")
    sets = [points for points, _ in used if points.poses]
    names = [item.name for item in record.sessions] or [name]
    number = _numbers(record, [points.poses for points in sets])
    sessions = []
    for session in names:
        parts, order = [], []
        for points, when in zip(sets, number, strict=True):
            mine = _in_session(points, session, tuple(names))
            if mine.any():
                parts.append(_plain(points.select(mine), tuple(names)))
                order.append(when[mine])
        both = joined([("fit", parts[0]), ("fit", parts[1])]) if len(parts) > 1 else parts[0]
        elapsed = np.concatenate(order)
        place = np.argsort(elapsed, kind="stable")
        both = _ordered(replace(both, session=None), place)
        sessions.append((session, both, _motion(both, elapsed[place], record)))
    return Earlier(record, tuple(sessions), folder)


def _motion(points: PointSet, elapsed: FloatArray, record: Record) -> Motion:
    """Motion of points that were saved."""
    load, place = payload_of(points, "the earlier calibration")
    return Motion(points.q, points.moves(), elapsed, load, not record.programmed, place, points.torques)


def _numbers(record: Record, counts: list[int]) -> list[FloatArray]:
    """Number of each pose in its session, fitted poses and held-out ones; in the order of the file if not saved."""
    assert record.poses is not None
    saved = record.poses.number
    values = np.array(saved if saved else np.arange(sum(counts)), dtype=float)
    heldout = np.array(record.poses.heldout, dtype=bool)
    return [part for part in (values[~heldout], values[heldout]) if len(part)]


def _in_session(points: PointSet, session: str, names: tuple[str, ...]) -> np.ndarray:
    """Which poses belong to a session, by the names of their targets."""
    own = np.array([block_of(target, names, names[-1])[1] == session for target in points.target_names], dtype=bool)
    mine = np.zeros(points.poses, dtype=bool)
    mine[points.pose[own[points.target]]] = True
    return mine


def _plain(points: PointSet, names: tuple[str, ...]) -> PointSet:
    """The same points of one session with the targets' plain names."""
    seen = points.with_seen_targets()
    return replace(seen, target_names=tuple(block_of(target, names, names[-1])[0] for target in seen.target_names))


def _ordered(points: PointSet, order: np.ndarray) -> PointSet:
    """The same points with the poses in another order."""
    rank = np.empty(len(order), dtype=int)
    rank[order] = np.arange(len(order))
    of_point = np.argsort(rank[points.pose], kind="stable")
    changed = replace(points.take(of_point), pose=rank[points.pose][of_point])
    values: dict[str, Any] = {"q": points.q[order], "pose_ids": points.pose_ids[order], "groups": points.groups[order]}
    for name in OF_POSES:
        value = getattr(points, name)
        values[name] = None if value is None else value[order]
    return replace(changed, **values)
