"""The page in a real browser (headless chromium), opened from a file without any server."""

import numpy as np
import pandas as pd
import pytest
from support import arm, random_robot, write_measurements
from support import measured as simulated
from viewer_page import Opened, link, visible

import irbcal
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap

HOSTILE = "</script><script>window.hacked=1</script><img src=x onerror=window.hacked=2>"


@pytest.fixture(scope="module")
def measured(browser, cell, tmp_path_factory):
    table = pd.read_csv(cell / "poses.csv")
    table["group"] = table["group"].replace("b", HOSTILE)
    folder = tmp_path_factory.mktemp("page")
    table.to_csv(folder / "poses.csv", index=False)
    view = irbcal.view(cell / "cal", folder / "poses.csv")
    return Opened(browser, view.save(folder / "view.html"), width=400, height=300), view.scene


def test_page_of_measurements(measured, cell):
    page, scene = measured
    last = max(scene.meshes)  # a link far out on the arm
    # links: the browser's kinematics against the robots' own
    place = {robot: link(page, robot, last) for robot in ("robot", "ghost")}
    q = scene.q[:1]
    tree = scene.drawn.links
    after = np.eye(4)  # from that link to the tip: fixed joints only
    k = scene.drawn.tip
    while k != last:
        assert tree[k].kind == "fixed"
        after, k = tree[k].T_parent_joint @ after, tree[k].parent
    expected = scene.robot.poses(q)[0]
    assert np.abs(place["robot"] @ after - expected).max() < 1e-6
    page.page.select_option("#ghost", "place")
    nominal = irbcal.load(cell / "cal").robot_nominal()
    expected = frames.inverse(scene.robot.T_world_base) @ nominal.T_world_base @ nominal.poses(q)[0]
    assert np.abs(link(page, "ghost", last) @ after - expected).max() < 1e-6
    # the ghost's magnified shift: its origin goes that many times further from the calibrated one
    page.page.select_option("#ghost", "magnified")
    origin = {"robot": place["robot"][:3, 3], "ghost": (expected @ np.linalg.inv(after))[:3, 3]}
    shifted = origin["robot"] + scene.own_scales["nominal"][0] * (origin["ghost"] - origin["robot"])
    assert np.abs(link(page, "ghost", last)[:3, 3] - shifted).max() < 1e-4

    # at first the worst tenth and the current pose; vectors: from the modelled point, magnified error long
    assert page("irbcalView.body.vectors.count") == 3 * 5
    page.press("a")
    assert page("irbcalView.body.vectors.count") == len(scene.points.pose) == 120
    for model, press in (("calibrated", ""), ("nominal", "b")):
        if press:
            page.press(press)
        slots = page("Array.from(irbcalView.slots())")
        of_arrow = page(
            "['position', 'way'].map((name) => Array.from(irbcalView.body.vectors.geometry.attributes[name].array))"
        )
        start, way = np.array(of_arrow).reshape(2, 120, 7, 3)[:, slots]
        assert (np.ptp(start, axis=1) == 0).all()  # the same for all corners
        assert np.abs(start[:, 0] - getattr(scene.points, model)).max() < 1e-6
        ends = (start + way)[:, 0]
        modelled = getattr(scene.points, model)
        assert np.abs(ends - (modelled + scene.own_scales[model][0] * scene.points.error(model))).max() < 1e-5
    page.press("b")

    # legend, statistics and the pose's own text
    ticks = [float(text) for text in page.text("#ticks").split()]
    assert ticks == sorted(ticks)
    assert ticks[-1] == pytest.approx(scene.own_scales["calibrated"][1] * 1e3)
    assert page.page.input_value("#magnification") == f"{scene.own_scales['calibrated'][0]:g}"
    page.press("o")  # one scale for both
    assert float(page.text("#ticks").split()[-1]) == pytest.approx(scene.scale_top * 1e3)
    assert page.page.input_value("#magnification") == f"{scene.magnification:g}"
    page.press("o")
    size = {name: np.linalg.norm(scene.points.error(name), axis=1) * 1e3 for name in ("nominal", "calibrated")}
    assert "120 points, held out" in page.text("#statistics")
    assert [f"{size[model].mean():.3f}" for model in size] == page.text("#statistics tr:nth-child(3)").split()[1:]
    assert page.text("#pose .name") == "Pose 0"
    assert "1 of 40 · held out · group a" in page.text("#pose .where")
    assert f"{size['nominal'][0]:.3f}" in page.text("#pose table")
    assert f"{size['calibrated'][0]:.3f}" in page.text("#pose table")
    assert f"± {1e3 * scene.points.u95[0]:.3f}" in page.text("#pose table")
    assert not page.page.is_visible("#simulated")  # nobody said that these were simulated

    # keys
    for key, expected in (("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("End", 39), ("Home", 0)):
        page.press(key)
        assert page("irbcalView.state.pose") == expected
        assert page.page.input_value("#slider") == str(expected)
    page.press("w")
    assert page("irbcalView.state.pose") == scene.points.pose[np.argmax(size["calibrated"])]
    q = scene.q[[page("irbcalView.state.pose")]]
    assert np.abs(link(page, "robot", last) @ after - scene.robot.poses(q)[0]).max() < 1e-6
    page.press("Home", " ")
    page.wait_for("irbcalView.state.pose >= 2", 10)
    page.press(" ")
    assert not page("irbcalView.state.playing")

    # groups and layers
    page.press("Home")
    page.page.uncheck(f"#group-{sorted(['a', HOSTILE]).index('a')}")
    assert page("irbcalView.body.measured.count") == 75
    assert page("irbcalView.state.pose") == 15  # stepping goes through the groups that are on
    assert page("irbcalView.state.active.length") == 25
    page.page.check("#which-pose")
    assert page("irbcalView.body.vectors.count") == 3
    for name in ("measured", "modelled", "vectors", "ghost", "tracker", "cube", "sight", "robot"):
        page.page.check(f"#layer-{name}")
        assert visible(page, "irbcal", name)
        page.page.uncheck(f"#layer-{name}")
        assert not visible(page, "irbcal", name)
    page.press("t", "r")
    assert page("typeof window.hacked") == "undefined"
    assert HOSTILE in page.text("#pose .where")
    assert page("document.images.length") == 0
    page.check_silence()


@pytest.fixture(params=["level", "auto"])
def slid(request, cell, tmp_path):
    """A calibration with a joint map: of a level, and of terms."""
    if request.param == "level":
        return cell / "cal"
    robot = arm("irb120")
    truth = random_robot(robot, "34", np.random.default_rng(5))
    points = simulated(truth, robot.random_joints(60, 1), 2e-5, np.random.default_rng(6))
    made = irbcal.calibrate(write_measurements(tmp_path / "m.csv", points), "irb120", "auto", holdout=5)
    made.save(tmp_path / "cal")
    return tmp_path / "cal"


def test_joint_sliders(browser, slid, tmp_path):
    """Commanded joints are typed, and the calibrated robot is shown: its joint map is part of it."""
    view = irbcal.view(slid)
    page = Opened(browser, view.save(tmp_path / "view.html"), width=500, height=500)
    q = np.array([[0.5, -0.4, 0.3, 1.0, -0.8, 2.0]])
    for k, value in enumerate(q[0]):
        page(
            f"(() => {{const s = document.getElementById('joint-{k}'); s.value = {value};"
            "s.dispatchEvent(new Event('input'))})()"
        )
    robot = view.scene.robot
    tip = robot.poses(q)[0, :3, 3] * 1e3
    shown = [float(text) for text in page.text("#pose .tip").replace("\u2212", "-").split() if text[-1].isdigit()]
    assert np.abs(np.array(shown) - tip).max() < 0.006
    sight = np.array(page("Array.from(irbcalView.body.sight.instanceMatrix.array)")).reshape(-1, 4, 4)
    plain = robot.replace(joint_map=JointMap.identity(robot.arm))
    targets, unmapped = (
        [frames.apply(view.scene.T_scene_world, one.points(q, name))[0] for name in view.scene.targets]
        for one in (robot, plain)
    )
    assert np.abs(np.array(targets) - unmapped).max() > 1e-4
    assert np.abs(sight[:, 3, :3] - view.scene.T_scene_world[:3, 3]).max() < 1e-6
    assert np.abs((np.array([0, 1, 0, 1]) @ sight)[:, :3] - targets).max() < 1e-6
    page.check_silence()


def test_seven_joints_on_a_rail(browser, tmp_path):
    joints = [
        ("prismatic", "0 1 0"),
        *(("revolute", axis) for axis in ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")),
    ]
    text = "".join(
        f'<link name="l{k}"/><joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/><child link="l{k}"/>'
        f'<origin xyz="0.1 0 0.2" rpy="0.1 {0.2 * k:.1f} 0"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k, (kind, axis) in enumerate(joints, start=1)
    )
    (tmp_path / "rail.urdf").write_text(f'<robot name="rail"><link name="l0"/>{text}</robot>')
    q = np.random.default_rng(4).uniform(-2, 2, (3, 7))
    view = irbcal.view(tmp_path / "rail.urdf", plan=q)
    page = Opened(browser, view.save(tmp_path / "view.html"), width=500, height=400)
    page.press("End")
    assert np.abs(link(page, "robot", 6)[:3, 3] - link(page, "robot", 0)[:3, 3]).max() > 0.1
    tip = view.scene.robot.poses(q)[2, :3, 3]
    shown = page("irbcalView.state.tip.elements.slice(12, 15)")
    assert np.abs(np.array(shown) - tip).max() < 1e-6
    assert f"q1, mm\t{q[2, 0] * 1e3:.2f}".replace("-", "\u2212") in page.text("#pose .move")
    assert "planned" in page.text("#pose .where")
    page.check_silence()


def test_thousand_poses_with_three_targets(browser, cell, tmp_path):
    view = irbcal.view(cell / "cal", cell / "many.csv")
    path = view.save(tmp_path / "view.html")
    page = Opened(browser, path, width=640, height=400)
    assert page("irbcalView.body.measured.count") == 3 * 101
    page.press("a")
    assert page("irbcalView.body.measured.count") == 3000
    size = view.scene.points.distance("calibrated")[np.argsort(page("Array.from(irbcalView.slots())"))]
    assert (np.diff(size) <= 1e-9).all()  # the largest errors first
    meshes = page("(() => {let n = 0; irbcalView.viewer.scene.traverse((o) => {if (o.isMesh) n++}); return n})()")
    assert meshes < 60  # whole layers, not points
    # while it moves without a graphics card: coarser bodies, and of many points those with the largest errors
    shown = "irbcalView.viewer.scene_tree.find(['irbcal', 'robot', '1', ...path, '<object>']).object"
    seen = f"[[], ['coarse']].map((path) => [{shown}.visible, {shown}.geometry.index.count])"
    drawn = "['vectors', 'measured'].map((name) => irbcalView.body[name].geometry.drawRange.count)"
    (whole, triangles), (coarse, fewer) = page(seen)
    assert (whole, coarse) == (True, False)
    assert 0 < fewer < 0.3 * triangles
    assert page(drawn) == [9 * 3000, 3000]
    page("irbcalView.hurry(true)")
    assert [visible for visible, _ in page(seen)] == [False, True]
    assert page(drawn) == [3 * 3000, 3000]
    page("irbcalView.hurry(false)")
    assert page(drawn) == [9 * 3000, 3000]
    assert [visible for visible, _ in page(seen)] == [True, False]
    for _ in range(20):
        page("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight'}))")
    assert page("irbcalView.state.pose") == 20
    page.check_silence()
