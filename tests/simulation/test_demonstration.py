"""The demonstration's cell: the shipped robot with worn gears, and poses of the thesis's kinds."""

import numpy as np

from irbcal.simulation import demonstration, procedure
from irbcal.simulation.shipped import open_cell


def test_it_is_the_shipped_robot_with_gears_worn_twice_as_much():
    cell, shipped = demonstration.demonstration_cell(), open_cell("irb1600")
    assert all(
        np.array_equal(getattr(cell.table, name), getattr(shipped.table, name)) for name in ("alpha", "a", "theta", "d")
    )
    worn, new = ({effect.name: effect for effect in item.effects} for item in (cell, shipped))
    for name in worn.keys() - {"backlash", "harmonics", "lost"}:
        assert worn[name] == new[name]
    np.testing.assert_allclose(
        worn["backlash"].peak_to_peak_deg, 2 * np.array(new["backlash"].peak_to_peak_deg), rtol=1e-12
    )
    assert list(cell.references) == ["ref1", "ref2", "ref3"]
    assert cell.tool.names == ("smr1", "smr2", "smr3")


def test_poses_are_in_their_areas_and_seeds_make_them_again():
    cell = demonstration.demonstration_cell()
    poses = demonstration.identification_poses(cell)
    assert len(poses.q) == 120
    tip = cell.arm.forward(poses.q)[:, :3, 3]
    assert procedure.in_cube(tip[poses.extra["group"] == "iso_cube"]).all()
    assert procedure.in_range(tip[poses.extra["group"] == "all_range"]).all()
    np.testing.assert_array_equal(demonstration.identification_poses(cell).q, poses.q)
    others = demonstration.verification_poses(cell).q
    assert len(others) == 1000
    assert np.abs(poses.q[:, None] - others[None]).max(axis=2).min() > 1e-3
