r"""What a measurement at a feature says of the tool: one small class a kind.

A row is a pose of the robot at which something is known of a point ``p`` of the tool (or of the tool's attitude ``R``):
it touches a ball, lies in a plane, is so far from a point. Each kind has residuals, their derivatives by the point, by
the tool's rotation and by unknowns of its own, and a start of these in closed form. Point and attitude are seen in the
frame in which the feature is known or sought: kinds know nothing of the frames of a cell.

A kind is added by a class here, or in a file of its own, and its name in `KINDS`: rows of it are then read, fitted,
judged and drawn. Kinds are named elsewhere only where a device is of them (`irbcal.simulation.devices`,
`irbcal.planning.device_plan`) or one is drawn otherwise than as a ball on a foot, also by unknowns of new names
(`irbcal.viewer.features`), and ``point`` for the rows of a tracker.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.identification.images import Image, ImageOnTool
from irbcal.identification.observation_kind import (
    Kind,
    Observed,
    Residuals,
    Unknown,
    ball,
    ball_tool,
    distance,
    eliminated,
    left_inverse,
    null,
    ones,
    rotation,
)
from irbcal.identification.pixels import Depth, DepthOnTool, Pixel, PixelOnTool
from irbcal.measurement.features import ANGLE, Feature
from irbcal.modeling import frames
from irbcal.modeling.frames import LEVER


class Point(Kind):
    """The tool's point is at one place: a ball in a socket, a pointer at a tip; or where a tracker saw it."""

    name, size, unknowns, shown_as = "point", 3, {"centre": Unknown("place")}, "socket"

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``c - p``."""
        eye = ones(len(obs.p))
        return Residuals(values["centre"] - obs.p, eye, {"centre": -eye})

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """The mean."""
        return {"centre": obs.p.mean(axis=0)}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From ``R t - c = -p``, which is linear."""
        return eliminated(obs.R, [-ones(len(obs.p))], -obs.p)


class Sphere(Kind):
    """The tool's point is on a sphere: a probe touches a ball; the radius is that of ball and probe together."""

    name, size, unknowns = "sphere", 1, {"centre": Unknown("place"), "radius": Unknown("number")}

    def fixed(self, feature: Feature) -> dict[str, FloatArray]:
        """The radius, where it is known."""
        return {} if feature.radius is None else {"radius": np.array([feature.radius])}

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``R - |p - c|``."""
        d, n = distance(obs.p, values["centre"])
        return Residuals((values["radius"] - d)[:, None], n, {"centre": -n, "radius": -np.ones((len(d), 1, 1))})

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """From ``|p|^2 - 2 p.c + |c|^2 - R^2 = 0``, which is linear in c and a constant."""
        c, constant = ball(obs.p)
        return {"centre": c, "radius": np.array([np.sqrt(max(float(c @ c) - constant, 1e-8))])}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From the same equation with ``p + R t`` in place of p, linear in t, c, their products and a constant."""
        return ball_tool(obs, ())


