"""Looks of a robot: visuals where the URDF puts them, and rods where there are none."""

import numpy as np
import pytest
from viewer_urdf import looks, mesh, write_stl

from irbcal.viewer import building, shapes


def test_meshes_stand_where_the_urdf_puts_them(packages):
    visual = (
        '<visual><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry>'
        '<mesh filename="package://my_robot/meshes/part.stl" scale="0.2 0.4 0.6"/></geometry>'
        '<material name="red"><color rgba="1 0 0 1"/></material></visual>'
    )
    found, notes = looks(visual, packages, [packages])
    assert notes == []
    assert list(found) == [0]
    np.testing.assert_allclose(found[0].vertices.min(axis=0), [1 - 0.2, 2 - 0.1, 3 - 0.3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[0].vertices.max(axis=0), [1 + 0.2, 2 + 0.1, 3 + 0.3], rtol=0, atol=1e-6)
    assert (found[0].colours == [255, 0, 0]).all()


@pytest.mark.parametrize(
    "visual",
    [
        "<visual/>",
        "<visual><geometry/></visual>",
        '<visual><geometry><box size="1 2"/></geometry></visual>',
        '<visual><geometry><cylinder radius="1"/></geometry></visual>',
        '<visual><geometry><sphere radius="nan"/></geometry></visual>',
        "<visual><geometry><teapot/></geometry></visual>",
        '<visual><origin xyz="a b c"/><geometry><sphere radius="1"/></geometry></visual>',
    ],
)
def test_visuals_that_make_no_sense_are_noted(visual, tmp_path):
    found, notes = looks(visual, tmp_path)
    assert len(notes) == 1
    assert 0 in found


def test_a_robot_without_looks_is_drawn_as_rods(tmp_path):
    found, notes = looks("", tmp_path)
    assert notes == []
    assert set(found) == set(range(7))


def test_many_triangles_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "MAX_TRIANGLES", 10)
    write_stl(tmp_path / "part.stl", shapes.box([1, 1, 1]))
    assert "more than 10 triangles" in looks(mesh("part.stl"), tmp_path)[1][0]
