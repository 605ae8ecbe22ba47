"""One self-contained HTML page: meshcat's viewer, the recorded scene, and the panel that steps through it.

Names in it come from measurement files and URDFs, which are untrusted: they stand in the page as JSON whose ``<``,
``>`` and ``&`` are escaped, and reach the screen as text only. A content security policy allows the page's own scripts,
by their hashes, and no request to anywhere.
"""

from __future__ import annotations

import base64
import hashlib
import json
import warnings
from collections.abc import Sequence
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import FloatArray
from irbcal.page_style import DARK, ERRORS, LIGHT, rule
from irbcal.units import MM
from irbcal.viewer import features, shapes
from irbcal.viewer.scene import Drawn, PageScene, Points, WhichModel

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # meshcat 0.3.2 imports zmq in a way that zmq regrets
    import meshcat.geometry as g
    import umsgpack
    from meshcat.visualizer import Visualizer

INK, BODY, GLASS, TEAL, CUBE, PATH = shapes.colours("#3a4149", "#f2f2ee", "#20262c", "#0b7a75", "#7a4fa3", "#0b7a75")
"""Colours of tracker (ink, body, glass), references, cube and path."""
COARSE_TRIANGLES = 6_000
"""Triangles, about, of a robot that moves smoothly without a graphics card."""
AXIS_COLOURS = np.array([[214, 39, 40], [44, 160, 44], [31, 95, 214]]) / 255
"""Colours of x, y and z."""


class Recorder:
    """Takes the place of meshcat's window: keeps the commands as the viewer's page takes them."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep a command (msgpack)."""
        self.commands.append(umsgpack.packb(command.lower()))

    def as_text(self) -> list[str]:
        """The commands in base64, list of str."""
        return [base64.b64encode(command).decode("ascii") for command in self.commands]


class _Body(g.Geometry):  # type: ignore[misc]  # meshcat has no types
    """A `shapes.Mesh` in meshcat's form: indexed, with normals and colours of one byte a number."""

    def __init__(self, mesh: shapes.Mesh) -> None:
        super().__init__()
        self.mesh = mesh

    def lower(self, object_data: Any) -> dict[str, Any]:
        """The geometry as meshcat sends it."""

        def attribute(kind: str, code: int, array: NDArray[Any], normalized: bool) -> dict[str, Any]:
            return {
                "itemSize": array.shape[1],
                "type": kind,
                "array": umsgpack.Ext(code, np.ascontiguousarray(array).tobytes()),
                "normalized": normalized,
            }

        mesh = self.mesh
        return {
            "uuid": self.uuid,
            "type": "BufferGeometry",
            "data": {
                "attributes": {
                    "position": attribute("Float32Array", 0x17, mesh.vertices, False),
                    "normal": attribute("Int8Array", 0x11, mesh.normals, True),
                    "color": attribute("Uint8Array", 0x12, mesh.colours, True),
                },
                "index": attribute("Uint32Array", 0x16, mesh.faces.reshape(-1, 1), False),
            },
        }


def record(scene: PageScene) -> Recorder:
    """Draw a scene's still bodies.

    Nodes: ``/irbcal/robot/K`` (link K) and ``/irbcal/robot/K/coarse`` (while it moves), ``/irbcal/tracker``,
    ``/irbcal/references``, ``/irbcal/cube``, ``/irbcal/features``, ``/irbcal/cell``, ``/irbcal/path``. Names from files
    are never part of a node's path.
    """
    recorder = Recorder()
    view = Visualizer(window=recorder)
    view["/Background"].set_property("top_color", [0.97, 0.98, 0.99])
    view["/Background"].set_property("bottom_color", [0.80, 0.84, 0.88])
    view["/Axes"].set_property("visible", False)
    view["/Grid"].set_property("visible", False)
    share = _coarse_share(scene)
    for k, mesh in scene.meshes.items():
        _add(view, f"/irbcal/robot/{k}", mesh)
        if share < 1:
            _add(view, f"/irbcal/robot/{k}/coarse", shapes.coarser(mesh, share))
    if scene.tracker:
        _add(view, "/irbcal/tracker", _tracker(scene))
    if scene.references:
        _add(view, "/irbcal/references", _references(scene))
    if scene.cube is not None:
        _add(view, "/irbcal/cube", _cube(*scene.cube), opacity=0.9)
    if scene.features:
        solid, glass = features.bodies(scene.features, scene.reach)
        if solid:
            _add(view, "/irbcal/features/solid", _painted(solid))
        if glass:
            _add(view, "/irbcal/features/glass", _painted(glass), transparent=True, opacity=0.35)
    for node, on_tip in (("tools", True), ("work_objects", False)):
        if shown := [one.T for one in scene.cell if one.on_tip == on_tip]:
            _add(view, f"/irbcal/cell/{node}", _axes(shown, 0.08 * scene.reach))
    if scene.path is not None:
        geometry = g.PointsGeometry(scene.path.T.astype(np.float32))
        colour = int(sum(int(255 * v) << s for v, s in zip(PATH, (16, 8, 0), strict=True)))
        view["/irbcal/path"].set_object(g.Line(geometry, g.LineBasicMaterial(color=colour)))
    return recorder


