"""Frame terms in a calibration's file: they come back, and others can check what they compute from it."""

import json

import numpy as np
import pytest
from pydantic import ValidationError
from support import arm, assert_same_poses
from term_cases import framed_robot

from irbcal.files.frame_terms_section import FrameTermsSection
from irbcal.files.joint_map_section import JointMapSection


@pytest.fixture(scope="module")
def robot():
    return framed_robot("irb120", np.random.default_rng(4))


def test_what_is_written_is_read_again(robot):
    text = FrameTermsSection.of_robot(robot).model_dump_json(by_alias=True)
    read = FrameTermsSection.model_validate_json(text)
    again = robot.replace(frame_terms=read.term_map(arm("irb120")))
    q = robot.arm.random_joints(50, 3)
    assert_same_poses(again.poses(q), robot.poses(q), 1e-15, 1e-14)
    assert FrameTermsSection.of_robot(robot.replace(frame_terms=None)) is None


def rotation(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(4)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


def translation(axis, length):
    T = np.eye(4)
    T[axis, 3] = length
    return T


def small(xi):
    """Rigid motion of the frame: shift, then rotation vector by Rodrigues' formula."""
    angle = np.linalg.norm(xi[:3])
    K = np.array([[0, -xi[2], xi[1]], [xi[2], 0, -xi[0]], [-xi[1], xi[0], 0]])
    T = np.eye(4)
    if angle > 0:
        T[:3, :3] += np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * K @ K
    T[:3, 3] = xi[3:]
    return T


def test_the_test_vectors_can_be_computed_from_the_file_alone(robot):
    """Of wobble, which needs no attitudes: matrices one by one as docs/calibration-auto.md says."""
    table, terms = robot.arm.table, [t for t in robot.frame_terms.terms if t.family == "wobble"]
    keep = [k for k, t in enumerate(robot.frame_terms.terms) if t.family == "wobble"]
    part = type(robot.frame_terms)(robot.frame_terms.arm, tuple(terms), robot.frame_terms.coefficients[keep])
    robot = robot.replace(frame_terms=part)
    content = json.loads(FrameTermsSection.of_robot(robot).model_dump_json(by_alias=True))
    effective = JointMapSection.of(robot.joint_map, robot.arm).test_vectors
    for vector, joints in zip(content["test_vectors"], effective, strict=True):
        xi = np.zeros((6, 6))
        for term in content["terms"]:
            j = term["joint"] - 1
            wave = {"cos": np.cos, "sin": np.sin}[term["basis"]](term["cycles_per_turn"] * vector["q"][j])
            value = term.get("coefficient_rad", term.get("coefficient_m"))
            xi[j, ["rx", "ry", "rz", "tx", "ty", "tz"].index(term["axis"])] += value * wave
        T = robot.arm.T_base_0
        for j in range(6):
            T = T @ rotation(0, table.alpha[j]) @ translation(0, table.a[j])
            T = T @ rotation(1, table.beta[j]) @ translation(1, table.b[j])
            T = T @ small(xi[j]) @ rotation(2, table.theta[j] + joints.effective[j]) @ translation(2, table.d[j])
        assert_same_poses(vector["T_base_tip"], T @ robot.arm.T_last_tip, 1e-14, 1e-13)


def test_it_says_what_urdf_and_joint_map_miss(robot):
    section = FrameTermsSection.of_robot(robot)
    low, high = robot.joint_map.ranges
    q = low + (high - low) * np.random.default_rng(9).random((400, 6))
    moved = np.linalg.norm(robot.points(q, "smr1") - robot.replace(frame_terms=None).points(q, "smr1"), axis=1)
    assert section.median_mm == pytest.approx(1e3 * np.median(moved), rel=0.1)
    assert section.largest_mm >= 0.8e3 * moved.max()
    assert f"move smr1 by {section.median_mm:.3f} mm in the median" in section.in_words
    assert "--" not in section.in_words, "it stands in an XML comment"


def test_a_term_that_is_not_understood_is_refused(robot):
    content = FrameTermsSection.of_robot(robot).model_dump(by_alias=True)
    content["terms"][0]["basis"] = "magic"
    with pytest.raises(ValidationError, match="a term is not understood"):
        FrameTermsSection(**content)
