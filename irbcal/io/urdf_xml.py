"""The XML of a URDF: parsed without trust, patched in place; its mesh files, and how their names are written.

A URDF is untrusted input: document types and entities are refused before parsing, nothing is fetched.

A URDF is untrusted: only files with a mesh's ending below the given package folders, ROS packages that the URDF lies
in, or the URDF's own folder are looked at.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from irbcal import literals
from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.safe_files import path_of_uri

MAX_BYTES = 20_000_000
FARTHEST, LARGEST_TURN = 1e4, 1e4
"""Metres and radians that no joint's origin has."""
WORDS_MARK = "CALIBRATED by irbcal"
"""Start of the comment that a corrected URDF begins with."""

XmlTree: TypeAlias = Any
"""lxml ElementTree (lxml has no types)."""
XmlElement: TypeAlias = Any
"""lxml Element."""


def parse(data: bytes, source: str) -> XmlTree:
    """The document of a URDF.

    Raises
    ------
    RobotError
        If it is not well-formed, not UTF-8, too large, has document types or entities, or is no URDF.
    """
    from lxml import etree

    if not data.strip():
        raise RobotError("the file is empty, expected a URDF", file=source)
    if len(data) > MAX_BYTES:
        raise RobotError(f"{len(data)} bytes is too large for a URDF (at most {MAX_BYTES})", file=source)
    encoding = re.match(rb"\s*<\?xml[^>]*encoding\s*=\s*['\"]([\w.-]+)['\"]", data.removeprefix(b"\xef\xbb\xbf"))
    if b"\x00" in data or (encoding and encoding[1].lower() not in (b"utf-8", b"us-ascii", b"ascii", b"iso-8859-1")):
        raise RobotError("expected UTF-8 text, found another encoding", file=source)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        line_number = data[: data.find(b"<!")].count(b"\n") + 1
        raise RobotError("document types and entities are refused in a URDF", file=source, line=line_number)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        tree = etree.ElementTree(etree.fromstring(data, parser))
    except etree.XMLSyntaxError as error:
        raise RobotError(f"not well-formed XML: {' '.join(error.msg.split())}", file=source) from None
    if tree.getroot().tag != "robot":
        raise RobotError(f"expected a <robot> element at the top, found <{tree.getroot().tag}>", file=source)
    return tree


def serialised(tree: XmlTree) -> bytes:
    """The document as the content of a file."""
    from lxml import etree

    root = tree.getroot()
    # lxml drops the line ends between the comments before and after the root element: write them one a line
    around = [*reversed(list(root.itersiblings(preceding=True))), root, *root.itersiblings()]
    pieces = [b'<?xml version="1.0" encoding="utf-8"?>']
    pieces += [etree.tostring(node, encoding="utf-8", with_tail=False) for node in around]
    return b"\n".join(pieces) + b"\n"


