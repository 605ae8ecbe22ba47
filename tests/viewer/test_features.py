"""Features in a scene, against the places that made the rows and against what the calibration itself reports."""

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import MeasurementError, OptionError
from irbcal.identification.observations import KINDS, Point
from irbcal.modeling import frames
from irbcal.plotting.charts import inline
from irbcal.units import MM
from irbcal.viewer import building, features, page

TURN = frames.rotation_from_vector(np.array([0.2, -0.3, 0.4]))
AT = np.array([0.85, 0.2, 0.5])
TRUTH = {
    "left/0": ("point", {"centre": np.array([0.8, -0.3, 0.4])}),
    "left/1": ("point", {"centre": np.array([0.8, -0.25, 0.4])}),
    "right/0": ("sphere", {"centre": np.array([0.9, 0.3, 0.6]), "radius": np.array([0.03])}),
    "table/0": ("plane", {"normal": TURN, "height": np.array([TURN[:, 2] @ AT])}),
    "wire/0": ("line", {"line": np.column_stack([TURN, AT])}),
    "string/0": ("radius", {"centre": np.array([1.6, 0.9, 0.2]), "offset": np.array([0.05])}),
    "nest/0": ("offset", {"centre": np.array([0.9, 0.0, 0.5]), "axes": TURN}),
}
KNOWN = [{"feature": name, "kind": kind} for name, (kind, _) in TRUTH.items()]
KNOWN[2]["radius_mm"] = 30.0
KNOWN.append({"feature": "50 mm", "kind": "distance", "first": "left/0", "second": "left/1", "length_mm": 50.0})


@pytest.fixture(scope="module")
def touched():
    """SIMULATED rows of the nominal arm, 0.01 mm of noise, and their calibration."""
    rng, parts = np.random.default_rng(3), []
    for name, (kind, own) in TRUTH.items():
        part = cases._rows(kind, cases.arm(), own, 16, rng, 1e-5, np.eye(3)).drop(columns="kind")
        place, number = name.split("/")
        parts.append(part.assign(place=place, number=number, pose=[f"{name} {k}" for k in range(16)]))
    table = pd.concat(parts, ignore_index=True).astype(object)
    table = table.where(table.notna(), "").assign(simulated="yes")
    pattern = [{"feature": "{place}/{number}", "kind": "point"}]  # names are made of columns
    known = pd.DataFrame(pattern + KNOWN).astype(object).fillna("")
    return irbcal.calibrate(table, "irb1600", features=known, leave_out="none"), table


def test_features_stand_at_their_fitted_places(touched):
    found, table = touched
    scene = building.view(found, table).scene
    drawn = {one.name: one for one in scene.features}
    rows = {row.name: row.fitted | row.known for row in found.record.features.features}
    assert list(drawn) == [*TRUTH, "50 mm"]
    for name, (kind, own) in TRUTH.items():
        T, row = drawn[name].T_scene, rows[name]
        assert drawn[name].kind == kind
        if "centre" in own:
            assert np.abs(T[:3, 3] - np.array(row["centre"]) * MM).max() < 1e-12
            assert np.linalg.norm(T[:3, 3] - own["centre"]) < 2e-4
            continue
        axis = np.array(row["normal" if kind == "plane" else "line"])
        assert np.abs(T[:3, 2] - axis).max() < 1e-12
        assert abs(abs(axis @ TURN[:, 2]) - 1.0) < 1e-5
        away = T[:3, 3] - AT  # anywhere in the plane, on the line, but where the tool was
        across = away @ TURN[:, 2] if kind == "plane" else np.linalg.norm(away - TURN[:, 2] * (away @ TURN[:, 2]))
        assert abs(across) < 2e-4
    assert np.abs(drawn["nest/0"].T_scene[:3, :3] - TURN).max() < 2e-3
    assert abs(drawn["right/0"].size - 0.03) < 1e-12
    length = drawn["50 mm"]
    ends = [length.T_scene[:3, 3] + sign * length.size * length.T_scene[:3, 2] for sign in (-1, 1)]
    for end, name in zip(ends, ("left/0", "left/1"), strict=True):
        assert np.linalg.norm(end - drawn[name].T_scene[:3, 3]) < 1e-12
    told = page.content(scene)["features"]
    assert {"label": "50 mm", "kind": "distance", "place": length.T_scene[:3, 3].tolist()} in told
    assert next(one["label"] for one in told) == "left/0 · socket"


def test_rows_miss_their_features_by_what_the_calibration_says(touched):
    found, table = touched
    view = irbcal.view(found, table)
    scene = view.scene
    assert scene.mode == "measured"
    assert scene.at_features
    assert scene.fitted.all()
    assert not scene.tracker
    for model in ("calibrated", "nominal"):
        said = np.array(getattr(found.record.points, f"{model}_mm"))
        assert np.abs(scene.points.distance(model) / MM - said).max() < 1e-6
    words = " ".join(str(part) for part in view.report())
    assert "Distances of rows from their features" in words
    assert "SIMULATED" in words
    assert "not its accuracy" in words