def _coarse_share(scene: PageScene) -> float:
    """Share of the robot's triangles that is drawn while it moves."""
    return COARSE_TRIANGLES / max(sum(len(mesh.faces) for mesh in scene.meshes.values()), 1)


def _add(view: Any, path: str, mesh: shapes.Mesh, **material: Any) -> None:
    material = {"shininess": 35, "specular": 0x333333, **material}
    view[path].set_object(g.Mesh(_Body(mesh), g.MeshPhongMaterial(vertexColors=True, **material)))


def _painted(bodies: Sequence[tuple[FloatArray, FloatArray]]) -> shapes.Mesh:
    """One mesh of bodies and their colours."""
    return shapes.smooth(
        np.concatenate([body for body, _ in bodies]),
        np.concatenate([np.broadcast_to(colour, (len(body), 3)) for body, colour in bodies]),
    )


def _tracker(scene: PageScene) -> shapes.Mesh:
    """A laser tracker with its head in the origin of the measuring frame, upright, on a tripod."""
    T = scene.T_scene_world
    heights = [xyz[2] for xyz in scene.references.values()]
    floor = min([0.0, *heights])
    height = T[2, 3] - floor
    height = float(height) if 0.5 < height < 2.5 else 1.1
    bodies = [
        (shapes.sphere(0.075), BODY),
        (shapes.moved(shapes.cylinder(0.028, 0.03), [0, 0, 0.075]), GLASS),
        (shapes.moved(shapes.box([0.045, 0.24, 0.22]), [0, 0, -0.03]), INK),
        (shapes.cone(0.10, 0.085, -0.36, -0.10), BODY),
        (shapes.cone(0.12, 0.12, -0.40, -0.36), INK),
    ]
    for angle in np.radians([90, 210, 330]):
        foot = np.array([0.38 * np.cos(angle), 0.38 * np.sin(angle), -height])
        bodies.append((shapes.rod([0, 0, -0.40], foot, 0.016), INK))
    mesh = _painted(bodies)
    upright = T[2, 2] > 0.8
    R = T[:3, :3] if upright else np.eye(3)
    return shapes.Mesh(
        (mesh.vertices @ R.T + T[:3, 3]).astype(np.float32),
        np.rint(mesh.normals @ R.T).astype(np.int8),
        mesh.colours,
        mesh.faces,
    )


def _axes(poses: Sequence[FloatArray], length: float) -> shapes.Mesh:
    """Axes x, y, z of frames (4, 4), red, green and blue."""
    bodies = []
    for T in poses:
        ends = T[:3, 3] + length * T[:3, :3].T
        bodies += [(shapes.rod(T[:3, 3], end, 0.06 * length), rgb) for end, rgb in zip(ends, AXIS_COLOURS, strict=True)]
    return _painted(bodies)


def _references(scene: PageScene) -> shapes.Mesh:
    radius = float(np.clip(0.014 * scene.reach, 0.008, 0.03))
    bodies = []
    for xyz in scene.references.values():
        bodies.append((shapes.moved(shapes.sphere(radius), xyz), TEAL))
        bodies.append((shapes.moved(shapes.cone(1.8 * radius, 1.1 * radius, -1.7 * radius, -0.6 * radius), xyz), INK))
    return _painted(bodies)


def _cube(centre: FloatArray, edge: float) -> shapes.Mesh:
    """The twelve edges of the cube of ISO 9283, as thin beams."""
    half, width = edge / 2, 0.006 * edge
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    bodies = []
    for axis in range(3):
        size = np.full(3, width)
        size[axis] = edge + width
        for sign in signs[signs[:, axis] > 0]:
            at = half * sign
            at[axis] = 0.0
            bodies.append((shapes.moved(shapes.box(size), centre + at), CUBE))
    return _painted(bodies)


SCRIPTS = (
    "begin",
    "robots",
    "errors",
    "figures",
    "layers",
    "pose",
    "list",
    "playing",
    "camera",
    "labels",
    "pick",
    "panel",
    "keys",
)
"""Parts of the page's own script, in the order in which they run."""


def render(scene: PageScene) -> str:
    """The page of a scene."""
    from irbcal.templates import environment

    data = content(scene)
    data["commands"] = record(scene).as_text()
    script = "".join(_own(f"script/{name}.js") for name in SCRIPTS)
    scripts = {"viewer": _viewer("main.min.js"), "overlay": f'"use strict";\n(function () {{\n{script}}})();\n'}
    for name, text in scripts.items():
        if "</script" in text.lower() or "<!--" in text:
            raise AssertionError(f"the script {name} cannot stand inside a page")
    return (
        environment("irbcal.viewer", "", trim=False)
        .get_template("page.html.j2")
        .render(
            title=scene.title,
            data=escaped_json(data),
            licences=_viewer("main.min.js.LICENSE.txt"),
            style=rule(":root", "light", LIGHT) + rule(':root[data-theme="dark"]', "dark", DARK) + _own("overlay.css"),
            policy="; ".join(
                [
                    "default-src 'none'",
                    "script-src " + " ".join(f"'sha256-{_digest(text)}'" for text in scripts.values()),
                    "style-src 'unsafe-inline'",
                    "img-src data: blob:",
                    "base-uri 'none'",
                    "form-action 'none'",
                ]
            ),
            **scripts,
        )
    )


