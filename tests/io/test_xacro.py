"""xacro files as robots: the oracle is the package xacro itself, on files that ask for nothing dangerous."""

import os
import re

import numpy as np
import pytest
import xacro
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import irbcal
from irbcal.errors import RobotError
from irbcal.io import robots, urdf, xacro_file

ARM = """<?xml version="1.0"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="two">
  <xacro:include filename="$(find arm_parts)/urdf/link.xacro"/>
  <xacro:arg name="kind" default="short"/>
  <xacro:property name="sizes" value="${xacro.load_yaml('$(find arm_parts)/config/' + '$(arg kind)' + '.yaml')}"/>
  <xacro:property name="reach" value="${sizes['reach'] if sizes['known'] else 0.0}"/>
  <link name="base_link"/>
  <xacro:segment number="1" parent="base_link" at="0 0 ${reach}" limit="${radians(170)}"/>
  <xacro:segment number="2" parent="link_1" at="${max(reach, 0.1) * 2 ** 2 / 4} 0 ${-sizes.side}" limit="${sizes.limit}"/>
  <xacro:segment number="3" parent="link_2" at="0 ${cos(pi / 3)} 0" limit="${2 * pi}"/>
</robot>
"""
LINK = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="segment" params="number parent at limit rpy:='0 0 0'">
    <link name="link_${number}"/>
    <joint name="joint_${number}" type="revolute">
      <parent link="${parent}"/> <child link="link_${number}"/>
      <origin xyz="${at}" rpy="${rpy}"/>
      <xacro:if value="${number % 2 == 0 and not number > 5}"><axis xyz="0 1 0"/></xacro:if>
      <xacro:unless value="${number in [2, 4]}"><axis xyz="0 0 1"/></xacro:unless>
      <limit lower="${-limit}" upper="${limit}" velocity="1" effort="1"/>
    </joint>
  </xacro:macro>
</robot>
"""


def written(folder, arm=ARM, **files):
    """An arm's package and that of its parts beside one another."""
    parts = {"short.yaml": "reach: 0.4\nknown: true\nside: 0.05\nlimit: !degrees 90.0\n"}
    parts |= {"long.yaml": "reach: !millimeters 900.0\nknown: true\nside: 0.05\nlimit: 3.0\n"} | files
    for name in ("arm_support/urdf", "arm_parts/urdf", "arm_parts/config"):
        (folder / name).mkdir(parents=True)
    (folder / "arm_support" / "package.xml").write_text("<package><name>arm_support</name></package>")
    (folder / "arm_parts" / "urdf" / "link.xacro").write_text(LINK)
    for name, text in parts.items():
        (folder / "arm_parts" / "config" / name).write_text(text)
    file = folder / "arm_support" / "urdf" / "two.urdf.xacro"
    file.write_text(arm)
    return file


def expression(text, **symbols):
    return xacro_file._Expression(robots.robot_file("irb1600")).of_text(text, symbols)


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_a_description_is_the_robot_that_its_urdf_is(name):
    file = robots.urdf_folder() / "irbcal_description" / "urdf" / f"{name}.urdf.xacro"
    expanded, plain = urdf.read(file).arm, urdf.read(name).arm
    q = plain.random_joints(30, 0)
    np.testing.assert_allclose(expanded.forward(q), plain.forward(q), rtol=0, atol=1e-12)
    assert urdf.read(f"{file} prefix:=left_").arm.joint_names == tuple(f"left_{each}" for each in plain.joint_names)


def test_packages_arguments_yaml_and_units(tmp_path):
    """Lengths and limits by hand: joint 2 lies 0.4 (or 0.9) m beside joint 1's axis, as high as that less 0.05 m."""
    file = written(tmp_path)
    for given_arguments, reach, limit in (("", 0.4, np.pi / 2), (" kind:=long", 0.9, 3.0)):
        arm = urdf.read(f"{file}{given_arguments}").arm
        T = arm.forward(np.zeros((1, 3)))[0]
        np.testing.assert_allclose(T[:3, 3], [reach, 0.5, reach - 0.05], rtol=0, atol=1e-12)
        assert (arm.lower[1], arm.upper[1]) == pytest.approx((-limit, limit))


