"""Tables of used poses: whole columns or none."""

import pytest
from pydantic import ValidationError

from irbcal.files.point_tables import PoseTable

POSES = {"pose": ["1", "2"], "group": ["", ""], "heldout": [False, True], "joints": [[0.0, 1.0]], "came_from": ["+0"]}


def test_loads_are_told_for_all_poses_or_none():
    assert PoseTable(**POSES).payload_kg == []
    whole = PoseTable(**POSES, payload_kg=[0.0, None], payload_place_mm=[[0.0, 1.0]] * 3, torques_nm=[[1.0, 2.0]])
    assert PoseTable.model_validate_json(whole.model_dump_json()) == whole
    for change in ({"payload_kg": [1.0]}, {"payload_place_mm": [[1.0]] * 3}, {"torques_nm": [[1.0]]}):
        with pytest.raises(ValidationError, match="2 values, one for each pose"):
            PoseTable(**POSES, **change)
