"""Boards drawn by OpenCV, seen by a known homography: corners must be where it puts them."""

import os

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.urdf import read_urdf
from irbcal.measurement import features, imaging
from irbcal.modeling import frames

SIZE, SQUARES, SQUARE, SCALE = (640, 480), (8, 6), 0.03, 60  # pixels of a square as drawn
KNOWN = {
    "feature": "board",
    "kind": "image-on-tool",
    "fx_px": 700,
    "cx_px": 320,
    "cy_px": 240,
    "width_px": SIZE[0],
    "height_px": SIZE[1],
    "squares_x": SQUARES[0],
    "squares_y": SQUARES[1],
    "square_mm": 30,
    "marker_mm": 22,
    "dictionary": "DICT_5X5_100",
}
HOMOGRAPHIES = [
    np.array([[1.0, 0.1, 60.0], [-0.05, 1.0, 70.0], [2e-4, -1e-4, 1.0]]),
    np.array([[0.7, -0.5, 260.0], [0.5, 0.7, 20.0], [-1e-4, 3e-4, 1.0]]),
]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Two pictures of a board and an empty one; the joints' table."""
    cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless (pip install irbcal[camera])")
    folder = tmp_path_factory.mktemp("pictures")
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard(SQUARES, SQUARE, 0.022, words)
    drawn = board.generateImage((SQUARES[0] * SCALE, SQUARES[1] * SCALE), marginSize=0)
    for k, H in enumerate(HOMOGRAPHIES):
        seen = cv2.warpPerspective(drawn, H, SIZE, flags=cv2.INTER_AREA, borderValue=200)
        cv2.imwrite(str(folder / f"{k}.png"), cv2.GaussianBlur(seen, (3, 3), 0.7))
    cv2.imwrite(str(folder / "empty.png"), np.full(SIZE[::-1], 200, dtype=np.uint8))
    joints = pd.DataFrame({f"q{k}_deg": [1.0, 2.0, 3.0] for k in range(1, 7)})
    return folder, joints.assign(image=["0.png", "1.png", "empty.png"], place=["a", "b", "b"])


