"""Collisions and blocked lines of sight against linear programmes, clipped half-spaces and cast rays."""

import functools

import numpy as np
import pytest
import trimesh
from solids import hulls, link_frames, touches_itself, within
from support import arm

from irbcal.errors import RobotError
from irbcal.io import robots, urdf
from irbcal.modeling import frames
from irbcal.planning import collisions
from irbcal.planning.collisions import BEAM_GAP, BEAM_RADIUS, CollisionModel

PLACE = np.array([1.55, 1.63, 1.51])
TOOL = np.array([[-0.087, 0.087, 0.11], [0.0, 0.0, 0.11], [0.06, -0.06, 0.057]])


@functools.cache
def model(name):
    data = robots.robot_file(name).read_bytes()
    return CollisionModel(data, arm(name), package_dirs=robots.package_dirs())


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_self_collisions_are_those_of_linear_programmes_on_the_hulls(name):
    q = arm(name).random_joints(25, 4)
    q[:5, 1:3] = [arm(name).upper[1:3]] * 5  # bent down to the base
    found = model(name).touching(q)
    assert found.tolist() == [touches_itself(name, row) for row in q]
    assert found.any()
    assert not found.all()


def test_a_folded_arm_touches_itself_and_a_stretched_one_does_not():
    folded, stretched = np.radians([[0, 120, 65, 0, 0, 0], [0, 0, 0, 0, 0, 0]])
    assert touches_itself("irb1600", folded)
    assert model("irb1600").touching(np.array([folded, stretched])).tolist() == [True, False]
    assert model("irb1600").overlapping == []


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_blocked_lines_of_sight_are_those_of_rays_and_half_spaces(name):
    nominal, place = arm(name), PLACE if name == "irb1600" else 0.5 * PLACE
    q = nominal.random_joints(40, 2)
    T = nominal.forward(q)
    points = TOOL @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    blocked = model(name).blocked(q, points, place)
    assert 0.05 < blocked.mean() < 0.6
    rays, inflated = np.zeros_like(blocked), np.zeros_like(blocked)
    for n, row in enumerate(q):
        at = link_frames(name, row)
        for k, point in enumerate(points[n]):
            way = place - point
            length = np.linalg.norm(way)
            start = point + way / length * BEAM_GAP
            for link, hull in hulls(name):
                inflated[n, k] |= within(hull, at[link], start, place, BEAM_RADIUS + 1e-6)
        scene = trimesh.util.concatenate([hull.copy().apply_transform(at[link]) for link, hull in hulls(name)])
        # from the tracker: a ray that hits something before the last part of the beam
        way = points[n] - place
        length = np.linalg.norm(way, axis=1)
        where, which, _ = scene.ray.intersects_location(np.tile(place, (3, 1)), way, multiple_hits=False)
        rays[n, which] = np.linalg.norm(where - place, axis=1) < length[which] - BEAM_GAP
    assert not (rays & ~blocked).any()
    assert not (blocked & ~inflated).any()
    assert (inflated & ~rays).mean() < 0.05  # the two bounds leave little between them


def test_beams_that_are_not_asked_for_count_as_blocked():
    q = np.zeros((2, 6))
    T = arm().forward(q)
    points = TOOL @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    free = np.array([3.0, 0.0, 1.2])
    assert not model("irb1600").blocked(q, points, free).any()
    asked = np.array([[True, False, False], [False, False, True]])
    assert model("irb1600").blocked(q, points, free, asked).tolist() == (~asked).tolist()
    behind = np.array([-3.0, 0.0, 1.1865])  # the forearm is in between
    assert model("irb1600").blocked(q, points[:, 1:2], behind).all()


def box(name, size, origin="0 0 0"):
    return (
        f'<link name="{name}"><collision><origin xyz="{origin}"/><geometry><box size="{size}"/></geometry>'
        "</collision></link>"
    )


def joint(name, parent, child, xyz, kind="revolute"):
    limit = '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>' if kind == "revolute" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="0 0 0"/>{limit}</joint>'
    )


