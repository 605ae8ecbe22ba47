"""The page as text: what is in it, what is not, and who may fetch it."""

import base64
import json
import re
from html import unescape

import numpy as np
import pandas as pd
import pytest
import umsgpack
from viewer_page import data_of

import irbcal
from irbcal.io import robots
from irbcal.viewer import building, page

HOSTILE = "</script><script>window.hacked=1</script><!--<img src=x onerror=window.hacked=2>"


def floats(text, columns):
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, columns)


def test_numbers_on_the_page_are_those_of_the_scene(view):
    data = data_of(view.html)
    points = view.scene.points
    # errors are differences of metres: taken before rounding, they keep their digits
    assert np.abs(floats(data["points"]["error_calibrated"], 3) - points.error()).max() < 1e-9
    assert np.abs(floats(data["points"]["measured"], 3) - points.measured).max() < 1e-6
    assert np.abs(floats(data["poses"]["effective"], 6) - view.scene.effective).max() < 1e-6
    assert data["scale"]["common"]["magnification"] == view.scene.magnification
    assert data["scale"]["common"]["top_mm"] * 1e-3 == pytest.approx(view.scene.scale_top)


def test_nothing_on_the_page_is_fetched(view):
    html = view.html
    outside = re.sub(r"<script[^>]*>.*?</script>|<style>.*?</style>", "", html, flags=re.DOTALL)
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", outside)
    assert "default-src 'none'" in unescape(outside)
    assert "url(" not in re.search(r"<style>(.*?)</style>", html, re.DOTALL)[1]


def test_every_colour_of_the_page_is_defined(view):
    defined = set(re.findall(r"--([\w-]+):", view.html))
    used = set(re.findall(r"""(?:var\(|ink\(["'`])--([^)"'`]*)""", view.html))
    assert {"page", "held-out", "action"} <= used <= defined


def test_names_cannot_leave_their_place(cell, tmp_path):
    table = pd.read_csv(cell / "poses.csv", dtype=str)
    table["group"] = HOSTILE
    table["pose"] = table["pose"] + HOSTILE
    table.to_csv(tmp_path / "hostile.csv", index=False)
    html = irbcal.view(cell / "cal", tmp_path / "hostile.csv").html
    assert "window.hacked=1" in html  # the name is there ...
    assert "<script>window" not in html  # ... and is no element
    assert "<img" not in html
    assert data_of(html)["poses"]["groups"] == [HOSTILE]
    assert json.loads(page.escaped_json(HOSTILE + "\u2028")) == HOSTILE + "\u2028"


def test_robot_names_are_escaped_in_the_title(tmp_path):
    path = tmp_path / "arm.urdf"
    text = robots.robot_file("irb120").read_text()
    path.write_text(re.sub(r'<robot[^>]*name="[^"]*"', '<robot name="&lt;/title&gt;&lt;img src=x&gt;"', text, count=1))
    html = irbcal.view(path).html
    assert "<img" not in html
    assert "&lt;/title&gt;&lt;img" in html


def test_every_body_is_recorded(cell):
    scene = building.view(cell / "cal", cell / "poses.csv").scene
    recorder = page.record(scene)
    commands = [umsgpack.unpackb(command) for command in recorder.commands]
    drawn = {command["path"] for command in commands if command["type"] == "set_object"}
    links = {f"/irbcal/robot/{k}{coarse}" for k in scene.meshes for coarse in ("", "/coarse")}
    assert drawn == {*links, "/irbcal/tracker", "/irbcal/cube"}
    assert len(recorder.as_text()) == len(commands)


def test_positions_reach_the_viewer_as_they_are(cell):
    scene = building.view(cell / "cal", plan=np.zeros((2, 6))).scene
    commands = [umsgpack.unpackb(command) for command in page.record(scene).commands]
    k, mesh = next(iter(scene.meshes.items()))
    (command,) = [c for c in commands if c.get("path") == f"/irbcal/robot/{k}" and c["type"] == "set_object"]
    (geometry,) = command["object"]["geometries"]
    position = geometry["data"]["attributes"]["position"]["array"]
    assert np.array_equal(np.frombuffer(position.data, "<f4").reshape(-1, 3), mesh.vertices)
    assert any(c.get("path") == "/irbcal/path" for c in commands)
