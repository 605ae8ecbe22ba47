"""Bags of ROS 2 (mcap, sqlite3) and ROS 1: joint states with pictures or points, where the robot stands a row of each.

The reading is that of the package ``rosbags``, which is not installed with irbcal but with its extra ``ros``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import imaging
from irbcal.measurement.boards import opencv
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.features import given_rows
from irbcal.measurement.input_table import TableLike, TextRow
from irbcal.measurement.lens_formats import ros
from irbcal.measurement.pictures import IMAGE
from irbcal.measurement.recordings import Recording
from irbcal.modeling.arm import Arm
from irbcal.units import MM

DESCRIPTION = "a bag of ROS 2 or ROS 1"
ENDINGS = (".mcap", ".db3", ".bag")
STILL_S = 0.5
"""The robot stands where no joint moved by more than `STILL` for so long, seconds."""
STILL = 5e-4
"""Radians (metres)."""
MOST_PICTURES = 60
"""Pictures of a camera that a lens is calibrated from."""
TOGETHER_S = 0.1
"""Between the pictures of two cameras of a rig and those nearest to them, seconds, in the median."""
GAP_S = 1.0
"""Between joint states, above which nothing is known of the robot."""
JOINTS, POINT = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PointStamped"
INFO, INFO_FIELDS = "sensor_msgs/msg/CameraInfo", ("k", "d", "width", "height", "distortion_model")
PICTURES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CHANNELS = {"mono8": 1, "8UC1": 1, "rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4}
"""Of the pictures that are read, by their encoding."""


def read(path: Path, features: TableLike | None, arm: Arm | None = None) -> Recording | None:
    """The recording; None where this is no bag."""
    if not is_bag(path):
        return None
    if arm is None:
        raise OptionError("robot: name the robot whose joints the bag has", parameter="robot")
    if features is None:
        return Recording(pd.DataFrame(), None)
    with opened(path) as bag:
        return _recorded(bag, arm, given_rows(features), features, str(path))


def is_bag(path: Path) -> bool:
    """Whether this is a bag by its name."""
    return path.suffix in ENDINGS or (path.is_dir() and (path / "metadata.yaml").is_file())


def pictures_over_time(path: Path, rows: list[TextRow]) -> dict[str, dict[str, Any]]:
    """Up to `MOST_PICTURES` pictures in grey of each feature, evenly over the bag, by topic and stamp; of lenses alone.

    Of cameras that are triggered together those that were taken together.

    Raises
    ------
    MeasurementError
        If it is no bag, or its topics do not tell the cameras.
    """
    out: dict[str, dict[str, Any]] = {}
    with opened(path) as bag:
        shown_at = _cameras(bag, rows, str(path))
        stamps: dict[str, list[float]] = {}
        for topic, at, _ in _messages(bag, PICTURES):
            stamps.setdefault(topic, []).append(at)
        first = np.array(next((stamps[topic] for topic in shown_at if shown_at[topic] and topic in stamps), []))
        chosen: dict[str, set[float]] = {}
        for topic, times in stamps.items():
            nearest = np.array(times)[np.abs(np.subtract.outer(_evenly(first), times)).argmin(axis=1)]
            together = len(nearest) and np.median(np.abs(nearest - _evenly(first))) < TOGETHER_S
            chosen[topic] = set((nearest if together else _evenly(np.array(times))).tolist())
        for topic, at, message in _messages(bag, PICTURES):
            for row in shown_at.get(topic, []) if at in chosen[topic] else ():
                out.setdefault(row["feature"], {})[f"{topic} {at:.6f}"] = _grey(message, str(path))
    if not out:
        raise MeasurementError("there are no pictures of these cameras in the bag", file=str(path))
    return out


def lens_fields(info: Any) -> dict[str, Any]:
    """What a message of `INFO` says of the lens; in ROS 1 K and D are capital letters."""
    return {name: getattr(info, name if hasattr(info, name) else name.upper()) for name in INFO_FIELDS}


def _evenly(times: FloatArray) -> FloatArray:
    return times[np.linspace(0, len(times) - 1, min(len(times), MOST_PICTURES)).round().astype(int)]


@contextmanager
def opened(path: Path, definitions: Mapping[str, str] | None = None) -> Iterator[Any]:
    """The bag; what the package says of damaged ones is refused in one sentence.

    Parameters
    ----------
    path : Path
    definitions : dict of str to str, optional
        Of messages beside ROS's own, for bags that do not hold them.
    """
    folder = path if path.is_dir() else path.parent
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise OptionError(
            "bags need the package rosbags, which is not installed here: pip install 'irbcal[ros]'"
        ) from None
    alone = path.is_dir() or path.suffix == ".bag" or not (folder / "metadata.yaml").is_file()
    source = path if alone else folder
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in (definitions or {}).items():
        store.register(get_types_from_msg(text, name))
    try:
        with AnyReader([source], default_typestore=store) as bag:
            yield bag
    except (MeasurementError, OptionError):
        raise
    except (AnyReaderError, OSError, ValueError, KeyError, TypeError, AssertionError, RuntimeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise MeasurementError(f"expected {DESCRIPTION}: {reason}", file=str(path)) from None


def _recorded(bag: Any, arm: Arm, rows: list[TextRow], features: TableLike, source: str) -> Recording:
    start, end, q = _stands(bag, arm, source)
    joints = dict(zip(arm.joint_columns, (q / arm.joint_units).T, strict=True))
    pictures, points = _pictures(bag, rows, start, end, source), _points(bag, rows, start, end)
    taken: dict[str, Any] = {}
    table: list[dict[str, Any]] = []
    for (feature, k), message in pictures.items():
        name = f"stand {k + 1}" if len({at for at, _ in pictures}) == 1 else f"stand {k + 1} {feature}"
        taken[name] = _grey(message, source)
        table.append({IMAGE: name, "pose": f"stand {k + 1}", "feature": feature, "stand": k})
    for (feature, k), xyz in points.items():
        place = dict(zip(POSITION, xyz / MM, strict=True))
        table.append({"pose": f"stand {k + 1}", "feature": feature, "stand": k, **place})
    if not table:
        raise MeasurementError(
            f"the robot stood {len(start)} times, but no picture or point of a feature was recorded meanwhile",
            file=source,
        )
    cells = pd.DataFrame(table)
    at = cells.pop("stand").to_numpy()
    cells = cells.assign(**{name: values[at] for name, values in joints.items()})
    note = f"the robot stood {len(start)} times for {STILL_S:g} s and longer; {len(set(at))} of them were used"
    lenses = _lenses(bag, rows, source)
    return Recording(cells, features if lenses is None else lenses, pictures=taken or None, notes=(note,))


def _time(message: Any, recorded: int) -> float:
    """When a message was made, seconds; when it was recorded where it does not say that."""
    stamp = message.header.stamp
    made = stamp.sec + 1e-9 * stamp.nanosec
    return float(made or 1e-9 * recorded)


def _messages(bag: Any, kinds: tuple[str, ...]) -> Any:
    connections = [c for c in bag.connections if c.msgtype in kinds]
    for connection, recorded, data in bag.messages(connections) if connections else ():
        message = bag.deserialize(data, connection.msgtype)
        yield connection.topic, _time(message, recorded), message


def _stands(bag: Any, arm: Arm, source: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """When the robot stood, (n,) and (n,), seconds, and its joints then, (n, joints)."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    by_topic: dict[str, list[tuple[float, list[float]]]] = {}
    others: set[str] = set()
    for topic, at, message in _messages(bag, (JOINTS,)):
        position = dict(zip(message.name, message.position, strict=False))
        if set(arm.joint_names) <= set(position):
            by_topic.setdefault(topic, []).append((at, [float(position[name]) for name in arm.joint_names]))
        else:
            others |= set(position)
    if not by_topic:
        raise MeasurementError(
            f"no joint states of {', '.join(arm.joint_names)}; found {', '.join(sorted(others)) or 'none'}", file=source
        )
    series = sorted(by_topic[max(by_topic, key=lambda topic: len(by_topic[topic]))])
    t, q = np.array([at for at, _ in series]), np.array([joints for _, joints in series])
    step = np.diff(t, prepend=t[0])
    width = max(int(np.ceil(STILL_S / max(float(np.median(step)), 1e-6))), 2)
    moved = (maximum_filter1d(q, width, axis=0) - minimum_filter1d(q, width, axis=0)).max(axis=1) > STILL
    gap = step > GAP_S
    still = ~(moved | gap | np.r_[gap[1:], False])
    edge = np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0))
    first, last = edge[::2], edge[1::2]
    keep = [np.ptp(q[a:b], axis=0).max() <= 2.0 * STILL for a, b in zip(first, last, strict=True)]
    first, last = first[keep], last[keep]
    if not len(first):
        raise MeasurementError(f"the robot never stood for {STILL_S:g} s", file=source)
    joints = np.array([q[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)])
    return t[first], t[last - 1], joints


