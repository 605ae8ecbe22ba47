"""Without Pinocchio, example-robot-data, meshcat and what extras bring, the main job works and says what it lacks."""

import json
import subprocess
import sys
from pathlib import Path

from irbcal.io import robots

WITHOUT = """
import importlib.util, sys
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
main()
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


def light(*arguments, absent=LIGHT):
    command = [sys.executable, "-c", WITHOUT, ",".join(absent), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def test_a_calibration_is_written_and_names_its_witnesses(tmp_path):
    data = robots.demo_file("demo_identification.csv")
    robot = ("--robot", "irb1600", "--model", "placement")
    done = light("calibrate", data, *robot, "--out", tmp_path / "c", "--json", absent=[*LIGHT, "pandas"])
    assert done.returncode == 0, done.stderr
    for words in (("evaluate", tmp_path / "c", robots.demo_file("demo_verification.csv")), ("verify", tmp_path / "c")):
        assert light(*words, absent=[*LIGHT, "pandas"]).returncode == 0
    check = json.loads(done.stdout)["urdf_witnesses"]
    assert list(check["witnesses"]) == ["irbcal's reader", "yourdfpy"]
    assert max(check["position_m"], check["rotation_rad"]) < 1e-9
    report = (tmp_path / "c" / "report.html").read_text(encoding="utf-8")
    assert "read it differs from irbcal" in report
    assert "Pinocchio (" not in report


def test_what_an_extra_brings_is_said_in_one_line(tmp_path):
    (tmp_path / "f.db").write_bytes(b"")
    done = light("fleet", "list", "--store", tmp_path / "f.db")
    assert done.returncode == 1
    assert "pip install 'irbcal[fleet]'" in done.stderr
    assert "Traceback" not in done.stderr
    assert light("fleet", "--help").returncode == 0
    assert light("fleet", "calibrate", tmp_path / "none.csv", "--out", tmp_path / "f").stderr.count("none.csv") == 1


def test_the_demo_needs_none_of_the_ballast_that_its_lock_leaves_out(tmp_path):
    """Meshes in COLLADA and STL, the witnesses, and the packages that the ballast belongs to."""
    data = robots.demo_file("demo_identification.csv")
    lines = (
        ("calibrate", data, "--robot", "irb1600", "--model", "placement", "--out", tmp_path / "c"),
        ("view", tmp_path / "c", "--html", tmp_path / "v.html"),
        ("export", tmp_path / "c", "--as", "mujoco", "--out", tmp_path / "m"),
    )
    loads = (
        "import meshcat, pinocchio, yourdfpy; from irbcal.io import robots; "
        "print(len(yourdfpy.URDF.load(str(robots.robot_file('ur5')), filename_handler=robots.mesh_file).scene.geometry))"
    )
    hidden = WITHOUT.replace(
        "\nmain()\n",
        f"""
for sys.argv in {[["irbcal", *map(str, words)] for words in lines]}:
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
{loads}
""",
    )
    done = subprocess.run(
        [sys.executable, "-c", hidden, ",".join(BALLAST)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Note" not in done.stdout
    assert done.stdout.splitlines()[-1] == "24"
    assert {path.name for path in tmp_path.iterdir()} == {"c", "v.html", "m"}
