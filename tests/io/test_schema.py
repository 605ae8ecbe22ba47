"""The sections of calibration.json take nothing unknown and give back what they were made from."""

import base64
import json
import pickle
import struct
import typing
from typing import Annotated

import numpy as np
import pytest
from pydantic import AfterValidator, BaseModel, StringConstraints, TypeAdapter, ValidationError
from support import TARGETS, arm, assert_same_poses, measured, random_robot, write_measurements
from term_cases import framed_robot
from thesis_formula import ThesisMap

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.feature_sections import FeaturesSection, RelationRow
from irbcal.identification.fit_sections import AverageChoice, GearSpectrum, ModelAverage
from irbcal.io import integrity, urdf_check
from irbcal.io.calibration_folder import Signature
from irbcal.io.packed_covariance import PackedCovariance
from irbcal.io.point_tables import PoseTable
from irbcal.io.schema import Record
from irbcal.io.term_sections import FrameTermsSection, JointMapSection
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import families
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.section import Date, Fingerprint, Name, Names, Section, Sentence, Sha256, Version, Word


class Number(Section):
    value: float


def test_unknown_keys_and_numbers_that_are_none_are_refused():
    assert Number(value=1.0).value == 1.0
    with pytest.raises(ValidationError, match="extra"):
        Number(value=1.0, other=2.0)
    with pytest.raises(ValidationError, match="finite"):
        Number(value=float("nan"))


def free(kind, place, checked=False):
    """Places of texts without a pattern in a type."""
    if kind is str or kind is typing.Any:
        return [] if checked else [place]
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin is Annotated:
        rules = any(isinstance(rule, (StringConstraints, AfterValidator)) for rule in inside[1:])
        return free(inside[0], place, checked or rules)
    if origin is typing.Literal:
        return []
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return fields(kind, place)
    return [found for k, part in enumerate(inside) for found in free(part, f"{place}[{k}]", checked)]


def fields(model, place=""):
    hints = typing.get_type_hints(model, include_extras=True)
    return [found for name in model.model_fields for found in free(hints[name], f"{place}.{name}")]


def test_every_text_has_a_pattern():
    assert fields(Record) == []
    assert fields(Signature) == []

    class Bad(BaseModel):
        a: list[str]
        b: dict[str, Name]
        c: str | None
        d: typing.Any
        e: dict[Name, Word | float]

    assert fields(Bad) == [".a[0]", ".b[0]", ".c[0]", ".d"]


@pytest.mark.parametrize("kind", [Date, Fingerprint, Name, Sentence, Sha256, Version, Word])
@pytest.mark.parametrize("text", ["\x1b[31m", "a\nb", "a\u2028b", "\u202ea", "a\x9b", "a" * 20_001])
def test_texts_that_could_act_are_refused(kind, text):
    with pytest.raises(ValidationError):
        TypeAdapter(kind).validate_python(text)
    with pytest.raises(ValidationError):
        TypeAdapter(Names).validate_python(["a", text])


def test_a_foreign_fingerprint_is_refused_with_its_place(folder, tmp_path):
    content = json.loads((folder / "calibration.json").read_text())
    content["fingerprint"] = 'x"""\nimport os; os.system("touch canary")\n"""'
    (tmp_path / "calibration.json").write_text(json.dumps(integrity.sealed(content)))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    with pytest.raises(CalibrationError, match="fingerprint: String should match pattern"):
        irbcal.load(tmp_path)


def test_the_layout_is_rows_of_the_lower_triangle():
    factor = base64.b64encode(struct.pack("<6f", 2.0, 1.0, 3.0, 0.5, -1.0, 4.0)).decode()
    section = PackedCovariance(layout="cholesky-rows-float32-base64", size=3, factor=factor)
    L = np.array([[2.0, 0, 0], [1.0, 3.0, 0], [0.5, -1.0, 4.0]])
    np.testing.assert_array_equal(section.matrix(), L @ L.T)
    np.testing.assert_array_equal(PackedCovariance.from_matrix(L @ L.T).matrix().round(5), (L @ L.T).round(5))


def test_what_is_known_well_stays_known_well():
    # a sum is known ten thousand times better than its parts: rounding of the matrix itself would lose it
    rng = np.random.default_rng(1)
    A = rng.standard_normal((40, 40))
    V = np.linalg.qr(A)[0]
    C = (V * np.geomspace(1e-6, 1e-15, 40)) @ V.T
    there = PackedCovariance.from_matrix(C).matrix()
    for v in V.T:
        assert np.sqrt(v @ there @ v) == pytest.approx(np.sqrt(v @ C @ v), rel=2e-3)
    assert abs(v @ C.astype("f4").astype(float) @ v / (v @ C @ v) - 1.0) > 0.1


