"""What a controller computes with, from files: measured Pandas, columns and units, the URDF that equals it."""

import numpy as np
import pandas as pd
import pytest
from support import arm

import irbcal
import irbcal.io.robots
from irbcal.errors import MeasurementError
from irbcal.io import urdf
from irbcal.modeling import frames


@pytest.fixture(scope="module")
def panda(shared_data):
    folder = shared_data / "panda_two_sockets"
    return lambda n: irbcal.controller(folder / f"panda_{n}.csv", folder / "panda.urdf", tip_link="panda_hand_tcp")


def test_the_rows_of_another_moment_are_found(panda, shared_data):
    found = panda(2)
    assert found.agreeing == 464
    assert len(found.other_moment) == 33
    assert found.median_mm() < 0.02
    assert found.fit.names == ()
    assert found.absolute_accuracy == "no sign of it"
    rows = (
        pd.read_csv(shared_data / "panda_two_sockets/panda_2.csv", dtype=str).set_index("pose").loc[found.other_moment]
    )
    assert (rows["socket"] == "1").all()  # nearly all of one socket, as the data's description says


def test_a_controller_with_other_lengths(panda, tmp_path, shared_data):
    found = panda(4)
    assert found.median_mm() == pytest.approx(0.165, abs=0.001)
    assert found.median_mm(True) < 0.02
    assert [row["number"] for row in found.numbers()] == ["d3", "d5"]
    assert [row["controller"] for row in found.numbers()] == pytest.approx([316.2, 384.2], abs=0.01)
    found.save(tmp_path / "controller.urdf")
    again = irbcal.controller(
        shared_data / "panda_two_sockets/panda_4.csv", tmp_path / "controller.urdf", tip_link="panda_hand_tcp"
    )
    assert again.fit.names == ()
    assert again.median_mm() == pytest.approx(found.median_mm(True), abs=1e-3)


def table(q, T, prefix="", metres=False, radians=False):
    columns = {f"q{k}_{'rad' if radians else 'deg'}": v if radians else np.degrees(v) for k, v in enumerate(q.T, 1)}
    unit = 1.0 if metres else 1e3
    columns |= {f"{prefix}{axis}_{'m' if metres else 'mm'}": T[:, k, 3] * unit for k, axis in enumerate("xyz")}
    quaternion = frames.quaternion_from_matrix(T[:, :3, :3])
    columns |= {f"{prefix}{name}": quaternion[:, k] for k, name in enumerate(("qw", "qx", "qy", "qz"))}
    return pd.DataFrame(columns)


@pytest.mark.parametrize("metres", [True, False])
@pytest.mark.parametrize("prefix", ["", "controller_"])
def test_columns_and_units(prefix, metres):
    nominal = arm()
    q = nominal.random_joints(20, 1)
    found = irbcal.controller(table(q, nominal.forward(q), prefix, metres, radians=metres), "irb1600")
    assert found.fit.nominal_errors.max() < 1e-9
    assert not found.simulated


def test_simulated_poses_are_named():
    nominal = arm()
    q = nominal.random_joints(20, 1)
    check = irbcal.controller(table(q, nominal.forward(q)).assign(simulated="yes"), "irb1600")
    assert check.to_dict()["simulated"]
    assert check.headline().startswith("SIMULATED data: 20 of 20 reported poses")


def test_what_differs_at_base_and_tool_goes_into_the_urdf(tmp_path):
    text = irbcal.io.robots.robot_file("irb1600").read_text()
    assert 'link="tool0"' in text
    nominal = arm()
    q = nominal.random_joints(100, 1)
    base = frames.transform(frames.rot_x(1e-3), [1e-3, 0, 2e-3])
    tool = frames.transform(frames.rot_y(2e-3), [0, 1e-3, 0])
    T = base @ nominal.forward(q) @ tool
    found = irbcal.controller(table(q, T), "irb1600")
    found.save(tmp_path / "same.urdf")
    if found.notes:
        assert "the URDF does not hold what differs at the tool" in found.notes[0]
        return
    same = urdf.read(tmp_path / "same.urdf").arm
    assert np.abs(same.forward(q) - T).max() < 5e-6  # as far as the report's digits are followed


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.drop(columns="q3_deg"), "expected a column q3_deg or q3_rad, found"),
        (lambda t: t.drop(columns="qw"), "expected a column controller_qw or qw, found"),
        (lambda t: t.assign(qw=2.0), "expected a unit quaternion or nothing, found 2,"),
        (
            lambda t: t.assign(y_mm=np.where(t.index == 3, -1e308, t["y_mm"])),
            r"row 4.*y_mm.*within 1 km in mm, found -1e\+308",
        ),
        (lambda t: t.assign(q3_deg=1e20), r"q3_deg.*a joint angle in degrees, found 1e\+20"),
        (lambda t: t.head(5), "expected 12 rows or more, found 5"),
    ],
)
def test_refusals(change, words):
    nominal = arm()
    q = nominal.random_joints(20, 1)
    with pytest.raises(MeasurementError, match=words):
        irbcal.controller(change(table(q, nominal.forward(q))), "irb1600")


def test_a_calibration_stands_for_the_robot_that_it_began_from(folder):
    q = arm().random_joints(20, 1)
    for robot in (folder, folder / "calibrated.urdf"):
        assert irbcal.controller(table(q, arm().forward(q)), robot).fit.names == ()


def test_the_command(program, tmp_path):
    nominal = arm()
    q = nominal.random_joints(20, 1)
    table(q, nominal.forward(q)).to_csv(tmp_path / "poses.csv", index=False)
    told = program("controller", tmp_path / "poses.csv", "--robot", "irb1600", "--out", tmp_path / "c.urdf", "--json")
    assert told["rows_that_agree"] == 20
    assert told["numbers"] == []
    assert urdf.read(tmp_path / "c.urdf").arm.joint_names == nominal.joint_names
    assert "computes with the numbers of the URDF" in program(
        "controller", tmp_path / "poses.csv", "--robot", "irb1600"
    )
