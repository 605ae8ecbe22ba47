"""Lenses from pictures alone: corners of a known lens, intervals that hold, files of other programs."""

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import features, imaging, lens_formats
from irbcal.measurement.lens import calibrated

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless (pip install irbcal[camera])")

SIZE = (1280, 960)
LENS = np.array([1100.0, 1105.0, 650.0, 470.0, -0.12, 0.05, 0.0008, -0.0005, 0.0])
BOARD = np.column_stack([(np.mgrid[0:6, 0:9].reshape(2, -1)[::-1].T * 0.03), np.zeros(54)])


def views(pictures, seed, noise=0.1, lens=LENS):
    """SIMULATED pictures of a board, by projection written out here."""
    rng = np.random.default_rng(seed)
    out = {}
    while len(out) < pictures:
        R = cv2.Rodrigues(rng.uniform(-0.6, 0.6, 3))[0]
        middle = np.array([*rng.uniform(-0.15, 0.15, 2), rng.uniform(0.35, 0.7)])
        y = (BOARD - BOARD.mean(axis=0)) @ R.T + middle
        a, b = y[:, 0] / y[:, 2], y[:, 1] / y[:, 2]
        r2 = a * a + b * b
        k1, k2, p1, p2, k3 = lens[4:]
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        u = lens[0] * (a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)) + lens[2]
        v = lens[1] * (b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b) + lens[3]
        uv = np.column_stack([u, v])
        if ((uv > 0) & (uv < SIZE)).all():
            out[f"{len(out)}.png"] = BOARD[:, :2], uv + noise * rng.standard_normal(uv.shape)
    return out


def test_without_noise_the_lens_comes_back():
    lens = calibrated(cv2, "camera", SIZE, views(12, 0, 0.0), "pictures")
    np.testing.assert_allclose(lens.numbers[:4], LENS[:4], rtol=0, atol=0.02)
    np.testing.assert_allclose(lens.numbers[4:8], LENS[4:8], rtol=0, atol=2e-3)
    assert lens.heldout_rms_pixels < 1e-2


def test_intervals_hold_and_left_out_pictures_show_the_noise():
    inside, heldout = [], []
    for seed in range(6):
        lens = calibrated(cv2, "camera", SIZE, views(10, seed), "pictures")
        fitted = lens.u95 > 0
        inside += [*(np.abs(lens.numbers - LENS) < lens.u95)[fitted]]
        heldout.append(lens.heldout_rms_pixels)
    assert 0.88 < np.mean(inside) <= 1.0
    assert np.mean(heldout) == pytest.approx(0.1 * np.sqrt(2), rel=0.1)


def test_small_tangential_numbers_are_fitted_for_the_centre():
    """Without them the centre takes them up: up to 3.4 of its half-widths from the truth."""
    small = np.array([*LENS[:6], 2e-4, -1.4e-4, 0.0])
    lenses = [calibrated(cv2, "camera", SIZE, views(14, seed, 0.03, small), "pictures") for seed in range(3)]
    off = np.array([(lens.numbers - small)[2:4] / lens.u95[2:4] for lens in lenses])
    assert np.abs(off).max() < 1.6
    assert all(lens.numbers[8] == 0.0 for lens in lenses)


def test_a_lens_without_distortion_has_zero_in_its_intervals_and_none_where_none_is_asked_for():
    pinhole = np.array([*LENS[:4], 0, 0, 0, 0, 0])
    seen = views(15, 3, 0.1, pinhole)
    lens = calibrated(cv2, "camera", SIZE, seen, "pictures")
    assert (np.abs(lens.numbers[4:]) <= 1.5 * lens.u95[4:]).all()
    assert lens.numbers[8] == 0.0
    plain = calibrated(cv2, "camera", SIZE, seen, "pictures", ("fx", "fy", "cx", "cy"))
    assert (plain.numbers[4:] == 0).all()
    assert (plain.u95[4:] == 0).all()


def test_pictures_that_are_too_few_are_refused():
    with pytest.raises(MeasurementError, match="3 pictures show a board to camera: 5 are needed"):
        calibrated(cv2, "camera", SIZE, views(3, 0), "pictures")


