"""Behaviour of single joints: a circle by hand, simulated truth many times over, and two real arms."""

from dataclasses import replace

import numpy as np
import pytest
from support import TARGETS, arm, measured

from irbcal.errors import IdentificationError, IrbcalError
from irbcal.joint_behaviour import behaviour
from irbcal.joint_behaviour.moves import analyse_moves
from irbcal.joint_behaviour.residuals import analyse_residuals
from irbcal.measurement import table
from irbcal.measurement.last_moves import last_moves
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap, Stiffness
from irbcal.modeling.robot import Robot

BACKLASH = np.radians(0.05)
SERIES = np.array([-0.000373, -0.000750, -0.000956, -0.000244])
"""Backlash of joint 6 and the coefficients of its series in radians (Nubiola 2011, section 4.2 and Table 5.2)."""


def there_and_back(low, high, step):
    up = np.radians(np.arange(low, high + step / 2, step))
    return np.r_[up, up[::-1]]


def moves(joint, angles, home=(0, 0, 0, 0, 30, 0)):
    """Commands (n, 6) in which one joint moves, counted from 1."""
    q = np.tile(np.radians(np.array(home, dtype=float)), (len(angles), 1))
    q[:, joint - 1] = angles
    return q


def simulated(commands, groups=None, backlash=0.0, per_move=0.0, noise=0.0, rng=None, **joint_map):
    """Points of a robot whose joints lag and bend; returns the points, their last moves and the robot without all that."""
    nominal = arm("irb1600")
    robot = Robot(nominal, JointMap(**joint_map), frames.transform(frames.rot_z(2.0), [3.0, -1.0, 0.5]), TARGETS)
    step = last_moves(commands, groups)
    known = np.nan_to_num(step)
    effective = robot.joint_map.effective(commands) - 0.5 * np.sign(known) * backlash + known * per_move
    points = measured(robot.replace(joint_map=JointMap()), effective, noise, rng, groups)
    return replace(points, q=commands), step, robot.replace(joint_map=JointMap())


# --- one-joint moves -------------------------------------------------------------------------------------


def test_a_circle_by_hand():
    # one reflector at 0, 90, 180, 270 degrees and back; 2 um outwards and inwards in turn, 3 um up and down in turn,
    # 40 urad behind the command on the way up, ahead on the way back: none of it bends a circle through all points
    angle = np.radians([0, 90, 180, 270, 270, 180, 90, 0])
    turn = np.array([1, -1, 1, -1, -1, 1, -1, 1])
    actual = angle + 40e-6 * np.array([-1, -1, -1, -1, -1, 1, 1, 1])
    actual[4] = angle[4] - 40e-6  # measured twice at the top: still reached from below
    radius = 0.5 + 2e-6 * turn
    xyz = np.column_stack([radius * np.cos(actual), radius * np.sin(actual), 1.0 + 3e-6 * turn])
    q = moves(3, angle)
    points = PointSet(q, np.arange(8), np.zeros(8, int), xyz, ("smr",), np.arange(8), np.full(8, "axis3", object))
    (joint,) = analyse_moves(points, last_moves(q, points.groups))
    (series,) = joint.series
    assert series.direction.tolist() == [0, 1, 1, 1, 1, -1, -1, -1]
    assert np.abs(series.radial - 2e-6 * turn).max() < 1e-9
    assert np.abs(series.axial - 3e-6 * turn).max() < 1e-9
    assert np.abs(series.angle - 40e-6 * np.array([-1, -1, -1, -1, -1, 1, 1, 1])).max() < 2e-8
    assert np.abs(series.tangential - 0.5 * series.angle).max() < 1e-9
    assert series.zero == 0.0
    # the top was reached from below only, the start from above and from nobody knows where: two angles are not enough
    assert joint.backlash.note == "2 joint angles were reached from both sides, 3 are needed"
    assert joint.fourier.note == "4 joint angles are too few for order 2: 8 are needed"


