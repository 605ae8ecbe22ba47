"""The shipped robots' collision shapes by means of their own: URDF by hand, trimesh, linear programmes, half-spaces."""

import functools
import xml.etree.ElementTree as ET

import numpy as np
import trimesh
from scipy.optimize import linprog

from irbcal.io import robots


@functools.cache
def hulls(name):
    """(link, convex hull in the link's frame) of each collision element, read with trimesh."""
    root = ET.parse(robots.robot_file(name)).getroot()
    out = []
    for link in root.findall("link"):
        for mesh in link.findall("collision/geometry/mesh"):
            path = robots.urdf_folder() / mesh.get("filename").removeprefix("package://")
            out.append((link.get("name"), trimesh.load_mesh(path).convex_hull))
    return out


@functools.cache
def joints(name):
    root = ET.parse(robots.robot_file(name)).getroot()
    return [
        (
            joint.find("parent").get("link"),
            joint.find("child").get("link"),
            np.array(joint.find("origin").get("xyz").split(), dtype=float),
            np.array(joint.find("axis").get("xyz").split(), dtype=float),
        )
        for joint in root.findall("joint")
        if joint.get("type") == "revolute"
    ]


def link_frames(name, q):
    """Link frames in the base link from the URDF's joints alone: at zero joints all are parallel to the base."""
    T = {"base_link": np.eye(4)}
    for value, (parent, child, origin, axis) in zip(q, joints(name), strict=True):
        T[child] = T[parent] @ trimesh.transformations.translation_matrix(origin)
        T[child] = T[child] @ trimesh.transformations.rotation_matrix(value, axis)
    return T


def touch(A, B):
    """Whether two convex hulls of points have a point in common: a linear programme."""
    if (A.min(0) > B.max(0)).any() or (B.min(0) > A.max(0)).any():
        return False
    a, b = len(A), len(B)
    equal = np.block([[A.T, -B.T], [np.ones((1, a)), np.zeros((1, b))], [np.zeros((1, a)), np.ones((1, b))]])
    return linprog(np.zeros(a + b), A_eq=equal, b_eq=[0, 0, 0, 1, 1]).status == 0


def touches_itself(name, q):
    order = {link: k for k, link in enumerate(["base_link", *(child for _, child, _, _ in joints(name))])}
    T = link_frames(name, q)
    solids = [(order[link], trimesh.transform_points(hull.vertices, T[link])) for link, hull in hulls(name)]
    return any(touch(A, B) for k, (i, A) in enumerate(solids) for j, B in solids[:k] if abs(i - j) > 1)


def within(hull, T, start, end, wider):
    """Whether a segment meets a hull whose planes are moved outwards: the interval of its points that do."""
    R, p = T[:3, :3], T[:3, 3]
    start, end = (start - p) @ R, (end - p) @ R
    normal = hull.face_normals
    offset = np.sum(normal * hull.triangles[:, 0], axis=1) + wider
    at, slope = offset - normal @ start, normal @ (end - start)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = at / slope
    low = max(0.0, np.max(t[slope < 0], initial=0.0))
    high = min(1.0, np.min(t[slope > 0], initial=1.0))
    return low <= high and (at[slope == 0] >= 0).all()