class Radius(Sphere):
    """The tool's point is ``value + offset`` from a place: string encoders, laser distances, ballbars."""

    name, unknowns, shown_as = "radius", {"centre": Unknown("place"), "offset": Unknown("number")}, "anchor"
    needs, metric, spread = ("value",), True, True

    def fixed(self, feature: Feature) -> dict[str, FloatArray]:
        """The offset, where it is known."""
        return {} if feature.offset is None else {"offset": np.array([feature.offset])}

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``value + offset - |p - c|``."""
        d, n = distance(obs.p, values["centre"])
        r = -(d - obs.value - values["offset"])[:, None]
        return Residuals(r, n, {"centre": -n, "offset": -np.ones((len(d), 1, 1))})

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """As of a sphere, with ``(value + offset)^2`` in place of its radius; the offset as on the mean."""
        offset = obs.feature.offset or 0.0
        v = obs.value + offset
        constant = np.ptp(v) < 1e-3 * v.mean()  # one radius determines the offset, its changes do not
        A = [-2.0 * obs.p, np.ones((len(v), 1))]
        A += [] if constant or obs.feature.offset is not None else [-2.0 * v[:, None]]
        x = np.linalg.lstsq(np.hstack(A), v**2 - np.sum(obs.p**2, axis=1), rcond=1e-10)[0]
        c = x[:3]
        return {"centre": c, "offset": np.array([float(np.mean(distance(obs.p, c)[0] - obs.value))])}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """As of a sphere."""
        v = obs.value + (obs.feature.offset or 0.0)
        return ball_tool(obs, (v[:, None],), v**2)


class Plane(Kind):
    """The tool's point is in a plane: a probe touches a table, the side of a cube."""

    name, size = "plane", 1
    unknowns: ClassVar[Mapping[str, Unknown]] = {"normal": Unknown("axis", unit="rad"), "height": Unknown("number")}
    shape_only, spread = True, True

    def fixed(self, feature: Feature) -> dict[str, FloatArray]:
        """Normal and height, where the plane is known."""
        if feature.axes is None or feature.centre is None:
            return {}
        return {"normal": feature.axes, "height": np.array([feature.axes[:, 2] @ feature.centre])}

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``d - n.p``."""
        Q = values["normal"]
        point = np.broadcast_to(Q[:, 2], (len(obs.p), 1, 3)).copy()
        local = obs.p @ Q
        by_axis = np.stack([-local[:, 1], local[:, 0]], axis=1)[:, None]
        return Residuals(
            (values["height"] - local[:, 2])[:, None],
            point,
            {"normal": by_axis, "height": -np.ones((len(local), 1, 1))},
        )

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """The direction in which the points scatter least."""
        middle = obs.p.mean(axis=0)
        n = np.linalg.svd(obs.p - middle)[2][2]
        return {"normal": frames.with_third(n), "height": np.array([n @ middle])}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From ``n.p + (n t').R - d = 0``, whose unknowns are a null vector."""
        m = len(obs.p)
        A = np.hstack([obs.p, obs.R.reshape(m, 9), -np.ones((m, 1))])
        x = null(A)
        if x is None:
            return None
        n, nt = x[:3], x[3:12].reshape(3, 3)
        return nt.T @ n / (n @ n), 1e-6 * np.eye(3)


