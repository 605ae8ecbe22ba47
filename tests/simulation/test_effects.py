"""Effects of the virtual cell: each against its formula in plain numpy, and all together."""

import numpy as np
import pytest
from thesis_formula import ThesisMap

import irbcal
from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.modeling import frames
from irbcal.simulation import effects
from irbcal.simulation.effects import ALL, EFFECTS, MORE, ReadingLagEffect, Stops, fitted
from irbcal.simulation.virtual_cell import directions
from irbcal.units import DEG, MM

GRAVITY = np.array([0.0, 0.0, -9.81])


def links(arm, theta, xi):
    """Frame of each joint before it turns and of each link (joints, 4, 4), and the tip, by 4x4 matrices at one pose."""
    T, row, before, after = arm.T_base_0, arm.table, [], []
    for j, angle in enumerate(theta):
        T = T @ frames.transform(frames.rot_x(row.alpha[j])) @ frames.transform(translation=[row.a[j], 0, 0])
        T = T @ frames.transform(rot_y(row.beta[j])) @ frames.transform(translation=[0, row.b[j], 0])
        before.append(T)
        T = T @ frames.transform(frames.rotation_from_vector(xi[j, :3]), xi[j, 3:])
        T = T @ frames.transform(frames.rot_z(row.theta[j] + angle), [0, 0, 0])
        T = T @ frames.transform(translation=[0, 0, row.d[j]])
        after.append(T)
    return np.array(before), np.array(after), T @ arm.T_last_tip


def rot_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def torque(cell, q, j, axis):
    """Gravity torque about an axis of joint j's frame before it turns, N m: masses, levers and weights by hand."""
    before, after, tip = links(cell.true_arm(), q, np.zeros((6, 6)))
    total = np.zeros(3)
    for k in range(j, 6):
        centre = frames.apply(after[k], cell.bodies.centre[k])
        total += np.cross(centre - before[j, :3, 3], cell.bodies.mass[k] * GRAVITY)
    load = frames.apply(tip, cell.tool.payload_centre)
    total += np.cross(load - before[j, :3, 3], cell.tool.payload_kg * GRAVITY)
    return before[j, :3, axis] @ total


def formula(name, cell, q, move, minutes):
    """What an effect adds to the joints (6,) and to the frames (6, 6) at one stop, from its own numbers alone."""
    part = next(effect for effect in cell.effects if effect.name == name)
    joints, xi = np.zeros(6), np.zeros((6, 6))
    if name == "compliance":
        joints = np.array([part.rad_per_Nm[j] * torque(cell, q, j, 2) for j in range(6)])
    elif name == "bending":
        for j in range(6):
            xi[j, :2] = [part.x_rad_per_Nm[j] * torque(cell, q, j, 0), part.y_rad_per_Nm[j] * torque(cell, q, j, 1)]
    elif name == "harmonics":
        for joint, periods, amplitude, phase in part.waves:
            j = joint - 1 if joint > 0 else joint
            joints[j] += amplitude * DEG * np.sin(periods * q[j] + phase * DEG)
    elif name == "gear":
        for joint, ratio, amplitude, phase in part.waves:
            joints[joint] += amplitude * DEG * np.sin(2 * ratio * q[joint] + phase * DEG)
    elif name == "wobble":
        for joint, axis, periods, size, phase in part.waves:
            j, k = joint - 1 if joint > 0 else joint, ("rx", "ry", "rz", "tx", "ty", "tz").index(axis)
            xi[j, k] += size * (DEG if k < 3 else MM) * np.sin(periods * q[j] + phase * DEG)
    elif name == "direction":
        joints = np.array(part.size_deg) * DEG * np.tanh(move / (0.5 * DEG))
    elif name == "move":
        joints = np.array(part.size_deg) * DEG * move / np.abs(move).max() + np.array(part.share) * move
    elif name == "thaw":
        drifts = [np.array(getattr(part, f"{axis}_deg")) * DEG for axis in "xyz"]
        drifts += [np.array(getattr(part, f"{axis}_mm")) * MM for axis in "xyz"]
        xi = np.exp(-minutes / part.tau_min) * np.array(drifts).T
        joints, xi[:, 2] = xi[:, 2].copy(), 0.0
    elif name == "warm_up":
        joints[1:3] = np.exp(-(minutes + part.before_min) / part.tau_min) * np.array(part.joint_deg) * DEG
    return joints, xi


