"""Devices in place of a tracker in the virtual cell: what they are, what they see, SIMULATED rows at their features.

Sizes and distances are shares of the arm's reach. The camera's centre is where other devices have their ball.

Devices that stand in for a tracker: what features they are, where to put them about an arm, poses that touch them.

Places are in the base link, scaled to the arm's reach. Poses are found by moving random joints of an arm until they
meet what the device's kind asks for; a camera's are those that see the board, those of strings any above the floor.
Where a device is of a kind with other unknowns than a place, `placed` says what they are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd

from irbcal import safe_files
from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.declared_options import takes_fields_of
from irbcal.distributions import NORMAL_95
from irbcal.errors import IdentificationError
from irbcal.identification.observation_kind import Observed
from irbcal.identification.observations import KINDS
from irbcal.measurement import imaging, pinhole
from irbcal.measurement.boards import MARKER, Board
from irbcal.measurement.column_names import PAYLOAD_CENTRE
from irbcal.measurement.features import TARGET, Feature, FeatureSet
from irbcal.measurement.features import read as read_features
from irbcal.measurement.imaging import Imaging
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import any_arm
from irbcal.modeling.terms import chain
from irbcal.names import csv_bytes
from irbcal.option_values import MOST_POSES, number
from irbcal.simulation.shipped_cells import asked_cell
from irbcal.simulation.simulation_options import DeviceOptions
from irbcal.simulation.virtual_cell import VirtualCell
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM

LENS = (1400.0, 1400.0, 960.0, 600.0, -0.1, 0.06, 0.0, 0.0, 0.0)
SIZE, SQUARES = (1920.0, 1200.0), (8, 6)
"""Pixels of an image, squares of a board."""

SQUARE, NEAR, FAR, ASIDE = 0.02, 0.22, 0.45, 0.15
"""Side of a square, and distances of camera and board, in shares of the reach; where the board is in the image, beside
its middle, in shares of the distance."""

CAMERA_AXES: FloatArray = frames.rotation_from_vector(np.array([0.03, -0.02, 0.4]))
"""Axes of the camera in the tip link: it looks along the tool."""

TILT: FloatArray = frames.with_third(np.array([0.8, 0.0, 0.6]))
"""Axis of an inclinometer in the tip link, the third: neither along the tool nor across it, so that all joints but the
first turn it."""

MARGIN = 25.0
"""Pixels that corners keep from the image's edge: the robot ends somewhere else."""


def camera_imaging(reach: float, noise: float) -> Imaging:
    """Camera and board for an arm; ``noise`` (metres) is that of an image as a whole."""
    square = max(round(SQUARE * reach / MM), 2.0) * MM
    board = Board("charuco", *SQUARES, square, MARKER * square, "DICT_5X5_100")
    imaging = Imaging(np.array(LENS), (), board, SIZE)
    return Imaging(imaging.lens, (), board, SIZE, round(NORMAL_95 * pixel_noise(imaging, reach, noise), 4) or 1e-3)


def pixel_noise(imaging: Imaging, reach: float, noise: float) -> float:
    """Standard deviation of a corner in pixels where that of an image as a whole is ``noise``, metres."""
    pixel = 0.5 * (NEAR + FAR) * reach / imaging.lens[0]
    return float(noise * np.sqrt(len(imaging.corners)) / pixel)


def board(imaging: Imaging, middle: FloatArray, normal: FloatArray) -> dict[str, FloatArray]:
    """Unknowns of a board with its middle at a place; as OpenCV has it, z goes into the board."""
    Q = frames.with_third(-np.asarray(normal))
    assert imaging.board is not None
    edges = imaging.board.pitch * np.array([imaging.board.across, imaging.board.along, 0.0])
    return {"centre": middle - Q @ (0.5 * edges), "attitude": Q}


def pointers(count: int, reach: float, rng: np.random.Generator, camera: FloatArray) -> FloatArray:
    """Points before a camera at ``camera`` of the tip link for a board's middle, (count, 3), tip link."""
    far = reach * rng.uniform(NEAR, FAR, count)
    sideways = far[:, None] * rng.uniform(-ASIDE, ASIDE, (count, 2))
    return camera + np.column_stack([sideways, far]) @ CAMERA_AXES.T


