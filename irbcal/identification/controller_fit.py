"""The numbers that a controller computes poses with, from joints and the poses that it reports for them.

A reported pose holds no measuring error, only rounding, so that a difference of some micrometres is one of the models.
Of all numbers of the chain (Hayati's among them) and of the tool's place those are taken that explain most, one after
the other, as long as each makes the rest clearly smaller; where many small differences explain much more than the few,
all are taken. Rows whose joints and pose are of different moments are found first, and do not bend the fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray, rms
from irbcal.errors import IdentificationError
from irbcal.identification import data_entry_errors
from irbcal.identification.fit import identify
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.frames import LEVER
from irbcal.modeling.parameters import GEOMETRIC
from irbcal.units import MM

MOMENT, MOMENT_FACTOR = 1.0 * MM, 20.0
"""Distance from the model above which joints and pose of a row are of different moments: metres, and as a multiple of
the median."""

FRAMES_FROM = 20.0 * MM
"""Median distance above which the controller's poses are of another base or tool than the URDF's links, metres."""

NOWHERE = 50.0 * MM
"""Median distance that no numbers of a model explain, metres."""

GAIN = 0.85
"""A further number must make the rms of the rows smaller by this factor."""

MANY_GAIN = 0.6
"""All numbers are taken where they make the rms smaller by this factor more than the few."""

MOST_CHOSEN = 8
"""Numbers that are taken one by one."""

EXACT = 2e-6
"""Distance below which there is nothing left to explain, metres: digits of the report."""

CORE = 4.0
"""Rows farther away than this multiple of the median do not take part in the fit (the arm moved on a little)."""

TOOL = ("tool_x", "tool_y", "tool_z", "tool_rx", "tool_ry", "tool_rz")


@dataclass(frozen=True, eq=False)
class ControllerFit(Locked):
    """Numbers of a controller's model beside those of an arm."""

    arm: Arm
    """With the controller's table; what differs at joint 1 holds what differs at the base, too."""
    T_base: FloatArray
    """Shape (4, 4). Base link in the controller's base frame; identity unless the controller's is elsewhere."""
    T_tool: FloatArray
    """Shape (4, 4). The controller's tool in the tip link."""
    names: tuple[str, ...]
    """Numbers that differ: columns of the table with the joint's number, such as ``d3``, and those of `TOOL`."""
    values: FloatArray
    std: FloatArray
    """Shape (k,). Differences and their standard deviations, metres and radians."""
    nominal_errors: FloatArray
    fitted_errors: FloatArray
    """Shape (n, 2). Distance (m) and angle (rad) of each row from the arm as it was (with ``T_base``, ``T_tool`` where
    these are other frames) and from the fitted one.
    """
    moment: BoolArray
    """Shape (n,). Rows whose joints and pose are of different moments."""
    frames_differ: bool
    """Whether base or tool are other frames than the URDF's links."""
    nearly_all: bool
    """Whether nearly all numbers differ."""


@dataclass(frozen=True, eq=False)
class _CandidateModel:
    """A candidate: arm and frames."""

    arm: Arm
    T_base: FloatArray
    T_tool: FloatArray

    def poses(self, q: FloatArray) -> FloatArray:
        """Poses that the controller would report, shape (n, 4, 4), metres."""
        return self.T_base @ self.arm.forward(q) @ self.T_tool

    def moved(self, names: NameArray, values: FloatArray) -> _CandidateModel:
        """The model with some numbers changed, and its tool."""
        table, tool = self.arm.table, np.zeros(6)
        for name, value in zip(names, values, strict=True):
            if name in TOOL:
                tool[TOOL.index(name)] = value
                continue
            kind, joint = name.rstrip("0123456789"), int(name[len(name.rstrip("0123456789")) :])
            column = getattr(table, kind).copy()
            column[joint - 1] += value
            table = replace(table, **{kind: column})
        T = frames.transform(frames.rotation_from_vector(tool[3:]), tool[:3])
        return _CandidateModel(self.arm.with_table(table), self.T_base, self.T_tool @ T)


def virtual_points(q: FloatArray, T: FloatArray) -> PointSet:
    """Poses as points: the origin and three more at `LEVER` along the axes."""
    n = len(q)
    corners = np.vstack([np.zeros(3), LEVER * np.eye(3)])
    xyz = np.einsum("nij,kj->nki", T[:, :3, :3], corners) + T[:, None, :3, 3]
    ids, groups = np.arange(n), np.full(n, "", dtype=object)
    pose, target = np.repeat(np.arange(n), 4), np.tile(np.arange(4), n)
    return PointSet(q, pose, target, xyz.reshape(-1, 3), ("origin", "x", "y", "z"), ids, groups)


def differences(model: FloatArray, reported: FloatArray) -> FloatArray:
    """Position, and turn times `LEVER`, from modelled to reported poses, both (n, 4, 4), in the model's tip: (n, 6)."""
    D = np.linalg.inv(model) @ reported
    turn = 0.5 * np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=1)
    return np.concatenate([D[:, :3, 3], LEVER * turn], axis=1)


