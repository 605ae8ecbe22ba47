"""Meshes that a URDF names are found, and nothing else is."""

import functools
import hashlib
import logging
import os
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import urchin
import yourdfpy
from lxml import etree
from support import assert_same_poses
from viewer_urdf import document, mesh, write_stl

import irbcal
from irbcal.errors import OptionError, RobotError
from irbcal.io import robots, urdf
from irbcal.io.urdf_xml import MeshFolders, MeshProblem, with_mesh_paths
from irbcal.viewer import shapes


@pytest.fixture(scope="session")
def mujoco():
    return pytest.importorskip("mujoco", reason="MuJoCo needs Python 3.11")


@pytest.fixture(scope="module", params=["relative", "absolute"])
def written(request, calibration_34, tmp_path_factory):
    """A calibration folder with mesh paths, blanks and letters beyond ASCII in its own."""
    folder = tmp_path_factory.mktemp("mesh") / "a cell of Zürich" / "cal"
    calibration_34.save(folder, mesh_paths=request.param, world_link=True, target_links=True)
    return folder


@pytest.fixture
def joints(validated):
    """Commanded and effective joints, and the tip in the base link by irbcal."""
    robot = validated.fit.robot
    q = robot.arm.random_joints(40, 4)
    return robot.joint_map.effective(q), robot.poses(q)


