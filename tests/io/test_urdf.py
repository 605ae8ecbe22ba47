"""URDF files are read to arms and written back with corrected joint origins, all else as it was."""

import dataclasses
import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from support import arm, assert_same_poses, example_robot

import irbcal
from irbcal.errors import RobotError
from irbcal.io import robots, urdf, urdf_check, urdf_xml
from irbcal.io.robots import robot_file
from irbcal.io.urdf import choose_tip, speed_limits
from irbcal.modeling import parameters


def tree(*pairs):
    """Links, what each hangs on, and which move; ``a>b`` moves, ``a-b`` is fixed."""
    above, moved, links = {}, set(), []
    for pair in pairs:
        parent, link = pair.replace(">", "-").split("-")
        links += [name for name in (parent, link) if name not in links]
        above[link] = parent
        if ">" in pair:
            moved.add(link)
    return links, above, moved


def test_usual_names_and_single_ends_need_no_question():
    assert choose_tip(*tree("base>l1", "l1>l2", "l2-tool0", "l2-cable"), "x.urdf") == "tool0"
    assert choose_tip(*tree("base>l1", "l1>l2", "base-camera"), "x.urdf") == "l2"


def test_the_hand_comes_before_its_fingers():
    arm = tree("base>l1", "l1>l7", "l7-link8", "link8-my_hand", "my_hand>finger_b", "my_hand>finger_a", "base-camera")
    with pytest.raises(RobotError, match="candidates are my_hand, link8, l7, finger_a, finger_b: name one") as refused:
        choose_tip(*arm, "x.urdf")
    assert refused.value.parameter == "tip_link"


def test_likely_names_and_near_links_come_first():
    arm = tree("base>l1", "l1>l2", "l2-a", "a-far", "l2-cover", "l2-b", "b-c", "c-gun_tcp")
    with pytest.raises(RobotError, match="candidates are gun_tcp, l2, cover, far: name"):
        choose_tip(*arm, "x.urdf")


def test_many_candidates_are_counted():
    with pytest.raises(RobotError, match=r"e00, e01, .* and 19 more: name one"):
        choose_tip(*tree("base>l1", *(f"l1-e{k:02d}" for k in range(30))), "x.urdf")


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "my.urdf"
    path.write_bytes(robot_file("irb120").read_bytes())
    return path


def test_without_a_file_there_is_none(robot):
    assert irbcal.read_urdf(robot).arm.coupling is None


def test_the_file_is_read(robot):
    robot.with_name("my.coupling.yaml").write_text("coupling: 3-2\n")
    expected = np.eye(6)
    expected[2, 1] = -1.0
    np.testing.assert_array_equal(irbcal.read_urdf(robot).arm.coupling, expected)
    robot.with_name("my.coupling.yaml").write_text(f"coupling: {expected.tolist()}\n")
    np.testing.assert_array_equal(irbcal.read_urdf(robot).arm.coupling, expected)


@pytest.mark.parametrize("text", ["3+2", "coupling:", "coupling: 3+9", "coupling: [1, 2]", "other: 3+2", "[", "\x00"])
def test_what_is_not_understood_is_refused(robot, text):
    robot.with_name("my.coupling.yaml").write_text(text)
    with pytest.raises(RobotError, match="coupling"):
        irbcal.read_urdf(robot)


def perturbed(found, seed, size=1.0):
    """The arm with errors on every parameter of links 2 to 6, Hayati's tilt included."""
    rng = np.random.default_rng(seed)
    scale = {"alpha": 2e-3, "a": 1e-3, "theta": 2e-3, "d": 1e-3, "beta": 2e-3}
    moved = np.arange(6) > 0
    changes = {k: getattr(found.arm.table, k) + size * s * moved * rng.normal(size=6) for k, s in scale.items()}
    return found.arm.with_table(dataclasses.replace(found.arm.table, **changes))


