"""Rigs of cameras: truth without noise, intervals that hold, never worse than OpenCV, files of other programs."""

import numpy as np
import pandas as pd
import pytest
import rig_cases as cases
from support import assert_same_poses

import irbcal
from irbcal.cell import camera_rig
from irbcal.cell.camera_rig import LensCalibration, instants, rigs
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import lens_formats
from irbcal.measurement.features import given_rows
from irbcal.measurement.pictures import boards_of
from irbcal.measurement.recordings import rosbag
from irbcal.modeling import frames

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless (pip install irbcal[camera])")


def test_a_rig_without_noise_is_the_truth_but_for_pictures_that_do_not_belong_together():
    """The third camera sees the board only together with the second; pictures 6 of the second are of another board."""
    both, others = cases.pictures(8, 0, 0.0), cases.pictures(6, 1, 0.0, ("right", "third"))
    moved = both["right"]["right/right06.png"]
    both["right"]["right/right06.png"] = moved[0], moved[1] + 15.0
    shown = {"left": both["left"], "right": dict(both["right"]), "third": {}}
    for k in range(1, 7):
        shown["right"][f"right/late {20 + k}.png"] = others["right"][f"right/right0{k}.png"]
        shown["third"][f"third/{20 + k}.png"] = others["third"][f"third/third0{k}.png"]
    errs = {camera: np.array(lens) * [1.003, 1.003, 1, 1, 1, 1, 1, 1, 1] for camera, lens in cases.LENSES.items()}
    found, rig, notes = rigs(cases.alone(shown, errs), shown, cases.boards_of(shown), "pictures")
    assert [(frame.name, frame.on) for frame in rig] == [("right", "left"), ("third", "left")]
    for frame in rig:
        assert_same_poses(frame.T, cases.PLACES[frame.name], 1e-5, 1e-5)
    for lens in found:
        np.testing.assert_allclose(lens.numbers, cases.LENSES[lens.camera], rtol=0, atol=0.05)
        assert lens.heldout_rms_pixels < 0.01
    assert notes == ("not taken together, and left out of the rig: left/left06.png, right/right06.png",)


def test_cameras_that_see_no_board_together_stay_alone():
    shown = cases.pictures(6, 3, 0.0)
    shown["right"] = dict(zip(shown["right"], reversed(shown["right"].values()), strict=True))
    found, rig, notes = rigs(cases.alone(shown), shown, cases.boards_of(shown), "pictures")
    assert rig == ()
    assert notes == tuple(f"{camera} sees no board together with another camera" for camera in shown)
    np.testing.assert_array_equal(found[0].numbers, cases.LENSES["left"])


def test_boards_that_look_the_same_after_half_a_turn_are_numbered_alike():
    shown = cases.pictures(6, 4, 0.0)
    board = cases.Board("circles", 9, 6, 0.03)
    for picture in list(shown["right"])[::2]:
        xy, uv = shown["right"][picture]
        shown["right"][picture] = xy.min(axis=0) + xy.max(axis=0) - xy, uv
    of = dict.fromkeys(cases.boards_of(shown), ("board", board))
    shown = {c: {p: (xy - 0.03, uv) for p, (xy, uv) in pictures.items()} for c, pictures in shown.items()}
    _, (frame,), _ = rigs(cases.alone(shown), shown, of, "pictures")
    assert_same_poses(frame.T, cases.PLACES["right"], 1e-6, 1e-6)


def test_intervals_hold_and_the_rig_is_never_worse_than_that_of_opencv(monkeypatch):
    monkeypatch.setattr(camera_rig, "left_out", lambda problem, state, scale, parts: 0.0 * scale)
    inside, width, errors = [], [], {"irbcal": [], "OpenCV": []}
    for seed in range(5):
        shown = cases.pictures(8, seed, 0.15)
        found, (frame,), _ = rigs(cases.alone(shown), shown, cases.boards_of(shown), "pictures")
        off = frames.inverse(cases.PLACES["right"]) @ frame.T
        inside += [*(np.abs(off[:3, 3]) < frame.u95_m)]
        inside += [*(np.abs(frames.vector_from_rotation(off[:3, :3])) < frame.u95_rad)]
        inside += [x for lens in found for x in (np.abs(lens.numbers - cases.LENSES[lens.camera]) < lens.u95)[:6]]
        width.append(frame.u95_m)
        errors["irbcal"].append(off[:3, 3])
        errors["OpenCV"].append((frames.inverse(cases.PLACES["right"]) @ by_opencv(shown))[:3, 3])
    rms = {name: np.sqrt(np.mean(np.square(values), axis=0)) for name, values in errors.items()}
    assert np.mean(inside) > 0.85
    assert np.mean(width) < 2.5 * 1.96 * rms["irbcal"].max()
    assert np.linalg.norm(rms["irbcal"]) < 1.02 * np.linalg.norm(rms["OpenCV"])


def by_opencv(shown):
    """The second camera in the first by stereoCalibrate, from lenses by calibrateCamera on."""
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    corners = [[uv.astype(np.float32) for _, uv in of.values()] for of in shown.values()]
    on_board = [cases.XYZ.astype(np.float32)] * len(corners[0])
    lenses_alone = [cv2.calibrateCamera(on_board, of, cases.SIZE, None, None, flags=flags)[1:3] for of in corners]
    answer = cv2.stereoCalibrate(
        on_board,
        *corners,
        *(matrix for lens in lenses_alone for matrix in lens),
        cases.SIZE,
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(3, 300, 1e-12),
    )
    return frames.inverse(frames.transform(answer[5], answer[6][:, 0]))


