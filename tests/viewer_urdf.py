"""An arm of six joints whose first link looks as a test wants it."""

import struct

import numpy as np

from irbcal.io import urdf
from irbcal.modeling import frames
from irbcal.viewer import building, shapes

JOINTS = "".join(
    f'<link name="l{k}"/><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
    f'<origin xyz="{0.1 * k:.1f} 0 0.2" rpy="0.1 {0.2 * k:.1f} 0"/><axis xyz="{axis}"/>'
    '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    for k, axis in enumerate(["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"], start=1)
)


def document(visuals, extra=""):
    """An arm of six joints whose first link has these visuals."""
    data = f'<robot name="arm"><link name="l0">{visuals}</link>{JOINTS}{extra}</robot>'.encode()
    return urdf.from_bytes(data, "arm.urdf", "l0", "l6")


def link_poses(tree, q, T_base_root=None):
    """Places (links, 4, 4) of all links for one set of effective joints, as the page computes them."""
    out = []
    for link in tree:
        value = (link.factor * q[link.joint] if link.joint >= 0 else 0.0) + link.offset
        T = link.T_parent_joint
        if link.kind == "revolute":
            T = T @ frames.transform(frames.rotation_from_vector(value * link.axis))
        elif link.kind == "prismatic":
            T = T @ frames.transform(None, link.axis * value)
        root = np.eye(4) if T_base_root is None else T_base_root
        out.append((out[link.parent] if link.parent >= 0 else root) @ T)
    return np.array(out)


def mesh(name, more=""):
    return f'<visual><geometry><mesh filename="{name}" {more}/></geometry></visual>'


def looks(visuals, folder, package_dirs=(), extra=""):
    arm = document(visuals, extra)
    return building.link_meshes(arm, shapes.links(arm), folder, package_dirs)


def write_stl(path, triangles):
    """A binary STL, by hand."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = b"\0" * 80 + struct.pack("<I", len(triangles))
    for triangle in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *np.ravel(triangle), 0)
    path.write_bytes(data)
    return path
