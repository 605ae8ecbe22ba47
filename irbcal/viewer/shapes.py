"""Bodies of a view: triangles, and a robot's links and joints as they are drawn, read from its URDF.

Bodies are arrays of triangles, shape (m, 3, 3), in metres, counter-clockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import FloatArray, IntArray, Locked
from irbcal.io.urdf import UrdfArm
from irbcal.io.urdf_xml import XmlElement
from irbcal.modeling import frames

SEGMENTS = 32
CREASE = np.cos(np.radians(38.0))
"""Cosine of the largest angle between faces that are shaded as one smooth surface."""

MOST_FACES_AT_A_CORNER = 64


def colours(*texts: str) -> list[FloatArray]:
    """Red, green and blue (3,) from 0 to 1 of texts such as ``#c98a1b``."""
    return [np.array([int(text[k : k + 2], 16) for k in (1, 3, 5)]) / 255 for text in texts]


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Locked):
    """An indexed mesh as the graphics card takes it."""

    vertices: NDArray[np.float32]
    """Shape (n, 3). Metres."""
    normals: NDArray[np.int8]
    """Shape (n, 3). Unit normals times 127."""
    colours: NDArray[np.uint8]
    """Shape (n, 3)."""
    faces: NDArray[np.uint32]
    """Shape (m, 3)."""


def smooth(triangles: FloatArray, colours: FloatArray) -> Mesh:
    """Weld triangles into a mesh whose normals are smooth but for edges sharper than 38 degrees.

    Parameters
    ----------
    triangles : ndarray, shape (m, 3, 3)
    colours : ndarray, shape (m, 3)
        Red, green, blue in 0 to 1.
    """
    across = frames.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(across, axis=1)
    keep = area > 0
    triangles, colours, across, area = triangles[keep], colours[keep], across[keep], area[keep]
    unit = across / area[:, None]
    corners = triangles.reshape(-1, 3).astype(np.float32)
    vertex = _equal_rows(corners)
    face = np.repeat(np.arange(len(triangles)), 3)
    normals = _corner_normals(vertex, face, across, unit)
    packed = np.rint(127 * normals).astype(np.int8)
    palette, colour = np.unique(np.rint(255 * colours).astype(np.uint8), axis=0, return_inverse=True)
    key = vertex.astype(np.int64) * len(palette) + colour.reshape(-1)[face]
    for axis in range(3):
        key = (key << 8) | (packed[:, axis].astype(np.int64) + 128)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    return Mesh(
        corners[first],
        packed[first],
        palette[colour.reshape(-1)[face[first]]],
        index.reshape(-1, 3).astype(np.uint32),
    )


FEWEST_TRIANGLES = 60
"""Bodies of one colour keep at least so many."""


def coarser(mesh: Mesh, share: float) -> Mesh:
    """A mesh with about this share of the triangles, the bodies of each colour by themselves.

    Edges are collapsed where the squared distances from the planes around them grow least (Garland and Heckbert 1997).
    """
    import fast_simplification

    corners = mesh.vertices[mesh.faces]
    palette, colour = np.unique(mesh.colours[mesh.faces[:, 0]], axis=0, return_inverse=True)
    bodies, colours = [], []
    for k, rgb in enumerate(palette):
        body = corners[colour.reshape(-1) == k]
        fewer = max(int(share * len(body)), FEWEST_TRIANGLES)
        if fewer < len(body):
            points = body.reshape(-1, 3)
            vertex = _equal_rows(points)
            _, first = np.unique(vertex, return_index=True)
            places, faces = fast_simplification.simplify(points[first], vertex.reshape(-1, 3), target_count=fewer)
            body = places[faces]
        bodies.append(body)
        colours.append(np.broadcast_to(rgb / 255, (len(body), 3)))
    return smooth(np.concatenate(bodies).astype(float), np.concatenate(colours))


def _equal_rows(rows: NDArray[np.float32]) -> IntArray:
    """A number for each row, the same for equal rows."""
    number = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:  # as whole numbers, which sort faster than rows
        values, place = np.unique(column, return_inverse=True)
        number = np.unique(number * len(values) + place, return_inverse=True)[1]
    return number


