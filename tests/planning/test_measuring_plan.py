"""Plans from Python: seeds, what they say, and a run in the virtual cell."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import OptionError
from irbcal.planning import measuring_plan
from irbcal.planning.choosing import Wish
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import make, plan
from irbcal.planning.scene import open_scene
from irbcal.safe_files import write_together
from irbcal.simulation import pose_list, simulation
from irbcal.simulation.shipped_cells import open_cell
from irbcal.simulation.simulation import simulate
from irbcal.units import MM


def test_seeds_decide_the_plan():
    scene = open_scene("irb1600", without=SOLID)
    kinds = {"axis": 0, "cube": 3, "all_range": 3, "optimal": 3, "candidates": 30, "level": "11"}
    texts = [measuring_plan.files(make(scene, Wish(seed=seed, **kinds)))["plan.csv"] for seed in (4, 4, 5)]
    assert texts[0] == texts[1] != texts[2]


def test_a_tracker_finds_each_target_where_the_plan_says(tmp_path):
    """In the virtual cell with 2 mm to find a target: the base comes from 18 axis poses, then a plan for others."""
    cell = open_cell("irb1600", seed=3).with_targets(("smr1", "smr2", "smr3")).without("lost", "visibility")
    scene = open_scene("irb1600", without=SOLID)
    axis = make(scene, Wish(cube=0, all_range=0, level="nominal"))
    (tmp_path / "poses.csv").write_bytes(measuring_plan.files(axis)["poses.csv"])
    asked = pose_list.read(tmp_path / "poses.csv", cell.arm)
    assert asked.targets is not None
    run = cell.measure(asked.q, asked.asked(cell), asked.wait_s)
    write_together(tmp_path, simulation.files(run, asked, cell, tmp_path / "axis.csv", "irb1600"))
    found = {}
    for model in ("nominal", "26"):
        irbcal.calibrate(tmp_path / "axis.csv", "irb1600", model=model, holdout=0).save(tmp_path / model)
        scene = open_scene(tmp_path / model, without=SOLID, min_height=(0.7, 1.1))
        made = make(scene, Wish(axis=0, cube=60, all_range=60))
        pose, target, expected, _ = made.expected()
        index = [cell.tool.names.index(scene.setting.targets.names[k]) for k in target]
        miss = np.linalg.norm(cell.measure(made.q, run=1).xyz[pose, index] - expected, axis=1) / MM
        found[model] = (miss < 2.0).mean(), miss.max()
    print(found)
    assert found["nominal"][0] > 0.97


# --- the front door ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    """A plan with few poses of every kind."""
    return plan("irb1600", cube=4, all_range=4, axis=18, optimal=4, candidates=40, level="11", seed=3)


def test_the_result_says_what_it_is_and_cannot_be_changed(small):
    assert small.headline().startswith("irb1600_6_145: 30 poses, ")
    assert len(repr(small)) < 2000
    text = small.summary()
    for part in (
        "What each condition removed",
        "axis moves",
        "Model 11, scatter of 0.1 mm",
        "Note: no --tracker given",
    ):
        assert part in text
    assert "<table>" in small._repr_html_()
    with pytest.raises(ValueError, match="read-only"):
        small.q[0] = 0.0
    with pytest.raises(TypeError, match="cannot be changed"):
        small.tallies["axis"] = None


def test_a_plan_can_be_kept_and_taken_up_again(small):
    again = pickle.loads(pickle.dumps(small))
    np.testing.assert_array_equal(again.q, small.q)
    assert again.to_dict() == small.to_dict()
    solids = again.scene.setting.solids
    assert solids.touching(small.q).tolist() == small.scene.setting.solids.touching(small.q).tolist()
    inside = small.scene.setting.place  # the ball around the tracker is there again
    assert len(solids.geometry.collisionPairs) == len(small.scene.setting.solids.geometry.collisionPairs)
    assert np.isfinite(inside).all()


def test_the_table_of_poses_is_the_file(small, tmp_path):
    names = [path.name for path in small.save(tmp_path / "plan")]
    assert names == ["plan.csv", "poses.csv", "plan.json", "plan.mod"]
    written, table = pd.read_csv(tmp_path / "plan" / "poses.csv"), small.to_frame()
    pd.testing.assert_frame_equal(written, table, check_dtype=False)
    assert table["targets"].iloc[-1].split() == [
        name for name, on in zip(small.scene.setting.targets.names, small.asked[-1], strict=True) if on
    ]


def test_a_plan_is_measured_in_the_cell_without_a_file(small):
    found = simulate("irb1600", small, seed=1)
    np.testing.assert_allclose(found.poses.q, small.q, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.run.asked[:, :3], small.asked)


def test_the_usual_plan_is_that_of_the_thesis():
    """Nubiola 2011, section 7.2: 18 axis moves, 52 poses in the cube, 50 in the whole range."""
    made = plan("irb1600", without=SOLID, level="nominal")
    count = {name: int((made.groups == name).sum()) for name in ("iso_cube", "all_range")}
    assert count == {"iso_cube": 52, "all_range": 50}
    assert len(made.q) == 120


@pytest.mark.parametrize(
    ("options", "parameter", "sentence"),
    [
        ({"criterion": "A"}, "criterion", "criterion: expected position or D, found 'A'"),
        ({"volume": "sphere"}, "volume", "volume: expected both, cube or range, found 'sphere'"),
        ({"without": ["luck"]}, "without", "without: expected limits, height, acceptance, collision, sight or way"),
        ({"axis": 17}, "axis", "expected 18, 158 or 0 axis moves, found 17"),
        ({"cube_edge": 0.4}, "cube_centre", "cube_centre and cube_edge go together"),
        ({"noise": 0.0}, "noise", "noise: expected more than zero, found 0.0"),
        ({"tracker": [1.0, 2.0]}, "tracker", "expected x, y, z of the tracker in metres"),
        ({"axis": 0, "cube": 0, "all_range": 0}, None, "the plan has no poses"),
    ],
)
def test_wrong_options_are_refused_by_name(options, parameter, sentence):
    with pytest.raises(OptionError, match=sentence) as refusal:
        plan("irb1600", **options)
    assert refusal.value.parameter == parameter


def test_the_robot_must_be_named():
    with pytest.raises(TypeError):
        plan()


def test_a_plan_takes_no_new_attributes_and_its_prediction_is_printed_short():
    found = plan("irb1600", axis=0, cube=6, all_range=6, level=11, without=("collision", "sight", "way"))
    assert found.wish.level == "11"
    with pytest.raises(FrozenInstanceError):
        found.more = 1
    assert 10 < len(repr(found.prediction)) < 200


def test_how_many_are_best_is_a_number():
    with pytest.raises(OptionError, match="optimal: expected a whole number of at least 0, found 'x'"):
        plan("irb1600", optimal="x")
