"""Joints that stand as literals in robot programs."""

import numpy as np
import pytest
from import_support import JOINTS, understood, write

from irbcal.measurement.imports import reader

RAPID = """MODULE m
  CONST jointtarget j1:=[[10,-20,30.5,0,45,9E1],[9E9,9E9,9E9,9E9,9E9,9E9]];
  ! jointtarget old:=[[1,1,1,1,1,1],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget p1:=[[900,0,1000],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  VAR jointtarget j2 := [ [11, -21, 31.5, 1, 46, 91], [9E9,9E9,9E9,9E9,9E9,9E9] ];
ENDMODULE
"""
KRL = """DEF p()
DECL E6AXIS j1={A1 10,A2 -20,A3 30.5,A4 0,A5 45,A6 90,E1 0,E2 0}
E6AXIS j2={A1 11, A2 -21, A3 31.5, A4 1, A5 46, A6 91}
E6POS q={X 900,Y 0,Z 0,A 1,B 2,C 3} ; E6AXIS old={A1 1,A2 1,A3 1,A4 1,A5 1,A6 1}
"""
LS = """/POS
P[1]{
   GP1:
\tUF : 0, UT : 1,
\tJ1=    10.000 deg,\tJ2=   -20.000 deg,\tJ3=    30.500 deg,
\tJ4=     0.000 deg,\tJ5=    45.000 deg,\tJ6=    90.000 deg
};
P[2:"high"]{
   GP1:
\tJ1=    11.000 deg,\tJ2=   -21.000 deg,\tJ3=    31.500 deg,
\tJ4=     1.000 deg,\tJ5=    46.000 deg,\tJ6=    91.000 deg
};
/END
"""
URSCRIPT = """def p():
  set_target_payload(2, [0, 0, 0.05], [0.01, 0.01, 0.01, 0, 0, 0])
  j1 = [0.17453292519943295, -0.3490658503988659, 0.5323254218582705, 0, 0.7853981633974483, 1.5707963267948966]
  j2=[0.19198621771937624, -0.3665191429188092, 0.5497787143782138, 0.017453292519943295, 0.8028514559173916, 1.5882496193148399]
  movej(get_inverse_kin(p[0.1,0.2,0.3,0,0,0], qnear=[0.1,0.1,0.1,0,0,0])) # j3 = [1,1,1,1,1,1]
end
"""
Q = [[10, -20, 30.5, 0, 45, 90], [11, -21, 31.5, 1, 46, 91]]


@pytest.mark.parametrize(
    ("name", "text", "poses"),
    [
        ("a.mod", RAPID, ["j1", "j2"]),
        ("a.dat", KRL, ["j1", "j2"]),
        ("a.ls", LS, ["P1", "P2"]),
        ("a.script", URSCRIPT, ["j1", "j2"]),
    ],
)
def test_joints_of_programs(tmp_path, name, text, poses):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    found = reader.joints_of_program(path)
    assert np.abs(found[JOINTS].to_numpy() - Q).max() < 1e-9
    assert found["pose"].tolist() == poses
    points = write(tmp_path / "p.txt", f"{poses[0]}_smr1, 1000, 2000, 300", f"{poses[1]}_smr1, 1100, 2000, 300")
    table = understood(points, "spatial-analyzer", "units.lengths=mm", joints=path).table
    assert table["pose"].tolist() == poses
    assert np.abs(table[JOINTS].to_numpy() - Q).max() < 1e-9


def test_joints_within_moves_of_a_script_are_read(tmp_path):
    path = tmp_path / "a.script"
    path.write_text(
        f"def p():\n  movej({np.radians(Q[0]).tolist()},\n  a=1)\n  servoj({np.radians(Q[1]).tolist()})\nend\n"
    )
    found = reader.joints_of_program(path)
    assert np.abs(found[JOINTS].to_numpy() - Q).max() < 1e-9
    assert found[reader.ROW].tolist() == [2, 4]


def test_programs_without_joints_are_none(tmp_path):
    assert reader.joints_of_program(write(tmp_path / "a.mod", "MODULE m", "ENDMODULE")) is None
    assert reader.joints_of_program(write(tmp_path / "a.csv", "q1_deg", "[[1,2,3,4,5,6],[9E9]]")) is None
