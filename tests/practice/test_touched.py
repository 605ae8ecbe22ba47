from io import BytesIO

import numpy as np
import pandas as pd

from irbcal.cell.adjustment import adjust
from irbcal.cell.touches import read_touches
from irbcal.practice import touched
from irbcal.practice.measured import practice_cell


def test_rows_and_balls_belong_together():
    rows, balls = (pd.read_csv(BytesIO(sample.content)) for sample in [*touched.files()][:2])
    assert len(rows) == touched.POSES
    assert (rows["simulated"] == "yes").all()
    assert set(rows["feature"]) == set(balls.loc[balls["kind"] == "point", "feature"])
    assert (balls["kind"] == "distance").sum() == 6


def test_touches_are_those_of_the_true_robot():
    cell = practice_cell()
    rows, source = read_touches(touched.touches(cell), cell.arm)
    T = cell.measure(np.array([one.q for one in rows])).T_base_tip
    found = adjust(rows, T, np.full(len(rows), touched.BY_EYE), source)
    np.testing.assert_allclose(found.tips["1"], touched.TIP, rtol=0, atol=6 * touched.BY_EYE)
    np.testing.assert_allclose(found.work_objects["1"], touched.T_BASE_FIXTURE, rtol=0, atol=12 * touched.BY_EYE)
    spread = np.sqrt(np.sum(found.residual**2) / found.redundancy)
    assert 0.4 * touched.BY_EYE < spread < 1.6 * touched.BY_EYE