def test_mujoco_computes_the_same_poses(written, joints, mujoco):
    model = mujoco.MjModel.from_xml_path(str(written / "calibrated.urdf"))
    data = mujoco.MjData(model)
    assert model.nmesh == 14  # its 14 convex collision shapes
    found = []
    for theta in joints[0]:
        data.qpos[:] = theta
        mujoco.mj_kinematics(model, data)
        T_world_base, T_world_tip = np.eye(4), np.eye(4)
        for T, name in ((T_world_base, "base_link"), (T_world_tip, "tool0")):
            T[:3, :3], T[:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
        found.append(np.linalg.inv(T_world_base) @ T_world_tip)
    assert_same_poses(found, joints[1], 1e-9, 1e-9)


def test_urchin_and_yourdfpy_find_the_meshes_and_compute_the_same_poses(written, joints):
    file = str(written / "calibrated.urdf")
    theirs, other = urchin.URDF.load(file), yourdfpy.URDF.load(file)
    assert sum(len(v.geometry.mesh.meshes) for link in theirs.links for v in link.visuals) > 20
    assert len(other.scene.geometry) > 20
    names = irbcal.load(written).robot_calibrated().arm.joint_names
    found = {"urchin": [], "yourdfpy": []}
    for theta in joints[0]:
        configuration = dict(zip(names, theta.tolist(), strict=True))
        poses = theirs.link_fk(configuration, use_names=True)
        found["urchin"].append(np.linalg.inv(poses["base_link"]) @ poses["tool0"])
        other.update_cfg(configuration)
        found["yourdfpy"].append(other.get_transform("tool0", "base_link"))
    for poses in found.values():
        assert_same_poses(poses, joints[1], 1e-9, 1e-9)


def test_the_calibration_is_whole(written):
    record = irbcal.load(written).record
    content = (written / "calibrated.urdf").read_bytes()
    assert record.calibrated_urdf_sha256 == hashlib.sha256(content).hexdigest()
    assert irbcal.verify(written)
    assert irbcal.verify(written, written / "calibrated.urdf").same_file
    assert not any("mesh" in str(said) for said in irbcal.view(written).report())  # the view finds the meshes, too
    other = written.parent / "whole"
    again = irbcal.load(written).save(other, mesh_paths="absolute")  # of one that was loaded
    assert again.fingerprint == record.fingerprint
    names = [e.get("filename") for e in etree.parse(other / "calibrated.urdf").iter("mesh")]
    assert len(names) == 21
    assert all(os.path.isabs(name) and os.path.isfile(name) for name in names)


def test_package_leaves_the_urdf_as_it_is(calibration_34, tmp_path):
    calibration = calibration_34
    calibration.save(tmp_path / "cal", mesh_paths="package")
    assert (tmp_path / "cal" / "calibrated.urdf").read_bytes() == calibration.urdf
    assert calibration.urdf.count(b"package://") == 21
    with pytest.raises(OptionError, match="mesh_paths"):
        irbcal.save(calibration, tmp_path / "c", mesh_paths="short")


# ---------------------------------------------------------------- what a URDF may name


@pytest.fixture
def cell(tmp_path):
    """A URDF's folder with a mesh and a texture, a package, and a secret outside."""
    box = shapes.box([1, 1, 1])
    for name in ("urdf/meshes/part.stl", "ws/my_robot/meshes/part.stl", "secret.stl"):
        write_stl(tmp_path / name, box)
    (tmp_path / "urdf" / "wood.png").write_bytes(b"")
    (tmp_path / "urdf" / "notes.txt").write_text("private")
    return tmp_path


def written_names(cell, how, *names, extra=""):
    data = etree.tostring(document("".join(map(mesh, names)), extra).tree)
    folders = MeshFolders(cell / "urdf", [cell / "ws"])
    root = etree.fromstring(with_mesh_paths(data, how, cell / "out" / "cal", folders, "arm.urdf"))
    return [element.get("filename") for element in root.iter("mesh", "texture")], root


def test_names_become_paths(cell):
    names = ["package://my_robot/meshes/part.stl", "meshes/part.stl", f"file://{cell}/ws/my_robot/meshes/part.stl"]
    assert written_names(cell, "relative", *names)[0] == [
        "../../ws/my_robot/meshes/part.stl",
        "../../urdf/meshes/part.stl",
        "../../ws/my_robot/meshes/part.stl",
    ]
    assert written_names(cell, "absolute", *names)[0] == [
        f"{cell}/ws/my_robot/meshes/part.stl",
        f"{cell}/urdf/meshes/part.stl",
        f"{cell}/ws/my_robot/meshes/part.stl",
    ]
    texture = '<material name="wood"><texture filename="wood.png"/></material>'
    assert written_names(cell, "absolute", extra=texture)[0] == [f"{cell}/urdf/wood.png"]


@pytest.mark.parametrize("name", ["http://example.org/part.stl", "https://example.org/x", "/etc/passwd", "/dev/zero"])
def test_other_addresses_and_whole_paths_stay(cell, name):
    assert written_names(cell, "absolute", name)[0] == [name]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("../../etc/passwd", "not found"),
        ("../secret.stl", "outside"),
        ("package://my_robot/../../secret.stl", "outside"),
        ("package://../secret.stl", "outside"),
        ("file:///etc/passwd", "outside"),
        ("package://my_robot/meshes/absent.stl", "not found"),
        ("notes.txt", "are read as meshes"),
    ],
)
@pytest.mark.parametrize("how", ["relative", "absolute"])
def test_what_is_not_found_or_lies_outside_is_refused(cell, how, name, why):
    with pytest.raises(RobotError, match=why) as refused:
        written_names(cell, how, "meshes/part.stl", name)
    assert f"cannot be made {how}: {name}" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_too_many_files_are_refused(cell, monkeypatch):
    monkeypatch.setattr("irbcal.io.urdf_xml.MOST_FILES", 2)
    names = ["meshes/part.stl", "./meshes/part.stl"]
    assert len(written_names(cell, "relative", *names, *names)[0]) == 4
    with pytest.raises(RobotError, match="more than 2 files are too many"):
        written_names(cell, "relative", *names, "../urdf/meshes/part.stl")


def test_a_file_is_found_by_whichever_folder_it_lies_in(cell):
    folders = MeshFolders(cell / "urdf", [cell / "ws"])
    assert folders.find("../ws/my_robot/meshes/part.stl") == cell / "ws" / "my_robot" / "meshes" / "part.stl"
    with pytest.raises(MeshProblem, match="outside"):
        folders.find("../secret.stl")


def test_what_a_urdf_says_to_mujoco_is_kept(cell):
    said = '<mujoco><compiler meshdir="../m" strippath="true" balanceinertia="true"/><option timestep="0.1"/></mujoco>'
    root = written_names(cell, "relative", "meshes/part.stl", extra=said)[1]
    (element,) = root.findall("mujoco")
    assert dict(element.find("compiler").attrib) == {"strippath": "false", "balanceinertia": "true"}
    assert element.find("option").get("timestep") == "0.1"
    root = written_names(cell, "relative", extra='<mujoco><option timestep="0.1"/></mujoco>')[1]
    assert root.find("mujoco/compiler").get("strippath") == "false"


