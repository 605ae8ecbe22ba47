"""Collisions and clearance of commanded paths on a calibrated robot, with coal through Pinocchio.

The solids are those of the calibrated URDF, with an obstacle added; commands become configurations through the joint
map, so that solids stand where the real robot's links are.

Run it with ``python scripts/examples/check_collisions_with_coal.py [CALIBRATION_FOLDER]``.
"""

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
import virtual_robot

from irbcal.io import robots
from irbcal.units import DEG, MM

STEPS = 60


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances along a path.

    Attributes
    ----------
    pairs : list of tuple of str
        Names of the two solids of each pair.
    metres : ndarray, shape (n, pairs)
        At each step; not positive where the solids touch.
    """

    pairs: list
    metres: np.ndarray

    def collisions(self):
        """First step at which each pair touches, for the pairs that do, earliest first."""
        touches = self.metres <= 0.0
        first = {self.pairs[k]: int(np.argmax(touches[:, k])) for k in np.flatnonzero(touches.any(axis=0))}
        return dict(sorted(first.items(), key=lambda item: item[1]))

    def closest_to(self, name):
        """Smallest distance of a solid from all others, with its step and the pair."""
        metres = np.where([name in pair for pair in self.pairs], self.metres, np.inf)
        step, pair = np.unravel_index(np.argmin(metres), metres.shape)
        return metres[step, pair], int(step), self.pairs[pair]


def solids(calibrated):
    """Collision geometry of the robot, convex, without pairs on the same link or on neighbouring links.

    Parameters
    ----------
    calibrated : CalibratedModel

    Returns
    -------
    pinocchio.GeometryModel
    """
    model = calibrated.model
    text, folders = calibrated.urdf.decode("utf-8"), robots.package_dirs()
    geometry = pin.buildGeomFromUrdfString(model, text, pin.COLLISION, None, folders)
    for solid in geometry.geometryObjects:
        if isinstance(solid.geometry, coal.BVHModelBase):  # a mesh: its hull is quicker, and solid inside
            solid.geometry.buildConvexHull(True, "Qt")
            solid.geometry = solid.geometry.convex
    for i, first in enumerate(geometry.geometryObjects):
        for j, second in enumerate(geometry.geometryObjects[:i]):
            if not neighbours(model, first.parentJoint, second.parentJoint):
                geometry.addCollisionPair(pin.CollisionPair(j, i))
    return geometry


def neighbours(model, a, b):
    """Whether two joints carry the same link or links that a joint holds together."""
    return a == b or model.parents[a] == b or model.parents[b] == a


def add_obstacle(model, geometry, name, shape, T_universe_obstacle):
    """Add a solid that stands still, and check it against every link but those that do not move."""
    obstacle = pin.GeometryObject(name, 0, pin.SE3(T_universe_obstacle), shape)
    number = geometry.addGeometryObject(obstacle)
    for i, solid in enumerate(geometry.geometryObjects):
        if solid.parentJoint != 0:
            geometry.addCollisionPair(pin.CollisionPair(i, number))


def follow(calibrated, geometry, q):
    """Clearance along commanded joints.

    Parameters
    ----------
    calibrated : CalibratedModel
    geometry : pinocchio.GeometryModel
    q : ndarray, shape (n, joints)

    Returns
    -------
    Distances
    """
    data, geometry_data = calibrated.model.createData(), geometry.createData()
    metres = []
    for configuration in calibrated.model_from_command(q):
        pin.computeDistances(calibrated.model, data, geometry, geometry_data, configuration)
        metres.append([result.min_distance for result in geometry_data.distanceResults])
    solid = geometry.geometryObjects
    return Distances([(solid[p.first].name, solid[p.second].name) for p in geometry.collisionPairs], np.array(metres))


def paths(calibrated):
    """A turn of the first joint about the home position, and the same with the arm drawn back on the way."""
    share = np.linspace(0.0, 1.0, STEPS)[:, None]
    turn = np.zeros(len(calibrated.arm.joint_names))
    turn[0] = 60 * DEG
    straight = virtual_robot.home(calibrated) + (share - 0.5) * turn
    back = np.zeros_like(turn)
    back[1] = -25 * DEG
    return {"straight": straight, "drawn back": straight + np.sin(np.pi * share) * back}


def post_under(calibrated):
    """A post on the straight way: its top stands 0.1 m above the tip's path, halfway; shape and place."""
    T = calibrated.placement(virtual_robot.home(calibrated))[0]
    height = T[2, 3] + 0.1
    place = np.eye(4)
    place[:3, 3] = [T[0, 3], T[1, 3], height / 2]
    return coal.Box(0.1, 0.1, height), calibrated.T_universe_base @ place


def main(folder):
    """Follow both paths and say where they collide and how near they come."""
    calibrated = virtual_robot.calibrated(folder).model
    geometry = solids(calibrated)
    add_obstacle(calibrated.model, geometry, "post", *post_under(calibrated))
    print(f"{geometry.ngeoms} solids, {len(geometry.collisionPairs)} pairs")
    found = {}
    for name, q in paths(calibrated).items():
        found[name] = distances = follow(calibrated, geometry, q)
        for pair, step in distances.collisions().items():
            print(f"path {name!r}: {' and '.join(pair)} collide from step {step + 1} of {len(q)}")
        metres, step, pair = distances.closest_to("post")
        print(f"path {name!r}: nearest to the post {metres / MM:.1f} mm, step {step + 1}, {' and '.join(pair)}")
    return found


if __name__ == "__main__":
    main(virtual_robot.folder_from_command_line(__doc__))