def pixels(
    imaging: Imaging, unknowns: dict[str, FloatArray], T: FloatArray, camera: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where corners are in the image, (n, k, 2), and in camera axes, (n, k, 3), with the tip at T (n, 4, 4)."""
    x = np.column_stack([imaging.corners, np.zeros(len(imaging.corners))])
    p = T[:, :3, 3] + T[:, :3, :3] @ camera
    y = (unknowns["centre"] + x @ unknowns["attitude"].T - p[:, None]) @ (T[:, :3, :3] @ CAMERA_AXES)
    return pinhole.project(imaging.lens, y)[0], y


def visible(
    imaging: Imaging, unknowns: dict[str, FloatArray], T: FloatArray, camera: FloatArray, cone: float
) -> BoolArray:
    """Whether the whole board is in the image and seen from its front within an angle of its normal, (n,)."""
    uv, y = pixels(imaging, unknowns, T, camera)
    inside = ((uv > MARGIN) & (uv < np.array(SIZE) - MARGIN)).all(axis=(1, 2)) & (y[..., 2] > 0.0).all(axis=1)
    into = T[:, :3, :3] @ CAMERA_AXES
    middle = y.mean(axis=1)
    along = np.einsum("nij,nj->ni", into, middle / np.linalg.norm(middle, axis=1)[:, None])
    return np.asarray(inside & (along @ unknowns["attitude"][:, 2] > np.cos(cone)))


BALL = (12.0 * MM, -7.0 * MM, 110.0 * MM)
"""Where the ball or probe is on the tool, in the tip link."""

TRIES, MOST_STEPS, LARGEST_STEP, REACHED = 20, 25, 0.25, 1e-9
"""Random joints tried for a pose, Newton steps and the largest of them (radians), and what counts as met, metres."""

KeepPoses = Callable[[FloatArray], BoolArray]
Tips = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Spot:
    """A feature of a device."""

    name: str
    at: tuple[float, float, float]
    """Place in shares of the arm's reach: out to the front, to the left, up."""
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Added to it, metres."""
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Where it is open: of a plane, and of a socket's or ball's upper side."""


@dataclass(frozen=True)
class Device:
    """A device."""

    name: str
    description: str
    kind: str
    """Of its rows, see `irbcal.identification.observations`."""
    spots: tuple[Spot, ...]
    lengths: bool = False
    """Whether the distances between its features are known."""
    bar: float | None = None
    """Length of a ballbar, the shortest of several, in shares of the reach."""
    travel: float = 0.0
    """What its longest length is more, likewise."""
    lengths_of_bar: int = 1
    """Number of its lengths, evenly spaced over the travel; 0 where it telescopes."""
    noise: float = 0.03 * MM
    """Standard deviation of a coordinate that is plausible for it, metres. Of a camera: of an image as a whole; of an
    inclinometer at the end of a lever of 0.3 m (`irbcal.modeling.frames.LEVER`).
    """
    cone: float = 60.0 * DEG
    """Largest angle between the tool's axis and what it is turned to (the surface, the bar, the string), radians;
    between a camera's view and a board's normal; between an inclinometer's axis and the horizontal.
    """

    @property
    def touched(self) -> bool:
        """Whether the tool touches its features, and nothing is read."""
        return not KINDS[self.kind].needs

    @property
    def sees(self) -> bool:
        """Whether it is a camera."""
        return self.kind in imaging.TARGETS

    @property
    def tilts(self) -> bool:
        """Whether it shows how the tool is turned, wherever that is: an inclinometer."""
        return not KINDS[self.kind].pointed

    @property
    def target(self) -> str:
        """What the tool carries."""
        return "inclinometer" if self.tilts else imaging.TARGETS.get(self.kind, TARGET)


_FRONT = (0.55, 0.0, 0.30)
_CORNERS = ((0.42, -0.32, 0.15), (0.42, 0.32, 0.15), (0.70, 0.0, 0.20), (0.50, 0.0, 0.55))
_STATIONS = ((1.1, -0.9, 0.0), (1.1, 0.9, 0.0), (0.3, 0.0, 1.6))


def _spots(name: str, places: Sequence[tuple[float, float, float]]) -> tuple[Spot, ...]:
    return tuple(Spot(f"{name} {k}", at) for k, at in enumerate(places, 1))


_BALLBAR = Device(
    "ballbar",
    "a ballbar about three centres, their distances known",
    "radius",
    _spots("centre", _CORNERS[:3]),
    lengths=True,
    bar=0.17,
    cone=90.0 * DEG,
)
_LENGTHS = "a ballbar of three lengths about three centres, their distances known"
_TELESCOPE = "a telescoping ballbar about three centres, their distances known"
DEVICES: Mapping[str, Device] = {
    device.name: device
    for device in (
        Device(
            "balls", "four balls or sockets, their distances known", "point", _spots("ball", _CORNERS), lengths=True
        ),
        Device(
            "string",
            "three string encoders or laser distances",
            "radius",
            _spots("string", _STATIONS),
            noise=0.05 * MM,
            cone=120.0 * DEG,
        ),
        _BALLBAR,
        replace(_BALLBAR, name="ballbars", description=_LENGTHS, bar=0.10, travel=0.14, lengths_of_bar=3),
        replace(_BALLBAR, name="telescope", description=_TELESCOPE, travel=0.08, lengths_of_bar=0),
        Device(
            "two-balls",
            "two balls 300 mm apart",
            "point",
            (Spot("ball 1", _FRONT, (0.0, -0.15, 0.0)), Spot("ball 2", _FRONT, (0.0, 0.15, 0.0))),
            lengths=True,
        ),
        Device(
            "sockets",
            "two sockets 50 mm apart",
            "point",
            (Spot("socket 1", _FRONT, (0.0, -0.025, 0.0)), Spot("socket 2", _FRONT, (0.0, 0.025, 0.0))),
            lengths=True,
        ),
        Device("ball", "one ball", "point", (Spot("ball 1", _FRONT),)),
        Device(
            "camera",
            "a camera on the arm, boards at three places",
            "image-on-tool",
            _spots("board", _CORNERS[:3]),
            cone=50.0 * DEG,
        ),
        Device("inclinometer", "an inclinometer on the tool", "angle", (Spot("level", (0.0, 0.0, 0.0)),)),
        Device(
            "plane",
            "three planes",
            "plane",
            (
                Spot("floor", (0.55, 0.0, 0.1)),
                Spot("front", (0.75, 0.0, 0.3), normal=(-1.0, 0.0, 0.0)),
                Spot("side", (0.55, 0.35, 0.3), normal=(0.0, -1.0, 0.0)),
            ),
        ),
    )
}
"""Devices by name, as `irbcal.compare_devices` lists them."""


@dataclass(frozen=True, eq=False)
class Placed(Locked):
    """A device about an arm: its features' unknowns as they are."""

    device: Device
    unknowns: Mapping[str, Mapping[str, FloatArray]]
    """By feature: the unknowns of the device's kind."""
    bar: float
    """Metres; zero for other devices."""
    middle: Mapping[str, FloatArray]
    """Values of shape (3,). By feature: its place, a point of planes."""
    reach: float
    """Of the arm, metres."""
    imaging: Imaging | None = None
    """Camera and board."""

    def table(self) -> pd.DataFrame:
        """What is known of the features, as the second file of `irbcal.measurement.features`."""
        columns: dict[str, object] = {"offset_mm": 0.0} if self.device.bar else {}
        if self.imaging is not None:
            columns |= {name: value for name, value in self.imaging.columns().items() if value}
        rows: list[dict[str, object]] = [
            {"feature": name, "kind": self.device.kind, "target": self.device.target, **columns}
            for name in self.unknowns
        ]
        if self.device.lengths:
            for first, second in combinations(self.unknowns, 2):
                length = np.linalg.norm(self.unknowns[first]["centre"] - self.unknowns[second]["centre"])
                ends = {"first": first, "second": second, "length_mm": round(float(length) / MM, 4), "u95_mm": 0.02}
                rows.append({"feature": f"{first} to {second}", "kind": "distance", **ends})
        return pd.DataFrame(rows).astype(object).where(lambda t: t.notna(), "")

    def by_key(self) -> dict[tuple[str, str], FloatArray]:
        """What is true of features and tool, by the keys of `irbcal.identification.feature_problem`."""
        out = {(name, feature): value for feature, values in self.unknowns.items() for name, value in values.items()}
        if self.device.tilts:
            return out | {("axis", self.device.target): TILT}
        out["tool", self.device.target] = np.array(BALL)
        return out | ({("axes", self.device.target): CAMERA_AXES} if self.device.sees else {})

    def with_noise(self, noise: float) -> Placed:
        """The same, what is known of it told with another noise (metres)."""
        if self.imaging is None:
            return self
        return replace(self, imaging=camera_imaging(self.reach, noise))


def placed(arm: Arm, device: Device) -> Placed:
    """A device in front of an arm."""
    reach = any_arm.reach(arm, 2000)
    unknowns: dict[str, dict[str, FloatArray]] = {}
    view = camera_imaging(reach, device.noise) if device.sees else None
    middle = {spot.name: reach * np.array(spot.at) + np.array(spot.shift) for spot in device.spots}
    for spot in device.spots:
        centre = middle[spot.name]
        n = np.array(spot.normal)
        if view is not None:
            unknowns[spot.name] = board(view, centre, n)
        elif device.tilts:
            unknowns[spot.name] = {"up": frames.with_third(n)}
        elif device.kind == "plane":
            unknowns[spot.name] = {"normal": frames.with_third(n), "height": np.array([n @ centre])}
        else:
            unknowns[spot.name] = {"centre": centre}
            if device.kind == "radius":
                unknowns[spot.name]["offset"] = np.array([0.0 if device.bar else 0.05 * reach])
    return Placed(device, unknowns, 0.0 if device.bar is None else round(reach * device.bar, 3), middle, reach, view)


def touched_poses(
    arm: Arm,
    features: Placed,
    feature: str,
    q: FloatArray,
    tips: Tips | None = None,
    off: FloatArray | None = None,
    tool: FloatArray | None = None,
) -> tuple[FloatArray, BoolArray]:
    """Joints moved until the tool meets a feature.

    Parameters
    ----------
    arm : Arm
        Nominal; its Jacobian is taken.
    features : Placed
    feature : str
    q : ndarray, shape (n, joints)
        Where to begin.
    tips : callable, optional
        From joints to the real tip frames (n, 4, 4); the nominal arm's unless given.
    off : ndarray, shape (n, k), optional
        Predicted minus measured to end at: noise of the contact.
    tool : ndarray, shape (n, 3), optional
        The tool's point in the tip link; `BALL` unless given.

    Returns
    -------
    q : ndarray, shape (n, joints)
    good : ndarray of bool, shape (n,)
    """
    q, tool = np.array(q, dtype=float), np.broadcast_to(BALL if tool is None else tool, (len(q), 3))
    good, rows = np.zeros(len(q), dtype=bool), np.arange(len(q))
    for _ in range(MOST_STEPS):
        r, J = _missed(arm, features, feature, rows, q[rows], tips, tool[rows])
        r = r if off is None else r + off[rows]
        good[rows] = near = np.abs(r).max(axis=1) < (REACHED if tips is None else 1e-7)
        if near.all():
            break
        step = (np.linalg.pinv(J, rcond=1e-3) @ r[..., None])[..., 0]
        size = np.abs(step).max(axis=1, keepdims=True)
        q[rows] += step * np.minimum(1.0, LARGEST_STEP / np.maximum(size, 1e-12))
        if tips is None:  # else each is where all are
            rows = rows[~near]
    return q, good


def _missed(
    arm: Arm, features: Placed, feature: str, rows: IntArray, q: FloatArray, tips: Tips | None, tool: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, k) and derivatives of predictions by the joints (n, k, joints); features may have many centres."""
    path = chain.walk(arm, q)
    T = chain.poses(path) if tips is None else tips(q)
    n = len(q)
    p = T[:, :3, 3] + np.einsum("nij,nj->ni", T[:, :3, :3], tool)
    nothing = np.full((n, 3), np.nan)
    value = np.full(n, features.bar)
    view = Observed(Feature(feature, features.device.kind), p, T[:, :3, :3], value, nothing, np.full((n, 3, 3), np.nan))
    unknowns = features.unknowns[feature]
    if "centre" in unknowns and unknowns["centre"].ndim == 2:
        unknowns = {**unknowns, "centre": unknowns["centre"][rows]}
    miss = KINDS[features.device.kind].residuals(view, unknowns)
    J = miss.point @ chain.by_joints(path, arm, p.T).T
    if miss.turn is not None:
        J = J + miss.turn @ chain.by_joints(path, arm).T
    return miss.r, J


def drawn(arm: Arm, features: Placed, feature: str, count: int, seed: int, patch: float | None = None) -> FloatArray:
    """Those of so many random joints that were brought to meet a feature within the limits, shape (n, joints).

    With ``patch``, planes are met at random places of a square about their middle only, with this half edge, metres.
    """
    q = arm.random_joints(count, seed)
    good = np.ones(len(q), dtype=bool)
    if patch is not None and features.device.kind == "plane":
        across = np.random.default_rng(seed).uniform(-patch, patch, (count, 2))
        spots = features.middle[feature] + across @ features.unknowns[feature]["normal"][:, :2].T
        features = replace(
            features, device=replace(features.device, kind="point"), unknowns={feature: {"centre": spots}}
        )
    if features.imaging is not None:
        q, good = _seeing(arm, features, feature, q, seed)
    elif features.device.tilts:
        tilt = values(arm, features, q, np.zeros(count, dtype=int))
        good = np.abs(np.asarray(tilt)) < features.device.cone
    elif features.device.kind == "radius" and not features.bar:
        good = arm.forward(q)[:, 2, 3] > 0.0
    else:
        rng, device = np.random.default_rng(seed), features.device
        longer = (
            rng.uniform(size=count) if not device.lengths_of_bar else rng.integers(device.lengths_of_bar, size=count)
        )
        longer = longer * device.travel * features.reach / max(device.lengths_of_bar - 1, 1)
        q, good = touched_poses(arm, features, feature, q, off=longer[:, None] if device.travel else None)
    margin = 2.0 * DEG * ~arm.table.prismatic
    good &= ((q > arm.lower + margin) & (q < arm.upper - margin)).all(axis=1)
    return q[good]


def _seeing(arm: Arm, features: Placed, feature: str, q: FloatArray, seed: int) -> tuple[FloatArray, BoolArray]:
    """Joints moved until a board is before the camera, and whether all of it is in the image."""
    assert features.imaging is not None
    tool = pointers(len(q), features.reach, np.random.default_rng(seed), np.array(BALL))
    at = replace(
        features,
        device=replace(features.device, kind="point"),
        unknowns={feature: {"centre": features.middle[feature]}},
    )
    q, good = touched_poses(arm, at, feature, q, tool=tool)
    unknowns = dict(features.unknowns[feature])
    good &= visible(features.imaging, unknowns, arm.forward(q), np.array(BALL), features.device.cone)
    return q, good


def poses(
    arm: Arm, features: Placed, count: int, seed: int = 0, keep: KeepPoses | None = None
) -> tuple[FloatArray, IntArray]:
    """Poses of the nominal arm at a device's features, shared out evenly.

    Parameters
    ----------
    arm : Arm
    features : Placed
    count : int
        In all.
    seed : int
    keep : callable, optional
        Which joints (n, joints) may be used: no collision, and the like.

    Returns
    -------
    q : ndarray, shape (count, joints)
    feature : ndarray of int, shape (count,)
        Number of the feature of each.

    Raises
    ------
    IdentificationError
        If too few are found.
    """
    names = list(features.unknowns)
    share = [count // len(names) + (k < count % len(names)) for k in range(len(names))]
    out, which = [], []
    for k, (name, quota) in enumerate(zip(names, share, strict=True)):
        accepted: list[FloatArray] = []
        for attempt in range(4):
            q = drawn(arm, features, name, max(TRIES * quota, 100), seed * 1000 + 10 * k + attempt)[: 6 * quota]
            accepted.append(q if keep is None else q[keep(q)])
            if sum(map(len, accepted)) >= quota:
                break
        q = np.concatenate(accepted)[:quota]
        if len(q) < quota:
            raise IdentificationError(
                f"{arm.name} reaches {name} of {features.device.description} in {len(q)} of {quota} poses only: ask "
                "for fewer"
            )
        out.append(q)
        which += [k] * quota
    return np.concatenate(out), np.array(which)


def rows_table(arm: Arm, features: Placed, q: FloatArray, which: IntArray, value: FloatArray | None) -> pd.DataFrame:
    """Poses at features as the first file of `irbcal.measurement.features`; ``value`` is that of `shown`.

    Of a camera without images, a row a pose that names its picture, as `irbcal.corners` takes it.
    """
    names = list(features.unknowns)
    table: dict[str, object] = {"pose": np.arange(1, len(q) + 1), **arm.joint_table(q, 6)}
    table["feature"] = [names[k] for k in which]
    if features.device.sees:
        frame = pd.DataFrame(table)
        if value is None:
            return frame.assign(image=[f"{k}.png" for k in frame["pose"]])
        corners, count = value.shape[1], len(frame)
        uv = np.round(value.reshape(-1, 2), 4)
        frame = frame.loc[np.repeat(np.arange(count), corners)].reset_index(drop=True)
        return frame.assign(corner=np.tile(np.arange(corners), count), u_px=uv[:, 0], v_px=uv[:, 1])
    if features.device.tilts:
        table["value_deg"] = "" if value is None else np.round(value / DEG, 6)
    elif KINDS[features.device.kind].needs:
        table["value_mm"] = "" if value is None else np.round(value / MM, 4)
    return pd.DataFrame(table)


def values(arm: Arm, features: Placed, q: FloatArray, which: IntArray) -> FloatArray | None:
    """What a device of values shows at poses of an arm, as `shown`."""
    return readings_at(arm.forward(q), features, which)


def readings_at(T: FloatArray, features: Placed, which: IntArray) -> FloatArray | None:
    """What a device shows with the tip at T (n, 4, 4); None of devices that are touched.

    Returns
    -------
    ndarray or None
        Strings and ballbars: shape (n,), metres; inclinometers radians. Cameras: corners, shape (n, k, 2), pixels.
    """
    names = list(features.unknowns)
    if features.imaging is not None:
        out = np.zeros((len(T), len(features.imaging.corners), 2))
        for k, name in enumerate(names):
            rows = which == k
            out[rows] = pixels(features.imaging, dict(features.unknowns[name]), T[rows], np.array(BALL))[0]
        return out
    if features.device.tilts:
        up = np.array([features.unknowns[names[k]]["up"][:, 2] for k in which])
        return np.asarray(np.arcsin(np.clip(np.einsum("ni,nij,j->n", up, T[:, :3, :3], TILT[:, 2]), -1.0, 1.0)))
    if features.device.kind != "radius":
        return None
    p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
    centre = np.array([features.unknowns[names[k]]["centre"] for k in which])
    offset = np.array([features.unknowns[names[k]]["offset"][0] for k in which])
    return np.asarray(np.linalg.norm(p - centre, axis=1) - offset)


def spread(features: Placed, noise: float) -> float:
    """Standard deviation of what is `shown`, in its unit, where that of the device is ``noise``, metres."""
    if features.imaging is not None:
        return pixel_noise(features.imaging, features.reach, noise)
    return noise / KINDS[features.device.kind].lever


STOP_TRIES = 8
"""Times that the real robot is moved a little until it touches."""

STREAM = 991
"""Of the device's own random numbers, beside those of the cell's effects."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedDevice(Result):
    """Rows at the features of a device in the virtual cell: SIMULATED.

    Attributes
    ----------
    robot : str
        As the user named it.
    cell : VirtualCell
    placed : Placed
        The device, where it is.
    q : ndarray, shape (n, joints)
        Commanded joints.
    which : ndarray of int, shape (n,)
        Number of the feature at each.
    value : ndarray, shape (n,) or (n, corners, 2), or None
        What the device showed: metres, of a camera pixels, of an inclinometer radians.
    noise : float
        Standard deviation of a contact or a value, of a camera that of an image as a whole, metres.
    payload : float or None
        Mass carried, kg, where it was asked for: the rows then tell it.
    """

    robot: str
    cell: VirtualCell
    placed: Placed
    q: FloatArray
    which: IntArray
    value: FloatArray | None
    noise: float
    payload: float | None = None

    def to_frame(self) -> pd.DataFrame:
        """The rows as the first file of ``irbcal calibrate --features``."""
        table = rows_table(self.cell.arm, self.placed, self.q, self.which, self.value)
        if self.payload is not None:
            payload_at = dict(zip(PAYLOAD_CENTRE, np.array(self.cell.tool.payload_centre) / MM, strict=True))
            table = table.assign(payload_kg=self.payload, **payload_at)
        return table.assign(simulated="yes")

    def features(self) -> pd.DataFrame:
        """What is known of the features, as the second file."""
        return self.placed.table()

    def read(self) -> FeatureSet:
        """Both, as the calibration reads them."""
        return read_features(self.to_frame(), self.features(), self.cell.arm)

    simulated: ClassVar[bool] = True
    CONTENT = (
        "robot=cell.arm.name simulated device=placed.device.name poses=q.__len__ features=placed.unknowns.keys "
        "noise_mm effects=cell.on seed=cell.seed"
    )

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        device = self.placed.device
        return [
            f"SIMULATED: {len(self.q)} poses of {self.cell.arm.name} at {device.description}, noise "
            f"{self.noise / MM:g} mm",
            f"Effects: {', '.join(self.cell.on) or 'none'}",
        ]

    def save(self, out: str | Path) -> tuple[Path, Path, Path]:
        """Write rows, features (``NAME.features.csv``) and truth (``NAME.truth.json``), together or not at all.

        Raises
        ------
        CalibrationError
            If they cannot be written.
        """
        out = Path(out)
        files = [out.name, f"{out.stem}.features.csv", f"{out.stem}.truth.json"]
        tables = (self.to_frame(), self.features())
        data = [csv_bytes(table) for table in tables]
        ball = dict(zip(("x", "y", "z"), (np.array(BALL) / MM).tolist(), strict=True))
        truth = {
            "simulated": True,
            "note": "What the virtual cell hides; the identification never reads this file.",
            "made_by": "irbcal simulate --device",
            "robot": self.robot,
            "device": self.placed.device.name,
            "data": out.name,
            "data_sha256": hashlib.sha256(data[0]).hexdigest(),
            "ball_in_tip_link_mm": ball,
            **({"camera_axes_in_tip_link": CAMERA_AXES.tolist()} if self.placed.device.sees else {}),
            **({"inclinometer_axis_in_tip_link": TILT[:, 2].tolist()} if self.placed.device.tilts else {}),
            "features_in_base_link_m": {
                name: {key: value.tolist() for key, value in values.items()}
                for name, values in self.placed.unknowns.items()
            },
            **self.cell.truth(),
        }
        contents = [*data, json.dumps(truth, indent=1, ensure_ascii=False).encode()]
        safe_files.write_together(out.parent, dict(zip(files, contents, strict=True)))
        first, second, third = (out.parent / name for name in files)
        return first, second, third


@takes_fields_of(DeviceOptions)
def simulate_device(options: DeviceOptions) -> SimulatedDevice:
    """Measure with a device in place of a tracker, in the virtual cell: SIMULATED rows at features.

    Raises
    ------
    IrbcalError
        If an option or input is refused, or the robot does not reach the device.
    """
    chosen, seed = DEVICES[options.device], options.seed
    count = number("random", options.random, len(chosen.spots), MOST_POSES, whole=True)
    opened = asked_cell(options)
    size = chosen.noise if options.noise is None else options.noise
    features = placed(opened.arm, chosen).with_noise(size)
    q, which = poses(opened.arm, features, count, seed) if options.at is None else options.at
    order = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(STREAM, 1))).permutation(len(q))
    order = order[np.argsort(which[order], kind="stable")]
    q, which, value = _measured(opened, features, q[order], which[order], size)
    return SimulatedDevice(str(options.robot), opened, features, q, which, value, size, options.payload)


