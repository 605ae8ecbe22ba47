"""Data folders of ROS-Industrial's industrial_calibration and of its forerunner robot_cal_tools.

A YAML file lists pictures with files of the flange's pose (``data``, or the list alone); the same file, or others
beside it, say ``intrinsics``, ``target_finder`` and ``static_camera``: whether the camera stands in the hall.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement import board_formats
from irbcal.measurement.board_formats import yaml_of
from irbcal.measurement.column_names import POSE
from irbcal.measurement.input_table import TableLike
from irbcal.measurement.pictures import IMAGE, read_picture
from irbcal.measurement.recordings import FLANGE, Recording, transforms
from irbcal.modeling.arm import Arm

DESCRIPTION = "a data folder of industrial_calibration or robot_cal_tools"


def read(path: Path, features: TableLike | None, arm: Arm | None = None) -> Recording | None:
    """The recording; None where this is no such folder."""
    listed = _listed(path)
    if listed is None:
        return None
    source, content, pairs = listed
    folder = source.parent
    poses = transforms([(str(folder / pair["pose"]), yaml_of(folder / pair["pose"])) for pair in pairs])
    rows = poses.rename(columns=dict(zip(POSE, FLANGE, strict=True)))
    rows.insert(0, IMAGE, [pair["image"] for pair in pairs])
    return Recording(rows, _features(source, content, rows) if features is None else features, folder)


def _listed(path: Path) -> tuple[Path, Any, list[dict[str, str]]] | None:
    """The file with the list, its content and the list."""
    for file in sorted([*path.glob("*.yaml"), *path.glob("*.yml")]) if path.is_dir() else [path]:
        if file.suffix not in (".yaml", ".yml"):
            continue
        content = yaml_of(file)
        pairs = content.get("data") if isinstance(content, dict) else content
        if not isinstance(pairs, list) or not pairs or not isinstance(pairs[0], dict) or "pose" not in pairs[0]:
            continue
        for k, pair in enumerate(pairs, 1):
            if not isinstance(pair, dict) or not all(isinstance(pair.get(n), str) for n in ("pose", "image")):
                raise MeasurementError(
                    f"entry {k} of the list: expected pose and image, names of files", file=str(file)
                )
        return file, content, pairs
    return None


def _features(source: Path, content: Any, rows: pd.DataFrame) -> pd.DataFrame:
    """Camera and board as the file or others beside it say."""
    described: dict[str, tuple[Any, Path]] = {}
    if isinstance(content, dict):
        described = {name: (value, source) for name, value in content.items()}
    for file in sorted(source.parent.glob("*.yaml")):
        beside = yaml_of(file) if file != source else None
        if not isinstance(beside, dict):
            continue
        if "type" in beside and "rows" in beside:
            beside = {board_formats.FINDER: beside}
        for name in ("intrinsics", board_formats.FINDER, board_formats.STATIC):
            if name not in beside or (name in described and described[name][1] == source):
                continue
            if name in described and described[name][0] != beside[name]:
                raise MeasurementError(
                    f"{name} is another in {described[name][1].name}: give camera and board (--features)",
                    file=str(file),
                )
            described[name] = beside[name], file
    missing = [name for name in (board_formats.FINDER, board_formats.STATIC) if name not in described]
    if missing:
        raise MeasurementError(
            f"no file of the folder says {' and '.join(missing)}: give camera and board (--features)", file=str(source)
        )
    finder, source_file = described[board_formats.FINDER]
    cells = board_formats.board({board_formats.FINDER: finder}, str(source_file))
    cells = board_formats.feature(cells, bool(described[board_formats.STATIC][0]))
    lens, source_file = described.get("intrinsics", (None, source))
    if lens is None:
        picture = source.parent / str(rows[IMAGE][0])
        grey = read_picture(picture)
        if grey is None:
            raise MeasurementError("there is no such picture that OpenCV reads", file=str(picture))
        return pd.DataFrame([cells | {"width_px": str(grey.shape[1]), "height_px": str(grey.shape[0])}])
    try:
        numbers = {f"{name}_px": repr(float(lens[name])) for name in ("fx", "fy", "cx", "cy")}
    except (KeyError, TypeError, ValueError):
        raise MeasurementError("expected intrinsics with fx, fy, cx and cy", file=str(source_file)) from None
    return pd.DataFrame([cells | numbers])