def test_nominal_arm_is_written_back_byte_for_byte_for_shipped_files():
    for name in robots.ROBOTS:
        found = urdf.read(name)
        original = robots.robot_file(name).read_bytes()
        assert urdf.to_bytes(found, found.arm).split(b"\n", 1)[1].strip() == original.split(b"\n", 1)[1].strip()


def test_numbers_carry_seventeen_digits():
    found = urdf.read("irb1600")
    robot = perturbed(found, 7)
    text = urdf.to_bytes(found, robot)
    xyz = etree.fromstring(text).find("joint[@name='joint_3']/origin").get("xyz").split()
    assert max(len(v.lstrip("-0.").replace(".", "")) for v in xyz) >= 16


def test_a_huge_file_is_refused():
    with pytest.raises(RobotError, match="too large for a URDF"):
        urdf.from_bytes(b" " * 20_000_001 + b"x", "big")


@pytest.mark.parametrize(
    "name", ["\x01.csv", "a---b.csv", "--", "\udc80.csv", "zwei\nZeilen\u2028.csv", "Ü\ufffe-.csv"]
)
def test_words_of_any_file_name_are_a_comment(name):
    root = etree.fromstring("<robot name='a'/>")
    urdf_xml.begin_with(root, f"{urdf_xml.WORDS_MARK} from {name}")
    read = etree.fromstring(etree.tostring(root.getroottree()))
    (comment,) = read.itersiblings(preceding=True)
    assert comment.text.strip().startswith(f"{urdf_xml.WORDS_MARK} from ")
    assert comment.text.isprintable()