def test_the_command_writes_paths_or_nothing(validated, tmp_path, program):
    data = validated.measurements.source
    robot = tmp_path / "my_robot.urdf"
    text = robots.robot_file("irb1600").read_text()
    robot.write_text(text)
    call = ["calibrate", data, "--robot", robot, "--model", "offsets", "--mesh-paths", "absolute", "--out"]
    program(*call, tmp_path / "cal")
    assert b'="package:' not in (tmp_path / "cal" / "calibrated.urdf").read_bytes()
    robot.write_text(text.replace("visual/link_1.dae", "visual/absent.dae"))
    with pytest.raises(RobotError, match=r"absent\.dae: the file was not found"):
        program(*call, tmp_path / "none")
    assert not (tmp_path / "none").exists()


ROOT = Path(__file__).resolve().parents[2]
FOLDER = robots.urdf_folder() / "irbcal_description"
COLLADA = {"c": "http://www.collada.org/2005/11/COLLADASchema"}
MM = 1e-3
MARGIN, REACH = 4 * MM, 8 * MM
ROUNDING = 0.02 * MM
LINKS = ["base_link", *(f"link_{i}" for i in range(1, 7))]
NEIGHBOURS = {LINKS[i]: LINKS[i + 1] for i in range(6)}

# For each joint, the discs across which its two links meet, in mm: from a place on the joint axis that is inside the
# parent to one that is inside the child (measured from the joint's origin), and the radius of the disc.
MEETINGS = {
    "irb1600": [
        [(205, 240, 183)],
        [(-55, -90, 118)],
        [(-95, -65, 92)],
        [(-98, -66, 76)],
        [(60, 40, 46), (-60, -40, 46)],
        [(-22, -10, 28)],
    ],
    "irb120": [
        [(154, 172, 78)],
        [(40, 60, 57), (-40, -60, 57)],
        [(60, 40, 47), (-60, -40, 47)],
        [(112, 140, 46)],
        [(45, 25, 35.5), (-45, -25, 35.5)],
        [(-22, -9, 20)],
    ],
}
ROBOTS = pytest.mark.parametrize("robot", robots.ROBOTS)


def floats(element):
    return np.array(element.text.split(), dtype=float)


@functools.cache
def parts(robot, link):
    """Parts of a link's visual: name -> vertices (n, 3), faces (m, 3), corner normals (m, 3, 3), colour."""
    root = ET.parse(FOLDER / "meshes" / robot / "visual" / f"{link}.dae").getroot()
    assert root.find("c:asset/c:unit", COLLADA).get("meter") == "1"
    assert root.find("c:asset/c:up_axis", COLLADA).text == "Z_UP"
    colours = {
        effect.get("id"): floats(effect.find(".//c:diffuse/c:color", COLLADA))
        for effect in root.findall(".//c:effect", COLLADA)
    }
    of_material = {
        material.get("id"): colours[material.find("c:instance_effect", COLLADA).get("url")[1:]]
        for material in root.findall(".//c:material", COLLADA)
    }
    out = {}
    for geometry in root.findall(".//c:geometry", COLLADA):
        positions, normals = (floats(a).reshape(-1, 3) for a in geometry.findall(".//c:float_array", COLLADA))
        corners = floats(geometry.find(".//c:p", COLLADA)).astype(int).reshape(-1, 3, 2)
        colour = of_material[geometry.find(".//c:triangles", COLLADA).get("material")]
        out[geometry.get("name")] = positions, corners[..., 0], normals[corners[..., 1]], colour
    shown = [node.get("url")[1:] for node in root.findall(".//c:node/c:instance_geometry", COLLADA)]
    assert shown == [f"{name}-mesh" for name in out]
    return out


@functools.cache
def pieces(robot, link):
    """Triangles (m, 3, 3) of each convex piece of a link's collision shape."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("none", "<u2")])
    files = sorted((FOLDER / "meshes" / robot / "collision").glob(f"{link}*.stl"))
    return [np.frombuffer(path.read_bytes()[84:], dtype=record)["corners"].astype(float) for path in files]


def planes(triangles):
    """Outward unit normals and offsets of triangles."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return normal, np.sum(normal * triangles[:, 0], axis=1)


