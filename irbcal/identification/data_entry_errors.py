"""Data-entry errors found by hypothesis: what would have to be read otherwise for a file to fit a robot.

A file that does not fit its robot is most often right but for one error: a joint that counts the other way, two columns
swapped, another unit, a row lost. Each such error is a hypothesis: an affine map of the joints, or joints of the row
before or behind. All are tried, alone and in pairs. Of each, the points are fitted by the nominal robot with base and
tool in closed form, the base being any affine map: its rotation's sign then tells left-handed points, its scale another
unit of length, without a hypothesis of their own. The best are judged with a rigid base by their median distance.

Nothing is changed here: a data-entry error is named, with what would mend it.

A row lost or doubled in the middle of a file: from some pose on, positions stand beside their neighbour's joints.

Base and tool of the nominal robot are found in closed form from windows of the file, read as they are and one pose
late or early; at least one window lies on one side of the place. With each, every pose has a distance as it is and one
read late or early, and the sums of both, each capped as an outlier has no more to say, from the front and from the
back tell the place at which it is best to go over from one to the other. The best is fitted again to all poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from irbcal import literals
from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, smallest
from irbcal.errors import IdentificationError
from irbcal.identification import initial_guess, least_squares
from irbcal.identification.problem import Problem, State
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM
from irbcal.wording import inflected, joined

FACTOR = 5.0
"""How many times nearer the points must be for a data-entry error to be named; for two at once its square root more."""

NEAR, NEAR_SHARE = 10.0 * MM, 0.01
"""Median distance that a named data-entry error leaves at most, metres and as a share of the spread of the points."""

SUSPECT = 4.0 * MM
"""Median distance from the nominal robot below which no data-entry error is looked for, metres."""

FEWEST_POSES_FOR_HYPOTHESES, FEWEST_EQUATIONS = 10, 2.0
"""Poses, and equations for each unknown, below which nothing is named: too many hypotheses would fit."""

SUBSET, ENOUGH_POINTS = 48, 72
"""Poses that hypotheses are tried on at most; fewer, but at least half, where they hold so many points."""

JUDGED = 14
"""Hypotheses that are judged with a rigid base, of those that fit best with an affine one."""

AS_GOOD = 1.5
"""Hypotheses that fit within this factor of the best are as good: the simplest of them is named first."""

SAME_DISTANCE = 0.01 * MM
"""Distances that differ by no more are the same, metres."""

SPREAD = 1e-3
"""Ratio of singular values of the closed form below which points as read do not tell base and tool: with one or two
joints moving it is some 1e-4, as the real arm is not the nominal one, with joints that all turn by 5 % of their range
1e-2."""

STILL, FEWEST_MOVING = 1e-3, 3
"""A joint that moves less (radians, metres) stands still; of two that move, a shift by a row is a turn of the base."""

TRIMMED_TO, ROUNDS = 0.6, 6
"""Share of the points that the robot is fitted to, and how often these are chosen again."""

LENGTHS = {
    1e3: ("positions in metres instead of millimetres", "m"),
    25.4: ("positions in inches instead of millimetres", "inch"),
    10.0: ("positions in centimetres instead of millimetres", None),
    1e3 / 25.4: ("positions in metres instead of inches", None),
    1e-3: ("positions in millimetres instead of metres", None),
    1 / 25.4: ("positions in millimetres instead of inches", None),
    0.1: ("positions in millimetres instead of centimetres", None),
}
"""Factor on positions as read: what they look like, and the unit to declare to `irbcal.import_measurements`."""

LARGE_MEDIAN = 0.05
"""Median distance after some rounds above which no more are needed, metres."""

CHUNK = 400
"""Hypotheses in memory at a time."""


@dataclass(frozen=True, eq=False)
class Hypothesis(Locked):
    """Another way to read the joints and points of a file."""

    descriptions: tuple[str, ...]
    """What the file looks like, such as ``joint 3 with its sign turned``."""
    cost: float
    """How far-fetched it is; about one for each thing that is wrong."""
    matrix: FloatArray
    offset: FloatArray
    """Shapes (joints, joints) and (joints,). ``matrix @ q + offset`` are the joints, radians (metres for prismatic
    joints).
    """
    late: int = 0
    """The points of a row belong to the joints so many rows before."""
    scale: float = 1.0
    """Factor on positions."""
    mirrored: bool = False
    """Whether positions are left-handed."""

    def joints(self, q: FloatArray) -> FloatArray:
        """Joints of all rows, (n, joints); of rows without one so many before them, those of the nearest row."""
        rows = np.clip(np.arange(len(q)) - self.late, 0, len(q) - 1)
        return q[rows] @ self.matrix.T + self.offset

    def applied_to(self, points: PointSet) -> PointSet:
        """The points read so, without orientations and stops before; a mirrored z stands for any mirrored axis."""
        flip = np.array([1.0, 1.0, -1.0 if self.mirrored else 1.0])
        xyz = points.xyz * (self.scale * flip)
        return replace(points, q=self.joints(points.q), xyz=xyz, rotation=None, previous=None, session=None)

    def then(self, second: Hypothesis) -> Hypothesis:
        """Both: the other is applied to what this one gives."""
        return Hypothesis(
            self.descriptions + second.descriptions,
            self.cost + second.cost,
            second.matrix @ self.matrix,
            second.matrix @ self.offset + second.offset,
            self.late + second.late,
        )


@dataclass(frozen=True, eq=False, repr=False)
class DataEntryError(Result):
    """A data-entry error that explains why a file does not fit a robot."""

    hypothesis: Hypothesis
    median_before: float
    median_after: float
    """Median distance of the points from the nominal robot as they are, and read so, metres."""
    also: tuple[Hypothesis, ...] = ()
    """Other ways to read the file that fit as well."""
    joint_columns: tuple[str, ...] = ()
    oriented: bool = False
    """Whether orientations were measured, too."""

    @property
    def looks_like(self) -> str:
        """What the file looks like."""
        return " and ".join(self.hypothesis.descriptions)

    def in_words(self, source: str = "") -> str:
        """One sentence, with the way to mend it where there is one.

        Parameters
        ----------
        source : str
            The file.
        """
        also = "; ".join(" and ".join(hypothesis.descriptions) for hypothesis in self.also)
        also = f" (as well with {also})" if also else ""
        return (
            f"these look like {self.looks_like}: read so, the nominal robot meets the points within "
            f"{self.median_after / MM:.2g} mm (median), as they are within {self.median_before / MM:.3g} mm{also}. "
            f"Nothing was changed; {self.remedy(source)}"
        )

    def remedy(self, source: str = "") -> str:
        """What mends the file: a line for ``irbcal import`` where that can, else words."""
        by_hand = []
        if self.hypothesis.late:
            side = "up" if self.hypothesis.late > 0 else "down"
            by_hand.append(f"move the columns of target and position {abs(self.hypothesis.late)} pose {side}")
        options = _options(self.hypothesis, self.joint_columns)
        if options and self.oriented and self.hypothesis.mirrored:
            options.append("columns.orientation=null")
        if options is None:
            by_hand.append(f"change the columns: {self.looks_like}")
            options = []
        if not options:
            return f"to mend it, {' and '.join(by_hand)}"
        first = f"to mend it, {' and '.join(by_hand)}, then" if by_hand else "to read them so:"
        name = source if source and not source.startswith("<") else "measured.csv"
        call = ["irbcal", "import", name, "--as", "irbcal"]
        return (
            f"{first} {literals.shell(*call, *(word for text in options for word in ('--set', text)))} --out mended.csv"
        )

    def report(self) -> Sequence[Paragraph]:
        """The sentence."""
        text = self.in_words()
        return [text[0].upper() + text[1:]]


def find_data_entry_error(
    arm: Arm, points: PointSet, misfit: float | None = None, pairs: bool = True
) -> DataEntryError | None:
    """Look for a data-entry error that explains why points do not fit a robot.

    Parameters
    ----------
    arm : Arm
        Nominal.
    points : PointSet
        All poses in the order of the file; of several sessions, those of the last one are used.
    misfit : float, optional
        Median distance from the nominal robot as the points are, metres, where it is known; infinite where it cannot
        be fitted at all.
    pairs : bool
        Try two data-entry errors at once where one does not explain it.

    Returns
    -------
    Slip or None
        None where the points fit, or no way to read them fits clearly better.
    """
    if points.session is not None:
        points = points.select(points.session == points.session[-1]).without_empty_poses()
    unknowns = 12 + 3 * len(np.unique(points.target))
    if points.poses < FEWEST_POSES_FOR_HYPOTHESES or 3 * len(points) < FEWEST_EQUATIONS * unknowns:
        return None
    error_as_read = _judged(arm, replace(points, rotation=None, previous=None, session=None))
    misfit = error_as_read if misfit is None else min(error_as_read, misfit)
    if misfit < SUSPECT:
        return None
    single = list(hypotheses(arm))
    data_entry_error = _best(arm, points, single, misfit, FACTOR)
    if data_entry_error is None and pairs:
        data_entry_error = _best(arm, points, list(_pairs(single)), misfit, FACTOR**1.5)
    return data_entry_error


def hypotheses(arm: Arm) -> Iterator[Hypothesis]:
    """All single data-entry errors of an arm's joints, the file as it is first, in the order of applying two."""
    n = len(arm.joint_names)
    turning = np.flatnonzero(~arm.table.prismatic)
    eye, none = np.eye(n), np.zeros(n)
    yield Hypothesis((), 0.0, eye, none)
    for late in (1, -1):
        where = "before" if late > 0 else "behind"
        text = f"points one pose {'late' if late > 0 else 'early'} (they belong to the joints of the row {where})"
        yield Hypothesis((text,), 1.4, eye, none, late)
    if len(turning):
        unit = np.where(arm.table.prismatic, 1.0, 1.0 / DEG)
        yield Hypothesis(("joints in radians instead of degrees",), 0.5, np.diag(unit), none)
        yield Hypothesis(("joints in degrees instead of radians",), 0.6, np.diag(1.0 / unit), none)
    for a, b in combinations(range(n), 2):
        order = np.arange(n)
        order[[a, b]] = b, a
        yield Hypothesis((f"joints {a + 1} and {b + 1} swapped",), 1.2, eye[order], none)
    for a in range(n):
        for b in (a - 1, a + 1):
            for sign in (1.0, -1.0):
                if a in turning and b in turning:
                    matrix = eye.copy()
                    matrix[a, b] = sign
                    how = "be added to" if sign > 0 else "be taken from"
                    text = f"joint {a + 1} shown with joint {b + 1} in it (joint {b + 1} is to {how} it)"
                    yield Hypothesis((text,), 1.1 if a > b else 1.6, matrix, none)
    for k in range(1, n + 1 if n <= 6 else 4):
        for joints in combinations(range(n), k):
            signs = np.ones(n)
            signs[list(joints)] = -1.0
            yield Hypothesis((_turned(joints),), float(k), np.diag(signs), none)
    for a in turning[1:-1]:  # offsets of the first and the last joint go into base and tool
        for degrees, zero in ((90, "+90"), (-90, "-90"), (180, "±180")):
            offset = none.copy()
            offset[a] = degrees * DEG
            text = f"joint {a + 1} with its zero elsewhere ({zero} degrees)"
            yield Hypothesis((text,), 1.3, eye, offset)


