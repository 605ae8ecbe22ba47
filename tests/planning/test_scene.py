"""Where a plan is made for: the tracker's place and turn."""

import re
from dataclasses import replace

import numpy as np
import pytest

from irbcal.errors import OptionError
from irbcal.io.opening import open_robot
from irbcal.io.robots import robot_file
from irbcal.planning import scene
from irbcal.planning.conditions import SOLID
from irbcal.planning.plan_options import PlanOptions
from irbcal.planning.scene import open_scene
from irbcal.units import DEG


def test_the_tracker_stands_where_it_is_said_to_stand():
    scene = open_scene(PlanOptions("irb1600", tracker=[2.0, 1.0, 0.5, 90 * DEG], ignore=SOLID))
    assert scene.setting.tracker_position == pytest.approx([2.0, 1.0, 0.5])
    # its x axis points along y of the base: what is 1 m from it along y is at (1, 0, 0)
    assert scene.T_world_base @ [2.0, 2.0, 0.5, 1.0] == pytest.approx([1.0, 0.0, 0.0, 1.0])
    assert scene.tracker_notes == ()


def test_a_calibration_without_a_tracker_has_no_place_of_one(monkeypatch):
    """Its measuring frame is the base link itself: the tracker is taken to stand where it does for any other robot."""
    opened = open_robot("irb1600")
    touched = replace(opened, robot=opened.robot.replace(targets={"ball": np.array([0.0, 0.0, 0.1])}))
    monkeypatch.setattr(scene, "open_robot", lambda *_, **__: touched)
    at_rest = open_scene(PlanOptions("irb1600", ignore=SOLID))
    assert np.linalg.norm(at_rest.setting.tracker_position) > 1.0
    assert any("no --tracker given: it is taken to stand at" in note for note in at_rest.tracker_notes)


@pytest.mark.parametrize(
    ("options", "parameter"),
    [({"tracker": (2000, 1000, 500)}, "tracker"), ({"cube_centre": (1000, 0, 900), "cube_edge": 0.4}, "cube_centre")],
)
def test_places_in_millimetres_are_refused(options, parameter):
    with pytest.raises(OptionError) as refused:
        open_scene(PlanOptions("irb1600", ignore=SOLID, **options))
    assert refused.value.parameter == parameter


def test_conditions_are_a_sequence():
    with pytest.raises(OptionError, match=r"ignore: .* one text: give \['sight'\]"):
        open_scene(PlanOptions("irb1600", ignore="sight"))


def test_without_meshes_the_conditions_that_need_them_are_off(tmp_path):
    data = robot_file("irb120").read_text()
    robot = tmp_path / "lost.urdf"
    robot.write_text(data.replace("package://", "package://nowhere/"))
    assert "package://nowhere/" in robot.read_text()
    scene = open_scene(PlanOptions(robot))
    assert not SOLID & set(scene.setting.conditions)
    notes = [note for note in scene.notes if "are off" in note]
    assert len(notes) == 1
    assert notes[0].startswith("the conditions collision, sight and path are off: collision mesh")
    bare = tmp_path / "bare.urdf"
    bare.write_text(re.sub("<collision.*?</collision>", "", data, flags=re.DOTALL))
    assert any("no collision geometry" in note for note in open_scene(PlanOptions(bare)).notes)
    silent = open_scene(PlanOptions(robot, ignore=SOLID))
    assert not any("are off" in note for note in silent.notes)