@pytest.mark.parametrize(
    "name", ["compliance", "bending", "harmonics", "gear", "wobble", "direction", "move", "thaw", "warm_up", "tilt"]
)
def test_each_effect_is_its_formula(cell, q, name):
    """Tips to 1e-12 m; the thesis's joint map and the link errors are there in all."""
    q = q[:25]
    alone = cell.also(name).only(name)
    level = ThesisMap.from_joint_map(cell.joint_map if name == "compliance" else cell.true_joint_map()).effective(q)
    asked = np.ones((len(q), len(cell.tool.names) + len(cell.references)), dtype=bool)
    minutes = alone._times(q, np.zeros(6), np.full(len(q), 4.0), asked)[0] / 60
    moves = np.diff(q, axis=0, prepend=np.zeros((1, 6)))
    found = alone.measure(q).T_base_tip
    for k, pose in enumerate(q):
        joints, xi = formula(name, alone, pose, moves[k], minutes[k])
        T = links(alone.true_arm(), level[k] + joints, xi)[2]
        if name == "warm_up":  # the whole robot is smaller
            part = alone.effects[0]
            T[:3, 3] *= 1.0 - part.growth * np.exp(-(minutes[k] + part.before_min) / part.tau_min)
        np.testing.assert_allclose(found[k, :3, 3], T[:3, 3], rtol=0, atol=1e-12)
        np.testing.assert_allclose(found[k, :3, :3], T[:3, :3], rtol=0, atol=1e-12)
    if name == "tilt":
        assert alone.true_arm().table.beta[2] == pytest.approx(0.014 * DEG)
    away = np.linalg.norm(found[:, :3, 3] - cell.only().measure(q).T_base_tip[:, :3, 3], axis=1)
    assert away.max() > 4e-6  # and it does something


def test_the_terms_that_the_cell_tells_are_what_it_does(cell, q):
    """Another sum of the same terms, with the attitudes of the nominal arm: a ten-thousandth of the effects apart."""
    from irbcal.modeling.terms.situation import Motion
    from irbcal.modeling.terms.term_map import TermMap

    q = q[:40]
    for part in (cell.without("repeatability", "backlash", "settling"), cell.also("bending", "thaw", "gear").only()):
        amounts = [pair for pair in part.terms().values() if pair[0].basis != "constant"]
        asked = np.ones((len(q), len(cell.tool.names) + len(cell.references)), dtype=bool)
        minutes = part._times(q, np.zeros(6), np.full(len(q), 4.0), asked)[0] / 60
        motion = Motion(q, np.diff(q, axis=0, prepend=np.zeros((1, 6))), minutes)
        terms = TermMap(cell.arm, tuple(t for t, _ in amounts), np.array([v for _, v in amounts]))
        T = terms.forward(part.true_arm(), motion)
        assert np.abs(T - part.measure(q).T_base_tip)[:, :3, 3].max() < 2e-6
    assert cell.terms()["rx2 constant"][1] == pytest.approx(-0.0060 * DEG)


def change_of_joints(cell, effect, joints, wait_s=4.0):
    """What an effect adds to the effective joints, degrees."""
    joints = np.radians(np.atleast_2d(joints))
    n = len(joints)
    moves = np.diff(joints, axis=0, prepend=np.zeros((1, 6)))
    stops = Stops(joints, moves, directions(joints, np.zeros(6)), np.zeros(n), np.full(n, wait_s), np.zeros(6, bool))
    return effect.joints(stops, np.random.default_rng(0)) / DEG