class Line(Kind):
    """The tool's point is on a straight line: a wire, an edge, the beam of a laser."""

    name, size, unknowns = "line", 2, {"line": Unknown("line")}
    shape_only, spread = True, True

    def fixed(self, feature: Feature) -> dict[str, FloatArray]:
        """The line, where it is known."""
        if feature.axes is None or feature.centre is None:
            return {}
        return {"line": np.column_stack([feature.axes, feature.centre])}

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """The two coordinates across the line, of the line from the point."""
        Q, a = values["line"][:, :3], values["line"][:, 3]
        m = len(obs.p)
        local = (obs.p - a) @ Q
        by_line = np.zeros((m, 2, 4))
        by_line[:, 0, 1], by_line[:, 1, 0] = -local[:, 2], local[:, 2]
        by_line[:, 0, 2] = by_line[:, 1, 3] = -1.0
        return Residuals(-local[:, :2], np.broadcast_to(Q[:, :2].T, (m, 2, 3)).copy(), {"line": by_line})

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """Through the mean, along the direction in which the points scatter most."""
        middle = obs.p.mean(axis=0)
        return {"line": np.column_stack([frames.with_third(np.linalg.svd(obs.p - middle)[2][0]), middle])}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From ``(p + R t) x u = m``, whose unknowns u, products of t and u, and m are a null vector."""
        m = len(obs.p)
        cross = np.array(
            [
                [[0, 0, 0], [0, 0, 1], [0, -1, 0]],
                [[0, 0, -1], [0, 0, 0], [1, 0, 0]],
                [[0, 1, 0], [-1, 0, 0], [0, 0, 0]],
            ],
            dtype=float,
        )  # (p x u)_i = cross[i, j, k] p_j u_k
        A = np.concatenate(
            [
                np.einsum("ijk,mj->mik", cross, obs.p),
                np.einsum("ijk,mjl->milk", cross, obs.R).reshape(m, 3, 9),
                -ones(m),
            ],
            axis=2,
        )
        x = null(A.reshape(3 * m, 15))
        if x is None:
            return None
        u, tu = x[:3], x[3:12].reshape(3, 3)
        return tu @ u / (u @ u), 1e-6 * np.eye(3)


class Gauge(Plane):
    """The tool's point against a dial gauge or a laser distance along a fixed direction: ``n.p - d = value``."""

    name, needs, shape_only = "gauge", ("value",), False

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``value - (n.p - d)``."""
        planar = super().residuals(obs, values)
        return Residuals(planar.r + obs.value[:, None], planar.point, planar.by_unknown)

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """Linear in the direction and the zero."""
        middle = obs.p.mean(axis=0)
        x = np.linalg.lstsq(np.hstack([obs.p - middle, np.ones((len(obs.p), 1))]), obs.value, rcond=1e-9)[0]
        n = x[:3] / max(float(np.linalg.norm(x[:3])), 1e-12)
        return {"normal": frames.with_third(n), "height": np.array([np.mean(obs.p @ n - obs.value)])}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From ``n.p + (n t').R - d = value``, which is linear."""
        m = len(obs.p)
        A = np.hstack([obs.p - obs.p.mean(axis=0), obs.R.reshape(m, 9), -np.ones((m, 1))])
        if m < A.shape[1]:
            return None
        x, _, rank, _ = np.linalg.lstsq(A, obs.value, rcond=1e-9)
        n, nt = x[:3], x[3:12].reshape(3, 3)
        return None if rank < A.shape[1] else (nt.T @ n / (n @ n), 1e-6 * np.eye(3))


class Offset(Kind):
    """A ball on the tool, seen in the axes of a sensor in the hall: laser fans, three dial gauges in a nest."""

    name, size, shown_as = "offset", 3, "sensor"
    unknowns: ClassVar[Mapping[str, Unknown]] = {"centre": Unknown("place"), "axes": Unknown("turn", unit="rad")}
    needs = ("xyz",)

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``c + F v - p``."""
        turned = obs.xyz @ values["axes"].T
        eye = ones(len(turned))
        r = -(obs.p - values["centre"] - turned)
        return Residuals(r, eye, {"centre": -eye, "axes": frames.cross_matrix(turned)})

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """Linear in c and F."""
        A = np.hstack([np.ones((len(obs.p), 1)), obs.xyz])
        x = np.asarray(np.linalg.lstsq(A, obs.p, rcond=1e-12)[0], dtype=float)
        return {"centre": x[0], "axes": rotation(x[1:].T)}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From ``R t - c - F v = -p``, which is linear."""
        all_of = np.einsum("ij,mk->mijk", np.eye(3), obs.xyz).reshape(len(obs.p), 3, 9)
        return eliminated(obs.R, [-ones(len(obs.p)), -all_of], -obs.p)