def test_the_last_move_is_kept_while_a_joint_stands_still():
    q = np.radians([[0.0, 5.0], [10.0, 5.0], [10.0, 5.001], [10.0, 2.0], [4.0, 2.0]])
    assert np.degrees(last_moves(q)[1:]) == pytest.approx(
        np.array([[10.0, np.nan], [10.0, np.nan], [10.0, -3.001], [-6.0, -3.001]]), abs=1e-12, nan_ok=True
    )
    groups = np.array(["a", "a", "b", "b", "b"], object)
    assert np.isnan(last_moves(q, groups)[[0, 2]]).all()
    assert np.isfinite(last_moves(q, groups)[4]).all()


def test_joint_6_of_the_thesis_is_found_within_its_intervals():
    q = moves(6, there_and_back(-400, 400, 20))
    groups = np.full(len(q), "axis6", object)
    backlash = BACKLASH * np.eye(6)[5]
    truth = dict(zip(("a1", "b1", "a2", "b2"), SERIES, strict=True))
    inside, widths = [], []
    for seed in range(40):
        points, step, _ = simulated(q, groups, backlash, noise=2e-5, rng=np.random.default_rng(seed), fourier=SERIES)
        (joint,) = analyse_moves(points, step)
        inside.append([joint.backlash.low[0] < BACKLASH < joint.backlash.high[0]])
        inside[-1] += [
            low < truth[n] < high
            for n, low, high in zip(joint.fourier.names, joint.fourier.low, joint.fourier.high, strict=True)
        ]
        widths.append(joint.fourier.high[0] - joint.fourier.low[0])
        assert joint.backlash.verdict == joint.fourier.verdict == "worth it"
        assert joint.gain.verdict == "not seen"
    # 200 intervals at 95 %: fewer than 180 inside would be a chance of 1 in 500 if they were independent
    assert 180 <= np.sum(inside) <= 199
    assert np.mean(inside, axis=0).min() > 0.8
    # a noise of 20 um on three targets 120 mm from the axis, known 40 times over: some 15 urad, the circle's centre included
    assert 5e-6 < np.mean(widths) < 8e-5


def test_a_free_frequency_is_found():
    q = moves(6, there_and_back(-400, 400, 20))
    groups = np.full(len(q), "axis6", object)
    inside = []
    for seed in range(8):
        points, step, _ = simulated(q, groups, noise=2e-5, rng=np.random.default_rng(seed), fourier=SERIES)
        found, low, high = analyse_moves(points, step, frequency=None)[0].fourier.frequency
        assert abs(found - 1.0) < 0.02
        assert high - low < 0.04
        inside.append(low < 1.0 < high)
    assert sum(inside) >= 6


def test_no_false_alarm_from_joints_that_only_turn():
    parts = [moves(k, there_and_back(-90, 90, 15)) for k in range(1, 7)]
    q = np.concatenate(parts)
    groups = np.repeat(np.array([f"axis{k}" for k in range(1, 7)], object), [len(p) for p in parts])
    alarms = {"backlash": 0, "gain": 0, "fourier": 0, "gravity": 0}
    for seed in range(12):
        points, step, _ = simulated(q, groups, noise=2e-5, rng=np.random.default_rng(seed))
        found = analyse_moves(points, step)
        for kind in alarms:
            alarms[kind] += any(
                term.verdict != "not seen" for joint in found for term in joint.terms if term.kind == kind
            )
    # each kind is wrong once in twenty files at most, whatever the number of joints
    assert max(alarms.values()) <= 2
    assert sum(alarms.values()) <= 5
    # and joint 1, whose circles are short and far off, is not the exception
    assert len(found) == 6


def test_bending_has_one_period_a_turn_and_depends_on_the_elbow():
    elbows = (30, 0, -30, -60, -90)
    parts = [moves(2, there_and_back(-50, 50, 5), (0, 0, elbow, 0, 10, 0)) for elbow in elbows]
    groups = np.full(sum(map(len, parts)), "axis2", object)
    stiffness = Stiffness.guess(0.7, 0.6).coefficients
    points, step, robot = simulated(
        np.concatenate(parts), groups, noise=1e-5, rng=np.random.default_rng(1), stiffness=stiffness
    )
    (joint,) = analyse_moves(points, step)
    assert [round(np.degrees(s.q[0, 2])) for s in joint.series] == list(elbows)
    assert joint.gravity.verdict == "worth it"
    assert joint.gravity.rms_with < 1.5e-5
    # one series for all elbows cannot explain what depends on the elbow
    assert joint.fourier.rms_with > 3 * joint.gravity.rms_with
    # the model's curves, evaluated like measured points, are what was measured
    for series in joint.series:
        curve = behaviour.predicted_series(series, robot, stiffness)
        assert np.abs(curve - series.angle).max() < 6e-5
        assert np.ptp(curve) > 3e-4