def test_the_calibration_is_of_the_expanded_file(tmp_path):
    folder = robots.urdf_folder() / "irbcal_description" / "urdf"
    data = robots.demo_file("demo_identification.csv")
    results = [irbcal.calibrate(data, file, "11", holdout=0) for file in (folder / "irb1600.urdf.xacro", "irb1600")]
    first, second = (result.robot_calibrated() for result in results)
    q = first.arm.random_joints(20, 1)
    np.testing.assert_allclose(first.poses(q), second.poses(q), rtol=0, atol=1e-12)
    results[0].save(tmp_path / "robot")
    assert irbcal.load(tmp_path / "robot").record.robot.urdf == "irb1600.urdf.xacro"
    assert b"xacro:" not in (tmp_path / "robot" / "calibrated.urdf").read_bytes()


NUMBERS = st.one_of(st.integers(-50, 50), st.floats(-50, 50, allow_nan=False).map(lambda x: round(x, 3))).map(str)


def combined(inner):
    two = st.tuples(inner, st.sampled_from(["+", "-", "*", "<", ">=", "==", "and", "or"]), inner)
    choice = st.tuples(inner, inner, inner).map(lambda x: f"({x[0]} if {x[1]} else {x[2]})")
    called = st.tuples(st.sampled_from(["cos", "python.abs", "radians", "math.sin", "python.round"]), inner)
    return st.one_of(
        two.map(lambda x: f"({x[0]} {x[1]} {x[2]})"), choice, called.map(lambda x: f"{x[0]}({x[1]})"),
        inner.map(lambda x: f"(-{x})"), inner.map(lambda x: f"(not {x})"), inner.map(lambda x: f"[{x}, a][1]"),
    )  # fmt: skip


