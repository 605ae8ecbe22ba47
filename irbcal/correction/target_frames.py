"""Tools and work objects of corrected targets, where they are from, and what is at stake where that is not known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, NameArray, lock
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.part_error import part_errors
from irbcal.correction.program import Goals
from irbcal.correction.true_frames import CELL, UNKNOWN, FramesOfGoals, TrueFrames, worst
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.summary import Told
from irbcal.units import MM


@dataclass(frozen=True)
class UnknownFrames:
    """Tools and work objects of unknown origin.

    Attributes
    ----------
    tools, work_objects : tuple of str
    targets : int
        How many targets are corrected with them.
    mean, largest : float
        Distance between the tool centre points of the nominal and the calibrated robot at these targets, metres: errors
        of this size are in tools and work objects that were taught with the robot.
    """

    tools: tuple[str, ...]
    work_objects: tuple[str, ...]
    targets: int
    mean: float
    largest: float

    def in_words(self) -> str:
        """What may go wrong, by how much, and what to do."""
        what = [
            f"{noun}{'s' if len(names) > 1 else ''} {', '.join(names)}"
            for noun, names in (("tool", self.tools), ("work object", self.work_objects))
            if names
        ]
        several = "are" if len(self.tools) + len(self.work_objects) > 1 else "is"
        return (
            f"{' and '.join(what)} {several} of unknown origin. If taught with the robot, the correction makes the "
            f"part worse: at these {self.targets} targets the nominal and the calibrated robot differ by "
            f"{self.mean / MM:.3f} mm on average and {self.largest / MM:.3f} mm at most. Compute them with irbcal cell "
            "and give --cell; if they were measured independently of the robot (CAD, tracker), say --frames-measured"
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON, millimetres."""
        return {
            "tools": list(self.tools),
            "work_objects": list(self.work_objects),
            "targets": self.targets,
            "mean_mm": self.mean / MM,
            "max_mm": self.largest / MM,
        }


@dataclass(frozen=True, eq=False, repr=False)
class TargetFrames:
    """Tools and work objects of n corrected targets.

    Attributes
    ----------
    tools, work_objects, tool_origins, object_origins : ndarray of str, shape (n,)
        As of `irbcal.correction.true_frames.FramesOfGoals`.
    points : ndarray of str, shape (n,)
        ``offline`` or ``taught``.
    at_stake : ndarray, shape (n,)
        Distance between the tool centre points of the nominal and the calibrated robot, metres.
    part_error : ndarray, shape (n, 2)
        Mean and 95 % of the expected error in the work object, metres; see `irbcal.correction.part_error`.
    numbers : str
        Which numbers the controller will have.
    re_expressed : bool
        Whether the targets are offline points of the true frames, and no fake targets.
    """

    tools: NameArray
    work_objects: NameArray
    tool_origins: NameArray
    object_origins: NameArray
    points: NameArray
    at_stake: FloatArray
    part_error: FloatArray
    numbers: str
    re_expressed: bool

    def __post_init__(self) -> None:
        lock(self)

    @staticmethod
    def of(
        robot: Robot,
        controller: Arm,
        found: Sequence[tuple[Goals, Corrected]],
        at: Sequence[FramesOfGoals],
        known: TrueFrames,
    ) -> TargetFrames | None:
        """Of the targets that were corrected; None of none."""
        parts = []
        for (goals, fake), ours in zip(found, at, strict=True):
            ok, q = fake.ok, fake.q_nominal[fake.ok]
            off = np.zeros((len(q), 3))
            if len(q):
                apart = robot.forward(q) - controller.forward(q)
                off = np.einsum("nij,nj->ni", apart[:, :3, :3], ours.tcp[ok]) + apart[:, :3, 3]
            points = np.where(known.points.are_taught(goals.names), "taught", "offline").astype(object)
            expected = part_errors(robot, known.cell, fake.q, ours)[ok]
            parts.append(
                TargetFrames(
                    ours.tools[ok],
                    ours.work_objects[ok],
                    ours.tool_origins[ok],
                    ours.object_origins[ok],
                    points[ok],
                    np.linalg.norm(off, axis=1),
                    expected,
                    known.numbers,
                    known.points.re_express,
                )
            )
        return TargetFrames.joined(parts)

    @staticmethod
    def joined(parts: Sequence[TargetFrames]) -> TargetFrames | None:
        """Of several programs; None of none."""
        if not parts:
            return None
        return TargetFrames(
            np.concatenate([part.tools for part in parts]),
            np.concatenate([part.work_objects for part in parts]),
            np.concatenate([part.tool_origins for part in parts]),
            np.concatenate([part.object_origins for part in parts]),
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.at_stake for part in parts]),
            np.concatenate([part.part_error for part in parts]),
            parts[0].numbers,
            parts[0].re_expressed,
        )

    @property
    def origins(self) -> NameArray:
        """Of each target the origin of its frame that is known worst."""
        return worst(self.tool_origins, self.object_origins)

    def columns(self) -> dict[str, NameArray | FloatArray]:
        """For tables; errors of the part in millimetres, where they are known."""
        columns: dict[str, NameArray | FloatArray] = {
            "tool": np.array(self.tools),
            "work_object": np.array(self.work_objects),
            "frames": self.origins,
            "points": np.array(self.points),
        }
        if np.isfinite(self.part_error).any():
            columns |= {"part_mean_mm": self.part_error[:, 0] / MM, "part_u95_mm": self.part_error[:, 1] / MM}
        return columns

    def unknown(self) -> UnknownFrames | None:
        """Those of unknown origin; None where there are none."""
        rows = self.origins == UNKNOWN
        if not rows.any():
            return None
        tools = sorted(set(self.tools[self.tool_origins == UNKNOWN]))
        work_objects = sorted(set(self.work_objects[self.object_origins == UNKNOWN]))
        stake = self.at_stake[rows]
        return UnknownFrames(
            tuple(tools), tuple(work_objects), int(rows.sum()), float(stake.mean()), float(stake.max())
        )

    def told(self, unchanged: int) -> list[Told]:
        """Which points were taken for offline points, and what the controller must have."""
        if self.re_expressed:
            return [
                f"{len(self.tools)} taught points are re-expressed as offline points of the true frames, {unchanged} "
                "stay as they are; nothing is corrected: filter the new program"
            ]
        told: list[Told] = []
        in_cell = self.origins == CELL
        if in_cell.any():
            ours = "its own numbers" if self.numbers == "same" else "the cell file's numbers"
            told.append(
                f"{in_cell.sum()} targets stand for the cell file's tools and work objects; the controller must "
                f"compute with {ours} of them"
            )
        if (in_cell & (self.points == "offline")).any():
            told.append(
                "All of them are taken for offline points: name those that were shown on the robot with --points"
            )
        expected = self.part_error[np.isfinite(self.part_error).all(axis=1)] / MM
        if len(expected):
            told.append(
                f"Expected error of the part: {expected[:, 0].mean():.3f} mm mean, at the worst target within "
                f"{expected[:, 1].max():.3f} mm with 95 % (robot, tools and work objects together)"
            )
        if unchanged:
            told.append(f"{unchanged} targets need no change")
        return told