def test_stiffness_as_one_angle():
    L_1, L_2 = 0.7, 0.6

    def wrist(q2, q3):
        return L_1 * np.exp(1j * q2) + L_2 * np.exp(1j * (q2 + q3 + np.pi / 2))

    for guess in (Stiffness.guess(L_1, L_2), Stiffness(1.8e-3, 0.3, 0.9, 2.0, L_1, L_2)):
        A, B = guess.coefficients
        # stretched, all the way down: eq. 5.16
        found = behaviour.equivalent_error([np.pi / 2], -np.pi / 2, (A, B), (0, np.pi / 2), (L_1, L_2))
        assert np.sin(found[0]) * (L_1 + L_2) == pytest.approx(guess.delta_L, rel=1e-5)
        # any elbow: the wrist of a plane arm with both joints bent, moved along its circle about joint 2
        for elbow in np.radians([30, 0, -60]):
            q2 = np.radians([-70.0, 25.0, 50.0])

            bent_3 = B * np.cos(q2 + elbow)
            at_zero_3 = B * np.cos(elbow)
            bent = wrist(q2 + A * np.sin(q2) + bent_3, elbow + bent_3) / wrist(q2, elbow)
            at_zero = wrist(at_zero_3, elbow + at_zero_3) / wrist(0.0, elbow)
            expected = np.angle(bent / at_zero)
            found = behaviour.equivalent_error(q2, elbow, (A, B), (0, np.pi / 2), (L_1, L_2))
            assert found == pytest.approx(expected, abs=3e-6)


# --- residuals -------------------------------------------------------------------------------------------


def random_commands(n, seed):
    nominal = arm("irb1600")
    return nominal.random_joints(n, seed) * 0.6


def test_backlash_and_stiffness_are_found_within_their_intervals():
    backlash = np.radians([0.02, 0.0, 0.015, 0.0, 0.02, 0.05])
    A, B = np.radians([0.043, 0.019])
    inside, stiff = [], []
    for seed in range(6):
        points, step, robot = simulated(
            random_commands(70, seed),
            None,
            backlash,
            noise=5e-5,
            rng=np.random.default_rng(seed),
            stiffness=(A, B),
            fourier=SERIES,
        )
        found = analyse_residuals(robot.replace(joint_map=JointMap(stiffness=(A, B), fourier=SERIES)), points, step)
        for j, term in found.of("backlash").items():
            inside.append(term.low[0] < backlash[j - 1] < term.high[0])
        term = found.of("stiffness")[None]
        stiff += [low < value < high for value, low, high in zip((A, B), term.low, term.high, strict=True)]
        assert found.of("backlash")[6].verdict == term.verdict == found.of("fourier")[6].verdict == "worth it"
        assert ("stiffness", None) in [(s.kind, s.joint) for s in found.needed]
        # an effect of the direction is not taken for one of the size of the moves
        assert not {s.kind for s in found.needed} & {"move", "gain"}
    # 36 and 12 intervals of 95 %
    assert sum(inside) >= 31
    assert sum(stiff) >= 10


def test_clean_residuals_raise_no_alarm():
    alarms = 0
    for seed in range(4):
        points, step, robot = simulated(random_commands(60, seed), noise=5e-5, rng=np.random.default_rng(seed))
        found = analyse_residuals(robot, points, step)
        alarms += sum(term.verdict == "worth it" for term in found.terms)
        assert found.needed == ()
        assert len(found.terms) == 6 + 6 + 6 + 6 + 1
        assert "needs no term beyond geometry" in behaviour.verdict(behaviour.Report("", True, [], found, [], []))[-1]
    assert alarms <= 1


