"""Errors in rows at features are named, and none where there is none: SIMULATED sockets, and real contacts of two arms."""

from dataclasses import replace
from types import SimpleNamespace

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal import pipeline
from irbcal.identification import feature_errors
from irbcal.identification.feature_fit import identify_features
from irbcal.io.opening import open_nominal
from irbcal.measurement import features

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
    assert [doubts(cases.arm(), sockets(seed)) for seed in range(1, 7)] == [[]] * 6


@pytest.mark.parametrize("first", [5, 10, 16])
def test_a_socket_that_moved_is_named_with_its_row(first):
    """The second socket moves by 0.6 mm before its row number ``first``, by joint 1 turned about the base."""
    rows = sockets()
    later = (rows.feature == "point 1") & (np.cumsum(rows.feature == "point 1") > first)
    (sentence,) = doubts(cases.arm(), replace(rows, q=rows.q + np.outer(later, np.eye(6)[0]) * 6e-4))
    assert sentence.startswith("point 1 moved by 0.")
    assert f"from row {rows.row[later][0]} on" in sentence


@pytest.mark.parametrize("number", [2, 4])
def test_real_contacts_without_and_with_errors(number, shared_data):
    """A quarter of a place turned by 5 mrad about joint 1, and joint 4 counted the other way; as they are, nothing is said."""
    folder = shared_data / "panda_two_sockets"
    arm = open_nominal(folder / "panda.urdf", None, "panda_link8", None).arm
    table = pd.read_csv(folder / f"panda_{number}.csv").drop(columns="controller_x_m")
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
    assert any("place 3 moved (or a known length" in doubt for doubt in result.record.doubts)
    known.loc[4, "length_mm"] -= 3.0
    result = irbcal.calibrate(table.assign(simulated="yes"), "irb1600", "26", features=known)
    assert not any("known length" in doubt for doubt in result.record.doubts)


@pytest.mark.parametrize(("nominal", "heldout", "doubted"), [(0.2, 0.6, True), (0.6, 0.2, False), (0.02, 0.06, False)])
def test_known_lengths_that_become_worse_are_doubted(nominal, heldout, doubted):
    length = SimpleNamespace(nominal_mm=nominal, heldout_mm=heldout)
    section = SimpleNamespace(scale_measured=True, scale_from="", lengths=[length], open_mm=0.0, before_mm=1.0)
    assert bool(pipeline._feature_doubts(section)) == doubted
