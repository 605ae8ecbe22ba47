"""Recordings of other programs: folders of industrial_calibration, samples of easy_handeye2, boards and lenses."""

import json

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest
import yaml

import irbcal
from irbcal.cell.hand_eye import hand_eye
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import board_formats, imaging, lens_formats
from irbcal.measurement.features import given_rows
from irbcal.measurement.features import read as read_features
from irbcal.measurement.recordings import corner_rows
from irbcal.modeling import frames
from irbcal.units import MM


def flange_poses(n, rng):
    """Flanges that are turned about all axes, metres."""
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, 3] = np.array([0.6, 0.1, 0.8]) + rng.uniform(-0.2, 0.2, (n, 3))
    down = np.diag([1.0, -1.0, -1.0])
    T[:, :3, :3] = down @ frames.rotation_from_vector(rng.uniform(-0.5, 0.5, (n, 3)))
    return T


def message(T):
    w, x, y, z = map(float, frames.quaternion_from_matrix(T[:3, :3]))
    place = dict(zip("xyz", map(float, T[:3, 3]), strict=True))
    return {"translation": place, "rotation": {"x": x, "y": y, "z": z, "w": w}}


def samples(kind, rng, n=12, noise=0.0):
    """SIMULATED samples as the sampler of easy_handeye2 writes them, and the true camera."""
    T = flange_poses(n, rng)
    camera_on = frames.transform(frames.rotation_from_vector(np.array([0.1, -0.2, 0.7])), np.array([0.05, 0.02, 0.1]))
    marker_in = frames.transform(np.eye(3), np.array([0.6, 0.1, 0.0]))
    if kind == "eye_on_base":
        camera_on = frames.transform(np.diag([-1.0, 1.0, -1.0]), np.array([0.6, 0.1, 2.0]))
        marker_in = frames.transform(frames.rotation_from_vector(np.array([3.0, 0.2, 0.1])), np.array([0.03, 0, 0.08]))
    hand = T if kind == "eye_in_hand" else frames.inverse(T)
    marker = frames.inverse(hand @ camera_on) @ marker_in
    marker[:, :3, :3] = marker[:, :3, :3] @ frames.rotation_from_vector(noise * rng.standard_normal((n, 3)))
    marker[:, :3, 3] += 0.2 * noise * rng.standard_normal((n, 3))
    return [{"robot": message(a), "tracking": message(b)} for a, b in zip(hand, marker, strict=True)], camera_on


@pytest.mark.parametrize("kind", ["eye_in_hand", "eye_on_base"])
def test_samples_of_easy_handeye_give_the_camera_and_its_file_back(kind, tmp_path, program):
    """The file that comes out tells the next samples of its name where the camera is."""
    taken, truth = samples(kind, np.random.default_rng(3))
    (tmp_path / "cam.samples").write_text(yaml.safe_dump({"samples": taken}))
    with pytest.raises(MeasurementError, match="samples do not say where the camera is"):
        hand_eye(tmp_path / "cam.samples")
    on_flange = kind == "eye_in_hand"
    row = "marker,image-on-tool,camera" if on_flange else "camera,image,marker"
    (tmp_path / "features.csv").write_text(f"feature,kind,target\n{row}\n")
    call = ["hand-eye", tmp_path / "cam.samples"]
    features = ["--features", tmp_path / "features.csv"]
    program(*call, *features, "--as", "easy_handeye2", "--out", tmp_path / "cam.calib", "--json")
    written = yaml.safe_load((tmp_path / "cam.calib").read_text())
    assert written["parameters"]["calibration_type"] == kind
    np.testing.assert_allclose(list(written["transform"]["translation"].values()), truth[:3, 3], rtol=0, atol=1e-8)
    x, y, z, w = written["transform"]["rotation"].values()
    np.testing.assert_allclose(frames.matrix_from_quaternion(np.array([w, x, y, z])), truth[:3, :3], rtol=0, atol=1e-8)
    again = program(*call, "--json")
    camera = next(frame for frame in again["frames"] if frame["device"] == "camera")
    assert camera["on"] == ("flange" if on_flange else "base")
    np.testing.assert_allclose([camera[f"{axis}_mm"] for axis in "xyz"], truth[:3, 3] / MM, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("kind", "ending"), [("eye_in_hand", "yaml"), ("eye_on_base", "json"), ("eye_in_hand", "xml")])