def _turned(joints: Sequence[int]) -> str:
    n, numbers = len(joints), joined([str(k + 1) for k in joints])
    return f"{inflected(n, 'joint')} {numbers} with {inflected(n, 'its sign', 'their signs')} turned"


def _pairs(single: Sequence[Hypothesis]) -> Iterator[Hypothesis]:
    """Two data-entry errors at once; of signs that are turned at most three."""
    likely = [hypothesis for hypothesis in single if 0 < hypothesis.cost < 3.5]
    for first, second in combinations(likely, 2):
        signs = [bool(hypothesis.descriptions[0].endswith("turned")) for hypothesis in (first, second)]
        if not all(signs) and not (first.late and second.late):
            yield first.then(second)


def _best(
    arm: Arm, points: PointSet, tried: Sequence[Hypothesis], misfit: float, factor: float
) -> DataEntryError | None:
    """The simplest of the hypotheses that fit clearly better than the file as it is."""
    spread = float(np.sqrt(np.var(points.xyz, axis=0).sum()))
    fits: list[tuple[float, Hypothesis]] = []
    for hypothesis in _screened(arm, points, tried):
        if hypothesis.cost:
            error = _judged(arm, read := hypothesis.applied_to(points))
            if error <= NEAR and not _determined(arm, read):
                continue
            if error <= min(hypothesis.scale * min(misfit / factor, NEAR_SHARE * spread), NEAR):
                fits.append((error, hypothesis))
    if not fits:
        return None
    smallest = min(error for error, _ in fits)
    near = AS_GOOD * smallest + SAME_DISTANCE
    good = sorted((fit for fit in fits if fit[0] <= near), key=lambda item: item[1].cost)
    also = tuple(hypothesis for _, hypothesis in good[1:] if hypothesis.cost < good[0][1].cost + 0.6)
    return DataEntryError(good[0][1], misfit, good[0][0], also, tuple(arm.joint_columns), bool(points.oriented().any()))


