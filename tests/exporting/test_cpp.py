"""The C++ header compiles without a warning and computes what irbcal computes."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from export_harness import COMPILERS, compiled, computed, situations
from support import assert_derivative

from irbcal.exporting import cpp
from irbcal.exporting.source import Source

pytestmark = pytest.mark.skipif(not COMPILERS, reason="no C++ compiler")
OTHERS = [("ur10", 1000), ("panda", 1000), ("level", 200), ("rail", 200), ("plain", 100)]


@pytest.mark.parametrize(
    ("compiler", "name", "poses"),
    [(*COMPILERS[:1], "irb1600", 10_000), *((*COMPILERS[-1:], name, poses) for name, poses in OTHERS)],
)
def test_the_header_computes_what_irbcal_computes(sources, tmp_path, compiler, name, poses):
    """By g++ as fast as it goes, with fused multiplications; by clang++, which compiles sooner, without."""
    source = sources[name]
    robot = source.robot
    program = compiled(source, tmp_path, compiler, ("-O1", "-march=native") if poses > 1000 else ("-O0",))
    q, situation = situations(robot, poses, 11)
    theta, T, _, _, back, again, flags = computed(program, q, situation)
    assert np.abs(theta - robot.joint_map.effective(q, **situation)).max() < 1e-12
    wanted = robot.forward(q, **situation)[:, :3]
    assert np.abs(T - wanted).max() < 1e-12
    assert flags[:, 0].all()
    assert np.abs(back - q).max() < 1e-12
    found = flags[:, 1] == 1.0
    assert found.mean() > 0.98  # the others are next to singularities
    assert np.abs(again - wanted)[found].max() < 5e-12

    q, before = (
        q[1:4],
        situation["previous"][1:4],
    )  # stops that are known, the usual load: irbcal's own derivative is for that
    load = {"kg": np.full(3, source.numbers.payload_kg), "place": np.tile(source.numbers.payload_centre, (3, 1))}
    _, _, M, J, *_ = computed(program, q, {"previous": before, **load, "torques": np.zeros(q.shape)})
    assert np.abs(M - robot.joint_map.jacobian(q, before)).max() < 1e-12
    assert_derivative(lambda x: robot.forward(x[None], before[:1])[0, :3, 3], q[0], J[0, :3], 1e-8, 1e-5)


def test_the_check_sees_a_wrong_number(sources, tmp_path):
    source = sources["irb1600"]
    for name, content in cpp.files(source).files.items():
        (tmp_path / name).write_bytes(content)
    (check,) = tmp_path.glob("*_check.cpp")
    call = [
        COMPILERS[0],
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-fno-exceptions",
        check,
        "-o",
        tmp_path / "check",
    ]
    subprocess.run(call, check=True)
    assert subprocess.run([tmp_path / "check"], capture_output=True).returncode == 0
    (header,) = tmp_path.glob("*.hpp")
    text = header.read_text()
    assert source.numbers.version in text
    header.write_text(text.replace(repr(float(source.numbers.gain[2])), repr(float(source.numbers.gain[2]) + 1e-9)))
    subprocess.run(call, check=True)
    assert subprocess.run([tmp_path / "check"], capture_output=True).returncode == 1


def test_the_example_of_the_page(folder, tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "exports.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```cpp\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "example.cpp").write_text(code)
    program = compiled(Source.from_calibration(folder), tmp_path, COMPILERS[0], main=tmp_path / "example.cpp")
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stdout.split()[1:] == ["-0.200000000", "1"]
