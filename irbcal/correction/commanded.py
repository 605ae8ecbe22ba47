"""The joints that a program commands, stop by stop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.corrected_goals import meant_joints
from irbcal.correction.program import Program
from irbcal.errors import ProgramError
from irbcal.modeling.arm import Arm


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
    joints: dict[int, FloatArray] = {}
    why: dict[int, str] = {}
    order: list[int] = []
    for goals, q, reasons in meant_joints(program, nominal):
        for number, row, reason in zip(goals.numbers.tolist(), q, reasons, strict=True):
            joints[number], why[number] = row, str(reason)
        order += goals.numbers.tolist()
    stops = [(stop.target, stop.line) for stop in program.stops()]
    left = {item.line: item for item in program.left()}
    out = []
    for number, line in stops or [(number, 0) for number in sorted(order)]:
        if number is not None and number in joints and np.isfinite(joints[number]).all():
            out.append(joints[number])
            continue
        known = why.get(number, "") if number is not None else ""
        reason = known or (left[line].reason if line in left else _of_target(program, number))
        raise ProgramError(f"the joints of this move are not known: {reason}", file=program.source, line=line or None)
    return np.array(out).reshape(-1, len(nominal.joint_names))


def _of_target(program: Program, number: int | None) -> str:
    targets: Sequence[object] = getattr(program, "targets", ())
    reason = getattr(targets[number], "reason", "") if number is not None and number < len(targets) else ""
    return str(reason) or "its target is computed"
