"""The page as text: what is in it, what is not, and who may fetch it."""

import base64
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
from html import unescape

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import IrbcalError
from irbcal.viewer import page, server

HOSTILE = "</script><script>window.hacked=1</script><!--<img src=x onerror=window.hacked=2>\u2028"


@pytest.fixture(scope="module")
def view(cell):
    return irbcal.view.show(cell / "cal", cell / "poses.csv")


def data_of(html):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)[1])


def floats(text, columns):
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, columns)


def test_numbers_on_the_page_are_those_of_the_scene(view):
    data = data_of(view.html)
    points = view.scene.points
    # errors are differences of metres: taken before rounding, they keep their digits
    assert np.abs(floats(data["points"]["error_calibrated"], 3) - points.error()).max() < 1e-9
    assert np.abs(floats(data["points"]["measured"], 3) - points.measured).max() < 1e-6
    assert np.abs(floats(data["poses"]["effective"], 6) - view.scene.effective).max() < 1e-6
    assert data["magnification"] == view.scene.magnification
    assert data["scale"]["top_mm"] * 1e-3 == pytest.approx(view.scene.scale_top)


def test_nothing_on_the_page_is_fetched(view):
    html = view.html
    outside = re.sub(r"<script[^>]*>.*?</script>|<style>.*?</style>", "", html, flags=re.DOTALL)
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", outside)
    assert "default-src 'none'" in unescape(outside)
    assert "url(" not in re.search(r"<style>(.*?)</style>", html, re.DOTALL)[1]


def test_names_cannot_leave_their_place(cell, tmp_path):
    table = pd.read_csv(cell / "poses.csv", dtype=str)
    table["group"] = HOSTILE
    table["pose"] = table["pose"] + HOSTILE
    table.to_csv(tmp_path / "hostile.csv", index=False)
    html = irbcal.view.show(cell / "cal", tmp_path / "hostile.csv").html
    assert "window.hacked=1" in html  # the name is there ...
    assert "<script>window" not in html  # ... and is no element
    assert "<img" not in html
    assert data_of(html)["poses"]["groups"] == [HOSTILE]
    assert json.loads(page.escaped_json(HOSTILE)) == HOSTILE


def test_robot_names_are_escaped_in_the_title(tmp_path):
    path = tmp_path / "arm.urdf"
    text = irbcal.shipped.robot_file("irb120").read_text()
    path.write_text(re.sub(r'<robot[^>]*name="[^"]*"', '<robot name="&lt;/title&gt;&lt;img src=x&gt;"', text, count=1))
    html = irbcal.view.show(path).html
    assert "<img" not in html
    assert "&lt;/title&gt;&lt;img" in html


def test_notebooks_get_a_frame_of_their_own(view):
    text = view._repr_html_()
    assert text.startswith("<iframe sandbox=")
    assert "allow-same-origin" not in text
    srcdoc = re.search(r'srcdoc="([^"]*)"></iframe>$', text)[1]
    assert "<" not in srcdoc
    assert len(srcdoc) > len(view.html)


def test_saving(view, tmp_path):
    assert view.save(tmp_path / "view.html").read_text(encoding="utf-8") == view.html
    assert [path.name for path in tmp_path.iterdir()] == ["view.html"]
    with pytest.raises(IrbcalError, match="found a folder"):
        view.save(tmp_path)


def test_import_stays_quick():
    code = "import irbcal, sys; irbcal.view; print([m for m in ('meshcat', 'pinocchio', 'jinja2') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- server ------------------------------------------------------------------------------------------------------


def get(port, path="/", host=None, address="127.0.0.1"):
    connection = http.client.HTTPConnection(address, port, timeout=5)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def own_addresses():
    """Addresses of this computer other than 127.0.0.1; all of 127/8 is this computer on Linux."""
    addresses = ["127.0.0.2"] if sys.platform == "linux" else []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # nothing is sent: this only chooses an interface
            addresses.append(probe.getsockname()[0])
        except OSError:
            pass
    return addresses


def test_only_this_computer_is_served():
    with server.serving("<p>hello</p>", 0) as address:
        port = int(address.rstrip("/").rsplit(":", 1)[1])
        assert address.startswith("http://127.0.0.1:")
        assert get(port) == (200, b"<p>hello</p>")
        assert get(port, host="localhost:9999")[0] == 200  # through a tunnel
        assert get(port, host="evil.example")[0] == 403
        assert get(port, "/etc/passwd")[0] == 404
        assert get(port, "/../../etc/passwd")[0] == 404
        for other in own_addresses():
            with pytest.raises(OSError, match=r"refused|timed out|unreachable"):
                socket.create_connection((other, port), timeout=2)
        with pytest.raises(IrbcalError, match=f"port {port} "), server.serving("", port):
            pass
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port), timeout=2)


# --- command line --------------------------------------------------------------------------------------------------


def command(*arguments):
    return [sys.executable, "-m", "irbcal", "view", *map(str, arguments)]


def run(*arguments):
    environment = os.environ | {"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}
    return subprocess.run(command(*arguments), capture_output=True, text=True, timeout=60, env=environment)


def called(*arguments):
    """The command in this process."""
    return CliRunner().invoke(app, ["view", *map(str, arguments)])


def test_command_serves_until_interrupted(cell):
    with subprocess.Popen(command("irb120", "--port", "0"), stdout=subprocess.PIPE, text=True) as process:
        try:
            line = process.stdout.readline()
            port = int(re.search(r"http://127\.0\.0\.1:(\d+)/", line)[1])
            assert f"ssh -L {port}:127.0.0.1:{port}" in process.stdout.readline()
            assert b"irbcal view" in get(port)[1]
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(timeout=10) == 0


def test_command_writes_a_page(cell, tmp_path):
    done = called(cell / "cal", cell / "poses.csv", "--html", tmp_path / "view.html", "--magnify", 25)
    assert done.exit_code == 0, done.output
    assert "Written to" in done.output
    assert data_of((tmp_path / "view.html").read_text(encoding="utf-8"))["magnification"] == 25


def test_command_refuses_in_one_sentence(cell, tmp_path):
    (tmp_path / "bad.csv").write_text("pose,target,x_mm\n1,a,2\n")
    done = run(cell / "cal", tmp_path / "bad.csv", "--html", tmp_path / "view.html")
    assert done.returncode == 1
    assert done.stdout == ""
    assert "missing column" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "view.html").exists()
    assert called("irb120", "--port", "70000").exit_code == 2
