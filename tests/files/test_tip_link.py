"""Which link is the tip, and in what order it is asked for."""

import pytest

from irbcal.errors import RobotError
from irbcal.files.tip_link import choose_tip


def tree(*pairs):
    """Links, what each hangs on, and which move; ``a>b`` moves, ``a-b`` is fixed."""
    above, moved, links = {}, set(), []
    for pair in pairs:
        parent, link = pair.replace(">", "-").split("-")
        links += [name for name in (parent, link) if name not in links]
        above[link] = parent
        if ">" in pair:
            moved.add(link)
    return links, above, moved


def test_usual_names_and_single_ends_need_no_question():
    assert choose_tip(*tree("base>l1", "l1>l2", "l2-tool0", "l2-cable"), "x.urdf") == "tool0"
    assert choose_tip(*tree("base>l1", "l1>l2", "base-camera"), "x.urdf") == "l2"


def test_the_hand_comes_before_its_fingers():
    arm = tree("base>l1", "l1>l7", "l7-link8", "link8-my_hand", "my_hand>finger_b", "my_hand>finger_a", "base-camera")
    with pytest.raises(RobotError, match="candidates are my_hand, link8, l7, finger_a, finger_b: name one") as refused:
        choose_tip(*arm, "x.urdf")
    assert refused.value.parameter == "tip_link"


def test_likely_names_and_near_links_come_first():
    arm = tree("base>l1", "l1>l2", "l2-a", "a-far", "l2-cover", "l2-b", "b-c", "c-gun_tcp")
    with pytest.raises(RobotError, match="candidates are gun_tcp, l2, cover, far: name"):
        choose_tip(*arm, "x.urdf")


def test_many_candidates_are_counted():
    with pytest.raises(RobotError, match=r"e00, e01, .* and 19 more: name one"):
        choose_tip(*tree("base>l1", *(f"l1-e{k:02d}" for k in range(30))), "x.urdf")
