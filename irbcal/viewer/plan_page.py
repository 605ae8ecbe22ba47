"""A measuring plan to look at: robot, tracker, cube, reflectors and their way from pose to pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling import frames
from irbcal.planning import route
from irbcal.planning.measuring_plan import Plan
from irbcal.viewer.scene import Points
from irbcal.viewer.view import View, view


def page(plan: Plan) -> str:
    """The page of a plan, self-contained HTML."""
    scene, setting = plan.scene, plan.scene.setting
    base, tip = scene.links
    view_page = view(
        scene.source,
        plan=np.array(plan.q),
        package_dir=scene.package_dirs,
        cube=scene.cube,
        base_link=base,
        tip_link=tip,
    ).scene
    pose, target, xyz, _ = plan.expected()
    T_scene_world = frames.inverse(scene.T_world_base)
    return View(
        replace(
            view_page,
            robot=setting.robot.replace(T_world_base=scene.T_world_base),
            targets=dict(zip(setting.targets.names, setting.targets.places, strict=True)),
            points=Points(pose, target, frames.apply(T_scene_world, xyz)),
            groups=plan.groups,
            path=_way(plan),
            T_scene_world=T_scene_world,
            tracker=True,
        )
    ).html


def _way(plan: Plan) -> FloatArray | None:
    """Way of the first reflector from pose to pose in the base link, (k, 3), metres."""
    setting = plan.scene.setting
    if len(plan.q) < 2:
        return None
    q, _ = route.between(plan.q[:-1], plan.q[1:], setting.arm.table.prismatic)
    return setting.places(q)[1][:, 0]
