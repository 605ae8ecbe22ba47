"""Drake: a package with the calibrated URDF and its meshes as OBJ files, which Drake reads."""

from __future__ import annotations

from irbcal.exporting.robot_numbers import ExportFiles
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import PACKAGE, description, joint_map_module, urdf_with_meshes
from irbcal.io import urdf_xml
from irbcal.io.meshes import as_obj

DESCRIPTION = "Drake: a package (package.xml) with the calibrated URDF and its meshes as OBJ"
NEXT_STEP = "parser.package_map().AddPackageXml({package!r})     # positions are effective joints"
UNREAD = ("mujoco", "safety_controller")
"""Elements that Drake warns of."""


def files(source: Source) -> ExportFiles:
    """The package and the joint map."""
    from xml.sax.saxutils import escape

    converted = urdf_with_meshes(source, as_obj)
    name = f"{source.numbers.identifier}_calibrated"
    root = converted.in_package(name)
    for element in list(root.iter(*UNREAD)):
        element.getparent().remove(element)
    package = PACKAGE.format(name=name, what=escape(description(source)), more="").encode()
    made = {"package.xml": package, f"{name}.urdf": urdf_xml.serialised(converted.tree)}
    return ExportFiles(made | converted.meshes | joint_map_module(source), converted.notes)
