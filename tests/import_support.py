"""What the tests of importing need: files written by hand, and what is understood of them or refused."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.measurement.imports import column_map, reader

JOINTS = [f"q{k}_deg" for k in range(1, 7)]
XYZ = ["x_mm", "y_mm", "z_mm"]
QUATERNION = ["qw", "qx", "qy", "qz"]
FOUR_JOINTS = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\nP1,10,20,30,40,50,60\nP2,11,21,31,41,51,61\n"
ROW = "10,-20,30,0,45,90,1200.5,-35.25,640.75"
"""A row as RoboDK writes it: joints and a position."""


def write(path, *lines, encoding="utf-8"):
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def make_map(tmp_path, text, name="map.yaml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def understood(sources, name, *changes, joints=None):
    """The table by a preset or map; what is written is read back to the same numbers."""
    sources = sources if isinstance(sources, list) else [sources]
    found = reader.understand(sources, column_map.read_map(name, changes), joints)
    folder = sources[0].parent
    (folder / "written.csv").write_bytes(found.csv())
    seen = table.read(folder / "written.csv")
    assert np.allclose(seen.table[XYZ], found.table[XYZ], rtol=0, atol=1e-8, equal_nan=True)
    assert seen.table["target"].tolist() == found.table["target"].tolist()
    return found


def refused(sources, name, *changes, joints=None):
    """The one sentence of a refusal."""
    sources = sources if isinstance(sources, list) else [sources]
    with pytest.raises(MeasurementError) as caught:
        reader.understand(sources, column_map.read_map(name, changes), joints).csv()
    text = str(caught.value)
    assert "\n" not in text
    return text