TABLES = {  # alpha deg, a mm, theta deg, d mm
    "irb1600": [[0, 0, 0, 486.5], [-90, 150, -90, 0], [0, 700, 0, 0], [-90, 0, 0, 600], [90, 0, 0, 0], [-90, 0, 180, 65]],
    "irb120": [[0, 0, 0, 290], [-90, 0, -90, 0], [0, 270, 0, 0], [-90, 70, 0, 302], [90, 0, 0, 0], [-90, 0, 180, 72]],
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_shipped_robots_give_their_printed_tables(name):
    found = urdf.read(name).arm
    table, printed = found.table, np.array(TABLES[name], dtype=float)
    assert np.abs(table.alpha - np.radians(printed[:, 0])).max() < 1e-12
    assert np.abs(table.a - printed[:, 1] * 1e-3).max() < 1e-12
    turns = np.abs((table.theta - np.radians(printed[:, 2]) + np.pi) % (2 * np.pi) - np.pi)
    assert turns.max() < 1e-12
    assert np.abs(table.d - printed[:, 3] * 1e-3).max() < 1e-12
    assert not table.beta.any()
    assert np.array_equal(found.T_base_0, np.eye(4))
    assert np.array_equal(found.T_last_tip, np.eye(4))


UR = [f"ur_description/urdf/ur{n}_robot.urdf" for n in (3, 5, 10)]


@pytest.mark.parametrize("name", ["irb1600", "irb120", *UR])
def test_pinocchio_agrees_on_the_written_urdf(name):
    """10,000 random configurations inside the limits, nominal and corrected (UR arms stand for any six-axis arm)."""
    found = urdf.read(name if name in robots.ROBOTS else example_robot(name))
    for robot in (found.arm, perturbed(found, 1)):
        q = robot.random_joints(10_000, 2)
        by_pinocchio = urdf_check.poses(urdf.to_bytes(found, robot), robot, q)
        assert_same_poses(by_pinocchio, robot.forward(q), 1e-12, 1e-12)


@pytest.mark.parametrize("name", ["irb1600", *UR])
def test_no_link_frame_is_thrown_away_from_its_link(name):
    """Link frames at zero joints move by no more than the errors do, parallel axes or not."""
    found = urdf.read(name if name in robots.ROBOTS else example_robot(name))
    robot = perturbed(found, 3)
    again = urdf.from_bytes(urdf.to_bytes(found, robot), "written", robot.base_link, robot.tip_link)
    assert urdf.largest_link_shift(found, robot) < 0.02
    q = robot.random_joints(100, 0)
    assert_same_poses(again.arm.forward(q), robot.forward(q), 1e-12, 1e-12)
    assert np.abs(again.arm.table.d).max() < 2, "near-parallel axes are read back without far-away normals"


RICH = b"""<?xml version="1.0"?>
<!-- before the robot -->
<robot name="rich" xmlns:xacro="urn:xacro">
  <link name="world"/>
  <link name="base_link"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="pedestal"/>
  <link name="l1"><visual><geometry><mesh filename="package://rich/meshes/l1.stl" scale="1 1 1"/></geometry></visual></link>
  <link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/><link name="l6"/><link name="tool0"/><link name="finger"/>
  <joint name="w" type="fixed"><parent link="world"/><child link="base_link"/><origin xyz="1 2 3" rpy="0 0 1"/></joint>
  <joint name="p" type="fixed"><parent link="base_link"/><child link="pedestal"/><origin xyz="0 0 .5" rpy="0.1 0 0"/></joint>
  <joint name="j1" type="continuous"><parent link="pedestal"/><child link="l1"/><axis xyz="0 0 2"/><calibration rising="0"/></joint>
  <joint name="j2" type="revolute"><origin xyz="0.1 0 0.4" rpy="-1.5707963267948966 0 0"/><parent link="l1"/><child link="l2"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/><safety_controller k_velocity="1"/></joint>
  <joint name="j3" type="revolute"><origin xyz="0.5 0 0"/><parent link="l2"/><child link="l3"/><axis xyz="0 0 -1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="j4" type="revolute"><origin xyz="0.1 -0.2 0.03" rpy="0.3 1.5707963267948966 0.2"/><parent link="l3"/><child link="l4"/><axis xyz="0.6 0 0.8"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="j5" type="revolute"><origin xyz="0 0.1 0.3" rpy="1.2 0 0"/><parent link="l4"/><child link="l5"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="j6" type="revolute"><origin xyz="0 0 0.1" rpy="-1.4 0.1 0"/><parent link="l5"/><child link="l6"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="t" type="fixed"><origin xyz="0.01 0.02 0.1" rpy="0.5 0.4 0.3"/><parent link="l6"/><child link="tool0"/></joint>
  <joint name="f" type="revolute"><parent link="tool0"/><child link="finger"/><axis xyz="1 0 0"/><mimic joint="j6"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <!-- keep me -->
  <transmission name="tr1"><type>simple</type><joint name="j1"/></transmission>
  <gazebo reference="l1"><material>Gazebo/Orange</material></gazebo>
  <unknown attribute="&lt;kept&gt;">text</unknown>
</robot>
<!-- after the robot -->
"""


def test_a_general_arm_with_offsets_fixed_joints_and_skew_axes():
    found = urdf.from_bytes(RICH, "rich")
    assert (found.arm.base_link, found.arm.tip_link, found.root_link) == ("base_link", "tool0", "world")
    for robot in (found.arm, perturbed(found, 5)):
        q = robot.random_joints(1000, 2)
        by_pinocchio = urdf_check.poses(urdf.to_bytes(found, robot), robot, q)
        assert_same_poses(by_pinocchio, robot.forward(q), 1e-12, 1e-12)


def test_writing_changes_joint_origins_only():
    found = urdf.from_bytes(RICH, "rich")
    written = urdf.to_bytes(found, perturbed(found, 5))

    def without_origins(data):
        root = etree.fromstring(data)
        for joint in root.findall("joint"):
            if joint.get("name") in found.arm.joint_names:
                for origin in joint.findall("origin"):
                    joint.remove(origin)
        return etree.tostring(root, method="c14n", with_comments=True).split()

    assert without_origins(written) == without_origins(RICH)
    for text in (b"<!-- before the robot -->", b"<!-- keep me -->", b"<!-- after the robot -->"):
        assert text in written


def test_measuring_frame_and_targets_as_links():
    import pinocchio as pin

    found = urdf.from_bytes(RICH, "rich")
    T_world_base = np.eye(4)
    T_world_base[:3, 3] = [3, 4, 5]
    links = urdf.to_bytes(found, found.arm), found.arm, T_world_base, {"smr1": [0.1, 0.2, 0.3]}
    text = urdf.with_links(*links)
    assert urdf.with_links(*links) == text
    model = pin.buildModelFromXML(text.decode())
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    frame, base, tip, target = (
        data.oMf[model.getFrameId(n)] for n in ("measuring_frame", "base_link", "tool0", "target_smr1")
    )
    assert np.abs((frame.inverse() * base).homogeneous - T_world_base).max() < 1e-12
    assert np.abs((tip.inverse() * target).translation - [0.1, 0.2, 0.3]).max() < 1e-12


# --- refusals ------------------------------------------------------------------------------------------


def replaced(old, new, count=1):
    assert old in RICH
    return RICH.replace(old, new, count)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "the file is empty"),
        (b"<robot>", "not well-formed XML"),
        (b"<sdf/>", "expected a <robot> element at the top, found <sdf>"),
        (b'<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>', "document types and entities are refused"),
        (b'<?xml version="1.0" encoding="utf-16"?><robot/>', "expected UTF-8 text"),
        ('<!DOCTYPE robot [<!ENTITY a "b">]><robot name="&a;"/>'.encode("utf-16"), "expected UTF-8 text"),
        (replaced(b'type="continuous"', b'type="planar"'), "found 6 moving joints: j1 (planar), j2 (revolute)"),
        (RICH.replace(b'type="revolute"', b'type="fixed"'), "expected 2 to 20 revolute or prismatic joints between 'base_link' and 'tool0', found 1 moving joints: j1 (continuous)"),
        (replaced(b'name="t" type="fixed"', b'name="t" type="floating"'), "found 7 moving joints"),
        (replaced(b'<axis xyz="0 0 2"/>', b'<axis xyz="0 0 0"/>'), "joint 'j1': the axis has no direction"),
        (replaced(b'<axis xyz="0 0 2"/>', b'<axis xyz="0 0"/>'), "joint 'j1', axis: expected 3 numbers, found '0 0'"),
        (replaced(b'xyz="0.5 0 0"', b'xyz="0.5 zero 0"'), "joint 'j3', origin xyz: expected 3 numbers, found '0.5 zero 0'"),
        (replaced(b'xyz="0.5 0 0"', b'xyz="0.5 nan 0"'), "joint 'j3', origin xyz: expected 3 numbers"),
        (replaced(b'<parent link="l2"/>', b'<parent link="l9"/>'), "joint 'j3' names a link 'l9' that does not exist"),
        (replaced(b'<parent link="l1"/>', b'<parent link="tool0"/>'), "cycle"),
        (replaced(b'<link name="l2"/>', b'<link name="l2"/><link name="l2"/>'), "link name 'l2' is used 2 times"),
        (replaced(b'<link name="finger"/>', b'<link name="finger"/><link name="loose"/>'), "expected exactly one root link, found world, loose"),
        (replaced(b'<child link="l3"/>', b""), "a joint needs a name, a type, a parent and a child link"),
        (replaced(b'<link name="l3"/>', b"<link/>"), "a link needs a name"),
        (replaced(b'<child link="finger"/>', b'<child link="l6"/>'), "link 'l6' has two parent joints"),
    ],
)  # fmt: skip
def test_refusals_say_what_was_found(data, expected):
    with pytest.raises(RobotError) as caught:
        urdf.from_bytes(data, "robot.urdf")
    assert expected in str(caught.value)
    assert str(caught.value).startswith("robot.urdf: ")
    assert "\n" not in str(caught.value)