def test_a_lag_is_told_from_play():
    lag = np.array([5e-4, 0, 0, 0, 0, 0])
    points, step, robot = simulated(random_commands(90, 2), per_move=lag, noise=5e-5, rng=np.random.default_rng(2))
    found = analyse_residuals(robot, points, step)
    # the direction alone seems to matter, and in the sense that play does not have
    assert found.of("backlash")[1].high[0] < 0
    assert found.approach["size"] < 0.5 * found.approach["direction"]
    term = found.of("move")[1]
    assert term.low[0] < lag[0] < term.high[0]
    assert [(s.kind, s.joint) for s in found.needed] == [("move", 1)]
    words = " ".join(behaviour.verdict(behaviour.Report("", True, [], found, [], [])))
    assert "a lag does" in words
    assert "BEYOND" in words


def test_what_left_out_poses_say_agrees_with_leaving_them_out():
    # 30 poses: the errors of poses left out, by the hat matrix, against as many fits by brute force
    from irbcal.joint_behaviour.residuals import Linearised

    points, step, robot = simulated(
        random_commands(30, 4), None, np.radians([0.05, 0, 0, 0, 0, 0]), noise=1e-4, rng=np.random.default_rng(4)
    )
    model = Linearised(robot, points, step)
    X = -0.5 * model.per_joint(np.sign(step))[:, :1]
    found = model.test(X)
    design = np.hstack([model.basis(), X])
    errors, estimates = np.empty_like(model.r), []
    for pose in range(30):
        out = model.flat_pose == pose
        solution = np.linalg.lstsq(design[~out], model.r[~out], rcond=None)[0]
        errors[out] = model.r[out] - design[out] @ solution
        estimates.append(solution[-1])
    assert found.after == pytest.approx(model.size(errors), rel=1e-9)
    jackknife = 29 / 30 * np.sum((np.array(estimates) - found.beta[0]) ** 2)
    assert found.C[0, 0] == pytest.approx(jackknife, rel=1e-9)


# --- refusals --------------------------------------------------------------------------------------------


def refusal(function, *arguments, **options):
    with pytest.raises(IrbcalError) as caught:
        function(*arguments, **options)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_refusals_are_one_sentence():
    q = random_commands(20, 0)
    points, step, robot = simulated(q)
    assert "no one-joint moves in a group axis1, axis2, …; found no groups" in refusal(analyse_moves, points, step)
    grouped = replace(points, groups=np.full(20, "axis4", object))
    assert refusal(analyse_moves, grouped, step).startswith("group axis4: joint 6 moves by 255 degrees")
    assert "in a group axis2; found axis4" in refusal(analyse_moves, grouped, step, 2)
    ninth = replace(points, groups=np.full(20, "axis9", object))
    assert refusal(analyse_moves, ninth, step) == "group axis9: there are only 6 joints"
    assert refusal(analyse_residuals, robot, points, step, 7) == "there is no joint 7: irb1600_6_145 has 6"
    other = robot.replace(targets={name: 3 * np.array(place) for name, place in TARGETS.items()})
    assert "not measured on this robot with this tool" in refusal(analyse_residuals, other, points, step)
    few = points.select(np.arange(20) < 5)
    assert "5 poses are too few" in refusal(analyse_residuals, robot, few, step[:5])


def test_a_point_far_from_its_circle_is_left_out_and_named():
    q = moves(5, there_and_back(-90, 90, 15))
    points, step, _ = simulated(q, np.full(len(q), "axis5", object), noise=1e-5, rng=np.random.default_rng(3))
    xyz = points.xyz.copy()
    xyz[10] += [0.0, 0.004, 0.003]
    (joint,) = analyse_moves(replace(points, xyz=xyz), step)
    ((pose, target, off),) = joint.series[0].excluded
    assert (pose, target) == ("3", "smr2")
    assert off > 1e-3
    assert joint.series[0].fit.rms < 3e-5


# --- real arms -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def irb120(shared_data):
    """A real IRB 120 in random poses, and the report on its joints."""
    seen = table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")
    return seen, behaviour.analyse(seen, arm("irb120"))


