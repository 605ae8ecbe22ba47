from io import BytesIO

import pandas as pd

from irbcal.practice import touched


def test_rows_and_balls_belong_together():
    rows, balls = (pd.read_csv(BytesIO(sample.content)) for sample in touched.files())
    assert len(rows) == touched.POSES
    assert (rows["simulated"] == "yes").all()
    assert set(rows["feature"]) == set(balls.loc[balls["kind"] == "point", "feature"])
    assert (balls["kind"] == "distance").sum() == 6