def test_unknown_robot_lists_the_shipped_ones(tmp_path):
    with pytest.raises(RobotError, match="'irb9' does not exist; robots by name are irb1600, irb120"):
        urdf.read("irb9")


def test_unknown_link_is_named():
    with pytest.raises(RobotError, match="there is no link 'tcp1'"):
        urdf.from_bytes(RICH, "rich", tip="tcp1")


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_damaged_files_are_refused_or_read_never_worse(data):
    position = data.draw(st.integers(0, len(RICH) - 1))
    length = data.draw(st.integers(0, 40))
    filler = data.draw(st.binary(max_size=10))
    try:
        found = urdf.from_bytes(RICH[:position] + filler + RICH[position + length :], "damaged")
    except RobotError as error:
        assert "\n" not in str(error)
    else:
        assert found.arm.forward(np.zeros((1, 6))).shape == (1, 4, 4)


def test_levels_name_existing_parameters():
    for level, names in parameters.THESIS_LEVELS.items():
        assert len(parameters.level_parameters(level)) == len(names)
    counts = {level: parameters.thesis_count(parameters.level_parameters(level)) for level in parameters.THESIS_LEVELS}
    assert counts == {"nominal": 6, "11": 11, "16": 16, "26": 26, "34": 34, "34b": 34}
    assert arm().name == "irb1600_6_145"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('xyz="0 0 1"/>', 'xyz="0 0 0"/>', "the axis has no direction"),
        ('upper="', 'upper="-9', "expected limits from below"),
        ('velocity="', 'velocity="-', "joint 'joint_1', limit velocity: expected no negative number"),
        ('velocity="', 'velocity="" a="', "joint 'joint_1', limit velocity: expected 1 numbers, found ''"),
    ],
)
def test_numbers_that_no_robot_has_are_refused(old, new, words):
    text = robots.robot_file("irb1600").read_text()
    assert old in text
    with pytest.raises(RobotError, match=words):
        urdf.from_bytes(text.replace(old, new, 1).encode(), "robot.urdf")


