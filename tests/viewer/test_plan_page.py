"""The page of a plan: its poses, reflectors and tracker are in it."""

from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import plan
from irbcal.viewer import view


def test_the_page_shows_the_groups_and_reflectors_of_the_plan():
    made = plan("irb1600", axis=18, cube=0, all_range=2, without=SOLID, level="nominal")
    page = view.plan_page(made)
    for text in ("irb1600_6_145", "axis6", "all_range", "smr1"):
        assert text in page
    assert view._way(made).shape[1] == 3
