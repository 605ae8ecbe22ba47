"""The still bodies of a scene as meshcat commands, recorded in this process: no server, no socket."""

from __future__ import annotations

import base64
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irbcal.arrays import FloatArray
from irbcal.viewer import features, shapes
from irbcal.viewer.scene import PageScene

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # meshcat 0.3.2 imports zmq in a way that zmq regrets
    import meshcat.geometry as g
    import umsgpack
    from meshcat.visualizer import Visualizer

INK, BODY, GLASS, TEAL, CUBE, PATH = (
    np.array([int(text[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    for text in ("#3a4149", "#f2f2ee", "#20262c", "#0b7a75", "#7a4fa3", "#0b7a75")
)
"""Colours of tracker (ink, body, glass), references, cube and path."""
AXES = np.array([[214, 39, 40], [44, 160, 44], [31, 95, 214]]) / 255
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

    Nodes: ``/irbcal/robot/K`` (link K), ``/irbcal/tracker``, ``/irbcal/references``, ``/irbcal/cube``,
    ``/irbcal/features``, ``/irbcal/cell``, ``/irbcal/path``. Names from files are never part of a node's path.

    Parameters
    ----------
    scene : PageScene
    """
    recorder = Recorder()
    view = Visualizer(window=recorder)
    view["/Background"].set_property("top_color", [0.97, 0.98, 0.99])
    view["/Background"].set_property("bottom_color", [0.80, 0.84, 0.88])
    view["/Axes"].set_property("visible", False)
    view["/Grid"].set_property("visible", False)
    for k, mesh in scene.meshes.items():
        _add(view, f"/irbcal/robot/{k}", mesh)
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
        bodies += [(shapes.rod(T[:3, 3], end, 0.06 * length), rgb) for end, rgb in zip(ends, AXES, strict=True)]
    return _painted(bodies)


def _references(scene: PageScene) -> shapes.Mesh:
    radius = float(np.clip(0.014 * scene.reach, 0.008, 0.03))
    bodies = []
    for xyz in scene.references.values():
        bodies.append((shapes.moved(shapes.sphere(radius), xyz), TEAL))
        bodies.append((shapes.moved(shapes.cone(1.8 * radius, 1.1 * radius, -1.7 * radius, -0.6 * radius), xyz), INK))
    return _painted(bodies)


def _cube(centre: FloatArray, edge: float) -> shapes.Mesh:
    """Edges of a cube and of its inclined plane (ISO 9283), as thin beams."""
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