def _corner_normals(vertex: IntArray, face: IntArray, across: FloatArray, unit: FloatArray) -> FloatArray:
    """Mean of the normals of the faces at each corner that are not across a sharp edge, weighted by area."""
    order = np.argsort(vertex, kind="stable")
    count = np.bincount(vertex)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    total = across[face].copy()  # corners with very many faces keep their own
    simple = count[vertex] <= MOST_FACES_AT_A_CORNER
    rows = np.flatnonzero(simple)
    repeats = count[vertex[rows]]
    corner = np.repeat(rows, repeats)
    within = np.arange(len(corner)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    neighbour = face[order[np.repeat(start[vertex[rows]], repeats) + within]]
    near = np.einsum("ij,ij->i", unit[face[corner]], unit[neighbour]) > CREASE
    for axis in range(3):
        summed = np.bincount(corner[near], across[neighbour[near], axis], len(face))
        total[simple, axis] = summed[simple]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.where(length > 0, length, 1.0), unit[face])


def box(size: ArrayLike) -> FloatArray:
    """A box about the origin with edges ``size`` (3,)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = 0.5 * signs * np.asarray(size, dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return corners[np.array([[[a, b, c], [a, c, d]] for a, b, c, d in quads]).reshape(-1, 3)]


def _turned(profile: ArrayLike, segments: int = SEGMENTS) -> FloatArray:
    """The body of revolution about z of a profile (k, 2) of radius and height, from bottom to top."""
    angle = 2 * np.pi * np.arange(segments + 1) / segments
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    ring[-1] = ring[0]
    points = np.array([np.column_stack([r * ring, np.full(segments + 1, z)]) for r, z in np.asarray(profile, float)])
    a, b = points[:-1, :-1], points[:-1, 1:]
    c, d = points[1:, 1:], points[1:, :-1]
    return np.concatenate([np.stack(triangle, axis=-2).reshape(-1, 3, 3) for triangle in ((a, b, c), (a, c, d))])


def cylinder(radius: float, length: float) -> FloatArray:
    """A closed cylinder about z, its centre in the origin."""
    h = length / 2
    return _turned([(0, -h), (radius, -h), (radius, h), (0, h)])


def cone(bottom: float, top: float, low: float, high: float) -> FloatArray:
    """A closed frustum about z with radii ``bottom`` at height ``low`` and ``top`` at ``high``."""
    return _turned([(0, low), (bottom, low), (top, high), (0, high)])


def sphere(radius: float) -> FloatArray:
    """A sphere about the origin."""
    return capsule(radius, 0.0)


def capsule(radius: float, length: float) -> FloatArray:
    """A cylinder about z of this length with half spheres on its ends."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
    shift = np.where(angle < -1e-9, -length / 2, length / 2)
    profile = np.column_stack([radius * np.cos(angle), radius * np.sin(angle) + shift])
    if length:
        profile = np.insert(profile, 8, [radius, -length / 2], axis=0)
    profile[[0, -1], 0] = 0.0
    return _turned(profile)


def rod(start: ArrayLike, end: ArrayLike, radius: float) -> FloatArray:
    """A capsule between two points (3,)."""
    ends = np.array([start, end], dtype=float)
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    z = along / length if length else np.array([0.0, 0.0, 1.0])
    x = frames.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    R = np.column_stack([x, frames.cross(z, x), z])
    return capsule(radius, length) @ R.T + ends.mean(axis=0)


def moved(triangles: FloatArray, xyz: ArrayLike) -> FloatArray:
    """The same body at another place."""
    return triangles + np.asarray(xyz, dtype=float)


