"""Mesh files that a URDF names, read as triangles; where they may lie: `irbcal.io.mesh_paths`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.io.mesh_paths import MeshFolders, MeshProblem

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
        found = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([\d.eE+-]+)[\"']", data[:100_000])
        unit = float(found[1]) if found else 1.0
    try:
        # without a resolver nothing but these bytes is read: no textures, no material files
        scene = trimesh.load_scene(BytesIO(data), file_type=ending, process=False)
        parts = list(_scene_parts(scene, budget))
    except MeshProblem:
        raise
    except Exception as error:  # whatever a parser raises on a damaged file
        raise MeshProblem(f"it is not a readable mesh ({type(error).__name__})", name) from None
    if not parts:
        raise MeshProblem("there are no triangles in it", name)
    triangles = np.concatenate([part for part, _ in parts]) * unit
    good = np.isfinite(triangles).all(axis=(1, 2))
    coloured = any(colour is not None for _, colour in parts)
    colours = np.concatenate([np.broadcast_to(GREY if c is None else c, (len(t), 3)) for t, c in parts])
    return triangles[good], colours[good] if coloured else None


def _scene_parts(scene: Any, budget: int) -> Iterator[tuple[FloatArray, FloatArray | None]]:
    for node in scene.graph.nodes_geometry:
        T, name = scene.graph[node]
        part = scene.geometry[name]
        if not hasattr(part, "faces") or not len(part.faces):
            continue
        budget -= len(part.faces)
        if budget < 0:
            raise MeshProblem(f"the robot has more than {MAX_TRIANGLES:,} triangles", name)
        triangles = part.triangles @ np.asarray(T)[:3, :3].T + np.asarray(T)[:3, 3]
        yield triangles, _part_colours(part)


def _part_colours(part: Any) -> FloatArray | None:
    visual = part.visual
    if not visual.defined:
        return None
    if visual.kind == "texture":
        material = visual.material
        if getattr(material, "image", None) is not None:
            return None
        return np.asarray(material.main_color[:3], dtype=float) / 255
    return np.asarray(visual.face_colors[:, :3], dtype=float) / 255
