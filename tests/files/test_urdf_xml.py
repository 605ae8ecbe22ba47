"""The XML of a URDF: read without trust, written with all else as it was."""

import dataclasses

import numpy as np
import pytest
from lxml import etree

from irbcal.errors import RobotError
from irbcal.files import robots, urdf, urdf_xml


def perturbed(found, seed, size=1.0):
    """The arm with errors on every parameter of links 2 to 6, Hayati's tilt included."""
    rng = np.random.default_rng(seed)
    scale = {"alpha": 2e-3, "a": 1e-3, "theta": 2e-3, "d": 1e-3, "beta": 2e-3}
    moved = np.arange(6) > 0
    changes = {k: getattr(found.arm.table, k) + size * s * moved * rng.normal(size=6) for k, s in scale.items()}
    return found.arm.with_table(dataclasses.replace(found.arm.table, **changes))


def test_nominal_arm_is_written_back_byte_for_byte_for_shipped_files():
    for name in robots.ROBOTS:
        found = urdf.read(name)
        original = robots.robot_file(name).read_bytes()
        assert urdf.to_bytes(found, found.arm).split(b"\n", 1)[1].strip() == original.split(b"\n", 1)[1].strip()


def test_numbers_carry_seventeen_digits():
    found = urdf.read("irb1600")
    robot = perturbed(found, 7)
    text = urdf.to_bytes(found, robot)
    xyz = etree.fromstring(text).find("joint[@name='joint_3']/origin").get("xyz").split()
    assert max(len(v.lstrip("-0.").replace(".", "")) for v in xyz) >= 16


def test_a_huge_file_is_refused():
    with pytest.raises(RobotError, match="too large for a URDF"):
        urdf.from_bytes(b" " * 20_000_001 + b"x", "big")


@pytest.mark.parametrize(
    "name", ["\x01.csv", "a---b.csv", "--", "\udc80.csv", "zwei\nZeilen\u2028.csv", "Ü\ufffe-.csv"]
)
def test_words_of_any_file_name_are_a_comment(name):
    root = etree.fromstring("<robot name='a'/>")
    urdf_xml.begin_with(root, f"{urdf_xml.WORDS_MARK} from {name}")
    read = etree.fromstring(etree.tostring(root.getroottree()))
    (comment,) = read.itersiblings(preceding=True)
    assert comment.text.strip().startswith(f"{urdf_xml.WORDS_MARK} from ")
    assert comment.text.isprintable()
