"""From the targets of a program to their fake targets: in the posture that the program names, for the true frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from irbcal.arrays import FloatArray, IntArray, Locked
from irbcal.correction.fake_targets import FakeTargets, correct_joints, correct_meant, correct_poses
from irbcal.correction.loads import Load
from irbcal.correction.program import Program, Unread, WantedTargets
from irbcal.correction.true_frames import CELL, UNKNOWN, TargetFrames, TrueFrames
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import nearly_closed_form
from irbcal.modeling.robot import Robot
from irbcal.modeling.trajectory import Trajectory

TAUGHT = "it is a taught point, right as it is"
OFFLINE = "it is an offline point, which stands for the true frames already"
NO_FRAME = "the true place of its tool or work object is not known"
Computed = TypeVar("Computed", FakeTargets, Trajectory)
WORTH_SAYING = 1e-6
"""Metres off by which a target is that is reached with several loads, to be told."""
UNCHANGED = frozenset({TAUGHT, OFFLINE})
"""Reasons of targets that are not corrected because nothing is wrong with them."""


@dataclass(frozen=True, eq=False)
class CorrectionModel:
    """What the fake targets of programs are computed with."""

    robot: Robot
    """Calibrated."""
    nominal: Arm
    """Whose limits and configurations hold."""
    fingerprint: str
    """Of the calibration; goes into the mark of the programs."""
    controller: Arm | None = None
    """What the controller computes with where that is not the nominal arm."""
    true_frames: TrueFrames = field(default_factory=TrueFrames)
    """What is known of tools and work objects."""
    path_tolerance: float | None = None
    """Points are put into straight and circular moves, so that the tool centre point leaves the wanted path by less,
    metres; for programs that are `irbcal.correction.paths.Cuttable`.
    """
    speeds: FloatArray | None = None
    """Shape (joints,). Largest speeds of the joints, which trajectories must keep to, rad/s (m/s)."""
    follow_loads: bool = False
    """The robot carries what the program says; else what ``robot`` carries everywhere."""

    @property
    def computing(self) -> Arm:
        """What the controller computes with."""
        return self.controller or self.nominal


@dataclass(frozen=True, eq=False)
class Carried(Locked):
    """What the robot carries at the n targets of a batch."""

    mass: FloatArray
    """Shape (n,). Kg; of several loads the mean."""
    centre: FloatArray
    """Shape (n, 3). Its centre in the tip link, metres."""
    several: tuple[tuple[tuple[float, FloatArray], ...], ...]
    """Mass and place, shape (3,), of each; length n. Masses and centres where they are several, else empty."""
    reasons: tuple[str, ...]
    """Length n. Why it is not known; empty where it is."""

    @classmethod
    def at(cls, robot: Robot, batch: WantedTargets) -> Carried:
        """The loads of a program's targets; where it names none the robot's own."""
        usual, usual_centre = robot.joint_map.payload_kg or 0.0, robot.joint_map.payload_centre
        usual_centre = np.zeros(3) if usual_centre is None else usual_centre
        n = len(batch.names)
        mass, centre = np.full(n, usual), np.tile(usual_centre, (n, 1))
        several: list[tuple[tuple[float, FloatArray], ...]] = [()] * n
        reasons = [""] * n
        rows: dict[tuple[Load | None, ...], list[int]] = {}
        for k, loads in enumerate(batch.loads):
            rows.setdefault(loads, []).append(k)
        for loads, of_loads in rows.items():
            reason = next((load.reason for load in loads if load is not None and load.reason), "")
            masses = np.array([usual if load is None else load.mass_kg for load in loads])
            centres = np.array([usual_centre if load is None or load.centre is None else load.centre for load in loads])
            if len(loads) and not reason:
                mass[of_loads] = masses.mean()
                centre[of_loads] = masses @ centres / masses.sum() if masses.any() else usual_centre
            for k in of_loads:
                reasons[k] = reason
                several[k] = tuple(zip(masses.tolist(), centres, strict=True)) if len(loads) > 1 and not reason else ()
        return cls(mass, centre, tuple(several), tuple(reasons))

    def apart(self, robot: Robot, fake: FakeTargets) -> list[tuple[int, float]]:
        """Corrected targets that are reached with several loads, and how far one of them puts the tip off, metres."""
        out = []
        for k in (k for k, several in enumerate(self.several) if several and fake.ok[k]):
            reached = [
                robot.forward(fake.q[k : k + 1], payload_kg=mass, payload_centre=centre)[0, :3, 3]
                for mass, centre in self.several[k]
            ]
            off = max(float(np.linalg.norm(p - fake.T_wanted[k, :3, 3])) for p in reached)
            out += [(k, off)] if off > WORTH_SAYING else []
        return out

    def groups(self) -> tuple[list[tuple[float, FloatArray]], IntArray]:
        """The different loads, and which of them each target has (n,)."""
        rows = np.column_stack([self.mass, self.centre])
        different, which = np.unique(rows, axis=0, return_inverse=True)
        return [(float(row[0]), row[1:]) for row in different], which.reshape(-1)

    def computed_for_each(self, robot: Robot, compute: Callable[[Robot], Computed], names: Sequence[str]) -> Computed:
        """What is computed for all targets with the robot: each target's row with what it carries there.

        ``names`` are the fields of it with a row a target; those that are None stay so.
        """
        loads, which = self.groups()
        of_loads = [compute(robot.carrying(*load)) for load in loads]
        rows = np.arange(len(which))
        picked: dict[str, Any] = {}
        for name in names:
            arrays = [getattr(each, name) for each in of_loads]
            picked[name] = None if arrays[0] is None else np.stack(arrays)[which, rows]
        return replace(of_loads[0], **picked)


@dataclass(frozen=True, eq=False)
class TargetBatch:
    """The n targets of one kind with their corrections as far as they are computed."""

    programmed: WantedTargets
    frames: TargetFrames
    """Their tools and work objects."""
    load: Carried | None
    """What the robot carries at each; None where the program does not tell, or its loads are not followed."""
    fake: FakeTargets


def meant_joints(
    program: Program, nominal: Arm, controller: Arm | None = None
) -> list[tuple[WantedTargets, FloatArray, Sequence[str]]]:
    """Joints that a controller takes for the targets of a program.

    Parameters
    ----------
    program : Program
        See `irbcal.correction.languages`.
    nominal : Arm
    controller : Arm, optional
        What the controller computes with where that is not the nominal arm.

    Returns
    -------
    list of (WantedTargets, ndarray of shape (n, joints), sequence of str)
        Radians; NaN where there are none, with the reason. Empty reasons where there are.
    """
    out: list[tuple[WantedTargets, FloatArray, Sequence[str]]] = []
    for batch in program.wanted_targets():
        if batch.kind == "joint":
            out.append((batch, batch.values, [""] * len(batch.names)))
            continue
        fake = as_programmed(nominal, batch, controller)
        reachable = np.isfinite(fake.q_nominal).all(axis=1)
        out.append((batch, fake.q_nominal, [*np.where(reachable, "", fake.reason)]))
    return out


def fake_targets(robot: Robot, nominal: Arm, batch: WantedTargets, controller: Arm | None) -> FakeTargets:
    """Fake targets of goals in the posture that the program names; tools and work objects are the controller's."""
    if batch.kind == "joint":
        return correct_joints(robot, nominal, batch.values, controller)
    if batch.joints is not None:
        return refused(correct_meant(robot, nominal, batch.values, batch.joints, controller), batch.unknown)
    return correct_poses(robot, nominal, batch.values, controller)


