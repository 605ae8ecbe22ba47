"""Static compliance by hand: an arm that is a spring with known constants."""

import numpy as np
import pytest
from written import written

from irbcal.errors import MeasurementError
from irbcal.modeling import frames
from irbcal.validation.iso9283_check import static_compliance

SPRING = 1e-6 * np.array([[3.0, 0.5, 0.0], [0.5, 4.0, 0.2], [0.0, 0.2, 5.0]])
"""Displacement per force in the base link, m/N."""

WAYS = ("+x", "-x", "+y", "-y", "+z", "-z")


def loaded(path, R=None, cycles=3, noise=0.0, extra=""):
    """Places under 0 to 60 N along the axes of the base link, seen in a frame turned by R, mm."""
    rng = np.random.default_rng(0)
    lines = [f"direction,force_n,cycle,x_mm,y_mm,z_mm{extra and ',simulated'}"]
    for way in WAYS:
        axis = np.eye(3)["xyz".index(way[1])] * (1 if way[0] == "+" else -1)
        for c in range(1, cycles + 1):
            for force in range(0, 61, 6):
                p = np.array([0.8, 0.1, 1.0]) + c * 1e-5 + SPRING @ axis * force + noise * rng.standard_normal(3)
                p = p if R is None else R @ p
                lines.append(f"{way},{force},{c},{','.join(f'{v * 1e3:.9f}' for v in p)}{extra}")
    return written(path, "\n".join(lines))


def test_a_spring_is_found_along_and_across(tmp_path):
    R = frames.rot_z(0.7) @ frames.rot_x(-1.1)
    found = static_compliance(loaded(tmp_path / "f.csv", R), R.T)
    assert found.frame == "base link"
    for name, c in found.directions.items():
        k = "xyz".index(name[1])
        assert c.along == pytest.approx(SPRING[k, k], rel=1e-6)
        assert c.across == pytest.approx(np.linalg.norm(np.delete(SPRING[k], k)), rel=1e-6)
        assert c.largest == (60.0, pytest.approx(60 * SPRING[k, k], rel=1e-6))
        assert c.spread < 1e-11
    frame = found.to_frame()
    assert frame["direction"].tolist() == list(WAYS)
    assert frame["along_mm_per_n"].tolist() == pytest.approx([0.003, 0.003, 0.004, 0.004, 0.005, 0.005], rel=1e-6)
    assert "Static compliance, axes of the base link" in found.summary()
    # seen along the axes of another frame it is another matrix
    other = static_compliance(loaded(tmp_path / "g.csv")).directions["+z"]
    assert other.along == pytest.approx(5e-6, rel=1e-6)


def test_noise_is_told_by_the_cycles(tmp_path):
    found = static_compliance(loaded(tmp_path / "f.csv", noise=2e-5, extra=",yes"))
    # slope of 11 forces 6 N apart: 20 um / (6 N sqrt(110)) = 0.32 um/N
    spread = np.mean([c.spread for c in found.directions.values()])
    assert 1e-7 < spread < 6e-7
    assert "SIMULATED data: static compliance up to" in repr(found)
    assert "SIMULATED data" in found.plot().svg()


def test_refusals(tmp_path):
    text = loaded(tmp_path / "f.csv").read_text()
    with pytest.raises(MeasurementError, match=r"row 2, column direction: expected \+x, -x, .*, found 'up'"):
        static_compliance(written(tmp_path / "a.csv", text.replace("+x,0,1", "up,0,1")))
    with pytest.raises(MeasurementError, match=r"column force_n: expected a force that is not negative.*, found '-6'"):
        static_compliance(written(tmp_path / "b.csv", text.replace("+x,6,1", "+x,-6,1")))
    one = "\n".join(line for line in text.splitlines() if ",0,1," not in line or line.startswith("dir"))
    lines = [text.splitlines()[0], *[line for line in one.splitlines() if line.startswith("+x,6,1,")]]
    with pytest.raises(MeasurementError, match=r"direction \+x of cycle 1 has one force only"):
        static_compliance(written(tmp_path / "c.csv", "\n".join(lines)))
