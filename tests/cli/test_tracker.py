"""``irbcal tracker`` and its figures on small simulated files."""

import numpy as np
import pytest
from typer.testing import CliRunner

from irbcal.cli.main import app
from irbcal.errors import IrbcalError

RNG = np.random.default_rng(0)


def table(path, header, *columns):
    rows = zip(*columns, strict=True)
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize("kind", ["bar", "repeat", "drift", "settle"])
def test_each_check_prints_and_draws(kind, program, tmp_path):
    n = 60
    x, y, z = np.round(RNG.normal(0, 0.004, (3, n)), 6)
    if kind == "bar":
        end = np.tile(["A", "B"], n // 2)
        file = table(
            tmp_path / "t.csv",
            "position,end,x_mm,y_mm,z_mm",
            np.repeat([1, 2, 3], 20),
            end,
            x + 1000 * (end == "B"),
            y,
            z,
        )
    elif kind == "repeat":
        file = table(tmp_path / "t.csv", "position,x_mm,y_mm,z_mm", np.repeat(["P1", "P2"], 30), x + 900, y, z)
    elif kind == "drift":
        file = table(
            tmp_path / "t.csv",
            "time_s,x_mm,y_mm,z_mm,temperature_c",
            17 * np.arange(n),
            x + 5,
            y,
            z,
            [*(22 + x)[:-1], ""],
        )
    else:
        time = np.tile(np.arange(20) * 0.75, 3)
        file = table(
            tmp_path / "t.csv",
            "run,time_s,x_mm,y_mm,z_mm",
            np.repeat([1, 2, 3], 20),
            time,
            1 + np.exp(-2 * time),
            0 * y + 3,
            0 * z,
        )
    options = ["--length", "1000"] if kind == "bar" else []
    found = program("tracker", file, "--json", *options, "--plot", tmp_path / "t.svg")
    assert found["check"] == kind
    figure = (tmp_path / "t.svg").read_text(encoding="utf-8")
    assert {
        "bar": "distance error (mm)",
        "repeat": "distance from mean (µm)",
        "drift": "temperature (°C)",
        "settle": "time (s)",
    }[kind] in figure
    text = program("tracker", file, *options)
    assert {
        "bar": "scale bar of 1000 mm",
        "repeat": "mean+3σ",
        "drift": "Correlation with the air",
        "settle": "PSt 0.00 s",
    }[kind] in text


def test_wrong_calls_and_refusals(program, tmp_path):
    file = table(tmp_path / "d.csv", "distance_mm", [1000.0, 1000.001])
    assert CliRunner().invoke(app, ["tracker", str(file)]).exit_code == 2, "the length is missing"
    refused = CliRunner().invoke(app, ["tracker", str(file), "--length", "1000", "--plot", str(tmp_path / "d.docx")])
    assert (refused.exit_code, "a name that ends in" in refused.output) == (2, True)
    with pytest.raises(
        IrbcalError, match=r"row 2, column x_mm: expected a position within 1 km in mm or nothing, found 'one'"
    ):
        program("tracker", table(tmp_path / "x.csv", "x_mm,y_mm,z_mm", ["one"], [1], [1]))
    with pytest.raises(IrbcalError, match="missing column z_mm"):
        program("tracker", table(tmp_path / "z.csv", "x_mm,y_mm", [1], [1]))