@given(st.recursive(NUMBERS | st.just("a"), combined, max_leaves=8))
def test_expressions_have_the_values_that_xacro_gives_them(text):
    symbols = {"a": 0.25}
    oracle = xacro.safe_eval(text, dict(xacro._global_symbols) | symbols)
    assert expression(text, **symbols) == pytest.approx(oracle, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "(x for x in ()).gi_frame.f_back.f_globals",
        "[c for c in (1,)]",
        "(lambda: 1)()",
        "''.join(['a'])",
        "str.mro()",
        "a._name",
        "a.clear()",
        "python.vars()",
        "math.factorial(10)",
        "'x' * 10**9",
        "[0] * 10**9",
        "__import__('os').system('true')",
        "f'{a}'",
        "a[lambda: 1]",
        "1 << 9",
        "9999999999 * 9999999999",
        "int('9' + '9999999999999999999')",
        "load_yaml('/etc/passwd')",
    ],
)
def test_expressions_never_become_code(text):
    with pytest.raises((ValueError, NameError, KeyError, TypeError, SyntaxError)):
        expression(text, a={"clear": 1})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"$(find arm_parts)/urdf": "$(find missing_parts)/urdf"}, "missing_parts is not beside"),
        ({"${reach}": "$(env HOME)"}, "environment variable HOME"),
        ({"${reach}": "${().__class__}"}, "does not compute"),
        ({"${reach}": "$(eval [x for x in 'ab'])"}, "does not compute"),
        ({"${reach}": "${later}"}, "later"),
        ({"short": "absent"}, "absent.yaml"),
        ({'name="reach" value="': 'name="reach" value="${reach} '}, "circular"),
        ({"urdf/link.xacro": "../arm_support/urdf/two.urdf.xacro"}, "cannot be expanded"),
        ({'<link name="base_link"/>': "<xacro:segment/>"}, "Undefined parameters"),
    ],
)
def test_bad_files_are_refused_in_a_sentence(tmp_path, change, words):
    text = ARM
    for old, new in change.items():
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(RobotError, match=re.escape(words)) as caught:
        urdf.read(written(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert "xacro FILE > robot.urdf" in str(caught.value)


def test_what_grows_without_end_is_stopped(tmp_path, monkeypatch):
    """Each macro calls the next one ten times: ten millions of links."""
    monkeypatch.setattr(xacro_file, "MOST_STEPS", 2000)
    macros = (
        "".join(f'<xacro:macro name="m{k}">{f"<xacro:m{k + 1}/>" * 10}</xacro:macro>' for k in range(7))
        + '<xacro:macro name="m7"><link name="x"/></xacro:macro><xacro:m0/>'
    )
    with pytest.raises(RobotError, match="steps"):
        urdf.read(written(tmp_path, ARM.replace('<link name="base_link"/>', macros)))


@pytest.mark.parametrize(
    ("first", "next_value"),
    [
        ("${99999999999}", "${x%d * x%d}"),
        ("${['a', 'a']}", "${[x%d, x%d, x%d, x%d]}"),
        ("aaaaaaaaaa", "${x%d}${x%d}${x%d}${x%d}"),
        ("a" * 90_000, "${x%d}"),
    ],
)
def test_values_that_double_again_and_again_are_refused(tmp_path, first, next_value):
    values = [first, *(next_value.replace("%d", str(k)) for k in range(40))]
    properties = "".join(f'<xacro:property name="x{k}" value="{value}"/>' for k, value in enumerate(values))
    used = "".join(f'<link name="${{x40}}{k}"/>' for k in range(300))
    with pytest.raises(RobotError, match=r"too large|too long|characters"):
        urdf.read(written(tmp_path, ARM.replace('<link name="base_link"/>', properties + used)))


@pytest.mark.parametrize("name", ["../../secret.yaml", "$(find secrets)/../secret.yaml", "$(find ..)/secret.yaml"])
def test_files_outside_the_packages_are_not_read(tmp_path, name):
    file = written(tmp_path, ARM.replace("$(find arm_parts)/config/' + '$(arg kind)' + '.yaml", name))
    (tmp_path / "secrets").mkdir()
    (tmp_path / "secret.yaml").write_text("reach: 0.4\nknown: true\nside: 0.05\nlimit: 1.0\n")
    with pytest.raises(RobotError, match=r"outside the packages of this robot|is no name of a package"):
        urdf.read(file)


def test_aliases_of_a_yaml_file_are_refused(tmp_path):
    with pytest.raises(RobotError, match="anchors and aliases are not taken"):
        urdf.read(written(tmp_path, **{"short.yaml": "a: &a [1, 1]\nb: [*a, *a]\n"}))


def test_included_files_are_read_as_untrusted_input(tmp_path):
    file = written(tmp_path)
    link = tmp_path / "arm_parts" / "urdf" / "link.xacro"
    link.write_text(f"<!DOCTYPE x [<!ENTITY a 'b'>]>{LINK}")
    with pytest.raises(RobotError, match="entities are refused"):
        urdf.read(file)
    link.unlink()
    os.mkfifo(link)
    with pytest.raises(RobotError, match="expected a file, found a pipe"):
        urdf.read(file)


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_damaged_files_are_read_or_refused(tmp_path_factory, data):
    """Parts of the file cut out, doubled and exchanged."""
    a, b, c = sorted(data.draw(st.integers(0, len(ARM))) for _ in range(3))
    text = data.draw(st.sampled_from([ARM[:a] + ARM[b:], ARM[:b] + ARM[a:], ARM[:a] + ARM[b:c] + ARM[a:b] + ARM[c:]]))
    try:
        urdf.read(written(tmp_path_factory.mktemp("damaged"), text))
    except RobotError as error:
        assert "\n" not in str(error)


def test_macros_without_a_call_and_arguments_without_xacro_are_refused():
    macro = robots.urdf_folder() / "irbcal_description" / "urdf" / "irb1600_macro.xacro"
    with pytest.raises(RobotError, match="declares macros and calls none"):
        urdf.read(macro)
    with pytest.raises(RobotError, match="a URDF takes no arguments"):
        urdf.read("irb1600 prefix:=left_")


def test_an_expansion_leaves_the_package_xacro_as_it_was(tmp_path):
    before = xacro.safe_eval, xacro.parse, xacro.eval_all
    with pytest.raises(RobotError):
        urdf.read(written(tmp_path, ARM.replace("${reach}", "${nothing}")))
    assert (xacro.safe_eval, xacro.parse, xacro.eval_all) == before


def test_packages_far_away_are_named(tmp_path):
    file = written(tmp_path / "here")
    (tmp_path / "there").mkdir()
    os.rename(tmp_path / "here" / "arm_parts", tmp_path / "there" / "arm_parts")
    with pytest.raises(RobotError, match="--package-dir"):
        urdf.read(file)
    for folder in (tmp_path / "there", tmp_path / "there" / "arm_parts"):
        assert len(irbcal.read_urdf(file, package_dirs=[folder]).arm.joint_names) == 3
