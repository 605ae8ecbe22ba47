"""Boards drawn by OpenCV, seen by a known homography: corners must be where it puts them."""

import os

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import features, imaging

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