def test_the_direction_of_approach_shows_on_a_real_arm(irb120):
    found = irb120[1].residuals
    plays = found.of("backlash")
    low, high = np.degrees(plays[1].low[0]), np.degrees(plays[1].high[0])
    assert -0.08 < low < high < -0.05
    assert plays[1].verdict == "worth it"
    assert sum(term.high[0] < 0 for term in plays.values()) >= 3
    # each half of the poses says so by itself
    assert (np.degrees(found.halves[:3]) < -0.015).all()
    assert (found.halves_p > 0.005).all()
    # it grows with the moves of joints 1 to 3, about alike, and explains a quarter of what is left
    lag = [found.of("move")[j] for j in (1, 2, 3)]
    assert all(3e-4 < term.values[0] < 6e-4 and term.low[0] > 2e-4 for term in lag)
    assert found.approach["size"] < 0.75 * found.approach["neither"]
    assert [(s.kind, s.joint) for s in found.needed][:2] == [("stiffness", None), ("move", 1)]


def test_directions_of_other_poses_show_nothing_on_a_real_arm(irb120):
    found = irb120[1].residuals
    # the move that follows a pose cannot act on it
    step = np.r_[found.step[1:], found.step[:1]]
    wrong = analyse_residuals(found.robot, found.points, step, joint=1)
    assert wrong.of("backlash")[1].verdict == "not seen"
    assert wrong.of("move")[1].verdict == "not seen"
    assert wrong.approach["direction"] > 0.99 * wrong.approach["neither"]
    assert {s.kind for s in wrong.needed} <= {"stiffness", "gain"}


def test_what_is_said_is_what_was_found(irb120):
    report = irb120[1]
    plain = behaviour.as_dict(report)
    first = next(t for t in plain["residuals"]["terms"] if t["kind"] == "backlash" and t["joint"] == 1)
    value = first["values"]["backlash"]
    assert value["value"] == pytest.approx(np.degrees(report.residuals.of("backlash")[1].values[0]))
    half = (value["high"] - value["low"]) / 2
    assert any(f"backlash joint 1: {value['value']:.4f} ± {half:.4f} degrees" in line for line in plain["verdict"])
    assert plain["verdict"][-1].startswith("This robot needs, the most important first: arm stiffness (0.4")
    assert len(plain["excluded"]) == 33
    assert plain["excluded"][0]["pose"] == "21"


def test_one_joint_moves_of_a_real_arm(shared_data):
    seen = table.read(shared_data / "fanuc_r2000_axis_by_axis" / "measurements.csv")
    report = behaviour.analyse(seen, order=1)
    assert [joint.joint for joint in report.moves] == [1, 2, 3, 4, 5, 6]
    for joint in report.moves:
        (series,) = joint.series
        assert 5e-6 < np.sqrt(np.mean(series.radial**2)) < 5e-5
        assert 5e-6 < np.sqrt(np.mean(series.axial**2)) < 5e-5
        assert joint.backlash.note.startswith("no joint angle was reached from both sides")
    # -360 and 360 degrees are one place: the angular errors there differ by what the raw points are apart
    raw = seen.table.set_index(["group", "q4_deg", "target"]).sort_index()
    (series,) = report.moves[3].series
    radius = dict(zip(series.fit.targets, series.fit.radii, strict=True))
    for t, name in enumerate(series.points.target_names):
        ends = [
            raw.loc[("axis4", angle, name), ["x_mm", "y_mm", "z_mm"]].to_numpy(float).ravel() for angle in (-360, 360)
        ]
        if t in radius and radius[t] > 0.1:
            apart = np.linalg.norm(ends[0] - ends[1]) * 1e-3
            assert apart == pytest.approx(radius[t] * abs(series.angle[0] - series.angle[-1]), abs=6e-5)
    assert report.moves[3].fourier.verdict == "worth it"


def test_a_file_without_one_joint_moves_needs_a_robot(tmp_path):
    from support import write_measurements

    points, _, _ = simulated(random_commands(4, 0))
    seen = table.read(write_measurements(tmp_path / "random.csv", points))
    assert refusal(behaviour.analyse, seen).endswith(
        "random.csv: there are no one-joint moves (column group: axis1, axis2, …); for other poses a robot or a "
        "calibration is needed"
    )
    with pytest.raises(IdentificationError, match=r"random\.csv: "):
        behaviour.analyse(seen, arm("irb1600"))
