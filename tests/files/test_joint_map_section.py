"""Joint maps through JSON, and a second derivation of the terms from docs/calibration-auto.md."""

import json

import numpy as np
import pytest
from pydantic import ValidationError
from support import arm

from irbcal.errors import RobotError
from irbcal.files.joint_map_section import JointMapSection
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import families
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.thesis_map import ThesisMap


@pytest.fixture(scope="module")
def joint_map():
    model = arm("irb120")
    names = ("gravity", "gain", "thesis", "harmonics", "direction", "move", "torque")
    terms = [t for name in names for t in families()[name].terms(model)] + Payload((0.02, -0.01, 0.1)).terms(model)
    values = 0.3 * np.array([t.size for t in terms]) * np.random.default_rng(3).standard_normal(len(terms))
    ranges = np.array([np.full(6, -2.0), np.full(6, 1.5)])
    return JointMap(TermMap(model, tuple(terms), values, np.abs(values)), ranges, 2.5)


def test_terms_come_back_from_json(joint_map):
    model = arm("irb120")
    section = JointMapSection.of(joint_map, model)
    text = section.model_dump_json()
    assert json.loads(text)["schema"] == "irbcal-joint-map-2"
    again = JointMapSection.model_validate_json(text).joint_map(model)
    q, previous = model.random_joints(50, 1), model.random_joints(50, 2)
    assert np.array_equal(again.effective(q, previous), joint_map.effective(q, previous))
    assert np.array_equal(again.ranges, joint_map.ranges)
    assert again.payload_kg == json.loads(text)["payload_kg"] == 2.5
    assert np.array_equal(again.carrying(4.0).effective(q), joint_map.carrying(4.0).effective(q))
    assert again.terms.std == pytest.approx(joint_map.terms.std, abs=0.0)


def test_the_thesis_s_map_comes_back_from_json():
    model = arm("irb120")
    thesis = ThesisMap(np.linspace(1e-4, 6e-4, 6), [1e-3, 2e-3], [0.1, 1.5], [1e-3, 2e-3, 3e-3, 4e-3])
    section = JointMapSection.of(thesis.joint_map(model), model)
    again = JointMapSection.model_validate_json(section.model_dump_json()).joint_map(model)
    q = model.random_joints(20, 1)
    assert np.abs(again.effective(q) - thesis.effective(q)).max() < 1e-14
    assert again.ranges is None


def rotation(k, angle):
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    i, j = (k + 1) % 3, (k + 2) % 3
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def effective(entry, model, vector):
    """The joint map in plain steps: revolute joints, rows of the nominal DHM table."""
    table, q = model.table, np.array(vector["q"])
    D = q - vector["previous_q"]
    R, o, frames, links, origins = model.T_base_0[:3, :3], model.T_base_0[:3, 3], [], [], []
    for alpha, a, beta, b, theta, d, angle in zip(
        table.alpha, table.a, table.beta, table.b, table.theta, table.d, q, strict=True
    ):
        o = o + a * R[:, 0]
        R = R @ rotation(0, alpha) @ rotation(1, beta)
        o = o + b * R[:, 1] + d * R[:, 2]
        frames.append(R)
        origins.append(o)
        links.append(R := R @ rotation(2, theta + angle))
    out = q.copy()
    for t in entry["terms"]:
        j = t["joint"] - 1
        z = frames[j][:, 2]
        if t["basis"] == "gravity":
            v = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}.get(str(t["vector"]), t["vector"])
            value = z @ np.cross(links[t["link"] - 1] @ v, entry["gravity"])
        elif t["basis"] == "payload":
            p = o + R @ (model.T_last_tip[:3, :3] @ t["place"] + model.T_last_tip[:3, 3])
            value = 9.81 * vector["payload_kg"] * (z @ np.cross(p - origins[j], entry["gravity"]))
        elif t["basis"] == "torque":
            value = vector["torques_nm"][j]
        elif t["basis"] in ("cos", "sin"):
            value = getattr(np, t["basis"])(t["cycles_per_turn"] * q[j])
        elif t["basis"] == "direction":
            value = np.tanh(D[j] / t["width_rad"])
        else:
            value = {"q": q[j], "move": D[j], "share_of_move": D[j] / np.abs(D).max()}[t["basis"]]
        for joint in [t["joint"], *t.get("also", [])]:
            out[joint - 1] += (t["coefficient_rad"] if "coefficient_rad" in t else t["coefficient"]) * value
    return out


def test_test_vectors_follow_from_the_description(joint_map):
    model = arm("irb120")
    entry = json.loads(JointMapSection.of(joint_map, model).model_dump_json())
    assert entry["inputs"] == ["q", "previous_q", "payload_kg", "torques_nm"]
    assert [vector["payload_kg"] for vector in entry["test_vectors"]] == [2.5, 3.5, 4.5, 5.5, 6.5]
    for vector in entry["test_vectors"]:
        found = effective(entry, model, vector)
        assert np.abs(found - vector["effective"]).max() < 1e-13
        assert np.abs(found - vector["q"]).max() > 1e-4


def test_what_is_no_joint_map_is_refused(joint_map):
    model = arm("irb120")
    entry = json.loads(JointMapSection.of(joint_map, model).model_dump_json())
    for change, words in (
        ({"schema": "irbcal-joint-map-9"}, "irbcal-joint-map-2"),
        ({"terms": [{"joint": 1}]}, "not a term"),
        ({"terms": [entry["terms"][0] | {"basis": "magic"}]}, "not understood"),
        ({"gravity": [0, 0]}, "at least 3"),
    ):
        with pytest.raises(ValidationError, match=words):
            JointMapSection.model_validate(entry | change)
    short = JointMapSection.model_validate(entry | {"ranges": [[0.0], [1.0]]})
    with pytest.raises(RobotError, match="two rows of 6 joints"):
        short.joint_map(model)