@pytest.mark.parametrize(
    ("left", "right", "together"),
    [
        (["l/left01.png", "l/left02.png"], ["r/right02.jpg", "r/right03.jpg"], 1),
        (["l/1403715273262142976.png"], ["r/1403715273263000000.png"], 1),
        (["l/1403715273262142976.png"], ["r/1403715273282142976.png"], 0),
        (["/l/image 17.250000", "/l/image 17.750000"], ["/r/image 17.252000", "/r/image 17.700000"], 1),
        (["l/near.png", "l/far.png"], ["r/far.png", "r/low.png"], 1),
        (["l/a1.png", "l/b1.png"], ["r/a1.png", "r/b1.png"], 2),
    ],
    ids=["running numbers", "stamps", "other stamps", "a bag", "names", "numbers twice"],
)
def test_pictures_are_paired_by_numbers_stamps_and_names(left, right, together):
    at = instants({"left": left, "right": right})
    assert len({at[name] for name in left} & {at[name] for name in right}) == together


@pytest.fixture(scope="module")
def calibration():
    shown = cases.pictures(6, 7, 0.1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(camera_rig, "left_out", lambda problem, state, scale, parts: 0.0 * scale)
        found, rig, notes = rigs(cases.alone(shown), shown, cases.boards_of(shown), "pictures")
    return LensCalibration(found, pd.DataFrame(), (), rig, notes)


def test_kalibr_gets_the_chain(calibration, tmp_path):
    import yaml

    content = yaml.safe_load(calibration.save(tmp_path / "chain.yaml", "kalibr").read_text())
    assert_same_poses(np.array(content["cam1"]["T_cn_cnm1"]), np.linalg.inv(calibration.rig[0].T), 1e-12, 1e-12)
    assert "T_cn_cnm1" not in content["cam0"]
    assert list(lens_formats.read(tmp_path / "chain.yaml")) == ["cam0", "cam1"]


def test_opencv_reads_both_cameras_and_places_points_of_the_first_before_the_second(calibration, tmp_path):
    path = calibration.save(tmp_path / "stereo.yaml", "opencv")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K, d, R, T = (storage.getNode(name).mat() for name in ("M2", "D2", "R", "T"))
    storage.release()
    point = np.array([0.05, -0.02, 0.6])
    (before,) = frames.apply(np.linalg.inv(calibration.rig[0].T), point[None])
    expected = cases.in_image(calibration.lenses[1].numbers, before)
    shown = cv2.projectPoints(point[None], cv2.Rodrigues(R)[0], T, K, d)[0].ravel()
    np.testing.assert_allclose(shown, expected, rtol=0, atol=1e-9)
    (_, second) = lens_formats.read(path).values()
    np.testing.assert_allclose(second[0], calibration.lenses[1].numbers, rtol=1e-12)
    with pytest.raises(OptionError, match="a file of ros has one camera, here are left, right: take kalibr"):
        calibration.save(tmp_path / "info.yaml", "ros")


def test_pictures_of_a_rig_in_folders_and_in_one(tmp_path):
    """Of cameras on the arm each has a name for the board; the folder bears the camera's name, or pictures begin so."""
    head = {"kind": "image-on-tool", "pattern": "chessboard", "squares_x": 10, "squares_y": 7, "square_mm": 30}
    known = pd.DataFrame([{"feature": f"{name} board", "target": name} | head for name in ("left", "right")])
    seen = list(boards_of(given_rows(known), "").values())
    for folder in ("left", "right", "one"):
        (tmp_path / folder).mkdir()
    for name in ("left/1.png", "right/1.PNG", "right/notes.txt", "one/left board 1.png", "one/right board 1.png"):
        (tmp_path / name).write_text("")
    of = [[name for name, _ in camera_rig._pictures(tmp_path, each, seen)] for each in seen]
    assert of == [["left/1.png"], ["right/1.PNG"]]
    of = [[name for name, _ in camera_rig._pictures(tmp_path / "one", each, seen)] for each in seen]
    assert of == [["left board 1.png"], ["right board 1.png"]]
    with pytest.raises(MeasurementError, match="there is no such folder of pictures") as refused:
        irbcal.lens(tmp_path / "right", known)
    assert refused.value.file.endswith("left board")
    with pytest.raises(MeasurementError, match="each of them, such as board left and board right") as refused:
        irbcal.lens(tmp_path, known.assign(feature="board"))
    assert refused.value.row == 2


def test_a_bag_gives_pictures_that_were_taken_together(tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types
    with rosbag2.Writer(tmp_path / "run", version=9) as writer:
        for topic, start, step in (("/left/image", 5.0, 0.1), ("/right/image", 2.301, 0.05)):
            to = writer.add_connection(topic, "sensor_msgs/msg/Image", typestore=store)
            for t in np.arange(start, 17.0, step):
                stamp = kind["builtin_interfaces/msg/Time"](int(t), round((t % 1.0) * 1e9))
                header = kind["std_msgs/msg/Header"](stamp, "")
                message = kind["sensor_msgs/msg/Image"](header, 2, 3, "mono8", 0, 3, np.zeros(6, dtype=np.uint8))
                writer.write(to, int(1e9 * t), store.serialize_cdr(message, to.msgtype))
    rows = [{"feature": name, "kind": "image", "target": "board"} for name in ("left", "right")]
    of = {feature: list(taken) for feature, taken in rosbag.pictures_over_time(tmp_path / "run", rows).items()}
    at = instants(of)
    assert len(of["left"]) == rosbag.MOST_PICTURES
    assert {at[name] for name in of["left"]} == {at[name] for name in of["right"]}
