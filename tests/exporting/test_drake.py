"""Drake reads the exported package without a warning and computes irbcal's poses."""

import logging

import numpy as np
import pytest
from export_harness import situations
from support import assert_same_poses

from irbcal.exporting import drake as target

pytest.importorskip("pydrake", reason="Drake needs Python 3.11 and a recent system")


@pytest.mark.parametrize("name", ["irb1600", "panda"])
def test_the_same_poses_without_a_warning(described, tmp_path, name, caplog):
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    source = described[name]
    for file, content in target.files(source).files.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(content)
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(tmp_path / "package.xml"))
    word = f"{source.numbers.identifier}_calibrated"
    with caplog.at_level(logging.WARNING):
        (model,) = parser.AddModelsFromUrl(f"package://{word}/{word}.urdf")
        plant.Finalize()
    assert [record.getMessage() for record in caplog.records] == []
    context = plant.CreateDefaultContext()
    q, situation = situations(source.robot, 1000, 3)
    theta = source.robot.joint_map.effective(q, **situation)
    base, tip = (plant.GetFrameByName(link, model) for link in (source.numbers.base_link, source.numbers.tip_link))
    places = [plant.GetJointByName(joint, model).position_start() for joint in source.numbers.joint_names]
    values, found = plant.GetPositions(context), []
    for row in theta:
        values[places] = row
        plant.SetPositions(context, values)
        found.append(tip.CalcPose(context, base).GetAsMatrix4())
    assert_same_poses(np.array(found), source.robot.forward(q, **situation), 1e-12, 1e-12)
