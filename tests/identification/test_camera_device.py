import feature_cases as cases
import numpy as np
import pytest

from irbcal.modeling import frames
from irbcal.simulation import devices
from irbcal.simulation.devices import BALL, DEVICES, placed


def test_a_board_is_seen_from_its_front_and_whole():
    """A tip that looks down onto the board's middle, from 0.5 m; then aside, from behind and too slanted."""
    found = placed(cases.arm(), DEVICES["camera"])
    own, middle = dict(found.unknowns["board 1"]), found.middle["board 1"]
    down = frames.rotation_from_vector([np.pi, 0, 0]) @ devices.CAMERA_AXES.T  # camera axes: z down

    def tip(R, away):
        place = middle + away - R @ np.array(BALL)
        return frames.transform(R, place)[None]

    def seen(R, away):
        return bool(devices.visible(found.imaging, own, tip(R, away), np.array(BALL), found.device.cone)[0])

    above = np.array([0.0, 0.0, 0.5])
    assert seen(down, above)
    assert not seen(down, np.array([0.3, 0.0, 0.5]))
    assert not seen(devices.CAMERA_AXES.T, -above)
    slanted = frames.rotation_from_vector([0, 1.1, 0])
    assert not seen(slanted @ down, slanted @ above)
    uv, y = devices.pixels(found.imaging, own, tip(down, above), np.array(BALL))
    np.testing.assert_allclose(y[..., 2], 0.5, atol=1e-12)
    np.testing.assert_allclose(uv.mean(axis=(0, 1)), [960, 600], atol=1.0)


def test_noise_of_an_image_is_that_of_all_its_corners():
    found = placed(cases.arm(), DEVICES["camera"])
    pixel = 0.5 * (devices.NEAR + devices.FAR) * found.reach / 1400
    sigma = devices.pixel_noise(found.imaging, found.reach, 1e-5)
    assert sigma * pixel / np.sqrt(35) == pytest.approx(1e-5)
    assert found.with_noise(2e-5).imaging.u95 == pytest.approx(2 * 1.96 * sigma, rel=1e-3)
