"""What a folder keeps can be read again, and nothing else."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.studies import folder
from irbcal.studies.settings import Repetition


def test_a_part_is_read_as_it_was_kept(done, tmp_path):
    repetition = Repetition("34", 80)
    assert not folder.is_kept(tmp_path, repetition)
    folder.keep(tmp_path, repetition, *done[repetition])
    assert folder.is_kept(tmp_path, repetition)
    assert set(folder.read_rows(tmp_path / "parts" / "34-80-1.csv")["repetition"]) == {"34-80-1"}
    series = folder.read_series(tmp_path, repetition)
    assert series["verified/iso_cube/3/point"].dtype == np.float32


def test_damage_is_refused_with_the_file(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(MeasurementError, match="these are not the rows of a study") as caught:
        folder.read_rows(path)
    assert caught.value.file == str(path)
    with pytest.raises(MeasurementError, match=r"damaged: delete it and nominal\.csv") as caught:
        folder.read_series(tmp_path, Repetition("nominal"))
    assert caught.value.file == str(tmp_path / "parts" / "nominal.npz")