def numbers(text: str, count: int, title: str, source: str) -> FloatArray:
    """Numbers of an attribute, refused where there are others than ``count``; ``title`` and ``source`` for messages."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        raise RobotError(f"{title}: expected {count} numbers, found {text!r}", file=source)
    return values


def origin(element: XmlElement, title: str, source: str) -> FloatArray:
    """The origin of an element, shape (4, 4); identity without one."""
    origin_element = element.find("origin")
    if origin_element is None:
        return np.eye(4)
    xyz = numbers(origin_element.get("xyz", "0 0 0"), 3, f"{title}, origin xyz", source)
    rpy = numbers(origin_element.get("rpy", "0 0 0"), 3, f"{title}, origin rpy", source)
    if max(np.abs(xyz).max() / FARTHEST, np.abs(rpy).max() / LARGEST_TURN) > 1:
        raise RobotError(
            f"{title}: expected an origin within {FARTHEST:g} m and {LARGEST_TURN:g} rad, "
            f"found {' '.join(f'{value:g}' for value in (*xyz, *rpy))}",
            file=source,
        )
    return frames.transform(frames.matrix_from_rpy(rpy), xyz)


def text_of(values: FloatArray) -> str:
    """Numbers with 17 significant digits, so that none changes when it is read again."""
    # adding zero turns -0 into 0
    return " ".join(format(float(value) + 0.0, ".17g") for value in values)


def set_origin(joint: XmlElement, T: FloatArray) -> None:
    """Write a joint frame in its parent link, shape (4, 4), as the origin of a joint element."""
    from lxml import etree

    origin = joint.find("origin")
    if origin is None:
        origin = etree.Element("origin")
        origin.tail = joint.text
        joint.insert(0, origin)
    origin.set("xyz", text_of(T[:3, 3]))
    origin.set("rpy", text_of(frames.rpy_from_matrix(T[:3, :3])))


def add_joint(
    root: XmlElement, parent: str, child: str, T: FloatArray, name: str | None = None, new_link: str | None = ""
) -> XmlElement:
    """Add a fixed joint at a place ``T``, shape (4, 4), in the parent link, and a link: the child unless given."""
    from lxml import etree

    if new_link is not None:
        link = etree.SubElement(root, "link", name=new_link or child)
        link.getprevious().tail = "\n  "
    joint = etree.SubElement(root, "joint", name=name or f"{parent}-{child}", type="fixed")
    etree.SubElement(joint, "parent", link=parent)
    etree.SubElement(joint, "child", link=child)
    set_origin(joint, T)
    etree.indent(joint, level=1)
    joint.getprevious().tail = "\n  "
    joint.tail = "\n"
    return joint


def begin_with(root: XmlElement, words: str) -> None:
    """Say what the file is in its first comment, in place of what an earlier calibration said there.

    File names among the words may hold what no XML comment may: see `irbcal.literals`.
    """
    from lxml import etree

    for comment in list(root.itersiblings(preceding=True)):
        if (comment.text or "").strip().startswith(WORDS_MARK):
            etree.Element("taken_out").append(comment)  # lxml's way to take out what stands before the root
    first = next(reversed(list(root.itersiblings(preceding=True))), root)
    first.addprevious(etree.Comment(literals.xml_comment(words)))


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


class MissingMesh(MeshProblem):
    """A file that a URDF names and that is not on this computer."""


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
        self.urdf_folder = [] if folder is None else [Path(folder).resolve()]
        self.packages = [Path(folder).resolve() for folder in package_dirs]
        self.around = [
            parent for top in self.urdf_folder for parent in (top, *top.parents) if (parent / "package.xml").is_file()
        ]

    def tops(self, uri: str) -> list[Path]:
        """Folders in which a name may be looked up: those of the URDF, of packages, and that package beside them."""
        name = uri.partition("://")[2].partition("/")[0]
        beside = [top.parent / name for top in self.around if name.strip(".")]
        return [
            *self.urdf_folder,
            *self.packages,
            *self.around,
            *(top for top in beside if (top / "package.xml").is_file()),
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
        short_uri = uri if len(uri) < 120 else uri[:120] + "…"
        scheme, separator, relative = uri.partition("://")
        if separator and scheme not in ("package", "model", "file"):
            raise MeshProblem("only files on this computer are read", short_uri)
        if "\x00" in uri:
            raise MeshProblem("not a file name", "a mesh")
        if separator and scheme != "file":
            name, _, relative = relative.partition("/")
            candidates = [top / name / relative for top in self.packages]
            candidates += [top / relative for top in self.tops(uri) if top.name == name and top not in self.urdf_folder]
        else:
            relative = path_of_uri(uri) if separator else uri
            candidates = [top / relative for top in (*self.urdf_folder, *self.packages, *self.around)]
        outside = False
        for path in candidates:
            try:
                path = path.resolve()
                if not path.is_file():
                    continue
            except (OSError, RuntimeError):  # too long, or links in a circle
                continue
            if any(path.is_relative_to(top.resolve()) for top in self.tops(uri)):
                if path.suffix.lower() not in endings:
                    raise MeshProblem(f"only {', '.join(endings)} files are read as meshes", short_uri)
                return path
            outside = True
        if outside:
            raise MeshProblem("it lies outside the URDF's folder and the package folders", short_uri)
        raise MissingMesh("the file was not found", short_uri)


def mesh_folders(root: XmlElement, finder: MeshFolders, known: Sequence[str | PathLike[str]]) -> list[str]:
    """Folders, besides those that are known, in which a URDF's meshes lie.

    Parameters
    ----------
    root : XmlElement
        Of the URDF.
    finder : MeshFolders
        Where meshes are looked for.
    known : sequence of str
        Folders of packages that any reader looks into.
    """
    without, needed = MeshFolders(None, known), dict[str, None]()
    for uri in dict.fromkeys(mesh.get("filename", "") for mesh in root.iter("mesh")):
        try:
            without.find(uri)
        except MeshProblem:
            try:
                path = finder.find(uri)
            except MeshProblem:
                continue
            relative = [] if "://" in uri else finder.urdf_folder
            needed |= dict.fromkeys(str(top) for top in relative)
            needed |= dict.fromkeys(str(top) for top in finder.tops(uri) if path.is_relative_to(top.resolve()))
    return list(needed)


def without_shape(mesh: XmlElement) -> None:
    """Take a mesh out of its document, with the shape that is made of it."""
    shape = next(mesh.iterancestors("visual", "collision"), mesh)
    if shape.getparent() is not None:
        shape.getparent().remove(shape)


def with_mesh_paths(
    data: bytes,
    how: MeshPaths,
    folder: str | Path,
    meshes: MeshFolders,
    source: str,
    left_out: list[str] | None = None,
) -> bytes:
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
    left_out : list of str, optional
        Files that cannot be named are left out with what is made of them, and are added to this list.

    Raises
    ------
    RobotError
        If a file is not found, or lies where the URDF may not look, and none is to be left out.
    """
    if how == "package":
        return data
    tree = parse(data, source)
    root, start = tree.getroot(), Path(folder).resolve()
    by_name: dict[tuple[str, str], list[XmlElement]] = {}
    for element in root.iter(*ENDINGS):
        name = element.get("filename", "")
        scheme, address, _ = name.partition("://")
        if name and not os.path.isabs(name) and (not address or scheme in ("package", "model", "file")):
            by_name.setdefault((name, element.tag), []).append(element)
    problems: list[MeshProblem] = []

    def note(problem: MeshProblem, elements: Sequence[XmlElement]) -> None:
        problems.append(problem)
        for element in elements if left_out is not None else ():
            without_shape(element) if element.tag == "mesh" else element.getparent().remove(element)

    for (name, kind), elements in list(by_name.items())[: MOST_FILES + 1]:
        try:
            path = meshes.find(name, ENDINGS[kind])
            text = Path(os.path.relpath(path, start) if how == "relative" else path).as_posix()
            for element in elements:
                element.set("filename", text)
        except MeshProblem as problem:
            note(problem, elements)
        except ValueError:  # bytes that are no text, control characters, another drive
            note(MeshProblem("its path cannot be written in a URDF", name), elements)
    if len(by_name) > MOST_FILES:
        problems, left_out = [MeshProblem(f"more than {MOST_FILES} files are too many", "its meshes")], None
    if left_out is not None:
        left_out += [problem.which for problem in problems]
    elif problems:
        first, more = problems[0], f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        hint = "; packages are looked for in ROS_PACKAGE_PATH, too" if isinstance(first, MissingMesh) else ""
        raise RobotError(
            f"mesh paths cannot be made {how}: {first.which}{more}: {first.reason}{hint}",
            file=source,
            parameter="mesh_paths",
        )
    _tell_mujoco(root)
    return serialised(tree)


def _tell_mujoco(root: XmlElement) -> None:
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