def corrected(model: CorrectionModel, batch: WantedTargets, at: TargetFrames) -> FakeTargets:
    """Fake targets of goals for the true tools and work objects; taught points are not corrected.

    ``C(q) = Ot P Tt^-1`` is solved next to the joints that the controller takes for the target. Where taught points are
    re-expressed, the controller shall compute the pose that the true frames give where they were taught, and nothing
    else changes: ``N(q) = Oc Ot^-1 C(q0) Tt Tc^-1``.
    """
    robot, nominal, controller, points = model.robot, model.nominal, model.controller, model.true_frames.points
    taught = points.are_taught(batch.names)
    if not taught.any() and CELL not in at.origins and not points.re_express:
        return fake_targets(robot, nominal, batch, controller)
    plain = as_programmed(nominal, batch, controller)
    if points.re_express:
        q = np.nan_to_num(plain.q_nominal)
        T_wanted = frames.inverse(at.T_left) @ robot.forward(q) @ frames.inverse(at.T_right)
        computing, unchanged = Robot(model.computing), np.where(taught, "", OFFLINE)
    else:
        T_wanted = at.T_left @ plain.T_wanted @ at.T_right
        computing, unchanged = robot, np.where(taught, TAUGHT, "")
    corrections = correct_meant(computing, nominal, T_wanted, plain.q_nominal, controller)
    against = np.where(np.isfinite(plain.q_nominal).all(axis=1), "", plain.reason).astype(object)
    if points.re_express:
        against = np.where(at.origins == UNKNOWN, NO_FRAME, against)
    else:
        for k in np.flatnonzero(~corrections.ok & (against == "")).tolist():
            against[k] = f"{corrections.reason[k]}{at.far_in_words(k)}"
    return refused(corrections, [*np.where(unchanged != "", unchanged, against)])


