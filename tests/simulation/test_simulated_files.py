"""The files of a virtual measurement: what they hold, and that nothing of the truth is in the measurements."""

import hashlib
import json

import numpy as np

from irbcal.measurement import table
from irbcal.simulation import simulated_files
from irbcal.simulation.pose_list import drawn


def test_the_truth_belongs_to_its_measurement_file(cell, tmp_path):
    poses = drawn(cell, 6, seed=3)
    run = cell.measure(poses.q)
    found = simulated_files.files(run, poses, cell, tmp_path / "m.csv", "irb1600")
    assert list(found) == ["m.csv", "m.truth.json"]
    truth = json.loads(found["m.truth.json"])
    assert truth["simulated"] is True
    assert truth["data_sha256"] == hashlib.sha256(found["m.csv"]).hexdigest()
    np.testing.assert_allclose(np.array(truth["poses"])[:, :3] * 1e-3, run.T_base_tip[:, :3, 3], rtol=0, atol=1e-9)
    (tmp_path / "m.csv").write_bytes(found["m.csv"])
    read = table.read(tmp_path / "m.csv")
    np.testing.assert_allclose(read.positions().reshape(run.xyz.shape), run.xyz, rtol=0, atol=0.051e-6)
    np.testing.assert_allclose(read.joints(), poses.q, rtol=0, atol=1e-8)
