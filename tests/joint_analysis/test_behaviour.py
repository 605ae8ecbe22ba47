"""The behaviour of the joints as a result: sentences, numbers, files."""

import pickle
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from chart_data import given, texts
from moving import moves, random_commands, refusal, simulated, there_and_back
from support import arm, write_measurements

import irbcal
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.joint_analysis import behaviour, series, terms
from irbcal.joint_analysis.behaviour import JointBehaviour
from irbcal.joint_analysis.moves import analyse_moves
from irbcal.joint_analysis.residuals import analyse_residuals
from irbcal.joint_analysis.terms import JointTerm
from irbcal.measurement import table


@pytest.fixture(scope="module")
def irb120(shared_data):
    """A real IRB 120 in random poses, and the report on its joints."""
    seen = table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")
    return seen, behaviour.analyse(seen, arm("irb120"))


def test_what_is_said_is_what_was_found(irb120):
    report = irb120[1]
    plain = report.to_dict()
    first = next(t for t in plain["residuals"]["terms"] if t["kind"] == "backlash" and t["joint"] == 1)
    value = first["values"]["backlash"]
    assert value["value"] == pytest.approx(np.degrees(report.residuals.by_joint("backlash")[1].values[0]))
    half = (value["high"] - value["low"]) / 2
    assert any(f"backlash joint 1: {value['value']:.4f} ± {half:.4f} degrees" in line for line in plain["verdict"])
    assert plain["verdict"][-1].startswith("This robot needs, the most important first: ")
    assert "arm stiffness" in plain["verdict"][-1]
    assert len(plain["excluded"]) == 33
    assert plain["excluded"][0]["pose"] == "21"


def test_a_file_without_one_joint_moves_needs_a_robot(tmp_path):
    points, _, _ = simulated(random_commands(4, 0))
    seen = table.read(write_measurements(tmp_path / "random.csv", points))
    assert refusal(behaviour.analyse, seen).endswith(
        "random.csv: there are no one-joint moves (column group: axis1, axis2, …); for other poses a robot or a "
        "calibration is needed"
    )
    with pytest.raises(IdentificationError, match=r"random\.csv: "):
        behaviour.analyse(seen, arm("irb1600"))


@pytest.fixture(scope="module")
def random_file(tmp_path_factory):
    """Random poses of a robot with play in joint 6."""
    play = np.radians([0, 0, 0, 0, 0, 0.06])
    points, _, _ = simulated(random_commands(40, 0), None, play, noise=3e-5, rng=np.random.default_rng(0))
    return write_measurements(tmp_path_factory.mktemp("joints") / "random.csv", points)


def test_the_front_door_takes_files_and_measurements(random_file, tmp_path):
    steps = []
    found = behaviour.joints(random_file, robot="irb1600", plots=tmp_path / "figures", progress=steps.append)
    assert steps == ["reading the measurements", "analysing the joints", "drawing"]
    assert ("backlash", 6) in [(term.kind, term.joint) for term in found.residuals.needed]
    assert sorted(found.plots) == sorted(str(path) for path in (tmp_path / "figures").iterdir())
    assert sorted(found.plots) == sorted(str(tmp_path / "figures" / f"{name}.png") for name in found.figures)
    seen = table.read(random_file)
    again = behaviour.analyse(seen, arm("irb1600"))
    assert again.to_dict() | {"plots": list(found.plots)} == found.to_dict()
    assert behaviour.joints(random_file, robot=arm("irb1600")).to_dict() == again.to_dict()


