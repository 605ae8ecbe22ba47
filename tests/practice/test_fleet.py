import io

import pandas as pd

from irbcal.practice import fleet


def test_the_lists_name_the_files_beside_them():
    found = {sample.path: sample.content for sample in fleet.files()}
    for month, day in fleet.MONTHS:
        rows = pd.read_csv(io.BytesIO(found[f"fleet/{month}.csv"]))
        assert list(rows["id"]) == ["cell-1", "cell-2"]
        assert set(rows["date"]) == {day}
        for path in rows["measurements"]:
            seen = pd.read_csv(io.BytesIO(found[f"fleet/{path}"]))
            assert set(seen["simulated"]) == {"yes"}
            assert seen["pose"].nunique() == fleet.POSES
