import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement.features import read

JOINTS = {f"q{k}_deg": [10.0, 20.0] for k in range(1, 7)}


def table(**more):
    return pd.DataFrame(JOINTS | {"pose": ["1", "2"]} | more)


def test_yaml_says_the_same(tmp_path):
    (tmp_path / "features.yaml").write_text(
        "- {feature: A, kind: sphere, radius_mm: 12.5, x_mm: 1, y_mm: 2, z_mm: 3}\n"
    )
    seen = read(table(feature="A"), tmp_path / "features.yaml", cases.arm())
    assert seen.features["A"].radius == 0.0125
    np.testing.assert_allclose(seen.features["A"].centre, [1e-3, 2e-3, 3e-3])
    (tmp_path / "features.yaml").write_text("A: sphere\n")
    with pytest.raises(MeasurementError, match="expected a list of features"):
        read(table(feature="A"), tmp_path / "features.yaml", cases.arm())