def test_a_result_speaks_is_pickled_and_cannot_be_changed(random_file):
    found = behaviour.joints(random_file, robot="irb1600")
    assert repr(found).startswith("<JointBehaviour: This robot needs")
    for result in (found, found.residuals, *found.residuals.terms):
        assert len(repr(result)) < 2000
    assert "Verdict" in found.summary()
    assert "<table>" in found._repr_html_()
    assert pickle.loads(pickle.dumps(found)).to_dict() == found.to_dict()
    with pytest.raises(ValueError, match="read-only"):
        found.residuals.angle[0, 0] = 0.0


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"calibration": "here", "robot": "irb120"}, "give a calibration or a robot, not both"),
        ({"joint": 0}, "joint: expected a number from 1, found 0"),
        ({"order": 13}, "order: expected 1 to 12, found 13"),
        ({"frequency": "often"}, "frequency: expected free or a number of periods per turn above zero, found 'often'"),
        ({"frequency": 0.0}, "frequency: expected free or a number of periods per turn above zero, found 0.0"),
    ],
)
def test_options_that_there_are_not_are_refused_before_anything_is_read(options, sentence):
    with pytest.raises(OptionError) as caught:
        behaviour.joints("absent.csv", **options)
    assert str(caught.value) == sentence
    assert caught.value.parameter in (*options, "robot")


def test_refusals_name_their_file(random_file):
    with pytest.raises(MeasurementError) as caught:
        behaviour.joints(random_file)
    assert caught.value.file == str(random_file)
    with pytest.raises(IdentificationError) as caught:
        behaviour.joints(random_file, robot="irb120")
    assert caught.value.file == str(random_file)


def test_too_few_angles_of_one_joint_ask_for_a_robot(tmp_path):
    points, _, _ = simulated(random_commands(2, 0)[[0, 0, 0, 1]] * [1, 0, 0, 0, 0, 0], np.full(4, "axis1", object))
    write_measurements(tmp_path / "m.csv", points)
    seen = table.read(pd.read_csv(tmp_path / "m.csv").assign(group="axis1"))
    said = refusal(behaviour.analyse, seen)
    assert "group axis1: " in said
    assert said.endswith("give a robot or a calibration (--robot or --calibration)")


PLAY_6 = np.radians([0, 0, 0, 0, 0, 0.06])


@pytest.fixture(scope="module")
def by_moves():
    """Joint 6 with play, moved alone."""
    q = moves(6, there_and_back(-180, 180, 20))
    groups = np.full(len(q), "axis6", object)
    points, step, _ = simulated(q, groups, PLAY_6, noise=1e-5, rng=np.random.default_rng(0))
    return tuple(analyse_moves(points, step))


@pytest.fixture(scope="module")
def by_residuals():
    """The same joint in random poses."""
    points, step, robot = simulated(random_commands(60, 0), None, PLAY_6, noise=3e-5, rng=np.random.default_rng(0))
    return analyse_residuals(robot.arm, points, step)


def said(by_moves, by_residuals):
    return JointBehaviour("file", True, by_moves, by_residuals).verdict()


def test_two_sources_that_agree_are_named(by_moves, by_residuals):
    words = said(by_moves, by_residuals)
    assert any(line.startswith("by one-joint moves, backlash joint 6: 0.0") for line in words)
    assert any(line.startswith("backlash joint 6: 0.0") for line in words)
    assert not any("by the one-joint moves" in line for line in words)
    assert words[-1].startswith("This robot needs, the most important first: backlash of joint 6")
    alone = said(by_moves, None)
    assert alone[0].startswith("backlash joint 6: 0.0")
    assert alone[-1] == "This robot needs: backlash of joint 6."


def without_evidence(terms, kind):
    """The terms, those of a kind with nothing in their favour."""
    return tuple(replace(term, evidence=-1.0) if term.kind == kind else term for term in terms)


def test_two_sources_that_do_not_agree_say_so(by_moves, by_residuals):
    # the moves see play that the other poses do not need
    none = replace(by_residuals, terms=without_evidence(by_residuals.terms, "backlash"))
    words = said(by_moves, none)
    assert "backlash of joint 6: needed by the one-joint moves, not needed by any poses" in words[-2]
    assert words[-1].startswith("This robot needs no term beyond geometry")
    # and the other way round
    (joint,) = by_moves
    unseen = replace(joint, backlash=replace(joint.backlash, evidence=-1.0))
    words = said((unseen,), by_residuals)
    assert words[0].startswith("by one-joint moves, backlash joint 6: ")
    assert words[0].endswith(": not needed")
    assert "backlash of joint 6: needed by any poses, not needed by the one-joint moves" in words[-2]
    # what only one of the two has tested is no disagreement
    untested = tuple(replace(term, note="too few") if term.kind == "backlash" else term for term in by_residuals.terms)
    assert not any("backlash of joint 6: needed" in line for line in said(by_moves, replace(none, terms=untested)))


