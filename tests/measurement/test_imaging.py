import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.identification.feature_problem import FeatureProblem
from irbcal.measurement import features, imaging

UV = 100.0 + 40.0 * np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])


def corners(**more):
    """Two images of six corners, a row each; the second is given in the board's axes."""
    table = pd.DataFrame({f"q{k}_deg": [10.0] * 6 + [20.0] * 6 for k in range(1, 7)})
    table["pose"], table["feature"] = ["a"] * 6 + ["b"] * 6, "board"
    table["corner"] = ["0", "1", "2", "7", "8", "9"] + [""] * 6
    table["x_mm"] = [""] * 6 + ["30", "60", "90"] * 2
    table["y_mm"] = [""] * 6 + ["30"] * 3 + ["60"] * 3
    table["u_px"], table["v_px"] = np.tile(UV, (2, 1)).T
    return table.assign(**more)


def changed(column, row, value):
    table = corners().astype(object)
    table.loc[row, column] = value
    return table


def known(**more):
    return pd.DataFrame([{"feature": "board", "kind": "image-on-tool", **cases.camera(**more)}]).fillna("")


def test_corners_of_an_image_become_a_row():
    seen = features.read(corners(), known(), cases.arm())
    assert len(seen) == 2
    assert list(seen.target) == ["camera"] * 2
    assert list(seen.row) == [1, 7]
    xy = [[0.03, 0.03], [0.06, 0.03], [0.09, 0.03], [0.03, 0.06], [0.06, 0.06], [0.09, 0.06]]
    for image in seen.corners:  # numbered and measured places are the same
        np.testing.assert_allclose(image[:, :2], xy, atol=1e-12)
        np.testing.assert_allclose(image[:, 2:4], UV, rtol=0, atol=1e-9)
    assert not np.isfinite(seen.xyz).any()
    np.testing.assert_allclose(imaging.per_pixel(seen.corners), 0.03 / 40, rtol=1e-9)
    np.testing.assert_allclose(seen.u95, 0.2 * 0.03 / 40 / np.sqrt(6), rtol=1e-9)
    assert "12 corners in all" in str(seen.summary())
    one = seen.select(np.array([False, True]))
    np.testing.assert_array_equal(one.corners[0], seen.corners[1])
    back = features.read(
        corners(),
        pd.DataFrame([seen.features["board"].imaging.columns() | {"feature": "board", "kind": "image-on-tool"}]),
        cases.arm(),
    )
    np.testing.assert_array_equal(back.features["board"].imaging.lens, cases.LENS_OF)


def test_images_may_be_of_different_sizes():
    seen = features.read(corners().drop(index=[4, 5]), known(u95_px=0.4), cases.arm())
    assert np.isfinite(seen.corners[:, :, 2]).sum(axis=1).tolist() == [4, 6]
    assert seen.u95[1] == pytest.approx(0.4 * 0.03 / 40 / np.sqrt(6))


def test_what_one_row_says_of_a_camera_holds_for_all():
    first = {"feature": "one", "kind": "image-on-tool", **cases.camera(fit="fx k1")}
    second = {"feature": "two", "kind": "image-on-tool", "squares_x": 8, "squares_y": 6, "square_mm": 15}
    table = pd.concat([corners(feature="one"), corners(feature="two")])
    seen = features.read(table, pd.DataFrame([first, second]).astype(object).fillna(""), cases.arm())
    two = seen.features["two"].imaging
    np.testing.assert_array_equal(two.lens, cases.LENS_OF)
    assert two.board.pitch == 0.015
    assert two.fit == ("fx", "k1")
    second["fx_px"] = 1500
    with pytest.raises(MeasurementError, match=r"row 2.*camera camera has fx_px 1400.0 in one row and 1500"):
        features.read(table, pd.DataFrame([first, second]).astype(object).fillna(""), cases.arm())


