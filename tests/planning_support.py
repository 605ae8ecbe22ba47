"""What several tests of plans need: reflectors, a robot's solids that are known beforehand, and each condition again."""

import numpy as np
from support import arm

from irbcal.io import urdf, urdf_check
from irbcal.io.robots import robot_file
from irbcal.modeling.robot import Robot
from irbcal.planning.conditions import Setting, Targets
from irbcal.simulation.instruments import IRB1600_HEIGHTS

PLACE = np.array([1.55, 1.63, 1.51])


LOOK = np.array([-0.176, 0.898, 0.404])


TARGETS = Targets(
    ("smr1", "smr2", "smr5"),
    [[-0.087, 0.087, 0.109], [0.084, 0.084, 0.109], [-0.06, 0.06, 0.057]],
    [LOOK, LOOK, LOOK * [1, 1, -1]],
)


CHEAP = ("limits", "height", "acceptance")


class Wall:
    """Stands in for a robot's solids: what it says is known beforehand."""

    def touching(self, theta):
        return (theta[:, 3] > 2.0) | (theta[:, 4] > 0.9) & (theta[:, 4] < 1.2)

    def blocked(self, theta, points, place, asked=None):
        return (points[..., 1] < 0.0) | ~asked


def setting(conditions=CHEAP, **changes):
    values = {"heights": IRB1600_HEIGHTS, "solids": Wall()} | changes
    return Setting(Robot(arm()), TARGETS, PLACE, conditions, **values)


def angle(a, b):
    """Angle between two vectors by the law of cosines, degrees."""
    a, b = a / np.sqrt(a @ a), b / np.sqrt(b @ b)
    return np.degrees(np.arccos(np.clip(1 - (a - b) @ (a - b) / 2, -1, 1)))


def recheck(q, seen, margin_deg=2.0, acceptance_deg=30.0):
    """Limits, heights, acceptance and what the wall says, one pose at a time, with Pinocchio's forward kinematics."""
    T = urdf_check.poses(robot_file("irb1600").read_bytes(), arm(), q)
    lower = np.array([-180, -90, -245, -200, -115, -400])
    upper = np.array([180, 120, 65, 200, 115, 400])
    good = []
    for joints, pose, row in zip(np.degrees(q), T, seen, strict=True):
        ok = (joints >= lower + margin_deg - 1e-9).all() and (joints <= upper - margin_deg + 1e-9).all()
        points = [pose[:3, :3] @ place + pose[:3, 3] for place in TARGETS.positions]
        ok &= all(p[2] > (0.7 if p[0] >= 0.15 else 1.1) for p in [pose[:3, 3], *points])
        in_sight = [
            angle(pose[:3, :3] @ look, PLACE - p) <= acceptance_deg and p[1] >= 0
            for look, p in zip(TARGETS.directions, points, strict=True)
        ]
        ok &= joints[3] <= np.degrees(2.0) and joints[4] <= np.degrees(0.9)  # behind 1.2 there is no way from home
        good.append(ok and row.any() and row.tolist() == in_sight)
    return np.array(good), T[:, :3, 3]


GANTRY = """<robot name="gantry"><link name="base_link"/><link name="a"/><link name="b"/><link name="tool0"/>
<joint name="x" type="prismatic"><parent link="base_link"/><child link="a"/><origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
<limit lower="{x0}" upper="{x1}" effort="1" velocity="1"/></joint>
<joint name="y" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="{y1}" effort="1" velocity="1"/></joint>
<joint name="z" type="prismatic"><parent link="b"/><child link="tool0"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1.2" effort="1" velocity="1"/></joint></robot>"""


def gantry(x0=0.2, x1=1.0, y1=0.9):
    return urdf.from_bytes(GANTRY.format(x0=x0, x1=x1, y1=y1).encode(), "gantry").arm
