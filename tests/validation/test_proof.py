"""What a calibration reached: a certificate names what it rests on."""

from types import SimpleNamespace

from irbcal.calibration import reached


def record(held):
    objective = SimpleNamespace(name="max", value_mm=0.5, lower_bound_mm=0.4)
    parameters = [SimpleNamespace(name=name, state="held") for name in held]
    return SimpleNamespace(objective=objective, parameters=parameters, method="least-squares")


def test_a_certificate_names_what_is_held():
    assert reached(record([])).endswith("certified: not below 0.400 mm with this model")
    assert reached(record(["delta_d3"])).endswith("not below 0.400 mm with this model and with delta_d3 held")
