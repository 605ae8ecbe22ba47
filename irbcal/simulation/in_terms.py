"""What a virtual robot does, in the terms of the error model: amounts to compare identified coefficients with.

The cell computes its effects by itself; here stands what they are called in `irbcal.modeling.terms`, with signs and
units. The tests walk the chain with both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.terms import families
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.harmonics import pair
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import AXES, Term
from irbcal.modeling.terms.term_map import TermMap, basis_values
from irbcal.modeling.thesis_map import ThesisMap
from irbcal.simulation.effect import Amounts
from irbcal.simulation.gravity import GRAVITY
from irbcal.simulation.masses import Bodies

POSES, SEED = 400, 3
"""Random poses on which levers are expressed by those that the error model keeps."""


def constant(joint: int, axis: str) -> Term:
    """The error of a joint's place (joints from 0) along one of `AXES`; joint 1's are part of the base."""
    return Term(joint, axis, "constant", 1.0, "geometry", "geometry", "rad" if axis[0] == "r" else "m")


def constants(nominal: DHMTable, table: DHMTable) -> Amounts:
    """Errors of a table that are not zero."""
    errors = {axis: getattr(table, name) - getattr(nominal, name) for axis, name in DHM_COLUMNS.items()}
    return [(constant(int(j), axis), float(errors[axis][j])) for axis in AXES for j in np.flatnonzero(errors[axis])]


def sine(
    joint: int, cycles: int, amplitude: float, phase: float, axis: str = "rz", family: str = "harmonics"
) -> Amounts:
    """``amplitude sin(cycles q + phase)`` as cosine and sine; joints from 0, radians or metres."""
    cos, sin = pair(joint, cycles, axis, 1.0, family, family, "rad" if axis[0] == "r" else "m")
    return [(cos, float(amplitude * np.sin(phase))), (sin, float(amplitude * np.cos(phase)))]


def of_family(arm: Arm, family: str, basis: str, values: FloatArray) -> Amounts:
    """One value for each joint, of a family that has one such term a joint."""
    terms = [term for term in families()[family].terms(arm) if term.basis == basis]
    return [(term, float(values[term.joint])) for term in terms]


def direction_amounts(arm: Arm, values: FloatArray) -> Amounts:
    """What a long move from below adds to each joint, radians (metres)."""
    return of_family(arm, "direction", "direction", values)


def move_amounts(arm: Arm, values: FloatArray, shares: FloatArray) -> Amounts:
    """What the largest of the joints' moves adds to each joint, radians (metres), and the share of its own move."""
    return [*of_family(arm, "move", "share_of_move", values), *of_family(arm, "move", "move", shares)]


def decays(turns: FloatArray, shifts: FloatArray, tau_min: float) -> Amounts:
    """Drifts of the joints' frames at the start, shape (joints, 3) each, radians and metres; time is in minutes."""
    start = np.concatenate([turns, shifts], axis=1)
    terms = [
        Term(j, axis, "decay", 1.0, "warm_up", "warm_up", "rad" if axis[0] == "r" else "m", {"tau": tau_min})
        for j in range(len(start))
        for axis in AXES
    ]
    return [(t, float(start[t.joint, AXES.index(t.axis)])) for t in terms if start[t.joint, AXES.index(t.axis)]]


def joint_map_amounts(arm: Arm, joint_map: ThesisMap, stiffness: bool) -> Amounts:
    """The thesis's joint map; ``stiffness``: with its two numbers for what gravity does."""
    out = of_family(arm, "gain", "q", joint_map.gain)
    thesis = families()["thesis"].terms(arm)
    if not thesis:
        return out
    waves = [wave for k in (1, 2) for wave in pair(5, k, "rz", 1.0, "harmonics", "harmonics")]
    levers = zip(thesis, joint_map.stiffness if stiffness else (0.0, 0.0), strict=False)
    return [*out, *levers, *zip(waves, joint_map.fourier.tolist(), strict=True)]


def frame_rotations(arm: Arm) -> FloatArray:
    """Axes of each joint's frame, before it turns, in the link before it, shape (joints, 3, 3); columns x, y, z."""
    table = arm.table
    ca, sa, cb, sb = np.cos(table.alpha), np.sin(table.alpha), np.cos(table.beta), np.sin(table.beta)
    zero = np.zeros_like(ca)
    rows = [[cb, zero, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]]
    return np.moveaxis(np.array(rows), -1, 0)