JointKind: TypeAlias = Literal["fixed", "revolute", "prismatic"]

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Link(Locked):
    """A link and the joint that carries it."""

    name: str
    parent: int
    """Place of the parent link in the list; -1 for the root."""
    T_parent_joint: FloatArray
    """Shape (4, 4)."""
    kind: JointKind = "fixed"
    """``fixed``, ``revolute`` (continuous ones too) or ``prismatic``."""
    axis: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Shape (3,)."""
    joint: int = -1
    """Which of the arm's joints moves it; -1 for none."""
    factor: float = 1.0
    offset: float = 0.0
    """Joint value is ``factor * q[joint] + offset`` (mimic joints)."""


def links(urdf: UrdfArm) -> tuple[Link, ...]:
    """All links of a robot, parents first.

    Returns
    -------
    tuple of Link
        The first is the root; of an arm whose base moves it is the base link. Joints that are not the arm's own stand
        at zero.
    """
    index = {name: k for k, name in enumerate(urdf.arm.joint_names)}
    by_parent: dict[str, list[XmlElement]] = {}
    way_up: dict[str, XmlElement] = {}
    for element in urdf.tree.getroot().findall("joint"):
        by_parent.setdefault(element.find("parent").get("link"), []).append(element)
        way_up[element.find("child").get("link")] = element
    if not urdf.arm.joints_up:
        way_up = {}
    out = [Link(urdf.arm.base_link if urdf.arm.joints_up else urdf.root_link, -1, np.eye(4))]
    walked: set[XmlElement] = set()
    for number, link in enumerate(out):  # the list grows while it is walked
        if link.name in way_up and way_up[link.name] not in walked:
            element = way_up[link.name]
            walked.add(element)
            down = _link(element, number, index)
            # the joint's motion reversed, then the parent link behind it
            out.append(replace(down, name=f"{element.get('name')} reversed", T_parent_joint=np.eye(4), axis=-down.axis))
            parent = element.find("parent").get("link")
            out.append(Link(parent, len(out) - 1, frames.inverse(down.T_parent_joint)))
        for element in by_parent.get(link.name, ()):
            if element not in walked:
                walked.add(element)
                out.append(_link(element, number, index))
    return tuple(out)


def _link(element: XmlElement, parent: int, index: Mapping[str, int]) -> Link:
    kind = element.get("type")
    name = element.get("name")
    axis = element.find("axis")
    along = vector((axis.get("xyz") if axis is not None else None) or "1 0 0", 3)
    joint, factor, offset = index.get(name, -1), 1.0, 0.0
    mimic = element.find("mimic")
    if mimic is not None and joint < 0:
        joint = index.get(mimic.get("joint"), -1)
        try:
            factor = float(vector(mimic.get("multiplier") or "1", 1)[0])
            offset = float(vector(mimic.get("offset") or "0", 1)[0])
        except ValueError:
            joint = -1  # a mimic that makes no sense stands still
    if kind not in MOVING:
        kind = "fixed"
    return Link(
        element.find("child").get("link"),
        parent,
        origin(element),
        "prismatic" if kind == "prismatic" else "fixed" if kind == "fixed" else "revolute",
        along / (np.linalg.norm(along) or 1.0),
        joint,
        factor,
        offset,
    )


def reach(tree: Sequence[Link]) -> float:
    """Length of the longest chain of joint origins, metres: the scale of the robot."""
    lengths: list[float] = []
    for link in tree:
        length = lengths[link.parent] if link.parent >= 0 else 0.0
        lengths.append(length + float(np.linalg.norm(link.T_parent_joint[:3, 3])))
    return max(max(lengths), 0.1)


def vector(text: str | None, count: int) -> FloatArray:
    """So many finite numbers of a URDF's text; ValueError for anything else."""
    values = np.array([float(word) for word in (text or "").split()])
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"expected {count} numbers, found {text!r}")
    return values


def origin(element: XmlElement) -> FloatArray:
    """The ``origin`` in an element of a URDF; identity without one."""
    child = element.find("origin")
    if child is None:
        return np.eye(4)
    return frames.transform(
        frames.matrix_from_rpy(vector(child.get("rpy") or "0 0 0", 3)), vector(child.get("xyz") or "0 0 0", 3)
    )
