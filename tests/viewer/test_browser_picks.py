"""What hands do with the page: click, touch, type, switch, filter; in a real browser."""

import io

import numpy as np
import pytest
from viewer_page import Opened

import irbcal
from irbcal.viewer import scene as points

SPOTS = """(() => {const {points, slots, on_screen, point, state} = irbcalView; const out = [];
slots().forEach((slot, row) => {if (slot >= 0) out.push([row, points.pose[row],
...on_screen(point(points.at[state.model], row))])}); return out})()"""


@pytest.fixture(scope="module")
def view(cell):
    return irbcal.view(cell / "cal", cell / "fit.csv")  # 50 fitted and 10 held-out poses


@pytest.fixture(scope="module")
def saved(view, tmp_path_factory):
    return view.save(tmp_path_factory.mktemp("picks") / "view.html")


def lonely(page, pose, away=45):
    """A point of another pose on the screen that no other pose's point is near to: its pose and its place."""
    spots = np.array(page(SPOTS))
    for _, own, x, y, _ in spots:
        others = spots[spots[:, 1] != own]
        inside = 30 < x < page("innerWidth") - 330 and 30 < y < 500
        if own != pose and inside and np.hypot(others[:, 2] - x, others[:, 3] - y).min() > away:
            return int(own), x, y
    raise AssertionError("no point stands alone")


def without_bodies(page):
    for name in ("robot", "vectors"):
        page.page.uncheck(f"#layer-{name}")


def test_click_field_list_and_filters(browser, view, saved):
    page = Opened(browser, saved, width=1100, height=700, reduced_motion="reduce", color_scheme="light")
    fitted = np.asarray(view.scene.fitted)
    assert (fitted.sum(), (~fitted).sum()) == (50, 10)
    size = 1e3 * view.scene.points.distance("calibrated")
    of_pose = np.array([size[view.scene.points.pose == k].max() for k in range(60)])
    worst = np.argsort(-of_pose)
    # the first sight: the worst tenth and the current pose
    assert {int(spot[1]) for spot in page(SPOTS)} == {0, *worst[:6]}

    # a click beside a point goes nowhere, one on it to its pose; a drag is no click
    without_bodies(page)
    pose, x, y = lonely(page, 0)
    page.page.mouse.click(x, y - 20)
    assert page("irbcalView.state.pose") == 0
    page.page.mouse.move(x, y)
    page.wait_for(f"document.getElementById('hint').textContent.startsWith('pose {view.scene.pose_ids[pose]} ')", 5)
    page.page.mouse.click(x, y)
    assert page("irbcalView.state.pose") == pose

    # the list: sorted by error, counted, and a way to each pose; the camera goes there
    ids = page("Array.from(document.querySelectorAll('#list .id'), (one) => one.textContent)")
    assert ids == [str(view.scene.pose_ids[k]) for k in worst]
    page.page.click("#list button:nth-child(3)")
    assert page("irbcalView.state.pose") == worst[2]
    page.press("w")
    assert page("irbcalView.state.pose") == worst[0]
    page.wait_for("!irbcalView.state.gliding", 5)
    rows = view.scene.points.calibrated[view.scene.points.pose == worst[0]]
    x, y, z = page("irbcalView.viewer.controls.target.toArray()")
    assert np.abs(np.array([x, -z, y]) - rows.mean(axis=0)).max() < 1e-5

    # the field of poses
    page.press("g")
    page.page.keyboard.type("17")  # no key of these steps, plays or switches
    page.press("Enter")
    assert page("irbcalView.state.pose") == list(view.scene.pose_ids).index("17")
    page.press("g")
    page.page.keyboard.type("999")
    page.press("Enter")
    assert page.text("#problem") == "no pose 999"
    page.press("Escape")
    assert page.text("#problem") == ""

    # held-out and fitted poses: counted apart, chosen apart
    assert "30 points, held out" in page.text("#statistics")
    assert "150 points, fitted: no proof" in page.text("#statistics")
    rows = fitted[view.scene.points.pose]
    found = page.text("#statistics").replace("\t", " ")
    for kind in (rows, ~rows):
        assert f"{size[kind].mean():.3f}" in found
        assert f"{size[kind].max():.3f}" in found
    page.page.uncheck("#kind-fitted")
    page.press("a")
    assert {int(spot[1]) for spot in page(SPOTS)} == set(np.flatnonzero(~fitted))
    assert page("irbcalView.state.active.length") == 10
    assert "fitted" not in page.text("#statistics")
    page.page.check("#kind-fitted")

    # without stiffness: the whole robot without these terms
    page.page.get_by_label("arm stiffness and joint-6 series").uncheck()
    assert "without arm stiffness and joint-6 series" in page.text("#pose table")
    scene = view.scene
    bare = points.without(scene.robot, "thesis")
    names = np.array(list(scene.targets))[scene.points.target]
    expected = bare.points(scene.q[scene.points.pose], list(names))
    expected = expected @ scene.T_scene_world[:3, :3].T + scene.T_scene_world[:3, 3]
    shown = np.array(page("Array.from(irbcalView.points.at.calibrated)")).reshape(-1, 3)
    assert np.abs(shown - expected).max() < 1e-6
    longest = 1e3 * np.linalg.norm(scene.points.measured - expected, axis=1).max()
    assert page("Math.max(...irbcalView.largest.calibrated)") == pytest.approx(longest, abs=1e-4)
    page.page.get_by_label("arm stiffness and joint-6 series").check()
    assert page("Math.max(...irbcalView.largest.calibrated)") == pytest.approx(of_pose.max(), abs=1e-5)
    page.check_silence()