def inside(points, vertices, faces):
    """Whether points are inside a closed solid: the solid angle under which they see its faces is 4 pi."""
    out = np.zeros(len(points), dtype=bool)
    near = np.flatnonzero(np.all((points > vertices.min(axis=0)) & (points < vertices.max(axis=0)), axis=1))
    if len(near):
        a, b, c = (vertices[faces[:, i]] - points[near, None] for i in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        triple = np.sum(a * np.cross(b, c), axis=-1)
        dots = (np.sum(u * v, axis=-1) for u, v in ((a, b), (b, c), (c, a)))
        angle = 2 * np.arctan2(
            triple, la * lb * lc + sum(d * length for d, length in zip(dots, (lc, la, lb), strict=True))
        )
        out[near] = angle.sum(axis=1) > 2 * np.pi
    return out


def in_link(robot, link, points):
    """Whether points are inside any part of a link's visual."""
    return np.any([inside(points, vertices, faces) for vertices, faces, _, _ in parts(robot, link).values()], axis=0)


def urdf_joints(robot):
    """Origin and axis of the six joints."""
    root = ET.parse(robots.robot_file(robot)).getroot()
    moving = [joint for joint in root.findall("joint") if joint.get("type") == "revolute"]
    numbers = [[joint.find(tag).get("xyz").split() for tag in ("origin", "axis")] for joint in moving]
    return [(np.array(origin, float), np.array(axis, float)) for origin, axis in numbers]


@functools.cache
def model(robot):
    return pin.buildModelFromUrdf(str(robots.robot_file(robot)))


def geometry(robot, kind):
    return pin.buildGeomFromUrdf(model(robot), str(robots.robot_file(robot)), kind, package_dirs=robots.package_dirs())


# ---------------------------------------------------------------- the files


@ROBOTS
def test_urdf_names_exactly_the_files_that_exist_and_they_are_small(robot):
    named = re.findall(r'<mesh filename="([^"]+)"', robots.robot_file(robot).read_text())
    assert all(name.startswith(f"package://irbcal_description/meshes/{robot}/") for name in named)
    found = [Path(robots.mesh_file(name)) for name in named]
    files = [path for path in (FOLDER / "meshes" / robot).rglob("*") if path.is_file()]
    assert sorted(found) == sorted(files)
    assert len(set(found)) == len(found)
    assert sum(path.stat().st_size for path in files) < 1.4e6


def test_script_makes_the_same_files_and_notices_a_difference(tmp_path, monkeypatch, capsys):
    script = runpy.run_path(str(ROOT / "scripts" / "make_meshes"))
    made = script["files"]()
    there = [path for path in (FOLDER / "meshes").rglob("*") if path.is_file()]
    assert {str(path.relative_to(FOLDER / "meshes")): path.read_bytes() for path in there} == made
    monkeypatch.setitem(script["main"].__globals__, "files", lambda: made)
    folder = tmp_path / "meshes"

    def run(*options):
        monkeypatch.setattr(sys, "argv", ["make_meshes", "--out", str(folder), *options])
        script["main"]()

    folder.mkdir()
    (folder / "stray.stl").touch()
    run()
    assert {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} == set(made)
    with pytest.raises(SystemExit, match="0"):
        run("--check")
    changed = folder / "irb120" / "collision" / "link_6.stl"
    changed.write_bytes(changed.read_bytes()[:-3] + b"abc")
    capsys.readouterr()
    with pytest.raises(SystemExit, match="1"):
        run("--check")
    assert capsys.readouterr().out.split() == [str(len(made)), "files,", "1", "differ", "irb120/collision/link_6.stl"]


def test_wheel_holds_the_meshes_beside_the_urdf():
    pytest.importorskip("hatchling")
    from hatchling.builders.wheel import WheelBuilder

    held = {file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()}
    expected = {f"irbcal/urdf/{path.relative_to(FOLDER.parent)}" for path in FOLDER.rglob("*") if path.is_file()}
    assert len(expected) > 30
    assert expected <= held
    assert {f"irbcal/urdf/{name}" for name in robots.ROBOTS.values()} <= held


def test_ros_package_is_described():
    described = ET.parse(FOLDER / "package.xml").getroot()
    assert described.find("name").text == FOLDER.name
    assert {"version", "description", "maintainer", "license"} <= {child.tag for child in described}
    assert f"project({FOLDER.name}" in (FOLDER / "CMakeLists.txt").read_text()
    assert "install(DIRECTORY" in (FOLDER / "CMakeLists.txt").read_text()


# ---------------------------------------------------------------- the visuals


@ROBOTS
@pytest.mark.parametrize("link", LINKS)
def test_every_part_is_closed_faces_outwards_and_has_fitting_normals(robot, link):
    for name, (vertices, faces, normals, _) in parts(robot, link).items():
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        there = edges[:, 0] * len(vertices) + edges[:, 1]
        back = edges[:, 1] * len(vertices) + edges[:, 0]
        assert len(np.unique(there)) == len(there), name
        assert np.array_equal(np.sort(there), np.sort(back)), name
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        assert np.sum(a * np.cross(b, c)) / 6 > (3 * MM) ** 3, name
        assert np.abs(np.linalg.norm(normals, axis=-1) - 1).max() < 2e-3, name
        flat = np.cross(b - a, c - a)
        large = np.linalg.norm(flat, axis=1) > 1e-6
        cosine = np.sum(flat[:, None] * normals, axis=-1)[large] / np.linalg.norm(flat[large], axis=1, keepdims=True)
        assert cosine.min() > 0.5, name


@ROBOTS
def test_round_things_look_smooth_and_edges_crisp(robot):
    """Around a turned hub neighbouring faces share their normals; across the rim of a flange they do not."""
    _, faces, normals, _ = parts(robot, "link_5")["drum"]
    by_corner = {}
    for vertex, normal in zip(faces.ravel(), normals.reshape(-1, 3), strict=True):
        by_corner.setdefault(vertex, set()).add(tuple(normal))
    assert np.mean([len(different) == 1 for different in by_corner.values()]) > 0.9
    _, faces, normals, _ = parts(robot, "link_6")["flange"]
    by_corner = {}
    for vertex, normal in zip(faces.ravel(), normals.reshape(-1, 3), strict=True):
        by_corner.setdefault(vertex, set()).add(tuple(normal))
    assert np.mean([len(different) > 1 for different in by_corner.values()]) > 0.9


@ROBOTS
def test_colours(robot):
    area = {}
    for link in LINKS:
        for vertices, faces, _, colour in parts(robot, link).values():
            a, b, c = (vertices[faces[:, i]] for i in range(3))
            area[tuple(colour)] = area.get(tuple(colour), 0) + np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert len(area) >= 4
    assert all(colour[3] == 1 for colour in area)
    red, green, blue, _ = max(area, key=area.get)
    if robot == "irb1600":
        assert red > 2 * green > 4 * blue  # orange
    else:
        assert min(red, green, blue) > 0.75  # white
    assert min(sum(colour[:3]) for colour in area) < 0.3  # and something black on it
    assert max(area.values()) < 0.97 * sum(area.values())


@ROBOTS
def test_no_gap_at_any_angle(robot):
    angles = np.radians([-170, -31, 58, 143])
    around = np.linspace(0, 2 * np.pi, 13, endpoint=False)
    for number, ((origin, axis), meetings) in enumerate(zip(urdf_joints(robot), MEETINGS[robot], strict=True)):
        parent, child = LINKS[number], LINKS[number + 1]
        side = np.roll(axis, 1)
        across = np.cos(around)[:, None] * side + np.sin(around)[:, None] * np.cross(axis, side)
        for start, end, radius in meetings:
            steps = np.linspace(start, end, 6) * MM
            rings = [steps[:, None, None] * axis + part * radius * MM * across for part in (0.02, 0.5, 0.95)]
            disc = np.stack(rings, axis=1)  # steps, rings, around, xyz, in the joint frame at zero angle
            in_parent = in_link(robot, parent, disc.reshape(-1, 3) + origin).reshape(disc.shape[:3])
            assert in_parent[0].all(), (parent, start)
            for angle in angles:
                turned = disc @ pin.AngleAxis(angle, axis).toRotationMatrix()  # into the child frame
                in_child = in_link(robot, child, turned.reshape(-1, 3)).reshape(disc.shape[:3])
                assert in_child[-1].all(), (child, end)
                assert (in_parent | in_child).all(), (child, angle)


@ROBOTS
def test_mounting_face_is_where_the_urdf_has_it(robot):
    points = np.concatenate([vertices for vertices, *_ in parts(robot, "link_6").values()])
    assert -0.5 * MM < points[:, 0].max() <= 0
    assert np.abs(points[:, 1:].min(axis=0) + points[:, 1:].max(axis=0)).max() < ROUNDING  # centred on axis 6
    floor = np.concatenate([vertices for vertices, *_ in parts(robot, "base_link").values()])
    assert floor[:, 2].min() == 0


# ---------------------------------------------------------------- the collision shapes


@ROBOTS
@pytest.mark.parametrize("link", LINKS)
def test_collision_is_convex_and_encloses_the_visual_by_4_to_8_mm(robot, link):
    margin = []
    samples = []
    for vertices, faces, _, _ in parts(robot, link).values():
        samples += [
            vertices,
            vertices[faces].mean(axis=1),
            (vertices[faces] + np.roll(vertices[faces], 1, axis=1)).reshape(-1, 3) / 2,
        ]
    samples = np.unique(np.round(np.concatenate(samples), 5), axis=0)
    for triangles in pieces(robot, link):
        normal, offset = planes(triangles)
        assert (triangles.reshape(-1, 3) @ normal.T - offset).max() < ROUNDING  # convex
        _, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        edges = np.concatenate([index.reshape(-1, 3)[:, [i, (i + 1) % 3]] for i in range(3)])
        assert set(map(tuple, edges)) == set(map(tuple, edges[:, ::-1]))  # closed
        sideways = normal[:, 2] > -0.999 if link == "base_link" else slice(None)  # the base stands on the floor
        margin.append((offset - samples @ normal.T)[:, sideways].min(axis=1))
    assert np.max(margin, axis=0).min() > MARGIN - ROUNDING
    outer = np.concatenate(pieces(robot, link)).reshape(-1, 3)
    low, high = samples.min(axis=0), samples.max(axis=0)
    assert (low - outer.min(axis=0)).max() < REACH
    assert (outer.max(axis=0) - high).max() < REACH
    if link == "base_link":
        assert np.abs(outer[:, 2].min()) < ROUNDING


def collision_model(robot):
    """Convex shapes, all pairs of links that are not neighbours."""
    shapes = geometry(robot, pin.GeometryType.COLLISION)
    for shape in shapes.geometryObjects:
        shape.geometry.buildConvexRepresentation(False)
        shape.geometry = shape.geometry.convex
    for i, first in enumerate(shapes.geometryObjects):
        for j, second in enumerate(shapes.geometryObjects[:i]):
            if abs(first.parentJoint - second.parentJoint) > 1:
                shapes.addCollisionPair(pin.CollisionPair(j, i))
    return shapes


@ROBOTS
def test_self_collision(robot):
    arm, shapes = model(robot), collision_model(robot)
    data, results = arm.createData(), shapes.createData()

    def collides(q):
        return pin.computeCollisions(arm, data, shapes, results, np.asarray(q), False)

    assert not collides(np.zeros(6))
    q = urdf.read(robot).arm.random_joints(200, 3)
    assert np.mean([not collides(row) for row in q]) > 0.9
    for bend in np.linspace(arm.lowerPositionLimit[4], arm.upperPositionLimit[4], 9):
        assert not collides([0, 0, 0, 0.7, bend, 0.4])  # the wrist alone never reaches its own arm
    folded = {"irb1600": [0, -90, -230, 0, -40, 0], "irb120": [0, 80, 60, 0, 30, 0]}[robot]
    q = np.radians(folded)
    assert (q > arm.lowerPositionLimit - 1e-9).all()
    assert (q < arm.upperPositionLimit + 1e-9).all()
    flange = urdf.read(robot).arm.forward(q[None])[:, :3, 3]
    assert in_link(robot, "base_link", flange).all()  # truly inside the base
    assert collides(q)


# ---------------------------------------------------------------- other programs


def bounds(robot, q, kind):
    """Lowest and highest coordinates of a robot by Pinocchio's kinematics and the files as read here."""
    data = model(robot).createData()
    pin.framesForwardKinematics(model(robot), data, q)
    points = []
    for link in LINKS:
        place = data.oMf[model(robot).getFrameId(link)]
        own = [p[0] for p in parts(robot, link).values()] if kind == "visual" else pieces(robot, link)
        points.append(np.concatenate([p.reshape(-1, 3) for p in own]) @ place.rotation.T + place.translation)
    points = np.concatenate(points)
    return np.stack([points.min(axis=0), points.max(axis=0)])


@ROBOTS
def test_yourdfpy_shows_all_where_it_belongs(robot, caplog):
    with caplog.at_level(logging.WARNING):
        seen = yourdfpy.URDF.load(
            str(robots.robot_file(robot)),
            filename_handler=robots.mesh_file,
            build_collision_scene_graph=True,
            load_collision_meshes=True,
            force_collision_mesh=False,
        )
    assert caplog.records == []
    assert seen.validate()
    assert len(seen.scene.geometry) == sum(len(parts(robot, link)) for link in LINKS)
    colours = {tuple(mesh.visual.material.main_color) for mesh in seen.scene.geometry.values()}
    assert len(colours) >= 4
    for q in urdf.read(robot).arm.random_joints(2, 1):
        seen.update_cfg(q)
        assert np.abs(seen.scene.bounds - bounds(robot, q, "visual")).max() < ROUNDING
        assert np.abs(seen.collision_scene.bounds - bounds(robot, q, "collision")).max() < ROUNDING


@ROBOTS
def test_pinocchio_shows_all_where_it_belongs(robot):
    for kind, name in ((pin.GeometryType.VISUAL, "visual"), (pin.GeometryType.COLLISION, "collision")):
        shapes = geometry(robot, kind)
        assert not any(shape.overrideMaterial for shape in shapes.geometryObjects)  # colours are those of the files
        assert shapes.ngeoms == (7 if name == "visual" else sum(len(pieces(robot, link)) for link in LINKS))
        data, results = model(robot).createData(), shapes.createData()
        q = urdf.read(robot).arm.random_joints(1, 2)[0]
        pin.updateGeometryPlacements(model(robot), data, shapes, results, q)
        points = [
            place.act(point)
            for place, shape in zip(results.oMg, shapes.geometryObjects, strict=True)
            for point in shape.geometry.vertices()
        ]
        seen = np.stack([np.min(points, axis=0), np.max(points, axis=0)])
        assert np.abs(seen - bounds(robot, q, name)).max() < ROUNDING


# ---------------------------------------------------------------- where packages are looked up


def test_package_dirs_follow_the_environment_in_order_and_once(monkeypatch, tmp_path):
    for name in ("mine", "ros/some_description", "ament/share"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "ros" / "some_description" / "package.xml").write_text("<package/>")
    single, absent = tmp_path / "ros" / "some_description", tmp_path / "absent"
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(map(str, (single, absent, single))))
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(map(str, (tmp_path / "ament", absent))))
    found = robots.package_dirs(tmp_path / "mine")
    expected = [tmp_path / "mine", robots.urdf_folder(), single, tmp_path / "ros", tmp_path / "ament" / "share"]
    assert found[:5] == [str(path) for path in expected]
    assert len(found) == len(set(found))
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    assert robots.package_dirs()[0] == str(robots.urdf_folder())
    assert str(single) not in robots.package_dirs()


