"""A calibrated URDF together with the mesh files that it names, for folders that can be moved anywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from irbcal.arrays import Locked
from irbcal.errors import CalibrationError
from irbcal.exporting import python
from irbcal.exporting.source import Source
from irbcal.io import urdf_xml
from irbcal.io.urdf_xml import MESH_ENDINGS, MeshProblem, MissingMesh, XmlElement, XmlTree, without_shape
from irbcal.wording import counted, first_of

FOLDER = "meshes"
MOST_NAMED = 5
"""Files that a note names."""
Convert = Callable[[Path], tuple[str, bytes] | None]
"""From a mesh file to an ending and content; None where the format is not taken."""
PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>1.0.0</version>
  <description>{what}</description>
  <maintainer email="nobody@example.org">made by irbcal</maintainer>
  <license>as the robot's own description</license>{more}
</package>
"""
"""Description of a ROS package."""


@dataclass(frozen=True, eq=False)
class UrdfWithMeshes(Locked):
    """A URDF whose meshes lie in a folder beside it."""

    tree: XmlTree
    """The document; names of meshes are ``meshes/NAME``."""
    meshes: dict[str, bytes]
    """Content of the files by these names."""
    left_out: tuple[str, ...]
    """Mesh files that are not taken: their shapes are gone from the document."""
    textures: tuple[str, ...] = ()
    """Images that surfaces were drawn with: none is taken."""
    missing: tuple[str, ...] = ()
    """Mesh files that were not found, or that may not be read, with the reason: their shapes are gone, too."""
    without: int = 0
    """Shapes that were left out on request."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not taken, in words."""
        sentences = []
        if self.left_out:
            which = counted(len(self.left_out), "mesh is", "meshes are")
            names = ", ".join(self.left_out)
            sentences.append(f"{which} left out with the shapes made of them, for no reader takes them: {names}")
        if self.without:
            sentences.append(f"{self.without} shapes made of meshes are left out, as --without-meshes says")
        sentences += missing(self.missing)
        if self.textures:
            sentences.append(f"textures are left out: {', '.join(self.textures)}")
        return tuple(sentences)

    def in_package(self, name: str) -> XmlElement:
        """The document's root, whose meshes are named as those of a ROS package from now on."""
        root = self.tree.getroot()
        for mesh in root.iter("mesh"):
            mesh.set("filename", f"package://{name}/{mesh.get('filename')}")
        return root


def missing(names: Sequence[str]) -> tuple[str, ...]:
    """A note on meshes that are not taken because they cannot be read; none without any."""
    listed = list(dict.fromkeys(names))
    return (
        (
            "meshes that cannot be read on this computer are left out with the shapes made of them: "
            f"{first_of(listed, MOST_NAMED)} (--package-dir names the folder that holds their package)",
        )
        if listed
        else ()
    )


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
    """
    tree = urdf_xml.parse(urdf_of(source), "calibrated.urdf")
    root = tree.getroot()
    finder = source.meshes
    copied: dict[Path, str | None] = {}
    meshes: dict[str, bytes] = {}
    left_out, absent = [], []
    listed = list(root.iter("mesh"))
    for mesh in listed:
        if source.without_meshes:
            without_shape(mesh)
            continue
        try:
            path = finder.find(mesh.get("filename", ""), MESH_ENDINGS)
        except MeshProblem as problem:
            absent.append(problem.which if isinstance(problem, MissingMesh) else f"{problem.which}: {problem.reason}")
            without_shape(mesh)
            continue
        if path not in copied:
            converted = convert(path)
            if converted is None:
                left_out.append(path.name)
                copied[path] = None
            else:
                copied[path] = _free(meshes, path.stem, converted[0])
                meshes[str(copied[path])] = converted[1]
        name = copied[path]
        if name is None:
            without_shape(mesh)
        else:
            mesh.set("filename", name)
    without = len(listed) if source.without_meshes else 0
    textures = list(root.iter("texture"))
    for texture in textures:
        texture.getparent().remove(texture)
    names = dict.fromkeys(PurePosixPath(texture.get("filename", "unnamed")).name for texture in textures)
    return UrdfWithMeshes(tree, meshes, tuple(left_out), tuple(names), tuple(absent), without)


def urdf_of(source: Source) -> bytes:
    """The calibrated URDF.

    Raises
    ------
    CalibrationError
        If it is not known.
    """
    if source.urdf is None:
        raise CalibrationError(
            f"this calibration of {source.numbers.name} does not hold the robot's URDF: give its folder instead",
            parameter="calibration",
        )
    return source.urdf


def description(source: Source) -> str:
    """What an export is of, for descriptions and comments."""
    numbers = source.numbers
    simulated = " from SIMULATED measurements" if numbers.simulated else ""
    return f"{numbers.name}, calibrated{simulated}: {numbers.version}, fingerprint {numbers.fingerprint}"


def joint_map_module(source: Source) -> dict[str, bytes]:
    """The joint map for those who have the URDF only: the Python module on numpy."""
    text = python.text(source.numbers, source.vectors)
    return {f"{source.numbers.identifier}_calibrated.py": text}


def _free(used: dict[str, bytes], stem: str, ending: str) -> str:
    word = "".join(char if char.isalnum() or char in "-_" else "_" for char in stem)
    names = (f"{FOLDER}/{word}{mark}{ending}" for mark in ("", *(f"_{k}" for k in range(2, 10_000))))
    return next(name for name in names if name not in used)
