"""Base, tool and links from circles: the tool against its drawing, parts that were moved, wrong requests."""

from dataclasses import replace

import numpy as np
import pytest
from one_joint import one_joint_moves, true_robot
from support import arm, measured, write_measurements

from irbcal.errors import IrbcalError, OptionError
from irbcal.joint_analysis.by_circles import circles
from irbcal.simulation.instruments import TABLE_3_1

REAL = {name: np.array(real) * 1e-3 for name, (_, real) in TABLE_3_1.items()}
DRAWN = {name: np.array(cad) * 1e-3 for name, (cad, _) in TABLE_3_1.items()}


def file_of(path, groups=None, tilt=0.0, simulated=False):
    """One-joint moves of a robot with the thesis's tool; some groups only."""
    robot = true_robot(arm("irb1600"), 4, tilt)
    columns = {name: getattr(robot.table, name).copy() for name in ("theta", "d")}
    for name in columns:  # what cannot be told from the tool is nominal
        columns[name][5] = getattr(arm("irb1600").table, name)[5]
    robot = robot.replace(arm=arm("irb1600").with_table(replace(robot.table, **columns)), targets=REAL)
    q, names = one_joint_moves(0.0, degrees=(-90, -60, -30, 0, 30, 60, 90))
    keep = np.isin(names, groups or names)
    points = measured(robot, q[keep], groups=np.array(names)[keep])
    write_measurements(path, points)
    lines = path.read_text().splitlines()
    said = [
        f"{line},{name}{',yes' if simulated else ''}"
        for line, name in zip(lines[1:], np.repeat(points.groups, 9), strict=True)
    ]
    path.write_text("\n".join([f"{lines[0]},group{',simulated' if simulated else ''}", *said]))
    return path, robot


def test_table_3_1_comes_out_again(tmp_path):
    file, _ = file_of(tmp_path / "m.csv", ["axis5", "axis6"])
    found = circles(file, "irb1600", drawn=DRAWN)
    assert (found.base, found.links) == (None, None)
    table = found.compared().set_index("target")
    for name, (cad, real) in TABLE_3_1.items():
        row = table.loc[name]
        assert row[[f"measured_{a}_mm" for a in "xyz"]].tolist() == pytest.approx(real, abs=1e-5)
        assert row["error_mm"] == pytest.approx(np.linalg.norm(np.array(real) - cad), abs=1e-5)
        assert row["error_moved_mm"] < 0.2 < row["error_mm"]
    # the thesis's own printed errors
    printed = [0.553, 0.465, 0.515, 0.568, 0.690, 0.609, 0.612, 0.661, 0.497]
    assert table["error_mm"].tolist() == pytest.approx(printed, abs=2e-3)
    assert "The tool as drawn and as measured, mm" in found.summary()


def test_all_parts_of_a_simulated_file(tmp_path):
    file, robot = file_of(tmp_path / "m.csv", simulated=True)
    found = circles(file, "irb1600")
    assert np.abs(found.base.T_world_base - robot.T_world_base).max() < 1e-8
    data = found.to_dict()
    assert data["simulated"]
    assert data["links"]["parallel"] == "hayati"
    assert list(data["tool"]["targets"]) == list(TABLE_3_1)
    assert data["compared"] is None
    assert found.summary().startswith(
        "SIMULATED data: irb1600_6_145 by the circles of one-joint moves: base, tool, links"
    )
    assert set(found.to_frame()["part"]) == {"base", "tool", "links"}
    only = circles(file, "irb1600", part="base")
    assert (only.tool, only.links) == (None, None)
    assert np.array_equal(only.base.T_world_base, found.base.T_world_base)


def test_parallel_axes_are_forced(tmp_path):
    file, robot = file_of(tmp_path / "m.csv", tilt=0.002)
    kept, forced = (circles(file, "irb1600", part="links", parallel=way).links for way in ("hayati", "forced"))
    assert forced.robot.table.alpha[2] == forced.robot.table.beta[2] == 0.0
    assert abs(kept.robot.table.beta[2] - robot.table.beta[2]) < 1e-8
    assert forced.rms > 1e-5 > kept.rms
    narrow = circles(file, "irb1600", part="links", parallel="forced", tolerance=1e-4).links
    assert narrow.robot.table.beta[2] == kept.robot.table.beta[2]


@pytest.mark.parametrize(
    ("groups", "options", "words"),
    [
        (["axis3"], {}, "no groups axis1 and axis2 for the base, nor of the last two joints for the tool"),
        (["axis5", "axis6"], {"part": "base"}, "m.csv: there are no moves of joint 1 in a group axis1"),
        (["axis1", "axis2"], {"drawn": DRAWN}, "drawn: there are no moves of the last two joints"),
        (["axis1", "axis2"], {"parallel": "forced"}, "parallel: it is for the links, which need moves of all six"),
        (["axis5", "axis6"], {"drawn": {"cup": [0, 0, 0.1]}}, "no drawn reflector was measured; reflectors are"),
        (["axis1", "axis2"], {"part": "hand"}, "part: expected base, tool or links, found 'hand'"),
        (["axis1", "axis2"], {"part": "base", "drawn": DRAWN}, "drawn: places as drawn are compared with the tool"),
        (["axis1", "axis2"], {"part": "base", "parallel": "forced"}, "parallel: it is for the links, the base needs"),
        (["axis1", "axis2"], {"tolerance": -1.0}, "tolerance: expected a number from 0 to"),
    ],
)
def test_wrong_requests(groups, options, words, tmp_path):
    file, _ = file_of(tmp_path / "m.csv", groups)
    with pytest.raises(IrbcalError, match=words) as refused:
        circles(file, "irb1600", **options)
    assert "\n" not in str(refused.value)
    assert isinstance(refused.value, OptionError) or "m.csv" in str(refused.value)