def test_robots_of_example_robot_data_are_found_without_importing_it():
    code = (
        "import sys; from irbcal.io import robots; print(robots.package_dirs()[-1]); print('pinocchio' in sys.modules)"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code]
    said = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()
    assert said[1] == "False"
    panda = Path(said[0]) / "example-robot-data" / "robots" / "panda_description" / "urdf" / "panda.urdf"
    named = re.findall(r'<mesh filename="(package://[^"]+)"', panda.read_text())
    assert named
    assert all(Path(robots.mesh_file(name)).is_file() for name in named)


def test_mesh_file_takes_uris_and_paths(tmp_path):
    uri = "package://irbcal_description/meshes/irb120/visual/link_1.dae"
    assert Path(robots.mesh_file(uri)) == FOLDER / "meshes" / "irb120" / "visual" / "link_1.dae"
    copied = tmp_path / "irbcal_description" / "meshes" / "irb120" / "visual" / "link_1.dae"
    copied.parent.mkdir(parents=True)
    copied.touch()
    assert robots.mesh_file(uri, [tmp_path]) == str(copied)
    assert robots.mesh_file(uri, robots.package_dirs(tmp_path)) == str(copied)
    assert robots.mesh_file("package://nowhere/a.stl") == "package://nowhere/a.stl"
    assert robots.mesh_file("file:///some/a.stl") == "/some/a.stl"
    assert robots.mesh_file("meshes/a.stl") == "meshes/a.stl"