def test_held_directions_and_nothing_are_kept():
    v = np.array([[1.0, -1.0, 0.0]])
    C = np.eye(3) - v.T @ v / 2
    np.testing.assert_allclose(PackedCovariance.from_matrix(C).matrix(), C, atol=1e-6)
    assert PackedCovariance.from_matrix(np.zeros((2, 2))).matrix().tolist() == [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("size", "factor", "words"),
    [
        (2, "!!!", "factor"),
        (3, base64.b64encode(bytes(12)).decode(), "of size 3 has 12 bytes"),
        (1, base64.b64encode(struct.pack("<f", np.inf)).decode(), "not finite"),
    ],
)
def test_damage_is_refused(size, factor, words):
    with pytest.raises(ValidationError, match=words):
        PackedCovariance(layout="cholesky-rows-float32-base64", size=size, factor=factor)


def test_a_folder_gives_the_same_predictions(validated, folder):
    fresh, loaded = validated.fit.robot, irbcal.load(folder).robot_calibrated()
    q = fresh.arm.random_joints(30, 4)
    for name in fresh.targets:
        one, two = fresh.predict(q, target=name), loaded.predict(q, target=name)
        np.testing.assert_allclose(two.position, one.position, rtol=0, atol=1e-12)
        np.testing.assert_allclose(two.interval, one.interval, rtol=1e-5)
        np.testing.assert_array_equal(two.outside, one.outside)


def test_intervals_are_as_wide_as_the_errors_where_two_families_share_a_function(tmp_path):
    """Joint 6's series of the thesis and the harmonics are averaged: each keeps its columns of the covariance."""
    nominal, rng = arm(), np.random.default_rng(2)
    robot = random_robot(nominal, "34", rng)
    points = measured(robot, nominal.random_joints(40, 2), 3e-5, rng)
    irbcal.calibrate(write_measurements(tmp_path / "m.csv", points), "irb1600", holdout=0).save(tmp_path / "out")
    loaded = irbcal.load(tmp_path / "out")
    families = {term.family for term in loaded.robot_calibrated().certainty.terms}
    assert {"thesis", "harmonics"} <= families
    names = [row.name for row in loaded.record.parameters]
    assert len(set(names)) == len(names)
    q = nominal.random_joints(300, 9)
    found = loaded.robot_calibrated().predict(q, target="smr1")
    errors = found.position - (robot.points(q, "smr1") + 3e-5 * rng.standard_normal((300, 3)))
    assert 0.92 <= (np.abs(errors) <= found.interval).mean() <= 0.985
    assert np.sqrt(np.mean(found.interval**2)) < 1.5 * 1.96 * np.sqrt(np.mean(errors**2))


def test_an_average_is_saved_with_its_comparison():
    model, rng = arm("irb120"), np.random.default_rng(1)
    points = measured(random_robot(model, "34", rng), model.random_joints(40, 1), 2e-5, rng)
    fit = identify_evidence(model, points, Motion.in_order(points.q))
    choice, average = fit.choice, fit.average
    assert AverageChoice.model_validate_json(choice.model_dump_json()) == choice
    assert sum(row.weight for row in choice.table) == pytest.approx(1.0, abs=1e-12)
    assert (choice.table, choice.explanation) == (fit.term_sets, fit.explanation())
    assert ModelAverage.model_validate_json(average.model_dump_json()) == average
    assert fit.certainty.limits.leave_one_out_mm == average.leave_one_out_mm