def made(*parts):
    data = f'<robot name="made">{"".join(parts)}</robot>'.encode()
    return data, urdf.from_bytes(data, "made").arm


TWO_JOINTS = (
    '<link name="a"/><link name="tool0"/>',
    joint("j1", "base_link", "a", "0 0 1"),
    joint("j2", "a", "tool0", "1 0 0"),
)


def test_base_link_that_is_not_the_root_and_links_that_overlap_by_construction():
    data, nominal = made(
        '<link name="world"/>',
        box("base_link", "0.1 0.1 0.1"),
        box("a", "0.2 0.2 0.1"),
        box("b", "0.1 0.1 0.3", "0 0 -0.05"),
        box("c", "0.1 0.1 0.1"),
        '<link name="tool0"/>',
        joint("stand", "world", "base_link", "5 6 7", "fixed"),
        joint("j1", "base_link", "a", "0 0 0.2"),
        joint("j2", "a", "b", "0 0 0"),
        joint("j3", "b", "c", "1 0 0"),
        joint("end", "c", "tool0", "0 0 0.5", "fixed"),
    )
    found = CollisionModel(data, nominal)
    assert found.overlapping == [("base_link", "b")]  # b goes through the base whatever the joints are
    assert ("base_link", "c") in found.pairs
    # seen from the base link, beams along x: through c at (1, 0, 0.2), and past its side at y = 0.05
    y = np.array([0.0, 0.054, 0.056])
    points = np.stack([np.full(3, 2.0), y, np.full(3, 0.2)], axis=1)
    beside = [[0.3, value, 0.2] for value in y]
    found_blocked = [
        found.blocked(np.zeros((1, 3)), p[None, None], np.array(b)) for p, b in zip(points, beside, strict=True)
    ]
    assert np.ravel(found_blocked).tolist() == [True, True, False]


def test_files_outside_the_folders_are_never_read(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / "secret.stl").write_bytes(trimesh.creation.box().export(file_type="stl"))
    (tmp_path / "inside" / "good.stl").write_bytes(trimesh.creation.box([0.1] * 3).export(file_type="stl"))
    (tmp_path / "inside" / "notes.txt").write_text("not a mesh")

    def with_mesh(name):
        mesh = f'<link name="base_link"><collision><geometry><mesh filename="{name}"/></geometry></collision></link>'
        data, nominal = made(mesh, *TWO_JOINTS)
        return CollisionModel(data, nominal, package_dirs=[tmp_path / "inside"])

    assert with_mesh("good.stl").solids == 1
    assert with_mesh("package://good.stl").solids == 1
    for name in ("../secret.stl", f"file://{tmp_path}/secret.stl", "package://../secret.stl", "package://none/a.stl"):
        with pytest.raises(RobotError, match="is not in the folders of meshes"):
            with_mesh(name)
    with pytest.raises(RobotError, match="expected a file on this computer"):
        with_mesh("http://example.com/a.stl")
    with pytest.raises(RobotError, match="expected a file with the ending"):
        with_mesh("notes.txt")


def test_a_urdf_without_collision_geometry_is_refused():
    data, nominal = made('<link name="base_link"/>', *TWO_JOINTS)
    with pytest.raises(RobotError, match="no collision geometry"):
        CollisionModel(data, nominal)


def test_beam_capsules_point_along_the_beams():
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    R = collisions._turned_to(directions)
    assert np.abs(R[:, :, 2] - directions).max() < 1e-15
    assert np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() < 1e-14
    assert np.abs(np.linalg.det(R) - 1).max() < 1e-14
    assert frames.rotation_distance(R[-1], R[-1]) < 1e-9


def test_what_pinocchio_prints_of_a_urdf_is_not_shown(capfd):
    data, arm = made(*TWO_JOINTS, box("base_link", "1 1 1"))
    with pytest.raises(RobotError, match=r"the collision geometry of made cannot be read: \S.*"):
        CollisionModel(data.replace(b'effort="1"', b'effort="much"'), arm)
    assert capfd.readouterr() == ("", "")
