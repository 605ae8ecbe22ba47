"""Without Pinocchio, example-robot-data, meshcat and what extras bring, the main job works and says what it lacks."""

import json
import re
import subprocess
import sys
from pathlib import Path

from irbcal.io import robots

WITHOUT = """
import gc, importlib.util, sys
gc.set_threshold(300000, 20, 100)  # as the program does
ABSENT = set(sys.argv.pop(1).split(","))
find_spec = importlib.util.find_spec

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name.partition(".")[0])

sys.meta_path.insert(0, Absent())
importlib.util.find_spec = lambda name, package=None: None if name.partition(".")[0] in ABSENT else find_spec(name, package)
from irbcal.__main__ import Late
sys.modules.setdefault("pandas", Late("pandas"))
from irbcal.cli.main import main
codes = []
for line in sys.argv.pop(1).splitlines():
    sys.argv = ["irbcal", *line.split("|")]
    try:
        codes.append(main())
    except SystemExit as end:
        codes.append(end.code)
print([code or 0 for code in codes])
"""


LIGHT = [
    "pinocchio",
    "meshcat",
    "sqlalchemy",
    "cv2",
    "pyarrow",
    "distributed",
    "casadi",
    "psycopg",
    "cryptography",
    "rosbags",
]
BALLAST = [
    line.replace("-", "_").partition("_path")[0]  # svg-path is the module svg.path
    for line in (Path(__file__).parents[1] / "scripts" / "ballast.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]


def light(*lines, absent=LIGHT, then=""):
    """Command lines one after the other in a process: their exit codes, and both streams."""
    words = "\n".join("|".join(map(str, line)) for line in lines)
    command = [sys.executable, "-c", WITHOUT + then, ",".join(absent), words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(re.findall(r"^\[[\d, ]+\]$", done.stdout, re.MULTILINE)[-1]), done.stdout, done.stderr


def test_a_calibration_is_written_and_names_its_witnesses(tmp_path):
    data = robots.demo_file("demo_identification.csv")
    codes, out, err = light(
        ("calibrate", data, "--robot", "irb1600", "--model", "placement", "--out", tmp_path / "c", "--json"),
        ("evaluate", tmp_path / "c", robots.demo_file("demo_verification.csv")),
        ("verify", tmp_path / "c"),
        absent=[*LIGHT, "pandas"],
    )
    assert codes == [0, 0, 0], err
    check = json.JSONDecoder().raw_decode(out)[0]["urdf_witnesses"]
    assert list(check["witnesses"]) == ["irbcal's reader", "yourdfpy"]
    assert max(check["position_m"], check["rotation_rad"]) < 1e-9
    report = (tmp_path / "c" / "report.html").read_text(encoding="utf-8")
    assert "read it differs from irbcal" in report
    assert "Pinocchio (" not in report


def test_what_an_extra_brings_is_said_in_one_line(tmp_path):
    (tmp_path / "f.db").write_bytes(b"")
    codes, _, err = light(
        ("fleet", "list", "--store", tmp_path / "f.db"),
        ("fleet", "--help"),
        ("fleet", "calibrate", tmp_path / "none.csv", "--out", tmp_path / "f"),
    )
    assert codes == [1, 0, 1]
    assert "pip install 'irbcal[fleet]'" in err
    assert "Traceback" not in err
    assert err.count("none.csv") == 1


THEN = """
import meshcat, pinocchio, yourdfpy
from irbcal.io import robots
drawn = yourdfpy.URDF.load(str(robots.robot_file("ur5")), filename_handler=robots.mesh_file)
print(len(drawn.scene.geometry))
"""


def test_the_demo_needs_none_of_the_ballast_that_its_lock_leaves_out(tmp_path):
    """Meshes in COLLADA and STL, the witnesses, and the packages that the ballast belongs to."""
    data = robots.demo_file("demo_identification.csv")
    codes, out, err = light(
        ("calibrate", data, "--robot", "irb1600", "--model", "placement", "--out", tmp_path / "c"),
        ("view", tmp_path / "c", "--html", tmp_path / "v.html"),
        ("export", tmp_path / "c", "--as", "mujoco", "--out", tmp_path / "m"),
        absent=BALLAST,
        then=THEN,
    )
    assert codes == [0, 0, 0], err
    assert "Note" not in out
    assert out.splitlines()[-1] == "24"
    assert {path.name for path in tmp_path.iterdir()} == {"c", "v.html", "m"}
