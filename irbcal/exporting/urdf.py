"""URDF: the calibrated URDF with mesh paths of a kind, its joint origins, and the joint map as a module."""

from __future__ import annotations

from irbcal.exporting.parts import ExportFiles
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import beside, urdf_of
from irbcal.io import joint_origins, robots
from irbcal.io.urdf_xml import MeshFolders, with_mesh_paths

WHAT = "the calibrated URDF with mesh paths of a kind, its joint origins, and the joint map as a Python module"
NEXT = "check_urdf {folder}/{word}_calibrated.urdf     # its joints are effective joints"


def files(source: Source) -> ExportFiles:
    """The URDF, ``joint_origins.yaml`` and the joint map."""
    finder = MeshFolders(source.folder, robots.package_dirs())
    name = f"{source.parts.identifier}_calibrated.urdf"
    made = {name: with_mesh_paths(urdf_of(source), source.mesh_paths, source.out, finder, "calibrated.urdf")}
    if source.record is not None:
        made["joint_origins.yaml"] = joint_origins.to_yaml(source.record).encode()
    return ExportFiles(made | beside(source))
