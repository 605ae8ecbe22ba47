r"""Robot programs as lists of targets, whatever their format.

A target is either a set of joints or a pose of the tool centre point in a work object. Writing "fake targets"
(Nubiola 2011, section 6.2) means to replace the numbers of targets and nothing else::

    T_base_tip = T_base_wobj @ T_wobj_tcp @ inverse(T_tip_tcp)

where ``tip`` is the flange frame that carries the tool (``tool0``) and ``base`` the frame that carries the work
objects (``wobj0``).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.units import DEG, MM

DECIMALS = 6
"""Decimals written for millimetres and degrees."""

QUATERNION_DECIMALS = 9
"""Decimals written for the components of a quaternion."""

QUATERNION_TOLERANCE = 1e-3
"""How far the length of a quaternion may be from one."""


@dataclass(frozen=True)
class ConfData:
    """Configuration of a pose: quadrants of axes 1, 4 and 6, and the branch number ``cfx``.

    The quadrant of an axis is ``floor(angle / 90 degrees)``.
    """

    cf1: int
    cf4: int
    cf6: int
    cfx: int


@dataclass(frozen=True)
class Use:
    """One direct use of a target in a move.

    Attributes
    ----------
    line, column : int
        Of the instruction; both start at 1.
    instruction : str
        As usually spelled: MoveJ, MoveL, MoveC, MoveAbsJ, TriggL, …
    role : str
        ``to``, or ``via`` for the point on the circle.
    tool, work_object : str or None
        Names in lower case; None where the program computes them.
    """

    line: int
    column: int
    instruction: str
    role: str
    tool: str | None
    work_object: str | None


@dataclass(frozen=True, eq=False)
class Target:
    """A target whose numbers stand in the file.

    Attributes
    ----------
    name : str
        As in the program, with the index for the element of an array; the place for a literal inside a move.
    kind : str
        ``joint`` or ``pose``.
    value : ndarray, shape (6,) or (4, 4)
        Joints in radians, or ``T_wobj_tcp`` in metres; locked. NaN where ``conflicts`` says that it has none.
    configuration : ConfData or None
        Of a pose; None where it is not a literal.
    external : str
        External axes as they stand in the file.
    line, column : int
        Where the literal begins; both start at 1.
    uses : tuple of Use
        Direct uses in moves.
    conflicts : tuple of str
        Why changing this literal would do more, or something else, than correct its direct uses.
    written : tuple of float
        The numbers as they stand in the file: degrees, or mm and quaternion (scalar first).
    spans, configuration_spans : tuple of (int, int)
        Where these numbers stand in the text.
    """

    name: str
    kind: str
    value: np.ndarray
    configuration: ConfData | None
    external: str
    line: int
    column: int
    uses: tuple
    conflicts: tuple
    written: tuple
    spans: tuple
    configuration_spans: tuple = ()

    @property
    def correctable(self):
        """Whether a move uses this target and nothing speaks against changing it."""
        return bool(self.uses) and not self.conflicts

    @property
    def reason(self):
        """Why the target is not correctable, one sentence part; empty if it is."""
        return "; ".join(self.conflicts) or ("" if self.uses else "no move of this module uses it")


@dataclass(frozen=True)
class Uncorrected:
    """A move that goes, at least in part, to a target that cannot be corrected."""

    line: int
    column: int
    instruction: str
    target: str
    reason: str


@dataclass(frozen=True)
class Note:
    """Something in the program that the corrections do not know about."""

    line: int
    text: str


@dataclass(frozen=True, eq=False)
class Program:
    """A program as read: its text and what was understood of it.

    Attributes
    ----------
    source : str
        File name for messages.
    text, encoding : str
        ``text.encode(encoding)`` are the bytes of the file.
    targets : tuple of Target
        In the order of the file.
    tools, work_objects : dict of str to ndarray, shape (4, 4)
        ``T_tip_tcp`` and ``T_base_wobj`` of the names (lower case) that direct uses of poses need; metres.
    uncorrected : tuple of Uncorrected
        Moves that are left as they are.
    notes : tuple of Note
        What the user should look at.
    fingerprint : str or None
        Of the calibration that this program was already corrected with; empty where the mark does not say.
    """

    source: str
    text: str
    encoding: str
    targets: tuple
    tools: dict
    work_objects: dict
    uncorrected: tuple
    notes: tuple
    fingerprint: str | None

    @property
    def data(self):
        """The bytes of the file."""
        return self.text.encode(self.encoding)

    def correctable(self, kind=None):
        """Numbers of the targets that may be changed, of one kind or of both: list of int."""
        return [k for k, t in enumerate(self.targets) if t.correctable and kind in (None, t.kind)]

    def skipped(self):
        """Targets that are left as they are, with the reason: list of (Target, str)."""
        return [(t, t.reason) for t in self.targets if not t.correctable]


def is_filtered(program):
    """Whether a program (RAPID or table) bears the mark of an earlier correction."""
    return program.fingerprint is not None


def read_bytes(path):
    """Content of a program file.

    Raises
    ------
    ProgramError
        If there is nothing to read.
    """
    try:
        data = Path(path).read_bytes()
    except IsADirectoryError:
        raise ProgramError(f"{path}: expected a file, found a folder") from None
    except FileNotFoundError:
        raise ProgramError(f"{path}: there is no such file") from None
    except PermissionError:
        raise ProgramError(f"{path}: no permission to read this file") from None
    if not data.strip():
        raise ProgramError(f"{path}: the file is empty, expected a robot program")
    return data


def poses_from_numbers(numbers):
    """Transforms from millimetres and quaternions.

    Parameters
    ----------
    numbers : ndarray, shape (n, 7)
        x, y, z in mm and the quaternion, scalar first, of any positive length.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        Metres.
    """
    numbers = np.asarray(numbers, dtype=float).reshape(-1, 7)
    w, x, y, z = (numbers[:, 3:] / np.linalg.norm(numbers[:, 3:], axis=1, keepdims=True)).T
    T = np.zeros((len(numbers), 4, 4))
    T[:, 0, :3] = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
    T[:, 1, :3] = np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
    T[:, 2, :3] = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    T[:, :3, 3] = numbers[:, :3] * MM
    T[:, 3, 3] = 1.0
    return T


def numbers_from_poses(T, near=None):
    """Millimetres and unit quaternions of transforms.

    Parameters
    ----------
    T : ndarray, shape (n, 4, 4)
        Metres.
    near : ndarray, shape (n, 4), optional
        Quaternions, scalar first: of ``q`` and ``-q``, the one nearer to these is taken. Without, the scalar
        part is not negative.

    Returns
    -------
    ndarray, shape (n, 7)

    Raises
    ------
    ValueError
        If a transform is not rigid.
    """
    from scipy.spatial.transform import Rotation

    T = np.asarray(T, dtype=float).reshape(-1, 4, 4)
    R = T[:, :3, :3]
    rigid = np.isfinite(T).all() and np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(initial=0.0) < 1e-6
    if not rigid or (np.linalg.det(R) < 0).any() or (T[:, 3] != [0, 0, 0, 1]).any():
        raise ValueError("expected rigid transforms")
    quaternion = Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]]
    sign = quaternion[:, 0] if near is None else (quaternion * near).sum(axis=1)
    quaternion *= np.where(sign < 0, -1.0, 1.0)[:, None]
    return np.column_stack([T[:, :3, 3] / MM, quaternion])


def tip_poses(program, indices):
    """Poses of the flange that pose targets ask for.

    Parameters
    ----------
    program : Program
    indices : sequence of int
        Numbers of correctable pose targets.

    Returns
    -------
    ndarray, shape (n, 4, 4)
        ``T_base_tip``, metres.
    """
    T_base_wobj, T_tip_tcp = _frames_of(program, indices)
    values = np.array([program.targets[k].value for k in indices]).reshape(-1, 4, 4)
    return T_base_wobj @ values @ frames.inverse(T_tip_tcp)


def values_for_tip_poses(program, indices, T_base_tip):
    """Values of pose targets that make the flange reach given poses; the inverse of `tip_poses`.

    Returns
    -------
    dict of int to ndarray, shape (4, 4)
        ``T_wobj_tcp`` by the number of the target, as `with_targets` takes it.
    """
    T_base_wobj, T_tip_tcp = _frames_of(program, indices)
    values = frames.inverse(T_base_wobj) @ np.asarray(T_base_tip, dtype=float).reshape(-1, 4, 4) @ T_tip_tcp
    return dict(zip(indices, values, strict=True))


def _frames_of(program, indices):
    uses = [program.targets[k].uses[0] for k in indices]
    T_base_wobj = np.array([program.work_objects[use.work_object] for use in uses]).reshape(-1, 4, 4)
    return T_base_wobj, np.array([program.tools[use.tool] for use in uses]).reshape(-1, 4, 4)


def with_targets(program, new_values, configurations=None):
    """Bytes of the program with new values for some targets and all else untouched.

    A number that the new value does not change, within the decimals written, keeps its text.

    Parameters
    ----------
    program : Program
    new_values : dict of int to ndarray, shape (6,) or (4, 4)
        By the number of the target: joints in radians or ``T_wobj_tcp`` in metres.
    configurations : dict of int to ConfData, optional
        New configurations of pose targets.

    Returns
    -------
    bytes

    Raises
    ------
    ProgramError
        If a configuration is to be written where the program has no literal one.
    ValueError
        If a value is not finite, not rigid or of the wrong shape.
    """
    edits = []
    poses = [k for k in new_values if program.targets[k].kind == "pose"]
    joints = [k for k in new_values if program.targets[k].kind == "joint"]
    for chosen, shape in ((poses, (4, 4)), (joints, (6,))):
        wrong = [k for k in chosen if np.shape(new_values[k]) != shape or not np.isfinite(new_values[k]).all()]
        if wrong:
            raise ValueError(f"target {program.targets[wrong[0]].name}: expected finite numbers of shape {shape}")
    if poses:
        near = np.array([program.targets[k].written[3:] for k in poses])
        numbers = numbers_from_poses(np.array([new_values[k] for k in poses]), near)
        for k, row in zip(poses, numbers, strict=True):
            _edit(edits, program.targets[k], row, [DECIMALS] * 3 + [QUATERNION_DECIMALS] * 4)
    for k in joints:
        _edit(edits, program.targets[k], np.asarray(new_values[k]) / DEG, [DECIMALS] * 6)
    for k, conf in (configurations or {}).items():
        target = program.targets[k]
        if target.configuration is None:
            raise ProgramError(
                f"{program.source}: line {target.line}: target {target.name} has no configuration in numbers to rewrite"
            )
        was = target.configuration
        pairs = zip((conf.cf1, conf.cf4, conf.cf6, conf.cfx), (was.cf1, was.cf4, was.cf6, was.cfx), strict=True)
        spans = target.configuration_spans
        edits.extend((*s, str(int(new))) for s, (new, old) in zip(spans, pairs, strict=True) if new != old)
    pieces, end = [], 0
    for start, stop, text in sorted(edits):
        pieces += [program.text[end:start], text]
        end = stop
    return "".join([*pieces, program.text[end:]]).encode(program.encoding)


def _edit(edits, target, numbers, decimals):
    for span, new, old, places in zip(target.spans, numbers, target.written, decimals, strict=True):
        if not abs(new - old) <= 0.5 * 10.0**-places:
            edits.append((*span, number_text(new, places)))


def number_text(value, decimals):
    """A number without exponent, without needless zeros and without a negative zero."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