def test_touch_dark_colours_and_hidden_labels(painting_browser, view, saved):
    from PIL import Image

    page = Opened(
        painting_browser, saved, width=1100, height=700, has_touch=True, reduced_motion="reduce", color_scheme="dark"
    )

    def pixels():
        return np.asarray(Image.open(io.BytesIO(page.page.screenshot())).convert("RGB")).astype(int)

    without_bodies(page)
    pose, x, y = lonely(page, 0)
    page.page.touchscreen.tap(x + 10, y + 10)  # a finger is wide
    page.wait_for(f"irbcalView.state.pose === {pose}", 5)

    # dark as the system says, light by the key; an arrow has the legend's colour
    assert pixels()[5, 5].max() < 70
    page.press("d")
    page.page.check("#layer-vectors")
    page.press("w")
    page.wait_for("!irbcalView.state.gliding", 5)
    page.page.uncheck("#layer-shown")
    page.page.locator("#bar").scroll_into_view_if_needed()
    image = pixels()
    assert image[5, 5].min() > 200
    legend = page.page.locator("#bar").bounding_box()
    worst = int(np.argmax(view.scene.points.distance("calibrated")))
    part = 1e3 * view.scene.points.distance("calibrated")[worst] / page("irbcalView.top_mm()")
    expected = image[int(legend["y"] + 7), int(legend["x"] + part * (legend["width"] - 1))]
    middle = page(
        f"(() => {{const {{points, point, on_screen, magnification}} = irbcalView; return on_screen(point(points.at."
        f"calibrated, {worst}).addScaledVector(point(points.error.calibrated, {worst}), 0.5 * magnification()))}})()"
    )
    drawn = image[int(middle[1]) - 1 : int(middle[1]) + 2, int(middle[0]) - 1 : int(middle[0]) + 2].reshape(-1, 3)
    assert np.abs(drawn - expected).max(axis=1).min() <= 6

    # the tracker's label goes when the robot's foot is before it, and comes back without the robot
    page.page.check("#layer-robot")
    look = (
        "(sign) => {const {viewer, labels} = irbcalView; const p = labels[0].place; const d = [-p.x, -p.y, 0.25 - p.z];"
        "const n = Math.hypot(...d); const e = d.map((v, k) => [p.x, p.y, p.z][k] + sign * v * (n + 2) / n);"
        "viewer.camera.position.set(e[0], e[2], -e[1]); viewer.controls.target.set(p.x, p.z, -p.y);"
        "viewer.controls.update(); viewer.render()}"
    )
    page(f"({look})(1)")
    page.wait_for("irbcalView.labels[0].hidden && irbcalView.labels[0].node.hidden", 5)
    page.page.uncheck("#layer-robot")
    page.wait_for("!irbcalView.labels[0].node.hidden", 5)
    page.page.check("#layer-robot")
    page.wait_for("irbcalView.labels[0].node.hidden", 5)
    page(f"({look})(-1)")
    page.wait_for("!irbcalView.labels[0].node.hidden", 5)
    page.check_silence()


def test_orientation_errors_are_frames(browser, cell, tmp_path):
    irbcal.save(irbcal.calibrate(cell / "fit.csv", "irb1600", "26", holdout=10, as_poses=True), tmp_path / "cal")
    view = irbcal.view(tmp_path / "cal", cell / "poses.csv")
    page = Opened(browser, view.save(tmp_path / "view.html"), width=640, height=400)
    page.press("a")
    assert page("irbcalView.body.axes.count") == 3 * 40
    saved = irbcal.load(tmp_path / "cal")
    robot = saved.robot_calibrated()
    expected = robot.poses(view.scene.q)[:, :3, :3] @ next(iter(robot.target_rotations.values()))
    factor = page("irbcalView.state.turning.calibrated")
    assert factor > 10
    drawn = {}
    for name in ("modelled_axes", "axes"):
        way = np.array(page(f"Array.from(irbcalView.body.{name}.geometry.attributes.way.array)")).reshape(40, 3, 4, 3)[
            :, :, 0
        ]
        drawn[name] = np.swapaxes(way / np.linalg.norm(way, axis=2, keepdims=True), 1, 2)
    np.testing.assert_allclose(drawn["modelled_axes"], expected, rtol=0, atol=1e-5)
    # the measured frame is turned away that many times as far as it was measured
    turn = np.einsum("nij,nij->n", drawn["axes"], drawn["modelled_axes"])
    angle = np.arccos(np.clip((turn - 1) / 2, -1, 1))
    np.testing.assert_allclose(angle, factor * view.scene.points.turn_calibrated, rtol=0, atol=2e-3)
    page.check_silence()
