"""Joints that programs command: their stops in order, poses through the arm's own solution, and refusals with lines."""

import numpy as np
import pytest
from maker_cases import given, pose_numbers, robot_of, well_inside

from irbcal.correction.commanded import commanded
from irbcal.correction.languages import krl, rapid, table
from irbcal.errors import ProgramError
from irbcal.io import urdf


def src(*lines):
    return [("job.src", "\n".join(["DEF job()", *lines, "END", ""]).encode())]


def test_stops_come_in_order_as_often_as_the_robot_goes_there():
    nominal, _, at = robot_of("kr120r2500pro")
    q = well_inside(nominal, 3)
    axes = ["{" + ", ".join(f"A{k} {v:.6f}" for k, v in enumerate(np.degrees(row), 1)) + "}" for row in q]
    pose = pose_numbers(nominal.forward(q), "ZYX")
    angles = [", ".join(f"{key} {v:.6f}" for key, v in zip("XYZABC", row, strict=True)) for row in pose]
    lines = ["$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", f"PTP {axes[0]}", f"LIN {{{angles[0]}}}", f"PTP {axes[2]}"]
    program = krl.parse(nominal, src(*lines, f"PTP {axes[0]}"), given(at))
    found = commanded(program, nominal)
    np.testing.assert_allclose(found, q[[0, 0, 2, 0]], rtol=0, atol=1e-6)


def test_configurations_of_rapid_name_the_joints():
    nominal = urdf.read("irb120").arm
    q = np.radians([[10.0, 20.0, -30.0, 100.0, 40.0, -120.0]])
    T = nominal.forward(q)[0]
    from irbcal.modeling import frames

    quaternion = frames.quaternion_from_matrix(T[:3, :3])
    numbers = [",".join(f"{v:.9f}" for v in part) for part in (T[:3, 3] * 1000, quaternion)]
    target = f"[[{numbers[0]}],[{numbers[1]}],[0,1,-2,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    module = f"MODULE M\n PROC main()\n  MoveJ {target},v100,fine,tool0;\n ENDPROC\nENDMODULE\n".encode()
    np.testing.assert_allclose(commanded(rapid.parse(module), nominal), q, rtol=0, atol=1e-6)


def test_rows_of_a_table_are_stops():
    nominal = urdf.read("irb120").arm
    header = ",".join(nominal.joint_columns)
    program = table.parse(f"{header}\n1,2,3,4,5,6\n0,0,0,0,0,9\n".encode(), "a.csv", nominal.joint_columns)
    expected = np.radians([[1, 2, 3, 4, 5, 6], [0, 0, 0, 0, 0, 9]])
    np.testing.assert_allclose(commanded(program, nominal), expected, rtol=0, atol=1e-12)


def test_moves_whose_joints_are_not_known_are_refused_with_their_line():
    nominal, _, at = robot_of("kr120r2500pro")
    for line, reason in (("PTP XHOME", "line 2: the joints of this move are not known"), ("LIN_REL {X 5}", "relative")):
        with pytest.raises(ProgramError, match=reason):
            commanded(krl.parse(nominal, src(line), given(at)), nominal)
