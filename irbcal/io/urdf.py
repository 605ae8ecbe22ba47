"""URDF to DHM and back.

Reading takes any chain of revolute and prismatic joints between a base and a tip link to a DHM table plus the
constant place of each link frame in its DHM frame. Writing patches the joint origins in the original XML
tree: with ``F_i`` the link frame in DHM frame i and ``S_i`` the corrected DHM step at zero joints, the
corrected origin of joint i is ``F_{i-1}^-1 S_i F_i``, so that axes, visuals, collisions and inertials keep
their place in their links. Everything else stays as it was. The XML itself is in `irbcal.io.urdf_xml`.

Base and tip may be on two branches of a tree. The chain then goes up from the base link to the link that both hang on,
and down to the tip. A joint on the way up moves its parent link against its child: it turns about the axis reversed,
and its origin, inverted, comes after its motion. So the step before joint i + 1 stands in the origin of joint i there.

A file ``NAME.coupling.yaml`` beside a URDF declares how its controller counts coupled joints.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, Locked
from irbcal.errors import OptionError, RobotError
from irbcal.io import robots, urdf_xml, xacro_file
from irbcal.io.urdf_xml import XmlElement, XmlTree
from irbcal.modeling import coupling, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.extraction import dhm_from_axes
from irbcal.names import check_names
from irbcal.option_values import excerpt
from irbcal.safe_files import read_bytes
from irbcal.wording import first_of

TIP_NAMES = ("tool0", "flange", "ee_link", "tcp")
LIKELY = re.compile(r"tool|tcp|flange|(^|_)ee(_|$)|(^|_)eef(_|$)|effector|tip|hand|wrist|mount", re.IGNORECASE)
"""Parts of names that links of tips bear."""
MOST_CANDIDATES = 12
"""Candidates that are named."""


def choose_tip(links: Sequence[str], above: Mapping[str, str], moved: Collection[str], source: str) -> str:
    """A robot's tip link: of a usual name, or the only one at the end of the longest chain of moving joints.

    Parameters
    ----------
    links : sequence of str
    above : dict of str to str
        The link that each one hangs on; the root on none.
    moved : collection of str
        The links whose joint moves.
    source : str
        File name for messages.

    Raises
    ------
    RobotError
        If it may be one of several; candidates are named, the likeliest first.
    """
    for name in TIP_NAMES:
        if name in links:
            return name
    ends = [link for link in links if link not in set(above.values())]
    chains = {link: _chain(link, above) for link in ends}
    deepest = max((sum(name in moved for name in chain) for chain in chains.values()), default=0)
    best = [link for link in ends if sum(name in moved for name in chains[link]) == deepest]
    if len(best) == 1:
        return best[0]
    listed = _likeliest_first([chains[link] for link in best], moved)
    raise RobotError(
        f"which link is the tip? candidates are {first_of(listed, MOST_CANDIDATES)}: name one of these, or a "
        "link before them, with --tip-link",
        file=source,
        parameter="tip_link",
    )


def _chain(link: str, above: Mapping[str, str]) -> list[str]:
    """The links from the root to this one."""
    chain = [link]
    while chain[-1] in above:
        chain.append(above[chain[-1]])
    return chain[::-1]


def _likeliest_first(chains: Sequence[Sequence[str]], moved: Collection[str]) -> list[str]:
    """Where the chains part (such as the hand before its fingers), then their ends: by name, then nearest first."""
    shared = 0
    while all(len(chain) > shared for chain in chains) and len({chain[shared] for chain in chains}) == 1:
        shared += 1
    together = list(chains[0][:shared])
    last = max((k for k, link in enumerate(together) if link in moved), default=len(together))
    trunk = together[last:][::-1]  # what is fixed to the last joint that all share, the outermost first
    ends = sorted((chain[-1], len(chain)) for chain in chains)
    ends.sort(key=lambda end: (not LIKELY.search(end[0]), end[1]))
    ordered = [*trunk, *(name for name, _ in ends)]
    return sorted(ordered, key=lambda name: not LIKELY.search(name))


COUPLING_ENDING = ".coupling.yaml"
LARGEST_COUPLING_FILE = 100_000
"""Bytes; no coupling needs more."""


NO_COUPLING = "none"
"""Given in place of a coupling: the controller counts as the URDF does, whatever a file says."""


def declared_coupling(urdf: Path, joints: int, terms: str | None) -> FloatArray | None:
    """The coupling of a robot.

    Parameters
    ----------
    urdf : Path
    joints : int
        Of the arm.
    terms : str or None
        As `irbcal.modeling.coupling.matrix` takes it, or ``none``; it goes before the file beside the URDF.

    Returns
    -------
    ndarray, shape (joints, joints), or None

    Raises
    ------
    RobotError
        If it, or the file, is not understood.
    """
    if terms is None:
        return coupling_beside(urdf, joints)
    if not isinstance(terms, str):
        raise OptionError(f"coupling: expected terms such as 3+2, found {excerpt(terms)}", parameter="coupling")
    return None if terms.strip().lower() == NO_COUPLING else coupling.matrix(terms, joints)


def coupling_beside(urdf: Path, joints: int) -> FloatArray | None:
    """The coupling declared beside a URDF, see `irbcal.modeling.coupling.matrix`; None where there is no file.

    Raises
    ------
    RobotError
        If there is a file that is not understood.
    """
    import yaml

    file = urdf.with_suffix(COUPLING_ENDING)
    if not file.is_file():
        return None
    try:
        with open(file, encoding="utf-8") as stream:
            content = yaml.safe_load(stream.read(LARGEST_COUPLING_FILE))
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise RobotError(f"expected a line such as 'coupling: 3+2' in YAML, found {error}", file=file) from None
    if not isinstance(content, dict) or set(content) != {"coupling"} or content["coupling"] is None:
        raise RobotError(f"expected a line such as 'coupling: 3+2', found {excerpt(content)}", file=file)
    return coupling.matrix(content["coupling"], joints, str(file))


LARGEST_ARM = 50.0
"""Metres: no arm is larger, nor are its links, tools and joint travels."""
MOST_JOINTS = 20
"""Joints of a chain; more is no arm."""
NO_LIMIT = 1e6
"""A limit beyond is none: some programs write 1e16."""
FINGERPRINT_TAG = "irbcal_calibration"


@dataclass(frozen=True, eq=False)
class UrdfArm(Locked):
    """A parsed URDF and the arm found in it."""

    arm: Arm
    tree: XmlTree
    """The original document; never changed, writing works on a copy."""
    joint_elements: tuple[int, ...]
    """Position of the chain's moving joints among the document's ``joint`` elements."""
    T_dhm_link: FloatArray
    """Shape (joints + 1, 4, 4). Link frame in its DHM frame: base link in frame 0, then the child link of each moving
    joint (at zero, fixed to the parent link, of a joint on the way up).
    """
    T_link_parent: FloatArray
    """Shape (joints, 4, 4). Parent link of each moving joint (child link of one on the way up) in the link frame before
    it (fixed joints in between).
    """
    child_links: tuple[str, ...]
    """Child link of each moving joint."""
    root_link: str
    T_root_base: FloatArray
    """Shape (4, 4)."""

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: the document as bytes."""
        return {**vars(self), "tree": urdf_xml.serialised(self.tree)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in {**state, "tree": urdf_xml.parse(state["tree"], "URDF")}.items():
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class JointElement:
    """A joint as its element says it."""

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: FloatArray
    axis: FloatArray
    lower: float
    upper: float
    mimic: bool
    position: int


def read_urdf(
    path: str | Path,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> UrdfArm:
    """Read a robot from a URDF or xacro file.

    Parameters
    ----------
    path : str or Path
        A file, or a robot's name, see `irbcal.io.robots.robots`; of a xacro file with arguments ``FILE NAME:=VALUE``.
    base_link : str, optional
        Base link of the arm: base_link or the root unless given.
    tip_link : str, optional
        Tip link of the arm: tool0, flange, ee_link, tcp or the last link unless given.
    coupling : str, optional
        How the controller counts joints: ``3+2`` adds joint 2 to its joint 3; ``none``: as the URDF. The file beside
        the URDF says it unless given.
    package_dirs : sequence of str or Path
        Folders in which packages of the robot's description are looked up first: of a xacro file, and of meshes.

    Raises
    ------
    RobotError
        If the file cannot be read safely or does not hold a serial arm.
    """
    entry = robots.named_robot(path)
    if entry is not None:
        base_link, tip_link = base_link or entry.base_link, tip_link or entry.tip_link
    file = robots.robot_file(path)
    robot_read = from_bytes(source_bytes(path, package_dirs), str(file), base_link, tip_link)
    declared = declared_coupling(file, len(robot_read.arm.joint_names), coupling)
    return robot_read if declared is None else replace(robot_read, arm=replace(robot_read.arm, coupling=declared))


read = read_urdf


def source_bytes(robot: str | Path, package_dirs: Sequence[str | Path] = ()) -> bytes:
    """The URDF of a file or a robot's name; a xacro file is expanded with packages of these folders, and others.

    Raises
    ------
    RobotError
        If the file cannot be read, or expanded safely.
    """
    file, arguments = robots.robot_file(robot), robots.xacro_arguments(robot)[1]
    data = read_bytes(file, RobotError)
    if xacro_file.is_xacro(data):
        return xacro_file.expanded(file, arguments, package_dirs)
    if arguments:
        raise RobotError(f"a URDF takes no arguments: leave out {next(iter(arguments))}:=", file=file)
    return data


@lru_cache(maxsize=32)  # commands look at the same file several times
def from_bytes(data: bytes, source: str, base: str | None = None, tip: str | None = None) -> UrdfArm:
    """As `read`, from the file's content; ``source`` names it in errors."""
    tree = urdf_xml.parse(data, source)
    root = tree.getroot()
    joints = _joints(root, source)
    links = [link.get("name") for link in root.findall("link")]
    for link in root.findall("link"):
        if link.get("name") is None:
            raise RobotError("a link needs a name", file=source, line=link.sourceline)
    check_names([root.get("name"), *links, *(joint.name for joint in joints)], RobotError, file=source)
    root_link = _check_structure(links, joints, source)
    by_child = {joint.child: joint for joint in joints}
    if base is None:
        base = "base_link" if "base_link" in links else root_link
    if tip is None:
        above = {link: joint.parent for link, joint in by_child.items()}
        tip = choose_tip(links, above, {link for link, joint in by_child.items() if joint.kind != "fixed"}, source)
    for name in (base, tip):
        if name not in links:
            raise RobotError(f"there is no link {name!r}; links are {', '.join(links)}", file=source)
    up, down = _path(base, tip, by_child)
    moving = _moving([*up, *down], base, tip, source)
    name = root.get("name") or Path(source).stem
    return _build(name, tree, up, down, moving, base, tip, root_link, by_child, source)


def _limits(element: XmlElement, kind: str, title: str, source: str) -> tuple[float, float]:
    limit = element.find("limit")
    if limit is not None and urdf_xml.numbers(limit.get("velocity", "0"), 1, f"{title}, limit velocity", source)[0] < 0:
        raise RobotError(f"{title}, limit velocity: expected no negative number", file=source)
    if kind not in ("revolute", "prismatic") or limit is None:
        return -np.inf, np.inf
    lower, upper = (
        float(urdf_xml.numbers(limit.get(key, "0"), 1, f"{title}, limit {key}", source)[0])
        for key in ("lower", "upper")
    )
    if lower > upper:
        raise RobotError(f"{title}: expected limits from below, found {lower:g} and {upper:g}", file=source)
    return (lower if lower > -NO_LIMIT else -np.inf), (upper if upper < NO_LIMIT else np.inf)


def _joints(root: XmlElement, source: str) -> list[JointElement]:
    joints = []
    for position, element in enumerate(root.findall("joint")):
        name, kind = element.get("name"), element.get("type")
        title = f"joint {name!r}"
        ends = [element.find(tag) for tag in ("parent", "child")]
        if name is None or kind is None or None in ends or any(end.get("link") is None for end in ends):
            line_number = element.sourceline
            raise RobotError("a joint needs a name, a type, a parent and a child link", file=source, line=line_number)
        axis_element = element.find("axis")
        axis_text = "1 0 0" if axis_element is None else axis_element.get("xyz", "1 0 0")
        axis = urdf_xml.numbers(axis_text, 3, f"{title}, axis", source)
        longest = np.abs(axis).max()
        axis = axis / longest if longest else axis  # so that no square overflows
        length = np.linalg.norm(axis)
        if kind in ("revolute", "continuous", "prismatic") and longest < 1e-6:
            raise RobotError(f"{title}: the axis has no direction: {axis_text!r}", file=source)
        joints.append(
            JointElement(
                name,
                kind,
                ends[0].get("link"),
                ends[1].get("link"),
                urdf_xml.origin(element, title, source),
                axis / length if length else axis,
                *_limits(element, kind, title, source),
                element.find("mimic") is not None,
                position,
            )
        )
    return joints


def _check_structure(links: Sequence[str], joints: Sequence[JointElement], source: str) -> str:
    """One root, no cycles, every joint between known links; returns the root link."""
    for names, kind in ((links, "link"), ([joint.name for joint in joints], "joint")):
        double = sorted({name for name in names if names.count(name) > 1}, key=str)
        if double:
            raise RobotError(f"{kind} name {double[0]!r} is used {names.count(double[0])} times", file=source)
    parent: dict[str, str] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise RobotError(f"joint {joint.name!r} names a link {end!r} that does not exist", file=source)
        if joint.child in parent:
            raise RobotError(f"link {joint.child!r} has two parent joints: not a tree", file=source)
        parent[joint.child] = joint.parent
    roots = [link for link in links if link not in parent]
    if len(roots) != 1:
        roots_text = ", ".join(roots) or "none: the joints form a cycle"
        raise RobotError(f"expected exactly one root link, found {roots_text}", file=source)
    for link in links:
        visited = {link}
        while link in parent:
            link = parent[link]
            if link in visited:
                raise RobotError(f"the joints form a cycle through link {link!r}", file=source)
            visited.add(link)
    return roots[0]


def _path(base: str, tip: str, by_child: Mapping[str, JointElement]) -> tuple[list[JointElement], list[JointElement]]:
    """Joints from the base link up to the link that base and tip hang on, and from there down to the tip."""
    up, down = (_above(link, by_child) for link in (base, tip))
    while up and down and up[-1] is down[-1]:
        up.pop()
        down.pop()
    return up, down[::-1]


def _above(link: str, by_child: Mapping[str, JointElement]) -> list[JointElement]:
    """Joints between a link and the root, from the link on."""
    joints = []
    while link in by_child:
        joints.append(by_child[link])
        link = by_child[link].parent
    return joints


def _moving(path: Sequence[JointElement], base: str, tip: str, source: str) -> list[JointElement]:
    moving = [joint for joint in path if joint.kind != "fixed"]
    listed = ", ".join(f"{joint.name} ({joint.kind})" for joint in moving) or "none"
    unsupported = [joint for joint in moving if joint.kind not in ("revolute", "continuous", "prismatic")]
    if not 2 <= len(moving) <= MOST_JOINTS or unsupported:
        raise RobotError(
            f"expected 2 to {MOST_JOINTS} revolute or prismatic joints between {base!r} and {tip!r}, "
            f"found {len(moving)} moving joints: {listed}",
            file=source,
        )
    for joint in moving:
        if joint.mimic:
            raise RobotError(f"joint {joint.name!r} mimics another joint, expected independent ones", file=source)
    return moving


def _build(
    name: str,
    tree: XmlTree,
    up: Sequence[JointElement],
    down: Sequence[JointElement],
    moving: Sequence[JointElement],
    base: str,
    tip: str,
    root_link: str,
    by_child: Mapping[str, JointElement],
    source: str,
) -> UrdfArm:
    """DHM table and link offsets of the chain at zero joints."""
    T = np.eye(4)
    link_frames, parent_frames = [np.eye(4)], []
    for k, joint in enumerate((*up, *down)):
        if joint in moving:
            parent_frames.append(frames.inverse(link_frames[-1]) @ T)
        T_child = T if k < len(up) else T @ joint.T_parent_joint
        if joint in moving:
            link_frames.append(T_child)
        T = T @ frames.inverse(joint.T_parent_joint) if k < len(up) else T_child
    points = np.array([link[:3, 3] for link in link_frames[1:]])
    joints_up = sum(joint in moving for joint in up)
    signs = np.where(np.arange(len(moving)) < joints_up, -1.0, 1.0)
    axes = np.array([T_link[:3, :3] @ joint.axis for T_link, joint in zip(link_frames[1:], moving, strict=True)])
    axes = axes * signs[:, None]
    slides = [joint.kind == "prismatic" for joint in moving]
    table, T_base_0, T_last_tip = dhm_from_axes(points, axes, T, slides)
    arm = Arm(
        name,
        table,
        T_base_0,
        T_last_tip,
        tuple(joint.name for joint in moving),
        np.array([joint.lower for joint in moving]),
        np.array([joint.upper for joint in moving]),
        base,
        tip,
        joints_up=joints_up,
    )
    T_base_dhm = [T_base_0]
    for i in range(len(moving)):
        T_base_dhm.append(T_base_dhm[-1] @ table.step(i))
    T_dhm_link = np.array([frames.inverse(D) @ L for D, L in zip(T_base_dhm, link_frames, strict=True)])
    if np.abs(T_base_dhm[-1] @ T_last_tip - T).max() > 1e-9 or np.abs(T_dhm_link[1:, :2, 3]).max() > 1e-9:
        raise AssertionError(f"{source}: the DHM table does not give the URDF's zero pose back")
    T_root_base, link = np.eye(4), base
    while link in by_child:
        T_root_base = by_child[link].T_parent_joint @ T_root_base
        link = by_child[link].parent
    size = np.abs([link[:3, 3] for link in link_frames]).max()
    if size > LARGEST_ARM:
        raise RobotError(
            f"the arm is {size:.0f} m large: a URDF is in metres, is this one in millimetres?", file=source
        )
    positions = tuple(joint.position for joint in moving)
    children = tuple(joint.child for joint in moving)
    return UrdfArm(arm, tree, positions, T_dhm_link, np.array(parent_frames), children, root_link, T_root_base)


def joint_origins(urdf: UrdfArm, arm: Arm) -> dict[str, FloatArray]:
    """Joint origins that give the moving joints of an arm's chain another DHM table.

    Parameters
    ----------
    urdf : UrdfArm
        As read.
    arm : Arm
        The corrected arm: same frames 0 and tip, another DHM table; or ``urdf.arm`` itself.

    Returns
    -------
    dict of str to ndarray, shape (4, 4)
        Joint name -> joint frame in its parent link; exactly as read where the table's row is as read.
    """
    up, F = urdf.arm.joints_up, urdf.T_dhm_link
    old, new = (
        [frames.inverse(F[i]) @ each.table.step(i) @ F[i + 1] for i in range(len(F) - 1)] for each in (urdf.arm, arm)
    )
    if up and not np.array_equal(old[0], new[0]):
        new[1] = _past_first_joint(urdf, frames.inverse(old[0]) @ new[0]) @ new[1]
    origins = {}
    for i, position in enumerate(urdf.joint_elements):
        element = urdf.tree.getroot().findall("joint")[position]
        name = element.get("name")
        origin = urdf_xml.origin(element, f"joint {name!r}", "")
        if i >= up and not np.array_equal(old[i], new[i]):
            origin = frames.inverse(urdf.T_link_parent[i]) @ new[i]
        elif i < up - 1 and not np.array_equal(old[i + 1], new[i + 1]):
            origin = origin @ old[i + 1] @ frames.inverse(new[i + 1])
        origins[name] = origin
    return origins


def _past_first_joint(urdf: UrdfArm, T: FloatArray) -> FloatArray:
    """What a corrected place of the first joint, one on the way up, does after the joint's motion.

    Raises
    ------
    RobotError
        If it is no motion about and along the joint's axis: no origin in the URDF says where in the base link it is.
    """
    z = urdf.T_dhm_link[1, 2, :3]  # the axis in the link frame
    if np.abs(T[:3, :3] @ z - z).max() > 1e-12 or np.abs(frames.cross(T[:3, 3], z)).max() > 1e-12:
        raise RobotError(
            f"a URDF cannot hold another place of joint {urdf.arm.joint_names[0]} in {urdf.arm.base_link}: hold the "
            "parameters of joint 1"
        )
    return T


def with_joint_origins(data: bytes, origins: Mapping[str, FloatArray]) -> bytes:
    """A URDF with other joint origins; all else as it was.

    Parameters
    ----------
    data : bytes
        The URDF.
    origins : dict of str to ndarray, shape (4, 4)
        Joint name -> joint frame in its parent link; joints not named stay as they are.
    """
    tree = urdf_xml.parse(data, "URDF")
    for element in tree.getroot().findall("joint"):
        if element.get("name") in origins:
            urdf_xml.set_origin(element, origins[element.get("name")])
    return urdf_xml.serialised(tree)


def with_tip_moved(data: bytes, source: str, tip: str, T_tip_new: FloatArray) -> bytes | None:
    """A URDF whose fixed joint at the tip puts the tip link elsewhere, all else as it was.

    Parameters
    ----------
    data : bytes
        The URDF.
    source : str
        Its name, for messages.
    tip : str
        The tip link.
    T_tip_new : ndarray, shape (4, 4)
        The new tip link in the old one.

    Returns
    -------
    bytes or None
        None if the tip link hangs on a joint that moves.
    """
    tree = urdf_xml.parse(data, source)
    for element in tree.getroot().findall("joint"):
        if element.find("child").get("link") == tip and element.get("type") == "fixed":
            urdf_xml.set_origin(element, urdf_xml.origin(element, f"joint {element.get('name')!r}", source) @ T_tip_new)
            return urdf_xml.serialised(tree)
    return None


def fingerprint(data: bytes, source: str) -> str | None:
    """Fingerprint of the calibration that wrote a URDF; None where there is none.

    Raises
    ------
    RobotError
        If the file is not a URDF.
    """
    element = urdf_xml.parse(data, source).getroot().find(FINGERPRINT_TAG)
    return None if element is None else element.get("fingerprint")


def to_bytes(
    urdf: UrdfArm,
    arm: Arm,
    mark: str | None = None,
    comment: str | None = None,
) -> bytes:
    """The URDF with corrected joint origins.

    Parameters
    ----------
    urdf : UrdfArm
        As read.
    arm : Arm
        The corrected arm: same frames 0 and tip, another DHM table.
    mark : str, optional
        Fingerprint of the calibration, written into an element that readers of URDF pass over.
    comment : str, optional
        What the file is, written as its first comment in place of that of an earlier calibration.
    """
    from lxml import etree

    tree = copy.deepcopy(urdf.tree)
    root = tree.getroot()
    elements = root.findall("joint")
    nominal, corrected = joint_origins(urdf, urdf.arm), joint_origins(urdf, arm)
    for position in urdf.joint_elements:
        name = elements[position].get("name")
        if not np.array_equal(nominal[name], corrected[name]):
            urdf_xml.set_origin(elements[position], corrected[name])
    if mark is not None:
        for old in root.findall(FINGERPRINT_TAG):
            root.remove(old)
        element = etree.SubElement(root, FINGERPRINT_TAG, fingerprint=mark)
        if element.getprevious() is not None:
            element.getprevious().tail = "\n  "
        element.tail = "\n"
    if comment is not None:
        urdf_xml.begin_with(root, comment)
    return urdf_xml.serialised(tree)


def without_mark(data: bytes) -> bytes:
    """A URDF without the fingerprint of a calibration."""
    tree = urdf_xml.parse(data, "URDF")
    for element in tree.getroot().findall(FINGERPRINT_TAG):
        tree.getroot().remove(element)
    return urdf_xml.serialised(tree)


def with_links(
    data: bytes, arm: Arm, T_world_base: FloatArray | None = None, targets: Mapping[str, FloatArray] | None = None
) -> bytes:
    """A URDF with links more.

    Parameters
    ----------
    data : bytes
    arm : Arm
        Its base and tip link.
    T_world_base : ndarray, shape (4, 4), optional
        Adds a link ``world`` (the measuring frame) and a fixed joint to the root; to the base link where it moves.
    targets : dict of str to ndarray, shape (3,), optional
        Adds a link ``target_NAME`` for each reflector, fixed to the tip; metres.
    """
    if T_world_base is None and not targets:
        return data
    urdf = from_bytes(data, f"URDF of {arm.name}", arm.base_link, arm.tip_link)
    tree = copy.deepcopy(urdf.tree)
    root = tree.getroot()
    names = {element.get("name") for element in root.iter("link", "joint")}
    if T_world_base is not None:
        world = next(name for name in ("world", "measuring_frame", "irbcal_world") if name not in names)
        T = T_world_base @ frames.inverse(urdf.T_root_base)
        if urdf.arm.joints_up:  # the root moves in the measuring frame, the base link does not
            urdf_xml.add_joint(root, urdf.arm.base_link, world, frames.inverse(T_world_base))
        else:
            urdf_xml.add_joint(root, world, urdf.root_link, T, new_link=world)
    for name, xyz in (targets or {}).items():
        link = f"target_{name}"
        if link not in names:
            urdf_xml.add_joint(root, arm.tip_link, link, frames.transform(None, xyz))
    return urdf_xml.serialised(tree)


def largest_link_shift(urdf: UrdfArm, arm: Arm) -> float:
    """How far corrected joint origins move any link frame at zero joints, metres.

    Parameters
    ----------
    urdf : UrdfArm
        As read.
    arm : Arm
        The corrected arm.
    """
    old = new = urdf.arm.T_base_0
    largest = 0.0
    for i, T_dhm_link in enumerate(urdf.T_dhm_link[1:]):
        old, new = old @ urdf.arm.table.step(i), new @ arm.table.step(i)
        largest = max(largest, float(np.linalg.norm((old @ T_dhm_link)[:3, 3] - (new @ T_dhm_link)[:3, 3])))
    return float(largest)


def speed_limits(urdf: bytes, names: Sequence[str]) -> FloatArray:
    """Largest speeds of joints.

    Returns
    -------
    ndarray, shape (joints,)
        Radians (metres for prismatic joints) per second; infinite where the URDF says none, or zero.
    """
    limits = {
        joint.get("name"): float(limit.get("velocity", "0"))
        for joint in urdf_xml.parse(urdf, "calibrated.urdf").getroot().findall("joint")
        if (limit := joint.find("limit")) is not None
    }
    speeds = np.array([limits.get(name, 0.0) for name in names])
    return np.where(speeds > 0.0, speeds, np.inf)
