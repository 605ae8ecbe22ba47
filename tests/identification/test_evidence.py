"""Identification by evidence: simulated truth found again, and figures of real robots computed elsewhere."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support import TARGETS, arm, example_robot, measured, random_robot

from irbcal.errors import IdentificationError
from irbcal.files import urdf
from irbcal.identification import evidence, readings, repeats
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.fit import identify
from irbcal.measurement import cleaning, table
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling import frames
from irbcal.modeling.terms import families
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap

MM = 1e-3

# --- simulated truth ----------------------------------------------------------------------------------------


class Truth:
    """An arm with random terms of some families, that measures itself."""

    def __init__(self, names, seed=1, scale=0.7, extra=(), T_world_base=None):
        rng = np.random.default_rng(seed)
        self.nominal = arm("irb120")
        geometry = families()["geometry"].terms(self.nominal)
        self.constants = {t.name: 0.5 * t.size * rng.standard_normal() for t in geometry}
        columns = {k: getattr(self.nominal.table, k).copy() for k in DHM_COLUMNS.values()}
        for t in geometry:
            columns[DHM_COLUMNS[t.axis]][t.joint] += self.constants[t.name]
        self.arm = self.nominal.with_table(replace(self.nominal.table, **columns))
        terms = [t for name in names for t in families()[name].terms(self.nominal)]
        terms = [t for t in terms if t.family != "harmonics" or t.parameters["cycles_per_turn"] <= 2]
        values = [scale * t.size * rng.standard_normal() for t in terms]
        self.map = TermMap(self.nominal, (*terms, *(t for t, _ in extra)), np.array([*values, *(c for _, c in extra)]))
        self.T_world_base = frames.from_xyz_angles([0.4, -1.0, 0.2, 0.1, 0.2, -2.0])

    def points(self, motion, name):
        T = self.T_world_base @ self.map.forward(self.arm, motion)
        return T[:, :3, :3] @ np.asarray(TARGETS[name]) + T[:, :3, 3]

    def measured(self, motion, noise, seed=2):
        rng = np.random.default_rng(seed)
        n, names = len(motion), tuple(TARGETS)
        xyz = np.stack([self.points(motion, name) for name in names], axis=1).reshape(-1, 3)
        xyz += noise * rng.standard_normal(xyz.shape)
        pose, target = np.repeat(np.arange(n), 3), np.tile(np.arange(3), n)
        return PointSet(motion.q, pose, target, xyz, names, np.arange(n), np.full(n, "", dtype=object))


def moves(model, n, seed):
    return Motion.in_order(model.random_joints(n, seed))


def test_simulated_terms_are_found_again():
    truth = Truth(["gain", "gravity", "harmonics", "direction"])
    motion = replace(moves(truth.nominal, 150, 3), elapsed=None)
    found = identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion, gear_scan=False)
    true = dict(zip([t.name for t in truth.map.terms], truth.map.coefficients, strict=True)) | truth.constants
    error = np.array([c - true.get(t.name, 0.0) for t, c in zip(found.terms, found.coefficients, strict=True)])
    off = np.abs(error / found.std)
    assert (off < 3.0).mean() > 0.985
    assert off.max() < 5.0
    named = {t.name: s for t, s in zip(found.terms, found.std, strict=True)}
    # large ones are known much better than by their prior
    assert named["rz2 direction 0.00872665"] < 0.1 * 1e-4
    assert found.sigma == pytest.approx(2e-5, rel=0.25)
    # and what it says of other poses holds: the truth is within the interval of the parameters alone
    test = Motion.in_order(truth.nominal.random_joints(100, 9))
    seen = found.predict(test.q, test.q - test.moves, "smr2")
    error = seen.position - truth.points(replace(test, elapsed=None), "smr2")
    assert np.linalg.norm(error, axis=1).mean() < 2.5e-5
    spread = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    assert 0.8 < np.mean(np.abs(error) < 1.96 * spread) <= 1.0
    assert np.mean(np.abs(error) < seen.interval) > 0.99


def test_an_unknown_stop_before_widens_the_interval():
    truth = Truth(["gravity", "direction"], scale=2.0)
    motion = replace(moves(truth.nominal, 100, 3), elapsed=None)
    found = identify_evidence(truth.nominal, truth.measured(motion, 1e-5), motion, gear_scan=False)
    test = moves(truth.nominal, 30, 5)
    known, unknown = found.predict(test.q, test.q - test.moves), found.predict(test.q)
    assert (unknown.interval > known.interval).all()
    assert np.abs(unknown.position - known.position).max() > 1e-5
    assert (np.abs(unknown.position - known.position) < unknown.interval).mean() > 0.9


def test_gears_are_found_in_words():
    gears = [(t, c) for t, c in zip(gear_terms(3, 242), (6e-5, -3e-5), strict=True)]
    truth = Truth(["gravity", "gain"], extra=gears)
    motion = Motion(truth.nominal.random_joints(120, 3))
    found = identify_evidence(truth.nominal, truth.measured(motion, 1e-5), motion)
    assert [(g.joint, g.cycles_per_turn) for g in found.gears] == [(3, 242)]
    (sentence,) = found.gear_sentences()
    assert sentence.startswith("Joint 4 swings by 0.0038 degrees 242 times a turn")


def test_no_gears_are_found_in_noise():
    truth = Truth(["gravity", "gain"])
    motion = Motion(truth.nominal.random_joints(80, 3))
    assert not identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion).gears


def test_payload_is_carried_over_to_another_mass():
    loads = np.repeat([1.0, 4.0], 60)
    extra = [(t, 2e-5 * (j + 1)) for j, t in enumerate(Payload((0.0, 0.0, 0.1)).terms(arm("irb120")))]
    truth = Truth(["gravity"], extra=extra)
    q = truth.nominal.random_joints(120, 3)
    motion = Motion(q, payload_kg=loads)
    found = identify_evidence(
        truth.nominal, truth.measured(motion, 1e-5), motion, gear_scan=False, payload_place=(0.0, 0.0, 0.1)
    )
    test = Motion(truth.nominal.random_joints(40, 8), payload_kg=np.full(40, 7.0))
    T = found.T_world_base @ found.term_map().forward(found.arm, test)
    p = T[:, :3, :3] @ found.targets["smr1"] + T[:, :3, 3]
    error = np.linalg.norm(p - truth.points(test, "smr1"), axis=1)
    assert error.mean() < 3e-5
    unloaded = Motion(test.q)
    assert np.linalg.norm(truth.points(unloaded, "smr1") - truth.points(test, "smr1"), axis=1).mean() > 3e-4


def test_the_thesis_level_keeps_its_accuracy_on_arms_with_its_errors():
    model, rng = arm("irb120"), np.random.default_rng(4)
    robot = random_robot(model, "34", rng)
    points = measured(robot, model.random_joints(100, 1), 2e-5, rng)
    test = measured(robot, model.random_joints(200, 2))
    level = distances(identify(model, points, "34").robot, test).mean()
    found = identify_evidence(model, points, gear_scan=False)
    error = [
        np.linalg.norm(found.predict(test.q[test.pose[mine]], None, name).position - test.xyz[mine], axis=1)
        for name, mine in ((name, test.target == k) for k, name in enumerate(test.target_names))
    ]
    assert np.concatenate(error).mean() < 1.15 * level


def test_repeats_of_a_stop_are_averaged():
    truth = Truth(["gravity"])
    motion = Motion(np.repeat(truth.nominal.random_joints(30, 3), 3, axis=0))
    points = truth.measured(motion, 3e-5)
    merged, shorter = repeats.averaged(points, motion)
    assert merged.poses == len(shorter) == 30
    expected = points.xyz.reshape(30, 3, 3, 3).mean(axis=1).reshape(-1, 3)
    np.testing.assert_allclose(merged.xyz, expected, atol=1e-12)
    assert identify_evidence(truth.nominal, points, motion, gear_scan=False).poses == 30


def test_readings_that_lag_are_recognised():
    truth = Truth(["gravity"])
    commands = moves(truth.nominal, 120, 3)
    rng = np.random.default_rng(6)
    share = np.abs(4e-4 + 2e-4 * rng.standard_normal(120))
    points = truth.measured(replace(commands, elapsed=None), 1e-5)
    read = commands.q - share[:, None] * commands.moves
    motion = Motion(read, np.diff(read, axis=0, prepend=read[:1]), readings=True)
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    assert found.readings_projected
    assert found.readings_gain > 3.0
    shares = readings.shares(found, points, motion)
    assert np.abs(shares - share)[5:].mean() < 2e-5
    lag = readings.lag(found, points, motion)
    assert np.abs(lag.share(found, motion)[5:] - share[5:]).mean() < 2.5e-4
    # exact readings are left alone
    motion = Motion(commands.q, commands.moves, readings=True)
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    assert not found.readings_projected
    assert found.readings_gain < 1.2


def test_comparison_on_some_poses_then_all(monkeypatch):
    truth = Truth(["gravity"])
    motion = Motion(truth.nominal.random_joints(120, 3))
    points = truth.measured(motion, 2e-5)
    whole = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    monkeypatch.setattr(evidence, "COMPARED", 60)
    part = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    assert part.poses == 120
    difference = part.predict(motion.q[:20]).position - whole.predict(motion.q[:20]).position
    assert np.abs(difference).max() < 2e-5


def test_what_cannot_be_done_is_refused():
    truth = Truth(["gravity"])
    motion = Motion(truth.nominal.random_joints(20, 3))
    points = truth.measured(motion, 2e-5)
    with pytest.raises(IdentificationError, match="joint-map or all"):
        identify_evidence(truth.nominal, points, motion, terms="some")
    with pytest.raises(IdentificationError, match="stops"):
        identify_evidence(truth.nominal, points, Motion(motion.q[:5]))
    with pytest.raises(IdentificationError, match="at least 3"):
        identify_evidence(truth.nominal, points.select(np.arange(20) < 2), motion.select(slice(0, 2)))
    with pytest.raises(IdentificationError, match="unknown target"):
        identify_evidence(truth.nominal, points, motion, gear_scan=False).predict(motion.q, None, "smr9")


def test_joints_outside_the_ranges_of_the_fit_are_marked():
    truth = Truth(["gravity"])
    motion = Motion(0.3 * truth.nominal.random_joints(40, 3))
    found = identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion, gear_scan=False)
    q = np.array([motion.q[0], motion.q[0] + np.array([0, 0, 0, 3.0, 0, 0])])
    np.testing.assert_array_equal(found.predict(q).outside, [False, True])


# --- real robots: figures of an independent calculation -----------------------------------------------------


class Measured:
    """Clean poses of a real robot with programmed joints and last moves."""

    def __init__(self, model, points, motion):
        self.model, self.points, self.motion = model, points, motion

    def first(self, n, **options):
        rows = np.arange(self.points.poses) < n
        return identify_evidence(self.model, self.points.select(rows), self.motion.select(rows), **options)

    def heldout(self, found, n):
        """Mean and largest error (mm) and coverage of the interval on the poses after the first n."""
        rows = np.arange(self.points.poses) >= n
        points, motion = self.points.select(rows), self.motion.select(rows)
        errors, inside = [], []
        for k, name in enumerate(points.target_names):
            mine = points.target == k
            q = motion.q[points.pose[mine]]
            seen = found.predict(q, q - motion.moves[points.pose[mine]], name)
            errors.append(np.linalg.norm(points.xyz[mine] - seen.position, axis=1) / MM)
            inside.append(np.abs(points.xyz[mine] - seen.position) < seen.interval)
        error = np.concatenate(errors)
        return error.mean(), error.max(), np.concatenate(inside).mean()


def irb120(shared_data, joints="c"):
    seen = table.read(shared_data / "irb120_laser_tracker" / "measurements_with_commands.csv")
    first = seen.table.groupby("pose_index", sort=True).first()
    q = np.radians(first[[f"{joints}{i}_deg" for i in range(1, 7)]].to_numpy(dtype=float))
    cleaned = cleaning.clean(seen)
    row = pd.Index(first["pose"]).get_indexer(cleaned.points.pose_ids)
    keep = cleaned.registration.own[row]
    motion = Motion.in_order(q, readings=joints == "q").select(row[keep])
    points = replace(cleaned.points, q=q[row]).select(keep)
    return Measured(urdf.read("irb120").arm, points, motion)


@pytest.fixture(scope="module")
def irb120_commands(shared_data):
    return irb120(shared_data)


CHECKED = {  # families of a dictionary: columns, log evidence, sigma and leave-one-out error in mm
    "geometry": (45, 221.3, 0.1358, 0.258),
    "gravity, gain": (81, 766.9, 0.0452, 0.0844),
    "harmonics to 2": (178, 797.0, 0.0397, 0.0770),
    "move": (196, 805.7, 0.0382, 0.0754),
    "warm-up": (232, 893.9, 0.0303, 0.0629),
    "wobble": (352, 919.2, 0.0262, 0.0562),
}


def test_log_evidences_of_an_irb120(irb120_commands):
    found = irb120_commands.first(200, terms="all", gear_scan=False)
    rows = {row.terms: row for row in found.dictionaries}
    for columns, value, sigma, loo in CHECKED.values():
        assert rows[columns].log_evidence == pytest.approx(value, abs=6.0)
        if rows[columns].weight:
            assert rows[columns].sigma / MM == pytest.approx(sigma, rel=0.03)
            assert rows[columns].loo / MM == pytest.approx(loo, rel=0.03)
    assert rows[352].weight == pytest.approx(0.92, abs=0.05)
    assert rows[232].weight == pytest.approx(0.07, abs=0.05)
    found = irb120_commands.first(200, terms="joint-map", gear_scan=False)
    rows = {row.terms: row for row in found.dictionaries}
    assert rows[159].log_evidence == pytest.approx(855.9, abs=4.0)
    assert rows[159].sigma / MM == pytest.approx(0.0356, rel=0.02)
    assert rows[159].loo / MM == pytest.approx(0.0700, rel=0.02)
    assert rows[159].weight == pytest.approx(0.98, abs=0.02)


HELDOUT = {  # terms, poses, gears: mean and largest error in mm on the rest of the file
    ("all", 200, False): (0.0556, 0.251),
    ("all", 200, True): (0.0473, 0.26),
    ("joint-map", 200, False): (0.0695, 0.241),
    ("joint-map", 200, True): (0.0638, 0.233),
    ("all", 45, False): (0.125, 0.54),
    ("joint-map", 45, False): (0.130, 0.54),
    ("all", 400, False): (0.0454, 0.13),
    ("joint-map", 400, False): (0.0595, 0.17),
}


@pytest.mark.parametrize(("terms", "poses", "gears"), HELDOUT)
def test_held_out_errors_of_an_irb120(irb120_commands, terms, poses, gears):
    found = irb120_commands.first(poses, terms=terms, gear_scan=gears)
    mean, largest, inside = irb120_commands.heldout(found, poses)
    expected = HELDOUT[terms, poses, gears]
    assert mean < 1.05 * expected[0]
    assert largest < 1.1 * expected[1]
    if poses >= 200:
        assert 0.93 < inside < 0.985


def test_readings_of_an_irb120(shared_data, irb120_commands):
    read = irb120(shared_data, "q")
    found = read.first(200, terms="all", gear_scan=False)
    assert found.readings_projected
    assert found.readings_gain > 4.0
    mean, largest, _ = irb120_commands.heldout(found, 200)
    assert mean < 0.082  # at programmed joints, which it has never seen
    assert largest < 0.25


@pytest.mark.parametrize(("group", "mean", "largest"), [("random", 0.124, 1.37), ("grid", 0.178, 1.85)])
def test_held_out_errors_of_a_ur10(shared_data, tmp_path, group, mean, largest):
    rows = pd.read_csv(shared_data / "ur10_laser_tracker_6d" / "measurements.csv", dtype=str)
    rows[rows["group"] == group].to_csv(tmp_path / "ur10.csv", index=False)
    points = replace(cleaning.clean(table.read(tmp_path / "ur10.csv")).points, rotation=None)
    model = urdf.read(example_robot("ur_description/urdf/ur10_robot.urdf")).arm
    data = Measured(model, points, Motion.in_order(points.q))
    found = data.first(300, gear_scan=False)
    error = data.heldout(found, 300)
    assert error[0] < 1.05 * mean
    assert error[1] < largest
    assert error[2] > 0.9