def test_corners_are_found_where_the_board_was_put(pictures):
    folder, joints = pictures
    found = irbcal.corners(folder, joints, pd.DataFrame([KNOWN]))
    assert found.images == 2
    assert found.missed == (("empty.png", 0),)
    assert "left out, with fewer than 4 corners or all on one line: empty.png" in str(found.summary())
    table = found.to_frame()
    assert list(table.place.unique()) == ["a", "b"]
    for k, H in enumerate(HOMOGRAPHIES):
        mine = table[table.image == f"{k}.png"]
        assert len(mine) == 35
        number = mine.corner.to_numpy(dtype=int)
        # a pixel's middle is a whole number: the drawing's first square ends half a pixel before SCALE
        drawn = SCALE * np.column_stack([number % 7 + 1.0, number // 7 + 1.0]) - 0.5
        there = np.column_stack([drawn, np.ones(len(drawn))]) @ H.T
        miss = mine[["u_px", "v_px"]].to_numpy(dtype=float) - there[:, :2] / there[:, 2:]
        assert np.abs(miss).max() < 0.25
        assert np.sqrt(np.mean(miss**2)) < 0.1


def drawn_by_hand(cv2, pattern):
    """A board as its description has it, with a margin of a square; its size in squares."""
    across, along = {"chessboard": (8, 5), "circles": (7, 5), "rings": (7, 5)}.get(pattern, (4, 9))
    margin = 2 * SCALE
    if pattern == "circles-staggered":
        size = (along * SCALE // 2, across * SCALE)
        middles = [(SCALE * (i + 0.5 * (j % 2)), SCALE * 0.5 * j) for j in range(along) for i in range(across)]
    else:
        size = (along * SCALE, across * SCALE)
        middles = [(SCALE * i, SCALE * j) for j in range(along) for i in range(across)]
    drawn = np.full((size[0] + 2 * margin, size[1] + 2 * margin), 255, dtype=np.uint8)
    for k, (x, y) in enumerate(middles):
        if pattern == "chessboard" and (k % across + k // across) % 2 == 0:
            drawn[margin + y : margin + y + SCALE, margin + x : margin + x + SCALE] = 0
        elif pattern != "chessboard":
            at = (round(16 * (margin + x)), round(16 * (margin + y)))
            cv2.circle(drawn, at, 16 * 12, 0, 6 if pattern == "rings" else -1, cv2.LINE_AA, 4)
    if pattern == "chessboard":  # inner corners, between pixels
        middles = [(SCALE * (i + 1), SCALE * (j + 1)) for j in range(along - 1) for i in range(across - 1)]
    at = np.array(middles) + margin - (0.5 if pattern == "chessboard" else 0.0)
    return drawn, (across, along), at


def of_markers(cv2, words, across, along, first):
    board = cv2.aruco.GridBoard((across, along), 0.02, 0.01, words, first + np.arange(across * along))
    size = (across * 60 - 20 + 80, along * 60 - 20 + 80)
    drawn = board.generateImage(size, marginSize=40)
    middles = [(60 * i + 40 * a, 60 * j + 40 * b) for j in range(along) for i in range(across) for a, b in CORNERS]
    return drawn, (across, along), np.array(middles) + 39.5


def aprilgrid(codes, across, along):
    """A grid as Kalibr prints it: numbers from below, a border of two bits, squares of three bits between the tags."""
    bit, gap = 6, 18
    pitch = 10 * bit + gap
    size = (along * pitch + 3 * gap, across * pitch + 3 * gap)
    drawn, at = np.full(size, 255, dtype=np.uint8), []
    for k, code in enumerate(codes):
        x, y = 2 * gap + k % across * pitch, size[0] - gap - (k // across + 1) * pitch
        tag = np.zeros((10, 10), dtype=np.uint8)
        tag[2:8, 2:8] = [[255 * (code >> (35 - 6 * i - j) & 1) for j in range(6)] for i in range(6)]
        drawn[y : y + 10 * bit, x : x + 10 * bit] = np.kron(tag, np.ones((bit, bit), dtype=np.uint8))
        for a in (x - gap, x + 10 * bit):
            for b in (y - gap, y + 10 * bit):
                drawn[b : b + gap, a : a + gap] = 0
        at += [(x + a * 10 * bit, y + b * 10 * bit) for a, b in ((1, 1), (0, 1), (0, 0), (1, 0))]
    return drawn, np.array(at) - 0.5


T36H11 = [0xD5D628584, 0xD97F18B49, 0xDD280910E, 0xE479E9C98, 0xEBCBCA822, 0xF31DAB3AC]
"""The first codes of the family, whose first bit is the upper left one (Olson 2011)."""


@pytest.mark.parametrize("H", [0, 1])
def test_a_grid_of_kalibr_is_found(H, tmp_path):
    cv2 = pytest.importorskip("cv2")
    drawn, at = aprilgrid(T36H11, 3, 2)
    H = np.array([[1.4, -0.6, 260.0], [0.6, 1.2, 20.0], [-1e-4, 3e-4, 1.0]]) if H else np.diag([2.0, 2.0, 1.0])
    shown = cv2.warpPerspective(drawn, H, SIZE, borderValue=255)
    cv2.imwrite(str(tmp_path / "0.png"), cv2.GaussianBlur(shown, (3, 3), 0.7))
    (tmp_path / "grid.yaml").write_text(
        "{target_type: aprilgrid, tagCols: 3, tagRows: 2, tagSize: 0.05, tagSpacing: 0.3}"
    )
    (tmp_path / "f.csv").write_text("feature,kind,board\nboard,image-on-tool,grid.yaml\n")
    joints = pd.DataFrame({f"q{k}_deg": [1.0] for k in range(1, 7)}).assign(image="0.png")
    table = irbcal.corners(tmp_path, joints, tmp_path / "f.csv").to_frame()
    number = table.corner.to_numpy(dtype=int)
    assert sorted(number) == list(range(24))
    there = np.column_stack([at, np.ones(len(at))]) @ H.T
    miss = table[["u_px", "v_px"]].to_numpy(dtype=float) - (there[:, :2] / there[:, 2:])[number]
    assert np.abs(miss).max() < 0.25
    board = (
        imaging.board_of(features.given_rows(tmp_path / "f.csv")[0]).corners / 0.05 * 60
    )  # y upwards, in the drawing down
    np.testing.assert_allclose((board - board[0]) * [1, -1], at - at[0], rtol=0, atol=1e-9)


CORNERS = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(
    "pattern", ["chessboard", "circles", "rings", "circles-staggered", "markers", "a marker", "AprilTags"]
)
@pytest.mark.parametrize("turned", [False, True], ids=["level", "turned"])
def test_boards_of_all_patterns(pattern, turned, tmp_path):
    H = np.array([[0.5, -0.4, 260.0], [0.4, 0.5, 20.0], [-1e-4, 3e-4, 1.0]]) if turned else HOMOGRAPHIES[0]
    cv2 = pytest.importorskip("cv2")
    more = {"dictionary": "", "marker_mm": "", "pattern": "circles" if pattern == "rings" else pattern}
    if pattern in ("markers", "a marker", "AprilTags"):
        name = "DICT_APRILTAG_36h11" if pattern == "AprilTags" else "DICT_5X5_100"
        words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        drawn, size, at = of_markers(cv2, words, *((1, 1) if pattern == "a marker" else (4, 3)), 17)
        more = {"dictionary": name, "marker_mm": 20, "pattern": "markers", "first_marker": 17}
    else:
        drawn, size, at = drawn_by_hand(cv2, pattern)
    shown = cv2.warpPerspective(drawn, H, SIZE, flags=cv2.INTER_AREA, borderValue=255)
    cv2.imwrite(str(tmp_path / "0.png"), cv2.GaussianBlur(shown, (3, 3), 0.7))
    joints = pd.DataFrame({f"q{k}_deg": [1.0] for k in range(1, 7)}).assign(image="0.png")
    known = KNOWN | {"squares_x": size[0], "squares_y": size[1], "square_mm": 30} | more
    table = irbcal.corners(tmp_path, joints, pd.DataFrame([known])).to_frame()
    there = np.column_stack([at, np.ones(len(at))]) @ H.T
    there = there[:, :2] / there[:, 2:]
    uv = table[["u_px", "v_px"]].to_numpy(dtype=float)
    number = table.corner.to_numpy(dtype=int)
    assert len(uv) == len(at)
    # circles are numbered from either end, chessboards from the end with the light square
    ways = [there[number], there[::-1]] if pattern in ("circles", "rings", "chessboard") else [there[number]]
    miss = min(np.sqrt(np.mean((uv - way) ** 2)) for way in ways)
    assert miss < (0.6 if more.get("dictionary") else 0.35)  # blur moves a marker's corners inwards
    board = imaging.board_of({key: str(value) for key, value in known.items()} | {"row": "1", "source": ""})
    on_board = board.corners / 0.03 * SCALE
    np.testing.assert_allclose(on_board - on_board[0], at - at[0], rtol=0, atol=1e-9)


def test_a_file_for_a_calibration_comes_out(pictures, tmp_path):
    folder, joints = pictures
    joints.to_csv(tmp_path / "joints.csv", index=False)
    pd.DataFrame([KNOWN]).to_csv(tmp_path / "camera.csv", index=False)
    line = [
        "corners",
        str(folder),
        "--joints",
        str(tmp_path / "joints.csv"),
        "--features",
        str(tmp_path / "camera.csv"),
    ]
    told = CliRunner().invoke(app, [*line, "--out", str(tmp_path / "corners.csv")])
    assert told.exit_code == 0, told.output
    assert "70 corners in 2 images" in told.output
    seen = features.read(tmp_path / "corners.csv", tmp_path / "camera.csv", irbcal.read_urdf("irb1600").arm)
    assert len(seen) == 2
    assert list(seen.cells.place) == ["a", "b"]


def test_a_board_is_named_by_its_place(pictures):
    """Of one board at several places each place is a feature of its own, which the rows then name."""
    folder, joints = pictures
    known = pd.DataFrame([KNOWN | {"feature": "board {place}"}])
    table = irbcal.corners(folder, joints.iloc[:2], known).to_frame()
    assert table.groupby("image").feature.unique().map(list).to_dict() == {"0.png": ["board a"], "1.png": ["board b"]}
    seen = features.read(table, known, irbcal.read_urdf("irb1600").arm)
    assert list(seen.feature) == ["board a", "board b"]
    with pytest.raises(MeasurementError, match=r"asks for the column place, which .* does not have"):
        irbcal.corners(folder, joints.drop(columns="place"), known)
    with pytest.raises(MeasurementError, match=r"row 2, column feature.*one of board {place}; found board c"):
        irbcal.corners(folder, joints.assign(feature=["board a", "board c", ""]), known)


@pytest.mark.parametrize(
    ("joints", "known", "words"),
    [
        ({"image": ["0.png", "none.png", "1.png"]}, {}, "row 2.*there is no picture none.png"),
        ({"feature": ["board", "other", "board"]}, {}, "row 2, column feature.*one of board; found other"),
        ({}, {"width_px": 600}, r"0.png has 640 × 480 pixels, the camera 600 × 480"),
        ({}, {"dictionary": "5X5"}, "expected one of OpenCV's dictionaries.*found 5X5"),
        ({}, {"marker_mm": 29.9999999}, "row 1, column squares_x: OpenCV makes no board of 8 × 6 squares of 30 mm"),
        ({}, {"marker_mm": 31}, "expected a marker smaller than its square, found 31 mm"),
        ({}, {"squares_x": 9}, "no picture shows 4 corners"),
        ({}, {"kind": "point"}, "there is no feature of kind image or image-on-tool"),
    ],
)
def test_refusals_name_what_is_wrong(pictures, joints, known, words):
    folder, table = pictures
    if "squares_x" in known:
        table = table.iloc[2:]
    with pytest.raises(MeasurementError, match=words):
        irbcal.corners(folder, table.assign(**joints), pd.DataFrame([KNOWN | known]))


def test_without_opencv_it_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(OptionError, match=r"pip install 'irbcal\[camera\]'"):
        irbcal.corners(".", pd.DataFrame({"image": ["0.png"]}), pd.DataFrame([KNOWN]))


def test_a_damaged_picture_is_refused_in_one_sentence(pictures, tmp_path, capfd):
    folder, joints = pictures
    whole = (folder / "0.png").read_bytes()
    (tmp_path / "0.png").write_bytes(whole[:2000] + bytes([whole[2000] ^ 255]) + whole[2001:])
    with pytest.raises(MeasurementError, match=r"there is no picture 0\.png"):
        irbcal.corners(tmp_path, joints.head(1), pd.DataFrame([KNOWN]))
    assert capfd.readouterr().err == ""


def test_a_pipe_is_no_picture(pictures, tmp_path):
    joints = pictures[1]
    os.mkfifo(tmp_path / "0.png")
    with pytest.raises(MeasurementError, match=r"there is no picture 0\.png"):
        irbcal.corners(tmp_path, joints.head(1), pd.DataFrame([KNOWN]))


DIE, TAG, SHEET = 0.06, 0.044, 300  # side of the die and of a tag, metres; pixels of a side as drawn
K = np.array([[1200.0, 0.0, 480.0], [0.0, 1200.0, 360.0], [0.0, 0.0, 1.0]])
FACES = {  # of each tag: its x and y on the die
    3: ([1, 0, 0], [0, -1, 0]),
    7: ([0, 1, 0], [0, 0, -1]),
    8: ([0, -1, 0], [0, 0, -1]),
    11: ([-1, 0, 0], [0, 0, -1]),
    20: ([1, 0, 0], [0, 0, -1]),
}


def square(tag, side):
    """Corners of a square on a side of the die, from the upper left one on clockwise, (4, 3), metres."""
    x, y = np.array(FACES[tag], dtype=float)
    outward = np.cross(y, x)
    return 0.5 * DIE * outward + 0.5 * side * np.array([-x - y, x - y, x + y, y - x])


def die_seen(cv2, T):
    """A SIMULATED picture of the die at a pose before the camera; sides that face away are not seen."""
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    shown = np.full((720, 960), 120, dtype=np.uint8)
    for tag in FACES:
        corners = square(tag, DIE) @ T[:3, :3].T + T[:3, 3]
        x, y = np.array(FACES[tag], dtype=float) @ T[:3, :3].T
        if np.cross(y, x) @ corners.mean(axis=0) > 0.0:
            continue
        side = np.full((SHEET, SHEET), 255, dtype=np.uint8)
        inner, margin = round(SHEET * TAG / DIE), (SHEET - round(SHEET * TAG / DIE)) // 2
        side[margin : margin + inner, margin : margin + inner] = cv2.aruco.generateImageMarker(words, tag, inner)
        uv = (corners / corners[:, 2:]) @ K.T
        edges = np.array([[0, 0], [SHEET, 0], [SHEET, SHEET], [0, SHEET]], dtype=np.float32) - 0.5
        H = cv2.getPerspectiveTransform(edges, uv[:, :2].astype(np.float32))
        seen = cv2.warpPerspective(side, H, (960, 720), flags=cv2.INTER_AREA)
        inside = cv2.warpPerspective(np.full_like(side, 255), H, (960, 720)) > 127
        shown[inside] = seen[inside]
    return cv2.GaussianBlur(shown, (3, 3), 0.7)


def test_tags_on_a_die_are_a_body_whose_corners_place_the_camera(tmp_path, program):
    """Each picture shows other sides; hand-eye takes the pictures, and the rows that corners writes."""
    cv2 = pytest.importorskip("cv2")
    corners_of_die = {tag: square(tag, TAG) for tag in FACES}
    body = [f"{tag},{x},{y},{z}" for tag, of in corners_of_die.items() for x, y, z in 1e3 * of]
    (tmp_path / "die.csv").write_text("\n".join(["marker,x_mm,y_mm,z_mm", *body]))
    (tmp_path / "camera.csv").write_text(
        "feature,kind,target,fx_px,cx_px,cy_px,width_px,height_px,board,dictionary\n"
        "hall,image,die,1200,480,360,960,720,die.csv,4x4_50\n"
    )
    rng = np.random.default_rng(3)
    on_flange = frames.transform(frames.rotation_from_vector(np.array([0.2, -0.3, 0.4])), np.array([0.02, 0.01, 0.09]))
    turn = frames.rotation_from_vector(np.array([2.6, 0.4, 0.2]))
    camera = frames.transform(turn, np.array([0.7, 0.1, 0.9]))
    table, T_die = [], []
    for k in range(10):
        R = frames.rotation_from_vector(rng.uniform(-0.9, 0.9, 3)) @ frames.rotation_from_vector(
            np.array([np.pi, 0, 0])
        )
        T_die.append(frames.transform(R, np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.3, 0.45)])))
        cv2.imwrite(str(tmp_path / f"{k}.png"), die_seen(cv2, T_die[-1]))
        flange = camera @ T_die[-1] @ frames.inverse(on_flange)
        q = frames.quaternion_from_matrix(flange[None, :3, :3])[0]
        table.append([f"{k}.png", *flange[:3, 3] * 1e3, *q])
    heads = ["image", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
    poses = pd.DataFrame(table, columns=heads)
    poses.to_csv(tmp_path / "poses.csv", index=False)
    given = ["--features", tmp_path / "camera.csv"]
    result = program("hand-eye", tmp_path / "poses.csv", *given, "--images", tmp_path, "--json")
    assert result["pictures"] == 10
    for name, true in (("die", on_flange), ("hall", camera)):
        (frame,) = (frame for frame in result["frames"] if frame["name"] == name)
        np.testing.assert_allclose([frame[f"{axis}_mm"] for axis in "xyz"], true[:3, 3] * 1e3, rtol=0, atol=0.5)
    joints = poses[["image"]].assign(**{f"q{j}_deg": 10.0 * j for j in range(1, 7)})
    found = irbcal.corners(tmp_path, joints, tmp_path / "camera.csv").to_frame()
    assert found.groupby("image").size().nunique() > 1
    for k, of in found.groupby(found.image.str.removesuffix(".png").astype(int)):
        y = of[["x_mm", "y_mm", "z_mm"]].to_numpy() * 1e-3 @ T_die[k][:3, :3].T + T_die[k][:3, 3]
        uv = (y / y[:, 2:]) @ K.T
        assert np.abs(of[["u_px", "v_px"]].to_numpy() - uv[:, :2]).max() < 1.2
    rows = features.read(found, tmp_path / "camera.csv", read_urdf("irb1600").arm)
    assert rows.corners.shape[2] == 6
    with pytest.raises(MeasurementError, match="the lens comes from a flat board, not from markers on a body"):
        irbcal.lens(tmp_path, tmp_path / "camera.csv")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: rows[:3], "row 2, column marker: marker 3 has 3 rows, expected its four corners"),
        (
            lambda rows: [rows[1], rows[0], *rows[2:]],
            "corners of marker 3 are no square in this order: expected them clockwise",
        ),
        (lambda rows: ["1.5,0,0,0", *rows], "expected the number of a marker, found 1.5"),
        (lambda rows: [], "no rows"),
    ],
)
def test_a_body_of_markers_that_is_none_is_refused(tmp_path, change, words):
    pytest.importorskip("cv2")
    rows = [f"3,{x},{y},{z}" for x, y, z in square(3, TAG)]
    (tmp_path / "die.csv").write_text("\n".join(["marker,x_mm,y_mm,z_mm", *change(rows)]) + "\n")
    row = {"feature": "hall", "kind": "image", "target": "die", "board": str(tmp_path / "die.csv")}
    joints = pd.DataFrame([{"image": "0.png"} | {f"q{k}_deg": 0.0 for k in range(1, 7)}])
    with pytest.raises(MeasurementError, match=words):
        irbcal.corners(tmp_path, joints, pd.DataFrame([row | {"dictionary": "DICT_4X4_50"}]))