def fit_controller(arm: Arm, q: FloatArray, T: FloatArray, source: str) -> ControllerFit:
    """Find the numbers with which a controller computes poses.

    Parameters
    ----------
    arm : Arm
        The URDF's.
    q : ndarray, shape (n, joints)
        Radians (metres for prismatic joints).
    T : ndarray, shape (n, 4, 4)
        Poses that the controller reports for them, metres.
    source : str
        File name for messages.

    Raises
    ------
    IdentificationError
        If the poses are nowhere near those of the arm; a data-entry error that explains it is named.
    """
    start = _CandidateModel(arm, np.eye(4), np.eye(4))
    size = _sizes(start, q, T)
    frames_differ = bool(np.median(size) > FRAMES_FROM)
    if frames_differ:
        start = _with_frames(arm, q, T, source)
        size = _sizes(start, q, T)
    moment = size > max(MOMENT, MOMENT_FACTOR * float(np.median(size)))
    if np.median(size) > NOWHERE or moment.mean() > 0.5:
        raise IdentificationError(
            f"the reported poses are {np.median(size) / MM:.3g} mm (median) from those of {arm.name}, even with the "
            "best base and tool: wrong robot file, joint order or joint signs?",
            file=source,
        )
    rows = np.flatnonzero(~moment)
    names = _candidates(arm)
    J, r = _linearised(start, names, q[rows], T[rows])
    always = [names.index(name) for name in names if frames_differ and (name in TOOL or name.endswith("1"))]
    sparse = _chosen(J, r, always)
    every = list(range(len(names)))
    core = _core(J, r, sparse)
    rms_few, rms_all = (_rms(J, r, chosen, core) for chosen in (sparse, every))
    dense = rms_all < MANY_GAIN * rms_few and rms_few > EXACT and len(rows) > len(names)
    chosen = every if dense else sparse
    model, values, std = _refined(start, names, chosen, q[rows], T[rows])
    names_chosen = tuple(names[k] for k in chosen)
    if frames_differ:  # frames differ as frames, not as numbers of the model
        of_arm = [k for k, name in enumerate(names_chosen) if name not in TOOL and not name.endswith("1")]
        base = {f"{kind}1" for kind in GEOMETRIC}
        corrected = _CandidateModel(arm, np.eye(4), np.eye(4)).moved(
            np.array(names_chosen, dtype=object)[of_arm], values[of_arm]
        )
        row = start.moved(*_selected(names_chosen, values, base)).arm
        shift = row.T_base_0 @ row.table.step(0) @ np.linalg.inv(arm.T_base_0 @ arm.table.step(0))
        model = _CandidateModel(corrected.arm, start.T_base @ shift, model.T_tool)
        names_chosen, values, std = tuple(names_chosen[k] for k in of_arm), values[of_arm], std[of_arm]
    errors_of_both = [_errors(fitted_model, q, T) for fitted_model in (start, model)]
    remaining = errors_of_both[1][:, 0]
    moment = remaining > max(MOMENT, MOMENT_FACTOR * float(np.median(remaining)))
    return ControllerFit(
        model.arm,
        model.T_base,
        model.T_tool,
        names_chosen,
        values,
        std,
        errors_of_both[0],
        errors_of_both[1],
        moment,
        frames_differ,
        dense,
    )


def _selected(names: tuple[str, ...], values: FloatArray, selection: set[str]) -> tuple[NameArray, FloatArray]:
    keep = [k for k, name in enumerate(names) if name in selection]
    return np.array([names[k] for k in keep], dtype=object), values[keep]


def _sizes(model: _CandidateModel, q: FloatArray, T: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(differences(model.poses(q), T)[:, :3], axis=1))


def _errors(model: _CandidateModel, q: FloatArray, T: FloatArray) -> FloatArray:
    """Distance (m) and angle (rad) of each row, shape (n, 2)."""
    reached = model.poses(q)
    distance = np.linalg.norm(reached[:, :3, 3] - T[:, :3, 3], axis=1)
    return np.column_stack([distance, frames.rotation_distance(reached[:, :3, :3], T[:, :3, :3])])


def _with_frames(arm: Arm, q: FloatArray, T: FloatArray, source: str) -> _CandidateModel:
    """Base and tool of the controller where they are others than the URDF's links."""
    points = virtual_points(q, T)
    for _ in range(6):
        try:
            robot = identify(arm, points, "nominal").robot
        except IdentificationError:
            break
        size = np.linalg.norm(virtual_points(q, T).xyz - virtual_points(q, T).predicted(robot), axis=1).reshape(-1, 4)
        keep = size.max(axis=1) <= np.quantile(size.max(axis=1), 0.6)
        points = virtual_points(q[keep], T[keep])
    else:
        if np.median(size) < NOWHERE:
            corners = np.array([robot.targets[name] for name in ("origin", "x", "y", "z")])
            R = frames.nearest_rotation((corners[1:] - corners[0]).T / LEVER)
            return _CandidateModel(arm, robot.T_world_base, frames.transform(R, corners[0]))
    data_entry_error = data_entry_errors.find_data_entry_error(arm, virtual_points(q, T))
    if data_entry_error is not None:
        raise IdentificationError(data_entry_error.in_words(), file=source)
    return _CandidateModel(arm, np.eye(4), np.eye(4))


