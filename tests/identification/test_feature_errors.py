"""Errors in rows at features are named, and none where there is none: SIMULATED sockets, and real contacts of two arms."""

import re
from dataclasses import replace
from types import SimpleNamespace

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal import feature_pipeline
from irbcal.identification import feature_errors
from irbcal.identification.feature_fit import identify_features
from irbcal.io.urdf import read_urdf
from irbcal.measurement import features
from irbcal.simulation.devices import BALL

KNOWN = pd.DataFrame(
    [
        {"feature": "{place}/{socket}", "kind": "point"},
        {"feature": "{place} bar", "kind": "distance", "first": "{place}/0", "second": "{place}/1", "length_mm": 50.0},
    ]
).astype(object)
KNOWN = KNOWN.where(KNOWN.notna(), "")


def doubts(arm, rows):
    return feature_errors.doubts(identify_features(arm, rows, choices=[()], bare=True))


def sockets(seed=0):
    """Three sockets, an arm with errors, 0.02 mm of noise."""
    table, known = cases.rows("point", cases.true_arm(cases.arm(), seed, lengths=False), 20, seed, 2e-5)
    return features.read(table, known, cases.arm())


def contacts(kind="point", seed=0, n=20, noise=2e-5, change=None, fit=""):
    """Rows of a kind as the file has them, spoiled; and calibrated."""
    table, known = cases.rows(kind, cases.true_arm(cases.arm(), seed, lengths=False), n, seed, noise, fit=fit)
    table = table.assign(simulated="yes")
    if change is not None:
        change(table)
    return irbcal.calibrate(table, "irb1600", features=known.fillna("")).record


def turned(q, joint):
    sign = np.ones(6)
    sign[joint - 1] = -1.0
    return q * sign


@pytest.mark.parametrize(
    ("as_read", "words"),
    [
        (lambda q: turned(q, 2), "joint 2 with its sign turned"),
        (lambda q: q[:, [0, 1, 2, 4, 3, 5]], "joints 4 and 5 swapped"),
        (lambda q: np.radians(q), "joints in radians instead of degrees"),
        (lambda q: q - np.eye(6)[2] * q[:, [1]], "joint 3 shown with joint 2 in it"),
    ],
)
def test_joints_read_otherwise_are_named(as_read, words):
    rows = sockets()
    (sentence,) = doubts(cases.arm(), replace(rows, q=as_read(rows.q)))
    assert words in sentence


def test_rows_that_no_reading_explains_are_doubted():
    """Rows say another socket than they are at, by chance."""
    rows = sockets()
    label = np.random.default_rng(0).permutation(rows.feature)
    (sentence,) = doubts(cases.arm(), replace(rows, feature=label))
    assert "which no calibrated arm does" in sentence


def test_rows_without_errors_are_not_doubted():
    assert [doubts(cases.arm(), sockets(seed)) for seed in range(1, 4)] == [[]] * 3


@pytest.mark.parametrize("first", [5, 10, 16])
def test_a_socket_that_moved_is_named_with_its_row(first):
    """The second socket moves by 0.6 mm before its row number ``first``, by joint 1 turned about the base."""
    rows = sockets()
    later = (rows.feature == "point 1") & (np.cumsum(rows.feature == "point 1") > first)
    (sentence,) = doubts(cases.arm(), replace(rows, q=rows.q + np.outer(later, np.eye(6)[0]) * 6e-4))
    assert sentence.startswith("point 1 moved by 0.")
    assert f"from row {rows.row[later][0]} on" in sentence


