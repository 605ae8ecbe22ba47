"""Shoulder, elbow and wrist."""

import pytest

from irbcal.correction.languages.val3.writing import posture_of


@pytest.mark.parametrize(
    ("shoulder", "elbow", "wrist", "expected"),
    [
        ("lefty", "enegative", "wpositive", (False, True, 1)),
        ("ssame", "esame", "wsame", (None, None, None)),
        ("", "", "", (None, None, None)),
    ],
)
def test_what_they_mean(shoulder, elbow, wrist, expected):
    posture, reason = posture_of({"shoulder": shoulder, "elbow": elbow, "wrist": wrist})
    assert posture[:3] == expected
    assert reason == ""