def test_backlash_depends_on_where_each_joint_came_from(cell):
    # joint 1 rises, falls, stays, rises; joint 2 falls and stays; joint 3 never moves (counts as reached from below)
    joints = [[10, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [6, -5, 0, 0, 0, 0]]
    gap = effects.BacklashEffect(peak_to_peak_deg=(0.04, 0.02, 0.06, 0.0, 0.0, 0.0))
    found = change_of_joints(cell, gap, joints)
    np.testing.assert_allclose(found[:, 0], [-0.02, 0.02, 0.02, -0.02], atol=1e-15)
    np.testing.assert_allclose(found[:, 1], [0.01] * 4, atol=1e-15)
    np.testing.assert_allclose(found[:, 2], [-0.03] * 4, atol=1e-15)


def test_backlash_of_a_pose_reached_from_both_sides(cell):
    bare = cell.only("backlash").replace(table=cell.arm.table)
    there = np.radians([[0, 0, 0, 0, 0, 30.0], [0, 0, 0, 0, 0, 60.0], [0, 0, 0, 0, 0, 30.0]])
    run = bare.measure(there)
    turn = frames.rotation_distance(run.T_base_tip[0, :3, :3], run.T_base_tip[2, :3, :3])
    assert turn == pytest.approx(0.05 * DEG, rel=1e-9)  # section 4.2


def test_settling_follows_its_formula(cell):
    swing = effects.SettlingEffect(amplitude_deg=0.012, tau_s=0.4, frequency_Hz=8.0)
    found = change_of_joints(cell, swing, [[10.0, -10.0, 0, 0, 0, 0]], wait_s=0.5)
    expected = 0.012 * np.exp(-0.5 / 0.4) * np.cos(2 * np.pi * 8.0 * 0.5)
    np.testing.assert_allclose(found[0], [expected, -expected, expected, 0, 0, 0], atol=1e-15)
    assert np.abs(change_of_joints(cell, swing, [[10.0] * 6], wait_s=2.0)).max() < 0.012 / 100  # annex V


def test_repeatability_has_the_stated_sigmas(cell):
    part = effects.RepeatabilityEffect(sigma_deg=(0.001, 0.002, 0.003, 0.004, 0.005, 0.006))
    found = change_of_joints(cell, part, np.zeros((20_000, 6)))
    np.testing.assert_allclose(found.std(axis=0), part.sigma_deg, rtol=0.03)


def test_three_kilograms_bend_the_stretched_arm_as_table_4_3_says(cell):
    """Nubiola 2011, Table 4.3: 0.29 mm from 3 kg, 2.13 mm in all with 1.8 kg."""
    joints = np.radians([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
    bare = cell.only("compliance").replace(table=cell.arm.table)
    at_rest = cell.arm.forward(joints)[0, :3, 3]
    sag = [
        np.linalg.norm(bare.with_payload(load).measure(joints).T_base_tip[0, :3, 3] - at_rest) for load in (1.8, 4.8)
    ]
    assert sag[0] == pytest.approx(2.134 * MM, rel=0.15)
    assert sag[1] - sag[0] == pytest.approx(0.292 * MM, rel=0.15)


def test_tracker_noise_has_the_stated_sigmas_along_and_across_the_beam():
    noise = effects.NoiseEffect(range_um=2.0, range_um_per_m=0.5, across_um=3.0, across_um_per_m=2.0)
    beam = np.array([0.6, -0.64, 0.48])
    u = np.cross(beam, [0, 0, 1.0]) / np.linalg.norm(np.cross(beam, [0, 0, 1.0]))
    off = noise.points(np.tile(4.0 * beam, (40_000, 1, 1)), None, np.random.default_rng(1))[:, 0] - 4.0 * beam
    # 2 + 0.5 * 4 = 4 um along, 3 + 2 * 4 = 11 um across; 40,000 samples know a sigma to 0.35 %
    assert (off @ beam).std() == pytest.approx(4e-6, rel=0.02)
    for across in (u, np.cross(beam, u)):
        assert (off @ across).std() == pytest.approx(11e-6, rel=0.02)
    assert np.abs(off.mean(axis=0)).max() < 0.3e-6


def test_drift_moves_all_points_of_a_moment_as_one_body_and_references_take_it_out(cell):
    run = cell.only("drift").measure(np.zeros((400, 6)), wait_s=300.0)
    still = cell.only().measure(np.zeros((400, 6)), wait_s=300.0)
    moved = run.xyz - still.xyz
    assert 2e-6 < np.linalg.norm(moved, axis=2).mean() < 40e-6  # annex IV: 0.012 mm on average
    T = frames.rigid_fit(run.xyz, still.xyz)
    left = np.einsum("nij,nkj->nki", T[:, :3, :3], run.xyz) + T[:, None, :3, 3] - still.xyz
    # points of a pose are measured within 20 s: nearly at one moment
    assert np.abs(left).max() < 0.1e-6


def test_random_poses_are_seen_and_hidden_ones_are_lost_points(cell, q):
    seeing = cell.only("visibility")
    assert seeing.measure(q).unseen["visibility"] < 5  # the true robot stands a millimetre beside the nominal one
    anywhere = cell.arm.random_joints(500, seed=2)
    run = seeing.measure(anywhere)
    lost = np.isnan(run.xyz).any(axis=2)
    assert run.unseen["visibility"] == lost[:, :3].sum() > 1000
    assert not lost[:, 3:].any()
    # by the definition, from the truth: angle between where the reflector looks and the tracker
    T = run.T_base_tip
    p = np.einsum("nij,kj->nki", T[:, :3, :3], cell.tool.real) + T[:, None, :3, 3]
    look = np.einsum("nij,kj->nki", T[:, :3, :3], cell.tool.direction)
    beam = cell.tracker.position - p
    angle = np.degrees(np.arccos(np.sum(beam * look, axis=2) / np.linalg.norm(beam, axis=2)))
    assert (lost[:, :3] >= (angle > 30.0)).all()
    assert (lost[:, :3] & (angle < 30.0)).sum() < 0.4 * (angle < 30.0).sum()


def test_lost_points_are_as_many_as_stated(cell, q):
    run = cell.only("lost").with_effect(effects.LostEffect(share=0.05)).measure(np.tile(q, (20, 1)))
    assert run.unseen["lost"] == np.isnan(run.xyz[..., 0]).sum() == pytest.approx(0.05 * 6000 * 7, rel=0.1)


def test_it_is_off_unless_asked_for(cell, q):
    assert "reading_lag" not in cell.on
    assert cell.measure(q).readings is None
    assert set(ALL) == {*EFFECTS, *MORE}
    assert cell.also("reading_lag").on == (*cell.on, "reading_lag")
    assert cell.also("noise").on == cell.on
    assert cell.also("reading_lag").without("reading_lag").on == cell.on
    with pytest.raises(MeasurementError, match="unknown effect 'lag'"):
        cell.also("lag")


def test_the_arm_and_the_points_stay_as_they_were(cell, q):
    plain, lagging = cell.measure(q), cell.also("reading_lag").measure(q)
    np.testing.assert_array_equal(lagging.xyz, plain.xyz)
    np.testing.assert_array_equal(lagging.T_base_tip, plain.T_base_tip)
    np.testing.assert_array_equal(lagging.q, plain.q)
    again = cell.also("reading_lag").measure(q)
    np.testing.assert_array_equal(again.readings, lagging.readings)


def test_readings_are_behind_by_one_share_of_the_last_move(cell, q):
    exact = cell.with_effect(ReadingLagEffect(scatter_deg=0.0)).measure(q)
    move = np.diff(q, axis=0, prepend=np.zeros((1, 6)))
    share = (exact.q - exact.readings) / move
    np.testing.assert_allclose(share, share[:, :1] * np.ones(6), rtol=0, atol=1e-9)
    lag = np.degrees(share[:, 0] * np.abs(move).max(axis=1))
    assert share.min() >= 0
    assert np.median(lag) == pytest.approx(0.041, rel=0.12)
    low, high = np.percentile(lag, [25, 75])
    assert low == pytest.approx(0.0235, rel=0.2)
    assert high == pytest.approx(0.066, rel=0.2)


def test_no_reading_is_behind_the_stop_before(cell):
    still = np.zeros((20, 6))
    still[::2, 0] = 1e-6
    run = cell.with_effect(ReadingLagEffect(scatter_deg=0.0)).measure(still)
    assert run.readings.min() >= 0
    assert run.readings.max() <= 1e-6


def test_simulated_files_have_commands_beside_readings(tmp_path):
    plain = irbcal.simulate("irb1600", random=40, seed=5)
    lagging = irbcal.simulate("irb1600", random=40, seed=5, also=["reading_lag"])
    assert not any(name.startswith("c1") for name in plain.to_frame().columns)
    assert plain.to_frame()["x_mm"].equals(lagging.to_frame()["x_mm"])
    measured, truth = lagging.save(tmp_path / "m.csv")
    seen = table.read(measured)
    np.testing.assert_allclose(seen.joints(), lagging.poses.q, rtol=0, atol=1e-8)
    assert seen.reading_lag().before_standstill
    assert '"reading_lag"' in truth.read_text()
    alone = irbcal.simulate("irb1600", lagging.poses.q, only=["reading_lag"])
    assert alone.cell.on == ("reading_lag",)
    assert irbcal.simulate("irb1600", random=3, only=["noise"], also=["reading_lag"]).cell.on == (
        "noise",
        "reading_lag",
    )


def test_a_plan_with_programmed_joints_commands_them():
    made = irbcal.simulate("irb1600", random=10, also=["reading_lag"], targets=1).to_frame()
    rows = made[made["target"] == "smr1"]
    again = irbcal.simulate("irb1600", rows[["pose", *[n for n in made.columns if n[0] in "qc" and n[1].isdigit()]]])
    np.testing.assert_allclose(np.degrees(again.poses.q[:, 0]), rows["c1_deg"], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("prismatic", "expected"),
    [
        ([0] * 6, (1, 2, 3, 4, 5, 6)),
        ([0] * 7, (1, 2, 3, 3, 4, 5, 6)),
        ([1, 0, 0, 0, 0, 0, 0], (9, 1, 2, 3, 4, 5, 6)),
        ([0, 0], (5, 6)),
        ([1, 1, 1], (9, 9, 9)),
    ],
)
def test_values_of_six_joints_fit_any_arm(prismatic, expected):
    """The first ones from the base, the last three from the wrist."""
    assert fitted((1, 2, 3, 4, 5, 6), np.array(prismatic, dtype=bool), 9) == expected


@pytest.mark.parametrize("name", effects.EFFECT_NAMES)
def test_switching_one_effect_off_leaves_the_others_as_they_were(cell, q, name):
    """Effects are small: what one adds is the same with all others on or off, to second order."""
    unseeing = ("visibility", "lost")
    if name in unseeing:
        both, other, alone = (
            np.isnan(cell.only(*names).measure(cell.arm.random_joints(300, seed=2)).xyz[..., 0])
            for names in (unseeing, set(unseeing) - {name}, [name])
        )
        np.testing.assert_array_equal(both, other | alone)
        assert 0 < alone.sum() < both.sum()
        return
    everything = cell.without(*unseeing)
    added = everything.measure(q).xyz - everything.without(name).measure(q).xyz
    alone = cell.only(name).measure(q).xyz - cell.only().measure(q).xyz
    assert np.abs(alone).max() > (1e-10 if name == "settling" else 1e-6)
    assert np.abs(added - alone).max() < 2e-6
    if name == "noise":  # not even to second order: the same random numbers
        assert np.abs(added - alone).max() < 1e-8


def test_unknown_effects_and_targets_are_refused_with_the_names(cell):
    for call in (cell.only, cell.without):
        with pytest.raises(MeasurementError, match=r"unknown effect 'friction': effects are tilt, compliance,.* lost"):
            call("friction")
    with pytest.raises(MeasurementError, match="unknown target 'smr7': targets are smr1, smr2, smr3"):
        cell.with_targets(["smr7"])


def test_every_effect_says_what_it_is():
    assert len(set(effects.EFFECT_NAMES)) == len(effects.EFFECTS)
    for effect in effects.EFFECTS:
        assert effect.summary
        assert "section" in effect.summary or "annex" in effect.summary
        units = ("_deg", "_Nm", "_um", "_m", "_s", "_Hz", "_min", "_h", "_urad", "_mm", "waves", "growth", "share")
        assert all(name.endswith(units) for name in effect().parameters()), effect.name
