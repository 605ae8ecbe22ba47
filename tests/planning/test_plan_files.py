"""The files of a plan."""

from irbcal.planning import measuring_plan
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import plan


def test_files_hold_what_the_tables_say():
    made = plan("irb1600", axis=0, cube=0, all_range=3, without=SOLID, level="nominal", payload=2.5)
    found = measuring_plan.files(made, page="<html></html>")
    assert list(found) == ["plan.csv", "poses.csv", "plan.json", "plan.mod", "plan.html"]
    rows = found["plan.csv"].decode().splitlines()
    assert rows[0].endswith("target,expected_x_mm,expected_y_mm,expected_z_mm,time_s,payload_kg")
    cells = rows[1].split(",")
    assert all(len(cell.split(".")[1]) == 4 for cell in cells[2:8])
    assert [len(cell.split(".")[1]) for cell in cells[9:13]] == [3, 3, 3, 1]
    assert len(rows) == 1 + made.asked.sum() == 1 + len(measuring_plan.plan_table(made))
    assert found["plan.mod"].decode().count("WaitTime") == 3
