import json

import numpy as np
import pytest

from irbcal.errors import OptionError
from irbcal.identification.devices import AXES, BALL
from irbcal.simulation.device_simulation import simulate_device
from irbcal.units import MM


@pytest.fixture(scope="module")
def balls():
    return simulate_device("irb1600", "balls", 24, seed=3, noise=0.0)


def test_the_real_robot_touches_the_balls(balls):
    """The oracle is the cell's own truth of where the tip stood."""
    T = balls.cell.measure(balls.q).T_base_tip
    p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
    centre = np.array([own["centre"] for own in balls.found.own.values()])[balls.which]
    assert np.linalg.norm(p - centre, axis=1).max() < 0.02 * MM
    nominal = balls.cell.arm.forward(balls.q)
    away = nominal[:, :3, 3] + nominal[:, :3, :3] @ np.array(BALL) - centre
    assert np.linalg.norm(away, axis=1).mean() > 0.3 * MM


def test_files_say_that_they_are_simulated(balls, tmp_path):
    rows, known, truth = balls.save(tmp_path / "b.csv")
    assert "yes" in rows.read_text().splitlines()[1]
    assert known.name == "b.features.csv"
    assert json.loads(truth.read_text())["simulated"] is True
    seen = balls.read()
    assert seen.simulated
    assert "SIMULATED" in str(balls.summary())
    assert len(seen.lengths) == 6


def test_poses_of_a_plan_can_be_measured(balls):
    again = simulate_device("irb1600", "balls", seed=3, noise=0.0, at=(balls.q[:6], balls.which[:6]))
    assert again.which.tolist() == balls.which[:6].tolist()
    assert sorted(np.round(again.q[:, 0], 2)) == pytest.approx(sorted(np.round(balls.q[:6, 0], 2)), abs=0.02)


def test_strings_show_distances_with_their_noise():
    exact, noisy = (simulate_device("irb1600", "string", 60, noise=noise) for noise in (0.0, 1e-4))
    np.testing.assert_array_equal(exact.q, noisy.q)
    assert np.std(noisy.value - exact.value) == pytest.approx(1e-4, rel=0.3)
    with pytest.raises(OptionError, match="device"):
        simulate_device("irb1600", "tape")


def test_effects_of_the_cell_can_be_left_out():
    alone = simulate_device("irb1600", "ball", 6, only=["tilt"])
    assert alone.cell.on == ("tilt",)
    heavy = simulate_device("irb1600", "ball", 6, payload=5.0)
    assert heavy.read().payload_kg.tolist() == [5.0] * 6
    assert heavy.read().payload_place[0] == pytest.approx(heavy.cell.tool.payload_centre)
    assert not np.allclose(heavy.q, simulate_device("irb1600", "ball", 6, payload=0.0).q, atol=1e-7)
    assert "backlash" not in simulate_device("irb1600", "ball", 6, without=["backlash"]).cell.on
    with pytest.raises(OptionError, match="exclude each other"):
        simulate_device("irb1600", "ball", 6, only=["tilt"], without=["noise"])


def test_a_camera_sees_boards_from_where_the_real_robot_stands():
    """The oracle is a projection written out by hand, with the cell's own truth of where the tip stood."""
    exact, noisy = (simulate_device("irb1600", "camera", 9, seed=2, noise=noise) for noise in (0.0, 1e-5))
    T, own = exact.cell.measure(exact.q).T_base_tip[0], exact.found.own["board 1"]
    square = exact.found.imaging.square
    corner = own["centre"] + own["attitude"] @ [3 * square, 2 * square, 0.0]  # number 9 of 7 a row
    x, y, z = (T[:3, :3] @ AXES).T @ (corner - T[:3, 3] - T[:3, :3] @ np.array(BALL))
    r2 = (x / z) ** 2 + (y / z) ** 2
    there = 1400.0 * np.array([x, y]) / z * (1 - 0.1 * r2 + 0.06 * r2**2) + [960, 600]
    np.testing.assert_allclose(exact.value[0, 9], there, atol=1e-6)
    assert float(noisy.features().u95_px[0]) == pytest.approx(1.96 * np.std(noisy.value - exact.value), rel=0.1)
    seen = noisy.read()
    assert len(seen) == 9
    assert seen.simulated
    assert set(seen.target) == {"camera"}
    assert len(noisy.to_frame()) == 9 * 35