def test_without_any_test_nothing_is_known(by_moves):
    (joint,) = by_moves
    untested = {kind: replace(getattr(joint, kind), note="too few") for kind in ("backlash", "gain")}
    words = said((replace(joint, fourier=replace(joint.fourier, note="few"), **untested),), None)
    assert words[-1].startswith("What this robot needs is not known")
    assert "backlash of joint 6 not tested by one-joint moves: too few" in words


def one_by_one(home=(0.0, -10.0, 10.0, 0.0, 20.0, 0.0)):
    """A plan of there-and-back moves of each joint, degrees."""
    rows = []
    for joint, (low, high) in enumerate([(-140, 140), (-50, 88), (-140, 40), (-120, 120), (-80, 80), (-120, 120)]):
        up = np.linspace(low, high, 15)
        for value in (*up, *up[::-1]):
            q = list(home)
            q[joint] = value
            rows.append((str(len(rows) + 1), f"axis{joint + 1}", *q))
    return pd.DataFrame(rows, columns=["pose", "group", *(f"q{k}_deg" for k in range(1, 7))])


@pytest.mark.parametrize("seed", [0, 3, 9])
def test_weight_is_not_called_a_series_of_joint_3(seed):
    """SIMULATED: nothing but joints that give way under weight; moves alone cannot know more than a period a turn."""
    run = irbcal.simulate(
        "irb1600", one_by_one(), seed=seed, robot_seed=seed, only=["compliance", "repeatability", "noise"]
    )
    words = irbcal.joints(run.measurements()).to_dict()["verdict"]
    assert "bending under gravity of joint 2" in words[-1]
    assert "bending under gravity of joint 3" in words[-1]
    assert not any(f"Fourier series of order 2 of joint {k}" in words[-1] for k in (1, 2, 3))
    assert "may be bending under weight" in words[-2]
    assert "gravity of joint 2 (stands for gain error and Fourier series of order 2, too: " in words[-1]
    for joint in range(1, 7):
        assert not (
            any(f"backlash joint {joint}: " in w and w.endswith(": not needed") for w in words)
            and f"backlash of joint {joint}" in words[-1]
        )


@pytest.fixture(scope="module")
def both():
    play = np.radians([0, 0, 0.02, 0, 0, 0.06])
    q = moves(6, there_and_back(-180, 180, 20))
    points, step, _ = simulated(q, np.full(len(q), "axis6", object), play, noise=1e-5, rng=np.random.default_rng(0))
    some = analyse_moves(points, step)
    points, step, robot = simulated(random_commands(40, 0), None, play, noise=3e-5, rng=np.random.default_rng(0))
    return JointBehaviour("points.csv", False, tuple(some), analyse_residuals(robot.arm, points, step))


def test_error_size_by_hand():
    assert series.error_size([3e-3, -4e-3]) == pytest.approx({"rms_mm": np.sqrt(12.5), "max_mm": 4.0}, rel=1e-12)


def test_frame_tables_and_plain_values_say_the_same(both):
    frame, plain, (_, by_moves, by_residuals) = both.to_frame(), both.to_dict(), behaviour.tables(both)
    for source, plain_terms, shown in (
        ("moves", plain["moves"][0]["terms"], by_moves),
        ("residuals", plain["residuals"]["terms"], by_residuals),
    ):
        assert len(shown.rows) == len(plain_terms)
        for term, row in zip(plain_terms, shown.rows, strict=True):
            mine = frame[(frame["source"] == source) & (frame["kind"] == term["kind"])]
            mine = mine[mine["joint"].isna() if term["joint"] is None else mine["joint"] == term["joint"]]
            if term["note"]:
                assert mine["note"].tolist() == [term["note"]] == [row[2]]
                continue
            assert dict(zip(mine["name"], mine["value"], strict=True)) == pytest.approx(
                {name: value["value"] for name, value in term["values"].items()}, rel=1e-12
            )
            assert mine["log_evidence"].tolist() == pytest.approx([term["log_evidence"]] * len(mine), rel=1e-12)
            assert row[-1] == term["verdict"] == mine["verdict"].iloc[0]
            assert float(row[3]) == pytest.approx(term["log_evidence"], abs=0.0501)
            assert row[3] != "-0.0"
            assert row[5] == pytest.approx(term["moves_mm"], rel=1e-12)