def test_joints_alone_are_a_plan_and_features_still_stand(touched):
    found, table = touched
    scene = building.view(found, table[[f"q{k}_deg" for k in range(1, 7)]].assign(pose=range(len(table)))).scene
    assert scene.mode == "plan"
    assert not scene.at_features
    assert len(scene.features) == len(building.view(found).scene.features) == 8


def test_strangers_are_named(touched):
    found, table = touched
    with pytest.raises(MeasurementError, match="does not know the feature elsewhere/0: it has left/0"):
        building.view(found, table.assign(place="elsewhere"))
    with pytest.raises(OptionError, match="do not place the base"):
        building.view(found, table, refit_base=True)


def test_figures_of_such_a_calibration_do_not_speak_of_position_errors(touched):
    for draw in ("before_and_after", "distribution", "errors_by_pose"):
        chart = getattr(touched[0].plot, draw)()
        words = " ".join([chart.caption, *map(str, map(inline, chart.drawings))]).lower()
        assert "distance from feature" in words
        assert "position error" not in words


def test_a_kind_that_was_added_is_drawn_under_its_name(touched, monkeypatch):
    class Tip(Point):
        name, shown_as = "tip", "needle"

    class Plain(Point):
        name, shown_as = "plain", ""

    section = touched[0].record.features
    for kind, label in ((Tip(), "needle"), (Plain(), "plain")):
        monkeypatch.setitem(KINDS, kind.name, kind)
        row = section.features[0].model_copy(update={"kind": kind.name})
        shown = features.shown_features(section.model_copy(update={"features": [row]}), 1.5)
        assert shown[0].label == f"left/0 · {label}"
        assert features.bodies(shown, 1.5)[0]


def test_cameras_and_boards_are_drawn_where_they_stand():
    """SIMULATED images; the oracle is what made them, and the way across the view of a shifted board."""
    for kind in ("image", "image-on-tool"):
        table, known = cases.rows(kind, cases.arm(), 4, 0, 1e-6)
        own = cases.unknowns(kind, np.random.default_rng(0))
        found = irbcal.calibrate(table, "irb1600", features=known.fillna(""), leave_out="none")
        scene = building.view(found, table).scene
        drawn = {one.name: one for one in scene.features}
        at = own["centre"]
        if kind == "image-on-tool":
            at = at + own["attitude"] @ [0.12, 0.09, 0.0]  # middle of 8 by 6 squares of 30 mm
            assert drawn["image-on-tool 0"].label == "image-on-tool 0 · board"
        assert np.linalg.norm(drawn[f"{kind} 0"].T_scene[:3, 3] - at) < 2e-3
        np.testing.assert_allclose(drawn[f"{kind} 0"].T_scene[:3, 2], own["attitude"][:, 2], atol=2e-3)
        assert len(scene.points.pose) == 12
        for model in ("calibrated", "nominal"):  # the millimetres of the report
            said = np.array(getattr(found.record.points, f"{model}_mm"))
            assert scene.points.distance(model) / MM == pytest.approx(said, abs=1e-6)


def test_a_level_and_the_frame_of_whole_poses_have_bodies():
    """SIMULATED rows of an inclinometer and of whole poses, with the truth that made them."""
    table, known = cases.rows("angle", cases.arm(), 30, 4)
    whole, _ = cases.rows("pose", cases.arm(), 30, 5)
    table = pd.concat([table, whole], ignore_index=True).astype(object)
    found = irbcal.calibrate(
        table.where(table.notna(), "").assign(simulated="yes"), "irb1600", features=known, leave_out="none"
    )
    drawn = {one.name: one for one in building.view(found).scene.features}
    assert set(drawn) == {"angle 0", "measuring frame"}
    up = frames.rotation_from_vector(np.array([0.01, -0.02, 0.0]))[:, 2]
    assert np.abs(drawn["angle 0"].T_scene[:3, 2] - up).max() < 1e-4
    assert np.abs(drawn["measuring frame"].T_scene - frames.inverse(cases.world())).max() < 1e-3
    solid, glass = features.bodies(tuple(drawn.values()), 1.5)
    assert (len(solid), len(glass)) == (4, 1)
    assert all(np.isfinite(body).all() for body, _ in (*solid, *glass))


def test_a_tracker_looks_at_a_calibration_without_one(touched):
    """SIMULATED points of another reflector in a frame of its own: base and tool are fitted again, half are shown."""
    found, _ = touched
    q = cases.arm().random_joints(40, 6) * 0.6
    p, _ = cases.tip(cases.arm(), q, np.array([0.0, 0.05, 0.2]))
    T = cases.world()
    table = pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)])
    xyz = (p @ T[:3, :3].T + T[:3, 3]) / MM
    table = table.assign(pose=range(40), target="ball", x_mm=xyz[:, 0], y_mm=xyz[:, 1], z_mm=xyz[:, 2], simulated="yes")
    scene = building.view(found, table, refit_base=True, refit_tool=True).scene
    assert len(scene.q) == 20
    assert scene.points.distance("calibrated").max() < 2e-4