class OffsetOnTool(Kind):
    """A ball in the hall, seen in the axes of a sensor on the tool: cameras or laser fans that the arm carries."""

    name, size, shown_as = "offset-on-tool", 3, "ball"
    unknowns: ClassVar[Mapping[str, Unknown]] = {
        "centre": Unknown("place"),
        "axes": Unknown("turn", owner="target", unit="rad"),
    }
    needs = ("xyz",)

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``c - (p + R X v)``."""
        local = obs.xyz @ values["axes"].T
        turned = np.einsum("mij,mj->mi", obs.R, local)
        eye = ones(len(turned))
        return Residuals(
            values["centre"] - (obs.p + turned),
            eye,
            {"centre": -eye, "axes": -obs.R @ frames.cross_matrix(local)},
            -frames.cross_matrix(turned),
        )

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """Linear in c and X."""
        m = len(obs.p)
        A = np.concatenate([np.einsum("mij,mk->mijk", obs.R, obs.xyz).reshape(m, 3, 9), -ones(m)], axis=2)
        x = np.linalg.lstsq(A.reshape(3 * m, 12), -obs.p.ravel(), rcond=1e-12)[0]
        return {"centre": x[9:], "axes": rotation(x[:9].reshape(3, 3))}

    def tool(self, obs: Observed) -> tuple[FloatArray, FloatArray] | None:
        """From ``R t + R X v - c = -p``, which is linear."""
        m = len(obs.p)
        all_of = np.einsum("mij,mk->mijk", obs.R, obs.xyz).reshape(m, 3, 9)
        return eliminated(obs.R, [all_of, -ones(m)], -obs.p)


class Pose(Kind):
    """The tool's place and attitude are measured: a tracker with a probe of six degrees of freedom, a camera."""

    name, size = "pose", 6
    unknowns: ClassVar[Mapping[str, Unknown]] = {"axes": Unknown("turn", owner="target", unit="rad")}
    needs, metric, spread = ("xyz", "rotation"), True, True

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``x - p``, and the rotation vector from predicted to measured axes times `LEVER`."""
        m = len(obs.p)
        e = frames.vector_from_rotation(obs.R @ values["axes"] @ obs.rotation.transpose(0, 2, 1))
        left = LEVER * left_inverse(e)
        point, turn, axes = np.zeros((3, m, 6, 3))
        point[:, :3], turn[:, 3:], axes[:, 3:] = np.eye(3), left, left @ obs.R
        return Residuals(np.hstack([obs.xyz - obs.p, -LEVER * e]), point, {"axes": axes}, turn)

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """The mean of what the axes on the tool must be."""
        return {"axes": frames.nearest_rotation((obs.R.transpose(0, 2, 1) @ obs.rotation).mean(axis=0))}


class Angle(Kind):
    """An axis of the tool against the horizontal: an inclinometer; the feature is what is level."""

    name, size, shown_as = ANGLE, 1, "level"
    unknowns: ClassVar[Mapping[str, Unknown]] = {
        "axis": Unknown("axis", owner="target", unit="rad"),
        "up": Unknown("axis", unit="rad"),
    }
    needs, spread, pointed, lever = ("value",), True, False, LEVER

    def residuals(self, obs: Observed, values: Mapping[str, FloatArray]) -> Residuals:
        """``value - asin(a.u)`` times `LEVER`, with a the axis of the tool and u upwards."""
        A, U = values["axis"], values["up"]
        axes = obs.R @ A  # columns: the axis and two across it
        a, u = axes[:, :, 2], U[:, 2]
        s = np.clip(a @ u, -1.0 + 1e-12, 1.0 - 1e-12)
        slope = (LEVER / np.sqrt(1.0 - s * s))[:, None, None]
        by_axis = np.stack([-axes[:, :, 1] @ u, axes[:, :, 0] @ u], axis=1)[:, None]
        by_up = np.stack([-a @ U[:, 1], a @ U[:, 0]], axis=1)[:, None]
        turn = frames.cross(a, u)[:, None]
        return Residuals(
            (LEVER * (obs.value - np.arcsin(s)))[:, None],
            np.zeros((len(s), 1, 3)),
            {"axis": slope * by_axis, "up": slope * by_up},
            slope * turn,
        )

    def start(self, obs: Observed) -> dict[str, FloatArray]:
        """The base link taken as level: ``a.(R' z) = sin(value)`` is linear."""
        a = np.linalg.lstsq(obs.R[:, 2, :], np.sin(obs.value), rcond=1e-12)[0]
        return {"axis": frames.with_third(a / np.linalg.norm(a)), "up": np.eye(3)}


KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Point(),
        Sphere(),
        Radius(),
        Plane(),
        Line(),
        Gauge(),
        Offset(),
        OffsetOnTool(),
        Pose(),
        Angle(),
        Image(),
        ImageOnTool(),
        Pixel(),
        PixelOnTool(),
        Depth(),
        DepthOnTool(),
    )
}
"""Kinds of rows by name."""
