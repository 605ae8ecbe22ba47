import pytest

from irbcal.files.features_section import FeaturesSection, LengthRow


def section(**more):
    return FeaturesSection(
        **{
            "kinds": {"point": 3},
            "framed": False,
            "scale_measured": False,
            "left_out": None,
            "before_mm": 2.0,
            "open_mm": 0.5,
            "features": [],
            "places": [],
            "lengths": [],
        }
        | more
    )


def test_the_scale_is_told_where_no_length_was_measured():
    assert section().scale == "no length was measured: the scale rests on nominal link lengths"
    assert section(scale_measured=True).scale == ""


def test_length_errors_are_means_of_sizes():
    rows = [
        LengthRow(name=n, first="a", second="b", length_mm=50, fitted_mm=0, nominal_mm=before, heldout_mm=after)
        for n, before, after in (("1", -2.0, 0.1), ("2", 1.0, -0.3), ("3", None, None))
    ]
    assert section(lengths=rows).length_error() == pytest.approx((1.5, 0.2))
    assert section().length_error() is None
