"""The XML of a URDF: parsed without trust, patched in place, written with all else as it was.

A URDF is untrusted input: document types and entities are refused before parsing, nothing is fetched.
"""

from __future__ import annotations

import re
from typing import Any, TypeAlias

import numpy as np

from irbcal import literals
from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.modeling import frames

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


def first_node(root: XmlElement) -> XmlElement:
    """The first node of the document: a comment before the root element, or that element."""
    return next(reversed(list(root.itersiblings(preceding=True))), root)


def begin_with(root: XmlElement, words: str) -> None:
    """Say what the file is in its first comment, in place of what an earlier calibration said there.

    File names among the words may hold what no XML comment may: see `irbcal.literals`.
    """
    from lxml import etree

    for comment in list(root.itersiblings(preceding=True)):
        if (comment.text or "").strip().startswith(WORDS_MARK):
            etree.Element("taken_out").append(comment)  # lxml's way to take out what stands before the root
    first_node(root).addprevious(etree.Comment(literals.xml_comment(words)))
