"""Lenses in the files of other programs: one module a format.

A module has ``DESCRIPTION``; ``read(content)``, which gives the numbers of each camera, or None where the content is
another format's; and ``write(cameras, rig)``, which gives text.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.board_formats import yaml_of
from irbcal.names import csv_bytes
from irbcal.safe_files import read_bytes, write_set

if TYPE_CHECKING:
    import pandas as pd

FORMATS = ("ros", "opencv", "kalibr")
FEATURES = "features"
MOST_CAMERAS = {"ros": 1, "opencv": 2}
"""Cameras that a file holds at most."""

Cameras: TypeAlias = "Mapping[str, tuple[FloatArray, tuple[int, int]]]"
"""By name: nine numbers as `irbcal.measurement.imaging.LENS` names them, and width and height, pixels."""

Rig: TypeAlias = "Mapping[str, tuple[str, FloatArray]]"
"""Cameras of a rig by name: the rig's first camera, and the pose in it, (4, 4), metres."""


def between(rig: Rig, one: str, other: str) -> FloatArray | None:
    """What maps coordinates in one camera to those in another, (4, 4); None where they are of no rig."""
    (a, T), (b, U) = rig.get(one, (one, np.eye(4))), rig.get(other, (other, np.eye(4)))
    return np.asarray(np.linalg.inv(U) @ T) if a == b else None


def check(name: str) -> None:
    """Refuse a format that is not known.

    Raises
    ------
    OptionError
        If it is not.
    """
    if name not in (FEATURES, *FORMATS):
        raise OptionError.unknown("as_", name, (FEATURES, *FORMATS))


def save(out: Path, name: str, cameras: Cameras, table: pd.DataFrame, rig: Rig) -> Path:
    """Write lenses as a format has them, or the features with them; see `irbcal.measurement.lens.LensCalibration`."""
    check(name)
    if len(cameras) > MOST_CAMERAS.get(name, len(cameras)):
        most = "one camera" if MOST_CAMERAS[name] == 1 else f"{MOST_CAMERAS[name]} cameras"
        raise OptionError(
            f"as_: a file of {name} has {most}, here are {', '.join(cameras)}: take kalibr", parameter="as_"
        )
    data = csv_bytes(table) if name == FEATURES else _module(name).write(cameras, rig).encode()
    write_set({out: data})
    return out


def read(path: Path) -> dict[str, tuple[FloatArray, tuple[int, int]]]:
    """Lenses of a file.

    Raises
    ------
    MeasurementError
        If it is of no known format, or of a lens that is no pinhole with Brown's distortion.
    """
    content = content_of(path)
    for name in FORMATS:
        try:
            cameras: dict[str, tuple[FloatArray, tuple[int, int]]] | None = _module(name).read(content)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise MeasurementError(
                f"this is no lens as {_module(name).DESCRIPTION} has it: {error}", file=str(path)
            ) from None
        if cameras is not None:
            for numbers, size in cameras.values():
                if numbers.shape != (9,) or not np.isfinite(numbers).all() or min(*numbers[:2], *size) <= 0:
                    raise MeasurementError(
                        "expected a pinhole with at most five numbers of distortion (k1 k2 p1 p2 k3)", file=str(path)
                    )
            return cameras
    known = ", ".join(_module(name).DESCRIPTION for name in FORMATS)
    raise MeasurementError(f"expected a lens: {known}", file=str(path))


def content_of(path: Path) -> Any:
    """What a file of YAML, JSON or OpenCV's XML holds."""
    data = read_bytes(path, MeasurementError)
    if not data.lstrip().startswith(b"<"):
        # OpenCV's header is no YAML, nor are the tabs in its JSON; ros2 topic echo ends with a line
        data = data.rstrip().removesuffix(b"---").expandtabs()
        return yaml_of(path, data.replace(b"%YAML:1.0", b"", 1).replace(b"!!opencv-matrix", b""))
    from lxml import etree

    try:
        root = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as error:
        raise MeasurementError(f"expected XML, found {error}", file=str(path)) from None
    return {str(item.tag): _of_xml(item) for item in root}


def _of_xml(element: Any) -> Any:
    """A matrix, a sequence of them, or a text."""
    if len(element) and all(each.tag == "_" for each in element):
        return [_of_xml(each) for each in element]
    return {"data": (element.findtext("data") or "").split()} if len(element) else element.text


def brown(K: Any, distortion: Any) -> FloatArray:
    """The nine numbers of a camera matrix and up to five of distortion.

    Raises
    ------
    ValueError
        If there are more that are not zero.
    """
    K = np.asarray(K, dtype=float).reshape(3, 3)
    d = np.ravel(np.asarray(distortion, dtype=float))
    if np.any(d[5:] != 0.0):
        raise ValueError(f"{len(d)} numbers of distortion, expected at most 5 (k1 k2 p1 p2 k3)")
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *d[:5], *np.zeros(max(5 - len(d), 0))])


def _module(name: str) -> Any:
    return import_module(f"irbcal.measurement.lens_formats.{name}")
