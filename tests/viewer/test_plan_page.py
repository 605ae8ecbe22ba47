"""The page of a plan: its poses, reflectors and tracker are in it; it opens with the next move."""

from dataclasses import replace

import numpy as np
from viewer_page import Opened, link, visible

from irbcal.modeling.commanded_joints import home_joints
from irbcal.planning import route
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import plan
from irbcal.viewer import building


def test_the_page_opens_with_the_next_move(browser, tmp_path):
    made = plan("irb1600", axis=18, cube=0, all_range=2, ignore=SOLID, level="nominal")
    made = replace(made, over_home=np.arange(len(made.q)) == 2)
    text = building.plan_page(made)
    for name in ("irb1600_6_145", "axis6", "all_range", "smr1"):
        assert name in text
    (tmp_path / "plan.html").write_text(text, encoding="utf-8")
    page = Opened(browser, tmp_path / "plan.html")
    arm, place = made.scene.setting.arm, made.scene.setting.targets.positions[0]

    def reflector(q):
        T = arm.forward(q)
        return T[..., :3, :3] @ place + T[..., :3, 3]

    def way():
        pieces = np.array(page("Array.from(irbcalView.body.way.instanceMatrix.array)")).reshape(-1, 4, 4)
        return (np.array([0, 1, 0, 1]) @ pieces)[:, :3]

    q, home = made.q, home_joints(arm)
    last = 5
    for pose, through in ((0, [q[0], q[1]]), (1, [q[1], home, q[2]])):
        at = np.linspace(0, len(through) - 1, 41)[1:]
        joints = np.array([np.interp(at, np.arange(len(through)), values) for values in np.array(through).T]).T
        assert np.abs(way() - reflector(joints)).max() < 1e-5
        assert ("over home" in page.text("#pose")) is (pose == 1)
        move = np.degrees(q[pose + 1] - q[pose])
        shown = [line.split("\t") for line in page.text("#pose .move").replace("\u2212", "-").splitlines()]
        assert shown[0] == ["joint", "now", f"next: {pose + 2}", "move"]
        assert np.abs(np.array([line[3] for line in shown[1:]], dtype=float) - move).max() < 0.006
        ghost = link(page, "next", last)
        page.page.get_by_role("button", name="next", exact=False).first.click()
        assert np.abs(link(page, "robot", last) - ghost).max() < 1e-9
    assert not visible(page, "irbcal", "path")
    page.page.get_by_role("button", name="show all").click()
    assert visible(page, "irbcal", "path")
    page.press("End")
    assert "next" not in page.text("#pose .move")
    assert page("irbcalView.body.way.count") == 0
    page.check_silence()


def test_the_whole_way_is_that_of_the_program():
    made = plan("irb1600", axis=18, cube=0, all_range=2, ignore=SOLID, level="nominal")
    made = replace(made, over_home=np.arange(len(made.q)) == 2)
    arm, place = made.scene.setting.arm, made.scene.setting.targets.positions[0]
    home = home_joints(arm)
    stops = np.array([home, *made.q[:2], home, *made.q[2:], home])
    q, _ = route.between(stops[:-1], stops[1:], arm.table.prismatic)
    T = arm.forward(q)
    expected = T[:, :3, :3] @ place + T[:, :3, 3]
    np.testing.assert_allclose(building._way(made), expected, rtol=0, atol=1e-9)
