"""Reflectors of a plan: from files with and without directions."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.planning.conditions import SOLID
from irbcal.planning.scene import open_scene
from irbcal.units import MM


def test_reflectors_from_a_file_with_and_without_directions(tmp_path):
    (tmp_path / "plain.csv").write_text("target,x_mm,y_mm,z_mm\na,10,20,30\nb,-40,0,50\n")
    plain = open_scene("irb1600", targets=tmp_path / "plain.csv", without=SOLID)
    assert "acceptance" not in plain.setting.conditions
    assert any("directions are not known: the condition acceptance is off" in note for note in plain.notes)
    assert plain.setting.targets.places.tolist() == pytest.approx(np.array([[10, 20, 30], [-40, 0, 50]]) * MM)
    (tmp_path / "full.csv").write_text("target,x_mm,y_mm,z_mm,nx,ny,nz\na,10,20,30,0,0,2\nb,-40,0,50,3,0,4\n")
    full = open_scene("irb1600", targets=tmp_path / "full.csv", without=SOLID)
    assert full.setting.conditions == ("limits", "height", "acceptance")
    assert full.setting.targets.directions.tolist() == pytest.approx(np.array([[0, 0, 1], [0.6, 0, 0.8]]))
    for text, message in (
        ("target,x_mm,y_mm,z_mm,nx,ny\na,1,2,3,0,0\n", "row 1: missing column nz"),
        ("target,x_mm,y_mm,z_mm,nx,ny,nz\na,1,2,3,0,0,0\n", "row 2, columns nx, ny, nz: expected a direction"),
        (
            "target,x_mm,y_mm,z_mm,nx,ny,nz\na,1,2,3,0,q,0\n",
            "row 2, column ny: expected a part of a direction, found 'q'",
        ),
    ):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(MeasurementError, match=message):
            open_scene("irb1600", targets=tmp_path / "bad.csv", without=SOLID)