def test_long_axes_and_limits_that_are_none():
    """An axis of any length is a direction; limits as some programs write them for none are none."""
    text = robots.robot_file("irb1600").read_text()
    good = urdf.from_bytes(text.encode(), "robot.urdf").arm
    long = urdf.from_bytes(text.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1e300"/>').encode(), "robot.urdf").arm
    q = good.random_joints(5, 1)
    assert np.abs(good.forward(q) - long.forward(q)).max() < 1e-12
    first = re.search(r'lower="([^"]*)" upper="([^"]*)"', text)
    free = urdf.from_bytes(text.replace(first[0], 'lower="-1e16" upper="1e16"', 1).encode(), "robot.urdf").arm
    assert np.isinf(free.lower[0])
    assert np.isinf(free.upper[0])


def test_provenances_at_the_end_of_the_world_are_refused():
    text = robots.robot_file("irb1600").read_text()
    far = re.sub(r'(<joint.*?<origin xyz=")\S+', r"\g<1>1e300", text, count=1, flags=re.DOTALL)
    with pytest.raises(RobotError, match="expected an origin within 10000 m"):
        urdf.from_bytes(far.encode(), "robot.urdf")


def test_speeds_are_those_that_pinocchio_reads():
    data = robots.robot_file("irb1600").read_bytes()
    names = [f"joint_{k}" for k in range(6, 0, -1)]
    model = pin.buildModelFromXML(data.decode())
    expected = [model.velocityLimit[model.joints[model.getJointId(name)].idx_v] for name in names]
    assert speed_limits(data, names) == pytest.approx(expected)
    assert np.isinf(
        speed_limits(b'<robot name="a"><joint name="j"><limit velocity="0"/></joint></robot>', ["j", "k"])
    ).all()
