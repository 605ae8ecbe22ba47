"""Joint origins as YAML, and whether a URDF found somewhere is the calibration."""

import numpy as np
import yaml
from support import arm, assert_same_poses, example_robot, measured, random_robot, write_measurements

import irbcal
from irbcal.io import joint_origins, urdf, urdf_check
from irbcal.io.opening import open_robot
from irbcal.modeling import frames


def test_yaml_rebuilds_the_robot(folders):
    """Origins from the file, put into the nominal URDF by hand, give the calibrated robot in Pinocchio."""
    entries = yaml.safe_load((folders[0] / "joint_origins.yaml").read_text())["kinematics"]
    assert entries.pop("hash") == f"irbcal_{irbcal.load(folders[0]).record.fingerprint}"
    assert list(entries) == [f"link_{i}" for i in range(1, 7)]
    nominal = open_robot(folders[0], nominal=True).urdf_bytes
    placed = {}
    for entry in entries.values():
        R = frames.matrix_from_rpy([entry["roll"], entry["pitch"], entry["yaw"]])
        placed[entry["joint"]] = frames.transform(R, [entry[axis] for axis in "xyz"])
    rebuilt = urdf.with_joint_origins(nominal, placed)
    calibrated = irbcal.load(folders[0]).arm()
    q = calibrated.random_joints(100, 1)
    assert_same_poses(urdf_check.poses(rebuilt, calibrated, q), calibrated.forward(q), 1e-12, 1e-12)
    # before that it is the nominal robot, whatever else stands in the file
    assert_same_poses(urdf_check.poses(nominal, arm(), q), arm().forward(q), 1e-12, 1e-12)
    assert np.abs(arm().forward(q) - calibrated.forward(q)).max() > 1e-4


def test_yaml_uses_the_keys_of_ur_description(tmp_path):
    found = urdf.read(example_robot("ur_description/urdf/ur10_robot.urdf"))
    truth = random_robot(found.arm, "26", np.random.default_rng(1))
    data = write_measurements(tmp_path / "m.csv", measured(truth, found.arm.random_joints(60, 1)))
    irbcal.save(irbcal.calibrate(data, example_robot("ur_description/urdf/ur10_robot.urdf"), "26"), tmp_path / "cal")
    entries = yaml.safe_load((tmp_path / "cal/joint_origins.yaml").read_text())["kinematics"]
    assert list(entries) == ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "hash"]
    assert list(entries["forearm"]) == ["x", "y", "z", "roll", "pitch", "yaw", "joint"]


def test_links_whose_short_names_collide_keep_all_their_joints(folders):
    saved = irbcal.load(folders[0]).record
    for names in (["arm", "arm_link"], ["hash", "x"], ["_link", "y"]):
        links = [item.link for item in saved.joint_origins]
        links[1:3] = names
        items = [item.model_copy(update={"link": link}) for item, link in zip(saved.joint_origins, links, strict=True)]
        entries = yaml.safe_load(joint_origins.to_yaml(saved.model_copy(update={"joint_origins": items})))["kinematics"]
        assert [entry["joint"] for key, entry in entries.items() if key != "hash"] == [
            f"joint_{i}" for i in range(1, 7)
        ]


def test_numbers_and_names_are_written_as_yaml_reads_them():
    for value in (0.0, -0.0, 1e17, 1e-7, 1.5e-300, 123456.789, -2.5e20):
        assert joint_origins._number(value) == yaml.safe_dump(value).split("\n")[0]
    for name in (
        "link_1",
        "yes",
        "No",
        "a b",
        "a: b",
        "1_2",
        "é",
        "a#b",
        " a",
        "~",
        "",
        "-",
        ".inf",
        "link y",
        'q"x',
        "\\",
    ):
        assert yaml.safe_load(f"{joint_origins._text(name)}: {joint_origins._text(name)}") == {name: name}
