"""Mesh files that a URDF names, as triangles."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.io.urdf_xml import MeshProblem

GREY = (0.78, 0.79, 0.80)
"""Colour of triangles without one where others of the file have one."""
MOST_TRIANGLES = 2_000_000


def read_mesh(data: bytes, ending: str, name: str, budget: int) -> tuple[FloatArray, FloatArray | None]:
    """Triangles of a mesh file's content; nothing but these bytes is read.

    Parameters
    ----------
    data : bytes
    ending : str
        ``stl``, ``dae``, ``obj`` or ``glb``.
    name : str
        Of the file, for errors.
    budget : int
        Most triangles to take.

    Returns
    -------
    triangles : ndarray, shape (m, 3, 3)
        Metres, in the frame of the file; COLLADA's axis that is up is not looked at, as other readers of URDF do not.
    colours : ndarray, shape (m, 3), or None
        Red, green, blue in 0 to 1; None where the file has no colours.

    Raises
    ------
    MeshProblem
        If it is not understood, or has more triangles.
    """
    binary_stl = ending == "stl" and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    try:
        if ending == "dae":
            import collada  # noqa: F401
        elif not binary_stl:
            import trimesh
    except ImportError as error:
        raise MeshProblem(f"reading {ending} meshes needs the package {error.name}", name) from None
    unit = 1.0
    if ending == "dae":
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
            raise MeshProblem("document types and entities are refused", name)
        unit_text = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([\d.eE+-]+)[\"']", data[:100_000])
        unit = float(unit_text[1]) if unit_text else 1.0
    try:
        if binary_stl:
            facets = np.frombuffer(data, np.dtype([("numbers", "<f4", (4, 3)), ("attribute", "<u2")]), offset=84)
            mesh_parts: Iterable[MeshPart] = [(facets["numbers"][:, 1:].astype(float), None)] if len(facets) else []
        elif ending == "dae":
            mesh_parts = _collada_parts(data)
        else:
            # without a resolver nothing but these bytes is read: no textures, no material files
            mesh_parts = _scene_parts(trimesh.load_scene(BytesIO(data), file_type=ending, process=False))
        link_meshes = []
        for triangles, colours in mesh_parts:
            link_meshes.append((triangles, colours))
            if sum(len(mesh) for mesh, _ in link_meshes) > budget:
                raise MeshProblem(f"it has more than {budget:,} triangles", name)
    except MeshProblem:
        raise
    except Exception as error:  # whatever a parser raises on a damaged file
        raise MeshProblem(f"it is not a readable mesh ({type(error).__name__})", name) from None
    if not link_meshes:
        raise MeshProblem("there are no triangles in it", name)
    triangles = np.concatenate([mesh for mesh, _ in link_meshes]) * unit
    good = np.isfinite(triangles).all(axis=(1, 2))
    coloured = any(colour is not None for _, colour in link_meshes)
    colours = np.concatenate([np.broadcast_to(GREY if c is None else c, (len(t), 3)) for t, c in link_meshes])
    return triangles[good], colours[good] if coloured else None


MeshPart: TypeAlias = tuple[FloatArray, FloatArray | None]
"""Triangles (m, 3, 3) and their colours: one, (3,), or each its own, (m, 3); None where the file says none."""


def _collada_parts(data: bytes) -> Iterator[MeshPart]:
    """Parts of a COLLADA file; textures are white, as trimesh shows them without the files that they name."""
    import collada
    from collada import scene

    file: Any = collada.Collada(BytesIO(data), ignore=[collada.common.DaeError])
    nodes = [(node, np.eye(4)) for node in reversed(file.scene.nodes)]
    while nodes:
        node, T = nodes.pop()
        if isinstance(node, scene.Node):
            nodes += [(child, T @ node.matrix) for child in reversed(node.children)]
        elif isinstance(node, scene.GeometryNode):
            effects = {bound.symbol: bound.target.effect for bound in node.materials}
            for primitive in node.geometry.primitives:
                if isinstance(primitive, collada.polylist.Polylist):
                    primitive = primitive.triangleset()
                if not isinstance(primitive, collada.triangleset.TriangleSet) or not len(primitive.index):
                    continue
                triangles = primitive.vertex[primitive.vertex_index].astype(float) @ T[:3, :3].T + T[:3, 3]
                colours = primitive.sources.get("COLOR")
                colour = None
                if primitive.material in effects:
                    diffuse = effects[primitive.material].diffuse
                    plain = diffuse is not None and not isinstance(diffuse, collada.material.Map)
                    colour = np.round(np.array(diffuse[:3] if plain else (1.0, 1.0, 1.0)) * 255.0) / 255.0
                elif colours:
                    of_corners = colours[0][4].data[primitive.index[:, :, colours[0][0]]]
                    colour = np.round(of_corners[:, :, :3].mean(axis=1) * 255.0) / 255.0
                yield triangles, colour


def _scene_parts(scene: Any) -> Iterator[MeshPart]:
    for node in scene.graph.nodes_geometry:
        T, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not hasattr(mesh, "faces") or not len(mesh.faces):
            continue
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


def as_obj(path: Path) -> tuple[str, bytes] | None:
    """A mesh file as OBJ, which MuJoCo and Drake read: OBJ as it is, others by their triangles, without colours.

    None of a file that is not understood.
    """
    import trimesh

    ending = path.suffix.lower()
    if ending == ".obj":
        return ending, path.read_bytes()
    try:
        triangles, _ = read_mesh(path.read_bytes(), ending[1:], path.name, MOST_TRIANGLES)
    except MeshProblem:
        return None
    mesh: Any = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    text: str = mesh.export(file_type="obj", include_normals=False, include_color=False, header=None, digits=9)
    return ".obj", text.encode()