def _stand_of(at: float, start: FloatArray, end: FloatArray) -> int:
    """The stand in which a time lies; -1 where the robot moved."""
    k = int(np.searchsorted(start, at, side="right")) - 1
    return k if k >= 0 and at <= end[k] else -1


def _pictures(
    bag: Any, rows: list[TextRow], start: FloatArray, end: FloatArray, source: str
) -> Mapping[tuple[str, int], Any]:
    """The picture nearest to the middle of each stand, by feature."""
    of = _cameras(bag, rows, source)
    best: dict[tuple[str, int], tuple[float, Any]] = {}
    for topic, at, message in _messages(bag, PICTURES):
        k = _stand_of(at, start, end)
        if k < 0 or not of.get(topic):
            continue
        key = of[topic][0]["feature"], k
        off = abs(at - 0.5 * (start[k] + end[k]))
        if key not in best or off < best[key][0]:
            best[key] = off, message
    return {key: message for key, (_, message) in best.items()}


def _cameras(bag: Any, rows: list[TextRow], source: str) -> Mapping[str, list[TextRow]]:
    """The feature that the pictures of a topic show, by topic."""
    shown = [row for row in rows if row["kind"] in imaging.TARGETS]
    features_of = _by_topic(bag, shown, PICTURES)
    if (
        shown
        and features_of
        and (not any(features_of.values()) or any(len(features) > 1 for features in features_of.values()))
    ):
        raise MeasurementError(
            f"pictures of {', '.join(features_of)}: expected one feature for each, its camera named by a part of the "
            "topic",
            file=source,
        )
    return features_of


