"""Commands for the viewer: recorded without a server, one for each body."""

import numpy as np
import umsgpack

from irbcal.viewer import building, page


def test_every_body_is_recorded(cell):
    scene = building.build(cell / "cal", cell / "poses.csv")
    recorder = page.record(scene)
    commands = [umsgpack.unpackb(command) for command in recorder.commands]
    drawn = {command["path"] for command in commands if command["type"] == "set_object"}
    assert drawn == {*(f"/irbcal/robot/{k}" for k in scene.meshes), "/irbcal/tracker", "/irbcal/cube"}
    assert len(recorder.as_text()) == len(commands)


def test_positions_reach_the_viewer_as_they_are(cell):
    scene = building.build(cell / "cal", plan=np.zeros((2, 6)))
    commands = [umsgpack.unpackb(command) for command in page.record(scene).commands]
    k, mesh = next(iter(scene.meshes.items()))
    (command,) = [c for c in commands if c.get("path") == f"/irbcal/robot/{k}" and c["type"] == "set_object"]
    (geometry,) = command["object"]["geometries"]
    position = geometry["data"]["attributes"]["position"]["array"]
    assert np.array_equal(np.frombuffer(position.data, "<f4").reshape(-1, 3), mesh.vertices)
    assert any(c.get("path") == "/irbcal/path" for c in commands)