def test_poses_that_opencv_wrote_give_the_camera(kind, ending, tmp_path):
    """OpenCV itself writes the file; each pose is what its name says, wherever the camera is."""
    cv2 = pytest.importorskip("cv2")
    taken, truth = samples(kind, np.random.default_rng(5))
    poses = [(_matrix(each["robot"]), _matrix(each["tracking"])) for each in taken]
    name = "gripper2base" if kind == "eye_in_hand" else "base2gripper"  # as samples of easy_handeye2 have it
    path = tmp_path / f"poses.{ending}"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for of, which in ((name, 0), ("target2cam", 1)):
        for letter in "Rt":
            file.startWriteStruct(f"{letter}_{of}", cv2.FileNode_SEQ)
            for pair in poses:
                T = pair[which]
                file.write(
                    "", T[:3, :3] if letter == "R" and which else T[:3, 3:] if letter == "t" else _vector(cv2, T)
                )
            file.endWriteStruct()
    file.release()
    row = "marker,image-on-tool,camera" if kind == "eye_in_hand" else "camera,image,marker"
    (tmp_path / "f.csv").write_text(f"feature,kind,target\n{row}\n")
    camera = next(frame for frame in hand_eye(path, tmp_path / "f.csv").devices if frame.device == "camera")
    np.testing.assert_allclose(camera.T, truth, rtol=0, atol=1e-8)
    if ending == "yaml":
        path.write_text(path.read_text().replace("R_target2cam", "R_other"))
        with pytest.raises(MeasurementError, match="expected R_target2cam and t_target2cam"):
            hand_eye(path, tmp_path / "f.csv")


def _vector(cv2, T):
    return cv2.Rodrigues(T[:3, :3])[0]


def _matrix(pose):
    x, y, z, w = pose["rotation"].values()
    turn = frames.matrix_from_quaternion(np.array([w, x, y, z]))
    return frames.transform(turn, np.array(list(pose["translation"].values())))


def test_samples_with_noise_are_never_worse_than_by_opencv(tmp_path, monkeypatch):
    monkeypatch.setattr("irbcal.cell.hand_eye.left_out", lambda problem, state, scale: 0.0 * scale)
    cv2 = pytest.importorskip("cv2")
    errors = []
    (tmp_path / "f.csv").write_text("feature,kind,target\nmarker,image-on-tool,camera\n")
    for seed in range(4):
        taken, truth = samples("eye_in_hand", np.random.default_rng(seed), noise=0.004)
        (tmp_path / "s.samples").write_text(json.dumps({"samples": taken}))
        result = hand_eye(tmp_path / "s.samples", tmp_path / "f.csv")
        camera = next(frame for frame in result.devices if frame.device == "camera")
        parts = []
        for name in ("robot", "tracking"):
            q = np.array([[sample[name]["rotation"][key] for key in "wxyz"] for sample in taken])
            parts += [frames.matrix_from_quaternion(q)]
            parts += [np.array([list(sample[name]["translation"].values()) for sample in taken])]
        methods = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
        others = [cv2.calibrateHandEye(*parts, method=getattr(cv2, f"CALIB_HAND_EYE_{name}"))[1] for name in methods]
        errors.append([np.linalg.norm(place.ravel() - truth[:3, 3]) for place in [camera.T[:3, 3], *others]])
    mean = np.mean(errors, axis=0)
    assert mean[0] <= 1.02 * mean[1:].min(), mean / MM


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda s: s[0].pop("robot"), "expected a pose: x, y, z in metres"),
        (lambda s: s[1]["tracking"]["rotation"].update(w=3.0), "expected a unit quaternion"),
        (
            lambda s: s[2]["tracking"]["translation"].update(z=-1.0),
            "sample 3: the marker is not in front of the camera",
        ),
        (lambda s: s[2]["robot"]["translation"].update(z="far"), "expected a pose"),
    ],
)
def test_damaged_samples_are_refused(tmp_path, damage, sentence):
    taken, _ = samples("eye_in_hand", np.random.default_rng(0))
    damage(taken)
    (tmp_path / "s.samples").write_text(yaml.safe_dump({"samples": taken}))
    (tmp_path / "f.csv").write_text("feature,kind,target\nmarker,image-on-tool,camera\n")
    with pytest.raises(MeasurementError, match=sentence):
        hand_eye(tmp_path / "s.samples", tmp_path / "f.csv")


