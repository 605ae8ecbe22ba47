"""Robots to export: every kind of term, several arms, SIMULATED errors."""

from dataclasses import replace

import numpy as np
from support import arm, on_a_rail, random_robot

from irbcal.io import robots, urdf
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.term_map import TermMap

FAMILIES = ("gravity", "own_weight", "gain", "thesis", "harmonics", "direction", "move", "torque")


def with_all_terms(nominal, seed=3, names=FAMILIES, size=0.3):
    """A robot with errors of its geometry and with all terms that a joint map can have."""
    rng = np.random.default_rng(seed)
    terms = [t for name in names for t in families()[name].terms(nominal)]
    terms += Payload((0.02, -0.01, 0.15)).terms(nominal)
    terms += [*gear_terms(1, 242), *gear_terms(4, 202)]
    values = size * np.array([t.size for t in terms]) * rng.standard_normal(len(terms))
    table = nominal.table
    small = {k: getattr(table, k) + 1e-3 * rng.standard_normal(len(table)) for k in ("alpha", "a", "beta", "b")}
    joint_map = JointMap(TermMap(nominal, tuple(terms), values), None, 2.0)
    return Robot(nominal.with_table(replace(table, **small, theta=table.theta + 1e-3, d=table.d - 1e-3)), joint_map)


def robot(name, folder=None):
    """A robot by what it is to show."""
    if name == "level":
        return random_robot(arm("irb1600"), "34", np.random.default_rng(2))
    if name == "plain":
        return Robot(arm("irb120"))
    if name == "rail":
        nominal = urdf.read(on_a_rail(folder / "rail.urdf"), "rail_base", "tool0").arm
        return with_all_terms(nominal, names=tuple(k for k in FAMILIES if k != "thesis"))
    return with_all_terms(arm(name))


def described(name):
    """A robot with all terms, its calibrated URDF and the folder where its meshes are looked for."""
    read = urdf.read(name)
    made = with_all_terms(read.arm)
    return made, urdf.to_bytes(read, made.arm), robots.robot_file(name).parent
