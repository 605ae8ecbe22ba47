"""Mesh files that a URDF names: where they are, and how their names are written for readers without package folders.

A URDF is untrusted: only files with a mesh's ending below the given package folders, ROS packages that the URDF lies
in, or the URDF's own folder are looked at.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Literal, TypeAlias

from irbcal.errors import RobotError
from irbcal.io import urdf_xml

MeshPaths: TypeAlias = Literal["package", "relative", "absolute"]
"""How mesh files stand in a written URDF: as they were, from its folder, or from the root of the disk."""
CHOICES: tuple[MeshPaths, ...] = ("package", "relative", "absolute")
MESH_ENDINGS = (".stl", ".dae", ".obj", ".glb")
TEXTURE_ENDINGS = (".png", ".jpg", ".jpeg")
ENDINGS = {"mesh": MESH_ENDINGS, "texture": TEXTURE_ENDINGS}
"""Elements of a URDF that name files, and the endings of those."""

MOST_FILES = 10_000
"""Different files that a URDF may name."""


class MeshProblem(Exception):
    """A file that a URDF names and that cannot be used.

    Attributes
    ----------
    reason : str
        What is wrong.
    which : str
        The file or element.
    """

    def __init__(self, reason: str, which: str) -> None:
        super().__init__(reason, which)
        self.reason, self.which = reason, which


class MeshFolders:
    """Finds files that a URDF names, inside the folders that it may name.

    Parameters
    ----------
    folder : Path or None
        Folder of the URDF, if it lies in one.
    package_dirs : sequence of str or Path
        Folders that hold ROS packages, or are one.
    """

    def __init__(self, folder: str | PathLike[str] | None, package_dirs: Sequence[str | PathLike[str]] = ()) -> None:
        self.own = [] if folder is None else [Path(folder).resolve()]
        self.packages = [Path(folder).resolve() for folder in package_dirs]
        self.around = [
            parent for top in self.own for parent in (top, *top.parents) if (parent / "package.xml").is_file()
        ]

    def find(self, uri: str, endings: Sequence[str] = MESH_ENDINGS) -> Path:
        """The file that a name stands for.

        Parameters
        ----------
        uri : str
            ``package://NAME/...``, ``file://...``, or a path.
        endings : sequence of str
            That it may have.

        Raises
        ------
        Problem
            If there is none, or if it lies outside the folders that may be read.
        """
        shown = uri if len(uri) < 120 else uri[:120] + "…"
        scheme, separator, rest = uri.partition("://")
        if separator and scheme not in ("package", "model", "file"):
            raise MeshProblem("only files on this computer are read", shown)
        if "\x00" in uri:
            raise MeshProblem("not a file name", "a mesh")
        if separator and scheme != "file":
            name, _, rest = rest.partition("/")
            candidates = [top / name / rest for top in self.packages]
            candidates += [top / rest for top in (*self.packages, *self.around) if top.name == name]
        else:
            rest = rest if separator else uri
            candidates = [top / rest for top in (*self.own, *self.packages, *self.around)]
        outside = False
        for path in candidates:
            try:
                path = path.resolve()
                if not path.is_file():
                    continue
            except (OSError, RuntimeError):  # too long, or links in a circle
                continue
            if any(path.is_relative_to(top) for top in (*self.own, *self.packages, *self.around)):
                if path.suffix.lower() not in endings:
                    raise MeshProblem(f"only {', '.join(endings)} files are read as meshes", shown)
                return path
            outside = True
        if outside:
            raise MeshProblem("it lies outside the URDF's folder and the package folders", shown)
        raise MeshProblem("the file was not found", shown)


def with_mesh_paths(data: bytes, how: MeshPaths, folder: str | Path, meshes: MeshFolders, source: str) -> bytes:
    """A URDF whose meshes and textures are named by paths that MuJoCo, urchin and yourdfpy open; all else as it was.

    Names that begin with ``package://``, ``model://`` or ``file://``, and relative ones, are looked for. Absolute
    paths and other addresses stay as they are. MuJoCo is told not to cut folders off, and to keep links that are fixed
    to others, in an element ``mujoco`` that other readers pass over; an element that is there is kept.

    Parameters
    ----------
    data : bytes
        The URDF.
    how : {"package", "relative", "absolute"}
        ``package``: nothing is changed.
    folder : str or Path
        Where it will lie; relative paths start there.
    meshes : MeshFolders
        Where files are looked for.
    source : str
        Its name, for messages.

    Raises
    ------
    RobotError
        If a file is not found, or lies where the URDF may not look.
    """
    if how == "package":
        return data
    tree = urdf_xml.parse(data, source)
    root, start = tree.getroot(), Path(folder).resolve()
    by_name: dict[tuple[str, str], list[urdf_xml.XmlElement]] = {}
    for element in root.iter(*ENDINGS):
        name = element.get("filename", "")
        scheme, address, _ = name.partition("://")
        if name and not os.path.isabs(name) and (not address or scheme in ("package", "model", "file")):
            by_name.setdefault((name, element.tag), []).append(element)
    problems = []
    for (name, kind), elements in list(by_name.items())[: MOST_FILES + 1]:
        try:
            path = meshes.find(name, ENDINGS[kind])
            text = Path(os.path.relpath(path, start) if how == "relative" else path).as_posix()
            for element in elements:
                element.set("filename", text)
        except MeshProblem as problem:
            problems.append(problem)
        except ValueError:  # bytes that are no text, control characters, another drive
            problems.append(MeshProblem("its path cannot be written in a URDF", name))
    if len(by_name) > MOST_FILES:
        problems = [MeshProblem(f"more than {MOST_FILES} files are too many", "its meshes")]
    if problems:
        first, more = problems[0], f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        hint = "; packages are looked for in ROS_PACKAGE_PATH, too" if "not found" in first.reason else ""
        raise RobotError(
            f"mesh paths cannot be made {how}: {first.which}{more}: {first.reason}{hint}",
            file=source,
            parameter="mesh_paths",
        )
    _tell_mujoco(root)
    return urdf_xml.serialised(tree)


def _tell_mujoco(root: urdf_xml.XmlElement) -> None:
    """Have MuJoCo take the names as they are: older versions cut folders off unless they are told not to."""
    from lxml import etree

    element = root.find("mujoco")
    if element is None:
        element = etree.SubElement(root, "mujoco")
        if element.getprevious() is not None:
            element.getprevious().tail = "\n  "
        etree.SubElement(element, "compiler", fusestatic="false")
        element.tail = "\n"
    compiler = element.find("compiler")
    if compiler is None:
        compiler = etree.SubElement(element, "compiler")
    compiler.set("strippath", "false")
    for name in ("meshdir", "assetdir"):  # the names are whole now
        compiler.attrib.pop(name, None)