def _candidates(arm: Arm) -> list[str]:
    """Numbers that may differ: all of joint 1 (the base's place), those of a DHM table, the tool."""
    names = []
    table = arm.table
    for k in range(len(table)):
        parallel = abs(np.sin(table.alpha[k])) < 1e-3 or table.beta[k] or table.b[k]
        kinds = GEOMETRIC if k == 0 or parallel else ("alpha", "a", "theta", "d")
        names += [f"{kind}{k + 1}" for kind in kinds]
    return [*names, *TOOL]


def _linearised(
    model: _CandidateModel, names: list[str], q: FloatArray, T: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivative of `differences` with respect to all candidates, (n, 6, k), and the differences (n, 6)."""
    T_before = model.poses(q)
    columns = []
    for name in names:
        ends = [model.moved(np.array([name], dtype=object), np.array([h])).poses(q) for h in (1e-5, -1e-5)]
        columns.append((differences(T_before, ends[0]) - differences(T_before, ends[1])) / 2e-5)
    return np.stack(columns, axis=2), differences(T_before, T)


def _solve(J: FloatArray, r: FloatArray, chosen: list[int], core: IntArray) -> FloatArray:
    columns = J[core][:, :, chosen].reshape(-1, len(chosen))
    return np.asarray(np.linalg.lstsq(columns, r[core].ravel(), rcond=1e-7)[0])


def _remaining_sizes(J: FloatArray, r: FloatArray, chosen: list[int], core: IntArray) -> FloatArray:
    """Size of what is left of each row, shape (n,)."""
    residual = r - J[:, :, chosen] @ _solve(J, r, chosen, core) if chosen else r
    return np.asarray(np.linalg.norm(residual, axis=1))


def _core(J: FloatArray, r: FloatArray, chosen: list[int]) -> IntArray:
    """Rows that take part: those that are not much farther than the median."""
    core = np.arange(len(r))
    for _ in range(5):
        size = _remaining_sizes(J, r, chosen, core)
        core = np.flatnonzero(size <= max(CORE * float(np.median(size)), EXACT))
    return core


def _rms(J: FloatArray, r: FloatArray, chosen: list[int], core: IntArray) -> float:
    size = _remaining_sizes(J, r, chosen, core)[core]
    return rms(size)


def _chosen(J: FloatArray, r: FloatArray, always: list[int]) -> list[int]:
    """Numbers that explain most, one after the other (orthogonal matching pursuit on the rows that agree)."""
    chosen = list(always)
    while len(chosen) < len(always) + MOST_CHOSEN:
        core = _core(J, r, chosen)
        now = _rms(J, r, chosen, core)
        if now < EXACT:
            break
        open_ = [k for k in range(J.shape[2]) if k not in chosen]
        best_rms, best = min((_rms(J, r, [*chosen, k], core), k) for k in open_)
        if best_rms > GAIN * now:
            pairs = [(a, b) for at, a in enumerate(open_) for b in open_[at + 1 :]]
            best_rms, *two = min((_rms(J, r, [*chosen, a, b], core), a, b) for a, b in pairs)
            if best_rms > GAIN**2 * now:
                break
            chosen += two
        else:
            chosen.append(best)
    for k in chosen[len(always) :]:  # what others taken later make needless
        kept_numbers = [number for number in chosen if number != k]
        core = _core(J, r, chosen)
        if _rms(J, r, kept_numbers, core) * GAIN**0.5 < _rms(J, r, chosen, core):
            chosen = kept_numbers
    return chosen


def _refined(
    start: _CandidateModel, names: list[str], chosen: list[int], q: FloatArray, T: FloatArray
) -> tuple[_CandidateModel, FloatArray, FloatArray]:
    """The model with the chosen numbers by Gauss-Newton, their values and standard deviations."""
    names_chosen = np.array([names[k] for k in chosen], dtype=object)
    values = np.zeros(len(chosen))
    if not chosen:
        return start, values, values
    every = list(range(len(chosen)))
    for _ in range(4):
        J, r = _linearised(start.moved(names_chosen, values), list(names_chosen), q, T)
        core = _core(J, r, every)
        values = values + _solve(J, r, every, core)
    columns = J[core].reshape(-1, len(chosen))
    sigma = np.linalg.norm(r[core].ravel() - columns @ _solve(J, r, every, core)) / np.sqrt(
        max(columns.shape[0] - len(chosen), 1)
    )
    std = sigma * np.sqrt(np.diag(np.linalg.pinv(columns.T @ columns, rcond=1e-14, hermitian=True)))
    return start.moved(names_chosen, values), values, std