@pytest.mark.parametrize(
    ("rows", "what", "words"),
    [
        (corners().drop(columns="u_px"), known(), "row 1.*a row of kind image-on-tool needs u_px and v_px"),
        (changed("v_px", 3, ""), known(), "row 4, column v_px.*needs u_px and v_px"),
        (changed("u_px", 3, "nan"), known(), "row 4, column u_px"),
        (
            changed("u_px", [3, 9], "3000"),
            known(),
            "expected a place within the image of 1920 pixels, found 3000, as 2 of 12 corners",
        ),
        (
            changed("corner", 2, "35"),
            known(),
            r"corner 35 is not on the board: board has 8 × 6 squares, so corners 0 to 34",
        ),
        (changed("corner", 2, "1"), known(), "row 3, column corner.*this corner is in its image twice"),
        (changed("corner", 2, ""), known(), "a corner needs its number, or x_mm and y_mm"),
        (corners().drop(index=[3, 4, 5]), known(), "row 1.*at least 4 corners that are not on one line, found 3"),
        (corners(z_mm=[""] * 11 + ["5"]), known(), "boards are flat"),
        (
            corners(target="other"),
            known(),
            "seen with camera; for other give it a feature of another name, such as board other",
        ),
        (corners(feature="plate", kind="image"), known(), "row 1.*needs fx_px … of its camera"),
        (
            corners(),
            known(fx_px=""),
            "row 1, column fx_px: nothing is known of the lens of camera: a camera needs fx_px",
        ),
        (corners(), known(squares_y=""), "expected squares_x, squares_y, square_mm, all or none"),
        (corners(), known(squares_x="nan"), "expected squares_x, squares_y, square_mm, all or none"),
        (corners(), known(squares_y=6.5), "a board has 3 to 200 squares along each side, found 6.5"),
        (corners(), known(squares_y=6e5), "a board has 3 to 200 squares along each side, found 600000"),
        (corners(), known(square_mm=-3), "expected a number above zero, found -3"),
        (corners(), known(fit="k4"), "cannot fit 'k4'"),
        (corners(), known(squares_x="", squares_y="", square_mm=""), "needs squares_x, squares_y, square_mm to number"),
    ],
)
def test_refusals_name_row_and_column(rows, what, words):
    with pytest.raises(MeasurementError, match=words):
        features.read(rows.astype(object), what, cases.arm())


@pytest.mark.parametrize(("beyond", "left"), [([0], 10), ([0, 1, 2], 9), ([0, 3, 4], 9)])
def test_corners_beyond_the_image_are_left_out_and_a_picture_only_with_what_it_needs(beyond, left):
    """A picture goes where fewer than four are left, or all on one line; the file never."""
    pictures = [corners().iloc[:6].assign(pose=f"p{k}") for k in range(10)]
    pictures[3].loc[beyond, "u_px"] = 1e4
    seen = features.read(pd.concat(pictures, ignore_index=True), known(), cases.arm())
    assert len(seen) == left
    assert ("p3" in set(seen.pose)) == (left == 10)
    assert seen.outside == (len(beyond) if left == 10 else 6)


def test_points_in_pictures_are_rows_of_their_own():
    table = corners().drop(columns=["corner", "x_mm", "y_mm"]).iloc[[0, 6]]
    what = known(kind="depth-on-tool", u95_px=0.5)
    seen = features.read(table.assign(value_mm=[800, 900]), what, cases.arm())
    np.testing.assert_allclose(seen.corners[:, :, 2:4], UV[[0, 0]][:, None], rtol=0, atol=1e-9)
    np.testing.assert_allclose(seen.value, [0.8, 0.9], rtol=0, atol=1e-12)
    np.testing.assert_allclose(seen.u95, 0.5 / cases.LENS_OF[0], rtol=1e-9)  # metres, a metre away
    with pytest.raises(MeasurementError, match=r"row 2.*this point is in its image twice"):
        features.read(corners().iloc[:2], what, cases.arm())
    with pytest.raises(MeasurementError, match="row 1, column value_mm: a row of kind depth-on-tool needs value_mm"):
        FeatureProblem(cases.arm(), features.read(table, what, cases.arm()), [])
