"""The virtual cell of a URDF: link masses in, plan in, measurement file and truth out."""

import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.cell import cell as cells
from irbcal.cell import procedure as cell_procedure
from irbcal.cell.gravity import Bodies
from irbcal.errors import MeasurementError
from irbcal.files import urdf as urdf_module
from irbcal.measurement import columns as readers
from irbcal.modeling import frames
from irbcal.units import MM

KEPT = ("group", "cycle")
"""Columns of a plan that go into the measurement file as they are."""
LONGEST_WAIT = 86_400.0


def bodies(urdf):
    """Masses that each joint of a URDF's chain carries, at zero of all other joints.

    Links on fixed joints count with the link they sit on, and so do branches (a gripper's fingers); links without
    ``inertial`` have no mass.

    Parameters
    ----------
    urdf : UrdfArm

    Returns
    -------
    Bodies

    Raises
    ------
    RobotError
        If a mass or a centre is not a number.
    """
    root, source = urdf.tree.getroot(), urdf.arm.name
    links = {link.get("name"): link for link in root.findall("link")}
    joints = urdf_module._joints(root, source)
    names, children = list(urdf.arm.joint_names), {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    mass, centre = np.zeros(len(names)), np.zeros((len(names), 3))
    for i, first in enumerate(urdf.child_links):
        stack = [(first, urdf.T_dhm_link[i + 1])]
        while stack:
            link, T = stack.pop()
            kilograms, place = _inertial(links[link], link, source)
            mass[i] += kilograms
            centre[i] += kilograms * frames.apply(T, place)
            stack += [
                (joint.child, T @ joint.T_parent_joint) for joint in children.get(link, []) if joint.name not in names
            ]
    return Bodies(mass, centre / np.where(mass > 0, mass, 1.0)[:, None])


def _inertial(link, name, source):
    """Mass and centre of mass of a link element."""
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3)
    mass = inertial.find("mass")
    text = "0" if mass is None else mass.get("value", "0")
    kilograms = urdf_module._numbers(text, 1, f"link {name!r}, mass", source)[0]
    return kilograms, urdf_module._origin(inertial, f"link {name!r}, inertial", source)[:3, 3]


def open_cell(robot, base=None, tip=None, **options):
    """The shipped virtual cell of a robot; options as `irbcal.cell.cell.shipped_cell`."""
    found = urdf_module.read(robot, base, tip)
    return cells.shipped_cell(found.arm, bodies(found), **options)


@dataclass(frozen=True, eq=False)
class Plan:
    """Poses to measure.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Radians (metres for prismatic joints).
    pose : ndarray of str, shape (n,)
    targets : list of tuple or None
        For each pose the names of its targets (none for all) and its line in the file; None for all everywhere.
    wait_s : ndarray, shape (n,)
    extra : dict of str to ndarray of str, shape (n,)
        Columns that are kept.
    source : str
    sha256 : str or None
    """

    q: np.ndarray
    pose: np.ndarray
    targets: list | None
    wait_s: np.ndarray
    extra: dict
    source: str
    sha256: str | None = None


def read_plan(path, arm, wait_s=cells.WAIT_S):
    """Read a plan or a program of joints.

    Parameters
    ----------
    path : str or Path
        CSV with the arm's joint columns; optional columns ``pose``, ``group``, ``cycle``, ``targets`` (names with
        spaces or semicolons between them) and ``wait_s``. Others are not looked at.
    arm : Arm
    wait_s : float
        Where the file does not say.

    Returns
    -------
    Plan

    Raises
    ------
    MeasurementError
        If the file does not keep the format.
    """
    raw, source, digest = readers.read(path, arm.joint_columns)
    columns = []
    for name in arm.joint_columns:
        expected = readers.expected_joint(name)
        values = readers.numbers(raw, name, source, expected)
        largest = readers.LARGEST_POSITION_MM if name.endswith("_mm") else readers.LARGEST_ANGLE_DEG
        _refuse_first(np.abs(values) > largest, raw, name, source, expected)
        columns.append(values)
    n = len(raw)
    waits = np.full(n, float(wait_s))
    if "wait_s" in raw.columns:
        given = readers.numbers(raw, "wait_s", source, "seconds or nothing", lost=True)
        outside = (given < 0) | (given > LONGEST_WAIT)
        _refuse_first(outside, raw, "wait_s", source, f"0 to {LONGEST_WAIT:g} seconds")
        waits = np.where(np.isfinite(given), given, waits)
    return Plan(
        np.column_stack(columns) * arm.joint_units,
        _pose_names(raw, source) if "pose" in raw.columns else numbered(n),
        _targets(raw) if "targets" in raw.columns else None,
        waits,
        {name: raw[name].to_numpy(dtype=object) for name in KEPT if name in raw.columns},
        source,
        digest,
    )