def test_a_spectrum_is_thinned_but_keeps_its_peaks():
    chi2 = np.random.default_rng(1).gamma(1.0, 2.0, (6, 416))
    chi2[3, 237] = 99.96
    saved = GearSpectrum.from_scan(range(6), 5, chi2, 19.649)
    assert saved == GearSpectrum.model_validate_json(saved.model_dump_json())
    assert (saved.joints, saved.first, saved.limit) == ([1, 2, 3, 4, 5, 6], 5, 19.649)
    found = np.array(saved.chi2)
    assert found.shape == (6, -(-416 // saved.step))
    assert found[3, 237 // saved.step] == 100.0
    assert found.max(axis=1) == pytest.approx(chi2.max(axis=1), abs=0.051)
    assert len(saved.model_dump_json()) < 6000
    with pytest.raises(ValidationError, match="a row of one length for each joint"):
        GearSpectrum(**saved.model_dump() | {"joints": [1, 2]})


def section(**more):
    return FeaturesSection(
        **{
            "kinds": {"point": 3},
            "in_frame": False,
            "scale_measured": False,
            "left_out": None,
            "before_mm": 2.0,
            "open_mm": 0.5,
            "features": [],
            "places": [],
            "relations": [],
            "feature_column": "feature",
            "scale_from": "",
        }
        | more
    )


def test_the_scale_is_told_where_no_length_was_measured():
    assert (
        section().scale
        == "no length was measured that determines the size of the arm: the scale rests on nominal link lengths"
    )
    assert section(scale_measured=True).scale == ""


def test_length_errors_are_means_of_sizes():
    rows = [
        RelationRow(name=n, kind=k, first="a", second="b", unit=u, known=50, fitted=0, nominal=before, heldout=after)
        for n, k, u, before, after in (
            ("1", "distance", "mm", -2.0, 0.1),
            ("2", "distance", "mm", 1.0, -0.3),
            ("3", "distance", "mm", None, None),
            ("4", "angle-between", "deg", 9.0, 9.0),
        )
    ]
    assert section(relations=rows).length_error() == pytest.approx((1.5, 0.2))
    assert section().length_error() is None


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
    effective = JointMapSection.from_joint_map(robot.joint_map, robot.arm).test_vectors
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
    section = JointMapSection.from_joint_map(joint_map, model)
    text = section.model_dump_json()
    assert json.loads(text)["schema"] == "irbcal-joint-map-1"
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
    section = JointMapSection.from_joint_map(thesis.joint_map(model), model)
    again = JointMapSection.model_validate_json(section.model_dump_json()).joint_map(model)
    q = model.random_joints(20, 1)
    assert np.abs(again.effective(q) - thesis.effective(q)).max() < 1e-14
    assert again.ranges is None


def axis_rotation(k, angle):
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
        R = R @ axis_rotation(0, alpha) @ axis_rotation(1, beta)
        o = o + b * R[:, 1] + d * R[:, 2]
        frames.append(R)
        origins.append(o)
        links.append(R := R @ axis_rotation(2, theta + angle))
    out = q.copy()
    for t in entry["terms"]:
        j = t["joint"] - 1
        z = frames[j][:, 2]
        if t["basis"] == "gravity":
            v = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}.get(str(t["vector"]), t["vector"])
            value = z @ np.cross(links[t["link"] - 1] @ v, entry["gravity"])
        elif t["basis"] == "payload":
            p = o + R @ (model.T_last_tip[:3, :3] @ t["place"] + model.T_last_tip[:3, 3])
            value = 9.81 * vector["inputs"]["payload_kg"] * (z @ np.cross(p - origins[j], entry["gravity"]))
        elif t["basis"] == "torque":
            value = vector["inputs"]["torques"][j]
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
    entry = json.loads(JointMapSection.from_joint_map(joint_map, model).model_dump_json())
    assert entry["inputs"] == ["q", "previous_q", "payload_kg", "payload_centre", "torques"]
    assert [vector["inputs"]["payload_kg"] for vector in entry["test_vectors"]] == [2.5, 3.5, 4.5, 5.5, 6.5]
    for vector in entry["test_vectors"]:
        found = effective(entry, model, vector)
        assert np.abs(found - vector["effective"]).max() < 1e-13
        assert np.abs(found - vector["q"]).max() > 1e-4


def test_what_is_no_joint_map_is_refused(joint_map):
    model = arm("irb120")
    entry = json.loads(JointMapSection.from_joint_map(joint_map, model).model_dump_json())
    for change, words in (
        ({"schema": "irbcal-joint-map-9"}, "irbcal-joint-map-1"),
        ({"terms": [{"joint": 1}]}, "not a term"),
        ({"terms": [entry["terms"][0] | {"basis": "magic"}]}, "not understood"),
        ({"gravity": [0, 0]}, "at least 3"),
    ):
        with pytest.raises(ValidationError, match=words):
            JointMapSection.model_validate(entry | change)
    short = JointMapSection.model_validate(entry | {"ranges": [[0.0], [1.0]]})
    with pytest.raises(RobotError, match="two rows of 6 joints"):
        short.joint_map(model)


POSES = {"pose": ["1", "2"], "group": ["", ""], "heldout": [False, True], "joints": [[0.0, 1.0]], "came_from": ["+0"]}


def test_loads_are_told_for_all_poses_or_none():
    assert PoseTable(**POSES).inputs == {}
    whole = PoseTable(**POSES, inputs={"payload_kg": [0.0, None], "payload_x_mm": [0.0, 1.0], "tau1_nm": [1.0, 2.0]})
    assert PoseTable.model_validate_json(whole.model_dump_json()) == whole
    with pytest.raises(ValidationError, match="2 values, one for each pose"):
        PoseTable(**POSES, inputs={"payload_kg": [1.0]})
    with pytest.raises(ValidationError, match="mood is no column of an input of the error model"):
        PoseTable(**POSES, inputs={"mood": [1.0, 2.0]})


def test_nominal_robot_comes_back_too(validated, folder):
    q = validated.urdf.arm.random_joints(50, 5)
    found = irbcal.load(folder).robot_nominal().points(q, "smr1")
    assert np.abs(found - validated.nominal_robot.points(q, "smr1")).max() < 1e-9


def test_a_record_and_its_parts_are_printed_short(folder):
    record = irbcal.load(folder).record
    assert repr(record) == str(record)
    assert repr(record).startswith(f"<Record of {record.robot.name}: ")
    for part in (record, record.points, record.poses, record.robot, record.joint_map, record.observability, record.fit):
        assert 10 < len(repr(part)) < 1000
        assert "\n" not in repr(part)
    assert f"n={record.fit.all.n}" in repr(record.fit.all)


def test_three_ways_to_predict_agree(validated, folder):
    """From the fit, from the loaded folder, and from the written URDF in Pinocchio plus the joint map."""
    loaded = irbcal.load(folder)
    q = validated.urdf.arm.random_joints(500, 3)
    robot = loaded.robot_calibrated()
    theta = robot.joint_map.effective(q)
    T = urdf_check.poses((folder / "calibrated.urdf").read_bytes(), loaded.arm(), theta)
    for name in TARGETS:
        from_fit = validated.fit.robot.points(q, name)
        base = np.einsum("nij,j->ni", T[:, :3, :3], robot.targets[name]) + T[:, :3, 3]
        from_pinocchio = base @ robot.T_world_base[:3, :3].T + robot.T_world_base[:3, 3]
        assert np.abs(robot.points(q, name) - from_fit).max() < 1e-9
        assert np.abs(from_pinocchio - from_fit).max() < 1e-9


def test_statistics_are_those_of_the_held_out_poses(validated, folder):
    loaded = irbcal.load(folder)
    robot, points = loaded.robot_calibrated(), validated.heldout_points
    distance = [
        np.linalg.norm(xyz - robot.points(q[None], name)[0])
        for q, xyz, name in zip(points.joints(), points.xyz, points.names(), strict=True)
    ]
    assert loaded.record.heldout.all.mean_mm == pytest.approx(np.mean(distance) * 1e3, abs=1e-9)
    assert loaded.record.heldout.all.max_mm == pytest.approx(np.max(distance) * 1e3, abs=1e-9)
    assert loaded.record.poses_fit + loaded.record.poses_heldout == 60
    assert set(validated.fit_points.pose_ids).isdisjoint(points.pose_ids)


def test_every_parameter_is_listed_with_state_and_unit(folder):
    loaded = irbcal.load(folder)
    names = [p.name for p in loaded.record.parameters]
    assert len(names) == len(set(names))
    for expected in ("base_x", "target_smr3_z", "delta_alpha4", "stiffness_delta_L", "fourier_b2"):
        assert expected in names
    for p in loaded.record.parameters:
        assert (p.std is None) == (p.state != "identified")
        assert bool(p.reason) or p.state == "identified"
    assert loaded.record.parameter_count == 43


def test_it_is_printed_short(validated):
    assert repr(validated) == "<Validated irb1600_6_145.urdf, model 34: 42 fitted and 18 held-out poses>"


def test_its_urdf_and_fit_are_pickled(validated):
    again = pickle.loads(pickle.dumps(validated))
    q = validated.urdf.arm.random_joints(20, 3)
    assert np.abs(again.fit.robot.points(q, "smr1") - validated.fit.robot.points(q, "smr1")).max() == 0.0
    assert again.urdf.tree.getroot().get("name") == validated.urdf.tree.getroot().get("name")
    assert np.abs(again.urdf.T_dhm_link - validated.urdf.T_dhm_link).max() == 0.0


def test_it_cannot_be_changed(validated):
    with pytest.raises(ValueError, match="read-only"):
        validated.urdf.T_dhm_link[0, 0, 0] = 2.0
    assert isinstance(validated.notes, tuple)
    assert isinstance(validated.excluded, tuple)