def test_a_sliding_joint_is_told_in_millimetres():
    term = JointTerm("backlash", 1, ("backlash",), (2e-4,), (1e-4,), (3e-4,), 10.0, 1e-3, prismatic=True)
    assert term.to_dict()["values"]["backlash"] == pytest.approx({"value": 0.2, "low": 0.1, "high": 0.3}, rel=1e-12)
    (row,) = terms.terms_table([term]).rows
    assert row[1:3] == ("backlash, mm", "0.2000 ± 0.1000")


__all__ = ["given"]


@pytest.fixture(scope="module")
def found():
    q = np.vstack([moves(2, there_and_back(-40, 40, 10)), moves(2, there_and_back(-40, 40, 10), (0, 0, -60, 0, 30, 0))])
    groups = np.full(len(q), "axis2", object)
    points, step, _ = simulated(q, groups, noise=1e-5, rng=np.random.default_rng(0), stiffness=(8e-4, 4e-4))
    return JointBehaviour("points.csv", True, tuple(analyse_moves(points, step)), None)


def test_figures_by_name_are_those_of_the_files(found, few):
    assert found.figures == (
        "errors_axis2_1",
        "errors_axis2_2",
        "fourier_joint_2",
        "angular_errors",
        "stiffness_joint_2",
    )
    assert "stiffness_joint_2" not in replace(found, residuals=few.residuals).figures, "an arm that bends otherwise"
    assert all(found.plot(name).content("png").startswith(b"\x89PNG") for name in found.figures)


def test_a_figure_shows_the_errors_of_each_home_pose(found, given):
    chart = found.plot("stiffness_joint_2")
    for k, of_joint in enumerate(found.moves[0].series):
        ((kind, x, y),) = given[f"error{k}"]
        assert kind == "dots"
        assert x == pytest.approx(np.degrees(of_joint.turn), abs=1e-9)
        assert y == pytest.approx(np.degrees(of_joint.angle), abs=1e-12)
    assert chart.mark + chart.caption == "SIMULATED data. Equivalent error of joint 2"


def test_other_figures_are_refused(found):
    lines = [sign for colour, sign, _ in found.plot("errors_axis2_1").legend if colour == "ink"]
    assert len(lines) == len(set(lines)) > 1, "each target has a line of its own"
    assert refusal(found.plot, "backlash").startswith("figure: expected errors_axis2_1, errors_axis2_2,")


@pytest.fixture(scope="module")
def few():
    """Few random poses: joint 1 never moves, and there are too few poses for means."""
    q = random_commands(14, 1)
    q[:, 0] = 0.3
    points, step, robot = simulated(q, noise=1e-5, rng=np.random.default_rng(0))
    seen = analyse_residuals(robot.arm, points, step)
    return JointBehaviour("points.csv", True, (), seen)


def test_the_caption_says_where_there_are_no_means(few, given):
    chart = few.plot("residuals_by_joint")
    assert [word for word in texts(chart) if word.startswith("joint")] == [f"joint {k} (deg)" for k in (2, 3, 4, 5, 6)]
    assert chart.caption.endswith("At joints 3, 6, 14 poses are too few for means of both directions")
    count = sum(len(x) for colour in ("below", "above") for kind, x, _ in given[colour] if kind == "dots")
    assert count > 5 * 10


def test_words_of_panels_stay_in_their_drawings(few):
    for drawing in few.plot("residuals_by_joint").drawings:
        for item in drawing.marks:
            if hasattr(item, "text") and item.upright:
                wide = 0.56 * item.size * len(item.text)
                left = item.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[item.anchor] * wide
                assert -2 < left < left + wide < drawing.width + 4, item.text
                assert 0 < item.y < drawing.height