def _lagging(cell: VirtualCell, lag: FloatArray) -> Tips:
    """Tips of the nominal arm with the real robot's distance from it, (n, 4, 4)."""
    return lambda q: np.asarray(lag @ cell.arm.forward(q))


def _measured(
    cell: VirtualCell, features: Placed, q: FloatArray, which: IntArray, noise: float
) -> tuple[FloatArray, IntArray, FloatArray | None]:
    """The real robot brought to each feature, and what the device shows there."""
    rng = np.random.default_rng(np.random.SeedSequence(cell.seed, spawn_key=(STREAM, 2)))
    size = KINDS[features.device.kind].size
    off = noise * rng.standard_normal((len(q), size))
    spots = list(features.unknowns)
    T = cell.measure(q).T_base_tip
    if features.device.touched:
        for _ in range(
            STOP_TRIES
        ):  # how it comes to a stop depends on all stops before: all are moved a little each time
            q_before = q.copy()
            lag = T @ np.linalg.inv(cell.arm.forward(q_before))
            for k, name in enumerate(spots):
                rows = which == k
                q[rows], _ = touched_poses(cell.arm, features, name, q[rows], _lagging(cell, lag[rows]), off[rows])
            T = cell.measure(q).T_base_tip
            if np.abs(q - q_before).max() < 1e-9:
                break
    value = readings_at(T, features, which)
    if value is None:
        return q, which, None
    more = off[:, 0] if value.ndim == 1 else noise * rng.standard_normal(value.shape)
    return q, which, value + more * (spread(features, noise) / noise if noise else 0.0)