KNOWN = {"feature": "plate", "kind": "image-on-tool", "pattern": "chessboard", "squares_x": 10, "squares_y": 7}


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """SIMULATED pictures of a chessboard by a pinhole camera."""
    folder = tmp_path_factory.mktemp("lens")
    scale, rng = 40, np.random.default_rng(2)
    drawn = np.full((9 * scale, 12 * scale), 255, dtype=np.uint8)
    for j in range(7):
        for i in range(10):
            if (i + j) % 2 == 0:
                drawn[(j + 1) * scale : (j + 2) * scale, (i + 1) * scale : (i + 2) * scale] = 0
    K = np.array([[525.0, 0, 240], [0, 525, 180], [0, 0, 1]])
    to_board = np.array([[0.03 / scale, 0, -0.18], [0, 0.03 / scale, -0.135], [0, 0, 1]])
    for k in range(10):
        R = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0]
        H = K @ np.column_stack([R[:, 0], R[:, 1], [*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.5, 0.7)]]) @ to_board
        shown = cv2.warpPerspective(drawn, H, (480, 360), flags=cv2.INTER_AREA, borderValue=255)
        cv2.imwrite(str(folder / f"{k}.png"), cv2.GaussianBlur(shown, (3, 3), 0.7))
    cv2.imwrite(str(folder / "empty.png"), np.full((360, 480), 200, dtype=np.uint8))
    return folder


@pytest.fixture(scope="module")
def lens_of_pictures(pictures):
    return irbcal.lens(pictures, pd.DataFrame([KNOWN | {"square_mm": 30}]))


@pytest.mark.parametrize("as_", ["features", *lens_formats.FORMATS])
def test_pictures_become_a_lens_that_features_read(pictures, lens_of_pictures, tmp_path, program, as_):
    out = tmp_path / ("camera.csv" if as_ == "features" else "camera.yaml")
    result = lens_of_pictures.to_dict()
    if as_ == "ros":
        known = tmp_path / "board.csv"
        pd.DataFrame([KNOWN | {"square_mm": 30}]).to_csv(known, index=False)
        result = program("lens", pictures, "--features", known, "--as", as_, "--out", out, "--json")
    else:
        lens_of_pictures.save(out, as_)
    (lens,) = result["lenses"]
    assert lens["pictures"] == 10
    assert result["left_out"] == ["empty.png"]
    assert lens["heldout_px"] < 0.2
    for name, value in {"fx_px": 525, "fy_px": 525, "cx_px": 240, "cy_px": 180}.items():
        assert abs(lens[name]["value"] - value) < 2.25
    if as_ != "features":
        pd.DataFrame([KNOWN | {"square_mm": 30, "lens": out.name}]).to_csv(tmp_path / "camera.csv", index=False)
    (row,) = features.given_rows(tmp_path / "camera.csv")
    back = imaging.imaging_of(row)
    np.testing.assert_allclose(back.lens, [lens[name]["value"] for name in imaging.LENS], rtol=1e-12)
    assert back.size == (480, 360)
    if as_ == "opencv":  # its own reader
        storage = cv2.FileStorage(str(out), cv2.FILE_STORAGE_READ)
        assert storage.getNode("camera_matrix").mat()[0, 0] == pytest.approx(back.lens[0], rel=1e-12)
        storage.release()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1", "expected a lens: ROS camera_info, OpenCV's FileStorage, Kalibr's camchain"),
        ("cam0: {intrinsics: [1, 2, 3, 4], camera_model: omni, resolution: [6, 4]}", "expected pinhole and radtan"),
        ("{image_width: 4, camera_matrix: {data: [1, 2]}}", "this is no lens as ROS camera_info has it"),
        ("[: ", "expected YAML"),
    ],
)
def test_other_files_are_refused(tmp_path, text, words):
    (tmp_path / "lens.yaml").write_text(text)
    with pytest.raises(MeasurementError, match=words):
        features.given_rows(pd.DataFrame([KNOWN | {"square_mm": 30, "lens": str(tmp_path / "lens.yaml")}]))


def test_an_unknown_format_is_refused_before_the_work(tmp_path):
    with pytest.raises(OptionError, match="expected features, ros, opencv or kalibr"):
        irbcal.lens(tmp_path, pd.DataFrame([KNOWN | cases.camera()]), as_="halcon")


def test_a_number_to_fit_that_no_lens_has_is_refused_before_the_work(tmp_path):
    with pytest.raises(MeasurementError, match="cannot fit 'k4': of a camera fx, fy, cx, cy, k1"):
        irbcal.lens(tmp_path, pd.DataFrame([KNOWN | {"square_mm": 30, "fit": "fx k4"}]))
