"""URDF: the calibrated URDF with mesh paths of a kind, its joint origins, and the joint map as a module."""

from __future__ import annotations

from pathlib import Path

from irbcal.exporting.gathered import beside, urdf_of
from irbcal.exporting.source import Source
from irbcal.files import joint_origins, robots
from irbcal.files.mesh_paths import MeshFolders, MeshPaths, with_mesh_paths

WHAT = "the calibrated URDF with mesh paths of a kind, its joint origins, and the joint map as a Python module"
NEXT = "check_urdf {folder}/{word}_calibrated.urdf     # its joints are effective joints"


def files(source: Source, folder: Path, mesh_paths: MeshPaths = "relative") -> dict[str, bytes]:
    """The URDF, ``joint_origins.yaml`` and the joint map.

    Parameters
    ----------
    source : Source
    folder : Path
        Where it will lie: relative paths start there.
    mesh_paths : {"relative", "absolute", "package"}

    Returns
    -------
    dict of str to bytes
        Names of the files and what is in them.
    """
    places = MeshFolders(source.folder, robots.package_dirs())
    name = f"{source.parts.identifier}_calibrated.urdf"
    made = {name: with_mesh_paths(urdf_of(source), mesh_paths, folder, places, "calibrated.urdf")}
    if source.record is not None:
        made["joint_origins.yaml"] = joint_origins.to_yaml(source.record).encode()
    return made | beside(source)
