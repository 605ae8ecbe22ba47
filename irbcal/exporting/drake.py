"""Drake: a package with the calibrated URDF and its meshes as OBJ files, which Drake reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from irbcal.exporting.parts import ExportFiles
from irbcal.exporting.source import Source
from irbcal.exporting.urdf_with_meshes import beside, in_words, urdf_with_meshes
from irbcal.io import urdf_xml

WHAT = "Drake: a package (package.xml) with the calibrated URDF and its meshes as OBJ"
NEXT = "parser.package_map().AddPackageXml({package!r})     # positions are effective joints"
UNREAD = ("mujoco", "safety_controller")
"""Elements that Drake warns of."""
PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>1.0.0</version>
  <description>{what}</description>
  <maintainer email="nobody@example.org">made by irbcal</maintainer>
  <license>as the robot's own description</license>
</package>
"""


def files(source: Source) -> ExportFiles:
    """The package and the joint map."""
    from xml.sax.saxutils import escape

    found = urdf_with_meshes(source, _as_obj)
    name = f"{source.parts.identifier}_calibrated"
    root = found.in_package(name)
    for element in list(root.iter(*UNREAD)):
        element.getparent().remove(element)
    package = PACKAGE.format(name=name, what=escape(in_words(source))).encode()
    made = {"package.xml": package, f"{name}.urdf": urdf_xml.serialised(found.tree)}
    return ExportFiles(made | found.meshes | beside(source), found.notes)


def _as_obj(path: Path) -> tuple[str, bytes] | None:
    """OBJ as it is, STL converted; others are not taken: their units and axes are for their own readers to know."""
    import trimesh

    ending = path.suffix.lower()
    if ending == ".obj":
        return ".obj", path.read_bytes()
    if ending != ".stl":
        return None
    mesh: Any = trimesh.load(path, file_type="stl", force="mesh")
    text: str = mesh.export(file_type="obj", include_normals=False, include_color=False, header=None, digits=9)
    return ".obj", text.encode()
