"""URDF: the calibrated URDF with mesh paths of a kind, its joint origins, and the joint map as a module."""

from __future__ import annotations

from irbcal.exporting.robot_numbers import ExportFiles
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import joint_map_module, missing, urdf_of, urdf_with_meshes
from irbcal.io import joint_origins, urdf_xml
from irbcal.io.urdf_xml import with_mesh_paths

DESCRIPTION = "the calibrated URDF with mesh paths of a kind, its joint origins, and the joint map as a Python module"
NEXT_STEP = "check_urdf {folder}/{word}_calibrated.urdf     # its joints are effective joints"


def files(source: Source) -> ExportFiles:
    """The URDF, ``joint_origins.yaml`` and the joint map."""
    left_out: list[str] = []
    data = urdf_of(source)
    notes: tuple[str, ...] = ()
    if source.without_meshes:
        package = urdf_with_meshes(source, lambda path: None)
        data, notes = urdf_xml.serialised(package.tree), package.notes
    data = with_mesh_paths(data, source.mesh_paths, source.out, source.meshes, "calibrated.urdf", left_out)
    name = f"{source.numbers.identifier}_calibrated.urdf"
    made = {name: data}
    if source.record is not None:
        made["joint_origins.yaml"] = joint_origins.to_yaml(source.record).encode()
    return ExportFiles(made | joint_map_module(source), (*notes, *missing(left_out)))
