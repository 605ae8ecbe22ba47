"""What a corrected program says of itself."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from irbcal.correction.filtered import Filtered
from irbcal.correction.program import Left, Note
from irbcal.units import DEG, MM


def filtered(n, columns=("q1_deg", "q2_mm"), **more):
    q = np.ones((n, 2)) * [10 * DEG, 20 * MM]
    return Filtered(
        source="job.csv",
        files={"job.mod": b""},
        targets=np.array([f"t{k} [red]" for k in range(n)], dtype=object),
        lines=np.arange(n) + 2,
        q_before=q,
        q=q + np.array([-0.5 * DEG, 0.25 * MM]),
        shift=np.full(n, 1.5 * MM),
        turn=np.full(n, 0.1 * DEG),
        residual=np.zeros(n),
        joint_columns=columns,
        fingerprint="abc",
        **{"left": (), "notes": (), **more},
    )


def test_the_frame_is_in_the_units_of_files():
    frame = filtered(3).to_frame()
    assert frame["line"].tolist() == [2, 3, 4]
    first = frame.iloc[0]
    assert first["q1_deg"] - first["q1_deg_before"] == pytest.approx(-0.5, abs=1e-9)
    assert first["q2_mm"] - first["q2_mm_before"] == pytest.approx(0.25, abs=1e-9)
    assert first["shift_mm"] == pytest.approx(1.5, abs=1e-9)
    assert first["turn_deg"] == pytest.approx(0.1, abs=1e-9)
    empty = filtered(0).to_frame()
    assert (len(empty), empty.columns.tolist()) == (0, frame.columns.tolist())


def test_the_summary_tells_the_first_changes_and_everything_that_was_left():
    left = tuple(Left(f"p{k}", k, "out of reach") for k in range(30))
    found = filtered(
        12, left=left, notes=(Note(7, "a displacement"),), expected_error=0.25 * MM, written=Path("new.csv")
    )
    text = found.summary()
    assert text.splitlines()[0] == "12 targets corrected, by 1.500 mm on average and at most 1.500 mm"
    assert "largest joint change deg (mm)" in text
    assert "t9 [red]" in text
    assert "t10 [red]" not in text
    assert "… and 2 more" in text
    assert text.count("left as it was: p") == 30
    assert "Note: line 7: a displacement" in text
    assert "Expected error afterwards: 0.250 mm mean" in text
    assert text.endswith("Written to new.csv")
    assert not found.complete
    assert len(repr(found)) < 200
    assert "0.5000" in found._repr_html_()


def test_of_very_many_left_for_one_reason_the_first_are_told_and_how_many_more():
    left = [Left(f"p{k}", k, "out of reach") for k in range(1, 121)] + [Left("other", 7, "it is computed")]
    text = filtered(2, left=tuple(left)).summary()
    assert text.count("left as it was: p") == 50
    assert "left as it was: other (line 7): it is computed" in text
    assert "left as they were: 70 more in lines 51 to 120: out of reach" in text


def test_nothing_corrected_is_said():
    assert filtered(0).summary() == "no target corrected"
    assert filtered(1).complete


def test_results_are_locked_and_pickle():
    found = filtered(2)
    with pytest.raises(ValueError, match="read-only"):
        found.q[0, 0] = 1.0
    again = pickle.loads(pickle.dumps(found))
    assert again.summary() == found.summary()


def test_it_becomes_a_dict_for_json():
    found = filtered(2, left=(Left("p", 4, "out of reach"),), notes=(Note(7, "speed"),), expected_error=0.2 * MM)
    data = json.loads(json.dumps(found.to_dict()))
    assert [row["target"] for row in data["targets"]] == ["t0 [red]", "t1 [red]"]
    assert data["left"][0]["reason"] == "out of reach"
    assert data["notes"][0]["text"] == "speed"
    assert data["expected_error_mm"] == pytest.approx(0.2)
    assert data["written"] is None