def content(scene: PageScene) -> dict[str, Any]:
    """What the panel works with, as plain values; arrays are base64 of little-endian float32 or int32."""
    robot, points = scene.robot, scene.points
    arm = robot.arm
    lower, upper = arm.finite_limits
    groups, group = np.unique(scene.groups.astype(str), return_inverse=True)
    return {
        "title": scene.title,
        "simulated": scene.simulated,
        "mode": scene.mode,
        "notes": scene.notes,
        "robot": _drawn(scene.drawn),
        "ghost": None if scene.ghost is None else _drawn(scene.ghost),
        "meshes": sorted(scene.meshes),
        "coarse": _coarse_share(scene) < 1,
        "reach": scene.reach,
        "joints": {
            "names": list(arm.joint_names),
            "units": arm.joint_unit_names,
            "factors": arm.joint_units.tolist(),
            "lower": lower.tolist(),
            "upper": upper.tolist(),
        },
        "joint_map": robot.joint_map.static_parts(),  # coefficients for the sliders
        "poses": {
            "ids": [str(name) for name in scene.pose_ids],
            "groups": groups.tolist(),
            "group": group.reshape(-1).tolist(),
            "q": _floats(scene.q),
            "effective": _floats(scene.effective),
            "fitted": None if scene.fitted is None else scene.fitted.tolist(),
        },
        "targets": [{"name": name, "place": xyz.tolist()} for name, xyz in scene.targets.items()],
        "points": None if points is None else _points(points),
        "world": scene.T_scene_world.T.ravel().tolist(),
        "tracker": scene.tracker,
        "references": [{"name": name, "place": xyz.tolist()} for name, xyz in scene.references.items()],
        "features": [
            {"label": feature.label, "kind": feature.kind, "place": feature.T_scene[:3, 3].tolist()}
            for feature in scene.features
        ],
        "at_features": scene.at_features,
        "cell": [{"label": each.label, "place": each.T[:3, 3].tolist(), "on_tip": each.on_tip} for each in scene.cell],
        "cube": None if scene.cube is None else {"centre": scene.cube[0].tolist(), "edge": scene.cube[1]},
        "path": scene.path is not None,
        "home": None
        if scene.over_home is None
        else {"q": scene.over_home[0].tolist(), "before": scene.over_home[1].tolist()},
        "scale": {
            "colours": ERRORS,
            "common": _scale(scene.magnification, scene.scale_top),
            **{model: _scale(*scales) for model, scales in scene.own_scales.items()},
        },
    }


def _scale(magnification: float, top: float) -> dict[str, float]:
    return {"magnification": magnification, "top_mm": top / MM}


def _drawn(drawing: Drawn) -> dict[str, Any]:
    return {
        "root": drawing.T_scene_root.T.ravel().tolist(),
        "tip": drawing.tip,
        "links": [
            {
                "parent": link.parent,
                "origin": link.T_parent_joint.T.ravel().tolist(),
                "kind": link.kind,
                "axis": np.asarray(link.axis, dtype=float).tolist(),
                "joint": link.joint,
                "factor": link.factor,
                "offset": link.offset,
            }
            for link in drawing.links
        ],
    }


def _points(points: Points) -> dict[str, Any]:
    """Points and errors; differences are taken before rounding to float32."""
    turns = {"calibrated": points.turn_calibrated, "nominal": points.turn_nominal}
    out: dict[str, Any] = {
        "pose": _integers(points.pose),
        "target": _integers(points.target),
        "count": len(points.pose),
        "measured": _floats_if(points.measured),
        "calibrated": _floats_if(points.calibrated),
        "nominal": _floats_if(points.nominal),
        **{f"turn_{model}": _floats_if(turn) for model, turn in turns.items()},
        "u95": _floats_if(points.u95),
        "attitudes": {model: _floats(values) for model, values in points.attitudes.items()},
        "without": {family: _floats(shift) for family, shift in points.without.items()},
    }
    models: tuple[WhichModel, ...] = ("calibrated", "nominal")
    return out | {f"error_{model}": _floats_if(points.error(model)) for model in models}


def _floats_if(array: FloatArray | None) -> str | None:
    return None if array is None else _floats(array)


def _floats(array: ArrayLike) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")


def _integers(array: ArrayLike) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<i4").tobytes()).decode("ascii")


def escaped_json(value: Any) -> str:
    """JSON that can stand inside a script element: no character in it can end or open one."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _own(name: str) -> str:
    return (files("irbcal.viewer") / name).read_text(encoding="utf-8")


def _viewer(name: str) -> str:
    """A file of meshcat's viewer, without importing meshcat."""
    spec = find_spec("meshcat")
    assert spec is not None, "meshcat is a dependency"
    assert spec.submodule_search_locations, "meshcat is a package"
    folder = Path(spec.submodule_search_locations[0])
    return (folder / "viewer" / "dist" / name).read_text(encoding="utf-8")
