"""A calibrated URDF together with the mesh files that it names, for folders that can be moved anywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from irbcal.arrays import Locked
from irbcal.errors import CalibrationError, RobotError
from irbcal.exporting import python
from irbcal.exporting.source import Source
from irbcal.io import robots, urdf_xml
from irbcal.io.urdf_xml import MESH_ENDINGS, MeshFolders, MeshProblem, MissingMesh, XmlElement, XmlTree

FOLDER = "meshes"
Convert = Callable[[Path], tuple[str, bytes] | None]
"""From a mesh file to an ending and content; None where the format is not taken."""


@dataclass(frozen=True, eq=False)
class UrdfWithMeshes(Locked):
    """A URDF whose meshes lie in a folder beside it.

    Attributes
    ----------
    tree : XmlTree
        The document; names of meshes are ``meshes/NAME``.
    meshes : dict of str to bytes
        Content of the files by these names.
    left_out : tuple of str
        Mesh files that are not taken: their shapes are gone from the document.
    textures : tuple of str
        Images that surfaces were drawn with: none is taken.
    missing : tuple of str
        Mesh files that were not found: their shapes are gone, too.
    """

    tree: XmlTree
    meshes: dict[str, bytes]
    left_out: tuple[str, ...]
    textures: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not taken, in words."""
        told = []
        if self.left_out:
            which = f"{len(self.left_out)} meshes are" if len(self.left_out) > 1 else "one mesh is"
            names = ", ".join(self.left_out)
            told.append(f"{which} left out with the shapes made of them, for no reader takes them: {names}")
        if self.missing:
            names = ", ".join(dict.fromkeys(self.missing))
            told.append(
                f"meshes that are not on this computer are left out with the shapes made of them: {names} "
                "(ROS_PACKAGE_PATH leads to packages)"
            )
        if self.textures:
            told.append(f"textures are left out: {', '.join(self.textures)}")
        return tuple(told)

    def in_package(self, name: str) -> XmlElement:
        """The document's root, whose meshes are named as those of a ROS package from now on."""
        root = self.tree.getroot()
        for mesh in root.iter("mesh"):
            mesh.set("filename", f"package://{name}/{mesh.get('filename')}")
        return root


def urdf_with_meshes(source: Source, convert: Convert) -> UrdfWithMeshes:
    """The URDF of a calibration with its meshes.

    Parameters
    ----------
    source : Source
    convert : callable
        What becomes of each file.

    Raises
    ------
    CalibrationError
        If the URDF is not known.
    RobotError
        If a mesh file lies where the URDF may not look.
    """
    tree = urdf_xml.parse(urdf_of(source), "calibrated.urdf")
    root = tree.getroot()
    finder = MeshFolders(source.folder, robots.package_dirs())
    taken: dict[Path, str | None] = {}
    meshes: dict[str, bytes] = {}
    left_out, missing = [], []
    for mesh in list(root.iter("mesh")):
        try:
            path = finder.find(mesh.get("filename", ""), MESH_ENDINGS)
        except MissingMesh as problem:
            missing.append(problem.which)
            _without_shape(mesh)
            continue
        except MeshProblem as problem:
            raise RobotError(f"{problem.which}: {problem.reason}", file="calibrated.urdf", parameter="as") from None
        if path not in taken:
            converted = convert(path)
            if converted is None:
                left_out.append(path.name)
                taken[path] = None
            else:
                taken[path] = _free(meshes, path.stem, converted[0])
                meshes[str(taken[path])] = converted[1]
        name = taken[path]
        if name is None:
            _without_shape(mesh)
        else:
            mesh.set("filename", name)
    textures = list(root.iter("texture"))
    for texture in textures:
        texture.getparent().remove(texture)
    names = dict.fromkeys(PurePosixPath(texture.get("filename", "unnamed")).name for texture in textures)
    return UrdfWithMeshes(tree, meshes, tuple(left_out), tuple(names), tuple(missing))


def _without_shape(mesh: XmlElement) -> None:
    shape = mesh.getparent().getparent()
    shape.getparent().remove(shape)


def urdf_of(source: Source) -> bytes:
    """The calibrated URDF.

    Raises
    ------
    CalibrationError
        If it is not known.
    """
    if source.urdf is None:
        raise CalibrationError(
            f"this calibration of {source.parts.name} does not hold the robot's URDF: give its folder instead",
            parameter="calibration",
        )
    return source.urdf


def in_words(source: Source) -> str:
    """What an export is of, for descriptions and comments."""
    parts = source.parts
    simulated = " from SIMULATED measurements" if parts.simulated else ""
    return f"{parts.name}, calibrated{simulated}: {parts.version}, fingerprint {parts.fingerprint}"


def beside(source: Source) -> dict[str, bytes]:
    """The joint map for those who have the URDF only: the Python module on numpy."""
    text = python.text(source.parts, source.vectors)
    return {f"{source.parts.identifier}_calibrated.py": text}


def _free(used: dict[str, bytes], stem: str, ending: str) -> str:
    word = "".join(char if char.isalnum() or char in "-_" else "_" for char in stem)
    names = (f"{FOLDER}/{word}{mark}{ending}" for mark in ("", *(f"_{k}" for k in range(2, 10_000))))
    return next(name for name in names if name not in used)