def test_real_contacts_without_and_with_errors(shared_data):
    """A quarter of a place turned by 5 mrad about joint 1, and joint 4 counted the other way; as they are, nothing is said."""
    folder = shared_data / "panda_two_sockets"
    arm = read_urdf(folder / "panda.urdf", None, "panda_link8", None).arm
    table = pd.read_csv(folder / "panda_4.csv").drop(columns="controller_x_m")
    for joint in range(1, 8):
        table[f"q{joint}_deg"] = np.degrees(table.pop(f"q{joint}_rad"))
    table = table[[name for name in table if not name.startswith("controller")]].astype(object)
    rows = features.read(table, KNOWN, arm)
    assert doubts(arm, rows) == []
    place = table.place.unique()[-1]
    later = np.flatnonzero(table.place == place)
    later = later[3 * len(later) // 4 :]  # among the contacts of one socket
    slipped = rows.q.copy()
    slipped[later, 0] += 5e-3
    (sentence,) = doubts(arm, replace(rows, q=slipped))
    assert sentence.startswith(f"{place}")
    (sentence,) = doubts(arm, replace(rows, q=rows.q * np.array([1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0])))
    assert "joint 4 with its sign turned" in sentence


def test_a_known_length_that_is_wrong_is_doubted(tmp_path):
    """Two sockets at four places, known distances apart, of SIMULATED contacts; the file is 3 mm wrong of the last."""
    truth = cases.true_arm(cases.arm(), 3)
    parts = []
    for k in range(4):
        table, _ = cases.rows("point", truth, 30, 10 + k, 1e-5)
        parts.append(table.assign(place=f"place {k}"))
    table = pd.concat(parts)
    table = table[table.feature != "point 2"].assign(pose=range(4 * 60))
    table["socket"] = table.pop("feature").str[-1]
    q = np.radians(table[[f"q{j}_deg" for j in range(1, 7)]].to_numpy(dtype=float))
    tip = cases.tip(truth, q)[0]
    lengths = []
    for k in range(4):
        of = [(table.place == f"place {k}").to_numpy() & (table.socket == s).to_numpy() for s in "01"]
        length = np.linalg.norm(tip[of[0]].mean(axis=0) - tip[of[1]].mean(axis=0)) * 1e3
        lengths.append({"feature": f"bar {k}", "kind": "distance", "first": f"place {k}/0", "second": f"place {k}/1"})
        lengths[-1]["length_mm"] = length + 3.0 * (k == 3)
    known = pd.DataFrame([{"feature": "{place}/{socket}", "kind": "point"}, *lengths]).astype(object)
    known = known.where(known.notna(), "")
    result = irbcal.calibrate(table.assign(simulated="yes"), "irb1600", "26", features=known)
    assert any(doubt.startswith("The known length bar 3 is ") for doubt in result.record.doubts)
    known.loc[4, "length_mm"] -= 3.0
    result = irbcal.calibrate(table.assign(simulated="yes"), "irb1600", "26", features=known)
    assert not any("known length" in doubt for doubt in result.record.doubts)


@pytest.mark.parametrize(("nominal", "heldout", "doubted"), [(0.2, 0.6, True), (0.6, 0.2, False), (0.02, 0.06, False)])
def test_known_lengths_that_become_worse_are_doubted(nominal, heldout, doubted):
    section = SimpleNamespace(scale_measured=True, scale_from="", open_mm=0.0, before_mm=1.0)
    section.left_out_lengths = lambda: np.array([[nominal, heldout]])
    assert bool(feature_pipeline.doubts_of(section)) == doubted


def at(table, poses):
    """Which rows of a file are of some poses, by their number."""
    return np.isin(pd.factorize(table.pose)[0], poses)


def test_rows_at_another_socket_are_left_out_and_their_socket_is_named():
    def change(table):
        table.loc[at(table, [3, 25, 44]), "feature"] = ["point 2", "point 0", "point 1"]

    record = contacts(change=change)
    assert [row.reason.split(": it is at ")[1] for row in record.excluded] == ["point 0", "point 1", "point 2"]
    assert not any("contradict" in doubt or "moved" in doubt for doubt in record.doubts)


def test_a_mistyped_joint_is_left_out_though_it_moves_the_tool_by_less_than_a_millimetre():
    """Joint 6 by 0.3 degrees: the ball is 67 mm from its axis."""

    def change(table):
        table.loc[at(table, [30]), "q6_deg"] += 0.3

    (row,) = contacts(change=change).excluded
    assert row.reason.startswith("row 31 ")


def test_pictures_of_another_board_are_left_out():
    """Four of 45 pictures say another board: no place of camera and boards meets all of them."""

    def change(table):
        table.loc[at(table, [2, 9]), "feature"] = "image-on-tool 1"
        table.loc[at(table, [20, 33]), "feature"] = "image-on-tool 0"

    record = contacts("image-on-tool", n=15, change=change)
    assert {row.pose for row in record.excluded} == {f"image-on-tool {k}" for k in ("0 2", "0 9", "1 5", "2 3")}


def test_an_anchor_whose_zero_jumps_is_named():
    """An encoder shows 3 mm more from a row on."""

    def change(table):
        table.loc[at(table, range(18, 40)), "value_mm"] += 3.0

    (moved,) = [doubt for doubt in contacts("radius", n=40, change=change).doubts if "moved" in doubt]
    assert moved.startswith("radius 0 moved by ")
    assert "from row 19 on" in moved


def test_a_ball_that_was_mounted_anew_is_named():
    """Behind the middle of each socket's rows it is 0.6 mm farther along the tool, found from the flange's poses."""
    truth = cases.true_arm(cases.arm(), 0, lengths=False)
    table, known = cases.rows("point", truth, 20, 0, 2e-5)
    rows = features.read(table, known, cases.arm())
    later = np.arange(len(rows)) % 20 >= 10
    order = np.argsort(later, kind="stable")
    rows = features.read(table.iloc[order], known, cases.arm())
    q, later = rows.q.copy(), later[order]
    wanted = cases.tip(truth, q)[0]
    for _ in range(20):
        p = cases.tip(truth, q, cases.TOOL + np.array([0.0, 0.0, 6e-4]))[0]
        J = np.stack(
            [(cases.tip(truth, q + 1e-6 * e, cases.TOOL)[0] - cases.tip(truth, q, cases.TOOL)[0]) for e in np.eye(6)], 2
        )
        q = q + (np.linalg.pinv(J / 1e-6) @ (wanted - p)[..., None])[..., 0]
    (sentence,) = doubts(cases.arm(), replace(rows, q=np.where(later[:, None], q, rows.q)))
    size = re.match(r"The target ball moved on the tool by (\S+) mm", sentence)
    assert size is not None
    assert float(size[1]) == pytest.approx(0.6, abs=0.05)
    assert f"from row {rows.row[later][0]} on" in sentence


@pytest.mark.parametrize("moved", [True, False])
def test_a_ball_on_strings_that_was_mounted_anew_is_named_though_joints_err_beyond_the_geometry(moved):
    """Half a millimetre from the middle of the file on, in the virtual cell: the geometry alone leaves 0.22 mm."""
    made = irbcal.simulate_device("irb1600", device="string", random=120, seed=1, robot_seed=1)
    T, ball = made.cell.arm.forward(made.q), np.array(BALL)
    hook, anew = (T[:, :3, :3] @ at for at in (ball, ball + np.array([0.0, 0.0, 5e-4])))
    anchor = np.array([unknowns["centre"] for unknowns in made.placed.unknowns.values()])[made.which] - T[:, :3, 3]
    longer = np.linalg.norm(anew - anchor, axis=1) - np.linalg.norm(hook - anchor, axis=1)
    table, order = made.to_frame(), np.random.default_rng(0).permutation(120)
    table["value_mm"] = table["value_mm"].astype(float) + np.where(moved & (order.argsort() >= 60), 1e3 * longer, 0.0)
    rows = features.read(table.iloc[order].reset_index(drop=True), made.features(), made.cell.arm)
    named = feature_errors.doubts(identify_features(made.cell.arm, rows, bare=True))
    assert len(named) == moved
    if moved:
        size = re.match(r"The target ball moved on the tool by (\S+) mm from row (\d+) on", named[0])
        assert float(size[1]) == pytest.approx(0.5, abs=0.2)
        assert int(size[2]) == pytest.approx(61, abs=4)


def test_values_of_a_wrong_scale_are_doubted():
    def change(table):
        table["value_mm"] *= 1.01

    assert any("% larger than nominal" in doubt for doubt in contacts("radius", n=40, change=change).doubts)
    good = contacts("radius", n=40).doubts
    assert not any("than nominal" in doubt or "moved" in doubt for doubt in good)


@pytest.mark.parametrize(("noise", "doubted"), [(5e-4, True), (1e-4, False)])
def test_rows_that_scatter_far_beyond_their_stated_uncertainty_are_doubted(noise, doubted):
    def change(table):
        table["u95_mm"] = 0.05

    record = contacts(noise=noise, change=change)
    assert any("0.05 mm was stated" in doubt for doubt in record.doubts) == doubted


def test_strings_with_a_joint_counted_the_other_way_are_named():
    """No place of anchors and hook meets them."""
    table, known = cases.rows("radius", cases.true_arm(cases.arm(), 0, lengths=False), 20, 0, 2e-5)
    rows = features.read(table, known, cases.arm())
    (sentence,) = doubts(cases.arm(), replace(rows, q=turned(rows.q, 2)))
    assert "joint 2 with its sign turned" in sentence