def moments(arm: Arm, bodies: Bodies) -> FloatArray:
    """First moment of all that a joint carries, a constant vector of each link on the way there, shape (joints, 3).

    With ``V_k`` of link k in its axes, what joint j carries has the moment ``sum_{k >= j} R_k V_k`` about its origin.
    """
    table, beyond = arm.table, np.cumsum(bodies.mass[::-1])[::-1]
    out = np.array(bodies.mass[:, None] * bodies.centre)
    R = frame_rotations(arm)
    for k in range(len(out) - 1):
        step = table.a[k + 1] * np.array([1.0, 0.0, 0.0])
        step = step + table.b[k + 1] * np.array([0.0, np.cos(table.alpha[k + 1]), np.sin(table.alpha[k + 1])])
        out[k] += beyond[k + 1] * (step + table.d[k + 1] * R[k + 1, :, 2])
    return out


def lever_amounts(arm: Arm, bodies: Bodies, family: str, compliance: Mapping[str, FloatArray]) -> Amounts:
    """How joints or frames give way under weight, in the levers that a family of the error model keeps.

    The levers that it leaves out are sums of the others and a constant, which joins the geometry. Arms with prismatic
    joints after the first are described as they stand at zero.

    Parameters
    ----------
    arm : Arm
        Nominal.
    bodies : Bodies
        With the payload.
    family : str
        ``gravity`` or ``bending``.
    compliance : mapping of str to ndarray, shape (joints,)
        Axis -> rad/Nm of each joint about it.
    """
    here = Situation(arm, Motion(arm.random_joints(POSES, SEED)))
    V = moments(arm, bodies)
    beyond = np.cumsum(bodies.mass[::-1])[::-1]
    kept = families()[family].terms(arm)
    out = []
    for axis, soft in compliance.items():
        for j in np.flatnonzero((soft != 0.0) & ~arm.table.prismatic):
            mine = np.array(V)
            mine[j, 2] += beyond[j] * arm.table.d[j]  # about the frame's origin: nothing for the joint's own axis
            levers = [
                (Term(int(j), axis, "gravity", 1.0, "", "", "rad", {"link": k + 1, "vector": "xyz"[b]}), mine[k, b])
                for k in range(j, len(V))
                for b in range(3)
            ]
            lever = GRAVITY * soft[j] * np.array([value for _, value in levers])
            wanted = lever @ basis_values([term for term, _ in levers], here)
            own = [*(term for term in kept if term.joint == j and term.axis == axis), constant(int(j), axis)]
            values = np.linalg.lstsq(basis_values(own, here).T, wanted, rcond=None)[0]
            out += list(zip(own, values.tolist(), strict=True))
    return out


def payload_amounts(arm: Arm, rad_per_Nm: Sequence[float], place: FloatArray) -> Amounts:
    """How each joint gives way under a mass at a place of the tip link, as terms of the family payload."""
    terms = Payload([float(x) for x in place]).terms(arm)
    return [(term, float(rad_per_Nm[term.joint])) for term in terms]


def merged(amounts: Iterable[tuple[Term, float]]) -> dict[str, tuple[Term, float]]:
    """Amounts by the terms' names, those of one name added up."""
    out: dict[str, tuple[Term, float]] = {}
    for term, value in amounts:
        out[term.name] = (term, value + (out[term.name][1] if term.name in out else 0.0))
    return out


def term_map(arm: Arm, amounts: Mapping[str, tuple[Term, float]]) -> TermMap:
    """The amounts but the constants."""
    found = [(term, value) for term, value in amounts.values() if term.basis != "constant"]
    return TermMap(arm, tuple(term for term, _ in found), np.array([value for _, value in found]))


def true_arm(arm: Arm, amounts: Mapping[str, tuple[Term, float]]) -> Arm:
    """The nominal arm with the constants among the amounts in its table."""
    columns = {name: np.array(getattr(arm.table, name)) for name in DHM_COLUMNS.values()}
    for term, value in amounts.values():
        if term.basis == "constant":
            columns[DHM_COLUMNS[term.axis]][term.joint] += value
    return arm.with_table(DHMTable(**columns, prismatic=arm.table.prismatic))