def numbered(n):
    """Names of ``n`` poses: 1 to n."""
    return np.arange(1, n + 1).astype(str).astype(object)


def _refuse_first(bad, raw, column, source, expected):
    """Refuse the first row that is marked as bad."""
    if np.any(bad):
        k = int(np.flatnonzero(bad)[0])
        found = repr(raw[column].iloc[k].strip())
        raise MeasurementError(f"{source}: row {raw.index[k]}, column {column}: expected {expected}, found {found}")


def _pose_names(raw, source):
    names = raw["pose"].str.strip()
    _refuse_first(names == "", raw, "pose", source, "a name")
    key = names + " / " + raw["cycle"].str.strip() if "cycle" in raw.columns else names
    _refuse_first(key.duplicated(), raw, "pose", source, "each pose once (in each cycle)")
    return names.to_numpy(dtype=object)


def _targets(raw):
    """Names of the targets of each row and the line of the file; no names stand for all targets."""
    names = (tuple(name for name in re.split(r"[\s;|,]+", text) if name) for text in raw["targets"])
    return list(zip(names, raw.index, strict=True))


def asked(plan, cell):
    """Which targets each pose of a plan asks for, shape (n, targets); None for all.

    Raises
    ------
    MeasurementError
        If the plan names a target that the cell does not measure.
    """
    if plan.targets is None:
        return None
    names = cell.tool.names
    out = np.zeros((len(plan.q), len(names)), dtype=bool)
    for k, (wanted, row) in enumerate(plan.targets):
        unknown = [name for name in wanted if name not in names]
        if unknown:
            raise MeasurementError(
                f"{plan.source}: row {row}, column targets: expected targets of the tool ({', '.join(names)}), "
                f"found {unknown[0]!r}"
            )
        out[k] = np.isin(names, wanted) if wanted else True
    return out


def random_plan(cell, count, seed=0, wait_s=cells.WAIT_S):
    """Random joints inside the limits, above the floor and, where visibility is on, with a target in sight.

    Parameters
    ----------
    cell : Cell
    count, seed : int
    wait_s : float

    Returns
    -------
    Plan

    Raises
    ------
    MeasurementError
        If the tracker sees too few poses.
    """
    q = cell_procedure.random_poses(cell, count, seed)
    return Plan(q, numbered(count), None, np.full(count, float(wait_s)), {}, f"{count} random poses")


def measurement_table(run, plan, arm):
    """A run as the rows of a measurement file.

    Returns
    -------
    DataFrame
        Text and numbers as they are written: joints with 6 decimals, positions with 4 (0.1 um).
    """
    row, point = np.nonzero(run.asked)
    units = arm.joint_units
    columns = {"pose": plan.pose[row]}
    for name, values in plan.extra.items():
        columns[name] = values[row]
    joints = np.round(plan.q / units, 6) + 0.0
    columns |= {name: joints[row, j] for j, name in enumerate(arm.joint_columns)}
    columns["target"] = np.array(run.names, dtype=object)[point]
    xyz = np.round(run.xyz[row, point] / MM, 4) + 0.0
    columns |= {name: xyz[:, k] for k, name in enumerate(readers.POSITION)}
    columns["payload_kg"] = np.full(len(row), run.payload_kg)
    columns["time_s"] = np.round(run.time_s[row, point], 2)
    columns["simulated"] = np.full(len(row), "yes", dtype=object)
    return pd.DataFrame(columns)