def _subset(points: PointSet) -> tuple[PointSet, FloatArray]:
    """Some poses from the whole file, and their rows."""
    inner = np.arange(1, points.poses - 1)
    count = int(np.clip(ENOUGH_POINTS * points.poses / len(points), SUBSET // 2, SUBSET))
    rows = inner[np.unique(np.linspace(0, len(inner) - 1, min(count, len(inner))).round().astype(int))]
    keep = np.zeros(points.poses, dtype=bool)
    keep[rows] = True
    return points.select(keep).with_seen_targets(), rows


def _screened(arm: Arm, points: PointSet, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses that fit best with any affine base, each with the scale and the hand that its base tells."""
    subset, rows = _subset(points)
    m, count = len(subset), len(subset.target_names)
    y = subset.xyz - subset.xyz.mean(axis=0)
    size = max(float(np.abs(y).max()), 1e-12)
    design = np.column_stack([y / size, np.ones(m)])
    U, S, _ = np.linalg.svd(design, full_matrices=False)
    Q = U[:, 1e-9 * S[0] < S]
    inverse = np.linalg.pinv(design, rcond=1e-9)
    scores, bases = [], []
    for first in range(0, len(tried), CHUNK):
        chunk = tried[first : first + CHUNK]
        q = np.concatenate([hypothesis.joints(points.q)[rows] for hypothesis in chunk])
        T = arm.forward(q).reshape(len(chunk), -1, 4, 4)[:, subset.pose]
        p = T[:, :, :3, 3]
        turns = np.zeros((len(chunk), m, 3, count, 3))
        turns[:, np.arange(m), :, subset.target] = np.moveaxis(T[:, :, :3, :3], 0, 1)
        A = turns.reshape(len(chunk), m, 3 * 3 * count)
        columns = (A - Q @ (Q.T @ A)).reshape(len(chunk), 3 * m, 3 * count)
        right = (p - Q @ (Q.T @ p)).reshape(len(chunk), 3 * m)
        normal = np.swapaxes(columns, 1, 2) @ columns
        c = -np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ (np.swapaxes(columns, 1, 2) @ right[..., None])
        residual = (right + (columns @ c)[..., 0]).reshape(len(chunk), m, 3)
        reached = p + (A.reshape(len(chunk), 3 * m, -1) @ c).reshape(len(chunk), m, 3)
        placed = reached - residual
        spread = np.sqrt(np.var(placed, axis=1).sum(axis=1))  # joints that hardly move are met by a base that shrinks
        scores.append(np.median(np.linalg.norm(residual, axis=2), axis=1) / np.maximum(spread, 1e-12))
        bases.append(np.swapaxes((inverse @ reached)[:, :3], 1, 2) / size)
    order = np.argsort(np.concatenate(scores) * (1.0 + 0.02 * np.array([hypothesis.cost for hypothesis in tried])))
    W = np.concatenate(bases)
    return [_with_base(tried[k], W[k]) for k in order[:JUDGED]]


def _with_base(hypothesis: Hypothesis, W: FloatArray) -> Hypothesis:
    """A hypothesis with what an affine base (3, 3) tells of the unit of the positions and of their hand."""
    sizes = np.linalg.svd(W, compute_uv=False)
    if sizes[-1] < 0.7 * sizes[0]:  # the points do not tell all of it
        return hypothesis
    texts, cost = list(hypothesis.descriptions), hypothesis.cost
    mirrored, scale = bool(np.linalg.det(W) < 0), 1.0
    size = float(np.exp(np.log(sizes).mean()))
    for factor, (name, _) in LENGTHS.items():
        if abs(np.log(size / factor)) < 0.1:
            scale, cost = factor, cost + 0.5
            texts.append(name)
    if mirrored:
        texts.append("left-handed points (one axis mirrored, or two swapped)")
        cost += 1.0
    return replace(hypothesis, descriptions=tuple(texts), cost=cost, mirrored=mirrored, scale=scale)


def _judged(arm: Arm, points: PointSet) -> float:
    """Median distance from the nominal robot, fitted rigidly to the best part of the points, metres."""
    fit = fitted(arm, points.without_empty_poses().with_seen_targets())
    return np.inf if fit is None else float(np.median(fit[1]))


def fitted(arm: Arm, points: PointSet) -> tuple[State, FloatArray] | None:
    """Base and targets of the nominal robot, fitted to the best part of the points, and the distance of all.

    Parameters
    ----------
    arm : Arm
    points : PointSet
        Without empty poses and targets that were not seen.

    Returns
    -------
    state : State
    distance : ndarray, shape (m,)
        Metres. None in place of both where base and tool cannot be found at all.
    """
    core = np.ones(len(points), dtype=bool)
    best: tuple[State, FloatArray] | None = None
    for k in range(ROUNDS):
        subset = points.take(core).without_empty_poses()
        if len(np.unique(subset.target)) < len(points.target_names):
            break
        try:
            problem = Problem(arm, subset, ())
            state, _ = initial_guess.closed_form(problem)
            if k == ROUNDS - 1 and best is not None and np.median(best[1]) < LARGE_MEDIAN:
                state = least_squares.solve(problem, state).state
        except (IdentificationError, np.linalg.LinAlgError):
            break
        distance = residual_distances(arm, state, points)
        best = state, distance
        if k == ROUNDS // 2 and np.median(distance) > LARGE_MEDIAN:
            break
        core = smallest(distance, TRIMMED_TO)
    return best


def _determined(arm: Arm, points: PointSet) -> bool:
    """Whether points read so tell base and tool; where they do not, too many hypotheses fit."""
    if np.count_nonzero(np.ptp(points.q, axis=0) > STILL) < FEWEST_MOVING:
        return False
    try:
        return initial_guess.closed_form(Problem(arm, points.without_empty_poses().with_seen_targets(), ()))[1] > SPREAD
    except (IdentificationError, np.linalg.LinAlgError):
        return False


def residual_distances(arm: Arm, state: State, points: PointSet) -> FloatArray:
    """Distances (m,) of points from where the nominal arm with this base and these targets expects them, metres."""
    W = np.linalg.inv(state.T_world_base)
    T = arm.forward(points.q)[points.pose]
    reached = np.einsum("mij,mj->mi", T[:, :3, :3], state.targets[points.target]) + T[:, :3, 3]
    return np.linalg.norm(points.xyz @ W[:3, :3].T + W[:3, 3] - reached, axis=1)


def _options(hypothesis: Hypothesis, columns: Sequence[str]) -> list[str] | None:
    """What to ``--set`` so that ``irbcal import --as irbcal`` reads a file so; None where it cannot."""
    matrix = hypothesis.matrix.copy()
    turning = np.array([name.endswith("_deg") for name in columns])
    radians = bool(np.abs(matrix[turning]).max(initial=0.0) > 10.0)
    if radians:
        matrix[turning] *= DEG
    joints = _import_of_joints(matrix)
    length = None if hypothesis.scale == 1.0 else LENGTHS[hypothesis.scale][1]
    if joints is None or (length is None and hypothesis.scale != 1.0):
        return None
    order, signs, add = joints
    options = []
    names = [columns[j] for j in order]
    if names != [f"q{k}_deg" for k in range(1, 7)]:
        options.append(f"columns.joints=[{', '.join(names)}]")
        options.append(f"columns.programmed=[{', '.join('c' + name[1:] for name in names)}]")
    if radians and turning.all():
        options.append("units.joints=rad")
    elif radians or not turning.all():
        units = [("rad" if radians else "deg") if turns else "mm" for turns in turning]
        options.append(f"units.joints=[{', '.join(units)}]")
    if add:
        options.append(f"joints.add={{{', '.join(f'{to}: {source_joint}' for to, source_joint in add.items())}}}")
    if -1 in signs:
        options.append(f"joints.signs={signs}")
    if hypothesis.offset.any():
        options.append(f"joints.offsets_deg={[round(float(value) / DEG, 9) for value in hypothesis.offset]}")
    if length is not None:
        options.append(f"units.lengths={length}")
    if hypothesis.mirrored:
        options.append("columns.position=[y_mm, x_mm, z_mm]")
    return options


def _import_of_joints(matrix: FloatArray) -> tuple[list[int], list[int], dict[int, int]] | None:
    """Column and sign of each joint, and the joint (counted from 1, with a sign) that is added to others.

    None where no import does it: entries other than 1 and -1, more than two in a row, a column for two joints.
    """
    entries = [np.flatnonzero(np.abs(row) > 1e-9).tolist() for row in matrix]
    if not np.allclose(np.abs(matrix[np.abs(matrix) > 1e-9]), 1.0) or any(len(row) not in (1, 2) for row in entries):
        return None
    alone = {row[0] for row in entries if len(row) == 1}
    order = []
    for row in entries:
        candidates = [j for j in row if len(row) == 1 or j not in alone]
        if not candidates:
            return None
        order.append(candidates[0])
    if sorted(order) != list(range(len(matrix))):
        return None
    signs = [int(np.sign(matrix[k, j])) for k, j in enumerate(order)]
    add = {
        k + 1: (order.index(j) + 1) * int(np.sign(matrix[k, j] * signs[k]))
        for k, row in enumerate(entries)
        for j in row
        if j != order[k]
    }
    return order, signs, add


FEWEST_POSES_FOR_SHIFTED_ROWS, FEWEST_ROWS = 20, 3
"""Poses below which nothing is looked for, and poses that must be shifted and poses that must not be."""

ROWS_NEARER, ROWS_SHARE = 8.0, 0.6
"""How many times nearer the poses of each side must be as read, and the share of them of which each is nearer so."""

ROWS_NEAR, ROWS_NEAR_SHARE = 30.0 * MM, 0.05
"""Median distance of either side from the nominal robot at most, metres and as a share of the spread of the points."""

WINDOW = 3
"""Part of the file, one in so many, that robots are fitted to."""


@dataclass(frozen=True)
class LostRow:
    """Where positions begin to stand beside their neighbour's joints."""

    pose: str
    """The first such pose."""
    late: int
    """1 where positions belong to the joints of the pose before (they come late), -1 where to those of the next."""
    poses: int
    """Poses from there on."""
    median_before: float
    median_after: float
    """Median distance of their points from the robot as they are and read so, metres."""

    def in_words(self, measurements: MeasurementSet | None = None) -> str:
        """One sentence, with the row of the file where this is at hand."""
        where = f"pose {self.pose}"
        if measurements is not None:
            rows = measurements.cells["row"][measurements.cells["pose"] == self.pose]
            where = f"row {rows[0]} of {Path(measurements.source).name}" if len(rows) else where
        late = self.late > 0
        cause = "a row of joints is missing or a position is doubled"
        if not late:
            cause = "a position is missing or a row of joints is doubled"
        return (
            f"from pose {self.pose} on the points are one pose {'late' if late else 'early'}: {cause} at about {where} "
            f"(read so, the {self.poses} poses from there on are met within {self.median_after / MM:.2g} mm "
            f"(median), as they are within {self.median_before / MM:.3g} mm); nothing was changed"
        )

    def sentence(self, measurements: MeasurementSet) -> str:
        """The same as a sentence of its own."""
        text = self.in_words(measurements)
        return f"{text[0].upper()}{text[1:]}."


def find_lost_row(arm: Arm, points: PointSet) -> LostRow | None:
    """Look for the pose from which on positions belong to their neighbour's joints.

    Parameters
    ----------
    arm : Arm
        Nominal.
    points : PointSet
        All poses in the order of the file; of several sessions, none is looked for.

    Returns
    -------
    LostRow or None
        None where no place explains clearly more than the file as it is.
    """
    if points.session is not None or points.poses < FEWEST_POSES_FOR_SHIFTED_ROWS:
        return None
    points = replace(points, rotation=None, previous=None)
    unknowns = 12 + 3 * len(points.target_names)
    of_a_pose = 3.0 * len(points) / points.poses
    width = max(points.poses // WINDOW, int(np.ceil(FEWEST_EQUATIONS * unknowns / of_a_pose)))
    if width > points.poses // 2:
        return None
    best: tuple[float, int, int] | None = None
    for first in (0, (points.poses - width) // 2, points.poses - width):
        window = np.zeros(points.poses, dtype=bool)
        window[first : first + width] = True
        for late in (0, 1, -1):
            change = _change(arm, points, _read(points, window * late), window)
            if change is not None and (best is None or change < best):
                best = change
    for _ in range(2):
        if best is None:
            return None
        _, late, first_shifted = best
        shifted = np.arange(points.poses) >= first_shifted
        best = _change(arm, points, _read(points, shifted * late), np.ones(points.poses, dtype=bool), (late,))
    return None if best is None else _named(arm, points, best[1], best[2])


def lost_row_of_robot(robot: Robot, points: PointSet) -> LostRow | None:
    """The same with a robot whose base and tool are known already.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        All poses in the order of the file.
    """
    if points.session is not None or points.poses < FEWEST_POSES_FOR_SHIFTED_ROWS:
        return None
    if not points.inputs:  # each pose's prediction serves its neighbours, too
        predicted = _every_target(robot, points)
        rows = {late: np.clip(points.pose - late, 0, points.poses - 1) for late in (0, 1, -1)}
        apart = {late: np.linalg.norm(points.xyz - predicted[points.target, row], axis=1) for late, row in rows.items()}
    else:
        apart = {late: distances(robot, _read(points, late)) for late in (0, 1, -1)}
    read = {late: _of_poses(points, distance) for late, distance in apart.items()}
    _, late, index = min(_cheapest(read, late) for late in (1, -1))
    return _lost_row(points, read[0], read[late], late, index)


def _read(points: PointSet, late: int | IntArray) -> PointSet:
    """The points with the joints of the pose so many before, of all or (n,) of each; at the ends those of the last."""
    rows = np.clip(np.arange(points.poses) - late, 0, points.poses - 1)
    return replace(points, q=points.q[rows], previous=None)


def _every_target(robot: Robot, points: PointSet) -> FloatArray:
    """Where a robot expects each target at each pose from unknown moves, shape (targets, n, 3), metres."""
    n = points.poses
    probe = replace(points, pose=np.arange(n), target=np.zeros(n, int), xyz=np.zeros((n, 3)), rotation=None, u95=None)
    probe = replace(probe, previous=None)
    tip = robot.T_world_base @ probe.tips(robot)
    return np.stack([tip[:, :3, :3] @ robot.targets[name] + tip[:, :3, 3] for name in points.target_names])


def _of_poses(points: PointSet, distance: FloatArray) -> FloatArray:
    """Median distance (n,) of the points of each pose, metres."""
    first = np.searchsorted(points.pose, np.arange(points.poses))
    count = np.bincount(points.pose, minlength=points.poses)
    largest = int(count.max())
    if largest * points.poses > 4 * len(distance):
        order = np.lexsort((distance, points.pose))
        ordered = distance[order]
        return np.asarray((ordered[first + (count - 1) // 2] + ordered[first + count // 2]) / 2.0)
    table = np.full((points.poses, largest), np.inf)
    table[points.pose, np.arange(len(distance)) - first[points.pose]] = distance
    table.sort(axis=1)
    row = np.arange(points.poses)
    return np.asarray((table[row, (count - 1) // 2] + table[row, count // 2]) / 2.0)


def _change(
    arm: Arm, points: PointSet, read: PointSet, used: BoolArray, shifts: tuple[int, ...] = (1, -1)
) -> tuple[float, int, int] | None:
    """Sum of capped distances, shift and place of the best change, seen by the robot that fits points as read."""
    subset = read.select(used).without_empty_poses()
    if len(np.unique(subset.target)) < len(points.target_names):
        return None
    fit = fitted(arm, subset)
    if fit is None:
        return None
    state, _ = fit
    distance = {k: _of_poses(points, residual_distances(arm, state, _read(points, k))) for k in (0, *shifts)}
    return min(_cheapest(distance, late) for late in shifts)


def _cheapest(distance: Mapping[int, FloatArray], late: int) -> tuple[float, int, int]:
    """Sum of capped distances with the best place from which on poses are read with a shift; the shift; the place."""
    cap = 5.0 * ROWS_NEAR
    plain, shifted = np.minimum(distance[0], cap), np.minimum(distance[late], cap)
    sums = np.concatenate([[0.0], np.cumsum(plain)]) + np.concatenate([np.cumsum(shifted[::-1])[::-1], [0.0]])
    index = int(np.argmin(sums))
    return float(sums[index]), late, index


def _named(arm: Arm, points: PointSet, late: int, index: int) -> LostRow | None:
    """The change that a robot fitted to the file as read so stands by."""
    shifted = np.arange(points.poses) >= index
    fit = fitted(arm, _read(points, shifted * late))
    if fit is None:
        return None
    plain, shifted_errors = (_of_poses(points, residual_distances(arm, fit[0], _read(points, k))) for k in (0, late))
    return _lost_row(points, plain, shifted_errors, late, index)


def _lost_row(points: PointSet, plain: FloatArray, shifted: FloatArray, late: int, index: int) -> LostRow | None:
    """The change, where both sides are clearly nearer as read and near."""
    spread = float(np.sqrt(np.var(points.xyz, axis=0).sum()))
    near = min(ROWS_NEAR, ROWS_NEAR_SHARE * spread)
    sides = ((plain[:index], shifted[:index]), (shifted[index:], plain[index:]))
    for good, bad in sides:
        if len(good) < FEWEST_ROWS or np.median(good) > min(near, float(np.median(bad)) / ROWS_NEARER):
            return None
        # of a few poses all must be nearer
        if np.count_nonzero((good < 0.5 * bad) & (good <= 3.0 * near)) < max(ROWS_SHARE * len(good), FEWEST_ROWS):
            return None
    name = str(points.pose_ids[index])
    error_after = float(np.median(shifted[index:]))
    return LostRow(name, late, points.poses - index, float(np.median(plain[index:])), error_after)
