"""A robot, its measurements and its calibration whose every name would act, if anything took it for more than a name."""

import csv

import numpy as np
from lxml import etree
from support import arm, measured, random_robot

from irbcal.io import robots

TEXT = (
    '''=1+cmd"""+open("canary","w")+"""';*/${open("canary","w")}$(touch canary)`touch canary`");system("touch canary")'''
    """;//</script><script>x()</script><img src=x onerror=x()>[/red]{{7*7}}--->\\"""
)
"""Printable, so it is a name like any other."""
CONTROL = ("\x1b]0;x\x07", '"""\nopen("canary","w")\n"""', "x\u2028x", "\x9b31m", "\u202ex")
"""No names: refused wherever they come from."""


def name(word):
    """A name that tells what it is of."""
    return f"{TEXT[:-1]}{word}\\"


def urdf(path):
    """The URDF of an IRB 1600 with hostile names of robot, links and joints, and text that xacro would compute."""
    root = etree.fromstring(robots.robot_file("irb1600").read_bytes())
    root.set("name", name("robot"))
    for element in root.iter("link", "joint"):
        element.set("name", name(element.get("name")))
    for element in root.iter("parent", "child"):
        element.set("link", name(element.get("link")))
    etree.SubElement(root, "gazebo").text = '${open("canary","w")} $(eval 1/0)'
    for element in list(root.iter("visual", "collision")):
        element.getparent().remove(element)
    path.write_bytes(etree.tostring(root))
    return path


def measurements(path, poses=45, seed=1):
    """SIMULATED measurements with hostile names of poses, targets and groups."""
    rng = np.random.default_rng(seed)
    points = measured(random_robot(arm(), "34", np.random.default_rng(1)), arm().random_joints(poses, seed), 3e-5, rng)
    with open(path, "w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["pose", "group", *(f"q{k}_deg" for k in range(1, 7)), "target", "x_mm", "y_mm", "z_mm"])
        for k, xyz in enumerate(points.xyz * 1e3):
            pose = points.pose[k]
            target = points.target_names[points.target[k]]
            row = [f"'{name(pose)}", f"'{name(pose % 2)}", *np.degrees(points.q[pose]).tolist(), f"'{name(target)}"]
            table.writerow([*row, *xyz.tolist()])
    return path
