"""Self-collision and blocked lines of sight, with coal through Pinocchio on the collision geometry of a URDF.

Meshes count as their convex hulls: quicker, solid inside and never smaller than the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import RobotError
from irbcal.io.urdf_check import ArmInModel
from irbcal.modeling.arm import Arm
from irbcal.safe_files import libraries_silent
from irbcal.units import MM

BEAM_RADIUS = 5 * MM
"""Of the tracker's beam, metres."""

BEAM_GAP = 25 * MM
"""Last part of the beam, before the reflector's centre, that may lie in a solid: reflector and nest, metres."""

MESH_ENDINGS = (".stl", ".dae", ".obj")
ALWAYS = 0.9
"""Share of random poses in which two links touch that overlap by construction."""
SAMPLES = 200


class NoSolidsError(RobotError):
    """The URDF has no collision geometry, or a mesh of it is not on this computer."""


class CollisionModel:
    """Where an arm's own solids stand in its way and in the tracker's.

    Solids of one link or of links that a joint connects are never checked against each other.

    Parameters
    ----------
    urdf_bytes : bytes
        Content of the URDF.
    arm : Arm
        Names of the joints, base and tip; limits.
    package_dirs : sequence of str or Path
        Folders in which ``package://`` names are looked up, see `irbcal.io.robots.package_dirs`; relative
        names start in one of them, too. No file outside them is read.

    Attributes
    ----------
    pairs : list of tuple of str
        Links that are checked against each other.
    overlapping : list of tuple of str
        Links that touch at rest and in nearly all random poses, by construction: not checked.

    Raises
    ------
    NoSolidsError
        If a mesh is not found, or there is no collision geometry.
    RobotError
        If a mesh may not be read or is not understood.
    """

    def __init__(self, urdf_bytes: bytes, arm: Arm, *, package_dirs: Sequence[str | Path] = ()) -> None:
        import pinocchio as pin

        self.arm = arm
        self._made_from = urdf_bytes, arm, tuple(str(folder) for folder in package_dirs)
        self._obstacles: list[tuple[FloatArray, tuple[float, ...]]] = []
        text = _with_mesh_files(urdf_bytes, [Path(folder).resolve() for folder in package_dirs])
        try:
            with libraries_silent():
                self.model = pin.buildModelFromXML(text)
                self.geometry = pin.buildGeomFromUrdfString(self.model, text, pin.COLLISION, None, [])
        except (ValueError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise RobotError(f"the collision geometry of {arm.name} cannot be read: {reason}") from None
        if not self.geometry.ngeoms:
            raise NoSolidsError(f"the URDF of {arm.name} has no collision geometry")
        for solid in self.geometry.geometryObjects:
            _make_convex(solid)
        self.data = self.model.createData()
        self.arm_in_model = ArmInModel(self.model, arm)
        self.other_joints = pin.neutral(self.model)
        pin.framesForwardKinematics(self.model, self.data, self.other_joints)
        base = self.model.frames[self.arm_in_model.base]
        self.base_joint, self.T_joint_base = base.parentJoint, base.placement.homogeneous
        self.solids = self.geometry.ngeoms
        self._links = [self.model.frames[solid.parentFrame].name for solid in self.geometry.geometryObjects]
        self._add_pairs()

    def __reduce__(self) -> tuple[Any, ...]:
        # what Pinocchio and coal hold cannot be pickled: the model is made again from the files
        return _rebuilt, (*self._made_from, self._obstacles)

    def add_obstacle(self, centre: ArrayLike, radius: float) -> None:
        """A ball that stands still, such as the tracker; the moving links are checked against it from now on.

        Parameters
        ----------
        centre : array_like, shape (3,)
            Its middle in the base link, metres.
        radius : float
            Metres.
        """
        T = np.eye(4)
        T[:3, 3] = centre
        self._add_obstacle(T, (float(radius),))

    def add_box(self, T_base_box: FloatArray, edges: Sequence[float]) -> None:
        """A box that stands still, such as a table, as `add_obstacle`.

        Parameters
        ----------
        T_base_box : ndarray, shape (4, 4)
            Its middle and axes in the base link.
        edges : sequence of three float
            Metres.
        """
        self._add_obstacle(T_base_box, tuple(float(edge) for edge in edges))

    def _add_obstacle(self, T_base: FloatArray, size: tuple[float, ...]) -> None:
        """A ball of a radius, or a box of three edges."""
        import coal
        import pinocchio as pin

        self._obstacles.append((T_base, size))
        T = pin.SE3(self.T_joint_base @ T_base)
        shape = coal.Sphere(*size) if len(size) == 1 else coal.Box(*size)
        name = f"obstacle_{self.geometry.ngeoms}"
        ball = self.geometry.addGeometryObject(pin.GeometryObject(name, self.base_joint, T, shape))
        for k, solid in enumerate(self.geometry.geometryObjects[: self.solids]):
            if solid.parentJoint != self.base_joint:
                self.geometry.addCollisionPair(pin.CollisionPair(k, ball))
        self.geometry_data = self.geometry.createData()

    def _add_pairs(self) -> None:
        import pinocchio as pin

        solids = self.geometry.geometryObjects
        checked = [
            (i, j)
            for j in range(self.solids)
            for i in range(j)
            if (a := solids[i].parentJoint) != (b := solids[j].parentJoint)
            and self.model.parents[a] != b
            and self.model.parents[b] != a
        ]
        for i, j in checked:
            self.geometry.addCollisionPair(pin.CollisionPair(i, j))
        home = np.clip(np.zeros((1, len(self.arm.joint_names))), self.arm.lower, self.arm.upper)
        q = np.concatenate([home, self.arm.random_joints(SAMPLES, 0)])
        touching = self._each_pair(q)
        built_in = touching[0] & (touching.mean(axis=0) >= ALWAYS)
        for k in np.flatnonzero(built_in):
            self.geometry.removeCollisionPair(pin.CollisionPair(*checked[k]))
        names = [tuple(self._links[k] for k in pair) for pair in checked]
        self.overlapping = sorted({pair for pair, out in zip(names, built_in, strict=True) if out})
        self.pairs = sorted(set(names) - set(self.overlapping))
        self.geometry_data = self.geometry.createData()

    def _configurations(self, theta: FloatArray) -> FloatArray:
        return self.arm_in_model.configurations(self.arm.check_joints(theta), self.other_joints)

    def _each_pair(self, theta: FloatArray) -> BoolArray:
        """Whether each pair touches, shape (n, pairs)."""
        import pinocchio as pin

        data = self.geometry.createData()
        out = np.zeros((len(theta), len(self.geometry.collisionPairs)), dtype=bool)
        for row, configuration in zip(out, self._configurations(theta), strict=True):
            pin.computeCollisions(self.model, self.data, self.geometry, data, configuration, False)
            row[:] = [result.isCollision() for result in data.collisionResults]
        return out

    def touching(self, theta: FloatArray) -> BoolArray:
        """Whether the robot touches itself.

        Parameters
        ----------
        theta : ndarray, shape (n, joints)
            Effective joints, radians (metres for prismatic joints).

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        import pinocchio as pin

        things = self.model, self.data, self.geometry, self.geometry_data
        return np.array([pin.computeCollisions(*things, row, True) for row in self._configurations(theta)], dtype=bool)

    def blocked(
        self, theta: FloatArray, points: FloatArray, tracker: FloatArray, needed: BoolArray | None = None
    ) -> BoolArray:
        """Whether solids of the robot stand in the beam between tracker and reflectors.

        The beam has `BEAM_RADIUS`; its last `BEAM_GAP` before the reflector is not looked at, nor are solids of the tip
        link itself: they are the tool.

        Parameters
        ----------
        theta : ndarray, shape (n, joints)
            Effective joints.
        points : ndarray, shape (n, k, 3)
            Reflectors in the base link, metres.
        tracker : ndarray, shape (3,)
            The tracker in the base link, metres.
        needed : ndarray of bool, shape (n, k), optional
            Which beams are looked at; the others count as blocked. All unless given.

        Returns
        -------
        ndarray of bool, shape (n, k)
        """
        import coal
        import pinocchio as pin

        points = np.asarray(points, dtype=float)
        n, k = points.shape[:2]
        needed = np.ones((n, k), dtype=bool) if needed is None else np.asarray(needed, dtype=bool)
        scene = pin.GeometryModel(self.geometry)
        scene.removeAllCollisionPairs()
        beam = tracker - points
        length = np.linalg.norm(beam, axis=-1)
        # one capsule as long as the longest beam; it begins at the reflector's end and may reach behind the tracker
        longest = float(length.max(initial=1.0))
        looked = [i for i in range(self.solids) if self._links[i] != self.arm.tip_link]
        capsule = coal.Capsule(BEAM_RADIUS, longest)
        number = scene.addGeometryObject(pin.GeometryObject("beam", 0, pin.SE3.Identity(), capsule))
        for i in looked:
            scene.addCollisionPair(pin.CollisionPair(i, number))
        data = scene.createData()
        out = ~needed
        starts = np.concatenate([[0], np.cumsum(needed.sum(axis=1))])
        rows, columns = np.nonzero(needed)
        along = beam[rows, columns] / length[rows, columns, None]
        middle = points[rows, columns] + along * (BEAM_GAP + longest / 2)
        R_base, p_base = self.T_joint_base[:3, :3], self.T_joint_base[:3, 3]
        R, middle = R_base @ _turned_to(along), middle @ R_base.T + p_base
        configurations = self._configurations(theta)
        for row in np.unique(rows):
            pin.updateGeometryPlacements(self.model, self.data, scene, data, configurations[row])
            T_joint = self.data.oMi[self.base_joint]
            for m in range(starts[row], starts[row + 1]):
                data.oMg[number] = T_joint * pin.SE3(R[m], middle[m])
                out[row, columns[m]] = pin.computeCollisions(scene, data, True)
        return out


def _rebuilt(
    urdf_bytes: bytes, arm: Arm, package_dirs: Sequence[str], obstacles: Sequence[tuple[FloatArray, tuple[float, ...]]]
) -> CollisionModel:
    model = CollisionModel(urdf_bytes, arm, package_dirs=package_dirs)
    for T, size in obstacles:
        model._add_obstacle(T, size)
    return model


def _turned_to(direction: FloatArray) -> FloatArray:
    """Rotations (m, 3, 3) whose z axes are unit vectors (m, 3)."""
    helper = np.where(np.abs(direction[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(direction, x), direction], axis=2)


def _make_convex(solid: Any) -> None:
    import coal

    if isinstance(solid.geometry, coal.BVHModelBase):
        solid.geometry.buildConvexHull(True, "Qt")
        solid.geometry = solid.geometry.convex


def _with_mesh_files(urdf_bytes: bytes, folders: Sequence[Path]) -> str:
    """The URDF's text without visuals, each collision mesh named by its file.

    Raises
    ------
    RobotError
        If a mesh is not in the folders.
    """
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    root = etree.fromstring(urdf_bytes, parser)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        for mesh in link.findall("collision/geometry/mesh"):
            mesh.set("filename", f"file://{_find(mesh.get('filename') or '', folders, link.get('name'))}")
    return etree.tostring(root, encoding="unicode")


def _find(uri: str, folders: Sequence[Path], link: str | None) -> Path:
    name = uri if len(uri) < 120 else uri[:120] + "…"
    where = f"collision mesh {name!r} of link {link!r}"
    if uri.startswith("file://"):
        uri = uri.removeprefix("file://")
    elif uri.startswith("package://"):
        uri = uri.removeprefix("package://").lstrip("/")
    elif "://" in uri:
        raise RobotError(f"{where}: expected a file on this computer")
    for folder in folders:
        path = (folder / uri).resolve()
        if path.is_relative_to(folder) and path.is_file():
            if path.suffix.lower() not in MESH_ENDINGS:
                raise RobotError(f"{where}: expected a file with the ending {', '.join(MESH_ENDINGS)}")
            return path
    raise NoSolidsError(f"{where} is not in the folders of meshes (--package-dir names the one that holds the package)")