CHARUCO = {"type": "CharucoGridTargetFinder", "rows": 6, "cols": 8, "chessboard_dim": 0.03, "aruco_marker_dim": 0.02}


LENS = 900.0, 900.0, 400.0, 300.0


def board_seen(cv2, T):
    """A picture of the board of `CHARUCO` at T in the camera's axes, drawn by OpenCV."""
    drawn = cv2.aruco.CharucoBoard((8, 6), 0.03, 0.02, cv2.aruco.getPredefinedDictionary(10)).generateImage((960, 720))
    K = np.array([[LENS[0], 0, LENS[2]], [0, LENS[1], LENS[3]], [0, 0, 1.0]])
    of_pixels = np.diag([0.24 / 960, 0.18 / 720, 1.0]) @ [[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]
    H = K @ T[:3, [0, 1, 3]] @ of_pixels
    return cv2.warpPerspective(drawn, H, (800, 600), flags=cv2.INTER_AREA, borderValue=128)


def industrial(folder):
    """A SIMULATED folder of industrial_calibration: pictures of a ChArUco board drawn by OpenCV, and the true camera."""
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(5)
    camera_on = frames.transform(np.eye(3), np.array([0.05, 0.02, 0.1]))
    board_in = frames.transform(np.eye(3), np.array([0.5, 0.0, -0.2]))
    data = []
    for name in ("poses", "images"):
        (folder / name).mkdir()
    for k in range(8):
        towards = frames.transform(
            frames.rotation_from_vector(np.array([*rng.uniform(-0.4, 0.4, 2), rng.uniform(-1, 1)])),
            np.array([*rng.uniform(-0.03, 0.03, 2), 0.45]),
        ) @ frames.transform(np.eye(3), np.array([-0.12, -0.09, 0.0]))  # the board in the camera
        flat = message(board_in @ frames.inverse(towards) @ frames.inverse(camera_on))
        picture = board_seen(cv2, towards)
        cv2.imwrite(str(folder / f"images/{k}.png"), picture)
        pose = flat["translation"] | {f"q{axis}": value for axis, value in flat["rotation"].items()}
        (folder / f"poses/{k}.yaml").write_text(yaml.safe_dump(pose))
        data.append({"pose": f"poses/{k}.yaml", "image": f"images/{k}.png"})
    content = {"data": data, "static_camera": False, "target_finder": {**CHARUCO, "dictionary": 10}}
    content["intrinsics"] = dict(zip(("fx", "fy", "cx", "cy"), LENS, strict=True))
    (folder / "cal_data.yaml").write_text(yaml.safe_dump(content))
    return content, camera_on


def test_a_folder_of_industrial_calibration_is_taken_as_it_is(tmp_path, program):
    """Camera on the hand, SIMULATED; what lies in files beside the list is taken from there."""
    content, truth = industrial(tmp_path)
    result = program("hand-eye", tmp_path, "--json")
    assert result["rms_px"] < 0.25
    camera = next(frame for frame in result["frames"] if frame["device"] == "camera")
    np.testing.assert_allclose([camera[f"{axis}_mm"] for axis in "xyz"], truth[:3, 3] / MM, rtol=0, atol=0.5)
    (tmp_path / "cal_data.yaml").write_text(yaml.safe_dump(content["data"]))
    with pytest.raises(MeasurementError, match="no file of the folder says target_finder and static_camera"):
        hand_eye(tmp_path)
    (tmp_path / "intr.yaml").write_text(yaml.safe_dump({"intrinsics": content["intrinsics"], "static_camera": False}))
    (tmp_path / "target.yaml").write_text(yaml.safe_dump(content["target_finder"]))
    assert program("hand-eye", tmp_path, "--json")["frames"] == result["frames"]
    (tmp_path / "zz.yaml").write_text(yaml.safe_dump({"intrinsics": {"fx": 1}}))
    with pytest.raises(MeasurementError, match=r"intrinsics is another in intr\.yaml"):
        hand_eye(tmp_path)
    with pytest.raises(OptionError, match="expected one of json, easy_handeye2"):
        hand_eye(tmp_path, as_="ros")


def test_boards_of_kalibr_and_of_the_target_finder(tmp_path):
    chess = {"target_type": "checkerboard", "targetCols": 6, "targetRows": 7}
    chess |= {"rowSpacingMeters": 0.06, "colSpacingMeters": 0.06}
    (tmp_path / "target.yaml").write_text(yaml.safe_dump(chess))
    (tmp_path / "f.csv").write_text("feature,kind,target,board\nwall,image-on-tool,cam,target.yaml\n")
    board = imaging.board_of(given_rows(tmp_path / "f.csv")[0])
    assert (board.pattern, board.across, board.along) == ("chessboard", 7, 8)
    assert len(board.corners) == 6 * 7
    np.testing.assert_allclose(board.corners.max(axis=0) - board.corners.min(axis=0), [0.30, 0.36], rtol=0, atol=1e-12)
    with pytest.raises(MeasurementError, match="does not say where the camera is"):
        given_rows(tmp_path / "target.yaml")
    assert given_rows(tmp_path / "target.yaml", static=True)[0]["kind"] == "image"
    circles = {"target_type": "circlegrid", "targetCols": 4, "targetRows": 11, "spacingMeters": 0.02}
    (tmp_path / "target.yaml").write_text(yaml.safe_dump(circles | {"asymmetricGrid": True}))
    staggered = imaging.board_of(given_rows(tmp_path / "f.csv")[0])  # as OpenCV's tutorial numbers and places them
    there = [(0.02 * (2 * i + j % 2), 0.02 * j) for j in range(11) for i in range(4)]
    np.testing.assert_allclose(staggered.corners, there, rtol=0, atol=1e-12)
    cells = board_formats.board({"target_finder": {**CHARUCO, "dictionary": 10}}, "f")
    assert cells["dictionary"] == "DICT_6X6_250"
    cv2 = pytest.importorskip("cv2")
    for number, name in enumerate(board_formats.DICTIONARIES):
        assert getattr(cv2.aruco, name) == number
    for wrong, sentence in [
        ({"target_type": "aprilgrid"}, "not understood: 'tagSize'"),
        ({**chess, "colSpacingMeters": 0.05}, "squares are no squares"),
        ({**CHARUCO, "dictionary": 99}, "not understood"),
        ({"type": "rct_ros_tools::ModifiedCircleGridTargetFinderPlugin", "rows": 10}, "ModifiedCircleGridTargetFinder"),
        ([1], "expected a board"),
    ]:
        with pytest.raises(MeasurementError, match=sentence):
            board_formats.board(wrong, "f")


@pytest.mark.parametrize("ending", ["xml", "json", "yaml"])
def test_lenses_as_opencv_writes_them(tmp_path, ending):
    """OpenCV itself writes the file."""
    cv2 = pytest.importorskip("cv2")
    K = np.array([[901.5, 0, 400.25], [0, 902.5, 300.75], [0, 0, 1]])
    d = np.array([[-0.2, 0.05, 1e-3, -2e-3, 0.01]])
    path = tmp_path / f"lens.{ending}"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("image_width", 800)
    file.write("image_height", 600)
    file.write("camera_matrix", K)
    file.write("distortion_coefficients", d)
    file.release()
    ((numbers, size),) = lens_formats.read(path).values()
    np.testing.assert_allclose(numbers, [901.5, 902.5, 400.25, 300.75, *d[0]], rtol=0, atol=1e-12)
    assert size == (800, 600)


def test_a_camera_info_message_is_a_lens(tmp_path):
    echoed = {"width": 800, "height": 600, "distortion_model": "plumb_bob", "d": [0.1, 0, 0, 0, 0], "r": [], "p": []}
    echoed["k"] = [900.0, 0, 400, 0, 901, 300, 0, 0, 1]
    (tmp_path / "info.yaml").write_text(yaml.safe_dump(echoed) + "---\n")
    ((numbers, size),) = lens_formats.read(tmp_path / "info.yaml").values()
    np.testing.assert_array_equal(numbers, [900, 901, 400, 300, 0.1, 0, 0, 0, 0])
    assert size == (800, 600)


STANDS = 9


def bag(folder, arm, plugin, encoding, names=None):
    """A SIMULATED bag: the arm stands for two seconds at each of `STANDS` places and moves for one between them, its
    joints come by name in another order, a picture each second, also while it moves, points of a probe beside them.

    Gives the joints of the stands and where the camera is on the flange.
    """
    cv2, rosbag2 = pytest.importorskip("cv2"), pytest.importorskip("rosbags.rosbag2")
    from rosbags import rosbag1
    from rosbags.typesys import Stores, get_typestore

    rng = np.random.default_rng(11)
    store = get_typestore(Stores.ROS1_NOETIC if plugin == "ROS1" else Stores.ROS2_HUMBLE)
    kind = store.types
    middle = np.array([0.1, 0.2, 0.3, 0.2, 0.9, 0.1])
    q = middle + rng.uniform(-0.2, 0.2, (STANDS, 6))
    q[:, 5] += rng.uniform(-0.8, 0.8, STANDS)
    camera_on = frames.transform(frames.rotation_from_vector(np.array([0.05, 0.1, 0.4])), np.array([0.05, 0.02, 0.1]))
    at = frames.transform(np.eye(3), np.array([-0.12, -0.09, 0.5]))
    board_in = arm.forward(middle[None])[0] @ camera_on @ at
    order = [2, 0, 1, 4, 3, 5]
    names = names or [arm.joint_names[k] for k in order]

    def header(t):
        stamp = kind["builtin_interfaces/msg/Time"](int(t), round((t % 1.0) * 1e9))
        return kind["std_msgs/msg/Header"](*([0] if plugin == "ROS1" else []), stamp, "")

    def joints_at(t):
        k, share = int(t // 3.0), np.clip(t % 3.0 - 2.0, 0.0, 1.0)
        return (1.0 - share) * q[k] + share * q[min(k + 1, STANDS - 1)]

    def picture(t):
        grey = board_seen(cv2, frames.inverse(arm.forward(joints_at(t)[None])[0] @ camera_on) @ board_in)
        if encoding == "png":
            coded = cv2.imencode(".png", grey)[1].ravel()
            return kind["sensor_msgs/msg/CompressedImage"](header(t), "png", coded)
        colours = np.repeat(grey[:, :, None], 3, axis=2).ravel()
        return kind["sensor_msgs/msg/Image"](header(t), 600, 800, encoding, 0, 2400, colours)

    def point(t):
        return kind["geometry_msgs/msg/PointStamped"](header(t), kind["geometry_msgs/msg/Point"](0.1, 0.2, float(t)))

    def states(t):
        position = joints_at(t)[order] + rng.uniform(-2e-5, 2e-5, 6)
        return kind["sensor_msgs/msg/JointState"](header(t), names, position, np.zeros(0), np.zeros(0))

    def info(t):
        K, region = np.array([900.0, 0, 400, 0, 900, 300, 0, 0, 1]), kind["sensor_msgs/msg/RegionOfInterest"]
        P = np.insert(K.reshape(3, 3), 3, 0.0, axis=1).ravel()
        sizes = (600, 800, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), P, 0, 0, region(0, 0, 0, 0, False))
        return kind["sensor_msgs/msg/CameraInfo"](header(t), *sizes)

    write = rosbag1.Writer(folder) if plugin == "ROS1" else rosbag2.Writer(folder, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if plugin == "ROS1" else store.serialize_cdr
    with write as writer:
        for topic, make, step in (
            ("/joint_states", states, 0.02),
            ("/hand/image", picture, 1.0),
            ("/probe", point, 0.5),
            ("/hand/camera_info", info, 5.0),
        ):
            first = make(100.0 - 100.0)
            to = writer.add_connection(topic, first.__msgtype__, typestore=store)
            for t in np.arange(0.25, 3.0 * STANDS - 1.0, step):
                message = make(t)
                writer.write(to, int(1e9 * (t + 5.0)), serialize(message, to.msgtype))
    return q, camera_on


@pytest.mark.parametrize(("plugin", "encoding"), [("SQLITE3", "png"), ("MCAP", "bgr8")])
def test_a_bag_of_ros_2_gives_the_camera(plugin, encoding, tmp_path, program):
    """By hand-eye, and as rows of a calibration; pictures of a moving robot are left out; one lens is in the bag."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    arm = cases.arm()
    q, camera_on = bag(tmp_path / "run", arm, getattr(rosbag2.StoragePlugin, plugin), encoding)
    heads = "feature,kind,target,fx_px,cx_px,cy_px,squares_x,squares_y,square_mm,marker_mm,dictionary"
    lens = "900,400,300" if encoding == "png" else ",,"
    board = f"board,image-on-tool,hand,{lens},8,6,30,20,6X6_250"
    (tmp_path / "f.csv").write_text(f"{heads}\n{board}\nprobe,offset-on-tool,hand{',' * 8}\n")
    (tmp_path / "camera.csv").write_text(f"{heads}\n{board}\n")
    call = ["hand-eye", tmp_path / "run", "--features", tmp_path / "camera.csv", "--robot", "irb1600"]
    result = program(*call, "--json")
    camera = next(frame for frame in result["frames"] if frame["device"] == "camera")
    assert result["pictures"] == STANDS
    assert result["rms_px"] < 0.25
    np.testing.assert_allclose([camera[f"{axis}_mm"] for axis in "xyz"], camera_on[:3, 3] / MM, rtol=0, atol=0.6)
    rows = read_features(*corner_rows(tmp_path / "run", tmp_path / "f.csv", arm), arm)
    np.testing.assert_allclose(rows.q[rows.feature == "board"], q, rtol=0, atol=2e-5)
    points = rows.feature == "probe"
    assert points.sum() == STANDS
    np.testing.assert_allclose(rows.xyz[points, :2], [[0.1, 0.2]] * STANDS, rtol=0, atol=1e-12)
    middle = rows.xyz[points, 2] - 3.0 * np.arange(STANDS)  # the time of the point
    assert (middle > 0.2).all()
    assert (middle < 1.8).all()


def test_a_bag_of_ros_1_has_corners_and_lens_in_it(tmp_path, program):
    """The lens that the bag itself says is taken; from the pictures alone comes the same one."""
    run = tmp_path / "run.bag"
    q, camera_on = bag(run, cases.arm(), "ROS1", "png")
    heads = "feature,kind,target,squares_x,squares_y,square_mm,marker_mm,dictionary"
    (tmp_path / "f.csv").write_text(f"{heads}\nboard,image-on-tool,hand,8,6,30,20,6X6_250\n")
    given = ["--features", tmp_path / "f.csv"]
    result = program("hand-eye", run, *given, "--robot", "irb1600", "--json")
    camera = next(frame for frame in result["frames"] if frame["device"] == "camera")
    np.testing.assert_allclose([camera[f"{axis}_mm"] for axis in "xyz"], camera_on[:3, 3] / MM, rtol=0, atol=0.6)
    assert not result["lens"]
    out = tmp_path / "corners.csv"
    found = program("corners", run, *given, "--robot", "irb1600", "--out", out, "--json")
    assert found["images"] == STANDS
    rows = pd.read_csv(out).drop_duplicates("pose")
    np.testing.assert_allclose(np.radians(rows[[f"q{k}_deg" for k in range(1, 7)]]), q, rtol=0, atol=2e-5)
    with pytest.raises(OptionError, match="name the table that has the joints"):
        irbcal.corners(tmp_path, None, tmp_path / "f.csv")
    (lens,) = program("lens", run, *given, "--json")["lenses"]
    assert lens["pictures"] > 20
    assert lens["width_px"] == 800
    for name, true in (("fx_px", 900.0), ("fy_px", 900.0), ("cx_px", 400.0), ("cy_px", 300.0)):
        assert abs(lens[name]["value"] - true) < 3.0 * lens[name]["u95"] + 0.5


def test_a_bag_of_another_robot_is_refused(tmp_path):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    names = [f"other_{k}" for k in range(6)]
    bag(tmp_path / "run", cases.arm(), rosbag2.StoragePlugin.MCAP, "png", names)
    (tmp_path / "f.csv").write_text("feature,kind\nboard,image-on-tool\n")
    with pytest.raises(MeasurementError, match=r"no joint states of joint_1, .*; found other_0, other_1"):
        hand_eye(tmp_path / "run", tmp_path / "f.csv", robot="irb1600")
    with pytest.raises(OptionError, match="name the robot whose joints the bag has"):
        hand_eye(tmp_path / "run", tmp_path / "f.csv")
    file = next((tmp_path / "run").glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:200])
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(200))
    for damaged in ("run", "old.bag", "none.bag"):
        with pytest.raises(MeasurementError, match="expected a bag of ROS 2 or ROS 1: "):
            hand_eye(tmp_path / damaged, tmp_path / "f.csv", robot="irb1600")


@pytest.mark.parametrize("depth", [False, True], ids=["pixels", "places of a depth camera"])
def test_samples_of_robot_calibration_give_the_camera(depth, tmp_path, program):
    """SIMULATED: the camera stands in the hall, the chain carries the board; one sample has no chain, and is told."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from irbcal.measurement.recordings.robot_calibration import DEFINITIONS, PACKAGE, SAMPLE

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    kind, arm, rng = store.types, cases.arm(), np.random.default_rng(2)
    own = cases.unknowns("image", rng)
    shown = cases.images("image", arm, own, 8, rng)
    q = np.radians(shown.drop_duplicates("q1_deg")[[f"q{k}_deg" for k in range(1, 7)]].to_numpy())
    y = cases.before_camera("image", *cases.tip(arm, q), own)
    uv = shown[["u_px", "v_px"]].to_numpy().reshape(8, -1, 2)
    header = kind["std_msgs/msg/Header"](kind["builtin_interfaces/msg/Time"](1, 0), "")
    fx, fy, cx, cy, *d = cases.LENS_OF
    region, none = kind["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False), np.zeros(0, np.uint8)

    def observed(sensor, places, f=0.0):
        K = np.array([f, 0, cx, 0, f * fy / fx, cy, 0, 0, 1])
        sizes = (1200, 1920, "plumb_bob", np.array(d), K, np.eye(3).ravel(), np.zeros(12), 0, 0, region)
        info = kind[f"{PACKAGE}ExtendedCameraInfo"](kind["sensor_msgs/msg/CameraInfo"](header, *sizes), [])
        points = [kind["geometry_msgs/msg/Point"](*map(float, place)) for place in places]
        stamped = [kind["geometry_msgs/msg/PointStamped"](header, point) for point in points]
        cloud = kind["sensor_msgs/msg/PointCloud2"](header, 0, 0, [], False, 0, 0, none, False)
        empty = kind["sensor_msgs/msg/Image"](header, 0, 0, "", 0, 0, none)
        return kind[f"{PACKAGE}Observation"](sensor, stamped, info, cloud, empty)

    with rosbag2.Writer(tmp_path / "run", version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        to = writer.add_connection("/calibration_data", SAMPLE, typestore=store)
        for k, joints in enumerate(q):
            position = np.r_[joints[::-1], 0.1]
            state = kind["sensor_msgs/msg/JointState"](
                header, [*arm.joint_names[::-1], "finger"], position, np.zeros(0), np.zeros(0)
            )
            places = y[k] if depth else np.pad(uv[k], ((0, 0), (0, 1)))
            seen = [observed("head", places, fx), observed("arm", cases.corners())][: 1 if k == 5 else 2]
            writer.write(to, k, store.serialize_cdr(kind[SAMPLE](state, seen), SAMPLE))
    result = program("hand-eye", tmp_path / "run", "--robot", "irb1600", "--json")
    camera = next(frame for frame in result["frames"] if frame["device"] == "camera")
    assert (camera["name"], camera["on"], result["pictures"]) == ("head", "base", 7)
    np.testing.assert_allclose([camera[f"{axis}_mm"] for axis in "xyz"], own["centre"] / MM, rtol=0, atol=1e-4)
    assert "7 of 8 samples have points of a camera and of a chain" in result["notes"]
    (tmp_path / "f.csv").write_text("feature,kind,target\nhead,image,arm\n")
    rows = read_features(*corner_rows(tmp_path / "run", tmp_path / "f.csv", arm), arm)
    np.testing.assert_allclose(rows.q, np.delete(q, 5, axis=0), rtol=0, atol=1e-12)
    with pytest.raises(MeasurementError, match=r"sample 1: no joint panda_joint1; found finger, joint_1, joint_2"):
        hand_eye(tmp_path / "run", tmp_path / "f.csv", robot="panda")
