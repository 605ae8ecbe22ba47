from irbcal.fleet import words


def test_parameters_have_names_that_people_know():
    assert words.called("delta_theta3") == ("joint 3's zero", "a crash, an exchanged motor or a lost zero")
    assert words.called("delta_alpha2")[0] == "the tilt between joints 2 and 3"
    assert words.called("rz3 direction 0.00872665")[0] == "the backlash of joint 3 (rz3 direction 0.00872665)"
    assert words.called("something") == ("something", "wear, a crash or a repair")


def test_amounts_have_the_digits_of_their_uncertainty():
    assert words.amount(-0.000366519, 0.0000698, "rad") == "0.0210 ± 0.0040 degrees"
    assert words.amount(1.23e-4, 1.1e-5, "m") == "0.123 ± 0.011 mm"


def test_high_waves_are_told_from_low_ones():
    assert words.high_wave("rz4 cos 242 gear")
    assert not words.high_wave("rz4 cos 2")
    assert not words.high_wave("delta_theta7")
