"""What a robot's links look like: the visual geometry of its URDF as triangles.

Meshes become triangles here, in Python: the page that is sent to a colleague holds numbers only, no files, and nothing
in it is fetched.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.io.mesh_paths import MeshFolders, MeshProblem
from irbcal.io.urdf import UrdfArm
from irbcal.io.urdf_xml import XmlElement
from irbcal.viewer import shapes
from irbcal.viewer.links import Link, origin, reach, vector

MAX_MESH_BYTES = 100_000_000
MAX_TRIANGLES = 2_000_000
"""Triangles of a whole robot beyond which further visuals are left out."""

GREY = (0.78, 0.79, 0.80)


class MeshFinder(MeshFolders):
    """Finds and reads mesh files that a URDF names, inside the folders that it may read."""

    def read(self, uri: str, budget: int = MAX_TRIANGLES) -> tuple[FloatArray, FloatArray | None]:
        """Triangles of a mesh file.

        Parameters
        ----------
        uri : str
        budget : int
            Most triangles to take.

        Returns
        -------
        triangles : ndarray, shape (m, 3, 3)
            Metres.
        colours : ndarray, shape (m, 3), or None
            Red, green, blue in 0 to 1; None where the file has no colours.

        Raises
        ------
        Problem
            If the file cannot be found, may not be read or is not understood.
        """
        path = self.find(uri)
        try:
            data = path.read_bytes() if path.stat().st_size <= MAX_MESH_BYTES else None
        except OSError as error:
            raise MeshProblem(f"it cannot be read: {error.strerror}", path.name) from None
        if data is None:
            raise MeshProblem(f"it is larger than {MAX_MESH_BYTES // 1_000_000} MB", path.name)
        return _read_mesh(data, path.suffix.lower()[1:], path.name, budget)


def _read_mesh(data: bytes, ending: str, name: str, budget: int) -> tuple[FloatArray, FloatArray | None]:
    try:
        import trimesh

        if ending == "dae":
            import collada  # noqa: F401
    except ImportError as error:
        raise MeshProblem(f"reading {ending} meshes needs the package {error.name}", name) from None
    unit = 1.0
    if ending == "dae":
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
            raise MeshProblem("document types and entities are refused", name)
        unit_text = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([\d.eE+-]+)[\"']", data[:100_000])
        unit = float(unit_text[1]) if unit_text else 1.0
    try:
        # without a resolver nothing but these bytes is read: no textures, no material files
        scene = trimesh.load_scene(BytesIO(data), file_type=ending, process=False)
        meshes = list(_scene_parts(scene, budget))
    except MeshProblem:
        raise
    except Exception as error:  # whatever a parser raises on a damaged file
        raise MeshProblem(f"it is not a readable mesh ({type(error).__name__})", name) from None
    if not meshes:
        raise MeshProblem("there are no triangles in it", name)
    triangles = np.concatenate([mesh for mesh, _ in meshes]) * unit
    good = np.isfinite(triangles).all(axis=(1, 2))
    coloured = any(colour is not None for _, colour in meshes)
    colours = np.concatenate([np.broadcast_to(GREY if c is None else c, (len(t), 3)) for t, c in meshes])
    return triangles[good], colours[good] if coloured else None


def _scene_parts(scene: Any, budget: int) -> Iterator[tuple[FloatArray, FloatArray | None]]:
    for node in scene.graph.nodes_geometry:
        T, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not hasattr(mesh, "faces") or not len(mesh.faces):
            continue
        budget -= len(mesh.faces)
        if budget < 0:
            raise MeshProblem(f"the robot has more than {MAX_TRIANGLES:,} triangles", name)
        triangles = mesh.triangles @ np.asarray(T)[:3, :3].T + np.asarray(T)[:3, 3]
        yield triangles, _part_colours(mesh)


def _part_colours(mesh: Any) -> FloatArray | None:
    visual = mesh.visual
    if not visual.defined:
        return None
    if visual.kind == "texture":
        material = visual.material
        if getattr(material, "image", None) is not None:
            return None
        return np.asarray(material.main_color[:3], dtype=float) / 255
    return np.asarray(visual.face_colors[:, :3], dtype=float) / 255


Painted: TypeAlias = tuple[FloatArray, FloatArray]
"""Triangles, shape (m, 3, 3), and their colours, shape (m, 3)."""


def meshes(
    urdf: UrdfArm,
    tree: Sequence[Link],
    folder: str | PathLike[str] | None,
    package_dirs: Sequence[str | PathLike[str]] = (),
) -> tuple[dict[int, shapes.Mesh], list[str]]:
    """What each link looks like.

    Parameters
    ----------
    urdf : UrdfArm
    tree : sequence of Link
        As `irbcal.viewer.links.links` gives them.
    folder : Path or None
        Folder of the URDF; relative file names start there.
    package_dirs : sequence of str or Path
        Folders that hold ROS packages (or are one).

    Returns
    -------
    meshes : dict of int to Mesh
        By place of the link in the list.
    notes : list of str
        What could not be drawn, in one sentence at most.
    """
    root = urdf.tree.getroot()
    materials = {m.get("name"): _colour(m) for m in root.findall("material")}
    elements = {link.get("name"): link for link in root.findall("link")}
    finder = MeshFinder(folder, package_dirs)
    painted: dict[int, list[Painted]] = {}
    bare: set[int] = set()
    problems: dict[str, list[str]] = {}
    budget = MAX_TRIANGLES
    for k, link in enumerate(tree):
        for visual in elements[link.name].findall("visual"):
            try:
                triangles, colours = _visual(visual, materials, finder, budget)
            except MeshProblem as problem:
                problems.setdefault(problem.reason, []).append(problem.which)
                bare.add(k)
                continue
            budget -= len(triangles)
            painted.setdefault(k, []).append((triangles, colours))
    size = reach(tree)
    if not painted:
        bare = set(range(len(tree)))
    for k in sorted(bare - set(painted)):
        rod = _rods(tree, k, size)
        if rod is not None:
            painted[k] = [(rod, _grey(rod))]
    found = {
        k: shapes.smooth(np.concatenate([t for t, _ in pieces]), np.concatenate([c for _, c in pieces]))
        for k, pieces in painted.items()
    }
    return found, _problem_note(problems)


def _problem_note(problems: Mapping[str, Sequence[str]]) -> list[str]:
    if not problems:
        return []
    count = sum(map(len, problems.values()))
    reason, which = next(iter(problems.items()))
    more = f" (and {count - 1} more)" if count > 1 else ""
    hint = "; --package-dir names the folder that holds the package" if "not found" in reason else ""
    return [f"Links without their meshes are drawn as rods: {which[0]}{more}: {reason}{hint}."]


def _visual(
    visual: XmlElement, materials: Mapping[str | None, FloatArray | None], finder: MeshFinder, budget: int
) -> Painted:
    geometry = visual.find("geometry")
    shape = next((child for child in geometry if isinstance(child.tag, str)), None) if geometry is not None else None
    if shape is None:
        raise MeshProblem("there is no geometry in the visual", "a visual")
    material = visual.find("material")
    colour = None
    if material is not None:
        colour = _colour(material)
        colour = materials.get(material.get("name")) if colour is None else colour
    try:
        T = origin(visual)
        triangles, colours_of_shape = _shape(shape, finder, budget)
    except (ValueError, TypeError) as error:
        raise MeshProblem(f"not understood ({' '.join(str(error).split())})", f"<{shape.tag}>") from None
    if colours_of_shape is None:
        colours_of_shape = _grey(triangles) if colour is None else np.broadcast_to(colour, (len(triangles), 3))
    return triangles @ T[:3, :3].T + T[:3, 3], colours_of_shape


def _shape(shape: XmlElement, finder: MeshFinder, budget: int) -> tuple[FloatArray, FloatArray | None]:
    if shape.tag == "box":
        return shapes.box(vector(shape.get("size"), 3)), None
    if shape.tag == "cylinder":
        return shapes.cylinder(_size(shape, "radius"), _size(shape, "length")), None
    if shape.tag == "capsule":
        return shapes.capsule(_size(shape, "radius"), _size(shape, "length")), None
    if shape.tag == "sphere":
        return shapes.sphere(_size(shape, "radius")), None
    if shape.tag == "mesh":
        triangles, colours = finder.read(shape.get("filename") or "", budget)
        scale = vector(shape.get("scale") or "1 1 1", 3)
        triangles = triangles * scale
        if np.prod(scale) < 0:
            triangles = triangles[:, ::-1]
        return triangles, colours
    raise ValueError(f"unknown geometry {shape.tag}")


def _size(shape: XmlElement, name: str) -> float:
    value = float(shape.get(name))
    if not 0 <= value < 1e3:
        raise ValueError(f"{name} is {value:g}")
    return value


def _colour(material: XmlElement) -> FloatArray | None:
    element = material.find("color")
    try:
        return None if element is None else vector(element.get("rgba"), 4)[:3].clip(0, 1)
    except ValueError:
        return None


def _rods(tree: Sequence[Link], k: int, size: float) -> FloatArray | None:
    """A link as rods from its frame to the joints that it carries, with a drum about each moving joint."""
    radius = 0.022 * size
    rods = []
    for child in tree:
        if child.parent != k:
            continue
        end = child.T_parent_joint[:3, 3]
        if np.linalg.norm(end) > 2 * radius:
            rods.append(shapes.rod(np.zeros(3), end, radius))
    link = tree[k]
    if link.kind == "revolute":
        rods.append(shapes.rod(-1.6 * radius * link.axis, 1.6 * radius * link.axis, 1.5 * radius))
    return np.concatenate(rods) if rods else None


def _grey(triangles: FloatArray) -> FloatArray:
    return np.broadcast_to(GREY, (len(triangles), 3))
