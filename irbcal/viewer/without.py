"""What the points would be without a family of the error model's terms: the rest of the model stays as it was fitted.

The whole model predicts them, last moves, loads and frame terms included, so that nothing is left to the page but to
show the difference. Base, tool and geometry are those of the fit with all terms: these are not the errors of a model
that was fitted without them, which would be smaller.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.term_map import TermMap

WORDS = {"thesis": "arm stiffness and joint-6 series"}
"""What a family is called on the page where its name does not say it."""
SMALLEST = 1e-9
"""Metres: a family that moves no point by more is not told."""


def shifts(model: Robot, points: PointSet, T_scene_world: FloatArray) -> dict[str, FloatArray]:
    """How far each point moves when the terms of one family are zero.

    Parameters
    ----------
    model : Robot
        Calibrated.
    points : PointSet
    T_scene_world : ndarray, shape (4, 4)

    Returns
    -------
    dict of str to ndarray, shape (m, 3)
        Family's name in words; metres in the scene.
    """
    whole = points.predicted(model)
    turn = frames.transform(T_scene_world[:3, :3])
    out = {}
    for family in families(model):
        shift = frames.apply(turn, points.predicted(without(model, family)) - whole)
        if np.abs(shift).max(initial=0.0) > SMALLEST:
            out[WORDS.get(family, family.replace("_", " "))] = shift
    return out


def families(model: Robot) -> list[str]:
    """Families with terms in a robot's joint map or among its frame terms, in their order."""
    found = [term.family for term in model.joint_map.terms.terms]
    if model.frame_terms is not None:
        found += [term.family for term in model.frame_terms.terms]
    return list(dict.fromkeys(found))


def without(model: Robot, family: str) -> Robot:
    """A robot whose terms of a family are zero."""
    joint_map = replace(model.joint_map, terms=_silenced(model.joint_map.terms, family))
    frame_terms = None if model.frame_terms is None else _silenced(model.frame_terms, family)
    return model.replace(joint_map=joint_map, frame_terms=frame_terms)


def _silenced(terms: TermMap, family: str) -> TermMap:
    keep = np.array([term.family != family for term in terms.terms], dtype=float)
    return replace(terms, coefficients=terms.coefficients * keep)