def as_programmed(nominal: Arm, batch: WantedTargets, controller: Arm | None) -> FakeTargets:
    """Where the controller goes with goals as they are: joints, and its own pose of them."""
    return fake_targets(Robot(controller or nominal), nominal, batch, controller)


def as_written(model: CorrectionModel, batch: TargetBatch) -> FakeTargets:
    """Fake targets in the numbers that the controller will have: ``P' = On^-1 N(q) Tn``.

    Programs write ``Oc^-1 T Tc`` for a pose ``T``, so with numbers from the cell ``T = Oc On^-1 N(q) Tt Tc^-1``. Taught
    poses keep their joints, so these change as well.
    """
    fake, at, true_frames = batch.fake, batch.frames, model.true_frames
    if CELL not in at.origins and not true_frames.points.re_express:
        return fake
    plain = as_programmed(model.nominal, batch.programmed, model.controller)
    T_fake, q, ok, reason = fake.T_fake, fake.q, fake.ok, fake.reason
    if true_frames.numbers == "from-cell" and batch.programmed.kind == "pose" and not true_frames.points.re_express:
        stays = (reason == TAUGHT) & plain.ok
        ok, reason = ok | stays, np.where(stays, "", reason)
        q = np.where(stays[:, None], plain.q_nominal, q)
        T_fake = np.where(stays[:, None, None], plain.T_fake, T_fake)
        T_fake = at.T_numbers @ T_fake @ frames.inverse(at.T_right)
    return replace(fake, T_wanted=plain.T_wanted, T_fake=T_fake, q=q, ok=ok, reason=reason)


def writable(program: Program, nominal: Arm, batch: WantedTargets, fake: FakeTargets) -> FakeTargets:
    """Corrections without those that would write another configuration of the arm, or that the language refuses."""
    written = refused(fake, program.refused(batch, fake))
    form = nearly_closed_form.nearest_form(nominal) if batch.kind == "pose" and nominal.six_revolute else None
    if form is None:
        return written
    configuration_before, configuration_after = (
        form.configuration(np.nan_to_num(q)) for q in (written.q_nominal, written.q)
    )
    changed = written.ok & (configuration_before != configuration_after)
    return refused(written, [*np.where(changed, "its correction would need another configuration of the arm", "")])


def refused(corrections: FakeTargets, reasons: Sequence[str]) -> FakeTargets:
    """Corrections without those that a reason (length n, or none at all) speaks against."""
    new = np.array([*reasons] or [""] * len(corrections.ok), dtype=object)
    mask = new != ""
    ok = corrections.ok & ~mask
    return replace(
        corrections,
        q=np.where(ok[:, None], corrections.q, np.nan),
        ok=ok,
        reason=np.where(mask, new, corrections.reason),
    )


def commanded(program: Program, nominal: Arm) -> FloatArray:
    """Joints that a controller commands at the stops of a program, in their order.

    Parameters
    ----------
    program : Program
    nominal : Arm
        What the controller computes with.

    Returns
    -------
    ndarray, shape (n, joints)
        Radians (metres for prismatic joints). Points that circles pass are none.

    Raises
    ------
    ProgramError
        If a stop is computed by the program, or nothing tells its joints; names the line.
    """
    if isinstance(program, Unread):
        raise ProgramError(program.reason, file=program.source)
    joints: dict[int, FloatArray] = {}
    reason_of: dict[int, str] = {}
    order: list[int] = []
    for batch, q, reasons in meant_joints(program, nominal):
        for number, row, reason in zip(batch.numbers.tolist(), q, reasons, strict=True):
            joints[number], reason_of[number] = row, str(reason)
        order += batch.numbers.tolist()
    stops = [(stop.target, stop.line) for stop in program.stops()]
    unchanged = {target.line: target for target in program.unchanged_targets()}
    out = []
    for number, line in stops or [(number, 0) for number in sorted(order)]:
        if number is not None and number in joints and np.isfinite(joints[number]).all():
            out.append(joints[number])
            continue
        target_reason = reason_of.get(number, "") if number is not None else ""
        reason = target_reason or (unchanged[line].reason if line in unchanged else _of_target(program, number))
        raise ProgramError(f"the joints of this move are not known: {reason}", file=program.source, line=line or None)
    return np.array(out).reshape(-1, len(nominal.joint_names))


def _of_target(program: Program, number: int | None) -> str:
    targets: Sequence[object] = getattr(program, "targets", ())
    reason = getattr(targets[number], "reason", "") if number is not None and number < len(targets) else ""
    return str(reason) or "its target is computed"