def files(run, plan, cell, out, robot):
    """Contents of the measurement file and of the truth beside it.

    Parameters
    ----------
    run : Run
    plan : Plan
    cell : Cell
    out : Path
        The measurement file.
    robot : str

    Returns
    -------
    dict of str to bytes
        File name -> content.
    """
    from scipy.spatial.transform import Rotation

    data = measurement_table(run, plan, cell.arm).to_csv(index=False, lineterminator="\n").encode()
    document = {
        "simulated": True,
        "note": "What the virtual cell hides; the identification never reads this file.",
        "made_by": "irbcal simulate",
        "robot": robot,
        "data": out.name,
        "data_sha256": hashlib.sha256(data).hexdigest(),
        "plan": Path(plan.source).name,
        "plan_sha256": plan.sha256,
        "units": "mm and degrees; base_*: the base link in the tracker's frame (eq. 3.5); target_*: in the tip link",
        "stiffness_is": "the two numbers that describe joints 2 and 3 best; the effect compliance says what they do",
        **cell.truth(),
        "unseen": run.unseen,
        "poses_are": "true tip poses in the base link, in the order of the run: x_mm, y_mm, z_mm, qw, qx, qy, qz",
    }
    xyzw = Rotation.from_matrix(run.T_base_tip[:, :3, :3]).as_quat(canonical=True)
    rows = np.round(np.column_stack([run.T_base_tip[:, :3, 3] / MM, xyzw[:, 3], xyzw[:, :3]]), 9).tolist()
    poses = ",\n".join(f"  {row}" for row in rows)
    truth = json.dumps(document, indent=1, ensure_ascii=False).removesuffix("\n}")
    return {out.name: data, truth_name(out): f'{truth},\n "poses": [\n{poses}\n ]\n}}\n'.encode()}


def truth_name(out):
    """Name of the truth's file beside a measurement file."""
    return f"{Path(out).stem}.truth.json"


def misses(run, wanted, calibration):
    """Distances of the measured targets from where a program wanted them.

    Wanted is what the controller's nominal arm means by its joints, in the base and with the tool of a calibration.

    Parameters
    ----------
    run : Run
    wanted : ndarray, shape (n, joints)
        Joints of the uncorrected program, radians (metres for prismatic joints).
    calibration : Record

    Returns
    -------
    ndarray, shape (m,)
        Metres, for the targets that were seen and that the calibration knows. Where the calibration has references,
        each pose is registered to them first.

    Raises
    ------
    MeasurementError
        If the programs differ in length or no target is known.
    """
    from irbcal.measurement.registration import register

    if len(wanted) != len(run.q):
        raise MeasurementError(f"the wanted program has {len(wanted)} poses, the simulated one {len(run.q)}")
    robot = calibration.robot_calibrated()
    robot = robot.replace(
        arm=calibration.arm(calibrated=False), joint_map=type(robot.joint_map)(np.zeros(wanted.shape[1]))
    )
    xyz, places = run.xyz[:, : run.targets], calibration.reference_places()
    found = places and register(run.xyz[:, run.targets :], run.names[run.targets :], "simulated points", places)
    if found:
        T = found.T_frame_pose
        xyz = np.einsum("nij,nkj->nki", T[:, :3, :3], xyz) + T[:, None, :3, 3]
    known = [k for k, name in enumerate(run.names[: run.targets]) if name in robot.targets]
    if not known:
        raise MeasurementError(f"the calibration knows none of the targets {', '.join(run.names[: run.targets])}")
    off = np.concatenate([np.linalg.norm(xyz[:, k] - robot.points(wanted, run.names[k]), axis=1) for k in known])
    return off[np.isfinite(off)]