def _by_topic(bag: Any, shown: list[TextRow], kinds: tuple[str, ...]) -> dict[str, list[TextRow]]:
    """Features by topics of some kinds, a part of which names the camera; of a single topic all where none does."""
    topics = sorted({c.topic for c in bag.connections if c.msgtype in kinds})
    features_of = {t: [r for r in shown if imaging.camera_and_board(r)[0] in t.split("/")] for t in topics}
    return {topics[0]: features_of[topics[0]] or shown} if len(topics) == 1 else features_of


def _lenses(bag: Any, rows: list[TextRow], source: str) -> pd.DataFrame | None:
    """The features with lenses of the bag's `INFO`, where the features do not say them; None where there are none."""
    unknown = [row for row in rows if row["kind"] in imaging.TARGETS and not row.get(imaging.LENS[0])]
    features_of = _by_topic(bag, unknown, (INFO,))
    filled = False
    for topic, _, message in _messages(bag, (INFO,)) if unknown else ():
        info = lens_fields(message)
        if not features_of[topic] or not info["k"][0]:  # zeros: the camera is not calibrated
            continue
        try:
            cameras = ros.read(info)
        except ValueError as error:
            raise MeasurementError(f"{topic}: this is no lens: {error}", file=source) from None
        for numbers, size in (cameras or {}).values():
            for row in features_of.pop(topic):
                row |= imaging.lens_columns(numbers, size)
                filled = True
        features_of[topic] = []
    return pd.DataFrame(rows).fillna("") if filled else None


def _points(bag: Any, rows: list[TextRow], start: FloatArray, end: FloatArray) -> Mapping[tuple[str, int], FloatArray]:
    """Mean of the points of each stand, metres; the topic names the feature."""
    names = {row["feature"] for row in rows}
    gathered: dict[tuple[str, int], list[list[float]]] = {}
    for topic, at, message in _messages(bag, (POINT,)):
        k, feature = _stand_of(at, start, end), topic.strip("/")
        if k >= 0 and feature in names:
            gathered.setdefault((feature, k), []).append([message.point.x, message.point.y, message.point.z])
    return {key: np.mean(values, axis=0) for key, values in gathered.items()}


def _grey(message: Any, source: str) -> Any:
    cv2 = opencv()
    data = np.asarray(message.data, dtype=np.uint8)
    if not hasattr(message, "encoding"):
        grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise MeasurementError(f"a picture ({message.format}) is not one that OpenCV reads", file=source)
        return grey
    channels = CHANNELS.get(message.encoding)
    if channels is None:
        raise MeasurementError(
            f"expected pictures encoded as one of {', '.join(CHANNELS)}, found {message.encoding}", file=source
        )
    rows = data.reshape(message.height, message.step)[:, : message.width * channels]
    picture = np.ascontiguousarray(rows.reshape(message.height, message.width, channels))
    if channels == 1:
        return picture[:, :, 0]
    order = "RGB" if message.encoding.startswith("rgb") else "BGR"
    return cv2.cvtColor(picture, getattr(cv2, f"COLOR_{order}{'A' if channels == 4 else ''}2GRAY"))
