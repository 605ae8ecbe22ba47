"""Arms of the catalogue: against URDFs that others made, against the reach in their names, and found by name."""

import csv
from pathlib import Path

import numpy as np
import pytest
from support import assert_same_poses

import irbcal
from irbcal.errors import OptionError, RobotError
from irbcal.io import catalogue, robots, urdf
from irbcal.modeling import frames

OTHERS = {
    "gp8": "yaskawa/gp8",
    "irb2400": "abb/irb2400",
    "kr120r2500pro": "kuka/kr120-r2500-pro",
    "lrmate200id": "fanuc/lrmate200id",
    "m20ia": "fanuc/m-20ia",
    "r2000ic165f": "fanuc/r-2000ic-165f",
    "rs007n": "kawasaki/rs007n",
    "rx160": "staubli/rx160",
}
"""URDFs of the shared data, made from other packages by xacro, and the same arms here."""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "irbcal" / "robots"


@pytest.mark.parametrize(("file", "name"), OTHERS.items())
def test_arms_are_those_that_others_describe(shared_data, file, name):
    others, ours = urdf.read(shared_data / "other_arms" / f"{file}.urdf").arm, urdf.read(name).arm
    q = others.random_joints(50, 1)
    assert_same_poses(others.forward(q), ours.forward(q), 1e-9, 1e-6)
    assert np.abs(np.degrees(others.lower - ours.lower)).max() < 0.06
    assert np.abs(np.degrees(others.upper - ours.upper)).max() < 0.06


def test_universal_robots_are_counted_from_the_controller_s_base():
    """The UR10 of example-robot-data, whose base link is turned by half a turn from the controller's base."""
    lengths = {"d1": 0.1273, "a2": -0.612, "a3": -0.5723, "d4": 0.163941, "d5": 0.1157, "d6": 0.0922}
    row = catalogue.CatalogueArm(
        "ur/ur10", "UR10", lengths, ((-360.0, 360.0),) * 6, (), "ros-industrial/universal_robot", ""
    )
    others, ours = urdf.read("ur10", tip_link="tool0").arm, urdf.from_bytes(row.urdf(), "ur10").arm
    q = others.random_joints(50, 1)
    T_base_link = frames.transform(frames.rot_z(np.pi))
    assert_same_poses(T_base_link @ others.forward(q), ours.forward(q), 1e-9, 1e-6)


@pytest.mark.parametrize(
    ("name", "lengths"),
    [
        ("irb120", {"c1": 0.29, "c2": 0.27, "a2": -0.07, "c3": 0.302, "c4": 0.072}),
        ("irb1600", {"c1": 0.4865, "a1": 0.15, "c2": 0.7, "c3": 0.6, "c4": 0.065}),
    ],
)
def test_abb_arms_are_as_those_that_ship(name, lengths):
    row = catalogue.CatalogueArm(f"abb/{name}", name, lengths, ((-180.0, 180.0),) * 6, (), "RobotComponents", "")
    shipped, ours = urdf.read(name).arm, urdf.from_bytes(row.urdf(), name).arm
    q = shipped.random_joints(50, 1)
    assert_same_poses(shipped.forward(q), ours.forward(q), 1e-9, 1e-9)


def test_rows_say_where_their_numbers_come_from_and_what_is_in_doubt():
    listed = irbcal.robots().to_frame()
    rows = listed[listed["source"] == "catalogue"]
    assert len(rows) >= 150
    assert rows["numbers"].str.fullmatch(r"\S+ \(.*(BSD|Apache|GPL).*\)").all()
    for arm in catalogue.arms().values():
        assert len(arm.limits) == 6
        assert len(arm.speeds) in (0, 6)
        assert all(lower < upper for lower, upper in arm.limits)
        assert ("speeds: the source has none" in arm.unconfirmed) == (not arm.speeds)
    assert "the wrist reaches 2.941 m, the name says 3 m" in irbcal.robots()["abb/irb6700-245-300"].unconfirmed
    with open(catalogue.TABLE, encoding="utf-8", newline="") as stream:
        names = [row["name"] for row in csv.DictReader(stream)]
    assert len(names) == len(set(names))


def test_the_reach_of_names_is_that_of_the_lengths():
    """An oracle that no URDF shares: most makers write the wrist's reach into the name."""
    named = [arm for arm in catalogue.arms().values() if catalogue._NAMED_REACH.search(arm.model)]
    assert len(named) > 90
    assert sum("the wrist reaches" in arm.unconfirmed for arm in named) < 0.1 * len(named)


def test_a_fanuc_counts_as_its_pendant_and_the_file_stays(cache):
    arm = urdf.read("fanuc/m-20ia").arm
    assert np.array_equal(arm.to_controller(np.ones((1, 6)))[0], [1, 1, 0, 1, 1, 1])
    assert urdf.read("kuka/kr16-2").arm.coupling is None
    file = robots.robot_file("kuka/kr16-2")
    assert file == cache / "kuka" / "kr16-2.urdf"
    written = file.stat().st_mtime_ns
    assert robots.robot_file("KUKA/KR16-2").stat().st_mtime_ns == written
    Path(file).write_text("something else")
    assert urdf.read("kuka/kr16-2").arm.joint_names[0] == "joint_a1"


def test_names_are_found_with_typing_errors():
    assert irbcal.robots(search="KR 16 R2010").headline() == "kuka/kr16-r2010-2"
    assert "kuka/kr16-2" in irbcal.robots(search="kr61-2").headline()
    assert {robot.name.partition("/")[0] for robot in irbcal.robots(maker="Fanuk")} == {"fanuc"}
    assert "staubli/rx160" in irbcal.robots(maker="Stäubli")
    with pytest.raises(OptionError, match="maker: expected one of abb, fanuc"):
        irbcal.robots(maker="nobody")
    with pytest.raises(OptionError, match="search: no robot is called like"):
        irbcal.robots(search="?")
    with pytest.raises(RobotError, match="robots by name like it are kuka/kr16-2"):
        urdf.read("kuka/kr16-3")
