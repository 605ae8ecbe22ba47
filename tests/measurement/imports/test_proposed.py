"""Lines that are proposed for tables of others: they run, and give the numbers of the table."""

import shlex

import numpy as np
import pandas as pd
import pytest
from import_support import JOINTS, XYZ

from irbcal.errors import MeasurementError
from irbcal.measurement import table
from irbcal.measurement.imports.proposed import proposed

RNG = np.random.default_rng(3)
Q = RNG.uniform(-170, 170, (8, 6)).round(4)
POINTS = RNG.uniform(-2000, 2000, (8, 3, 3)).round(4)


def long(names, q=Q, factor=1.0):
    """One target in a row."""
    rows = [[k, "abc"[t], *q[k], *(POINTS[k, t] * factor)] for k in range(8) for t in range(3)]
    return pd.DataFrame(rows, columns=names)


def wide(names):
    return pd.DataFrame([[*Q[k], *POINTS[k].ravel()] for k in range(8)], columns=names)


TABLES = {
    "numbered": long(["nr", "point", *(f"J{k}" for k in range(1, 7)), "X", "Y", "Z"]),
    "kuka": long(["No", "Marker", *(f"A{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]),
    "radians": long(["id", "name", *(f"joint_{k}" for k in range(1, 7)), "x_m", "y_m", "z_m"], np.radians(Q), 1e-3),
    "from zero": long(["pose", "target", *(f"q{k}" for k in range(6)), "pos_x", "pos_y", "pos_z"]),
    "yaskawa": long(["Pose", "Target", *"SLURBT", "x_meas", "y_meas", "z_meas"]),
    "wide": wide([*(f"J{k}" for k in range(1, 7)), *(f"{a}{k}" for k in (1, 2, 3) for a in "XYZ")]),
    "wide by name": wide(
        [*(f"Axis {k}" for k in range(1, 7)), *(f"{t}_{a}" for t in ("ball1", "ball2", "r") for a in "xyz")]
    ),
}


@pytest.mark.parametrize("sep", [",", ";", "\t"])
@pytest.mark.parametrize("kind", TABLES)
def test_the_proposed_line_reads_the_table(kind, sep, tmp_path, monkeypatch, program):
    monkeypatch.chdir(tmp_path)
    TABLES[kind].to_csv("t.csv", sep=sep, decimal="," if sep == ";" else ".", index=False)
    with pytest.raises(MeasurementError, match="check names and units: irbcal import t") as caught:
        table.read("t.csv")
    assert caught.value.row == 1
    program(*shlex.split(str(caught.value).partition("units: ")[2])[1:])
    seen = table.read("measured.csv").table
    assert np.abs(seen[JOINTS].to_numpy() - np.repeat(Q, 3, axis=0)).max() < 1e-9
    assert np.abs(seen[XYZ].to_numpy() - POINTS.reshape(-1, 3)).max() < 1e-9
    assert seen["pose_index"].tolist() == np.repeat(np.arange(8), 3).tolist()


def test_nothing_is_proposed_for_what_is_no_such_table():
    assert proposed(b"a,b,c\n1,2,3\n", "t.csv") is None
    assert proposed(b"J1,J2,J3,J4,J5,J6\n1,2,3,4,5,6\n", "t.csv") is None
    assert proposed(b"", "t.csv") is None
    assert proposed(b"\x00\xff\n\xfe", "t.csv") is None
    header = b'J1,J2,J3,J4,J5,J6,",X,Y,Z'  # a quotation mark that is never closed
    assert proposed(header + b"\n1,2,3,4,5,6,a,700,8,9\n", "t.csv") is None


def test_a_quaternion_is_proposed_with_its_order():
    header = "J1,J2,J3,J4,J5,J6,X,Y,Z,qw,qx,qy,qz"
    line = proposed(f"{header}\n1,2,3,4,5,6,700,8,9,1,0,0,0\n".encode(), "t.csv")
    assert "'columns.orientation=[qw, qx, qy, qz]' --set orientation.kind=quaternion" in line
    assert "fixed.target=smr1" in line
