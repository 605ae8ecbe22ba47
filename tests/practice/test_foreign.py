"""The same points in other programs' files: imported, all sets tell the same distances on the tool."""

import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from irbcal.cli.main import app


@pytest.fixture(scope="module")
def imported(written, tmp_path_factory):
    """Tables by the name of what they were imported from."""
    here, out = Path.cwd(), tmp_path_factory.mktemp("imported")
    tables = {}
    for name, line in written.tried.items():
        if not line.startswith("irbcal import"):
            continue
        words = shlex.split(line)[1:]
        source = [str(path) for word in words[1:] if "*" in word for path in sorted(written.folder.glob(word))]
        words = [words[0], *source, *(word for word in words[1:] if "*" not in word)]
        words = [str(written.folder / word) if (written.folder / word).is_file() else word for word in words]
        words[words.index("--out") + 1] = str(out / f"{Path(name).stem}.csv")
        done = CliRunner().invoke(app, words, catch_exceptions=False)
        assert done.exit_code == 0, done.output
        tables[name] = pd.read_csv(out / f"{Path(name).stem}.csv")
    assert Path.cwd() == here
    return tables


def test_points_of_all_layouts_agree(imported):
    xyz = {}
    for name in ("robodk.csv", "wide.csv", "turned.csv", "points.txt", "smr1.csv"):
        table = imported[name]
        table = table[~table["target"].astype(str).str.startswith("ref")]
        xyz[name] = table[["x_mm", "y_mm", "z_mm"]].to_numpy()
        assert xyz[name].shape == (120, 3)
    for name, found in xyz.items():
        assert np.allclose(found, xyz["wide.csv"], atol=1e-6), name


def test_joints_agree_and_the_turned_sign_is_turned_back(imported):
    columns = [f"q{k}_deg" for k in range(1, 7)]
    for name in ("robodk.csv", "turned.csv", "points.txt"):
        joints = imported[name].drop_duplicates("pose")[columns].to_numpy()
        assert np.allclose(joints, imported["wide.csv"].drop_duplicates("pose")[columns].to_numpy(), atol=1e-6), name


def test_full_poses_agree(imported):
    columns = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
    one, other = (imported[name][columns].to_numpy() for name in ("tmac.csv", "export.csv"))
    assert np.allclose(one[:, :3], other[:, :3], atol=1e-6)
    assert np.abs(np.abs(np.sum(one[:, 3:] * other[:, 3:], axis=1)) - 1).max() < 1e-8
